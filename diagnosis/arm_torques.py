"""What the rest of a described arm does to one of its joints, from the measured motion of all of them.

A joint is simulated with its own inertia and gravity around the pose of the logs. Everything else that the rigid body
asks of its motor,

    rest_j + change_j q_j'' = [W_j(q, q', q'') - W_j(own motion alone, the others at the pose)] theta,

the coupling inertias, Coriolis and centrifugal torques and the change of its own gravity with the pose (rest_j), and
the change of its own inertia, is known from the description (theta: ten inertial parameters per link) and the measured
motion. Its own acceleration is simulated: a measured one holds what the command, and the noise in it, are still to make
of the joint, and none of what is too fast for its encoder. The description's numbers
are uncertain: ``theta = theta_0 + S z``, z standard normal. A linear regression of the command updates them, dry
friction and the joint's own terms left free, and the leading principal components of what it leaves uncertain join as
further torques of unknown size, so that a wrong mass is not taken for an effect.

Source: M. Gautier, W. Khalil, Direct calculation of minimum set of inertial parameters of serial robots, IEEE Trans.
Robot. Autom. 6 (1990); the principal components replace the base parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import minimum_filter1d

from diagnosis.problem import LIMIT, centred, segments, smooth_derivatives
from diagnosis.replay import rms
from diagnosis.smoothing import motion_of, window
from envs.log import Array, Log
from envs.robot import Robot
from methods.arm import described_body, full_states
from methods.kernel import SHAPES

if TYPE_CHECKING:
    import pinocchio as pin

UNCERTAIN = 0.3
"""Standard deviation of a described mass, first moment or inertia as a share of its typical size."""
NEGLIGIBLE = 2e-3
"""Share of the command's rms below which torques of the rest of the arm do not matter."""
LEARNED = 4000
"""Samples from which the description's parameters are updated."""
TURNS = (0.005, 0.05, 0.3)
"""Shares of the rms velocity over which dry friction turns in that."""
REVERSAL = 0.1
"""Share of the rms velocity below which a joint reverses."""
MOVING = 0.2
"""Share of the samples that has to be left."""
DRAWS = 4
"""Draws of the torques that the description may be off by."""
ROUNDS = 5
"""Times that the noise of that is estimated anew."""


@dataclass(frozen=True, eq=False)
class ArmTorques:
    """The torques of the rest of the arm on a joint, per log: description, pose (N,) and components (10 N, 1 + R).

    open: square root (10 N, K) of the covariance of the description beside the components, which the fitted logs have
    not changed enough to matter. Other motion may ask for it. unit: command units per joint torque. seconds: length of
    the smoothing window.
    """

    body: pin.Model
    joint: int
    pose: Array
    components: Array
    open: Array
    unit: float
    seconds: float

    def of(self, log: Log) -> tuple[Array, Array]:
        """See `diagnosis.problem.KnownTorques`: what the description says and the leading components of its
        uncertainty; draws of what else is uncertain."""
        torque, inertia, acceleration = self.regressors(log)
        known = self.unit * np.concatenate([torque @ self.components, inertia @ self.components], axis=1)
        off = self.open @ np.random.default_rng(0).standard_normal((self.open.shape[1], DRAWS))
        doubts = self.unit * (torque @ off + acceleration[:, None] * (inertia @ off))
        for item in (known, doubts):
            item[:-1] = 0.5 * (item[:-1] + item[1:])
        return known, doubts

    def regressor(self, log: Log) -> Array:
        """``W_j`` less that of the joint's own motion (T, 10 N), its measured acceleration included."""
        torque, inertia, acceleration = self.regressors(log)
        return torque + inertia * acceleration[:, None]

    def regressors(self, log: Log) -> tuple[Array, Array, Array]:
        """The same without the joint's own acceleration, what is to be multiplied by that, both (T, 10 N), and its
        measured acceleration (T,)."""
        from envs.pinocchio_model import torque_regressor

        j, motion = self.joint - 1, motion_of(log.time, log.position, self.seconds)
        every = full_states(motion, [number - 1 for number in log.joints], self.pose)
        alone = full_states([signal[:, [log.index(self.joint)]] for signal in motion], [j], self.pose)
        acceleration = every[2, :, j].copy()
        found = []
        for own in (0.0, 1.0):
            every[2, :, j] = alone[2, :, j] = own
            whole, single = (torque_regressor(self.body, *states, rows=[j])[:, 0] for states in (every, alone))
            found.append(whole - single)
        return found[0], found[1] - found[0], acceleration


def arm_torques(robot: Robot | None, logs: Sequence[Log], joint: int, pose: Array) -> ArmTorques | None:
    """The torques of the rest of the arm on a joint; None without a description, where the logs hold no other joint,
    and where the description couples nothing. Raises MethodError for a body that Pinocchio cannot have."""
    if robot is None or all(len(log.joints) < 2 for log in logs):
        return None
    from envs.pinocchio_model import inertial_parameters

    body = described_body(robot)
    theta = inertial_parameters(body)
    unit = robot.joint(joint).drive.input_equivalent
    parts = [part for log in logs for part in segments(log, LIMIT // len(logs))]
    seconds = window([(part.time, part.position) for part in parts])
    plain = ArmTorques(body, joint, pose, np.eye(len(theta)), np.zeros((len(theta), 0)), unit, seconds)
    rows_of = [filtered(plain, part) for part in parts]
    own, regressor, torque = (np.concatenate([found[i] for found in rows_of]) for i in range(3))
    rows = slice(None, None, max(1, len(torque) // LEARNED))
    independent = len(torque) * logs[0].sample_time / plain.seconds
    theta, spread = updated(theta, uncertainty(theta), regressor[rows], own[rows], torque[rows], independent)
    least = NEGLIGIBLE * rms(torque)
    _, values, shapes = np.linalg.svd(regressor[rows] @ spread, full_matrices=False)
    count = min(int(np.sum(values / np.sqrt(len(regressor[rows])) > least)), SHAPES)
    if count == 0 and rms(regressor @ theta) < least:
        return None
    return replace(
        plain, components=np.column_stack([theta, spread @ shapes[:count].T]), open=spread @ shapes[count:].T
    )


def filtered(known: ArmTorques, log: Log) -> tuple[Array, Array, Array]:
    """What a joint's command is for without the rest of the arm (inertia, damping, dry friction, offset and gravity,
    (T, 8)), the rest's regressor (T, 10 N), and the command as a torque (T,), all through the same filter.

    Samples around reversals are left out: when dry friction turns, the smoothed velocity tells least.
    """
    column = log.index(known.joint)
    q, dq, ddq = (item[:, column] for item in motion_of(log.time, log.position, known.seconds))
    hold = 0 if log.facts[column].hold == "zero_order" else 1
    held = centred(log.command[:, [column]], hold) / known.unit
    typical = rms(dq) + 1e-12
    dry = [np.tanh(dq / (share * typical)) for share in TURNS]
    own = np.stack([ddq, dq, *dry, np.ones_like(q), np.sin(q), np.cos(q)], axis=1)
    width = round(known.seconds / log.sample_time)
    moving = minimum_filter1d(np.abs(dq), 2 * width + 1) > REVERSAL * typical
    if np.mean(moving) < MOVING:
        moving[:] = True
    found = [smooth_derivatives(log.time, item, known.seconds)[0] for item in (own, known.regressor(log), held)]
    return found[0][moving], found[1][moving], found[2][moving, 0]


def updated(
    theta: Array, deviation: Array, regressor: Array, own: Array, torque: Array, independent: float
) -> tuple[Array, Array]:
    """Inertial parameters (10 N,) and a square root (10 N, 10 N) of their covariance, after the joint's own command.

    Linear regression of the torque (T,) on the joint's own motion (T, 8), about which nothing is known, and on
    ``W S z`` with z standard normal. Its residuals, unmodelled effects included, count as noise of which only
    `independent` samples tell something new.
    """
    basis, values, every = np.linalg.svd(regressor * deviation, full_matrices=False)
    kept = values > 1e-6 * max(values[0], 1e-300)
    basis, values, shapes, silent = basis[:, kept], values[kept], every[kept], every[~kept]
    own = own / (np.sqrt(np.mean(own**2, axis=0)) + 1e-300)
    outer = np.linalg.qr(own)[0]
    free = lambda matrix: matrix - outer @ (outer.T @ matrix)  # noqa: E731
    design, target = free(basis * values), free(torque - regressor @ theta)
    gram, side, variance = design.T @ design, design.T @ target, float(np.mean(target**2))
    z = np.zeros(len(values))
    covariance = np.eye(len(values))
    for _ in range(ROUNDS):
        weight = min(1.0, independent / len(target)) / max(variance, 1e-300)
        covariance = np.linalg.inv(gram * weight + np.eye(len(values)))
        z = covariance @ side * weight
        variance = float(np.mean((target - design @ z) ** 2))
    # the directions that these logs do not excite stay as described
    spread = np.concatenate([np.linalg.cholesky(covariance).T @ shapes, silent])
    return theta + deviation * (z @ shapes), (deviation * spread).T


def uncertainty(theta: Array) -> Array:
    """Standard deviations (10 N,) of inertial parameters: mass, first moments and inertias of each link in turn."""
    found = []
    for mass, *rest in theta.reshape(-1, 10):
        moment, inertia = np.array(rest[:3]), np.array(rest[3:])
        size = abs(inertia[0]) + abs(inertia[2]) + abs(inertia[5])  # the trace in Pinocchio's order
        lever = max(float(np.linalg.norm(moment)), float(np.sqrt(abs(mass) * size)) / 2.0)
        found += [abs(mass), *[lever / np.sqrt(3.0)] * 3, *[size / 3.0] * 6]
    return UNCERTAIN * np.array(found)
