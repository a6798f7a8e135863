"""The plant against independent consequences of its effects: equilibria, steady speeds, resonances, exact solutions."""

from __future__ import annotations

import dataclasses
import json
import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from envs.adeptone import adeptone
from envs.excitation import PRBS, Multisine, Sine, Steps, parse
from envs.log import Log
from envs.log_files import load
from envs.plant.effects import EFFECTS, EffectError, parse_effect
from envs.plant.effects.base import effect as register_effect
from envs.plant.plant import Plant, PlantError, record, truth_path
from envs.plant.sensors import AmplifierNoise, Sensors
from envs.plant.servo import PositionServo
from envs.plant.simulator import PlantSimulator
from envs.robot import load_robot
from envs.simulator import KernelSimulator

POSE = np.array([0.0, 0.5 * np.pi, 0.1, 0.0])
IDEAL = Sensors(quantised=False, velocity=True)
ROBOT = adeptone()
CURRENT_ROBOT = adeptone(amplifier="current")


def run(effects, excitation, duration, *, robot=ROBOT, pose=POSE, sensors=IDEAL, seed=0, rate=1000.0, **options):
    """A log and its first joint's position (T,) and velocity (T,) or None, by default of ideal sensors."""
    hidden = tuple(parse_effect(item) if isinstance(item, str) else item for item in effects)
    plant = Plant(robot, hidden, sensors)
    log, _ = plant.record(excitation, duration, np.random.default_rng(seed), rate=rate, pose=pose, **options)
    return log, log.position[:, 0], None if log.velocity is None else log.velocity[:, 0]


def final_speed(effects, level, joint=1, **options):
    """Speed that a joint settles at under a constant command; starts where it has room to run."""
    room = 0.9 * min(abs(ROBOT.joint(joint).lower.value), ROBOT.joint(joint).upper.value)
    pose = POSE.copy()
    pose[joint - 1] = -math.copysign(room, level)
    return run(effects, constant(level, joint), {1: 2.0, 2: 2.0, 4: 0.7}[joint], pose=pose, **options)[2][-1]


def constant(level, joint=1):
    return Steps(joints=(joint,), amplitude=level, levels=(1.0,), dwell=1e6)


@cache
def numbers(joint=1, robot=ROBOT):
    """Inertia, torque constant, resistance, inductance, viscous friction, gain: by name."""
    drive = robot.joint(joint).drive
    return {
        "J": float(robot.inertia_matrix(POSE)[joint - 1, joint - 1]),
        "K": drive.torque_constant,
        "R": drive.resistance.value,
        "L": drive.inductance.value,
        "f": drive.viscous.value,
        "G": drive.amplifier_gain.value,
    }


def quantised(level, joint=1):
    step = ROBOT.joint(joint).drive.command_step
    return round(level / step) * step


def steady_speed(volts, joint=1, *, torque=0.0, k=None, r=None):
    """Speed at which K i = f w + torque, i = (G u - K w) / R."""
    n = numbers(joint)
    k, r = k or n["K"], r or n["R"]
    return (k * n["G"] * volts / r - torque) / (n["f"] + k * k / r)


def linear_response(commands, joint=1, *, lag=None, offset=0.0):
    """Exact response of one joint at rest to a held command, shape (T,): matrix exponential of its linear equations."""
    n = numbers(joint)
    size = 3 if lag is None else 4
    a, b = np.zeros((size, size)), np.zeros(size)
    a[0, 1] = 1.0
    a[1, 1], a[1, 2] = -n["f"] / n["J"], n["K"] / n["J"]
    a[2, 1], a[2, 2] = -n["K"] / n["L"], -n["R"] / n["L"]
    if lag is None:
        b[2] = n["G"] / n["L"]
    else:
        a[2, 3], a[3, 3], b[3] = n["G"] / n["L"], -1.0 / lag, 1.0 / lag
    both = expm(np.block([[a, b[:, None]], [np.zeros((1, size + 1))]]) * 1e-3)
    state, path = np.zeros(size), []
    for u in commands + offset:
        path.append(state[0])
        state = both[:size, :size] @ state + both[:size, size] * u
    return np.array(path)


# ------------------------------------------------------------------------------------------ without effects


@pytest.mark.parametrize("joint", [1, 2, 4])
def test_clean_joint_follows_the_exact_linear_solution(joint):
    log, q, _ = run((), PRBS(joints=(joint,), amplitude=0.5), 4.0)
    moved = q - q[0]
    assert np.abs(moved - linear_response(log.command[:, 0], joint)).max() < 2e-7 * np.ptp(q)


def test_vertical_joint_stands_still_under_its_holding_command():
    log, q, _ = run((), constant(0.0, 3), 2.0)
    n = numbers(3)
    assert log.command[0, 0] == pytest.approx(-3.0 * 9.80665 * n["R"] / n["K"] / n["G"], abs=0.5 * 20 / 4096)
    assert np.ptp(q) < 1e-3
    _, q, _ = run((), constant(0.0, 3), 0.5, hold=False)
    assert q[-1] - q[0] > 1e-3  # without it the quill falls, downwards positive


def test_plant_without_effects_is_the_nominal_kernel():
    plant, nominal = PlantSimulator(Plant(ROBOT)), KernelSimulator(ROBOT)
    rng, start = np.random.default_rng(0), np.array([0.1, 0.5, 0.1, 0.2])
    assert np.array_equal(plant.reset(start, rng), nominal.reset(start, rng))
    steps = np.array([joint.encoder_step.value for joint in ROBOT.joints])
    for _ in range(150):
        command = rng.uniform(-1.0, 1.0, 4) * [2.0, 2.0, 1.0, 1.0]
        assert np.all(np.abs(plant.step(command, 2) - nominal.step(command, 2)) < 1.5 * steps)


def test_simulator_needs_a_reset_and_keeps_held_joints():
    simulator = PlantSimulator(Plant(ROBOT), free=(1,))
    with pytest.raises(RuntimeError, match="reset"):
        simulator.step(np.zeros(4))
    simulator.reset(POSE, np.random.default_rng(0))
    reading = simulator.step(np.ones(4), 50)
    assert simulator.held == (2, 3, 4)
    assert reading[0] > 0.0
    assert np.array_equal(reading[1:], POSE[1:])


def test_same_seed_same_bits_other_seed_others():
    effects = ("coulomb_friction=7", "timestamp_jitter=1e-4")
    options = {"duration": 1.0, "sensors": Sensors(velocity=True, velocity_noise=1e-3), "noise": AmplifierNoise(0.05)}
    first, again, other = (record(ROBOT, effects, "multisine", seed=seed, **options) for seed in (3, 3, 4))
    assert first.log.content_hash == again.log.content_hash != other.log.content_hash
    assert first.truth == again.truth


def test_running_in_pieces_is_running():
    effects = ("input_delay=0.0103", "amplifier_lag=0.01", "collision=torque:9,time:0.3", "presliding_friction=3")
    plant = Plant(ROBOT, tuple(parse_effect(item) for item in effects), IDEAL, AmplifierNoise(0.1))
    wanted = Multisine(amplitude=0.7, band=(0.5, 8.0)).sample(np.arange(600) * 1e-3, np.random.default_rng(0))
    whole, pieces = (plant.simulate((1,), np.random.default_rng(0), pose=POSE) for _ in range(2))
    _, seen = whole.run(wanted)
    parts = [pieces.run(part)[1].position for part in np.split(wanted, [1, 2, 250, 251])]
    assert np.array_equal(np.concatenate(parts), seen.position)


def test_brakes_hold_and_their_pose_matters():
    """Joint 1 turns the inertia of the pose that joint 2 is held in: p1 + p2 + 2 p3 cos q2 (+ yaw)."""
    speeds = []
    for angle in (0.0, 0.5 * np.pi):
        pose = np.array([0.0, angle, 0.1, 0.0])
        log, _, speed = run((), constant(1.0), 0.03, robot=CURRENT_ROBOT, pose=pose)
        assert log.joints == (1,)
        speeds.append(speed[-1] * CURRENT_ROBOT.inertia_matrix(pose)[0, 0])
    torque = numbers(1, CURRENT_ROBOT)["K"] * 1.17 * quantised(1.0)
    assert np.allclose(speeds, torque * 0.029, rtol=0.02)
    assert speeds[0] == pytest.approx(speeds[1], rel=0.01)


@pytest.mark.parametrize("rate", [200.0, 2000.0])
def test_rate_of_the_log(rate):
    log, q, _ = run((), Multisine(amplitude=1.0), 2.0, rate=rate)
    assert log.sample_time == pytest.approx(1.0 / rate)
    assert len(log) == int(2 * rate)
    assert np.abs(q).max() > 0.01


def test_free_joint_beside_the_excited_one_moves_by_coupling():
    log, _, _ = run((), Multisine(joints=(1,), amplitude=1.0), 1.0, free=(2,), pose=np.array([0, 0.3, 0.1, 0]))
    assert log.joints == (1, 2)
    assert np.ptp(log.position[:, 1]) > 1e-2
    assert np.ptp(log.command[:, 1]) == 0.0


# ------------------------------------------------------------------------------------------ the chain's sensors


def test_converter_and_encoder_quantise():
    log, _, _ = run((), Multisine(amplitude=1.0), 1.0, sensors=Sensors())
    for values, step in ((log.command, 20.0 / 4096), (log.position, 2 * np.pi / 5e5)):
        counts = values / step
        assert np.abs(counts - np.round(counts)).max() < 1e-6
    assert log.facts[0].encoder_step == pytest.approx(2 * np.pi / 5e5)
    assert log.facts[0].command_step == 20.0 / 4096
    log, _, _ = run((), constant(20.0, 4), 0.05, sensors=Sensors())
    assert log.command[0, 0] == 10.0 - 20.0 / 4096


def test_amplifier_noise_moves_the_arm_but_not_the_log():
    noise, step = AmplifierNoise(rms=0.3, correlation_time=0.05), 1e-3
    sample = noise.sample(np.zeros(1), 200_000, step, np.random.default_rng(0))[:, 0]
    assert sample.std() == pytest.approx(0.3, rel=0.05)
    assert np.corrcoef(sample[:-50], sample[50:])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.05)
    plant = Plant(ROBOT, (), IDEAL, noise)
    log, _ = plant.record(constant(0.0), 1.0, np.random.default_rng(0))
    assert np.ptp(log.command) == 0.0
    assert np.ptp(log.position) > 1e-3


def test_velocity_and_temperature_columns_are_optional():
    log, _, _ = run((), Sine(), 0.5, sensors=Sensors())
    assert log.velocity is None
    assert log.temperature is None
    log, q, v = run((), Sine(), 0.5, sensors=dataclasses.replace(IDEAL, temperature=True))
    assert np.abs(np.gradient(q, log.time)[1:-1] - v[1:-1]).max() < 1e-4
    assert np.all(log.temperature == 25.0)


def test_current_limit_of_the_amplifier():
    recording = record(ROBOT, (), constant(9.0), duration=0.1, pose=POSE)
    assert recording.truth.robot["joints"]["1"]["current_limited"] > 0.5
    n = numbers()
    _, _, v = run((), constant(9.0), 0.1)
    assert v[60] - v[40] == pytest.approx(0.02 * n["K"] * 11.7 / n["J"], rel=0.05)


# ------------------------------------------------------------------------------------------ amplifier effects


def test_input_delay_shifts_the_response_by_any_real_delay():
    excitation = Steps(dwell=0.3, amplitude=0.8)
    _, clean, _ = run((), excitation, 3.0)
    _, late, _ = run(("input_delay=0.012",), excitation, 3.0)
    assert np.abs(late[12:] - clean[:-12]).max() < 1e-12
    log, clean, _ = run((), excitation, 3.0)
    _, late, _ = run(("input_delay=0.01237",), excitation, 3.0)
    expected = np.interp(log.time - 0.01237, log.time, clean)
    assert np.abs(late - expected).max() < 3e-6 * np.ptp(clean)


def test_dead_zone_swallows_small_commands_and_shifts_large_ones():
    _, q, _ = run(("dead_zone=0.3",), Sine(amplitude=0.29), 2.0)
    assert np.all(q == 0.0)
    speed = final_speed(("dead_zone=0.3",), 1.0)
    assert speed == pytest.approx(steady_speed(quantised(1.0) - 0.3), rel=1e-6)


def test_voltage_saturation_clips_the_speed():
    for level in (2.0, 3.0, -3.0):
        speed = final_speed(("voltage_saturation=0.7",), level)
        assert speed == pytest.approx(math.copysign(steady_speed(0.7), level), rel=1e-6)


def test_amplifier_lag_is_a_first_order_low_pass():
    log, q, _ = run(("amplifier_lag=0.02",), PRBS(amplitude=0.5), 3.0)
    exact = linear_response(log.command[:, 0], lag=0.02)
    assert np.abs(q - exact).max() < 1e-7 * np.ptp(q)
    assert np.abs(q - linear_response(log.command[:, 0])).max() > 1e-2 * np.ptp(q)


def test_amplifier_offset_drifts():
    log, q, _ = run(("amplifier_offset=0.05",), Multisine(amplitude=0.5), 3.0)
    assert np.abs(q - linear_response(log.command[:, 0], offset=0.05)).max() < 1e-7 * np.ptp(q)


SPRING = 400.0  # N m/rad: stalls joint 1, so that torque shows as angle


def stalled(effects, volts=0.7, joint=1, spring=SPRING, duration=6.0, **options):
    """Final angle of a joint that pushes against a stiff cable, from the pose's angle 0."""
    return run((*effects, f"cable_spring@{joint}={spring}"), constant(volts, joint), duration, **options)


def test_cable_spring_balances_the_stall_torque():
    n = numbers()
    _, q, _ = stalled(())
    assert q[-1] == pytest.approx(n["K"] * n["G"] * quantised(0.7) / n["R"] / SPRING, rel=1e-5)
    _, q, _ = run(("cable_spring=stiffness:400,rest_angle:0.2",), constant(0.0), 6.0)
    assert q[-1] == pytest.approx(0.2, rel=1e-5)


def test_supply_sag_lowers_the_stall_current():
    n, gain = numbers(), 0.05
    volts = n["G"] * quantised(0.7)
    _, q, _ = stalled((f"supply_sag={gain}",))
    assert q[-1] * SPRING / n["K"] == pytest.approx(volts / (n["R"] + gain * volts), rel=1e-5)


# ------------------------------------------------------------------------------------------ motor effects


def test_thermal_drift_weakens_a_stalled_motor_and_shows_in_the_temperature():
    rise = 0.3
    log, q, _ = stalled(
        (f"thermal_drift=resistance_rise:{rise},time_constant:1.0",),
        duration=12.0,
        sensors=dataclasses.replace(IDEAL, temperature=True),
    )
    _, cold, _ = stalled((), duration=12.0)
    assert q[-1] < q[1500] < cold[1500]
    # current and with it the mean square of the record fall a little while it heats
    assert cold[-1] / q[-1] - 1.0 == pytest.approx(rise, rel=0.05)
    resistance = 1.0 + 0.00393 * (log.temperature[-1, 0] - 25.0)
    assert resistance == pytest.approx(cold[-1] / q[-1], rel=1e-3)


def test_thermal_drift_follows_the_winding_s_equations():
    """L i' = G u - R0 (1 + x) i - K w, tc x' = s (i / rms)^2 (1 + x) - x with s = rise / (1 + rise)."""
    n, rise, time_constant, rms = numbers(4), 1.5, 0.2, 1.0
    effect = f"thermal_drift@4=resistance_rise:{rise},time_constant:{time_constant},current:{rms}"
    log, q, _ = run((effect,), PRBS(joints=(4,), amplitude=0.4, bit_time=0.02), 0.6)
    share = rise / (1 + rise)

    def rates(_, x, volts):
        _, w, i, heat = x
        electrical = (volts - n["R"] * (1 + heat) * i - n["K"] * w) / n["L"]
        return [w, (n["K"] * i - n["f"] * w) / n["J"], electrical, (share * i**2 * (1 + heat) - heat) / time_constant]

    state, path = np.zeros(4), []
    for u in log.command[:, 0]:
        path.append(state[0])
        state = solve_ivp(rates, (0.0, 1e-3), state, args=(n["G"] * u,), rtol=1e-9, atol=1e-12).y[:, -1]
    assert np.abs(q - np.array(path)).max() < 1e-6 * np.ptp(q)
    assert state[3] > 0.2


def test_thermal_drift_lowers_the_speed_of_a_loaded_motor():
    effects = ("quadratic_drag=40", "thermal_drift=resistance_rise:0.4,time_constant:0.5")
    pose = np.array([-2.4, np.pi / 2, 0.1, 0.0])
    _, _, warm = run(effects, constant(1.5), 3.0, pose=pose)
    _, _, cold = run(effects[:1], constant(1.5), 3.0, pose=pose)
    assert warm[-1] < 0.97 * cold[-1]
    assert warm[200] == pytest.approx(cold[200], rel=0.05)


def test_torque_constant_saturation_in_stall():
    n, coefficient = numbers(), 0.02
    current = n["G"] * quantised(0.7) / n["R"]
    _, q, _ = stalled((f"torque_constant_saturation={coefficient}",))
    assert q[-1] * SPRING == pytest.approx(n["K"] * current / (1 + coefficient * current**2), rel=1e-5)


def test_torque_ripple_in_stall():
    n = numbers()
    _, q, _ = stalled(("torque_ripple=share:0.1,cycles_per_rev:12,phase:0.4",))
    torque = n["K"] * n["G"] * quantised(0.7) / n["R"]
    assert q[-1] * SPRING == pytest.approx(torque * (1 + 0.1 * math.sin(12 * q[-1] + 0.4)), rel=1e-5)


def test_cogging_draws_into_the_nearest_notch():
    for start in (0.01, 0.05, -0.03):
        pose = np.array([start, 1.57, 0.1, 0.0])
        _, q, _ = run(("cogging_torque=amplitude:4,cycles_per_rev:150,phase:0.3",), constant(0.0), 6.0, pose=pose)
        notch = (150 * q[-1] + 0.3) / (2 * np.pi)
        assert notch == pytest.approx(round(notch), abs=1e-3)
        assert abs(q[-1] - start) < np.pi / 150


def test_cogging_has_its_period_along_the_angle():
    _, q, v = run(("cogging_torque=amplitude:20,cycles_per_rev:60",), constant(0.5), 2.5)
    moved = q > 0.5
    grid = np.arange(0.5, 0.5 + 2 * np.pi * 4 / 60, 1e-4)
    ripple = np.interp(grid, q[moved], v[moved])
    lines = np.abs(np.fft.rfft((ripple - ripple.mean()) * np.hanning(len(grid))))
    assert np.argmax(lines) == 4  # four periods of 2 pi / 60 in the stretch


# ------------------------------------------------------------------------------------------ transmission effects


def impulse_resonance(joint, effects, robot=CURRENT_ROBOT, duration=4.0):
    _log, _, v = run(effects, constant(0.0, joint), duration, robot=robot)
    after = v[100:] - v[-1]
    spectrum = np.abs(np.fft.rfft(after * np.hanning(len(after)), 1 << 17))
    frequencies = np.fft.rfftfreq(1 << 17, 1e-3)
    band = frequencies > 3.0
    return frequencies[band][np.argmax(spectrum[band])]


@pytest.mark.parametrize(("joint", "stiffness", "blow"), [(1, 5000.0, 50.0), (3, 4e5, 100.0), (4, 30.0, 0.5)])
def test_flexible_joint_rings_at_its_resonance(joint, stiffness, blow):
    ratio, inertia = 0.6, numbers(joint, CURRENT_ROBOT)["J"]
    effects = (
        f"joint_flexibility@{joint}=stiffness:{stiffness},damping:0,inertia_ratio:{ratio}",
        f"collision@{joint}=torque:{blow},time:0.05,duration:0.01",
    )
    expected = math.sqrt(stiffness / (ratio * (1 - ratio) * inertia)) / (2 * np.pi)
    assert impulse_resonance(joint, effects) == pytest.approx(expected, rel=0.01)


def test_flexible_joint_moves_as_a_whole_when_slow():
    slow = Sine(amplitude=0.5, frequency=0.3)
    _, rigid, _ = run((), slow, 3.0)
    for side in ("motor", "load"):
        _, soft, _ = run((f"joint_flexibility=stiffness:50000,inertia_ratio:0.4,encoder:{side}",), slow, 3.0)
        assert np.abs(soft - rigid).max() < 3e-3 * np.ptp(rigid)


def test_flexible_joint_twists_by_torque_over_stiffness():
    effects = ("joint_flexibility=stiffness:2000,damping:40,inertia_ratio:0.7,encoder:{}", f"cable_spring={SPRING}")
    ends = {}
    for side in ("motor", "load"):
        _, q, _ = run([item.format(side) for item in effects], constant(0.7), 8.0)
        ends[side] = q[-1]
    n = numbers()
    torque = n["K"] * n["G"] * quantised(0.7) / n["R"]
    assert ends["load"] == pytest.approx(torque / SPRING, rel=1e-4)
    assert ends["motor"] - ends["load"] == pytest.approx(torque / 2000.0, rel=1e-3)


def test_backlash_lets_the_rotor_run_alone_and_then_takes_the_load_along():
    ratio, gap, n = 0.6, 0.02, numbers(1, CURRENT_ROBOT)
    effects = (f"backlash=gap:{gap},inertia_ratio:{ratio}",)
    _, q, v = run(effects, constant(0.2), 1.0, robot=CURRENT_ROBOT)
    torque = n["K"] * 1.17 * quantised(0.2)
    alone = torque / ((1 - ratio) * n["J"])
    contact = math.sqrt(gap / alone)  # half of the gap to the flank: alone t^2 / 2 = gap / 2
    row = int(1000 * contact) - 3
    assert q[row] == pytest.approx(0.5 * alone * (row * 1e-3) ** 2, rel=1e-3)
    assert v[-1] == pytest.approx(torque / n["f"] * (1 - math.exp(-n["f"] / n["J"] * 0.999)), rel=0.02)
    _, load, _ = run(
        (f"backlash=gap:{gap},inertia_ratio:{ratio},encoder:load",), constant(0.2), 1.0, robot=CURRENT_ROBOT
    )
    assert np.all(load[:row] == 0.0)
    assert q[-1] - load[-1] == pytest.approx(0.5 * gap, rel=0.1)


def test_axis_coupling_by_velocity():
    excitation = constant(0.5, 3)
    log, _, _ = run(
        ("axis_coupling@4=coefficient:0.3,signal:velocity,other:3",), excitation, 0.4, free=(4,), sensors=IDEAL
    )
    v3, v4 = log.velocity[-1]
    n = numbers(4)
    assert v3 > 0.05
    assert v4 == pytest.approx(-0.3 * v3 / (n["f"] + n["K"] ** 2 / n["R"]), rel=1e-3)


def test_axis_coupling_by_acceleration():
    """J4 q4'' + f q4' = -c q3'': integrated once, J4 q4' + f q4 = -c q3', from rest."""
    log, _, _ = run(
        ("axis_coupling@4=coefficient:0.2,other:3",),
        Multisine(joints=(3,), amplitude=0.3, band=(0.5, 8.0)),
        1.0,
        robot=CURRENT_ROBOT,
        free=(4,),
    )
    n = numbers(4, CURRENT_ROBOT)
    q4 = log.position[:, 1]
    assert np.allclose(n["J"] * log.velocity[:, 1] + n["f"] * q4, -0.2 * log.velocity[:, 0], atol=1e-7)
    assert np.abs(q4).max() > 0.1


def test_axis_coupling_by_motor_torque():
    log, _, _ = run(
        ("axis_coupling@4=coefficient:0.01,signal:motor_torque,other:3",),
        constant(0.1, 3),
        0.3,
        robot=CURRENT_ROBOT,
        free=(4,),
    )
    n3, n4 = numbers(3, CURRENT_ROBOT), numbers(4, CURRENT_ROBOT)
    torque = -0.01 * n3["K"] * n3["G"] * log.command[0, 0]
    expected = torque / n4["f"] * (1 - np.exp(-n4["f"] / n4["J"] * log.time))
    assert np.allclose(log.velocity[:, 1], expected, rtol=1e-6, atol=1e-9)


def test_axis_coupling_needs_two_moving_axes_and_a_stable_number():
    with pytest.raises(EffectError, match="Excite both"):
        run(("axis_coupling=0.1",), Sine(), 0.1)
    with pytest.raises(EffectError, match="outweighs"):
        run(("axis_coupling@4=coefficient:50,other:1",), Sine(), 0.1, free=(4,))


# ------------------------------------------------------------------------------------------ arm effects


def breakaway(torque, joint=1):
    n = numbers(joint)
    return torque * n["R"] / n["K"] / n["G"]


@pytest.mark.parametrize(("joint", "torque"), [(1, 7.0), (2, 3.0), (4, 0.15)])
def test_coulomb_friction_sticks_below_and_slows_above(joint, torque):
    effect = (f"coulomb_friction@{joint}={torque}",)
    _, q, _ = run(effect, Sine(joints=(joint,), amplitude=0.95 * breakaway(torque, joint)), 3.0)
    assert np.ptp(q) < 0.02 * ROBOT.joint(joint).encoder_step.value
    level = 4.0 * breakaway(torque, joint)
    expected = steady_speed(quantised(level, joint), joint, torque=torque)
    assert final_speed(effect, level, joint) == pytest.approx(expected, rel=1e-4)


def test_coulomb_friction_stops_the_arm_for_good():
    """J w' = -T - f w from w0 stops at (J / f) ln(1 + f w0 / T), then stays."""
    n, torque = numbers(1, CURRENT_ROBOT), 7.0
    excitation = Steps(amplitude=0.5, levels=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0), dwell=0.5)
    _, q, v = run((f"coulomb_friction={torque}",), excitation, 3.0, robot=CURRENT_ROBOT)
    stop = 0.5 + n["J"] / n["f"] * math.log(1 + n["f"] * v[500] / torque)
    still = int(1000 * stop) + 3
    assert still < 2500
    assert abs(v[still - 15]) > 1e-3
    assert np.ptp(q[still:]) < 1e-8


def test_stribeck_friction_breaks_away_late_and_slides_lightly():
    effect = ("stribeck_friction=torque:5,static_torque:10,velocity:0.02",)
    _, q, _ = run(effect, constant(0.97 * breakaway(10.0)), 2.0)
    assert np.abs(q).max() < 1e-7
    level = 1.05 * breakaway(10.0)
    speed = final_speed(effect, level)
    law = 5.0 + 5.0 * math.exp(-((speed / 0.02) ** 2))
    assert speed == pytest.approx(steady_speed(quantised(level), torque=law), rel=1e-3)
    assert speed > 2 * steady_speed(quantised(level), torque=9.0)


def test_presliding_friction_yields_like_dahl_and_slides_like_coulomb():
    """Pushed from rest, Dahl's bristle gives way by -(Tc / sigma) ln(1 - tau / Tc)."""
    n, level = numbers(), 0.5 * breakaway(7.0)
    effect = ("presliding_friction=torque:7,stiffness:7000,damping:500",)
    _, q, _ = run(effect, constant(level), 3.0)
    torque = n["K"] * n["G"] * quantised(level) / n["R"]
    assert q.max() == pytest.approx(-7.0 / 7000.0 * math.log(1 - torque / 7.0), rel=0.02)
    fast = 4 * breakaway(7.0)
    assert final_speed(effect, fast) == pytest.approx(steady_speed(quantised(fast), torque=7.0), rel=1e-5)


def test_stiff_bristles_stay_stable():
    _, q, _ = run(("presliding_friction=torque:7,stiffness:1e6,damping:300",), Multisine(amplitude=0.8), 2.0)
    _, dry, _ = run(("coulomb_friction=7",), Multisine(amplitude=0.8), 2.0)
    assert np.abs(q - dry).max() < 0.02 * np.ptp(dry)


def test_quadratic_drag_balances_at_its_speed():
    n, coefficient = numbers(), 30.0
    for level in (1.0, -1.0):
        signed = final_speed((f"quadratic_drag={coefficient}",), level)
        speed = abs(signed)
        drive = n["K"] * (n["G"] * quantised(1.0) - n["K"] * speed) / n["R"]
        assert coefficient * speed**2 + n["f"] * speed == pytest.approx(drive, rel=1e-5)
        assert math.copysign(1.0, signed) == math.copysign(1.0, level)


def test_friction_asymmetry_splits_the_directions():
    effects = ("coulomb_friction=5", "friction_asymmetry=torque:4,viscous:2")
    n = numbers()
    for sign, torque, viscous in ((1.0, 7.0, 4.0), (-1.0, 3.0, 2.0)):
        speed = (n["K"] * n["G"] * quantised(1.0) / n["R"] - torque) / (viscous + n["K"] ** 2 / n["R"])
        assert final_speed(effects, sign) == pytest.approx(sign * speed, rel=1e-4)
    _, q, _ = run(effects, constant(0.0), 2.0)
    assert np.abs(q).max() < 1e-7


def test_friction_asymmetry_alone_brings_the_friction_it_presupposes():
    plant = Plant(ROBOT, (parse_effect("friction_asymmetry=4"),))
    assert [(effect.name, effect.torque) for effect in plant.effects[1:]] == [("coulomb_friction", 2.0)]
    with pytest.raises(EffectError, match="would push"):
        Plant(ROBOT, (parse_effect("friction_asymmetry=4"), parse_effect("coulomb_friction=1")))
    with pytest.raises(EffectError, match="would push"):
        run(("friction_asymmetry=torque:1,viscous:7",), Sine(), 0.1)


def test_load_dependent_friction_takes_its_share_of_the_torque():
    n, share = numbers(), 0.4
    speed = final_speed((f"load_dependent_friction={share}",), 1.0)
    current = (n["G"] * quantised(1.0) - n["K"] * speed) / n["R"]
    assert n["f"] * speed == pytest.approx((1 - share) * n["K"] * current, rel=1e-4)


@pytest.mark.parametrize(("joint", "torque"), [(1, 60.0), (2, 20.0), (4, 0.3)])
def test_gravity_tilt_gives_the_equilibrium(joint, torque):
    effect = f"gravity_tilt@{joint}=torque:{torque},phase:0.4"
    start = POSE.copy()
    start[joint - 1] = 0.0
    _, q, _ = run((effect,), constant(0.0, joint), 20.0 if joint < 4 else 8.0, pose=start)
    assert q[-1] == pytest.approx(-0.4, abs=1e-3)
    level = 0.5 * breakaway(torque, joint)
    n = numbers(joint)
    _, q, _ = run((effect,), constant(level, joint), 20.0 if joint < 4 else 8.0, pose=start)
    pushed = n["K"] * n["G"] * quantised(level, joint) / n["R"]
    assert q[-1] == pytest.approx(math.asin(pushed / torque) - 0.4, abs=2e-3)


def test_gravity_cannot_give_more_than_its_weight_and_tilts_once():
    with pytest.raises(EffectError, match="lying base"):
        run(("gravity_tilt=1000",), Sine(), 0.1)
    with pytest.raises(EffectError, match="tilted already"):
        run(("gravity_tilt=5", "gravity_tilt@2=5"), Sine(joints=(1, 2)), 0.1)


@pytest.mark.parametrize(("joint", "inertia", "level"), [(1, 3.0, 0.2), (2, 0.6, 0.2), (4, 0.004, 0.05)])
def test_payload_change_adds_its_inertia_at_its_time(joint, inertia, level):
    n = numbers(joint, CURRENT_ROBOT)
    effect = (f"payload_change@{joint}=inertia:{inertia},time:0.2",)
    log, _, v = run(effect, constant(level, joint), 0.4, robot=CURRENT_ROBOT)
    slope = np.gradient(v, log.time)
    torque = n["K"] * n["G"] * log.command[0, 0] - n["f"] * v
    assert torque[100] / slope[100] == pytest.approx(n["J"], rel=1e-3)
    assert torque[300] / slope[300] == pytest.approx(n["J"] + inertia, rel=1e-3)
    assert abs(v[201] - v[199]) < 1.1 * 2e-3 * slope[100]


def test_payload_on_the_quill_brings_its_weight():
    log, _, v = run(("payload_change@3=inertia:2,time:0.1",), constant(0.0, 3), 0.12, robot=CURRENT_ROBOT)
    n = numbers(3, CURRENT_ROBOT)
    slope = (v[115] - v[105]) / (log.time[115] - log.time[105])
    assert slope == pytest.approx((2.0 * 9.80665 - n["f"] * v[110]) / (n["J"] + 2.0), rel=5e-3)


def test_payload_cannot_take_more_than_there_is():
    with pytest.raises(EffectError, match="more than the tool has"):
        run(("payload_change=inertia:-5,time:0.1",), Sine(), 0.2)


def test_periodic_disturbance_shakes_with_its_frequency():
    n, rate = numbers(1, CURRENT_ROBOT), 2 * np.pi * 5.0
    effect = ("periodic_disturbance=torque:10,frequency:5,phase:0.3",)
    log, _, v = run(effect, constant(0.0), 2.0, robot=CURRENT_ROBOT)
    exact = solve_ivp(
        lambda t, w: (-10.0 * np.sin(rate * t + 0.3) - n["f"] * w) / n["J"],
        (0.0, 2.0),
        [0.0],
        t_eval=log.time,
        rtol=1e-10,
        atol=1e-12,
    )
    assert np.abs(v - exact.y[0]).max() < 1e-8


def test_collision_changes_the_momentum_by_its_impulse():
    n = numbers(1, CURRENT_ROBOT)
    _, _, v = run(("collision=torque:60,time:0.1,duration:0.02",), constant(0.0), 0.2, robot=CURRENT_ROBOT)
    assert np.all(v[:100] == 0.0)
    assert v[121] == pytest.approx(-60.0 * 0.02 / n["J"], rel=0.01)
    assert abs(v[-1]) < abs(v[121])


@pytest.mark.parametrize("which", ["viscous", "motor_constant", "resistance", "amplifier_gain"])
def test_parameter_mismatch_changes_the_steady_speed(which):
    n = dict(numbers())
    n[{"viscous": "f", "motor_constant": "K", "resistance": "R", "amplifier_gain": "G"}[which]] *= 1.5
    speed = final_speed((f"parameter_mismatch=parameter:{which},factor:1.5",), 0.8)
    expected = n["K"] * n["G"] * quantised(0.8) / n["R"] / (n["f"] + n["K"] ** 2 / n["R"])
    assert speed == pytest.approx(expected, rel=1e-5)


def test_parameter_mismatch_of_inertia_and_inductance():
    n = numbers(1, CURRENT_ROBOT)
    for factor in (0.7, 1.4):
        log, _, v = run((f"parameter_mismatch={factor}",), constant(0.2), 0.1, robot=CURRENT_ROBOT)
        torque = n["K"] * n["G"] * log.command[0, 0]
        assert v[50] == pytest.approx(torque / n["f"] * -math.expm1(-n["f"] / (factor * n["J"]) * 0.05), rel=1e-6)
    _, fast, _ = run((), constant(0.5), 0.02)
    _, slow, _ = run(("parameter_mismatch=parameter:inductance,factor:2",), constant(0.5), 0.02)
    assert slow[-1] < 0.8 * fast[-1]


# ------------------------------------------------------------------------------------------ sensor effects


def test_encoder_eccentricity_bends_the_reading_not_the_motion():
    excitation = Multisine(amplitude=1.0)
    _, q, v = run((), excitation, 2.0)
    _, y, w = run(("encoder_eccentricity=amplitude:0.01,phase:0.7",), excitation, 2.0)
    assert np.allclose(y, q + 0.01 * np.sin(q + 0.7), atol=1e-12)
    assert np.array_equal(v, w)


def test_timestamp_jitter_is_speed_times_jitter():
    excitation = Multisine(amplitude=1.0)
    log, q, v = run((), excitation, 3.0)
    jittered, y, _ = run(("timestamp_jitter=5e-5",), excitation, 3.0)
    assert np.array_equal(jittered.time, log.time)
    assert np.array_equal(jittered.command, log.command)
    fast = np.abs(v) > 0.3
    late = (y - q)[fast] / v[fast]
    assert late.std() == pytest.approx(5e-5, rel=0.1)
    assert abs(np.corrcoef(late[:-1], late[1:])[0, 1]) < 0.15


# ------------------------------------------------------------------------------------------ together, everywhere

TYPICAL = {
    "input_delay": "0.004",
    "dead_zone": "0.05",
    "voltage_saturation": "0.2",
    "amplifier_lag": "0.005",
    "amplifier_offset": "0.02",
    "supply_sag": "0.03",
    "thermal_drift": "resistance_rise:0.3,time_constant:0.5",
    "torque_constant_saturation": "0.03",
    "cogging_torque": "amplitude:{torque},cycles_per_rev:60",
    "torque_ripple": "share:0.1,phase:1",
    "joint_flexibility": "{stiffness}",
    "backlash": "{gap}",
    "axis_coupling": "coefficient:{inertia},other:{other}",
    "coulomb_friction": "{torque}",
    "stribeck_friction": "torque:{torque},static_torque:{twice},velocity:0.02",
    "presliding_friction": "{torque}",
    "quadratic_drag": "{torque}",
    "friction_asymmetry": "{torque}",
    "load_dependent_friction": "0.2",
    "gravity_tilt": "torque:{torque},phase:1",
    "cable_spring": "stiffness:{spring},rest_angle:0.1",
    "payload_change": "inertia:{inertia},time:0.5",
    "periodic_disturbance": "{torque}",
    "collision": "torque:{twice},time:0.3",
    "parameter_mismatch": "1.3",
    "encoder_eccentricity": "{gap}",
    "timestamp_jitter": "1e-4",
}
SCALES = {
    1: (7.0, 4000.0, 0.01, 1.0),
    2: (2.0, 1000.0, 0.01, 0.2),
    3: (15.0, 2e5, 5e-4, 1.0),
    4: (0.1, 20.0, 0.02, 0.001),
}
PARTNER = {1: 2, 2: 1, 3: 4, 4: 1}


def typical(name, joint):
    torque, stiffness, gap, inertia = SCALES[joint]
    values = TYPICAL[name].format(
        torque=torque,
        twice=2 * torque,
        stiffness=stiffness,
        spring=0.005 * stiffness,
        gap=gap,
        inertia=0.3 * inertia,
        other=PARTNER[joint],
    )
    return f"{name}@{joint}={values}"


AMPLITUDE = {1: 0.8, 2: 0.5, 3: 0.5, 4: 0.4}


def experiment(effects, joint):
    """The joint and its partner, both excited, with real sensors."""
    joints = tuple(sorted((joint, PARTNER[joint])))
    amplitude = tuple(AMPLITUDE[number] for number in joints)
    excitation = Multisine(joints=joints, amplitude=amplitude, band=(1.0, 8.0), period=1.0)
    return run(effects, excitation, 1.0, sensors=Sensors())[0]


@cache
def unspoilt(joint):
    return experiment((), joint)


def test_typical_covers_the_vocabulary():
    assert set(TYPICAL) == set(EFFECTS)


@pytest.mark.parametrize("joint", [1, 2, 3, 4])
@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_every_effect_shows_on_every_joint(name, joint):
    log = experiment((typical(name, joint),), joint)
    assert np.array_equal(log.command, unspoilt(joint).command)
    column = log.joints.index(joint)
    step = ROBOT.joint(joint).encoder_step.value
    assert np.abs(log.position - unspoilt(joint).position)[:, column].max() > 2 * step


def test_everything_at_once_on_every_joint_keeps_its_senses():
    leave_out = {"gravity_tilt", "axis_coupling", "presliding_friction"}
    effects = [typical(name, joint) for joint in (1, 2, 4) for name in sorted(set(EFFECTS) - leave_out)]
    effects += ["gravity_tilt@1=7", "axis_coupling@4=coefficient:0.0002,other:1"]
    excitation = Multisine(joints=(1, 2, 4), amplitude=(0.6, 0.4, 0.3), band=(1.0, 8.0), period=1.0)
    log, _, _ = run(effects, excitation, 1.0)
    assert np.isfinite(log.position).all()
    assert np.all(np.ptp(log.position, axis=0) > 1e-3)


def test_motor_of_joint_2_on_the_base_sees_its_effects_with_every_brake():
    robot = adeptone(second_stator="base")
    for joints in ((2,), (1, 2)):
        for effects in ((), ("joint_flexibility@2=1000",), ("cogging_torque@2=amplitude:1",)):
            excitation = Multisine(joints=joints, amplitude=0.5, band=(1.0, 8.0), period=1.0)
            log, _, _ = run(effects, excitation, 0.5, robot=robot)
            assert np.ptp(log.position[:, -1]) > 1e-3
    # a torque on both: motor 2 pushes joint 1 as well
    log, _, _ = run((), constant(0.3, 2), 0.05, robot=robot, free=(1,), pose=np.array([0, np.pi / 2, 0.1, 0]))
    apart, _, _ = run((), constant(0.3, 2), 0.05, free=(1,), pose=np.array([0, np.pi / 2, 0.1, 0]))
    assert log.position[-1, 0] > 0.0 > apart.position[-1, 0]


def test_an_ensemble_member_is_another_plant():
    rng = np.random.default_rng(1)
    _, nominal, _ = run((), Multisine(amplitude=0.8), 1.0)
    _, drawn, _ = run((), Multisine(amplitude=0.8), 1.0, robot=ROBOT.sample(rng))
    assert np.abs(nominal - drawn).max() > 0.01 * np.ptp(nominal)


# ------------------------------------------------------------------------------------------ closed loop


def test_servo_holds_a_vertical_joint_under_a_payload():
    servo = PositionServo.tuned(ROBOT, (3,), bandwidth=40.0, integral_share=0.3)
    log, q, _ = run(
        ("payload_change@3=inertia:3,time:0.2",), constant(0.0, 3), 3.0, servo=servo, sensors=Sensors(velocity=True)
    )
    n = numbers(3)
    assert log.loop == "closed"
    assert np.abs(q[:190] - 0.1).max() < 2e-4
    assert q[-1] == pytest.approx(0.1, abs=2e-4)
    assert log.command[-200:, 0].mean() == pytest.approx(-6.0 * 9.80665 * n["R"] / n["K"] / n["G"], rel=0.02)


def test_servo_tracks_its_reference_and_the_log_holds_what_it_commanded():
    servo = PositionServo.tuned(ROBOT, (1, 2), bandwidth=30.0, pose=tuple(POSE))
    excitation = Sine(joints=(1, 2), amplitude=(0.3, 0.2), frequency=0.5)
    log, q, _ = run((), excitation, 4.0, servo=servo)
    assert np.abs(q - 0.3 * np.sin(np.pi * log.time)).max() < 0.1 * 0.3
    counts = log.command / (20 / 4096)
    assert np.abs(counts - np.round(counts)).max() < 1e-6
    # one joint alone is linear: the command that was logged gives the motion again
    servo = PositionServo.tuned(ROBOT, (1,), bandwidth=30.0)
    log, q, _ = run((), Sine(amplitude=0.2, frequency=0.2), 3.0, servo=servo)
    assert np.abs(linear_response(log.command[:, 0]) - q).max() < 1e-7


def test_servo_holds_the_joints_beside_an_excited_one():
    servo = PositionServo.tuned(ROBOT, (2,), bandwidth=30.0, pose=tuple(POSE))
    log, _, _ = run((), Multisine(joints=(1,), amplitude=0.8), 2.0, servo=servo)
    assert log.loop == "open"
    assert np.ptp(log.position[:, 0]) > 10 * np.ptp(log.position[:, 1]) > 0.0
    with pytest.raises(ValueError, match="one gain of each kind"):
        PositionServo((1, 2), (1.0,), (1.0, 1.0))


def test_servo_feels_delay():
    servo = PositionServo.tuned(ROBOT, (1,), bandwidth=30.0)
    excitation = Steps(amplitude=0.1, levels=(1.0,), dwell=10.0)
    _, quick, _ = run((), excitation, 2.0, servo=servo)
    _, late, _ = run(("input_delay=0.02",), excitation, 2.0, servo=servo)
    assert late.max() > quick.max() + 0.01


# ------------------------------------------------------------------------------------------ truth and text


def test_truth_stands_beside_the_log_and_never_in_it(tmp_path):
    effects = ("coulomb_friction=7.25", "joint_flexibility=stiffness:4321")
    recording = record(ROBOT, effects, "multisine", duration=0.5, seed=11, name="trial")
    path = recording.save(tmp_path / "trial.csv")
    truth = json.loads(truth_path(path).read_text())
    torque = truth["effects"][0]["parameters"]["torque"]
    assert torque == {"value": 7.25, "unit": "N m"}
    damping = truth["effects"][1]["parameters"]["damping"]
    assert damping["value"] > 0.0  # derived by the plant
    assert damping["unit"] == "N m s/rad"
    assert truth["log_hash"] == recording.log.content_hash
    read = load(path)
    assert read.position == pytest.approx(recording.log.position)
    files = [file for file in tmp_path.iterdir() if ".truth." not in file.name]
    assert sorted(file.suffix for file in files) == [".csv", ".toml"]
    for text in (*(file.read_text() for file in files), repr(recording.log), repr(read)):
        for secret in ("coulomb", "flexib", "multisine", ".truth.", "seed", "entropy"):
            assert secret not in text
    assert {item.name for item in dataclasses.fields(Log)}.isdisjoint({"truth", "effects", "seed"})
    truth_path(path).unlink()
    assert load(path).content_hash == read.content_hash


@pytest.mark.parametrize(
    ("text", "joint", "values"),
    [
        ("coulomb_friction=7.0", 1, {"torque": 7.0}),
        ("coulomb_friction@2=3", 2, {"torque": 3.0}),
        (" coulomb_friction @ 2 = torque:3 ", 2, {"torque": 3.0}),
        (
            "stribeck_friction=torque:5,static_torque:8,velocity:0.05",
            1,
            {"torque": 5.0, "static_torque": 8.0, "velocity": 0.05},
        ),
        ("parameter_mismatch=parameter:viscous,factor:2", 1, {"parameter": "viscous", "factor": 2.0}),
        ("cogging_torque=-2e-1", 1, {"amplitude": -0.2, "cycles_per_rev": 150.0}),
    ],
)
def test_parse_effect(text, joint, values):
    effect = parse_effect(text)
    assert effect.joint == joint
    assert {name: getattr(effect, name) for name in values} == values
    assert parse_effect(effect.text) == effect


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("coulomb=7", "Did you mean coulomb_friction"),
        ("coulomb_friction", "needs torque"),
        ("coulomb_friction=", "no assignment"),
        ("coulomb_friction=-1", r"torque is -1.0. Give a number in \[0, inf\]"),
        ("coulomb_friction=nan", "torque is nan"),
        ("coulomb_friction=much", "not a number"),
        ("coulomb_friction@0=1", "numbered from 1"),
        ("coulomb_friction@two=1", "joint after @"),
        ("stribeck_friction=5", "needs static_torque and velocity"),
        ("stribeck_friction=torque:5,speed:1", "no parameter of stribeck_friction 'speed'"),
        ("backlash=gap:0.1,encoder:nose", "motor"),
        ("input_delay=3", r"\[0, 0.5\]"),
    ],
)
def test_unusable_effects_are_one_clear_line(text, said):
    with pytest.raises(EffectError, match=said) as caught:
        parse_effect(text)
    assert "\n" not in str(caught.value)
    assert text in str(caught.value)


def test_effects_that_cannot_be():
    with pytest.raises(EffectError, match=r"joints 1..4, not 5"):
        Plant(ROBOT, (parse_effect("coulomb_friction@5=1"),))
    with pytest.raises(EffectError, match="given twice"):
        Plant(ROBOT, (parse_effect("dead_zone=1"), parse_effect("dead_zone=2")))
    with pytest.raises(EffectError, match="joint 2 is braked"):
        run(("coulomb_friction@2=1",), Sine(), 0.1)
    with pytest.raises(EffectError, match="needs voltage"):
        run(("thermal_drift=resistance_rise:0.1,time_constant:1",), Sine(), 0.1, robot=CURRENT_ROBOT)
    with pytest.raises(EffectError, match="inertia_ratio"):
        run(("joint_flexibility=4000", "backlash=gap:0.01,inertia_ratio:0.5"), Sine(), 0.1)
    with pytest.raises(EffectError, match="exists already"):
        register_effect("dead_zone", "amplifier")(EFFECTS["dead_zone"])


def test_experiments_that_cannot_be():
    with pytest.raises(PlantError, match="end of its range"):
        run((), constant(2.0), 5.0)
    with pytest.raises(PlantError, match=r"joints 1..4, not 7"):
        run((), Sine(joints=(7,)), 1.0)
    with pytest.raises(PlantError, match="fewer than two samples"):
        run((), Sine(), 0.001)
    with pytest.raises(PlantError, match="rate"):
        run((), Sine(), 1.0, rate=5.0)


def test_record_reads_text_and_puts_effects_on_the_excited_joint():
    recording = record(ROBOT, ("coulomb_friction=3",), "sine:joints=2,amplitude=0.5", duration=0.2)
    assert recording.truth.effects[0]["joint"] == 2
    assert recording.log.joints == (2,)
    assert parse("sine:joints=2,amplitude=0.5").text == recording.truth.experiment["excitation"]


PENDULUM = """<mujoco><worldbody><body name="rod"><joint name="swing" axis="0 1 0"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0.5 0 0" mass="2"/></body></worldbody></mujoco>"""
TORQUE_DRIVE = """name = "pendulum"
body = { file = "rod.xml" }
[[joint]]
name = "swing"
kind = "revolute"
lower = -3.0
upper = 3.0
[joint.drive]
amplifier = "torque"
command = "torque"
amplifier_gain = 1.0
viscous = 0.2
"""


def test_a_described_robot_with_a_torque_drive(tmp_path):
    (tmp_path / "rod.xml").write_text(PENDULUM)
    (tmp_path / "pendulum.toml").write_text(TORQUE_DRIVE)
    robot = load_robot(tmp_path / "pendulum.toml")
    plant = Plant(robot, (parse_effect("coulomb_friction=0.5"),), IDEAL)
    log, _ = plant.record(constant(0.0), 1.0, np.random.default_rng(0))
    assert np.ptp(log.position) < 1e-7
    assert abs(log.command[0, 0]) == pytest.approx(2.0 * 9.81 * 0.25, rel=1e-3)
    assert log.facts[0].input == "torque"
    # without the holding torque it swings about the vertical
    log, _ = Plant(robot, (), IDEAL).record(constant(0.0), 20.0, np.random.default_rng(0), hold=False)
    assert log.position[-1, 0] == pytest.approx(0.5 * np.pi, abs=0.05)
    with pytest.raises(EffectError, match="torque amplifier"):
        Plant(robot, (parse_effect("supply_sag=0.1"),)).record(constant(0.0), 1.0, np.random.default_rng(0))
