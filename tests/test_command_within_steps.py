"""A command that changes within a step, by its hold or a delay: angle and velocity behind it are right."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from diagnosis.estimation import Point, errors, predicted_motion
from diagnosis.hypotheses import Hypothesis, extend
from diagnosis.nominal import JointStructure, point_at
from diagnosis.problem import Problem, stack
from envs.log import Array, JointFacts, Log
from methods.effects import built_in
from methods.kernel import NOMINAL, build

EFFECTS = built_in()
NAMED = {effect.name: effect for effect in EFFECTS}
KERNEL = build(EFFECTS)
DT, INERTIA, FINE = 2e-3, 0.05, 1000


def exact(command: Array, linear: bool, delay: float) -> Array:
    """Angles (T,) of an inertia that begins at rest, the command integrated twice in thousandths of steps."""
    time = DT * np.arange(len(command))
    grid = DT / FINE * (np.arange(FINE * (len(command) - 1)) + 0.5) - delay
    index = np.clip(np.floor(grid / DT).astype(int), 0, len(command) - 1)
    held = np.interp(grid, time, command) if linear else command[index]
    velocity = np.concatenate([[0.0], np.cumsum(held)]) * DT / FINE / INERTIA
    way = np.cumsum(velocity[:-1] + 0.5 * held * DT / FINE / INERTIA) * DT / FINE
    return np.concatenate([[0.0], way[FINE - 1 :: FINE]])


def inertia_with(command: Array, reading: Array, hold: str, name: str, value: float) -> tuple[Problem, Point]:
    """A log of an inertia under a command, and its model with an effect of one parameter, exact from the beginning."""
    facts = JointFacts(input="torque", position_unit="rad", encoder_step=1e-6, hold=hold)
    log = Log(DT * np.arange(len(command)), command[:, None], reading[:, None], (1,), facts=(facts,))
    problem = stack(KERNEL, [log], (1,))
    point = point_at(problem, (JointStructure(input="torque"),)).point
    parameters = np.zeros_like(point.parameters)
    parameters[..., NOMINAL.index("inertia")] = INERTIA
    point = replace(point, parameters=parameters, starts=np.zeros_like(point.starts))
    return problem, extend(problem, point, Hypothesis(NAMED[name], 0), np.array([[value]]))


@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
@pytest.mark.parametrize("delay", [0.0, 0.6e-3, 2.7e-3])
def test_an_inertia_follows_jumps_exactly(hold: str, delay: float) -> None:
    rng = np.random.default_rng(0)
    command = np.repeat(rng.choice([-1.0, 1.0], 60), 5)
    expected = exact(command, hold == "first_order", delay)
    problem, point = inertia_with(command, expected, hold, "input_delay", delay)
    error = errors(problem, [point], leak=False)[0, :, 0]
    assert np.max(np.abs(error)) < 1e-6 * np.ptp(expected)
    assert np.ptp(expected) > 0.1
    general = problem.reading - predicted_motion(problem, point)[:, :, 0]
    assert np.array_equal(errors(problem, [point])[0], general)


@pytest.mark.parametrize("lag", [0.0, 1e-4, 1.5e-3, 0.02])
@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
def test_a_lag_is_exact_behind_jumps(hold: str, lag: float) -> None:
    """The command filtered on a fine grid by the exact recursion, then integrated twice, is what the model moves by."""
    command = np.repeat(np.random.default_rng(1).choice([-1.0, 1.0], 60), 5)
    fine, time = DT / FINE, DT * np.arange(len(command))
    grid = fine * (np.arange(FINE * (len(command) - 1)) + 0.5)
    held = np.interp(grid, time, command) if hold == "first_order" else command[(grid / DT).astype(int)]
    if lag:
        held = lfilter([-np.expm1(-fine / lag)], [1.0, -np.exp(-fine / lag)], held, zi=[np.exp(-fine / lag) * held[0]])[
            0
        ]
    velocity = np.concatenate([[0.0], np.cumsum(held)]) * fine / INERTIA
    way = np.cumsum(velocity[:-1] + 0.5 * held * fine / INERTIA) * fine
    expected = np.concatenate([[0.0], way[FINE - 1 :: FINE]])
    problem, point = inertia_with(command, expected, hold, "amplifier_lag", lag)
    error = errors(problem, [point], leak=False)[0, :, 0]
    assert np.max(np.abs(error)) < 1e-4 * np.ptp(expected)  # the filter holds its output over a thousandth of a step


def test_a_supply_gives_way_to_the_current_that_flows_behind_it() -> None:
    """What the motor draws under the voltage that is left of it: i = u (1 - g |i|) is i = u / (1 + g |u|)."""
    command, gain = np.repeat(np.random.default_rng(2).choice([-1.0, -0.3, 0.3, 1.0], 60), 5), 0.5
    expected = exact(command / (1.0 + gain * np.abs(command)), False, 0.0)
    problem, point = inertia_with(command, expected, "zero_order", "supply_sag", gain)
    error = errors(problem, [point], leak=False)[0, :, 0]
    assert np.max(np.abs(error)) < 1e-6 * np.ptp(expected)


LEVELS = np.repeat(np.random.default_rng(3).choice([-1.0, -0.3, 0.2, 1.0], 60), 5)
LAWS = {
    "voltage_saturation": (0.6, lambda u: np.clip(u, -0.6, 0.6)),
    "dead_zone": (0.25, lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.25, 0.0)),
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("delay", [0.6e-3, 2.7e-3])
def test_a_law_of_the_command_takes_both_levels_of_a_step_by_themselves(name: str, delay: float) -> None:
    """What a limit leaves of a step's mean is not the mean of what it leaves of its two levels."""
    value, law = LAWS[name]
    expected = exact(law(LEVELS), False, delay)
    problem, point = inertia_with(LEVELS, expected, "zero_order", "input_delay", delay)
    point = extend(problem, point, Hypothesis(NAMED[name], 0), np.array([[value]]))
    error = errors(problem, [point], leak=False)[0, :, 0]
    assert np.max(np.abs(error)) < 1e-6 * np.ptp(expected)
    assert np.array_equal(errors(problem, [point])[0], problem.reading - predicted_motion(problem, point)[:, :, 0])


@pytest.mark.parametrize("name", LAWS)
def test_a_short_lag_of_the_winding_is_behind_the_laws_of_the_command(name: str) -> None:
    """Far shorter than a step it acts as a delay, but not of a command that a limit has yet to pass."""
    (value, law), lag, fine = LAWS[name], 0.4e-3, DT / FINE
    held = law(LEVELS)[(np.arange(FINE * (len(LEVELS) - 1)) // FINE)]
    decay = np.exp(-fine / lag)
    torque = lfilter([1.0 - decay], [1.0, -decay], held, zi=[decay * LEVELS[0]])[0]
    velocity = np.concatenate([[0.0], np.cumsum(torque)]) * fine / INERTIA
    way = np.cumsum(velocity[:-1] + 0.5 * torque * fine / INERTIA) * fine
    expected = np.concatenate([[0.0], way[FINE - 1 :: FINE]])
    problem, point = inertia_with(LEVELS, expected, "zero_order", name, value)
    point.parameters[..., NOMINAL.index("electrical_time_constant")] = lag
    error = errors(problem, [point], leak=False)[0, :, 0]
    assert np.max(np.abs(error)) < 1e-4 * np.ptp(expected)
    assert np.array_equal(errors(problem, [point])[0], problem.reading - predicted_motion(problem, point)[:, :, 0])
