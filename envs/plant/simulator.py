"""The plant behind its converters and encoders, one servo period at a time: an `envs.simulator.Simulator`."""

from __future__ import annotations

import numpy as np

from envs.log import Array
from envs.plant.plant import Plant
from envs.plant.simulation import Simulation
from envs.robot import Robot


class PlantSimulator:
    """A plant for controllers and learning. free: joints that move, all by default; brakes hold the others."""

    def __init__(self, plant: Plant, *, free: tuple[int, ...] | None = None, sample_time: float = 1e-3):
        everything = tuple(range(1, len(plant.robot) + 1))
        self._plant, self._free = plant, everything if free is None else tuple(sorted(free))
        self.sample_time = sample_time
        self.held = tuple(joint for joint in everything if joint not in self._free)
        self._columns = [joint - 1 for joint in self._free]
        self._position = np.zeros(len(everything))
        self._simulation: Simulation | None = None

    @property
    def robot(self) -> Robot:
        """The plant's robot."""
        return self._plant.robot

    def reset(self, position: Array, rng: np.random.Generator) -> Array:
        """At rest at `position`, shape (n,) [rad or m]; gives the encoders' reading, shape (n,)."""
        rate = 1.0 / self.sample_time
        self._simulation = self._plant.simulate(self._free, rng, rate=rate, pose=position, hold=False)
        self._position = np.array(position, dtype=np.float64)
        return self._read()

    def step(self, command: Array, periods: int = 1) -> Array:
        """Holds `command`, shape (n,) [command units], for some servo periods; gives the reading at their end.

        Raises RuntimeError before the first `reset`.
        """
        if self._simulation is None:
            raise RuntimeError("the plant stands nowhere yet. Call reset first")
        self._simulation.run(np.tile(np.asarray(command, dtype=np.float64)[self._columns], (periods, 1)))
        return self._read()

    def _read(self) -> Array:
        assert self._simulation is not None
        reading = self._position.copy()
        reading[self._columns] = self._simulation.reading()
        return reading
