"""One immutable recording of a robot: time, command and measured signals per joint.

A `Log` is what the sensors and the command line of a robot gave, and nothing else. The truth of a
synthetic experiment never travels inside it.

File layout (CSV, Parquet or NPZ): ``t`` [s] and per joint j = 1..n ``v{j}`` command [V] (or ``i{j}``
[A], ``tau{j}`` [N m] or [N]), ``q{j}`` [rad or m], optionally ``dq{j}`` and ``temp{j}`` [deg C].
What columns cannot carry stands in the sidecar ``NAME.toml``; every entry has a default.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
InputKind = Literal["voltage", "current", "torque"]
Hold = Literal["zero_order", "first_order"]

COMMAND_PREFIX: dict[str, InputKind] = {"v": "voltage", "i": "current", "tau": "torque"}
PREFIX_OF: dict[InputKind, str] = {kind: prefix for prefix, kind in COMMAND_PREFIX.items()}
COMMAND_UNIT: dict[InputKind, str] = {"voltage": "V", "current": "A", "torque": "N m"}


class LogError(ValueError):
    """Unusable input, said in one line: which file, which column and row, what is wrong, what to do."""

    def __init__(
        self,
        problem: str,
        *,
        remedy: str,
        source: str | None = None,
        column: str | None = None,
        row: int | None = None,
    ):
        self.problem, self.remedy = problem, remedy
        self.source, self.column, self.row = source, column, row
        place = [part for part in (source, column and f"column {column}", row is not None and f"row {row}") if part]
        super().__init__(": ".join([", ".join(place), problem] if place else [problem]) + f". {remedy}")


@dataclass(frozen=True)
class JointFacts:
    """What the columns of one joint cannot say.

    encoder_step: resolution of q [rad or m]; None when unknown (estimated from the data where needed).
    command_step: resolution of the command [its unit]; None when unknown.
    command_limit: largest magnitude of the command that the amplifier accepts [its unit].
    hold: how the command acts between samples: ``zero_order`` (u[k] from t[k] to t[k+1]) or
        ``first_order`` (a measured, continuous signal).
    """

    input: InputKind = "voltage"
    position_unit: Literal["rad", "m"] = "rad"
    encoder_step: float | None = None
    command_step: float | None = None
    command_limit: float | None = None
    hold: Hold = "zero_order"

    @property
    def command_unit(self) -> str:
        """Unit of the command: V, A, N m, or N for the force on a joint that slides."""
        return "N" if (self.input, self.position_unit) == ("torque", "m") else COMMAND_UNIT[self.input]


@dataclass(frozen=True, eq=False)
class Log:
    """One recording. Shapes: time (T,), command and position (T, n), velocity and temperature (T, n) or None.

    `joints` are the robot's joint numbers, 1-based, in the order of the columns. Arrays are read-only.
    """

    time: Array
    command: Array
    position: Array
    joints: tuple[int, ...] = (1,)
    velocity: Array | None = None
    temperature: Array | None = None
    facts: tuple[JointFacts, ...] = ()
    robot: str | None = None
    loop: Literal["open", "closed"] | None = None
    name: str = "log"
    source: str | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        size = len(self.joints)
        for attribute in ("time", "command", "position", "velocity", "temperature"):
            value = getattr(self, attribute)
            if value is None:
                continue
            array = np.array(value, dtype=np.float64)
            if attribute != "time":
                array = array.reshape(len(array), -1 if array.size else size)
                if array.shape != (len(self.time), size):
                    raise LogError(
                        f"{attribute} has shape {array.shape}, expected {(len(self.time), size)}",
                        remedy="Give one row per time stamp and one column per joint",
                        source=self.source,
                    )
            array.flags.writeable = False
            object.__setattr__(self, attribute, array)
        if not self.facts:
            object.__setattr__(self, "facts", tuple(JointFacts() for _ in self.joints))
        if len(self.facts) != size:
            raise LogError(
                f"{len(self.facts)} joint facts for {size} joints",
                remedy="Give one table [joints.J] per joint of the log",
                source=self.source,
            )

    def __len__(self) -> int:
        return len(self.time)

    @property
    def duration(self) -> float:
        """Length of the recording [s]."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def sample_time(self) -> float:
        """Median interval between samples [s]."""
        return float(np.median(np.diff(self.time)))

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 over signals and facts: the identity of the recording, independent of its file format."""
        digest = hashlib.sha256()
        for array in (self.time, self.command, self.position, self.velocity, self.temperature):
            digest.update(b"-" if array is None else np.ascontiguousarray(array).tobytes())
        digest.update(repr((self.joints, self.facts, self.robot, self.loop)).encode())
        return digest.hexdigest()

    def index(self, joint: int) -> int:
        """Column of a joint number. Raises LogError when the log does not hold that joint."""
        try:
            return self.joints.index(joint)
        except ValueError:
            raise LogError(
                f"the log holds joints {list(self.joints)}, not joint {joint}",
                remedy="Choose one of these joints",
                source=self.source,
            ) from None

    def joint(self, joint: int) -> Log:
        """The same recording reduced to one joint."""
        return self.select((joint,))

    def select(self, joints: tuple[int, ...]) -> Log:
        """The same recording reduced to some joints, in the order given."""
        columns = [self.index(joint) for joint in joints]
        pick = lambda array: None if array is None else array[:, columns]  # noqa: E731
        return replace(
            self,
            command=self.command[:, columns],
            position=self.position[:, columns],
            velocity=pick(self.velocity),
            temperature=pick(self.temperature),
            joints=tuple(joints),
            facts=tuple(self.facts[column] for column in columns),
        )

    def slice(self, start: int, stop: int) -> Log:
        """Samples start..stop-1 as a log of their own; time keeps its origin."""
        pick = lambda array: None if array is None else array[start:stop]  # noqa: E731
        return replace(
            self,
            time=self.time[start:stop],
            command=self.command[start:stop],
            position=self.position[start:stop],
            velocity=pick(self.velocity),
            temperature=pick(self.temperature),
            name=f"{self.name}[{start}:{stop}]",
        )
