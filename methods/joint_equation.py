"""The compiled equation of `JointModel`, (6) of the paper, with its network.

F = a1 q''' + a2 q'' + a3 q' + a4 + a5 tanh(q'/w) + a6 q + a7 sin q + a8 cos q + N(q, q', q'', q''') - u

These functions call one another and therefore share a file: numba's cache notices a change only in the file of the
function that it has compiled, not in what that function calls.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from methods.equation import compile_balance


@njit(cache=True)
def network_value(flat, start, q, dq, ddq, jerk):
    """v2 of one sample from the layout of `TwoLayerNetwork.flat`, beginning at flat[start]."""
    m, h = int(flat[start]), int(flat[start + 1])
    at = start + 2
    value = flat[at + h * (m + 2)]
    for _ in range(h):
        z = flat[at + m] + flat[at] * q + flat[at + 1] * dq
        if m == 4:
            z += flat[at + 2] * ddq + flat[at + 3] * jerk
        value += flat[at + m + 1] / (1.0 + np.exp(-z))
        at += m + 2
    return value


@njit(cache=True)
def network_values(flat, inputs):
    """v2 for inputs (T, m), shape (T,)."""
    values = np.empty(len(inputs))
    four = inputs.shape[1] == 4
    for k in range(len(inputs)):
        ddq = inputs[k, 2] if four else 0.0
        jerk = inputs[k, 3] if four else 0.0
        values[k] = network_value(flat, 0, inputs[k, 0], inputs[k, 1], ddq, jerk)
    return values


@compile_balance
def joint_balance(p, q, dq, ddq, jerk, u):
    """F; p = (a1..a8, w, the network's flat layout)."""
    value = p[0] * jerk + p[1] * ddq + p[2] * dq + p[3] + p[5] * q - u
    if p[4] != 0.0:
        value += p[4] * np.tanh(dq / p[8])
    if p[6] != 0.0 or p[7] != 0.0:
        value += p[6] * np.sin(q) + p[7] * np.cos(q)
    if p[10] > 0.0:
        value += network_value(p, 9, q, dq, ddq, jerk)
    return value
