"""The reference of an accuracy check: single runs over several seeds, as text that shows in a commit what moved."""

from __future__ import annotations

import csv
import io
import math
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from benchmarks.yardstick import METRICS

COMPARED = tuple(name for name, metric in METRICS.items() if not metric.timing and name != "parameter_count")
"""Metrics that a check compares."""
SECONDS = "fit_seconds"
HEAD = ("task", "method", "specification", "seed", "trial", "status", "reason")
Trial = Literal["run", "rounding"]
"""A run as it is, and its repetition on logs that differ in the last digits."""


class CheckError(ValueError):
    """An accuracy check cannot be made, said in one line."""


@dataclass(frozen=True, eq=False)
class Run:
    """One run: what it was about, how it ended, and its figures by metric; metrics that do not apply are left out."""

    task: str
    method: str
    specification: str
    seed: int
    trial: Trial
    status: str
    reason: str
    figures: Mapping[str, float]

    @classmethod
    def of(cls, row: Mapping[str, Any], trial: Trial) -> Run:
        """From a row of `benchmarks.cells.run_cell`."""
        figures = {name: float(row[name]) for name in (*COMPARED, SECONDS) if not math.isnan(float(row[name]))}
        head = (str(row["task"]), str(row["label"]), str(row["method"]), int(row["seed"]))
        return cls(*head, trial, str(row["status"]), str(row["reason"]), figures if row["status"] == "ok" else {})


def path_of(folder: Path, suite: str) -> Path:
    """Where the reference of a suite stands."""
    return folder / f"{suite}.csv"


def read(path: Path) -> tuple[Run, ...]:
    """The runs of a reference. Raises CheckError for a file that is none."""
    if not path.exists():
        return ()
    with open(path, encoding="utf-8", newline="") as file:
        table = csv.DictReader(file)
        if table.fieldnames is None or not set(HEAD) <= set(table.fieldnames):
            raise CheckError(f"{path} is no reference: it lacks columns. Make it anew with --update")
        try:
            return tuple(_run(line) for line in table)
        except (KeyError, TypeError, ValueError) as error:
            raise CheckError(f"{path}, line {table.line_num}: {error}. Make the reference anew with --update") from None


def _run(line: Mapping[str, str]) -> Run:
    known = (*COMPARED, SECONDS)
    figures = {name: float(line[name]) for name in known if line.get(name)}
    trial: Trial = "rounding" if line["trial"] == "rounding" else "run"
    head = (line["task"], line["method"], line["specification"], int(line["seed"]))
    return Run(*head, trial, line["status"], line["reason"], figures)


def write(runs: Iterable[Run], path: Path) -> None:
    """Replaces the file as a whole; figures keep ten digits, times two."""
    ordered = sorted(runs, key=lambda run: (run.task, run.method, run.trial != "run", run.seed))
    names = [name for name in (*COMPARED, SECONDS) if any(name in run.figures for run in ordered)]
    buffer = io.StringIO()
    table = csv.writer(buffer, lineterminator="\n")
    table.writerow([*HEAD, *names])
    for run in ordered:
        head = (run.task, run.method, run.specification, run.seed, run.trial, run.status, run.reason)
        table.writerow([*head, *(_text(name, run.figures.get(name)) for name in names)])
    _replace(path, buffer.getvalue())


def write_provenance(path: Path, methods: Sequence[str], facts: Mapping[str, str]) -> None:
    """Beside a reference: by what the runs of each method were made (TOML)."""
    import tomllib

    import tomli_w

    place = path.with_suffix(".toml")
    known = tomllib.loads(place.read_text(encoding="utf-8")) if place.exists() else {}
    _replace(place, tomli_w.dumps({**known, **{method: dict(facts) for method in sorted(methods)}}))


def _text(name: str, value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.2g}" if name == SECONDS else f"{value:.10g}"


def _replace(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="") as file:
            file.write(text)
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
