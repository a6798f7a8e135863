"""A measured command that holds rounded levels."""

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.command_levels import held_levels, with_levels_counted
from diagnosis.estimation import measured_precisely
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem, stack
from envs.log import JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
KERNEL = build(EFFECTS)
DT, STEP, ENCODER = 2e-3, 2e-3, 1e-5
JOINT = {"inertia": 0.07, "viscous": 0.3}


def switched(seed: int, *, is_stated: bool = True) -> Problem:
    """A joint under a torque that takes one of two levels, of which the converter says the nearest number."""
    rng = np.random.default_rng(seed)
    low, high = -rng.uniform(0.9, 1.1), rng.uniform(0.9, 1.1)
    time = DT * np.arange(4000)
    command = np.where(np.repeat(rng.integers(0, 2, 100), 40), high, low)[:, None]
    model = StructuredModel((StructuredJoint(1, "torque", JOINT, {}),), DT, None, EFFECTS)
    motion = model.simulate(time, command, State.at_rest(0.0), "first_order").position
    facts = JointFacts(
        input="torque",
        position_unit="rad",
        encoder_step=ENCODER,
        hold="first_order",
        command_step=STEP if is_stated else None,
    )
    reading = ENCODER * np.round(motion / ENCODER)
    return stack(
        KERNEL, [Log(time, STEP * np.round(command / STEP), reading, (1,), facts=(facts,), name="switched")], (1,)
    )


def test_deviations_know_that_a_level_is_off_by_the_same_all_the_while() -> None:
    away, plain = [], []
    for seed in range(8):
        problem = switched(seed)
        fitted = measured_precisely(problem, fit_nominal(problem, (JointStructure(electrical=False),)))
        off = fitted.point.value("inertia@0") - JOINT["inertia"]
        plain.append(off / fitted.standard_error("inertia@0"))
        away.append(off / with_levels_counted(problem, fitted).standard_error("inertia@0"))
    assert np.sqrt(np.mean(np.square(plain))) > 5.0
    assert 0.4 < np.sqrt(np.mean(np.square(away))) < 1.8


def test_a_command_that_acts_as_it_is_written_leaves_nothing_open() -> None:
    problem = switched(0)
    written = replace(problem, command_steps=(0.0,))
    fitted = measured_precisely(written, fit_nominal(written, (JointStructure(electrical=False),)))
    assert with_levels_counted(written, fitted) is fitted
    assert with_levels_counted(problem, fitted) is not fitted


def test_the_resolution_of_a_measured_command_is_read_off_many_levels_only() -> None:
    assert switched(0).command_steps == (STEP,)
    assert switched(0, is_stated=False).command_steps == (0.0,)


@pytest.mark.parametrize(("command", "held"), [([1.0] * 60 + [2.0] * 40, [1.0, 2.0]), (np.linspace(0, 1, 200), [])])
def test_levels_that_are_held(command: list[float], held: list[float]) -> None:
    assert held_levels(np.array(command)) == held
