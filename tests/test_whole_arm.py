"""All joints of a described arm move at once: what the others do to a joint is known, and its own friction is found."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from diagnosis.arm_torques import arm_torques
from diagnosis.preparation import arrange, moving_joints, pose
from diagnosis.run import diagnose
from diagnosis.smoothing import window
from envs.log import Array, JointFacts, Log
from envs.pinocchio_model import inertial_parameters
from envs.robots import find_robot
from methods.arm import described_body
from methods.effects import built_in

DT, STEP = 2e-3, 2.0 * np.pi / 2**18
NAMES = ("turn", "lift", "bend")
FRICTION = 2.0
LINKS = ((4.0, 0.03), (3.0, 0.15), (1.5, 0.12))
"""Mass [kg] and distance of the centre of mass [m] of each link."""


def body(links: tuple[tuple[float, float], ...]) -> str:
    (m1, c1), (m2, c2), (m3, c3) = links
    inertia = [" ".join(f"{m * k:.6f}" for k in (0.02, 0.025, 0.012)) for m, _ in links]
    return f"""<mujoco><option timestep="5e-4" integrator="RK4"/><worldbody>
    <body name="base"><joint name="turn" type="hinge" axis="0 0 1" armature="0.2"/>
    <inertial pos="{c1} 0 0.1" mass="{m1}" diaginertia="{inertia[0]}"/>
    <body name="upper" pos="0.05 0 0.3"><joint name="lift" type="hinge" axis="0 1 0" armature="0.3"/>
    <inertial pos="{c2} 0.01 0" mass="{m2}" diaginertia="{inertia[1]}"/>
    <body name="fore" pos="0.35 0 0"><joint name="bend" type="hinge" axis="0 1 0" armature="0.1"/>
    <inertial pos="{c3} 0 0.02" mass="{m3}" diaginertia="{inertia[2]}"/></body></body></body></worldbody></mujoco>"""


def described(folder: Path, links: tuple[tuple[float, float], ...]) -> str:
    folder.mkdir(exist_ok=True)
    (folder / "arm.xml").write_text(body(links))
    joints = "".join(f'[[joint]]\nname = "{name}"\nkind = "revolute"\n' for name in NAMES)
    (folder / "arm.toml").write_text(
        f'name = "arm"\n[body]\nfile = "arm.xml"\n[drive]\namplifier = "torque"\ncommand = "torque"\n{joints}'
    )
    return str(folder / "arm.toml")


def recorded(seed: int, moving: tuple[int, ...] = (0, 1, 2), seconds: float = 16.0, stiffer: float = 1.0) -> Log:
    """The arm under a controller, viscous friction everywhere and dry friction in its second joint."""
    model = mujoco.MjModel.from_xml_string(body(LINKS))
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    hertz = np.array([0.2, 0.37, 0.61, 0.9, 1.3])
    size, phase = rng.uniform(0.1, 0.2, (3, 5)), rng.uniform(0.0, 2.0 * np.pi, (3, 5))
    size[[j for j in range(3) if j not in moving]] = 0.0
    rest = np.array([0.2, -0.5, 0.8])
    data.qpos[:] = rest
    gain, damping = stiffer * np.array([300.0, 400.0, 100.0]), stiffer**0.5 * np.array([25.0, 30.0, 7.0])
    time = DT * np.arange(round(seconds / DT))
    command, position = np.empty((2, len(time), 3))
    for k, t in enumerate(time):
        wave = 2.0 * np.pi * hertz * t + phase
        wanted = rest + min(1.0, t) * np.sum(size * np.sin(wave), axis=1)
        speed = min(1.0, t) * np.sum(size * 2.0 * np.pi * hertz * np.cos(wave), axis=1)
        position[k] = STEP * np.round(data.qpos / STEP)
        command[k] = gain * (wanted - position[k]) + damping * (speed - data.qvel)
        for _ in range(round(DT / model.opt.timestep)):
            data.qfrc_applied[:] = command[k] - np.array([1.0, 1.5, 0.5]) * data.qvel
            data.qfrc_applied[1] -= FRICTION * np.tanh(data.qvel[1] / 0.002)
            mujoco.mj_step(model, data)
    facts = tuple(JointFacts(input="torque", position_unit="rad", encoder_step=STEP) for _ in NAMES)
    return Log(time, command, position, (1, 2, 3), facts=facts, name=f"log {seed}")


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    return [recorded(seed) for seed in (1, 2, 3)]


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The arm with masses and centres that are off by up to a fifth."""
    off = ((0.85, 1.2), (1.15, 0.9), (0.8, 1.1))
    links = tuple((m * a, c * b) for (m, c), (a, b) in zip(LINKS, off, strict=True))
    return described(tmp_path_factory.mktemp("wrong"), links)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_a_wrong_description_is_put_right(joint: int, logs: list[Log], wrong: str, tmp_path: Path) -> None:
    right, described_arm = find_robot(described(tmp_path / "right", LINKS)), find_robot(wrong)
    at = pose(logs[0], described_arm)
    found = arm_torques(described_arm, logs[:2], joint, at)
    assert found is not None
    theta = [inertial_parameters(described_body(item))[:, None] for item in (right, described_arm)]
    own = found.regressor(logs[2])
    truth, given, learned = (own @ x[:, 0] for x in (*theta, found.components))
    assert rms(learned - truth) < 0.2 * rms(given - truth)
    assert rms(learned - truth) < 0.02 * rms(truth)
    known, doubts = found.of(logs[2])
    assert np.all(rms(doubts) < 0.1 * rms(truth))
    acceleration = found.regressors(logs[2])[2]
    torque, inertia = known[:, 0], known[:, known.shape[1] // 2]
    whole = found.unit * learned
    acceleration, whole = (0.5 * (x[1:] + x[:-1]) for x in (acceleration, whole))
    assert rms(torque[:-1] + inertia[:-1] * acceleration - whole) < 0.02 * rms(whole)
    if joint == 3:  # nothing hangs on the last one
        assert rms(inertia) < 1e-9


def test_friction_of_one_joint_is_found_while_all_move(logs: list[Log], wrong: str) -> None:
    effects = [item for item in built_in() if item.name in ("coulomb_friction", "dead_zone", "cable_spring")]
    found, *_ = diagnose(arrange(logs[:2], logs[2:], wrong), joint=2, effects=effects)
    assert found.verdict == "named"
    (effect,) = found.effects
    assert effect.name == "coulomb_friction"
    torque = effect.parameters[0].physical
    assert torque.value == pytest.approx(FRICTION, rel=0.01)
    gap = found.gaps[0]
    assert gap.after < 0.02 * gap.before
    assert any("from the description and the measured motion" in said for said in found.provenance.findings)


def test_joints_that_give_way_are_skipped_unless_asked_for() -> None:
    log, findings = recorded(1, moving=(1,), seconds=4.0, stiffer=8.0), []
    assert moving_joints([log], None, findings) == (2,)
    assert [said[:7] for said in findings] == ["joint 1", "joint 3"]
    assert moving_joints([log], 3, []) == (3,)


def test_no_torques_without_others(logs: list[Log], wrong: str) -> None:
    assert arm_torques(None, logs, 2, np.zeros(3)) is None
    assert arm_torques(find_robot(wrong), [logs[0].select((2,))], 2, np.zeros(3)) is None


def test_smoothing_is_as_short_as_the_noise_allows(logs: list[Log]) -> None:
    rough = [
        Log(log.time, log.command, log.position + 1e-3 * np.random.default_rng(0).standard_normal(log.position.shape),
            log.joints, facts=log.facts, name=log.name)
        for log in logs
    ]  # fmt: skip
    short, long = (window([(log.time, log.position) for log in noisy]) for noisy in (logs, rough))
    assert 8 * DT <= short < long <= 0.25
