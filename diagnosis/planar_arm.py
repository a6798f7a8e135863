"""Whether two joints are those of a planar arm, the second link on the first: by its description, or by the logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from diagnosis.estimation import Fitted, Point, fit
from diagnosis.hypotheses import Hypothesis, extend
from diagnosis.nominal import Gravity, JointStructure, fit_nominal, least_squares, point_at
from diagnosis.problem import Problem, smooth_derivatives, stack
from diagnosis.search import try_all
from diagnosis.smoothing import window
from envs.log import Array, Log
from envs.robot import Robot
from methods.effects import compiled_with
from methods.effects.base import Effect
from methods.kernel import build
from methods.parallel import each

PLANAR_SHARE = 0.02
"""How far a description's inertias may be from a planar arm's, as a share of what couples the joints."""
TELLING = 0.7
"""Share of the squared residual that the coupling of an arm, or its gravity, leaves at most where it is plain."""
PLENTY = 20_000
"""Samples with which logs are enough to tell an arm."""
AHEAD = 30.0
"""Lead in -2 log likelihood, each parameter paid for, by which two joints are an arm."""
SMALL = 0.02
"""Dry friction and offset, as a share of the command's rms, from which their fit begins."""
BESIDE = ("coulomb_friction", "amplifier_offset")
"""What joints often have beside an arm's coupling, and what would hide it."""
NEIGHBOUR = "axis_coupling"
"""What else one joint may do to another: torques in proportion to its motion and command."""


def is_planar_arm(robot: Robot, at: Array, moving: Mapping[int, tuple[float, float]]) -> bool:
    """True when the description's first two joints turn about parallel axes, the second link on the first.

    Around a pose `at` (n,), whatever both angles are: ``M11 = a + 2 p3 cos q2``, ``M12 = p2 + p3 cos q2``, ``M22 = c``.
    moving: least and largest position of further joints that move, by number. They may change nothing of that, nor
    couple with the two.
    """
    if any(robot.joint(number).unit != "rad" for number in (1, 2)):
        return False
    angle = 2.0 * np.pi * np.arange(12) / 12
    poses = [at]
    for number, ends in moving.items():
        poses += [np.where(np.arange(len(at)) == number - 1, end, at) for end in ends]
    places = np.repeat(np.array(poses), len(angle), axis=0)
    places[:, 0], places[:, 1] = at[0] + 5.0 * np.tile(angle, len(poses)), np.tile(angle, len(poses))
    matrix = robot.body.inertia_matrix(places)
    wave = np.stack([np.ones(len(angle)), np.cos(angle)], axis=1)
    sides = np.stack([matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]], axis=1)
    solution = np.linalg.lstsq(wave, sides[: len(angle)], rcond=None)[0]
    coupling = solution[1, 1]
    model = np.tile(wave @ np.array([[*solution[0]], [2.0 * coupling, coupling, 0.0]]), (len(poses), 1))
    others = matrix[:, :2, [number - 1 for number in moving]]
    off = max(np.max(np.abs(sides - model)), np.max(np.abs(others), initial=0.0))
    return bool(coupling != 0.0 and off < PLANAR_SHARE * abs(coupling))


def planar_pair(
    logs: Sequence[Log],
    joints: tuple[int, int],
    structures: tuple[JointStructure, JointStructure],
    effects: Sequence[Effect],
) -> Gravity | None:
    """What gravity does to an arm of two links, if the logs say that it is one; None where they do not.

    In such an arm the second joint's angle changes how the joints' motions act on one another. Where a regression shows
    that in both joints (`in_commands`), it is an arm; noise hides it in the derivatives of the readings. It also is one
    where its nominal model predicts the logs better than two joints that act on one another in proportion to their
    motions and commands: by AHEAD, with ln N paid for every parameter, and with what is BESIDE or without it.
    """
    if any(log.facts[log.index(joint)].position_unit != "rad" for log in logs for joint in joints):
        return None
    seen = [in_commands(log, *joints) for log in logs]
    if any(is_arm for is_arm, _ in seen):
        return next("pendulum" if is_heavy else "none" for is_arm, is_heavy in seen if is_arm)
    chosen: list[Log] = []
    for log in sorted(logs, key=len, reverse=True):
        if sum(map(len, chosen)) < PLENTY:
            chosen.append(log)
    kernel = build(compiled_with(effects))
    beside = [effect for effect in effects if effect.name in BESIDE]
    coupling = [(effect, 0) for effect in effects if effect.name == NEIGHBOUR]
    kinds: list[Gravity] = ["none", "pendulum"] if any(is_heavy for _, is_heavy in seen) else ["none"]

    def fits(problem: Problem, own: tuple[JointStructure, ...]) -> list[Fitted]:
        return [fit_nominal(problem, own), with_all(problem, point_at(problem, own).point, beside)]

    def together(kind: Gravity) -> tuple[float, Gravity]:
        problem = stack(kernel, chosen, joints, pair=True)
        return min(map(cost, fits(problem, tuple(replace(own, gravity=kind) for own in structures)))), kind

    def alone(item: tuple[int, JointStructure]) -> float:
        problem = stack(kernel, chosen, (item[0],))
        found = [fitted for kind in kinds for fitted in fits(problem, (replace(item[1], gravity=kind),))]
        coupled = [scored.fitted for fitted in found for scored in try_all(problem, fitted, coupling)[:1]]
        return min(map(cost, [*found, *coupled]))

    with threadpool_limits(1, "blas"):  # as in `diagnosis.engine`
        best, gravity = min(each(together, kinds))
        apart = sum(each(alone, list(zip(joints, structures, strict=True))))
    return gravity if best < apart - AHEAD else None


def cost(fitted: Fitted) -> float:
    """-2 log likelihood and ln N per free parameter."""
    return fitted.criterion + len(fitted.point.free) * float(np.log(fitted.samples))


def with_all(problem: Problem, point: Point, effects: Sequence[Effect]) -> Fitted:
    """The model with these effects in all joints: what one joint of an arm leaves unexplained disturbs the other."""
    for j in range(problem.joints):
        size = SMALL * float(np.sqrt(np.mean(problem.command[:, j] ** 2)))
        for effect in effects:
            point = extend(problem, point, Hypothesis(effect, j), np.full((problem.logs, effect.size), size))
    return fit(problem, point, rounds=3, iterations=12)


def in_commands(log: Log, first: int, second: int) -> tuple[bool, bool]:
    """Whether an arm's coupling and its gravity explain a good part of the commands of both joints.

    They are regressed on the joint's own motion, on gravity, linearly on the other's motion and command, and on the
    coupling terms ``cos q2 (2 q1'' + q2'') - sin q2 (2 q1' q2' + q2'^2)`` and ``cos q2 q1'' + sin q2 q1'^2``, all
    through the same smoothing. These have to have the sign of an inertia.
    """
    columns = [log.index(first), log.index(second)]
    position, command = log.position[:, columns], log.command[:, columns]
    seconds = window([(log.time, position)])
    q, dq, ddq = smooth_derivatives(log.time, position, seconds)
    c, s = np.cos(q[:, 1]), np.sin(q[:, 1])
    coupling = (
        c * (2 * ddq[:, 0] + ddq[:, 1]) - s * (2 * dq[:, 0] * dq[:, 1] + dq[:, 1] ** 2),
        c * ddq[:, 0] + s * dq[:, 0] ** 2,
    )
    both = q.sum(axis=1)
    weight = np.stack([np.sin(q[:, 0]), np.cos(q[:, 0]), np.sin(both), np.cos(both)], axis=1)
    inner = slice(len(q) // 50, -max(1, len(q) // 50))

    def smooth(*terms: Array) -> Array:
        return smooth_derivatives(log.time, np.column_stack(terms), seconds)[0][inner]

    def regression(matrix: Array, target: Array) -> tuple[float, float]:
        """Coefficient of the last column, and the sum of squares that is left."""
        solution = least_squares(matrix, target)
        return float(solution[-1]), float(np.sum((target - matrix @ solution) ** 2))

    is_arm = is_heavy = True
    for j in range(2):
        dry = np.tanh(dq[:, j] / (0.05 * np.std(dq[:, j]) + 1e-12))
        target = smooth(command[:, j])[:, 0]
        own = smooth(ddq, dq, dry, np.ones(len(q)), command[:, 1 - j])
        pull, arm = smooth(weight if j == 0 else weight[:, 2:]), smooth(coupling[j])
        inertia, left = regression(np.hstack([own, pull, arm]), target)
        is_arm &= inertia > 0.0 and left <= TELLING * regression(np.hstack([own, pull]), target)[1]
        is_heavy &= left < TELLING * regression(np.hstack([own, arm]), target)[1]
    return is_arm, is_heavy
