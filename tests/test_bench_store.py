"""Rows survive kills, are merged without loss, and are read as the latest state of affairs."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.store import KEY, Store


def row(number: int, *, fingerprint: str | None = None, finished_at: str = "2026-01-01", **more: object) -> dict:
    return {
        "task": f"task{number // 10}",
        "method": "M()",
        "seed": number % 10,
        "fingerprint": fingerprint or f"print{number}",
        "status": "ok",
        "finished_at": finished_at,
        "error": number / 7.0,
        "curve": [1.0, number / 3.0],
        **more,
    }


def append_for_ever(path: Path) -> None:
    store = Store(path)
    for number in range(10**9):
        store.append(row(number))


def test_rows_come_back_to_the_last_bit(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.append(row(3, missing=float("nan"), endless=float("inf"), nothing=[]))
    found = store.read().iloc[0]
    assert found.error == 3 / 7.0
    assert list(found.curve) == [1.0, 1.0]
    assert np.isnan(found.missing)
    assert found.endless == float("inf")
    assert list(found.nothing) == []


def test_an_empty_store_reads_as_an_empty_table(tmp_path: Path) -> None:
    assert Store(tmp_path / "none").fingerprints() == {}
    assert set(KEY) <= set(Store(tmp_path / "none").read().columns)


@pytest.mark.parametrize("after", [0.3, 0.35, 0.4])
def test_a_kill_leaves_whole_rows_only(tmp_path: Path, after: float) -> None:
    writer = multiprocessing.get_context("fork").Process(target=append_for_ever, args=(tmp_path,))
    writer.start()
    while not list(tmp_path.glob("rows/*.parquet")):
        time.sleep(0.01)
    time.sleep(after)
    assert writer.pid is not None
    os.kill(writer.pid, signal.SIGKILL)
    writer.join()
    table = Store(tmp_path).read()
    assert len(table) >= 1
    assert table.error.tolist() == [
        (10 * int(task[4:]) + seed) / 7.0 for task, seed in zip(table.task, table.seed, strict=True)
    ]


def test_merging_loses_nothing_and_may_be_cut_anywhere(tmp_path: Path) -> None:
    store = Store(tmp_path)
    for number in range(7):
        store.append(row(number))
    before = store.read()
    store.merge(above=0)
    assert not list(store.rows.glob("*.parquet"))
    assert store.read().equals(before)
    store.append(row(3))  # as if the merge had been killed before it removed this row
    store.append(row(8))
    assert len(store.read()) == 8
    store.merge(above=0)
    assert len(store.read()) == len(store.history()) == 8


def test_the_latest_row_of_a_key_counts(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.append(row(1, fingerprint="new", finished_at="2026-02-01", note="new"))
    store.append(row(1, fingerprint="old", finished_at="2026-01-01", note="old"))
    assert store.read().note.tolist() == ["new"]
    assert len(store.history()) == 2


def test_a_row_without_an_old_column_reads_as_missing(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.append(row(1))
    store.append(row(2, added=5.0))
    assert store.read().added.isna().tolist() == [True, False]
