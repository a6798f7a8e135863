"""Finite-impulse-response filters for many signals at once: compiled where short, by FFT where long."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.signal import oaconvolve

from envs.log import Array

LONG = 96
"""Number of coefficients from which the FFT is faster than a direct sum."""


def prediction_filter(signals: Array, coefficients: Array) -> Array:
    """y[c, k] = sum_i coefficients[i] signals[c, k - i] with zeros before the beginning; signals (C, T), result (C,
    T)."""
    if np.count_nonzero(coefficients) < LONG:
        return _direct(signals, coefficients)
    return np.asarray(oaconvolve(signals, coefficients[None], axes=1)[:, : signals.shape[1]])


@njit(cache=True, parallel=True, fastmath=True)
def _direct(signals: Array, coefficients: Array) -> Array:
    count, length = signals.shape
    order = len(coefficients)
    result = np.zeros((count, length))
    block = 4096
    blocks = (length + block - 1) // block
    for task in prange(count * blocks):
        c, first = task // blocks, (task % blocks) * block
        last = min(first + block, length)
        for i in range(order):
            a = coefficients[i]
            if a == 0.0:
                continue
            for k in range(max(first, i), last):
                result[c, k] += a * signals[c, k - i]
    return result


@njit(cache=True, parallel=True, fastmath=True)
def filter_at(signals: Array, coefficients: Array, rows: NDArray[np.int64]) -> Array:
    """The same filter evaluated at chosen rows only; result (C, len(rows))."""
    count = signals.shape[0]
    result = np.zeros((count, len(rows)))
    for task in prange(count * len(rows)):
        c, r = task // len(rows), task % len(rows)
        k = rows[r]
        total = 0.0
        for i in range(min(len(coefficients), k + 1)):
            total += coefficients[i] * signals[c, k - i]
        result[c, r] = total
    return result
