"""Effects of the sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from envs.plant.effects.base import Effect, effect, parameter

if TYPE_CHECKING:
    from envs.plant.build import Build


@effect("encoder_eccentricity", "sensor")
@dataclass(frozen=True, kw_only=True)
class EncoderEccentricity(Effect):
    """Reading q + amplitude sin(cycles q + phase), before quantisation; a servo sees it too."""

    amplitude: float = parameter("position")
    phase: float = parameter("angle", default=0.0)
    cycles: float = parameter("cycles", default=1.0, lower=1e-6)

    def install(self, build: Build) -> None:
        """Sets the encoder's error."""
        encoder = build.servo(self)
        encoder["eccentricity"], encoder["eccentricity_phase"] = self.amplitude, self.phase
        encoder["eccentricity_cycles"] = self.cycles


@effect("timestamp_jitter", "sensor")
@dataclass(frozen=True, kw_only=True)
class TimestampJitter(Effect):
    """Samples are taken at t + jitter, normal with `rms`, at most 0.45 samples, but stamped t; all joints alike."""

    rms: float = parameter("time", lower=0.0)

    def install(self, build: Build) -> None:
        """Sets the recorder's jitter; a servo keeps good time."""
        build.joint_of(self)
        build.jitter = self.rms
