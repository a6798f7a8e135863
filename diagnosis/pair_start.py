"""Where the fit of a planar pair begins: one regression of both commands, sharing the arm's inertias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from envs.log import Array

OWN = 4
"""Columns that a joint has to itself: its inertia, damping, dry friction and offset."""


@dataclass(frozen=True, eq=False)
class PairStart:
    """Inertias p1 and p2 and coupling p3 in units of joint 1, unit ratio s, inertia of joint 2 in its own units,
    damping per joint (2,), gravity (2, 2): sine and cosine per joint in its own units."""

    inertia: Array
    shared: float
    coupling: float
    ratio: float
    damping: Array
    gravity: Array


def pair_start(q: Array, dq: Array, ddq: Array, command: Array, *, gravity: bool) -> PairStart:
    """Least squares of both equations of motion on smoothed signals (T, 2), for the best ratio of the units.

        u1   = (p1 + p2) q1'' + p2 q2'' + p3 (cos q2 (2 q1'' + q2'') - sin q2 (2 q1' q2' + q2'^2)) + own terms
        u2   = I2 q2'' + s p2 q1'' + s p3 (cos q2 q1'' + sin q2 q1'^2) + own terms

    Given s it is linear; s is searched. The equations are weighted with what each leaves by itself. Inertias that a
    robot cannot have are replaced by the nearest that it can.
    """
    c, s = np.cos(q[:, 1]), np.sin(q[:, 1])
    f1 = c * (2 * ddq[:, 0] + ddq[:, 1]) - s * (2 * dq[:, 0] * dq[:, 1] + dq[:, 1] ** 2)
    f2 = c * ddq[:, 0] + s * dq[:, 0] ** 2
    own = [
        np.stack([ddq[:, j], dq[:, j], np.tanh(dq[:, j] / (0.05 * np.std(dq[:, j]) + 1e-12)), np.ones(len(q))], axis=1)
        for j in range(2)
    ]
    both = q[:, 0] + q[:, 1]
    first = np.stack([np.sin(q[:, 0]), np.cos(q[:, 0])], axis=1) if gravity else np.zeros((len(q), 0))
    second = np.stack([np.sin(both), np.cos(both)], axis=1) if gravity else np.zeros((len(q), 0))
    blank = np.zeros_like(own[0])

    def system(ratio: float) -> tuple[Array, Array]:
        upper = np.column_stack([ddq.sum(axis=1), f1, own[0], blank, first, second / ratio])
        lower = np.column_stack([ratio * ddq[:, 0], ratio * f2, blank, own[1], 0 * first, second])
        return upper, lower

    def alone(matrix: Array, target: Array) -> tuple[Array, float]:
        solution = _solve([matrix], [target])
        return solution, float(np.std(target - matrix @ solution)) + 1e-12 * float(np.std(target)) + 1e-300

    upper, lower = system(1.0)
    x1, noise1 = alone(np.column_stack([upper[:, :2], own[0], first, second]), command[:, 0])
    x2, noise2 = alone(np.column_stack([lower[:, :2], own[1], second]), command[:, 1])
    sides = [command[:, 0] / noise1, command[:, 1] / noise2]

    def cost(logarithm: float) -> float:
        matrices = [part / noise for part, noise in zip(system(np.exp(logarithm)), (noise1, noise2), strict=True)]
        solution = _solve(matrices, sides)
        return float(sum(np.sum((y - m @ solution) ** 2) for m, y in zip(matrices, sides, strict=True)))

    guess = abs(x2[1] / x1[1]) if x1[1] and x2[1] else float(np.std(command[:, 1]) / np.std(command[:, 0]))
    grid = np.log(guess) + np.linspace(-4.0, 4.0, 33)
    best = grid[int(np.argmin([cost(value) for value in grid]))]
    ratio = float(np.exp(minimize_scalar(cost, bounds=(best - 0.25, best + 0.25), method="bounded").x))
    x = _solve([part / noise for part, noise in zip(system(ratio), (noise1, noise2), strict=True)], sides)
    p2, p3, p1, own2 = x[0], x[1], x[2], x[2 + OWN]
    least = 0.02 * max(abs(p1), abs(p2))
    p1, p2, own2 = max(p1, least), max(p2, least), max(own2, ratio * least, ratio * p2)
    bound = 0.95 * np.sqrt(p1 * p2)
    pull = x[2 + 2 * OWN :].reshape(-1, 2) if gravity else np.zeros((2, 2))
    return PairStart(np.array([p1, own2]), p2, float(np.clip(p3, -bound, bound)), ratio, x[[3, 3 + OWN]], pull)


def _solve(matrices: list[Array], targets: list[Array]) -> Array:
    """Least-squares solution of stacked systems, columns scaled."""
    gram = sum(m.T @ m for m in matrices)
    right = sum(m.T @ y for m, y in zip(matrices, targets, strict=True))
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return np.linalg.lstsq(gram / np.outer(scale, scale), right / scale, rcond=1e-12)[0] / scale
