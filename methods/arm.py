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
from numpy.typing import NDArray

from envs.log import Array, InputKind, Log
from envs.robot import Robot, RobotError
from envs.robots import find_robot
from methods.base import MethodError
from methods.driven import DrivenModel, Drives, RigidDynamics
from methods.usable_logs import check_logs

if TYPE_CHECKING:
    import pinocchio as pin

REVERSAL = 1e-2
"""w_j as a share of the joint's largest speed."""
LIGHT = 1e-3
"""Share of the norm of a body's ten numbers (SI) below which its mass is too small to divide by."""


@dataclass(frozen=True, eq=False)
class ArmModel(DrivenModel):
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

    def dynamics(self) -> RigidDynamics:
        """Pinocchio's composite-rigid-body algorithm and its bias, for the moving joints.

        Base parameters need not be those of a body: the mass may be negative, or zero beside a first moment, and
        Pinocchio divides by it. M and b are linear in theta, so that such a body is the difference of two: itself with
        a point mass at its joint, and that point mass.
        """
        rows = np.array(self.joints) - 1
        bodies = self.theta.reshape(-1, 10)
        size = np.linalg.norm(bodies, axis=1)
        ballast = np.zeros_like(bodies)
        ballast[:, 0] = np.where((size > 0.0) & (bodies[:, 0] < LIGHT * size), 2.0 * size, 0.0)
        whole = PinocchioDynamics(self._body(bodies + ballast, self.rotors), rows, self.held)
        if not np.any(ballast):
            return whole
        return Difference(whole, PinocchioDynamics(self._body(ballast, np.zeros_like(self.rotors)), rows, self.held))

    def _body(self, bodies: Array, rotors: Array) -> pin.Model:
        """The robot's Pinocchio model with other bodies (N, 10) and rotors (N,)."""
        import pinocchio as pin

        model = described_body(find_robot(self.robot))
        model.armature = rotors.copy()
        for number, values in enumerate(bodies):
            massless = not np.any(values)
            model.inertias[number + 1] = pin.Inertia.Zero() if massless else pin.Inertia.FromDynamicParameters(values)
        return model


@dataclass(frozen=True, eq=False)
class Difference:
    """M and b of one body less those of another."""

    whole: RigidDynamics
    part: RigidDynamics

    def inertia(self, position: Array) -> Array:
        """See `RigidDynamics`."""
        return self.whole.inertia(position) - self.part.inertia(position)

    def bias(self, position: Array, velocity: Array) -> Array:
        """See `RigidDynamics`."""
        return self.whole.bias(position, velocity) - self.part.bias(position, velocity)


class PinocchioDynamics:
    """M and b of some joints (`rows`) of a body whose other joints are held."""

    def __init__(self, model: pin.Model, rows: NDArray[np.int64], held: tuple[float, ...]):
        import pinocchio as pin

        self._pin, self._model, self._data = pin, model, model.createData()
        self._rows, self._square = rows, np.ix_(rows, rows)
        self._position, self._velocity = np.array(held), np.zeros(len(held))

    def inertia(self, position: Array) -> Array:
        """See `RigidDynamics`."""
        self._position[self._rows] = position
        whole: Array = self._pin.crba(self._model, self._data, self._position)
        return whole[self._square]

    def bias(self, position: Array, velocity: Array) -> Array:
        """See `RigidDynamics`."""
        self._position[self._rows], self._velocity[self._rows] = position, velocity
        whole: Array = self._pin.nonLinearEffects(self._model, self._data, self._position, self._velocity)
        return whole[self._rows]


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


def full_states(motion: Sequence[Array], rows: Sequence[int], held: Sequence[float] | Array) -> Array:
    """Position, velocity and acceleration (3, T, N) of all the robot's joints from those (T, n) of some of them; those
    not in `rows` stand where they are held."""
    full = np.zeros((3, len(motion[0]), len(held)))
    full[0] = held
    full[:, :, rows] = np.stack(motion)
    return full
