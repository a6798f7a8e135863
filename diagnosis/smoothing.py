"""How long the local polynomials have to be that give velocities and accelerations from readings with noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.problem import bandwidth, smooth_derivatives, start_window
from envs.log import Array

SMOOTHED = 0.1
"""Longest local cubics that give velocities and accelerations, in periods of the fastest motion."""
NOISE = 0.01
"""Noise of the accelerations, as a share of their rms, that is aimed at."""


def window(readings: Sequence[tuple[Array, Array]]) -> float:
    """Length of the smoothing window [s]: the shortest whose accelerations are good to NOISE, at most a share of the
    period of the frequency that holds 95 % of the velocities' power, of the joint that asks for most of both.

    readings: instants (T,) and positions (T, n) of every stretch.

    A local cubic over N samples of time step h gives accelerations of variance ``720 s^2 / (N^5 h^4)`` from readings
    with noise s, which shows in what the shortest cubic leaves.
    """
    fastest, least, shortest = 0.0, 0.0, 0.0
    for time, position in readings:
        h = float(np.median(np.diff(time)))
        smooth, velocity, acceleration = smooth_derivatives(time, position, start_window(h))
        noise = np.std(position - smooth_derivatives(time, position, 7 * h)[0], axis=0)
        fastest = max(fastest, *(bandwidth(time, column) for column in velocity.T))
        wanted = NOISE * np.std(acceleration, axis=0) + 1e-300
        samples = (720.0 * noise**2 / (h**4 * wanted**2)) ** 0.2
        moving = np.ptp(smooth, axis=0) > 0.1 * np.max(np.ptp(smooth, axis=0))
        least, shortest = max(least, float(np.max(samples[moving])) * h), max(shortest, 8 * h)
    return max(min(least, SMOOTHED / max(fastest, 0.4)), shortest)
