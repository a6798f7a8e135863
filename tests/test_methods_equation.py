"""Simulation and inverse from one equation: an analytic oracle, order of convergence, stiffness, implicit jerk."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete, dlsim

from methods.base import Motion, State
from methods.joint_model import JointModel
from methods.regressor import HORIZONTAL
from methods.two_layer_network import FOUR_SIGNALS, TWO_SIGNALS, TwoLayerNetwork

STEP = 1e-3
TIME = np.arange(3000) * STEP


def joint(a1: float = 5e-4, a2: float = 0.05, a3: float = 0.72, network: TwoLayerNetwork | None = None) -> JointModel:
    return JointModel(1, "voltage", HORIZONTAL, np.array([a1, a2, a3]), network)


def network_of(inputs: str, size: float, seed: int = 0, steepness: float = 1.0) -> TwoLayerNetwork:
    rng = np.random.default_rng(seed)
    m = 2 if inputs == TWO_SIGNALS else 4
    return TwoLayerNetwork(
        inputs=inputs,  # type: ignore[arg-type]
        hidden=steepness * rng.normal(size=(6, m)),
        hidden_bias=rng.normal(size=6),
        output=size * rng.normal(size=6),
        output_bias=0.0,
        input_centre=np.zeros(m),
        input_scale=np.array([0.5, 2.0, 8.0, 100.0])[:m],
    )


def test_free_motion_is_the_matrix_exponential() -> None:
    model = joint()
    a1, a2, a3 = model.coefficients
    system = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -a3 / a1, -a2 / a1]])
    start = np.array([0.2, 1.5, -4.0])
    run = model.simulate(TIME, np.zeros((len(TIME), 1)), State(*start))
    for k in (1, 10, 100, 2999):
        expected = expm(system * TIME[k]) @ start
        found = (run.position[k, 0], run.velocity[k, 0], run.acceleration[k, 0])
        np.testing.assert_allclose(found, expected, atol=2e-4 * np.max(np.abs(start)))


def exact_held(model: JointModel, time: np.ndarray, command: np.ndarray) -> np.ndarray:
    a1, a2, a3 = model.coefficients
    continuous = (
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -a3 / a1, -a2 / a1]]),
        np.array([[0.0], [0.0], [1.0 / a1]]),
        np.eye(3),
        np.zeros((3, 1)),
    )
    step = time[1] - time[0]
    return dlsim((*cont2discrete(continuous, step)[:4], step), command)[1]


def test_held_command_steps_against_the_exact_discretisation() -> None:
    command = np.where(np.arange(len(TIME)) // 250 % 2, 1.5, -1.0)
    run = joint().simulate(TIME, command[:, None], State.at_rest(0.0))
    exact = exact_held(joint(), TIME, command)
    np.testing.assert_allclose(run.position[:, 0], exact[:, 0], atol=2e-5)
    np.testing.assert_allclose(run.velocity[:, 0], exact[:, 1], atol=2e-4)
    np.testing.assert_allclose(run.acceleration[:, 0], exact[:, 2], atol=2e-2)


def test_the_integrator_has_order_three(monkeypatch: pytest.MonkeyPatch) -> None:
    slow = joint(0.5, 0.6, 0.7)  # time constants far above the step, so that the error is the integrator's own
    errors = []
    for step in (1e-3, 0.5e-3):
        scaled = 60.0  # a coarser clock: one integrator step is MAX_STEP of model time
        time = np.arange(0.0, 1.0, step)
        model = joint(slow.coefficients[0] / scaled**3, slow.coefficients[1] / scaled**2, slow.coefficients[2] / scaled)
        command = np.ones(len(time))
        run = model.simulate(time, command[:, None], State.at_rest(0.0))
        errors.append(np.max(np.abs(run.position[:, 0] - exact_held(model, time, command)[:, 0])))
    assert 2.5 < np.log2(errors[0] / errors[1]) < 3.5


def test_an_inductance_a_hundred_times_too_small_is_stiff_and_harmless() -> None:
    command = np.sin(2.0 * np.pi * TIME)[:, None]
    stiff = joint(a1=5e-6).simulate(TIME, command, State.at_rest(0.0))
    true = joint(a1=5e-9).simulate(TIME, command, State.at_rest(0.0))
    np.testing.assert_allclose(stiff.position, true.position, atol=1e-4)


@pytest.mark.parametrize(("inputs", "size"), [(TWO_SIGNALS, 0.05), (FOUR_SIGNALS, 0.02)])
def test_inverse_of_a_simulation_returns_its_command(inputs: str, size: float) -> None:
    model = joint(network=network_of(inputs, size))
    command = np.sin(2.0 * np.pi * 0.8 * TIME)[:, None]
    run = model.simulate(TIME, command, State.at_rest(0.1), hold="first_order")
    returned = model.inverse(TIME, run)
    np.testing.assert_allclose(returned[50:], command[50:], atol=1e-6)


def test_friction_as_steep_as_a_step_is_integrated() -> None:
    friction = TwoLayerNetwork(  # 0.2 f(q' / w) - 0.1: 0.1 V against the motion
        TWO_SIGNALS, np.array([[0.0, 1.0]]), np.zeros(1), np.array([0.2]), -0.1, np.zeros(2), np.full(2, 1e-5)
    )
    model = joint(network=friction)
    slowed = model.simulate(TIME, np.full((len(TIME), 1), 0.05), State(0.0, 0.5, 0.0))
    assert abs(slowed.velocity[-1, 0]) < 1e-4  # 0.05 V do not overcome the friction
    driven = model.simulate(TIME, np.full((len(TIME), 1), 0.5), State.at_rest(0.0))
    assert driven.velocity[-1, 0] == pytest.approx((0.5 - 0.1) / 0.72, rel=1e-3)


def test_divergence_ends_in_nan_and_does_not_raise() -> None:
    run = joint(a1=-5e-4).simulate(TIME, np.ones((len(TIME), 1)), State.at_rest(0.0))
    assert np.isfinite(run.position[0, 0])
    assert np.isnan(run.position[-1, 0])
    first_lost = np.flatnonzero(np.isnan(run.position[:, 0]))[0]
    assert np.all(np.isnan(run.position[first_lost:, 0]))


def test_slow_samples_are_integrated_in_several_steps() -> None:
    coarse = TIME[::10]
    command = np.repeat(np.where(np.arange(len(coarse)) // 25 % 2, 1.0, -1.0), 10)
    fine = joint().simulate(TIME, command[:, None], State.at_rest(0.0))
    few = joint().simulate(coarse, command[::10, None], State.at_rest(0.0))
    np.testing.assert_allclose(few.position[:, 0], fine.position[::10, 0], atol=1e-9)


def test_inputs_stay_untouched_and_models_survive_pickling() -> None:
    model = pickle.loads(pickle.dumps(joint(network=network_of(FOUR_SIGNALS, 0.02))))
    command = np.sin(TIME)[:, None]
    command.flags.writeable = False
    run = model.simulate(TIME, command, State.at_rest(0.0))
    again = model.simulate(TIME, command, State.at_rest(0.0))
    assert run.position.tobytes() == again.position.tobytes()
    assert isinstance(run, Motion)
    assert model.inverse(TIME, run).shape == (len(TIME), 1)
