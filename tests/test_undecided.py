"""Which form a law has, where logs do not tell: the deviations of its parameters cover both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.engine import find
from diagnosis.estimation import Fitted, covariance, fit, measured_precisely
from diagnosis.finding import Accepted
from diagnosis.hypotheses import Hypothesis, Start, extend
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem, stack
from diagnosis.search import score
from diagnosis.undecided import left_undecided
from envs.log import JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
KERNEL = build(EFFECTS)
NAMED = {effect.name: effect for effect in EFFECTS}
DT, STEP, RISE, SECONDS = 2e-3, 1e-4, 0.1, 5.0


def heated(feedback: float) -> Problem:
    """Two logs of a motor whose winding warms up by copper losses, or by losses that do not grow."""
    time, rng, logs = DT * np.arange(10000), np.random.default_rng(0), []
    nominal = {"inertia": 0.02, "viscous": 0.0, "back_emf": 0.3, "torque_square_mean": 0.5}
    heat = {"resistance_rise": RISE, "time_constant": SECONDS, "feedback": feedback}
    model = StructuredModel(
        (StructuredJoint(1, "voltage", nominal, {"thermal_drift_copper": heat}),), DT, None, EFFECTS
    )
    for number in range(2):
        phase = rng.uniform(0.0, 6.28, 6)
        command = 0.5 * np.sum(np.sin(2 * np.pi * np.outer(time, [0.3, 0.7, 1.3, 2.9, 4.1, 6.1]) + phase), axis=1)
        position = model.simulate(time, command[:, None], State.at_rest(np.zeros(1))).position
        facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=STEP),)
        logs.append(
            Log(time, command[:, None], STEP * np.round(position / STEP), (1,), facts=facts, name=f"log {number}")
        )
    return stack(KERNEL, logs, (1,))


def plainly(problem: Problem) -> tuple[Accepted, Fitted]:
    """The model whose losses do not grow."""
    nominal = fit_nominal(problem, (JointStructure(electrical=False),))
    start = Start(Hypothesis(NAMED["thermal_drift"], 0), np.tile([RISE, SECONDS], (problem.logs, 1)), 0.0)
    fitted = fit(problem, extend(problem, nominal.point, start.hypothesis, start.values), iterations=12)
    return Accepted(score(problem, nominal, start, fitted), 0.0, ()), fitted


def off(fitted: Fitted, name: str) -> float:
    """Deviations by which the time constant is wrong."""
    place = [f.name for f in fitted.point.free].index(f"{name}.time_constant@0")
    return float(abs(fitted.point.vector[place] - SECONDS) / np.sqrt(covariance(fitted)[place, place]))


@pytest.mark.parametrize("feedback", [0.0, 1.0])
def test_both_forms_are_in_the_deviations(feedback: float) -> None:
    problem = heated(feedback)
    item, before = plainly(problem)
    (found,), after = left_undecided(problem, before, [item], EFFECTS)
    assert found.name == "thermal_drift_copper"
    assert off(after, found.name) < 2.5
    assert feedback == 0.0 or off(before, "thermal_drift") > 10.0
    (again,), same = left_undecided(problem, after, [found], EFFECTS)
    assert again is found
    assert same is after


def test_a_finding_leaves_the_form_undecided_and_its_covariance_is_precise() -> None:
    problem = heated(1.0)
    forms = [effect for effect in EFFECTS if effect.label == "thermal_drift"]
    finding = find(problem, (JointStructure(electrical=False),), forms)
    (item,) = finding.accepted
    assert (finding.verdict, item.label) == ("named", "thermal_drift")
    assert off(finding.final, item.name) < 2.5
    assert np.array_equal(finding.final.jacobian, measured_precisely(problem, finding.final).jacobian)


def test_a_form_that_does_worse_does_not_take_the_place() -> None:
    problem = heated(1.0)
    item, before = plainly(problem)
    unlike = replace(NAMED["thermal_drift_copper"], undecided=((-1e3, 1e-3),))
    (found,), after = left_undecided(problem, before, [item], (unlike,))
    assert found is item
    assert after is before
