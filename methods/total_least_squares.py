"""Total least squares with the known shape of the noise: the regressor's columns are noisy too.

The derivatives of a noisy position carry noise whose covariance is known up to the encoder's variance s^2: columns
d^i q and d^j q of one row share s^2 h_i . h_j for the kernels h of the differentiator. With C that covariance, bordered
by the variance of the command's error, the estimate is the generalised eigenvector

    [Y v]'[Y v] x = lambda C x,   a = -x_Y / x_v      for the smallest lambda,

after the columns without noise (constant, friction, gravity) have been projected out (S. Van Huffel, J. Vandewalle,
SIAM J. Matrix Anal. Appl. 10 (1989) 294; M. Gautier, P. Vandanjon, C. Presse, CDC 1994, for robots).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eigh

from envs.log import Array, Log
from envs.log_statistics import position_noise
from methods.differentiation import BandLimited
from methods.joint_regression import Equations, JointRegression, Preparation
from methods.least_squares import long_run_scatter, solve
from methods.registry import METHODS
from methods.regressor import ColumnName

NOISY: dict[ColumnName, int] = {"velocity": 1, "acceleration": 2, "jerk": 3}
"""Columns that carry the encoder's noise, and the order of their derivative."""


@METHODS.register("total_least_squares", "single-joint", "physics")
@dataclass(frozen=True)
class TotalLeastSquares(JointRegression):
    """The preparation keeps more noise than least squares can afford: it is accounted for."""

    preparation: Preparation = field(default_factory=lambda: Preparation(attenuation=2e-3))

    def noise(self, logs: Sequence[Log], equations: Equations) -> Array:
        """Covariance of one row's columns, the mean of the logs, (p, p) [column units]; zero without noise."""
        size = len(equations.columns)
        total = np.zeros((size, size))
        for number, log in enumerate(logs):
            filter_ = BandLimited(equations.bandwidth)
            kernels = np.zeros((size, 2 * filter_.half_width(log.sample_time) + 1))
            for k, name in enumerate(equations.columns):
                if name in NOISY:
                    kernels[k] = filter_.kernel(NOISY[name], log.sample_time)
            total += np.mean(equations.logs == number) * position_noise(log.position[:, 0]) ** 2 * kernels @ kernels.T
        return total

    def solve(self, equations: Equations) -> tuple[Array, Array, tuple[str, ...]]:
        covariance = self.noise(equations.sources, equations)
        noisy = np.array([name in NOISY for name in equations.columns])
        exact = equations.regressor[:, ~noisy]
        scale = np.linalg.norm(equations.regressor[:, noisy], axis=0) / np.sqrt(len(equations.command))
        basis = np.linalg.qr(exact)[0] if exact.size else np.zeros((len(equations.command), 0))
        joined = np.column_stack((equations.regressor[:, noisy] / scale, equations.command))
        joined = joined - basis @ (basis.T @ joined)
        start = np.linalg.lstsq(joined[:, :-1], joined[:, -1], rcond=None)[0]
        shape = np.zeros((len(scale) + 1, len(scale) + 1))
        shape[:-1, :-1] = covariance[np.ix_(noisy, noisy)] / np.outer(scale, scale)
        unexplained = float(np.mean((joined[:, -1] - joined[:, :-1] @ start) ** 2)) - start @ shape[:-1, :-1] @ start
        shape[-1, -1] = max(unexplained, 1e-12 * float(np.mean(equations.command**2)))
        shape[np.diag_indices(len(scale))] += 1e-14
        gram = joined.T @ joined / len(joined)
        vector = eigh(gram, shape, subset_by_index=[0, 0])[1][:, 0]
        values = np.empty(len(noisy))
        values[noisy] = -vector[:-1] / vector[-1] / scale
        left = equations.command - equations.regressor[:, noisy] @ values[noisy]
        values[~noisy] = np.linalg.lstsq(exact, left, rcond=None)[0]
        return values, self._covariance(equations, values, covariance), ()

    def _covariance(self, equations: Equations, values: Array, noise: Array) -> Array:
        """Sandwich around the gram matrix less its noise; that of least squares where nothing would remain."""
        residuals = equations.command - equations.regressor @ values
        scale = np.linalg.norm(equations.regressor, axis=0)
        scaled = equations.regressor / scale
        gram = scaled.T @ scaled - len(residuals) * noise / np.outer(scale, scale)
        if np.linalg.eigvalsh(gram)[0] <= 0.0:
            return solve(equations.regressor, equations.command)[1]
        bread = np.linalg.inv(gram)
        scatter = long_run_scatter(scaled * residuals[:, None], residuals)
        return bread @ scatter @ bread / np.outer(scale, scale)
