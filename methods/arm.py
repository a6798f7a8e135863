"""Several joints at once: the arm's rigid body by Pinocchio, and its drives in units of the command.

    u_j = c_j (tau_j + T_j tau_j') + k_j q_j' + o_j + f_j tanh(q_j' / w_j),     tau = W(q, q', q'') theta

with c_j command units per joint torque, T_j the winding's time constant (0 for current and torque drives), k_j all
damping (back-EMF and viscous), o_j an offset, f_j dry friction, and theta ten inertial parameters per joint, to which
tau adds the rotors' I_j q_j''. Kinematics, gravity and the nominal numbers are those of the robot's description. Of
theta the logs tell only the base parameters; the rest stays as described, so that the model has a complete body to
simulate (M. Gautier, W. Khalil, IEEE Trans. Robot. Autom. 6 (1990) 368).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from envs.log import Array, Hold, InputKind, Log
from envs.robot import Robot, RobotError
from envs.robots import find_robot
from methods.base import MethodError, Model, Motion, State
from methods.usable_logs import check_logs

if TYPE_CHECKING:
    import pinocchio as pin

SUBSTEP = 1e-3
"""Longest step of the integrator [s]."""
OUT_OF_REACH = 1e6
"""Speed at which a simulation counts as diverged [rad/s or m/s]."""
LEAST_LAG = 1e-5
"""Time constant below which a winding has none [s]."""
REVERSAL = 1e-2
"""w_j as a share of the joint's largest speed."""


@dataclass(frozen=True, eq=False)
class Drives:
    """Per joint, each (n,): c [command unit per N m or N], T [s], k, o, f and w of the equation above."""

    scale: Array
    lag: Array
    damping: Array
    offset: Array
    friction: Array
    reversal: Array


@dataclass(frozen=True, eq=False)
class ArmModel(Model):
    """A robot's kinematics with identified inertial parameters theta (10 N,), rotors (N,) and drives of n joints.

    robot: name or path of the description, which has N joints. held: positions of all of them [rad or m], where those
    that the model does not move stay.
    """

    robot: str
    joints: tuple[int, ...]
    inputs: tuple[InputKind, ...]
    held: tuple[float, ...]
    theta: Array
    rotors: Array
    drives: Drives

    def body(self) -> pin.Model:
        """The Pinocchio model with theta and the rotors in it."""
        import pinocchio as pin

        model = described_body(find_robot(self.robot))
        model.armature = self.rotors.copy()
        for number in range(len(self.rotors)):
            values = self.theta[10 * number : 10 * number + 10]
            massless = not np.any(values)
            model.inertias[number + 1] = pin.Inertia.Zero() if massless else pin.Inertia.FromDynamicParameters(values)
        return model

    def inverse(self, time: Array, motion: Motion, command: Array | None = None) -> Array:
        """Command (T, n); the torque's rate is its difference quotient along the motion."""
        import pinocchio as pin

        model, own = self.body(), self.drives
        data, rows = model.createData(), [joint - 1 for joint in self.joints]
        torques = np.array([pin.rnea(model, data, *state)[rows] for state in full_states(motion, rows, self.held)])
        rate = np.gradient(torques, time, axis=0) if np.any(own.lag > 0.0) else 0.0
        friction = own.friction * np.tanh(motion.velocity / own.reversal)
        return own.scale * (torques + own.lag * rate) + own.damping * motion.velocity + own.offset + friction

    def simulate(self, time: Array, command: Array, initial: State, hold: Hold = "zero_order") -> Motion:
        """Runge-Kutta of order 4 in steps of 1 ms at most; the winding's lag is exact for a held command."""
        import pinocchio as pin

        model, own = self.body(), self.drives
        data, rows = model.createData(), np.array(self.joints) - 1
        lagging = own.lag > LEAST_LAG
        lag = np.where(lagging, own.lag, 1.0)
        stiff = np.where(lagging, 0.0, own.damping)  # without a winding the damping acts at once
        place, speed = np.array(self.held), np.zeros(len(self.held))
        square = np.ix_(rows, rows)

        def acceleration(q: Array, v: Array, w: Array) -> Array:
            place[rows], speed[rows] = q, v
            bias = pin.nonLinearEffects(model, data, place, speed)[rows]
            net = (w - own.offset - own.friction * np.tanh(v / own.reversal)) / own.scale - bias
            return np.linalg.solve(pin.crba(model, data, place)[square], net)

        q, v = initial.position.copy(), initial.velocity.copy()
        still = acceleration(q, v, np.zeros(len(rows)))
        motor = own.scale * (pin.crba(model, data, place)[square] @ (initial.acceleration - still))
        out = np.full((4, len(time), len(rows)), np.nan)
        for k in range(len(time)):
            out[0, k], out[1, k] = q, v
            out[2, k] = acceleration(q, v, np.where(lagging, motor, command[k] - own.damping * v))
            if k == len(time) - 1 or not np.all(np.abs(v) < OUT_OF_REACH):
                break
            span = time[k + 1] - time[k]
            steps = max(1, int(np.ceil(span / SUBSTEP - 1e-6)))
            h = span / steps
            decay = np.where(lagging, np.exp(-h / lag), 0.0)
            share = np.where(lagging, (1.0 - decay) * lag / h, 0.0)
            for i in range(steps):
                u = command[k]
                if hold == "first_order":
                    u = u + (i + 0.5) / steps * (command[k + 1] - command[k])
                final = u - own.damping * v
                mean = final + (motor - final) * share
                a1 = acceleration(q, v, mean)
                v2 = v + 0.5 * h * a1
                a2 = acceleration(q + 0.5 * h * v, v2, mean - stiff * (v2 - v))
                v3 = v + 0.5 * h * a2
                a3 = acceleration(q + 0.5 * h * v2, v3, mean - stiff * (v3 - v))
                v4 = v + h * a3
                a4 = acceleration(q + h * v3, v4, mean - stiff * (v4 - v))
                final = u - own.damping * (v + h / 12.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4))
                motor = final + (motor - final) * decay
                q = q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
                v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        out[3] = np.gradient(out[2], time, axis=0)
        return Motion(*out)


def described(logs: Sequence[Log], name: str | None) -> tuple[str, Robot, tuple[float, ...]]:
    """(name, robot, positions of its joints) that logs of some of its joints belong to.

    Joints that the logs do not hold stand in the middle of their range. Raises MethodError without a description.
    """
    joints = check_logs(logs)
    name = name or logs[0].robot
    if name is None:
        raise MethodError(
            "the logs do not say which robot they are of", remedy="Set the log's robot, or give robot=NAME or a path"
        )
    try:
        robot = find_robot(name)
        for joint in joints:
            robot.joint(joint)
    except RobotError as error:
        raise MethodError(error.problem, remedy=error.remedy) from None
    ends = [(joint.lower.value, joint.upper.value) for joint in robot.joints]
    return name, robot, tuple(0.5 * (a + b) if np.isfinite(a + b) else 0.0 for a, b in ends)


def described_body(robot: Robot) -> pin.Model:
    """The robot's body with its rotors as armature. Raises MethodError where Pinocchio cannot have it."""
    from envs.pinocchio_model import pinocchio_model

    if np.any(robot.coupling_matrix != np.eye(len(robot))):
        raise MethodError("a motor of this robot turns several joints", remedy="Describe it with one motor per joint")
    try:
        return pinocchio_model(robot)
    except RobotError as error:
        raise MethodError(error.problem, remedy=error.remedy) from None


def full_states(motion: Motion, rows: Sequence[int], held: tuple[float, ...]) -> Iterator[tuple[Array, Array, Array]]:
    """Position, velocity and acceleration of all the robot's joints, sample by sample; those not in `rows` stand."""
    place, speed, change = np.array(held), np.zeros(len(held)), np.zeros(len(held))
    for k in range(len(motion)):
        place[rows], speed[rows], change[rows] = motion.position[k], motion.velocity[k], motion.acceleration[k]
        yield place, speed, change
