"""Step 2: the paper's learning rule against a numerical gradient, both trainers, both inputs, the network alone."""

from __future__ import annotations

import numpy as np
import pytest
from test_methods_differentiation import TIME, A, held_third_order_log

from envs.log import Log
from methods.back_propagation import BackPropagation
from methods.base import Motion, Status
from methods.compensated_least_squares import CompensatedLeastSquares
from methods.conformance.example import LinearJoint
from methods.differentiation import BandLimited
from methods.full_batch import FullBatch
from methods.joint_model import JointModel
from methods.least_squares import LeastSquares
from methods.network_alone import NetworkAlone
from methods.network_training import Trainer, Weights, train_network
from methods.two_layer_network import FOUR_SIGNALS, TWO_SIGNALS, NetworkInputs, TwoLayerNetwork

INPUTS: tuple[NetworkInputs, ...] = (TWO_SIGNALS, FOUR_SIGNALS)


def log_with_friction(level: float = 0.08) -> Log:
    """The linear joint's motion; the command also has to overcome friction of `level` volts."""
    log = held_third_order_log(A)
    velocity = BandLimited(30.0).signals(log)
    friction = np.zeros(len(log))
    friction[velocity.start : velocity.start + len(velocity)] = level * np.tanh(velocity.motion.velocity[:, 0] / 0.02)
    return Log(time=log.time, command=log.command[:, 0] + friction, position=log.position)


def weights(m: int, nodes: int, seed: int = 0) -> Weights:
    rng = np.random.default_rng(seed)
    return Weights(rng.normal(size=(nodes, m)), rng.normal(size=nodes), rng.normal(size=nodes), 0.3)


def output(w: Weights, s: np.ndarray) -> float:
    return float(w.output @ (1.0 / (1.0 + np.exp(-(w.hidden @ s + w.hidden_bias)))) + w.output_bias)


@pytest.mark.parametrize("m", [2, 4])
def test_one_step_of_back_propagation_is_the_numerical_gradient(m: int) -> None:
    start, s, wanted = weights(m, 5), np.linspace(-1.0, 1.0, m), 0.7
    rule = BackPropagation(output_rate=0.02, hidden_rate=0.05, passes=1)
    moved, _, _ = rule.train(s[None, :], np.array([wanted]), start, with_bias=True)

    def gradient(name: str, index: tuple[int, ...]) -> float:
        ends = []
        for sign in (1.0, -1.0):
            arrays = {key: np.array(getattr(start, key)) for key in ("hidden", "hidden_bias", "output")}
            arrays[name][index] += sign * 1e-6
            ends.append(0.5 * (wanted - output(Weights(**arrays, output_bias=start.output_bias), s)) ** 2)
        return (ends[0] - ends[1]) / 2e-6

    for j in range(5):
        assert moved.output[j] - start.output[j] == pytest.approx(-0.02 * gradient("output", (j,)), rel=1e-5)
        assert moved.hidden_bias[j] - start.hidden_bias[j] == pytest.approx(
            -0.05 * gradient("hidden_bias", (j,)), rel=1e-5
        )
        for i in range(m):
            assert moved.hidden[j, i] - start.hidden[j, i] == pytest.approx(
                -0.05 * gradient("hidden", (j, i)), rel=1e-5, abs=1e-12
            )


@pytest.mark.parametrize("inputs", INPUTS)
def test_the_compiled_network_is_the_formula(inputs: NetworkInputs) -> None:
    rng = np.random.default_rng(1)
    m = 2 if inputs == TWO_SIGNALS else 4
    w = weights(m, 7)
    centre, scale = rng.normal(size=m), rng.uniform(0.5, 2.0, m)
    network = TwoLayerNetwork(inputs, w.hidden, w.hidden_bias, w.output, w.output_bias, centre, scale)
    motion = Motion(*rng.normal(size=(4, 20)))
    signals = np.column_stack((motion.position, motion.velocity, motion.acceleration, motion.jerk))[:, :m]
    expected = [output(w, (row - centre) / scale) for row in signals]
    np.testing.assert_allclose(network(motion), expected, rtol=1e-12)
    model = JointModel(1, "voltage", (), np.empty(0), network)
    np.testing.assert_allclose(model.inverse(np.arange(20.0), motion)[:, 0], expected, rtol=1e-9)


def test_without_bias_the_network_is_a_constant_plus_an_odd_function() -> None:
    rng = np.random.default_rng(2)
    network, _, _ = train_network(
        rng.normal(size=(500, 2)), rng.normal(size=500), TWO_SIGNALS, 6, FullBatch(iterations=20, every=1), False, rng
    )
    shift = rng.normal(size=(2, 30))
    there, back = (
        Motion(*(network.input_centre[:, None] + sign * shift), np.zeros(30), np.zeros(30)) for sign in (1, -1)
    )
    np.testing.assert_allclose(network(there) + network(back), np.sum(network.output), rtol=1e-9)


@pytest.mark.parametrize("inputs", INPUTS)
@pytest.mark.parametrize("trainer", [BackPropagation(), FullBatch()], ids=["rule", "lbfgs"])
def test_the_compensator_learns_the_friction_that_step_1_leaves(inputs: NetworkInputs, trainer: Trainer) -> None:
    log = log_with_friction()
    step_1 = LeastSquares().fit([log], np.random.default_rng(0))
    method = CompensatedLeastSquares(inputs=inputs, trainer=trainer)
    fit = method.fit([log], np.random.default_rng(0))
    assert np.std(fit.residuals) < 0.4 * np.std(step_1.residuals)
    assert fit.learning_curve[-1] < 0.3 * fit.learning_curve[0]
    assert fit.learning_curve[-1] == pytest.approx(np.mean(fit.residuals**2), rel=0.2)
    np.testing.assert_array_equal(fit.estimates.values, step_1.estimates.values)
    again = method.fit([log], np.random.default_rng(0))
    assert fit.residuals.tobytes() == again.residuals.tobytes()
    signals = BandLimited().signals(log)
    returned = fit.model.inverse(signals.time, signals.motion)
    np.testing.assert_allclose(signals.command - returned, fit.residuals[:, None], atol=1e-9)


def test_the_modern_optimiser_ends_lower_than_the_rule() -> None:
    log = log_with_friction()
    ends = [
        CompensatedLeastSquares(trainer=trainer).fit([log], np.random.default_rng(3)).learning_curve[-1]
        for trainer in (BackPropagation(), FullBatch())
    ]
    assert ends[1] < ends[0]


def test_too_fast_a_rule_is_reported_as_failed() -> None:
    with np.errstate(over="ignore"):
        fit = CompensatedLeastSquares(trainer=BackPropagation(output_rate=3.0, hidden_rate=3.0, passes=3)).fit(
            [log_with_friction()], np.random.default_rng(0)
        )
    assert fit.status is Status.FAILED


def test_a_compensator_with_nothing_to_learn_says_so_and_is_no_failure() -> None:
    fit = CompensatedLeastSquares().fit([LinearJoint().log(1)], np.random.default_rng(0))
    assert fit.status is Status.ITERATION_LIMIT
    begun, ended = np.sqrt(fit.learning_curve[[0, -1]])
    assert begun < ended < 2.0 * begun
    assert fit.notes[-1] == f"training does not lower the command's error: from {begun:.3g} to {ended:.3g} V"


def test_a_network_alone_fits_its_record_and_nothing_else() -> None:
    log = log_with_friction()
    fit = NetworkAlone(hidden_nodes=12).fit([log], np.random.default_rng(0))
    assert np.std(fit.residuals) < 0.1 * np.std(log.command)
    other = BandLimited().signals(Log(time=TIME, command=TIME, position=3.0 * TIME**2))
    miss = fit.model.inverse(other.time, other.motion) - (A[1] * 6.0 + A[2] * other.motion.velocity)
    assert np.sqrt(np.mean(miss**2)) > np.std(log.command)
    assert fit.estimates.names == ()
