"""`adeptone bench check`: a fresh run of a suite against its reference, and `--update`, which makes the reference."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

from benchmarks import fingerprint, reference, tolerance
from benchmarks.cells import Cell, Prepared, TaskReference, needed, prepare, run_cell
from benchmarks.comparison import SHARES, SKIPPED, Finding, compare
from benchmarks.isolation import preload
from benchmarks.progress import Progress
from benchmarks.reference import CheckError, Run, Trial
from benchmarks.runner import plan, read_seeds
from benchmarks.store import Store
from benchmarks.suites import SUITES, Suite
from benchmarks.yardstick import METRICS
from diagnosis.quantities import number, quantity
from envs.log import Log

WORKFLOW = "accuracy.yml"
OK = "ok"
UNFINISHED = Path(".cache/adeptone/reference")
"""Where an update that was interrupted left its runs."""


@dataclass(frozen=True)
class Report:
    """What a check found."""

    suite: str
    seeds: tuple[int, ...]
    runs: int
    findings: tuple[Finding, ...]

    @property
    def regressions(self) -> tuple[Finding, ...]:
        """The findings that fail the check."""
        return tuple(item for item in self.findings if item.verdict == "regression")

    @property
    def sound(self) -> bool:
        """Whether nothing got worse."""
        return not self.regressions

    def text(self) -> str:
        """Everything that moved beyond its allowance or could not be compared, as a table, under one sentence."""
        compared = [item for item in self.findings if item.verdict != "not compared"]
        worse, better = len(self.regressions), sum(item.verdict == "better" for item in compared)
        shown = [item for item in self.findings if item.verdict != "same"]
        seeds = ", ".join(map(str, self.seeds))
        moved = f"{worse} worse, {better} better" if worse + better else "nothing moved"
        sentence = f"Suite {self.suite}, seeds {seeds}: {self.runs} runs, {len(compared)} comparisons, {moved}."
        return "\n".join([sentence, *([""] if shown else []), *_aligned(shown)])


def check(
    suite: str,
    methods: Sequence[str],
    folder: Path,
    *,
    seeds: str | None = None,
    workers: int = 2,
    progress: bool = True,
) -> Report:
    """A fresh run of a suite, or of other methods on its tasks, against the reference in a folder.

    methods: names or files; the suite's own when empty. seeds: instead of its own, see `benchmarks.runner.read_seeds`.

    Raises CheckError when the suite is unknown or a method has no reference, RegistryError for unknown methods.
    """
    chosen = find_suite(suite)
    cells = plan(chosen.tasks, methods or chosen.methods, read_seeds(seeds) if seeds else chosen.seeds)
    path = reference.path_of(folder, suite)
    before = reference.read(path)
    _require(cells, before, path, suite)
    runs = measure(cells, "run", workers=workers, progress=progress)
    return _report(suite, cells, runs, before)


def update(
    suite: str,
    methods: Sequence[str],
    folder: Path,
    *,
    workers: int = 2,
    progress: bool = True,
    finished: Store | None = None,
) -> tuple[Report, Path]:
    """Makes the reference of a suite, or of some methods on its tasks, anew; what moved, and the reference's path.

    Runs on the suite's own seeds are made twice, see `benchmarks.tolerance`. The file is replaced when all are there;
    until then they are kept in the store `finished`, so that an interrupted update goes on where it stopped.
    """
    chosen = find_suite(suite)
    seeds = reference_seeds(chosen)
    cells = plan(chosen.tasks, methods or chosen.methods, seeds)
    path = reference.path_of(folder, suite)
    before = reference.read(path)
    repeated = [item for item in cells if item.seed in chosen.seeds]
    runs = measure(cells, "run", workers=workers, progress=progress, finished=finished)
    runs += measure(repeated, "rounding", workers=workers, progress=progress, finished=finished)
    absent = _absent(cells)
    renewed = {run.method for run in runs}
    kept = [run for run in before if run.method not in renewed or run.task in absent]
    reference.write([*kept, *(run for run in runs if run.task not in absent)], path)
    facts = {**fingerprint.provenance(), "machine": fingerprint.processor(), "seeds": ", ".join(map(str, seeds))}
    reference.write_provenance(path, sorted(renewed), facts)
    fresh = [run for run in runs if run.trial == "run"]
    return _report(suite, cells, fresh, before), path


def find_suite(name: str) -> Suite:
    """A suite by name. Raises CheckError when there is none."""
    if name not in SUITES:
        raise CheckError(f"there is no suite {name!r}. Known: {', '.join(sorted(SUITES))}")
    return SUITES[name]


def reference_seeds(suite: Suite) -> tuple[int, ...]:
    """The suite's seeds and the least further ones that make `Suite.reference_seeds`."""
    further = (seed for seed in range(suite.reference_seeds + len(suite.seeds)) if seed not in suite.seeds)
    missing = max(0, suite.reference_seeds - len(suite.seeds))
    return (*suite.seeds, *(seed for seed, _ in zip(further, range(missing), strict=False)))


def workflow() -> str:
    """A GitHub Actions workflow that checks a method of one's own against its committed reference."""
    return (files("benchmarks") / "templates" / WORKFLOW).read_text("utf-8")


def measure(
    cells: Sequence[Cell], trial: Trial, *, workers: int, progress: bool, finished: Store | None = None
) -> list[Run]:
    """Runs the cells on this machine, so many at once; in the cells' order. What is in a store is taken from there."""
    marks = {item: fingerprint.digest(item.fingerprint, trial) for item in cells}
    rows = [] if finished is None else finished.history().to_dict("records")
    known = {row["fingerprint"]: row for row in rows if row["status"] in (OK, SKIPPED)}
    found = {item: Run.of(known[mark], trial) for item, mark in marks.items() if mark in known}
    groups: dict[tuple[TaskReference, int], list[Cell]] = defaultdict(list)
    for item in cells:
        if item not in found:
            groups[item.task, item.seed].append(item)
    preload(needed([item for item in cells if item not in found]))
    telling = threading.Lock()
    with Progress(len(cells), len(found), shown=progress) as bar:

        def work(task: TaskReference, seed: int, items: Sequence[Cell]) -> None:
            prepared = prepare(task, seed)
            prepared = rounded_otherwise(prepared) if trial == "rounding" else prepared
            for item in items:
                row = run_cell(item, prepared)
                with telling:
                    found[item] = Run.of(row, trial)
                    if finished is not None:
                        finished.append(row | {"fingerprint": marks[item]})
                    bar.advance(row)

        with ThreadPoolExecutor(max_workers=max(1, workers), thread_name_prefix="check") as pool:
            for group in [pool.submit(work, *key, items) for key, items in groups.items()]:
                group.result()
    return [found[item] for item in cells]


def rounded_otherwise(prepared: Prepared) -> Prepared:
    """The same questions on training logs that are larger by a factor so near 1 that only rounding differs."""
    examination = prepared.examination
    if examination is None:
        return prepared
    train = tuple(_scaled(log) for log in examination.data.train)
    return replace(prepared, examination=replace(examination, data=replace(examination.data, train=train)))


def _scaled(log: Log) -> Log:
    velocity = None if log.velocity is None else log.velocity * tolerance.SCALED
    return replace(
        log, command=log.command * tolerance.SCALED, position=log.position * tolerance.SCALED, velocity=velocity
    )


def _report(suite: str, cells: Sequence[Cell], runs: Sequence[Run], before: Sequence[Run]) -> Report:
    findings = compare(runs, before, _absent(cells))
    return Report(suite, tuple(sorted({item.seed for item in cells})), len(runs), tuple(findings))


def _absent(cells: Sequence[Cell]) -> dict[str, str]:
    """Tasks that cannot be had here, with the reason."""
    tasks = [task.load() for task in dict.fromkeys(item.task for item in cells)]
    return {task.name: reason for task in tasks if (reason := task.skip()) is not None}


def _require(cells: Sequence[Cell], before: Sequence[Run], path: Path, suite: str) -> None:
    """Raises CheckError when a method has no reference at all."""
    known = {run.method for run in before}
    missing = sorted({item.contestant.label for item in cells} - known)
    if missing:
        raise CheckError(
            f"{path} holds no reference of {', '.join(missing)}. "
            f"Make it with `adeptone bench check --suite {suite} --update`, with the same --method and --reference"
        )


def _aligned(findings: Sequence[Finding]) -> list[str]:
    """The findings as lines with columns; regressions first."""
    if not findings:
        return []
    order = {"regression": 0, "not compared": 1, "better": 2, "same": 3}
    ranked = sorted(findings, key=lambda item: order[item.verdict])
    rows: list[tuple[str, ...]] = [("", "task", "method", "metric", "now (SI)", "reference", "change", "allowed", "")]
    rows += [_row(item) for item in ranked]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    return [
        "  ".join([*(text.ljust(width) for text, width in zip(row, widths, strict=False)), row[-1]]).rstrip()
        for row in rows
    ]


def _row(item: Finding) -> tuple[str, ...]:
    title = METRICS[item.metric].title if item.metric in METRICS else item.metric
    note = "; ".join(part for part in (item.basis, item.note) if part)
    return (
        item.verdict, item.task, item.method, title, _value(item, item.now), _value(item, item.before),
        _limit(item, item.change), _limit(item, item.allowed), note,
    )  # fmt: skip


def _value(item: Finding, value: float) -> str:
    if value != value:
        return ""
    unit = METRICS[item.metric].unit
    return number(value, 4) if unit.endswith(" unit") else quantity(value, "" if unit == "1" else unit, 4)


def _limit(item: Finding, value: float) -> str:
    if value != value:
        return ""
    if item.metric in SHARES:
        return f"{value:+.2g}" if abs(value) > 1e-6 else "0"
    return f"×{_digits(value)}"


def _digits(value: float) -> str:
    """A factor with as many decimals as tell it from 1."""
    for decimals in (2, 3, 4, 6):
        if abs(value - 1.0) >= 0.5 * 10.0**-decimals * 2:
            return f"{value:.{decimals}f}"
    return f"{value:.9g}"
