"""On which side of a spring or a play the viscous friction acts.

Without one it is a single number, with one it is two: bearings and seals of the motor, of the joint, of what hangs on
it. Both belong to the nominal robot: which of them damps is no effect that a simulation misses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, Point
from diagnosis.problem import Free, Problem
from diagnosis.turns import free_of_filter, in_turns
from methods.kernel import DAMPING, NOMINAL
from methods.parallel import each

VISCOUS, BACK_EMF, ARM_VISCOUS = (NOMINAL.index(name) for name in DAMPING)
DAMPED = [NOMINAL.index(name) for name in DAMPING]
BEGINNINGS = ((0.0, 0.0), (1.0, 0.0), (0.5, 0.5))
"""Shares of viscous friction and of back-EMF on the arm's side with which a fit is begun."""


def arm_damping_settled(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with viscous friction on the arm's side of springs and plays as well, where the logs ask for it.

    A damped arm and a damped motor may be two optima, so it is begun with none of it on the arm, with all of it, and,
    as back-EMF stands for it where a voltage drives, with half of all damping. The one that comes closest as it is may
    only have stopped short.
    """
    if problem.pair:
        return fitted
    names = {f.name for f in fitted.point.free}
    joints = [j for j in range(problem.joints) if _is_split(problem, fitted.point, j)]
    joints = [j for j in joints if f"arm_viscous@{j}" not in names]
    if not joints:
        return fitted
    cost = len(joints) * float(np.log(fitted.samples))
    points: list[Point] = []
    for shares in BEGINNINGS:
        point = on_arms_side(fitted.point, joints, *shares)
        if not any(np.array_equal(point.parameters, other.parameters) for other in points):
            points.append(point)
    fits = each(lambda point: free_of_filter(problem, point), points)
    closest = min(fits, key=lambda option: float(np.sum(option.error[problem.used] ** 2)))
    best = min(*fits, in_turns(problem, closest), key=lambda option: option.criterion)
    if best.criterion + cost >= fitted.criterion:
        return fitted
    whole = free_of_filter(problem, fitted.point)  # which may have stopped short as well
    return best if best.criterion + cost < whole.criterion else min(fitted, whole, key=lambda option: option.criterion)


def undivided(problem: Problem, point: Point) -> Point:
    """The point with all damping in one place where no spring or play is left that would tell two apart."""
    free = {f.name: f for f in point.free}
    whole = [j for j in range(problem.joints) if f"arm_viscous@{j}" in free and not _is_split(problem, point, j)]
    parameters = point.parameters.copy()
    for j in whole:
        kept = VISCOUS if f"viscous@{j}" in free else BACK_EMF
        parameters[:, j, kept] += parameters[:, j, ARM_VISCOUS]
        parameters[:, j, ARM_VISCOUS] = 0.0
        del free[f"arm_viscous@{j}"]
    return replace(point, parameters=parameters, free=tuple(free.values())) if whole else point


def _is_split(problem: Problem, point: Point, joint: int) -> bool:
    """Whether a joint has a spring or a play."""
    return any(
        on and effect.parts_the_arm for effect, on in zip(problem.kernel.effects, point.switches[joint], strict=True)
    )


def on_arms_side(point: Point, joints: list[int], viscous: float, back_emf: float) -> Point:
    """The point with shares of the viscous friction and of the back-EMF on the arm's side, where damping is free."""
    parameters, free = point.parameters.copy(), list(point.free)
    for j in joints:
        size = max(float(np.mean(np.abs(parameters[:, j, DAMPED].sum(axis=-1)))), 1e-12)
        for column, share in ((VISCOUS, viscous), (BACK_EMF, back_emf)):
            moved = share * parameters[:, j, column]
            parameters[:, j, column] -= moved
            parameters[:, j, ARM_VISCOUS] += moved
        free.append(Free(f"arm_viscous@{j}", "joint", j, ARM_VISCOUS, size, lower=0.0))
    return replace(point, parameters=parameters, free=tuple(free))
