"""The whole arm: against the closed form of the SCARA, and what convex identification promises of every body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from envs.adeptone import adeptone
from envs.log import Array, Log
from methods.arm import ArmModel, described_body
from methods.base import MethodError, Motion, State
from methods.consistent_arm import ConsistentArm, pseudo_inertia
from methods.joint_regression import Preparation
from methods.registry import METHODS
from methods.whole_arm import WholeArm

RNG = np.random.default_rng(0)
PREPARATION = Preparation(bandwidth=20.0)
SCALE = 1.3
"""What the drives' constants differ from their description by."""


def recorded(joints: tuple[int, ...], seed: int, noise: float = 0.0) -> Log:
    """Commands that the closed form of `envs.scara` needs along sums of sines, 8 s at 200 Hz; drives weaker by 1.3."""
    robot = adeptone()
    rng = np.random.default_rng(seed)
    rows = [joint - 1 for joint in joints]
    time: Array = np.arange(1600, dtype=np.float64) * 5e-3
    tones = 2.0 * np.pi * np.arange(0.2, 2.3, 0.3)
    size = np.array([0.3, 0.4, 0.01, 0.4])[rows] / np.sqrt(len(tones))
    phases = rng.uniform(0.0, 2.0 * np.pi, (len(tones), len(joints)))
    inner = tones[:, None] * time[:, None, None] + phases
    middle = np.array([0.5 * (joint.lower.value + joint.upper.value) for joint in robot.joints])
    full = [np.zeros((len(time), 4)) for _ in range(4)]
    full[0] += middle
    for order, wave in enumerate((np.sin(inner), np.cos(inner), -np.sin(inner), -np.cos(inner))):
        full[order][:, rows] += np.sum(size * tones[:, None] ** order * wave, axis=1)
    torque = robot.inverse_dynamics(full[0], full[1], full[2])
    drives = [robot.joints[row].drive for row in rows]
    c = SCALE * np.array([drive.input_equivalent for drive in drives])
    lag = np.array([drive.inductance.value / drive.resistance.value for drive in drives])
    emf = np.array([drive.torque_constant / drive.amplifier_gain.value for drive in drives])
    motor = c * torque[:, rows]
    command = motor + lag * np.gradient(motor, time, axis=0) + emf * full[1][:, rows]
    command = command + noise * np.std(command, axis=0) * rng.normal(size=command.shape)
    facts = tuple(replace(robot.facts(joint), hold="first_order") for joint in joints)
    return Log(time=time, command=command, position=full[0][:, rows], joints=joints, facts=facts, robot="adeptone")


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    return [recorded((1, 2, 3, 4), seed) for seed in (1, 2)]


def check_inertia(model: ArmModel, rel: float) -> None:
    """c M of the model is that of the closed form, wherever the arm stands."""
    robot, rigid = adeptone(), model.dynamics()
    c = SCALE * robot.drive_values("input_equivalent")
    for q in RNG.uniform([-1.0, -1.0, 0.05, -1.0], [1.0, 1.0, 0.15, 1.0], (5, 4)):
        expected = c[:, None] * robot.inertia_matrix(q)
        found = model.drives.scale[:, None] * rigid.inertia(q)
        assert np.abs(found - expected).max(axis=1) == pytest.approx(0.0, abs=rel * np.abs(expected).max())
        assert np.diag(found) == pytest.approx(np.diag(expected), rel=5.0 * rel)


def test_the_closed_form_is_recovered(logs: list[Log]) -> None:
    fit = WholeArm(preparation=PREPARATION).fit(logs, RNG)
    assert isinstance(fit.model, ArmModel)
    spread = np.std(np.concatenate([log.command for log in logs]), axis=0)
    assert np.all(np.std(fit.residuals.reshape(-1, 4), axis=0) < 0.01 * spread)
    check_inertia(fit.model, 0.01)
    emf = np.array([drive.torque_constant / drive.amplifier_gain.value for drive in adeptone().drives])
    viscous = SCALE * adeptone().drive_values("viscous") * adeptone().drive_values("input_equivalent")
    assert fit.model.drives.damping == pytest.approx(emf + viscous, rel=0.02)


def test_bodies_that_cannot_be_have_the_dynamics_of_their_numbers(logs: list[Log]) -> None:
    fit = WholeArm(preparation=PREPARATION).fit(logs, RNG)
    assert isinstance(fit.model, ArmModel)
    theta = fit.model.theta.copy()
    theta[10], theta[20], theta[22] = -3.9, 0.0, -0.4  # a negative mass, and a first moment without a mass
    model = replace(fit.model, theta=theta)
    rigid, body = model.dynamics(), described_body(adeptone())
    for q, v, a in np.random.default_rng(1).uniform(-0.5, 0.5, (4, 3, 4)):
        regressor = pin.computeJointTorqueRegressor(body, body.createData(), q, v, a)
        torque = rigid.inertia(q) @ a + rigid.bias(q, v)
        np.testing.assert_allclose(torque, regressor @ theta + model.rotors * a, rtol=1e-9, atol=1e-9)


def test_inverse_and_simulation_are_one_model(logs: list[Log]) -> None:
    model = WholeArm(preparation=PREPARATION).fit(logs, RNG).model
    time = np.arange(600) * 1e-3
    command = np.std(logs[0].command, axis=0) * np.sin(2.0 * np.pi * 1.5 * time)[:, None]
    weight = model.inverse(time[:9], Motion(*(np.tile(logs[0].position[0], (9, 1)) * k for k in (1.0, 0.0, 0.0, 0.0))))
    run = model.simulate(time, command + weight[4], State.at_rest(logs[0].position[0]), "first_order")
    back = model.inverse(time, run)
    error = (back - command - weight[4])[50:-50]
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 0.03 * np.std(command, axis=0))


def test_every_body_of_the_consistent_arm_is_possible() -> None:
    noisy = [recorded((1, 2), seed, noise=0.3) for seed in (1, 2)]
    fit = ConsistentArm(preparation=PREPARATION).fit(noisy, RNG)
    assert isinstance(fit.model, ArmModel)
    free = WholeArm(preparation=PREPARATION).fit(noisy, RNG).model
    assert isinstance(free, ArmModel)
    assert min(np.linalg.eigvalsh(pseudo_inertia(body))[0] for body in np.split(fit.model.theta, 4)) > -1e-7
    assert np.all(fit.model.rotors >= -1e-7)
    assert np.all(fit.model.drives.friction >= -1e-7)
    assert np.all(fit.model.drives.damping >= -1e-7)
    assert np.any(free.drives.friction < -1e-7) or np.any(free.rotors < -1e-7)


def test_a_possible_arm_is_left_as_it_is(logs: list[Log]) -> None:
    fit = ConsistentArm(preparation=PREPARATION).fit(logs, RNG)
    assert isinstance(fit.model, ArmModel)
    check_inertia(fit.model, 0.01)


def test_pseudo_inertia_is_positive_for_bodies_only() -> None:
    ball = np.array([2.0, 0.2, 0.0, 0.0, 0.01, 0.0, 0.03, 0.0, 0.0, 0.03])
    assert np.linalg.eigvalsh(pseudo_inertia(ball))[0] > 0.0
    ball[9] = 0.06  # an inertia about one axis greater than the sum of the others
    assert np.linalg.eigvalsh(pseudo_inertia(ball))[0] < 0.0


@pytest.mark.parametrize("name", ["whole_arm", "consistent_arm"])
def test_logs_of_no_described_robot_are_refused(name: str) -> None:
    method = METHODS[name].factory()
    log = recorded((1, 2), 0)
    cases = {
        "which robot": replace(log, robot=None),
        "no robot": replace(log, robot="unheard of"),
        "joints 1..4": replace(log, joints=(1, 7)),
    }
    for words, wrong in cases.items():
        with pytest.raises(MethodError, match=words):
            method.fit([wrong], RNG)
    with pytest.raises(MethodError, match="no log"):
        method.fit([], RNG)
