"""The compiled simulator with a network per joint beside it, evaluated once per sample and held until the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numba import njit

from envs.log import Array
from methods.joint_equation import network_value
from methods.two_layer_network import TwoLayerNetwork


def pack(networks: Sequence[TwoLayerNetwork | None]) -> Array:
    """Networks of angle and velocity as rows of an array; a row of zeros where a joint has none."""
    flat = [np.zeros(1) if network is None else network.flat for network in networks]
    rows = np.zeros((len(flat), max(map(len, flat))))
    for row, values in zip(rows, flat, strict=True):
        row[: len(values)] = values
    return rows


@lru_cache(maxsize=4)
def compensated(advance: Callable) -> Callable:
    """`advance` of a kernel's module with packed networks as an additional first argument.

    Before every sample the networks' outputs at angle and velocity become the additional torque that resists.
    """

    @njit
    def run(networks, first, last, t, u, cumulative, hold, y, x, extra, S, z, P, on, pair, rigid, leak, rate_leak,
            substeps, out, motion):  # fmt: skip
        for k in range(first, last):
            for j in range(len(networks)):
                if networks[j, 0] > 0.0:
                    extra[k, j] = network_value(networks[j], 0, S[j, 0], S[j, 1], 0.0, 0.0)
            advance(k, k + 1, t, u, cumulative, hold, y, x, extra, S, z, P, on, pair, rigid, leak, rate_leak,
                    substeps, out, motion)  # fmt: skip

    return run
