"""Step 1: recovery, recursion, honest standard errors, the Cramer-Rao bound, and a published identification."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim
from test_methods_differentiation import TIME, A, held_third_order_log

from benchmarks.paper.measured import idim_for, relative_error
from envs.log import JointFacts, Log
from envs.rigs import rig
from methods.base import MethodError, State, Status
from methods.cramer_rao import cramer_rao_bound
from methods.joint_model import JointModel
from methods.least_squares import (
    LeastSquares,
    condition_number,
    estimate_history,
    solve,
    white_covariance,
)
from methods.regressor import HORIZONTAL, VERTICAL, ColumnName

RNG = np.random.default_rng(0)


def test_coefficients_of_a_noise_free_joint_are_recovered() -> None:
    fit = LeastSquares().fit([held_third_order_log(A)], RNG)
    np.testing.assert_allclose(fit.estimates.values, A, rtol=3e-4)
    assert fit.status is Status.CONVERGED
    assert fit.estimates.units == ("V s^3/rad", "V s^2/rad", "V s/rad")
    assert fit.estimates.as_dict() == dict(zip(HORIZONTAL, fit.estimates.values.tolist(), strict=True))


def test_two_logs_are_stacked_and_a_constant_load_has_its_column() -> None:
    logs = [held_third_order_log(A, seed=seed) for seed in (1, 2)]
    loaded = [Log(time=log.time, command=log.command + 0.4, position=log.position) for log in logs]
    fit = LeastSquares(columns=VERTICAL).fit(loaded, RNG)
    np.testing.assert_allclose(fit.estimates.values, [*A, 0.4], rtol=1e-3)


def test_the_history_is_what_refitting_after_every_sample_gives() -> None:
    problem = LeastSquares().problem([held_third_order_log(A)])
    noisy = problem.command + np.random.default_rng(1).normal(0.0, 0.05, len(problem.command))
    history = estimate_history(problem.regressor, noisy)
    for samples in (40, 400, len(noisy)):
        refitted = np.linalg.lstsq(problem.regressor[:samples], noisy[:samples], rcond=None)[0]
        np.testing.assert_allclose(history[samples - 1], refitted, rtol=1e-6)
    assert np.all(np.isnan(history[1]))


def test_standard_errors_hold_for_correlated_residuals_and_white_ones_do_not() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(3000) * 1e-2
    regressor = np.column_stack((np.sin(0.7 * time), np.cos(1.1 * time)))
    inside = np.zeros((2, 300), dtype=bool)
    for trial in range(inside.shape[1]):
        noise = np.convolve(rng.normal(size=len(time) + 60), np.ones(60) / 60.0, mode="valid")[: len(time)]
        command = regressor @ (1.0, -2.0) + noise
        values, covariance = solve(regressor, command)
        white = white_covariance(regressor, command - regressor @ values)
        for kind, spread in enumerate((covariance, white)):
            inside[kind, trial] = abs(values[0] - 1.0) < 1.96 * np.sqrt(spread[0, 0])
    coverage = inside.mean(axis=1)
    assert 0.88 < coverage[0] < 0.99
    assert coverage[1] < 0.5


def test_collinear_columns_are_reported() -> None:
    turn = 2.0 * np.pi
    steady = Log(time=TIME, command=np.sin(turn * TIME + 0.3), position=np.sin(turn * TIME))
    fit = LeastSquares().fit([steady], RNG)
    assert fit.status is Status.ILL_CONDITIONED
    assert condition_number(LeastSquares().problem([held_third_order_log(A)]).regressor) < 10.0


def test_the_cramer_rao_bound_is_the_one_from_independently_computed_sensitivities() -> None:
    log = held_third_order_log(A)
    first_order = Log(
        time=log.time, command=log.command, position=log.position, facts=(JointFacts(hold="first_order"),)
    )
    deviation = 1e-5
    bound = cramer_rao_bound(JointModel(1, "voltage", HORIZONTAL, A), first_order, State.at_rest(0.0), deviation)
    # dq/da_i obeys the same equation driven by -q^(i), and the free responses span the unknown start
    system = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -A[2] / A[0], -A[1] / A[0]]])
    drive = np.array([[0.0], [0.0], [1.0 / A[0]]])
    plant = StateSpace(system, drive, np.eye(3), np.zeros((3, 1)))
    states = lsim(plant, log.command[:, 0], TIME)[1]
    jerk = (log.command[:, 0] - A[1] * states[:, 2] - A[2] * states[:, 1]) / A[0]
    position = StateSpace(system, drive, np.eye(3)[:1], np.zeros((1, 1)))
    columns = [lsim(position, -signal, TIME)[1] for signal in (jerk, states[:, 2], states[:, 1])]
    columns += [lsim(position, np.zeros_like(TIME), TIME, X0=np.eye(3)[k])[1] for k in range(3)]
    sensitivity = np.column_stack([np.ravel(column) for column in columns])
    expected = deviation**2 * np.linalg.inv(sensitivity.T @ sensitivity)[:3, :3]
    np.testing.assert_allclose(np.sqrt(np.diag(bound)), np.sqrt(np.diag(expected)), rtol=0.02)


def test_unusable_requests_are_refused_in_one_line() -> None:
    log = held_third_order_log(A)
    still = Log(time=TIME, command=np.sin(TIME), position=np.zeros_like(TIME))
    two = Log(time=TIME, command=np.zeros((len(TIME), 2)), position=np.zeros((len(TIME), 2)), joints=(1, 2))
    strange: tuple[ColumnName, ...] = ("jerk", "snap")  # type: ignore[assignment]
    for method, logs in (
        (LeastSquares(), []),
        (LeastSquares(), [two]),
        (LeastSquares(), [still]),
        (LeastSquares(columns=strange), [log]),
        (LeastSquares(columns=("jerk", "jerk")), [log]),
    ):
        with pytest.raises(MethodError) as caught:
            method.fit(logs, RNG)
        assert "\n" not in str(caught.value)
        assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.skipif(not rig("emps").available, reason="the EMPS recordings are not on this machine (ADEPTONE_DATA)")
def test_the_published_identification_of_emps_is_reproduced() -> None:
    machine = rig("emps")
    fitted, held_out = machine.log("estimation"), machine.log("pulses")
    method = idim_for(fitted)
    fit = method.fit([fitted], RNG)
    published = machine.published()["Coulomb friction"]
    force = 1.0 / machine.robot().input_equivalent(1)
    for name, column in (
        ("mass", "acceleration"),
        ("viscous", "velocity"),
        ("coulomb", "coulomb"),
        ("offset", "constant"),
    ):
        assert force * fit.estimates[column] == pytest.approx(published[name], rel=0.005)
    assert relative_error(method, fit, fitted) == pytest.approx(published["relative_force_error_estimation"], abs=1e-3)
    assert relative_error(method, fit, held_out) == pytest.approx(published["relative_force_error_pulses"], abs=1e-3)
