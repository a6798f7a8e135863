"""Joints that a rigid-body model and one drive each describe: what models of several joints share.

    u_j = c_j (tau_j + T_j tau_j') + k_j q_j' + o_j + f_j (1 + T_j d/dt) tanh(q_j' / w_j),   tau = M(q) q'' + b(q, q')

A family's primitive is M and b at one state (`RigidDynamics`); inverse and simulation follow here once.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from envs.log import Array, Hold
from methods.base import Model, Motion, State

SUBSTEP = 1e-3
"""Longest step of the integrator [s]."""
OUT_OF_REACH = 1e6
"""Speed at which a simulation counts as diverged [rad/s or m/s]."""
LEAST_LAG = 1e-5
"""Time constant below which a winding has none [s]."""


class RigidDynamics(Protocol):
    """M(q) and b(q, q') at one state of n joints, in one unit of torque throughout."""

    def inertia(self, position: Array) -> Array:
        """M, (n, n)."""
        ...

    def bias(self, position: Array, velocity: Array) -> Array:
        """b, (n,): Coriolis, centrifugal and gravity terms."""
        ...


@dataclass(frozen=True, eq=False)
class Drives:
    """Per joint, each (n,): c [command unit per torque], T [s], k, o, f and w of the equation above."""

    scale: Array
    lag: Array
    damping: Array
    offset: Array
    friction: Array
    reversal: Array


class DrivenModel(Model):
    """Joints given by `drives` and by M and b."""

    drives: Drives

    @abc.abstractmethod
    def dynamics(self) -> RigidDynamics:
        """M and b, made ready for many states."""

    def inverse(self, time: Array, motion: Motion, command: Array | None = None) -> Array:
        """Command (T, n); rates of torques are difference quotients along the motion.

        The rate of the friction, an impulse at a reversal, is left out: measured accelerations are too smooth for it.
        """
        rigid, own = self.dynamics(), self.drives
        states = zip(motion.position, motion.velocity, motion.acceleration, strict=True)
        torques = np.array([rigid.inertia(q) @ a + rigid.bias(q, v) for q, v, a in states])
        motor = own.scale * torques
        if np.any(own.lag > LEAST_LAG):
            motor = motor + own.lag * np.gradient(motor, time, axis=0)
        friction = own.friction * np.tanh(motion.velocity / own.reversal)
        return motor + own.damping * motion.velocity + own.offset + friction

    def simulate(self, time: Array, command: Array, initial: State, hold: Hold = "zero_order") -> Motion:
        """Runge-Kutta of order 4 in steps of 1 ms at most; the winding's lag is exact for a held command."""
        rigid, own = self.dynamics(), self.drives
        lagging = own.lag > LEAST_LAG
        lag = np.where(lagging, own.lag, 1.0)
        stiff = np.where(lagging, 0.0, own.damping)  # without a winding the damping acts at once

        def rest(q: Array, v: Array) -> Array:
            return own.scale * rigid.bias(q, v) + own.offset + own.friction * np.tanh(v / own.reversal)

        def at(q: Array, v: Array) -> Callable[[Array], Array]:
            inertia, resisting = rigid.inertia(q), rest(q, v)

            def accelerated(motor: Array) -> Array:
                force = (motor - resisting) / own.scale
                return force / inertia[0] if len(q) == 1 else np.asarray(np.linalg.solve(inertia, force), np.float64)

            return accelerated

        q, v = initial.position.copy(), initial.velocity.copy()
        motor = own.scale * (rigid.inertia(q) @ initial.acceleration) + rest(q, v)
        out = np.full((4, len(time), len(q)), np.nan)
        accelerated = at(q, v)
        for k in range(len(time)):
            out[0, k], out[1, k] = q, v
            out[2, k] = accelerated(np.where(lagging, motor, command[k] - own.damping * v))
            if k == len(time) - 1 or not np.all(np.abs(v) < OUT_OF_REACH):
                break
            span = time[k + 1] - time[k]
            steps = max(1, int(np.ceil(span / SUBSTEP - 1e-6)))
            h = span / steps
            decay = np.where(lagging, np.exp(-h / lag), 0.0)
            share = np.where(lagging, (1.0 - decay) * lag / h, 0.0)
            for i in range(steps):
                u = command[k]
                if hold == "first_order":
                    u = u + (i + 0.5) / steps * (command[k + 1] - command[k])
                final = u - own.damping * v
                mean = final + (motor - final) * share
                a1 = accelerated(mean)
                v2 = v + 0.5 * h * a1
                a2 = at(q + 0.5 * h * v, v2)(mean - stiff * (v2 - v))
                v3 = v + 0.5 * h * a2
                a3 = at(q + 0.5 * h * v2, v3)(mean - stiff * (v3 - v))
                v4 = v + h * a3
                a4 = at(q + h * v3, v4)(mean - stiff * (v4 - v))
                final = u - own.damping * (v + h / 12.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4))
                motor = final + (motor - final) * decay
                q = q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
                v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
                accelerated = at(q, v)
        out[3] = np.gradient(out[2], time, axis=0)
        return Motion(*out)
