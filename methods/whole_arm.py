"""All joints at once: Pinocchio's regressor, base parameters by a pivoted QR, drives along with them.

The equation is that of `methods.arm`. It is linear in the base parameters and in k, o and f, but the scales c and the
time constants T multiply the base parameters: all are found together by Gauss-Newton with damping, each joint's rows
over the deviation of its own residuals (weighted least squares over joints). Base parameters: columns of the regressor
that a QR with pivoting finds independent; the others stay as described (M. Gautier, J. Robot. Syst. 8 (1991) 485).
A product of scale and inertia that the logs cannot divide is divided by the described uncertainty of the scales
(M. Gautier, S. Briot, J. Dyn. Syst. Meas. Control 136 (2014) 051025 need a known payload for that).
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import qr
from scipy.optimize import least_squares
from scipy.signal import fftconvolve

from envs.log import COMMAND_UNIT, Array, Log
from envs.robot import Robot
from methods.arm import REVERSAL, ArmModel, described, described_body, full_states
from methods.base import Estimates, Fit, Method, MethodError, Motion, Status
from methods.differentiation import BandLimited
from methods.driven import Drives
from methods.joint_regression import Preparation
from methods.least_squares import long_run_scatter
from methods.registry import METHODS

NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Inertial parameters of a joint in Pinocchio's order, [kg], [kg m] and [kg m^2]."""
INDEPENDENT = 1e-6
"""Share of the largest pivot below which a column depends on the others."""


@dataclass(frozen=True, eq=False)
class ArmEquations:
    """Rows of all logs: W and its rate (N, n, 11 m) for (theta, rotors) of the robot's m joints;

    velocity, friction column and command are (N, n), reversal is w (n,), start is the model as described.
    """

    regressor: Array
    rate: Array
    velocity: Array
    friction: Array
    command: Array
    reversal: Array
    start: ArmModel

    @property
    def described(self) -> Array:
        """(theta, rotors) of the description, (11 m,)."""
        return np.concatenate((self.start.theta, self.start.rotors))

    @property
    def size(self) -> int:
        """Number of joints."""
        return self.command.shape[1]


@METHODS.register("whole_arm", "multi-joint", "physics")
@dataclass(frozen=True)
class WholeArm(Method):
    """robot: name or path of the description; None: the one that the log names. rows: at most, over all logs."""

    robot: str | None = None
    preparation: Preparation = field(default_factory=Preparation)
    rows: int = 4000

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Consumes no random numbers."""
        begin = time.perf_counter()
        equations = arm_equations(self, logs)
        solution = solved(equations, logs)
        return replace(fitted(equations, solution, logs), seconds=time.perf_counter() - begin)


@dataclass(frozen=True, eq=False)
class Solution:
    """kept: indices of the base parameters. residuals: (N, n); deviations: theirs, (n,).

    covariance: of the base parameters, then of damping, offset and friction of all joints.
    """

    kept: np.ndarray
    model: ArmModel
    residuals: Array
    deviations: Array
    covariance: Array


def arm_equations(method: WholeArm, logs: Sequence[Log]) -> ArmEquations:
    """The rows of all logs behind one filter. Raises MethodError for logs of no described robot."""
    from envs.pinocchio_model import inertial_parameters, torque_regressor

    name, robot, held = described(logs, method.robot)
    joints = logs[0].joints
    model = described_body(robot)
    n, all_joints = len(joints), len(robot)
    moved = [joint - 1 for joint in joints]
    bandwidth = min(method.preparation.equations([log.joint(j) for log in logs]).bandwidth for j in joints)
    filter_ = BandLimited(bandwidth)
    parts = [filter_.signals(log) for log in logs]
    speeds = np.max(np.abs(np.concatenate([part.motion.velocity for part in parts])), axis=0)
    columns: list[list[Array]] = [[], [], [], [], []]
    total = sum(len(part) for part in parts)
    for log, part in zip(logs, parts, strict=True):
        kernel = filter_.kernel(0, log.sample_time)
        half = len(kernel) // 2
        sign = np.tanh(part.motion.velocity / (REVERSAL * speeds))
        smooth = np.column_stack([fftconvolve(column, kernel, mode="same") for column in sign.T])
        every = max(1, math.ceil(total / method.rows), round(1.0 / (5.0 * bandwidth * log.sample_time)))
        at = np.arange(half + 1, len(part) - half - 1, every)
        if len(at) < 20 * n:
            raise MethodError(f"{log.name} leaves {len(at)} rows behind the filter", remedy="Record a longer log")

        def rows(at: np.ndarray, motion: Motion = part.motion) -> Array:
            found = np.zeros((len(at), n, 11 * all_joints))
            chosen = Motion(
                *(signal[at] for signal in (motion.position, motion.velocity, motion.acceleration, motion.jerk))
            )
            states = full_states((chosen.position, chosen.velocity, chosen.acceleration), moved, held)
            found[:, :, : 10 * all_joints] = torque_regressor(model, *states, rows=moved)
            found[:, range(n), 10 * all_joints + np.array(moved)] = chosen.acceleration
            return found

        columns[0].append(rows(at))
        columns[1].append((rows(at + 1) - rows(at - 1)) / (2.0 * log.sample_time))
        for list_, signal in zip(columns[2:], (part.motion.velocity, smooth, part.command), strict=True):
            list_.append(signal[at])
    joined = [np.concatenate(list_) for list_ in columns]
    inputs = tuple(fact.input for fact in logs[0].facts)
    start = ArmModel(
        robot=name,
        joints=joints,
        inputs=inputs,
        held=held,
        theta=inertial_parameters(model),
        rotors=np.array(model.armature),
        drives=_described_drives(robot, joints, REVERSAL * speeds),
    )
    return ArmEquations(joined[0], joined[1], joined[2], joined[3], joined[4], REVERSAL * speeds, start)


def _described_drives(robot: Robot, joints: tuple[int, ...], reversal: Array) -> Drives:
    drives = [robot.joint(joint).drive for joint in joints]
    voltage = [drive.amplifier == "voltage" for drive in drives]
    lag = [d.inductance.value / d.resistance.value if v else 0.0 for d, v in zip(drives, voltage, strict=True)]
    zero = np.zeros(len(joints))
    return Drives(np.array([drive.input_equivalent for drive in drives]), np.array(lag), zero, zero, zero, reversal)


def solved(equations: ArmEquations, logs: Sequence[Log]) -> Solution:
    """Gauss-Newton over base parameters, scales, time constants, damping, offsets and friction; see the module."""
    n, start = equations.size, equations.start
    size = np.maximum(np.abs(equations.described), 1e-3)
    stacked = equations.regressor * start.drives.scale[:, None] / np.std(equations.command, axis=0)[:, None]
    flat = (stacked * size).reshape(-1, len(size))
    _, upper, order = qr(flat, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(upper))
    kept = np.sort(order[: int(np.sum(pivots > INDEPENDENT * pivots[0]))])
    lagging = np.flatnonzero(start.drives.lag > 0.0)
    count = len(kept)
    speed = np.sqrt(np.mean(equations.velocity**2, axis=0))
    power = np.std(equations.command, axis=0)
    deviations = 0.05 * power

    def parts(x: Array) -> tuple[Array, Drives]:
        phi = equations.described.copy()
        phi[kept] += size[kept] * x[:count]
        rest = x[count:]
        lag = start.drives.lag.copy()
        lag[lagging] *= np.exp(rest[n : n + len(lagging)])
        linear = rest[n + len(lagging) :].reshape(3, n)
        return phi, Drives(
            scale=start.drives.scale * np.exp(rest[:n]),
            lag=lag,
            damping=linear[0] * power / speed,
            offset=linear[1] * power,
            friction=linear[2] * power,
            reversal=equations.reversal,
        )

    def errors(x: Array) -> Array:
        phi, drives = parts(x)
        return residuals(equations, phi, drives)

    def jacobian(x: Array) -> Array:
        phi, drives = parts(x)
        lagged = equations.regressor + drives.lag[:, None] * equations.rate
        table = np.zeros((*equations.command.shape, len(x)))
        table[:, :, :count] = -drives.scale[:, None] * lagged[:, :, kept] * size[kept]
        for j in range(n):
            table[:, j, count + j] = -drives.scale[j] * (lagged[:, j] @ phi)
            table[:, j, count + n + len(lagging) + j] = -equations.velocity[:, j] * power[j] / speed[j]
            table[:, j, count + 2 * n + len(lagging) + j] = -power[j]
            table[:, j, count + 3 * n + len(lagging) + j] = -equations.friction[:, j] * power[j]
        for k, j in enumerate(lagging):
            table[:, j, count + n + k] = -drives.scale[j] * drives.lag[j] * (equations.rate[:, j] @ phi)
        return table

    x = np.zeros(count + 4 * n + len(lagging))
    far = np.full(len(x), np.inf)
    far[count : count + n + len(lagging)] = 3.0  # scales and time constants within a factor of twenty
    doubt = np.zeros((len(x), len(x)))
    doubt[range(count, count + n), range(count, count + n)] = 1.0  # a factor of e in each scale is one deviation
    for _ in range(3):
        found = least_squares(
            lambda x, d=deviations: np.concatenate(((errors(x) / d).ravel(), doubt @ x)),
            x,
            jac=lambda x, d=deviations: np.vstack(((jacobian(x) / d[:, None]).reshape(-1, len(x)), doubt)),
            bounds=(-far, far),
            method="trf",
            x_scale="jac",
            max_nfev=60,
        )
        x = found.x
        deviations = np.maximum(np.sqrt(np.mean(errors(x) ** 2, axis=0)), 1e-6 * power)
    phi, drives = parts(x)
    table = (jacobian(x) / deviations[:, None]).reshape(-1, len(x))
    length = np.sqrt(np.sum(table**2, axis=0) + np.diag(doubt))
    table /= length
    bread = np.linalg.pinv(table.T @ table + doubt / np.outer(length, length), hermitian=True)
    scores = np.einsum("ijk,ij->ik", table.reshape(*equations.command.shape, -1), errors(x) / deviations)
    spread, axes = np.linalg.eigh(long_run_scatter(scores, np.sum(errors(x) / deviations, axis=1)))
    root = bread @ axes * np.sqrt(np.maximum(spread, 0.0))  # B S B as a square, so that rounding leaves no negative one
    covariance = root @ root.T
    bodies = len(start.theta)
    model = replace(start, theta=phi[:bodies], rotors=phi[bodies:], drives=drives)
    reported = [*range(count), *range(len(x) - 3 * n, len(x))]
    unit = np.concatenate((size[kept], power / speed, power, power)) / length[reported]
    return Solution(kept, model, errors(x), deviations, covariance[np.ix_(reported, reported)] * np.outer(unit, unit))


def residuals(equations: ArmEquations, phi: Array, drives: Drives) -> Array:
    """Recorded less modelled command, (N, n)."""
    torque = (equations.regressor + drives.lag[:, None] * equations.rate) @ phi
    rest = drives.damping * equations.velocity + drives.offset + drives.friction * equations.friction
    return equations.command - drives.scale * torque - rest


def fitted(equations: ArmEquations, solution: Solution, logs: Sequence[Log]) -> Fit:
    """The fit of a solution: base parameters, and per joint damping, offset and friction."""
    joints, drives = equations.start.joints, solution.model.drives
    phi = np.concatenate((solution.model.theta, solution.model.rotors))
    bodies = len(solution.model.rotors)
    names = [f"{NAMES[k % 10]} of joint {k // 10 + 1}" for k in range(10 * bodies)]
    names += [f"rotor of joint {joint}" for joint in range(1, bodies + 1)]
    measures = ["kg", "kg m", "kg m", "kg m", *["kg m^2"] * 6] * bodies
    kinds = dict(zip(joints, (fact.position_unit for fact in logs[0].facts), strict=True))
    measures += ["kg" if kinds.get(joint) == "m" else "kg m^2" for joint in range(1, bodies + 1)]
    further = [
        (f"{title} of joint {joint}", f"{COMMAND_UNIT[fact.input]}{f' s/{fact.position_unit}' if rate else ''}", value)
        for title, values, rate in (
            ("velocity", drives.damping, True),
            ("constant", drives.offset, False),
            ("coulomb", drives.friction, False),
        )
        for joint, fact, value in zip(joints, logs[0].facts, values, strict=True)
    ]
    return Fit(
        model=solution.model,
        estimates=Estimates(
            names=(*(names[k] for k in solution.kept), *(name for name, _, _ in further)),
            units=(*(measures[k] for k in solution.kept), *(unit for _, unit, _ in further)),
            values=np.concatenate((phi[solution.kept], [value for _, _, value in further])),
            covariance=solution.covariance,
        ),
        residuals=solution.residuals.ravel(),
        status=Status.CONVERGED,
        seconds=0.0,
        notes=(f"{len(solution.kept)} base parameters of {len(phi)}",),
    )
