"""A fitted model on logs that it has not seen: input-equivalent residual, free simulation in windows, noise floor.

Windows begin in the state of the leaking observer, corrected by what the measurement says of angle and velocity there;
states without a sensor (winding, lag, temperature, load side, bristles) are those of the observer.
"""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter, resample, savgol_filter

from diagnosis.estimation import Fitted, Point
from diagnosis.problem import NEVER, Problem, bounded, smooth_derivatives
from diagnosis.whitening import Whitener
from envs.log import Array
from methods.kernel import DAMPING, NOMINAL, STATES
from methods.two_layer_network import TwoLayerNetwork, pack

WINDOW = 1.0
"""Length of the windows of free simulation [s]."""
CORRECTION = 0.1
"""Length of the smoothing that estimates the state at the beginning of a window [s]."""
LONGEST = 12_000
"""Samples of a stretch at most."""
DRAWS = 4
"""Recordings that a model imitates."""
SMOOTHING = 0.03
"""Length of the smoothing of the input-equivalent residual [s]."""


@dataclass(frozen=True, eq=False)
class Replay:
    """One model on one problem's logs.

    prediction: error with the leak, (T, n). motion: angle, velocity, motor torque of that simulation, (T, n, 3).
    windows: error of free simulation, (T, n), NaN outside of windows.
    whole: the same from the end of the burn-in to the end of each log. microseconds: of one simulated sample.
    """

    prediction: Array
    windows: Array
    whole: Array
    motion: Array
    microseconds: float


def window_width(seconds: float, sample_time: float) -> int:
    """Samples of a window of free simulation."""
    return max(8, round(seconds / sample_time))


def transfer(problem: Problem, point: Point) -> Point:
    """A point fitted on other logs, made ready for these: what holds for all logs stays, initial states are new.

    An event of one of the fitted logs only (its amplitudes are zero in the others) is not due in these until an instant
    is found for it; what else is free in every log is that of the first.
    """
    parameters, kernel = np.repeat(point.parameters[:1], problem.logs, axis=0), problem.kernel
    for effect in (effect for effect in kernel.effects if effect.scan == "event"):
        amplitudes = [kernel.offsets[effect.name] + a for a in effect.amplitudes]
        for j in np.flatnonzero(point.switches[:, kernel.switches[effect.name]]):
            happens = np.any(point.parameters[:, j, amplitudes], axis=1)
            if not np.all(happens):
                parameters[:, j, kernel.own(effect)] = point.parameters[np.argmax(happens), j, kernel.own(effect)]
                parameters[:, j, kernel.column(effect, "time")] = NEVER * problem.longest
    return replace(point, parameters=parameters, starts=problem.starts.copy(), free=())


def replay(
    problem: Problem, point: Point, window: float = 1.0, compensators: Sequence[TwoLayerNetwork | None] = ()
) -> Replay:
    """Simulate a point on the logs of a problem: with the leak, freely in windows [s], and freely as a whole.

    compensators: one network of angle and velocity per joint, or None; its output resists, held over each sample.
    """
    module, n, advance = problem.kernel.module, problem.joints, problem.kernel.module.advance
    if any(compensators):
        advance = partial(module.compensated, pack(compensators))
    shape, none = problem.reading.shape, np.zeros((0, n, 3))
    prediction, moved = np.zeros(shape), np.zeros((*shape, 3))
    windows, whole = np.full(shape, np.nan), np.full(shape, np.nan)
    simulated, seconds = 0, 0.0
    for log, (a, b) in enumerate(pairwise(problem.bounds)):
        count = b - a
        first = int(np.searchsorted(problem.time[a:b] - problem.time[a], problem.burn_in))
        width = window_width(window, problem.sample_time)
        begins = [*range(first, count - width + 1, width)] or [first]

        signals, model, (states, bristles) = begun(problem, point, log, problem.reading)
        inputs = (*signals, np.zeros((count if any(compensators) else 0, n)))
        pull, free = (problem.leak, problem.rate_leak, problem.substeps), (0.0, 0.0, problem.substeps)
        motion, held = np.zeros((count, n, 3)), []
        at = 0
        for begin in (*begins, count):
            advance(at, begin, *inputs, states, bristles, *model, *pull, prediction[a:b], motion)
            held.append((states.copy(), bristles.copy()))
            at = begin
        moved[a:b] = motion
        shift = corrections(problem, bounded(prediction[a:b]))
        started = clock.perf_counter()
        scratch = np.zeros((count, n))
        for begin, state in zip(begins, held, strict=False):
            stop = min(begin + width, count)
            advance(begin, stop, *inputs, *corrected(problem, point, state, shift[begin]), *model, *free, scratch, none)
            windows[a:b][begin:stop] = bounded(scratch[begin:stop])
        seconds += clock.perf_counter() - started
        simulated += len(begins) * width
        advance(first, count, *inputs, *corrected(problem, point, held[0], shift[first]), *model, *free, scratch, none)
        whole[a:b][first:] = bounded(scratch[first:])
    return Replay(prediction, windows, whole, moved, 1e6 * seconds / max(simulated, 1))


def begun(
    problem: Problem, point: Point, log: int, reading: Array
) -> tuple[tuple[Array, ...], tuple[Any, ...], tuple[Array, Array]]:
    """What the compiled simulator takes of one log: its signals (with the readings given), the model there, and the
    model's states and bristles at its beginning."""
    n, own = problem.joints, slice(problem.bounds[log], problem.bounds[log + 1])
    near = problem.neighbour[own] if len(problem.neighbour) else np.zeros((0, n, 3))
    command = problem.command[own]
    signals = (problem.instants[own], command, problem.cumulative[own], problem.hold, reading[own], near)
    states = np.zeros((n, STATES))
    problem.kernel.module.begin(point.starts[log], command[0], states, point.parameters[log], point.switches)
    return signals, (point.parameters[log], point.switches, problem.pair, point.rigid), (states, np.zeros(n))


def corrections(problem: Problem, error: Array) -> Array:
    """What to add to the observer's angle and velocity, (T, n, 2): smoothed error e, and e' + leak e."""
    smooth, rate, _ = smooth_derivatives(np.arange(len(error), dtype=float) * problem.sample_time, error, CORRECTION)
    return np.stack([smooth, rate + problem.leak * smooth], axis=-1)


def corrected(problem: Problem, point: Point, state: tuple[Array, Array], shift: Array) -> tuple[Array, Array]:
    """A copy of the observer's states with angle and velocity of the encoder's side corrected; shift (n, 2)."""
    states, bristles = state[0].copy(), state[1].copy()
    for j in range(problem.joints):
        angle, velocity = (5, 6) if problem.kernel.module._load_side(point.switches[j]) else (0, 1)
        states[j, [angle, velocity]] += shift[j]
    return states, bristles


def input_equivalent(
    problem: Problem, point: Point, error: Array, seconds: float = SMOOTHING, *, coupled: bool = False
) -> Array:
    """Prediction errors (T, n) as the command that has to be added to explain them, smoothed over `seconds`.

    With leaks L of the angle and K of the velocity, inertia J, viscous damping b, back-EMF k and the winding's lag T,
    the model's velocity errs by ``s = e' + L e`` and lacks ``J (s' + K e) + b s + k s / (T p + 1)``. J changes with an
    arm's pose, and that of the first joint of a planar pair is M11. Each joint's error is taken for its own, unless
    `coupled` asks for the whole mass matrix of a pair and the velocities' torques, as the difference of two simulations
    does; in readings that would show one encoder's noise at the other joint.
    """
    result = np.zeros_like(error)
    dt = problem.sample_time
    for log, (a, b) in enumerate(pairwise(problem.bounds)):
        e, rate, bend = smooth_derivatives(problem.time[a:b], error[a:b], max(seconds, 8 * dt))
        speed, change = rate + problem.leak * e, bend + problem.leak * rate + problem.rate_leak * e
        for j, p in enumerate(point.parameters[log]):
            inertia, viscous, arm_viscous, back_emf, lag = (
                p[NOMINAL.index(name)]
                for name in ("inertia", "viscous", "arm_viscous", "back_emf", "electrical_time_constant")
            )
            keep = np.exp(-dt / lag) if lag > 0 else 0.0
            braked = lfilter([1.0 - keep], [1.0, -keep], speed[:, j])
            if problem.arm is not None:
                sizes = p[NOMINAL.index("arm") :][: problem.arm_shapes]
                inertia = inertia + problem.neighbour[a:b, j, 3 + problem.arm_shapes :] @ sizes
            result[a:b, j] = inertia * change[:, j] + (viscous + arm_viscous) * speed[:, j] + back_emf * braked
        if problem.pair:
            coupling, ratio, shared = point.rigid
            cosine, sine = np.cos(problem.reading[a:b, 1]), np.sin(problem.reading[a:b, 1])
            result[a:b, 0] += (shared + 2.0 * coupling * cosine) * change[:, 0]
            if coupled:
                d1, d2 = smooth_derivatives(problem.time[a:b], problem.reading[a:b], max(seconds, 8 * dt))[1].T
                both = shared + coupling * cosine
                turning = d2 * speed[:, 0] + (d1 + d2) * speed[:, 1]
                result[a:b, 0] += both * change[:, 1] - 2.0 * coupling * sine * turning
                result[a:b, 1] += ratio * (both * change[:, 0] + 2.0 * coupling * sine * d1 * speed[:, 0])
    return result


def rms(error: Array) -> float:
    """Root mean square of the finite values."""
    return float(np.sqrt(np.mean(np.square(error[np.isfinite(error)]))))


def noise_floor(problem: Problem, fitted: Fitted, j: int, window: float, innovation: float, coloured: bool) -> float:
    """Window error [rad or m] that the true model would have: only noise drives it.

    Prediction errors e are drawn from the autoregressive model of the fit (`coloured`) or as white sensor noise. With
    the leak l, inertia J, damping B and stiffness K the free error is e + g in a window that starts at t0::

        g' = h + l e,  J h' = -B h - K g,  g(t0) = -q0,  h(t0) = -v0

    where q0, v0 are the corrections of the initial state. A negative B counts as nothing: another law makes up for
    it, and no motion grows by itself.
    """
    rng = np.random.default_rng(0)
    dt, width = problem.sample_time, window_width(window, problem.sample_time)
    count = max(40 * width, 20_000)
    error = rng.standard_normal(count) * innovation
    if coloured:
        error = coloured_as(fitted.whitener, j, error)
    span = min(max(7, 2 * round(0.5 * CORRECTION / dt) + 1), count // 2 * 2 - 1)
    q0 = savgol_filter(error, span, 3)
    v0 = savgol_filter(error, span, 3, deriv=1, delta=dt) + problem.leak * q0
    p = fitted.point.parameters[0, j]
    inertia, damping = p[NOMINAL.index("inertia")], max(0.0, sum(p[NOMINAL.index(name)] for name in DAMPING))
    rates = np.array([[0.0, 1.0], [-stiffness(problem, fitted.point, j) / inertia, -damping / inertia]])
    step = expm(rates * dt)
    begins = np.arange(span, count - width - span, width)
    state, total = -np.stack([q0[begins], v0[begins]]), 0.0
    for k in range(width):
        e = error[begins + k]
        total += float(np.sum((e + state[0]) ** 2))
        state = step @ state
        state[0] += problem.leak * dt * e
    return float(np.sqrt(total / (width * len(begins))))


def imitated_floor(
    problem: Problem, fitted: Fitted, spread: Array, point: Point, window: float, seconds: float = 30.0
) -> Array:
    """Window errors (n,) that a fitted model would have on the beginning of a log of its own, by simulation.

    Where dry friction holds and lets go, or joints are coupled, noise does more than in `noise_floor`; and a model that
    short logs have left uncertain errs more than its noise. Each reading is the prediction from the readings before it
    and an error drawn from the autoregression of the fit; the windows are those of models drawn from the covariance
    of its parameters, `spread`.
    """
    cut, _ = stretch(problem, seconds)
    own = replace(point, parameters=point.parameters[:1], starts=point.starts[:1])
    squares = []
    for seed in range(DRAWS):
        rng = np.random.default_rng(seed)
        artificial = imitated(cut, fitted, own, rng)
        squares.append(np.nanmean(replay(artificial, drawn(fitted, spread, own, rng), window).windows ** 2, axis=0))
    return np.asarray(np.sqrt(np.mean(squares, axis=0)))


def drawn(fitted: Fitted, spread: Array, point: Point, rng: np.random.Generator) -> Point:
    """A point with its parameters moved as uncertainly as the fit knows them, with covariance `spread`."""
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    values, axes = np.linalg.eigh(spread / np.outer(scale, scale))
    change = scale * (axes @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(scale))))
    moved = fitted.point.within(fitted.point.vector + change)
    return replace(
        point,
        parameters=point.parameters + (moved.parameters - fitted.point.parameters)[:1],
        rigid=point.rigid + moved.rigid - fitted.point.rigid,
    )


def imitated(problem: Problem, fitted: Fitted, point: Point, rng: np.random.Generator) -> Problem:
    """The problem with readings as the model would have given them to these commands with the noise of the fit."""
    n, advance = problem.joints, problem.kernel.module.advance
    reading, nobody, unused = np.zeros_like(problem.reading), np.zeros((0, n)), np.zeros((0, n, 3))
    pull = (problem.leak, problem.rate_leak, problem.substeps)
    for log, (a, b) in enumerate(pairwise(problem.bounds)):
        white = rng.standard_normal((n, b - a)) * np.sqrt(fitted.variances)[:, None]
        noise = np.stack([coloured_as(fitted.whitener, j, own) for j, own in enumerate(white)], axis=1)
        signals, model, (states, bristles) = begun(problem, point, log, reading)
        error = np.zeros((b - a, n))
        for k in range(b - a):
            advance(k, k + 1, *signals, nobody, states.copy(), bristles.copy(), *model, *pull, error, unused)
            reading[a + k] = noise[k] - error[k]  # the error of a reading of zero is what it is predicted to be
            advance(k, k + 1, *signals, nobody, states, bristles, *model, *pull, error, unused)
    return replace(problem, reading=reading)


def coloured_as(filter_: Whitener, j: int, innovations: Array) -> Array:
    """Errors (T,) of joint index j whose innovations are white with the variance of those given (T,), and periodic.

    Where errors are compared in a narrow band they are noise of that band alone: the autoregression holds there, and
    the inverse of the filter that limits the band would make what lies outside endlessly strong.
    """
    if filter_.every == 1:
        return coloured_by(filter_.coefficients[j], innovations)
    return np.asarray(resample(coloured_by(filter_.within(j), innovations[:: filter_.every]), len(innovations)))


def coloured_by(filter_: Array, white: Array) -> Array:
    """A periodic signal whose spectrum is that of white noise (T,) behind the inverse of a prediction-error filter."""
    response = np.abs(np.fft.rfft(filter_, len(white)))
    return np.asarray(np.fft.irfft(np.fft.rfft(white) / np.maximum(response, 1e-9), len(white)))


def stiffness(problem: Problem, point: Point, j: int) -> float:
    """Torque per position of gravity, a tilted axis and a cable, on average over the logs (not below zero)."""
    q = problem.reading[problem.used, j]
    p, kernel = point.parameters[0, j], problem.kernel
    sine, cosine = p[NOMINAL.index("gravity_sine")], p[NOMINAL.index("gravity_cosine")]
    spring = 0.0
    for name in ("gravity_tilt", "cable_spring", "cable_spring_stiffening"):
        if name in kernel.switches and point.switches[j, kernel.switches[name]]:
            first, second = p[kernel.offsets[name] : kernel.offsets[name] + 2]
            if name == "gravity_tilt":
                sine, cosine = sine + first, cosine + second
            else:
                spring = first
    return max(0.0, spring + float(np.mean(sine * np.cos(q) - cosine * np.sin(q))))


def stretch(problem: Problem, seconds: float) -> tuple[Problem, float]:
    """The beginning of the first log as a problem of its own, and how many times longer all logs are."""
    count = min(int(problem.bounds[1]), int(np.clip(round(seconds / problem.sample_time), 2000, LONGEST)))
    cut = replace(
        problem,
        time=problem.time[:count],
        command=problem.command[:count],
        reading=problem.reading[:count],
        neighbour=problem.neighbour[:count],
        bounds=np.array([0, count]),
        names=problem.names[:1],
        starts=problem.starts[:1],
    )
    return cut, float(problem.used.sum()) / max(float(cut.used.sum()), 1.0)


def in_blocks(error: Array, bounds: np.ndarray, width: int, *, about_mean: bool = False) -> Array:
    """Mean squares, or variances, of the finite values in blocks of `width` samples of every log, shape (blocks,)."""
    found = []
    for a, b in pairwise(bounds):
        for start in range(a, b, width):
            values = error[start : min(start + width, b)]
            values = values[np.isfinite(values)]
            if len(values) >= width // 2:
                found.append(np.var(values) if about_mean else np.mean(values**2))
    return np.array(found)
