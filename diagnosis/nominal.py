"""The nominal model of a joint before any effect: which parameters are free and where the fit begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from diagnosis.arm_torques import UNCERTAIN
from diagnosis.estimation import Fitted, Point, fit, predicted_motion
from diagnosis.pair_start import PairStart, pair_start
from diagnosis.problem import Free, Problem, Stamps, centred, evenly, free_damping, free_velocity, smooth_derivatives
from diagnosis.smoothing import window
from diagnosis.timing import timing_settled
from envs.log import Array, InputKind
from methods.effects.base import Effect
from methods.kernel import NOMINAL

COLUMN = {name: index for index, name in enumerate(NOMINAL)}

EVEN = 20.0
"""Least decrease of -2 log likelihood for which stamps are put aside."""
TOLERANCE = 0.5
"""Share by which a stated time constant or inertia may be wrong (one standard deviation)."""
LONGEST = 0.015
"""Time constant [s] beyond which a lag is none of a winding that nobody stated: those of servo motors have a
millisecond, large ones ten."""
HOPELESS = 2.0
"""Mean square of the innovations over that of the fit so far, from which a first fit is not carried on."""
FAR = 1.15
"""The same for a fit that begins where the other one ended."""
TOLD = 60.0
"""Decrease of -2 log likelihood from which logs tell mechanical damping from back-EMF."""
ROWS = 15_000
"""Samples at most on which a starting point is regressed along with an effect."""


Gravity = Literal["none", "constant", "pendulum"]


@dataclass(frozen=True)
class JointStructure:
    """What is known of a joint without any number: kind of drive and what gravity does to it.

    electrical: the winding's lag is part of the model (voltage drives with inductance).
    gravity: ``none``, ``pendulum`` (sine and cosine of the angle) or ``constant`` (a vertical linear axis).
    viscous_share: share of the damping that is mechanical (0..1); command and angle cannot tell it from back-EMF.
    damping: its stated damping, mechanical and by back-EMF, input-equivalent, where known; what a fit gives without the
    effects that are missing may be far from it.
    electrical_time_constant: nominal L / R [s], where known.
    inertia: its stated inertia, input-equivalent, where known; it only decides between otherwise equal explanations.
    torque_limit: input-equivalent torque at the drive's known current limit (0: no limit known).
    """

    input: InputKind = "voltage"
    electrical: bool = True
    gravity: Gravity = "none"
    viscous_share: float = 0.0
    damping: float | None = None
    electrical_time_constant: float | None = None
    inertia: float | None = None
    torque_limit: float = 0.0


class Regressed(NamedTuple):
    """A starting point, and what was regressed along with it: dry friction (n,), the parameters (n, size) of an effect
    that is a linear torque, and the standard deviation (n,) of its torque over the motion."""

    point: Point
    friction: Array
    parameters: Array
    change: Array


def point_at(problem: Problem, structures: tuple[JointStructure, ...], beside: Effect | None = None) -> Regressed:
    """Starting point: linear regression of the held command on smoothed derivatives, joint by joint, with dry friction.
    The winding's lag takes part in every voltage drive that has one.

    beside: an effect that is a linear torque of angle and velocity, regressed along, on evenly spaced ones of the
    samples, whose law is computed one by one. Then it is the acceleration that is regressed: it is what a coarse
    encoder shows badly, and a weight or a spring goes together with it.
    """
    n = problem.joints
    parameters = np.zeros((problem.logs, n, problem.kernel.columns))
    parameters[:, :, COLUMN["torque_square_mean"]] = 1.0
    rigid = np.array([0.0, 1.0, 0.0])
    free: list[Free] = []
    rows: list[list[Array]] = [[] for _ in range(n)]
    sides: list[list[Array]] = [[] for _ in range(n)]
    motion: list[tuple[Array, ...]] = []
    spans = [slice(*span) for span in pairwise(problem.bounds.tolist())]
    seconds = max(0.02, 8 * problem.sample_time)
    thinned = slice(None, None, 1 if beside is None else 1 + len(problem.time) // ROWS)
    if problem.pair:  # noise hides what the joints do to one another
        seconds = max(seconds, window([(problem.time[span], problem.reading[span]) for span in spans]))
    for span in spans:
        time, u = problem.time[span], problem.command[span]
        held = centred(u, int(problem.hold[0]))
        q, dq, ddq = smooth_derivatives(time, problem.reading[span], seconds)
        side = smooth_derivatives(time, held, seconds)[0]
        motion.append((q, dq, ddq, side))
        for j in range(n):
            columns = [ddq[:, j], dq[:, j], np.tanh(dq[:, j] / (0.05 * np.std(dq[:, j]) + 1e-12)), np.ones(len(q))]
            if structures[j].gravity == "pendulum":
                columns += [np.sin(q[:, j]), np.cos(q[:, j])]
            laws = [] if beside is None else torques_of(beside, q[thinned, j], dq[thinned, j])
            rows[j].append(np.stack([*(column[thinned] for column in columns), *laws], axis=1))
            own_side = side[:, j]
            if problem.arm is not None:
                near = problem.neighbour[span, j]
                own_side = own_side - near[:, 3] - near[:, 3 + problem.arm_shapes] * ddq[:, j]
            sides[j].append(own_side[thinned])
    solutions = []
    for j in range(n):
        matrix, target = np.concatenate(rows[j]), np.concatenate(sides[j])
        solution = None if beside is None else _of_acceleration(matrix, target)
        solutions.append(least_squares(matrix, target) if solution is None else solution)
    if problem.pair:
        q, dq, ddq, side = (np.concatenate(parts) for parts in zip(*motion, strict=True))
        pair = pair_start(q, dq, ddq, side, gravity=structures[0].gravity == "pendulum")
        for solution, damping in zip(solutions, pair.damping, strict=True):
            solution[1] = damping
    for j, structure in enumerate(structures):
        x = solutions[j]
        rms = np.sqrt(np.mean(np.concatenate(rows[j]) ** 2, axis=0)) + 1e-300
        drive = float(np.sqrt(np.mean(np.concatenate(sides[j]) ** 2)))
        inertia = x[0] if x[0] > 0 else 0.1 * drive / rms[0]
        damping = max(x[1], 1e-3 * drive / rms[1])
        share, size = 1.0, damping
        if structure.input == "voltage":
            share, size = structure.viscous_share, structure.damping or damping
        parameters[:, j, COLUMN["torque_limit"]] = structure.torque_limit
        parameters[:, j, COLUMN["inertia"]] = inertia
        parameters[:, j, COLUMN["viscous"]] = share * size
        parameters[:, j, COLUMN["back_emf"]] = (1.0 - share) * damping
        stated = structure.inertia
        free.append(
            Free(
                f"inertia@{j}",
                "joint",
                j,
                COLUMN["inertia"],
                inertia,
                lower=1e-6 * inertia,
                centre=stated or inertia,
                deviation=TOLERANCE * stated if stated else np.inf,
            )
        )
        main = "back_emf" if structure.input == "voltage" else "viscous"
        free.append(Free(f"{main}@{j}", "joint", j, COLUMN[main], size))
        if structure.input == "voltage" and structure.electrical:
            begin = structure.electrical_time_constant or 3e-3
            parameters[:, j, COLUMN["electrical_time_constant"]] = begin
            known = structure.electrical_time_constant
            free.append(
                Free(
                    f"electrical_time_constant@{j}",
                    "joint",
                    j,
                    COLUMN["electrical_time_constant"],
                    begin,
                    0.0,
                    LONGEST if known is None else 1.0,
                    centre=begin,
                    deviation=np.inf if known is None else TOLERANCE * known,
                )
            )
        if structure.gravity == "pendulum":
            size = drive
            parameters[:, j, COLUMN["gravity_sine"]], parameters[:, j, COLUMN["gravity_cosine"]] = x[4], x[5]
            free.append(Free(f"gravity_sine@{j}", "joint", j, COLUMN["gravity_sine"], size))
            free.append(Free(f"gravity_cosine@{j}", "joint", j, COLUMN["gravity_cosine"], size))
        elif structure.gravity == "constant":
            parameters[:, j, COLUMN["load"]] = x[3]
            free.append(Free(f"load@{j}", "joint", j, COLUMN["load"], drive))
        for column in range(COLUMN["arm"], COLUMN["arm"] + problem.arm_shapes):
            size, deviation = (1.0, UNCERTAIN) if column == COLUMN["arm"] else (0.0, 1.0)
            parameters[:, j, column] = size
            free.append(Free(f"{NOMINAL[column]}@{j}", "joint", j, column, 1.0, centre=size, deviation=deviation))
        for log in range(problem.logs):
            fastest = float(np.max(np.abs(motion[log][1][:, j])))
            free.append(free_velocity(problem, j, log, fastest, float(problem.starts[log, j, 1])))
    if problem.pair:
        _start_pair(parameters, rigid, free, pair, structures)
    switches = np.zeros((n, len(problem.kernel.effects)), dtype=bool)
    point = Point(parameters, switches, rigid, problem.starts.copy(), tuple(free))
    friction = np.array([x[2] for x in solutions])
    first = len(solutions[0]) - (beside.size if beside else 0)
    own = np.array([x[first:] for x in solutions])
    change = np.array([np.std(np.concatenate(part)[:, first:] @ x) for part, x in zip(rows, own, strict=True)])
    return Regressed(point, friction, own, change)


def least_squares(matrix: Array, target: Array) -> Array:
    """Coefficients of the columns, which may be of any size, in the regression of the target."""
    scale = np.sqrt(np.mean(matrix**2, axis=0)) + 1e-300
    return np.linalg.lstsq(matrix / scale, target, rcond=1e-8)[0] / scale


def _of_acceleration(matrix: Array, command: Array) -> Array | None:
    """Coefficients of the columns, the first of which is the acceleration, in the regression of that on the command and
    all others; None where the command does not accelerate."""
    per_command, *others = least_squares(np.column_stack([command, matrix[:, 1:]]), matrix[:, 0])
    return np.array([1.0, *(-c for c in others)]) / per_command if per_command > 0.0 else None


def torques_of(effect: Effect, position: Array, velocity: Array) -> list[Array]:
    """The torque (T,) of each parameter of an effect that is linear in them, of one joint by itself."""
    assert effect.function is not None
    law = np.vectorize(effect.function, otypes=[float], excluded=("p",))
    return [law(0.0, position, velocity, 0.0, 0.0, p=unit) for unit in np.eye(effect.size)]


def _start_pair(
    parameters: Array,
    rigid: Array,
    free: list[Free],
    start: PairStart,
    structures: Sequence[JointStructure],
) -> None:
    """Parameters of the planar pair; p1, p2 and p3 in units of joint 1, the inertia of joint 2 in its own."""
    parameters[:, :, COLUMN["inertia"]] = start.inertia
    if structures[0].gravity == "pendulum":
        parameters[:, :, COLUMN["gravity_sine"]], parameters[:, :, COLUMN["gravity_cosine"]] = start.gravity.T
    rigid[:] = start.coupling, start.ratio, start.shared
    free[:] = [
        replace(f, scale=start.inertia[f.joint], lower=1e-3 * start.inertia[f.joint], deviation=np.inf)
        if f.name.startswith("inertia")
        else f
        for f in free
    ]
    free.append(Free("coupling_inertia", "rigid", 0, 0, start.shared))
    free.append(Free("unit_ratio", "rigid", 1, 1, start.ratio, 1e-3 * start.ratio))
    free.append(Free("shared_inertia", "rigid", 0, 2, start.shared, 1e-3 * start.shared))


def settle_stamps(
    problem: Problem, held_out: Problem, structures: tuple[JointStructure, ...]
) -> tuple[Problem, Problem]:
    """Even stamps in place of jittering ones where the nominal model says that the readings were taken evenly."""
    regular = evenly(problem)
    if regular is None:
        return problem, held_out
    even, error = regular
    decrease = fit_nominal(problem, structures).criterion - fit_nominal(even, structures).criterion
    if decrease < EVEN:
        return problem, held_out
    other = evenly(held_out)
    return replace(even, stamps=Stamps(error, decrease)), held_out if other is None else other[0]


def fit_nominal(problem: Problem, structures: tuple[JointStructure, ...]) -> Fitted:
    """Fit of the nominal model. A drive's stated torque limit takes part only where the logs show that it acts, a
    timing (`diagnosis.timing`) and the split of the damping only where they ask for it."""
    free_running = tuple(replace(s, torque_limit=0.0) for s in structures)
    best = fit(problem, point_at(problem, free_running)[0], rounds=3, iterations=12)
    if any(s.torque_limit > 0.0 for s in structures):
        largest = np.max(np.abs(problem.command), axis=0)
        if any(0.0 < s.torque_limit < largest[j] for j, s in enumerate(structures)):
            limited = _promising(problem, point_at(problem, structures)[0], best, HOPELESS, rounds=3, iterations=12)
            if limited.criterion < best.criterion:
                best = limited
    return damping_settled(problem, timing_settled(problem, best))


def without_limits(problem: Problem, fitted: Fitted) -> Fitted | None:
    """The fit without the torque limits that act in it; None where none does."""
    column = COLUMN["torque_limit"]
    if not np.any(fitted.point.parameters[..., column]):
        return None
    parameters = fitted.point.parameters.copy()
    parameters[..., column] = 0.0
    return fit(problem, replace(fitted.point, parameters=parameters), rounds=3, iterations=12)


def with_limit(point: Point, joint: int, limit: float) -> Point:
    """The point with another torque limit of a joint; 0: none."""
    parameters = point.parameters.copy()
    parameters[:, joint, COLUMN["torque_limit"]] = limit
    return replace(point, parameters=parameters)


def limits_settled(problem: Problem, fitted: Fitted, structures: tuple[JointStructure, ...]) -> Fitted:
    """The fit with every stated torque limit either acting or not, whichever the logs say now.

    A limit may have stood in for an effect that was not yet in the model, or an effect for the limit.
    """
    column = COLUMN["torque_limit"]
    for j, structure in enumerate(structures):
        if structure.torque_limit == 0.0:
            continue
        torque = predicted_motion(problem, fitted.point)[:, j, 2]
        if np.max(np.abs(torque)) < structure.torque_limit:
            continue
        acts = fitted.point.parameters[0, j, column] > 0.0
        point = with_limit(fitted.point, j, 0.0 if acts else structure.torque_limit)
        other = _promising(problem, point, fitted, FAR, rounds=2, iterations=8)
        if other.criterion < fitted.criterion:
            fitted = other
    return fitted


def windings_settled(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with every winding's lag that has become a delay, shorter than a quarter of a step, tried as a lag again.

    It may have stood in for something that was not yet in the model, and cannot come back by itself.
    """
    column = COLUMN["electrical_time_constant"]
    step = problem.sample_time / problem.substeps
    for j in range(problem.joints):
        free = any(f.kind == "joint" and f.joint == j and f.column == column for f in fitted.point.free)
        if not free or fitted.point.parameters[0, j, column] > 0.25 * step:
            continue
        parameters = fitted.point.parameters.copy()
        parameters[:, j, column] = step
        other = fit(problem, replace(fitted.point, parameters=parameters), rounds=2, iterations=4)
        if other.criterion < fitted.criterion:
            fitted = other
    return fitted


def damping_settled(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with mechanical damping and back-EMF as two parameters, where this makes the logs far likelier, or
    likelier at all beside a spring or a play: what the logs leave open then is in the deviations of all others.

    A winding's lag holds up the back-EMF only. Beside inertia and damping alone either can stand in for the other. The
    links of an arm, whose pose changes the inertia, tell them apart, and so does what hangs on a spring or a play, of
    which the motor feels less the faster it moves; effects that resist do so, too, but so faintly that a simulator's
    steps may do it as well: beside them a share that was stated is better.
    """
    known, column = {f.name: f for f in fitted.point.free}, COLUMN["viscous"]
    for j in range(problem.joints):
        back_emf, winding = known.get(f"back_emf@{j}"), known.get(f"electrical_time_constant@{j}")
        begin = float(fitted.point.parameters[0, j, column])
        present = [e for e, on in zip(problem.kernel.effects, fitted.point.switches[j], strict=True) if on]
        is_parted = any(e.parts_the_arm for e in present)
        is_told = problem.divides_damping or is_parted or bool(begin == 0.0 and present)
        if f"viscous@{j}" in known or back_emf is None or winding is None or not is_told:
            continue
        point = replace(fitted.point, free=(*fitted.point.free, free_damping(j, back_emf.scale, begin)))
        other = fit(problem, point, rounds=2, iterations=12)
        if other.criterion < fitted.criterion - (0.0 if is_parted else TOLD):
            fitted = other
    return fitted


def _promising(problem: Problem, point: Point, beside: Fitted, most: float, *, rounds: int, iterations: int) -> Fitted:
    """A fit from a point; only its first steps where these leave more than `most` times the mean square innovation of
    another fit."""
    first = fit(problem, point, rounds=1, iterations=3)
    if first.criterion > beside.criterion + beside.samples * np.log(most):
        return first
    return fit(problem, first.point, rounds=rounds, iterations=iterations)
