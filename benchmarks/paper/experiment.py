"""What the paper leaves open, chosen and reasoned: which motion, which rate, which imperfections, which held-out logs.

The paper gives no number. Every choice stands here once; `CHOICES` is printed in the report.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.paper.truth import true_coefficients
from envs.adeptone import adeptone
from envs.excitation import Excitation, Multisine, Sine
from envs.log import Log
from envs.plant.effects import Effect
from envs.plant.effects.amplifier import DeadZone
from envs.plant.effects.arm import CoulombFriction
from envs.plant.effects.motor import CoggingTorque
from envs.plant.plant import Plant
from envs.plant.sensors import Sensors
from envs.robot import Quantity, Robot
from envs.scara import ScaraBody
from methods.regressor import HORIZONTAL, VERTICAL, ColumnName

RATE = 1000.0  # Hz
DURATION = 10.0  # s, unless a quick run is asked for
PHYSICS_STEP = 5e-4
"""Longest step of the plant's integrator [s]; half of it moves no coefficient by more than 1e-5."""
LogName = Literal[
    "training sine", "other amplitude", "other frequency", "multisine", "other pose of joint 2", "payload"
]
TRAINING: LogName = "training sine"
HELD_OUT: tuple[LogName, ...] = ("other amplitude", "other frequency", "multisine", "other pose of joint 2", "payload")

CHOICES: tuple[tuple[str, str, str], ...] = (
    ("servo and sampling rate", "1 kHz", "the period at which the controller's servo library serves the converter"),
    ("record length", "10 s", "five periods of the slowest sine; longer records do not change the verdicts"),
    (
        "sine of joint 1",
        "0.5 Hz, sweep ±0.85 rad",
        "a third of the joint's travel, a third of its top speed; friction is then a few per cent of the voltage",
    ),
    ("sine of joint 2", "0.5 Hz, sweep ±0.85 rad", "as joint 1"),
    ("sine of joint 3", "1 Hz, sweep ±0.06 m", "half the stroke at three quarters of the top speed"),
    ("sine of joint 4", "1 Hz, sweep ±1.5 rad", "a third of the travel"),
    (
        "sine amplitude",
        "from the sweep",
        "an experimenter turns the voltage up until the joint sweeps as wanted; the amplitude then differs per draw",
    ),
    ("pose", "joint 2 at 90°, joint 3 at 0.05 m", "the paper's total inertia of joint 1 has no cosine of joint 2"),
    ("friction, cogging", "table of hidden effects", "a real arm has them, the paper's regressor has not"),
    ("dead zone", "20 mV of the ±10 V command", "the paper names an electrical dead zone; four steps of the converter"),
    ("encoders, converter", "5e5 counts/rev (J1, J2), 12 bit", "the robot's table"),
    (
        "parameter draws",
        "drives within a factor of 2, inertias within 35 %",
        "the uncertainty stated in the robot's table; hidden effects within a factor of 2",
    ),
    ("differentiator", "30 Hz, zero phase", "passes everything the joint does, see the panel on bandwidth"),
    ("hidden nodes", "10", "six and twenty give the same errors within a tenth"),
    (
        "inputs of the network",
        "centred, divided by their standard deviation",
        "sigmoid nodes need inputs of order one; uncentred, joint 3 does not learn",
    ),
    ("network target", "divided by its standard deviation", "learning rates then do not depend on the joint"),
    ("learning rates", "0.003 output, 0.03 hidden; 60 passes", "three times as much makes single runs rise again"),
)


@dataclass(frozen=True)
class JointSetup:
    """How one joint is tried. `sweep`: amplitude of the motion [rad or m]; `centre`: of the motion; `frequency`: Hz.

    coulomb, cogging: torque or force amplitudes [N m or N]; cycles: cogging cycles per revolution or 2 pi metres;
    dead_zone: [V].
    """

    joint: int
    columns: tuple[ColumnName, ...]
    centre: float
    sweep: float
    frequency: float
    coulomb: float
    cogging: float
    cycles: float
    dead_zone: float = 0.02
    cogging_phase: float = 0.0


SETUPS: dict[int, JointSetup] = {
    1: JointSetup(1, HORIZONTAL, centre=0.0, sweep=0.85, frequency=0.5, coulomb=7.0, cogging=2.0, cycles=150.0),
    2: JointSetup(2, HORIZONTAL, centre=0.0, sweep=0.85, frequency=0.5, coulomb=3.0, cogging=0.8, cycles=150.0),
    3: JointSetup(3, VERTICAL, centre=0.10, sweep=0.06, frequency=1.0, coulomb=20.0, cogging=2.0, cycles=314.0),
    4: JointSetup(4, HORIZONTAL, centre=0.0, sweep=1.5, frequency=1.0, coulomb=0.15, cogging=0.02, cycles=30.0),
}
POSE = (0.0, 0.5 * math.pi, 0.05, 0.0)
STRETCHED = (0.0, 0.0, 0.05, 0.0)
PAYLOAD = 5.0  # kg, about half of what the arm may carry


@dataclass(frozen=True)
class Draw:
    """One robot of the ensemble. `seed` feeds all that is random in its logs, of `duration` [s], and in the fits."""

    number: int
    robot: Robot
    setups: dict[int, JointSetup]
    seed: int
    duration: float = DURATION


def draws(count: int, seed: int, duration: float = DURATION) -> tuple[Draw, ...]:
    """The nominal robot first, then members of the ensemble within the stated uncertainties; logs of `duration` [s]."""
    members = [Draw(0, adeptone(), SETUPS, seed, duration)]
    for number in range(1, count):
        rng = np.random.default_rng([seed, number])
        robot = adeptone().sample(rng)
        setups = {
            joint: replace(
                setup,
                coulomb=setup.coulomb * _factor(rng),
                cogging=setup.cogging * _factor(rng),
                dead_zone=setup.dead_zone * _factor(rng),
                cogging_phase=float(rng.uniform(-math.pi, math.pi)),
            )
            for joint, setup in SETUPS.items()
        }
        members.append(Draw(number, robot, setups, seed + number, duration))
    return tuple(members)


def _factor(rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(-math.log(2.0), math.log(2.0))))


def with_payload(robot: Robot, mass: float) -> Robot:
    """The robot with a point mass [kg] at the quill."""
    body = robot.body
    assert isinstance(body, ScaraBody)
    loaded = Quantity(body.quill.mass.value + mass, "kg", "quill and payload")
    return replace(robot, body=replace(body, quill=replace(body.quill, mass=loaded)))


def training_sine(robot: Robot, setup: JointSetup) -> Sine:
    """The paper's sine: the voltage that sweeps the joint as wanted in spite of friction.

    The plant adds the voltage that carries the joint's weight.
    """
    truth = true_coefficients(robot, setup.joint, POSE)
    turn = 2j * np.pi * setup.frequency
    voltage = abs(truth["jerk"] * turn**3 + truth["acceleration"] * turn**2 + truth["velocity"] * turn) * setup.sweep
    voltage += setup.coulomb * robot.input_equivalent(setup.joint) + setup.dead_zone
    return Sine(
        joints=(setup.joint,),
        amplitude=round(voltage, 2),
        frequency=setup.frequency,
    )


def multisine(robot: Robot, setup: JointSetup, period: float) -> Multisine:
    """From below to far above the corner of the joint's mechanics, as strong as the amplifier's current limit allows.

    At standstill the peak voltage drives 0.7 of the current limit, which leaves room for the back-EMF.
    """
    sine = training_sine(robot, setup)
    drive = robot.joint(setup.joint).drive
    ceiling = 0.7 * drive.current_limit.value * drive.resistance.value / drive.amplifier_gain.value
    return Multisine(
        joints=sine.joints,
        amplitude=round(min(1.2 * float(sine.per_joint("amplitude")[0]), ceiling), 2),
        band=(0.4 * setup.frequency, 20.0 * setup.frequency),
        period=period,
    )


@dataclass(frozen=True)
class Trial:
    """One recording to be made: who, with what, for how long [s]."""

    name: LogName
    robot: Robot
    setup: JointSetup
    excitation: Excitation
    pose: tuple[float, ...]
    duration: float


def trials(draw: Draw, joint: int, names: tuple[LogName, ...]) -> tuple[Trial, ...]:
    """The recordings of one joint by name."""
    robot, setup = draw.robot, draw.setups[joint]
    sine = training_sine(robot, setup)
    below = setup.centre - setup.sweep  # a sine from rest swings to one side of its start
    start = tuple(below if number == joint else place for number, place in enumerate(POSE, start=1))
    centred = tuple(setup.centre if number == joint else place for number, place in enumerate(POSE, start=1))
    stretched = tuple(below if number == joint else place for number, place in enumerate(STRETCHED, start=1))
    half = replace(sine, amplitude=0.5 * float(sine.per_joint("amplitude")[0]))
    faster = replace(sine, frequency=1.6 * setup.frequency)
    loaded = with_payload(robot, PAYLOAD)
    everything: dict[LogName, tuple[Robot, Excitation, tuple[float, ...]]] = {
        "training sine": (robot, sine, start),
        "other amplitude": (robot, half, start),
        "other frequency": (robot, faster, start),
        "multisine": (robot, multisine(robot, setup, draw.duration), centred),
        "other pose of joint 2": (robot, sine, stretched),
        "payload": (loaded, sine, start),
    }
    chosen = ((name, everything[name]) for name in names)
    return tuple(Trial(name, who, setup, what, pose, draw.duration) for name, (who, what, pose) in chosen)


def record(trial: Trial, seed: int, *, hidden: bool = True, quantised: bool = True) -> Log:
    """Makes a recording on the plant and returns the log of the joint that moved; the others are held by their brakes.

    hidden: whether friction, cogging and dead zone act. quantised: whether the encoder has a finite resolution.
    """
    setup = trial.setup
    effects: tuple[Effect, ...] = (
        CoulombFriction(joint=setup.joint, torque=setup.coulomb),
        CoggingTorque(
            joint=setup.joint, amplitude=setup.cogging, cycles_per_rev=setup.cycles, phase=setup.cogging_phase
        ),
        DeadZone(joint=setup.joint, voltage=setup.dead_zone),
    )
    plant = Plant(
        trial.robot, effects if hidden else (), sensors=Sensors(quantised=quantised), longest_step=PHYSICS_STEP
    )
    rng = np.random.default_rng(seed)
    return plant.record(
        trial.excitation, trial.duration, rng, rate=RATE, pose=np.array(trial.pose), name=trial.name
    ).log
