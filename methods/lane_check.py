"""Whether candidates that are simulated several at a time move as each does by itself, bit by bit.

A compiler that packs the lanes into vectors can be wrong, and without a word: LLVM has left out the velocity with which
all lanes begin, depending on what had been compiled before. What is new here is therefore compared, once per machine
and vocabulary, before anybody relies on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from envs.log import Array
from methods.effects.base import Scales

if TYPE_CHECKING:
    from methods.kernel import Kernel

SAMPLES = 60
"""Samples of each of both logs."""
INTERVAL = 2e-3
"""Time between them [s]."""
TAIL = (20.0, 0.0, 1)
"""Leaks of angle and velocity [1/s], and steps per sample."""
NOMINAL_VALUES = {
    "inertia": 0.05,
    "viscous": 0.1,
    "back_emf": 0.1,
    "electrical_time_constant": 2e-3,
    "torque_square_mean": 4.0,
}
SIZES = Scales(
    command_rms=3.0,
    command_peak=6.0,
    torque_rms=2.0,
    torque_peak=5.0,
    position_span=3.0,
    position_mean=0.2,
    velocity_rms=4.0,
    velocity_peak=9.0,
    inertia=NOMINAL_VALUES["inertia"],
    damping=0.2,
    duration=2.0 * SAMPLES * INTERVAL,
    sample_time=INTERVAL,
    encoder_step=1e-4,
    revolute=True,
    joints=2,
)


@dataclass(frozen=True)
class Check:
    """What `run` predicts of every candidate by itself; arguments: those of `Kernel.spread` but for the last one."""

    arguments: tuple[Any, ...]
    alone: Array

    @classmethod
    def of(cls, kernel: Kernel, joints: int) -> Check:
        """Candidates of a single joint or of a planar pair without effects and with each of them, from beginnings that
        are all of another angle, velocity, torque, twist and heat."""
        from methods.kernel import BEGINNING, NOMINAL

        own = [effect for effect in kernel.effects if joints == 1 or not effect.parts_the_arm]
        count, rng = 1 + len(own), np.random.default_rng(0)
        parameters = np.zeros((count, 2, joints, kernel.columns))
        switches = np.zeros((count, joints, len(kernel.effects)), dtype=bool)
        for name, value in NOMINAL_VALUES.items():
            parameters[..., NOMINAL.index(name)] = value
        for c, effect in enumerate(own, start=1):
            values = next(iter(effect.starts(SIZES)), None) if effect.starts else None
            if values is not None:
                parameters[c, ..., kernel.own(effect)] = values
                switches[c, c % joints, kernel.switches[effect.name]] = True
        starts = rng.normal(0.0, 0.1, (count, 2, joints, len(BEGINNING)))
        time = np.tile(np.arange(SAMPLES) * INTERVAL, 2)
        command, reading = 6.0 * np.cos(np.outer(time, (31.0, 23.0)[:joints])), np.zeros((len(time), joints))
        bounds, hold = np.array([0, SAMPLES, 2 * SAMPLES]), np.zeros(joints, dtype=np.int64)
        cumulative = np.zeros_like(command)
        for a in bounds[:-1]:
            cumulative[a + 1 : a + SAMPLES] = np.cumsum(command[a : a + SAMPLES - 1], axis=0)
        pair, rigid = joints == 2, np.tile([0.01, 1.0, 0.03], (count, 1))
        none, nothing = np.zeros((0, joints, 3)), np.zeros((0, joints))
        signals, alone = (time, command, cumulative, hold, reading), np.empty((count, len(time), joints))
        for c, log in np.ndindex(count, 2):
            rows = slice(bounds[log], bounds[log + 1])
            cut = (*(signal[rows] for signal in signals[:3]), hold, reading[rows], none, nothing, starts[c, log])
            model = (parameters[c, log], switches[c], pair, rigid[c])
            kernel.module.run(*cut, *model, *TAIL, alone[c, rows], none)
        extra = np.zeros((0, 0, joints))
        return cls((*signals, none, extra, bounds, starts, parameters, switches, pair, rigid, *TAIL), alone)

    def holds(self, kernel: Kernel) -> bool:
        """Whether lanes predict the same."""
        lanes = np.empty_like(self.alone)
        kernel.spread(*self.arguments, lanes)
        return bool(np.array_equal(lanes, self.alone, equal_nan=True))
