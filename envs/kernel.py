"""Batches of nominal SCARA simulations, compiled: RK4 of arm and motor currents under a zero-order-hold command.

State per simulation: q (4), q' (4), i (4). Equations as in `envs.robot` and `envs.scara`, solved in closed form::

    M(q) q'' = A^T N K sat(i) - F q' - b(q, q')
    L i' = sat(G u) - R i - N K A q'            inductance in a voltage-mode amplifier
    i = (sat(G u) - N K A q') / R               none
    i = sat(G u)                                current mode

A joint whose brake is closed has infinite inertia. At a joint limit the joint stops dead (a plastic stop that moves
no other joint); MuJoCo's limits are springs. Everything else agrees with `envs.mjcf.robot_spec`, with which it shares
the integrator and the step; see there for the order of MuJoCo's current.
"""

from __future__ import annotations

import hashlib
import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from envs import scara
from envs.adeptone import BASE_MOTOR
from envs.log import Array
from envs.robot import Drive, Robot, RobotError
from envs.scara import ScaraBody


@dataclass(frozen=True)
class Trajectories:
    """Simulated motions at the sampling instants. Shapes: time (T + 1,), the others (B, T + 1, 4).

    current: of the motors [A]; where it is no state (current mode, torque mode, no inductance) it stays as it began.
    """

    time: Array
    position: Array
    velocity: Array
    current: Array


def simulate(
    robots: Robot | Sequence[Robot],
    command: Array,
    sample_time: float,
    *,
    substeps: int = 1,
    position: Array | None = None,
    velocity: Array | None = None,
    current: Array | None = None,
    held: Sequence[int] = (),
    stops: bool = True,
    threads: int | None = None,
) -> Trajectories:
    """Simulates a batch of B SCARA robots over T sampling periods.

    robots: one robot for the whole batch or one per member.
    command: shape (T, 4) or (B, T, 4) [command units]; each row is held over one sampling period.
    sample_time: [s]; each period takes `substeps` steps of RK4.
    position, velocity, current: initial state, shape (4,) or (B, 4); 0 where not given.
    held: joints, by number, whose brakes are closed; their initial velocity is taken as 0.
    stops: whether the joint limits act.
    threads: number of threads; None takes all.

    Raises RobotError for a robot that is not a SCARA with a motor per joint or joint 2's motor on the base.
    """
    members = [robots] if isinstance(robots, Robot) else list(robots)
    table = np.stack([pack(member, held=held, stops=stops) for member in members])
    commands = np.ascontiguousarray(command, dtype=np.float64)
    commands = commands[None] if commands.ndim == 2 else commands
    initial = [np.atleast_2d(np.zeros(4) if item is None else item) for item in (position, velocity, current)]
    initial[1] = initial[1] * ~np.isin(np.arange(1, 5), held)
    batch = max(len(table), len(commands), *(len(item) for item in initial))
    states = np.empty((batch, commands.shape[1] + 1, STATES))
    states[:, 0] = np.concatenate([np.broadcast_to(item, (batch, 4)) for item in initial], axis=1)
    available = numba.get_num_threads()
    threads = min(batch, threads or available)
    if threads == 1:
        advance(table, commands, sample_time / substeps, substeps, states)
    else:
        numba.set_num_threads(threads)
        _advance_in_threads(table, commands, sample_time / substeps, substeps, states)
        numba.set_num_threads(available)
    time = sample_time * np.arange(states.shape[1])
    return Trajectories(time, states[..., 0:4], states[..., 4:8], states[..., 8:12])


def state_rates(robot: Robot, position: Array, velocity: Array, current: Array, output: Array) -> tuple[Array, Array]:
    """q'' [rad/s^2 or m/s^2] and i' [A/s], each of shape (4,), for one state and amplifier outputs, shape (4,) each."""
    row = pack(robot)
    state = (tuple(map(float, item)) for item in (velocity, current, output))
    accelerations, slopes = _slopes(row, math.sin(position[1]), math.cos(position[1]), *state)
    return np.array(accelerations), np.array(slopes)


STATES = 12
"""Length of a state: q (4), q' (4), i (4)."""
_ARM, _DRIVES, _DRIVE_ENTRIES = 8, 4, 14
PARAMETERS = _ARM + _DRIVES * _DRIVE_ENTRIES
"""Length of a packed robot."""


def pack(robot: Robot, *, held: Sequence[int] = (), stops: bool = True) -> Array:
    """A robot as the row of numbers that the compiled code reads, shape (PARAMETERS,).

    Arm: p1, p2, p3, yaw, weight, 1 if joint 2's motor stands on the base else 0, 1 / M33, 1 / M44. Per joint: 0 if
    held else 1, reflected inertia, viscous, torque constant, resistance, 1 / inductance (0: the current is no state),
    share of the state in the current (1 or 0), current per amplifier output and per velocity where it is no state,
    amplifier gain, limits of its output and of the current; last the rows' joint limits, lower and upper.
    """
    if not isinstance(robot.body, ScaraBody) or len(robot) != _DRIVES:
        raise RobotError(f"{robot.name} is no SCARA of four joints", remedy="Simulate it through envs.mjcf.robot_spec")
    based = np.array_equal(robot.coupling_matrix, BASE_MOTOR)
    rotors = robot.drive_values("reflected_inertia")
    if not (np.array_equal(robot.coupling_matrix, np.eye(_DRIVES)) or (based and rotors[1] == 0.0)):
        raise RobotError(
            f"{robot.name} couples its motors in a way the compiled equations do not know",
            remedy="Simulate it through envs.mjcf.robot_spec",
        )
    p = robot.body.parameters
    rows = [
        p.p1,
        p.p2,
        p.p3,
        p.yaw,
        p.mass * p.gravity,
        float(based),
        1 / (p.mass + rotors[2]),
        1 / (p.yaw + rotors[3]),
    ]
    for number, joint in enumerate(robot.joints, start=1):
        drive = joint.drive
        rows += [float(number not in held), drive.reflected_inertia, drive.viscous.value, *_electrical(drive)]
        rows += [joint.lower.value, joint.upper.value] if stops else [-math.inf, math.inf]
    return np.array(rows)


def _electrical(drive: Drive) -> tuple[float, ...]:
    gain, constant, resistance = drive.amplifier_gain.value, drive.torque_constant, drive.resistance.value
    limit = gain * drive.command_limit.value
    if drive.amplifier == "torque":
        return 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, gain, limit, math.inf
    current = drive.current_limit.value
    if drive.amplifier == "current":
        return constant, 0.0, 0.0, 0.0, 1.0, 0.0, gain, limit, current
    limit = min(limit, drive.voltage_limit.value)
    if drive.inductance.value == 0.0:
        return constant, resistance, 0.0, 0.0, 1.0 / resistance, constant / resistance, gain, limit, current
    return constant, resistance, 1.0 / drive.inductance.value, 1.0, 0.0, 0.0, gain, limit, current


_OPTIONS: dict[str, Any] = {"error_model": "numpy"}
"""No check for division by zero. Arithmetic stays in order: machine code for one thread and for several may otherwise
differ in the last bits."""

_planar_inertia = numba.njit(**_OPTIONS)(scara.planar_inertia)
_planar_bias = numba.njit(**_OPTIONS)(scara.planar_bias)


@numba.njit(**_OPTIONS)
def _clip(value, limit):
    return min(max(value, -limit), limit)


@numba.njit(**_OPTIONS)
def _moved(state, step, slope):
    """state + step slope for tuples of four."""
    return (
        state[0] + step * slope[0],
        state[1] + step * slope[1],
        state[2] + step * slope[2],
        state[3] + step * slope[3],
    )


@numba.njit(**_OPTIONS)
def _advanced(state, step, first, second, third, fourth):
    """RK4's state + step (k1 + 2 k2 + 2 k3 + k4) / 6 for tuples of four."""
    total = _moved(_moved(first, 1.0, fourth), 2.0, _moved(second, 1.0, third))
    return _moved(state, step * (1.0 / 6.0), total)


@numba.njit(**_OPTIONS)
def _turned(sine, cosine, angle):
    """Sine and cosine after a further turn: addition theorem, series to rounding for the small turn within a step."""
    if abs(angle) > 0.02:
        small_sine, small_cosine = math.sin(angle), math.cos(angle)
    else:
        square = angle * angle
        small_sine = angle + angle * square * (square * (1.0 / 120.0 - square * (1.0 / 5040.0)) - 1.0 / 6.0)
        small_cosine = 1.0 + square * (square * (1.0 / 24.0 - square * (1.0 / 720.0)) - 0.5)
    return sine * small_cosine + cosine * small_sine, cosine * small_cosine - sine * small_sine


@numba.njit(**_OPTIONS)
def _motor(row, joint, output, current, speed):
    """Torque at the joint and rate of the current; `output` is the amplifier's, whatever it controls."""
    at = _ARM + _DRIVE_ENTRIES * joint + 3
    constant = row[at]
    slope = (output - row[at + 1] * current - constant * speed) * row[at + 2]
    flowing = row[at + 3] * current + row[at + 4] * output - row[at + 5] * speed
    return constant * _clip(flowing, row[at + 8]), slope


@numba.njit(**_OPTIONS)
def _slopes(row, sine, cosine, speed, current, output):
    """q'' and i', two tuples of four; sine and cosine of joint 2's angle."""
    p1, p2, p3, yaw, based = row[0], row[1], row[2], row[3], row[5]
    at_1, at_2, at_3, at_4 = _ARM, _ARM + _DRIVE_ENTRIES, _ARM + 2 * _DRIVE_ENTRIES, _ARM + 3 * _DRIVE_ENTRIES
    free_1, free_2, free_3, free_4 = row[at_1], row[at_2], row[at_3], row[at_4]
    torque_1, slope_1 = _motor(row, 0, output[0], current[0], speed[0])
    torque_2, slope_2 = _motor(row, 1, output[1], current[1], speed[1] + based * speed[0])
    torque_3, slope_3 = _motor(row, 2, output[2], current[2], speed[2])
    torque_4, slope_4 = _motor(row, 3, output[3], current[3], speed[3])
    bias_1, bias_2 = _planar_bias(sine, speed[0], speed[1], p3)
    net_1 = torque_1 + (based * torque_2 - (row[at_1 + 2] * speed[0] + bias_1))
    net_2 = torque_2 - (row[at_2 + 2] * speed[1] + bias_2)
    net_3 = torque_3 - (row[at_3 + 2] * speed[2] - row[4])
    net_4 = torque_4 - row[at_4 + 2] * speed[3]

    # Joint 4 is eliminated first; a held joint's rows and columns vanish.
    m11, m12, m22 = _planar_inertia(cosine, p1, p2, p3, yaw)
    share = free_4 * yaw * row[7]
    m11, m22 = m11 + row[at_1 + 1] - share * yaw, m22 + row[at_2 + 1] - share * yaw
    m12 = (m12 - share * yaw) * free_1 * free_2
    net_1, net_2 = net_1 - share * net_4, net_2 - share * net_4
    inverse = 1.0 / (m11 * m22 - m12 * m12)
    acceleration_1 = (free_1 * inverse * m22) * net_1 - (free_1 * inverse * m12) * net_2
    acceleration_2 = (free_2 * inverse * m11) * net_2 - (free_2 * inverse * m12) * net_1
    acceleration_3 = free_3 * row[6] * net_3
    acceleration_4 = free_4 * row[7] * (net_4 - yaw * (acceleration_1 + acceleration_2))
    accelerations = (acceleration_1, acceleration_2, acceleration_3, acceleration_4)
    return accelerations, (slope_1, slope_2, slope_3, slope_4)


@numba.njit(**_OPTIONS)
def _step(row, position, speed, current, output, step):
    """One step of RK4 for constant amplifier output."""
    half = 0.5 * step
    sine, cosine = math.sin(position[1]), math.cos(position[1])
    a1, d1 = _slopes(row, sine, cosine, speed, current, output)
    sine_2, cosine_2 = _turned(sine, cosine, half * speed[1])
    speed_2 = _moved(speed, half, a1)
    a2, d2 = _slopes(row, sine_2, cosine_2, speed_2, _moved(current, half, d1), output)
    sine_3, cosine_3 = _turned(sine, cosine, half * speed_2[1])
    speed_3 = _moved(speed, half, a2)
    a3, d3 = _slopes(row, sine_3, cosine_3, speed_3, _moved(current, half, d2), output)
    sine_4, cosine_4 = _turned(sine, cosine, step * speed_3[1])
    speed_4 = _moved(speed, step, a3)
    a4, d4 = _slopes(row, sine_4, cosine_4, speed_4, _moved(current, step, d3), output)
    return (
        _advanced(position, step, speed, speed_2, speed_3, speed_4),
        _advanced(speed, step, a1, a2, a3, a4),
        _advanced(current, step, d1, d2, d3, d4),
    )


@numba.njit(**_OPTIONS)
def _stopped(row, joint, position, speed):
    """The joint's coordinate and speed after its stops."""
    at = _ARM + _DRIVE_ENTRIES * joint + 12
    if position < row[at]:
        return row[at], max(speed, 0.0)
    if position > row[at + 1]:
        return row[at + 1], min(speed, 0.0)
    return position, speed


@numba.njit(**_OPTIONS)
def _output(row, joint, command):
    at = _ARM + _DRIVE_ENTRIES * joint + 9
    return _clip(row[at] * command, row[at + 1])


@numba.njit(**_OPTIONS)
def _run_member(row, command, step, substeps, record):
    """One simulation from record[0] on; fills the rest of `record`, shape (T + 1, 12)."""
    start = record[0]
    position = (start[0], start[1], start[2], start[3])
    speed = (start[4], start[5], start[6], start[7])
    current = (start[8], start[9], start[10], start[11])
    for sample in range(len(command)):
        now = command[sample]
        output = (_output(row, 0, now[0]), _output(row, 1, now[1]), _output(row, 2, now[2]), _output(row, 3, now[3]))
        for _ in range(substeps):
            position, speed, current = _step(row, position, speed, current, output, step)
            q1, w1 = _stopped(row, 0, position[0], speed[0])
            q2, w2 = _stopped(row, 1, position[1], speed[1])
            q3, w3 = _stopped(row, 2, position[2], speed[2])
            q4, w4 = _stopped(row, 3, position[3], speed[3])
            position, speed = (q1, q2, q3, q4), (w1, w2, w3, w4)
        state = record[sample + 1]
        for joint in range(4):
            state[joint], state[4 + joint], state[8 + joint] = position[joint], speed[joint], current[joint]


def _compile(formulas: str, parallel: bool) -> Callable[[Array, Array, float, int, Array], None]:
    """The loop over the batch. numba keys its cache by this file and by the closure, neither of which knows the source
    of what is compiled from another file, nor the options: naming them inside keeps a stale compilation away."""

    @numba.njit(parallel=parallel, cache=True, **_OPTIONS)
    def run(table, commands, step, substeps, states):
        (formulas, parallel)  # noqa: B018
        for member in numba.prange(len(states)):
            row, command = table[member % len(table)], commands[member % len(commands)]
            _run_member(row, command, step, substeps, states[member])

    return run


_FORMULAS = hashlib.sha256(inspect.getsource(scara).encode()).hexdigest()
_advance_in_threads = _compile(_FORMULAS, True)
advance = _compile(_FORMULAS, False)
"""Fills `states`, shape (B, T + 1, STATES), from states[:, 0] on, in steps of `step` [s], `substeps` per command.

Arguments, all contiguous: table (1 or B, PARAMETERS) of packed robots, commands (1 or B, T, 4), step, substeps,
states. What `simulate` does without its conveniences, for callers that advance a few steps at a time.
"""
