"""The same work on an existing Dask cluster: `run(..., scheduler="tcp://HOST:PORT")`.

The data of a task and seed are made once, where Dask sees fit, and travel between workers; every row is a task of its
own. When a worker dies, Dask gives its rows to another one. A worker has to run the same code and the same versions as
the client, otherwise rows would carry fingerprints that they do not deserve; that is checked.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks import fingerprint
from benchmarks.cells import Cell, Prepared, TaskReference, failed_row, needed, prepare, run_cell
from benchmarks.isolation import preload

CONNECTING = 20.0
"""Time [s] that a scheduler has to answer."""
AHEAD = 2
"""Groups of cells per worker thread that are handed in at a time, so that data do not pile up."""


class ClusterError(ValueError):
    """The cluster cannot be used, said in one line."""


def run_on_cluster(cells: Sequence[Cell], address: str, finish: Callable[[dict[str, Any]], None]) -> None:
    """The cells on the cluster behind `address`; `finish` is called with each row.

    Raises ClusterError when there is no scheduler at the address or a worker runs other code.
    """
    from distributed import Client, as_completed
    from distributed.scheduler import KilledWorker

    groups: dict[tuple[TaskReference, int], list[Cell]] = defaultdict(list)
    for item in cells:
        groups[item.task, item.seed].append(item)
    try:
        client = Client(address, set_as_default=False, timeout=CONNECTING)
    except OSError as error:
        raise ClusterError(f"there is no Dask scheduler at {address} ({error}). Start one: dask scheduler") from None
    setting = _Setting(fingerprint.installation(), needed(cells))
    with client:
        slots = max(1, sum(client.nthreads().values()))
        completed = as_completed(loop=client.loop, raise_errors=False)
        waiting = [_Group(reference, seed, items) for (reference, seed), items in groups.items()]
        group_of: dict[Any, tuple[_Group, Cell]] = {}

        def hand_in() -> None:
            """One group more: its data, and a row for each cell."""
            group = waiting.pop(0)
            key = group.cells[0].fingerprint
            group.data = client.submit(_data, group.reference, group.seed, setting, key=f"data-{key}", retries=2)
            for item in group.cells:
                row = client.submit(_row, item, group.data, setting, key=f"row-{item.fingerprint}", retries=2)
                group_of[row.key] = group, item
                completed.add(row)

        for _ in range(min(len(waiting), AHEAD * slots)):
            hand_in()
        for future in completed:
            group, item = group_of.pop(future.key)
            if future.status == "finished":
                finish(future.result())
            else:
                reason = future.exception()
                if not isinstance(reason, KilledWorker):
                    raise reason
                finish(failed_row(item, "crashed", "every worker that took this row died"))
            group.cells.remove(item)
            if not group.cells:
                group.data = None  # Dask forgets what nobody refers to
                if waiting:
                    hand_in()


@dataclass
class _Group:
    """Cells that share their data, a future."""

    reference: TaskReference
    seed: int
    cells: list[Cell]
    data: Any = None


@dataclass(frozen=True)
class _Setting:
    """What a worker has to be like: the client's code and versions, and the slow libraries of the whole run."""

    code: str
    libraries: tuple[str, ...]

    def establish(self) -> None:
        """Raises ClusterError when this process runs other code."""
        if fingerprint.installation() != self.code:
            raise ClusterError(
                "a worker of the cluster runs other code or other versions than this client. Install the same on both"
            )
        preload(self.libraries)


def _data(reference: TaskReference, seed: int, setting: _Setting) -> Prepared:
    setting.establish()
    return prepare(reference, seed)


def _row(item: Cell, prepared: Prepared, setting: _Setting) -> dict[str, Any]:
    setting.establish()
    return run_cell(item, prepared)
