"""Logs that are simulated in steps of several samples, where only a low band of them counts."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from diagnosis.estimation import errors
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import ROOM, Problem, coarser, in_band, stack
from envs.log import JointFacts, Log
from methods.effects import built_in
from methods.kernel import LANES, build

KERNEL = build(built_in())
DT = 5e-4
INERTIA, DRAG = 0.05, 0.4
STRUCTURE = (JointStructure(input="current"),)


def moved(seed: int, seconds: float, *, dt: float = DT, jitter: float = 0.0) -> Log:
    """An inertia with viscous friction under a held command, exact between samples."""
    rng = np.random.default_rng(seed)
    time = dt * np.arange(round(seconds / dt))
    command = np.sum(np.sin(2 * np.pi * np.outer(time, [0.5, 1.3, 2.9]) + rng.uniform(0, 6, 3)), axis=1)
    command += 0.3 * rng.standard_normal(len(time))
    rates = np.array([[0.0, 1.0, 0.0], [0.0, -DRAG / INERTIA, 1.0 / INERTIA], [0.0, 0.0, 0.0]])
    step, state, position = expm(dt * rates), np.zeros(3), np.zeros(len(time))
    for k, u in enumerate(command):
        position[k], state[2] = state[0], u
        state = step @ state
    facts = JointFacts(input="current", position_unit="rad", encoder_step=1e-6)
    stamps = time + jitter * dt * rng.uniform(-0.3, 0.3, len(time))
    return Log(
        stamps, command[:, None], 1e-6 * np.round(position[:, None] / 1e-6), (1,), facts=(facts,), name=f"{seed}"
    )


def problem_of(**others: float) -> Problem:
    return stack(KERNEL, [moved(1, 4.0, **others), moved(2, 3.0005, **others)], (1,))


def test_every_few_samples_are_predicted_as_all_are() -> None:
    problem = problem_of()
    narrow = coarser(problem, 16)
    assert (narrow.thinning, narrow.decimation, narrow.sample_time) == (4, 4, pytest.approx(4 * DT))
    rows = np.concatenate([np.arange(a, b, 4) for a, b in pairwise(problem.bounds)])
    assert np.array_equal(narrow.reading, problem.reading[rows])
    fits = [fit_nominal(own, STRUCTURE) for own in (problem, narrow)]
    for fitted in fits:
        known = {name: fitted.point.value(f"{name}@0") for name in ("inertia", "viscous")}
        assert known == pytest.approx({"inertia": INERTIA, "viscous": DRAG}, rel=2e-3)
    point = fits[0].point
    whole, few = (errors(own, [point], leak=False)[0] for own in (problem, narrow))
    assert np.max(np.abs(few - whole[rows])) < 2e-4 * np.std(problem.reading)


def test_a_simulation_counts_as_many_steps_as_it_takes() -> None:
    problem = problem_of()
    point, coarse = fit_nominal(problem, STRUCTURE).point, coarser(problem, 16)
    for own, steps in ((problem, len(problem.time)), (coarse, len(problem.time) / coarse.thinning)):
        before = own.work.steps
        errors(own, [point])
        assert own.work.steps - before == pytest.approx(LANES / own.logs * steps, rel=1e-3)
    assert coarse.thinning > 1


@pytest.mark.parametrize(
    ("dt", "decimation", "several"), [(DT, 16, 4), (DT, 3 * ROOM - 1, 2), (DT, 2, 1), (2e-3, 32, 1)]
)
def test_steps_stay_short_and_leave_the_band_room(dt: float, decimation: int, several: int) -> None:
    narrow = coarser(problem_of(dt=dt), decimation)
    assert (narrow.thinning, narrow.decimation) == (several, decimation // several)


def test_uneven_samples_are_simulated_one_by_one() -> None:
    assert coarser(problem_of(jitter=1.0), 16).thinning == 1


def test_the_band_is_that_of_the_motion_whatever_the_rate() -> None:
    bands = [0.4 / (own.decimation * own.sample_time) for own in (in_band(problem_of()), in_band(problem_of(dt=2e-3)))]
    assert bands[0] == pytest.approx(bands[1], rel=0.15)
