"""One law in the place of another, begun where it does the same to the motion of the logs.

From a model without either, a fit may end far from what the second can do: where a spring moves the joint, a model
without it moves quite unlike, and a gradual saturation of one kind may explain nothing as the textbook's form of the
other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from diagnosis.estimation import Fitted, Point, predicted_motion
from diagnosis.hypotheses import Hypothesis, Start, extend, sizes_of, withdraw
from diagnosis.problem import Problem
from diagnosis.search import Scored, score
from diagnosis.turns import either_way
from envs.log import Array
from methods.effects.base import Effect

INSTANTS = 400
"""Samples at which the laws are compared, besides those at which the signals are largest."""
BACKWARDS = 20
"""Steps from a torque with an effect to the torque without."""
ALIKE = 0.5
"""Rms of the difference of two laws, over that of the first, up to which the second is fitted in its place."""
NEARLY = 0.1
"""The same of sums of laws, over the scatter of the first."""


@dataclass(frozen=True, eq=False)
class Signals:
    """What laws read, at some instants (N,): command, angle, velocity and motor torque."""

    command: Array
    position: Array
    velocity: Array
    torque: Array

    @classmethod
    def of(cls, problem: Problem, fitted: Fitted, joint: int) -> Signals:
        """The command and the predicted motion of a joint, all along the logs and where each is largest."""
        motion = predicted_motion(problem, fitted.point)[:, joint]
        rows = np.column_stack([problem.command[:, joint], motion])[problem.used]
        even = np.linspace(0, len(rows) - 1, INSTANTS).astype(int)
        return cls(*rows[np.unique([*even, *np.argmax(rows, axis=0), *np.argmin(rows, axis=0)])].T)


def resistance(effect: Effect, signals: Signals) -> Callable[[Array], Array] | None:
    """The torque (N,) that an effect takes from the motor's, by its parameters; None where it is no function of these
    signals alone."""
    law, s = effect.function, signals
    if law is None or effect.slot == "sensor" or effect.has_time or effect.has_neighbour:
        return None
    rows = list(zip(s.command, s.position, s.velocity, s.torque, strict=True))
    if effect.slot == "command":
        return lambda p: np.array([u - law(u, 0.0, q, dq, w, p) for u, q, dq, w in rows])
    if effect.slot == "gain":
        return lambda p: np.array([w * (1.0 - law(0.0, q, dq, w, p)) for _, q, dq, w in rows])
    if effect.slot == "friction":
        return lambda p: np.array([np.sign(dq) * law(0.0, q, dq, w, p) for _, q, dq, w in rows])
    alone = (0.0, 0.0, 0.0)
    return lambda p: np.array([law(0.0, q, dq, w, alone, p) for _, q, dq, w in rows])


def before(effect: Effect, signals: Signals, values: Array) -> Signals:
    """The signals with the motor torque as it would be without an effect of the command or the torque itself."""
    torque = signals.torque
    for _ in range(BACKWARDS if effect.slot in ("command", "gain") else 0):
        taken = resistance(effect, replace(signals, torque=torque))
        torque = torque if taken is None else signals.torque + taken(values)
    return replace(signals, torque=torque)


def imitating(
    problem: Problem, base: Fitted, smaller: Fitted, effect: Effect, other: Effect, joint: int
) -> Scored | None:
    """Another law in the place of an effect of the base; None where either is no function of the signals, or it cannot
    do nearly the same. smaller: the model without the effect, to which the score refers."""
    start = alike(problem, base, effect, other, joint)
    if start is None:
        return None
    return score(problem, smaller, start, either_way(problem, in_place(problem, base, effect, start)))


def in_place(problem: Problem, base: Fitted, effect: Effect, start: Start) -> Point:
    """The base with what another law starts from in the place of an effect."""
    hypothesis = start.hypothesis
    return extend(problem, withdraw(problem, base.point, effect.name, hypothesis.joint), hypothesis, start.values)


def together(
    problem: Problem, base: Fitted, smaller: Fitted, effect: Effect, other: Effect, joint: int, beside: Sequence[Effect]
) -> Scored | None:
    """Another law in the place of an effect of the base, those `beside` it moved so that all do together what they did;
    None where one is no function of the signals, or they cannot do nearly that. smaller: as of `imitating`."""
    signals, row = Signals.of(problem, base, joint), base.point.parameters[0, joint]
    laws = [resistance(law, signals) for law in (effect, other, *beside)]
    known = [law for law in laws if law is not None]
    if len(known) < len(laws) or other.starts is None:
        return None
    first, theirs, *moved = known
    values = [row[problem.kernel.own(law)] for law in beside]
    wanted = first(row[problem.kernel.own(effect)]) + sum(law(x) for law, x in zip(moved, values, strict=True))
    free = [parameter for law in (other, *beside) for parameter in law.parameters]
    bounds = [parameter.lower for parameter in free], [parameter.upper for parameter in free]
    ends = np.cumsum([other.size, *(law.size for law in beside)])[:-1]

    def differ(x: Array) -> Array:
        return sum(law(own) for law, own in zip((theirs, *moved), np.split(x, ends), strict=True)) - wanted

    starts = [np.concatenate([own, *values]) for own in other.starts(sizes_of(problem, base)[joint])]
    if not starts:
        return None
    best, cost = nearest(differ, starts, bounds, 60)
    if 2.0 * cost > NEARLY**2 * np.sum((wanted - np.mean(wanted)) ** 2):
        return None
    own, *rest = np.split(best, ends)
    start = Start(Hypothesis(other, joint), np.tile(own, (problem.logs, 1)), 0.0, len(starts))
    point = in_place(problem, base, effect, start)
    parameters = point.parameters.copy()
    for law, x in zip(beside, rest, strict=True):
        parameters[:, joint, problem.kernel.own(law)] = x
    return score(problem, smaller, start, either_way(problem, replace(point, parameters=parameters)))


def alike(problem: Problem, base: Fitted, effect: Effect, other: Effect, joint: int) -> Start | None:
    """Where another law does the same as an effect of the base; None where either is no function of the signals, or it
    cannot do nearly that."""
    values = base.point.parameters[0, joint, problem.kernel.own(effect)]
    signals = before(effect, Signals.of(problem, base, joint), values)
    own, theirs = resistance(effect, signals), resistance(other, signals)
    if own is None or theirs is None or other.starts is None:
        return None
    speed = signals.velocity / max(float(np.linalg.norm(signals.velocity)), 1e-300)
    aside = lambda torque: torque - speed * (speed @ torque)  # the damping moves along  # noqa: E731
    wanted = aside(own(values))
    bounds = [p.lower for p in other.parameters], [p.upper for p in other.parameters]
    starts = [np.asarray(values, dtype=float) for values in other.starts(sizes_of(problem, base)[joint])]
    if not starts:
        return None
    best, cost = nearest(lambda p: aside(theirs(p)) - wanted, starts, bounds, 30)
    if 2.0 * cost > ALIKE**2 * np.sum(wanted**2):
        return None
    return Start(Hypothesis(other, joint), np.tile(best, (problem.logs, 1)), 0.0, len(starts))


def nearest(
    differ: Callable[[Array], Array], starts: Sequence[Array], bounds: tuple[list[float], list[float]], most: int
) -> tuple[Array, float]:
    """Where the squares of a difference are least, begun from each start, and half of their sum there; most:
    evaluations from each."""
    begun = [np.clip(start, *bounds) for start in starts]
    fits = [least_squares(differ, x, bounds=bounds, x_scale=np.abs(x) + 1e-12, max_nfev=most) for x in begun]
    best = min(fits, key=lambda fitted: fitted.cost)
    return best.x, float(best.cost)
