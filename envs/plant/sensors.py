"""What the measuring side of a plant gives, and the noise that its amplifiers add without telling."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.signal

from envs.log import Array
from envs.robot import Joint


@dataclass(frozen=True)
class Sensors:
    """Encoders, and what else is logged.

    quantised: encoder readings are whole steps of the robot's table.
    position_noise: rms of white noise on the reading before quantisation [rad or m].
    velocity: whether a tachometer's column is logged; velocity_noise: its rms white noise [rad/s or m/s].
    temperature: whether the windings' temperature is logged [deg C].
    """

    quantised: bool = True
    position_noise: float = 0.0
    velocity: bool = False
    velocity_noise: float = 0.0
    temperature: bool = False

    def encoder_step(self, joint: Joint) -> float:
        """Resolution of the joint's reading [rad or m]; 0 when it is not quantised."""
        return joint.encoder_step.value if self.quantised and joint.encoder_step is not None else 0.0


@dataclass(frozen=True)
class AmplifierNoise:
    """Coloured noise at the amplifier's input that no log shows: Ornstein-Uhlenbeck.

    rms [command unit], correlation_time [s]; 0 makes it white from step to step.
    """

    rms: float = 0.0
    correlation_time: float = 0.02

    def start(self, channels: int, rng: np.random.Generator) -> Array:
        """A stationary first value, shape (channels,) [command unit]."""
        return self.rms * rng.standard_normal(channels)

    def sample(self, before: Array, count: int, step: float, rng: np.random.Generator) -> Array:
        """What follows on `before` (channels,), shape (count, channels), held over steps of `step` [s]; (0, channels)
        without noise.

        x[k] = a x[k-1] + rms sqrt(1 - a^2) e[k], a = exp(-step / correlation_time), exact for the process.
        """
        if self.rms == 0.0:
            return np.zeros((0, len(before)))
        keep = math.exp(-step / self.correlation_time) if self.correlation_time > 0.0 else 0.0
        drive = self.rms * math.sqrt(1.0 - keep**2) * rng.standard_normal((count, len(before)))
        values, _ = scipy.signal.lfilter([1.0], [1.0, -keep], drive, axis=0, zi=keep * before[None, :])
        return np.asarray(values)
