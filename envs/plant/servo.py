"""The position servo of a closed-loop experiment, working on what the sensors give."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from envs.robot import Robot


@dataclass(frozen=True)
class PositionServo:
    """u = proportional (r - y) + derivative d(r - y)/dt + integral int(r - y) dt, once per sample, then quantised.

    y is the encoder's reading, r the reference. Gains in command units per rad or m (per second, second); the
    derivative is a difference quotient smoothed by a first-order filter of `filter_time` [s]. joints: those under the
    servo; the others take the excitation as their command.
    """

    joints: tuple[int, ...]
    proportional: tuple[float, ...]
    derivative: tuple[float, ...]
    integral: tuple[float, ...] = ()
    filter_time: float = 2e-3

    def __post_init__(self) -> None:
        counts = {len(self.joints), len(self.proportional), len(self.derivative), len(self.integral or self.joints)}
        if len(counts) != 1:
            raise ValueError("servo with unequal numbers of joints and gains. Give one gain of each kind per joint")

    @classmethod
    def tuned(
        cls,
        robot: Robot,
        joints: tuple[int, ...],
        *,
        bandwidth: float = 20.0,
        damping: float = 1.0,
        integral_share: float = 0.0,
        pose: tuple[float, ...] | None = None,
    ) -> Self:
        """Gains for a closed loop like w^2 / (s^2 + 2 d w s + w^2) on the nominal joints at a pose, windings neglected.

        bandwidth: w [rad/s]. integral_share: integral gain as a share of proportional gain times bandwidth.
        Of the nominal joint u = h (J q'' + f q') + b q', with h the robot's input equivalent of a torque and b the
        back-EMF per amplifier gain, follow proportional = h J w^2 and derivative = max(0, 2 d w h J - h f - b).
        """
        inertia = np.diag(robot.inertia_matrix(np.zeros(len(robot)) if pose is None else np.array(pose)))
        proportional, derivative = [], []
        for number in joints:
            drive = robot.joint(number).drive
            per_torque = drive.input_equivalent
            own = per_torque * drive.viscous.value
            if drive.amplifier == "voltage":
                own += drive.torque_constant / drive.amplifier_gain.value
            moved = per_torque * float(inertia[number - 1])
            proportional.append(moved * bandwidth**2)
            derivative.append(max(0.0, 2.0 * damping * bandwidth * moved - own))
        integral = tuple(integral_share * gain * bandwidth for gain in proportional)
        return cls(tuple(joints), tuple(proportional), tuple(derivative), integral)
