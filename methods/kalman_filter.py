"""Extended Kalman filter with the parameters in the state.

State x = (q, q', w, ln J, ln d, ln T_e, load, T_c, g_s, g_c) of the joint of `methods.physical_joint`; dry friction is
T_c tanh(q'/v) here. Between samples the mean is integrated by Runge-Kutta and the covariance follows the Jacobian of
that very step; each position reading corrects both (L. Ljung, IEEE Trans. Autom. Control 24 (1979) 36; for robots
M. Gautier, P. Poignet, Control Eng. Pract. 9 (2001) 1361).

The reading's variance is measured on the log; that of the disturbing acceleration is the one of `levels` with the
likeliest innovations over the first `trial` seconds. The parameters start at IDIM-LS with the uncertainty `doubt`, and
the second pass over the logs starts where the first ended.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit

from envs.log import Array, Log
from envs.log_statistics import position_noise
from methods.base import Fit, Method, Status
from methods.idim_least_squares import IdimLeastSquares
from methods.joint_model import JointModel
from methods.physical_joint import FRICTION, SIGNED, coefficient_estimates, physical_model, physical_parameters
from methods.registry import METHODS
from methods.usable_logs import check_joint

ORDER = ("inertia", "damping", "electrical_time_constant", "load", FRICTION, "gravity_sine", "gravity_cosine")
"""Parameters in the order of the state; ``damping`` is back-EMF or viscous."""
LOGARITHMIC = 3
"""The first so many of them are estimated by their logarithm."""
CAUTIOUS = 4
"""Attempts, each with a third of the doubt of the one before."""
FARTHEST = 30.0
"""Standard deviations of the start beyond which an estimate is lost."""


@METHODS.register("kalman_filter", "single-joint", "physics")
@dataclass(frozen=True)
class KalmanFilter(Method):
    """doubt: relative uncertainty of the start. levels: disturbing acceleration as shares of the acceleration's rms.

    trial: see the module [s]. rounding: velocity over which friction turns, as a share of the largest speed. passes:
    over all logs.
    """

    start: IdimLeastSquares = field(default_factory=IdimLeastSquares)
    doubt: float = 0.3
    levels: tuple[float, ...] = (1e-5, 1e-3, 1e-2, 1e-1)
    trial: float = 8.0
    rounding: float = 0.01
    passes: int = 2

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Consumes no random numbers. Residuals are the innovations of the last pass [rad or m]."""
        begin = time.perf_counter()
        joint, facts = check_joint(logs)
        first = self.start.fit(logs, rng)
        assert isinstance(first.model, JointModel)
        guess = physical_parameters(first.model)
        damping = "back_emf" if "back_emf" in guess else "viscous"
        names = tuple(damping if name == "damping" else name for name in ORDER)
        mean, spread = self._prior(guess, names, logs)
        signals = self.start.preparation.signals(logs)
        speed = max(float(np.max(np.abs(part.motion.velocity))) for part in signals)
        rms = float(np.sqrt(np.mean(np.concatenate([part.motion.acceleration for part in signals]) ** 2)))
        lag = damping == "back_emf"

        def passed(level: float, mean: Array, covariance: Array, most: float) -> tuple[Array, Array, Array, float]:
            innovations, likelihood = [], 0.0
            for log, part in zip(logs, signals, strict=True):
                state = part.motion.state(0)
                noise = max(
                    position_noise(log.position[:, 0]), (log.facts[0].encoder_step or 0.0) / np.sqrt(12.0), 1e-9 * speed
                )
                x = np.concatenate(([state.position[0], state.velocity[0], part.command[0, 0]], mean))
                x[2] -= np.exp(mean[1]) * state.velocity[0] if lag else 0.0
                p = np.diag([noise**2, (0.05 * speed) ** 2, np.var(log.command), *np.zeros(len(mean))])
                p[3:, 3:] = covariance
                rows = slice(part.start, min(len(log), part.start + int(most / log.sample_time)))
                command = log.command[rows, 0]
                if log.facts[0].hold == "first_order":
                    command = np.append(0.5 * (command[1:] + command[:-1]), command[-1])
                errors, value = _filtered(
                    log.position[rows, 0].copy(), command.copy(), log.sample_time, x, p, noise**2,
                    (level * rms) ** 2 * log.sample_time**2, self.rounding * speed, lag,
                )  # fmt: skip
                mean, covariance = x[3:], p[3:, 3:]
                innovations.append(errors)
                likelihood += value
            return mean, covariance, np.concatenate(innovations), likelihood

        def likeliest(level: float) -> float:
            value = passed(level, mean, np.diag(spread**2), self.trial)[3]
            return value if np.isfinite(value) else -np.inf

        begun, notes = mean, []
        for _ in range(CAUTIOUS):
            best = max(self.levels, key=likeliest)
            mean = begun
            for _ in range(self.passes):
                mean, covariance, innovations, _ = passed(best, mean, np.diag(spread**2), 1e9)
            if np.all(np.isfinite(mean)) and np.all(np.abs(mean - begun) < FARTHEST * spread + 1e-12):
                break
            notes.append("the filter lost the joint and was begun again with a third of the doubt")
            mean, spread = begun, spread / 3.0
        else:
            return replace(first, status=Status.FAILED, residuals=innovations, notes=("the filter loses the joint",))
        values = np.concatenate((np.exp(mean[:LOGARITHMIC]), mean[LOGARITHMIC:]))
        slopes = np.concatenate((values[:LOGARITHMIC], np.ones(len(values) - LOGARITHMIC)))
        kept = [k for k, name in enumerate(names) if name in guess]
        named = {names[k]: float(values[k]) for k in kept}
        named[FRICTION] = max(named[FRICTION], 0.0)
        return Fit(
            model=physical_model(joint, facts, named, logs),
            estimates=coefficient_estimates(named, (covariance * np.outer(slopes, slopes))[np.ix_(kept, kept)], facts),
            residuals=innovations,
            status=Status.CONVERGED,
            seconds=time.perf_counter() - begin,
            notes=(*notes, f"disturbing acceleration {best:g} of the acceleration's rms"),
        )

    def _prior(self, guess: dict[str, float], names: tuple[str, ...], logs: Sequence[Log]) -> tuple[Array, Array]:
        """Mean and standard deviation of the parameters; what the joint does not have is held at nothing."""
        deviation = float(np.std(np.concatenate([log.command for log in logs])))
        mean, spread = np.zeros(len(names)), np.zeros(len(names))
        for k, name in enumerate(names):
            if name not in guess:
                mean[k] = -20.0 if k < LOGARITHMIC else 0.0
            elif k < LOGARITHMIC:
                mean[k], spread[k] = np.log(max(guess[name], 1e-12)), self.doubt
            else:
                least = 0.02 if name in (*SIGNED, FRICTION) else 0.0
                mean[k], spread[k] = guess[name], max(self.doubt * abs(guess[name]), least * deviation)
        return mean, spread


@njit(cache=True, error_model="numpy")
def _step(x, u, dt, turn, lag, out):
    """State after one sample with held command u."""
    inertia, damping, te = np.exp(x[3]), np.exp(x[4]), np.exp(x[5])
    lagging = lag and te > 0.02 * dt
    steps = max(1, int(np.ceil(dt / 2e-3)))
    if lagging:
        steps = max(steps, int(np.ceil(dt / te)))
    h = dt / steps
    q, v, w = x[0], x[1], x[2]
    s = np.zeros((4, 3))
    for _ in range(steps):
        for stage in range(4):
            share = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
            last = max(stage - 1, 0)
            qs, vs, ws = q + share * s[last, 0], v + share * s[last, 1], w + share * s[last, 2]
            drive = ws
            if lag and not lagging:
                drive = u - damping * vs
            if not lag:
                drive = u - damping * vs
            force = drive - x[6] - x[7] * np.tanh(vs / turn) - x[8] * np.sin(qs) - x[9] * np.cos(qs)
            s[stage, 0] = vs
            s[stage, 1] = force / inertia
            s[stage, 2] = (u - damping * vs - ws) / te if lagging else 0.0
        q += h / 6.0 * (s[0, 0] + 2.0 * s[1, 0] + 2.0 * s[2, 0] + s[3, 0])
        v += h / 6.0 * (s[0, 1] + 2.0 * s[1, 1] + 2.0 * s[2, 1] + s[3, 1])
        w += h / 6.0 * (s[0, 2] + 2.0 * s[1, 2] + 2.0 * s[2, 2] + s[3, 2])
    out[:] = x
    out[0], out[1], out[2] = q, v, w


@njit(cache=True, error_model="numpy")
def _filtered(reading, command, dt, x, p, noise, disturbance, turn, lag):
    """Innovations and log likelihood; x (n,) and p (n, n) end up behind the last sample."""
    n = len(x)
    errors = np.empty(len(reading))
    likelihood = 0.0
    ahead, moved, trial = np.empty(n), np.empty(n), np.empty(n)
    slope = np.zeros((n, n))
    for k in range(len(reading)):
        e = reading[k] - x[0]
        s = p[0, 0] + noise
        errors[k] = e
        likelihood -= 0.5 * (e * e / s + np.log(s))
        gain = p[:, 0] / s
        for i in range(n):
            x[i] += gain[i] * e
        for i in range(n):
            for j in range(n):
                p[i, j] -= gain[i] * gain[j] * s
        if k == len(reading) - 1:
            break
        _step(x, command[k], dt, turn, lag, ahead)
        for j in range(n):
            trial[:] = x
            size = 1e-6 * (1e-3 + abs(x[j]))
            trial[j] += size
            _step(trial, command[k], dt, turn, lag, moved)
            for i in range(n):
                slope[i, j] = (moved[i] - ahead[i]) / size
        p[:, :] = slope @ p @ slope.T
        for i in range(n):
            for j in range(i):
                mean = 0.5 * (p[i, j] + p[j, i])
                p[i, j] = mean
                p[j, i] = mean
        p[1, 1] += disturbance
        x[:] = ahead
    return errors, likelihood
