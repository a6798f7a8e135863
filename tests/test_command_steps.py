"""An amplifier that rounds its set point: found by its steps, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.command_steps import COMMAND_STEPS, lines, resolution
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

KERNEL = build(built_in())
STEP = 1e-5


def rounded(command: Array, width: float, offset: float) -> Array:
    """What an amplifier makes of a command when it cuts it to steps."""
    return width * (np.floor(command / width + offset) + 0.5 - offset) if width > 0.0 else command


def log(seed: int, width: float, offset: float, scale: float, time_constant: float, step: float) -> Log:
    """A joint whose amplifier rounds its command, of so many times the usual inertia and torque."""
    time = step * np.arange(6000)
    generator = np.random.default_rng(seed)
    hertz, phases = np.array([0.3, 0.7, 1.3, 2.9, 6.1]), generator.uniform(0.0, 2 * np.pi, 5)
    command = scale * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + phases), axis=1)[:, None]
    resolution = 1e-3 * scale
    command = resolution * np.round(command / resolution)
    joint = {"inertia": 0.07 * scale, "viscous": 0.1 * scale, "back_emf": 0.6 * scale}
    joint["electrical_time_constant"] = time_constant
    model = StructuredModel((StructuredJoint(1, "voltage", joint, {}),), step, None)
    position = model.simulate(time, rounded(command, width * scale, offset), State.at_rest(0.0)).position
    position = position + 2e-6 * generator.standard_normal(position.shape)
    facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=STEP),)
    return Log(time, command, STEP * np.round(position / STEP), (1,), facts=facts, name=f"log {seed}")


@pytest.mark.parametrize(
    ("width", "offset", "scale", "time_constant", "step"),
    [
        (0.08, 0.5, 1.0, 0.004, 2e-3),
        (0.3, 0.0, 1.0, 0.02, 2e-3),
        (0.05, 0.5, 30.0, 0.0, 1e-3),
        (0.0, 0.5, 1.0, 0.004, 2e-3),
        (1e-3, 0.5, 1.0, 0.004, 2e-3),  # the steps of the logged command
    ],
)
def test_an_amplifier_that_rounds_makes_the_cause_unknown(
    width: float, offset: float, scale: float, time_constant: float, step: float
) -> None:
    problem = stack(KERNEL, [log(seed, width, offset, scale, time_constant, step) for seed in (1, 2)], (1,))
    nominal = fit_nominal(problem, (JointStructure(),))
    left = remainders(problem, nominal)
    is_found = width > 2e-3
    assert verdict(problem, nominal, nominal, (), left, Settings()) == ("unknown" if is_found else "none")
    assert any(d.signal == COMMAND_STEPS for d in left[0].dependences) == is_found
    assert (left[0].coarse is not None) == is_found
    if left[0].coarse is not None:
        assert left[0].coarse.width == pytest.approx(width * scale, rel=0.01)


def test_a_line_of_the_command_stands_at_one_over_the_width() -> None:
    generator = np.random.default_rng(0)
    command = np.cumsum(generator.uniform(-0.1, 0.1, 20_000))
    correlated = np.sin(2.0 * np.pi * command / 0.07 + 0.3) + 3.0 * generator.standard_normal(len(command))
    cycles, height = lines(command, correlated, 0.0)
    assert 1.0 / cycles[np.argmax(height)] == pytest.approx(0.07, rel=0.01)
    assert np.median(height) == pytest.approx(np.log(2.0), rel=0.2)


@pytest.mark.parametrize("command", [np.ones(50), np.tile([0.0, 2.0], 40), np.zeros(50)])
def test_a_command_of_few_levels_has_no_lines(command: Array) -> None:
    assert not len(lines(command, np.ones(len(command)), resolution(command))[0])
