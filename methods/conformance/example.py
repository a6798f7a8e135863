"""The joints on which methods are checked: linear, noise-free, and solved exactly.

    J q'' + B q' = w,   T w' = u - w                                                     [unit of the command u]

hence ``u = J T q''' + (J + B T) q'' + B q'``, the third-order equation of a joint with a voltage drive; with T = 0 the
second-order one. Everything a check needs to know of the truth follows from these three numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.linalg import expm

from envs.log import Array, InputKind, JointFacts, Log
from methods.base import Motion

SAMPLE_TIME = 1e-3
DURATION = 4.0
FREQUENCIES = (0.5, 1.1, 1.9, 3.1, 4.7, 7.3)
"""Frequencies of the multisines [Hz]: below the band of every differentiator, no two in a simple ratio."""


@dataclass(frozen=True)
class LinearJoint:
    """inertia J [u s^2/x], damping B [u s/x], electrical T [s] with u the command's unit and x rad or m."""

    inertia: float = 0.05
    damping: float = 0.6
    electrical: float = 8e-3
    input: InputKind = "voltage"
    unit: Literal["rad", "m"] = "rad"
    number: int = 1

    def log(self, seed: int, *, amplitude: float = 3.0, duration: float = DURATION, name: str | None = None) -> Log:
        """A recording from rest under a held multisine, exact to rounding; the seed draws the phases."""
        time = _times(duration)
        phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(FREQUENCIES))
        waves = np.cos(2.0 * np.pi * np.outer(time, FREQUENCIES) + phases)
        command = amplitude * waves @ np.array([1.0, 0.9, 0.8, 0.6, 0.5, 0.4]) / 2.0
        return self._recorded(time, command, self._held(command), name or f"multisine_{seed}", "zero_order")

    def sine(self, frequency: float = 2.0, amplitude: float = 2.0, step: float = 2e-5) -> Log:
        """A single sine in its steady state with a coarse encoder: q''' and q' are proportional."""
        time = _times(DURATION)
        motion = _waves(time, np.array([frequency]), np.array([0.7]), np.array([amplitude / self.damping / 12.0]))
        position = step * np.round(motion.position[:, 0] / step)
        return self._recorded(time, self.command(motion), position, "sine", "first_order")

    def still(self, *, command: float = 0.0) -> Log:
        """A recording in which nothing moves and the command is constant."""
        time = _times(DURATION)
        return self._recorded(time, np.full(len(time), command), np.full(len(time), 0.3), "still", "zero_order")

    def unseen(self) -> tuple[Array, Motion, Array]:
        """Time (T,), a smooth motion (T, 1) that no log holds, and the command (T, 1) that belongs to it."""
        time = _times(2.0)
        amplitudes = np.array([0.5, 0.2, 0.08]) * (1.0 if self.unit == "rad" else 0.1)
        motion = _waves(time, np.array([0.8, 1.7, 3.3]), np.array([0.3, 1.9, 4.0]), amplitudes)
        return time, motion, self.command(motion)[:, None]

    def command(self, motion: Motion) -> Array:
        """u of a motion by the joint's equation, shape (T,)."""
        third, second = self.inertia * self.electrical, self.inertia + self.damping * self.electrical
        return (third * motion.jerk + second * motion.acceleration + self.damping * motion.velocity)[:, 0]

    @cached_property
    def _step(self) -> tuple[Array, Array]:
        """Exact transition of (q, q', w) over one sample under a held command."""
        if self.electrical > 0.0:
            matrix = np.array(
                [
                    [0.0, 1.0, 0.0, 0.0],
                    [0.0, -self.damping / self.inertia, 1.0 / self.inertia, 0.0],
                    [0.0, 0.0, -1.0 / self.electrical, 1.0 / self.electrical],
                    [0.0, 0.0, 0.0, 0.0],
                ]
            )
        else:
            matrix = np.zeros((4, 4))
            matrix[0, 1], matrix[1, 1], matrix[1, 3] = 1.0, -self.damping / self.inertia, 1.0 / self.inertia
        whole = expm(SAMPLE_TIME * matrix)
        return whole[:3, :3], whole[:3, 3]

    def _held(self, command: Array) -> Array:
        transition, gain = self._step
        state, position = np.zeros(3), np.empty(len(command))
        for k, u in enumerate(command):
            position[k] = state[0]
            state = transition @ state + gain * u
        return position

    def _recorded(
        self, time: Array, command: Array, position: Array, name: str, hold: Literal["zero_order", "first_order"]
    ) -> Log:
        facts = JointFacts(input=self.input, position_unit=self.unit, hold=hold)
        return Log(time, command, position, joints=(self.number,), facts=(facts,), name=name)


def _times(duration: float) -> Array:
    return SAMPLE_TIME * np.arange(round(duration / SAMPLE_TIME), dtype=np.float64)


def _waves(time: Array, frequencies: Array, phases: Array, amplitudes: Array) -> Motion:
    """Sum of sines with its derivatives."""
    rates = 2.0 * np.pi * frequencies
    angles = np.outer(time, rates) + phases
    return Motion(
        np.sin(angles) @ amplitudes,
        np.cos(angles) @ (amplitudes * rates),
        -np.sin(angles) @ (amplitudes * rates**2),
        -np.cos(angles) @ (amplitudes * rates**3),
    )


def rescaled(log: Log, factor: float) -> Log:
    """The same recording with every command multiplied, as of a joint with larger inertia and damping."""
    return replace(log, command=factor * log.command)
