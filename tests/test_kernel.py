"""The compiled kernel: batches, threads, stops, limits, speed."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from benchmarks.kernel_speed import measure_speed
from envs.adeptone import adeptone
from envs.kernel import simulate
from envs.robot import RobotError

START = np.array([0.3, -0.8, 0.1, 1.0])


def commands(batch=5, steps=40, seed=0):
    """Random commands, shape (batch, steps, 4) [V]."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (batch, steps, 4))


def test_a_batch_is_its_members_bit_by_bit_with_any_number_of_threads():
    rng = np.random.default_rng(1)
    robots = [adeptone().sample(rng) for _ in range(5)]
    start = START + rng.uniform(-0.05, 0.05, (5, 4))
    together = simulate(robots, commands(), 1e-3, position=start, threads=numba.config.NUMBA_NUM_THREADS)
    for member, robot in enumerate(robots):
        alone = simulate(robot, commands()[member], 1e-3, position=start[member], threads=1)
        assert np.array_equal(alone.position[0], together.position[member])
        assert np.array_equal(alone.current[0], together.current[member])


def test_one_robot_and_one_command_serve_a_batch_of_starts():
    run = simulate(adeptone(), commands()[0], 1e-3, position=START + np.zeros((3, 4)))
    assert run.position.shape == (3, 41, 4)
    assert run.time == pytest.approx(1e-3 * np.arange(41))
    assert np.array_equal(run.velocity[0], run.velocity[2])


def test_substeps_are_steps_under_a_held_command():
    robot, held = adeptone(), commands(steps=20)
    coarse = simulate(robot, held, 2e-3, substeps=2, position=START)
    fine = simulate(robot, np.repeat(held, 2, axis=1), 1e-3, position=START)
    assert np.array_equal(coarse.position, fine.position[:, ::2])


def test_a_run_continues_where_another_ended():
    robot, whole = adeptone(), simulate(adeptone(), commands(), 1e-3, position=START)
    first = simulate(robot, commands()[:, :15], 1e-3, position=START)
    state = {name: getattr(first, name)[:, -1] for name in ("position", "velocity", "current")}
    second = simulate(robot, commands()[:, 15:], 1e-3, **state)
    assert np.array_equal(second.position[:, -1], whole.position[:, -1])


def test_the_quill_sinks_to_its_stop_and_rests_there():
    """The terminal speed before the stop balances weight, friction and the shorted motor: m g / (F + alpha^2 / R)."""
    robot = adeptone()
    drive, p = robot.joint(3).drive, robot.body.parameters
    run = simulate(robot, np.zeros((8000, 4)), 1e-3, position=np.zeros(4))
    speed = p.mass * p.gravity / (drive.viscous.value + drive.torque_constant**2 / drive.resistance.value)
    assert run.velocity[0, 1000, 2] == pytest.approx(speed, rel=1e-6)
    assert run.position[0, -1, 2] == robot.joint(3).upper.value
    assert run.velocity[0, -1, 2] == pytest.approx(0.0, abs=1e-12)
    unstopped = simulate(robot, np.zeros((8000, 4)), 1e-3, position=np.zeros(4), stops=False)
    assert unstopped.position[0, -1, 2] > robot.joint(3).upper.value


def test_a_command_beyond_the_converters_range_does_no_more_than_its_limit():
    beyond, limit = (simulate(adeptone(), np.full((30, 4), value), 1e-3, position=START) for value in (99.0, 10.0))
    assert np.array_equal(beyond.position, limit.position)


def test_the_current_limit_bounds_the_torque():
    robot = adeptone()
    run = simulate(robot, np.tile([10.0, 0, 0, 0], (30, 1)), 1e-3, held=(2, 3, 4))
    limit = robot.joint(1).drive.torque_constant * robot.joint(1).drive.current_limit.value
    acceleration = np.diff(run.velocity[0, :, 0]).max() / 1e-3
    assert run.current[0, -1, 0] > robot.joint(1).drive.current_limit.value
    assert acceleration <= limit / robot.inertia_matrix(np.zeros(4))[0, 0]


def test_brakes_hold_even_a_joint_that_was_moving():
    run = simulate(adeptone(), commands(), 1e-3, position=START, velocity=np.ones(4), held=(1, 2, 3, 4))
    assert np.array_equal(run.position[:, -1], np.tile(START, (5, 1)))


def test_yaw_is_coupled_to_the_links():
    """Turning the quill pushes the arm back: with everything free and no friction the total angular momentum stays."""
    robot = adeptone(amplifier="current")
    free = replace(robot, joints=tuple(_without_friction(joint) for joint in robot.joints))
    command = np.tile([0.0, 0.0, 0.0, 1.0], (50, 1))
    run = simulate(free, command, 1e-3, position=START, stops=False)
    momentum = np.einsum("tij,tj->ti", free.inertia_matrix(run.position[0]), run.velocity[0])
    assert abs(run.velocity[0, -1, 0]) > 1e-4
    assert np.abs(momentum[:, 0]).max() < 1e-12


def _without_friction(joint):
    return replace(joint, drive=replace(joint.drive, viscous=replace(joint.drive.viscous, value=0.0)))


def test_a_coupling_outside_the_equations_is_refused():
    strange = replace(adeptone(), coupling=tuple(map(tuple, np.eye(4)[::-1])))
    with pytest.raises(RobotError, match="couples its motors"):
        simulate(strange, commands(), 1e-3)


def test_the_kernel_is_an_order_of_magnitude_faster_than_mujoco_rollout():
    """It is about fifty times as fast on an idle machine: see `benchmarks.kernel_speed`. What else runs here lowers the
    ratio of one try, but interpreted code would be slower than MuJoCo."""
    assert max(measure_speed(adeptone(), steps=200, repeats=5).ratio for _ in range(3)) > 10.0


@pytest.mark.slow
def test_the_kernel_is_fifty_times_as_fast_as_mujoco_rollout_on_an_idle_machine():
    ratios = [measure_speed(adeptone(), repeats=20).ratio for _ in range(5)]
    assert max(ratios) >= 50.0, ratios
