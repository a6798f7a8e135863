"""The nouns that every contestant shares: Motion, Model, Method and Fit.

A `Method` is an immutable specification. `Method.fit(logs, rng)` returns a new `Fit`, whose `Model` answers the two
questions that are asked of a robot model: which command belongs to this motion (`inverse`), and which motion follows
from this command (`simulate`). A class is either abstract or final; a family of models has one primitive, from which
the family's base class derives both answers once (`methods.equation.EquationModel` is such a family).
"""

from __future__ import annotations

import abc
import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from envs.log import Array, Hold, InputKind, Log


class MethodError(ValueError):
    """A method cannot work with these logs, said in one line: what is wrong, what to do."""

    def __init__(self, problem: str, *, remedy: str):
        self.problem, self.remedy = problem, remedy
        super().__init__(f"{problem}. {remedy}")

    def __reduce__(self) -> tuple[Callable[[], MethodError], tuple[()]]:
        return partial(type(self), self.problem, remedy=self.remedy), ()  # survives the way between processes


@dataclass(frozen=True, eq=False)
class State:
    """Where a simulation starts: position, velocity and acceleration, each (n,) [rad or m, and per s, s^2]."""

    position: Array
    velocity: Array
    acceleration: Array

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "acceleration"):
            object.__setattr__(self, name, np.atleast_1d(np.asarray(getattr(self, name), dtype=np.float64)))

    @staticmethod
    def at_rest(position: Array | float) -> State:
        """Standing still at `position`, shape (n,) or a scalar for one joint."""
        place = np.atleast_1d(np.asarray(position, dtype=np.float64))
        return State(place, np.zeros_like(place), np.zeros_like(place))


@dataclass(frozen=True, eq=False)
class Motion:
    """A joint motion and its derivatives, each (T, n): [rad or m], [1/s], [1/s^2], [1/s^3]."""

    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "acceleration", "jerk"):
            array = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, array.reshape(len(array), -1))

    def __len__(self) -> int:
        return len(self.position)

    def state(self, row: int = 0) -> State:
        """The state at one sample."""
        return State(self.position[row], self.velocity[row], self.acceleration[row])

    def slice(self, start: int, stop: int | None = None) -> Motion:
        """Samples start..stop-1."""
        rows = slice(start, stop)
        return Motion(self.position[rows], self.velocity[rows], self.acceleration[rows], self.jerk[rows])


class Model(abc.ABC):
    """Nominal structure plus whatever a method added: the relation between command and motion of some joints.

    `joints` are the robot's joint numbers in the order of the columns; `inputs` says what kind of command each takes.
    """

    joints: tuple[int, ...]
    inputs: tuple[InputKind, ...]

    @abc.abstractmethod
    def inverse(self, time: Array, motion: Motion, command: Array | None = None) -> Array:
        """Command (T, n) that belongs to the motion, in the unit of the log's command.

        `time` is (T,) [s]. `command` (T, n) is the recorded command, needed only by models whose internal states
        (winding temperature, lag) depend on it; others ignore it. Entries that the model cannot answer are NaN.
        """

    @abc.abstractmethod
    def simulate(self, time: Array, command: Array, initial: State, hold: Hold = "zero_order") -> Motion:
        """Motion (T, n) that follows from the command (T, n) at the stamps `time` (T,) [s], from `initial` at time[0].

        With ``zero_order`` hold command[k] acts from time[k] to time[k+1]; with ``first_order`` it is interpolated.
        A diverging simulation ends in NaN from that sample on; it does not raise.
        """


class Status(enum.Enum):
    """How a fit ended. The value is the message for the user."""

    CONVERGED = "converged"
    ITERATION_LIMIT = "stopped at the iteration limit before the tolerance was reached"
    ILL_CONDITIONED = "the excitation does not separate the parameters: some estimates are arbitrary"
    FAILED = "failed"


@dataclass(frozen=True, eq=False)
class Estimates:
    """Named parameters (p,) with their units and covariance (p, p)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array

    def __post_init__(self) -> None:
        size = len(self.names)
        if len(self.units) != size or self.values.shape != (size,) or self.covariance.shape != (size, size):
            raise ValueError(
                f"estimates disagree in size: {size} names, {len(self.units)} units, values {self.values.shape}, "
                f"covariance {self.covariance.shape}"
            )

    @cached_property
    def standard_errors(self) -> Array:
        """Square roots of the covariance's diagonal, shape (p,)."""
        return np.sqrt(np.diag(self.covariance))

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.names.index(name)])

    def as_dict(self) -> Mapping[str, float]:
        """Name -> value."""
        return dict(zip(self.names, self.values.tolist(), strict=True))


@dataclass(frozen=True)
class Cause:
    """An effect that a method names as present: its canonical name, its joint, and names that cannot be told apart."""

    effect: str
    joint: int
    rivals: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Fit:
    """What a method found.

    `residuals` are recorded minus modelled command on the fitted samples, shape (N,), unit of the command.
    `learning_curve` is the mean squared error per pass over the data, shape (passes,), empty for closed-form methods.
    `notes` hold what the user has to know in plain sentences. `seconds` is wall time; it is no part of the result.
    `causes` are the named causes of methods that name any, None for all others; `verdict` is then one of ``none``,
    ``named``, ``ambiguous``, ``unknown``.
    """

    model: Model
    estimates: Estimates
    residuals: Array
    status: Status
    seconds: float
    learning_curve: Array = field(default_factory=lambda: np.empty(0))
    notes: tuple[str, ...] = ()
    causes: tuple[Cause, ...] | None = None
    verdict: str | None = None


class Method(abc.ABC):
    """An immutable specification of how to get from logs to a model. Subclasses are frozen dataclasses.

    The constructor stores arguments and nothing else; the `repr` is the key of the row in every table. A method knows
    logs and, where it says so, a robot's nominal description; it never knows the truth behind a synthetic log.

    `check_settings` are constructor arguments that make it quick enough for the conformance checks.
    """

    check_settings: ClassVar[Mapping[str, Any]] = {}

    @property
    def expected_failures(self) -> Mapping[str, str]:
        """Conformance checks (`methods.conformance`) that it fails by its nature: name of the check -> reason."""
        return {}

    @abc.abstractmethod
    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Identify from the logs. Inputs are not modified; the same generator state gives the same bits.

        Raises MethodError when the logs cannot be used (too short, wrong joints, constant signals).
        """


FEWEST_SAMPLES = 8
"""Fewer samples carry no third derivative."""


def single_joint(logs: Sequence[Log]) -> int:
    """The joint number of logs that all hold the same single joint, which moves in one of them at least.

    Raises MethodError otherwise, and for a log of fewer than `FEWEST_SAMPLES`.
    """
    if not logs:
        raise MethodError("there is no log to fit", remedy="Give at least one log")
    found = {log.joints for log in logs}
    if len(found) > 1 or len(logs[0].joints) != 1:
        shown = ", ".join(str(list(joints)) for joints in sorted(found))
        raise MethodError(
            f"this method identifies one joint at a time, but the logs hold joints {shown}",
            remedy="Reduce each log to the joint that moved: log.joint(number)",
        )
    for log in logs:
        if len(log) < FEWEST_SAMPLES:
            raise MethodError(
                f"{log.name} holds {len(log)} samples, too few to fit", remedy=f"Record {FEWEST_SAMPLES} at the least"
            )
    if not any(np.ptp(log.position) > 0.0 for log in logs):
        raise MethodError("the joint never moves in these logs", remedy="Give a log in which it does")
    return logs[0].joints[0]
