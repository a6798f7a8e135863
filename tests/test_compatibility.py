"""Logs that do not belong to the robot or to one another are noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from envs.compatibility import check_together, with_robot
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
