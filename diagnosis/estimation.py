"""Prediction-error estimation: simulate with a weak leak, whiten what remains, minimise it.

With the leak fixed, the prediction error of a linear joint is an invertible filter of the innovations; a long
autoregressive whitening filter therefore makes the least-squares estimate that of the prediction-error method,
efficient
and consistent in open and closed loop, whatever the colour of the unlogged noise (L. Ljung, System Identification,
1999, chapters 7 and 13).
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

from diagnosis.problem import Free, Problem
from envs.log import Array
from methods.filters import filter_at, prediction_filter


@dataclass(frozen=True, eq=False)
class Point:
    """A model: parameters (L, n, columns), switches (n, effects), rigid (3,), initial states (L, n, 3), free
    parameters."""

    parameters: Array
    switches: np.ndarray
    rigid: Array
    starts: Array
    free: tuple[Free, ...]

    @property
    def vector(self) -> Array:
        """Values of the free parameters."""
        return np.array([self._get(f) for f in self.free])

    def _get(self, f: Free) -> float:
        if f.kind == "start":
            return float(self.starts[f.log, f.joint, f.column])
        if f.kind == "rigid":
            return float(self.rigid[f.column])
        return float(self.parameters[max(f.log, 0), f.joint, f.column])

    def at(self, vector: Array) -> Point:
        """The same model with other values of the free parameters."""
        parameters, rigid, starts = self.parameters.copy(), self.rigid.copy(), self.starts.copy()
        for f, value in zip(self.free, vector, strict=True):
            if f.kind == "start":
                starts[f.log, f.joint, f.column] = value
            elif f.kind == "rigid":
                rigid[f.column] = value
            elif f.kind == "log":
                parameters[f.log, f.joint, f.column] = value
            else:
                parameters[:, f.joint, f.column] = value
        return replace(self, parameters=parameters, rigid=rigid, starts=starts)

    def value(self, name: str) -> float:
        return self.vector[[f.name for f in self.free].index(name)]


def errors(problem: Problem, points: Sequence[Point], extra: Array | None = None, leak: bool = True) -> Array:
    """Prediction errors (C, T, n) of several points with the same switches or not."""
    return problem.errors(
        np.stack([p.parameters for p in points]),
        np.stack([p.switches for p in points]),
        np.stack([p.rigid for p in points]),
        np.stack([p.starts for p in points]),
        extra=extra,
        leak=leak,
    )


def predicted_motion(problem: Problem, point: Point) -> Array:
    """Predicted angle, velocity and motor torque (T, n, 3) of a point; see `Problem.motion`."""
    return problem.motion(point.parameters, point.switches, point.rigid, point.starts)


@dataclass(frozen=True, eq=False)
class Whitener:
    """Prediction-error filters per joint (n, order + 1), leading coefficient 1, and the mask of usable samples."""

    coefficients: Array
    mask: np.ndarray

    @cached_property
    def rows(self) -> np.ndarray:
        """Indices of the usable samples."""
        return np.flatnonzero(self.mask)

    def __call__(self, error: Array) -> Array:
        """Innovations of errors (..., T, n), stacked over joints: (..., N n)."""
        parts = []
        for j, filter_ in enumerate(self.coefficients):
            flat = np.ascontiguousarray(error[..., j]).reshape(-1, error.shape[-2])
            if 4 * len(self.rows) < flat.shape[1]:
                y = filter_at(flat, filter_, self.rows)
            else:
                y = prediction_filter(flat, filter_)[:, self.mask]
            parts.append(y.reshape(*error.shape[:-2], -1))
        return np.concatenate(parts, axis=-1)


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
    mask = problem.used.copy()
    for start, stop in zip(problem.bounds[:-1], problem.bounds[1:], strict=True):
        first = start + int(np.argmax(problem.used[start:stop]))
        mask[first : first + memory] = False
        kept = np.zeros(stop - start, dtype=bool)
        kept[::every] = True
        mask[start:stop] &= kept
    limited = without_lines(problem, error) if every == 1 else prediction_filter(np.ascontiguousarray(error.T), band).T
    rows = np.flatnonzero(mask)
    rows = rows[:: len(rows) // 40_000 + 1]
    filters = np.zeros((problem.joints, memory + 1))
    for j in range(problem.joints):
        lagged = np.stack([limited[rows, j], *_lagged(limited[:, j], rows, blocks, every)])
        gram = lagged @ lagged.T
        ridge = 1e-12 * np.trace(gram[1:, 1:]) / len(blocks) + 1e-300
        solution = np.linalg.solve(gram[1:, 1:] + ridge * np.eye(len(blocks)), gram[1:, 0])
        sparse = np.zeros(order * every + 1)
        sparse[0] = 1.0
        for (first, last), value in zip(blocks, solution, strict=True):
            sparse[first * every : (last - 1) * every + 1 : every] = -value / (last - first)
        filters[j] = np.convolve(sparse, band)
    return Whitener(filters, mask)


def band_filter(problem: Problem) -> Array:
    """Window filter that limits the errors to the band in which they are compared."""
    every = problem.decimation
    return np.ones(1) if every == 1 else firwin(6 * every + 1, 0.8 / every)


def plain(problem: Problem, fitted: Fitted) -> Fitted:
    """The same model with its errors as they are: a filter that may have taken a missing effect for noise is put aside.

    What the nominal parameters can explain of them to first order is taken away.
    """
    band = np.tile(band_filter(problem), (problem.joints, 1))
    view = finish(problem, fitted.point, fitted.error, Whitener(band, fitted.whitener.mask), fitted.iterations)
    scale = weights(view.innovation, problem.joints)
    scaled = view.innovation * scale
    left = scaled - project(view.jacobian, scaled)[0] @ view.jacobian
    again = weights(left / scale, problem.joints)
    return replace(view, innovation=left / scale, jacobian=view.jacobian / scale * again, filtered=False)


LAGS = 60
"""Lags of the sandwich's kernel [samples]."""
LINE = 30.0
"""Power of a spectral line over the median around it: white noise reaches that once in 1e5 spectra."""
LINES = 6
"""Lines sought per log."""


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


@dataclass(frozen=True, eq=False)
class Fitted:
    """Outcome of a fit: model, errors (T, n), innovations (N n,), their mean squares per joint, covariance.

    filtered: whether the innovations are meant to be white.
    """

    point: Point
    error: Array
    innovation: Array
    whitener: Whitener
    covariance: Array
    jacobian: Array
    iterations: int
    floor: Array
    credible: bool = True
    filtered: bool = True

    @property
    def samples(self) -> int:
        return self.innovation.size

    @property
    def variances(self) -> Array:
        """Mean square innovation per joint (n,)."""
        return np.mean(self.innovation.reshape(len(self.whitener.coefficients), -1) ** 2, axis=1)

    @property
    def criterion(self) -> float:
        """-2 log likelihood up to a constant: sum over joints of N ln(mean square innovation + floor).

        What is known of parameters beforehand is part of it.
        """
        if not self.credible:
            return np.inf
        count = self.samples // len(self.variances)
        known = sum(
            ((x - f.centre) / f.deviation) ** 2 for f, x in zip(self.point.free, self.point.vector, strict=True)
        )
        return float(count * np.sum(np.log(self.variances + self.floor)) + known)

    @property
    def total(self) -> float:
        """Sum of squares of the innovations, each over its joint's rms, with the floor added."""
        count = self.samples // len(self.variances)
        return float(count * np.sum(1.0 + self.floor / np.maximum(self.variances, 1e-300)))

    def standard_error(self, name: str) -> float:
        i = [f.name for f in self.point.free].index(name)
        return float(np.sqrt(max(self.covariance[i, i], 0.0)))


def sensitivities(problem: Problem, point: Point, error: Array, step: float = 1e-3, first: int = 0) -> Array:
    """Derivative (P, T, n) of the prediction error with respect to the free parameters, by forward differences.

    Parameters that live in different logs are perturbed together, since they cannot touch the same samples. Those
    before `first` are left out: (P - first, T, n).
    """
    groups: dict[tuple, list[int]] = {}
    for i, f in enumerate(point.free):
        if i < first:
            continue
        key = (f.kind, f.joint, f.column) if f.log >= 0 else (f.kind, f.joint, f.column, i)
        groups.setdefault(key, []).append(i)
    vector = point.vector
    steps = np.array([step * f.scale for f in point.free])
    steps = np.where(vector + steps > np.array([f.upper for f in point.free]), -steps, steps)
    moved = []
    for members in groups.values():
        shifted = vector.copy()
        shifted[members] += steps[members]
        moved.append(point.at(shifted))
    out = errors(problem, moved) - error
    result = np.zeros((len(vector) - first, *error.shape))
    for difference, members in zip(out, groups.values(), strict=True):
        for i in members:
            f = point.free[i]
            where = slice(None) if f.log < 0 else slice(problem.bounds[f.log], problem.bounds[f.log + 1])
            result[i - first, where] = difference[where] / steps[i]
    return result


def weights(innovation: Array, joints: int) -> Array:
    """One over the rms innovation of each joint, repeated per sample: joints with different units weigh alike."""
    rms = np.sqrt(np.mean(innovation.reshape(joints, -1) ** 2, axis=1))
    return np.repeat(1.0 / np.maximum(rms, 1e-300), innovation.size // joints)


def fit(
    problem: Problem,
    point: Point,
    filter_: Whitener | None = None,
    *,
    rounds: int = 2,
    iterations: int = 6,
    tolerance: float = 1e-5,
    known: Array | None = None,
    renewed: bool = True,
) -> Fitted:
    """Levenberg-Marquardt on the innovations; the whitening filter is renewed between rounds and, if `renewed`, after.

    Sensitivities serve for several steps, as long as these get on; iterations: how often a round computes them.
    tolerance: relative decrease of the mean square below which a round ends. known: whitened sensitivities (K, N n) of
    the first K parameters, taken for constant, in a fit of one round that only has to tell hypotheses apart.
    """
    error = errors(problem, [point])[0]
    lower = np.array([f.lower for f in point.free])
    upper = np.array([f.upper for f in point.free])
    centre = np.array([f.centre for f in point.free])
    certainty = np.array([f.deviation for f in point.free]) ** -2.0
    first = 0 if known is None else len(known)
    damping, count, age = 1e-3, 0, 0
    slopes: Array | None = None  # taken `age` steps ago
    filter_ = filter_ or whitener(problem, error)
    for turn in range(rounds):
        if turn:
            filter_ = whitener(problem, error)
        left, jacobian = iterations, None
        for _ in range(ATTEMPTS * iterations):
            if slopes is None or age >= REUSED:
                if not left:
                    break
                slopes, jacobian = sensitivities(problem, point, error, first=first), None
                age, left, count = 0, left - 1, count + 1
            if jacobian is None:
                jacobian = _jacobian(filter_, slopes, known)
            innovation = filter_(error)
            scale = weights(innovation, problem.joints)
            away = point.vector - centre
            base = float(np.sum((innovation * scale) ** 2) + away**2 @ certainty)
            scaled = jacobian * scale
            gram = scaled @ scaled.T + np.diag(certainty)
            gradient = scaled @ (innovation * scale) + certainty * away
            if not (np.all(np.isfinite(gram)) and np.all(np.isfinite(gradient)) and np.max(np.diag(gram)) > 0.0):
                break
            diagonal = np.maximum(np.diag(gram), 1e-30 * max(np.max(np.diag(gram)), 1e-300))
            root = np.sqrt(diagonal)
            trials = []
            for factor in (damping * 0.1, damping * 100.0):
                matrix = gram + factor * np.diag(diagonal)
                step = np.linalg.lstsq(matrix / np.outer(root, root), -gradient / root, rcond=1e-13)[0]
                vector = np.clip(point.vector + step / root, lower, upper)
                trials.append((factor, point.at(vector)))
            outcomes = errors(problem, [trial for _, trial in trials])
            costs = [
                float(np.sum((filter_(outcome) * scale) ** 2) + (trial.vector - centre) ** 2 @ certainty)
                if problem.credible(outcome)
                else np.inf
                for outcome, (_, trial) in zip(outcomes, trials, strict=True)
            ]
            best = int(np.argmin(costs))
            if not costs[best] < base:
                if age:
                    age = REUSED
                    continue
                if damping >= 1e3:
                    break
                damping *= 1e4
                continue
            damping = max(trials[best][0], 1e-7)
            point, error = trials[best][1], outcomes[best]
            age += 1
            if costs[best] > base * (1.0 - tolerance):
                if (
                    age == 1 or turn < rounds - 1
                ):  # by the sensitivities of the point itself, or soon to be filtered anew
                    break
                age = REUSED
    if renewed:
        filter_ = whitener(problem, error)
    return finish(problem, point, error, filter_, count, known, slopes if age <= 1 else None)


REUSED = 4
"""Steps that may be taken by the same sensitivities."""
ATTEMPTS = 4
"""Steps per computation of sensitivities that a fit may try on average."""


def _jacobian(filter_: Whitener, slopes: Array, known: Array | None) -> Array:
    """Whitened sensitivities (P, N n) of the known parameters and of the others, (P - K, T, n)."""
    return filter_(slopes) if known is None else np.vstack([known, filter_(slopes)])


def finish(
    problem: Problem,
    point: Point,
    error: Array,
    filter_: Whitener,
    count: int = 0,
    known: Array | None = None,
    slopes: Array | None = None,
) -> Fitted:
    """Innovations, sensitivities and covariance at a point; slopes: sensitivities that are good enough, if any."""
    innovation = filter_(error)
    scale = weights(innovation, problem.joints)
    if slopes is None:
        slopes = sensitivities(problem, point, error, first=0 if known is None else len(known))
    jacobian = _jacobian(filter_, slopes, known) * scale
    gram = jacobian @ jacobian.T + np.diag([f.deviation**-2.0 for f in point.free])
    diagonal = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    if np.all(np.isfinite(gram)):
        covariance = np.linalg.pinv(gram / np.outer(diagonal, diagonal), rcond=1e-14) / np.outer(diagonal, diagonal)
    else:  # a model that runs away determines nothing
        jacobian, covariance = np.zeros_like(jacobian), np.diag(np.full(len(gram), np.inf))
    return Fitted(
        point,
        error,
        innovation,
        filter_,
        covariance,
        jacobian,
        count,
        rounding_floor(problem, filter_),
        problem.credible(error),
    )


def rounding_floor(problem: Problem, filter_: Whitener) -> Array:
    """A quarter of the variance that white rounding of the encoder would have behind the filter, per joint (n,).

    A joint that rests within one step of its encoder is predicted perfectly; such samples must not count as evidence.
    """
    return np.full(len(filter_.coefficients), 0.25 * problem.encoder_step**2 / 12.0)


def covariance(fitted: Fitted) -> Array:
    """Covariance (P, P) of the free parameters: inverse information, widened where the sandwich is wider.

    With scores s_k = j_k e_k (Jacobian times innovation) the sandwich is ``C (sum_l w_l sum_k s_k s_{k+l}') C``,
    Bartlett weights w over LAGS samples.
    """
    n = len(fitted.whitener.coefficients)
    scores = fitted.jacobian * (fitted.innovation * weights(fitted.innovation, n))
    length = scores.shape[1]
    # Bartlett weights are a triangle, the autocorrelation of a box: running sums of LAGS scores give the same matrix
    running = np.cumsum(np.pad(scores, ((0, 0), (LAGS, 0))), axis=1)
    blocks = running[:, LAGS:] - running[:, :length]
    meat = blocks @ blocks.T / LAGS
    sandwich = fitted.covariance @ meat @ fitted.covariance
    plain = np.diag(fitted.covariance)
    wider = np.sqrt(np.maximum(np.diag(sandwich) / np.maximum(plain, 1e-300), 1.0))
    return fitted.covariance * np.outer(wider, wider)


def project(basis: Array, target: Array) -> tuple[Array, float]:
    """Least-squares coefficients of target (N,) on basis (K, N) and the decrease of the sum of squares."""
    gram = basis @ basis.T
    diagonal = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    right = basis @ target
    try:
        factor = cho_factor(gram / np.outer(diagonal, diagonal) + 1e-10 * np.eye(len(gram)))
        coefficients = cho_solve(factor, right / diagonal) / diagonal
    except np.linalg.LinAlgError:
        coefficients = np.linalg.lstsq(gram, right, rcond=1e-10)[0]
    return coefficients, float(right @ coefficients)
