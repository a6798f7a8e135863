"""A robot as its builder describes it: nominal rigid body, one drive per joint, sensor facts.

Equations, for n joints with coordinates q [rad or m], motor currents i [A] and commands u [V, A or N m]::

    M(q) q'' + b(q, q') + F q' = A^T tau            b: Coriolis, centrifugal and gravity terms
    tau_j = N_j K_j i_j                             K: motor constant, N: gear ratio
    L_j i_j' + R_j i_j + N_j K_j (A q')_j = G_j u_j voltage-mode amplifier of gain G
    i_j = G_j u_j                                   current-mode amplifier
    tau_j = G_j u_j                                 torque-mode amplifier

`A` (`Robot.coupling`) says which joints turn the motor of joint j relative to its own stator; it is the identity
unless a motor sits on a link other than its joint's predecessor. Every number is a `Quantity`: it knows its unit,
where it comes from and how far it can be trusted.
"""

from __future__ import annotations

import hashlib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, Self, TypeGuard, TypeVar, get_args

import numpy as np

from envs.description_units import Units, drive_units, in_standard_unit, joint_units
from envs.log import Array, InputKind, JointFacts
from envs.units import UnitError

if TYPE_CHECKING:
    import mujoco

JointKind = Literal["revolute", "prismatic"]
T = TypeVar("T")


class RobotError(ValueError):
    """An unusable robot description, said in one line: where, what is wrong, what to do."""

    def __init__(self, problem: str, *, remedy: str, source: str | None = None):
        self.problem, self.remedy, self.source = problem, remedy, source
        super().__init__(f"{source + ': ' if source else ''}{problem}. {remedy}")


@dataclass(frozen=True)
class Quantity:
    """One number with its unit, its source or reason, and its uncertainty.

    uncertainty: relative and multiplicative; the true value lies in [value / (1 + u), value (1 + u)].
        0 means exact, 0.35 means within 35 %, 1 means within a factor of two.
    """

    value: float
    unit: str
    source: str
    uncertainty: float = 0.0

    def __post_init__(self) -> None:
        if math.isnan(self.value) or not 0.0 <= self.uncertainty < math.inf:
            raise RobotError(
                f"value {self.value} {self.unit} with uncertainty {self.uncertainty}",
                remedy="Give a number and a relative uncertainty of 0 or more",
            )

    def __float__(self) -> float:
        return self.value

    def sample(self, rng: np.random.Generator) -> Quantity:
        """A draw, log-uniform over the stated range. An exact quantity consumes no random number."""
        if self.uncertainty == 0.0:
            return self
        width = math.log1p(self.uncertainty)
        return replace(self, value=self.value * math.exp(rng.uniform(-width, width)))


def sample_fields(record: T, rng: np.random.Generator) -> T:
    """A copy of a dataclass with every `Quantity` field drawn, in the order of declaration."""
    drawn = {
        item.name: value.sample(rng)
        for item in fields(record)  # type: ignore[arg-type]
        if isinstance(value := getattr(record, item.name), Quantity)
    }
    return replace(record, **drawn)  # type: ignore[type-var]


ABSENT = "not part of this drive"
"""Source of a number that the description leaves out."""


def _absent(value: float, unit: str) -> Quantity:
    return Quantity(value, unit, ABSENT)


@dataclass(frozen=True)
class Drive:
    """Amplifier, motor and gear of one joint. Motor-side numbers act at the rotor, `viscous` at the joint.

    command: what the log's command column holds (`voltage`: V, `current`: A, `torque`: N m or N).
    amplifier: what the amplifier sets in proportion to the command: terminal voltage, motor current, joint torque.
    amplifier_gain: amplifier output per unit of command, 1 unless stated.
    gear_ratio: rotor angle per joint coordinate [1, or rad/m for a screw]; 1 for a direct drive.
    rotor_inertia: of a rotor that spins on its own axis; the joint feels gear_ratio^2 times as much. The rotor of a
        direct drive is bolted to its link: it belongs to the link's inertia and is 0 here.
    viscous: torque per joint velocity [N m s/rad or N s/m].
    voltage_limit, current_limit: what the amplifier can give at its terminals.
    command_limit, command_bits: range of the command (+-) and resolution of the converter; None: not quantised.
    """

    amplifier: InputKind
    amplifier_gain: Quantity = field(default_factory=lambda: _absent(1.0, ""))
    command: InputKind = "voltage"
    resistance: Quantity = field(default_factory=lambda: _absent(0.0, "ohm"))
    inductance: Quantity = field(default_factory=lambda: _absent(0.0, "H"))
    motor_constant: Quantity = field(default_factory=lambda: _absent(0.0, "N m/A"))
    gear_ratio: Quantity = field(default_factory=lambda: _absent(1.0, ""))
    rotor_inertia: Quantity = field(default_factory=lambda: _absent(0.0, "kg m^2"))
    viscous: Quantity = field(default_factory=lambda: _absent(0.0, "N m s/rad"))
    voltage_limit: Quantity = field(default_factory=lambda: _absent(math.inf, "V"))
    current_limit: Quantity = field(default_factory=lambda: _absent(math.inf, "A"))
    command_limit: Quantity = field(default_factory=lambda: _absent(math.inf, "V"))
    command_bits: int | None = None

    def __post_init__(self) -> None:
        for name in ("amplifier", "command"):
            _check_choice(name, getattr(self, name), get_args(InputKind))
        positive = {"voltage": ("resistance", "motor_constant"), "current": ("motor_constant",), "torque": ()}
        for name in ("amplifier_gain", "gear_ratio", *positive[self.amplifier], "voltage_limit", "current_limit"):
            _check_sign(name, getattr(self, name), strict=True)
        for name in ("inductance", "rotor_inertia", "viscous", "resistance"):
            _check_sign(name, getattr(self, name), strict=False)
        if self.command_bits is not None and not math.isfinite(self.command_limit.value):
            raise RobotError("command_bits without command_limit", remedy="Give the range of the converter")

    @property
    def torque_constant(self) -> float:
        """Joint torque per motor current [N m/A or N/A]; also terminal volts per joint velocity (SI, no losses)."""
        return self.motor_constant.value * self.gear_ratio.value

    @property
    def reflected_inertia(self) -> float:
        """What the joint feels of the rotor: gear_ratio^2 rotor_inertia [kg m^2 or kg]."""
        return self.rotor_inertia.value * self.gear_ratio.value**2

    @property
    def input_equivalent(self) -> float:
        """Command units per joint torque at standstill: R/(N K G), 1/(N K G) or 1/G by kind of amplifier."""
        if self.amplifier == "torque":
            return 1.0 / self.amplifier_gain.value
        per_current = 1.0 / (self.torque_constant * self.amplifier_gain.value)
        return per_current * self.resistance.value if self.amplifier == "voltage" else per_current

    @property
    def input_equivalent_uncertainty(self) -> float:
        """Uncertainty of `input_equivalent`, relative and multiplicative as that of a `Quantity`: all that is stated of
        the constants in it."""
        constants = {
            "torque": (self.amplifier_gain,),
            "current": (self.amplifier_gain, self.motor_constant, self.gear_ratio),
            "voltage": (self.amplifier_gain, self.motor_constant, self.gear_ratio, self.resistance),
        }
        return math.prod(1.0 + constant.uncertainty for constant in constants[self.amplifier]) - 1.0

    @property
    def command_step(self) -> float | None:
        """Resolution of the command [its unit]: 2 limit / 2^bits; None when the command is not quantised."""
        return None if self.command_bits is None else 2.0 * self.command_limit.value / 2**self.command_bits

    def sample(self, rng: np.random.Generator) -> Drive:
        """A draw within the stated uncertainties."""
        return sample_fields(self, rng)


@dataclass(frozen=True)
class Joint:
    """One joint: its kind, its range, its sensor and its drive. Coordinates in rad (revolute) or m (prismatic)."""

    name: str
    kind: JointKind
    drive: Drive
    lower: Quantity = field(default_factory=lambda: _absent(-math.inf, ""))
    upper: Quantity = field(default_factory=lambda: _absent(math.inf, ""))
    encoder_step: Quantity | None = None
    speed_limit: Quantity | None = None

    def __post_init__(self) -> None:
        _check_choice(f"kind of {self.name}", self.kind, get_args(JointKind))
        if not self.lower.value < self.upper.value:
            raise RobotError(
                f"{self.name} ranges from {self.lower.value} to {self.upper.value}", remedy="Give lower < upper"
            )

    @property
    def unit(self) -> Literal["rad", "m"]:
        """Unit of the coordinate."""
        return "rad" if self.kind == "revolute" else "m"

    @property
    def torque_unit(self) -> Literal["N m", "N"]:
        """Unit of the generalised force."""
        return "N m" if self.kind == "revolute" else "N"

    def sample(self, rng: np.random.Generator) -> Joint:
        """A draw within the stated uncertainties; limits and sensor facts are known and stay."""
        return replace(self, drive=self.drive.sample(rng))


class RigidBody(Protocol):
    """The arm without its drives. Leading dimensions of the arguments are batch dimensions."""

    def inertia_matrix(self, position: Array) -> Array:
        """M(q), shape (..., n, n) [kg m^2, kg m, kg], for position (..., n)."""
        ...

    def bias(self, position: Array, velocity: Array) -> Array:
        """b(q, q'): Coriolis, centrifugal and gravity terms, shape (..., n) [N m or N]."""
        ...

    def spec(self) -> mujoco.MjSpec:
        """The kinematic tree as an editable MuJoCo model without drives; joints carry the robot's joint names."""
        ...

    def sample(self, rng: np.random.Generator) -> Self:
        """A draw within the stated uncertainties."""
        ...


@dataclass(frozen=True)
class Robot:
    """Nominal rigid body plus one drive per joint and sensor facts. Joints are numbered from 1, as on the robot.

    coupling: A, shape (n, n), rows are motors: speed of motor j at its gear's output is row j of A times q'.
        None is the identity.
    """

    name: str
    body: RigidBody
    joints: tuple[Joint, ...]
    coupling: tuple[tuple[float, ...], ...] | None = None

    def __post_init__(self) -> None:
        names = [joint.name for joint in self.joints]
        if not names or len(set(names)) != len(names):
            raise RobotError(f"joint names {names}", remedy="Give at least one joint, each with its own name")
        if self.coupling is not None and np.shape(self.coupling) != (len(names), len(names)):
            raise RobotError(
                f"coupling of shape {np.shape(self.coupling)} for {len(names)} joints",
                remedy="Give n rows of n numbers",
            )

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def drives(self) -> tuple[Drive, ...]:
        """One drive per joint."""
        return tuple(joint.drive for joint in self.joints)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 over body, joints and coupling: the identity of the description, independent of its files."""
        content = self.body.spec().to_xml() + repr((self.joints, self.coupling))
        return hashlib.sha256(content.encode()).hexdigest()

    @property
    def coupling_matrix(self) -> Array:
        """A, shape (n, n)."""
        return np.eye(len(self)) if self.coupling is None else np.array(self.coupling, dtype=np.float64)

    def joint(self, number: int) -> Joint:
        """Joint by its number, 1..n. Raises RobotError for any other number."""
        if not 1 <= number <= len(self):
            raise RobotError(f"{self.name} has joints 1..{len(self)}, not {number}", remedy="Choose one of these")
        return self.joints[number - 1]

    def drive_values(self, name: str) -> Array:
        """One number of every drive by the name of the field or property, shape (n,)."""
        return np.array([float(getattr(drive, name)) for drive in self.drives])

    def input_equivalent(self, joint: int) -> float:
        """Command units per joint torque at standstill; R/(K N G) for a voltage-mode amplifier."""
        return self.joint(joint).drive.input_equivalent

    def facts(self, joint: int) -> JointFacts:
        """What a log of this joint has to know beside its columns."""
        item = self.joint(joint)
        limit = item.drive.command_limit.value
        return JointFacts(
            input=item.drive.command,
            position_unit=item.unit,
            encoder_step=None if item.encoder_step is None else item.encoder_step.value,
            command_step=item.drive.command_step,
            command_limit=limit if math.isfinite(limit) else None,
        )

    def quantise(self, command: Array) -> Array:
        """Commands, shape (..., n) [command units], as the converters pass them on: clipped and rounded to steps."""
        limit, step = self._command_limits, self._command_steps
        rounded = _round_to(step, np.clip(command, -limit, limit))
        return np.clip(rounded, -limit, limit - step)

    def measure(self, position: Array) -> Array:
        """Coordinates, shape (..., n) [rad or m], as the encoders give them: rounded to steps."""
        return _round_to(self._encoder_steps, np.asarray(position, dtype=np.float64))

    def inertia_matrix(self, position: Array) -> Array:
        """M(q) of arm and rotors, shape (..., n, n): the body's plus A^T diag(reflected inertia) A."""
        turns = self.coupling_matrix
        rotors = turns.T @ np.diag(self.drive_values("reflected_inertia")) @ turns
        return np.asarray(self.body.inertia_matrix(np.asarray(position)) + rotors)

    def inverse_dynamics(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        """M(q) q'' + b(q, q') + F q', shape (..., n): the joint torques that the motors have to give in sum."""
        inertial = np.einsum("...ij,...j->...i", self.inertia_matrix(position), np.asarray(acceleration))
        return inertial + self.body.bias(np.asarray(position), np.asarray(velocity)) + self._viscous(velocity)

    def forward_dynamics(self, position: Array, velocity: Array, torque: Array) -> Array:
        """q'' under joint torques, shape (..., n) [rad/s^2 or m/s^2]."""
        rest = np.asarray(torque) - self.body.bias(np.asarray(position), np.asarray(velocity)) - self._viscous(velocity)
        return np.asarray(np.linalg.solve(self.inertia_matrix(position), rest[..., None])[..., 0])

    def sample(self, rng: np.random.Generator) -> Robot:
        """A member of the parameter ensemble: every number drawn within its uncertainty."""
        return replace(self, body=self.body.sample(rng), joints=tuple(joint.sample(rng) for joint in self.joints))

    @cached_property
    def _command_limits(self) -> Array:
        return self.drive_values("command_limit")

    @cached_property
    def _command_steps(self) -> Array:
        return np.array([drive.command_step or 0.0 for drive in self.drives])

    @cached_property
    def _encoder_steps(self) -> Array:
        return np.array([0.0 if joint.encoder_step is None else joint.encoder_step.value for joint in self.joints])

    def _viscous(self, velocity: Array) -> Array:
        return self.drive_values("viscous") * np.asarray(velocity)


def _round_to(step: Array, value: Array) -> Array:
    """Rounds to multiples of `step`; a step of 0 leaves the value."""
    return np.where(step > 0.0, step * np.round(value / np.where(step > 0.0, step, 1.0)), value)


def load_robot(path: str | Path) -> Robot:
    """A robot from a TOML description.

    ``[body]`` holds either ``file = "arm.xml"`` (MJCF or URDF, relative to the TOML) or the links of a SCARA
    (``kind = "scara"``); each ``[[joint]]`` one joint of that body, in order, with its ``[joint.drive]``; ``[drive]``
    what all drives share. Without any ``[[joint]]`` they are those of the file, with its limits. A number is plain or a
    table ``{value, unit, source, uncertainty}``; ``[sources]`` gives long texts for short source names.

    Raises RobotError, in one line, for whatever makes the description unusable.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, IsADirectoryError):
        raise RobotError("no such file", remedy="Give the path of a robot description", source=str(path)) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RobotError(f"not a TOML file ({error})", remedy="docs/robots.md shows one", source=str(path)) from None
    try:
        return parse_robot(content, path.parent)
    except RobotError as error:
        raise RobotError(error.problem, remedy=error.remedy, source=error.source or str(path)) from None


def parse_robot(content: Mapping[str, Any], folder: Path) -> Robot:
    """A robot from the content of its description; `folder` is where a body's file is looked up."""
    sources, shared = content.get("sources", {}), content.get("drive", {})
    body = _need(content, "body")
    tables = content.get("joint") or _joints_of_file(body, folder)
    if not isinstance(tables, list):
        raise RobotError("joint is no list of tables", remedy="Head each joint by [[joint]]")
    joints = tuple(_parse_joint(table, number, shared, sources) for number, table in enumerate(tables, start=1))
    coupling = content.get("coupling")
    rigid_body = _parse_body(body, folder, tuple(joint.name for joint in joints), sources)
    if "file" in body and content.get("joint"):
        _check_kinds(joints, body, folder)
    return Robot(
        name=_need(content, "name"),
        body=rigid_body,
        joints=joints,
        coupling=None if coupling is None else tuple(tuple(float(item) for item in row) for row in coupling),
    )


def parse_record(kind: type[T], table: Mapping[str, Any], sources: Mapping[str, str], where: str, units: Units) -> T:
    """A dataclass from a table: numbers and tables become `Quantity` in SI, everything else is passed on.

    units: which ones each entry may be given in (see `envs.description_units`).
    """
    known = {item.name for item in fields(kind)}  # type: ignore[arg-type]
    if extra := sorted(set(table) - known):
        raise RobotError(f"{where} has the unknown entry {extra[0]}", remedy=f"Known are {', '.join(sorted(known))}")
    values = {
        name: _parse_value(value, sources, f"{where}.{name}", name, units.get(name, ()))
        for name, value in table.items()
    }
    try:
        return kind(**values)
    except RobotError as error:
        raise RobotError(f"{where}: {error.problem}", remedy=error.remedy) from None
    except TypeError as error:
        raise RobotError(f"{where} is incomplete ({error})", remedy="Add the entry") from None


_PLAIN: dict[str, type] = {
    "command_bits": int,
    "name": str,
    "kind": str,
    "amplifier": str,
    "command": str,
    "drive": Drive,
}
"""Entries that are no quantities, and their types."""


def _parse_value(value: Any, sources: Mapping[str, str], where: str, name: str, units: tuple[str, ...]) -> Any:
    if name in _PLAIN:
        if not isinstance(value, _PLAIN[name]):
            raise RobotError(f"{where} is {value!r}", remedy=f"Give a {_PLAIN[name].__name__}")
        return value
    table = value if isinstance(value, Mapping) else {"value": value}
    number = table.get("value")
    if set(table) - {"value", "unit", "source", "uncertainty"} or not _is_number(number):
        raise RobotError(f"{where} is {value!r}", remedy="Give a number, or value, unit, source and uncertainty")
    source = table.get("source", "not stated")
    uncertainty = table.get("uncertainty", 0.0)
    if not _is_number(uncertainty) or not 0.0 <= uncertainty < math.inf:
        raise RobotError(
            f"{where} has the uncertainty {uncertainty!r}", remedy="Give a share of the value, such as 0.1 for 10 %"
        )
    unit = table.get("unit", "")
    if not isinstance(unit, str):
        raise RobotError(f"{where} has the unit {unit!r}", remedy='Write it as a text, such as unit = "N m/A"')
    try:
        standard, unit = in_standard_unit(float(number), unit, units)
    except UnitError as error:
        choices = " or ".join(units)
        raise RobotError(f"{where}: {error}", remedy=f"Give it in {choices}, or in a unit that becomes one") from None
    return Quantity(standard, unit, sources.get(source, source), float(uncertainty))


def _is_number(value: Any) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _parse_joint(table: Mapping[str, Any], number: int, shared: Mapping[str, Any], sources: Mapping[str, str]) -> Joint:
    where, kind = f"joint {number}", table.get("kind")
    drive_table = {**shared, **table.get("drive", {})}
    drive = parse_record(Drive, drive_table, sources, f"{where}.drive", drive_units(drive_table, kind))
    return parse_record(Joint, {**table, "drive": drive}, sources, where, joint_units(kind))


def _joints_of_file(table: Mapping[str, Any], folder: Path) -> list[dict[str, Any]]:
    """What a body's file says of its joints: name, kind and limits. Raises RobotError where there is none."""
    if "file" not in table:
        raise RobotError("the description has no entry joint", remedy="docs/robots.md shows one")
    from envs.mjcf import joints_of_file

    path = folder / table["file"]
    found = joints_of_file(path)
    if not found:
        raise RobotError(
            "the body has no joint that moves", remedy="Give it a hinge or a slide, in MJCF or URDF", source=str(path)
        )
    return found


def _check_kinds(joints: tuple[Joint, ...], table: Mapping[str, Any], folder: Path) -> None:
    """Refuses a joint that turns in the body's file and slides in its own description, or the other way."""
    kinds = {item["name"]: item["kind"] for item in _joints_of_file(table, folder)}
    for joint in joints:
        if joint.kind != kinds[joint.name]:
            raise RobotError(
                f"joint {joint.name} is {joint.kind}, but {kinds[joint.name]} in {table['file']}",
                remedy="Correct one of them",
            )


def _parse_body(
    table: Mapping[str, Any], folder: Path, names: tuple[str, ...], sources: Mapping[str, str]
) -> RigidBody:
    if table.get("kind") == "scara":
        from envs.scara import parse_scara

        return parse_scara({name: item for name, item in table.items() if name != "kind"}, sources)
    if "file" in table:
        from envs.mjcf import DescribedBody

        return DescribedBody(str(folder / table["file"]), names)
    raise RobotError("the body has neither a file nor a known kind", remedy='Give file = "arm.xml" or kind = "scara"')


def _need(table: Mapping[str, Any], name: str, where: str = "the description") -> Any:
    if name not in table:
        raise RobotError(f"{where} has no entry {name}", remedy="docs/robots.md shows one")
    return table[name]


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise RobotError(f"{name} is {value!r}", remedy=f"Choose one of {', '.join(choices)}")


def _check_sign(name: str, quantity: Quantity, *, strict: bool) -> None:
    if strict and quantity.value == 0.0 and quantity.source == ABSENT:
        raise RobotError(f"{name} is missing", remedy="Add the entry: this kind of amplifier needs it")
    if quantity.value < 0.0 or (strict and quantity.value == 0.0):
        raise RobotError(
            f"{name} is {quantity.value} {quantity.unit}".rstrip(),
            remedy=f"Give a {'positive' if strict else 'non-negative'} number",
        )
