"""Rows of the benchmark as arrays by contestant, task and seed, with what is known of tasks and contestants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks.statistics import Array
from benchmarks.tasks.base import Published
from benchmarks.yardstick import METRICS

if TYPE_CHECKING:
    import pandas as pd

OK, SKIPPED = "ok", "skipped"
REQUIRED = ("task", "method", "label", "seed", "fingerprint", "status", "reason")
PROVENANCE = ("version", "commit", "python", "versions", "machine")
"""Columns that say by what a row was made, where the store has them."""
FLOOR_TAG, CEILING_TAG = "floor", "ceiling"


class ReportError(ValueError):
    """A table of results cannot be reported, said in one line."""


@dataclass(frozen=True)
class TaskInfo:
    """What the page says about a task; tasks that are not installed here have a name only."""

    name: str
    title: str
    tags: tuple[str, ...] = ()
    published: tuple[Published, ...] = ()
    known: bool = True


@dataclass(frozen=True)
class Contestant:
    """A method of the table: its key, its label, a short name that no other has, tags, and its role if it has one."""

    key: str
    label: str
    name: str
    tags: tuple[str, ...] = ()

    @property
    def role(self) -> str:
        """``floor`` (knows nothing), ``ceiling`` (is told what is hidden) or empty."""
        return next((role for role in (FLOOR_TAG, CEILING_TAG) if role in self.tags), "")


@dataclass(frozen=True, eq=False)
class Results:
    """The table and its axes: contestants (M), tasks (T), seeds (S)."""

    frame: pd.DataFrame
    contestants: tuple[Contestant, ...]
    tasks: tuple[TaskInfo, ...]
    seeds: tuple[int, ...]

    @classmethod
    def of(cls, frame: pd.DataFrame, tasks: Mapping[str, TaskInfo]) -> Results:
        """From a store's table; titles and published figures of the `tasks` that are installed here.

        Raises ReportError for a table without rows or without a column that it needs.
        """
        missing = [name for name in REQUIRED if name not in frame.columns]
        if len(frame) == 0:
            raise ReportError("there are no results. Run `adeptone bench run` first, or give another folder")
        if missing:
            raise ReportError(
                f"the table of results lacks {', '.join(missing)}. Give the folder of `adeptone bench run`"
            )
        frame = frame.reset_index(drop=True)
        names = sorted(set(frame["task"]))
        return cls(
            frame=frame,
            contestants=_contestants(frame),
            tasks=tuple(
                tasks.get(name, TaskInfo(name, name, _tags(frame, "task", name), known=False)) for name in names
            ),
            seeds=tuple(sorted({int(seed) for seed in frame["seed"]})),
        )

    @cached_property
    def place(self) -> dict[tuple[str, str, int], int]:
        """Row of the table by (method, task, seed)."""
        keys = zip(self.frame["method"], self.frame["task"], self.frame["seed"], strict=True)
        return {(method, task, int(seed)): row for row, (method, task, seed) in enumerate(keys)}

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        """Row of the table by contestant, task and seed (M, T, S); -1 where there is none."""
        found = np.full((len(self.contestants), len(self.tasks), len(self.seeds)), -1)
        methods = {contestant.key: m for m, contestant in enumerate(self.contestants)}
        tasks = {task.name: t for t, task in enumerate(self.tasks)}
        seeds = {seed: s for s, seed in enumerate(self.seeds)}
        for (method, task, seed), row in self.place.items():
            found[methods[method], tasks[task], seeds[seed]] = row
        return found

    @cached_property
    def status(self) -> NDArray[np.str_]:
        """Status by contestant, task and seed; empty where there is no row."""
        column = np.array([*self.frame["status"].astype(str), ""])
        return column[self.rows]

    @cached_property
    def failed(self) -> NDArray[np.bool_]:
        """Where a run was asked for and gave nothing: failed, crashed, or beyond a limit."""
        return ~np.isin(self.status, [OK, SKIPPED, ""])

    def column(self, name: str) -> Array:
        """A column of figures as it stands in the table (M, T, S); NaN where there is none."""
        if name not in self.frame.columns:
            return np.full(self.rows.shape, np.nan)
        return np.append(self.frame[name].to_numpy(dtype=float, na_value=np.nan), np.nan)[self.rows]

    def errors(self, metric: str) -> Array:
        """A metric for pooling (M, T, S): failed runs are infinitely wrong where the contestant answers such questions.

        A contestant without any figure of this kind does not take part, unless everything that it tried failed.
        """
        values = np.where(self.status == OK, self.column(metric), np.nan)
        answers = np.any(~np.isnan(values), axis=(1, 2)) | ~np.any(self.status == OK, axis=(1, 2))
        return np.where(self.failed & answers[:, None, None], np.inf, values)

    def role(self, role: str) -> int | None:
        """Index of the contestant with a role, or None."""
        return next((m for m, contestant in enumerate(self.contestants) if contestant.role == role), None)

    def group(self, tag: str | None) -> NDArray[np.int64]:
        """Indices of the tasks with a tag; of all for None."""
        return np.array([t for t, task in enumerate(self.tasks) if tag is None or tag in task.tags], dtype=int)

    def text(self, row: int, name: str) -> str:
        """A cell as text; empty when it is missing."""
        value = self.frame[name].iloc[row] if name in self.frame.columns else None
        return "" if value is None or value != value else str(value)

    def unit(self, metric: str, task: int) -> str:
        """Unit of a metric on a task: ``command unit`` and ``position unit`` are looked up in its rows."""
        unit = METRICS[metric].unit
        name = unit.replace(" ", "_")
        if not unit.endswith(" unit"):
            return unit
        rows = self.rows[:, task][self.rows[:, task] >= 0]
        found = [self.text(int(row), name) for row in rows]
        return next((text for text in found if text), "")

    def noise_floor(self, kind: str) -> Array:
        """Error that noise alone causes, by task and seed (T, S), from any contestant's row; NaN where unknown."""
        return _first(self.column(f"noise_floor_{kind}"))

    @cached_property
    def provenance(self) -> tuple[tuple[str, ...], ...]:
        """Distinct makers of rows: the columns PROVENANCE."""
        return tuple(sorted(set(self.maker)))

    @cached_property
    def maker(self) -> tuple[tuple[str, ...], ...]:
        """PROVENANCE of every row of the table."""
        return tuple(tuple(self.text(row, name) for name in PROVENANCE) for row in range(len(self.frame)))


def known_tasks() -> dict[str, TaskInfo]:
    """The tasks that are installed here."""
    from benchmarks.tasks.base import TASKS, load_tasks

    load_tasks()
    found = {}
    for entry in TASKS:
        task = entry.factory()
        found[task.name] = TaskInfo(task.name, task.title, tuple(sorted(task.tags)), task.published)
    return found


def _contestants(frame: pd.DataFrame) -> tuple[Contestant, ...]:
    """Sorted by label; those that share a label are told apart by their specification."""
    first = frame.drop_duplicates("method").sort_values(["label", "method"], kind="stable")
    labels = [str(label) for label in first["label"]]
    return tuple(
        Contestant(str(key), label, label if labels.count(label) == 1 else str(key), _tags(frame, "method", key))
        for label, key in zip(labels, first["method"], strict=True)
    )


def _tags(frame: pd.DataFrame, of: str, name: str) -> tuple[str, ...]:
    """Tags of a task or method as its rows tell them."""
    column = f"{of}_tags"
    if column not in frame.columns:
        return ()
    found = {tag for text in frame.loc[frame[of] == name, column].dropna() for tag in str(text).split("+") if tag}
    return tuple(sorted(found))


def _first(values: Array) -> Array:
    """The first number along the contestants; NaN where there is none."""
    known = ~np.isnan(values)
    taken = np.take_along_axis(values, np.argmax(known, axis=0)[None], axis=0)[0]
    return np.where(np.any(known, axis=0), taken, np.nan)
