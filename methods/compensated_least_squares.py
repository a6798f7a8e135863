"""The paper's two steps: least squares, then a network beside the identified model that learns what is left."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from envs.log import Log
from methods.back_propagation import BackPropagation
from methods.base import Fit, Method
from methods.joint_equation import network_values
from methods.joint_model import JointModel
from methods.least_squares import LeastSquares
from methods.network_training import Trainer, train_network
from methods.registry import METHODS
from methods.two_layer_network import TWO_SIGNALS, NetworkInputs, network_inputs


@METHODS.register("compensated_least_squares", "single-joint", "hybrid")
@dataclass(frozen=True)
class CompensatedLeastSquares(Method):
    """v = Y a + U' f(W s): `step_1` finds a, then `trainer` fits the network to vd - Y a on the same signals.

    inputs: the paper prefers (q, q') so that the compensator can run in real time. with_bias: not in the paper.
    """

    step_1: LeastSquares = field(default_factory=LeastSquares)
    inputs: NetworkInputs = TWO_SIGNALS
    hidden_nodes: int = 10
    trainer: Trainer = field(default_factory=BackPropagation)
    with_bias: bool = False

    @property
    def expected_failures(self) -> Mapping[str, str]:
        if not isinstance(self.trainer, BackPropagation):
            return {}
        return {"order_of_logs": "back-propagation follows the samples in the order of time: the last log weighs most"}

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Step 1 in closed form, step 2 from a random start."""
        begin = time.perf_counter()
        first = self.step_1.fit(logs, rng)
        assert isinstance(first.model, JointModel)
        signals = [self.step_1.differentiator.signals(log) for log in logs]
        inputs = np.concatenate([network_inputs(part.motion, self.inputs) for part in signals])
        target = np.concatenate([part.command[:, 0] - first.model.linear_part(part.motion) for part in signals])
        network, curve, status = train_network(
            inputs, target, self.inputs, self.hidden_nodes, self.trainer, self.with_bias, rng
        )
        begun, ended = np.sqrt(curve[[0, -1]])
        unit = logs[0].facts[0].command_unit
        verb = "lowers" if ended < begun else "does not lower"
        return replace(
            first,
            model=replace(first.model, network=network),
            residuals=target - network_values(network.flat, inputs),
            status=status,
            seconds=time.perf_counter() - begin,
            learning_curve=curve,
            notes=(
                *first.notes,
                f"step 1 {first.status.value}",
                f"training {verb} the command's error: from {begun:.3g} to {ended:.3g} {unit}",
            ),
        )
