"""The likelihood of coloured errors is exact from the first sample of a log on."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from diagnosis.estimation import Fitted
from diagnosis.growing_order import growing_predictors
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem, stack
from diagnosis.remainder import spectral_deviation
from diagnosis.whitening import Whitener, absorption, begun, whitener
from envs.log import Array, JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
KERNEL = build(EFFECTS)
JOINT = {"inertia": 0.07, "viscous": 0.02, "back_emf": 0.7, "electrical_time_constant": 0.004}
STEP, DT, LOGS = 1e-5, 2e-3, 3


def log_of(seed: int, count: int) -> Log:
    """A joint under sines, its readings rounded."""
    rng = np.random.default_rng(seed)
    time, hertz = DT * np.arange(count), np.array([0.4, 1.1, 2.3])
    command = np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0, 6, 3)), axis=1)[:, None]
    model = StructuredModel((StructuredJoint(1, "voltage", JOINT, {}),), DT, None, EFFECTS)
    position = model.simulate(time, command, State.at_rest(0.0)).position
    facts = JointFacts(input="voltage", position_unit="rad", encoder_step=STEP)
    return Log(time, command, STEP * np.round(position / STEP), (1,), facts=(facts,), name=f"{seed}")


def problem_of(count: int = 4000) -> Problem:
    return stack(KERNEL, [log_of(seed, count) for seed in range(LOGS)], (1,))


@pytest.fixture(scope="module")
def clean() -> Fitted:
    return fit_nominal(problem_of(), (JointStructure(),))


def covariance_of(autoregression: Array, count: int) -> Array:
    """Covariance (count, count) of a stationary signal with innovations of unit variance."""
    impulse = lfilter([1.0], autoregression, np.eye(1, 20_000)[0])
    return np.asarray(toeplitz([impulse[: len(impulse) - k] @ impulse[k:] for k in range(count)]))


@pytest.mark.parametrize("roots", [(0.5,), (0.99, -0.3, 0.2), (0.9 + 0.3j, 0.9 - 0.3j, 0.97)])
def test_predictors_of_growing_order_whiten_a_beginning(roots: tuple[complex, ...]) -> None:
    autoregression = np.real(np.poly(roots))
    filters, logarithm = growing_predictors(autoregression)
    covariance = covariance_of(autoregression, len(roots))
    assert filters @ covariance @ filters.T == pytest.approx(np.eye(len(roots)), abs=1e-6)
    assert logarithm == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-6)


def test_an_unstable_autoregression_is_drawn_in_as_little_as_it_takes() -> None:
    near, beyond = (growing_predictors(np.poly([root, 0.5])) for root in (1.0 - 1e-4, 1.0 + 1e-5))
    assert np.all(np.isfinite(beyond[0]))
    assert 0.5 * near[1] < beyond[1] < 2.0 * near[1]


def test_innovations_are_white_from_the_first_sample_of_a_log_on(clean: Fitted) -> None:
    """With 3 x 4000 samples and half a second of memory, colour that a short predictor knows nothing of would show."""
    problem, rng = problem_of(), np.random.default_rng(0)
    error = (
        1e-4 * lfilter([1.0], np.poly([0.97, 0.9]), rng.standard_normal((len(problem.time) + 1000, 20)), axis=0)[1000:]
    )
    sizes = []
    for own in error.T:
        filter_ = whitener(problem, own[:, None])
        innovation = filter_(own[:, None])
        assert len(innovation) == np.count_nonzero(problem.used)
        assert np.count_nonzero(~filter_.late) == LOGS * len(filter_.first[0])
        sizes.append(np.mean(innovation[~filter_.late] ** 2) / np.mean(innovation[filter_.late] ** 2))
    assert np.mean(sizes) == pytest.approx(1.0, abs=0.1)


def test_the_likelihood_of_whole_logs_is_exact() -> None:
    """Squares of the innovations and what the first samples vary more: ``x' C^-1 x + ln |C|`` of every log."""
    problem, rng = problem_of(1000), np.random.default_rng(0)
    autoregression = np.real(np.poly([0.99, 0.6 + 0.5j, 0.6 - 0.5j]))
    error = lfilter([1.0], autoregression, rng.standard_normal(len(problem.time)))[:, None]
    blocks = ((1, 2), (2, 3), (3, 4))
    bare = Whitener(autoregression[None], np.zeros(0, dtype=bool), -autoregression[None, 1:], blocks, np.ones(1))
    filter_ = begun(problem, bare)
    expected = 0.0
    for a, b in pairwise(problem.bounds):
        own = error[a:b, 0][problem.used[a:b]]
        whole = covariance_of(autoregression, len(own))
        expected += float(own @ np.linalg.solve(whole, own) + np.linalg.slogdet(whole)[1])
    found = float(np.sum(filter_(error) ** 2) + np.sum(filter_.log_determinant))
    assert found == pytest.approx(expected, rel=1e-8)


def test_the_filter_does_not_follow_where_it_has_no_memory() -> None:
    """The absorption leaves the first samples of a log alone: a start velocity that only they show is not taken."""
    problem = problem_of()
    fitted = fit_nominal(problem, (JointStructure(),))
    part = absorption(problem, fitted.error, fitted.whitener)
    is_early = ~fitted.whitener.late[part.positions]
    assert np.any(is_early)
    assert not np.any(part.lagged[0][:, is_early])


def test_deviation_of_a_spectrum_is_that_of_its_estimates(clean: Fitted) -> None:
    """Slow waves meet all blocks of lags alike: their power is known three times as badly as that of fast ones."""
    problem, rng, found, expected = problem_of(), np.random.default_rng(1), [], np.zeros(0)
    for _ in range(60):
        error = 1e-4 * rng.standard_normal((len(problem.time), 1))
        filter_ = whitener(problem, error)
        fitted = replace(clean, error=error, whitener=filter_, innovation=filter_(error))
        expected = spectral_deviation(problem, fitted, 0, 4096)
        found.append(-np.log(np.abs(np.fft.rfft(filter_.coefficients[0], 4096)) ** 2))
    actual = np.std(found, axis=0)
    for band in (slice(5, 60), slice(600, 2000)):
        assert np.mean(actual[band]) == pytest.approx(np.mean(expected[band]), rel=0.25)
    assert np.mean(expected[5:60]) > 1.5 * np.mean(expected[600:2000])
