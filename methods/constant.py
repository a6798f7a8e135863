"""The floor: a predictor that knows nothing of the motion. Every contestant has to be better than this."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from envs.log import Array, Hold, InputKind, Log
from methods.base import Estimates, Fit, Method, Model, Motion, State, Status
from methods.registry import METHODS
from methods.usable_logs import check_logs


@dataclass(frozen=True, eq=False)
class ConstantModel(Model):
    """command: what every motion is answered with, (n,); every command is answered with standing still."""

    joints: tuple[int, ...]
    inputs: tuple[InputKind, ...]
    command: Array

    def inverse(self, time: Array, motion: Motion, command: Array | None = None) -> Array:
        """The mean command of the fitted logs, (T, n)."""
        return np.tile(self.command, (len(motion), 1))

    def simulate(self, time: Array, command: Array, initial: State, hold: Hold = "zero_order") -> Motion:
        """The joint stays where it starts."""
        still = np.zeros((len(time), len(self.joints)))
        return Motion(still + initial.position, still, still, still)


@METHODS.register("constant", "single-joint", "multi-joint", "floor")
@dataclass(frozen=True)
class Constant(Method):
    """Mean command for any motion; no motion for any command."""

    @property
    def expected_failures(self) -> Mapping[str, str]:
        floor = "it is the floor of every table: it knows no motion"
        return {
            "covariance": "a mean of commands estimates nothing of the joint",
            "recovery": floor,
            "inverse_and_simulation_agree": floor,
            "honest_status": floor,
        }

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Consumes no random numbers; any number of joints."""
        begin = clock.perf_counter()
        joints = check_logs(logs)
        commands = np.concatenate([log.command for log in logs])
        mean = np.mean(commands, axis=0)
        facts = logs[0].facts
        return Fit(
            model=ConstantModel(joints, tuple(item.input for item in facts), mean),
            estimates=Estimates(
                names=tuple(f"mean command of joint {joint}" for joint in joints),
                units=tuple(item.command_unit for item in facts),
                values=mean,
                covariance=np.full((len(joints), len(joints)), np.nan),
            ),
            residuals=(commands - mean).ravel(),
            status=Status.CONVERGED,
            seconds=clock.perf_counter() - begin,
        )
