"""A neural state-space model of one joint, trained on what it simulates.

    z' = (u - k q' - z) / T,    q'' = f(q, q') + g z,    f = offset + two-layer tanh network

The states are integrated in steps of `step` from measured states over windows of `window` seconds, and all weights, T
and g included, follow L-BFGS down the error of positions and velocities in these windows (G. Beintema, M. Schoukens, R.
Toth, Automatica 156 (2023) 111210). The start is the best linear model with a silent network (M. Schoukens, ECC 2021).
Without T (current and torque drives) z is u - k q'.

Eliminating z gives the equation of `methods.equation`, so that inverse and simulation belong together:

    F = (q'' - f) / g + T / g (q''' - f_q q' - f_q' q'') + k q' - u
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.optimize import minimize

from envs.log import Array, Log
from methods.base import Estimates, Fit, Method, MethodError, Status
from methods.differentiation import Signals
from methods.equation import EquationModel, compile_balance
from methods.joint_regression import Preparation
from methods.registry import METHODS
from methods.usable_logs import check_joint

if TYPE_CHECKING:
    import torch


@compile_balance
def _balance(p, q, dq, ddq, jerk, u):
    # p = (T, g, k, offset, then per node weight q, weight q', bias, output)
    f, change = p[3], 0.0
    for k in range(4, len(p), 4):
        y = np.tanh(p[k] * q + p[k + 1] * dq + p[k + 2])
        f += p[k + 3] * y
        change += p[k + 3] * (1.0 - y * y) * (p[k] * dq + p[k + 1] * ddq)
    value = (ddq - f) / p[1] + p[2] * dq - u
    if p[0] > 0.0:
        value += p[0] / p[1] * (jerk - change)
    return value


@dataclass(frozen=True, eq=False)
class NeuralStateSpaceModel(EquationModel):
    """lag: T [s]; gain: g; damping: k; f = offset + sum of nodes; nodes: (h, 4), weights, bias and output of each."""

    lag: float
    gain: float
    damping: float
    offset: float
    nodes: Array

    @property
    def balance(self) -> Callable[[Array, float, float, float, float, float], float]:
        return _balance

    @cached_property
    def parameters(self) -> Array:
        return np.concatenate(([self.lag, self.gain, self.damping, self.offset], self.nodes.ravel()))


@METHODS.register("neural_state_space", "single-joint", "network", "torch")
@dataclass(frozen=True)
class NeuralStateSpace(Method):
    """nodes: of the network. window: of a simulation [s]. step: of the integrator [s]. most: windows that are learned.

    iterations: of L-BFGS at most. penalty: on the squares of the output weights.
    """

    preparation: Preparation = field(default_factory=Preparation)
    nodes: int = 20
    window: float = 0.3
    step: float = 4e-3
    most: int = 200
    iterations: int = 50
    penalty: float = 1e-6

    check_settings: ClassVar[Mapping[str, Any]] = {"nodes": 4, "most": 20, "iterations": 5}

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Random numbers draw the hidden weights and the windows. There are no physical estimates."""
        import torch

        begin = time.perf_counter()
        joint, facts = check_joint(logs)
        signals = self.preparation.signals(logs)
        lag, gain, damping, offset = linear_start(signals, lagging=facts.input == "voltage")
        motions = np.concatenate([np.column_stack((p.motion.position, p.motion.velocity)) for p in signals])
        centre, scale = float(np.mean(motions[:, 0])), np.std(motions, axis=0)
        size = gain * float(np.std(np.concatenate([p.command for p in signals])))
        windows = self._windows(signals, logs)
        chosen = np.sort(rng.permutation(len(windows[0]))[: self.most])
        state, command, target = (torch.from_numpy(part[chosen]) for part in windows)
        hidden = np.column_stack((rng.uniform(-2.0, 2.0, (self.nodes, 2)), rng.uniform(-1.0, 1.0, self.nodes)))
        hidden[: self.nodes // 2, 1] *= 10.0  # some steep ones, for friction
        shapes = [(), (), (), (), hidden.shape, (self.nodes,)]
        begins = [np.log(max(lag, 1e-6)), 1.0, 1.0, offset / size, hidden, np.zeros(self.nodes)]
        edges = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])
        weights: list[torch.Tensor] = []

        def acceleration(q: torch.Tensor, v: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
            inputs = torch.stack(((q - centre) / scale[0], v / scale[1]), dim=-1)
            inner = torch.tanh(inputs @ weights[4][:, :2].T + weights[4][:, 2]) @ weights[5]
            return gain * weights[1] * z + size * (weights[3] + inner)

        h = logs[0].sample_time * max(1, round(self.step / logs[0].sample_time))
        errors = np.array([scale[1] * self.window, scale[1]])
        curve: list[float] = []

        def loss_and_gradient(flat: Array) -> tuple[float, Array]:
            x = torch.tensor(flat, requires_grad=True)
            weights[:] = [x[a:b].reshape(shape) for (a, b), shape in zip(pairwise(edges), shapes, strict=True)]
            z = torch.exp(weights[0]) if lag > 0.0 else None
            loss = simulation_error(acceleration, z, damping * weights[2], state, command, target, errors, h)
            total = loss + self.penalty * torch.sum(weights[5] ** 2)
            (slope_,) = torch.autograd.grad(total, x)
            gradient = slope_.numpy()
            if not (np.isfinite(total.item()) and np.all(np.isfinite(gradient))):
                return 1e10, np.zeros_like(flat)  # a step that let the windows diverge
            curve.append(loss.item())
            return total.item(), gradient

        result = minimize(
            loss_and_gradient,
            np.concatenate([np.ravel(part) for part in begins]),
            jac=True,
            method="L-BFGS-B",
            options={
                "maxiter": self.iterations,
                "maxfun": 2 * self.iterations,
                "maxcor": 20,
                "ftol": 1e-10,
                "gtol": 0.0,
            },
        )
        found = [result.x[a:b].reshape(shape) for (a, b), shape in zip(pairwise(edges), shapes, strict=True)]
        raw = found[4] / np.array([scale[0], scale[1], 1.0])
        raw[:, 2] -= raw[:, 0] * centre
        model = NeuralStateSpaceModel(
            joint=joint,
            input=facts.input,
            lag=float(np.exp(found[0])) if lag > 0.0 else 0.0,
            gain=gain * float(found[1]),
            damping=damping * float(found[2]),
            offset=size * float(found[3]),
            nodes=np.column_stack((raw, size * found[5])),
        )
        residuals = [p.command - model.inverse(p.time, p.motion) for p in signals]
        return Fit(
            model=model,
            estimates=Estimates((), (), np.empty(0), np.empty((0, 0))),
            residuals=np.concatenate(residuals)[:, 0],
            status=Status.ITERATION_LIMIT if result.nit >= self.iterations else Status.CONVERGED,
            seconds=time.perf_counter() - begin,
            learning_curve=np.minimum.accumulate(curve),
            notes=(f"{len(windows[0])} windows of {self.window:g} s, {len(chosen)} of them learned",),
        )

    def _windows(self, signals: Sequence[Signals], logs: Sequence[Log]) -> tuple[Array, Array, Array]:
        """States (W, 3), mean commands of every step (W, S) and positions and velocities behind it (W, S, 2)."""
        if len({round(log.sample_time, 9) for log in logs}) > 1:
            raise MethodError("the logs differ in their sample time", remedy="Give logs of one sample time")
        states, commands, targets = [], [], []
        for part, log in zip(signals, logs, strict=True):
            every = max(1, round(self.step / log.sample_time))
            count = max(2, round(self.window / (every * log.sample_time)))
            raw = log.command[part.start : part.start + len(part), 0]
            if log.facts[0].hold == "first_order":
                raw = np.append(0.5 * (raw[1:] + raw[:-1]), raw[-1])
            total = np.concatenate(([0.0], np.cumsum(raw)))
            for first in range(0, len(part) - every * count, max(1, every * count // 3)):
                at = first + every * np.arange(count + 1)
                state = part.motion.state(first)
                states.append(np.concatenate((state.position, state.velocity, state.acceleration)))
                commands.append(np.diff(total[at]) / every)
                targets.append(np.column_stack((part.motion.position[at[1:], 0], part.motion.velocity[at[1:], 0])))
        if not states:
            raise MethodError(f"no log holds a window of {self.window:g} s", remedy="Record longer logs")
        return np.array(states), np.array(commands), np.array(targets)


def simulation_error(
    acceleration: Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor],
    lag: torch.Tensor | None,
    damping: torch.Tensor,
    state: torch.Tensor,
    command: torch.Tensor,
    target: torch.Tensor,
    scale: Array,
    h: float,
) -> torch.Tensor:
    """Mean squared error of windows simulated by Runge-Kutta in steps h [s], positions and velocities over `scale`.

    The lag is exact for a held command and the velocity amid a step. Without one z is the command less the damping.
    """
    import torch

    q, v = state[:, 0], state[:, 1]
    free = acceleration(q, v, torch.zeros_like(q))
    z = (state[:, 2] - free) / (acceleration(q, v, torch.ones_like(q)) - free)
    loss = torch.zeros((), dtype=torch.float64)
    for k in range(command.shape[1]):
        u, direct = command[:, k], damping
        if lag is not None:
            final = u - damping * (v + 0.5 * h * acceleration(q, v, z))
            decay = torch.exp(-h / lag)
            u, z, direct = final + (z - final) * (1.0 - decay) * lag / h, final + (z - final) * decay, 0.0 * damping
        a1 = acceleration(q, v, u - direct * v)
        v2 = v + 0.5 * h * a1
        a2 = acceleration(q + 0.5 * h * v, v2, u - direct * v2)
        v3 = v + 0.5 * h * a2
        a3 = acceleration(q + 0.5 * h * v2, v3, u - direct * v3)
        v4 = v + h * a3
        a4 = acceleration(q + h * v3, v4, u - direct * v4)
        q, v = q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        loss = loss + torch.mean(((q - target[:, k, 0]) / scale[0]) ** 2 + ((v - target[:, k, 1]) / scale[1]) ** 2)
    return loss / command.shape[1]


def linear_start(signals: Sequence[Signals], lagging: bool) -> tuple[float, float, float, float]:
    """(T, g, k, offset) of the best linear model; T = 0 without a lag or where it comes out negative."""
    motion = [np.column_stack((p.motion.jerk, p.motion.acceleration, p.motion.velocity)) for p in signals]
    matrix = np.column_stack((np.concatenate(motion), np.ones(sum(map(len, motion)))))
    command = np.concatenate([p.command[:, 0] for p in signals])
    values = np.linalg.lstsq(matrix, command, rcond=None)[0] if lagging else np.zeros(4)
    if values[0] <= 0.0 or values[1] <= 0.0:
        values = np.concatenate(([0.0], np.linalg.lstsq(matrix[:, 1:], command, rcond=None)[0]))
    if values[1] <= 0.0:
        raise MethodError("the command does not accelerate the joint in these logs", remedy="Check sign and excitation")
    return values[0] / values[1], 1.0 / values[1], values[2], -values[3] / values[1]
