"""One cell of the benchmark: a task, a method and a seed become one row."""

from __future__ import annotations

import hashlib
import inspect
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks import fingerprint, isolation
from benchmarks.tasks.base import TAGS, TASKS, Task, TaskData, always, load_tasks, no_files
from benchmarks.worker import Contestant, Job, Questions
from benchmarks.yardstick import Examination, score, unanswered

CEILING = "ceiling"
"""Tag of the contestant that is told the names of the hidden effects."""
YARDSTICK = ("yardstick.py", "worker.py")
"""Files of which a change makes every row another one."""


@dataclass(frozen=True)
class TaskReference:
    """A task by its name and, for a plugin, the file that registers it: what travels between processes."""

    name: str
    plugin: str | None = None

    def load(self) -> Task:
        """The task. Raises RegistryError when there is none of that name."""
        load_tasks()
        if self.plugin is not None and self.name not in TASKS.names():
            TASKS.load_path(Path(self.plugin))
        return TASKS[self.name].factory()


@dataclass(frozen=True)
class Cell:
    """One row to be computed; `fingerprint` says what it depends on."""

    task: TaskReference
    contestant: Contestant
    seed: int
    fingerprint: str


@dataclass(frozen=True, eq=False)
class Prepared:
    """A task's questions for one seed, or the reason why there are none."""

    task: Task
    examination: Examination | None = None
    status: str = "ok"
    reason: str = ""


def cell(reference: TaskReference, task: Task, contestant: Contestant, seed: int) -> Cell:
    """A cell with its fingerprint: code of task, method and yardstick, settings, data, versions, seed."""
    yardstick = fingerprint.source_hash(*(fingerprint.ROOT / "benchmarks" / name for name in YARDSTICK))
    code = task_code(task, reference)
    values = [getattr(task, item.name) for item in fields(task)]
    settings = [sorted(value) if isinstance(value, frozenset) else value for value in values if not callable(value)]
    method = (contestant.key, contestant.code)
    mark = fingerprint.digest(
        settings, code, task.identity(), task.skip(), method, yardstick, fingerprint.versions(), seed
    )
    return Cell(reference, contestant, seed, mark)


def needed(cells: Iterable[Cell]) -> tuple[str, ...]:
    """The slow libraries that the contestants of these cells import."""
    return tuple(sorted({name for item in cells for name in item.contestant.libraries}))


def _function(made: Callable[..., Any]) -> tuple[Any, str]:
    """The plain function behind a callable, and what it was bound to, as text."""
    if isinstance(made, partial):
        inner, bound = _function(made.func)
        return inner, f"{bound}{made.args!r}{sorted(made.keywords.items())!r}"
    if inspect.ismethod(made):
        return made.__func__, repr(made.__self__)
    return (made, "") if inspect.isfunction(made) else (type(made).__call__, repr(made))


def task_code(task: Task, reference: TaskReference) -> str:
    """Hash of the code that makes the task's data, and of what that code was bound to."""
    function, bound = _function(task.make)
    files = [Path(inspect.getfile(function))]
    if reference.plugin is not None:
        files.append(Path(reference.plugin))
    return fingerprint.digest(fingerprint.source_hash(*files), function.__qualname__, bound)


def make_examination(reference: TaskReference, seed: int) -> Prepared:
    """Makes the data of one seed; meant for a child process, where it is not slowed down by others."""
    task = reference.load()
    shown = replace(task, make=_made, skip=always, identity=no_files)  # a plugin's functions stay where they are
    try:
        return Prepared(shown, Examination.of(shown, task.make(0 if task.deterministic else seed)))
    except ValueError as error:
        return Prepared(shown, None, "failed", f"the task's data cannot be made: {' '.join(str(error).split())}")


def _made(seed: int) -> TaskData:
    raise RuntimeError("the data of this task have been made already")


def prepare(reference: TaskReference, seed: int) -> Prepared:
    """`make_examination` in a child."""
    task = reference.load()
    reason = task.skip()
    if reason is not None:
        return Prepared(task, None, "skipped", reason)
    return isolation.call(make_examination, reference, seed)


def run_cell(item: Cell, prepared: Prepared) -> dict[str, Any]:
    """The row of a cell. Nothing that a method does raises here."""
    begin = time.perf_counter()
    row = _blank(item, prepared.task, prepared.status, prepared.reason)
    if prepared.examination is not None:
        row |= _contest(item, prepared.examination)
    return _finished(row, begin)


def failed_row(item: Cell, status: str, reason: str) -> dict[str, Any]:
    """The row of a cell that could not be tried."""
    return _finished(_blank(item, item.task.load(), status, reason), time.perf_counter())


def _blank(item: Cell, task: Task, status: str, reason: str) -> dict[str, Any]:
    """All columns, figures unknown."""
    contestant = item.contestant
    return {
        "task": task.name,
        "method": contestant.key,
        "label": contestant.label,
        "family": next((tag for tag in TAGS if tag in task.tags), ""),
        "task_tags": "+".join(sorted(task.tags)),
        "method_tags": "+".join(contestant.tags),
        "joints": "+".join(map(str, task.joints)),
        "seed": item.seed,
        "fingerprint": item.fingerprint,
        "status": status,
        "reason": reason,
        "convergence": "",
        **unanswered(),
        "horizons": list(task.horizons_seconds),
    }


def _finished(row: dict[str, Any], begin: float) -> dict[str, Any]:
    row |= fingerprint.provenance()
    row["total_seconds"] = time.perf_counter() - begin
    row["finished_at"] = datetime.now(UTC).isoformat(timespec="milliseconds")
    return row


def _contest(item: Cell, examination: Examination) -> dict[str, Any]:
    task, data, contestant = examination.task, examination.data, item.contestant
    told = data.truth.effects if data.truth is not None and CEILING in contestant.tags else None
    entropy = hashlib.sha256(f"{task.name}/{item.seed}/{contestant.key}".encode()).digest()[:8]
    job = Job(contestant, data.train, int.from_bytes(entropy, "big"), task.memory_gib, told)
    questions = Questions(tuple(examination.simulations()), tuple(examination.inverses()))
    outcome = isolation.attempt(job, questions, task.budget_seconds)
    row: dict[str, Any] = {"status": outcome.status, "reason": outcome.reason}
    row["convergence"] = outcome.fitted.get("convergence", "")
    if outcome.answers is not None:
        row |= score(examination, outcome.answers)
    for name in ("fit_seconds", "parameter_count"):
        row[name] = float(outcome.fitted.get(name, float("nan")))
    for name in ("step_microseconds", "peak_memory_gib"):
        row[name] = float(outcome.answered.get(name, float("nan")))
    return row
