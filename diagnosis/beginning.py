"""The state in which a log begins, as far as its readings do not show it: velocities, the twist of a spring or a play,
the heat of a winding.

Machines begin at rest, as a rule, an arm hanging in its spring and a motor cold; simulators often do not, a motor that
has just worked is warm, and logs may be cut out of longer ones. A lightly damped spring remembers that for longer than
the burn-in, and a winding for as long as it takes to cool down.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from diagnosis.estimation import Fitted, Point, errors, predicted_motion
from diagnosis.instants import log_of, with_instants
from diagnosis.problem import Free, Problem, start_deviation
from diagnosis.replay import transfer
from diagnosis.turns import free_of_filter
from diagnosis.whitening import Whitener, on_logs
from envs.log import Array
from methods.kernel import BEGINNING, NOMINAL

VELOCITY, TWIST, TWIST_RATE, HEAT = (BEGINNING.index(name) for name in ("velocity", "twist", "twist rate", "heat"))
WARMS = "thermal_drift"
"""The effect that heats the winding."""
LEAST_RISE = 1e-3
"""Relative rise of resistance that a winding may have at least."""
SMALL = 0.01
"""Change of a state, as a share of its typical size, by which the response to it is taken."""
ROUNDS = 5
"""How often states at the beginning of a log are regressed at most."""
SETTLED = 1e-3
"""Relative decrease of the squares of what is seen of them that any but the first time has to bring."""
WORTHWHILE = 2.0
"""Least decrease of -2 log likelihood per state."""


@dataclass(frozen=True)
class Hidden:
    """A state of a joint at the beginning of logs (column of `methods.kernel.BEGINNING`) and its typical size."""

    joint: int
    column: int
    size: float

    @property
    def least(self) -> float:
        """The least that it can be: no winding is colder than cold."""
        return 0.0 if self.column == HEAT else -np.inf


def twists(problem: Problem, point: Point) -> Iterator[Hidden]:
    """The twist of every joint's spring or play and its rate.

    Of the size that the largest motor torque t makes of it, ``t / (r J w^2) + g / 2``, with the inertia J, the share r
    of it behind the spring, its natural frequency w, and the gap g of a play.
    """
    motion = None
    for j in range(problem.joints):
        for effect in problem.kernel.effects:
            if not (point.switches[j, problem.kernel.switches[effect.name]] and effect.parts_the_arm):
                continue
            names = [parameter.name for parameter in effect.parameters]
            if motion is None:
                motion = predicted_motion(problem, point)
            own = dict(zip(names, point.parameters[0, j, problem.kernel.own(effect)].tolist(), strict=True))
            frequency = 2.0 * np.pi * own["frequency"]
            stiffness = point.parameters[0, j, NOMINAL.index("inertia")] * own["inertia_ratio"] * frequency**2
            size = float(np.max(np.abs(motion[:, j, 2]))) / max(stiffness, 1e-300) + 0.5 * own.get("gap", 0.0)
            yield Hidden(j, TWIST, size)
            yield Hidden(j, TWIST_RATE, frequency * size)


def heats(problem: Problem, point: Point) -> Iterator[Hidden]:
    """The relative rise of resistance of every joint whose winding drifts, of the size that it has in the end."""
    for j in range(problem.joints):
        for effect in problem.kernel.effects:
            if effect.label == WARMS and point.switches[j, problem.kernel.switches[effect.name]]:
                rise = float(point.parameters[0, j, problem.kernel.column(effect, "resistance_rise")])
                yield Hidden(j, HEAT, max(abs(rise), LEAST_RISE))


def unread(problem: Problem, point: Point) -> Iterator[Hidden]:
    """All states at the beginning of logs that no reading shows."""
    yield from twists(problem, point)
    yield from heats(problem, point)


def beginnings_settled(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with the twists of springs and plays and the heat of windings at the beginning of every log free, where
    that does better.

    Their prior is all that they cost: they are no properties of the machine. Begun with the errors as they are, since
    the filter takes for noise what swings in all logs alike.
    """
    point, names = fitted.point, {f.name for f in fitted.point.free}
    free = [
        Free(name, "start", item.joint, item.column, item.size, lower=item.least, log=log, deviation=item.size)
        for item in unread(problem, point)
        for log in range(problem.logs)
        if (name := f"{BEGINNING[item.column]}@{item.joint}#{log}") not in names
    ]
    if not free:
        return fitted
    other = free_of_filter(problem, replace(point, free=(*point.free, *free)))
    return other if other.criterion < fitted.criterion - WORTHWHILE * len(free) else fitted


def started(problem: Problem, point: Point, filter_: Whitener) -> Point:
    """A point fitted on other logs, made ready for these, with the instants of events, states at the beginning and
    phases of periodic disturbances as these logs have them."""
    timed = with_instants(problem, transfer(problem, point), filter_)
    return with_phases(problem, with_states(problem, timed, filter_), filter_)


def with_states(problem: Problem, point: Point, filter_: Whitener) -> Point:
    """The point with the velocities, twists and heats at the beginning of these logs that their readings tell beside
    the model.

    The velocities of `transfer` are smoothed over a stretch in which a command that sets in at once may have changed
    them by much. Here the whitened prediction errors of a log (`seen`) are regressed on the responses to other states,
    each known beforehand: velocities as `start_deviation` says, the others by their typical size. Again from there, as
    long as that still does better: a winding that is as warm as it becomes makes another motion than to first order.
    A joint may also have begun at rest (`rested`).
    """
    whiten, states = on_logs(problem, filter_), pushes(problem, point)
    size = SMALL * np.array([item.size for item in states])
    place = [item.joint for item in states], [item.column for item in states]
    least = np.array([item.least for item in states])
    fastest = (np.max(np.abs(problem.velocity[a:b]), axis=0) for a, b in pairwise(problem.bounds))
    deviations = [
        np.array([speed[item.joint] if item.column == VELOCITY else item.size for item in states])
        for speed in (start_deviation(problem, own) for own in fastest)
    ]
    best, error = point, errors(problem, [point])[0]
    for turn in range(ROUNDS):
        starts, every = best.starts.copy(), np.stack([error, *errors(problem, pushed(best, states))])
        for log, deviation in enumerate(deviations):
            plain, *others = seen(problem, whiten, every, log)
            noise = float(np.sqrt(np.mean(plain[: problem.joints * len(whiten.rows)] ** 2)))
            responses = np.stack([other - plain for other in others], axis=1)
            basis = np.vstack([responses, np.diag(noise * size / deviation)])
            away = starts[log][place] - point.starts[log][place]
            target = np.concatenate([plain, noise * away / deviation])
            change = size * np.linalg.lstsq(basis, target, rcond=None)[0]
            starts[log][place] = np.maximum(starts[log][place] - change, least)
        moved = replace(best, starts=starts)
        again = errors(problem, [moved])[0]
        both = np.stack([error, again])
        before, after = sum(np.sum(seen(problem, whiten, both, log) ** 2, axis=1) for log in range(problem.logs))
        if not after < before * (1.0 - SETTLED if turn else 1.0):
            break
        best, error = moved, again
    return rested(problem, best, error, whiten)


def rested(problem: Problem, point: Point, error: Array, whiten: Whitener) -> Point:
    """The point at rest at the beginning of the logs that this makes likelier: dry friction holds a joint that does not
    move, and a slow one soon, so that nothing leads from the one to the other. error: (T, n) of the point."""
    still = point.starts.copy()
    still[:, :, VELOCITY] = 0.0
    both = np.stack([error, errors(problem, [replace(point, starts=still)])[0]])
    sums = np.array([np.sum(seen(problem, whiten, both, log) ** 2, axis=1) for log in range(problem.logs)])
    holds = sums[:, 1] < sums[:, 0]
    return replace(point, starts=np.where(holds[:, None, None], still, point.starts))


def seen(problem: Problem, whiten: Whitener, errors_: Array, log: int) -> Array:
    """What errors (C, T, n) show of the beginning of a log: their innovations (C, N), zero in other logs, and errors as
    they are before the first of these.

    Such errors e do not follow from those before them as far as they are innovations v: their deviation counts as
    ``s(e)^2 / s(v)``, and they are scaled to that of the innovations.
    """
    innovations, is_own = whiten(of_log(problem, errors_, log)), log_of(problem, whiten) == log
    if not np.any(is_own):
        return innovations
    own, rows = innovations[0].reshape(problem.joints, -1)[:, is_own], whiten.rows[is_own]
    share = np.mean(own**2, axis=1) / np.maximum(np.mean(errors_[0][rows] ** 2, axis=0), 1e-300)
    early = errors_[:, problem.bounds[log] : rows[0] : problem.decimation] * np.minimum(share, 1.0)
    return np.concatenate([innovations, early.reshape(len(errors_), -1)], axis=1)


def pushes(problem: Problem, point: Point) -> list[Hidden]:
    """All states at the beginning of logs that readings show badly or not at all."""
    speeds = np.std(problem.velocity, axis=0).tolist()
    return [*(Hidden(j, VELOCITY, speed) for j, speed in enumerate(speeds)), *unread(problem, point)]


def pushed(point: Point, states: Sequence[Hidden]) -> list[Point]:
    """The model with another state at the beginning of all logs, one at a time."""
    found = []
    for item in states:
        starts = point.starts.copy()
        starts[:, item.joint, item.column] += SMALL * item.size
        found.append(replace(point, starts=starts))
    return found


def of_log(problem: Problem, errors_: Array, log: int) -> Array:
    """Errors (C, T, n) of one log, zero in the others."""
    window = slice(problem.bounds[log], problem.bounds[log + 1])
    own = np.zeros_like(errors_)
    own[:, window] = errors_[:, window]
    return own


def with_phases(problem: Problem, point: Point, filter_: Whitener) -> Point:
    """The point with the phases of periodic disturbances as each of these logs has them; amplitudes stay.

    A disturbance has no reason to begin anew with a recording, so its phase is no property of the model. It is the
    regression of the whitened prediction errors of a log on the responses to sine and cosine, and to the states at its
    beginning that a coarse encoder shows badly and little friction remembers.
    """
    whiten = on_logs(problem, filter_)
    for effect in problem.kernel.effects:
        if effect.scan != "time":
            continue
        start = problem.kernel.offsets[effect.name]
        pair = [start + a for a in effect.amplitudes]
        for j in np.flatnonzero(point.switches[:, problem.kernel.switches[effect.name]]):
            size = float(np.hypot(*point.parameters[0, j, pair]))
            trials = []
            for values in ((0.0, 0.0), (size, 0.0), (0.0, size)):
                parameters = point.parameters.copy()
                parameters[:, j, pair] = values
                trials.append(replace(point, parameters=parameters))
            errors_ = errors(problem, [*trials, *pushed(trials[0], pushes(problem, point))])
            parameters = point.parameters.copy()
            for log in range(problem.logs):
                own = of_log(problem, errors_, log)
                plain, *others = whiten(own).reshape(len(own), problem.joints, -1)[:, j]
                basis = np.stack([other - plain for other in others], axis=1)
                weights = -np.linalg.lstsq(basis, plain, rcond=None)[0][:2]
                parameters[log, j, pair] = size * weights / max(float(np.linalg.norm(weights)), 1e-300)
            point = replace(point, parameters=parameters)
    return point
