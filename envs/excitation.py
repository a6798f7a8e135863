"""Excitations: the command, or the reference of a position servo, that an experiment applies to some joints.

An excitation is a value. `sample` turns it into numbers for given instants; what is random in it comes from the
generator handed in. Amplitudes are in the unit of what is excited: command units (V, A, N m) in open loop, rad or m
as the reference of a servo. Values count from the pose in which the experiment starts and from the command that holds
the robot there. A number may be given once for all joints or as a tuple, one entry per joint.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np
import scipy.fft
import scipy.signal

from envs.log import Array
from envs.text_form import (
    TextFormError,
    choose,
    read_list,
    read_number,
    read_range,
    split_assignments,
    write_assignments,
)

if TYPE_CHECKING:
    from envs.robot import Robot

PerJoint = float | tuple[float, ...]


class ExcitationError(ValueError):
    """An unusable excitation, said in one line: which, what is wrong, what to do."""


REGISTRY: dict[str, type[Excitation]] = {}
"""Every excitation by the name of its text form."""

Kind = TypeVar("Kind", bound="type[Excitation]")


def register(name: str) -> Callable[[Kind], Kind]:
    """Class decorator: makes an excitation known under `name`; refuses duplicates."""

    def add(kind: Kind) -> Kind:
        if name in REGISTRY:
            raise ExcitationError(f"excitation {name} exists already. Choose another name")
        REGISTRY[name] = kind
        return kind

    return add


@dataclass(frozen=True, kw_only=True)
class Excitation(ABC):
    """What an experiment applies. `joints` are the excited joints, 1-based; the columns of `sample` follow them."""

    joints: tuple[int, ...] = (1,)

    def __post_init__(self) -> None:
        if not self.joints or len(set(self.joints)) != len(self.joints) or min(self.joints) < 1:
            raise ExcitationError(f"joints are {self.joints}. Give different joint numbers from 1 on")
        for name in self._positive:
            if not all(0.0 < value < math.inf for value in self.per_joint(name)):
                raise ExcitationError(f"{name} is {getattr(self, name)}. Give a positive number")
        if "band" in {item.name for item in fields(self)} and not 0.0 < self.band[0] < self.band[1]:  # type: ignore[attr-defined]
            raise ExcitationError(f"band is {self.band}. Give 0 < low < high [Hz]")  # type: ignore[attr-defined]

    _positive: ClassVar[tuple[str, ...]] = ()
    """Names of the fields that have to be positive."""

    @abstractmethod
    def sample(self, time: Array, rng: np.random.Generator) -> Array:
        """Values at the instants `time` (T,) [s], shape (T, n), one column per entry of `joints`."""

    def fitted(self, robot: Robot, pose: Array) -> Excitation:
        """The excitation as it is on a robot that starts at `pose` (n,), for excitations that have to know."""
        return self

    def per_joint(self, name: str) -> Array:
        """A field as one number per joint, shape (n,). Raises ExcitationError when the count does not fit."""
        value = getattr(self, name)
        if isinstance(value, tuple) and len(value) != len(self.joints):
            raise ExcitationError(f"{name} has {len(value)} entries for {len(self.joints)} joints. Give one or all")
        return np.broadcast_to(np.asarray(value, dtype=np.float64), (len(self.joints),))

    @property
    def text(self) -> str:
        """The text form that `parse` reads; fields at their default are left out."""
        name = next(key for key, kind in REGISTRY.items() if kind is type(self))
        changed = {
            item.name: getattr(self, item.name)
            for item in fields(self)
            if item.name != "robot" and getattr(self, item.name) != item.default
        }
        values = {key: f"{value[0]:.12g}-{value[1]:.12g}" if key == "band" else value for key, value in changed.items()}
        return f"{name}:{write_assignments(values, '=')}" if values else name


@dataclass(frozen=True, kw_only=True)
class ScaledExcitation(Excitation):
    """offset + amplitude * shape(t), where the shape stays within +-1."""

    amplitude: PerJoint = 1.0
    offset: PerJoint = 0.0

    def sample(self, time: Array, rng: np.random.Generator) -> Array:
        """Values at the instants `time` (T,) [s], shape (T, n)."""
        return self.per_joint("offset") + self.per_joint("amplitude") * self.shape(time, rng)

    @abstractmethod
    def shape(self, time: Array, rng: np.random.Generator) -> Array:
        """The excitation of amplitude 1, shape (T, n)."""


@register("sine")
@dataclass(frozen=True, kw_only=True)
class Sine(ScaledExcitation):
    """sin(2 pi frequency t + phase), the paper's excitation. Frequency in Hz, phase in rad."""

    frequency: PerJoint = 0.5
    phase: PerJoint = 0.0
    _positive: ClassVar[tuple[str, ...]] = ("frequency",)

    def shape(self, time: Array, rng: np.random.Generator) -> Array:
        """The sine, shape (T, n)."""
        return np.sin(2.0 * np.pi * time[:, None] * self.per_joint("frequency") + self.per_joint("phase"))


@register("multisine")
@dataclass(frozen=True, kw_only=True)
class Multisine(ScaledExcitation):
    """Harmonics of 1/period within `band` [Hz], of equal amplitude, phases chosen for a low crest factor.

    The peak over one period is `amplitude`. Several joints get interleaved harmonics and are orthogonal over a period.

    crest_factor: peak over rms that is good enough; None takes the lowest that the search finds (about 1.5).
    Source of the search: E. van der Ouderaa et al., "Peak factor minimization using a time-frequency domain swapping
    algorithm", IEEE Trans. Instrum. Meas. 37 (1988) 145-147.
    """

    band: tuple[float, float] = (0.1, 8.0)
    period: float = 10.0
    crest_factor: float | None = None
    _positive: ClassVar[tuple[str, ...]] = ("period",)

    def harmonics(self) -> list[np.ndarray]:
        """Harmonic numbers per joint. Raises ExcitationError when a joint would get none."""
        first, last = math.ceil(self.band[0] * self.period - 1e-9), math.floor(self.band[1] * self.period + 1e-9)
        count = len(self.joints)
        numbers = [np.arange(first + column, last + 1, count) for column in range(count)]
        if any(len(own) == 0 for own in numbers):
            raise ExcitationError(
                f"band {self.band} Hz holds {max(0, last - first + 1)} harmonics of period {self.period} s for "
                f"{count} joints. Widen the band or lengthen the period"
            )
        return numbers

    def shape(self, time: Array, rng: np.random.Generator) -> Array:
        """The multisine of peak 1, shape (T, n)."""
        columns = []
        for numbers in self.harmonics():
            phases = low_crest_phases(numbers, rng, self.crest_factor)
            angles = 2.0 * np.pi * numbers * time[:, None] / self.period + phases
            columns.append(np.cos(angles).sum(axis=1) / _peak(numbers, phases))
        return np.stack(columns, axis=1)


def low_crest_phases(harmonics: np.ndarray, rng: np.random.Generator, crest_factor: float | None = None) -> Array:
    """Phases [rad], shape (H,), of equal cosines at `harmonics` with a low ratio of peak to rms.

    Starts at random phases; clips the signal, keeps the spectrum's phases and repeats. Stops at `crest_factor`.
    Raises ExcitationError when that is not reached.
    """
    size = _grid_size(harmonics)
    best_phases, best = np.zeros(len(harmonics)), math.inf
    for _ in range(4):
        phases = rng.uniform(-np.pi, np.pi, len(harmonics))
        for iteration in range(150):
            signal = _periodic(harmonics, phases, size)
            crest = np.abs(signal).max() / np.sqrt(np.mean(signal**2))
            if crest < best:
                best_phases, best = phases, crest
            if crest_factor is not None and best <= crest_factor:
                return best_phases
            level = (0.75 + 0.2 * iteration / 150) * np.abs(signal).max()
            phases = np.angle(scipy.fft.rfft(np.clip(signal, -level, level))[harmonics])
    if crest_factor is not None:
        raise ExcitationError(
            f"crest factor {crest_factor} not reached, lowest found is {best:.3g}. Ask for more or widen the band"
        )
    return best_phases


def _grid_size(harmonics: np.ndarray) -> int:
    return 2 ** math.ceil(math.log2(16 * int(harmonics[-1]) + 1))


def _periodic(harmonics: np.ndarray, phases: Array, size: int) -> Array:
    spectrum = np.zeros(size // 2 + 1, dtype=complex)
    spectrum[harmonics] = np.exp(1j * phases)
    return scipy.fft.irfft(spectrum, size) * size / 2


def _peak(harmonics: np.ndarray, phases: Array) -> float:
    return float(np.abs(_periodic(harmonics, phases, 16 * _grid_size(harmonics))).max())


@register("fourier_series")
@dataclass(frozen=True, kw_only=True)
class FourierSeries(Excitation):
    """Finite Fourier series of the joint positions that keeps position, velocity and command limits.

    q(t) = centre + s w(t) sum_k a_k sin(k w_f t) + b_k cos(k w_f t), w_f = 2 pi / period, k = 1..harmonics, with
    random coefficients a, b of falling size 1/k and a fade-in w of `fade` seconds with three continuous derivatives,
    so that it starts at rest. The largest scale s is taken at which the robot's nominal response (rigid body, viscous
    friction, windings; `Robot` holds the equations) respects every limit. Joints that are not excited stand still at
    `pose`.

    output: ``command`` gives the nominal command of this motion beyond the one that holds the pose, ``position`` the
        displacement (for a servo).
    position, velocity, command: limits as distance from the centre, speed and command magnitude per joint.
    Source: J. Swevers et al., "Optimal robot excitation and identification", IEEE Trans. Robot. Autom. 13 (1997).
    """

    robot: Robot | None = None
    harmonics: int = 5
    period: float = 10.0
    position: PerJoint = 1.0
    velocity: PerJoint = 2.0
    command: PerJoint = 5.0
    pose: tuple[float, ...] = ()
    fade: float = 1.0
    output: Literal["command", "position"] = "command"
    _positive: ClassVar[tuple[str, ...]] = ("harmonics", "period", "position", "velocity", "command", "fade")

    def sample(self, time: Array, rng: np.random.Generator) -> Array:
        """Command or position at the instants `time` (T,) [s], shape (T, n). Raises ExcitationError without a robot."""
        robot = self._robot()
        derivatives = self._series(time, rng)
        scale = min(
            float(np.min(self.per_joint("position") / _largest(derivatives[0]))),
            float(np.min(self.per_joint("velocity") / _largest(derivatives[1]))),
        )
        limit = self.per_joint("command")
        pose = self._pose(robot)
        respects = lambda s: bool(np.all(_largest(self._command(robot, pose, time, derivatives, s)) <= limit))  # noqa: E731
        if not respects(0.0):
            raise ExcitationError(f"holding the pose needs more command than {limit}. Raise the command limit")
        if not respects(scale):
            scale = _largest_true(respects, scale)
        if self.output == "position":
            return scale * derivatives[0]
        held = self._command(robot, pose, time, derivatives, 0.0)
        return self._command(robot, pose, time, derivatives, scale) - held

    def fitted(self, robot: Robot, pose: Array) -> FourierSeries:
        """With this robot and pose where none is given yet."""
        return replace(self, robot=self.robot or robot, pose=self.pose or tuple(float(angle) for angle in pose))

    def _robot(self) -> Robot:
        if self.robot is None:
            raise ExcitationError("fourier_series has no robot. Give the robot whose nominal response sets the limits")
        for joint in self.joints:
            self.robot.joint(joint)
        return self.robot

    def _pose(self, robot: Robot) -> Array:
        if self.pose and len(self.pose) != len(robot):
            raise ExcitationError(f"pose has {len(self.pose)} entries for {len(robot)} joints. Give one per joint")
        return np.array(self.pose) if self.pose else np.zeros(len(robot))

    def _series(self, time: Array, rng: np.random.Generator) -> list[Array]:
        """Unscaled displacement and its first three derivatives, each (T, n)."""
        orders = np.arange(1, self.harmonics + 1)
        size = (len(orders), len(self.joints))
        sines, cosines = rng.normal(size=size) / orders[:, None], rng.normal(size=size) / orders[:, None]
        rate = 2.0 * np.pi / self.period
        elapsed = time - time[0]
        angles = rate * elapsed[:, None] * orders
        periodic = []
        for order in range(4):
            turn = order * np.pi / 2.0
            factor = (rate * orders[:, None]) ** order
            periodic.append(np.sin(angles + turn) @ (factor * sines) + np.cos(angles + turn) @ (factor * cosines))
        window = _smooth_step(elapsed / self.fade, 1.0 / self.fade)
        faded = [np.zeros_like(periodic[0]) for _ in range(4)]
        for order in range(4):
            for k in range(order + 1):
                faded[order] += math.comb(order, k) * window[k][:, None] * periodic[order - k]
        return faded

    def _command(self, robot: Robot, pose: Array, time: Array, derivatives: list[Array], scale: float) -> Array:
        """Nominal command of the scaled motion, shape (T, n): the robot's equations solved for the input."""
        columns = [joint - 1 for joint in self.joints]
        full = [np.zeros((len(time), len(robot))) for _ in derivatives]
        full[0] += pose
        for whole, part in zip(full, derivatives, strict=True):
            whole[:, columns] += scale * part
        torque = np.linalg.solve(robot.coupling_matrix.T, robot.inverse_dynamics(*full[:3]).T).T
        command = np.empty_like(torque)
        for column, drive in enumerate(robot.drives):
            output = torque[:, column]
            if drive.amplifier != "torque":
                output = output / drive.torque_constant
            if drive.amplifier == "voltage":
                slope = np.gradient(output, time, edge_order=2)
                speed = full[1] @ robot.coupling_matrix[column]
                resistive = drive.resistance.value * output
                output = drive.inductance.value * slope + resistive + drive.torque_constant * speed
            command[:, column] = output / drive.amplifier_gain.value
        return command[:, columns]


def _largest(values: Array) -> Array:
    """Largest magnitude per column, at least a tiny number so that it can divide."""
    return np.maximum(np.abs(values).max(axis=0), 1e-300)


def _largest_true(condition: Any, upper: float) -> float:
    """Largest argument in [0, upper] for which a condition that holds at 0 and fails at `upper` holds (bisection)."""
    lower = 0.0
    for _ in range(30):
        middle = 0.5 * (lower + upper)
        lower, upper = (middle, upper) if condition(middle) else (lower, middle)
    return lower


def _smooth_step(x: Array, rate: float) -> list[Array]:
    """Polynomial step from 0 to 1 on [0, 1] with three continuous derivatives, and those derivatives over time."""
    step: Array = np.array([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])
    inside = np.clip(x, 0.0, 1.0)
    values = []
    for order in range(4):
        derivative = np.polynomial.polynomial.polyder(step, order)
        values.append(np.asarray(np.polynomial.polynomial.polyval(inside, derivative) * rate**order))
    return values


@register("chirp")
@dataclass(frozen=True, kw_only=True)
class Chirp(ScaledExcitation):
    """A sine whose frequency runs through `band` [Hz] once, over the length of the record or `sweep_time` [s].

    law: ``logarithmic`` spends equal time per octave, ``linear`` per hertz. Afterwards the sweep starts anew.
    """

    band: tuple[float, float] = (0.1, 20.0)
    sweep_time: float | None = None
    law: Literal["logarithmic", "linear"] = "logarithmic"

    def shape(self, time: Array, rng: np.random.Generator) -> Array:
        """The chirp, the same on every joint, shape (T, n)."""
        elapsed = time - time[0]
        length = self.sweep_time if self.sweep_time is not None else max(float(elapsed[-1]), 1e-9)
        within = np.where(elapsed > length, elapsed % length, elapsed)
        wave = scipy.signal.chirp(within, self.band[0], length, self.band[1], method=self.law, phi=-90.0)
        return np.repeat(wave[:, None], len(self.joints), axis=1)


@register("prbs")
@dataclass(frozen=True, kw_only=True)
class PRBS(ScaledExcitation):
    """Pseudo-random binary sequence of maximum length 2^order - 1, each bit lasting `bit_time` [s].

    Starts at a random place; several joints get the sequence shifted by equal parts of its length.
    """

    order: int = 10
    bit_time: float = 0.05
    _positive: ClassVar[tuple[str, ...]] = ("bit_time",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 2 <= self.order <= 32:
            raise ExcitationError(f"order is {self.order}. Give a number of bits from 2 to 32")

    def shape(self, time: Array, rng: np.random.Generator) -> Array:
        """The sequence of +-1, shape (T, n)."""
        length = 2**self.order - 1
        start = int(rng.integers(length))
        bits = np.floor((time - time[0]) / self.bit_time + 1e-9).astype(int)
        sequence = 2.0 * scipy.signal.max_len_seq(self.order, length=min(length, 2**20))[0] - 1.0
        shifts = start + np.arange(len(self.joints)) * (length // len(self.joints))
        return sequence[(bits[:, None] + shifts) % len(sequence)]


@register("triangular_sweep")
@dataclass(frozen=True, kw_only=True)
class TriangularSweep(ScaledExcitation):
    """A slow triangular wave from 0 up to 1, down to -1 and back, of the given period [s]: friction and dead zones."""

    period: float = 20.0
    _positive: ClassVar[tuple[str, ...]] = ("period",)

    def shape(self, time: Array, rng: np.random.Generator) -> Array:
        """The triangle, the same on every joint, shape (T, n)."""
        wave = scipy.signal.sawtooth(2.0 * np.pi * ((time - time[0]) / self.period + 0.25), width=0.5)
        return np.repeat(wave[:, None], len(self.joints), axis=1)


@register("steps")
@dataclass(frozen=True, kw_only=True)
class Steps(ScaledExcitation):
    """Levels held for `dwell` [s]: the given ones in turn, or random ones, uniform in [-1, 1] and new for each joint.

    levels: fractions of the amplitude; empty for random ones.
    """

    dwell: float = 1.0
    levels: tuple[float, ...] = ()
    _positive: ClassVar[tuple[str, ...]] = ("dwell",)

    def shape(self, time: Array, rng: np.random.Generator) -> Array:
        """The steps, shape (T, n)."""
        number = np.floor((time - time[0]) / self.dwell + 1e-9).astype(int)
        if self.levels:
            held = np.array(self.levels)[number % len(self.levels)]
            return np.repeat(held[:, None], len(self.joints), axis=1)
        return rng.uniform(-1.0, 1.0, (int(number[-1]) + 1, len(self.joints)))[number]


_INTEGERS = ("order", "harmonics")
_WORDS = ("law", "output")
_LISTS = ("levels", "pose")


def parse(text: str, *, robot: Robot | None = None, joints: tuple[int, ...] | None = None) -> Excitation:
    """An excitation from its text form, such as ``multisine:amplitude=2,band=0.1-8,joints=1+2``.

    robot: passed on to the excitations that need one. joints: the excited joints where the text names none.
    Raises ExcitationError, in one line, for an unknown name or field and for values that do not fit.
    """
    name, _, rest = text.strip().partition(":")
    try:
        kind = REGISTRY[choose(name.strip(), REGISTRY, "excitation")]
        assignments = split_assignments(rest, "=") if rest.strip() else {}
        known = {item.name for item in fields(kind)} - {"robot"}
        values: dict[str, Any] = {
            choose(field, known, f"field of {name}"): _read(value, field) for field, value in assignments.items()
        }
    except TextFormError as error:
        raise ExcitationError(f"excitation {text!r}: {error}") from None
    if joints is not None:
        values.setdefault("joints", joints)
    if any(item.name == "robot" for item in fields(kind)):
        values["robot"] = robot
    try:
        return kind(**values)
    except ExcitationError as error:
        raise ExcitationError(f"excitation {text!r}: {error}") from None


def _read(text: str, name: str) -> Any:
    if name == "band":
        return read_range(text, name)
    if name in _WORDS:
        words = {"law": ("logarithmic", "linear"), "output": ("command", "position")}[name]
        return choose(text, words, f"value of {name}")
    numbers = read_list(text, name)
    if name == "joints":
        return tuple(_integer(number, name) for number in numbers)
    if name in _INTEGERS:
        return _integer(read_number(text, name), name)
    return numbers if len(numbers) > 1 or name in _LISTS else numbers[0]


def _integer(number: float, name: str) -> int:
    if number != int(number):
        raise TextFormError(f"{name} is {number:g}. Write a whole number")
    return int(number)
