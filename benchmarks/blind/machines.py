"""Families of machines, drawn at random around what such machines are like.

Everything an engineer would know beforehand (type of drive, limits, resolution, rough data sheet values) stands in the
`Machine`'s public facts; the joints themselves are the hidden truth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.blind.world import Drive, Joint
from envs.log import Hold, InputKind, JointFacts

Rng = np.random.Generator
INPUT: dict[Drive, InputKind] = {Drive.VOLTAGE: "voltage", Drive.CURRENT: "current", Drive.TORQUE: "torque"}


@dataclass(frozen=True)
class Machine:
    """A machine under test: true joints and the facts that are public.

    travel: half width of the working range [rad or m], speed: highest sensible speed [rad/s or m/s], per joint.
    bandwidth: range of sensible position-loop bandwidths [rad/s]. loops: which experiments its owner would run.
    step: longest step of integration that stays well below the encoder's resolution [s].
    """

    family: str
    joints: tuple[Joint, ...]
    numbers: tuple[int, ...]
    sample_time: float
    travel: tuple[float, ...]
    speed: tuple[float, ...]
    command_limit: tuple[float, ...]
    command_step: tuple[float, ...]
    bandwidth: tuple[float, float]
    loops: tuple[Literal["open", "closed"], ...] = ("open", "closed")
    unit: Literal["rad", "m"] = "rad"
    hold: Hold = "zero_order"
    coupling_inertia: float = 0.0
    robot: str | None = None
    step: float = 5e-5

    def facts(self) -> tuple[JointFacts, ...]:
        """What the sidecars of its logs say."""
        return tuple(
            JointFacts(
                input=INPUT[Drive(joint.drive)],
                position_unit=self.unit,
                encoder_step=joint.encoder_step,
                command_step=step,
                command_limit=limit,
                hold=self.hold,
            )
            for joint, step, limit in zip(self.joints, self.command_step, self.command_limit, strict=True)
        )


def input_equivalent(joint: Joint) -> float:
    """Command units per N m (or N) of torque at standstill."""
    if joint.drive == Drive.TORQUE:
        return 1.0 / joint.gain
    if joint.drive == Drive.CURRENT:
        return 1.0 / (joint.torque_constant * joint.gain)
    return joint.resistance / (joint.torque_constant * joint.gain)


def total_inertia(joint: Joint) -> float:
    """Inertia that the motor moves [kg m^2 or kg]."""
    return joint.motor_inertia + joint.link_inertia


def damping(joint: Joint) -> float:
    """Viscous plus electrical damping [N m s/rad or N s/m]."""
    electrical = joint.torque_constant**2 / joint.resistance if joint.drive == Drive.VOLTAGE else 0.0
    return joint.viscous + electrical


def log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def around(rng: Rng, value: float, factor: float) -> float:
    """`value` times or divided by up to `factor`."""
    return value * log_uniform(rng, 1.0 / factor, factor)


def _converter(rng: Rng, limit: float, bits: tuple[int, ...]) -> float:
    return 2.0 * limit / 2 ** int(rng.choice(bits))


# resistance, inductance, torque constant, viscous, motor and link inertia, gain, counts per unit, travel, speed
_ADEPT = {
    "adept_j1": (5.0, 0.050, 21.0, 3.0, 0.15, 8.9, 30.0, 5e5 / (2 * math.pi), 2.6, 6.0),
    "adept_j2": (6.0, 0.040, 14.0, 1.0, 0.02, 1.18, 30.0, 5e5 / (2 * math.pi), 2.5, 7.0),
    "adept_j3": (1.5, 0.002, 31.4, 60.0, 4.9, 3.0, 6.0, 2e5, 0.1, 0.5),
    "adept_j4": (2.0, 0.002, 0.50, 0.005, 0.002, 0.0015, 6.0, 2e4 / (2 * math.pi), 4.8, 40.0),
}


def _adept_joint(name: str, rng: Rng, factor: float) -> Joint:
    resistance, inductance, constant, viscous, motor, link, gain, counts, _, _ = _ADEPT[name]
    return Joint(
        gain=gain,
        resistance=around(rng, resistance, factor),
        inductance=around(rng, inductance, factor),
        torque_constant=around(rng, constant, factor),
        motor_inertia=around(rng, motor, factor),
        link_inertia=around(rng, link, factor),
        viscous=around(rng, viscous, factor**2),
        weight=3.0 * 9.81 if name == "adept_j3" else 0.0,
        encoder_step=1.0 / counts,
    )


def _adept(name: str) -> Callable[[Rng], Machine]:
    def draw(rng: Rng) -> Machine:
        factor = 1.15 if rng.random() < 0.6 else 1.5
        joint = _adept_joint(name, rng, factor)
        return Machine(
            family=name,
            joints=(joint,),
            numbers=(int(name[-1]),),
            sample_time=1e-3,
            travel=(_ADEPT[name][8],),
            speed=(_ADEPT[name][9],),
            command_limit=(10.0,),
            command_step=(20.0 / 4096,),
            bandwidth=(4.0, 20.0),
            loops=("closed",) if name == "adept_j3" else ("open", "closed"),
            unit="m" if name == "adept_j3" else "rad",
            robot="AdeptOne",
        )

    return draw


def _pair(rng: Rng) -> Machine:
    """Joints 1 and 2 moving together, coupled through the arm's inertia; stators on the base and on link 1."""
    factor = 1.15 if rng.random() < 0.6 else 1.4
    first, second = (_adept_joint(name, rng, factor) for name in ("adept_j1", "adept_j2"))
    # the pair's link inertias are p1 and p2 of M11 = p1 + p2 + 2 p3 cos q2
    first = replace(first, link_inertia=around(rng, 5.17, factor))
    second = replace(second, link_inertia=around(rng, 1.18, factor))
    bound = 0.8 * math.sqrt(first.link_inertia * second.link_inertia)
    return Machine(
        family="pair",
        joints=(first, second),
        numbers=(1, 2),
        sample_time=1e-3,
        travel=(2.6, 2.5),
        speed=(6.0, 7.0),
        command_limit=(10.0, 10.0),
        command_step=(20.0 / 4096,) * 2,
        bandwidth=(4.0, 15.0),
        coupling_inertia=min(around(rng, 1.515, factor), bound),
        robot="AdeptOne",
    )


def _servo(rng: Rng) -> Machine:
    ratio = log_uniform(rng, 60.0, 280.0)
    constant = ratio * log_uniform(rng, 0.004, 0.012)
    resistance = log_uniform(rng, 2.5, 9.0)
    inertia = ratio**2 * log_uniform(rng, 2e-7, 1.2e-6)
    limit = float(rng.choice([7.4, 12.0]))
    no_load = limit / constant
    return Machine(
        family="servo",
        joints=(
            Joint(
                resistance=resistance,
                inductance=resistance * log_uniform(rng, 5e-5, 4e-4),
                torque_constant=constant,
                motor_inertia=inertia,
                link_inertia=inertia * log_uniform(rng, 0.1, 1.5),
                viscous=constant**2 / resistance * log_uniform(rng, 0.02, 0.3),
                encoder_step=2 * math.pi / 4096,
            ),
        ),
        numbers=(1,),
        sample_time=1.0 / float(rng.choice([200, 250, 333, 500])),
        travel=(2.6,),
        speed=(0.8 * no_load,),
        command_limit=(limit,),
        command_step=(_converter(rng, limit, (9, 10, 11)),),
        bandwidth=(6.0, 20.0),
        loops=("closed",),
    )


def _pendulum(rng: Rng) -> Machine:
    inertia = log_uniform(rng, 0.02, 0.5)
    own = log_uniform(rng, 2.5, 7.0)  # rad/s
    gravity = inertia * own**2
    limit = gravity * rng.uniform(0.8, 2.0)
    return Machine(
        family="pendulum",
        joints=(
            Joint(
                drive=Drive.TORQUE,
                link_inertia=inertia * 0.9,
                motor_inertia=inertia * 0.1,
                viscous=2.0 * inertia * own * log_uniform(rng, 0.03, 0.3),
                gravity=gravity,
                encoder_step=2 * math.pi / float(rng.choice([8192, 16384, 65536, 262144])),
            ),
        ),
        numbers=(1,),
        sample_time=1.0 / float(rng.choice([250, 500, 1000])),
        travel=(1.6,),
        speed=(8.0,),
        command_limit=(limit,),
        command_step=(_converter(rng, limit, (12, 14, 16)),),
        bandwidth=(8.0, 20.0),
    )


def _rotor(rng: Rng) -> Machine:
    inertia = log_uniform(rng, 2e-4, 2e-2)
    rate = log_uniform(rng, 0.1, 2.0)  # viscous rate [1/s]
    limit = log_uniform(rng, 2.0, 15.0)
    acceleration = log_uniform(rng, 60.0, 400.0)
    hold: Hold = "first_order" if rng.random() < 0.25 else "zero_order"
    return Machine(
        family="rotor",
        joints=(
            Joint(
                drive=Drive.CURRENT,
                torque_constant=inertia * acceleration / limit,
                motor_inertia=0.4 * inertia,
                link_inertia=0.6 * inertia,
                viscous=inertia * rate,
                encoder_step=2 * math.pi / float(rng.choice([8192, 20000, 80000, 400000])),
            ),
        ),
        numbers=(1,),
        sample_time=1.0 / float(rng.choice([500, 1000, 2000])),
        travel=(40.0,),
        speed=(30.0,),
        command_limit=(limit,),
        command_step=(_converter(rng, limit, (12, 14, 16)),),
        bandwidth=(8.0, 25.0),
        hold=hold,
        # a measured current that changes linearly between samples cannot answer to its own sample
        loops=("open",) if hold == "first_order" else ("open", "closed"),
    )


def _stage_joint(rng: Rng) -> Joint:
    mass = log_uniform(rng, 1.0, 20.0)
    rate = log_uniform(rng, 3.0, 20.0)  # Kt^2 / (R m)
    resistance = log_uniform(rng, 1.0, 8.0)
    constant = math.sqrt(rate * resistance * mass)
    return Joint(
        gain=4.8,
        resistance=resistance,
        inductance=resistance * log_uniform(rng, 5e-4, 4e-3),
        torque_constant=constant,
        motor_inertia=0.3 * mass,
        link_inertia=0.7 * mass,
        viscous=mass * rate * log_uniform(rng, 0.05, 0.5),
        encoder_step=float(rng.choice([5e-7, 1e-6, 5e-6])),
    )


def _stage(rng: Rng) -> Machine:
    joint = _stage_joint(rng)
    return Machine(
        family="stage",
        joints=(joint,),
        numbers=(1,),
        sample_time=1.0 / float(rng.choice([1000, 2000])),
        travel=(log_uniform(rng, 0.1, 0.4),),
        speed=(min(1.0, 0.7 * 48.0 / joint.torque_constant),),
        command_limit=(10.0,),
        command_step=(_converter(rng, 10.0, (12, 14, 16)),),
        bandwidth=(30.0, 80.0),
        step=2.5e-5,
        loops=("closed",),
        unit="m",
    )


def _gantry(rng: Rng) -> Machine:
    """Two linear stages that a clean machine keeps apart."""
    joints = (_stage_joint(rng), _stage_joint(rng))
    return Machine(
        family="gantry",
        joints=joints,
        numbers=(1, 2),
        sample_time=1e-3,
        travel=(0.3, 0.2),
        speed=tuple(min(1.0, 0.7 * 48.0 / joint.torque_constant) for joint in joints),
        command_limit=(10.0, 10.0),
        command_step=(20.0 / 2**14,) * 2,
        bandwidth=(15.0, 40.0),
        step=2.5e-5,
        loops=("closed",),
        unit="m",
    )


COMMON = ("adept_j1", "adept_j2", "adept_j3", "adept_j4", "servo", "pendulum", "rotor", "stage", "pair")
"""Families that trials draw from with equal chance; `gantry` is there for the coupling of axes."""

FAMILIES: dict[str, Callable[[Rng], Machine]] = {
    **{name: _adept(name) for name in _ADEPT},
    "servo": _servo,
    "pendulum": _pendulum,
    "rotor": _rotor,
    "stage": _stage,
    "pair": _pair,
    "gantry": _gantry,
}
"""Each entry draws one machine of its family."""
