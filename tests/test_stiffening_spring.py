"""A spring that stiffens as it is twisted, against an integrator of its own, and found in logs by its name."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from diagnosis.engine import find
from diagnosis.nominal import JointStructure
from diagnosis.problem import stack
from envs.log import Array, JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
DT, STEP = 1e-3, 1e-6
JOINT = {"inertia": 0.05, "viscous": 0.3, "back_emf": 0.0, "electrical_time_constant": 0.0}
SHARE, FREQUENCY, DAMPING_RATIO, STIFFENING = 0.6, 9.0, 0.04, 0.08
FORMS = ("joint_flexibility_stiffening", "joint_flexibility_stiffening_load_side")
"""Encoder on the motor, and on the arm."""


def spring(name: str, **more: float) -> dict[str, dict[str, float]]:
    values = {"inertia_ratio": SHARE, "frequency": FREQUENCY, "damping_ratio": DAMPING_RATIO, "stiffening": STIFFENING}
    return {name: {**values, **more}}


def command_of(time: Array, seed: int = 0) -> Array:
    hertz, phases = np.array([0.4, 1.1, 2.3, 4.7]), np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 4)
    return np.asarray(np.sum(1.5 * np.sin(2.0 * np.pi * np.outer(time, hertz) + phases), axis=1))


def integrated(time: Array, command: Array) -> Array:
    """Angles (T, 2) of motor and arm from rest, the command held over every sample."""
    motor, arm = JOINT["inertia"] * (1.0 - SHARE), JOINT["inertia"] * SHARE
    angular = 2.0 * np.pi * FREQUENCY
    stiffness, damping = arm * angular**2, 2.0 * DAMPING_RATIO * arm * angular
    cubic = STIFFENING * stiffness**3

    def rates(u: float, s: Array) -> list[float]:
        twist, rate = s[0] - s[1], s[2] - s[3]
        between = stiffness * twist + cubic * twist**3 + damping * rate
        return [s[2], s[3], (u - JOINT["viscous"] * s[2] - between) / motor, between / arm]

    states = [np.zeros(4)]
    for u in command[:-1]:
        done = solve_ivp(lambda _, s, u=u: rates(u, s), (0.0, DT), states[-1], rtol=1e-9, atol=1e-12)
        states.append(done.y[:, -1])
    return np.array(states)[:, :2]


def model_of(effects: dict[str, dict[str, float]]) -> StructuredModel:
    return StructuredModel((StructuredJoint(1, "torque", JOINT, effects),), DT, None, EFFECTS)


def test_it_moves_as_an_integrator_of_its_own_says() -> None:
    time = DT * np.arange(1500)
    command = command_of(time)
    true = integrated(time, command)
    moved = lambda effects: model_of(effects).simulate(time, command[:, None], State.at_rest(0.0)).position[:, 0]  # noqa: E731
    for side, name in enumerate(FORMS):
        plain = name.replace("_stiffening", "")
        linear = {plain: {k: v for k, v in spring(name)[name].items() if k != "stiffening"}}
        effect = np.sqrt(np.mean((moved(linear) - true[:, side]) ** 2))
        error = np.sqrt(np.mean((moved(spring(name)) - true[:, side]) ** 2))
        assert error < 2e-3 * effect
        assert moved(spring(name, stiffening=0.0)) == pytest.approx(moved(linear), abs=1e-12)


@pytest.mark.parametrize("name", FORMS)
def test_an_arm_that_hangs_in_it_begins_at_rest(name: str) -> None:
    time = DT * np.arange(600)
    held = {"gravity_tilt": {"sine": 0.0, "cosine": 2.0}}
    command = np.full((len(time), 1), 2.0 * np.cos(0.0))
    start = np.array([0.0])
    if name == FORMS[0]:  # the arm lags the motor by the twist: the weight there holds it
        stiffness = JOINT["inertia"] * SHARE * (2.0 * np.pi * FREQUENCY) ** 2
        twist = np.roots([STIFFENING * stiffness**2, 0.0, 1.0, -2.0 / stiffness])
        start = np.real(twist[np.isreal(twist)])
    moved = model_of(spring(name) | held).simulate(time, command, State.at_rest(start)).position[:, 0]
    assert np.max(np.abs(moved - start)) < 1e-4 * max(1.0, abs(start[0]))


@pytest.mark.parametrize("name", FORMS)
def test_it_is_found_in_logs(name: str) -> None:
    logs = []
    for seed in (1, 2):
        time = DT * np.arange(6000)
        command = command_of(time, seed)[:, None]
        position = model_of(spring(name)).simulate(time, command, State.at_rest(0.0)).position
        facts = (JointFacts(input="torque", position_unit="rad", encoder_step=STEP),)
        logs.append(Log(time, command, STEP * np.round(position / STEP), (1,), facts=facts, name=f"log {seed}"))
    forms = [effect for effect in EFFECTS if effect.label == "joint_flexibility"]
    finding = find(stack(build(EFFECTS), logs, (1,)), (JointStructure(input="torque"),), forms)
    assert finding.verdict == "named"
    assert [item.label for item in finding.accepted] == ["joint_flexibility"]
    values = finding.final.point.values
    assert values[f"{name}.stiffening@0"] == pytest.approx(STIFFENING, rel=0.01)
    assert values[f"{name}.frequency@0"] == pytest.approx(FREQUENCY, rel=0.01)
