"""Closed form, compiled kernel, MuJoCo and Pinocchio are the same robot, and it obeys physics.

Where trajectories differ although integrator and step agree: MuJoCo's `dcmotor` with inductance lets the torque use
the current at the end of the step, so its error falls in proportion to the step even under RK4. Without inductance and
in current mode the engines differ by rounding alone.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from envs.adeptone import adeptone
from envs.kernel import simulate, state_rates
from envs.mjcf import lock_joint, robot_spec
from envs.pinocchio_model import (
    forward_dynamics,
    inertial_parameters,
    inverse_dynamics,
    pinocchio_model,
    torque_regressor,
)
from envs.robot import Quantity

STATORS = ("link_1", "base")
AGREEMENT = 1e-9
MEMBERS = st.integers(0, 2**32 - 1)
ANGLES = st.floats(-np.pi, np.pi)


def random_states(count, seed=0):
    """Positions within the limits, velocities, torques and currents, shape (count, 4) each."""
    rng = np.random.default_rng(seed)
    joints = adeptone().joints
    lower, upper = (np.array([float(getattr(joint, side)) for joint in joints]) for side in ("lower", "upper"))
    position = rng.uniform(lower, upper, (count, 4))
    return position, *(rng.normal(size=(3, count, 4)) * np.array([[5.0], [20.0], [2.0]])[:, None])


def with_drives(robot, **changes):
    """The same robot with some numbers of every drive replaced."""
    unit = "as before"
    values = {name: Quantity(value, unit, "test") for name, value in changes.items()}
    return replace(robot, joints=tuple(replace(item, drive=replace(item.drive, **values)) for item in robot.joints))


GENTLE = {"voltage": np.array([0.8, 0.6, 0.5, 0.6]), "current": np.array([0.5, 0.4, 0.2, 0.02])}


def gentle_commands(robot, steps):
    """Commands at 1 kHz that keep joints and currents within their limits and carry the quill, (steps, 4) [V]."""
    amplitude, carry = GENTLE[robot.joint(1).drive.amplifier], np.zeros(4)
    carry[2] = robot.body.bias(START, np.zeros(4))[2] * robot.input_equivalent(3)
    frequency, phase = np.array([9.0, 13.0, 11.0, 17.0]), np.array([1.0, 2.0, 1.5, 2.5])
    return carry + amplitude * np.cos(frequency * 1e-3 * np.arange(steps)[:, None] + phase)


START = np.array([0.3, -0.8, 0.1, 1.0])


def simulate_in_mujoco(robot, command, sample_time, substeps=1):
    """Positions, velocities and currents at the sampling instants, shape (T + 1, 4) each."""
    model = robot_spec(robot, timestep=sample_time / substeps, scenery=False).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = START
    record = [np.concatenate([data.qpos, data.qvel, data.act])]
    for row in command:
        data.ctrl[:] = row * robot.drive_values("amplifier_gain")
        mujoco.mj_step(model, data, nstep=substeps)
        record.append(np.concatenate([data.qpos, data.qvel, data.act]))
    record = np.array(record)
    return record[:, :4], record[:, 4:8], record[:, 8:]


def simulate_in_pinocchio(robot, command, step):
    """RK4 written out, on Pinocchio's ABA and the motors' equation; shape (T + 1, 12)."""
    model, turns = pinocchio_model(robot), robot.coupling_matrix
    gain, resistance, inductance = (robot.drive_values(name) for name in ("amplifier_gain", "resistance", "inductance"))
    constant = robot.drive_values("torque_constant")

    def slope(state, output):
        position, velocity, current = np.split(state, 3)
        acceleration = forward_dynamics(robot, model, position, velocity, turns.T @ (constant * current))
        return np.concatenate(
            [velocity, acceleration, (output - resistance * current - constant * (turns @ velocity)) / inductance]
        )

    states = [np.concatenate([START, np.zeros(8)])]
    for row in command:
        state, output = states[-1], gain * row
        k1 = slope(state, output)
        k2 = slope(state + 0.5 * step * k1, output)
        k3 = slope(state + 0.5 * step * k2, output)
        k4 = slope(state + step * k3, output)
        states.append(state + step / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4))
    return np.array(states)


def largest_error(actual, expected):
    """Largest difference relative to each column's largest magnitude."""
    return np.max(np.abs(actual - expected) / np.abs(expected).max(axis=0))


@pytest.mark.parametrize("stator", STATORS)
def test_accelerations_agree_on_random_states(stator):
    robot = adeptone(second_stator=stator).sample(np.random.default_rng(3))
    pinocchio, turns = pinocchio_model(robot), robot.coupling_matrix
    model = robot_spec(robot, scenery=False).compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    data = mujoco.MjData(model)
    limit = robot.drive_values("current_limit")
    for position, velocity, _, current in zip(*random_states(200), strict=True):
        torque = turns.T @ (robot.drive_values("torque_constant") * np.clip(current, -limit, limit))
        expected = robot.forward_dynamics(position, velocity, torque)
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = position, velocity, torque
        mujoco.mj_forward(model, data)
        by_kernel, _ = state_rates(robot, position, velocity, current, np.zeros(4))
        scale = np.abs(expected).max()
        for actual in (data.qacc, forward_dynamics(robot, pinocchio, position, velocity, torque), by_kernel):
            assert np.abs(actual - expected).max() <= AGREEMENT * scale


@pytest.mark.parametrize("stator", STATORS)
def test_motor_equations_agree_on_random_states(stator):
    robot = adeptone(second_stator=stator)
    model = robot_spec(robot, scenery=False).compile()
    data = mujoco.MjData(model)
    for position, velocity, output, current in zip(*random_states(100), strict=True):
        output = np.clip(output, -50.0, 50.0)
        data.qpos[:], data.qvel[:], data.act[:], data.ctrl[:] = position, velocity, current, output
        mujoco.mj_forward(model, data)
        _, slopes = state_rates(robot, position, velocity, current, output)
        assert data.act_dot == pytest.approx(slopes, rel=AGREEMENT)


def test_inverse_dynamics_and_regressor_agree():
    robot = adeptone().sample(np.random.default_rng(5))
    model = pinocchio_model(robot)
    theta = inertial_parameters(model)
    for position, velocity, acceleration, _ in zip(*random_states(100), strict=True):
        torque = robot.inverse_dynamics(position, velocity, acceleration)
        by_rnea = inverse_dynamics(robot, model, position, velocity, acceleration)
        drives = robot.drive_values("reflected_inertia") * acceleration + robot.drive_values("viscous") * velocity
        by_regressor = torque_regressor(model, position, velocity, acceleration) @ theta + drives
        assert by_rnea == pytest.approx(torque, rel=AGREEMENT)
        assert by_regressor == pytest.approx(torque, rel=AGREEMENT)


@pytest.mark.parametrize("stator", STATORS)
@pytest.mark.parametrize("drive", ["current mode", "no inductance"])
def test_trajectories_of_mujoco_agree_at_the_same_integrator_and_step(stator, drive):
    robot = adeptone(second_stator=stator, amplifier="current" if drive == "current mode" else "voltage")
    if drive == "no inductance":
        robot = with_drives(robot, inductance=0.0)
    command = gentle_commands(robot, 500)
    kernel = simulate(robot, command, 1e-3, position=START, threads=1)
    position, velocity, _ = simulate_in_mujoco(robot, command, 1e-3)
    assert np.ptp(position, axis=0).min() > 0.005
    assert largest_error(kernel.position[0], position) < AGREEMENT
    assert largest_error(kernel.velocity[0], velocity) < AGREEMENT


@pytest.mark.parametrize("stator", STATORS)
def test_trajectories_of_pinocchio_agree_at_the_same_integrator_and_step(stator):
    robot = adeptone(second_stator=stator)
    command = gentle_commands(robot, 300)
    kernel = simulate(robot, command, 1e-3, position=START, threads=1)
    states = simulate_in_pinocchio(robot, command, 1e-3)
    joined = np.concatenate([kernel.position[0], kernel.velocity[0], kernel.current[0]], axis=1)
    assert largest_error(joined, states) < AGREEMENT


def test_mujocos_motor_with_inductance_converges_at_first_order():
    robot = adeptone()
    command = gentle_commands(robot, 300)
    exact = simulate(robot, command, 1e-3, substeps=8, position=START, threads=1)
    errors = [
        largest_error(simulate_in_mujoco(robot, command, 1e-3, substeps)[1], exact.velocity[0]) for substeps in (4, 8)
    ]
    assert errors[0] < 0.02
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


@settings(max_examples=100, deadline=None)
@given(member=MEMBERS, elbow=ANGLES, yaw=ANGLES)
def test_inertia_matrix_is_symmetric_and_positive_definite(member, elbow, yaw):
    robot = adeptone().sample(np.random.default_rng(member))
    matrix = robot.inertia_matrix(np.array([0.0, elbow, 0.1, yaw]))
    assert np.array_equal(matrix, matrix.T)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0


@settings(max_examples=50, deadline=None)
@given(member=MEMBERS, state=st.integers(0, 2**32 - 1))
def test_coriolis_torques_do_no_work_beyond_the_change_of_inertia(member, state):
    """q' (b - g) = 1/2 q' M' q': the skew symmetry of M' - 2 C, by a central difference of M along the motion."""
    robot = adeptone().sample(np.random.default_rng(member))
    (position,), (velocity,), *_ = random_states(1, state)
    gravity = robot.body.bias(position, np.zeros(4))
    ahead, behind = (robot.inertia_matrix(position + sign * 1e-6 * velocity) for sign in (1, -1))
    change = (ahead - behind) / 2e-6
    work = velocity @ (robot.body.bias(position, velocity) - gravity)
    assert work == pytest.approx(0.5 * velocity @ change @ velocity, rel=1e-6, abs=1e-6 * np.sum(velocity**2))


def stored_energy(robot, run):
    """Kinetic energy of arm and rotors, magnetic of the motors, potential of the quill, shape (B, T + 1) [J]."""
    kinetic = 0.5 * np.einsum("...i,...ij,...j", run.velocity, robot.inertia_matrix(run.position), run.velocity)
    weight = robot.body.parameters.mass * robot.body.parameters.gravity
    magnetic = 0.5 * (robot.drive_values("inductance") * run.current**2).sum(axis=-1)
    return kinetic + magnetic - weight * run.position[..., 2]


def test_energy_is_conserved_without_friction_and_torque():
    robot = with_drives(adeptone(amplifier="current"), viscous=0.0)
    run = simulate(
        robot, np.zeros((1000, 4)), 1e-3, position=START, velocity=np.array([1.0, -3.0, 0.2, 9.0]), stops=False
    )
    energy = stored_energy(robot, run)[0]
    assert np.ptp(run.position[0, :, 1]) > 1.0
    assert np.abs(energy - energy[0]).max() < 1e-9 * energy[0]


@settings(max_examples=20, deadline=None)
@given(member=MEMBERS, stator=st.sampled_from(STATORS))
def test_the_motors_terminals_are_passive(member, stator):
    """What is stored never exceeds what the terminals supplied: integral of v i, by Simpson's rule per period."""
    rng = np.random.default_rng(member)
    robot = with_drives(adeptone(second_stator=stator).sample(rng), current_limit=1e6)
    output = rng.uniform(-10, 10, (40, 4))
    command = np.repeat(output, 2, axis=0) / robot.drive_values("amplifier_gain")
    run = simulate(robot, command, 5e-5, substeps=2, position=START, stops=False, threads=1)
    first, middle, last = run.current[0, :-1:2], run.current[0, 1::2], run.current[0, 2::2]
    supplied = 1e-4 * np.sum(output * (first + 4 * middle + last) / 6.0, axis=1)
    stored = np.diff(stored_energy(robot, run)[0, ::2])
    assert np.all(stored <= supplied + 1e-6 * np.abs(supplied).max())


def third_order_joint(robot, joint, position):
    """State matrix, shape (3, 3), and input vectors of one joint with the others held: x' = A x + B u + c."""
    drive = robot.joint(joint).drive
    inertia = robot.inertia_matrix(position)[joint - 1, joint - 1]
    alpha, inductance = drive.torque_constant, drive.inductance.value
    matrix = np.array(
        [
            [0.0, 1.0, 0.0],
            [0.0, -drive.viscous.value / inertia, alpha / inertia],
            [0.0, -alpha / inductance, -drive.resistance.value / inductance],
        ]
    )
    constant = np.array([0.0, -robot.body.bias(position, np.zeros(4))[joint - 1] / inertia, 0.0])
    return matrix, np.array([0.0, 0.0, drive.amplifier_gain.value / inductance]), constant


@pytest.mark.parametrize("joint", [1, 2, 3, 4])
def test_one_joint_is_the_analytic_third_order_system(joint):
    """A step command: x(t) = exp([A, B u + c; 0, 0] t) x(0), for each joint with the brakes of the others closed."""
    robot, time = adeptone(), 0.05
    matrix, entry, constant = third_order_joint(robot, joint, START)
    augmented = np.zeros((4, 4))
    augmented[:3, :3], augmented[:3, 3] = matrix, 0.3 * entry + constant
    expected = (expm(augmented * time) @ np.array([START[joint - 1], 0.0, 0.0, 1.0]))[:3]
    command = np.zeros(4)
    command[joint - 1] = 0.3
    others = [number for number in (1, 2, 3, 4) if number != joint]

    def error(substeps):
        run = simulate(robot, command[None], time, substeps=substeps, position=START, held=others, stops=False)
        end = np.array([item[0, -1, joint - 1] for item in (run.position, run.velocity, run.current)])
        assert np.array_equal(np.delete(run.position[0, -1], joint - 1), np.delete(START, joint - 1))
        return np.abs((end - expected) / expected).max()

    assert error(1000) < 1e-8
    assert np.log2(error(50) / error(100)) == pytest.approx(4.0, abs=0.4)


def test_paper_parameters_are_the_third_order_system():
    """v = a11 q''' + a12 q'' + a13 q' with a11 = L I/alpha, a12 = (R I + L f)/alpha, a13 = alpha + R f/alpha."""
    robot, pose = adeptone(), np.array([0.0, np.pi / 2, 0.0, 0.0])
    matrix, entry, _ = third_order_joint(robot, 1, pose)
    drive = robot.joint(1).drive
    resistance, inductance, alpha = drive.resistance.value, drive.inductance.value, drive.torque_constant
    inertia, viscous = robot.inertia_matrix(pose)[0, 0], drive.viscous.value
    jerk = inductance * inertia / alpha
    expected = [(resistance * inertia + inductance * viscous) / alpha, alpha + resistance * viscous / alpha]
    characteristic = np.poly(matrix[1:, 1:]) * jerk
    assert characteristic == pytest.approx([jerk, *expected])
    assert entry[2] * matrix[1, 2] * jerk == pytest.approx(drive.amplifier_gain.value)


def test_closed_brake_in_mujoco_and_kernel_is_the_same():
    robot = with_drives(adeptone(), inductance=0.0)
    command = gentle_commands(robot, 500)
    model = robot_spec(robot, held={2: START[1], 4: START[3]}, scenery=False).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = START[[0, 2]]
    for row in command:
        data.ctrl[:] = (row * robot.drive_values("amplifier_gain"))[[0, 2]]
        mujoco.mj_step(model, data)
    run = simulate(robot, command, 1e-3, position=START, held=(2, 4), threads=1)
    assert run.position[0, -1, [0, 2]] == pytest.approx(data.qpos, rel=AGREEMENT)
    assert run.position[0, -1, [1, 3]] == pytest.approx(START[[1, 3]], abs=0.0)


@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_locked_joint_stands_where_the_free_one_was_put(kind):
    xml = f"""<mujoco>
      <worldbody>
        <body pos="1 2 3" euler="10 20 30">
          <joint name="j" type="{kind}" pos="0.1 0.2 0.3" axis="1 2 3"/><geom size="0.1"/>
          <body pos="0.5 0 0"><geom size="0.1"/><site name="tip"/></body>
        </body>
      </worldbody>
      <actuator><motor name="j" joint="j"/></actuator>
    </mujoco>"""
    free, locked = mujoco.MjSpec.from_string(xml), mujoco.MjSpec.from_string(xml)
    lock_joint(locked, "j", 0.7)
    poses = []
    for spec in (free, locked):
        model = spec.compile()
        data = mujoco.MjData(model)
        data.qpos[:] = 0.7
        mujoco.mj_forward(model, data)
        poses.append(np.concatenate([data.site("tip").xpos, data.site("tip").xmat]))
    assert (model.nv, model.nu) == (0, 0)
    assert poses[1] == pytest.approx(poses[0])


def test_model_written_as_mjcf_is_the_same_robot(tmp_path):
    spec = robot_spec(adeptone())
    model = spec.compile()
    path = tmp_path / "robot.xml"
    path.write_text(spec.to_xml())
    again = mujoco.MjModel.from_xml_path(str(path))
    assert again.numeric("amplifier_gain").data == pytest.approx(adeptone().drive_values("amplifier_gain"))
    for name in ("body_mass", "body_inertia", "actuator_gainprm", "actuator_dynprm", "dof_damping", "dof_armature"):
        assert getattr(again, name) == pytest.approx(getattr(model, name), rel=1e-5), name
