"""Robust least squares: Huber's M-estimator by iteratively reweighted least squares on the IDIM equations.

Rows whose residual exceeds k = 1.345 robust standard deviations weigh k s / |r| instead of 1, which keeps 95 % of the
efficiency under normal errors (P. Huber, Ann. Math. Stat. 35 (1964) 73; P. Holland, R. Welsch, Commun. Stat. A6 (1977)
813). What the model lacks near velocity reversals then pulls less on the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from envs.log import Array
from methods.joint_regression import Equations, JointRegression, Preparation
from methods.least_squares import solve
from methods.registry import METHODS


@METHODS.register("huber", "single-joint", "physics")
@dataclass(frozen=True)
class HuberRegression(JointRegression):
    """corner: k, in standard deviations by the median absolute residual. rounds: largest number of reweightings."""

    preparation: Preparation = field(default_factory=Preparation)
    corner: float = 1.345
    rounds: int = 50

    def solve(self, equations: Equations) -> tuple[Array, Array, tuple[str, ...]]:
        root = np.ones(len(equations.command))
        scale = np.linalg.norm(equations.regressor, axis=0)
        scaled = equations.regressor / np.where(scale > 0.0, scale, 1.0)
        previous = np.full(scaled.shape[1], np.inf)
        floor = 1e-9 * float(np.sqrt(np.mean(equations.command**2)))
        for _ in range(self.rounds):
            values = np.linalg.lstsq(scaled * root[:, None], equations.command * root, rcond=None)[0]
            residuals = np.abs(equations.command - scaled @ values)
            limit = self.corner * max(float(np.median(residuals)) / 0.6745, floor)
            root = np.sqrt(np.minimum(1.0, limit / np.maximum(residuals, 1e-300)))
            if np.max(np.abs(values - previous)) <= 1e-8 * np.max(np.abs(values)):
                break
            previous = values
        found, covariance = solve(equations.regressor * root[:, None], equations.command * root)
        share = float(np.mean(root < 1.0))
        return found, covariance, (f"{100.0 * share:.3g} % of the equations weigh less than 1",)
