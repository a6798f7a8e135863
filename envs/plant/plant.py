"""Experiments on the "real" robot: what is hidden goes in, a log comes out, and the truth beside it.

    plant = Plant(adeptone(), (parse_effect("coulomb_friction=7"),))
    log, truth = plant.record(parse("multisine:amplitude=1.5"), 30.0, np.random.default_rng(0))

The log holds what command line and sensors gave and nothing else. The truth is a value of its own, stored as
``NAME.truth.json`` beside the log; no log ever refers to it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from envs.excitation import Excitation, parse
from envs.log import Array, Log
from envs.log_files import save
from envs.plant.build import Build
from envs.plant.effects import Effect, EffectError, parse_effect
from envs.plant.effects.arm import CoulombFriction, FrictionAsymmetry
from envs.plant.effects.motor import ThermalDrift
from envs.plant.sensors import AmplifierNoise, Sensors
from envs.plant.servo import PositionServo
from envs.plant.simulation import Measurement, Simulation
from envs.robot import Robot

_LARGEST_JITTER = 0.45
"""In samples: samples keep their order."""

_DRY_FRICTION = ("coulomb_friction", "stribeck_friction", "presliding_friction")

_CURRENT_TOLERANCE = 2e-3
"""Relative change of the rms current at which the search for it ends."""


class PlantError(ValueError):
    """An experiment that cannot be run, said in one line: what is wrong, what to do."""


@dataclass(frozen=True)
class Truth:
    """What no log tells: effects with the numbers that acted, and how the experiment was made, in JSON's types."""

    effects: tuple[dict[str, Any], ...]
    robot: dict[str, Any]
    experiment: dict[str, Any]
    log_hash: str

    def write(self, log_path: str | Path) -> Path:
        """Stores the truth beside a log; returns its path."""
        path = truth_path(log_path)
        path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")
        return path


def truth_path(log_path: str | Path) -> Path:
    """Where the truth of a synthetic log stands: ``NAME.truth.json``."""
    path = Path(log_path)
    return path.with_name(f"{path.stem}.truth.json")


class Recording(NamedTuple):
    """A log and, apart from it, its truth."""

    log: Log
    truth: Truth

    def save(self, path: str | Path) -> Path:
        """Writes log, sidecar and ``NAME.truth.json``; returns the log's path."""
        written = save(self.log, path)
        self.truth.write(written)
        return written


@dataclass(frozen=True)
class Plant:
    """The "real" robot. `robot` may be a member of an ensemble (`Robot.sample`); the nominal model never sees it.

    effects: what is hidden, in any order; one per name and joint unless the effect may be repeated.
    longest_step: of the physics [s]; fast modes shorten it.

    Raises EffectError, in one line, for effects that the robot cannot have.
    """

    robot: Robot
    effects: tuple[Effect, ...] = ()
    sensors: Sensors = field(default_factory=Sensors)
    noise: AmplifierNoise = field(default_factory=AmplifierNoise)
    longest_step: float = 2.5e-4

    def __post_init__(self) -> None:
        seen = set()
        for effect in self.effects:
            if effect.joint > len(self.robot):
                raise EffectError(
                    f"{effect.name}: {self.robot.name} has joints 1..{len(self.robot)}, not {effect.joint}"
                )
            if (effect.name, effect.joint) in seen and not effect.repeatable:
                raise EffectError(f"{effect.name} is given twice for joint {effect.joint}. Give it once")
            seen.add((effect.name, effect.joint))
        object.__setattr__(self, "effects", (*self.effects, *_implied(self.effects)))

    def rest_pose(self) -> Array:
        """Where an experiment starts unless told otherwise, shape (n,): 0, or the middle of a range that ends there."""
        ends = [(joint.lower.value, joint.upper.value) for joint in self.robot.joints]
        return np.array([0.0 if lower < 0.0 < upper else 0.5 * (lower + upper) for lower, upper in ends])

    def simulate(
        self,
        free: tuple[int, ...],
        rng: np.random.Generator,
        *,
        rate: float = 1000.0,
        pose: Array | None = None,
        servo: PositionServo | None = None,
        hold: bool = True,
        rms_currents: dict[int, float] | None = None,
    ) -> Simulation:
        """The plant at rest, ready to be advanced sample by sample.

        free: joints that move. rms_currents: what the motors will carry [A], by joint, for thermal drift; a fifth of
        the limit where unknown. Other arguments as in `record`.
        """
        self._check_joints(free)
        if not 10.0 <= rate <= 10_000.0:
            raise PlantError(f"rate is {rate:g} Hz. Give 10 to 10000 Hz")
        start = self.rest_pose() if pose is None else np.asarray(pose, dtype=np.float64)
        robot = self.robot
        for effect in self.effects:
            robot = effect.alter(robot)
        build = Build(robot, free, start, self.sensors, 1.0 / rate, rms_currents or {})
        for effect in self.effects:
            effect.install(build)
        held = holding_command(self.robot, start)[[joint - 1 for joint in free]] * hold
        if servo is not None:
            build.add_servo(servo, held)
        return Simulation(build, self.longest_step, held, self.noise, rng)

    def record(
        self,
        excitation: Excitation,
        duration: float,
        rng: np.random.Generator,
        *,
        rate: float = 1000.0,
        pose: Array | None = None,
        servo: PositionServo | None = None,
        free: tuple[int, ...] = (),
        hold: bool = True,
        name: str = "log",
    ) -> Recording:
        """One experiment of `duration` [s]; the same state of `rng` gives the same bits.

        The excited joints, the servo's joints and the joints `free` move and are logged; brakes hold the others at
        `pose` (n,) [rad or m], by default `rest_pose`. Joints under the servo take the excitation as their reference,
        counted from the pose; the others as their command, counted, where `hold` is set, from the command that holds
        the pose. rate: of servo and log [Hz].

        Raises PlantError when the arm runs into the end of its range, EffectError for effects on braked joints.
        """
        if not duration * rate >= 2.0:
            raise PlantError(f"{duration:g} s at {rate:g} Hz are fewer than two samples. Record for longer")
        entropy = int(rng.integers(2**62))
        excite_seed, plant_seed, jitter_seed = np.random.SeedSequence(entropy).spawn(3)
        moving = tuple(sorted({*excitation.joints, *free, *(servo.joints if servo else ())}))
        self._check_joints(moving)
        start = self.rest_pose() if pose is None else np.asarray(pose, dtype=np.float64)
        time = np.arange(round(duration * rate)) / rate
        wanted = np.zeros((len(time), len(moving)))
        columns = [moving.index(joint) for joint in excitation.joints]
        wanted[:, columns] = excitation.fitted(self.robot, start).sample(time, np.random.default_rng(excite_seed))
        jitter = np.random.default_rng(jitter_seed).standard_normal(len(time))

        def run(plant: Plant, rms_currents: dict[int, float]) -> tuple[Simulation, Array, Measurement]:
            simulation = plant.simulate(
                moving,
                np.random.default_rng(plant_seed),
                rate=rate,
                pose=start,
                servo=servo,
                hold=hold,
                rms_currents=rms_currents,
            )
            late = np.clip(simulation.build.jitter * jitter, -_LARGEST_JITTER / rate, _LARGEST_JITTER / rate)
            return simulation, *simulation.run(wanted, late)

        simulation, commands, seen = self._run_heated(run, moving)
        self._check_range(seen.position, moving, time)
        closed = servo is not None and bool(set(servo.joints) & set(excitation.joints))
        log = Log(
            time=time,
            command=commands,
            position=seen.position,
            joints=moving,
            velocity=seen.velocity if self.sensors.velocity else None,
            temperature=seen.temperature if self.sensors.temperature else None,
            facts=tuple(replace(self.robot.facts(joint), encoder_step=self._step(joint)) for joint in moving),
            robot=self.robot.name,
            loop="closed" if closed else "open",
            name=name,
        )
        experiment = {
            "excitation": excitation.text,
            "entropy": entropy,
            "rate": rate,
            "duration": duration,
            "pose": [float(angle) for angle in start],
            "moving": list(moving),
            "servo": None if servo is None else asdict(servo),
            "hold": hold,
            "physics_step": simulation.step,
            "sensors": asdict(self.sensors),
            "noise": asdict(self.noise),
            "mujoco": mujoco.__version__,
        }
        return Recording(log, self._truth(simulation.build, seen, experiment, log.content_hash))

    def _run_heated(self, run: Any, moving: tuple[int, ...]) -> tuple[Simulation, Array, Measurement]:
        """One run; with thermal drift as many as it takes for the heat to fit the record's own mean square current."""
        cold = tuple(effect for effect in self.effects if not isinstance(effect, ThermalDrift))
        if len(cold) == len(self.effects):
            return run(self, {})
        rms = _rms_currents(run(replace(self, effects=cold), {})[2], moving)
        for _ in range(6):
            result = run(self, rms)
            found = _rms_currents(result[2], moving)
            if all(math.isclose(found[joint], rms[joint], rel_tol=_CURRENT_TOLERANCE) for joint in moving):
                break
            rms = found
        return result

    def _step(self, joint: int) -> float | None:
        step = self.sensors.encoder_step(self.robot.joint(joint))
        return step if step > 0.0 else None

    def _check_joints(self, joints: Iterable[int]) -> None:
        for joint in joints:
            if joint > len(self.robot):
                raise PlantError(f"{self.robot.name} has joints 1..{len(self.robot)}, not {joint}. Choose one of these")

    def _check_range(self, position: Array, moving: tuple[int, ...], time: Array) -> None:
        for column, number in enumerate(moving):
            joint = self.robot.joint(number)
            outside = (position[:, column] < joint.lower.value) | (position[:, column] > joint.upper.value)
            if not np.isfinite(position[:, column]).all():
                raise PlantError(f"joint {number} flew away. Make the effects or the servo's gains smaller")
            if outside.any():
                row = int(np.argmax(outside))
                raise PlantError(
                    f"joint {number} ran into the end of its range, {position[row, column]:.3f} {joint.unit} at "
                    f"{time[row]:.2f} s. Use a smaller or faster excitation, a servo or another pose"
                )

    def _truth(self, build: Build, seen: Measurement, experiment: dict[str, Any], log_hash: str) -> Truth:
        effects = []
        for effect in self.effects:
            entry = effect.describe(build.robot)
            entry["parameters"].update(build.derived.get(id(effect), {}))
            effects.append(entry)
        joints = {}
        for column, number in enumerate(build.free):
            drive, current = build.robot.joint(number).drive, seen.current[:, column]
            joints[str(number)] = {
                "inertia": float(build.robot.inertia_matrix(build.pose)[number - 1, number - 1]),
                "input_equivalent": drive.input_equivalent,
                **{item: getattr(drive, item).value for item in ("resistance", "inductance", "viscous")},
                "torque_constant": drive.torque_constant,
                "amplifier_gain": drive.amplifier_gain.value,
                "current_rms": float(np.sqrt(np.mean(current**2))),
                "current_limited": float(np.mean(np.abs(current) >= (1.0 - 1e-9) * drive.current_limit.value)),
            }
        return Truth(tuple(effects), {"name": self.robot.name, "joints": joints}, experiment, log_hash)


def holding_command(robot: Robot, pose: Array) -> Array:
    """Command that nominally holds the robot at a pose, all joints, shape (n,) [command units]."""
    torque = np.linalg.solve(robot.coupling_matrix.T, robot.body.bias(pose, np.zeros_like(pose)))
    return torque * robot.drive_values("input_equivalent")


def record(
    robot: Robot,
    effects: Iterable[Effect | str],
    excitation: Excitation | str,
    *,
    duration: float = 30.0,
    rate: float = 1000.0,
    seed: int = 0,
    pose: Array | None = None,
    servo: PositionServo | None = None,
    sensors: Sensors | None = None,
    noise: AmplifierNoise | None = None,
    name: str = "log",
) -> Recording:
    """One experiment from plain arguments; effects and excitation may be text. See `Plant` and `Plant.record`.

    Raises EffectError, ExcitationError or PlantError, each in one line.
    """
    if isinstance(excitation, str):
        excitation = parse(excitation, robot=robot)
    first = excitation.joints[0]
    hidden = tuple(parse_effect(item, joint=first) if isinstance(item, str) else item for item in effects)
    plant = Plant(robot, hidden, sensors or Sensors(), noise or AmplifierNoise())
    rng = np.random.default_rng(seed)
    return plant.record(excitation, duration, rng, rate=rate, pose=pose, servo=servo, name=name)


def _implied(effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """The least mean friction that a difference of friction between the directions presupposes."""
    implied = []
    for effect in effects:
        if not isinstance(effect, FrictionAsymmetry):
            continue
        mean = sum(
            getattr(other, "torque", 0.0)
            for other in effects
            if other.joint == effect.joint and other.name in _DRY_FRICTION
        )
        lacking = 0.5 * abs(effect.torque) - mean
        if lacking > 1e-12:
            if any(other.joint == effect.joint and other.name == "coulomb_friction" for other in effects):
                raise EffectError(
                    f"friction_asymmetry: torque {effect.torque:g} on joint {effect.joint} is more than twice the mean "
                    f"friction {mean:g}, it would push. Raise coulomb_friction"
                )
            implied.append(CoulombFriction(joint=effect.joint, torque=lacking))
    return tuple(implied)


def _rms_currents(seen: Measurement, moving: tuple[int, ...]) -> dict[int, float]:
    rms = np.sqrt(np.mean(seen.current**2, axis=0))
    return {joint: max(float(value), 1e-6) for joint, value in zip(moving, rms, strict=True)}
