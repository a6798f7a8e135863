"""Rows of the benchmark, safe against a kill at any moment.

A store is a folder. A finished row becomes one Parquet file, ``rows/FINGERPRINT.parquet``, written beside its place
and renamed into it: a file is there as a whole or not at all, and several processes may write at once. Now and then
all rows are merged into ``table.parquet``, again by renaming; a kill in between leaves rows twice, which reading
ignores. A row is known by its fingerprint, so nothing is ever computed twice.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

KEY = ("task", "method", "seed")
"""What a row is about; among rows with the same key the latest one counts."""
TIMING = (
    "fit_seconds",
    "step_microseconds",
    "peak_memory_gib",
    "total_seconds",
    "finished_at",
    "machine",
)
"""Columns that differ from run to run; comparisons of tables leave them out."""
MERGE_ABOVE = 200
"""Row files above which they are merged."""


@dataclass(frozen=True)
class Store:
    """The rows below a folder, which is made with the first row."""

    path: Path

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", Path(self.path))

    @property
    def rows(self) -> Path:
        """Where single rows stand."""
        return self.path / "rows"

    @property
    def table(self) -> Path:
        """The merged rows."""
        return self.path / "table.parquet"

    def append(self, row: Mapping[str, Any]) -> None:
        """Adds one row; `row` holds at least a fingerprint and the columns of KEY."""
        import pandas as pd

        _write(pd.DataFrame([dict(row)]), self.rows / f"{row['fingerprint']}.parquet")

    def history(self) -> pd.DataFrame:
        """All rows, in the order in which they were finished; empty without any."""
        import pandas as pd

        for _ in range(5):  # another process may merge while this one reads
            try:
                tables = [pd.read_parquet(file) for file in self._files()]
                break
            except FileNotFoundError:
                continue
        if not tables:
            return pd.DataFrame(columns=[*KEY, "fingerprint", "status"])
        table = pd.concat([part.dropna(axis=1, how="all") for part in tables], ignore_index=True)
        everything = list(dict.fromkeys(name for part in tables for name in part.columns))
        table = table.reindex(columns=everything).drop_duplicates("fingerprint", keep="last")
        return table.sort_values(["finished_at", *KEY], kind="stable", ignore_index=True)

    def read(self) -> pd.DataFrame:
        """The latest row of every task, method and seed, sorted by these."""
        table = self.history().drop_duplicates(list(KEY), keep="last")
        return table.sort_values(list(KEY), kind="stable", ignore_index=True)

    def fingerprints(self) -> dict[str, str]:
        """Fingerprint -> status of every row."""
        table = self.history()
        return dict(zip(table["fingerprint"], table["status"], strict=True))

    def merge(self, *, above: int = MERGE_ABOVE) -> None:
        """Merges single rows into the table when there are more than `above`; leaves it to another process if busy."""
        singles = sorted(self.rows.glob("*.parquet"))
        if len(singles) <= above:
            return
        with open(self.path / ".lock", "w", encoding="ascii") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return
            _write(self.history(), self.table)
            for file in singles:
                file.unlink(missing_ok=True)

    def _files(self) -> list[Path]:
        return [*([self.table] if self.table.exists() else []), *sorted(self.rows.glob("*.parquet"))]


def _write(table: pd.DataFrame, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            table.to_parquet(file, index=False)
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
