"""What a task is: logs to learn from, held-out logs, limits, and what is known of the truth.

A task comes in by one of three ways: a file of this package, a path given by the user, or an installed package's entry
point in the group ``adeptone.tasks``. A plugin registers a function without arguments that returns a `Task`::

    @TASKS.register("my_task", "single")
    def my_task() -> Task:
        return Task(name="my_task", title="...", tags=frozenset({"single"}), joints=(1,), make=make)

`Task.make(seed)` gives the same bits for the same seed. Nothing but `TaskData.train` is shown to a contestant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from envs.log import Log
from envs.scara import ScaraBody
from methods.base import Cause
from methods.registry import Registry

TAGS = ("single", "pair", "arm", "clean", "hidden", "excitation", "extrapolation", "noise", "real", "naming")
"""Tags that reports group by. A task may carry more."""


@dataclass(frozen=True)
class Parameter:
    """A combination of parameters that the logs can identify: its true value and unit."""

    value: float
    unit: str


@dataclass(frozen=True)
class Truth:
    """What no log tells.

    parameters: identifiable combinations by the name under which `Estimates` report them. effects: hidden ones, as
    (name, joint); they are told to the ceiling contestant and to nobody else.
    """

    parameters: dict[str, Parameter] = field(default_factory=dict)
    effects: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True)
class Floor:
    """Errors that the true model would have on the held-out logs because of noise and quantisation alone.

    inverse [unit of the command], simulation [rad or m]: root mean squares over all held-out logs and rotary joints.
    """

    inverse: float
    simulation: float


class Judge(Protocol):
    """Says how good a naming is."""

    def __call__(self, verdict: str | None, causes: tuple[Cause, ...]) -> tuple[str, float]:
        """Outcome in a word, and its score from 0 (wrong or missed) to 1 (right)."""
        ...


@dataclass(frozen=True)
class Published:
    """A figure that others have published for the same data. metric: a name of `benchmarks.yardstick.METRICS`."""

    label: str
    metric: str
    value: float
    source: str


@dataclass(frozen=True, eq=False)
class TaskData:
    """One draw of a task. kinematics: of the arm, where the tip's error in space makes sense."""

    train: tuple[Log, ...]
    held_out: tuple[Log, ...]
    truth: Truth | None = None
    floor: Floor | None = None
    judge: Judge | None = None
    kinematics: ScaraBody | None = None


def always() -> None:
    """The reason to skip of a task that needs nothing: none."""


def no_files() -> str:
    """The identity of data that code alone determines."""
    return ""


@dataclass(frozen=True)
class Task:
    """What is asked, and under which limits.

    make: the data of one seed. budget_seconds: for the fit, and as much again for all answers. memory_gib: that fit and
    answers may take beyond the interpreter with its libraries. initialisation_seconds: at both ends of every held-out
    log, not scored; the state in which free runs start is estimated inside it, for all contestants alike.
    horizons_seconds: short, medium and long. bandwidth: of the reference that predictions are compared with [Hz].
    deterministic: the data do not depend on the seed. skip: the reason why the data cannot be had here, or None.
    identity: what beside the code determines the data, for instance a hash of files.
    """

    name: str
    title: str
    tags: frozenset[str]
    joints: tuple[int, ...]
    make: Callable[[int], TaskData]
    budget_seconds: float = 120.0
    memory_gib: float = 4.0
    initialisation_seconds: float = 0.25
    horizons_seconds: tuple[float, float, float] = (0.1, 0.5, 2.0)
    bandwidth: float = 30.0
    deterministic: bool = False
    published: tuple[Published, ...] = ()
    skip: Callable[[], str | None] = always
    identity: Callable[[], str] = no_files


TASKS: Registry = Registry("task", "adeptone.tasks")


def register(task: Task) -> Task:
    """Registers a task of this package under its name."""

    def factory() -> Task:
        return task

    factory.__module__, factory.__qualname__ = "benchmarks.tasks", task.name
    TASKS.register(task.name, *task.tags)(factory)
    return task


def load_tasks() -> None:
    """Imports every task of this package and of installed ones."""
    TASKS.load_package("benchmarks.tasks")
    TASKS.load_entry_points()
