"""Effects of the transmission."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from envs.plant.effects.base import Effect, effect, parameter
from envs.plant.tables import ACCELERATION, MOTOR_TORQUE, VELOCITY

if TYPE_CHECKING:
    from envs.plant.build import Build

_SIDES = ("motor", "load")
_SIGNALS = {"acceleration": ACCELERATION, "velocity": VELOCITY, "motor_torque": MOTOR_TORQUE}


@effect("joint_flexibility", "transmission")
@dataclass(frozen=True, kw_only=True)
class JointFlexibility(Effect):
    """Rotor and load joined by torque = stiffness x + damping x', x = q_rotor - q_load.

    The joint's inertia at the pose is shared: load = inertia_ratio, rotor = 1 - inertia_ratio.
    damping: by default 3 % of critical. encoder: the side that is measured.
    """

    stiffness: float = parameter("stiffness", lower=1e-9)
    damping: float | None = parameter("viscous", default=None, lower=0.0)
    inertia_ratio: float = parameter("ratio", default=0.7, lower=0.01, upper=0.99)
    encoder: str = parameter("word", default="motor", choices=_SIDES)

    def install(self, build: Build) -> None:
        """Puts a spring between rotor and load."""
        reduced = self.inertia_ratio * (1.0 - self.inertia_ratio) * build.inertia(self)
        damping = 0.06 * math.sqrt(self.stiffness * reduced) if self.damping is None else self.damping
        shaft = build.add_shaft(self, self.inertia_ratio, self.encoder)
        shaft.stiffness, shaft.damping = min(shaft.stiffness, self.stiffness), damping
        build.note(self, "damping", "viscous", damping)


@effect("backlash", "transmission")
@dataclass(frozen=True, kw_only=True)
class Backlash(Effect):
    """Rotor and load joined through a play of total width `gap`; the contact is stiff, damped and does not pull.

    contact_frequency: resonance of the closed contact [Hz]; damping_ratio: of the contact, relative to critical.
    Together with `JointFlexibility` the contact is that spring. inertia_ratio and encoder as there.
    """

    gap: float = parameter("position", lower=0.0)
    inertia_ratio: float = parameter("ratio", default=0.7, lower=0.01, upper=0.99)
    contact_frequency: float = parameter("frequency", default=120.0, lower=1.0, upper=1000.0)
    damping_ratio: float = parameter("ratio", default=0.2, lower=0.0, upper=2.0)
    encoder: str = parameter("word", default="motor", choices=_SIDES)

    def install(self, build: Build) -> None:
        """Puts a play between rotor and load."""
        reduced = self.inertia_ratio * (1.0 - self.inertia_ratio) * build.inertia(self)
        rate = 2.0 * math.pi * self.contact_frequency
        shaft = build.add_shaft(self, self.inertia_ratio, self.encoder)
        shaft.half_gap = 0.5 * self.gap
        shaft.stiffness = min(shaft.stiffness, reduced * rate**2)
        shaft.contact_damping = 2.0 * self.damping_ratio * reduced * rate
        build.note(self, "stiffness", "stiffness", shaft.stiffness)
        build.note(self, "damping", "viscous", shaft.contact_damping)


@effect("axis_coupling", "transmission", repeatable=True)
@dataclass(frozen=True, kw_only=True)
class AxisCoupling(Effect):
    """coefficient times acceleration, velocity or motor torque of joint `other`, which has to move too."""

    coefficient: float = parameter("coupling")
    signal: str = parameter("word", default="acceleration", choices=tuple(_SIGNALS))
    other: int | None = parameter("joint", default=None, lower=1)

    def install(self, build: Build) -> None:
        """Feeds the other joint's signal back; by default the next joint's, the last one takes the one before."""
        other = self.other
        if other is None:
            other = self.joint + 1 if self.joint < len(build.robot) else self.joint - 1
        build.add_coupling(self, _SIGNALS[self.signal], other, self.coefficient)
        build.note(self, "other", "joint", other)
