"""What a controller sees of a robot: commands go in, sensor readings come out, one servo period at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from envs.kernel import STATES, advance, pack
from envs.log import Array
from envs.robot import Robot


class Simulator(Protocol):
    """A robot behind its converters and encoders. The nominal model, a plant and an identified model all are one."""

    @property
    def robot(self) -> Robot:
        """The nominal robot: number and kind of joints, command limits, joint limits."""
        ...

    @property
    def sample_time(self) -> float:
        """Servo period [s]."""
        ...

    @property
    def held(self) -> tuple[int, ...]:
        """Joints, by number, whose brakes are closed."""
        ...

    def reset(self, position: Array, rng: np.random.Generator) -> Array:
        """Puts the robot at rest at `position`, shape (n,) [rad or m], and gives the encoders' reading, shape (n,)."""
        ...

    def step(self, command: Array, periods: int = 1) -> Array:
        """Holds `command`, shape (n,) [command units], for some servo periods and gives the reading at their end."""
        ...


class KernelSimulator:
    """The nominal SCARA on the compiled kernel, with quantised commands and encoders.

    robot: what is simulated. sample_time: servo period [s]. substeps: integrator steps per period. held: closed brakes.
    """

    def __init__(self, robot: Robot, *, sample_time: float = 1e-3, substeps: int = 1, held: Sequence[int] = ()):
        self.robot, self.sample_time, self.held = robot, sample_time, tuple(held)
        self._substeps = substeps
        self._row = pack(robot, held=held)[None]
        self._state = np.full(STATES, np.nan)

    def reset(self, position: Array, rng: np.random.Generator) -> Array:
        """At rest at `position`; the nominal robot has nothing random."""
        self._state = np.zeros(STATES)
        self._state[:4] = position
        return self.robot.measure(self._state[:4])

    def step(self, command: Array, periods: int = 1) -> Array:
        """Holds `command` for some servo periods; NaN before the first `reset`."""
        states = np.empty((1, 2, STATES))
        states[0, 0] = self._state
        commands = self.robot.quantise(command)[None, None]
        advance(self._row, commands, self.sample_time / self._substeps, periods * self._substeps, states)
        self._state = states[0, 1]
        return self.robot.measure(self._state[:4])
