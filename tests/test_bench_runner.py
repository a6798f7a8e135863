"""Resuming, fingerprints, the command, and the same table from a Dask cluster that loses a worker."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from benchmarks import fingerprint
from benchmarks.cluster import ClusterError
from benchmarks.runner import command, find_contestants, plan, read_seeds, run
from benchmarks.store import KEY, TIMING, Store
from methods.least_squares import LeastSquares
from methods.registry import RegistryError
from tests.bench_plugins import method, task

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("task") / "linear.py"
    path.write_text(task("linear"))
    return str(path)


def compared(table: pd.DataFrame) -> pd.DataFrame:
    """The table without what may differ from run to run, and without the commit, which may be made in between."""
    return table.drop(columns=[*TIMING, "commit"]).sort_values(list(KEY), ignore_index=True)


def test_a_finished_row_is_not_computed_again(tiny: str, tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    run([tiny], ["least_squares", "constant"], [0], store, workers=1, progress=False)
    first = store.read()
    run([tiny], ["least_squares", "constant"], [0, 1], store, workers=2, progress=False)
    second = store.read()
    assert len(second) == 4
    assert second[second.seed == 0].finished_at.tolist() == first.finished_at.tolist()


def test_changed_code_is_computed_again_and_nothing_else(tiny: str, tmp_path: Path) -> None:
    store, plugin = Store(tmp_path / "store"), tmp_path / "mine.py"
    plugin.write_text(method("mine"))
    run([tiny], ["least_squares", str(plugin)], [0], store, workers=1, progress=False)
    first = store.read().set_index("label")
    plugin.write_text(method("mine", "rng.random()"))
    fingerprint._content_hash.cache_clear()
    fingerprint.source_hash.cache_clear()
    run([tiny], ["least_squares", str(plugin)], [0], store, workers=1, progress=False)
    second = store.read().set_index("label")
    assert second.finished_at["mine"] > first.finished_at["mine"]
    assert second.finished_at["least_squares"] == first.finished_at["least_squares"]
    assert len(store.history()) == 3


def test_retry_takes_up_what_did_not_end_well(tiny: str, tmp_path: Path) -> None:
    store, flag, plugin = Store(tmp_path / "store"), tmp_path / "flag", tmp_path / "moody.py"
    plugin.write_text(method("moody", f"import pathlib\nassert pathlib.Path({str(flag)!r}).exists()"))
    run([tiny], [str(plugin)], [0], store, workers=1, progress=False)
    flag.touch()
    run([tiny], [str(plugin)], [0], store, workers=1, progress=False)
    assert store.read().status.tolist() == ["failed"]
    run([tiny], [str(plugin)], [0], store, workers=1, progress=False, retry=True)
    assert store.read().status.tolist() == ["ok"]


def test_a_specification_is_a_contestant_of_its_own(tiny: str, tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    run([tiny], [LeastSquares(), LeastSquares(decimation=4)], [0], store, workers=2, progress=False)
    assert store.read().method.tolist() == sorted(repr(LeastSquares(decimation=n)) for n in (1, 4))


def test_the_ceiling_alone_is_told_what_is_hidden(tiny: str, tmp_path: Path) -> None:
    body = "assert self.effects == EXPECTED, self.effects"
    for name, tags, expected in (("told", '"ceiling"', '(("coulomb_friction", 1),)'), ("untold", '"physics"', "()")):
        source = method(name, body.replace("EXPECTED", expected)).replace('"single-joint"', tags)
        source = source.replace("    def fit", "    effects: tuple = ()\n\n    def fit")
        (tmp_path / f"{name}.py").write_text(source)
    store = Store(tmp_path / "store")
    run([tiny], [str(tmp_path / "told.py"), str(tmp_path / "untold.py")], [0], store, workers=2, progress=False)
    assert dict(zip(store.read().reason, store.read().status, strict=True)) == {"": "ok"}


def test_a_task_whose_data_fail_leaves_rows_with_the_reason(tmp_path: Path) -> None:
    broken = task("broken").replace("def make(seed):", "def make(seed):\n    raise ValueError('dry')")
    absent = task("absent").replace("memory_gib", "skip=lambda: 'no recordings', memory_gib")
    (tmp_path / "broken.py").write_text(broken)
    (tmp_path / "absent.py").write_text(absent)
    store = Store(tmp_path / "store")
    files = [str(tmp_path / "broken.py"), str(tmp_path / "absent.py")]
    run(files, ["least_squares"], [0], store, workers=2, progress=False)
    table = store.read().set_index("task")
    assert (table.status["broken"], table.status["absent"]) == ("failed", "skipped")
    assert "dry" in table.reason["broken"]
    assert table.reason["absent"] == "no recordings"


def test_unknown_names_are_refused_in_one_line(tmp_path: Path) -> None:
    for tasks, methods in ((["nothing"], ["least_squares"]), ([], ["nothing"])):
        with pytest.raises(RegistryError, match=r"there is no \w+ 'nothing'"):
            plan(tasks, methods, [0])
    with pytest.raises(RegistryError, match="there is no suite"):
        command("nothing", [], [], None, tmp_path, workers=1)
    for text in ("many", "0", "3-1", ""):
        with pytest.raises(RegistryError, match=f"seeds are '{text}'"):
            read_seeds(text)
    assert (read_seeds("3"), read_seeds("2-4,7")) == ((0, 1, 2), (2, 3, 4, 7))


def test_a_fingerprint_follows_imports(tmp_path: Path) -> None:
    own = fingerprint._closure([ROOT / "methods" / "least_squares.py"])
    assert {"methods/differentiation.py", "methods/base.py", "envs/log.py"} <= set(own)
    assert not any(name.startswith(("benchmarks", "envs/plant")) for name in own)
    package = tmp_path / "theirs"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "method.py").write_text("from theirs.helper import x\nimport methods.effects\n")
    (package / "helper.py").write_text("x = 1\n")
    found = fingerprint._closure([package / "method.py"])
    assert {"theirs/helper.py", "methods/effects/coulomb_friction.py"} <= set(found)


def test_a_killed_run_goes_on_where_it_stopped(tiny: str, tmp_path: Path) -> None:
    plugin, store = tmp_path / "slow.py", Store(tmp_path / "store")
    plugin.write_text(method("slow", "import time\ntime.sleep(0.2)"))
    script = tmp_path / "runner.py"
    script.write_text(
        "from benchmarks.runner import run\nfrom benchmarks.store import Store\n"
        f"run([{tiny!r}], [{str(plugin)!r}], range(12), Store({str(store.path)!r}), workers=1, progress=False)\n"
    )
    running = subprocess.Popen([sys.executable, str(script)], cwd=ROOT)
    wait_for(lambda: len(list(store.rows.glob("*.parquet"))) >= 2)
    running.send_signal(signal.SIGKILL)
    running.wait()
    before = store.read().set_index("seed").finished_at
    assert 2 <= len(before) < 12
    run([tiny], [str(plugin)], range(12), store, workers=2, progress=False)
    after = store.read().set_index("seed").finished_at
    assert len(after) == 12
    assert after[before.index].equals(before)


def wait_for(condition, seconds: float = 400.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it takes too long"
        time.sleep(0.05)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """A scheduler and two workers on loopback, each a process of its own."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    file = tmp_path / "scheduler.json"
    common = {"cwd": tmp_path, "env": environment, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    module = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    place = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    processes = [subprocess.Popen([*module, *place], **common)]
    module = [sys.executable, "-m", "distributed.cli.dask_worker"]
    place = ["--no-nanny", "--nthreads", "1", "--no-dashboard", "--scheduler-file", str(file)]
    processes += [subprocess.Popen([*module, *place], **common) for _ in range(2)]
    try:
        import json

        wait_for(file.exists)
        yield json.loads(file.read_text())["address"], processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_the_same_table(
    tiny: str, tmp_path: Path, cluster: tuple[str, list[subprocess.Popen]]
) -> None:
    address, workers = cluster
    plugin = tmp_path / "slow.py"
    plugin.write_text(method("slow", "import time\ntime.sleep(0.3)"))
    methods, seeds = ["least_squares", "constant", str(plugin)], range(5)
    here, there = Store(tmp_path / "here"), Store(tmp_path / "there")
    failures: list[BaseException] = []

    def remote() -> None:
        try:
            run([tiny], methods, seeds, there, workers=1, scheduler=address, progress=False)
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=remote)
    thread.start()
    wait_for(lambda: failures or len(list(there.rows.glob("*.parquet"))) >= 3)
    assert len(list(there.rows.glob("*.parquet"))) < 15, "the kill came too late"
    workers[0].kill()
    run([tiny], methods, seeds, here, workers=2, progress=False)
    thread.join()
    assert failures == []
    local, remote_table = compared(here.read()), compared(there.read())
    assert len(local) == 15
    assert local.status.eq("ok").all()
    pd.testing.assert_frame_equal(local, remote_table, check_exact=True)


def test_no_scheduler_is_one_line(tiny: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.cluster.CONNECTING", 1.0)
    with pytest.raises(ClusterError, match="no Dask scheduler at tcp:"):
        run([tiny], ["constant"], [0], Store(tmp_path), workers=1, scheduler="tcp://127.0.0.1:1", progress=False)


def test_contestants_are_described_without_running_their_code_here(tmp_path: Path) -> None:
    plugin = tmp_path / "shy.py"
    plugin.write_text(method("shy") + "\nimport sys; sys.shy_was_here = True\n")
    (found,) = find_contestants([str(plugin)])
    assert (found.label, found.key, found.tags) == ("shy", "shy()", ("single-joint",))
    assert not hasattr(sys, "shy_was_here")
