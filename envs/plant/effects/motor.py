"""Effects of the motor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from envs.plant.effects.base import Effect, effect, parameter

if TYPE_CHECKING:
    from envs.plant.build import Build


@effect("thermal_drift", "motor")
@dataclass(frozen=True, kw_only=True)
class ThermalDrift(Effect):
    """C T' = i^2 R - T / Rth, R = R0 (1 + alpha T): MuJoCo's winding, cold at the start, alpha of copper.

    Rth is such that R0 (1 + resistance_rise) would be reached in the end under the mean square current of the record,
    or under `current` [A rms]; time_constant = Rth C.
    """

    resistance_rise: float = parameter("ratio", lower=1e-6, upper=3.0)
    time_constant: float = parameter("time", lower=1e-2)
    current: float | None = parameter("current", default=None, lower=1e-6)

    def install(self, build: Build) -> None:
        """Gives MuJoCo's motor its thermal state."""
        build.drive(self, only=("voltage",))
        rms = self.current if self.current is not None else build.rms_current(self)
        build.add_winding_heat(self, self.resistance_rise, self.time_constant, rms)
        build.note(self, "current", "current", rms)


@effect("torque_constant_saturation", "motor")
@dataclass(frozen=True, kw_only=True)
class TorqueConstantSaturation(Effect):
    """Torque K i / (1 + coefficient i^2); the back-EMF keeps K."""

    coefficient: float = parameter("1/current^2", lower=0.0)

    def install(self, build: Build) -> None:
        """Sets the coefficient."""
        build.drive(self, only=("voltage", "current"))["iron"] = self.coefficient


@effect("cogging_torque", "motor")
@dataclass(frozen=True, kw_only=True)
class CoggingTorque(Effect):
    """amplitude sin(cycles_per_rev q + phase), MuJoCo's cogging; q in rad, or in m with 2 pi cycles per metre."""

    amplitude: float = parameter("torque")
    cycles_per_rev: float = parameter("cycles", default=150.0, lower=1e-3)
    phase: float = parameter("angle", default=0.0)

    def install(self, build: Build) -> None:
        """Adds MuJoCo's cogging on the motor's axis."""
        build.add_cogging(self, self.amplitude, self.cycles_per_rev, self.phase)


@effect("torque_ripple", "motor")
@dataclass(frozen=True, kw_only=True)
class TorqueRipple(Effect):
    """Torque K i (1 + share sin(cycles_per_rev q + phase)); cycles as in `CoggingTorque`."""

    share: float = parameter("ratio", lower=0.0, upper=1.0)
    cycles_per_rev: float = parameter("cycles", default=24.0, lower=1e-3)
    phase: float = parameter("angle", default=0.0)

    def install(self, build: Build) -> None:
        """Sets share, cycles and phase."""
        drive = build.drive(self)
        drive["ripple"], drive["ripple_cycles"], drive["ripple_phase"] = self.share, self.cycles_per_rev, self.phase
