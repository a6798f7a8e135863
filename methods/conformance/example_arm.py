"""The joints on which methods of several joints are checked: two joints of the AdeptOne, noise-free and in closed form.

    u_j = c_j (tau_j + T_j tau_j') + k_j q_j'                                            [unit of the command u]

along sums of sines, with the torques tau of `envs.scara` and drives that are weaker than described. The interface is
that of `methods.conformance.example.LinearJoint`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from envs.adeptone import adeptone
from envs.log import Array, InputKind, Log
from envs.robot import Robot
from methods.base import Motion
from methods.conformance.example import DURATION, SAMPLE_TIME

WEAKER = 1.3
"""Factor on the described command per torque."""
TONES = (0.4, 0.9, 1.6, 2.7)
"""Frequencies of the recordings [Hz]."""
REACH = (0.5, 0.6)
"""Amplitudes of both joints [rad]."""
STEP = 1e-5
"""Of the central difference that gives tau' [s]."""


@dataclass(frozen=True)
class TwoJoints:
    """damping: factor on k. input: of both drives; currents and torques act without a winding's lag."""

    damping: float = 1.0
    input: InputKind = "voltage"
    numbers: tuple[int, int] = (1, 2)

    def log(self, seed: int) -> Log:
        """Four seconds on sums of sines; the seed draws the phases."""
        phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (len(TONES), 2))
        return self._recorded(np.array(TONES), phases, np.array(REACH) / np.sqrt(len(TONES)), f"multisine_{seed}")

    def sine(self) -> Log:
        """Both joints on one sine with a coarse encoder: q''' and q' are proportional."""
        log = self._recorded(np.array([1.0]), np.full((1, 2), 0.7), np.array([0.02, 0.02]), "sine")
        return replace(log, position=2e-5 * np.round(log.position / 2e-5))

    def still(self, *, command: float = 0.0) -> Log:
        """A recording in which nothing moves and the command is constant."""
        log = self.log(0)
        still = np.full_like(log.position, 0.3)
        return replace(log, command=np.full_like(log.command, command), position=still, name="still")

    def unseen(self) -> tuple[Array, Motion, Array]:
        """Time (T,), a smooth motion (T, 2) that no log holds, and the command (T, 2) that belongs to it."""
        time = _times(2.0)
        tones, phases = np.array([0.7, 1.9]), np.array([[0.3, 1.0], [1.9, 4.0]])
        return time, _waves(time, tones, phases, np.array(REACH)), self.command(time, tones, phases, np.array(REACH))

    def command(self, time: Array, tones: Array, phases: Array, reach: Array) -> Array:
        """u (T, 2) along sums of sines."""
        robot, rows = self._robot, [number - 1 for number in self.numbers]
        motion = _waves(time, tones, phases, reach)
        torque = self._torque(motion)
        drives = [robot.joints[row].drive for row in rows]
        if self.input != "voltage":
            scale = np.array([1.0 if self.input == "torque" else 1.0 / drive.torque_constant for drive in drives])
            return WEAKER * scale * torque
        later, earlier = (self._torque(_waves(time + shift, tones, phases, reach)) for shift in (STEP, -STEP))
        scale = WEAKER * np.array([drive.input_equivalent for drive in drives])
        lag = np.array([drive.inductance.value / drive.resistance.value for drive in drives])
        emf = np.array([drive.torque_constant / drive.amplifier_gain.value for drive in drives])
        return scale * (torque + lag * (later - earlier) / (2.0 * STEP)) + self.damping * emf * motion.velocity

    @cached_property
    def _robot(self) -> Robot:
        return adeptone()

    def _torque(self, motion: Motion) -> Array:
        """Joint torques (T, 2); the other joints stand in the middle of their range."""
        robot, rows = self._robot, [number - 1 for number in self.numbers]
        full = [np.zeros((len(motion), len(robot))) for _ in range(3)]
        full[0] += [0.5 * (joint.lower.value + joint.upper.value) for joint in robot.joints]
        for state, signal in zip(full, (motion.position, motion.velocity, motion.acceleration), strict=True):
            state[:, rows] = signal
        return np.asarray(robot.inverse_dynamics(*full)[:, rows], dtype=np.float64)

    def _recorded(self, tones: Array, phases: Array, reach: Array, name: str) -> Log:
        time = _times(DURATION)
        facts = tuple(
            replace(self._robot.facts(number), input=self.input, hold="first_order") for number in self.numbers
        )
        command = self.command(time, tones, phases, reach)
        position = _waves(time, tones, phases, reach).position
        return Log(time, command, position, joints=self.numbers, facts=facts, robot="adeptone", name=name)


def _times(duration: float) -> Array:
    return SAMPLE_TIME * np.arange(round(duration / SAMPLE_TIME), dtype=np.float64)


def _waves(time: Array, tones: Array, phases: Array, reach: Array) -> Motion:
    """Sums of sines with their derivatives; phases (tones, joints), reach (joints,)."""
    rates = (2.0 * np.pi * tones)[:, None]
    inner = rates * time[:, None, None] + phases
    return Motion(
        reach * np.sum(np.sin(inner), axis=1),
        reach * np.sum(rates * np.cos(inner), axis=1),
        reach * np.sum(-(rates**2) * np.sin(inner), axis=1),
        reach * np.sum(-(rates**3) * np.cos(inner), axis=1),
    )
