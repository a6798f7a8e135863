"""Pooled figures of a benchmark and their uncertainty: few seeds, many tasks, errors of any size.

The practice is that of Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice",
NeurIPS 2021: interquartile means, bootstrap intervals stratified by task, probability of improvement, ranks. Their
library needs `arch`, seaborn and old interfaces of pandas, and pools runs that share nothing; here the same seed gives
every contestant the same robot and the same logs, so seeds are resampled together and contestants are compared in
pairs. Interquartile mean and intervals agree with the library's (tests/test_bench_statistics.py).

Everything works on one array per contestant, `values` (T, S) by task and seed, where larger is better and NaN means
that there is no such run. Every task weighs the same, however many seeds it has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

Array = NDArray[np.float64]
LEVEL = 0.95
"""Share of the bootstrap distribution inside an interval."""
REPETITIONS = 2000
"""Bootstrap samples of one interval."""
QUARTILES = (0.25, 0.75)


@dataclass(frozen=True)
class Estimate:
    """A figure with its interval; None where no task has two seeds, so that nothing can be said."""

    value: float
    interval: tuple[float, float] | None


def normalised_score(error: Array, worst: Array, best: Array) -> Array:
    """Share of the attainable orders of magnitude that an error has gained,

        s = log(worst / error) / log(worst / best),

    limited below at 0. It is 0 at the error `worst` of the contestant that knows nothing and 1 at the error `best`
    that noise leaves the true model; a biased model may predict better than that, and score above 1. Infinite errors
    (failures, lost free runs) score 0. NaN where an error is NaN, and where
    `best` is not below `worst`: nothing can be gained there. A ratio scale needs logarithms, or the pooled figure is
    that of the task with the largest errors (Fleming and Wallace 1986).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        span = np.log(worst / best)
        share = np.log(worst / np.maximum(error, np.finfo(float).tiny)) / span
    share = np.where(np.isposinf(error), 0.0, np.maximum(share, 0.0))
    return np.where(np.isnan(error) | ~(span > 0.0) | ~np.isfinite(span), np.nan, share)


def interquartile_mean(values: Array, weights: Array | None = None) -> float:
    """Mean of the middle half of the mass; a quartile inside a value takes its share of it. NaN is left out."""
    flat = np.ravel(np.asarray(values, float))
    mass = np.ones_like(flat) if weights is None else np.ravel(np.asarray(weights, float))
    return float(_interquartile_means(flat, mass[None, :])[0])


def task_weights(values: Array) -> Array:
    """Weights (T, S) of the runs that there are: the same sum for every task that has one, zero elsewhere."""
    return _by_task((~np.isnan(values)).astype(float)[None])[0]


@dataclass(frozen=True, eq=False)
class Resampling:
    """How often each run occurs in each bootstrap sample, `counts` (R, T, S): seeds are drawn anew within each task."""

    counts: Array
    tells: bool
    """False when no task has two seeds: every sample is then the same."""

    @classmethod
    def of(cls, seeds: NDArray[np.bool_], rng: np.random.Generator, repetitions: int = REPETITIONS) -> Resampling:
        """Draw for the seeds (T, S) that exist; the same draw serves every contestant."""
        counts = np.zeros((repetitions, *seeds.shape))
        for task, row in enumerate(seeds):
            there = np.flatnonzero(row)
            if there.size:
                drawn = rng.integers(there.size, size=(repetitions, there.size))
                for position in range(there.size):
                    counts[:, task, there[position]] = np.sum(drawn == position, axis=1)
        return cls(counts, bool(np.any(np.sum(seeds, axis=1) > 1)))

    def interval(self, samples: Array) -> tuple[float, float] | None:
        """Percentile interval of a figure (R,) over the samples."""
        known = samples[np.isfinite(samples)]
        if not self.tells or known.size == 0:
            return None
        low, high = np.quantile(known, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
        return float(low), float(high)

    def mean(self, values: Array) -> Estimate:
        """Mean over tasks of the mean over seeds."""
        return Estimate(
            float(_means(values, task_weights(values)[None])[0]),
            self.interval(_means(values, self._weights(values))),
        )

    def interquartile_mean(self, values: Array) -> Estimate:
        """Interquartile mean over all runs."""
        return Estimate(
            interquartile_mean(values, task_weights(values)),
            self.interval(_interquartile_means(np.ravel(values), self._weights(values).reshape(len(self.counts), -1))),
        )

    def probability_of_improvement(self, first: Array, second: Array) -> Estimate:
        """Chance that the first beats the second on the same task and seed; a draw counts half."""
        return self.mean(wins(first, second))

    def _weights(self, values: Array) -> Array:
        return _by_task(self.counts * ~np.isnan(values))


def wins(first: Array, second: Array) -> Array:
    """1 where the first is better, 1/2 where they are equal, 0 where it is worse, NaN where one is missing."""
    won = (first > second) + 0.5 * (first == second)
    return np.where(np.isnan(first) | np.isnan(second), np.nan, won)


def ranks(values: Sequence[Array]) -> Array:
    """Ranks (M, T, S) of the contestants on every run: 1 is best, equals share the mean, NaN where one is missing."""
    return np.asarray(rankdata(-np.stack(values), axis=0, nan_policy="omit"), float)


def _by_task(counts: Array) -> Array:
    """Counts (R, T, S) divided by their sum over seeds; tasks without runs stay zero."""
    total = np.sum(counts, axis=-1, keepdims=True)
    return np.divide(counts, total, out=np.zeros_like(counts), where=total > 0.0)


def _means(values: Array, weights: Array) -> Array:
    total = np.sum(weights, axis=(1, 2))
    summed = np.einsum("ts,rts->r", np.nan_to_num(values), weights)
    return np.divide(summed, total, out=np.full(len(total), np.nan), where=total > 0.0)


def _interquartile_means(flat: Array, weights: Array) -> Array:
    """Interquartile mean (R,) of values (N,) under weights (R, N)."""
    known = np.flatnonzero(~np.isnan(flat))
    order = known[np.argsort(flat[known], kind="stable")]
    mass = weights[:, order]
    total = np.sum(mass, axis=1, keepdims=True)
    share = np.divide(mass, total, out=np.zeros_like(mass), where=total > 0.0)
    after = np.cumsum(share, axis=1)
    low, high = QUARTILES
    kept = np.maximum(np.minimum(after, high) - np.maximum(after - share, low), 0.0)
    means = kept @ flat[order] / (high - low)
    return np.where(total[:, 0] > 0.0, means, np.nan)
