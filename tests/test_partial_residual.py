"""Partial residuals: known torques come back from prediction errors, and effects are drawn as their laws say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from diagnosis.estimation import Fitted, errors
from diagnosis.hypotheses import Hypothesis, extend
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.partial_residual import without_effect
from diagnosis.problem import Problem, smooth_derivatives, stack
from diagnosis.replay import input_equivalent
from envs.log import Log
from methods.effects import built_in
from methods.kernel import build

LEVEL = 0.05
"""Dry friction [V]."""


@pytest.fixture(scope="module")
def solved() -> tuple[Problem, Fitted]:
    """A linear joint, 0.07 q'' + 0.5 q' = u, and its fit."""
    time = np.arange(0.0, 8.0, 0.002)
    command = np.sin(2.1 * time) + 0.6 * np.sin(9.3 * time + 1.0)
    _, position, _ = lsim(([1.0], [0.07, 0.5, 0.0]), command, time, interp=False)
    problem = stack(build(built_in()), [Log(time, command, position)], (1,))
    return problem, fit_nominal(problem, (JointStructure(electrical=False),))


def test_a_known_torque_comes_back(solved: tuple[Problem, Fitted]) -> None:
    problem, fitted = solved
    torque = 0.05 * np.sin(7.0 * problem.time)
    extra = torque[None, :, None]

    braked = errors(problem, [fitted.point], extra=extra)[0]
    change = braked - fitted.error
    found = input_equivalent(problem, fitted.point, change, 0.03)[:, 0]
    used = problem.used & (problem.time > 1.0)
    slope = np.polyfit(torque[used], found[used], 1)[0]
    assert slope == pytest.approx(1.0, abs=0.05)
    assert np.std(found[used] - slope * torque[used]) < 0.15 * np.std(torque)


def test_friction_shows_as_a_step_of_its_own_height(solved: tuple[Problem, Fitted]) -> None:
    problem, fitted = solved
    effect = next(e for e in built_in() if e.name == "coulomb_friction")
    point = extend(problem, fitted.point, Hypothesis(effect, 0), np.array([[LEVEL]]))
    without = without_effect(problem, point, effect.name, 0)
    share = errors(problem, [without])[0] - errors(problem, [point])[0]
    law = -input_equivalent(problem, fitted.point, share, 0.02)[:, 0]
    velocity = smooth_derivatives(problem.time, problem.reading, 0.02)[1][:, 0]
    fast = problem.used & (problem.time > 1.0) & (np.abs(velocity) > 0.4)
    assert np.median(law[fast & (velocity > 0)]) == pytest.approx(LEVEL, rel=0.05)
    assert np.median(law[fast & (velocity < 0)]) == pytest.approx(-LEVEL, rel=0.05)


def test_switching_an_effect_off_changes_nothing_else(solved: tuple[Problem, Fitted]) -> None:
    problem, fitted = solved
    effect = next(e for e in built_in() if e.name == "cable_spring")
    point = extend(problem, fitted.point, Hypothesis(effect, 0), np.full((1, effect.size), 0.3))
    again = without_effect(problem, point, effect.name, 0)
    assert np.array_equal(again.switches, fitted.point.switches)
    assert np.array_equal(errors(problem, [replace(again, free=fitted.point.free)]), errors(problem, [fitted.point]))
