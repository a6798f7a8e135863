"""Logs that do not belong to the robot or to one another are noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from envs.compatibility import check_apart, check_together, with_robot
from envs.log import JointFacts, Log, LogError
from envs.robots import find_robot


def swing(joint: int = 1, amplitude: float = 0.5, middle: float = 0.0, **facts: object) -> Log:
    t = 1e-3 * np.arange(500)
    return Log(
        t, np.sin(9.0 * t)[:, None], (middle + amplitude * np.sin(9.0 * t))[:, None], (joint,),
        facts=(JointFacts(**facts),), source="log.csv",  # type: ignore[arg-type]
    )  # fmt: skip


def test_facts_of_the_robot_complete_the_log() -> None:
    robot = find_robot("adeptone")
    log, findings = with_robot(swing(3, 0.05, 0.1), robot)
    assert findings == ()
    assert log.facts == (robot.facts(3),)
    assert log.robot == robot.name
    assert with_robot(swing(encoder_step=0.5), robot)[0].facts[0].encoder_step == 0.5


@pytest.mark.parametrize(
    ("log", "complaint"),
    [
        (swing(7), "has joints 1 to 4, not 7"),
        (swing(input="torque"), "takes a voltage"),
        (swing(amplitude=57.3 * 0.5), "this looks like degrees"),
        (swing(3, 50.0, 100.0), "this looks like millimetres"),
    ],
)
def test_logs_of_another_robot(log: Log, complaint: str) -> None:
    with pytest.raises(LogError, match=complaint) as caught:
        with_robot(log, find_robot("adeptone"))
    assert "\n" not in str(caught.value)


def test_wrong_gear_is_said() -> None:
    _, (finding,) = with_robot(swing(amplitude=5.0), find_robot("adeptone"))
    assert finding.kind == "beyond_range"


def test_a_recording_counts_once() -> None:
    one, two, three = swing(), swing(amplitude=0.4), swing(amplitude=0.3)
    check_apart([one, two], [three])
    with pytest.raises(LogError, match=r"the fitted log log is given twice\."):
        check_apart([one, two, one], [])
    with pytest.raises(LogError, match="the fitted log copy is given twice, also as log"):
        check_apart([one, replace(one, name="copy")], [two])
    with pytest.raises(LogError, match="the held-out log copy is also fitted"):
        check_apart([one, two], [replace(two, name="copy")])
    with pytest.raises(LogError, match="the held-out log log is given twice"):
        check_apart([one], [two, two])


def test_two_machines() -> None:
    log = swing(encoder_step=1e-4)
    assert check_together([log, log]) == ()
    with pytest.raises(LogError, match="the joints differ"):
        check_together([log, swing(2)])
    with pytest.raises(LogError, match="the robots differ"):
        check_together([replace(log, robot="one"), replace(log, robot="two")])
    coarse = swing()
    coarse = replace(coarse, position=1e-3 * np.round(coarse.position / 1e-3), time=3.0 * coarse.time)
    assert [finding.kind for finding in check_together([log, coarse])] == ["different_encoder", "different_rate"]


def driven(command: np.ndarray, inertia: float = 0.02, limit: float = np.inf) -> Log:
    """Readings at 500 Hz of an inertia with a damper behind a drive that clips its command."""
    t, position, velocity = 2e-3 * np.arange(len(command)), np.zeros(len(command)), 0.0
    for k in range(1, len(t)):
        for _ in range(10):
            velocity += 2e-4 * (np.clip(command[k - 1], -limit, limit) - 0.05 * velocity) / inertia
            position[k] += 2e-4 * velocity
        position[k] += position[k - 1]
    return Log(t, command[:, None], position[:, None], (1,), facts=(JointFacts(encoder_step=1e-4),), name="log")


def test_a_drive_that_clips_is_no_other_machine() -> None:
    """All commands of a log cut to a tenth look like ten times the inertia; those of another machine do as well, but no
    limit explains waves of all sizes."""
    t = 2e-3 * np.arange(5000)
    wave = 0.1 * sum(np.sin(2 * np.pi * f * t + f) for f in (0.4, 1.1, 2.3))
    steps = np.where(np.sin(2 * np.pi * 4.0 * t) > 0.0, 2.5, -2.5)
    small = driven(wave, limit=0.3)
    (said,) = check_together([small, driven(steps, limit=0.3)])
    assert said.kind == "different_machine"
    with pytest.raises(LogError, match="different machines"):
        check_together([small, driven(10.0 * wave, inertia=0.2)])
