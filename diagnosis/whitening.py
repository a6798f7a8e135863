"""Whitening: an autoregression turns coloured prediction errors into innovations.

With the leak fixed, the prediction error of a linear joint is an invertible filter of the innovations; a long
autoregressive filter therefore makes the least-squares estimate that of the prediction-error method, efficient and
consistent in open and closed loop, whatever the colour of the unlogged noise (L. Ljung, System Identification, 1999,
chapters 7 and 13).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import median_filter
from scipy.signal import firwin

from diagnosis.growing_order import growing_predictors
from diagnosis.problem import Problem
from diagnosis.projection import project
from envs.log import Array
from methods.filters import filter_at, prediction_filter

ROWS = 40_000
"""Samples from which an autoregression is estimated at most."""
LINE = 30.0
"""Power of a spectral line over the median around it: white noise reaches that once in 1e5 spectra."""
LINES = 6
"""Lines sought per log."""


@dataclass(frozen=True, eq=False)
class Whitener:
    """Prediction-error filters per joint (n, order + 1), leading coefficient 1, and the mask of usable samples.

    solution: coefficients (n, k) of the autoregression on the means over k blocks of lags; none for a fixed filter.
    first: where in every log the autoregression has nothing before it yet, rows (b,) each, at most its order; there
    the predictors grow with what there is (`diagnosis.growing_order`), so that the likelihood is exact.
    """

    coefficients: Array
    mask: np.ndarray
    solution: Array | None = None
    blocks: tuple[tuple[int, int], ...] = ()
    band: Array | None = None
    every: int = 1
    first: tuple[np.ndarray, ...] = ()

    @cached_property
    def rows(self) -> np.ndarray:
        """Indices of the usable samples."""
        return np.flatnonzero(self.mask)

    @cached_property
    def late(self) -> np.ndarray:
        """Which of the usable samples have the filter's whole memory before them."""
        return ~np.isin(self.rows, np.concatenate([np.zeros(0, dtype=int), *self.first]))

    @cached_property
    def beginnings(self) -> tuple[tuple[Array, float], ...]:
        """Per joint the filters (p, p) of a log's first samples, and the sum of the logarithms of their variances over
        those of the innovations."""
        if not self.first:
            return ()
        assert self.solution is not None
        return tuple(growing_predictors(self.within(j)) for j in range(len(self.solution)))

    @property
    def log_determinant(self) -> Array:
        """What the first samples of all logs vary more than innovations, per joint (n,): sum of ln v."""
        if not self.first:
            return np.zeros(len(self.coefficients))
        return len(self.first) * np.array([total for _, total in self.beginnings])

    def __call__(self, error: Array) -> Array:
        """Innovations of errors (..., T, n), stacked over joints: (..., N n)."""
        parts = []
        for j, filter_ in enumerate(self.coefficients):
            flat = np.ascontiguousarray(error[..., j]).reshape(-1, error.shape[-2])
            if 4 * len(self.rows) < flat.shape[1]:
                y = filter_at(flat, filter_, self.rows)
            else:
                y = prediction_filter(flat, filter_)[:, self.mask]
            for rows in self.first:
                assert self.band is not None
                limited = flat[:, rows] if len(self.band) == 1 else filter_at(flat, self.band, rows)
                place = np.searchsorted(self.rows, rows[0])
                y[:, place : place + len(rows)] = limited @ self.beginnings[j][0].T
            parts.append(y.reshape(*error.shape[:-2], -1))
        return np.concatenate(parts, axis=-1)

    def within(self, j: int) -> Array:
        """The autoregression of joint index j alone, on the samples that are kept of the band."""
        assert self.solution is not None
        return _sparse(self.solution[j], self.blocks, 1)

    def moved(self, change: Array) -> Whitener:
        """The filter with other coefficients of the autoregression: the change (n, k) added."""
        assert self.solution is not None
        assert self.band is not None
        solution = self.solution + change
        coefficients = np.stack([_expanded(own, self.blocks, self.every, self.band) for own in solution])
        return replace(self, solution=solution, coefficients=coefficients)


def whitener(problem: Problem, error: Array) -> Whitener:
    """Autoregressive filter per joint by least squares (covariance method) on the errors (T, n) after the burn-in.

    The lags are single ones at first and then means over blocks that grow by a quarter each (`lag_blocks`), so that few
    coefficients reach from the encoder's rounding to the slow noise of an amplifier in a closed loop.

    With a decimation the errors are band-limited by a symmetric window filter, every so many samples are kept, and the
    autoregression runs over the kept ones; both filters are merged into one.
    """
    every = problem.decimation
    blocks = lag_blocks(problem)
    order = blocks[-1][1] - 1
    band = band_filter(problem)
    memory = order * every + len(band) - 1
    rows = np.flatnonzero(filterable(problem, memory))
    limited = _noise_like(problem, error, band)
    rows = rows[_thinned(len(rows))]
    solution = np.zeros((problem.joints, len(blocks)))
    for j in range(problem.joints):
        lagged = np.stack([limited[rows, j], *_lagged(limited[:, j], rows, blocks, every)])
        gram = lagged @ lagged.T
        ridge = 1e-12 * np.trace(gram[1:, 1:]) / len(blocks) + 1e-300
        solution[j] = np.linalg.solve(gram[1:, 1:] + ridge * np.eye(len(blocks)), gram[1:, 0])
    coefficients = np.stack([_expanded(own, blocks, every, band) for own in solution])
    return begun(problem, Whitener(coefficients, np.zeros(0, dtype=bool), solution, tuple(blocks), band, every))


def begun(problem: Problem, filter_: Whitener) -> Whitener:
    """The filter on these logs, from where their band is limited on."""
    assert filter_.band is not None
    mask = filterable(problem, len(filter_.band) - 1)
    own = [a + np.flatnonzero(mask[a:b]) for a, b in pairwise(problem.bounds)]
    order = filter_.blocks[-1][1] - 1
    if any(len(rows) <= order for rows in own):
        return replace(filter_, mask=filterable(problem, filter_.coefficients.shape[1] - 1), first=())
    return replace(filter_, mask=mask, first=tuple(rows[:order] for rows in own))


def filterable(problem: Problem, memory: int) -> np.ndarray:
    """Mask (T,) of the usable samples, as far apart as the problem's decimation says, without the first `memory` ones
    after the burn-in of each log, which a filter needs."""
    mask = problem.used.copy()
    for a, b in pairwise(problem.bounds):
        mask[a : min(b, a + int(np.argmax(problem.used[a:b])) + memory)] = False
        mask[a:b] &= np.arange(b - a) % problem.decimation == 0
    return mask


def on_logs(problem: Problem, filter_: Whitener) -> Whitener:
    """A whitening filter for other logs than those it was made on, with coefficients that stay as they are."""
    return begun(problem, filter_)


def _thinned(count: int) -> np.ndarray:
    """Indices of at most ROWS evenly spaced ones of `count` samples."""
    return np.arange(0, count, count // ROWS + 1)


def _expanded(solution: Array, blocks: Sequence[tuple[int, int]], every: int, band: Array) -> Array:
    """One coefficient per lag, the band filter merged into them."""
    return np.asarray(np.convolve(_sparse(solution, blocks, every), band), dtype=np.float64)


def _sparse(solution: Array, blocks: Sequence[tuple[int, int]], every: int) -> Array:
    """The autoregression's prediction-error filter, leading coefficient 1, one lag every so many samples."""
    sparse = np.zeros((blocks[-1][1] - 1) * every + 1)
    sparse[0] = 1.0
    for (first, last), value in zip(blocks, solution, strict=True):
        sparse[first * every : (last - 1) * every + 1 : every] = -value / (last - first)
    return sparse


def _noise_like(problem: Problem, error: Array, band: Array) -> Array:
    """The errors (T, n) that an autoregression is estimated from."""
    if problem.decimation == 1:
        return without_lines(problem, error)
    limited: Array = prediction_filter(np.ascontiguousarray(error.T), band).T
    return limited


@dataclass(frozen=True, eq=False)
class Absorption:
    """What an autoregression that is estimated anew takes away of a change of the errors.

    To first order the innovations r change by ``J x - L' a`` when parameters move by x and coefficients by a, with L
    the lagged errors. The coefficients follow the parameters, ``a = (L L')^-1 L J x``: only that part of J counts which
    L does not contain (variable projection: L. Kaufman, BIT 15 (1975) 49). Without it an effect whose errors look like
    slow noise creeps towards its value, or stays where it began.

    positions (R,): the samples it is computed from, among the usable ones. lagged: (k, R) per joint, zero at the first
    samples of logs, which the autoregression is not estimated from.
    """

    positions: np.ndarray
    lagged: tuple[Array, ...]

    @cached_property
    def factors(self) -> list:
        """Cholesky factors of L L' per joint."""
        found = []
        for own in self.lagged:
            gram = own @ own.T
            found.append(cho_factor(gram + 1e-10 * np.diag(np.diag(gram)) + 1e-300 * np.eye(len(gram))))
        return found

    def samples(self, signals: Array) -> Array:
        """Signals (P, N n) at the positions: (n, P, R)."""
        return np.stack([part[:, self.positions] for part in np.split(signals, len(self.lagged), axis=1)])

    def followed(self, chosen: Array) -> Array:
        """Change of the coefficients (n, k, P) that signals (n, P, R) bring about."""
        return np.stack(
            [
                cho_solve(factor, own @ part.T)
                for factor, own, part in zip(self.factors, self.lagged, chosen, strict=True)
            ]
        )

    def left(self, chosen: Array) -> Array:
        """What of signals (n, P, R) the autoregression does not take away."""
        taken = [follow.T @ own for follow, own in zip(self.followed(chosen), self.lagged, strict=True)]
        return chosen - np.stack(taken)


def absorption(problem: Problem, error: Array, filter_: Whitener) -> Absorption:
    """Absorption of the filter's autoregression at these errors (T, n)."""
    assert filter_.band is not None
    limited = _noise_like(problem, error, filter_.band)
    positions = _thinned(len(filter_.rows))
    rows, late = filter_.rows[positions], filter_.late[positions]
    lagged = (np.stack(_lagged(limited[:, j], rows, filter_.blocks, filter_.every)) for j in range(problem.joints))
    return Absorption(positions, tuple(own * late for own in lagged))


def band_filter(problem: Problem) -> Array:
    """Window filter that limits the errors to the band in which they are compared."""
    every = problem.decimation
    return np.ones(1) if every == 1 else firwin(6 * every + 1, 0.8 / every)


def unfiltered(problem: Problem, mask: np.ndarray | None = None) -> Whitener:
    """The errors as they are, in the band in which they are compared; mask (T,): which, not the usable ones."""
    band = np.tile(band_filter(problem), (problem.joints, 1))
    return Whitener(band, problem.used if mask is None else mask)


def without_lines(problem: Problem, error: Array) -> Array:
    """Errors (T, n) less their mean and their spectral lines, which noise does not have.

    A long autoregression would otherwise imitate an offset or a periodic disturbance and call it noise. Where the
    motion itself is one sine, its harmonics are left: they are the rounding's as well as the model's.
    """
    cleaned = error.copy()
    for a, b in pairwise(problem.bounds):
        window = slice(a + int(np.argmax(problem.used[a:b])), b)
        cleaned[window] -= np.mean(cleaned[window], axis=0)
        for j in range(problem.joints):
            waves = _lines(error[window, j], problem.reading[window, j])
            if len(waves):
                basis = np.concatenate([waves.real, waves.imag])
                taper = np.hanning(waves.shape[1])  # against what leaks from slow parts of the error
                cleaned[window, j] -= project(basis * taper, error[window, j] * taper)[0] @ basis
    return cleaned


def _lines(error: Array, reading: Array) -> NDArray[np.complex128]:
    """Complex waves (lines, T) at the frequencies at which the spectrum of an error (T,) has a line."""
    count = len(error)
    taper = np.hanning(count)
    power = np.abs(np.fft.rfft((error - error.mean()) * taper)) ** 2
    around = median_filter(power, 41, mode="nearest")
    strong = power > LINE * np.maximum(around, 1e-300)
    strong[:12] = False
    peaks = np.flatnonzero(strong[1:-1] & (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])) + 1
    moved = np.abs(np.fft.rfft((reading - reading.mean()) * taper)) ** 2
    main = int(np.argmax(moved))
    if main > 4 and moved[main - 2 : main + 3].sum() > 0.9 * moved.sum():
        away = np.abs(peaks / main - np.round(peaks / main)) * main
        peaks = peaks[away > 2.5]
    peaks = peaks[np.argsort(power[peaks])[::-1][:LINES]]
    left, centre, right = (np.sqrt(power[peaks + k]) for k in (-1, 0, 1))
    # the main lobe of a Hann window tells the place between bins from its neighbours' amplitudes
    shift = np.where(right > left, (2 * right - centre) / (right + centre), -(2 * left - centre) / (left + centre))
    place = (peaks + shift)[:, None]
    return np.exp(2j * np.pi * place * np.arange(count) / count)


def _lagged(signal: Array, rows: np.ndarray, blocks: Sequence[tuple[int, int]], every: int) -> list[Array]:
    """Means of the signal (T,) over blocks of lags, at the rows."""
    found = []
    total = np.concatenate([np.zeros(every), signal])  # cumulative sums over every `every`-th sample
    for phase in range(every):
        total[phase::every] = np.cumsum(total[phase::every])
    for first, last in blocks:
        if last - first == 1:
            found.append(signal[rows - first * every])
        else:
            newest, before = rows - (first - 1) * every, rows - (last - 1) * every
            found.append((total[newest] - total[before]) / (last - first))
    return found


def lag_blocks(problem: Problem) -> list[tuple[int, int]]:
    """Blocks of lags (first, last + 1): single ones over 40 ms (12 to 32 lags), then growing to half a second.

    The reach is at most a twentieth of the shortest log. Four single lags where errors are compared in a narrow band.
    """
    if problem.decimation > 1:
        return [(i, i + 1) for i in range(1, 5)]
    shortest = int(np.min(np.diff(problem.bounds)))
    reach = min(round(0.5 / problem.sample_time), shortest // 20)
    single = int(np.clip(round(0.04 / problem.sample_time), 12, 32))
    blocks = [(i, i + 1) for i in range(1, single + 1)]
    while (first := blocks[-1][1]) < reach:
        blocks.append((first, min(first + max(2, first // 4), max(reach, first + 2))))
    return blocks
