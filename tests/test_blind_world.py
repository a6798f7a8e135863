"""The second world against physics on paper: energy, closed forms, stiction, equilibria, order of the integrator.

And its trials: same seed same bits, files that hold no truth, effects that are visible, the whole vocabulary offered.
"""

from __future__ import annotations

import ast
import json
import math
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from benchmarks.blind import hidden, visibility, world
from benchmarks.blind.hidden import FOREIGN, VOCABULARY
from benchmarks.blind.machines import FAMILIES, input_equivalent
from benchmarks.blind.trials import Kind, coloured_noise, make_trial, truth_table, wandering, write_trial
from benchmarks.blind.world import (
    Bristle,
    Coupling,
    DeadZone,
    Drive,
    Grasp,
    Heat,
    Joint,
    Limit,
    Loop,
    Sag,
    Shaft,
    Side,
    Stribeck,
    TorqueLaw,
    simulate,
)
from envs.log_files import load

TS = 1e-3
MOTOR = Joint(
    gain=30.0, resistance=5.0, inductance=0.05, torque_constant=21.0, motor_inertia=0.15, link_inertia=9.0, viscous=3.0
)
MASS = Joint(drive=Drive.TORQUE, link_inertia=2.0)


def wave(seconds: float, frequency: float = 0.7) -> np.ndarray:
    return np.sin(2 * np.pi * frequency * TS * np.arange(round(seconds / TS)))


# --- energy and closed forms -----------------------------------------------------------------------------------------


def test_free_pendulum_keeps_its_energy():
    pendulum = Joint(drive=Drive.TORQUE, link_inertia=0.1, gravity=2.0)
    motion = simulate((pendulum,), np.zeros(20_000), TS, start=np.array([1.2]))
    energy = 0.5 * 0.1 * motion.velocity**2 - 2.0 * np.cos(motion.position)
    assert np.ptp(motion.position) > 2.3
    assert np.abs(energy - energy[0]).max() < 1e-5 * 2.0 * (1 - math.cos(1.2))


def test_coupled_pair_keeps_its_energy():
    p1, p2, p3, k = 5.2, 1.2, 1.5, 40.0
    first = Joint(drive=Drive.TORQUE, link_inertia=p1, spring=k)
    second = Joint(drive=Drive.TORQUE, link_inertia=p2, spring=k)
    motion = simulate((first, second), np.zeros((20_000, 2)), TS, coupling_inertia=p3, start=np.array([1.0, -1.5]))
    q, w = motion.position, motion.velocity
    kinetic = 0.5 * (p1 + p2 + 2 * p3 * np.cos(q[:, 1])) * w[:, 0] ** 2 + 0.5 * p2 * w[:, 1] ** 2
    kinetic += (p2 + p3 * np.cos(q[:, 1])) * w[:, 0] * w[:, 1]
    energy = kinetic + 0.5 * k * (q**2).sum(axis=1)
    assert kinetic.max() > 0.5 * energy[0]
    assert np.abs(energy - energy[0]).max() < 2e-5 * energy[0]


def test_elastic_joint_keeps_momentum_and_energy():
    joint = Joint(drive=Drive.TORQUE, elastic=1, motor_inertia=0.4, link_inertia=0.6, stiffness=900.0)
    pulse = np.zeros(5000)
    pulse[:50] = 3.0
    motor = simulate((joint,), pulse, TS)
    link = simulate((replace(joint, encoder_side=Side.LINK),), pulse, TS)
    momentum = 0.4 * motor.velocity + 0.6 * link.velocity
    assert momentum[60:] == pytest.approx(3.0 * 0.05, rel=1e-9)
    twist = motor.position - link.position
    energy = 0.2 * motor.velocity**2 + 0.3 * link.velocity**2 + 450.0 * twist**2
    assert np.ptp(twist[60:]) > 1e-3
    assert energy[60:] == pytest.approx(energy[60, 0], rel=1e-4)


def test_linear_motor_is_its_matrix_exponential():
    j = MOTOR
    inertia = j.motor_inertia + j.link_inertia
    a = np.zeros((4, 4))
    a[0, 1] = 1.0
    a[1, 1:3] = -j.viscous / inertia, j.torque_constant / inertia
    a[2, 1:] = -j.torque_constant / j.inductance, -j.resistance / j.inductance, j.gain / j.inductance
    step = expm(a * TS)
    command = np.random.default_rng(0).uniform(-1, 1, 3000)
    state, expected = np.zeros(3), []
    for u in command:
        expected.append(state[0])
        state = (step @ np.append(state, u))[:3]
    motion = simulate((j,), command, TS)
    assert np.abs(motion.position[:, 0] - expected).max() < 2e-8 + 1e-6 * np.ptp(expected)


def test_ramped_command_is_the_first_order_hold():
    joint = Joint(drive=Drive.CURRENT, gain=2.0, torque_constant=0.5, link_inertia=0.25)
    command = np.array([0.0, 1.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    motion = simulate((joint,), command, 0.1, ramp=True)
    # 4 (1/s^2 per A) times the area below the ramps
    assert motion.velocity[:, 0] == pytest.approx(4 * 0.1 * np.array([0, 0.5, 1, 1, 0, -1, -1, -1]), abs=1e-9)


def test_delay_shifts_by_any_time():
    late = simulate((replace(MOTOR, delay=3e-3),), wave(3), TS).position
    assert late[3:] == pytest.approx(simulate((MOTOR,), wave(3), TS).position[:-3], abs=1e-12)
    mass = replace(MASS, delay=0.37e-3)
    motion = simulate((mass,), np.full(10, 4.0), TS)
    assert motion.velocity[1:, 0] == pytest.approx(2.0 * (TS * np.arange(1, 10) - 0.37e-3), abs=1e-12)


def test_single_late_samples_keep_their_order():
    delay = np.zeros(8)
    delay[3] = 0.4e-3
    motion = simulate((MASS,), np.array([0, 0, 0, 2.0, 0, 0, 0, 0]), TS, arrival_delay=delay)
    assert motion.velocity[-1, 0] == pytest.approx(0.6e-3, abs=1e-12)


def test_lag_is_first_order():
    motion = simulate((replace(MASS, lag=0.02),), np.full(200, 1.0), TS)
    t = TS * np.arange(200)
    assert motion.velocity[:, 0] == pytest.approx(0.5 * (t - 0.02 * -np.expm1(-t / 0.02)), abs=2e-8)


# --- amplifier and motor laws ----------------------------------------------------------------------------------------


def delivered(joint: Joint, command: float) -> float:
    """Torque that a constant command gives to a mass at rest."""
    return float(simulate((joint,), np.full(3, command), TS).motor_torque[1, 0])


def test_amplifier_laws():
    assert delivered(replace(MASS, dead_zone=0.3), 0.25) == 0.0
    assert delivered(replace(MASS, dead_zone=0.3), -1.0) == pytest.approx(-0.7)
    smooth = replace(MASS, dead_zone=0.3, dead_zone_law=DeadZone.SMOOTH)
    assert delivered(smooth, 30.0) == pytest.approx(29.7, abs=0.01)
    assert abs(delivered(smooth, 0.03)) < 0.003
    assert delivered(replace(MASS, saturation=2.0), -5.0) == pytest.approx(-2.0)
    soft = replace(MASS, saturation=2.0, saturation_law=Limit.SOFT)
    assert delivered(soft, 0.5) == pytest.approx(0.5, rel=1e-4)
    assert delivered(soft, 50.0) == pytest.approx(2.0, rel=1e-6)
    assert delivered(replace(MASS, offset=-0.1), 1.0) == pytest.approx(0.9)
    assert delivered(replace(MASS, torque_step=0.5), 1.3) == pytest.approx(1.5)


def test_sag_shares_its_slope():
    blocked = replace(MOTOR, inductance=0.0, link_inertia=1e9)
    current = 30.0 / 5.0
    for law in Sag:
        motion = simulate((replace(blocked, sag=1e-4, sag_law=law),), np.full(3, 1.0), TS)
        assert motion.current[1, 0] == pytest.approx(current * (1 - 1e-4 * current), rel=1e-6)


@pytest.mark.parametrize("law", list(TorqueLaw))
def test_torque_constant_laws_agree_at_small_current(law):
    joint = Joint(drive=Drive.CURRENT, torque_constant=2.0, kt_saturation=0.04, kt_law=law)
    assert delivered(joint, 0.2) == pytest.approx(0.4 * (1 - 0.04 * 0.04), rel=1e-5)
    assert delivered(joint, 8.0) < 0.75 * 16.0


@pytest.mark.parametrize("law", list(Heat))
def test_winding_heats_to_its_balance(law):
    joint = replace(MOTOR, link_inertia=1e9, heating=0.01, heating_time=0.5, heating_law=law)
    motion = simulate((joint,), np.full(20_000, 0.5), TS)
    rise, current = motion.resistance_rise[-1, 0], motion.current[-1, 0]
    assert current == pytest.approx(15.0 / (5.0 * (1 + rise)), rel=1e-5)
    growth = 1.0 + rise if law == Heat.COPPER else 1.0
    assert rise == pytest.approx(0.01 * current**2 * growth, rel=1e-4)
    early = simulate((joint,), np.full(100, 0.5), TS).resistance_rise[-1, 0]
    assert 0.1 * rise < early < 0.25 * rise


def test_the_mean_square_current_is_that_between_the_samples():
    """A winding as slow as a sample is long: at the middle of a sample a switching current is another one."""
    held, command = 20, np.where(np.arange(400) % 3 == 0, -0.5, 0.5)
    joint = replace(MOTOR, link_inertia=1e9, inductance=MOTOR.resistance * TS)
    coarse = simulate((joint,), command, TS)
    fine = simulate((joint,), np.repeat(command, held), TS / held)
    squares = [np.mean(motion.current_square) for motion in (coarse, fine)]
    assert squares[0] == pytest.approx(squares[1], rel=1e-3)
    assert np.mean(fine.current**2) == pytest.approx(squares[1], rel=2e-3)
    assert abs(np.mean(coarse.current**2) / squares[0] - 1.0) > 0.02


# --- friction --------------------------------------------------------------------------------------------------------


def test_stuck_body_does_not_creep():
    joint = replace(MASS, coulomb=1.0)
    motion = simulate((joint,), 0.999 * wave(10, 3.0), TS, start=np.array([0.4]))
    assert (motion.position == 0.4).all()


@pytest.mark.parametrize("law", list(Stribeck))
def test_breakaway_and_level_of_sliding(law):
    joint = replace(MASS, coulomb=1.0, static_excess=0.5, stribeck_velocity=0.01, stribeck_law=law)
    ramp = TS * np.arange(3000)
    motion = simulate((joint,), ramp, TS)
    leaving = int(np.argmax(motion.velocity[:, 0] > 0))
    assert leaving == pytest.approx(1501, abs=1)
    acceleration = np.gradient(motion.velocity[:, 0], TS)[2900]
    assert 2.0 * acceleration == pytest.approx(2.9 - 1.0, abs=0.02)


def test_sliding_body_stops_where_it_should_and_stays():
    push = np.zeros(3000)
    push[:200] = 5.0
    motion = simulate((replace(MASS, coulomb=1.0),), push, TS)
    v = (5.0 - 1.0) / 2.0 * 0.2
    stop = 0.5 * v * 0.2 + v**2 / (2 * 0.5)
    assert motion.position[-1, 0] == pytest.approx(stop, rel=1e-6)
    assert (motion.velocity[200 + round(v / 0.5 / TS) + 2 :] == 0).all()


def test_friction_by_direction_and_load():
    asym = replace(MASS, coulomb=1.0, asymmetry_torque=0.6)
    assert simulate((asym,), np.full(100, 1.25), TS).position[-1, 0] == 0.0
    assert simulate((asym,), np.full(100, -0.75), TS).position[-1, 0] < 0.0
    loaded = simulate((replace(MASS, load_friction=0.2),), np.full(100, 3.0), TS)
    assert loaded.velocity[-1, 0] == pytest.approx(0.8 * 1.5 * 99 * TS, rel=1e-9)


@pytest.mark.parametrize("law", [law for law in Bristle if law != Bristle.NONE])
def test_bristle_is_elastic_first_and_dry_later(law):
    joint = replace(
        MASS, viscous=90.0, bristle_law=law, bristle_torque=2.0, bristle_stiffness=400.0, bristle_damping=5.0
    )
    held = simulate((joint,), np.full(20_000, 0.1), TS)
    assert held.position[-1, 0] == pytest.approx(0.1 / 400.0, rel=0.08)
    assert abs(held.velocity[-1, 0]) < 1e-4
    sliding = simulate((joint,), np.full(20_000, 6.0), TS)
    assert 90.0 * sliding.velocity[-1, 0] == pytest.approx(4.0, rel=5e-3)


def test_maxwell_slip_returns_along_the_masing_branch():
    """Unloading follows the virgin curve, doubled."""
    bristle = world.pack((replace(MASS, bristle_law=Bristle.MAXWELL_SLIP, bristle_torque=1.0, bristle_stiffness=10.0),))
    z = np.zeros(4)

    def after(travel: float) -> float:
        for _ in range(200):
            world._bristle_flow(bristle[0], z, math.copysign(1.0, travel), abs(travel) / 200)
        return world._bristle_torque(bristle[0], z, 0.0)

    top = after(0.09)
    z[:] = 0.0
    half = after(0.04)
    z[:] = 0.0
    after(0.09)
    assert after(-0.08) == pytest.approx(top - 2 * half, abs=1e-9)


# --- transmission and loads ------------------------------------------------------------------------------------------


def test_equilibria_of_loads():
    damped = Joint(drive=Drive.TORQUE, link_inertia=0.1, viscous=0.6, gravity=2.0)
    assert simulate((damped,), np.full(9000, 1.0), TS).position[-1, 0] == pytest.approx(math.asin(0.5), rel=1e-9)
    tilted = replace(damped, gravity=0.0, tilt=2.0, tilt_phase=0.3)
    assert simulate((tilted,), np.full(9000, 1.0), TS).position[-1, 0] == pytest.approx(math.asin(0.5) - 0.3, rel=1e-9)
    spring = replace(damped, gravity=0.0, spring=4.0, spring_rest=0.2, weight=0.4)
    assert simulate((spring,), np.full(9000, 1.0), TS).position[-1, 0] == pytest.approx(0.2 + 0.6 / 4, rel=1e-9)
    cubic = replace(damped, gravity=0.0, cubic_spring=8.0)
    assert simulate((cubic,), np.full(9000, 1.0), TS).position[-1, 0] == pytest.approx(0.5, rel=1e-6)


@pytest.mark.parametrize("law", list(Shaft))
def test_play_lets_the_motor_turn_freely(law):
    joint = Joint(
        drive=Drive.TORQUE, elastic=1, motor_inertia=0.1, link_inertia=0.4, stiffness=3000.0, damping=1.0,
        gap=0.02, shaft_law=law, shaft_reference=1e-3, viscous=0.0,
    )  # fmt: skip
    push = np.full(2000, 0.01)
    motor = simulate((joint,), push, TS)
    link = simulate((replace(joint, encoder_side=Side.LINK),), push, TS)
    touch = math.sqrt(2 * 0.01 / 0.1)
    free = round(touch / TS) - 1
    assert (link.position[:free] == 0).all()
    assert link.position[free + 20, 0] > 0
    assert motor.position[free, 0] == pytest.approx(0.5 * 0.1 * (free * TS) ** 2, rel=1e-9)
    total = 0.1 * motor.velocity[-1, 0] + 0.4 * link.velocity[-1, 0]
    assert total == pytest.approx(0.01 * 1999 * TS, rel=1e-9)


def test_cogging_holds_and_collision_pushes():
    cogging = replace(MASS, viscous=5.0, cogging=0.5, cogging_wave=12.0)
    settled = simulate((cogging,), np.full(20_000, 0.25), TS).position[-1, 0]
    assert math.sin(12.0 * settled) == pytest.approx(-0.5, abs=1e-6)
    box = replace(MASS, collision=3.0, collision_time=0.0503, collision_duration=0.02)
    assert simulate((box,), np.zeros(200), TS).velocity[-1, 0] == pytest.approx(1.5 * 0.02, rel=1e-9)
    sine = simulate((replace(box, collision_law=1),), np.zeros(200), TS).velocity[-1, 0]
    assert sine == pytest.approx(1.5 * 0.02 * 2 / math.pi, rel=1e-4)


@pytest.mark.parametrize("law", list(Grasp))
def test_payload(law):
    joint = replace(MASS, payload=2.0, payload_time=0.1, payload_law=law)
    velocity = simulate((joint,), np.full(200, 4.0), TS).velocity[:, 0]
    before = 2.0 * 0.1
    at_pick = before if law == Grasp.MOVING else 0.5 * before
    assert velocity[199] == pytest.approx(at_pick + 1.0 * 0.099, rel=1e-6)


@pytest.mark.parametrize("law", list(Coupling))
def test_axis_coupling(law):
    first = replace(MASS, coupling=0.5, coupling_law=law)
    feed = np.column_stack([np.zeros(200), np.full(200, 1.0)])
    velocity = simulate((first, MASS), feed, TS).velocity[-1]
    t = 199 * TS
    if law == Coupling.TORQUE:
        expected = [0.5 * 1.0 * t / 2.0, 0.5 * t]
    elif law == Coupling.VELOCITY:
        expected = [0.5 * 0.5 * 0.5 * t**2 / 2.0, 0.5 * t]
    else:
        expected = np.linalg.solve([[2.0, -0.5], [-0.5, 2.0]], [0.0, 1.0]) * t
    assert velocity == pytest.approx(expected, rel=1e-6)


def test_swinging_base_is_a_free_body_without_its_spring():
    joint = replace(MASS, base_inertia=3.0)
    motion = simulate((joint,), np.full(200, 6.0), TS)
    assert motion.velocity[-1, 0] == pytest.approx((6.0 / 2.0 + 6.0 / 3.0) * 199 * TS, rel=1e-9)


def test_linkage_inertia_keeps_its_energy():
    joint = replace(MASS, inertia_wave=0.3, inertia_cycles=2.0, spring=20.0)
    motion = simulate((joint,), np.zeros(10_000), TS, start=np.array([1.0]))
    inertia = 2.0 * (1 + 0.3 * np.sin(2.0 * motion.position))
    energy = 0.5 * inertia * motion.velocity**2 + 10.0 * motion.position**2
    assert energy == pytest.approx(10.0, rel=1e-4)


def test_encoder_rounds_what_it_sees():
    joint = replace(MASS, encoder_step=1e-3, eccentricity=0.05, eccentricity_phase=0.4)
    motion = simulate((joint,), wave(3), TS)
    seen = motion.position + 0.05 * np.sin(motion.position + 0.4)
    assert np.abs(motion.measured - seen).max() <= 0.5e-3 + 1e-12
    assert motion.measured / 1e-3 == pytest.approx(np.round(motion.measured / 1e-3), abs=1e-9)


def test_closed_loop_follows_and_logs_what_acts():
    loop = Loop(True, np.array([10.0]), np.array([1.0]), np.array([2e-3]))
    reference = 0.3 * wave(5, 0.5)
    motion = simulate(
        (MOTOR,), np.zeros(5000), TS, loop=loop, reference=reference,
        command_step=np.array([0.005]), command_limit=np.array([10.0]),
    )  # fmt: skip
    assert np.abs(motion.position[:, 0] - reference).max() < 0.1
    again = simulate((MOTOR,), motion.command, TS)
    assert again.position == pytest.approx(motion.position, abs=1e-12)


# --- the integrator --------------------------------------------------------------------------------------------------

CASES = {
    "linear": MOTOR,
    "coulomb": replace(MOTOR, coulomb=7.0),
    "cogging": replace(MOTOR, cogging=5.0, cogging_wave=48.0),
    "lugre": replace(
        MOTOR, bristle_law=Bristle.LUGRE, bristle_torque=7.0, bristle_stiffness=2000.0, bristle_damping=30.0
    ),
    "flexible": replace(MOTOR, elastic=1, motor_inertia=4.0, link_inertia=5.0, stiffness=8e4, damping=20.0),
    "delay": replace(MOTOR, delay=1.33e-3, dead_zone=0.1),
    "base": replace(MOTOR, base_inertia=20.0, base_stiffness=2e4, base_damping=10.0),
}


@pytest.mark.parametrize("name", CASES)
def test_second_order(name):
    command = wave(3)
    best = simulate((CASES[name],), command, TS, step_limit=5e-6).position
    coarse, fine = (
        np.abs(simulate((CASES[name],), command, TS, step_limit=h).position - best).max() for h in (4e-4, 1e-4)
    )
    assert fine < coarse / 10
    assert fine < 1e-6


def test_half_a_minute_takes_a_moment():
    simulate((MOTOR,), wave(1), TS)
    seconds = []
    for _ in range(3):
        started = time.perf_counter()
        simulate((replace(MOTOR, coulomb=3.0),), wave(30), TS)
        seconds.append(time.perf_counter() - started)
    assert min(seconds) < 1.0


def test_shapes_are_checked():
    with pytest.raises(ValueError, match="one column per joint"):
        simulate((MOTOR,), np.zeros((10, 2)), TS)


# --- visibility ------------------------------------------------------------------------------------------------------


def test_whitening_recovers_an_autoregressive_process():
    noise = coloured_noise(200_000, TS, 2.0, np.random.default_rng(3))
    filter_, level = visibility.whitening([noise], 0.0)
    keep = math.exp(-TS / 0.02)
    assert noise.std() == pytest.approx(2.0, rel=0.05)
    assert filter_[1] == pytest.approx(-keep, abs=0.01)
    assert level == pytest.approx(2.0 * math.sqrt(1 - keep**2), rel=0.01)


def test_visibility_grows_with_the_effect_and_ignores_what_a_refit_explains():
    trial = make_trial(3, Kind.CLEAN, "adept_j1", duration=10.0)
    machine, logs, none = trial.truth.machine, trial.train, (visibility.Streams(),) * 2

    def seen(change: dict[str, float]) -> float:
        # the logs are clean: what is measured is how far off a machine with the change would predict
        other = (replace(machine.joints[0], **change),)
        return visibility.visibility(replace(machine, joints=other), machine.joints, other, logs, none, none)

    assert seen({}) == 0.0
    assert seen({"offset": 0.02}) == pytest.approx(2 * seen({"offset": 0.01}), rel=0.05)
    inertia = machine.joints[0].link_inertia
    assert seen({"link_inertia": 1.002 * inertia}) < 0.05 * seen({"offset": 0.01})


def test_what_is_visible_of_an_effect_leaves_out_what_another_ones_size_explains():
    trial = make_trial(3, Kind.CLEAN, "adept_j1", duration=10.0)
    machine, logs, none = trial.truth.machine, trial.train, (visibility.Streams(),) * 2
    other = (replace(machine.joints[0], offset=0.01),)
    known = visibility.visibility(replace(machine, joints=other), machine.joints, other, logs, none, none)
    assert visibility.visibility(machine, machine.joints, other, logs, none, none) < 1e-3 * known


def test_where_a_pendulum_hangs_is_not_known():
    machine = FAMILIES["pendulum"](np.random.default_rng(1))
    turned = [joints[0] for joints, _ in visibility.variations(machine, machine.joints, 1e-3) if joints[0].tilt]
    assert [joint.tilt_phase for joint in turned] == [math.pi / 2]


# --- trials ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["single", "foreign"])
def test_same_seed_same_bits(kind):
    one, two = (make_trial(5, kind, duration=8.0) for _ in range(2))
    assert [log.content_hash for log in one.train + one.holdout] == [
        log.content_hash for log in two.train + two.holdout
    ]
    assert truth_table(one.truth) == truth_table(two.truth)
    other = make_trial(5 + len(VOCABULARY), kind, duration=8.0)
    assert other.train[0].content_hash != one.train[0].content_hash


@pytest.mark.parametrize("name", VOCABULARY)
def test_every_effect_of_the_vocabulary_can_be_hidden(name):
    trial = make_trial(1, Kind.SINGLE, effect=name, duration=8.0)
    (effect,) = trial.truth.effects
    assert effect.hidden.name == name
    assert effect.visibility >= 12.0
    assert (len(trial.train), len(trial.holdout)) == (2, 1)
    assert all(math.isfinite(parameter.value) for parameter in effect.hidden.parameters.values())


@pytest.mark.parametrize("name", FOREIGN)
def test_every_foreign_effect_can_be_hidden(name):
    trial = make_trial(2, Kind.FOREIGN, effect=name, duration=8.0)
    assert trial.truth.foreign
    assert trial.truth.effects[0].hidden.name == name
    assert name not in VOCABULARY
    assert trial.truth.effects[0].visibility >= 12.0


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_gives_clean_logs_of_a_moving_machine(family):
    trial = make_trial(4, Kind.CLEAN, family, duration=8.0)
    assert trial.truth.effects == ()
    for log in (*trial.train, *trial.holdout):
        assert (np.ptp(log.position, axis=0) > 100 * np.array([fact.encoder_step for fact in log.facts])).all()
        assert (np.abs(log.command) <= np.array([fact.command_limit for fact in log.facts]) + 1e-9).all()


@pytest.mark.parametrize("family", FAMILIES)
def test_logs_are_exact_to_the_encoder(family):
    """A predictor that knows the machine leaves the rounding of the encoder and nothing else."""
    quiet = (make_trial(seed, Kind.CLEAN, family, duration=6.0) for seed in range(20))
    trial = next(t for t in quiet if t.truth.amplifier_noise[0] == 0.0 and t.truth.sensor_noise[0] == 0.0)
    machine, log = trial.truth.machine, trial.train[0]
    known = visibility.predict(machine, trial.truth.joints, log, visibility.Streams(), machine.coupling_inertia)
    rest = (log.position - known.measured)[round(visibility.SETTLING / machine.sample_time) :]
    steps = np.array([joint.encoder_step for joint in machine.joints])
    assert (np.sqrt((rest**2).mean(axis=0)) < 1.25 * steps / math.sqrt(12.0)).all()


def test_pairs_hide_two_compatible_effects_and_weak_ones_stand_at_the_edge():
    pair = make_trial(8, Kind.PAIR, "stage", duration=8.0).truth
    assert hidden.compatible(*(effect.hidden.name for effect in pair.effects))
    assert all(effect.visibility >= 12.0 for effect in pair.effects)
    weak = make_trial(13, Kind.WEAK, "rotor", duration=8.0).truth
    assert 1.5 <= weak.effects[0].visibility <= 15.0


def test_input_equivalents_are_torques_in_command_units():
    truth = make_trial(13, Kind.SINGLE, "adept_j1", effect="coulomb_friction", duration=8.0).truth
    torque = truth.effects[0].hidden.parameters["torque"]
    assert torque.input_equivalent == pytest.approx(torque.value * input_equivalent(truth.joints[0]))
    holding = Joint(gain=30.0, resistance=5.0, torque_constant=21.0, weight=7.0)
    fall = simulate((holding,), np.full(500, 7.0 * input_equivalent(holding)), TS)
    assert np.abs(fall.position).max() < 1e-9


def test_wandering_delay_keeps_the_order_of_samples():
    t = TS * np.arange(30_000)
    delay = wandering(t, 8 * TS, np.random.default_rng(0))
    assert delay.min() >= 0
    assert delay.max() == pytest.approx(8 * TS, rel=1e-3)
    assert (np.diff(t + delay) > 0).all()


def test_files_hold_the_logs_and_not_the_truth(tmp_path):
    trial = make_trial(4, Kind.SINGLE, "servo", effect="coulomb_friction", duration=8.0)
    write_trial(trial, tmp_path / "logs", tmp_path / "truth")
    written = load(tmp_path / "logs" / "train_1.csv")
    assert written.content_hash == trial.train[1].content_hash
    names = {path.name for path in (tmp_path / "logs").iterdir()}
    logs = ("train_0", "train_1", "holdout_0")
    assert names == {"nominal.toml", *(f"{name}.{end}" for name in logs for end in ("csv", "toml"))}
    (effect,) = json.loads((tmp_path / "truth" / "truth.json").read_text())["effects"]
    assert effect["name"] == "coulomb_friction"
    for path in (tmp_path / "logs").glob("*.toml"):
        assert "coulomb" not in path.read_text()
    with pytest.raises(ValueError, match="two folders"):
        write_trial(trial, tmp_path, tmp_path)


def test_the_second_world_stands_alone():
    """No physics from elsewhere: of the project only the Log and its files. Scorer and tables stand above the world."""
    own = {f"benchmarks.blind.{name}" for name in ("excitation", "hidden", "machines", "trials", "visibility", "world")}
    allowed = {*own, "envs.log", "envs.log_files", "numpy", "scipy", "numba", "typer", "tomli_w"}
    files = {path for path in Path(world.__file__).parent.glob("*.py") if path.name not in ("score.py", "summary.py")}
    assert {path.stem for path in files} >= {name.rpartition(".")[2] for name in own}
    for path in files:
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                known = any(name == item or name.startswith(item + ".") for item in allowed)
                assert known or name.split(".")[0] in sys.stdlib_module_names, f"{path.name}: {name}"
