"""Effects of the amplifier, in the order in which the command meets them.

delay -> dead zone -> saturation -> lag -> offset -> gain, sagging with the current. Levels are in command units.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from envs.plant.effects.base import Effect, effect, parameter

if TYPE_CHECKING:
    from envs.plant.build import Build


@effect("input_delay", "amplifier")
@dataclass(frozen=True, kw_only=True)
class InputDelay(Effect):
    """u(t - delay); any delay, whole samples or not."""

    delay: float = parameter("time", lower=0.0, upper=0.5)

    def install(self, build: Build) -> None:
        """Reads the held command `delay` earlier."""
        build.drive(self)["delay"] = self.delay / build.sample_time


@effect("dead_zone", "amplifier")
@dataclass(frozen=True, kw_only=True)
class DeadZone(Effect):
    """0 for |u| <= voltage, else u - voltage sign(u)."""

    voltage: float = parameter("command", lower=0.0)

    def install(self, build: Build) -> None:
        """Sets the half width."""
        build.drive(self)["dead_zone"] = self.voltage


@effect("voltage_saturation", "amplifier")
@dataclass(frozen=True, kw_only=True)
class VoltageSaturation(Effect):
    """u clipped to +-voltage."""

    voltage: float = parameter("command", lower=1e-9)

    def install(self, build: Build) -> None:
        """Sets the limit."""
        build.drive(self)["saturation"] = self.voltage


@effect("amplifier_lag", "amplifier")
@dataclass(frozen=True, kw_only=True)
class AmplifierLag(Effect):
    """time_constant x' + x = u, solved exactly between edges of the command."""

    time_constant: float = parameter("time", lower=1e-6)

    def install(self, build: Build) -> None:
        """Sets the time constant."""
        build.drive(self)["lag"] = self.time_constant


@effect("amplifier_offset", "amplifier")
@dataclass(frozen=True, kw_only=True)
class AmplifierOffset(Effect):
    """u + voltage."""

    voltage: float = parameter("command")

    def install(self, build: Build) -> None:
        """Sets the offset."""
        build.drive(self)["offset"] = self.voltage


@effect("supply_sag", "amplifier")
@dataclass(frozen=True, kw_only=True)
class SupplySag(Effect):
    """u (1 - gain |i|)."""

    gain: float = parameter("1/current", lower=0.0)

    def install(self, build: Build) -> None:
        """Sets the loss per ampere."""
        build.drive(self, only=("voltage", "current"))["sag"] = self.gain
