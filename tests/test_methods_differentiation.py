"""The differentiators: exactness, one gain for all orders, the hold of the command, refusal of unfit logs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from envs.log import JointFacts, Log
from methods.base import MethodError
from methods.differentiation import BandLimited, ButterworthDifferences, Differentiator, FiniteDifferences
from methods.least_squares import LeastSquares

STEP = 1e-3
TIME = np.arange(4000) * STEP


def held_third_order_log(a: np.ndarray, *, seed: int = 0) -> Log:
    """a1 q''' + a2 q'' + a3 q' = v under a held multisine, from the exact discretisation: no integrator involved."""
    rng = np.random.default_rng(seed)
    frequencies = np.arange(0.5, 10.0, 0.5)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    command = 0.4 * np.sum(np.cos(2.0 * np.pi * np.outer(TIME, frequencies) + phases), axis=1)
    continuous = (
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -a[2] / a[0], -a[1] / a[0]]]),
        np.array([[0.0], [0.0], [1.0 / a[0]]]),
        np.array([[1.0, 0.0, 0.0]]),
        np.zeros((1, 1)),
    )
    _, position, _ = dlsim((*cont2discrete(continuous, STEP)[:4], STEP), command)
    return Log(time=TIME, command=command, position=position)


def relative_errors(log: Log, differentiator: Differentiator, a: np.ndarray) -> np.ndarray:
    fit = LeastSquares(differentiator).fit([log], np.random.default_rng(0))
    return fit.estimates.values / a - 1.0


A = np.array([5e-4, 0.05, 0.72])


def test_polynomials_up_to_degree_five_are_differentiated_exactly() -> None:
    coefficients = np.polynomial.Polynomial([0.3, -1.0, 2.0, 0.5, -0.7, 0.2])
    log = Log(time=TIME, command=2.0 + 3.0 * TIME, position=coefficients(TIME))
    signals = BandLimited(30.0).signals(log)
    for order, name in enumerate(("position", "velocity", "acceleration", "jerk")):
        expected = coefficients.deriv(order)(signals.time) if order else coefficients(signals.time)
        np.testing.assert_allclose(getattr(signals.motion, name)[:, 0], expected, rtol=1e-6, atol=2e-5)
    np.testing.assert_allclose(signals.command[:, 0], 2.0 + 3.0 * (signals.time - STEP / 2.0), rtol=1e-10)


@pytest.mark.parametrize("frequency", [1.0, 10.0, 25.0, 40.0, 55.0])
def test_all_orders_and_the_command_share_one_gain(frequency: float) -> None:
    turn = 2.0 * np.pi * frequency
    log = Log(
        time=TIME,
        command=np.sin(turn * TIME),
        position=np.sin(turn * TIME),
        facts=(JointFacts(hold="first_order"),),
    )
    signals = BandLimited(30.0).signals(log)
    sine, cosine = np.sin(turn * signals.time), np.cos(turn * signals.time)
    motion = signals.motion
    gains = [
        sine @ motion.position[:, 0] / (sine @ sine),
        cosine @ motion.velocity[:, 0] / (cosine @ cosine) / turn,
        -(sine @ motion.acceleration[:, 0]) / (sine @ sine) / turn**2,
        -(cosine @ motion.jerk[:, 0]) / (cosine @ cosine) / turn**3,
        sine @ signals.command[:, 0] / (sine @ sine),
    ]
    np.testing.assert_allclose(gains, gains[0], atol=2e-4)
    if frequency <= 20.0:
        assert gains[0] == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("bandwidth", [5.0, 12.0, 30.0, 60.0])
def test_the_filter_biases_nothing_whatever_its_bandwidth(bandwidth: float) -> None:
    assert np.max(np.abs(relative_errors(held_third_order_log(A), BandLimited(bandwidth), A))) < 3e-4


def test_forgetting_the_hold_biases_the_third_order_coefficient_by_half_a_sample_over_the_electrical_time() -> None:
    log = held_third_order_log(A)
    forgotten = Log(time=log.time, command=log.command, position=log.position, facts=(JointFacts(hold="first_order"),))
    bias = relative_errors(forgotten, BandLimited(30.0), A)
    assert bias[0] == pytest.approx(0.5 * STEP / (A[0] / A[1]), rel=0.1)
    assert abs(bias[2]) < 1e-3


def test_raw_differences_of_a_quantised_angle_drown_the_third_order_coefficient() -> None:
    log = held_third_order_log(A)
    count = 2.0 * np.pi / 5e5
    coarse = Log(time=log.time, command=log.command, position=np.round(log.position / count) * count)
    assert relative_errors(coarse, FiniteDifferences(), A)[0] < -0.5
    assert abs(relative_errors(coarse, BandLimited(30.0), A)[0]) < 0.02


@pytest.mark.parametrize("scheme", ["central", "backward"])
def test_finite_differences_of_a_cubic(scheme: str) -> None:
    log = Log(time=TIME, command=TIME + 1.0, position=TIME**3)
    signals = FiniteDifferences(scheme).signals(log)  # type: ignore[arg-type]
    lag = {"central": 0.0, "backward": 1.5 * STEP}[scheme]
    np.testing.assert_allclose(signals.motion.jerk[:, 0], 6.0, atol=1e-3)
    np.testing.assert_allclose(signals.motion.acceleration[:, 0], 6.0 * (signals.time - lag / 1.5), atol=1e-6)
    np.testing.assert_allclose(signals.command[:, 0], signals.time - 0.5 * STEP + 1.0, rtol=1e-10)


def test_measured_velocity_is_used_where_the_log_has_it() -> None:
    log = Log(time=TIME, command=TIME + 1.0, position=np.zeros_like(TIME), velocity=TIME**2)
    signals = FiniteDifferences().signals(log)
    np.testing.assert_allclose(signals.motion.velocity[:, 0], signals.time**2)
    np.testing.assert_allclose(signals.motion.acceleration[:, 0], 2.0 * signals.time, atol=1e-9)


def test_irregular_stamps_are_resampled_and_the_held_command_keeps_its_steps() -> None:
    rng = np.random.default_rng(0)
    time = np.sort(TIME + rng.uniform(-0.3e-3, 0.3e-3, len(TIME)))
    log = Log(time=time, command=np.floor(4.0 * time), position=np.sin(3.0 * time))
    signals = BandLimited(20.0).signals(log)
    np.testing.assert_allclose(signals.motion.velocity[:, 0], 3.0 * np.cos(3.0 * signals.time), atol=1e-5)
    raw = FiniteDifferences().signals(log)
    assert set(np.unique(raw.command * 2.0) % 1.0) == {0.0}  # steps of the command, or half way between two


def test_unfit_logs_are_refused_in_one_line() -> None:
    short = Log(time=TIME[:100], command=TIME[:100], position=TIME[:100])
    slow = Log(time=TIME * 20.0, command=TIME, position=TIME)
    for log, differentiator in (
        (short, BandLimited(30.0)),
        (slow, BandLimited(30.0)),
        (slow, ButterworthDifferences(100.0)),
        (short.slice(0, 5), FiniteDifferences()),
    ):
        with pytest.raises(MethodError) as caught:
            differentiator.signals(log)
        assert "\n" not in str(caught.value)
        assert caught.value.remedy
