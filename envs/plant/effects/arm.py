"""Effects of the arm. All torques resist positive motion; dry friction holds at rest, by MuJoCo's constraint."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from envs.plant.effects.base import Effect, EffectError, effect, parameter
from envs.plant.tables import POSITION_SINE, PULSE, TIME_SINE

if TYPE_CHECKING:
    from envs.plant.build import Build
    from envs.robot import Robot

_DRIVE_NUMBERS = ("viscous", "motor_constant", "resistance", "inductance", "amplifier_gain")


@effect("coulomb_friction", "arm")
@dataclass(frozen=True, kw_only=True)
class CoulombFriction(Effect):
    """torque sign(q'); at rest whatever holds, up to `torque`."""

    torque: float = parameter("torque", lower=0.0)

    def install(self, build: Build) -> None:
        """Raises the friction limit."""
        row = build.row(self)
        row["coulomb"] += self.torque
        row["dry"] = 1


@effect("stribeck_friction", "arm")
@dataclass(frozen=True, kw_only=True)
class StribeckFriction(Effect):
    """(torque + (static_torque - torque) exp(-(q' / velocity)^2)) sign(q'); at rest up to `static_torque`."""

    torque: float = parameter("torque", lower=0.0)
    static_torque: float = parameter("torque", lower=0.0)
    velocity: float = parameter("velocity", lower=1e-9)

    def install(self, build: Build) -> None:
        """Makes the friction limit depend on the speed."""
        row = build.row(self)
        row["coulomb"] += self.torque
        row["static_rise"], row["stribeck_velocity"] = self.static_torque - self.torque, self.velocity
        row["dry"] = 1


@effect("presliding_friction", "arm")
@dataclass(frozen=True, kw_only=True)
class PreslidingFriction(Effect):
    """stiffness z + damping z', z' = q' - stiffness |q'| z / torque: MuJoCo's LuGre bristle at constant level.

    stiffness: by default the bristle yields at 1e-3 rad or m. damping: by default half of critical.
    """

    torque: float = parameter("torque", lower=1e-9)
    stiffness: float | None = parameter("stiffness", default=None, lower=1e-9)
    damping: float | None = parameter("viscous", default=None, lower=0.0)

    def install(self, build: Build) -> None:
        """Adds the bristle."""
        stiffness = self.torque / 1e-3 if self.stiffness is None else self.stiffness
        damping = math.sqrt(stiffness * build.inertia(self)) if self.damping is None else self.damping
        build.add_bristle(self, self.torque, stiffness, damping)
        build.note(self, "stiffness", "stiffness", stiffness)
        build.note(self, "damping", "viscous", damping)


@effect("quadratic_drag", "arm")
@dataclass(frozen=True, kw_only=True)
class QuadraticDrag(Effect):
    """coefficient |q'| q'."""

    coefficient: float = parameter("drag", lower=0.0)

    def install(self, build: Build) -> None:
        """Sets MuJoCo's second damping coefficient."""
        build.load_joint(self).damping[1] += self.coefficient


@effect("friction_asymmetry", "arm")
@dataclass(frozen=True, kw_only=True)
class FrictionAsymmetry(Effect):
    """Forward friction exceeds backward friction by `torque` + `viscous` |q'|: half each way, around their mean.

    Needs as much mean friction, from other effects and the nominal viscous coefficient; `Plant` adds what lacks.
    """

    torque: float = parameter("torque")
    viscous: float = parameter("viscous", default=0.0)

    def install(self, build: Build) -> None:
        """Sets both differences."""
        row = build.row(self)
        half = 0.5 * abs(self.viscous)
        if half > build.joint_of(self).drive.viscous.value:
            raise EffectError(
                f"friction_asymmetry: viscous {self.viscous:g} would push. Give less than twice the nominal"
            )
        row["asymmetry"], row["viscous_asymmetry"] = self.torque, self.viscous


@effect("load_dependent_friction", "arm")
@dataclass(frozen=True, kw_only=True)
class LoadDependentFriction(Effect):
    """coefficient |transmitted torque| sign(q'): the motor's torque, or the shaft's where there is a shaft."""

    coefficient: float = parameter("ratio", lower=0.0, upper=0.95)

    def install(self, build: Build) -> None:
        """Makes the friction limit depend on the load."""
        row = build.row(self)
        row["load_friction"] = self.coefficient
        row["dry"] = 1


@effect("gravity_tilt", "arm")
@dataclass(frozen=True, kw_only=True)
class GravityTilt(Effect):
    """torque sin(q + phase): a base that is not level.

    Gravity itself is tilted so that this joint feels this torque at the pose; other moving joints feel their share. A
    joint on which gravity has no lever, such as a quill about its axis, gets the torque of an eccentric load.
    """

    torque: float = parameter("torque")
    phase: float = parameter("angle", default=0.0)

    def install(self, build: Build) -> None:
        """Tilts gravity."""
        if not build.tilt(self, self.torque, self.phase):
            build.add_term(self, POSITION_SINE, self.torque, 1.0, self.phase)


@effect("cable_spring", "arm")
@dataclass(frozen=True, kw_only=True)
class CableSpring(Effect):
    """stiffness (q - rest_angle)."""

    stiffness: float = parameter("stiffness", lower=0.0)
    rest_angle: float = parameter("position", default=0.0)

    def install(self, build: Build) -> None:
        """Sets MuJoCo's joint spring."""
        joint = build.load_joint(self)
        joint.stiffness[0], joint.springref = self.stiffness, self.rest_angle


@effect("payload_change", "arm")
@dataclass(frozen=True, kw_only=True)
class PayloadChange(Effect):
    """From `time` on the tool is heavier by as much as adds `inertia` to the joint at the pose; the speed stays.

    On a vertical joint its weight comes along.
    """

    inertia: float = parameter("inertia")
    time: float = parameter("time", lower=0.0)

    def install(self, build: Build) -> None:
        """Plans the change of the tool's body."""
        build.add_event(self, self.inertia, self.time)


@effect("periodic_disturbance", "arm", repeatable=True)
@dataclass(frozen=True, kw_only=True)
class PeriodicDisturbance(Effect):
    """torque sin(2 pi frequency t + phase)."""

    torque: float = parameter("torque")
    frequency: float = parameter("frequency", default=7.3, lower=1e-3, upper=500.0)
    phase: float = parameter("angle", default=0.0)

    def install(self, build: Build) -> None:
        """Adds the torque."""
        build.add_term(self, TIME_SINE, self.torque, 2.0 * math.pi * self.frequency, self.phase)


@effect("collision", "arm", repeatable=True)
@dataclass(frozen=True, kw_only=True)
class Collision(Effect):
    """`torque` from `time` on for `duration`."""

    torque: float = parameter("torque")
    time: float = parameter("time", lower=0.0)
    duration: float = parameter("time", default=0.05, lower=1e-3)

    def install(self, build: Build) -> None:
        """Adds the pulse."""
        build.add_term(self, PULSE, self.torque, self.time, self.duration)


@effect("parameter_mismatch", "arm", repeatable=True)
@dataclass(frozen=True, kw_only=True)
class ParameterMismatch(Effect):
    """A nominal number of the joint is `factor` times the table's: of its drive, or its inertia at the pose."""

    factor: float = parameter("ratio", lower=0.05, upper=20.0)
    parameter: str = parameter("word", default="inertia", choices=("inertia", *_DRIVE_NUMBERS))

    def alter(self, robot: Robot) -> Robot:
        """The true robot, with the drive's number scaled."""
        if self.parameter == "inertia":
            return robot
        joint = robot.joint(self.joint)
        quantity = getattr(joint.drive, self.parameter)
        drive = replace(joint.drive, **{self.parameter: replace(quantity, value=self.factor * quantity.value)})
        joints = list(robot.joints)
        joints[self.joint - 1] = replace(joint, drive=drive)
        return replace(robot, joints=tuple(joints))

    def install(self, build: Build) -> None:
        """Adds the inertia; numbers of the drive are in the robot already."""
        build.joint_of(self)
        if self.parameter == "inertia":
            build.add_inertia(self, (self.factor - 1.0) * build.inertia(self))
