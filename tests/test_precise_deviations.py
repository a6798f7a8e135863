"""How well the parameters are known that are reported."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from diagnosis.estimation import Fitted, fit, measured_precisely
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem, stack
from envs.log import JointFacts, Log
from methods.effects import built_in
from methods.kernel import build

KERNEL = build(built_in())
DT, SAMPLES = 2e-3, 4000
INERTIA, DAMPING = 0.07, 0.3
NAMES = ("inertia@0", "back_emf@0")


def disturbed(seed: int, feedback: float) -> Problem:
    """A joint that moves a little, under a slow torque that nobody logged, and held against that by its feedback."""
    time, rng = DT * np.arange(SAMPLES), np.random.default_rng(seed)
    wanted = 0.1 * np.sum(np.sin(2 * np.pi * np.outer(time, [0.3, 0.7, 1.3, 2.9]) + np.arange(4)), axis=1)
    torque = lfilter([np.sqrt(1 - 0.97**2)], [1.0, -0.97], rng.standard_normal(SAMPLES))
    angle, command = np.zeros(SAMPLES), np.zeros(SAMPLES)
    kept, at, speed, before = np.exp(-DAMPING / INERTIA * DT), 0.0, 0.0, 0.0
    for k in range(SAMPLES):
        angle[k] = at
        command[k] = 40.0 * wanted[k] - feedback * (40.0 * at + 3.0 * (at - before) / DT)
        before, steady = at, (command[k] + torque[k]) / DAMPING
        at += steady * DT + (speed - steady) * (1.0 - kept) * INERTIA / DAMPING
        speed = steady + (speed - steady) * kept
    facts = (JointFacts(input="torque", position_unit="rad", encoder_step=1e-9),)
    return stack(KERNEL, [Log(time, command[:, None], angle[:, None], (1,), facts=facts, name="disturbed")], (1,))


def rise(problem: Problem, fitted: Fitted, name: str, times: float) -> float:
    """What the likelihood loses, over its own square, where a parameter is so many of its deviations away, the others
    and the filter make up for that."""
    i = [f.name for f in fitted.point.free].index(name)
    along = fitted.covariance[:, i] / fitted.standard_error(name)
    moved = fitted.point.within(fitted.point.vector + times * along)
    moved = replace(moved, free=tuple(f for f in moved.free if f.name != name))
    return (fit(problem, moved, rounds=4, iterations=8).criterion - fitted.criterion) / times**2


def test_deviations_are_those_of_the_likelihood_where_noise_comes_back_with_the_command() -> None:
    """The filter can then stand in for the parameters: one that stays would know these far too well."""
    found: list[float] = []
    for seed in range(3):
        problem = disturbed(seed, feedback=1.0)
        fitted = fit(problem, fit_nominal(problem, (JointStructure(electrical=False),)).point, rounds=4, iterations=8)
        precise = measured_precisely(problem, fitted)
        found += [rise(problem, precise, name, times) for name in NAMES for times in (-2.0, 2.0)]
    assert np.mean(found) == pytest.approx(1.1, abs=0.25)


def test_deviations_are_those_of_a_filter_that_stays_where_the_noise_knows_nothing_of_the_command() -> None:
    problem = disturbed(0, feedback=0.0)
    plain = fit_nominal(problem, (JointStructure(electrical=False),))
    precise = measured_precisely(problem, plain)
    for name in NAMES:
        assert precise.standard_error(name) == pytest.approx(plain.standard_error(name), rel=0.05)
