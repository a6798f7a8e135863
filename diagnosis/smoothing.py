"""Velocities and accelerations from readings with noise: how long local polynomials have to be, and a Wiener filter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from diagnosis.problem import bandwidth, smooth_derivatives, start_window
from envs.log import Array

SMOOTHED = 0.1
"""Longest local cubics that give velocities and accelerations, in periods of the fastest motion."""
NOISE = 0.01
"""Noise of the accelerations, as a share of their rms, that is aimed at."""
CERTAIN = 10.0
"""Times that noise is subtracted from a spectrum: what is left of an acceleration's is motion."""
RESOLUTION = 0.5
"""Width [Hz] over which power spectra are averaged."""
NOISY = 0.25
"""Frequency as a share of the sampling rate above which readings are taken to be noise."""


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


def motion_of(time: Array, reading: Array, seconds: float) -> tuple[Array, Array, Array]:
    """Angle, velocity and acceleration (T, n) from readings (T, n) by a Wiener filter.

    Of a spectrum S(f) the share ``max(0, 1 - c N / S(f))`` counts as motion: N is the noise's, the median of the upper
    half of frequencies, and c = `CERTAIN`. Where the motion is far above the noise all of it passes, however fast it
    is; local polynomials that are long enough for the same noise take a part of it away. They still give the first and
    last `seconds`, which no spectrum knows the neighbourhood of.
    """
    local = smooth_derivatives(time, reading, seconds)
    h, count = float(np.median(np.diff(time))), len(time)
    edge = round(seconds / h)
    if count < 4 * edge:
        return local
    around = np.concatenate([2.0 * reading[:1] - reading[:0:-1], reading, 2.0 * reading[-1:] - reading[-2::-1]])
    line = np.linspace(around[0], around[-1], len(around))
    spectrum, frequency = np.fft.rfft(around - line, axis=0), np.fft.rfftfreq(len(around), h)
    width = max(5, round(RESOLUTION * len(around) * h))
    power = uniform_filter1d(np.abs(spectrum) ** 2, width, axis=0, mode="nearest")
    noise = np.median(power[frequency > NOISY / h], axis=0)
    spectrum *= np.clip(1.0 - CERTAIN * noise / np.maximum(power, 1e-300), 0.0, 1.0)
    inner = slice(count - 1 + edge, 2 * count - 1 - edge)
    turn = 2j * np.pi * frequency[:, None]
    slope = (line[-1] - line[0]) / (h * (len(line) - 1))
    for order, (own, straight) in enumerate(zip(local, (line[inner], slope, 0.0), strict=True)):
        own[edge : count - edge] = np.fft.irfft(spectrum * turn**order, len(around), axis=0)[inner] + straight
    return local
