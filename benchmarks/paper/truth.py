"""The coefficients that the regression should find, from the robot that was simulated. No method sees this file.

With K = N alpha (motor constant times gear ratio), amplifier gain G and the inertia J that the joint feels:

    a1 = L J / (K G),  a2 = (R J + L f) / (K G),  a3 = (K + R f / K) / G,  constant = R g / (K G)

These are the paper's a11, a12, a13 with the amplifier's gain in them; its print of a13 is garbled.
"""

from __future__ import annotations

import numpy as np

from envs.robot import Robot
from methods.regressor import ColumnName


def true_coefficients(robot: Robot, joint: int, pose: tuple[float, ...]) -> dict[ColumnName, float]:
    """Coefficient per regressor column for a voltage-driven joint with the others held at `pose` (n,)."""
    row = joint - 1
    drive = robot.joint(joint).drive
    position = np.array(pose)
    inertia = float(robot.inertia_matrix(position)[row, row])
    load = float(robot.body.bias(position, np.zeros(len(robot)))[row])
    resistance, inductance = drive.resistance.value, drive.inductance.value
    constant, viscous = drive.torque_constant, drive.viscous.value
    gain = constant * drive.amplifier_gain.value
    return {
        "jerk": inductance * inertia / gain,
        "acceleration": (resistance * inertia + inductance * viscous) / gain,
        "velocity": (constant + resistance * viscous / constant) / drive.amplifier_gain.value,
        "constant": resistance * load / gain,
    }
