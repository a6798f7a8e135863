"""Least squares in which every log weighs by its own error: IDIM-WLS.

v = Y a, each log's rows divided by the standard deviation of that log's residuals, repeated until the deviations
settle (M. Gautier, ICRA 1997; A. Aitken, Proc. R. Soc. Edinburgh 55 (1935) 42). With one log it is least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from envs.log import Array
from methods.joint_regression import Equations, JointRegression, Preparation
from methods.least_squares import solve
from methods.registry import METHODS


@METHODS.register("weighted_ls", "single-joint", "physics")
@dataclass(frozen=True)
class WeightedLeastSquares(JointRegression):
    """rounds: largest number of renewals of the weights."""

    preparation: Preparation = field(default_factory=Preparation)
    rounds: int = 20

    def solve(self, equations: Equations) -> tuple[Array, Array, tuple[str, ...]]:
        deviations = np.ones(int(equations.logs[-1]) + 1)
        for _ in range(self.rounds):
            weights = 1.0 / deviations[equations.logs]
            values, covariance = solve(equations.regressor * weights[:, None], equations.command * weights)
            residuals = equations.command - equations.regressor @ values
            power = np.array([np.mean(residuals[equations.logs == log] ** 2) for log in range(len(deviations))])
            floor = 1e-12 * float(np.mean(equations.command**2))
            renewed = np.sqrt(np.maximum(power, floor))
            settled = np.allclose(renewed, deviations, rtol=1e-6)
            deviations = renewed
            if settled or len(deviations) == 1:
                break
        return values, covariance, ()
