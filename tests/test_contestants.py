"""Contestants on small synthetic joints: exact recovery, expected orderings, refusals, and laws that must hold."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from envs.log import Array, InputKind, JointFacts, Log
from methods.base import Method, MethodError, State
from methods.constant import Constant
from methods.gaussian_process import GaussianProcess, SemiparametricModel, covariance, negative_log_likelihood
from methods.huber_regression import HuberRegression
from methods.idim_least_squares import IdimLeastSquares
from methods.instrumental_variables import InstrumentalVariables
from methods.joint_model import JointModel
from methods.joint_regression import Preparation
from methods.kalman_filter import KalmanFilter
from methods.lagrangian_network import LagrangianNetwork
from methods.mujoco_sysid import MujocoSysid, toolbox
from methods.neural_state_space import NeuralStateSpace
from methods.output_error import OutputError
from methods.registry import METHODS
from methods.regressor import ColumnName
from methods.total_least_squares import TotalLeastSquares
from methods.weighted_least_squares import WeightedLeastSquares

RNG = np.random.default_rng(0)
VOLTAGE: dict[ColumnName, float] = {"jerk": 2e-4, "acceleration": 0.03, "velocity": 0.4, "constant": 0.1}
CURRENT: dict[ColumnName, float] = {"acceleration": 0.05, "velocity": 0.2, "constant": -0.3, "coulomb": 0.15}


def recorded(
    coefficients: dict[ColumnName, float],
    kind: InputKind = "voltage",
    unit: str = "rad",
    seconds: float = 6.0,
    seed: int = 0,
    noise: float = 0.0,
) -> Log:
    """A joint with these coefficients under a multisine, 1 kHz, from rest."""
    rng = np.random.default_rng(seed)
    time: Array = np.arange(round(seconds * 1000.0), dtype=np.float64) * 1e-3
    tones = np.arange(1.0, 9.0, 0.7)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(tones))
    command = coefficients.get("constant", 0.0) + 0.5 * np.cos(2.0 * np.pi * np.outer(time, tones) + phases).sum(axis=1)
    model = JointModel(1, kind, tuple(coefficients), np.array(list(coefficients.values())), None, 1e-3)
    position = model.simulate(time, command[:, None], State.at_rest(0.2)).position
    position = position + noise * rng.normal(size=position.shape)
    facts = (JointFacts(input=kind, position_unit=unit),)  # type: ignore[arg-type]
    return Log(time=time, command=command, position=position, facts=facts)


@pytest.fixture(scope="module")
def voltage() -> Log:
    return recorded(VOLTAGE)


@pytest.fixture(scope="module")
def current() -> Log:
    return recorded(CURRENT, "current", "m")


LINEAR: tuple[Method, ...] = (
    IdimLeastSquares(),
    WeightedLeastSquares(),
    HuberRegression(),
    TotalLeastSquares(),
    InstrumentalVariables(),
)
SIMULATING: tuple[Method, ...] = (OutputError(horizon=3.0), KalmanFilter(trial=2.0))


@pytest.mark.parametrize("method", [*LINEAR, *SIMULATING], ids=lambda m: type(m).__name__)
def test_a_linear_joint_is_recovered(method: Method, voltage: Log) -> None:
    fit = method.fit([voltage], RNG)
    found = fit.estimates.as_dict()
    for name, value in VOLTAGE.items():
        assert found[name] == pytest.approx(value, rel=0.01), name
    assert abs(found.get("coulomb", 0.0)) < 1e-3
    assert np.all(np.isfinite(fit.estimates.covariance))


@pytest.mark.parametrize("method", [*LINEAR, *SIMULATING], ids=lambda m: type(m).__name__)
def test_a_current_driven_linear_axis_with_friction_is_recovered(method: Method, current: Log) -> None:
    found = method.fit([current], RNG).estimates
    assert "jerk" not in found.names
    assert found.units[found.names.index("acceleration")] == "A s^2/m"
    for name, tolerance in (("acceleration", 0.03), ("velocity", 0.05), ("constant", 0.02), ("coulomb", 0.1)):
        assert found[name] == pytest.approx(CURRENT[name], rel=tolerance), name  # type: ignore[index]


def closed_loop(noise: float, seed: int, seconds: float = 12.0) -> Log:
    """J q'' + b q' = u under u = P (r - y) - D y' with noisy readings y; J = 0.05, b = 0.2."""
    rng = np.random.default_rng(seed)
    time: Array = np.arange(round(seconds * 1000.0), dtype=np.float64) * 1e-3
    tones = np.arange(0.5, 6.0, 0.5)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(tones))
    reference = 0.15 * np.cos(2.0 * np.pi * np.outer(time, tones) + phases).sum(axis=1)
    readings, command = np.empty(len(time)), np.empty(len(time))
    q, v, before = reference[0], 0.0, reference[0]
    decay = np.exp(-0.2 / 0.05 * 1e-3)
    for k, r in enumerate(reference):
        y = q + noise * rng.normal()
        u = 20.0 * (r - y) - 0.3 * (y - before) / 1e-3 * (k > 0)
        readings[k], command[k], before = y, u, y
        final = u / 0.2
        q += final * 1e-3 + (v - final) * (1.0 - decay) * 0.05 / 0.2
        v = final + (v - final) * decay
    return Log(time=time, command=command, position=readings, facts=(JointFacts(input="torque"),), loop="closed")


def test_instruments_are_less_biased_than_least_squares_under_noise_in_closed_loop() -> None:
    wide = Preparation(bandwidth=40.0, columns=("acceleration", "velocity"))
    bias = {}
    for method in (IdimLeastSquares(wide), InstrumentalVariables(wide), TotalLeastSquares(wide)):
        found = [method.fit([closed_loop(2e-3, seed)], RNG).estimates["acceleration"] for seed in range(2)]
        bias[type(method).__name__] = abs(np.mean(found) / 0.05 - 1.0)
    assert bias["IdimLeastSquares"] > 0.02
    assert bias["InstrumentalVariables"] < 0.3 * bias["IdimLeastSquares"]
    assert bias["TotalLeastSquares"] < 0.6 * bias["IdimLeastSquares"]


def test_the_filter_narrows_with_the_noise(voltage: Log) -> None:
    quiet, noisy = (Preparation().equations([log]) for log in (voltage, recorded(VOLTAGE, noise=1e-3)))
    assert noisy.bandwidth < 0.8 * quiet.bandwidth
    with pytest.raises(MethodError, match="too short"):
        Preparation(bandwidth=2.0).equations([voltage.slice(0, 2600)])


def test_gravity_that_turns_is_found_where_it_is_and_only_there() -> None:
    turning: dict[ColumnName, float] = {"acceleration": 0.05, "velocity": 0.3, "sine": 0.8, "cosine": 0.2}
    assert {"sine", "cosine"} <= set(IdimLeastSquares().fit([recorded(turning, "torque")], RNG).estimates.names)
    noisy = recorded(VOLTAGE, noise=1e-5)
    assert "sine" not in IdimLeastSquares().fit([noisy], RNG).estimates.names


def test_outliers_pull_less_on_the_robust_estimate(voltage: Log) -> None:
    command = voltage.command[:, 0].copy()
    for start in range(300, len(command), 900):
        command[start : start + 40] += 6.0
    spoiled = Log(time=voltage.time, command=command, position=voltage.position)
    plain, robust = (m.fit([spoiled], RNG).estimates["acceleration"] for m in (IdimLeastSquares(), HuberRegression()))
    assert abs(robust / VOLTAGE["acceleration"] - 1.0) < 0.3 * abs(plain / VOLTAGE["acceleration"] - 1.0)


def test_the_better_log_weighs_more(voltage: Log) -> None:
    rng = np.random.default_rng(1)
    hum = np.convolve(rng.normal(size=len(voltage) + 40), np.ones(41) / 8.0, mode="valid")
    poor = recorded(VOLTAGE, seed=3)
    poor = Log(time=poor.time, command=poor.command[:, 0] + hum, position=poor.position)
    plain, weighted = (
        m.fit([voltage, poor], RNG).estimates["acceleration"] for m in (IdimLeastSquares(), WeightedLeastSquares())
    )
    assert abs(weighted / VOLTAGE["acceleration"] - 1.0) < 0.3 * abs(plain / VOLTAGE["acceleration"] - 1.0)


def test_a_friction_that_would_drive_is_left_out(voltage: Log) -> None:
    helping: dict[ColumnName, float] = {**VOLTAGE, "constant": 0.1, "coulomb": -0.02}
    fit = IdimLeastSquares().fit([recorded(helping)], RNG)
    assert "coulomb" not in fit.estimates.names
    assert any("negative" in note for note in fit.notes)


def test_mujocos_toolbox_finds_the_joint(current: Log) -> None:
    method = MujocoSysid(segment=1.0, seconds=2.0, iterations=4, substeps=1)
    found = method.fit([recorded(VOLTAGE, seconds=4.0)], RNG).estimates
    assert found["acceleration"] == pytest.approx(VOLTAGE["acceleration"], rel=0.03)
    assert found["velocity"] == pytest.approx(VOLTAGE["velocity"], rel=0.03)
    assert method.fit([current.slice(0, 3000)], RNG).estimates["coulomb"] == pytest.approx(0.15, rel=0.15)


def test_mujocos_toolbox_without_its_extra_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(toolbox(), "optimize")
    with pytest.raises(MethodError, match="extra is not installed"):
        MujocoSysid().fit([recorded(VOLTAGE, seconds=2.0)], RNG)


def test_the_gaussian_process_learns_what_the_physics_lacks() -> None:
    log = recorded(CURRENT, "torque")
    grip = Log(
        time=log.time,
        command=log.command[:, 0] + 0.1 * np.sin(40.0 * log.position[:, 0]),
        position=log.position,
        facts=log.facts,
    )
    method = GaussianProcess(subset=120, inducing=60, most=1500)
    fit, physics = method.fit([grip], np.random.default_rng(0)), IdimLeastSquares().fit([grip], RNG)
    assert np.std(fit.residuals) < 0.5 * np.std(physics.residuals)
    assert isinstance(fit.model, SemiparametricModel)
    far = fit.model.residual(np.array([[50.0, 0.0]]))
    assert abs(far[0]) < 1e-9


def test_the_marginal_likelihood_is_that_of_the_normal_distribution() -> None:
    from scipy.stats import multivariate_normal

    inputs, target = RNG.normal(size=(6, 2)), RNG.normal(size=6)
    matrix = 4.0 * covariance(inputs, inputs, np.array([0.5, 2.0])) + (0.09 + 4e-9) * np.eye(6)
    expected = -multivariate_normal(np.zeros(6), matrix).logpdf(target) - 3.0 * np.log(2.0 * np.pi)
    assert negative_log_likelihood(np.log([0.5, 2.0, 2.0, 0.3]), inputs, target) == pytest.approx(expected)


def inverse_of_simulation(model: object, log: Log, tolerance: float) -> None:
    """The command that belongs to a simulated motion is the command that made it."""
    smooth = np.sin(2.0 * np.pi * 1.3 * log.time)[:, None] * np.std(log.command)
    run = model.simulate(log.time, smooth, State.at_rest(log.position[0]), "first_order")  # type: ignore[attr-defined]
    back = model.inverse(log.time, run)  # type: ignore[attr-defined]
    inner = slice(200, -200)
    assert np.sqrt(np.mean((back[inner] - smooth[inner]) ** 2)) < tolerance * np.std(smooth)


@pytest.mark.parametrize("kind", ["voltage", "current"])
def test_the_state_space_network_descends_and_is_one_model(kind: InputKind) -> None:
    log = recorded(VOLTAGE if kind == "voltage" else CURRENT, kind, seconds=3.0)
    fit = NeuralStateSpace(nodes=6, window=0.1, most=30, iterations=12).fit([log], np.random.default_rng(0))
    assert fit.learning_curve[-1] < fit.learning_curve[0]
    inverse_of_simulation(fit.model, log, 0.02)


def test_the_linear_start_of_the_state_space_network_is_the_joint(voltage: Log) -> None:
    fit = NeuralStateSpace(nodes=4, window=0.1, most=20, iterations=1).fit([voltage], np.random.default_rng(0))
    assert fit.learning_curve[0] < 1e-4


def test_the_lagrangian_network_learns_a_joint_and_is_one_model(current: Log) -> None:
    fit = LagrangianNetwork(nodes=8, rows=600, iterations=80).fit([current], np.random.default_rng(0))
    assert np.std(fit.residuals) < 0.1 * np.std(current.command)
    inverse_of_simulation(fit.model, current, 0.05)


def two_joints(seconds: float = 3.0) -> Log:
    """Two torque-driven joints that do not feel each other."""
    one, two = (
        recorded({"acceleration": 0.05, "velocity": 0.3}, "torque", seconds=seconds, seed=seed) for seed in (1, 2)
    )
    return Log(
        time=one.time,
        command=np.column_stack((one.command, two.command)),
        position=np.column_stack((one.position, two.position)),
        joints=(1, 2),
        facts=(one.facts[0], two.facts[0]),
    )


def test_a_lagrangian_network_keeps_its_energy_account() -> None:
    from methods.lagrangian_network import LagrangianModel

    model = LagrangianNetwork(nodes=5, rows=200, iterations=5).fit([two_joints()], np.random.default_rng(0)).model
    assert isinstance(model, LagrangianModel)
    rigid = model.dynamics()

    def potential(q: Array) -> float:
        inner = np.tanh(model.hidden @ ((q - model.centre) / model.scale) + model.bias)
        return float(model.outer[-1] @ inner + model.offset[-1])

    def energy(q: Array, v: Array) -> float:
        return float(0.5 * v @ rigid.inertia(q) @ v) + potential(q)

    rng = np.random.default_rng(4)
    for _ in range(5):
        q, v, a = rng.normal(size=(3, 2)) * np.array([[0.3], [2.0], [20.0]])
        power = v @ (rigid.inertia(q) @ a + rigid.bias(q, v))
        h = 1e-5
        rate = (energy(q + h * v + 0.5 * h**2 * a, v + h * a) - energy(q - h * v + 0.5 * h**2 * a, v - h * a)) / (
            2.0 * h
        )
        assert rate == pytest.approx(power, rel=1e-5, abs=1e-6)


def test_the_constant_predicts_the_mean_and_stays(voltage: Log) -> None:
    fit = Constant().fit([two_joints()], RNG)
    command = two_joints().command
    np.testing.assert_allclose(fit.estimates.values, command.mean(axis=0))
    run = fit.model.simulate(voltage.time, command, State.at_rest(np.array([0.3, -0.1])))
    assert np.ptp(run.position, axis=0) == pytest.approx([0.0, 0.0])
    assert fit.model.inverse(voltage.time, run).shape == run.position.shape


METHODS.load_package("methods")


def unusable() -> dict[str, list[Log]]:
    """Logs that nobody can learn from."""
    time: Array = np.arange(3000, dtype=np.float64) * 1e-3
    wave = np.sin(3.0 * time)
    nothing = Log(time=time, command=np.zeros_like(time), position=wave)
    return {
        "no log": [],
        "a joint that stands still": [Log(time=time, command=wave, position=np.zeros_like(time))],
        "too few samples": [Log(time=time[:30], command=wave[:30], position=wave[:30])],
        "a constant command": [nothing],
        "two joints": [two_joints()],
        "different inputs": [recorded(VOLTAGE, seconds=2.0), recorded(CURRENT, "current", seconds=2.0)],
    }


OWN = [
    "idim_ls", "weighted_ls", "huber", "total_least_squares", "idim_iv", "output_error", "mujoco_sysid",
    "kalman_filter", "gaussian_process", "neural_state_space", "sindy", "weak_sindy", "ensemble_sindy",
]  # fmt: skip


@pytest.mark.parametrize("name", OWN)
def test_unusable_logs_are_refused_in_one_line(name: str) -> None:
    method = METHODS[name].factory()
    for case, logs in unusable().items():
        with pytest.raises(MethodError) as caught:
            method.fit(logs, np.random.default_rng(0))
        assert "\n" not in str(caught.value), case


def test_every_contestant_stands_under_its_own_settings() -> None:
    keys = [repr(METHODS[name].factory()) for name in METHODS.names() if not name.startswith("_")]
    assert len(set(keys)) == len(keys)
    for name in OWN:
        assert repr(pickle.loads(pickle.dumps(METHODS[name].factory()))) == repr(METHODS[name].factory())
