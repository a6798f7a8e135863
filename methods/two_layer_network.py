"""The two-layer network of the paper, v2 = U' f(W s): sigmoid hidden layer, linear output (equation (9)).

Two input variants: s = (q, q') and s = (q, q', q'', q'''). Inputs are centred and scaled by fixed numbers before W, so
that the learning rates have the same meaning for rad and rad/s^3.

As printed, neither layer has a bias. Then v2(s) = sum_k u_k / 2 + (an odd function of the centred s): the network can
follow dry friction, but no effect that is even in its inputs and hardly one that depends on the place (cogging).
`with_bias` adds a constant input to the hidden layer and to the output; that is a change against the paper and is
named where used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from envs.log import Array
from methods.base import Motion
from methods.joint_equation import network_values

NetworkInputs = Literal["position, velocity", "position, velocity, acceleration, jerk"]
TWO_SIGNALS: NetworkInputs = "position, velocity"
FOUR_SIGNALS: NetworkInputs = "position, velocity, acceleration, jerk"
INPUT_COUNT: dict[NetworkInputs, int] = {TWO_SIGNALS: 2, FOUR_SIGNALS: 4}


@dataclass(frozen=True, eq=False)
class TwoLayerNetwork:
    """Weights for m inputs and h hidden nodes.

    hidden: W (h, m) [1], acts on (s - input_centre) / input_scale; hidden_bias: (h,); output: U (h,) [unit of the
    command]; output_bias [unit of the command]; input_centre, input_scale: (m,) [unit of the input].
    """

    inputs: NetworkInputs
    hidden: Array
    hidden_bias: Array
    output: Array
    output_bias: float
    input_centre: Array
    input_scale: Array

    def __call__(self, motion: Motion) -> Array:
        """v2 for every sample, shape (T,) [unit of the command]."""
        return network_values(self.flat, network_inputs(motion, self.inputs))

    @property
    def flat(self) -> Array:
        """The layout of `methods.joint_equation`: m, h, per node [W / scale (m), bias, U], then the output bias."""
        scaled = self.hidden / self.input_scale
        nodes = np.column_stack((scaled, self.hidden_bias - scaled @ self.input_centre, self.output))
        return np.concatenate(([len(self.input_scale), len(self.output)], nodes.ravel(), [self.output_bias]))


def network_inputs(motion: Motion, inputs: NetworkInputs) -> Array:
    """Network inputs (T, m) of a single joint's motion."""
    columns = (motion.position, motion.velocity, motion.acceleration, motion.jerk)[: INPUT_COUNT[inputs]]
    return np.ascontiguousarray(np.concatenate([column[:, :1] for column in columns], axis=1))


def pack(networks: Sequence[TwoLayerNetwork | None]) -> Array:
    """Networks of angle and velocity as rows of an array; a row of zeros where a joint has none."""
    flat = [np.zeros(1) if network is None else network.flat for network in networks]
    rows = np.zeros((len(flat), max(map(len, flat))))
    for row, values in zip(rows, flat, strict=True):
        row[: len(values)] = values
    return rows
