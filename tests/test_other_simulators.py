"""Logs of simulators as people write them, with rounded friction and Euler steps: the cause is found, nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.engine import find
from diagnosis.estimation import fit
from diagnosis.finding import Finding
from diagnosis.hypotheses import Hypothesis, extend
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.planar_arm import in_commands
from diagnosis.preparation import groups
from diagnosis.problem import stack
from envs.log import JointFacts, Log
from envs.robots import find_robot
from methods.base import State
from methods.effects import built_in
from methods.kernel import NOMINAL, build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
DT, INERTIA, VISCOUS = 2e-3, 0.07, 0.8
Friction = Callable[[float], float]


def record(
    seed: int,
    friction: Friction,
    *,
    steps: int,
    late: int = 0,
    noise: float = 1e-5,
    seconds: float = 12.0,
    spring: Callable[[float], float] = lambda q: 0.0,
    amplifier: Callable[[float], float] = lambda u: u,
) -> Log:
    """A torque-driven joint by semi-implicit Euler steps, so many per sample; the command acts `late` samples later."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(round(seconds / DT))
    hertz = np.linspace(0.3, 6.0, 14) * (1.0 + 0.1 * seed)
    command = 0.35 * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0.0, 6.28, 14)), axis=1)
    q, w, h, reading = 0.3, 0.0, DT / steps, np.empty(len(time))
    for k in range(len(time)):
        reading[k] = q
        u = amplifier(float(command[max(k - late, 0)]))
        for _ in range(steps):
            w += h * (u - VISCOUS * w - friction(w) - spring(q)) / INERTIA
            q += h * w
    reading += noise * rng.standard_normal(len(time))
    facts = JointFacts(input="torque", position_unit="rad")
    return Log(time, command[:, None], reading[:, None], (1,), facts=(facts,), name=f"log {seed}")


def mujoco_record(seed: int, joint: str, *, timestep: float, skip: int, noise: float, seconds: float = 16.0) -> Log:
    """A torque-driven joint in MuJoCo with its default integrator, read every so many steps."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{timestep}" gravity="0 0 0"/><worldbody><body>
        <joint name="j" axis="0 0 1" damping="{VISCOUS}" armature="{INERTIA}" {joint}/>
        <geom type="sphere" size="0.01" mass="0.001"/></body></worldbody>
        <actuator><motor joint="j"/></actuator></mujoco>
    """)
    data, rng, dt = mujoco.MjData(model), np.random.default_rng(seed), timestep * skip
    time = dt * np.arange(round(seconds / dt))
    hertz = np.linspace(0.3, 6.0, 14) * (1.0 + 0.1 * seed)
    command = 0.35 * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0.0, 6.28, 14)), axis=1)
    reading = np.empty(len(time))
    for k, u in enumerate(command):
        reading[k], data.ctrl[0] = data.qpos[0], u
        mujoco.mj_step(model, data, nstep=skip)
    reading += noise * rng.standard_normal(len(time))
    facts = JointFacts(input="torque", position_unit="rad")
    return Log(time, command[:, None], reading[:, None], (1,), facts=(facts,), name=f"log {seed}")


def diagnosed_in_mujoco(joint: str, **how: float) -> Finding:
    logs = [mujoco_record(seed, joint, **how) for seed in (0, 1)]  # type: ignore[arg-type]
    return find(stack(build(EFFECTS), logs, (1,)), (JointStructure(input="torque", electrical=False),), EFFECTS)


def diagnosed(friction: Friction, kinds: Collection[str] = (), **how: Any) -> Finding:
    """What is found in two logs, among the effects of these names or among all."""
    logs = [record(seed, friction, **how) for seed in (0, 1)]
    effects = [effect for effect in EFFECTS if not kinds or effect.label in kinds]
    return find(stack(build(EFFECTS), logs, (1,)), (JointStructure(input="torque", electrical=False),), effects)


def names(finding: Finding) -> list[str]:
    return [item.label for item in finding.accepted]


def free(finding: Finding, name: str) -> float:
    return finding.final.point.value(f"{name}@0")


def joint(**recording: float) -> StructuredModel:
    nominal = {"inertia": INERTIA, "viscous": VISCOUS, **recording}
    return StructuredModel((StructuredJoint(1, "torque", nominal, {}),), DT, None, EFFECTS)


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [2.0, 6.0])
def test_a_cubic_spring_is_no_sum_of_known_torques(stiffness: float) -> None:
    found = diagnosed(lambda w: 0.0, steps=4, spring=lambda q: stiffness * q**3)
    assert found.verdict == "unknown"
    assert names(found)


@pytest.mark.slow
def test_friction_of_the_root_of_the_velocity_is_not_two_dry_frictions() -> None:
    found = diagnosed(lambda w: math.copysign(0.12 * math.sqrt(abs(w)), w), steps=4)
    assert found.verdict == "unknown"


class Bristle:
    """LuGre friction that falls from a static level, by one implicit step of its bristle per call."""

    def __init__(self, step: float) -> None:
        self.step, self.bend = step, 0.0

    def __call__(self, w: float) -> float:
        level = 0.1 * (1.0 + 0.7 * math.exp(-((w / 0.15) ** 2)))
        before, stiffness = self.bend, 20.0
        self.bend = (before + self.step * w) / (1.0 + self.step * stiffness * abs(w) / level)
        return stiffness * self.bend + 0.1 * (self.bend - before) / self.step


@pytest.mark.slow
def test_bristles_below_a_static_level_are_found_whole() -> None:
    found = diagnosed(Bristle(DT / 20), steps=20, seconds=24.0)
    assert found.verdict == "named"
    assert names(found) == ["presliding_friction"]
    value = {p: free(found, f"presliding_friction_stribeck.{p}") for p in ("torque", "deflection", "rise", "velocity")}
    expected = {"torque": 0.1, "deflection": 0.005, "rise": 0.7, "velocity": 0.15}
    assert value == pytest.approx(expected, rel=0.05)


def test_a_joint_that_hardly_moves_is_searched_to_the_end() -> None:
    log = record(0, lambda w: 0.0, steps=4)
    still = 0.3 + 1e-4 * (log.position - 0.3)
    small = Log(log.time, log.command, still, (1,), facts=log.facts, name="small")
    problem = stack(build(EFFECTS), [small], (1,))
    structure = (JointStructure(input="torque", electrical=False),)
    waves = [effect for effect in EFFECTS if effect.scan == "position"]
    assert waves
    assert find(problem, structure, waves).verdict in ("none", "unknown")


def test_a_model_that_runs_away_has_a_finite_likelihood() -> None:
    problem = stack(build(EFFECTS), [record(0, lambda w: 0.0, steps=4)], (1,))
    nominal = fit_nominal(problem, (JointStructure(input="torque", electrical=False),))
    error = np.full_like(nominal.error, 1e6)
    gone = replace(nominal, error=error, innovation=0.0 * nominal.innovation, credible=False)
    assert np.isfinite(gone.criterion)
    assert gone.criterion > nominal.criterion


@pytest.mark.slow
def test_a_spring_beside_waves_that_the_logs_show_is_named() -> None:
    found = diagnosed(lambda w: 0.0, steps=4, spring=lambda q: 0.5 * (q - 0.2) + 0.1 * math.sin(12.0 * q + 0.5))
    assert set(names(found)) == {"cable_spring", "cogging_torque"}
    assert found.verdict == "named"


@pytest.mark.slow
def test_dry_friction_that_differs_by_direction_is_not_told_from_an_offset() -> None:
    found = diagnosed(lambda w: 0.1 * math.tanh(w / 0.01) + 0.03, steps=4)
    assert set(names(found)) == {"amplifier_offset", "coulomb_friction"}
    offset = next(item for item in found.accepted if item.label == "amplifier_offset")
    assert found.verdict == "ambiguous"
    assert [rival.label for rival in offset.rivals] == ["friction_asymmetry"]
    beyond = diagnosed(lambda w: 0.03 * math.tanh(w / 0.01) + 0.1, steps=4)
    assert set(names(beyond)) == {"amplifier_offset", "coulomb_friction"}
    assert beyond.verdict == "named"


@pytest.mark.slow
def test_the_output_of_an_amplifier_with_a_dead_zone_is_off() -> None:
    """An offset that comes in is lost in the dead zone, one of the output stage is not."""
    dead = lambda u: math.copysign(max(abs(u) - 0.1, 0.0), u)  # noqa: E731
    near = ("amplifier_offset", "dead_zone", "friction_asymmetry", "coulomb_friction")
    behind = diagnosed(lambda w: 0.0, near, steps=4, amplifier=lambda u: dead(u) + 0.03)
    assert sorted(item.name for item in behind.accepted) == ["amplifier_offset_at_output", "dead_zone"]
    assert {item.label for item in behind.accepted} == {"amplifier_offset", "dead_zone"}
    assert free(behind, "amplifier_offset_at_output.voltage") == pytest.approx(0.03, rel=0.02)
    before = diagnosed(lambda w: 0.0, near, steps=4, amplifier=lambda u: dead(u + 0.03))
    assert sorted(item.name for item in before.accepted) == ["amplifier_offset", "dead_zone"]


@pytest.mark.slow
def test_a_plainer_law_beside_the_general_form_of_another_one() -> None:
    """A drag that grows with less than the square of the velocity makes dry friction look like a Stribeck curve."""
    near = ("coulomb_friction", "stribeck_friction", "quadratic_drag")
    found = diagnosed(lambda w: 0.03 * math.copysign(1.0, w) + 0.08 * abs(w) ** 0.9 * w, near, steps=20, noise=1e-6)
    assert sorted(item.name for item in found.accepted) == ["coulomb_friction", "quadratic_drag_power"]
    assert free(found, "quadratic_drag_power.exponent") == pytest.approx(1.9, rel=0.02)


def test_a_command_that_acts_before_it_is_logged() -> None:
    time = DT * np.arange(500)
    command = np.sin(20.0 * time)[:, None]
    early = np.vstack([command[1:], command[-1:]])
    start = State.at_rest(0.0)
    expected = joint().simulate(time, early, start).position
    assert joint(timing=-DT).simulate(time, command, start).position == pytest.approx(expected, abs=1e-12)


def test_one_euler_step_per_sample() -> None:
    time = DT * np.arange(200)
    command = np.sin(20.0 * time)[:, None]
    q, w, expected = 0.0, 0.0, []
    for u in command[:, 0]:
        expected.append(q)
        w += DT * (u - VISCOUS * w) / INERTIA
        q += DT * w
    moved = joint(stepping=1.0).simulate(time, command, State.at_rest(0.0)).position[:, 0]
    assert moved == pytest.approx(np.array(expected), abs=1e-12)


def test_the_robot_alone_has_no_timing() -> None:
    assert set(joint(timing=1e-3, stepping=1.0).unrecorded().parts[0].nominal) == {"inertia", "viscous"}


@pytest.mark.parametrize("steps", [1, 4])
def test_steps_of_an_integrator_are_no_fault_of_the_robot(steps: int) -> None:
    finding = diagnosed(lambda w: 0.0, steps=steps)
    assert (finding.verdict, names(finding)) == ("none", [])
    row = finding.final.point.parameters[0, 0]
    lead = 0.5 * DT * row[NOMINAL.index("stepping")] - row[NOMINAL.index("timing")]
    assert lead == pytest.approx(0.5 * DT / steps, rel=0.05)
    assert free(finding, "inertia") == pytest.approx(INERTIA, rel=0.01)


def test_a_delay_in_the_log_of_such_a_simulator_is_one() -> None:
    finding = diagnosed(lambda w: 0.0, steps=1, late=3)
    assert (finding.verdict, names(finding)) == ("named", ["input_delay"])
    assert free(finding, "input_delay.delay") == pytest.approx(3 * DT, rel=0.01)


@pytest.mark.parametrize(
    ("friction", "width"),
    [
        (lambda w: 0.12 * math.tanh(w / 0.02), 0.02),
        pytest.param(lambda w: 0.12 * math.tanh(w / 0.002), 0.002, marks=pytest.mark.slow),
        pytest.param(lambda w: 0.12 * w / math.hypot(w, 0.05), 0.05, marks=pytest.mark.slow),
    ],
    ids=["tanh", "narrow tanh", "root"],
)
def test_friction_whose_sign_is_rounded_is_dry_friction(friction: Friction, width: float) -> None:
    finding = diagnosed(friction, steps=20)
    assert (finding.verdict, names(finding)) == ("named", ["coulomb_friction"])
    form = finding.accepted[0].name
    assert free(finding, f"{form}.torque") == pytest.approx(0.12, rel=0.01)
    assert free(finding, f"{form}.rounding") == pytest.approx(width, rel=0.1)


@pytest.mark.slow
def test_the_sign_of_the_velocity_as_friction() -> None:
    finding = diagnosed(lambda w: 0.12 * math.copysign(1.0, w), steps=1)
    assert (finding.verdict, names(finding)) == ("named", ["coulomb_friction"])
    assert free(finding, "coulomb_friction.torque") == pytest.approx(0.12, rel=0.01)


@pytest.mark.slow
def test_stribeck_friction_with_a_rounded_sign() -> None:
    def friction(w: float) -> float:
        return (0.12 + 0.1 * math.exp(-((w / 0.15) ** 2))) * math.tanh(w / 0.02)

    finding = diagnosed(friction, steps=20)
    assert (finding.verdict, names(finding)) == ("named", ["stribeck_friction"])
    form = finding.accepted[0].name
    assert free(finding, f"{form}.torque") == pytest.approx(0.12, rel=0.02)
    assert free(finding, f"{form}.excess") == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize(
    ("timestep", "skip", "noise"), [pytest.param(2e-3, 1, 1e-5, marks=pytest.mark.slow), (1e-3, 4, 0.0)]
)
def test_friction_of_mujoco_is_a_soft_constraint(timestep: float, skip: int, noise: float) -> None:
    finding = diagnosed_in_mujoco('frictionloss="0.12"', timestep=timestep, skip=skip, noise=noise)
    assert (finding.verdict, names(finding)) == ("named", ["coulomb_friction"])
    assert free(finding, "constrained_coulomb_friction.torque") == pytest.approx(0.12, rel=0.01)
    assert free(finding, "constrained_coulomb_friction.hold") == pytest.approx(0.9, abs=0.03)  # solimp's first number


@pytest.mark.slow
def test_a_log_without_any_noise() -> None:
    finding = diagnosed_in_mujoco('stiffness="0.3"', timestep=1e-3, skip=2, noise=0.0)
    assert (finding.verdict, names(finding)) == ("named", ["cable_spring"])
    assert free(finding, "cable_spring.stiffness") == pytest.approx(0.3, rel=1e-3)


TWO_LINKS = """<mujoco><option timestep="0.001" integrator="RK4"/><worldbody>
  <body><joint name="shoulder" axis="0 1 0" damping="0.25"/>
  <inertial pos="0 0 -0.15" mass="1.5" diaginertia="0.012 0.012 0.002"/>
  <body pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" damping="0.08"/>
  <inertial pos="0 0 -0.12" mass="0.8" diaginertia="0.005 0.005 0.001"/></body></body></worldbody>
  <actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator></mujoco>"""
DESCRIPTION = """
name = "two links"
body.file = "arm.xml"
[drive]
amplifier = "torque"
command = "torque"
[[joint]]
name = "shoulder"
kind = "revolute"
[[joint]]
name = "elbow"
kind = "revolute"
"""


def two_links(
    seed: int, friction: float, *, offset: float = 0.0, noise: float = 0.0, gravity: float = 9.81, elbow: float = 1.0
) -> Log:
    """A double pendulum in MuJoCo, driven in both joints, with dry friction in the second."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(TWO_LINKS)
    model.opt.gravity[2] = -gravity
    model.body_mass[2], model.body_inertia[2] = elbow * model.body_mass[2], elbow * model.body_inertia[2]
    data, rng, dt = mujoco.MjData(model), np.random.default_rng(seed), 4e-3
    time = dt * np.arange(1500)
    waves = np.outer(time, np.linspace(0.2, 4.0, 12) * (1.0 + 0.07 * seed))
    command = np.stack(
        [a * np.cos(2 * np.pi * waves + rng.uniform(0, 6.28, 12)).sum(axis=1) for a in (0.9, 0.25 * elbow)], 1
    )
    reading = np.empty((len(time), 2))
    for k, u in enumerate(command):
        reading[k], data.ctrl = data.qpos, u + np.array([offset, 0.0])
        for _ in range(4):
            data.qfrc_applied[1] = -friction * math.tanh(data.qvel[1] / 0.02)
            mujoco.mj_step(model, data)
    step = 2.0 * np.pi / 65536
    reading += noise * rng.standard_normal(reading.shape)
    facts = (JointFacts(input="torque", position_unit="rad", encoder_step=step),) * 2
    return Log(time, command, step * np.round(reading / step), (1, 2), facts=facts, name=f"log {seed}")


def test_two_links_are_one_arm_in_which_the_joint_with_friction_is_told(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(TWO_LINKS)
    (tmp_path / "arm.toml").write_text(DESCRIPTION)
    robot, logs = find_robot(str(tmp_path / "arm.toml")), [two_links(0, 0.15)]
    for known in (robot, None):
        ((joints, structures),) = groups(logs, (1, 2), known, EFFECTS)
        assert joints == (1, 2)
        assert [item.gravity for item in structures] == ["pendulum", "pendulum"]
    problem = stack(build(EFFECTS), logs, (1, 2), pair=True)
    point = fit_nominal(problem, groups(logs, (1, 2), robot, EFFECTS)[0][1]).point
    friction = next(effect for effect in EFFECTS if effect.name == "rounded_coulomb_friction")
    for joint in (0, 1):
        point = extend(problem, point, Hypothesis(friction, joint), np.array([[0.02, 0.02]]))
    fitted = fit(problem, point, rounds=2, iterations=8)
    torque = [fitted.point.value(f"{friction.name}.torque@{joint}") for joint in (0, 1)]
    assert torque == pytest.approx([0.0, 0.15], abs=0.003)


def test_an_offset_does_not_hide_an_arm() -> None:
    """A light second link shows in no regression on derivatives, and an offset hides it from the nominal model."""
    log = two_links(0, 0.0, offset=0.8, noise=3e-4, gravity=0.0, elbow=0.05)
    assert not any(in_commands(log, 1, 2))
    ((joints, structures),) = groups([log], (1, 2), None, EFFECTS)
    assert joints == (1, 2)
    assert [item.gravity for item in structures] == ["none", "none"]
