"""Predictors of growing order: what an autoregression says of samples that have too few before them.

The Levinson recursion backwards turns an autoregression of order p into the best predictors of every lower order m and
their variances v_m over that of the innovations, v_p = 1. With them the beginning x of a stationary signal has the
exact likelihood ``-2 ln L = sum_m ln v_m + sum_m (x_m - prediction)^2 / v_m`` (P. J. Brockwell, R. A. Davis, Time
Series: Theory and Methods, 1991, sections 5.2 and 8.7).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from envs.log import Array

SHRINKS = (0.0, *(10.0 ** (0.5 * k) for k in range(-10, 3)))
"""Over its order, how much the roots of an autoregression that is not stable are drawn in, the least that is enough."""


def growing_predictors(autoregression: Array) -> tuple[Array, float]:
    """Filters (p, p) that whiten the first p samples of a stationary signal, and the sum of ln v_m.

    autoregression (p + 1,): prediction-error filter, leading coefficient 1. Row m holds what is applied to the samples
    0 ... m, scaled by ``1 / sqrt(v_m)``. An unstable one has no stationary signal: its roots are drawn towards zero.
    """
    order = len(autoregression) - 1
    filters = np.zeros((order, order))
    for shrink in SHRINKS:
        own = autoregression * np.exp(-shrink / max(order, 1)) ** np.arange(order + 1)
        logarithm = _step_down(own, filters)
        if np.isfinite(logarithm):
            return filters, float(logarithm)
    return np.eye(order), 0.0


@njit(cache=True)
def _step_down(autoregression: Array, filters: Array) -> float:
    """Fills `filters` and returns the sum of ln v_m, or infinity where a reflection coefficient reaches 1."""
    order = len(autoregression) - 1
    current, lower = autoregression.copy(), autoregression.copy()
    variance, total = 1.0, 0.0
    for m in range(order, 0, -1):
        k = current[m]
        rest = 1.0 - k * k
        if not rest > 1e-12:
            return np.inf
        for i in range(m):
            lower[i] = (current[i] - k * current[m - i]) / rest
        variance /= rest
        total += np.log(variance)
        scale = 1.0 / np.sqrt(variance)
        for i in range(m):
            current[i] = lower[i]
            filters[m - 1, m - 1 - i] = lower[i] * scale
    return total
