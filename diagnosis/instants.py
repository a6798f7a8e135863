"""The instants of events: moved to where a fit likes them best, and found in logs that nobody fitted.

When a load is picked up is no property of the machine, as the phase of a disturbance is none. Where the fitted logs
have an event each at an instant of its own, other logs are asked for theirs; what it does there stays as it was fitted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, Information, Point, errors, fit
from diagnosis.hypotheses import Hypothesis, adjoint, seen_events, sizes_of
from diagnosis.problem import NEVER, Problem
from diagnosis.whitening import Whitener, on_logs
from envs.log import Array
from methods.effects.base import Effect

MOVES = 6
"""Moves of an event's instant, each by up to 256 samples."""
SHIFTS = np.array([0, *(sign * 2**k for k in range(9) for sign in (1, -1))])
"""These moves in samples, none at first."""


def retimed(problem: Problem, fitted: Fitted, hypothesis: Hypothesis) -> Fitted:
    """The fit with the instant of an event, or its instants in the logs, moved to where the innovations are smallest:
    there are many optima, and a derivative leads to the next one only. What is no event stays as it is."""
    effect, j = hypothesis.effect, hypothesis.joint
    if effect.scan != "event":
        return fitted
    column = problem.kernel.column(effect, "time")
    for _ in range(MOVES):
        instants, sums = moves(problem, fitted, j, column)
        if not hypothesis.apart:  # one move for all logs
            sums = np.tile(np.sum(sums, axis=1, keepdims=True), problem.logs)
        best = np.argmin(sums, axis=0)
        if not np.any(best):
            break
        point = at(fitted.point, j, column, instants[best, np.arange(problem.logs)])
        fitted = fit(problem, point, fitted.whitener, rounds=1, iterations=4)
    return fitted


def moves(problem: Problem, fitted: Fitted, joint: int, column: int) -> tuple[Array, Array]:
    """Instants (19, L) of an event, the first ones unmoved, and the sums of squared innovations of every log (19, L)
    with them."""
    instants = fitted.point.parameters[:, joint, column] + SHIFTS[:, None] * problem.sample_time
    outcomes = errors(problem, [at(fitted.point, joint, column, own) for own in instants])
    return instants, np.array([per_log(problem, fitted.whitener, error) for error in outcomes])


def at(point: Point, joint: int, column: int, instants: Array) -> Point:
    """The model with an event at other instants (L,)."""
    parameters = point.parameters.copy()
    parameters[:, joint, column] = instants
    return replace(point, parameters=parameters)


def per_log(problem: Problem, whiten: Whitener, error: Array) -> Array:
    """Sum of squared innovations of every log (L,)."""
    squares = np.sum(whiten(error).reshape(problem.joints, -1) ** 2, axis=0)
    return np.asarray(np.bincount(log_of(problem, whiten), squares, problem.logs), dtype=np.float64)


def log_of(problem: Problem, whiten: Whitener) -> np.ndarray:
    """The log of every innovation of a joint (N,)."""
    return np.searchsorted(problem.bounds, whiten.rows, side="right") - 1


def apart_in(point: Point, effect: Effect, joint: int) -> tuple[int, ...]:
    """The logs in each of which an effect of the model happens at an instant of its own; none where it does not."""
    name = effect.parameters[0].name
    if f"{effect.name}.{name}@{joint}" not in {f.name for f in point.free}:
        return ()
    return tuple(f.log for f in point.free if f.log >= 0 and f.name == f"{effect.name}.time@{joint}#{f.log}")


def own_instants(problem: Problem, point: Point, effect: Effect, joint: int) -> dict[str, float]:
    """By log the instant [s] of an event that happens in each at its own, on the log's clock; of others none."""
    found = {}
    for log in apart_in(point, effect, joint):
        since = float(point.parameters[log, joint, problem.kernel.column(effect, "time")])
        if since < problem.longest:
            found[problem.names[log]] = since + float(problem.time[problem.bounds[log]])
    return found


def happens(problem: Problem, point: Point, effect: Effect, joint: int) -> bool:
    """Whether an effect of a model does anything in these logs: an event need not happen in them."""
    if effect.scan != "event":
        return True
    time = point.parameters[:, joint, problem.kernel.column(effect, "time")]
    return bool(point.switches[joint, problem.kernel.switches[effect.name]] and np.any(time < problem.longest))


def with_instants(problem: Problem, point: Point, filter_: Whitener) -> Point:
    """A point that was fitted on other logs with the instants of its events in these."""
    whiten = on_logs(problem, filter_)
    events = {effect.label for effect in problem.kernel.effects if effect.scan == "event"}
    for effect in problem.kernel.effects:
        if effect.label in events:
            for joint in np.flatnonzero(point.switches[:, problem.kernel.switches[effect.name]]):
                point = _found(problem, point, effect, int(joint), whiten)
    return point


def _found(problem: Problem, point: Point, effect: Effect, joint: int, whiten: Whitener) -> Point:
    """The point with an event, in logs that this makes likelier than its own instant by what the search for another one
    costs, where a matched filter sees it and moves lead from there, or nowhere."""
    column, names = problem.kernel.column(effect, "time"), [p.name for p in effect.parameters]
    never = np.full(problem.logs, NEVER * problem.longest)
    base = unfitted(problem, at(point, joint, column, never), whiten)
    tool, size, other = adjoint(problem, base, joint), sizes_of(problem, base)[joint], never.copy()
    for log in range(problem.logs):
        seen = seen_events(problem, tool, effect, joint, size, log)
        if "duration" in names:
            place = names.index("duration")
            lasts = point.parameters[log, joint, problem.kernel.own(effect)][place]
            seen = sorted(seen, key=lambda event: abs(np.log(event.values[place] / lasts)))[:1]
        if seen:
            other[log] = seen[0].values[names.index("time")]
    for _ in range(MOVES):
        moved, sums = moves(problem, unfitted(problem, at(point, joint, column, other), whiten), joint, column)
        best = np.argmin(sums, axis=0)
        other = moved[best, np.arange(problem.logs)]
        if not np.any(best):
            break
    options = np.array([point.parameters[:, joint, column], never, other])
    outcomes = errors(problem, [at(point, joint, column, instants) for instants in options])
    costs = np.array([per_log(problem, whiten, error) for error in outcomes])
    count = np.bincount(log_of(problem, whiten), minlength=problem.logs)
    deviance = problem.joints * count * np.log(np.maximum(costs, 1e-300))
    deviance[1:] += 3.0 * np.log(np.maximum(count, 1))
    return at(point, joint, column, options[np.argmin(deviance, axis=0), np.arange(problem.logs)])


def unfitted(problem: Problem, point: Point, whiten: Whitener) -> Fitted:
    """A model as it is, with its errors and their innovations."""
    error, nothing = errors(problem, [point])[0], np.zeros((0, 0))
    return Fitted(point, error, whiten(error), whiten, Information.of(nothing, nothing), 0, np.zeros(problem.joints))
