"""Deep Lagrangian network with friction and drives, for one joint or several.

    tau = M(q) q'' + M'(q, q') q' - grad_q (q' M q') / 2 + grad V(q),     M = L L' + small,  L and V: one tanh layer

and the drives of `methods.driven` around it, friction and time constants included: mechanics that no network weight can
make inconsistent, but without any description of the arm (M. Lutter, C. Ritter, J. Peters, Deep Lagrangian networks,
ICLR 2019; M. Lutter, J. Peters, Int. J. Robot. Res. 42 (2023) 83, for friction). All weights follow L-BFGS down the
error of the command on band-limited signals; the winding's lag is learned as T M q''', its largest part.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from scipy.optimize import minimize

from envs.log import Array, InputKind, Log
from methods.base import Estimates, Fit, Method, Status
from methods.differentiation import BandLimited
from methods.driven import DrivenModel, Drives, RigidDynamics
from methods.joint_regression import Preparation
from methods.registry import METHODS
from methods.usable_logs import check_logs

if TYPE_CHECKING:
    import torch

SMALL = 1e-4
"""Added to M's diagonal, in units of scaled torque and acceleration."""


@njit(cache=True)
def _lagrangian(x, v, hidden, bias, outer, offset):
    """M (n, n) and b (n,) at scaled position x and velocity v; outer (n (n + 1) / 2 + 1, h), the last row for V."""
    n = len(x)
    y = np.tanh(hidden @ x + bias)
    slope = 1.0 - y * y
    flat = outer @ y + offset
    lower, changes = np.zeros((n, n)), np.zeros((n, n, n))
    gradient = np.zeros(n)
    for k in range(n):
        inner = outer @ (slope * hidden[:, k])
        gradient[k] = inner[-1]
        at = 0
        for i in range(n):
            for j in range(i + 1):
                lower[i, j] = flat[at]
                changes[k, i, j] = inner[at]
                at += 1
    mass = lower @ lower.T
    force = gradient
    for k in range(n):
        change = changes[k] @ lower.T
        change = change + change.T
        force = force + v[k] * (change @ v)
        force[k] -= 0.5 * v @ (change @ v)
    for i in range(n):
        mass[i, i] += SMALL
    return mass, force


@dataclass(frozen=True, eq=False)
class LagrangianModel(DrivenModel):
    """centre, scale: (n,) of positions. hidden (h, n), bias (h,), outer (n (n + 1) / 2 + 1, h) and offset: weights."""

    joints: tuple[int, ...]
    inputs: tuple[InputKind, ...]
    drives: Drives
    centre: Array
    scale: Array
    hidden: Array
    bias: Array
    outer: Array
    offset: Array

    def dynamics(self) -> RigidDynamics:
        """The network in physical coordinates."""
        return NetworkDynamics(self)


@dataclass(frozen=True, eq=False)
class NetworkDynamics:
    """M and b of a `LagrangianModel`: with x = (q - centre) / scale, generalised forces are those of x over scale."""

    model: LagrangianModel

    @cached_property
    def _weights(self) -> tuple[Array, Array, Array, Array]:
        m = self.model
        return tuple(np.ascontiguousarray(part) for part in (m.hidden, m.bias, m.outer, m.offset))  # type: ignore[return-value]

    def inertia(self, position: Array) -> Array:
        """See `RigidDynamics`."""
        x = (position - self.model.centre) / self.model.scale
        return np.asarray(
            _lagrangian(x, np.zeros_like(x), *self._weights)[0] / self.model.scale[:, None] / self.model.scale
        )

    def bias(self, position: Array, velocity: Array) -> Array:
        """See `RigidDynamics`."""
        x, v = (position - self.model.centre) / self.model.scale, velocity / self.model.scale
        return np.asarray(_lagrangian(x, v, *self._weights)[1] / self.model.scale)


@METHODS.register("lagrangian_network", "single-joint", "multi-joint", "network", "torch")
@dataclass(frozen=True)
class LagrangianNetwork(Method):
    """nodes: of the layer. rows: of all logs that are learned. iterations: of L-BFGS. penalty: on squared weights.

    reversal: velocity over which friction turns, as a share of the largest speed.
    """

    preparation: Preparation = field(default_factory=Preparation)
    nodes: int = 24
    rows: int = 3000
    iterations: int = 200
    penalty: float = 1e-5
    reversal: float = 0.01

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Random numbers draw the first weights. There are no physical estimates."""
        import torch

        begin = time.perf_counter()
        joints = check_logs(logs)
        facts, n = logs[0].facts, len(joints)
        bandwidth = min(self.preparation.equations([log.joint(j) for log in logs]).bandwidth for j in joints)
        parts = [BandLimited(bandwidth).signals(log) for log in logs]
        every = max(1, sum(map(len, parts)) // self.rows)
        stacked = [
            np.concatenate([signal(part)[::every] for part in parts])
            for signal in (
                lambda p: p.motion.position, lambda p: p.motion.velocity, lambda p: p.motion.acceleration,
                lambda p: p.motion.jerk, lambda p: p.command,
            )
        ]  # fmt: skip
        centre, scale = np.mean(stacked[0], axis=0), np.std(stacked[0], axis=0)
        power = np.std(stacked[4], axis=0)
        turn = self.reversal * np.max(np.abs(stacked[1]), axis=0)
        speed = np.std(stacked[1], axis=0)
        lagging = np.array([fact.input == "voltage" for fact in facts])
        first = linear_joints(stacked, turn, lagging)  # inertia, T, k, o and f of every joint by itself
        entries = n * (n + 1) // 2
        start = np.zeros(entries + 1)
        start[[i * (i + 3) // 2 for i in range(n)]] = np.sqrt(first[0] * scale / power)
        begins = [
            rng.uniform(-1.0, 1.0, (self.nodes, n)),
            rng.uniform(-1.0, 1.0, self.nodes),
            0.01 * rng.normal(size=(entries + 1, self.nodes)) * float(np.max(start)),
            start,
            np.zeros(n),  # ln c over the command's deviation
            np.log(np.maximum(first[1], 1e-4)),  # ln T
            first[2] * speed / power,  # k, o and f in the command's deviation
            first[3] / power,
            first[4] / power,
        ]
        edges = np.cumsum([0, *(part.size for part in begins)])
        q, v, a, j = (torch.from_numpy(part / scale) for part in (stacked[0] - centre, *stacked[1:4]))
        target = torch.from_numpy(stacked[4] / power)
        pace, sign = torch.from_numpy(stacked[1] / speed), torch.from_numpy(np.tanh(stacked[1] / turn))
        lag_on = torch.from_numpy(lagging.astype(float))
        curve: list[float] = []

        def loss_and_gradient(flat: Array) -> tuple[float, Array]:
            x = torch.tensor(flat, requires_grad=True)
            w = [x[lo:hi].reshape(part.shape) for (lo, hi), part in zip(pairwise(edges), begins, strict=True)]
            lag = lag_on * torch.exp(w[5])
            force = generalised_force(w[0], w[1], w[2], w[3], q, v, a + lag * j)
            command = torch.exp(w[4]) * force + w[6] * pace + w[7] + w[8] * sign
            loss = torch.mean((command - target) ** 2)
            total = loss + self.penalty * (torch.sum(w[0] ** 2) + torch.sum(w[2] ** 2)) + 1e-6 * torch.sum(w[4] ** 2)
            (slope,) = torch.autograd.grad(total, x)
            gradient = slope.numpy()
            if not (np.isfinite(total.item()) and np.all(np.isfinite(gradient))):
                return 1e10, np.zeros_like(flat)
            curve.append(loss.item())
            return total.item(), gradient

        found = minimize(
            loss_and_gradient,
            np.concatenate([part.ravel() for part in begins]),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": self.iterations, "maxcor": 20, "ftol": 1e-11, "gtol": 0.0},
        )
        w = [found.x[lo:hi].reshape(part.shape) for (lo, hi), part in zip(pairwise(edges), begins, strict=True)]
        drives = Drives(
            scale=np.exp(w[4]) * power * scale,
            lag=np.where(lagging, np.exp(w[5]), 0.0),
            damping=w[6] * power / speed,
            offset=w[7] * power,
            friction=w[8] * power,
            reversal=turn,
        )
        model = LagrangianModel(
            joints, tuple(fact.input for fact in facts), drives, centre, scale, w[0], w[1], w[2], w[3]
        )
        residuals = [part.command - model.inverse(part.time, part.motion) for part in parts]
        return Fit(
            model=model,
            estimates=Estimates((), (), np.empty(0), np.empty((0, 0))),
            residuals=np.concatenate(residuals).ravel(),
            status=Status.ITERATION_LIMIT if found.nit >= self.iterations else Status.CONVERGED,
            seconds=time.perf_counter() - begin,
            learning_curve=np.minimum.accumulate(curve),
        )


def linear_joints(signals: Sequence[Array], turn: Array, lagging: np.ndarray) -> Array:
    """Inertia, T, k, o and f (5, n) of every joint for itself; a share of the command where none comes out positive."""
    position, velocity, acceleration, jerk, command = signals
    found = np.zeros((5, position.shape[1]))
    for j in range(position.shape[1]):
        friction = np.tanh(velocity[:, j] / turn[j])
        columns = [acceleration[:, j], velocity[:, j], np.ones(len(position)), friction]
        matrix = np.column_stack([*columns, jerk[:, j]] if lagging[j] else columns)
        size = np.linalg.norm(matrix, axis=0)
        values = np.linalg.lstsq(matrix / size, command[:, j], rcond=None)[0] / size
        least = 0.1 * np.std(command[:, j]) / np.std(acceleration[:, j])
        inertia = max(values[0], least)
        lag = max(values[4], 0.0) / inertia if lagging[j] else 0.0
        found[:, j] = inertia, lag, max(values[1], 0.0), values[2], max(values[3], 0.0)
    return found


def generalised_force(
    hidden: torch.Tensor,
    bias: torch.Tensor,
    outer: torch.Tensor,
    offset: torch.Tensor,
    q: torch.Tensor,
    v: torch.Tensor,
    a: torch.Tensor,
) -> torch.Tensor:
    """M a + b for scaled states (N, n), the equation of `_lagrangian` for many states at once."""
    import torch

    n = q.shape[1]
    y = torch.tanh(q @ hidden.T + bias)
    flat = y @ outer.T + offset
    inner = torch.einsum("oh,ih,hk->iok", outer, 1.0 - y * y, hidden)
    rows, columns = np.tril_indices(n)
    lower = torch.zeros((len(q), n, n), dtype=q.dtype)
    lower[:, rows, columns] = flat[:, :-1]
    changes = torch.zeros((len(q), n, n, n), dtype=q.dtype)  # (sample, k, i, j): d L_ij / d q_k
    changes[:, :, rows, columns] = inner[:, :-1].transpose(1, 2)
    half = torch.einsum("skil,sjl->skij", changes, lower)
    change = half + half.transpose(2, 3)
    moved = torch.einsum("skij,sj->ski", change, v)
    mass = torch.einsum("sil,sjl,sj->si", lower, lower, a) + SMALL * a
    return mass + torch.einsum("sk,ski->si", v, moved) - 0.5 * torch.einsum("si,ski->sk", v, moved) + inner[:, -1]
