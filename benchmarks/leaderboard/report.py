"""From a store to files: the page and its tables. Everything is made before anything is written."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.leaderboard.page import render
from benchmarks.leaderboard.results import ReportError, Results, known_tasks
from benchmarks.leaderboard.standings import QUESTIONS, Leaderboard, groups, leaderboard
from benchmarks.leaderboard.summary import losses, naming
from benchmarks.leaderboard.tables import (
    Table,
    losses_table,
    naming_table,
    published_table,
    standings_table,
    task_table,
)
from benchmarks.store import Store
from envs.output_place import check_folder

PAGE = "index.html"
TABLES = "tables"


def report_files(results: Path, out: Path) -> Path:
    """Writes the report on a folder of results and returns the page's path.

    Raises ReportError when there is no such folder, or nothing in it.
    """
    if not results.is_dir():
        raise ReportError(f"{results} is no folder. Give the folder that `adeptone bench run` wrote with --results")
    check_folder(out)
    return write(Results.of(Store(results).read(), known_tasks()), out)


def leaderboards(results: Results) -> tuple[Leaderboard, ...]:
    """Every question on every group of tasks; intervals come from a fixed generator."""
    return tuple(
        leaderboard(results, question, tag, np.random.default_rng(0))
        for tag in groups(results)
        for question in QUESTIONS
    )


def report_tables(results: Results, boards: tuple[Leaderboard, ...]) -> tuple[Table, ...]:
    """Leaderboards, tasks, published figures, names, and what failed; empty ones are left out."""
    found = [standings_table(results, board) for board in boards]
    found += [task_table(results, t) for t in range(len(results.tasks))]
    found += [published_table(results), naming_table(naming(results)), losses_table(losses(results))]
    return tuple(table for table in found if table.rows)


def write(results: Results, out: Path) -> Path:
    """Page, and tables as CSV, Markdown and LaTeX; they replace earlier ones together."""
    boards = leaderboards(results)
    tables = report_tables(results, boards)
    everything = [table for table in tables if table.name.endswith("_all")]
    page = render(results, boards, everything)
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=".report-") as place:
        folder = Path(place)
        (folder / TABLES).mkdir()
        for table in tables:
            for ending, text in (("csv", table.csv()), ("md", table.markdown()), ("tex", table.latex())):
                (folder / TABLES / f"{table.name}.{ending}").write_text(text, encoding="utf-8")
        runs = results.frame.drop(columns=[n for n in results.frame.columns if _is_list(results, n)])
        runs.to_csv(folder / TABLES / "runs.csv", index=False)
        (folder / PAGE).write_text(page, encoding="utf-8")
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                target = out / path.relative_to(folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                path.replace(target)
    return out / PAGE


def _is_list(results: Results, column: str) -> bool:
    return any(isinstance(value, list | tuple | np.ndarray) for value in results.frame[column])
