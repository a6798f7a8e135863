"""Waves over the position in the readings: found where the encoder brings them, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.encoder_waves import READINGS, encoder_wave
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import stack
from diagnosis.remainder import remainders
from diagnosis.settings import Settings
from diagnosis.verdict import verdict
from envs.log import Array, JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
KERNEL = build(EFFECTS)
JOINT = {"inertia": 0.07, "viscous": 0.02, "back_emf": 0.7, "electrical_time_constant": 0.004}


def motion(effects: dict[str, dict[str, float]], seed: int) -> tuple[Array, Array, Array]:
    """Time (T,), command (T, 1) and position (T, 1) of a joint that turns to and fro."""
    time = 2e-3 * np.arange(5000)
    hertz, phases = np.array([0.3, 0.7, 1.3, 2.9]), np.random.default_rng(seed).uniform(0.0, 2 * np.pi, 4)
    command = np.sum(1.2 * np.sin(2 * np.pi * np.outer(time, hertz) + phases), axis=1)[:, None]
    model = StructuredModel((StructuredJoint(1, "voltage", JOINT, effects),), 2e-3, None, EFFECTS)
    return time, command, model.simulate(time, command, State.at_rest(0.0)).position


@pytest.mark.parametrize(
    ("cycles", "amplitude", "step", "effects", "is_found"),
    [
        (100.0, 2e-4, 1e-4, {}, True),
        (37.0, 5e-4, 1e-4, {}, True),
        (100.0, 0.0, 1e-4, {}, False),
        (100.0, 1e-5, 1e-4, {}, False),  # far below the rounding
        (100.0, 0.0, 2 * np.pi / 200, {}, False),  # the steps themselves
        (100.0, 0.0, 1e-5, {"cogging_torque": {"sine": 0.05, "cosine": 0.0, "cycles_per_rev": 1.5}}, False),
    ],
)
def test_a_wave_of_the_readings_is_found_and_makes_the_cause_unknown(
    cycles: float, amplitude: float, step: float, effects: dict[str, dict[str, float]], is_found: bool
) -> None:
    logs = []
    for seed in (1, 2):
        time, command, position = motion(effects, seed)
        reading = position + amplitude * np.sin(cycles * position + 0.4)
        facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=step),)
        logs.append(Log(time, command, step * np.round(reading / step), (1,), facts=facts, name=f"log {seed}"))
    problem = stack(KERNEL, logs, (1,))
    nominal = fit_nominal(problem, (JointStructure(),))
    wave, left = encoder_wave(problem, nominal, 0), remainders(problem, nominal)
    assert (wave is not None) == is_found
    assert left[0].wave == wave
    if wave is not None:
        assert wave.cycles == pytest.approx(cycles, rel=0.01)
        assert wave.amplitude == pytest.approx(amplitude, rel=0.1)
    if not effects:
        assert verdict(problem, nominal, nominal, (), left, Settings()) == ("unknown" if is_found else "none")


@pytest.mark.parametrize(
    ("height", "step", "effects", "is_found"),
    [
        (2e-3, 1e-5, {}, True),
        (0.0, 1e-5, {}, False),
        (2e-3, 4e-3, {}, False),  # within the encoder's step
        (0.0, 1e-5, {"cogging_torque": {"sine": 0.05, "cosine": 0.0, "cycles_per_rev": 4.0}}, False),  # a torque
    ],
)
def test_a_bulge_of_the_readings_is_found_and_makes_the_cause_unknown(
    height: float, step: float, effects: dict[str, dict[str, float]], is_found: bool
) -> None:
    logs = []
    for seed in (1, 2):
        time, command, position = motion(effects, seed)
        reading = position + height * np.exp(-(((position - np.median(position)) / 0.15) ** 2))
        reading += 2e-5 * np.random.default_rng(seed).standard_normal(position.shape)
        facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=step),)
        logs.append(Log(time, command, step * np.round(reading / step), (1,), facts=facts, name=f"log {seed}"))
    problem = stack(KERNEL, logs, (1,))
    nominal = fit_nominal(problem, (JointStructure(),))
    left = remainders(problem, nominal)
    assert (left[0].misread > 0.0) == is_found
    assert any(d.signal == READINGS for d in left[0].dependences) == is_found
    if not effects:
        assert verdict(problem, nominal, nominal, (), left, Settings()) == ("unknown" if is_found else "none")
