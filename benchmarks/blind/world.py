"""The second world: motor-driven joints integrated by symmetric splitting with exact sub-flows and friction events.

It shares nothing with the project's plant or models but the names of the effects. Per joint

    amplifier   e = lag(clip(dead_zone(u(t - delay))) + offset + noise), sagging with |i|
    winding     L i' + R (1 + heat) i + Ke w = gain e          (voltage drive; current and torque drives skip this line)
    motor side  Jm w_m' = Kt(i, q) i + cogging(q) - shaft(twist) - friction(w_m)
    link side   M(q) w' + C(q, w) w = shaft(twist) + loads(q, t) - friction(w)
    sensor      y = round((q + eccentricity(q) + noise) / step) * step

A rigid joint has motor and link side in one body. One step of length h is the palindrome

    winding(h/2)  drift(h/2)  kick(h)  drift(h/2)  winding(h/2)

where every part holds the other part's states: `winding` is the exact scalar exponential, `drift` moves angles and the
bristle, hysteresis and heat states along their flows at constant speed and current, `kick` changes velocities by the
midpoint rule and stops at every velocity zero of a body with dry friction to decide between sticking and sliding. The
scheme is of second order and has no creep at rest: a stuck body is locked, not pushed back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Drive(IntEnum):
    """What the command sets."""

    VOLTAGE = 0
    CURRENT = 1
    TORQUE = 2


class DeadZone(IntEnum):
    """SHIFTED: u - Vd sign(u) outside +-Vd. SMOOTH: u (1 - Vd / sqrt(u^2 + Vd^2)), the same without corners."""

    SHIFTED = 0
    SMOOTH = 1


class Limit(IntEnum):
    """HARD: clip. SOFT: u / (1 + |u/V|^8)^(1/8)."""

    HARD = 0
    SOFT = 1


class Sag(IntEnum):
    """LINEAR: e (1 - g |i|). RATIONAL: e / (1 + g |i|)."""

    LINEAR = 0
    RATIONAL = 1


class Heat(IntEnum):
    """LOSS: heating by i^2. COPPER: heating by i^2 (1 + rise), as copper loss grows with its own resistance."""

    LOSS = 0
    COPPER = 1


class TorqueLaw(IntEnum):
    """Kt(i)/Kt: RATIONAL 1/(1 + c i^2), TANH tanh(x)/x with x = i sqrt(3 c), ROOT 1/sqrt(1 + 2 c i^2)."""

    RATIONAL = 0
    TANH = 1
    ROOT = 2


class Shaft(IntEnum):
    """Torque over the twist x beyond the play: LINEAR k x, HERTZ k x sqrt(x / x0) with x0 the reference twist."""

    LINEAR = 0
    HERTZ = 1


class Side(IntEnum):
    """The body a friction or an encoder belongs to, of a joint with an elastic transmission."""

    MOTOR = 0
    LINK = 1


class Stribeck(IntEnum):
    """Fall from static friction by s = |w|/velocity: GAUSS exp(-s^2), EXPONENTIAL exp(-s), LORENTZ 1/(1 + s^2)."""

    GAUSS = 0
    EXPONENTIAL = 1
    LORENTZ = 2


class Bristle(IntEnum):
    """Elastic micro-motion: DAHL, DAHL_SQUARE (exponent 2), LUGRE (micro-damping), MAXWELL_SLIP (four elements)."""

    NONE = 0
    DAHL = 1
    DAHL_SQUARE = 2
    LUGRE = 3
    MAXWELL_SLIP = 4


class Pulse(IntEnum):
    """Shape of a collision: BOX, or HALF_SINE of the same peak."""

    BOX = 0
    HALF_SINE = 1


class Grasp(IntEnum):
    """Payload picked up MOVING with the arm (velocity continuous) or AT_REST (angular momentum continuous)."""

    MOVING = 0
    AT_REST = 1


class Coupling(IntEnum):
    """What of the other joint acts here: its ACCELERATION (reciprocal inertia), its VELOCITY, or its motor TORQUE."""

    ACCELERATION = 0
    VELOCITY = 1
    TORQUE = 2


@dataclass(frozen=True)
class Joint:
    """True physics of one joint; SI units, N m and rad read as N and m for a linear joint. Zero switches an effect off.

    Command units are volts at the amplifier's input (A or N m before `gain` for other drives).
    """

    # drive
    drive: int = Drive.VOLTAGE
    gain: float = 1.0
    resistance: float = 1.0
    inductance: float = 0.0
    torque_constant: float = 1.0
    # body
    motor_inertia: float = 0.0
    link_inertia: float = 1.0
    viscous: float = 0.0
    gravity: float = 0.0  # load torque gravity * sin(q)
    weight: float = 0.0  # constant load
    # amplifier
    dead_zone: float = 0.0
    dead_zone_law: int = DeadZone.SHIFTED
    saturation: float = math.inf
    saturation_law: int = Limit.HARD
    offset: float = 0.0
    lag: float = 0.0
    delay: float = 0.0
    sag: float = 0.0
    sag_law: int = Sag.LINEAR
    # motor
    heating: float = 0.0  # relative resistance rise per A^2 of lasting current
    heating_time: float = 1.0
    heating_law: int = Heat.LOSS
    kt_saturation: float = 0.0
    kt_law: int = TorqueLaw.RATIONAL
    cogging: float = 0.0
    cogging_wave: float = 0.0  # rad of phase per rad or m of travel
    cogging_phase: float = 0.0
    cogging_second: float = 0.0  # second harmonic's share
    ripple: float = 0.0
    ripple_wave: float = 0.0
    ripple_phase: float = 0.0
    ripple_reciprocal: int = 0  # 1: the back-EMF ripples too
    # transmission
    elastic: int = 0
    stiffness: float = 0.0
    damping: float = 0.0
    gap: float = 0.0
    shaft_law: int = Shaft.LINEAR
    shaft_reference: float = 1.0
    encoder_side: int = Side.MOTOR
    coupling: float = 0.0
    coupling_law: int = Coupling.ACCELERATION
    # friction
    friction_side: int = Side.MOTOR
    coulomb: float = 0.0
    static_excess: float = 0.0  # static minus Coulomb torque
    stribeck_velocity: float = 1.0
    stribeck_law: int = Stribeck.GAUSS
    asymmetry_torque: float = 0.0
    asymmetry_viscous: float = 0.0
    load_friction: float = 0.0
    drag: float = 0.0
    drag_exponent: float = 2.0
    bristle_law: int = Bristle.NONE
    bristle_torque: float = 0.0
    bristle_stiffness: float = 1.0
    bristle_damping: float = 0.0
    # loads
    tilt: float = 0.0
    tilt_phase: float = 0.0
    spring: float = 0.0
    spring_rest: float = 0.0
    payload: float = 0.0
    payload_time: float = math.inf
    payload_law: int = Grasp.MOVING
    disturbance: float = 0.0
    disturbance_frequency: float = 1.0
    disturbance_phase: float = 0.0
    collision: float = 0.0
    collision_time: float = math.inf
    collision_duration: float = 1.0
    collision_law: int = Pulse.BOX
    # sensor
    encoder_step: float = 0.0
    eccentricity: float = 0.0
    eccentricity_phase: float = 0.0
    # outside the vocabulary
    inertia_wave: float = 0.0  # J (1 + inertia_wave sin(inertia_cycles q + inertia_phase))
    inertia_cycles: float = 1.0
    inertia_phase: float = 0.0
    hysteresis: float = 0.0  # Bouc-Wen torque of a fully yielded element
    hysteresis_yield: float = 1.0  # its yield displacement
    kt_speed: float = 0.0  # Kt / (1 + kt_speed |w|)
    root_damper: float = 0.0  # root_damper * sqrt(|w|) sign(w)
    cubic_spring: float = 0.0
    torque_step: float = 0.0  # the amplifier's own coarse rounding [command units]
    viscous_cold: float = 0.0  # extra viscous share when cold
    viscous_energy: float = 1.0  # friction work after which 63 % of it is gone [J]
    base_inertia: float = 0.0  # the base swings against a spring
    base_stiffness: float = 0.0
    base_damping: float = 0.0


STATE = np.dtype(
    [
        (name, np.float64)
        for name in (
            # of the joint; the base is the first joint's
            *(
                "angle",
                "speed",
                "motor_angle",
                "motor_speed",
                "current",
                "hysteresis",
                "heat",
                "warm",
                "lag",
                "inertia",
            ),
            *("base_angle", "base_speed", "base_acceleration"),
            # of the step: motor and shaft torque, torque balance, accelerations, torque a stuck body bears, load
            *("drive", "shaft", "rhs", "link_acceleration", "motor_acceleration", "hold", "load"),
            # speeds at which the accelerations are evaluated, and of the base
            *("w", "wm", "wb"),
        )
    ]
    + [("bristle", np.float64, 4)]
)

RECORD = np.dtype([(f.name, np.int64 if f.type == "int" else np.float64) for f in fields(Joint)])


class Loop(NamedTuple):
    """Sampled PD loop with filtered differences, shape (joints,): u = feed + kp (r - y) + kd (r' - y')."""

    closed: bool
    proportional: Array
    derivative: Array
    filter_time: Array


class Motion(NamedTuple):
    """What the world did; arrays (samples, joints). Everything but `command` and `measured` is hidden truth.

    current_square: mean of the squared current until the next sample.
    """

    command: Array
    measured: Array
    position: Array
    velocity: Array
    current: Array
    motor_torque: Array
    resistance_rise: Array
    current_square: Array
    fine_position: Array
    fine_velocity: Array


def pack(joints: tuple[Joint, ...]) -> NDArray[np.void]:
    """Joints as a structured array (joints,) that the compiled kernel reads."""
    return np.array([tuple(getattr(joint, f.name) for f in fields(Joint)) for joint in joints], dtype=RECORD)


_NO_DRY_FRICTION = 2  # mode of a body: -1, +1 sliding, 0 stuck, 2 nothing that could stick
_ROOT_EDGE = 1e-3  # speed below which the square-root damper is smoothed, relative to 1 rad/s or 1 m/s


@njit(cache=True)
def _amplifier(p, u):
    """Static part of the amplifier: own rounding, dead zone, limit, offset."""
    if p.torque_step > 0.0:
        u = p.torque_step * np.floor(u / p.torque_step + 0.5)
    if p.dead_zone > 0.0:
        if p.dead_zone_law == DeadZone.SMOOTH:
            u *= 1.0 - p.dead_zone / math.sqrt(u * u + p.dead_zone * p.dead_zone)
        elif abs(u) <= p.dead_zone:
            u = 0.0
        else:
            u -= math.copysign(p.dead_zone, u)
    if p.saturation_law == Limit.SOFT:
        u /= (1.0 + abs(u / p.saturation) ** 8) ** 0.125
    else:
        u = min(max(u, -p.saturation), p.saturation)
    return u + p.offset


@njit(cache=True)
def _ripple(p, q):
    return 1.0 + p.ripple * math.sin(p.ripple_wave * q + p.ripple_phase)


@njit(cache=True)
def _motor_torque(p, i, q, w):
    """Kt(i, q, w) i + cogging; for a torque drive `i` is the torque itself."""
    torque = i if p.drive == Drive.TORQUE else p.torque_constant * i
    if p.kt_saturation > 0.0:
        x = p.kt_saturation * i * i
        if p.kt_law == TorqueLaw.RATIONAL:
            torque /= 1.0 + x
        elif p.kt_law == TorqueLaw.ROOT:
            torque /= math.sqrt(1.0 + 2.0 * x)
        elif x > 1e-12:
            root = math.sqrt(3.0 * x)
            torque *= math.tanh(root) / root
    if p.ripple != 0.0:
        torque *= _ripple(p, q)
    if p.kt_speed != 0.0:
        torque /= 1.0 + p.kt_speed * abs(w)
    if p.cogging != 0.0:
        phase = p.cogging_wave * q + p.cogging_phase
        torque += p.cogging * (math.sin(phase) + p.cogging_second * math.sin(2.0 * phase))
    return torque


@njit(cache=True)
def _winding(p, i, e, q, w, heat, dt):
    """Current after dt at amplifier voltage e, exact for frozen q, w and heat."""
    if p.drive != Drive.VOLTAGE:
        amplified = p.gain * e
        if p.sag > 0.0:
            x = p.sag * abs(amplified)
            amplified *= 1.0 - x if p.sag_law == Sag.LINEAR else 1.0 / (1.0 + x)
        return amplified
    volts = p.gain * e
    resistance = p.resistance * (1.0 + heat)
    emf = p.torque_constant * w
    if p.ripple_reciprocal == 1:
        emf *= _ripple(p, q)
    if p.sag > 0.0:
        if p.sag_law == Sag.LINEAR:
            resistance += p.sag * volts * (1.0 if i >= 0.0 else -1.0)
        else:
            volts /= 1.0 + p.sag * abs(i)
    if resistance <= 0.0:
        return i + dt * (volts - emf - resistance * i) / max(p.inductance, 1e-9)
    final = (volts - emf) / resistance
    if p.inductance <= 0.0:
        return final
    return final + (i - final) * math.exp(-resistance * dt / p.inductance)


@njit(cache=True)
def _dry_level(p, speed, direction, transmitted):
    """Magnitude of dry friction [N m] for a body that slides, or wants to slide, in `direction`."""
    level = p.coulomb + 0.5 * p.asymmetry_torque * direction + p.load_friction * abs(transmitted)
    if p.static_excess > 0.0:
        s = abs(speed) / p.stribeck_velocity
        if p.stribeck_law == Stribeck.GAUSS:
            level += p.static_excess * math.exp(-s * s)
        elif p.stribeck_law == Stribeck.EXPONENTIAL:
            level += p.static_excess * math.exp(-s)
        else:
            level += p.static_excess / (1.0 + s * s)
    return max(level, 0.0)


@njit(cache=True)
def _wet_friction(p, w, warm):
    """Velocity-dependent friction without stiction."""
    torque = p.viscous * (1.0 + p.viscous_cold * math.exp(-warm / p.viscous_energy)) * w
    torque += 0.5 * p.asymmetry_viscous * abs(w)
    if p.drag != 0.0:
        torque += p.drag * math.copysign(abs(w) ** p.drag_exponent, w)
    if p.root_damper != 0.0:
        torque += p.root_damper * w / math.sqrt(abs(w) + _ROOT_EDGE)
    return torque


@njit(cache=True)
def _bristle_torque(p, z, w):
    """Bristle friction from its states z (4,)."""
    if p.bristle_law == Bristle.NONE:
        return 0.0
    if p.bristle_law == Bristle.MAXWELL_SLIP:
        return 0.25 * p.bristle_stiffness * (z[0] + z[1] + z[2] + z[3])
    torque = p.bristle_stiffness * z[0]
    if p.bristle_law == Bristle.LUGRE:
        torque += p.bristle_damping * (w - abs(w) * z[0] * p.bristle_stiffness / p.bristle_torque)
    return torque


@njit(cache=True)
def _bristle_flow(p, z, w, dt):
    """Exact flow of the bristle states over dt at constant speed w."""
    if p.bristle_law == Bristle.NONE or w == 0.0:
        return
    reach = p.bristle_torque / p.bristle_stiffness
    if p.bristle_law == Bristle.MAXWELL_SLIP:
        for k in range(4):
            bound = 0.5 * reach * (k + 0.5)
            z[k] = min(max(z[k] + w * dt, -bound), bound)
        return
    end = math.copysign(reach, w)
    travel = abs(w) * dt / reach
    if p.bristle_law == Bristle.DAHL_SQUARE:
        left = 1.0 - z[0] / end
        z[0] = end * (1.0 - left / (1.0 + left * travel))
    else:
        z[0] = end + (z[0] - end) * math.exp(-travel)


@njit(cache=True)
def _shaft_torque(p, twist, rate):
    """Torque from motor to link side through play, stiffness and damping."""
    beyond = abs(twist) - 0.5 * p.gap
    if beyond <= 0.0 and p.gap > 0.0:
        return 0.0
    if p.shaft_law == Shaft.HERTZ:
        share = math.sqrt(beyond / p.shaft_reference)
        return math.copysign(p.stiffness * beyond * share, twist) + p.damping * rate * min(share, 1.0)
    if p.gap > 0.0:
        torque = p.stiffness * beyond + math.copysign(1.0, twist) * p.damping * rate
        return math.copysign(max(torque, 0.0), twist)
    return p.stiffness * twist + p.damping * rate


@njit(cache=True)
def _load(p, q, hysteresis, t, h):
    """Torque on the link at its angle q, averaged over the step that starts at t."""
    torque = -p.weight
    if p.gravity != 0.0:
        torque -= p.gravity * math.sin(q)
    if p.tilt != 0.0:
        torque -= p.tilt * math.sin(q + p.tilt_phase)
    torque -= p.spring * (q - p.spring_rest) + p.cubic_spring * q * q * q + p.hysteresis * hysteresis
    if p.disturbance != 0.0:
        phase = 2.0 * math.pi * p.disturbance_frequency * (t + 0.5 * h) + p.disturbance_phase
        torque += p.disturbance * math.sin(phase)
    if p.collision != 0.0:
        start = max(t, p.collision_time)
        stop = min(t + h, p.collision_time + p.collision_duration)
        if stop > start:
            force = p.collision * (stop - start) / h
            if p.collision_law == Pulse.HALF_SINE:
                force *= math.sin(math.pi * (0.5 * (start + stop) - p.collision_time) / p.collision_duration)
            torque += force
    return torque


@njit(cache=True)
def _rubs_on_motor(p):
    return p.elastic == 1 and p.friction_side == Side.MOTOR


@njit(cache=True)
def _accelerations(p, pair, mode, s):
    """Accelerations at the speeds s.w, s.wm, s.wb, and the torque s.hold that a stuck body has to bear."""
    n = len(p)
    for j in range(n):
        s[j].drive = _motor_torque(p[j], s[j].current, s[j].motor_angle, s[j].wm if p[j].elastic == 1 else s[j].w)
    for j in range(n):
        on_motor = _rubs_on_motor(p[j])
        v = s[j].wm if on_motor else s[j].w
        shaft = s[j].drive
        if p[j].elastic == 1:
            shaft = _shaft_torque(p[j], s[j].motor_angle - s[j].angle, s[j].wm - s[j].w)
        s[j].shaft = shaft
        friction = _wet_friction(p[j], v, s[j].warm) + _bristle_torque(p[j], s[j].bristle, v)
        if mode[j] == 1 or mode[j] == -1:
            friction += mode[j] * _dry_level(p[j], v, mode[j], shaft)
        rhs = shaft + s[j].load
        if n == 2 and p[j].coupling != 0.0:
            if p[j].coupling_law == Coupling.VELOCITY:
                rhs += p[j].coupling * s[1 - j].w
            elif p[j].coupling_law == Coupling.TORQUE:
                rhs += p[j].coupling * s[1 - j].drive
        if on_motor:
            balance = s[j].drive - shaft - friction
            s[j].motor_acceleration = 0.0 if mode[j] == 0 else balance / p[j].motor_inertia
            s[j].hold = balance
        else:
            rhs -= friction
            if p[j].elastic == 1:
                s[j].motor_acceleration = (s[j].drive - shaft) / p[j].motor_inertia
        s[j].rhs = rhs
    if n == 1:
        _single_link(p[0], mode[0] == 0 and not _rubs_on_motor(p[0]), s[0])
    else:
        _two_links(p, pair, mode, s)


@njit(cache=True)
def _single_link(p, locked, s):
    inertia = s.inertia
    if p.inertia_wave != 0.0:
        phase = p.inertia_cycles * s.angle + p.inertia_phase
        s.rhs -= 0.5 * inertia * p.inertia_wave * p.inertia_cycles * math.cos(phase) * s.w * s.w
        inertia *= 1.0 + p.inertia_wave * math.sin(phase)
    s.link_acceleration = s.rhs / inertia
    if p.base_inertia > 0.0:
        pull = p.base_stiffness * s.base_angle + p.base_damping * s.wb
        s.base_acceleration = -(s.rhs + pull) / p.base_inertia
        s.link_acceleration -= s.base_acceleration
    if locked:
        s.link_acceleration = 0.0
        s.hold = s.rhs


@njit(cache=True)
def _two_links(p, pair, mode, s):
    m11, m22, m12 = s[0].inertia, s[1].inertia, 0.0
    if pair != 0.0:
        second = s[1].inertia - (p[1].motor_inertia if p[1].elastic == 0 else 0.0)
        m12 = second + pair * math.cos(s[1].angle)
        m11 += second + 2.0 * pair * math.cos(s[1].angle)
        bend = pair * math.sin(s[1].angle)
        s[0].rhs += bend * s[1].w * (2.0 * s[0].w + s[1].w)
        s[1].rhs -= bend * s[0].w * s[0].w
    for j in range(2):
        if p[j].coupling_law == Coupling.ACCELERATION:
            m12 -= p[j].coupling
    free0 = mode[0] != 0 or _rubs_on_motor(p[0])
    free1 = mode[1] != 0 or _rubs_on_motor(p[1])
    a0, a1 = 0.0, 0.0
    if free0 and free1:
        det = m11 * m22 - m12 * m12
        a0 = (m22 * s[0].rhs - m12 * s[1].rhs) / det
        a1 = (m11 * s[1].rhs - m12 * s[0].rhs) / det
    elif free0:
        a0 = s[0].rhs / m11
        s[1].hold = s[1].rhs - m12 * a0
    elif free1:
        a1 = s[1].rhs / m22
        s[0].hold = s[0].rhs - m12 * a1
    else:
        s[0].hold, s[1].hold = s[0].rhs, s[1].rhs
    s[0].link_acceleration, s[1].link_acceleration = a0, a1


@njit(cache=True)
def _look(s, share):
    """Sets the speeds of evaluation a time `share` ahead of the present ones."""
    for j in range(len(s)):
        s[j].w = s[j].speed + share * s[j].link_acceleration
        s[j].wm = s[j].motor_speed + share * s[j].motor_acceleration
    s[0].wb = s[0].base_speed + share * s[0].base_acceleration


@njit(cache=True)
def _kick(p, pair, mode, s, h):
    """Speeds over h at frozen angles and currents; stops at every zero of a speed with dry friction."""
    n = len(p)
    left = h
    for _ in range(8):
        _look(s, 0.0)
        for j in range(n):
            if mode[j] == 0:
                _accelerations(p, pair, mode, s)
                direction = 1 if s[j].hold > 0.0 else -1
                if abs(s[j].hold) > _dry_level(p[j], 0.0, direction, s[j].shaft):
                    mode[j] = direction
        _accelerations(p, pair, mode, s)
        _look(s, 0.5 * left)
        _accelerations(p, pair, mode, s)
        span, who = left, -1
        for j in range(n):
            if mode[j] == 1 or mode[j] == -1:
                on_motor = _rubs_on_motor(p[j])
                v = s[j].motor_speed if on_motor else s[j].speed
                a = s[j].motor_acceleration if on_motor else s[j].link_acceleration
                if (v + a * left) * mode[j] < 0.0:
                    crossing = min(max(-v / a, 0.0), left)
                    if crossing < span or who < 0:
                        span, who = crossing, j
        _look(s, span)
        for j in range(n):
            s[j].speed, s[j].motor_speed = s[j].w, s[j].wm
        s[0].base_speed = s[0].wb
        if who < 0:
            return
        left -= span
        mode[who] = 0
        if _rubs_on_motor(p[who]):
            s[who].motor_speed = 0.0
        else:
            s[who].speed = 0.0


@njit(cache=True)
def _drift(p, s, dt):
    """Angles, bristles, hysteresis, heat and base along their flows at constant speeds and currents."""
    for j in range(len(p)):
        s[j].angle += dt * s[j].speed
        if p[j].elastic == 1:
            s[j].motor_angle += dt * s[j].motor_speed
        else:
            s[j].motor_angle = s[j].angle
        v = s[j].motor_speed if _rubs_on_motor(p[j]) else s[j].speed
        _bristle_flow(p[j], s[j].bristle, v, dt)
        if p[j].hysteresis != 0.0 and v != 0.0:
            s[j].hysteresis = _bouc_wen(p[j], s[j].hysteresis, v, dt)
        if p[j].viscous_cold != 0.0:
            s[j].warm += dt * p[j].viscous * v * v
        if p[j].heating > 0.0:
            # heat' = (power (1 + copper heat) - heat) / heating_time, exact at constant power
            power = p[j].heating * s[j].current * s[j].current
            keep = 1.0 - power if p[j].heating_law == Heat.COPPER else 1.0
            final = power / max(keep, 1e-3)
            s[j].heat = final + (s[j].heat - final) * math.exp(-keep * dt / p[j].heating_time)
    s[0].base_angle += dt * s[0].base_speed


@njit(cache=True)
def _bouc_wen(p, z, v, dt):
    """Midpoint rule for reach z' = v - 0.7 |v| |z| z - 0.3 v z^2."""
    for_half = z + 0.5 * dt * (v - 0.7 * abs(v) * abs(z) * z - 0.3 * v * z * z) / p.hysteresis_yield
    return z + dt * (v - 0.7 * abs(v) * abs(for_half) * for_half - 0.3 * v * for_half * for_half) / p.hysteresis_yield


@njit(cache=True)
def _sense(p, s, noise):
    """Encoder reading."""
    q = s.motor_angle if p.encoder_side == Side.MOTOR else s.angle
    y = q + noise
    if p.eccentricity != 0.0:
        y += p.eccentricity * math.sin(q + p.eccentricity_phase)
    if p.encoder_step > 0.0:
        y = p.encoder_step * np.floor(y / p.encoder_step + 0.5)
    return y


@njit(cache=True)
def _sensed_speed(p, s):
    return s.motor_speed if p.encoder_side == Side.MOTOR and p.elastic == 1 else s.speed


def _at_rest(angle: Array) -> NDArray[np.void]:
    state = np.zeros(len(angle), dtype=STATE)
    state["angle"] = state["motor_angle"] = angle
    return state


@njit(cache=True)
def _half_winding(p, s, e, dt):
    """Lag, then winding. A winding sees the lag's mean over dt, a current without inertia the lag's value after dt."""
    mean = e
    if p.lag > 0.0:
        x = dt / p.lag
        gone = -math.expm1(-x)
        mean = e + (s.lag - e) * gone / x
        s.lag += (e - s.lag) * gone
        if p.drive != Drive.VOLTAGE or p.inductance <= 0.0:
            mean = s.lag
    w = s.motor_speed if p.elastic == 1 else s.speed
    s.current = _winding(p, s.current, mean, s.motor_angle, w, s.heat, dt)


@njit(cache=True)
def _pick_up(p, s, t):
    """Adds the payload when its time has come; returns whether it did."""
    if t < p.payload_time:
        return False
    if p.payload_law == Grasp.AT_REST:
        s.speed *= s.inertia / (s.inertia + p.payload)
    s.inertia += p.payload
    return True


@njit(cache=True)
def _arriving(p, applied, delay, arrived, k, t, h, sample_time):
    """Mean of the held command over a step from t, and the index of the last sample that has arrived."""
    level, start = 0.0, t
    now = applied[arrived] if arrived >= 0 else p.offset
    while arrived < k:
        when = (arrived + 1) * sample_time + delay[arrived + 1] + p.delay
        if when >= t + h * (1.0 - 1e-9):
            break
        if when > start:
            level += (when - start) * now
            start = when
        arrived += 1
        now = applied[arrived]
    return (level + (t + h - start) * now) / h, arrived


@njit(cache=True)
def _run(p, pair, s, loop, feed, reference, rate, step, limit, ramp, delay, amp_noise, stray, sensor_noise,
         seen, leak, sample_time, substeps, fine, out):  # fmt: skip
    n, samples = len(p), len(feed)
    h = sample_time / substeps
    applied = np.zeros((n, samples))
    arrived = np.full(n, -1)
    mode = np.full(n, _NO_DRY_FRICTION)
    carries = np.zeros(n, dtype=np.bool_)
    e, last, slope, pull = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    for j in range(n):
        if p[j].coulomb + p[j].static_excess + p[j].load_friction + abs(p[j].asymmetry_torque) > 0.0:
            mode[j] = 0
        s[j].inertia = p[j].link_inertia + (p[j].motor_inertia if p[j].elastic == 0 else 0.0)
    for k in range(samples):
        after = min(k + 1, samples - 1)
        for j in range(n):
            y = _sense(p[j], s[j], sensor_noise[k, j])
            out.measured[k, j] = y
            pull[j] = leak * (seen[k, j] - y)
            out.position[k, j] = s[j].motor_angle if p[j].encoder_side == Side.MOTOR else s[j].angle
            out.velocity[k, j] = _sensed_speed(p[j], s[j])
            out.resistance_rise[k, j] = s[j].heat
            u = feed[k, j]
            if loop.closed:
                if k > 0:
                    weight = sample_time / (sample_time + loop.filter_time[j])
                    slope[j] += weight * ((y - last[j]) / sample_time - slope[j])
                last[j] = y
                u += loop.proportional[j] * (reference[k, j] - y) + loop.derivative[j] * (rate[k, j] - slope[j])
            u = min(max(u, -limit[j]), limit[j])
            if step[j] > 0.0:
                u = step[j] * np.floor(u / step[j] + 0.5)
            out.command[k, j] = u
            applied[j, k] = _amplifier(p[j], u)
        for sub in range(substeps):
            t = k * sample_time + sub * h
            place = (sub + 0.5) / substeps
            for j in range(n):
                if p[j].payload > 0.0 and not carries[j]:
                    carries[j] = _pick_up(p[j], s[j], t + 1e-9)
                s[j].angle += pull[j] * h
                s[j].motor_angle += pull[j] * h
                if ramp:
                    at = max(0.0, (t + 0.5 * h - delay[j, k] - p[j].delay) / sample_time)
                    low = min(int(at), samples - 2)
                    e[j] = _amplifier(p[j], feed[low, j] + (at - low) * (feed[low + 1, j] - feed[low, j]))
                else:
                    e[j], arrived[j] = _arriving(p[j], applied[j], delay[j], arrived[j], k, t, h, sample_time)
                e[j] += amp_noise[k, j] + place * (amp_noise[after, j] - amp_noise[k, j])
                _half_winding(p[j], s[j], e[j], 0.5 * h)
                out.current_square[k, j] += s[j].current * s[j].current / substeps
            _drift(p, s, 0.5 * h)
            for j in range(n):
                s[j].load = stray[k, j] + place * (stray[after, j] - stray[k, j])
                s[j].load += _load(p[j], s[j].angle, s[j].hysteresis, t, h)
            _kick(p, pair, mode, s, h)
            if sub == substeps // 2:
                for j in range(n):
                    out.current[k, j] = s[j].current
                    out.motor_torque[k, j] = s[j].drive
            _drift(p, s, 0.5 * h)
            for j in range(n):
                _half_winding(p[j], s[j], e[j], 0.5 * h)
                if fine:
                    row = k * substeps + sub + 1
                    out.fine_position[row, j] = s[j].motor_angle if p[j].encoder_side == Side.MOTOR else s[j].angle
                    out.fine_velocity[row, j] = _sensed_speed(p[j], s[j])


OPEN = Loop(False, np.zeros(2), np.zeros(2), np.zeros(2))


def simulate(
    joints: tuple[Joint, ...],
    feed: Array,
    sample_time: float,
    *,
    coupling_inertia: float = 0.0,
    loop: Loop = OPEN,
    reference: Array | None = None,
    command_step: Array | None = None,
    command_limit: Array | None = None,
    start: Array | None = None,
    amplifier_noise: Array | None = None,
    stray_torque: Array | None = None,
    sensor_noise: Array | None = None,
    arrival_delay: Array | None = None,
    seen: Array | None = None,
    leak: float = 0.0,
    ramp: bool = False,
    fine: bool = False,
    step_limit: float = 5e-5,
) -> Motion:
    """Run one or two joints from rest.

    feed (T, n): open-loop command, or feed-forward of a closed loop [command units]; reference (T, n) [rad, m].
    coupling_inertia: p3 of a planar pair, M11 = I1 + I2 + 2 p3 cos q2, M12 = I2 + p3 cos q2, M22 = I2 with the joints'
    link inertias I1, I2 (motor inertias on top of the diagonal); zero leaves two joints uncoupled.
    seen (T, n) [rad, m], leak [1/s]: the angles are pulled towards these measurements, q' = w + leak (seen - y).
    ramp: the command is linear between samples instead of held. fine: also return angle and speed at every step.
    step_limit: longest step of integration [s]; the steps divide the sample time. amplifier_noise [command units],
    stray_torque [N m] and sensor_noise [rad, m] are (T, n), linear between samples; arrival_delay (T, n) [s] >= 0
    delays single samples of the command, in order.
    """
    feed = np.ascontiguousarray(feed, dtype=np.float64).reshape(len(feed), -1)
    samples, n = feed.shape
    if n != len(joints) or n > 2:
        raise ValueError(f"feed has {n} columns for {len(joints)} joints. Give one column per joint, at most two")
    blank = np.zeros((samples, n))

    def table(value: Array | None) -> Array:
        return blank if value is None else np.ascontiguousarray(value, dtype=np.float64).reshape(samples, n)

    def vector(value: Array | None, default: float) -> Array:
        return np.full(n, default) if value is None else np.asarray(value, dtype=np.float64)

    target = table(reference)
    substeps = max(1, math.ceil(sample_time / step_limit - 1e-9))
    length = samples * substeps + 1 if fine else 1
    motion = Motion(*(np.zeros((rows, n)) for rows in [samples] * 8 + [length] * 2))
    state = _at_rest(vector(start, 0.0))
    motion.fine_position[0] = state["angle"]
    _run(
        pack(joints), coupling_inertia, state, loop, feed, target, np.gradient(target, sample_time, axis=0),
        vector(command_step, 0.0), vector(command_limit, math.inf), ramp,
        np.ascontiguousarray(table(arrival_delay).T), table(amplifier_noise),
        table(stray_torque), table(sensor_noise), table(seen), leak, sample_time, substeps, fine, motion,
    )  # fmt: skip
    return motion
