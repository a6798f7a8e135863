"""When a command acts and how its logs were integrated: no matter of the robot, but of what wrote the logs.

Simulators that step by semi-implicit Euler's rule read half a step late, others half a step early, and logs may hold a
reading beside the command that led to it. A delay in the model is the robot's. One Euler step per sample also has
another gain, by the square of step times frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, Point, errors, fit
from diagnosis.problem import Free, Problem
from diagnosis.regression import View
from diagnosis.turns import in_turns
from envs.log import Array
from methods.kernel import NOMINAL

SHIFT, STEPPING = NOMINAL.index("timing"), NOMINAL.index("stepping")
RANGE = (-1.6, 0.5)
"""Earliest and latest action of a command after it is logged, in samples."""
LEAST = 20.0
"""Least decrease of -2 log likelihood, beyond the price of a parameter, for which a timing is taken."""
HOPE = 0.5
"""Share of that which a timing has to promise to be fitted."""
PROBE = -0.1
"""Shift [samples] by which the sensitivity to a shift is taken."""


def timing_settled(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with the command's timing free, and integrated as simulators do, where the logs ask for it.

    They do where a shift, even one at the end of its range, explains something, or, beside a delay, Euler's steps:
    these come with a shift of half a step. At the end of its range a timing stands in for something else. Only what
    promises something to first order is fitted. A timing that is there stays where nothing else does as well: without
    it a fit may end elsewhere. It may have come with a law that has been replaced since, and the filter then keep the
    exact fit from what that was to explain. So it may where a timing is about to be taken: the exact fit may only have
    stopped short.
    """
    cost = (float(np.log(fitted.samples)) + LEAST) * problem.joints
    exact = _timed(problem, fitted, free=False, euler=False)
    if is_timed(fitted):
        exact = in_turns(problem, exact)
    promised = promises(problem, exact)

    def tried(free: bool, euler: bool) -> Fitted | None:
        possible = not euler or problem.thinning == 1  # the simulator's steps are the samples of its logs
        worthwhile = possible and promised[free, euler] > HOPE * cost * (free + euler)
        return _timed(problem, fitted, free=free, euler=euler) if worthwhile else None

    first, *further = promised
    asking = tried(*first)
    known = [(fitted, cost)] if is_timed(fitted) and _inside(fitted) else []
    if asking is None or exact.criterion - asking.criterion < cost:
        options = known
    else:
        found = [(asking, first), *((tried(*kind), kind) for kind in further)]
        options = [(other, cost * sum(kind)) for other, kind in found if other is not None and _inside(other)] + known
    best = _cheapest([(exact, 0.0), *options])
    if best is exact or is_timed(fitted):
        return best
    return _cheapest([(in_turns(problem, exact), 0.0), *options])


def _cheapest(options: Sequence[tuple[Fitted, float]]) -> Fitted:
    """The fit with the least criterion and price."""
    return min(options, key=lambda option: option[0].criterion + option[1])[0]


def promises(problem: Problem, exact: Fitted) -> dict[tuple[bool, bool], float]:
    """By (shift, steps): what a shift of the command, Euler steps, and both would explain beyond an exact fit.

    The first is the one to ask for. Decreases of -2 log likelihood to first order, all parameters moving along.
    """
    point, view = exact.point, View.of(problem, exact)
    movable = [j for j in range(problem.joints) if not _delayed(problem, point, j)]
    moved = []
    for j in movable:
        parameters = point.parameters.copy()
        parameters[:, j, SHIFT] = PROBE * problem.sample_time
        moved.append(replace(point, parameters=parameters))
    parameters = _stepped(problem, point, euler=True)
    rows = view.sensitivities(errors(problem, [*moved, replace(point, parameters=parameters)]) - exact.error)
    shifts, steps, residual = rows[:-1], rows[-1], view.residual
    gained = lambda sensitivity, changed: view.promise(problem, view.least(sensitivity, changed)[2])  # noqa: E731
    without = gained(rows[:0], residual)
    found = {(True, False): gained(shifts, residual) - without} if movable else {}
    found[False, True] = gained(rows[:0], residual + steps) - without
    if movable:
        found[True, True] = gained(shifts, residual + steps) - without
    return found


def is_timed(fitted: Fitted) -> bool:
    """Whether the command's timing is free in a model, or its integration a simulator's."""
    return any(_is_shift(f) for f in fitted.point.free) or bool(np.any(fitted.point.parameters[..., STEPPING]))


def _is_shift(f: Free) -> bool:
    return f.kind == "joint" and f.column == SHIFT


def _inside(fitted: Fitted) -> bool:
    """Whether no free timing has come to the end of its range."""
    own = [(f, v) for f, v in zip(fitted.point.free, fitted.point.vector, strict=True) if _is_shift(f)]
    return all(min(v - f.lower, f.upper - v) >= 0.02 * f.scale for f, v in own)


def _delayed(problem: Problem, point: Point, joint: int) -> bool:
    """Whether a joint has a delay, beside which a shift of its command has no meaning."""
    return any(
        e.replaces == "timing" and on for e, on in zip(problem.kernel.effects, point.switches[joint], strict=True)
    )


def _timed(problem: Problem, fitted: Fitted, *, free: bool, euler: bool) -> Fitted:
    """The same model with another timing, as it is where it has that; joints with a delay keep theirs at zero. The
    range is in samples of the logs, also where several of them are simulated at once."""
    point, dt = fitted.point, problem.sample_time / problem.thinning
    parameters = _stepped(problem, point, euler=euler)
    found = [f for f in point.free if not _is_shift(f)]
    for j in range(problem.joints):
        if free and not _delayed(problem, point, j):
            found.append(Free(f"timing@{j}", "joint", j, SHIFT, dt, RANGE[0] * dt, RANGE[1] * dt))
        else:
            parameters[:, j, SHIFT] = 0.0
    other = replace(point, parameters=parameters, free=tuple(found))
    return fitted if _same(point, other) else fit(problem, other, rounds=2, iterations=4)


def _stepped(problem: Problem, point: Point, *, euler: bool) -> Array:
    """The model's parameters with Euler's steps or without; a delay takes the half step that comes with them."""
    parameters = point.parameters.copy()
    half = 0.5 * problem.sample_time * (float(euler) - parameters[..., STEPPING])
    for effect in problem.kernel.effects:
        if effect.replaces == "timing":
            column = problem.kernel.offsets[effect.name]
            on = point.switches[:, problem.kernel.switches[effect.name]]
            parameters[..., column] = np.maximum(parameters[..., column] + half * on, 0.0)
    parameters[..., STEPPING] = float(euler)
    return parameters


def _same(point: Point, other: Point) -> bool:
    """Whether two points have the same parameters, those that are free included."""
    return np.array_equal(point.parameters, other.parameters) and {f.name for f in point.free} == {
        f.name for f in other.free
    }
