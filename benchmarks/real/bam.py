"""The friction models m1 to m6 of the XL330's authors, written after their paper, driven by the recorded voltage.

With motor torque ``t_m = kt (V - kt q') / R`` and gravity ``t_e = -m g l sin(q + offset)`` a budget of friction
``F(t_m, t_e, q')`` is spent to stop the joint: friction is whatever stops it within a step, but at most F plus viscous
friction::

    F = base + |external t_e - motor t_m|
        + exp(-|q' / v_s|^alpha) (stribeck + |external_stribeck t_e - motor_stribeck t_m| + quadratic)

where `quadratic` (m6) is external_quad t_e^2 when the motor drives against the load, motor_quad t_m^2 when it is
driven.

Source: M. Duclusaud, G. Passault, Extended friction models for the physics simulation of servo actuators, ICRA 2025
(arXiv 2410.08650).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numba import njit
from scipy.optimize import least_squares

from diagnosis.problem import Problem
from envs.log import Array

NAMES = (
    "kt", "R", "armature", "q_offset", "friction_base", "friction_viscous", "friction_stribeck", "dtheta_stribeck",
    "alpha", "load_friction_motor", "load_friction_external", "load_friction_motor_stribeck",
    "load_friction_external_stribeck", "load_friction_motor_quad", "load_friction_external_quad",
)  # fmt: skip
"""Parameters of the richest model in the order of the simulator; all others are special cases."""
UPPER = dict(zip(NAMES, (3, 20, 0.05, 0.2, 0.2, 1, 0.2, 20, 10, 1, 1, 1, 1, 0.1, 0.1), strict=True))
FREE: dict[str, tuple[str, ...]] = {
    "m1": NAMES[:6],
    "m2": NAMES[:9],
    "m3": (*NAMES[:6], "load_friction_base"),
    "m4": (*NAMES[:9], "load_friction_base", "load_friction_stribeck"),
    "m5": NAMES[:13],
    "m6": NAMES,
}
"""Free parameters of each model; a load friction without direction is the same on the motor's and the load's side."""
MASS, LENGTH, GRAVITY = 0.49, 0.10, 9.80665
STEP = 1e-3
"""Longest step of the integration [s]."""
STEP_SHARE = 2e-3
"""Relative step of the finite differences."""


@dataclass(frozen=True, eq=False)
class Bam:
    """One of the models with its parameters by the authors' names."""

    name: str
    values: Mapping[str, float]

    def vector(self) -> Array:
        """All parameters of the simulator; those that the model does not have are zero."""
        own = dict(self.values)
        if "load_friction_base" in own:
            own["load_friction_motor"] = own["load_friction_external"] = own["load_friction_base"]
        if "load_friction_stribeck" in own:
            both = own["load_friction_stribeck"]
            own["load_friction_motor_stribeck"] = own["load_friction_external_stribeck"] = both
        own.setdefault("dtheta_stribeck", 1.0)
        own.setdefault("alpha", 1.0)
        return np.array([own.get(name, 0.0) for name in NAMES])


def errors(problem: Problem, vectors: Array) -> Array:
    """Measured minus simulated position (C, T) of parameter vectors (C, 15), window by window of a problem."""
    vectors = np.atleast_2d(vectors)
    out = np.empty((len(vectors), len(problem.time)))
    for i, vector in enumerate(vectors):
        _simulate(
            problem.time, problem.command[:, 0], problem.reading[:, 0], problem.bounds, problem.starts[:, 0], vector,
            MASS * LENGTH**2, MASS * GRAVITY * LENGTH, STEP, out[i],
        )  # fmt: skip
    return out


@njit(cache=True)
def _simulate(time, volts, reading, bounds, starts, p, load, weight, longest, out):
    """Semi-implicit Euler with friction as the authors have it: at most what stops the joint within the step."""
    kt, resistance, armature, offset, base, viscous, stribeck, speed, alpha = p[:9]
    motor, external, motor_slow, external_slow, motor_quad, external_quad = p[9:]
    inertia = load + armature
    for i in range(len(bounds) - 1):
        q, dq = starts[i, 0], starts[i, 1]
        for k in range(bounds[i], bounds[i + 1]):
            out[k] = reading[k] - q
            if k + 1 == bounds[i + 1]:
                break
            span = time[k + 1] - time[k]
            steps = math.ceil(span / longest)
            h = span / steps
            for _ in range(steps):
                driving = kt * (volts[k] - kt * dq) / resistance
                gravity = -weight * math.sin(q + offset)
                budget = base + abs(external * gravity - motor * driving)
                slow = math.exp(-(abs(dq / speed) ** alpha))
                extra = stribeck + abs(external_slow * gravity - motor_slow * driving)
                if gravity * driving < 0.0:
                    if abs(gravity) < abs(driving):
                        extra += external_quad * gravity**2
                    else:
                        extra += motor_quad * driving**2
                budget += slow * extra + viscous * abs(dq)
                net = driving + gravity
                stop = inertia / h * dq + net
                net -= math.copysign(min(abs(stop), budget), stop)
                dq += net / inertia * h
                q += dq * h
    return out


def rms(problem: Problem, model: Bam) -> float:
    """Rms distance of the free simulation [rad]."""
    return float(np.sqrt(np.mean(errors(problem, model.vector())[0] ** 2)))


def refit(problem: Problem, name: str, starts: Sequence[Bam], evaluations: int = 40) -> Bam:
    """The model with the parameters that minimise the window error, the best over several starting points."""
    best: tuple[float, Bam] | None = None
    names = FREE[name]
    upper = np.array([UPPER.get(n, 1.0) for n in names], dtype=float)
    lower = np.where(np.array(names) == "q_offset", -upper, 1e-9)
    lower[[i for i, n in enumerate(names) if n == "alpha"]] = 0.5
    lower[[i for i, n in enumerate(names) if n == "dtheta_stribeck"]] = 0.05
    for start in starts:
        begin = np.array([start.values.get(n, 0.0) for n in names])
        scale = np.maximum(np.abs(begin), 0.02 * upper)
        model = lambda z, s=scale: Bam(name, dict(zip(names, z * s, strict=True))).vector()  # noqa: E731
        residual = lambda z, m=model: errors(problem, m(z))[0]  # noqa: E731

        jacobian = partial(_jacobian, problem, model, upper / scale)
        z = np.clip(begin / scale, lower / scale + 1e-9, upper / scale - 1e-9)
        found = least_squares(residual, z, jacobian, bounds=(lower / scale, upper / scale), max_nfev=evaluations)
        fitted = Bam(name, dict(zip(names, map(float, found.x * scale), strict=True)))
        if best is None or found.cost < best[0]:
            best = (float(found.cost), fitted)
    assert best is not None
    return best[1]


def _jacobian(problem: Problem, vector: Callable[[Array], Array], upper: Array, z: Array) -> Array:
    """Forward differences of the errors, (T, P); backward ones at an upper bound."""
    steps = np.where(z + STEP_SHARE > upper, -STEP_SHARE, STEP_SHARE)
    moved = np.array([vector(z + step * row) for step, row in zip(steps, np.eye(len(z)), strict=True)])
    return (errors(problem, moved) - errors(problem, vector(z))).T / steps
