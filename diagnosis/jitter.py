"""Jitter of the sampling instants, found by the law of the scatter that it leaves.

An error d of the instant makes an error ``q' d`` of the reading. Behind the whitening filter A the variance of the
innovations is then

    s_k^2 = a + c m_k + rms^2 V_k,   V = g^2 * q'^2,   g = A * h

where h is what an error of one reading makes of the prediction errors: the model follows the readings with a leak l,
so that ``h = 1, -l dt, -l dt (1 - l dt), ...``. ``g^2 *`` is a convolution with the squared coefficients of both (that
is near 1 where readings are all that is noisy), a stands for noise that does not depend on the motion and m_k for the
rounding of the encoder, which scatters only while the joint moves by more than a step per sample. Each log has an a and
a c of its own: a noisy log in which the joint moves faster than in a quiet one shows no jitter. Gaussian likelihoods
with and without V decide, and, where the scatter has longer tails than a Gaussian, how far rms^2 stands out of its
robust (sandwich) deviation. Scatter that follows the acceleration or the torque at least as well is not called jitter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from diagnosis.estimation import Fitted, predicted_motion
from diagnosis.instants import log_of
from diagnosis.problem import Problem
from envs.log import Array
from methods.filters import prediction_filter

LEAST = 1e-6
"""Least variance of a sample, as a share of the mean."""
FAR_OUT = 5.0
"""Deviations by any of the laws beyond which a sample says nothing of them: where dry friction catches the joint, the
instant of one reading makes the errors of many."""
SCORED, HALVED = 50, 20
"""Most steps of Fisher scoring, and how often one is halved."""


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
    if not np.any(square):
        return None
    motion = predicted_motion(problem, fitted.point)[:, joint]
    velocity, torque = motion[:, 1], motion[:, 2]
    acceleration = np.diff(velocity, prepend=velocity[:1])
    moving = np.minimum(np.abs(velocity) * problem.sample_time / max(problem.encoder_step, 1e-300), 1.0)
    response = reading_response(problem, fitted, joint)
    own = log_of(problem, fitted.whitener) == np.arange(problem.logs)[:, None]
    plain = [*own.astype(float), *(own * _scatter(moving, response)[rows])]
    signals = (("velocity", velocity), ("acceleration", acceleration), ("torque", torque))
    laws = {name: np.stack([*plain, _scatter(signal**2, response)[rows]]) for name, signal in signals}
    laws["nothing"] = np.stack(plain)
    within = np.all([square < FAR_OUT**2 * (fitted_scatter(law, square)[1] @ law) for law in laws.values()], axis=0)
    found = {name: fitted_scatter(law[:, within], square[within]) for name, law in laws.items()}
    without, best = found.pop("nothing"), min(found.values(), key=lambda item: item[0])
    deviance, coefficients, deviations = found["velocity"]
    if deviance > best[0] + 1e-9 or coefficients[-1] <= 0.0:
        return None
    law = laws["velocity"]
    within = square < FAR_OUT**2 * (coefficients @ law)  # beyond a scatter that is the same always what is fast may be
    _, coefficients, deviations = fitted_scatter(law[:, within], square[within])
    if coefficients[-1] <= 0.0:
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


def fitted_scatter(laws: Array, square: Array) -> tuple[float, Array, Array]:
    """-2 log likelihood, coefficients (K,) >= 0 and their deviations for variances that are linear in laws (K, N).

    The deviations are those of the sandwich, which hold whatever the law of the scatter; a coefficient that the limit
    holds at zero has none and says nothing about those of the others.
    """
    mean = float(np.mean(square))
    scale = (np.mean(laws, axis=1, keepdims=True) + 1e-300) / mean
    columns = laws / scale
    n, count = len(square), len(columns)

    def variance_of(x: Array) -> Array:
        return np.asarray(np.maximum(x @ columns, LEAST * mean))

    def deviance(x: Array) -> float:
        variance = variance_of(x)
        return float(np.mean(np.log(variance) + square / variance))

    x = np.full(count, 1.0 / count)
    reached = deviance(x)
    for _ in range(SCORED):  # Fisher scoring: squares have a deviation in proportion to their variance
        variance = variance_of(x)
        root = np.linalg.qr((columns / variance).T)
        step = nnls(root.R, root.Q.T @ (square / variance), maxiter=SCORED * count)[0] - x
        tried = ((deviance(other), other) for other in (x + 0.5**k * step for k in range(HALVED)))
        lower = next((item for item in tried if item[0] < reached), None)
        if lower is None or lower[0] > reached - 1e-9:
            break
        reached, x = lower
    variance = variance_of(x)
    inside = x > 0.0
    weighted = columns[inside] / variance
    size = np.linalg.norm(weighted, axis=1)  # where a joint rests nearly always, those of the laws differ by decades
    weighted = weighted / (size[:, None] + 1e-300)
    inner = np.linalg.pinv(weighted @ weighted.T / 2.0, rcond=1e-6, hermitian=True)
    scores = weighted * (square / variance - 1.0) / 2.0
    deviations = np.zeros(count)
    deviations[inside] = np.sqrt(np.maximum(np.diag(inner @ (scores @ scores.T) @ inner), 0.0)) / (size + 1e-300)
    return n * reached, x / scale[:, 0], deviations / scale[:, 0]
