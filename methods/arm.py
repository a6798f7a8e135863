"""Several joints at once: the arm's rigid body by Pinocchio, and its drives in units of the command.

    u_j = c_j (tau_j + T_j tau_j') + k_j q_j' + o_j + f_j tanh(q_j' / w_j),     tau = W(q, q', q'') theta

with c_j command units per joint torque, T_j the winding's time constant (0 for current and torque drives), k_j all
damping (back-EMF and viscous), o_j an offset, f_j dry friction, and theta ten inertial parameters per joint, to which
tau adds the rotors' I_j q_j''. Kinematics, gravity and the nominal numbers are those of the robot's description. Of
theta the logs tell only the base parameters; the rest stays as described, so that the model has a complete body to
simulate (M. Gautier, W. Khalil, IEEE Trans. Robot. Autom. 6 (1990) 368).
"""

from __future__ import annotations

from collections.abc import Sequence
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
    """A robot's kinematics with identified inertial parameters theta (10 n,) and drives.

    robot: name or path of the description. held: positions of all the robot's joints [rad or m], of which those that
    the model does not move stay there.
    """

    robot: str
    joints: tuple[int, ...]
    inputs: tuple[InputKind, ...]
    held: tuple[float, ...]
    theta: Array
    rotors: Array
    drives: Drives

    def body(self) -> pin.Model:
        """The Pinocchio model with theta and the rotors (n,) in it."""
        import pinocchio as pin

        model = reduced_body(find_robot(self.robot), self.joints, self.held)
        model.armature = self.rotors.copy()
        for number in range(len(self.joints)):
            values = self.theta[10 * number : 10 * number + 10]
            model.inertias[number + 1] = pin.Inertia.FromDynamicParameters(values)
        return model

    def inverse(self, time: Array, motion: Motion, command: Array | None = None) -> Array:
        """Command (T, n); the torque's rate is its difference quotient along the motion."""
        torques = inverse_dynamics(self.body(), motion)
        own = self.drives
        rate = np.gradient(torques, time, axis=0) if np.any(own.lag > 0.0) else 0.0
        friction = own.friction * np.tanh(motion.velocity / own.reversal)
        return own.scale * (torques + own.lag * rate) + own.damping * motion.velocity + own.offset + friction

    def simulate(self, time: Array, command: Array, initial: State, hold: Hold = "zero_order") -> Motion:
        """Runge-Kutta of order 4 on ABA; the winding's lag is exact for a held command."""
        import pinocchio as pin

        model, own = self.body(), self.drives
        data, n = model.createData(), len(self.joints)
        lagging = own.lag > 1e-5
        q, v = initial.position.copy(), initial.velocity.copy()
        free = pin.rnea(model, data, q, v, initial.acceleration)
        motor = own.scale * free + own.offset + own.friction * np.tanh(v / own.reversal)
        out = np.full((4, len(time), n), np.nan)

        def acceleration(q: Array, v: Array, w: Array) -> Array:
            net = (w - own.offset - own.friction * np.tanh(v / own.reversal)) / own.scale
            return np.array(pin.aba(model, data, q, v, net))

        for k in range(len(time)):
            out[0, k], out[1, k] = q, v
            out[2, k] = acceleration(q, v, np.where(lagging, motor, command[k] - own.damping * v))
            if k == len(time) - 1 or not np.all(np.abs(v) < 1e6):
                break
            span = time[k + 1] - time[k]
            steps = max(1, int(np.ceil(span / SUBSTEP - 1e-6)))
            h = span / steps
            decay = np.exp(-h / np.where(lagging, own.lag, 1.0))
            share = (1.0 - decay) * np.where(lagging, own.lag, 1.0) / h
            for i in range(steps):
                u = command[k]
                if hold == "first_order":
                    u = u + (i + 0.5) / steps * (command[k + 1] - command[k])
                final = u - own.damping * v
                mean = np.where(lagging, final + (motor - final) * share, final)
                stiff = np.where(lagging, 0.0, own.damping)  # without a winding the damping acts at once
                a1 = acceleration(q, v, mean)
                v2 = v + 0.5 * h * a1
                a2 = acceleration(q + 0.5 * h * v, v2, mean - stiff * (v2 - v))
                v3 = v + 0.5 * h * a2
                a3 = acceleration(q + 0.5 * h * v2, v3, mean - stiff * (v3 - v))
                v4 = v + h * a3
                a4 = acceleration(q + h * v3, v4, mean - stiff * (v4 - v))
                q = q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
                before, v = v, v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
                final = u - own.damping * 0.5 * (before + v)
                motor = np.where(lagging, final + (motor - final) * decay, final)
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


def reduced_body(robot: Robot, joints: tuple[int, ...], held: tuple[float, ...]) -> pin.Model:
    """The robot's body with its rotors as armature and all other joints locked where they are held."""
    import pinocchio as pin

    from envs.pinocchio_model import pinocchio_model

    if tuple(sorted(joints)) != joints:
        raise MethodError(f"the joints {list(joints)} are out of order", remedy="Order them: log.select(joints)")
    if np.any(robot.coupling_matrix != np.eye(len(robot))):
        raise MethodError("a motor of this robot turns several joints", remedy="Describe it with one motor per joint")
    try:
        model = pinocchio_model(robot)
    except RobotError as error:
        raise MethodError(error.problem, remedy=error.remedy) from None
    locked = [number for number in range(1, len(robot) + 1) if number not in joints]
    return pin.buildReducedModel(model, locked, np.array(held)) if locked else model


def inverse_dynamics(model: pin.Model, motion: Motion) -> Array:
    """Torques (T, n) of the body."""
    import pinocchio as pin

    data = model.createData()
    states = zip(motion.position, motion.velocity, motion.acceleration, strict=True)
    return np.array([pin.rnea(model, data, *state) for state in states])
