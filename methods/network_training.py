"""Fitting the two-layer network to a target signal: what every trainer promises, and the common start.

Inputs are centred and divided by their standard deviation, targets are divided by theirs, and the output layer is
scaled back afterwards, so that learning rates do not depend on whether the command is 10 V or 300 V. The paper is
silent on scaling; without it the vertical joint, whose position never crosses zero, does not learn at all.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass

import numpy as np

from envs.log import Array
from methods.base import Status
from methods.two_layer_network import NetworkInputs, TwoLayerNetwork


@dataclass(frozen=True, eq=False)
class Weights:
    """W (h, m) on scaled inputs, hidden bias (h,), U (h,) and output bias, all for a target of unit deviation."""

    hidden: Array
    hidden_bias: Array
    output: Array
    output_bias: float


class Trainer(abc.ABC):
    """How weights are found. Subclasses are frozen dataclasses."""

    @abc.abstractmethod
    def train(self, inputs: Array, target: Array, start: Weights, with_bias: bool) -> tuple[Weights, Array, Status]:
        """Weights for scaled inputs (T, m) and target (T,), the learning curve, and how it ended.

        The curve is the mean squared error per pass over the data, its first entry that of the start. Without
        `with_bias` both biases stay as they are.
        """


def train_network(
    inputs: Array,
    target: Array,
    variant: NetworkInputs,
    hidden_nodes: int,
    trainer: Trainer,
    with_bias: bool,
    rng: np.random.Generator,
) -> tuple[TwoLayerNetwork, Array, Status]:
    """A network for raw inputs (T, m) and target (T,), its learning curve [target's unit squared] and its status.

    The start is drawn from `rng`: W uniform in [-2, 2] (a node then bends within the range of its inputs), U uniform
    in [-0.1, 0.1].
    """
    input_centre, input_scale = np.mean(inputs, axis=0), np.std(inputs, axis=0)
    input_scale[input_scale == 0.0] = 1.0
    target_scale = float(np.std(target)) or 1.0
    start = Weights(
        hidden=rng.uniform(-2.0, 2.0, (hidden_nodes, inputs.shape[1])),
        hidden_bias=rng.uniform(-2.0, 2.0, hidden_nodes) if with_bias else np.zeros(hidden_nodes),
        output=rng.uniform(-0.1, 0.1, hidden_nodes),
        output_bias=0.0,
    )
    scaled = (inputs - input_centre) / input_scale
    weights, curve, status = trainer.train(scaled, target / target_scale, start, with_bias)
    network = TwoLayerNetwork(
        inputs=variant,
        hidden=weights.hidden,
        hidden_bias=weights.hidden_bias,
        output=weights.output * target_scale,
        output_bias=weights.output_bias * target_scale,
        input_centre=input_centre,
        input_scale=input_scale,
    )
    return network, curve * target_scale**2, status
