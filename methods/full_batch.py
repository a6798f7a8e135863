"""The same network by a modern optimiser: all samples at once, gradients from torch, steps by L-BFGS."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from envs.log import Array
from methods.base import Status
from methods.network_training import Trainer, Weights


@dataclass(frozen=True)
class FullBatch(Trainer):
    """Minimises the mean squared error over the record; the learning curve holds the lowest error per evaluation.

    L-BFGS (Liu and Nocedal, Math. Program. 45 (1989) 503) in SciPy's implementation, which unlike torch's own does not
    load torch's compiler; it stops early once an iteration lowers the error, relative to the target's variance, by
    less than `tolerance`. `every` takes every n-th sample: signals limited to tens of hertz lose nothing at 200 Hz.
    """

    iterations: int = 150
    tolerance: float = 1e-9
    every: int = 5

    def train(self, inputs: Array, target: Array, start: Weights, with_bias: bool) -> tuple[Weights, Array, Status]:
        import torch

        s = torch.from_numpy(np.ascontiguousarray(inputs[:: self.every]))
        wanted = torch.from_numpy(np.ascontiguousarray(target[:: self.every]))
        nodes, m = start.hidden.shape
        curve: list[float] = []

        def loss_and_gradient(flat: Array) -> tuple[float, Array]:
            x = torch.tensor(flat, requires_grad=True)
            w, b, u = x[: nodes * m].reshape(nodes, m), x[nodes * m : -nodes - 1], x[-nodes - 1 : -1]
            loss = torch.mean((torch.sigmoid(s @ w.T + b) @ u + x[-1] - wanted) ** 2)
            (slope,) = torch.autograd.grad(loss, x)
            gradient = slope.numpy()
            if not with_bias:
                gradient[nodes * m : -nodes - 1] = gradient[-1] = 0.0
            curve.append(loss.item())
            return curve[-1], gradient

        found = minimize(
            loss_and_gradient,
            np.concatenate((start.hidden.ravel(), start.hidden_bias, start.output, [start.output_bias])),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": self.iterations, "maxcor": 20, "gtol": 0.0, "ftol": self.tolerance},
        )
        x = found.x
        weights = Weights(
            hidden=x[: nodes * m].reshape(nodes, m),
            hidden_bias=x[nodes * m : -nodes - 1],
            output=x[-nodes - 1 : -1],
            output_bias=float(x[-1]),
        )
        if not np.isfinite(found.fun):
            status = Status.FAILED
        else:
            status = Status.ITERATION_LIMIT if found.nit >= self.iterations else Status.CONVERGED
        return weights, np.minimum.accumulate(curve), status
