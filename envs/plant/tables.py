"""What the compiled loop knows of a plant: records of numbers, one array per kind of thing. Indices are -1 for none.

Rows of `DRIVE`, `JOINT` and `SERVO` tables follow the free joints. Units are SI; levels of the amplifier chain are in
command units; times in seconds, `delay` in samples.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

VOLTAGE, CURRENT, TORQUE = 0, 1, 2
"""Kinds of amplifier in `DRIVE.mode`."""

POSITION_SINE, TIME_SINE, PULSE = 0, 1, 2
"""Kinds of `TERM`: a sin(b q + c), a sin(b t + c), a from time b for c seconds."""

ACCELERATION, VELOCITY, MOTOR_TORQUE = 0, 1, 2
"""Signals of `COUPLING`."""

_INDEX, _REAL = "i8", "f8"

DRIVE = np.dtype(
    [
        *((name, _INDEX) for name in ("mode", "control", "actuator", "current", "heat")),
        *((name, _REAL) for name in ("gain", "voltage_limit", "current_limit", "constant", "resistance")),
        *((name, _REAL) for name in ("inductance", "temperature_coefficient")),
        *((name, _REAL) for name in ("delay", "dead_zone", "saturation", "lag", "offset", "sag")),
        *((name, _REAL) for name in ("iron", "ripple", "ripple_cycles", "ripple_phase")),
    ]
)
"""Amplifier and motor. `current`, `heat`: places among MuJoCo's activations; `constant`: torque per current at the
joint; `iron`: c of K i / (1 + c i^2)."""

JOINT = np.dtype(
    [
        *((name, _INDEX) for name in ("rotor", "load", "encoder", "dry")),
        *((name, _REAL) for name in ("coulomb", "static_rise", "stribeck_velocity", "load_friction")),
        *((name, _REAL) for name in ("asymmetry", "viscous_asymmetry")),
        *((name, _REAL) for name in ("shaft_stiffness", "half_gap", "contact_damping")),
    ]
)
"""Transmission and arm. `rotor`, `load`, `encoder`: degrees of freedom; `dry`: whether the joint has dry friction."""

TERM = np.dtype([("kind", _INDEX), ("dof", _INDEX), ("a", _REAL), ("b", _REAL), ("c", _REAL)])
"""A torque on the left side of the equation of motion of one degree of freedom."""

COUPLING = np.dtype([("dof", _INDEX), ("signal", _INDEX), ("source", _INDEX), ("coefficient", _REAL)])
"""coefficient times a signal of the free joint `source`, on the left side of the equation of motion of `dof`."""

BRISTLE = np.dtype([("activation", _INDEX), ("dof", _INDEX), ("stiffness", _REAL), ("level", _REAL)])
"""A bristle of presliding friction, whose stiff equation is integrated exactly."""

EVENT = np.dtype([("body", _INDEX), ("time", _REAL), ("mass", _REAL), ("inertia", _REAL)])
"""A body that becomes heavier; `time` turns infinite once it has happened."""

SERVO = np.dtype(
    [
        ("active", _INDEX),
        *((name, _REAL) for name in ("proportional", "derivative", "integral", "filter", "feed")),
        *((name, _REAL) for name in ("encoder_step", "command_step", "command_limit")),
        *((name, _REAL) for name in ("eccentricity", "eccentricity_cycles", "eccentricity_phase")),
    ]
)
"""Position servo and the encoder and converter that it works through. Steps of 0 mean no quantisation."""


class World(NamedTuple):
    """Addresses of MuJoCo's model and data, and views of the arrays in them that the loop reads and writes."""

    model: int
    data: int
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    activation: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    activation_rate: NDArray[np.float64]
    control: NDArray[np.float64]
    applied: NDArray[np.float64]
    friction: NDArray[np.float64]
    dynamics: NDArray[np.float64]
    body_mass: NDArray[np.float64]
    body_inertia: NDArray[np.float64]


class Tables(NamedTuple):
    """The plant's effects and drives. turns: speed of motor j is row j times the velocities, shape (n, nv)."""

    drives: NDArray[np.void]
    joints: NDArray[np.void]
    turns: NDArray[np.float64]
    terms: NDArray[np.void]
    couplings: NDArray[np.void]
    bristles: NDArray[np.void]
    events: NDArray[np.void]
    servos: NDArray[np.void]


class Memory(NamedTuple):
    """States beside MuJoCo's. lag: output of the amplifier lags (n,); servo: last reading, filtered speed, integral and
    last reference (n, 4); work: scratch rows of the integrator (12, max(nv, na)); motor: motor torques (n,)."""

    lag: NDArray[np.float64]
    servo: NDArray[np.float64]
    work: NDArray[np.float64]
    motor: NDArray[np.float64]


class Traces(NamedTuple):
    """What a run leaves behind, one row per sample: encoder angle and speed, current, temperature rise (T, n)."""

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    current: NDArray[np.float64]
    heat: NDArray[np.float64]
