"""A neural state-space model of one joint, trained on what it simulates.

    z' = (u - z) / T,    q'' = f(q, q') + g z,    f = affine in q' + two-layer tanh network

The states are integrated in steps of `step` from measured states over windows of `window` seconds, and all weights, T
and g included, descend along the error of positions and velocities in these windows (G. Beintema, M. Schoukens, R.
Toth, Automatica 156 (2023) 111210). The start is the best linear model with a silent network (M. Schoukens, ECC 2021).
Without T (current and torque drives) z is u.

Eliminating z gives the equation of `methods.equation`, so that inverse and simulation belong together:

    F = (q'' - f) / g + T / g (q''' - f_q q' - f_q' q'') - u
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from envs.log import Array, InputKind, Log
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
    # p = (T, g, slope, offset, then per node weight q, weight q', bias, output)
    f = p[2] * dq + p[3]
    change = p[2] * ddq
    for k in range(4, len(p), 4):
        y = np.tanh(p[k] * q + p[k + 1] * dq + p[k + 2])
        f += p[k + 3] * y
        change += p[k + 3] * (1.0 - y * y) * (p[k] * dq + p[k + 1] * ddq)
    value = (ddq - f) / p[1] - u
    if p[0] > 0.0:
        value += p[0] / p[1] * (jerk - change)
    return value


@dataclass(frozen=True, eq=False)
class NeuralStateSpaceModel(EquationModel):
    """lag: T [s]; gain: g; f = slope q' + offset + sum of nodes; nodes: (h, 4), weights, bias and output of each."""

    joint: int
    input: InputKind
    lag: float
    gain: float
    slope: float
    offset: float
    nodes: Array

    @property
    def joints(self) -> tuple[int, ...]:  # type: ignore[override]
        return (self.joint,)

    @property
    def inputs(self) -> tuple[InputKind, ...]:  # type: ignore[override]
        return (self.input,)

    @property
    def balance(self) -> Callable[[Array, float, float, float, float, float], float]:
        return _balance

    @cached_property
    def parameters(self) -> Array:
        return np.concatenate(([self.lag, self.gain, self.slope, self.offset], self.nodes.ravel()))


@METHODS.register("neural_state_space", "single-joint", "network", "torch")
@dataclass(frozen=True)
class NeuralStateSpace(Method):
    """nodes: of the network. window: of a simulation [s]. step: of the integrator [s]. batch: windows per descent.

    rounds: descents of Adam. rate: its learning rate at the beginning; it falls to a twentieth along a cosine. The
    affine part, g and T move a fifth as fast.
    """

    preparation: Preparation = field(default_factory=Preparation)
    nodes: int = 20
    window: float = 0.3
    step: float = 5e-3
    batch: int = 128
    rounds: int = 200
    rate: float = 0.02

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Random numbers draw the hidden weights and the windows. There are no physical estimates."""
        import torch

        begin = time.perf_counter()
        joint, facts = check_joint(logs)
        signals = self.preparation.signals(logs)
        lag, gain, slope, offset = linear_start(signals, lagging=facts.input == "voltage")
        motions = np.concatenate([np.column_stack((p.motion.position, p.motion.velocity)) for p in signals])
        centre, scale = float(np.mean(motions[:, 0])), np.std(motions, axis=0)
        size = gain * float(np.std(np.concatenate([p.command for p in signals])))
        windows = self._windows(signals, logs)
        hidden = np.column_stack((rng.uniform(-2.0, 2.0, (self.nodes, 2)), rng.uniform(-1.0, 1.0, self.nodes)))
        hidden[: self.nodes // 2, 1] *= 10.0  # some steep ones, for friction
        begins = (np.log(max(lag, 1e-6)), 1.0, 1.0, offset / size, hidden, np.zeros(self.nodes))
        weights = [torch.tensor(np.asarray(w, dtype=np.float64), requires_grad=True) for w in begins]

        def acceleration(q: torch.Tensor, v: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
            inputs = torch.stack(((q - centre) / scale[0], v / scale[1]), dim=-1)
            inner = torch.tanh(inputs @ weights[4][:, :2].T + weights[4][:, 2]) @ weights[5]
            return slope * weights[2] * v + gain * weights[1] * z + size * (weights[3] + inner)

        optimiser = torch.optim.Adam(
            [{"params": weights[:4], "lr": 0.2 * self.rate}, {"params": weights[4:], "lr": self.rate}]
        )
        plan = torch.optim.lr_scheduler.LambdaLR(
            optimiser, lambda k: 0.05 + 0.475 * (1.0 + math.cos(math.pi * k / self.rounds))
        )
        h = logs[0].sample_time * max(1, round(self.step / logs[0].sample_time))
        errors = np.array([scale[1] * self.window, scale[1]])
        curve = np.empty(self.rounds)
        for k in range(self.rounds):
            chosen = rng.integers(len(windows[0]), size=self.batch)
            state, command, target = (torch.from_numpy(part[chosen]) for part in windows)
            loss = simulation_error(
                acceleration, torch.exp(weights[0]) if lag > 0.0 else None, state, command, target, errors, h
            )
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(weights, 1.0)
            optimiser.step()
            plan.step()
            curve[k] = loss.item()
        found = [w.detach().numpy() for w in weights]
        raw = found[4] / np.array([scale[0], scale[1], 1.0])
        raw[:, 2] -= raw[:, 0] * centre
        model = NeuralStateSpaceModel(
            joint=joint,
            input=facts.input,
            lag=float(np.exp(found[0])) if lag > 0.0 else 0.0,
            gain=gain * float(found[1]),
            slope=slope * float(found[2]),
            offset=size * float(found[3]),
            nodes=np.column_stack((raw, size * found[5])),
        )
        residuals = [p.command - model.inverse(p.time, p.motion) for p in signals]
        return Fit(
            model=model,
            estimates=Estimates((), (), np.empty(0), np.empty((0, 0))),
            residuals=np.concatenate(residuals)[:, 0],
            status=Status.ITERATION_LIMIT if np.isfinite(curve[-1]) else Status.FAILED,
            seconds=time.perf_counter() - begin,
            learning_curve=curve,
            notes=(f"{len(windows[0])} windows of {self.window:g} s",),
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
    state: torch.Tensor,
    command: torch.Tensor,
    target: torch.Tensor,
    scale: Array,
    h: float,
) -> torch.Tensor:
    """Mean squared error of windows simulated by Runge-Kutta in steps h [s], positions and velocities over `scale`.

    The lag is exact for a held command. Without one z is the command.
    """
    import torch

    q, v = state[:, 0], state[:, 1]
    free = acceleration(q, v, torch.zeros_like(q))
    z = (state[:, 2] - free) / (acceleration(q, v, torch.ones_like(q)) - free)
    loss = torch.zeros((), dtype=torch.float64)
    for k in range(command.shape[1]):
        drive = command[:, k]
        if lag is not None:
            decay = torch.exp(-h / lag)
            drive, z = drive + (z - drive) * (1.0 - decay) * lag / h, drive + (z - drive) * decay
        a1 = acceleration(q, v, drive)
        v2 = v + 0.5 * h * a1
        a2 = acceleration(q + 0.5 * h * v, v2, drive)
        v3 = v + 0.5 * h * a2
        a3 = acceleration(q + 0.5 * h * v2, v3, drive)
        v4 = v + h * a3
        a4 = acceleration(q + h * v3, v4, drive)
        q, v = q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        loss = loss + torch.mean(((q - target[:, k, 0]) / scale[0]) ** 2 + ((v - target[:, k, 1]) / scale[1]) ** 2)
    return loss / command.shape[1]


def linear_start(signals: Sequence[Signals], lagging: bool) -> tuple[float, float, float, float]:
    """(T, g, slope, offset) of the best linear model; T = 0 without a lag or where it comes out negative."""
    motion = [np.column_stack((p.motion.jerk, p.motion.acceleration, p.motion.velocity)) for p in signals]
    matrix = np.column_stack((np.concatenate(motion), np.ones(sum(map(len, motion)))))
    command = np.concatenate([p.command[:, 0] for p in signals])
    values = np.linalg.lstsq(matrix, command, rcond=None)[0] if lagging else np.zeros(4)
    if values[0] <= 0.0 or values[1] <= 0.0:
        values = np.concatenate(([0.0], np.linalg.lstsq(matrix[:, 1:], command, rcond=None)[0]))
    if values[1] <= 0.0:
        raise MethodError("the command does not accelerate the joint in these logs", remedy="Check sign and excitation")
    return values[0] / values[1], 1.0 / values[1], -values[2] / values[1], -values[3] / values[1]
