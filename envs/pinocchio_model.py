"""Robots as Pinocchio models: an independent rigid-body engine with RNEA, ABA and the inertial regressor.

Rotors enter as armature. Viscous friction is added here: Pinocchio's RNEA and ABA treat a model's damping
differently from version to version.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import singledispatch
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin

from envs.log import Array
from envs.mjcf import DescribedBody
from envs.robot import RigidBody, Robot, RobotError
from envs.scara import ScaraBody


def pinocchio_model(robot: Robot) -> pin.Model:
    """The robot's body and rotors as a Pinocchio model; its joints stand in the order of the robot's.

    Raises RobotError when a motor turns with several joints and has a rotor of its own, or when the order differs.
    """
    model = _body_model(robot.body)
    names = [joint.name for joint in robot.joints]
    if list(model.names)[1:] != names or model.nq != model.nv:
        raise RobotError(
            f"Pinocchio has the joints {', '.join(list(model.names)[1:])}, the robot {', '.join(names)}",
            remedy="List the joints along the kinematic tree, each of one degree of freedom and with limits",
        )
    rotors = robot.coupling_matrix.T @ np.diag(robot.drive_values("reflected_inertia")) @ robot.coupling_matrix
    if np.any(rotors != np.diag(np.diag(rotors))):
        raise RobotError(
            "a rotor turns with several joints", remedy="Add its inertia to the links; Pinocchio's armature is diagonal"
        )
    model.armature = np.diag(rotors).copy()
    return model


def inverse_dynamics(robot: Robot, model: pin.Model, position: Array, velocity: Array, acceleration: Array) -> Array:
    """Joint torques by RNEA, shape (n,), for one state with arguments of shape (n,)."""
    torque = pin.rnea(model, model.createData(), position, velocity, acceleration)
    return np.array(torque) + robot.drive_values("viscous") * velocity


def forward_dynamics(robot: Robot, model: pin.Model, position: Array, velocity: Array, torque: Array) -> Array:
    """Joint accelerations by ABA, shape (n,), for one state with arguments of shape (n,)."""
    net = torque - robot.drive_values("viscous") * velocity
    return np.array(pin.aba(model, model.createData(), position, velocity, net))


def torque_regressor(
    model: pin.Model,
    position: Array,
    velocity: Array,
    acceleration: Array,
    *,
    rows: Sequence[int] | None = None,
) -> Array:
    """W with W theta = M_body q'' + b, shape (..., n, 10 n); rotors and friction are not part of it.

    position, velocity, acceleration: (..., n). rows: the joints, from 0, whose rows are wanted; all unless given.
    """
    wanted = np.arange(model.nv) if rows is None else np.array(rows)
    states = [np.asarray(item, dtype=np.float64) for item in (position, velocity, acceleration)]
    shape, data = states[0].shape[:-1], model.createData()
    found = np.empty((math.prod(shape), len(wanted), 10 * model.nv))
    for k, state in enumerate(zip(*(item.reshape(-1, model.nv) for item in states), strict=True)):
        found[k] = pin.computeJointTorqueRegressor(model, data, *state)[wanted]
    return found.reshape(*shape, *found.shape[1:])


def inertial_parameters(model: pin.Model) -> Array:
    """theta, shape (10 n,): per joint mass, first moments and inertia at the joint, in Pinocchio's order."""
    return np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])


@singledispatch
def _body_model(body: RigidBody) -> pin.Model:
    raise RobotError(f"no Pinocchio model of a {type(body).__name__}", remedy="Use a SCARA body or one from a file")


@_body_model.register
def _(body: ScaraBody) -> pin.Model:
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -body.gravity])
    parent = 0
    reach = 0.0
    for name, link in (("J1", body.link_1), ("J2", body.link_2)):
        parent = model.addJoint(parent, pin.JointModelRZ(), _along(reach), name)
        inertia = np.eye(3) * (link.inertia.value + link.rotor_inertia.value)
        centre = np.array([link.centre_of_mass.value, 0.0, 0.0])
        model.appendBodyToJoint(parent, pin.Inertia(link.mass.value, centre, inertia), pin.SE3.Identity())
        reach = link.length.value
    downward = pin.JointModelPrismaticUnaligned(np.array([0.0, 0.0, -1.0]))
    parent = model.addJoint(parent, downward, _along(reach), "J3")
    parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Identity(), "J4")
    quill = pin.Inertia(body.quill.mass.value, np.zeros(3), np.eye(3) * body.quill.inertia.value)
    model.appendBodyToJoint(parent, quill, pin.SE3.Identity())
    return model


@_body_model.register
def _(body: DescribedBody) -> pin.Model:
    if Path(body.path).suffix.lower() != ".urdf":
        return _tree(body.spec().compile())
    try:
        model = pin.buildModelFromXML(_turning(Path(body.path)))
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise RobotError(f"Pinocchio refuses {body.path}: {reason}", remedy="Correct this element") from None
    model.armature = np.zeros(model.nv)
    return model


def _turning(path: Path) -> str:
    """A URDF with its continuous joints as revolute ones without limits: one number tells where they are."""
    tree = ElementTree.parse(path)
    for joint in tree.iter("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            for limit in joint.findall("limit"):
                joint.remove(limit)
            ElementTree.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
    return ElementTree.tostring(tree.getroot(), encoding="unicode")


def _tree(body: mujoco.MjModel) -> pin.Model:
    """The kinematic tree that MuJoCo has compiled: includes, defaults, bodies without names and the weight of meshes
    are settled there, and Pinocchio's own reader loses some of them without a word."""
    model = pin.Model()
    model.gravity.linear = body.opt.gravity
    carriers = {0: (0, pin.SE3.Identity())}  # of every MuJoCo body: the joint that moves it, and its place behind that
    for b in range(1, body.nbody):
        joint, place = carriers[int(body.body_parentid[b])]
        place = place * _placed(body.body_pos[b], body.body_quat[b])
        for k in range(body.body_jntadr[b], body.body_jntadr[b] + body.body_jntnum[b]):
            axis, zero = body.jnt_axis[k], float(body.qpos0[body.jnt_qposadr[k]])
            anchor = pin.SE3(np.eye(3), body.jnt_pos[k])
            if body.jnt_type[k] == mujoco.mjtJoint.mjJNT_HINGE:
                kind, back = pin.JointModelRevoluteUnaligned(axis), pin.SE3(pin.exp3(-zero * axis), np.zeros(3))
            else:
                kind, back = pin.JointModelPrismaticUnaligned(axis), pin.SE3(np.eye(3), -zero * axis)
            joint = model.addJoint(joint, kind, place * anchor * back, body.joint(k).name)
            place = anchor.inverse()
        inertia = pin.Inertia(float(body.body_mass[b]), np.zeros(3), np.diag(body.body_inertia[b]))
        model.appendBodyToJoint(joint, inertia, place * _placed(body.body_ipos[b], body.body_iquat[b]))
        carriers[b] = joint, place
    return model


def _placed(position: Array, quaternion: Array) -> pin.SE3:
    return pin.SE3(pin.Quaternion(*quaternion).matrix(), position)


def _along(distance: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([distance, 0.0, 0.0]))
