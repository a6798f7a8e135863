"""Pooled statistics against published examples, the reference library's figures, and their own promises."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import trim_mean

from benchmarks.statistics import Resampling, interquartile_mean, normalised_score, ranks, task_weights, wins

SEED, TASK = np.arange(8)[:, None], np.arange(4)[None, :]
FIRST = (np.mod(7 * SEED + 3 * TASK + SEED * TASK, 11) / 10.0).T
SECOND = (np.mod(5 * SEED + 2 * TASK + SEED * SEED, 13) / 10.0).T
"""Four tasks and eight seeds, written as formulas so that another program can repeat them."""


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ([5, 8, 4, 38, 8, 6, 9, 7, 7, 3, 1, 6], 6.5),
        ([1, 3, 5, 7, 9, 11, 13, 15, 17], 9.0),
        ([1, 2, 3, 4, 5], 3.0),
    ],
)
def test_interquartile_mean_of_published_examples(numbers: list[float], expected: float) -> None:
    """Worked examples of Wikipedia's article "Interquartile mean", with and without fractional quartiles."""
    assert interquartile_mean(np.array(numbers, float)) == pytest.approx(expected, rel=1e-12)


def test_interquartile_mean_agrees_with_scipy_where_quartiles_fall_between_values() -> None:
    values = np.random.default_rng(3).gamma(2.0, size=64)
    assert interquartile_mean(values) == pytest.approx(trim_mean(values, 0.25), rel=1e-12)


def test_figures_of_the_reference_library() -> None:
    """rliable 1.2.0 (arch 7.2.0, 20 000 samples, three generators) on the same numbers.

    aggregate_iqm 0.5 and 0.50625; intervals [0.375, 0.631] and [0.350, 0.706 to 0.7125].
    """
    resampling = Resampling.of(np.ones((4, 8), bool), np.random.default_rng(0), 20_000)
    first, second = resampling.interquartile_mean(FIRST), resampling.interquartile_mean(SECOND)
    assert first.value == pytest.approx(0.5, abs=1e-12)
    assert second.value == pytest.approx(0.50625, abs=1e-12)
    assert first.interval == pytest.approx((0.375, 0.631), abs=0.008)
    assert second.interval == pytest.approx((0.350, 0.710), abs=0.008)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """Scores of 6 tasks with 10 seeds each; the mean of a known distribution lies inside about 19 times in 20."""
    rng, held = np.random.default_rng(1), 0
    centres = np.linspace(0.0, 1.0, 6)[:, None]
    for _ in range(200):
        values = centres + rng.normal(0.0, 0.3, (6, 10))
        interval = Resampling.of(np.ones((6, 10), bool), rng, 400).mean(values).interval
        assert interval is not None
        held += interval[0] <= 0.5 <= interval[1]
    assert 0.87 <= held / 200 <= 0.98  # ten seeds make percentile intervals a little too narrow


def test_every_task_weighs_the_same() -> None:
    values = np.array([[1.0, np.nan, np.nan, np.nan], [0.0, 0.0, 0.0, 0.0]])
    resampling = Resampling.of(~np.isnan(values), np.random.default_rng(0), 200)
    assert resampling.mean(values).value == pytest.approx(0.5)
    assert np.sum(task_weights(values), axis=1) == pytest.approx([1.0, 1.0])


def test_one_seed_tells_nothing_about_the_spread() -> None:
    values = np.array([[0.3], [0.6]])
    assert Resampling.of(np.ones((2, 1), bool), np.random.default_rng(0), 50).mean(values).interval is None


def test_the_same_generator_gives_the_same_interval() -> None:
    seeds = np.ones((4, 8), bool)
    once, again = (Resampling.of(seeds, np.random.default_rng(5)).interquartile_mean(FIRST) for _ in range(2))
    assert once == again


def test_score_is_zero_at_the_worst_one_at_the_best_and_linear_in_decades() -> None:
    error = np.array([1.0, 0.1, 0.01, 5.0, np.inf, np.nan, 0.001])
    score = normalised_score(error, np.full(7, 1.0), np.full(7, 0.01))
    assert score == pytest.approx([0.0, 0.5, 1.0, 0.0, 0.0, np.nan, 1.5], nan_ok=True)


def test_no_score_where_nothing_can_be_gained() -> None:
    score = normalised_score(np.array([0.5, 0.5, 0.5]), np.array([1.0, 1.0, 1.0]), np.array([1.0, 2.0, 0.0]))
    assert np.all(np.isnan(score))


def test_wins_count_draws_half_and_leave_missing_runs_out() -> None:
    first = np.array([[1.0, 2.0, -np.inf, np.nan]])
    second = np.array([[0.0, 2.0, -np.inf, 1.0]])
    assert wins(first, second) == pytest.approx(np.array([[1.0, 0.5, 0.5, np.nan]]), nan_ok=True)
    resampling = Resampling.of(np.ones((1, 4), bool), np.random.default_rng(0), 100)
    assert resampling.probability_of_improvement(first, second).value == pytest.approx(2.0 / 3.0)


def test_chances_of_two_contestants_add_up_to_one() -> None:
    resampling = Resampling.of(np.ones((4, 8), bool), np.random.default_rng(0), 100)
    there = resampling.probability_of_improvement(FIRST, SECOND).value
    back = resampling.probability_of_improvement(SECOND, FIRST).value
    assert there + back == pytest.approx(1.0)


def test_ranks_share_places_and_put_failures_last() -> None:
    three = [np.array([[0.9, 0.5]]), np.array([[0.9, -np.inf]]), np.array([[0.1, np.nan]])]
    assert ranks(three)[:, 0, :] == pytest.approx(np.array([[1.5, 1.0], [1.5, 2.0], [3.0, np.nan]]), nan_ok=True)
