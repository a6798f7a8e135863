"""A progress bar with the time left, and a line for every row that did not end well."""

from __future__ import annotations

from types import TracebackType
from typing import Any, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as RichProgress

QUIET = ("ok", "skipped")


class Progress:
    """Rows done of all; `done` of them were in the store already."""

    def __init__(self, total: int, done: int, *, shown: bool = True):
        self._bar = RichProgress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            disable=not shown,
        )
        self._shown = shown
        self._task = self._bar.add_task("rows", total=total, completed=done)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def advance(self, row: dict[str, Any]) -> None:
        """One row more."""
        self._bar.advance(self._task)
        self._bar.update(self._task, description=f"{row['task']} · {row['label']}")
        if self._shown and row["status"] not in QUIET:
            self._bar.console.print(
                f"{row['task']} · {row['label']} · seed {row['seed']}: {row['status']}: {row['reason']}", markup=False
            )
