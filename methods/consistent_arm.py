"""The whole arm with inertias that bodies can have: convex identification under linear matrix inequalities.

Scales and time constants are those of `methods.whole_arm`; with them fixed, the equation of `methods.arm` is linear and

    min |r(theta, I, k, o, f)|^2 + pull |theta - theta_0|^2 / size^2
    s.t.  [[tr(J) / 2 - J, h], [h', m]] >= 0 for every body (pseudo-inertia), I, k, f >= 0

is a semidefinite programme, solved to its global optimum by Clarabel (C. Sousa, R. Cortesao, Int. J. Robot. Res. 33
(2014) 931; P. Wensing, S. Kim, J.-J. Slotine, IEEE Robot. Autom. Lett. 3 (2018) 60; P. Goulart, Y. Chen, Clarabel,
2024). Every body then has positive mass and an inertia that some distribution of mass has; what the logs do not tell
stays near the description.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import sparse

from envs.log import Array, Log
from methods.base import Fit, Method, Status
from methods.joint_regression import Preparation
from methods.registry import METHODS
from methods.whole_arm import ArmEquations, Solution, WholeArm, arm_equations, fitted, residuals, solved

PULL = 1e-3
"""Weight of the description: a parameter off by its own size costs as much as a thousandth of one row's variance."""


@METHODS.register("consistent_arm", "multi-joint", "physics")
@dataclass(frozen=True)
class ConsistentArm(Method):
    """robot, preparation, rows: as for `WholeArm`."""

    robot: str | None = None
    preparation: Preparation = field(default_factory=Preparation)
    rows: int = 4000

    @property
    def expected_failures(self) -> Mapping[str, str]:
        return {"covariance": "an estimate on the border of what bodies can have is not normally distributed"}

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Consumes no random numbers."""
        begin = time.perf_counter()
        equations = arm_equations(WholeArm(self.robot, self.preparation, self.rows), logs)
        free = solved(equations, logs)
        solution, status = consistent(equations, free)
        found = fitted(equations, solution, logs)
        lowest = min(
            float(np.linalg.eigvalsh(pseudo_inertia(body))[0])
            for body in np.split(free.model.theta, len(free.model.rotors))
        )
        said = "the free estimate was consistent" if lowest >= 0.0 else "the free estimate was no possible body"
        return replace(found, status=status, seconds=time.perf_counter() - begin, notes=(*found.notes, said))


def pseudo_inertia(theta: Array) -> Array:
    """(4, 4) of one body's ten parameters in Pinocchio's order, see the module."""
    m, hx, hy, hz, xx, xy, yy, xz, yz, zz = theta
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    matrix = np.empty((4, 4))
    matrix[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    matrix[:3, 3] = matrix[3, :3] = hx, hy, hz
    matrix[3, 3] = m
    return matrix


def consistent(equations: ArmEquations, free: Solution) -> tuple[Solution, Status]:
    """The constrained optimum at the free solution's scales and time constants."""
    import clarabel

    n, drives = equations.size, free.model.drives
    described = equations.described
    bodies, rotors = len(equations.start.theta) // 10, len(equations.start.rotors)
    size = np.maximum(np.abs(described), 1e-2)
    weight = 1.0 / free.deviations
    table = np.zeros((*equations.command.shape, len(size) + 3 * n))
    lagged = equations.regressor + drives.lag[:, None] * equations.rate
    table[:, :, : len(size)] = (weight * drives.scale)[:, None] * lagged * size
    own = [np.sqrt(np.mean(equations.velocity**2, axis=0)), np.ones(n), np.ones(n)]
    power = np.std(equations.command, axis=0)
    for k, signal in enumerate((equations.velocity / own[0], np.ones_like(equations.velocity), equations.friction)):
        for j in range(n):
            table[:, j, len(size) + k * n + j] = weight[j] * power[j] * signal[:, j]
    flat, target = table.reshape(-1, table.shape[2]), (weight * equations.command).ravel()
    pull = np.zeros(flat.shape[1])
    pull[: len(size)] = PULL
    quadratic = flat.T @ flat + np.diag(pull)
    linear = -flat.T @ target - pull * np.concatenate((described / size, np.zeros(3 * n)))
    scale = np.trace(quadratic) / len(quadratic)
    not_negative = [
        *range(len(size) - rotors, len(size)),
        *range(len(size), len(size) + n),
        *range(len(size) + 2 * n, len(pull)),
    ]
    rows = [-np.eye(len(pull))[not_negative]]
    for body in range(bodies):
        block = np.zeros((10, len(pull)))
        for k in range(10):
            block[:, 10 * body + k] = -_triangle(pseudo_inertia(np.eye(10)[k])) * size[10 * body + k]
        rows.append(block)
    constraints = sparse.csc_matrix(np.vstack(rows))
    cones = [clarabel.NonnegativeConeT(len(not_negative)), *(clarabel.PSDTriangleConeT(4) for _ in range(bodies))]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(quadratic / scale)),
        linear / scale,
        constraints,
        np.zeros(constraints.shape[0]),
        cones,
        settings,
    )
    found = solver.solve()
    x = np.array(found.x)
    phi = x[: len(size)] * size
    rest = x[len(size) :].reshape(3, n) * power / np.array(own)
    model = replace(
        free.model,
        theta=phi[: 10 * bodies],
        rotors=phi[10 * bodies :],
        drives=replace(drives, damping=rest[0], offset=rest[1], friction=rest[2]),
    )
    left = residuals(equations, phi, model.drives)
    unknown = np.full_like(free.covariance, np.nan)  # an estimate on the border of a cone is not normal
    solution = Solution(free.kept, model, left, np.sqrt(np.mean(left**2, axis=0)), unknown)
    return solution, Status.CONVERGED if "Solved" in str(found.status) else Status.FAILED


def _triangle(matrix: Array) -> Array:
    """Upper triangle, column by column, off-diagonals times the root of two, as Clarabel orders a symmetric matrix."""
    return np.array(
        [matrix[i, j] * (1.0 if i == j else np.sqrt(2.0)) for j in range(len(matrix)) for i in range(j + 1)]
    )
