"""A plant in motion: the compiled loop with its states, advanced in bulk for a record or sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from envs.log import Array
from envs.plant.build import AMBIENT, Build, Construction
from envs.plant.loop import ForwardFunction, advance
from envs.plant.sensors import AmplifierNoise
from envs.plant.tables import Memory, Traces


@dataclass(frozen=True)
class Measurement:
    """What sensors show, one row per sample and one column per moving joint: angle [rad or m], speed, current [A],
    winding temperature [deg C]; shapes (T, n)."""

    position: Array
    velocity: Array
    current: Array
    temperature: Array


class Simulation:
    """A plant in motion. It starts at rest at the build's pose under the command `hold` (n,) [command units].

    noise, rng: of the amplifiers and sensors.
    """

    def __init__(self, build: Build, longest_step: float, hold: Array, noise: AmplifierNoise, rng: np.random.Generator):
        self.build, self.free = build, build.free
        self._sensors, self._noise, self._hold = build.sensors, noise, hold
        self._noise_rng, self._sensor_rng = rng.spawn(2)
        self._disturbance = noise.start(len(build.free), self._noise_rng)
        self._construction: Construction = build.finish(longest_step)
        tables, world = self._construction.tables, self._construction.world
        size, width = len(self.free), max(len(world.velocity), len(world.activation), len(self.free), 1)
        self._memory = Memory(np.zeros(size), np.zeros((size, 4)), np.zeros((12, width)), np.zeros(size))
        given = self._quantise(hold)
        self._history = np.tile(given, (int(np.ceil(tables.drives["delay"].max())) + 1, 1))
        self._memory.lag[:] = given
        self._clock = 0
        held = (tables.drives["current"] >= 0) & (tables.drives["resistance"] > 0.0)
        current = tables.drives["gain"] * hold / np.where(held, tables.drives["resistance"], 1.0)
        world.activation[tables.drives["current"][held]] = current[held]

    @property
    def step(self) -> float:
        """Step of the physics [s]."""
        return self._construction.step

    def run(self, wanted: Array, late: Array | None = None) -> tuple[Array, Measurement]:
        """Advances by T samples. Returns the commands given, shape (T, n) [command units], and what was measured.

        wanted: (T, n), for joints under a servo their reference, counted from the build's pose [rad or m], for the
        others their command, counted from `hold` [command units]; converted as the amplifier's input demands and held
        over the sample. late: (T,) [s], how much later than planned the samples are taken.
        """
        start = self.build.pose[[joint - 1 for joint in self.free]]
        commands = self._quantise(self._hold + wanted)
        reference = np.ascontiguousarray(start + wanted)
        count, substeps, step = len(wanted), self._construction.substeps, self._construction.step
        past = len(self._history)
        buffer = np.concatenate([self._history, commands])
        sample_at = np.arange(count) * float(substeps)
        if late is not None:
            sample_at = np.maximum(sample_at + late / step, 0.0)
        disturbance = self._noise.sample(self._disturbance, count * substeps, step, self._noise_rng)
        if len(disturbance):
            self._disturbance = disturbance[-1]
        traces = Traces(*(np.zeros((count, len(self.free))) for _ in Traces._fields))
        advance(
            _forward(),
            self._construction.world,
            self._construction.tables,
            self._memory,
            traces,
            buffer,
            reference,
            disturbance,
            sample_at,
            substeps,
            step,
            self._clock,
        )
        self._history = buffer[-past:].copy()
        self._clock += count
        return buffer[past:], self._measure(traces)

    def reading(self) -> Array:
        """What the encoders show now, shape (n,) [rad or m]."""
        return self._read(self._construction.world.position[self._construction.tables.joints["encoder"]])

    def _quantise(self, commands: Array) -> Array:
        columns = [joint - 1 for joint in self.free]
        everything = np.zeros((*commands.shape[:-1], len(self.build.robot)))
        everything[..., columns] = commands
        return self.build.robot.quantise(everything)[..., columns]

    def _measure(self, traces: Traces) -> Measurement:
        velocity, noise = traces.velocity, self._sensors.velocity_noise
        if noise > 0.0:
            velocity = velocity + noise * self._sensor_rng.standard_normal(velocity.shape)
        return Measurement(self._read(traces.position), velocity, traces.current, AMBIENT + traces.heat)

    def _read(self, position: Array) -> Array:
        encoders, noise = self._construction.tables.servos, self._sensors.position_noise
        angle = encoders["eccentricity_cycles"] * position + encoders["eccentricity_phase"]
        reading = position + encoders["eccentricity"] * np.sin(angle)
        if noise > 0.0:
            reading = reading + noise * self._sensor_rng.standard_normal(reading.shape)
        step = encoders["encoder_step"]
        whole = np.where(step > 0.0, step, 1.0)
        return np.where(step > 0.0, whole * np.floor(reading / whole + 0.5), reading)


@cache
def _forward() -> ForwardFunction:
    return ForwardFunction()
