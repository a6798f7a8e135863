"""Step 1 of the paper: least squares with the pseudo-inverse, equations (7)-(8), one joint at a time.

a = (Y'Y)^-1 Y' v. With `FiniteDifferences` it is the paper as printed; with `BandLimited` it is the inverse dynamic
identification with proper filtering (Gautier, Janot, Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013) 428).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import lstsq
from scipy.signal import decimate

from envs.log import Array, Log
from methods.base import Estimates, Fit, Method, MethodError, Status, single_joint
from methods.differentiation import BandLimited, Differentiator, Signals
from methods.joint_model import JointModel
from methods.registry import METHODS
from methods.regressor import HORIZONTAL, ColumnName, check_columns, column_unit, regressor

ILL_CONDITIONED = 1e6
"""Condition number of the scaled regressor above which the status says so."""


@METHODS.register("least_squares", "single-joint", "physics")
@dataclass(frozen=True)
class LeastSquares(Method):
    """Linear coefficients of `columns` by (7)-(8) on signals from `differentiator`.

    reversal_velocity: as a share of the largest speed in the logs, where the Coulomb column turns over.
    decimation: keep every n-th row after a zero-phase low-pass over regressor and command alike (parallel filtering).
    """

    differentiator: Differentiator = field(default_factory=BandLimited)
    columns: tuple[ColumnName, ...] = HORIZONTAL
    reversal_velocity: float = 1e-3
    decimation: int = 1

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Closed form; consumes no random numbers."""
        begin = time.perf_counter()
        problem = self.problem(logs)
        values, covariance = solve(problem.regressor, problem.command)
        facts = logs[0].facts[0]
        model = JointModel(
            joint=single_joint(logs),
            input=facts.input,
            columns=self.columns,
            coefficients=values,
            reversal_velocity=problem.reversal_velocity,
        )
        condition = condition_number(problem.regressor)
        return Fit(
            model=model,
            estimates=Estimates(
                names=self.columns,
                units=tuple(column_unit(name, facts) for name in self.columns),
                values=values,
                covariance=covariance,
            ),
            residuals=problem.command - problem.regressor @ values,
            status=Status.CONVERGED if condition < ILL_CONDITIONED else Status.ILL_CONDITIONED,
            seconds=time.perf_counter() - begin,
            notes=(f"condition number of the scaled regressor {condition:.3g}",),
        )

    def problem(self, logs: Sequence[Log]) -> LinearProblem:
        """The stacked equations of all logs. Raises MethodError for unusable logs."""
        check_columns(self.columns)
        single_joint(logs)
        signals = tuple(self.differentiator.signals(log) for log in logs)
        fastest = max(float(np.max(np.abs(part.motion.velocity))) for part in signals)
        if fastest == 0.0:
            raise MethodError("the joint never moves in these logs", remedy="Give a log in which it does")
        reversal = self.reversal_velocity * fastest
        return LinearProblem(
            signals=signals,
            regressor=np.concatenate([self._thin(regressor(part.motion, self.columns, reversal)) for part in signals]),
            command=np.concatenate([self._thin(part.command)[:, 0] for part in signals]),
            reversal_velocity=reversal,
        )

    def _thin(self, columns: Array) -> Array:
        return columns if self.decimation == 1 else decimate(columns, self.decimation, axis=0, zero_phase=True)


@dataclass(frozen=True, eq=False)
class LinearProblem:
    """v = Y a for the stacked logs: regressor Y (N, p), command v (N,)."""

    signals: tuple[Signals, ...]
    regressor: Array
    command: Array
    reversal_velocity: float


def solve(regressor: Array, command: Array) -> tuple[Array, Array]:
    """Estimate (p,) of (7)-(8) and its covariance (p, p). Columns are scaled to unit norm before the solution.

    The residuals of a filtered, misspecified regression are correlated in time, so that s^2 (Y'Y)^-1 would promise far
    too much. The covariance is the sandwich (Y'Y)^-1 S (Y'Y)^-1 with the Bartlett-weighted S of Newey and West
    (Econometrica 55 (1987) 703) over lags up to four times the first zero of the residuals' autocorrelation.
    """
    scale = np.linalg.norm(regressor, axis=0)
    if not np.all(scale > 0.0):
        raise MethodError("a regressor column is zero throughout", remedy="Leave the column out or excite the joint")
    scaled = regressor / scale
    values = lstsq(scaled, command, lapack_driver="gelsd")[0]
    residuals = command - scaled @ values
    bread = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    covariance = bread @ long_run_scatter(scaled * residuals[:, None], residuals) @ bread
    return values / scale, covariance / np.outer(scale, scale)


def white_covariance(regressor: Array, residuals: Array) -> Array:
    """s^2 (Y'Y)^-1, shape (p, p): right only when residuals are independent from sample to sample."""
    scale = np.linalg.norm(regressor, axis=0)
    freedom = len(residuals) - regressor.shape[1]
    gram = np.linalg.pinv((regressor / scale).T @ (regressor / scale), hermitian=True)
    return residuals @ residuals / freedom * gram / np.outer(scale, scale)


def condition_number(regressor: Array) -> float:
    """Ratio of the extreme singular values of Y with columns scaled to unit norm."""
    singular = np.linalg.svd(regressor / np.linalg.norm(regressor, axis=0), compute_uv=False)
    return float(singular[0] / singular[-1]) if singular[-1] > 0.0 else np.inf


def estimate_history(regressor: Array, command: Array) -> Array:
    """Estimates after 1, 2, ..., N samples, shape (N, p), by the recursive information matrix; NaN before rank p.

    I_k = I_{k-1} + y_k y_k', b_k = b_{k-1} + y_k v_k, a_k = I_k^-1 b_k: one pass, no refitting.
    """
    scale = np.linalg.norm(regressor, axis=0)
    scaled = regressor / scale
    information = np.cumsum(scaled[:, :, None] * scaled[:, None, :], axis=0)
    moment = np.cumsum(scaled * command[:, None], axis=0)
    history = np.full(scaled.shape, np.nan)
    settled = np.linalg.cond(information) < 1e12
    history[settled] = np.linalg.solve(information[settled], moment[settled][..., None])[..., 0]
    return history / scale


def long_run_scatter(scores: Array, residuals: Array) -> Array:
    """S (p, p) of Newey and West for scores (N, p): their scatter over lags that the residuals (N,) suggest."""
    lag = 4 * _first_zero_of_autocorrelation(residuals)
    scatter = scores.T @ scores
    size = 1 << int(np.ceil(np.log2(2 * len(scores))))
    spectrum = np.fft.rfft(scores, size, axis=0)
    cross = np.fft.irfft(spectrum[:, :, None] * spectrum[:, None, :].conj(), size, axis=0)
    for k in range(1, min(lag, len(scores) - 1) + 1):
        scatter = scatter + (1.0 - k / (lag + 1.0)) * (cross[k] + cross[k].T)
    return scatter


def _first_zero_of_autocorrelation(residuals: Array) -> int:
    size = 1 << int(np.ceil(np.log2(2 * len(residuals))))
    power = np.abs(np.fft.rfft(residuals - np.mean(residuals), size)) ** 2
    correlation = np.fft.irfft(power, size)[: len(residuals) // 8]
    negative = np.flatnonzero(correlation <= 0.0)
    return int(negative[0]) if len(negative) else max(1, len(correlation))
