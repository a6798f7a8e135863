"""Robots as MuJoCo models: kinematic tree, drives, limits and brakes as an `MjSpec` that can be edited further.

`robot_spec` is the one way from a `Robot` to MuJoCo. Controls are what the amplifiers give at the motor terminals
[V], the motor current [A] or the joint torque, by kind of amplifier: ``ctrl = amplifier_gain * command``. The gains
travel in the model as the custom numeric ``amplifier_gain``.

MuJoCo's ``dcmotor`` solves the current's equation exactly over a step for constant voltage and speed, and lets the
force use the current at the step's end. With inductance every integrator, RK4 included, is therefore of first order
in the time step; without inductance, in current mode and in torque mode RK4 keeps its fourth order. The current limit
is a limit of the motor's torque to +-K i_max.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self
from xml.etree import ElementTree

import mujoco
import numpy as np

from envs.appearance import dress_scara
from envs.log import Array
from envs.robot import Robot, RobotError

if TYPE_CHECKING:
    from envs.robot import Joint
    from envs.scara import Link, ScaraBody

SHOULDER_HEIGHT = 0.80
"""Height of link 1 above the floor [m]; of no effect on the dynamics."""
LINK_OFFSET = 0.115
"""Height of link 2 above link 1 [m]; of no effect on the dynamics."""

_JOINT_TYPES = {"revolute": mujoco.mjtJoint.mjJNT_HINGE, "prismatic": mujoco.mjtJoint.mjJNT_SLIDE}


def robot_spec(
    robot: Robot, *, timestep: float = 1e-3, held: Mapping[int, float] | None = None, scenery: bool = True
) -> mujoco.MjSpec:
    """The nominal robot as an editable MuJoCo model: body, drives, joint limits; RK4, no contacts.

    timestep: of the integrator [s].
    held: joints, by number, that a brake holds, and where [rad or m]; their freedom and their drive are taken out.
    scenery: floor, lights, camera and the arm's shape; without them the model simulates a little faster.

    Raises RobotError when body and joints do not fit each other.
    """
    spec = robot.body.spec()
    spec.modelname = robot.name
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for row, joint in enumerate(robot.joints):
        _fit_joint(spec, joint)
        _add_drive(spec, robot, row)
    gains = spec.add_numeric(name="amplifier_gain")
    gains.data, gains.size = robot.drive_values("amplifier_gain"), len(robot)
    if not scenery:
        for geom in list(spec.geoms):
            # a shape with mass may be all that a described body has of inertia
            if geom.mass == 0.0 or geom.parent.name == "world":
                spec.delete(geom)
    for number, position in (held or {}).items():
        lock_joint(spec, robot.joint(number).name, position)
    return spec


def lock_joint(spec: mujoco.MjSpec, name: str, position: float) -> None:
    """Closes a joint's brake: the joint stands at `position` [rad or m] and its freedom and drive are gone.

    Raises RobotError for a joint that does not exist or that shares its body with a joint about another axis.
    """
    joint = _find_joint(spec, name)
    body = joint.parent
    others = [item for item in body.joints if item.name != name]
    if any(abs(np.dot(item.axis, joint.axis)) < 1.0 - 1e-12 or np.any(item.pos != joint.pos) for item in others):
        raise RobotError(f"joint {name} shares its body with other axes", remedy="Give each joint a body of its own")
    axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
    frame, turn, shift = _orientation(spec, body), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
        mujoco.mju_axisAngle2Quat(turn, axis, position)
        mujoco.mju_rotVecQuat(shift, np.array(joint.pos), turn)
        shift = np.array(joint.pos) - shift
    else:
        shift = position * axis
    moved, turned = np.zeros(3), np.zeros(4)
    mujoco.mju_rotVecQuat(moved, shift, frame)
    mujoco.mju_mulQuat(turned, frame, turn)
    body.pos, body.quat = np.array(body.pos) + moved, turned
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    for actuator in [item for item in spec.actuators if item.name == name]:
        spec.delete(actuator)
    for tendon in [item for item in spec.tendons if item.name == _motor_tendon(name)]:
        spec.delete(tendon)
    spec.delete(joint)


def scara_spec(body: ScaraBody) -> mujoco.MjSpec:
    """The kinematic tree of a SCARA arm: joints J1..J4, explicit inertias, the shape of an AdeptOne."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = [0.0, 0.0, -body.gravity]
    base = spec.worldbody.add_body(name="base", pos=[0.0, 0.0, SHOULDER_HEIGHT])
    link_1 = _add_link(base, "link_1", 0.0, 0.0, body.link_1)
    link_2 = _add_link(link_1, "link_2", body.link_1.length.value, LINK_OFFSET, body.link_2)
    quill = link_2.add_body(name="quill", pos=[body.link_2.length.value, 0.0, 0.0])
    _set_inertia(quill, body.quill.mass.value, body.quill.inertia.value, 0.0)
    link_1.add_joint(name="J1", axis=[0.0, 0.0, 1.0])
    link_2.add_joint(name="J2", axis=[0.0, 0.0, 1.0])
    quill.add_joint(name="J3", axis=[0.0, 0.0, -1.0], type=mujoco.mjtJoint.mjJNT_SLIDE)
    quill.add_joint(name="J4", axis=[0.0, 0.0, 1.0])
    quill.add_site(name="tool")
    dress_scara(spec, body.link_1.length.value, body.link_2.length.value)
    return spec


@dataclass(frozen=True)
class DescribedBody:
    """The rigid body of a file, MJCF or URDF. Drives stand elsewhere: actuators, damping, friction and armature of
    the file are left out.

    path: the file. joint_names: its joints in the order of the robot's joints.

    Raises RobotError, in one line, for a file that is missing or that MuJoCo refuses, such as one with an inertia
    that no body can have, and for joints that the file does not hold.
    """

    path: str
    joint_names: tuple[str, ...]

    def __post_init__(self) -> None:
        found = sorted(joint.name for joint in self.spec().joints)
        if found != sorted(self.joint_names):
            raise RobotError(
                f"the file has the joints {', '.join(found) or 'none'}, the description {', '.join(self.joint_names)}",
                remedy="Give one [[joint]] per joint of the file, under the same name",
                source=self.path,
            )
        self._model  # noqa: B018  compiled here, so that an impossible body is refused at once

    def spec(self) -> mujoco.MjSpec:
        """The kinematic tree without drives."""
        spec = _read(Path(self.path))
        for actuator in list(spec.actuators):
            spec.delete(actuator)
        for joint in spec.joints:
            joint.damping, joint.armature, joint.frictionloss = np.zeros_like(joint.damping), 0.0, 0.0
        return spec

    def inertia_matrix(self, position: Array) -> Array:
        """M(q), shape (..., n, n)."""
        position = np.asarray(position, dtype=np.float64)
        size, order = len(self.joint_names), self._columns
        matrices = np.zeros((position[..., 0].size, size, size))
        data = mujoco.MjData(self._model)
        full = np.zeros((size, size))
        for row, state in enumerate(position.reshape(-1, size)):
            data.qpos[order] = state
            mujoco.mj_forward(self._model, data)
            mujoco.mj_fullM(self._model, data, full)
            matrices[row] = full[np.ix_(order, order)]
        return matrices.reshape(*position.shape, size)

    def bias(self, position: Array, velocity: Array) -> Array:
        """b(q, q'), shape (..., n)."""
        position, velocity = np.broadcast_arrays(np.asarray(position, float), np.asarray(velocity, float))
        size, order = len(self.joint_names), self._columns
        bias = np.zeros((position[..., 0].size, size))
        data = mujoco.MjData(self._model)
        states = zip(position.reshape(-1, size), velocity.reshape(-1, size), strict=True)
        for row, (data.qpos[order], data.qvel[order]) in enumerate(states):
            mujoco.mj_forward(self._model, data)
            bias[row] = data.qfrc_bias[order]
        return bias.reshape(position.shape)

    def sample(self, rng: np.random.Generator) -> Self:
        """The same body: a file states no uncertainties."""
        return self

    @cached_property
    def _model(self) -> mujoco.MjModel:
        spec = self.spec()
        try:
            return spec.compile()
        except ValueError as error:
            raise _refused(error, self.path) from None

    @cached_property
    def _columns(self) -> list[int]:
        return [int(self._model.joint(name).qposadr[0]) for name in self.joint_names]


def _read(path: Path) -> mujoco.MjSpec:
    """The file's tree. Of a URDF the shapes that are meshes are left out: they lie in other packages, weigh nothing
    and touch nothing here. Raises RobotError for a file that is missing or that MuJoCo refuses."""
    if not path.is_file():
        raise RobotError("no such file", remedy="Give the path of an MJCF or URDF file", source=str(path))
    try:
        if path.suffix.lower() != ".urdf":
            return mujoco.MjSpec.from_file(str(path))
        tree = ElementTree.parse(path)
        for link in tree.iter("link"):
            for shape in [*link.findall("visual"), *link.findall("collision")]:
                if shape.find("geometry/mesh") is not None:
                    link.remove(shape)
        return mujoco.MjSpec.from_string(ElementTree.tostring(tree.getroot(), encoding="unicode"))
    except (ValueError, ElementTree.ParseError) as error:
        raise _refused(error, str(path)) from None


def joints_of_file(path: Path) -> list[dict[str, Any]]:
    """Name, kind and limits [rad or m] of the joints of an MJCF or URDF file, in its order.

    Raises RobotError for a file that is missing or refused, and for joints of several degrees of freedom.
    """
    spec = _read(path)
    try:
        model = spec.compile()
    except ValueError as error:
        raise _refused(error, str(path)) from None
    kinds = {int(number): kind for kind, number in _JOINT_TYPES.items()}
    found = []
    for row in range(model.njnt):
        joint = model.joint(row)
        if int(joint.type[0]) not in kinds:
            raise RobotError(
                f"joint {joint.name} is neither a hinge nor a slide", remedy="Fix the base", source=str(path)
            )
        item: dict[str, Any] = {"name": joint.name, "kind": kinds[int(joint.type[0])]}
        if model.jnt_limited[row]:
            item["lower"], item["upper"] = (float(value) for value in joint.range)
        found.append(item)
    return found


def _refused(error: Exception, path: str) -> RobotError:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    reason = ", ".join(lines).removeprefix("Error: ").rstrip(".")
    return RobotError(f"MuJoCo refuses the description: {reason}", remedy="Correct this element", source=path)


def _add_link(parent: mujoco.MjsBody, name: str, along: float, above: float, link: Link) -> mujoco.MjsBody:
    body = parent.add_body(name=name, pos=[along, 0.0, above])
    mass, centre = link.mass.value, link.centre_of_mass.value
    _set_inertia(body, mass, link.inertia.value + link.rotor_inertia.value, centre)
    return body


def _set_inertia(body: mujoco.MjsBody, mass: float, inertia: float, centre: float) -> None:
    # Links turn about the vertical alone, so one number acts; the same about all axes is a possible body.
    body.explicitinertial = True
    body.mass, body.ipos, body.inertia = mass, [centre, 0.0, 0.0], [inertia] * 3


def _orientation(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> Array:
    """The body's orientation in its parent as a quaternion, however the file writes it."""
    if body.alt.type == mujoco.mjtOrientation.mjORIENTATION_QUAT:
        return np.array(body.quat)
    options = spec.compiler
    return np.array(spec.resolve_orientation(degree=options.degree, sequence=options.eulerseq, orientation=body.alt))


def _find_joint(spec: mujoco.MjSpec, name: str) -> mujoco.MjsJoint:
    joint = spec.joint(name)
    if joint is None:
        raise RobotError(f"the model has no joint {name}", remedy="Name the joints of robot and model alike")
    return joint


def _fit_joint(spec: mujoco.MjSpec, joint: Joint) -> None:
    element = _find_joint(spec, joint.name)
    if element.type != _JOINT_TYPES[joint.kind]:
        raise RobotError(f"joint {joint.name} is {joint.kind} but the model's is not", remedy="Correct one of them")
    if math.isfinite(joint.lower.value) and math.isfinite(joint.upper.value):
        element.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        element.range = [joint.lower.value, joint.upper.value]
    element.damping = np.full_like(element.damping, 0.0)
    element.damping[0] = joint.drive.viscous.value


def _motor_tendon(name: str) -> str:
    return f"{name}_motor"


def _add_drive(spec: mujoco.MjSpec, robot: Robot, row: int) -> None:
    joint, turns = robot.joints[row], robot.coupling_matrix[row]
    drive = joint.drive
    actuator = spec.add_actuator(name=joint.name)
    if np.array_equal(turns, np.eye(len(robot))[row]):
        actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_JOINT, joint.name
        spec.joint(joint.name).armature = drive.reflected_inertia
    else:
        tendon = spec.add_tendon(name=_motor_tendon(joint.name), armature=drive.reflected_inertia)
        for other, share in zip(robot.joints, turns, strict=True):
            if share:
                tendon.wrap_joint(other.name, share)
        actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_TENDON, tendon.name
    current, constant = drive.current_limit.value, drive.motor_constant.value
    if drive.amplifier == "voltage":
        actuator.gear[0] = drive.gear_ratio.value
        actuator.set_to_dcmotor(
            motorconst=[constant, 0.0],
            resistance=drive.resistance.value,
            saturation=[0.0, current if math.isfinite(current) else 0.0, 0.0],
            inductance=[drive.inductance.value, 0.0],
        )
        limit = min(drive.voltage_limit.value, drive.amplifier_gain.value * drive.command_limit.value)
    else:
        actuator.set_to_motor()
        actuator.gear[0] = drive.torque_constant if drive.amplifier == "current" else 1.0
        limit = drive.amplifier_gain.value * drive.command_limit.value
        if drive.amplifier == "current":
            limit = min(limit, current)
    if math.isfinite(limit):
        actuator.ctrllimited, actuator.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, [-limit, limit]
