"""A Gaussian process on what identified physics leaves: semiparametric identification.

    v = Y a + g(q, q'),  g ~ GP(0, s^2 exp(-(dq/l_q)^2 / 2 - (dq'/l_v)^2 / 2)) + noise

Y a is IDIM-LS. Length scales, signal and noise are those of the largest marginal likelihood on a subset of the data;
the posterior mean over all data is that of the deterministic training conditional on inducing points, so that a
simulation pays for `inducing` exponentials per evaluation (D. Nguyen-Tuong, J. Peters, Using model knowledge for
learning inverse dynamics, ICRA 2010; J. Quinonero-Candela, C. Rasmussen, J. Mach. Learn. Res. 6 (2005) 1939). Away from
the data g fades and the physics remains.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from envs.log import Array, Log
from methods.base import Fit, Method
from methods.differentiation import BandLimited
from methods.equation import EquationModel, compile_balance
from methods.idim_least_squares import IdimLeastSquares
from methods.joint_model import JointModel
from methods.joint_regression import parallel_filtered
from methods.registry import METHODS
from methods.regressor import regressor

LINEAR = 9
"""Numbers of the linear part that lead the parameters: a1..a8 and w of `methods.joint_equation`."""


@njit(cache=True)
def _linear(p, q, dq, ddq, jerk):
    # the linear part of `methods.joint_equation`, again because numba's cache does not watch other files
    value = p[0] * jerk + p[1] * ddq + p[2] * dq + p[3] + p[5] * q
    if p[4] != 0.0:
        value += p[4] * np.tanh(dq / p[8])
    if p[6] != 0.0 or p[7] != 0.0:
        value += p[6] * np.sin(q) + p[7] * np.cos(q)
    return value


@compile_balance
def _balance(p, q, dq, ddq, jerk, u):
    # p = (linear part, l_q, l_v, then per inducing point q, q', weight)
    value = _linear(p, q, dq, ddq, jerk) - u
    for k in range(LINEAR + 2, len(p), 3):
        a, b = (q - p[k]) / p[LINEAR], (dq - p[k + 1]) / p[LINEAR + 1]
        value += p[k + 2] * np.exp(-0.5 * (a * a + b * b))
    return value


@dataclass(frozen=True, eq=False)
class SemiparametricModel(EquationModel):
    """linear: IDIM-LS. scales: (l_q, l_v); points: (M, 2); weights: (M,) [unit of the command]."""

    linear: JointModel
    scales: Array
    points: Array
    weights: Array

    @property
    def balance(self) -> Callable[[Array, float, float, float, float, float], float]:
        return _balance

    @cached_property
    def parameters(self) -> Array:
        table = np.column_stack((self.points, self.weights)).ravel()
        return np.concatenate((self.linear.parameters[:LINEAR], self.scales, table))

    def residual(self, inputs: Array) -> Array:
        """g for inputs (T, 2), shape (T,)."""
        return covariance(inputs, self.points, self.scales) @ self.weights


@METHODS.register("gaussian_process", "single-joint", "hybrid")
@dataclass(frozen=True)
class GaussianProcess(Method):
    """subset: points for the marginal likelihood. inducing: points of the posterior. most: rows that are learned."""

    physics: IdimLeastSquares = field(default_factory=IdimLeastSquares)
    subset: int = 250
    inducing: int = 100
    most: int = 5000

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Random numbers choose the subset and the inducing points."""
        begin = time.perf_counter()
        first = self.physics.fit(logs, rng)
        assert isinstance(first.model, JointModel)
        inputs, target = self._left(logs, first.model)
        every = max(1, len(target) // self.most)
        inputs, target = inputs[::every], target[::every]
        chosen = rng.permutation(len(target))
        near = chosen[: self.subset]
        spread = np.std(inputs, axis=0) + 1e-300
        guess = np.log([*(0.5 * spread), np.std(target) + 1e-300, 0.5 * np.std(target) + 1e-300])
        found = minimize(
            lambda x: negative_log_likelihood(x, inputs[near], target[near]),
            guess,
            method="L-BFGS-B",
            bounds=[(g - 4.0, g + 4.0) for g in guess],
            options={"maxiter": 40},
        )
        scales, signal, noise = np.exp(found.x[:2]), float(np.exp(found.x[2])), float(np.exp(found.x[3]))
        points = inputs[chosen[: self.inducing]]
        between = covariance(points, points, scales) * signal**2
        across = covariance(points, inputs, scales) * signal**2
        gram = noise**2 * between + across @ across.T
        gram[np.diag_indices(len(gram))] *= 1.0 + 1e-9
        weights = signal**2 * cho_solve(cho_factor(gram), across @ target)
        model = SemiparametricModel(first.model.joint, first.model.input, first.model, scales, points, weights)
        return replace(
            first,
            model=model,
            residuals=target - model.residual(inputs),
            seconds=time.perf_counter() - begin,
            notes=(
                *first.notes,
                f"length scales {scales[0]:.3g} and {scales[1]:.3g}, signal {signal:.3g}, noise {noise:.3g}",
            ),
        )

    def _left(self, logs: Sequence[Log], linear: JointModel) -> tuple[Array, Array]:
        """Positions and velocities (T, 2) and what the physics leaves of the command (T,), behind the same filters."""
        filter_ = BandLimited(self.physics.preparation.equations(logs).bandwidth)
        inputs, target = [], []
        for log in logs:
            part, kernel = filter_.signals(log), filter_.kernel(0, log.sample_time)
            matrix = regressor(part.motion, linear.columns, linear.reversal_velocity)
            inner = slice(len(kernel) // 2, len(part) - len(kernel) // 2)
            explained = parallel_filtered(matrix, linear.columns, kernel) @ linear.coefficients
            inputs.append(np.column_stack((part.motion.position, part.motion.velocity))[inner])
            target.append(part.command[inner, 0] - explained)
        return np.concatenate(inputs), np.concatenate(target)


def covariance(first: Array, second: Array, scales: Array) -> Array:
    """exp(-|(x - y) / scales|^2 / 2) for points (N, 2) and (M, 2), shape (N, M)."""
    a, b = first / scales, second / scales
    squares = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1) - 2.0 * a @ b.T
    return np.exp(-0.5 * np.maximum(squares, 0.0))


def negative_log_likelihood(logarithms: Array, inputs: Array, target: Array) -> float:
    """Of the targets under ln (l_q, l_v, signal, noise), up to a constant."""
    scales, signal, noise = np.exp(logarithms[:2]), np.exp(logarithms[2]), np.exp(logarithms[3])
    matrix = signal**2 * covariance(inputs, inputs, scales)
    matrix[np.diag_indices(len(matrix))] += noise**2 + 1e-9 * signal**2
    try:
        factor = cho_factor(matrix, lower=True)
    except np.linalg.LinAlgError:
        return 1e25
    return float(0.5 * target @ cho_solve(factor, target) + np.sum(np.log(np.diag(factor[0]))))
