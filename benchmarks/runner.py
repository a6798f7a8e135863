"""Works through tasks x methods x seeds, on this machine or on a Dask cluster, and leaves one row per cell in a store.

    run(["joint1_clean"], ["least_squares", "my_method.py"], range(3), Store("results/bench"), workers=2)

What is in the store with the same fingerprint is not computed again, whatever became of it. Every row is stored as
soon as it is there: an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import threading
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks import fingerprint
from benchmarks.cells import Cell, Prepared, TaskReference, cell, needed, prepare, run_cell
from benchmarks.isolation import SLOW_LIBRARIES, describe_methods, preload
from benchmarks.progress import Progress
from benchmarks.store import Store
from benchmarks.tasks.base import TASKS, Task, load_tasks
from benchmarks.worker import Contestant
from envs.output_place import check_folder
from methods.base import Method
from methods.registry import RegistryError


def run(
    tasks: Iterable[str],
    methods: Iterable[str | Method],
    seeds: Iterable[int],
    store: Store,
    *,
    workers: int,
    scheduler: str | None = None,
    progress: bool = True,
    retry: bool = False,
) -> None:
    """Computes every missing row of the product.

    tasks: names, or files that register tasks. methods: names, files that register methods, or specifications.
    workers: cells at once on this machine. scheduler: address of a Dask scheduler that takes the work instead.
    retry: rows that did not end well are computed again.

    Raises RegistryError, in one line, for unknown names and plugins that cannot be loaded.
    """
    cells = plan(tasks, methods, seeds)
    run_cells(cells, store, workers=workers, scheduler=scheduler, progress=progress, retry=retry)


def command(
    suite: str | None,
    tasks: Sequence[str],
    methods: Sequence[str],
    seeds: str | None,
    out: Path,
    *,
    workers: int,
    scheduler: str | None = None,
    retry: bool = False,
) -> str:
    """``adeptone bench run``: what is left out comes from the suite, by default ``quick``; returns the closing line.

    Raises RegistryError, in one line, for an unknown suite, task or method, and for seeds that are no numbers.
    """
    from benchmarks.suites import SUITES

    name = suite or "quick"
    if name not in SUITES:
        raise RegistryError(f"there is no suite {name!r}. Known: {', '.join(sorted(SUITES))}")
    chosen = SUITES[name]
    cells = plan(tasks or chosen.tasks, methods or chosen.methods, read_seeds(seeds) if seeds else chosen.seeds)
    check_folder(out)
    store = Store(out)
    run_cells(cells, store, workers=workers, scheduler=scheduler, retry=retry)
    done = store.fingerprints()
    counts = Counter(done[item.fingerprint] for item in cells)
    return f"{len(cells)} rows in {out}: " + ", ".join(f"{count} {status}" for status, count in counts.most_common())


def read_seeds(text: str) -> tuple[int, ...]:
    """Seeds from text: ``5`` is 0 to 4, ``2-4`` a range, ``1,3`` a list. Raises RegistryError for anything else."""
    found: list[int] = []
    try:
        for part in [f"0-{int(text) - 1}"] if text.strip().isdigit() else text.split(","):
            first, dash, last = part.partition("-")
            found += range(int(first), int(last if dash else first) + 1)
    except ValueError:
        found = []
    if not found:
        raise RegistryError(f"seeds are {text!r}. Write how many (5), a range (0-4) or a list (1,3)")
    return tuple(dict.fromkeys(found))


def run_cells(
    cells: Sequence[Cell],
    store: Store,
    *,
    workers: int,
    scheduler: str | None = None,
    progress: bool = True,
    retry: bool = False,
) -> None:
    """`run` for planned cells."""
    done = store.fingerprints()
    waiting = [item for item in cells if item.fingerprint not in done or (retry and done[item.fingerprint] != "ok")]
    store.merge()
    with Progress(len(cells), len(cells) - len(waiting), shown=progress) as bar:

        def finish(row: dict[str, Any]) -> None:
            store.append(row)
            bar.advance(row)

        if scheduler is not None:
            from benchmarks.cluster import run_on_cluster

            run_on_cluster(waiting, scheduler, finish)
        else:
            run_here(waiting, workers, finish)
    store.merge()


def plan(tasks: Iterable[str], methods: Iterable[str | Method], seeds: Iterable[int]) -> list[Cell]:
    """Cells of the product, those of the same task and seed side by side."""
    contestants = find_contestants(methods)
    numbers = list(seeds)
    found = find_tasks(tasks)
    return [
        cell(reference, task, contestant, seed)
        for reference, task in found
        for seed in numbers
        for contestant in contestants
    ]


def find_tasks(names: Iterable[str]) -> list[tuple[TaskReference, Task]]:
    """Tasks by name or file. Raises RegistryError for an unknown name or an unusable file."""
    load_tasks()
    references: list[TaskReference] = []
    for name in names:
        if name.endswith(".py"):
            path = str(Path(name).resolve())
            references += [TaskReference(added, path) for added in TASKS.load_path(Path(path))]
        else:
            references.append(TaskReference(name))
    return [(reference, TASKS[reference.name].factory()) for reference in dict.fromkeys(references)]


def find_contestants(methods: Iterable[str | Method]) -> list[Contestant]:
    """Contestants by name, file or specification, without running a plugin's code in this process.

    Raises RegistryError for an unknown name and for a plugin that cannot be loaded.
    """
    own: dict[str, Contestant] | None = None
    found: list[Contestant] = []
    for item in methods:
        if isinstance(item, Method):
            found.append(_specified(item))
            continue
        own = _described(None) if own is None else own
        if item.endswith(".py"):
            path = str(Path(item).resolve())
            found += [one for one in _described(path).values() if one.plugin is not None]
        elif item in own:
            found.append(own[item])
        else:
            raise RegistryError(f"there is no method {item!r}. Known: {', '.join(sorted(own))}, or give a file")
    return list(dict.fromkeys(found))


def known_methods() -> dict[str, Contestant]:
    """Every method of the project and of installed plugins, by name."""
    return _described(None)


def _described(plugin: str | None) -> dict[str, Contestant]:
    return {
        item["label"]: Contestant(
            label=item["label"],
            key=item["key"],
            tags=tuple(item["tags"]),
            plugin=plugin if item["plugin"] else None,
            code=fingerprint.source_hash(Path(item["source"])),
            libraries=fingerprint.libraries(Path(item["source"]), SLOW_LIBRARIES),
        )
        for item in describe_methods(plugin)
    }


def _specified(method: Method) -> Contestant:
    import sys

    source = sys.modules[type(method).__module__].__file__
    if source is None:
        raise RegistryError(
            f"{type(method).__name__} stands in no file. Put it into one, so that it can be sent around"
        )
    return Contestant(
        label=type(method).__name__,
        key=repr(method),
        code=fingerprint.source_hash(Path(source)),
        libraries=fingerprint.libraries(Path(source), SLOW_LIBRARIES),
        method=method,
    )


@dataclass
class _Group:
    """Cells that share their data. state: what has become of the data."""

    reference: TaskReference
    seed: int
    cells: list[Cell]
    state: str = "open"
    prepared: Prepared | None = None
    running: int = 0


@dataclass
class _Schedule:
    """Hands out work to threads: first cells whose data are there, else data that nobody makes yet."""

    groups: list[_Group]
    condition: threading.Condition = field(default_factory=threading.Condition)

    def take(self) -> tuple[_Group, Cell | None] | None:
        """A cell of a group with data, or a group whose data are to be made; None when nothing is left."""
        with self.condition:
            while True:
                ready = next((group for group in self.groups if group.state == "ready" and group.cells), None)
                if ready is not None:
                    ready.running += 1
                    return ready, ready.cells.pop(0)
                unmade = next((group for group in self.groups if group.state == "open"), None)
                if unmade is not None:
                    unmade.state = "making"
                    return unmade, None
                if not any(group.state == "making" for group in self.groups):
                    return None
                self.condition.wait()

    def made(self, group: _Group, prepared: Prepared) -> None:
        """The data of a group are there."""
        with self.condition:
            group.prepared, group.state = prepared, "ready"
            self.condition.notify_all()

    def finished(self, group: _Group) -> None:
        """A cell of the group is done; the last one frees the data."""
        with self.condition:
            group.running -= 1
            if not group.cells and not group.running:
                group.prepared, group.state = None, "done"

    def abandon(self) -> None:
        """No more work for anybody."""
        with self.condition:
            self.groups.clear()
            self.condition.notify_all()


def run_here(cells: Sequence[Cell], workers: int, finish: Callable[[dict[str, Any]], None]) -> None:
    """The cells on this machine, `workers` at once; `finish` is called with each row, by one thread at a time."""
    grouped: dict[tuple[TaskReference, int], list[Cell]] = defaultdict(list)
    for item in cells:
        grouped[item.task, item.seed].append(item)
    preload(needed(cells))
    schedule = _Schedule([_Group(reference, seed, items) for (reference, seed), items in grouped.items()])
    writing = threading.Lock()

    def work() -> None:
        try:
            while (taken := schedule.take()) is not None:
                group, item = taken
                if item is None:
                    schedule.made(group, prepare(group.reference, group.seed))
                    continue
                assert group.prepared is not None
                row = run_cell(item, group.prepared)
                with writing:
                    finish(row)
                schedule.finished(group)
        except BaseException:
            schedule.abandon()
            raise

    with ThreadPoolExecutor(max_workers=max(1, workers), thread_name_prefix="bench") as pool:
        threads = [pool.submit(work) for _ in range(max(1, workers))]
        try:
            for thread in threads:
                thread.result()
        except BaseException:
            schedule.abandon()
            raise
