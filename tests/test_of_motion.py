"""What an effect gains by shaping how noise is predicted is not of the motion; what a real one gains is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from diagnosis.choice import choose
from diagnosis.estimation import fit
from diagnosis.hypotheses import Hypothesis, Start, extend
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.of_motion import SHARE, is_of_motion, motion_gain
from diagnosis.problem import Problem, stack
from diagnosis.search import Scored, score
from diagnosis.settings import Settings
from envs.excitation import parse
from envs.log import JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import PlanarCoupling, StructuredJoint, StructuredModel

DT, STEP = 2e-3, 1e-5
SPRING = next(effect for effect in built_in() if effect.name == "joint_flexibility")
SHOULDER = {"inertia": 0.07, "viscous": 0.02, "back_emf": 0.7, "electrical_time_constant": 0.01}
ELBOW = {"inertia": 0.03, "viscous": 0.02, "back_emf": 0.4, "electrical_time_constant": 0.007}


def arm(effects: dict[str, dict[str, float]], noise: float, seed: int) -> Problem:
    """A planar arm whose amplifiers add noise (rms [V], correlated over 20 ms) that no log shows."""
    joints = StructuredJoint(1, "voltage", SHOULDER, {}), StructuredJoint(2, "voltage", ELBOW, effects)
    model = StructuredModel(joints, DT, PlanarCoupling(0.02, 1.5, 0.012))
    time, rng = DT * np.arange(8000), np.random.default_rng(seed)
    excitation = parse("multisine:amplitude=1.5,band=0.3-12,period=4,joints=1")
    command = np.column_stack([excitation.sample(time, rng)[:, 0] for _ in joints])
    pole = np.exp(-DT / 0.02)
    added = noise * np.sqrt(1.0 - pole**2) * lfilter([1.0], [1.0, -pole], rng.standard_normal(command.shape), axis=0)
    position = model.simulate(time, command + added, State.at_rest(np.zeros(2))).position
    facts = (JointFacts(encoder_step=STEP),) * 2
    log = Log(time, command, STEP * np.round(position / STEP), (1, 2), facts=facts, name="arm")
    return stack(build(built_in()), [log], (1, 2), pair=True)


def fitted(problem: Problem, start: tuple[float, float, float]) -> tuple[Scored, bool]:
    """A spring in the second joint, fitted from a start, and whether it would be taken."""
    base = fit_nominal(problem, (JointStructure(), JointStructure()))
    hypothesis, values = Hypothesis(SPRING, 1), np.array([start])
    whole = fit(problem, extend(problem, base.point, hypothesis, values), rounds=2, iterations=8)
    scored = score(problem, base, Start(hypothesis, values, 0.0), whole)
    assert scored.evidence > Settings().weak
    share = motion_gain(problem, whole, base) / (base.criterion - whole.criterion)
    assert is_of_motion(problem, whole, base) == (share > SHARE)
    assert share < SHARE or share > 0.9
    return scored, choose(problem, base, [scored], Settings(material=0.0, faint=0.0), 0.0) is not None


@pytest.mark.slow
def test_a_spring_that_only_the_noise_asks_for_is_none() -> None:
    assert not fitted(arm({}, 0.03, 2), (0.3, 60.0, 0.02))[1]


def test_a_spring_that_moves_the_joint_is_one() -> None:
    hidden = {"inertia_ratio": 0.5, "frequency": 25.0, "damping_ratio": 0.05}
    scored, is_taken = fitted(arm({"joint_flexibility": hidden}, 0.03, 2), (0.5, 20.0, 0.02))
    assert is_taken
    assert scored.fitted.point.value("joint_flexibility.frequency@1") == pytest.approx(25.0, rel=0.01)


def test_a_model_that_runs_away_has_no_motion_to_compare() -> None:
    problem = arm({}, 0.01, 1)
    base = fit_nominal(problem, (JointStructure(), JointStructure()))
    parameters = base.point.parameters.copy()
    parameters[:, 0, 1:3] = -1.0  # negative damping
    assert motion_gain(problem, replace(base, point=replace(base.point, parameters=parameters)), base) == np.inf
