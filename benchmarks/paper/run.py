"""Running the study: processes, progress bars, and where everything is written."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from benchmarks.paper.doubts import investigate
from benchmarks.paper.experiment import DURATION, draws
from benchmarks.paper.measured import joint_of, readable, study_measured
from benchmarks.paper.report import Drawing, Report, draw, measured_report, paper_report, write
from benchmarks.paper.study import run_draw
from envs.log import LogError
from envs.log_files import load
from envs.output_place import check_folder
from methods.base import MethodError

InputError = (LogError, MethodError, OSError)
"""What unusable input, or a folder that cannot be written, raises: one line each."""


@dataclass(frozen=True)
class Extent:
    """How much is run: members of the ensemble, how many of them compare network structures, length of logs [s]."""

    draws: int
    structure_draws: int
    duration: float = DURATION


FULL = Extent(draws=12, structure_draws=3)
QUICK = Extent(draws=2, structure_draws=1, duration=5.0)


class Workers:
    """Processes that work off jobs while a bar counts what is done."""

    def __init__(self, pool: ProcessPoolExecutor, progress: Progress):
        self._pool, self._progress = pool, progress

    def all(self, title: str, jobs: Sequence[tuple[Callable[..., Any], tuple[Any, ...]]]) -> list[Any]:
        """Results in the order of the jobs."""
        bar = self._progress.add_task(title, total=len(jobs))
        futures: list[Future[Any]] = []
        for function, arguments in jobs:
            futures.append(self._pool.submit(function, *arguments))
            futures[-1].add_done_callback(lambda _: self._progress.advance(bar))
        return [future.result() for future in futures]

    def draw(self, drawings: Sequence[Drawing], folder: Path) -> None:
        """All figures of a report."""
        self.all("figures", [(draw, (drawing, folder)) for drawing in drawings])


@contextmanager
def workers() -> Iterator[Workers]:
    """As many processes as there are processors. Forking, where the system can, spares them the imports."""
    method = "fork" if "fork" in multiprocessing.get_all_start_methods() else None
    context = multiprocessing.get_context(method)
    columns = (TextColumn("{task.description:<12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with ProcessPoolExecutor(os.cpu_count(), mp_context=context) as pool:
        pool.submit(os.getpid).result()  # forks before the progress display starts its thread
        with Progress(*columns, console=Console(stderr=True)) as progress:
            yield Workers(pool, progress)


def run_study(extent: Extent, out: Path, seed: int) -> Report:
    """The whole synthetic study into `out`."""
    check_folder(out)
    members = draws(extent.draws, seed, extent.duration)
    with workers() as work:
        doubts, *results = work.all(
            "experiments",
            [
                (investigate, (members[0],)),
                *((run_draw, (member, member.number < extent.structure_draws)) for member in members),
            ],
        )
        report = paper_report(results, doubts)
        write(report, out, work.draw)
    _announce(report, out)
    return report


def run_on_logs(paths: Sequence[Path], joint: int | None, out: Path, seed: int) -> Report:
    """The pipeline on measured logs into `out`. Raises `InputError` before anything is written."""
    check_folder(out)
    logs = readable(joint_of([load(path) for path in paths], joint))
    with Console(stderr=True).status("fitting and scoring"):
        report = measured_report(study_measured(logs, seed))
    with workers() as work:
        write(report, out, work.draw)
    _announce(report, out)
    return report


def _announce(report: Report, out: Path) -> None:
    console = Console(stderr=True, highlight=False)
    if report.page.verdicts:
        for number, claim, *_, verdict in report.page.verdicts.rows:
            console.print(f"[bold]{number}[/bold] {claim} [italic]{verdict}[/italic]", soft_wrap=True)
    for paragraph in report.page.abstract:
        console.print(paragraph, soft_wrap=True)
    console.print(f"written: {out / 'index.html'}")
