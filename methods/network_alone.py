"""A network without a model: the whole inverse dynamics v = U' f(W s) learned from the log, no physics inside."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from envs.log import Log
from methods.base import Estimates, Fit, Method, single_joint
from methods.differentiation import BandLimited, Differentiator
from methods.full_batch import FullBatch
from methods.joint_equation import network_values
from methods.joint_model import JointModel
from methods.network_training import Trainer, train_network
from methods.registry import METHODS
from methods.two_layer_network import FOUR_SIGNALS, NetworkInputs, network_inputs


@METHODS.register("network_alone", "single-joint", "black-box")
@dataclass(frozen=True)
class NetworkAlone(Method):
    """`hidden_nodes` sigmoid nodes with biases, trained on vd itself."""

    differentiator: Differentiator = field(default_factory=BandLimited)
    inputs: NetworkInputs = FOUR_SIGNALS
    hidden_nodes: int = 10
    trainer: Trainer = field(default_factory=FullBatch)
    with_bias: bool = True

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """From a random start. There are no physical estimates."""
        begin = time.perf_counter()
        joint = single_joint(logs)
        signals = [self.differentiator.signals(log) for log in logs]
        inputs = np.concatenate([network_inputs(part.motion, self.inputs) for part in signals])
        command = np.concatenate([part.command[:, 0] for part in signals])
        network, curve, status = train_network(
            inputs, command, self.inputs, self.hidden_nodes, self.trainer, self.with_bias, rng
        )
        model = JointModel(joint, logs[0].facts[0].input, columns=(), coefficients=np.empty(0), network=network)
        return Fit(
            model=model,
            estimates=Estimates((), (), np.empty(0), np.empty((0, 0))),
            residuals=command - network_values(network.flat, inputs),
            status=status,
            seconds=time.perf_counter() - begin,
            learning_curve=curve,
        )
