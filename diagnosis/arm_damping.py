"""On which side of a spring or a play friction acts.

Without one viscous friction is a single number, with one it is two: bearings and seals of the motor, of the joint, of
what hangs on it. So it is with the laws of friction of the joint. Both sides belong to the nominal robot: which of them
damps is no effect that a simulation misses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, Point, finish, fit
from diagnosis.problem import MECHANICAL, Free, Problem
from diagnosis.turns import free_of_filter, in_turns
from methods.effects.base import Effect
from methods.kernel import DAMPING, NOMINAL, acts_on_either_side
from methods.parallel import each

VISCOUS, BACK_EMF, ARM_VISCOUS = (NOMINAL.index(name) for name in DAMPING)
DAMPED = [NOMINAL.index(name) for name in DAMPING]
ARM_FRICTION = NOMINAL.index("arm_friction")
BEGINNINGS = ((0.0, 0.0), (1.0, 0.0), (0.5, 0.5))
"""Shares of viscous friction and of back-EMF on the arm's side with which a fit is begun."""
SHARES = (1.0, 0.3)
"""Shares of the laws of friction on the arm's side with which a fit is begun."""


def arm_damping_settled(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with friction on the arm's side of springs and plays as well, where the logs ask for it.

    A damped arm and a damped motor may be two optima, so it is begun with none of the viscous friction on the arm, with
    all of it, and, as back-EMF stands for it where a voltage drives, with half of all damping; and with all of the laws
    of friction there, and with some. The one that comes closest as it is may only have stopped short. Viscous friction
    on the wrong side may stand for another law there, and is asked again; so is what is there already, which may have
    made up for an effect that was not there yet.
    """
    if problem.pair:
        return fitted
    fitted = _needed(problem, fitted, "arm_viscous")
    fitted = _settled(problem, fitted, "arm_viscous", _is_split, _begun_viscous)
    moved = _settled(problem, fitted, "arm_friction", rubs, _begun_rubbing)
    return fitted if moved is fitted else _settled(problem, moved, "arm_viscous", _is_split, _begun_viscous)


def _needed(problem: Problem, fitted: Fitted, name: str) -> Fitted:
    """The fit without a nominal parameter of the arm's side where it is no longer worth its price."""
    joints = [f.joint for f in fitted.point.free if f.name.startswith(f"{name}@")]
    if not joints:
        return fitted
    less = free_of_filter(problem, taken_back(fitted.point, name, joints))
    return less if less.criterion < fitted.criterion + len(joints) * float(np.log(fitted.samples)) else fitted


def _settled(
    problem: Problem,
    fitted: Fitted,
    name: str,
    asks: Callable[[Problem, Point, int], bool],
    begun: Callable[[Point, list[int]], list[Point]],
) -> Fitted:
    """The fit with a nominal parameter of the arm's side free in the joints that ask for it, where it is worth that."""
    names = {f.name for f in fitted.point.free}
    joints = [j for j in range(problem.joints) if asks(problem, fitted.point, j) and f"{name}@{j}" not in names]
    if not joints:
        return fitted
    cost = len(joints) * float(np.log(fitted.samples))
    points: list[Point] = []
    for point in begun(fitted.point, joints):
        if not any(np.array_equal(point.parameters, other.parameters) for other in points):
            points.append(point)
    fits = each(lambda point: free_of_filter(problem, point), points)
    closest = min(fits, key=lambda option: problem.squares(option.error))
    best = min(*fits, in_turns(problem, closest), key=lambda option: option.criterion)
    if best.criterion + cost >= fitted.criterion:
        return fitted
    further = free_of_filter(problem, fitted.point)  # without it a fit may have stopped short as well
    back = fit(problem, taken_back(best.point, name, joints), best.whitener, rounds=2, iterations=6)
    whole = min(fitted, further, back, key=lambda option: option.criterion)
    return best if best.criterion + cost < whole.criterion else whole


def arm_damping_open(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with mechanical damping on both sides of every spring and play, whatever it gains.

    Logs that do not tell how damping is divided tell the spring and the winding less well, too: that is in the
    deviations of all parameters only where the division is one of them. From a voltage to the motor's angle it is one
    number more than there are, so that it is known by half of the damping, as the motor's part is.
    """
    names = {f.name for f in fitted.point.free}
    joints = [
        j for j in range(problem.joints) if _is_split(problem, fitted.point, j) and f"arm_viscous@{j}" not in names
    ]
    if problem.pair or not joints:
        return fitted
    begun = on_arms_side(fitted.point, joints, 0.0, 0.0)
    opened = {f"arm_viscous@{j}" for j in joints}
    free = (replace(f, deviation=MECHANICAL * f.scale) if f.name in opened else f for f in begun.free)
    begun = replace(begun, free=tuple(free))
    best = fit(problem, begun, fitted.whitener, iterations=12)
    return best if best.criterion < fitted.criterion else finish(problem, begun, fitted.error, fitted.whitener)


def undivided(problem: Problem, point: Point) -> Point:
    """The point with all friction in one place where no spring or play is left that would tell two apart, or no law."""
    free, joints = {f.name for f in point.free}, range(problem.joints)
    whole = [j for j in joints if f"arm_viscous@{j}" in free and not _is_split(problem, point, j)]
    smooth = [j for j in joints if f"arm_friction@{j}" in free and not rubs(problem, point, j)]
    return taken_back(taken_back(point, "arm_viscous", whole), "arm_friction", smooth)


def taken_back(point: Point, name: str, joints: Sequence[int]) -> Point:
    """The point with a nominal parameter of the arm's side back on the motor's."""
    if not joints:
        return point
    parameters, column = point.parameters.copy(), NOMINAL.index(name)
    free = {f.name: f for f in point.free}
    for j in joints:
        if column == ARM_VISCOUS:
            parameters[:, j, VISCOUS if f"viscous@{j}" in free else BACK_EMF] += parameters[:, j, column]
        parameters[:, j, column] = 0.0
        del free[f"{name}@{j}"]
    return replace(point, parameters=parameters, free=tuple(free.values()))


def _present(problem: Problem, point: Point, joint: int) -> list[Effect]:
    """The effects of a joint."""
    return [effect for effect, on in zip(problem.kernel.effects, point.switches[joint], strict=True) if on]


def _is_split(problem: Problem, point: Point, joint: int) -> bool:
    """Whether a joint has a spring or a play."""
    return any(effect.parts_the_arm for effect in _present(problem, point, joint))


def rubs(problem: Problem, point: Point, joint: int) -> bool:
    """Whether a joint has a spring or a play, and a law of friction that may act behind it."""
    laws = any(acts_on_either_side(effect) for effect in _present(problem, point, joint))
    return laws and _is_split(problem, point, joint)


def may_rub_behind(problem: Problem, point: Point, effect: Effect, joint: int) -> bool:
    """Whether a law of friction can be the first one of a joint with a spring or a play, and act behind that."""
    first = not any(acts_on_either_side(other) for other in _present(problem, point, joint))
    return first and acts_on_either_side(effect) and not problem.pair and _is_split(problem, point, joint)


def _begun_viscous(point: Point, joints: list[int]) -> list[Point]:
    return [on_arms_side(point, joints, *shares) for shares in BEGINNINGS]


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


def _begun_rubbing(point: Point, joints: list[int]) -> list[Point]:
    return [rubbing_behind(point, joints, share) for share in SHARES]


def rubbing_behind(point: Point, joints: Sequence[int], share: float) -> Point:
    """The point with a share of the laws of friction on the arm's side, which is free."""
    parameters, free = point.parameters.copy(), list(point.free)
    for j in joints:
        parameters[:, j, ARM_FRICTION] = share
        free.append(Free(f"arm_friction@{j}", "joint", j, ARM_FRICTION, 1.0, lower=0.0, upper=1.0))
    return replace(point, parameters=parameters, free=tuple(free))
