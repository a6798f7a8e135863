"""The two-layer network by L-BFGS with its gradient written out: for small tasks, where loading torch costs more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from envs.log import Array
from methods.base import Status
from methods.network_training import Trainer, Weights


@dataclass(frozen=True)
class ClosedFormGradient(Trainer):
    """Minimises the mean squared error e'e / T of ``z U + c - y``, z = sigmoid(s W' + b).

    Gradient: U: 2 z'e / T, c: 2 mean e, and with d = 2 e U z (1 - z) / T: W: d's, b: the column sums of d.
    """

    iterations: int = 100
    tolerance: float = 1e-9

    def train(self, inputs: Array, target: Array, start: Weights, with_bias: bool) -> tuple[Weights, Array, Status]:
        h, m = start.hidden.shape
        parts = np.cumsum([h * m, h, h])
        biased = float(with_bias)

        def unpack(x: Array) -> Weights:
            w, b, u, c = np.split(x, parts)
            return Weights(w.reshape(h, m), b, u, float(c[0]))

        curve: list[float] = []

        def loss(x: Array) -> tuple[float, Array]:
            now = unpack(x)
            z = expit(inputs @ now.hidden.T + now.hidden_bias)
            error = z @ now.output + now.output_bias - target
            d = 2.0 * error[:, None] * now.output * z * (1.0 - z) / len(target)
            value = float(np.mean(error**2))
            curve.append(value)
            output = 2.0 * z.T @ error / len(target)
            slopes = ((d.T @ inputs).ravel(), biased * d.sum(axis=0), output, [biased * 2.0 * np.mean(error)])
            return value, np.concatenate(slopes)

        begin = np.concatenate((start.hidden.ravel(), start.hidden_bias, start.output, [start.output_bias]))
        options = {"maxiter": self.iterations, "ftol": self.tolerance, "maxcor": 20}
        found = minimize(loss, begin, jac=True, method="L-BFGS-B", options=options)
        status = Status.CONVERGED if found.status == 0 else Status.ITERATION_LIMIT
        return unpack(found.x), np.minimum.accumulate(curve), status
