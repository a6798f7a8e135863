"""Jitter of the sampling instants, found by the law of the scatter that it leaves.

An error d of the instant makes an error ``q' d`` of the reading. Behind the whitening filter A the variance of the
innovations is then

    s_k^2 = a + c m_k + rms^2 V_k,   V = g^2 * q'^2,   g = A * h

where h is what an error of one reading makes of the prediction errors: the model follows the readings with a leak l,
so that ``h = 1, -l dt, -l dt (1 - l dt), ...``. ``g^2 *`` is a convolution with the squared coefficients of both (that
is near 1 where readings are all that is noisy), a stands for noise that does not depend on the motion and m_k for the
rounding of the encoder, which scatters only while the joint moves by more than a step per sample. Gaussian likelihoods
with and without V decide, and, where the scatter has longer tails than a Gaussian, how far rms^2 stands out of its
robust (sandwich) deviation. Scatter that follows the acceleration or the torque at least as well is not called jitter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.estimation import Fitted, predicted_motion
from diagnosis.problem import Problem
from envs.log import Array
from methods.filters import prediction_filter

ROUNDS = 30


@dataclass(frozen=True)
class Jitter:
    """Rms of the instants' error [s] with its standard deviation, and the decrease of -2 log likelihood by it."""

    rms: float
    deviation: float
    decrease: float


def jitter(problem: Problem, fitted: Fitted, joint: int) -> Jitter | None:
    """The jitter that the scatter of the innovations shows, or None where another law of the scatter does as well."""
    rows = fitted.whitener.rows
    square = fitted.innovation.reshape(problem.joints, -1)[joint] ** 2
    motion = predicted_motion(problem, fitted.point)[:, joint]
    velocity, torque = motion[:, 1], motion[:, 2]
    acceleration = np.diff(velocity, prepend=velocity[:1])
    moving = np.minimum(np.abs(velocity) * problem.sample_time / max(problem.encoder_step, 1e-300), 1.0)
    response = reading_response(problem, fitted, joint)
    plain = [np.ones(len(rows)), _scatter(moving, response)[rows]]
    without = _likelihood(np.stack(plain), square)
    laws = {
        name: _scatter(signal**2, response)[rows]
        for name, signal in (("velocity", velocity), ("acceleration", acceleration), ("torque", torque))
    }
    found = {name: _likelihood(np.stack([*plain, law]), square) for name, law in laws.items()}
    best = min(found.values(), key=lambda item: item[0])
    deviance, coefficients, deviations = found["velocity"]
    if deviance > best[0] + 1e-9 or coefficients[-1] <= 0.0:
        return None
    rms = float(np.sqrt(coefficients[-1]))
    robust = float((coefficients[-1] / max(deviations[-1], 1e-300)) ** 2)
    return Jitter(rms, float(deviations[-1]) / (2.0 * rms), min(without[0] - deviance, robust))


def reading_response(problem: Problem, fitted: Fitted, joint: int) -> Array:
    """What an error of one reading makes of the innovations from its own sample on (K,)."""
    coefficients = fitted.whitener.coefficients[joint]
    pull = problem.leak * problem.sample_time
    errors = np.concatenate([[1.0], -pull * (1.0 - pull) ** np.arange(len(coefficients) - 1)])
    return np.asarray(np.convolve(coefficients, errors)[: len(coefficients)])


def _scatter(power: Array, response: Array) -> Array:
    """Variance (T,) of the innovations by white noise of that variance (T,) in the readings."""
    return prediction_filter(np.ascontiguousarray(power[None]), response**2)[0]


def _likelihood(laws: Array, square: Array) -> tuple[float, Array, Array]:
    """-2 log likelihood, coefficients (K,) >= 0 and their deviations for variances that are linear in laws (K, N).

    Scoring for a gamma law with identity link; every coefficient is kept at zero or above. The deviations are those of
    the sandwich, which hold whatever the law of the scatter.
    """
    scale = np.mean(laws, axis=1, keepdims=True) + 1e-300
    columns = laws / scale
    mean = float(np.mean(square))
    x = np.full(len(columns), mean / len(columns))
    information = np.eye(len(columns))
    for _ in range(ROUNDS):
        variance = np.maximum(x @ columns, 1e-6 * mean)
        weighted = columns / variance
        information = weighted @ weighted.T / 2.0
        step = np.linalg.lstsq(information, weighted @ (square / variance - 1.0) / 2.0, rcond=1e-10)[0]
        new = np.maximum(x + step, 0.0)
        if np.max(np.abs(new - x)) < 1e-8 * mean:
            break
        x = new
    variance = np.maximum(x @ columns, 1e-6 * mean)
    deviance = float(np.sum(np.log(variance) + square / variance))
    inner, scores = np.linalg.pinv(information), columns / variance * (square / variance - 1.0) / 2.0
    deviations = np.sqrt(np.maximum(np.diag(inner @ (scores @ scores.T) @ inner), 0.0))
    return deviance, x / scale[:, 0], deviations / scale[:, 0]
