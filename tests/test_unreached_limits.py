"""A drive's stated torque limit that no fitted log reaches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.finding import Finding
from diagnosis.nominal import COLUMN, JointStructure, fit_nominal
from diagnosis.problem import Problem, stack
from diagnosis.settings import Settings
from diagnosis.unreached_limits import limits_decided
from envs.log import JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

JOINT = {"inertia": 0.02, "back_emf": 0.04, "viscous": 0.02, "electrical_time_constant": 0.0}
STRUCTURES = (JointStructure(torque_limit=1.0),)
EFFECTS = built_in()
STEP = 1e-5


def problem_of(amplitude: float, limit: float) -> Problem:
    """A joint under sines of this amplitude [V], whose torque is limited, or is not (0)."""
    time = 2e-3 * np.arange(5000)
    hertz = np.array([0.3, 0.7, 1.3, 2.9, 5.3])
    command = amplitude * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + np.arange(5)), axis=1)[:, None]
    joint = StructuredJoint(1, "voltage", {**JOINT, "torque_limit": limit}, {})
    position = StructuredModel((joint,), 2e-3, None, EFFECTS).simulate(time, command, State.at_rest(0.0)).position
    facts = JointFacts(input="voltage", position_unit="rad", encoder_step=STEP)
    log = Log(time, command, STEP * np.round(position / STEP), (1,), facts=(facts,))
    return stack(build(EFFECTS), [log], (1,))


@pytest.mark.parametrize("acts", [True, False])
@pytest.mark.parametrize("assumed", [0.0, 1.0])
def test_held_out_logs_decide_whether_it_acts(acts: bool, assumed: float) -> None:
    limit = 1.0 if acts else 0.0
    problem, held_out = problem_of(0.15, limit), problem_of(0.6, limit)
    nominal = fit_nominal(problem, STRUCTURES)
    parameters = nominal.point.parameters.copy()
    parameters[..., COLUMN["torque_limit"]] = assumed
    nominal = replace(nominal, point=replace(nominal.point, parameters=parameters))
    finding = Finding("none", nominal, (), nominal, (), (nominal,))
    decided, chosen = limits_decided(problem, held_out, finding, STRUCTURES, Settings().threshold)
    assert chosen == {0: acts}
    for fitted in (decided.nominal, decided.final, *decided.steps):
        assert np.all(fitted.point.parameters[..., COLUMN["torque_limit"]] == limit)


def test_they_have_no_say_where_it_is_reached_in_fitted_logs_or_in_none() -> None:
    for fitted, unseen in ((0.6, 0.6), (0.15, 0.15)):
        problem, held_out = problem_of(fitted, 1.0), problem_of(unseen, 0.0)
        nominal = fit_nominal(problem, STRUCTURES)
        finding = Finding("none", nominal, (), nominal, (), (nominal,))
        decided, chosen = limits_decided(problem, held_out, finding, STRUCTURES, Settings().threshold)
        assert decided is finding
        assert chosen == {}
