"""A fit as a linear regression sees it: what a change of the model would explain, to first order and without a fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from diagnosis.estimation import Fitted, Point
from diagnosis.problem import Problem
from diagnosis.projection import solve
from diagnosis.whitening import Absorption, absorption
from envs.log import Array


@dataclass(frozen=True, eq=False)
class View:
    """A fit as a regression sees it: residuals (n, R) and sensitivities of its parameters (n, P, R) at some samples.

    Where the filter is an autoregression that every hypothesis has anew, what it would take away is left out.
    Parameters that press against a bound stay there.
    certainty, expected (P,): what is known beforehand of changes of the parameters, one over the variance and the mean.
    """

    fitted: Fitted
    noise: Array
    taken: Absorption | None
    residual: Array
    jacobian: Array
    certainty: Array
    expected: Array

    @classmethod
    def of(cls, problem: Problem, fitted: Fitted) -> View:
        """The view of a fit, its errors being those of the fit."""
        noise = fitted.weights
        point = fitted.point
        certainty = point.certainty
        expected = np.array([f.centre for f in point.free]) - point.vector
        residual = fitted.innovation * noise
        held = _pressing(point, fitted.jacobian @ residual)
        jacobian = np.where(held[:, None], 0.0, fitted.jacobian)
        plain = cls(fitted, noise, None, residual, jacobian, certainty, expected)
        if not fitted.filtered or fitted.whitener.solution is None:
            return plain
        taken = absorption(problem, fitted.error, fitted.whitener)
        residual = taken.samples(plain.residual[None])[:, 0].ravel()
        jacobian = _flat(taken.left(taken.samples(plain.jacobian)))
        share = len(residual) / len(noise)
        return replace(plain, taken=taken, residual=residual, jacobian=jacobian, certainty=share * certainty)

    @cached_property
    def gram(self) -> Array:
        """Products (P, P) of the sensitivities of the fit's own parameters."""
        return self.jacobian @ self.jacobian.T

    def sensitivities(self, difference: Array) -> Array:
        """Differences of errors (A, T, n) as rows of the regression."""
        rows = self.fitted.whitener(difference) * self.noise
        return rows if self.taken is None else _flat(self.taken.left(self.taken.samples(rows)))

    def least(self, sensitivity: Array, changed: Array) -> tuple[Array, Array, Array]:
        """Changes of the parameters (P,) and of further ones (A,) with sensitivities (A, n R) after which least is left
        of changed residuals (n R,), and what is left."""
        unknown = np.zeros(len(sensitivity))
        certainty, expected = (np.concatenate([own, unknown]) for own in (self.certainty, self.expected))
        across = self.jacobian @ sensitivity.T
        gram = np.block([[self.gram, across], [across.T, sensitivity @ sensitivity.T]])
        right = np.concatenate([self.jacobian @ changed, sensitivity @ changed])
        change = solve(gram, -right, certainty, expected)[0]
        shift, own = np.split(change, [len(self.jacobian)])
        return shift, own, changed + shift @ self.jacobian + own @ sensitivity

    def promise(self, problem: Problem, left: Array) -> float:
        """Decrease of -2 log likelihood that residuals (R n,) in units of the view's rms stand for."""
        gained = (float(self.residual @ self.residual) - float(left @ left)) / left.size
        count = self.fitted.samples if self.fitted.filtered else effective_samples(left, problem.joints)
        share = gained * self.fitted.samples / self.fitted.total
        return float(-count * np.log(max(1.0 - share, 1e-12)))


def _pressing(point: Point, gradient: Array) -> np.ndarray:
    """Which parameters (P,) are at a bound that the gradient (P,) of the squared residuals presses them against."""
    lower, upper, scale = (np.array([getattr(f, name) for f in point.free]) for name in ("lower", "upper", "scale"))
    below, above = (np.abs(point.vector - bound) <= 1e-6 * scale for bound in (lower, upper))
    return (below & (gradient > 0.0)) | (above & (gradient < 0.0))


def _flat(parts: Array) -> Array:
    """Signals (n, P, R) as rows (P, n R)."""
    return np.concatenate(list(parts), axis=1)


def effective_samples(residual: Array, joints: int) -> float:
    """Number of independent samples that residuals (N n,) are worth: all of them when they are white.

    The autocorrelations r count as long as they stay positive: N / (1 + 2 sum r).
    """
    total = 0.0
    for own in residual.reshape(joints, -1):
        length = next_fast_len(2 * len(own), real=True)
        correlation = irfft(np.abs(rfft(own, length)) ** 2, length)[: len(own) // 2]
        correlation = correlation[1:] / max(correlation[0], 1e-300)
        negative = np.flatnonzero(correlation < 0.0)
        end = negative[0] if len(negative) else len(correlation)
        total += len(own) / (1.0 + 2.0 * float(np.sum(correlation[:end])))
    return total
