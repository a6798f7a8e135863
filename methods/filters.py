"""Compiled finite-impulse-response filter for many signals at once."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from envs.log import Array


@njit(cache=True, parallel=True, fastmath=True)
def prediction_filter(signals: Array, coefficients: Array) -> Array:
    """y[c, k] = sum_i coefficients[i] signals[c, k - i] with zeros before the beginning; signals (C, T), result (C, T)."""
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
            for k in range(max(first, i), last):
                result[c, k] += a * signals[c, k - i]
    return result
