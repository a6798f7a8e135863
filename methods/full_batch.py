"""The same network by a modern optimiser: full-batch L-BFGS or Adam in torch, double precision."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from envs.log import Array
from methods.base import Status
from methods.network_training import Trainer, Weights


@dataclass(frozen=True)
class FullBatch(Trainer):
    """Minimises the mean squared error over the record; the learning curve holds the lowest error per evaluation.

    L-BFGS uses a strong-Wolfe line search (Nocedal and Wright, Numerical Optimization, 2006, ch. 7) and stops early
    once the error, relative to the target's variance, changes by less than `tolerance`. `every` takes every n-th
    sample: signals limited to tens of hertz lose nothing at 200 Hz.
    """

    optimiser: Literal["lbfgs", "adam"] = "lbfgs"
    iterations: int = 150
    learning_rate: float = 0.02  # Adam only
    tolerance: float = 1e-9
    every: int = 5

    def train(self, inputs: Array, target: Array, start: Weights, with_bias: bool) -> tuple[Weights, Array, Status]:
        import torch

        s = torch.from_numpy(np.ascontiguousarray(inputs[:: self.every]))
        wanted = torch.from_numpy(np.ascontiguousarray(target[:: self.every]))
        w, b, u = (torch.tensor(array, requires_grad=True) for array in (start.hidden, start.hidden_bias, start.output))
        c = torch.tensor(start.output_bias, dtype=torch.float64, requires_grad=True)
        free = [w, u, b, c] if with_bias else [w, u]

        curve: list[float] = []

        def loss() -> torch.Tensor:
            return torch.mean((torch.sigmoid(s @ w.T + b) @ u + c - wanted) ** 2)

        def closure() -> torch.Tensor:
            optimiser.zero_grad()
            value = loss()
            value.backward()
            curve.append(float(value.detach()))
            return value

        if self.optimiser == "lbfgs":
            optimiser: torch.optim.Optimizer = torch.optim.LBFGS(
                free,
                max_iter=self.iterations,
                history_size=20,
                line_search_fn="strong_wolfe",
                tolerance_grad=0.0,
                tolerance_change=self.tolerance,
            )
            optimiser.step(closure)
        else:
            optimiser = torch.optim.Adam(free, lr=self.learning_rate)
            for _ in range(self.iterations):
                optimiser.step(closure)
        with torch.no_grad():
            curve.append(float(loss()))
        if not np.isfinite(curve[-1]):
            status = Status.FAILED
        elif self.optimiser == "lbfgs" and optimiser.state_dict()["state"][0]["n_iter"] < self.iterations:
            status = Status.CONVERGED
        else:
            status = Status.ITERATION_LIMIT
        found = (tensor.detach().numpy().copy() for tensor in (w, b, u))
        return Weights(*found, float(c.detach())), np.minimum.accumulate(curve), status
