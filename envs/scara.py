"""Closed-form equations of a four-joint SCARA arm: two vertical hinges, a vertical quill and the tool's yaw.

Coordinates: q1 of link 1 to the base, q2 of link 2 to link 1, q3 of the quill along its axis (downward, 0 at the upper
end), q4 of the quill about its axis to link 2; hinge axes point upward. With c2 = cos q2, s2 = sin q2::

    M = | p1 + p2 + 2 p3 c2 + J   p2 + p3 c2 + J   0   J |       b = | -p3 s2 (2 q1' q2' + q2'^2) |
        |      p2 + p3 c2 + J          p2 + J      0   J |           |  p3 s2 q1'^2               |
        |            0                   0         m   0 |           | -m g                       |
        |            J                   J         0   J |           |  0                         |

    p1 = I1 + J1 + m1 c1^2 + (m2 + m) l1^2,  p2 = I2 + J2 + m2 c2^2 + m l2^2,  p3 = l1 (m2 c2 + m l2)

for link lengths l, masses m, centres of mass c, inertias I at the centre of mass, rotors J1, J2 bolted to the links,
quill of mass m and inertia J. The quill turns with q1 + q2 + q4, which couples the yaw into joints 1 and 2.

The functions of plain numbers at the top work on floats, on arrays and, compiled by numba, inside `envs.kernel`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from envs.description_units import LINK_UNITS
from envs.log import Array
from envs.robot import Quantity, RobotError, parse_record, sample_fields

if TYPE_CHECKING:
    import mujoco

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s^2] (CGPM 1901)."""


def planar_inertia(cos2, p1, p2, p3, yaw):
    """M11, M12, M22 [kg m^2]; the other elements are constants."""
    return p1 + p2 + 2.0 * p3 * cos2 + yaw, p2 + p3 * cos2 + yaw, p2 + yaw


def planar_bias(sin2, velocity1, velocity2, p3):
    """b1, b2 [N m]: Coriolis and centrifugal torques."""
    return -p3 * sin2 * (2.0 * velocity1 + velocity2) * velocity2, p3 * sin2 * velocity1 * velocity1


@dataclass(frozen=True)
class Link:
    """A horizontal link. `centre_of_mass`: distance from its joint axis towards the next one.

    inertia: about the vertical through the centre of mass. rotor_inertia: the direct drive's rotor bolted to the link,
    about the link's joint axis. Raises RobotError for a mass or inertia that no body can have.
    """

    length: Quantity
    mass: Quantity
    centre_of_mass: Quantity
    inertia: Quantity
    rotor_inertia: Quantity

    def __post_init__(self) -> None:
        _check_body("link", self.mass, self.inertia)
        if self.rotor_inertia.value < 0.0 or self.length.value <= 0.0:
            raise RobotError(
                f"length {self.length.value} m, rotor_inertia {self.rotor_inertia.value} kg m^2",
                remedy="Give a positive length and a non-negative inertia",
            )


@dataclass(frozen=True)
class Quill:
    """The vertical shaft with its tool flange, symmetric about the axis of joints 3 and 4."""

    mass: Quantity
    inertia: Quantity

    def __post_init__(self) -> None:
        _check_body("quill", self.mass, self.inertia)


@dataclass(frozen=True)
class ScaraParameters:
    """The minimal inertial parameters of the closed form: p1, p2, p3, yaw J [kg m^2], mass m [kg], gravity [m/s^2]."""

    p1: float
    p2: float
    p3: float
    yaw: float
    mass: float
    gravity: float


@dataclass(frozen=True)
class ScaraBody:
    """The arm of a SCARA robot without its drives; see the equations of this module."""

    link_1: Link
    link_2: Link
    quill: Quill
    gravity: float = STANDARD_GRAVITY

    @cached_property
    def parameters(self) -> ScaraParameters:
        """The minimal inertial parameters."""
        first, second, tool = self.link_1, self.link_2, self.quill.mass.value
        l1, l2 = first.length.value, second.length.value
        moment = second.mass.value * second.centre_of_mass.value + tool * l2
        return ScaraParameters(
            p1=_about_axis(first) + (second.mass.value + tool) * l1**2,
            p2=_about_axis(second) + tool * l2**2,
            p3=l1 * moment,
            yaw=self.quill.inertia.value,
            mass=tool,
            gravity=self.gravity,
        )

    def inertia_matrix(self, position: Array) -> Array:
        """M(q), shape (..., 4, 4)."""
        p = self.parameters
        position = np.asarray(position, dtype=np.float64)
        matrix = np.zeros((*position.shape, 4))
        m11, m12, m22 = planar_inertia(np.cos(position[..., 1]), p.p1, p.p2, p.p3, p.yaw)
        matrix[..., 0, 0], matrix[..., 1, 1], matrix[..., 2, 2] = m11, m22, p.mass
        matrix[..., 0, 1] = matrix[..., 1, 0] = m12
        for joint in (0, 1, 3):
            matrix[..., joint, 3] = matrix[..., 3, joint] = p.yaw
        return matrix

    def bias(self, position: Array, velocity: Array) -> Array:
        """b(q, q'), shape (..., 4)."""
        p = self.parameters
        position, velocity = np.asarray(position, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
        bias = np.zeros(np.broadcast_shapes(position.shape, velocity.shape))
        bias[..., 0], bias[..., 1] = planar_bias(np.sin(position[..., 1]), velocity[..., 0], velocity[..., 1], p.p3)
        bias[..., 2] = -p.mass * p.gravity
        return bias

    def tool_pose(self, position: Array) -> Array:
        """Position of the tool flange and its yaw (x, y [m], drop below the upper end [m], yaw [rad]), (..., 4)."""
        q1, q12 = position[..., 0], position[..., 0] + position[..., 1]
        l1, l2 = self.link_1.length.value, self.link_2.length.value
        return np.stack(
            [
                l1 * np.cos(q1) + l2 * np.cos(q12),
                l1 * np.sin(q1) + l2 * np.sin(q12),
                position[..., 2],
                q12 + position[..., 3],
            ],
            axis=-1,
        )

    def spec(self) -> mujoco.MjSpec:
        """The kinematic tree as an editable MuJoCo model without drives."""
        from envs.mjcf import scara_spec

        return scara_spec(self)

    def sample(self, rng: np.random.Generator) -> ScaraBody:
        """A draw within the stated uncertainties."""
        return ScaraBody(
            sample_fields(self.link_1, rng),
            sample_fields(self.link_2, rng),
            sample_fields(self.quill, rng),
            self.gravity,
        )


def parse_scara(table: Mapping[str, Any], sources: Mapping[str, str]) -> ScaraBody:
    """The body of a robot description's table ``[body]`` of kind scara."""
    kinds = {"link_1": Link, "link_2": Link, "quill": Quill}
    if set(table) != set(kinds):
        raise RobotError(f"a SCARA body has the parts {sorted(table)}", remedy=f"Give {', '.join(kinds)}")
    return ScaraBody(
        **{name: parse_record(kind, table[name], sources, f"body.{name}", LINK_UNITS) for name, kind in kinds.items()}
    )


def _about_axis(link: Link) -> float:
    """Inertia of link and rotor about the link's joint axis [kg m^2]."""
    return link.inertia.value + link.rotor_inertia.value + link.mass.value * link.centre_of_mass.value**2


def _check_body(name: str, mass: Quantity, inertia: Quantity) -> None:
    for what, quantity in (("mass", mass), ("inertia", inertia)):
        if not 0.0 < quantity.value < math.inf:
            raise RobotError(
                f"{what} of the {name} is {quantity.value} {quantity.unit}", remedy="Give a positive number"
            )
