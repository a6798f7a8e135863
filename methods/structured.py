"""The extended model: nominal joints plus effects (plus a compensator network), simulated by the compiled kernel.

All numbers are input-equivalent, as in `methods.kernel`; a robot's drive constants turn them into SI units. The model
is a `Model` (inverse and simulation), travels as JSON, and runs as the simulator of ``AdeptOne-v0``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

from envs.log import Array, Hold, InputKind
from envs.robot import Robot
from methods.base import MethodError, Model, Motion, State
from methods.effects import built_in, vocabulary
from methods.effects.base import Effect
from methods.kernel import BEGINNING, DAMPING, NOMINAL, STATES, Kernel, build
from methods.two_layer_network import TwoLayerNetwork, pack

FORMAT = 1
"""Version of the JSON layout."""
DIVERGED = 1e6
"""Error by which the kernel marks samples after a divergence."""
INVERSION_LEAK = 30.0
"""Rate at which the simulation inside the inversion is pulled to the motion [1/s]."""
INVERSION_ROUNDS = 12
INSTANT = 1e-9
"""Step of a look at the rates of change [s]."""
COMPENSATOR = "compensator"
"""Name of the network among the parts of a model that can be left out."""


RECORDING = ("timing", "stepping", "following")
"""Nominal parameters that are properties of logs, not of robots."""


@dataclass(frozen=True)
class StructuredJoint:
    """One joint: nominal parameters by the names of `methods.kernel.NOMINAL`, effects with their model parameters.

    compensator: network of position and velocity whose output is a torque that resists, in the command's unit.
    """

    joint: int
    input: InputKind
    nominal: Mapping[str, float]
    effects: Mapping[str, Mapping[str, float]]
    position_unit: str = "rad"
    compensator: TwoLayerNetwork | None = None

    @property
    def damping(self) -> float:
        """Torque per velocity, mechanical and by back-EMF [command unit s/rad]."""
        return sum(self.nominal.get(name, 0.0) for name in DAMPING)


@dataclass(frozen=True)
class PlanarCoupling:
    """What couples the first two joints as a planar arm of two links, in units of joint 1; see `methods.kernel`.

    coupling_inertia: p3 of ``M12 = p2 + p3 cos q2``. unit_ratio: command units per torque of joint 2 over joint 1.
    shared_inertia: p2.
    """

    coupling_inertia: float
    unit_ratio: float
    shared_inertia: float

    @property
    def rigid(self) -> Array:
        """The three numbers as the kernel takes them."""
        return np.array([self.coupling_inertia, self.unit_ratio, self.shared_inertia])


@dataclass(frozen=True, eq=False)
class StructuredModel(Model):
    """Joints that are simulated together; see the module.

    coupling: what makes the first two joints a planar pair, else None. sample_time: of the logs it was fitted to [s];
    longer intervals are integrated in several steps.
    vocabulary: the effects that the kernel is built for, all built-in ones by default.
    """

    parts: tuple[StructuredJoint, ...]
    sample_time: float
    coupling: PlanarCoupling | None = None
    vocabulary: tuple[Effect, ...] = ()

    @property
    def joints(self) -> tuple[int, ...]:  # type: ignore[override]
        return tuple(part.joint for part in self.parts)

    @property
    def inputs(self) -> tuple[InputKind, ...]:  # type: ignore[override]
        return tuple(part.input for part in self.parts)

    def __getstate__(self) -> dict[str, Any]:
        """What travels between processes: the fields, not the compiled kernel, which is found again."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    @cached_property
    def kernel(self) -> Kernel:
        """The compiled kernel for the vocabulary; effects of installed packages are there when the model has one."""
        own = self.vocabulary or built_in()
        named = {name for part in self.parts for name in part.effects}
        return build(own if named <= {effect.name for effect in own} else vocabulary())

    @property
    def substeps(self) -> int:
        """Integration steps per sample: none longer than 2 ms."""
        return max(1, int(np.ceil(self.sample_time / 2e-3)))

    @cached_property
    def arrays(self) -> tuple[Array, np.ndarray, bool, Array]:
        """(parameters (n, columns), switches (n, effects), planar pair or not, rigid (3,)) as the kernel takes them.

        Raises MethodError for an effect that is not in the vocabulary.
        """
        kernel, n = self.kernel, len(self.parts)
        parameters, switches = np.zeros((n, kernel.columns)), np.zeros((n, len(kernel.effects)), dtype=bool)
        parameters[:, NOMINAL.index("torque_square_mean")] = 1.0
        known = {effect.name: effect for effect in kernel.effects}
        for j, part in enumerate(self.parts):
            for name, value in part.nominal.items():
                parameters[j, NOMINAL.index(name)] = value
            for name, values in part.effects.items():
                if name not in known:
                    raise MethodError(f"there is no effect {name}", remedy="Install the plugin that it comes from")
                order = [p.name for p in known[name].parameters]
                parameters[j, kernel.offsets[name] : kernel.offsets[name] + len(order)] = [values[p] for p in order]
                switches[j, kernel.switches[name]] = True
        return (
            parameters,
            switches,
            self.coupling is not None,
            np.zeros(3) if self.coupling is None else self.coupling.rigid,
        )

    def without(self, joint: int, effect: str) -> StructuredModel:
        """The same model with one effect (or the compensator) of a joint left out, nothing refitted."""

        def reduced(part: StructuredJoint) -> StructuredJoint:
            effects = {name: values for name, values in part.effects.items() if name != effect}
            return replace(part, effects=effects, compensator=None if effect == COMPENSATOR else part.compensator)

        return replace(self, parts=tuple(reduced(p) if p.joint == joint else p for p in self.parts))

    def unrecorded(self) -> StructuredModel:
        """The robot alone, without what belongs to the logs it was found in: their timing and their integration."""

        def timeless(part: StructuredJoint) -> StructuredJoint:
            return replace(part, nominal={k: v for k, v in part.nominal.items() if k not in RECORDING})

        return replace(self, parts=tuple(map(timeless, self.parts)))

    def simulate(self, time: Array, command: Array, initial: State, hold: Hold = "zero_order") -> Motion:
        """Motion (T, n) of what the sensors read, from `initial`; see `Model.simulate`.

        Joints that feel another one (`axis_coupling`) are simulated after the free motion of the others.
        """
        time = np.ascontiguousarray(time, dtype=np.float64)
        command = np.ascontiguousarray(command, dtype=np.float64).reshape(len(time), -1)
        reading, motion = self._run(time, command, initial, hold, np.zeros((0, len(self.parts), 3)))
        if any("axis_coupling" in part.effects for part in self.parts) and len(self.parts) > 1:
            near = self._neighbours(time, command, motion)
            reading, motion = self._run(time, command, initial, hold, near)
        velocity = motion[:, :, 1]
        acceleration = np.gradient(velocity, time, axis=0)
        return Motion(reading, velocity, acceleration, np.gradient(acceleration, time, axis=0))

    def _run(self, time: Array, command: Array, initial: State, hold: Hold, near: Array) -> tuple[Array, Array]:
        """Readings (T, n) and states (T, n, 3) of a free simulation."""
        run = Session(self, time, command, hold, near)
        run.begin(initial.position, initial.velocity, initial.acceleration)
        run.advance(0, len(time))
        reading = -run.error
        gone = np.all(run.error == DIVERGED, axis=1)
        reading[gone], run.motion[gone] = np.nan, np.nan
        return reading, run.motion

    def _neighbours(self, time: Array, command: Array, motion: Array) -> Array:
        """Acceleration, velocity and command of the next joint, (T, n, 3)."""
        near = np.zeros((len(time), len(self.parts), 3))
        for j in range(len(self.parts)):
            other = min((k for k in range(len(self.parts)) if k != j), key=lambda k: abs(k - j))
            near[:, j, 0] = np.gradient(motion[:, other, 1], time)
            near[:, j, 1] = motion[:, other, 1]
            near[:, j, 2] = command[:, other]
        return near

    def inverse(self, time: Array, motion: Motion, command: Array | None = None) -> Array:
        """Command (T, n) that makes the model follow the motion, by iterated correction; the recorded one is not used.

        The model is simulated with a weak pull towards the motion; what the pull has to do, as a command
        ``J (e'' + leak e') + B (e' + leak e)``, is added to the command, as far ahead as delay and lag demand. Where
        the model cannot follow (a saturated amplifier) the result is the closest that the iteration found.
        """
        time = np.ascontiguousarray(time, dtype=np.float64)
        parameters = self.arrays[0]
        inertia, damping = parameters[:, 0], np.array([part.damping for part in self.parts])
        drive = inertia * motion.acceleration + damping * motion.velocity
        ahead = np.array([self._dead_time(part) for part in self.parts])
        best, least = drive, np.inf
        window = min(max(7, 2 * round(0.01 / self.sample_time) + 1), (len(time) - 1) // 2 * 2 - 1)
        near = np.zeros((0, len(self.parts), 3))
        if len(self.parts) > 1:
            states = np.stack([motion.position, motion.velocity, motion.acceleration], axis=-1)
            near = self._neighbours(time, drive, states)
        for _ in range(INVERSION_ROUNDS):
            run = Session(self, time, drive, "first_order", near, motion.position)
            run.begin(motion.position[0], motion.velocity[0])
            run.advance(0, len(time), INVERSION_LEAK)
            e, rate, bend = (
                savgol_filter(run.error, window, 3, deriv=d, delta=self.sample_time, axis=0) for d in range(3)
            )
            missing = inertia * (bend + INVERSION_LEAK * rate) + damping * (rate + INVERSION_LEAK * e)
            size = float(np.mean(missing**2))
            if not size < least:
                break
            best, least = drive, size
            shifted = [np.interp(time + ahead[j], time, missing[:, j]) for j in range(len(self.parts))]
            drive = drive + np.stack(shifted, axis=1)
        return best

    @staticmethod
    def _dead_time(part: StructuredJoint) -> float:
        """Time by which a command has to come earlier than its torque [s]."""
        delay = part.effects.get("input_delay", {}).get("delay", 0.0)
        lag = part.effects.get("amplifier_lag", {}).get("time_constant", 0.0)
        return delay + lag + part.nominal.get("electrical_time_constant", 0.0) + part.nominal.get("timing", 0.0)

    def to_json(self) -> str:
        """The model as text; `from_json` is its inverse to the last bit."""
        content = {
            "format": FORMAT,
            "model": "structured",
            "units": "input-equivalent: torques in units of the command; angles rad, lengths m, times s",
            "sample_time": self.sample_time,
            "coupling": None if self.coupling is None else asdict(self.coupling),
            "joints": [
                {
                    "joint": part.joint,
                    "input": part.input,
                    "position_unit": part.position_unit,
                    "nominal": dict(part.nominal),
                    "effects": {name: dict(values) for name, values in part.effects.items()},
                    "compensator": None if part.compensator is None else _network_dict(part.compensator),
                }
                for part in self.parts
            ],
        }
        return json.dumps(content, indent=1) + "\n"

    @staticmethod
    def from_json(text: str, vocabulary: Sequence[Effect] = ()) -> StructuredModel:
        """A model from its text. Raises MethodError when it is none or its format is newer."""
        content = json.loads(text)
        if content.get("model") != "structured" or content.get("format") != FORMAT:
            raise MethodError(
                f"this is no structured model of format {FORMAT}", remedy="Give an extended_model.json of a diagnosis"
            )
        parts = tuple(
            StructuredJoint(
                joint=item["joint"],
                input=item["input"],
                nominal=item["nominal"],
                effects=item["effects"],
                position_unit=item["position_unit"],
                compensator=None if item["compensator"] is None else _network(item["compensator"]),
            )
            for item in content["joints"]
        )
        pair = content["coupling"]
        coupling = None if pair is None else PlanarCoupling(**pair)
        return StructuredModel(parts, content["sample_time"], coupling, tuple(vocabulary))


def _network_dict(network: TwoLayerNetwork) -> dict[str, Any]:
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in asdict(network).items()}


def _network(content: Mapping[str, Any]) -> TwoLayerNetwork:
    arrays: dict[str, Any] = {
        name: np.array(value) if isinstance(value, list) else value for name, value in content.items()
    }
    return TwoLayerNetwork(**arrays)


class Session:
    """A simulation that can be interrupted: signals (T, n), states, and what has been simulated so far.

    error (T, n): target minus reading; with a target of zero the reading with its sign changed. motion (T, n, 3).
    """

    def __init__(
        self,
        model: StructuredModel,
        time: Array,
        command: Array,
        hold: Hold,
        near: Array,
        target: Array | None = None,
    ):
        n = len(model.parts)
        self.model, self.time, self.command, self.near = model, np.array(time), np.array(command, order="C"), near
        self.hold = np.full(n, 0 if hold == "zero_order" else 1, dtype=np.int64)
        pieces = self.command[:-1] if hold == "zero_order" else 0.5 * (self.command[:-1] + self.command[1:])
        self.cumulative = np.vstack([np.zeros((1, n)), np.cumsum(pieces, axis=0)])
        self.target = np.zeros((len(time), n)) if target is None else np.ascontiguousarray(target)
        networks = [part.compensator for part in model.parts]
        self.extra = np.zeros((len(time) if any(networks) else 0, n))
        self._advance = model.kernel.module.advance
        if any(networks):
            self._advance = partial(model.kernel.module.compensated, pack(networks))
        self.error, self.motion = np.zeros((len(time), n)), np.zeros((len(time), n, 3))
        self.states, self.bristles = np.zeros((n, STATES)), np.zeros(n)

    def begin(self, position: Array, velocity: Array, acceleration: Array | None = None) -> None:
        """Initial state: angle, velocity and acceleration (n,); the motor torque is the one that goes with them.

        Without an acceleration the motor torque is that of the steady state of the first command; at rest it is zero.
        """
        parameters = self.model.arrays[0]
        start = np.zeros((len(self.model.parts), len(BEGINNING)))
        start[:, 0], start[:, 1] = position, velocity
        if np.any(velocity) or (acceleration is not None and np.any(acceleration)):
            start[:, 2] = self.command[0] - parameters[:, NOMINAL.index("back_emf")] * velocity
            if acceleration is not None:
                start[:, 2] = self._torque(start, acceleration)
        self.model.kernel.module.begin(start, self.command[0], self.states, *self.model.arrays[:2])

    def _torque(self, start: Array, acceleration: Array) -> Array:
        """Motor torques (n,) under which the joints, in motion from `start`, accelerate as given; one Newton step.

        Below a winding's time constant a wrong torque costs ``T_e`` times the wrong acceleration in velocity. Joints
        without a winding have no such state.
        """
        parameters, switches, pair, rigid = self.model.arrays
        n, module = len(start), self.model.kernel.module
        if not np.any(parameters[:, NOMINAL.index("electrical_time_constant")]):
            return start[:, 2]
        parameters = module._resolved(parameters, INSTANT)
        present = np.zeros((n, 5), dtype=bool)
        for j in range(n):
            module._present(switches[j], present[j])
        sign, still = np.sign(start[:, 1]), np.zeros(n, dtype=bool)
        near = self.near[0] if len(self.near) else np.zeros((n, 3))

        def accelerations(torque: Array) -> Array:
            states, rates = np.zeros((2, n, STATES))
            begun = np.column_stack((start[:, :2], torque, start[:, 3:]))
            module.begin(begun, self.command[0], states, parameters, switches)
            module._rates(
                0.0, states, rates, np.zeros(n), self.command[0], near, sign, still, n, parameters, switches, present,
                pair, rigid, np.zeros((n, 2)), *np.zeros((4, n)), np.zeros((n, 2)), INSTANT,
            )  # fmt: skip
            return rates[:, 1]

        size = np.maximum(np.abs(start[:, 2]), 1e-3)
        guess = accelerations(start[:, 2])
        slopes = np.column_stack(
            [(accelerations(start[:, 2] + row) - guess) / size[k] for k, row in enumerate(np.diag(size))]
        )
        return start[:, 2] + np.linalg.lstsq(slopes, acceleration - guess, rcond=1e-9)[0]

    def advance(self, first: int, last: int, leak: float = 0.0) -> None:
        """Samples first..last-1; the states end up at sample last."""
        parameters, switches, pair, rigid = self.model.arrays
        self._advance(
            first, last, self.time, self.command, self.cumulative, self.hold, self.target, self.near, self.extra,
            self.states, self.bristles, parameters, switches, pair, rigid,
            leak, 0.0, self.model.substeps, self.error, self.motion,
        )  # fmt: skip


class StructuredSimulator:
    """An extended model as a robot behind its converters and encoders: an `envs.simulator.Simulator`.

    robot: the nominal robot (limits, converters, encoders). Brakes hold the joints that the model does not have.
    """

    CHUNK = 4096

    def __init__(self, model: StructuredModel, robot: Robot, *, sample_time: float | None = None):
        self.robot = robot
        self.sample_time = model.sample_time if sample_time is None else sample_time
        self._model = replace(model.unrecorded(), sample_time=self.sample_time)
        self._rows = [joint - 1 for joint in model.joints]
        self.held = tuple(number for number in range(1, len(robot) + 1) if number not in model.joints)
        self._position = np.full(len(robot), np.nan)
        self._session: Session | None = None
        self._at = 0

    def reset(self, position: Array, rng: np.random.Generator) -> Array:
        """At rest at `position`; the model has nothing random."""
        self._position = np.array(position, dtype=np.float64)
        self._session = self._new(self.CHUNK)
        self._session.begin(self._position[self._rows], np.zeros(len(self._rows)))
        self._at = 0
        return self._measure(self._session.target[0] + self._position[self._rows])

    def step(self, command: Array, periods: int = 1) -> Array:
        """Holds `command` for some servo periods. Raises MethodError before the first `reset`."""
        if self._session is None:
            raise MethodError("the simulator has no state", remedy="Call reset first")
        while self._at + periods + 1 >= len(self._session.time):
            self._grow()
        run, first, last = self._session, self._at, self._at + periods
        run.command[first : last + 1] = self.robot.quantise(np.asarray(command, dtype=np.float64))[self._rows]
        for k in range(first, last):
            run.cumulative[k + 1] = run.cumulative[k] + run.command[k]
        run.advance(first, last)
        self._at = last
        states, bristles = run.states.copy(), run.bristles.copy()
        run.advance(last, last + 1)  # only to read the sensors there
        run.states, run.bristles = states, bristles
        return self._measure(-run.error[last])

    def _measure(self, reading: Array) -> Array:
        self._position[self._rows] = reading
        return self.robot.measure(self._position)

    def _new(self, length: int) -> Session:
        time = self.sample_time * np.arange(length, dtype=float)
        return Session(self._model, time, np.zeros((length, len(self._rows))), "zero_order", self._none())

    def _none(self) -> Array:
        return np.zeros((0, len(self._rows), 3))

    def _grow(self) -> None:
        """A session twice as long with the same past."""
        assert self._session is not None
        old, past = self._session, self._at + 1
        new = self._new(2 * len(old.time))
        for name in ("command", "cumulative", "error", "motion"):
            getattr(new, name)[:past] = getattr(old, name)[:past]
        if len(old.extra):
            new.extra[:past] = old.extra[:past]
        new.states, new.bristles = old.states, old.bristles
        self._session = new
