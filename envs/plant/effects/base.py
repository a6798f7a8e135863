"""What a hidden effect is: a name of the project's vocabulary, its stage, its parameters and its physics.

An effect is a frozen dataclass. Its `install` method writes it into a plant under construction (`Build`): as MuJoCo's
own physics where MuJoCo has it, else as entries of the tables that the compiled loop reads in every evaluation of the
equations of motion. Torques of all effects stand on the left of the equation of motion, beside friction and gravity:
a positive one resists positive motion.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

from envs.text_form import TextFormError, choose, read_number, split_assignments, write_assignments

if TYPE_CHECKING:
    from envs.log import InputKind
    from envs.plant.build import Build
    from envs.robot import JointKind, Robot

Stage = Literal["amplifier", "motor", "transmission", "arm", "sensor"]

UNITS: dict[str, tuple[str, str]] = {
    "torque": ("N m", "N"),
    "viscous": ("N m s/rad", "N s/m"),
    "drag": ("N m s^2/rad^2", "N s^2/m^2"),
    "stiffness": ("N m/rad", "N/m"),
    "inertia": ("kg m^2", "kg"),
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "cycles": ("1/rev", "2 pi/m"),
    "time": ("s", "s"),
    "frequency": ("Hz", "Hz"),
    "angle": ("rad", "rad"),
    "ratio": ("1", "1"),
    "current": ("A", "A"),
    "1/current": ("1/A", "1/A"),
    "1/current^2": ("1/A^2", "1/A^2"),
    "coupling": ("N m per unit of the signal", "N per unit of the signal"),
}
"""SI unit of a dimension on a revolute and on a prismatic joint."""

_COMMAND_UNITS: dict[InputKind, str] = {"voltage": "V", "current": "A", "torque": "N m"}


class EffectError(ValueError):
    """An unusable effect, said in one line: which, what is wrong, what to do."""


def parameter(
    dimension: str,
    *,
    default: Any = MISSING,
    lower: float = -math.inf,
    upper: float = math.inf,
    choices: tuple[str, ...] = (),
) -> Any:
    """A dataclass field for one parameter: dimension (a key of `UNITS`, ``command``, ``word`` or ``joint``), bounds."""
    metadata = {"dimension": dimension, "lower": lower, "upper": upper, "choices": choices}
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """One effect on one joint. Parameters are the fields made by `parameter`; the first one is the primary one.

    `None` as a parameter's default means that the plant derives it from the robot; the truth states the number.
    Raises EffectError for a value outside its bounds.
    """

    name: ClassVar[str]
    stage: ClassVar[Stage]
    repeatable: ClassVar[bool] = False
    """Whether one joint may have the effect more than once."""

    joint: int = 1

    def __post_init__(self) -> None:
        if self.joint < 1:
            raise EffectError(f"{self.name}: joint is {self.joint}. Joints are numbered from 1")
        for item in self.parameters():
            _check(self.name, item, getattr(self, item.name))

    @classmethod
    def parameters(cls) -> Iterator[Field[Any]]:
        """The fields that are parameters, in order."""
        return (item for item in fields(cls) if "dimension" in item.metadata)

    @abstractmethod
    def install(self, build: Build) -> None:
        """Writes the effect into a plant under construction. Raises EffectError where the joint cannot have it."""

    def alter(self, robot: Robot) -> Robot:
        """The robot as this effect has it, for effects that are other numbers of the same robot."""
        return robot

    @property
    def text(self) -> str:
        """The text form that `parse_effect` reads."""
        values = {item.name: getattr(self, item.name) for item in self.parameters()}
        given = {name: value for name, value in values.items() if value is not None}
        return f"{self.name}@{self.joint}={write_assignments(given, ':')}"

    def describe(self, robot: Robot) -> dict[str, Any]:
        """Name, stage, joint and parameters with their units on this robot, for the truth."""
        joint = robot.joint(self.joint)
        return {
            "name": self.name,
            "stage": self.stage,
            "joint": self.joint,
            "parameters": {
                item.name: {
                    "value": getattr(self, item.name),
                    "unit": unit_of(item.metadata["dimension"], joint.kind, joint.drive.command),
                }
                for item in self.parameters()
            },
        }


def unit_of(dimension: str, kind: JointKind, command: InputKind) -> str:
    """SI unit of a parameter's dimension by the joint's kind and the unit of its command."""
    if dimension == "command":
        return _COMMAND_UNITS[command]
    return UNITS.get(dimension, ("", ""))[kind == "prismatic"]


EFFECTS: dict[str, type[Effect]] = {}
"""Every effect that can be hidden, by its name."""

Kind = TypeVar("Kind", bound=type[Effect])


def effect(name: str, stage: Stage, *, repeatable: bool = False) -> Callable[[Kind], Kind]:
    """Class decorator: makes an effect known under its name; refuses duplicates."""

    def add(kind: Kind) -> Kind:
        if name in EFFECTS:
            raise EffectError(f"effect {name} exists already. Choose another name")
        kind.name, kind.stage, kind.repeatable = name, stage, repeatable
        EFFECTS[name] = kind
        return kind

    return add


def parse_effect(text: str, *, joint: int = 1) -> Effect:
    """An effect from its text form.

    ``coulomb_friction=7.0`` sets the primary parameter, ``stribeck_friction=torque:5,static_torque:8,velocity:0.05``
    several, ``coulomb_friction@2=3.0`` chooses joint 2; without ``@`` it is `joint`.
    Raises EffectError, in one line, for an unknown name or parameter and for values outside their bounds.
    """
    head, given, values = (part.strip() for part in text.partition("="))
    name, at, number = (part.strip() for part in head.partition("@"))
    try:
        kind = EFFECTS[choose(name, EFFECTS, "effect")]
        known = {item.name: item for item in kind.parameters()}
        primary = next(iter(known))
        if given and ":" not in values and "," not in values:
            values = f"{primary}:{values}"
        assignments = split_assignments(values, ":") if given else {}
        for key in assignments:
            choose(key, known, f"parameter of {name}")
        if at:
            joint = _whole(number, "the joint after @")
        missing = [key for key, item in known.items() if item.default is MISSING and key not in assignments]
        if missing:
            forms = ",".join(f"{key}:..." for key in missing)
            raise TextFormError(f"{name} needs {' and '.join(missing)}. Write {name}={forms}")
        return kind(joint=joint, **{key: _read(value, known[key]) for key, value in assignments.items()})
    except (TextFormError, EffectError) as error:
        raise EffectError(f"effect {text!r}: {error}") from None


def _read(text: str, item: Field[Any]) -> Any:
    if item.metadata["dimension"] == "word":
        return choose(text, item.metadata["choices"], f"value of {item.name}")
    if item.metadata["dimension"] == "joint":
        return _whole(text, item.name)
    return read_number(text, item.name)


def _whole(text: str, name: str) -> int:
    if not text.isdigit():
        raise TextFormError(f"{name} is {text!r}. Write a joint number such as 2")
    return int(text)


def _check(name: str, item: Field[Any], value: Any) -> None:
    dimension, choices = item.metadata["dimension"], item.metadata["choices"]
    if value is None and item.default is None:
        return
    if dimension == "word":
        if value not in choices:
            raise EffectError(f"{name}: {item.name} is {value!r}. Choose one of {', '.join(choices)}")
        return
    lower, upper = item.metadata["lower"], item.metadata["upper"]
    if not (isinstance(value, int | float) and math.isfinite(value) and lower <= value <= upper):
        raise EffectError(f"{name}: {item.name} is {value}. Give a number in [{lower:g}, {upper:g}]")
