"""One compiled equation per model; inverse and forward simulation derived from it once.

A single joint obeys an implicit equation of third order,

    F(p, q, q', q'', q''', u) = 0                                                          [unit of the command u]

for instance F = a11 q''' + a12 q'' + a13 q' + N(q, q', q'', q''') - u, equation (6) of the paper. Solving it for u
gives the inverse model, solving it for the jerk q''' inside an integrator gives the simulation. Both solutions are
scalar root findings (Newton, with a bracketing search where Newton fails), so that a compensator that depends on the
jerk itself, or one as steep as dry friction, needs no special treatment.

The integrator is the three-stage singly diagonally implicit Runge-Kutta method of order 3 (Alexander, SIAM J. Numer.
Anal. 14 (1977) 1006). It is L-stable: an estimate of the inductance that is a hundred times too small makes the
equation stiff, which must show as a wrong model and not as a crash of the integrator.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import float64, int64, njit, types

from envs.log import Array, Hold, InputKind
from methods.base import Model, Motion, State

BALANCE = float64(float64[::1], float64, float64, float64, float64, float64)
"""Signature of the primitive: F(parameters (P,), q, q', q'', q''', u) -> mismatch [unit of u]."""

compile_balance: Callable = njit(BALANCE, cache=True, fastmath=False, error_model="numpy")
"""Decorator that compiles a Python function with this signature; use it at module level, so that it is cached."""

MAX_STEP = 1e-3  # s; logs sampled more slowly are integrated in several steps per sample
_GAMMA = 0.43586652150845899942  # root of x^3 - 3 x^2 + 3/2 x - 1/6 that makes the method L-stable
_B1 = -(6.0 * _GAMMA**2 - 16.0 * _GAMMA + 1.0) / 4.0
_B2 = (6.0 * _GAMMA**2 - 20.0 * _GAMMA + 5.0) / 4.0
OUT_OF_REACH = 1e9  # magnitude of the state at which a simulation counts as diverged
TOLERANCE = 1e-10  # of a root, relative to 1 + its magnitude
COMMAND, JERK = 0, 1  # what `_root` solves for
_FUNCTION = types.FunctionType(BALANCE)
_ROOT_ARGUMENTS = (_FUNCTION, float64[::1], *(float64,) * 6, int64)


@dataclass(frozen=True, eq=False)
class EquationModel(Model):
    """A single joint given by `balance`, a function compiled by `compile_balance`, and its `parameters`."""

    joint: int
    input: InputKind

    @property
    def joints(self) -> tuple[int, ...]:  # type: ignore[override]
        return (self.joint,)

    @property
    def inputs(self) -> tuple[InputKind, ...]:  # type: ignore[override]
        return (self.input,)

    @property
    @abc.abstractmethod
    def balance(self) -> Callable[[Array, float, float, float, float, float], float]:
        """The equation F. F must be increasing or decreasing in u and in q''' where the model is to be used."""

    @property
    @abc.abstractmethod
    def parameters(self) -> Array:
        """Parameter vector (P,) of the equation, contiguous."""

    def inverse(self, time: Array, motion: Motion, command: Array | None = None) -> Array:
        """Command (T, 1) with F = 0; NaN where the equation does not determine it."""
        columns = (motion.position, motion.velocity, motion.acceleration, motion.jerk)
        solved = _inverse(self.balance, self.parameters, *(np.array(column[:, 0]) for column in columns))
        return solved[:, None]

    def simulate(self, time: Array, command: Array, initial: State, hold: Hold = "zero_order") -> Motion:
        """Motion (T, 1) with F = 0 at the stages of the integrator; NaN from divergence on.

        Where a held command jumps, the jerk does too; the value given is the one before the jump.
        """
        position, velocity, acceleration, jerk = _simulate(
            self.balance,
            self.parameters,
            np.array(time, dtype=np.float64),
            np.array(command[:, 0], dtype=np.float64),
            initial.position[0],
            initial.velocity[0],
            initial.acceleration[0],
            hold == "first_order",
        )
        return Motion(position, velocity, acceleration, jerk)


@njit(float64(*_ROOT_ARGUMENTS), cache=True, error_model="numpy")
def _mismatch(balance, p, q, dq, ddq, x, u, given, unknown):
    """F at a trial value x of the unknown, see `_root`."""
    if unknown == COMMAND:
        return balance(p, q, dq, ddq, given, x)
    ddq_s = ddq + given * x
    dq_s = dq + given * ddq_s
    q_s = q + given * dq_s
    return balance(p, q_s, dq_s, ddq_s, x, u)


@njit(types.UniTuple(float64, 2)(*_ROOT_ARGUMENTS, float64), cache=True, error_model="numpy")
def _root(balance, p, q, dq, ddq, x0, u, given, unknown, slope):
    """Root x of F near x0, NaN when none is found, and the slope dF/dx last used; `slope` 0: not known yet.

    unknown = COMMAND: x is u, `given` the jerk. unknown = JERK: x is the jerk, `given` the stage's step g, so that
    ddq_s = ddq + g x, dq_s = dq + g ddq_s, q_s = q + g dq_s (g = 0: the jerk at a known state).
    Newton with a difference quotient that is kept while it serves; where that does not settle, a growing bracket and
    the Illinois secant.
    """
    x = x0
    last = np.inf
    for iteration in range(24):
        f = _mismatch(balance, p, q, dq, ddq, x, u, given, unknown)
        if slope == 0.0 or abs(f) > 0.1 * last:
            delta = 1e-6 * (1.0 + abs(x))
            slope = (_mismatch(balance, p, q, dq, ddq, x + delta, u, given, unknown) - f) / delta
            if slope == 0.0 and iteration == 0:
                return np.nan, 0.0  # F does not contain the unknown
        if slope == 0.0 or not np.isfinite(f) or not np.isfinite(slope):
            break
        step = -f / slope
        x += step
        if abs(step) <= TOLERANCE * (1.0 + abs(x)):
            return x, slope
        last = abs(f)
    width = 1e-3 * (1.0 + abs(x0))
    bracketed = False
    for _ in range(60):
        low, high = x0 - width, x0 + width
        f_low = _mismatch(balance, p, q, dq, ddq, low, u, given, unknown)
        f_high = _mismatch(balance, p, q, dq, ddq, high, u, given, unknown)
        if f_low * f_high <= 0.0 and f_low != f_high:
            bracketed = True
            break
        width *= 2.0
    if not bracketed:
        return np.nan, 0.0
    kept = 0
    for _ in range(100):
        x = (low * f_high - high * f_low) / (f_high - f_low)
        f = _mismatch(balance, p, q, dq, ddq, x, u, given, unknown)
        if f * f_high > 0.0:
            high, f_high = x, f
            if kept == -1:
                f_low *= 0.5
            kept = -1
        else:
            low, f_low = x, f
            if kept == 1:
                f_high *= 0.5
            kept = 1
        if f == 0.0 or f_low == f_high or abs(high - low) <= TOLERANCE * (1.0 + abs(x)):
            break
    return x, 0.0


@njit(float64[::1](_FUNCTION, *(float64[::1],) * 5), cache=True, error_model="numpy")
def _inverse(balance, p, q, dq, ddq, jerk):
    command = np.empty(len(q))
    guess, slope = 0.0, 0.0
    for k in range(len(q)):
        command[k], slope = _root(balance, p, q[k], dq[k], ddq[k], guess, 0.0, jerk[k], COMMAND, slope)
        guess = command[k] if np.isfinite(command[k]) else 0.0
    return command


@njit(
    types.UniTuple(float64[::1], 4)(_FUNCTION, *(float64[::1],) * 3, *(float64,) * 3, types.boolean),
    cache=True,
    error_model="numpy",
)
def _simulate(balance, p, time, command, q, dq, ddq, interpolate):
    size = len(time)
    position, velocity, acceleration, jerk = (
        np.full(size, np.nan),
        np.full(size, np.nan),
        np.full(size, np.nan),
        np.full(size, np.nan),
    )
    j, _ = _root(balance, p, q, dq, ddq, 0.0, command[0], 0.0, JERK, 0.0)
    if not np.isfinite(j):  # an equation of second order leaves the jerk open
        j = 0.0
    slope = 0.0
    for k in range(size):
        position[k], velocity[k], acceleration[k], jerk[k] = q, dq, ddq, j
        if k == size - 1:
            break
        interval = time[k + 1] - time[k]
        steps = max(1, int(np.ceil(interval / MAX_STEP - 1e-6)))
        h = interval / steps
        g, r, b1, b2 = _GAMMA * h, 0.5 * (1.0 - _GAMMA) * h, _B1 * h, _B2 * h
        rise = (command[k + 1] - command[k]) / interval if interpolate else 0.0
        for n in range(steps):
            u = command[k] + rise * n * h
            # stage 1 at g
            j1, slope = _root(balance, p, q, dq, ddq, j, u + rise * g, g, JERK, slope)
            a1 = ddq + g * j1
            v1 = dq + g * a1
            # stage 2 at g + r
            j2, slope = _root(balance, p, q + r * v1, dq + r * a1, ddq + r * j1, j1, u + rise * (g + r), g, JERK, slope)
            a2 = ddq + r * j1 + g * j2
            v2 = dq + r * a1 + g * a2
            # stage 3 at h: its value is the new state
            q = q + b1 * v1 + b2 * v2
            dq = dq + b1 * a1 + b2 * a2
            ddq = ddq + b1 * j1 + b2 * j2
            j, slope = _root(balance, p, q, dq, ddq, j2, u + rise * h, g, JERK, slope)
            ddq += g * j
            dq += g * ddq
            q += g * dq
            if not (abs(q) < OUT_OF_REACH and abs(dq) < OUT_OF_REACH and abs(ddq) < OUT_OF_REACH):
                return position, velocity, acceleration, jerk
    return position, velocity, acceleration, jerk
