"""Wrong signs, wrong gears and mixed machines are noticed from the physics of the recordings themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from envs.compatibility import check_together, with_robot
from envs.log import JointFacts, Log, LogError
from envs.plausibility import rough, works_backwards
from envs.robot import Robot
from envs.robots import find_robot

STEP = 1e-3


def recording(inertia: float = 2.7, viscous: float = 5.8, dry: float = 0.58, seed: int = 0, name: str = "run") -> Log:
    """A slider with friction, driven by a multisine force; semi-implicit Euler, written apart from the product."""
    rng = np.random.default_rng(seed)
    time = np.asarray(STEP * np.arange(6000), dtype=np.float64)
    phases = rng.uniform(0.0, 2.0 * np.pi, 12)
    volts = sum(
        0.5 * np.sin(2.0 * np.pi * f * time + p) for f, p in zip(np.linspace(0.5, 6.0, 12), phases, strict=True)
    )
    position, x, v = np.zeros(len(time)), 0.0, 0.0
    for k, u in enumerate(volts):
        position[k] = x
        stop = inertia * v / STEP + u - viscous * v
        v += STEP * (u - viscous * v - np.clip(stop, -dry, dry)) / inertia
        x += STEP * v
    return Log(
        time, np.asarray(volts)[:, None], position[:, None], name=name, source=f"{name}.csv",
        facts=(JointFacts(position_unit="m", encoder_step=5e-8),),
    )  # fmt: skip


@pytest.fixture(scope="module")
def slider() -> Robot:
    return find_robot("emps")


def test_the_rough_physics_is_right_to_a_few_per_cent() -> None:
    physics = rough(recording(), 1)
    assert physics is not None
    assert physics.inertia == pytest.approx(2.7, rel=0.05)
    assert physics.explained > 0.95
    assert 0.05 < physics.work <= 1.0


def test_a_sound_recording_passes(slider: Robot) -> None:
    log, findings = with_robot(recording(), slider)
    assert findings == ()
    assert check_together([log, recording(seed=1, name="other")]) == ()


@pytest.mark.parametrize("signal", ["position", "command"])
def test_a_wrong_sign_is_refused(signal: str) -> None:
    log = recording()
    turned = replace(log, **{signal: -getattr(log, signal)})
    assert works_backwards(turned)
    assert not works_backwards(log)
    with pytest.raises(LogError, match=r"run.csv.*sign of a command or of a position is wrong"):
        check_together([turned])


def test_a_gear_wrong_by_ten_is_said(slider: Robot) -> None:
    log = recording()
    for factor, ratio in ((0.1, "10"), (10.0, "0.1")):
        _, findings = with_robot(replace(log, position=factor * log.position), slider)
        said = [finding.text for finding in findings if finding.kind == "other_inertia"]
        assert len(said) == 1
        assert f"{ratio} times the inertia" in said[0] or "wrong gear ratio" in said[0]


def test_recordings_of_two_machines_are_refused_or_said() -> None:
    first = recording()
    with pytest.raises(LogError, match="recordings of different machines"):
        check_together([first, recording(inertia=27.0, name="heavy")])
    kinds = {finding.kind for finding in check_together([first, recording(inertia=9.0, name="other")])}
    assert "different_machine" in kinds


def test_a_slow_recording_is_no_other_machine() -> None:
    """Where the back-EMF is nearly all of the command, a winding's lag alone takes away most of an inertia of 2.7."""
    time = np.asarray(STEP * np.arange(6000), dtype=np.float64)
    facts = (JointFacts(position_unit="m", encoder_step=5e-8),)

    def moving(scale: float, inertia: float, name: str) -> Log:
        position, command = np.zeros(len(time)), np.zeros(len(time))
        for w in 2.0 * np.pi * scale * np.array([0.2, 0.33]):
            position += np.sin(w * time) / w
            command += 5.8 * np.cos(w * time) - inertia * w * np.sin(w * time)
        return Log(time, command[:, None], position[:, None], name=name, source=name, facts=facts)

    fast, slow = moving(10.0, 2.7, "fast"), moving(0.7, 0.3, "slow")
    physics = rough(slow, 1)
    assert physics is not None
    assert physics.inertia == pytest.approx(0.3, rel=0.2)
    assert physics.own_share < 0.03
    assert check_together([fast, slow]) == ()
    with pytest.raises(LogError, match="different machines"):
        check_together([fast, moving(10.0, 0.3, "other")])


def test_a_saturated_command_is_no_other_machine() -> None:
    """Half of a large command that the amplifier clips softly looks like twice the inertia."""
    time = np.asarray(STEP * np.arange(10000), dtype=np.float64)

    def clipped(command: np.ndarray, name: str, inertia: float = 0.002) -> Log:
        position, x, v = np.zeros(len(time)), 0.0, 0.0
        for k, u in enumerate(command):
            position[k] = x
            v += STEP * (0.1 * np.tanh(u / 0.1) - 0.05 * v) / inertia
            x += STEP * v
        facts = (JointFacts(encoder_step=1e-6),)
        return Log(time, command[:, None], position[:, None], name=name, source=name, facts=facts)

    sweep = clipped(0.05 * np.sin(2.0 * np.pi * (0.1 * time + 0.1 * time**2)), "sweep")
    pulses = np.sign(np.sin(10.7 * time) + np.sin(18.2 * time + 1.0))
    large = clipped(pulses, "pulses")
    physics = [rough(log, 1) for log in (sweep, large)]
    assert all(item is not None and item.explained > 0.9 for item in physics)
    (said,) = check_together([sweep, large])
    assert said.kind == "different_machine"
    with pytest.raises(LogError, match="different machines"):
        check_together([sweep, clipped(0.1 * pulses, "other", inertia=0.03)])


def test_a_load_that_is_lowered_is_not_a_wrong_sign() -> None:
    """A motor that only brakes a weight takes energy out of the joint, and rightly so."""
    time = np.asarray(STEP * np.arange(2000), dtype=np.float64)
    position = -0.1 * time
    log = Log(time, np.full((2000, 1), 3.0) + 0.01 * np.sin(time)[:, None], position[:, None])
    assert not works_backwards(log)


def test_joints_of_a_pair_are_not_judged_alone(slider: Robot) -> None:
    """One joint may brake what the other drives."""
    log = recording()
    power = np.column_stack([log.command[:, 0], -0.1 * log.command[:, 0]])
    pair = Log(log.time, power, np.repeat(log.position, 2, axis=1), (1, 2))
    assert not works_backwards(pair)
