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
    out = np.empty((batch, commands.shape[1] + 1, 12))
    out[:, 0] = np.concatenate([np.broadcast_to(item, (batch, 4)) for item in initial], axis=1)
    before = numba.get_num_threads()
    numba.set_num_threads(before if threads is None else threads)
    try:
        _run(table, commands, sample_time / substeps, substeps, out)
    finally:
        numba.set_num_threads(before)
    return Trajectories(sample_time * np.arange(out.shape[1]), out[..., 0:4], out[..., 4:8], out[..., 8:12])


_ARM, _DRIVES, _DRIVE_ENTRIES = 7, 4, 12
PARAMETERS = _ARM + _DRIVES * _DRIVE_ENTRIES
"""Length of a packed robot."""


def pack(robot: Robot, *, held: Sequence[int] = (), stops: bool = True) -> Array:
    """A robot as the row of numbers that the compiled code reads, shape (PARAMETERS,).

    Arm: p1, p2, p3, yaw, mass, weight, 1 if joint 2's motor stands on the base else 0. Per joint: reflected inertia
    (infinite when held), viscous, torque constant, resistance, 1 / inductance (0: the current is no state), current
    per volt and per velocity where it is no state, gain, limits of amplifier output and current, lower, upper limit.
    """
    if not isinstance(robot.body, ScaraBody) or len(robot) != _DRIVES:
        raise RobotError(f"{robot.name} is no SCARA of four joints", remedy="Simulate it through envs.mjcf.robot_spec")
    based = np.array_equal(robot.coupling_matrix, BASE_MOTOR)
    rotors = robot.drive_values("reflected_inertia")
    if (not based and not np.array_equal(robot.coupling_matrix, np.eye(_DRIVES))) or (based and rotors[1] != 0.0):
        raise RobotError(
            f"{robot.name} couples its motors in a way the compiled equations do not know",
            remedy="Simulate it through envs.mjcf.robot_spec",
        )
    p = robot.body.parameters
    rows = [p.p1, p.p2, p.p3, p.yaw, p.mass, p.mass * p.gravity, float(based)]
    for number, joint in enumerate(robot.joints, start=1):
        inertia = math.inf if number in held else joint.drive.reflected_inertia
        limits = (joint.lower.value, joint.upper.value) if stops else (-math.inf, math.inf)
        rows += [inertia, joint.drive.viscous.value, *_electrical(joint.drive), *limits]
    return np.array(rows)


def _electrical(drive: Drive) -> tuple[float, ...]:
    gain, constant, resistance = drive.amplifier_gain.value, drive.torque_constant, drive.resistance.value
    limit = gain * drive.command_limit.value
    if drive.amplifier == "torque":
        return 1.0, 0.0, 0.0, 1.0, 0.0, gain, limit, math.inf
    current = drive.current_limit.value
    if drive.amplifier == "current":
        return constant, 0.0, 0.0, 1.0, 0.0, gain, limit, current
    limit = min(limit, drive.voltage_limit.value)
    if drive.inductance.value == 0.0:
        return constant, resistance, 0.0, 1.0 / resistance, constant / resistance, gain, limit, current
    return constant, resistance, 1.0 / drive.inductance.value, 0.0, 0.0, gain, limit, current


_OPTIONS = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "arcp", "nsz"}}
"""No check for division by zero, and reorderings of arithmetic that leave infinities and NaN meaningful."""

_planar_inertia = numba.njit(**_OPTIONS)(scara.planar_inertia)
_planar_bias = numba.njit(**_OPTIONS)(scara.planar_bias)


@numba.njit(**_OPTIONS)
def _clip(value, limit):  # type: ignore[no-untyped-def]
    return min(max(value, -limit), limit)


@numba.njit(**_OPTIONS)
def _moved(state, step, slope):  # type: ignore[no-untyped-def]
    """state + step slope for tuples of four."""
    return (
        state[0] + step * slope[0],
        state[1] + step * slope[1],
        state[2] + step * slope[2],
        state[3] + step * slope[3],
    )


@numba.njit(**_OPTIONS)
def _mean(first, second, third, fourth):  # type: ignore[no-untyped-def]
    """RK4's mean slope (k1 + 2 k2 + 2 k3 + k4) / 6 for tuples of four."""
    return _moved((0.0, 0.0, 0.0, 0.0), 1.0 / 6.0, _moved(_moved(first, 1.0, fourth), 2.0, _moved(second, 1.0, third)))


@numba.njit(**_OPTIONS)
def _motor(row, joint, voltage, current, speed):  # type: ignore[no-untyped-def]
    """Torque at the joint and rate of the current; `voltage` is the amplifier's output, whatever it controls."""
    at = _ARM + _DRIVE_ENTRIES * joint
    constant, per_inductance = row[at + 2], row[at + 4]
    if per_inductance > 0.0:
        slope = (voltage - row[at + 3] * current - constant * speed) * per_inductance
    else:
        current, slope = row[at + 5] * voltage - row[at + 6] * speed, 0.0
    return constant * _clip(current, row[at + 9]), slope


@numba.njit(**_OPTIONS)
def _slopes(row, angle, speed, current, voltage):  # type: ignore[no-untyped-def]
    """q'' and i', two tuples of four, for joint 2 at `angle`."""
    p1, p2, p3, yaw, mass, weight, based = row[0], row[1], row[2], row[3], row[4], row[5], row[6]
    torque_1, slope_1 = _motor(row, 0, voltage[0], current[0], speed[0])
    torque_2, slope_2 = _motor(row, 1, voltage[1], current[1], speed[1] + based * speed[0])
    torque_3, slope_3 = _motor(row, 2, voltage[2], current[2], speed[2])
    torque_4, slope_4 = _motor(row, 3, voltage[3], current[3], speed[3])
    bias_1, bias_2 = _planar_bias(math.sin(angle), speed[0], speed[1], p3)
    at_1, at_2, at_3, at_4 = _ARM, _ARM + _DRIVE_ENTRIES, _ARM + 2 * _DRIVE_ENTRIES, _ARM + 3 * _DRIVE_ENTRIES
    net_1 = torque_1 + based * torque_2 - row[at_1 + 1] * speed[0] - bias_1
    net_2 = torque_2 - row[at_2 + 1] * speed[1] - bias_2
    net_3 = torque_3 - row[at_3 + 1] * speed[2] + weight
    net_4 = torque_4 - row[at_4 + 1] * speed[3]

    # Elimination of joint 4, then of joint 1, in divisions that an infinite (held) inertia turns into zeros.
    m11, m12, m22 = _planar_inertia(math.cos(angle), p1, p2, p3, yaw)
    m44 = yaw + row[at_4]
    share = yaw / m44
    m11, m12, m22 = m11 + row[at_1] - share * yaw, m12 - share * yaw, m22 + row[at_2] - share * yaw
    net_1, net_2 = net_1 - share * net_4, net_2 - share * net_4
    share = m12 / m11
    acceleration_2 = (net_2 - share * net_1) / (m22 - share * m12)
    acceleration_1 = (net_1 - m12 * acceleration_2) / m11
    acceleration_3 = net_3 / (mass + row[at_3])
    acceleration_4 = (net_4 - yaw * (acceleration_1 + acceleration_2)) / m44
    accelerations = (acceleration_1, acceleration_2, acceleration_3, acceleration_4)
    return accelerations, (slope_1, slope_2, slope_3, slope_4)


@numba.njit(**_OPTIONS)
def _step(row, position, speed, current, voltage, step):  # type: ignore[no-untyped-def]
    """One step of RK4 for constant amplifier output."""
    half = 0.5 * step
    a1, d1 = _slopes(row, position[1], speed, current, voltage)
    speed_2 = _moved(speed, half, a1)
    a2, d2 = _slopes(row, position[1] + half * speed[1], speed_2, _moved(current, half, d1), voltage)
    speed_3 = _moved(speed, half, a2)
    a3, d3 = _slopes(row, position[1] + half * speed_2[1], speed_3, _moved(current, half, d2), voltage)
    speed_4 = _moved(speed, step, a3)
    a4, d4 = _slopes(row, position[1] + step * speed_3[1], speed_4, _moved(current, step, d3), voltage)
    return (
        _moved(position, step, _mean(speed, speed_2, speed_3, speed_4)),
        _moved(speed, step, _mean(a1, a2, a3, a4)),
        _moved(current, step, _mean(d1, d2, d3, d4)),
    )


@numba.njit(**_OPTIONS)
def _stopped(row, joint, position, speed):  # type: ignore[no-untyped-def]
    """The joint's coordinate and speed after its stops."""
    lower, upper = row[_ARM + _DRIVE_ENTRIES * joint + 10], row[_ARM + _DRIVE_ENTRIES * joint + 11]
    if position < lower:
        return lower, max(speed, 0.0)
    if position > upper:
        return upper, min(speed, 0.0)
    return position, speed


@numba.njit(**_OPTIONS)
def _output(row, joint, command):  # type: ignore[no-untyped-def]
    at = _ARM + _DRIVE_ENTRIES * joint
    return _clip(row[at + 7] * command, row[at + 8])


@numba.njit(**_OPTIONS)
def _run_member(row, command, step, substeps, record):  # type: ignore[no-untyped-def]
    """One simulation from record[0] on; fills the rest of `record`, shape (T + 1, 12)."""
    start = record[0]
    position = (start[0], start[1], start[2], start[3])
    speed = (start[4], start[5], start[6], start[7])
    current = (start[8], start[9], start[10], start[11])
    for sample in range(len(command)):
        now = command[sample]
        voltage = (_output(row, 0, now[0]), _output(row, 1, now[1]), _output(row, 2, now[2]), _output(row, 3, now[3]))
        for _ in range(substeps):
            position, speed, current = _step(row, position, speed, current, voltage, step)
            q1, w1 = _stopped(row, 0, position[0], speed[0])
            q2, w2 = _stopped(row, 1, position[1], speed[1])
            q3, w3 = _stopped(row, 2, position[2], speed[2])
            q4, w4 = _stopped(row, 3, position[3], speed[3])
            position, speed = (q1, q2, q3, q4), (w1, w2, w3, w4)
        state = record[sample + 1]
        for joint in range(4):
            state[joint], state[4 + joint], state[8 + joint] = position[joint], speed[joint], current[joint]


def _compile(formulas: str) -> Callable[[Array, Array, float, int, Array], None]:
    """The loop over the batch. `formulas` identifies the source of what is compiled from another file: numba keys its
    cache by this file and by the closure, so that naming it there keeps a stale compilation from being used."""

    @numba.njit(parallel=True, cache=True, **_OPTIONS)
    def run(table, commands, step, substeps, out):  # type: ignore[no-untyped-def]
        len(formulas)
        for member in numba.prange(len(out)):
            row, command = table[member % len(table)], commands[member % len(commands)]
            _run_member(row, command, step, substeps, out[member])

    return run


_run = _compile(hashlib.sha256(inspect.getsource(scara).encode()).hexdigest())
