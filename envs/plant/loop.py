"""The plant's compiled time loop: servo, amplifier and the classical Runge-Kutta scheme around MuJoCo's `mj_forward`.

MuJoCo gives accelerations and activation rates; the loop gives it, at every stage of every step, the controls, the
applied torques and the friction limits that the tables prescribe for the state of that stage. Nothing is added to a
motion afterwards. Orders of accuracy: 4 where the equations are smooth; the command is held over the sample, a command
edge inside a step (fractional delay) acts with its average, so the scheme is of order 2 there.
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

import ctypes
import math
from pathlib import Path

import mujoco
import numba.experimental.function_type  # noqa: F401  lets numba type wrapped addresses
from numba import njit, types

from envs.plant.tables import (
    ACCELERATION,
    CURRENT,
    POSITION_SINE,
    PULSE,
    TIME_SINE,
    VELOCITY,
    VOLTAGE,
)

_COUPLING_SWEEPS = 4
"""Evaluations per stage when an axis feels another one's acceleration: a contraction of at least 2 each."""


class ForwardFunction(types.WrapperAddressProtocol):
    """MuJoCo's C function `mj_forward` as a value that compiled code can call with the addresses of model and data."""

    def __init__(self) -> None:
        library = next(Path(mujoco.__file__).parent.glob("libmujoco.*"))
        self._function = ctypes.CDLL(str(library)).mj_forward

    def __wrapper_address__(self) -> int:
        address = ctypes.cast(self._function, ctypes.c_void_p).value
        assert address is not None
        return address

    def signature(self):
        return types.void(types.int64, types.int64)


@njit(cache=True)
def advance(forward, world, tables, memory, traces, commands, reference, noise, sample_at, substeps, step, clock):
    """Runs the plant over len(reference) samples.

    commands: (D + T, n), the last T rows are this run's commands (rows of servo joints are written here), the first D
    rows are earlier ones. reference: (T, n) of the servos. noise: (T substeps, n) or empty, command units.
    sample_at: (T,), ascending, when samples are taken, in steps from the run's start. clock: number of the first sample
    since the plant was started.
    """
    past = len(commands) - len(reference)
    taken = 0
    for tick in range(len(reference)):
        row = past + tick
        _servo(world, tables, memory, commands, reference, row, tick, clock, substeps * step)
        for substep in range(substeps):
            number = tick * substeps + substep
            time = (clock * substeps + number) * step
            before = memory.work[10]
            before_speed = memory.work[11]
            before[: len(world.position)] = world.position
            before_speed[: len(world.velocity)] = world.velocity
            _events(world, tables.events, time)
            _heat_winding(world, tables.drives)
            _step(forward, world, tables, memory, commands, noise, row, substep, substeps, number, step, time)
            while taken < len(sample_at) and sample_at[taken] < number + 1.0:
                _sample(world, tables, memory, traces, taken, sample_at[taken] - number, step)
                taken += 1


@njit(cache=True)
def _servo(world, tables, memory, commands, reference, row, tick, clock, sample_time):
    """u = kp (r - y) + kd (r' - y') + ki int(r - y) + feed, through encoder and converter, for servo joints."""
    for j in range(len(tables.servos)):
        servo = tables.servos[j]
        if servo.active == 0:
            continue
        angle = world.position[tables.joints[j].encoder]
        reading = read_encoder(
            angle,
            servo.encoder_step,
            servo.eccentricity,
            servo.eccentricity_cycles,
            servo.eccentricity_phase,
        )
        state = memory.servo[j]
        target = reference[tick, j]
        if clock + tick == 0:
            state[0], state[3] = reading, target
        error_rate = (target - state[3] - reading + state[0]) / sample_time
        state[1] += servo.filter * (error_rate - state[1])
        state[2] += (target - reading) * sample_time
        state[0], state[3] = reading, target
        wanted = servo.feed + servo.proportional * (target - reading) + servo.derivative * state[1]
        commands[row, j] = convert(wanted + servo.integral * state[2], servo.command_step, servo.command_limit)


@njit(cache=True)
def read_encoder(angle, step, eccentricity, cycles, phase):
    """round((q + A sin(c q + phase)) / step) step; without quantisation for step 0."""
    seen = angle + eccentricity * math.sin(cycles * angle + phase)
    return seen if step == 0.0 else step * math.floor(seen / step + 0.5)


@njit(cache=True)
def convert(value, step, limit):
    """The digital-to-analogue converter: nearest code, from -limit to limit - step."""
    value = min(max(value, -limit), limit - step)
    return value if step == 0.0 else step * math.floor(value / step + 0.5)


@njit(cache=True)
def _events(world, events, time):
    for event in events:
        if time >= event.time - 1e-9:
            world.body_mass[event.body] += event.mass
            for axis in range(3):
                world.body_inertia[event.body, axis] += event.inertia
            event.time = math.inf


@njit(cache=True)
def _heat_winding(world, drives):
    """The electrical time constant L / R(T); MuJoCo keeps it at its cold value by itself."""
    for drive in drives:
        if drive.heat >= 0 and drive.current >= 0:
            rise = drive.temperature_coefficient * world.activation[drive.heat]
            world.dynamics[drive.actuator, 0] = drive.inductance / (drive.resistance * (1.0 + rise))


@njit(cache=True)
def _delayed(commands, column, row, fraction, width, delay):
    """Mean of the held command over [fraction, fraction + width] samples after `row`, `delay` samples earlier."""
    start = fraction - delay
    first = math.floor(start + 1e-9)
    edge = min(max(first + 1.0 - start, 0.0), width)
    early = commands[max(row + int(first), 0), column]
    late = commands[max(row + min(int(first) + 1, 0), 0), column]
    return (edge * early + (width - edge) * late) / width


@njit(cache=True)
def _step(forward, world, tables, memory, commands, noise, row, substep, substeps, number, step, time):
    """One step of the classical Runge-Kutta scheme; bristles by the exponential scheme at the stages' speeds."""
    nv, na, n = len(world.velocity), len(world.activation), len(tables.drives)
    work = memory.work
    start_position, start_velocity, start_activation = work[0], work[1], work[2]
    sum_velocity, sum_acceleration, sum_rate = work[3], work[4], work[5]
    held, level, bristle_speed = work[6], work[7], work[8]
    start_position[:nv] = world.position
    start_velocity[:nv] = world.velocity
    start_activation[:na] = world.activation
    sum_velocity[:] = 0.0
    sum_acceleration[:] = 0.0
    sum_rate[:] = 0.0
    bristle_speed[:] = 0.0
    for j in range(n):
        held[j] = _hold(tables.drives[j], commands, j, row, substep / substeps, 1.0 / substeps)
    for stage in range(4):
        weight = 1.0 if stage == 0 or stage == 3 else 2.0
        place = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        ahead = 1.0 if stage == 2 else 0.5
        for j in range(n):
            lag = tables.drives[j].lag
            settled = held[j]
            if lag > 0.0:
                settled += (memory.lag[j] - held[j]) * math.exp(-place * step / lag)
            level[j] = settled + tables.drives[j].offset
            if len(noise) > 0:
                level[j] += noise[number, j]
        _evaluate(forward, world, tables, memory, level, time + place * step)
        for i in range(nv):
            sum_velocity[i] += weight * world.velocity[i]
            sum_acceleration[i] += weight * world.acceleration[i]
        for i in range(na):
            sum_rate[i] += weight * world.activation_rate[i]
        for b in range(len(tables.bristles)):
            bristle_speed[b] += weight * world.velocity[tables.bristles[b].dof]
        if stage < 3:
            for b in range(len(tables.bristles)):
                work[9, b] = world.velocity[tables.bristles[b].dof]
            for i in range(nv):
                world.position[i] = start_position[i] + ahead * step * world.velocity[i]
                world.velocity[i] = start_velocity[i] + ahead * step * world.acceleration[i]
            for i in range(na):
                world.activation[i] = start_activation[i] + ahead * step * world.activation_rate[i]
            for b in range(len(tables.bristles)):
                _bend(world, tables.bristles[b], start_activation, work[9, b], ahead * step)
    for i in range(nv):
        world.position[i] = start_position[i] + step / 6.0 * sum_velocity[i]
        world.velocity[i] = start_velocity[i] + step / 6.0 * sum_acceleration[i]
    for i in range(na):
        world.activation[i] = start_activation[i] + step / 6.0 * sum_rate[i]
    for b in range(len(tables.bristles)):
        _bend(world, tables.bristles[b], start_activation, bristle_speed[b] / 6.0, step)
    for j in range(n):
        drive = tables.drives[j]
        if drive.lag > 0.0:
            memory.lag[j] = held[j] + (memory.lag[j] - held[j]) * math.exp(-step / drive.lag)
        if drive.current >= 0:
            i = drive.current
            world.activation[i] = min(max(world.activation[i], -drive.current_limit), drive.current_limit)


@njit(cache=True)
def _bend(world, bristle, start, speed, duration):
    """Exact solution of z' = v - stiffness |v| z / level over `duration` at constant speed."""
    rate = bristle.stiffness * abs(speed) / bristle.level
    begin = start[bristle.activation]
    if rate * duration < 1e-9:
        world.activation[bristle.activation] = begin + speed * duration
    else:
        settled = speed / rate
        world.activation[bristle.activation] = settled + (begin - settled) * math.exp(-rate * duration)


@njit(cache=True)
def _hold(drive, commands, column, row, fraction, width):
    """What enters the amplifier's lag over one step: delayed command after dead zone and saturation."""
    u = commands[row, column] if drive.delay == 0.0 else _delayed(commands, column, row, fraction, width, drive.delay)
    if drive.dead_zone > 0.0:
        u = math.copysign(max(abs(u) - drive.dead_zone, 0.0), u)
    return min(max(u, -drive.saturation), drive.saturation)


@njit(cache=True)
def _evaluate(forward, world, tables, memory, level, time):
    """Controls, applied torques and friction limits for the present state, then MuJoCo's forward dynamics."""
    world.applied[:] = 0.0
    for j in range(len(tables.drives)):
        _drive(world, tables, memory, j, level[j])
    for j in range(len(tables.joints)):
        _joint(world, tables.joints[j], memory.motor[j])
    for term in tables.terms:
        if term.kind == POSITION_SINE:
            torque = term.a * math.sin(term.b * world.position[term.dof] + term.c)
        elif term.kind == TIME_SINE:
            torque = term.a * math.sin(term.b * time + term.c)
        else:
            torque = term.a if term.kind == PULSE and term.b <= time < term.b + term.c else 0.0
        world.applied[term.dof] -= torque
    sweeps = 1
    for coupling in tables.couplings:
        source = tables.joints[coupling.source].load
        if coupling.signal == VELOCITY:
            world.applied[coupling.dof] -= coupling.coefficient * world.velocity[source]
        elif coupling.signal == ACCELERATION:
            sweeps = _COUPLING_SWEEPS
        else:
            world.applied[coupling.dof] -= coupling.coefficient * memory.motor[coupling.source]
    if sweeps == 1:
        forward(world.model, world.data)
        return
    given = world.applied.copy()
    for _ in range(sweeps):
        world.applied[:] = given
        for coupling in tables.couplings:
            if coupling.signal == ACCELERATION:
                source = tables.joints[coupling.source].load
                world.applied[coupling.dof] -= coupling.coefficient * world.acceleration[source]
        forward(world.model, world.data)


@njit(cache=True)
def _drive(world, tables, memory, j, level):
    """Control of MuJoCo's actuator, motor torque, and what the motor gives beyond K i."""
    drive = tables.drives[j]
    output = drive.gain * level
    angle = 0.0
    speed = 0.0
    for i in range(len(world.velocity)):
        angle += tables.turns[j, i] * world.position[i]
        speed += tables.turns[j, i] * world.velocity[i]
    if drive.mode == VOLTAGE:
        if drive.current >= 0:
            current = world.activation[drive.current]
            output *= 1.0 - drive.sag * abs(current)
        else:
            current = (output - drive.constant * speed) / drive.resistance
            sagging = drive.resistance + drive.sag * output * math.copysign(1.0, current)
            current = (output - drive.constant * speed) / sagging
            output *= 1.0 - drive.sag * abs(current)
        output = min(max(output, -drive.voltage_limit), drive.voltage_limit)
        torque = drive.constant * current
    elif drive.mode == CURRENT:
        output /= 1.0 + drive.sag * abs(output)
        current = min(max(output, -drive.current_limit), drive.current_limit)
        output = current
        torque = drive.constant * current
    else:
        current = 0.0
        torque = output
    world.control[drive.control] = output
    factor = 1.0 + drive.ripple * math.sin(drive.ripple_cycles * angle + drive.ripple_phase)
    factor /= 1.0 + drive.iron * current * current
    memory.motor[j] = torque * factor
    if factor != 1.0:
        for i in range(len(world.velocity)):
            world.applied[i] += tables.turns[j, i] * torque * (factor - 1.0)


@njit(cache=True)
def _joint(world, joint, motor_torque):
    """Friction limits and asymmetry at the load, damping of a closed play."""
    speed = world.velocity[joint.load]
    transmitted = motor_torque
    if joint.rotor != joint.load:
        twist = world.position[joint.rotor] - world.position[joint.load]
        spin = world.velocity[joint.rotor] - speed
        pressed = max(abs(twist) - joint.half_gap, 0.0)
        transmitted = math.copysign(joint.shaft_stiffness * pressed, twist)
        if pressed > 0.0 and joint.contact_damping > 0.0:
            damping = joint.contact_damping * spin
            # a contact pushes but does not pull
            damping = max(damping, -transmitted) if twist > 0.0 else min(damping, -transmitted)
            world.applied[joint.rotor] -= damping
            world.applied[joint.load] += damping
            transmitted += damping
    if joint.dry != 0:
        limit = joint.coulomb + joint.load_friction * abs(transmitted)
        if joint.static_rise != 0.0:
            limit += joint.static_rise * math.exp(-((speed / joint.stribeck_velocity) ** 2))
        world.friction[joint.load] = max(limit, 1e-12)
    world.applied[joint.load] -= 0.5 * joint.asymmetry + 0.5 * joint.viscous_asymmetry * abs(speed)


@njit(cache=True)
def _sample(world, tables, memory, traces, row, fraction, step):
    """State at a fraction of the step just taken: cubic Hermite interpolation of the angle, linear for the rest."""
    x = fraction
    for j in range(len(tables.joints)):
        dof = tables.joints[j].encoder
        q0, q1 = memory.work[10, dof], world.position[dof]
        v0, v1 = memory.work[11, dof], world.velocity[dof]
        if x == 0.0:
            traces.position[row, j] = q0
        else:
            blend = x * x * (3.0 - 2.0 * x)
            tangents = step * x * (1.0 - x) * ((1.0 - x) * v0 - x * v1)
            traces.position[row, j] = q0 + blend * (q1 - q0) + tangents
        traces.velocity[row, j] = v0 + x * (v1 - v0)
        drive = tables.drives[j]
        if drive.current >= 0:
            i = drive.current
            before = memory.work[2, i]
            traces.current[row, j] = before + x * (world.activation[i] - before)
        elif drive.mode == VOLTAGE or drive.mode == CURRENT:
            traces.current[row, j] = memory.motor[j] / drive.constant
        if drive.heat >= 0:
            traces.heat[row, j] = world.activation[drive.heat]
