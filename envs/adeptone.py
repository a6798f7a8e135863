"""The AdeptOne XL, a direct-drive SCARA, from its one table of parameters `adeptone.toml`.

Two facts of the real machine are not known and are therefore options: where joint 2's motor stands, and what its
amplifiers control.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from envs.robot import Drive, Quantity, Robot, load_robot

TABLE = Path(__file__).with_name("adeptone.toml")
"""The table of parameters; every entry carries unit, source and uncertainty."""

BASE_MOTOR = ((1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
"""Coupling with joint 2's motor on the base: it turns with q1 + q2 and its torque also acts on joint 1."""


def adeptone(
    *, second_stator: Literal["link_1", "base"] = "link_1", amplifier: Literal["voltage", "current"] = "voltage"
) -> Robot:
    """The nominal AdeptOne.

    second_stator: what carries the stator of joint 2's motor. On link 1 the drives are decoupled, as the paper's
        diagonal motor matrices have it.
    amplifier: what the amplifiers control; in current mode full command gives the current limit.
    """
    robot = load_robot(TABLE)
    if second_stator == "base":
        robot = replace(robot, coupling=BASE_MOTOR)
    if amplifier == "current":
        joints = tuple(replace(joint, drive=_current_mode(joint.drive)) for joint in robot.joints)
        robot = replace(robot, joints=joints)
    return robot


def _current_mode(drive: Drive) -> Drive:
    gain = drive.current_limit.value / drive.command_limit.value
    return replace(
        drive,
        amplifier="current",
        amplifier_gain=Quantity(gain, "A/V", "assumed: current limit divided by the command range"),
    )
