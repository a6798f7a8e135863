"""A command that changes within a step, by its hold or a delay: angle and velocity behind it are right."""

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation import errors, predicted_motion
from diagnosis.hypotheses import Hypothesis, extend
from diagnosis.nominal import JointStructure, point_at
from diagnosis.problem import stack
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


@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
@pytest.mark.parametrize("delay", [0.0, 0.6e-3, 2.7e-3])
def test_an_inertia_follows_jumps_exactly(hold: str, delay: float) -> None:
    rng = np.random.default_rng(0)
    command = np.repeat(rng.choice([-1.0, 1.0], 60), 5)
    expected = exact(command, hold == "first_order", delay)
    facts = JointFacts(input="torque", position_unit="rad", encoder_step=1e-6, hold=hold)
    log = Log(DT * np.arange(len(command)), command[:, None], expected[:, None], (1,), facts=(facts,))
    problem = stack(KERNEL, [log], (1,))
    point = point_at(problem, (JointStructure(input="torque"),), (False,))
    parameters = np.zeros_like(point.parameters)
    parameters[..., NOMINAL.index("inertia")] = INERTIA
    point = replace(point, parameters=parameters, starts=np.zeros_like(point.starts))
    if delay:
        point = extend(problem, point, Hypothesis(NAMED["input_delay"], 0), np.array([[delay]]))
    error = errors(problem, [point], leak=False)[0, :, 0]
    assert np.max(np.abs(error)) < 1e-6 * np.ptp(expected)
    assert np.ptp(expected) > 0.1
    general = problem.reading - predicted_motion(problem, point)[:, :, 0]
    assert np.array_equal(errors(problem, [point])[0], general)
