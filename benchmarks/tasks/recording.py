"""Tasks on the plant: experiments on one member of a robot's ensemble, and what noise alone costs the true model.

The seed draws the robot (every number within its stated uncertainty), the strength of what is hidden, and all noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal
from zlib import crc32

import numpy as np

from benchmarks.paper.experiment import SETUPS, JointSetup, multisine, training_sine, with_payload
from benchmarks.paper.truth import true_coefficients
from benchmarks.tasks.base import Floor, Parameter, TaskData, Truth
from envs.adeptone import adeptone
from envs.excitation import PRBS, Chirp, Excitation, FourierSeries, Steps
from envs.log import Array, Log
from envs.robot import Robot
from envs.scara import ScaraBody
from methods.differentiation import BandLimited, Signals
from methods.regressor import ColumnName, column_unit

if TYPE_CHECKING:
    from envs.plant.effects import Effect
    from envs.plant.plant import Plant

Noise = Literal["low", "medium", "high"]
Form = Literal["sine", "multisine", "chirp", "prbs", "steps", "fourier"]
PHYSICS_STEP = 5e-4
"""Longest step of the plant [s]; half of it moves no coefficient by more than 1e-5."""
RATE = 1000.0
POSE = (0.0, 0.5 * np.pi, 0.10, 0.0)
"""Where the joints stand that do not move [rad or m]; the others start at the centre of their motion."""
NOISE: dict[Noise, tuple[float, float]] = {"low": (0.0, 0.002), "medium": (4.0, 0.01), "high": (20.0, 0.05)}
"""White noise of the encoders beside their resolution [steps], and coloured amplifier noise that no log shows [V]."""
SERVO_BANDWIDTH = 20.0
"""Of closed loops [rad/s]."""
REACH: dict[int, tuple[float, float]] = {1: (0.9, 3.0), 2: (0.9, 4.0), 3: (0.07, 0.35), 4: (1.8, 10.0)}
"""Distance from the centre and speed of Fourier series [rad or m, and per s]."""
COMMAND_SHARE = 8.0
"""Largest nominal command of Fourier series [V]."""
SHRINK = 0.7
"""By how much an experiment is made smaller when the arm runs into the end of its range."""


@dataclass(frozen=True)
class Experiment:
    """One recording. scale, speed: factors on amplitude and frequency.

    closed: under a position servo tuned to the nominal robot, where the excitation is a Fourier series of positions.
    pose: of all joints at the start; None: `POSE`. payload: at the flange [kg].
    """

    name: str
    form: Form
    scale: float = 1.0
    speed: float = 1.0
    duration: float = 10.0
    closed: bool = False
    pose: tuple[float, ...] | None = None
    payload: float = 0.0


@dataclass(frozen=True)
class Member:
    """One robot of the ensemble, and how its joints are excited."""

    robot: Robot
    joints: tuple[int, ...]

    def setup(self, joint: int) -> JointSetup:
        """How the joint is tried, for a robot whose friction nobody knows."""
        return replace(SETUPS[joint], coulomb=0.0, cogging=0.0, dead_zone=0.0)

    def level(self, joint: int) -> float:
        """Amplitude of a multisine that moves the joint well within its range [V]."""
        return float(multisine(self.robot, self.setup(joint), 10.0).per_joint("amplitude")[0])

    def torque(self, joint: int) -> float:
        """Torque that belongs to `level` at standstill [N m or N]."""
        return self.level(joint) / self.robot.input_equivalent(joint)

    def inertia(self, joint: int) -> float:
        """Inertia of the joint at `POSE` [kg m^2 or kg]."""
        return float(self.robot.inertia_matrix(np.array(POSE))[joint - 1, joint - 1])

    def top_speed(self, joint: int) -> float:
        """Speed of the joint's training sine [rad/s or m/s]."""
        return 2.0 * np.pi * SETUPS[joint].frequency * SETUPS[joint].sweep


Hide = Callable[[np.random.Generator, Member], "tuple[Effect, ...]"]


@dataclass(frozen=True)
class Setting:
    """A task on the plant. joints: those that move. hide: draws what is hidden; None: nothing."""

    name: str
    joints: tuple[int, ...]
    train: tuple[Experiment, ...]
    held_out: tuple[Experiment, ...]
    hide: Hide | None = None
    noise: Noise = "low"

    def make(self, seed: int) -> TaskData:
        """The data of one seed."""
        draw, own = np.random.default_rng([seed, crc32(self.name.encode())]).spawn(2)
        member = Member(adeptone().sample(draw), self.joints)
        effects = () if self.hide is None else self.hide(draw, member)
        makers = own.spawn(len(self.train) + len(self.held_out))
        pairs = [
            self._record(member, effects, experiment, rng)
            for experiment, rng in zip((*self.train, *self.held_out), makers, strict=True)
        ]
        count = len(self.train)
        body = member.robot.body
        return TaskData(
            train=tuple(log for log, _ in pairs[:count]),
            held_out=tuple(log for log, _ in pairs[count:]),
            truth=_truth(member, effects, pairs[0][0], self.train[0]),
            floor=_floor(member.robot, pairs[count:]),
            kinematics=body if len(self.joints) > 1 and isinstance(body, ScaraBody) else None,
        )

    def _record(
        self, member: Member, effects: Sequence[Effect], experiment: Experiment, rng: np.random.Generator
    ) -> tuple[Log, Log | None]:
        """The recording, and the same commands on the same arm without noise; None where that leaves the range."""
        from envs.plant.plant import Plant, PlantError
        from envs.plant.sensors import AmplifierNoise, Sensors
        from envs.plant.servo import PositionServo

        robot = with_payload(member.robot, experiment.payload) if experiment.payload else member.robot
        steps, volts = NOISE[self.noise]
        pose = np.array(experiment.pose or _start(self.joints, experiment))
        servo = None
        if experiment.closed:
            servo = PositionServo.tuned(adeptone(), self.joints, bandwidth=SERVO_BANDWIDTH, pose=tuple(pose))
        step = robot.joint(self.joints[0]).encoder_step
        noisy = Plant(
            robot,
            tuple(effects),
            sensors=Sensors(position_noise=steps * (step.value if step else 0.0)),
            noise=AmplifierNoise(rms=volts),
            longest_step=PHYSICS_STEP,
        )
        seed = int(rng.integers(2**62))
        scale = experiment.scale
        for _ in range(8):
            excitation = build(member, replace(experiment, scale=scale), tuple(pose))
            try:
                log = noisy.record(
                    excitation,
                    experiment.duration,
                    np.random.default_rng(seed),
                    rate=RATE,
                    pose=pose,
                    servo=servo,
                    name=experiment.name,
                ).log
                break
            except PlantError:
                scale *= SHRINK
        else:
            raise PlantError(f"{self.name}: no scale of {experiment.name} keeps the arm within its range")
        quiet = replace(noisy, effects=tuple(effects), sensors=Sensors(quantised=False), noise=AmplifierNoise())
        return log, _twin(quiet, log, pose)


@dataclass(frozen=True, kw_only=True, eq=False)
class Playback(Excitation):
    """Recorded commands (T, n), beyond nothing: to be used with ``hold=False``."""

    commands: Array

    def sample(self, time: Array, rng: np.random.Generator) -> Array:
        """The commands, one row per instant."""
        return self.commands

    @property
    def text(self) -> str:
        """No text form has room for a recording."""
        return "playback"


@dataclass(frozen=True, kw_only=True)
class Together(Excitation):
    """One excitation per joint, each with its own random numbers."""

    parts: tuple[Excitation, ...]

    def sample(self, time: Array, rng: np.random.Generator) -> Array:
        """One column per part."""
        streams = rng.spawn(len(self.parts))
        return np.column_stack([part.sample(time, own) for part, own in zip(self.parts, streams, strict=True)])

    @property
    def text(self) -> str:
        """The parts' text forms."""
        return " + ".join(part.text for part in self.parts)


def build(member: Member, experiment: Experiment, pose: tuple[float, ...]) -> Excitation:
    """The excitation of an experiment on one member of the ensemble."""
    joints = member.joints
    setups = [member.setup(joint) for joint in joints]
    level = tuple(experiment.scale * member.level(joint) for joint in joints)
    frequency = min(setup.frequency for setup in setups) * experiment.speed
    if experiment.form == "fourier":
        return Together(joints=joints, parts=tuple(_series(joint, experiment, pose) for joint in joints))
    if experiment.form == "sine":
        sines = [training_sine(member.robot, setup) for setup in setups]
        amplitude = tuple(experiment.scale * float(sine.per_joint("amplitude")[0]) for sine in sines)
        frequencies = tuple(experiment.speed * setup.frequency for setup in setups)
        return replace(sines[0], joints=joints, amplitude=amplitude, frequency=frequencies)
    band = (0.4 * frequency, 20.0 * frequency)
    if experiment.form == "multisine":
        rich = multisine(member.robot, setups[0], experiment.duration)
        return replace(rich, joints=joints, amplitude=level, band=band)
    if experiment.form == "chirp":
        return Chirp(joints=joints, amplitude=level, band=(frequency, 20.0 * frequency))
    if experiment.form == "prbs":
        return PRBS(joints=joints, amplitude=tuple(0.6 * volts for volts in level), bit_time=0.05 / experiment.speed)
    return Steps(joints=joints, amplitude=tuple(0.6 * volts for volts in level), dwell=0.4 / experiment.speed)


def _series(joint: int, experiment: Experiment, pose: tuple[float, ...]) -> FourierSeries:
    near, fast = REACH[joint]
    return FourierSeries(
        joints=(joint,),
        robot=adeptone(),
        pose=pose,
        period=5.0 / experiment.speed,
        position=experiment.scale * near,
        velocity=experiment.scale * fast,
        command=COMMAND_SHARE,
        output="position" if experiment.closed else "command",
    )


def _start(joints: tuple[int, ...], experiment: Experiment) -> tuple[float, ...]:
    """`POSE` with the moving joints where their motion begins: a sine from rest swings to one side of its start."""
    pose = list(POSE)
    for joint in joints:
        setup = SETUPS[joint]
        if len(joints) == 1 or joint != 2:
            pose[joint - 1] = setup.centre
        if experiment.form == "sine":
            pose[joint - 1] -= setup.sweep * min(experiment.scale, 1.2)
    return tuple(pose)


def _twin(plant: Plant, log: Log, pose: Array) -> Log | None:
    from envs.plant.plant import PlantError

    commands = Playback(joints=log.joints, commands=log.command)
    try:
        return plant.record(commands, len(log) / RATE, np.random.default_rng(0), rate=RATE, pose=pose, hold=False).log
    except PlantError:
        return None


def _truth(member: Member, effects: Sequence[Effect], log: Log, first: Experiment) -> Truth:
    """Identifiable combinations, input-equivalent, under the names of the regressor's columns.

    Of several joints those that no choice of base parameters touches: ``velocity of joint 1``, ``coulomb of joint 1``.
    """
    hidden = tuple((effect.name, effect.joint) for effect in effects)
    pose = first.pose or _start(member.joints, first)
    found: dict[str, Parameter] = {}
    for joint, facts in zip(member.joints, log.facts, strict=True):
        values: dict[ColumnName, float] = dict(true_coefficients(member.robot, joint, pose))
        values["coulomb"] = sum(
            member.robot.input_equivalent(joint) * getattr(effect, "torque", 0.0)
            for effect in effects
            if (effect.name, effect.joint) == ("coulomb_friction", joint)
        )
        single = len(member.joints) == 1
        for name, value in values.items():
            if single or name in ("velocity", "coulomb"):
                told = str(name) if single else f"{name} of joint {joint}"
                found[told] = Parameter(value, column_unit(name, facts))
    return Truth(found, hidden)


def _floor(robot: Robot, pairs: Sequence[tuple[Log, Log | None]]) -> Floor | None:
    """What is left of a true model's errors: noise, carried into the command by the nominal inverse of the true robot.

    Position: measured minus noise-free motion under the same commands. Command: the difference of the commands that
    belong to these two motions; hidden effects act alike on both and cancel.
    """
    inverse, position = [], []
    for noisy, quiet in pairs:
        if quiet is None:
            return None
        seen, true = (BandLimited().signals(log) for log in (noisy, quiet))
        rotary = np.array([facts.position_unit == "rad" for facts in noisy.facts])
        rotary = rotary if rotary.any() else ~rotary
        command = rigid_command(robot, seen, noisy.joints) - rigid_command(robot, true, noisy.joints)
        inverse.append(command[2:-2, rotary].ravel())
        position.append((seen.motion.position - true.motion.position)[:, rotary].ravel())
    return Floor(*(float(np.sqrt(np.mean(np.concatenate(part) ** 2))) for part in (inverse, position)))


def rigid_command(robot: Robot, signals: Signals, joints: tuple[int, ...]) -> Array:
    """Command (T, n) of the robot's own equations for a motion of some joints; the others stand at `POSE`."""
    columns = [joint - 1 for joint in joints]
    full = [np.tile(POSE, (len(signals), 1)), np.zeros((len(signals), 4)), np.zeros((len(signals), 4))]
    for whole, name in zip(full, ("position", "velocity", "acceleration"), strict=True):
        whole[:, columns] = getattr(signals.motion, name)
    torque = np.linalg.solve(robot.coupling_matrix.T, robot.inverse_dynamics(*full).T).T
    command = np.empty_like(torque)
    for column, drive in enumerate(robot.drives):
        current = torque[:, column] / drive.torque_constant
        slope = np.gradient(current, signals.time, edge_order=2)
        speed = full[1] @ robot.coupling_matrix[column]
        volts = drive.inductance.value * slope + drive.resistance.value * current + drive.torque_constant * speed
        command[:, column] = volts / drive.amplifier_gain.value
    return command[:, columns]
