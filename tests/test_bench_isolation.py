"""What goes wrong in a contestant costs its own row: tried with plugins that really do it."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pandas as pd
import pytest

from benchmarks.runner import find_contestants, run
from benchmarks.store import Store
from benchmarks.worker import compiling
from methods.registry import RegistryError
from tests.bench_plugins import method, task

BAD = {
    "hangs": ("while True: pass", "timed_out", "2 s"),
    "sleeps_with_children": (
        "import subprocess, time\nsubprocess.Popen(['sleep', '98765'])\ntime.sleep(1e6)",
        "timed_out",
        "2 s",
    ),
    "fills_memory": ("kept = []\nwhile True: kept.append(np.ones(4_000_000))", "out_of_memory", "allocate"),
    "fills_shared_memory": (
        "import mmap\nkept = []\nwhile True:\n    kept.append(mmap.mmap(-1, 2**26))\n    kept[-1].write(bytes(2**26))",
        "out_of_memory",
        "more than 0.5 GiB",
    ),
    "asks_for_everything": ("np.ones((200, 1000, 1000, 1000))", "out_of_memory", "allocate"),
    "leaves": ("import os\nos._exit(3)", "crashed", "exit status 3"),
    "leaves_politely": ("import sys\nsys.exit(4)", "crashed", "exit status 4"),
    "segfaults": ("import ctypes\nctypes.string_at(0)", "crashed", "SIGSEGV"),
    "raises": ("raise ZeroDivisionError('no pivot')", "failed", "ZeroDivisionError: no pivot"),
    "declines": (
        "from methods.base import MethodError\nraise MethodError('not for me', remedy='Ask another')",
        "skipped",
        "not for me. Ask another",
    ),
    "looks_for_the_truth": ("import envs.plant.plant", "failed", "closed to contestants"),
    "looks_for_the_task": ("import benchmarks.tasks.base", "failed", "closed to contestants"),
    "returns_nothing": ("return None", "failed", "not a Fit"),
    "prints": ("print('noise ' * 100_000)", "ok", ""),
    "writes_into_the_logs": ("logs[0].position[0] = 1.0", "failed", "read-only"),
}
WRONG_SHAPE = """
from dataclasses import dataclass, replace
import numpy as np
from methods.base import Model
from methods.least_squares import LeastSquares
from methods.registry import METHODS


class Flat(Model):
    joints, inputs = (1,), ("voltage",)

    def inverse(self, time, motion, command=None):
        return np.zeros(len(time))

    def simulate(self, time, command, initial, hold="zero_order"):
        raise NotImplementedError("no free runs")


@METHODS.register("wrong_shape", "single-joint")
@dataclass(frozen=True)
class WrongShape(LeastSquares):
    def fit(self, logs, rng):
        return replace(super().fit(logs, rng), model=Flat())
"""


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """One run with every bad plugin, a good one among them."""
    folder = tmp_path_factory.mktemp("isolation")
    (folder / "tiny.py").write_text(task())
    (folder / "brief.py").write_text(task("brief", 2.0))
    (folder / "wrong_shape.py").write_text(WRONG_SHAPE)
    for name, (body, _, _) in BAD.items():
        (folder / f"{name}.py").write_text(method(name, body))
    store = Store(folder / "store")
    slow = [str(folder / f"{name}.py") for name, (_, status, _) in BAD.items() if status == "timed_out"]
    rest = [str(folder / f"{name}.py") for name in [*BAD, "wrong_shape"]]
    run([str(folder / "brief.py")], slow, [0], store, workers=2, progress=False)
    rest = [file for file in rest if file not in slow]
    run([str(folder / "tiny.py")], ["least_squares", *rest], [0], store, workers=2, progress=False)
    return store.read().set_index("label")


@pytest.mark.parametrize("name", BAD)
def test_a_bad_plugin_costs_its_own_row(table: pd.DataFrame, name: str) -> None:
    _, status, reason = BAD[name]
    row = table.loc[name]
    assert (row.status, reason in row.reason) == (status, True), row.reason
    assert "\n" not in row.reason
    assert (row.status == "ok") == pd.notna(row.inverse_error)


def test_a_good_plugin_beside_them_is_measured(table: pd.DataFrame) -> None:
    assert table.loc["least_squares"].status == "ok"
    assert table.loc["least_squares"].inverse_error_relative < 0.1


def test_an_answer_of_the_wrong_shape_is_refused(table: pd.DataFrame) -> None:
    row = table.loc["wrong_shape"]
    assert row.status == "failed"
    assert "inverse answered with shape" in row.reason


def test_nothing_is_left_running(table: pd.DataFrame) -> None:
    for _ in range(50):
        commands = [path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline") if os.access(path, os.R_OK)]
        if not any(command == b"sleep\x0098765\x00" for command in commands):
            return
        time.sleep(0.1)
    pytest.fail("a grandchild outlived its plugin")


def test_a_plugin_that_ends_the_interpreter_at_import_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "kamikaze.py").write_text("import os; os._exit(7)")
    with pytest.raises(RegistryError, match=r"kamikaze\.py cannot be loaded: it ends the interpreter: exit status 7"):
        find_contestants([str(tmp_path / "kamikaze.py")])


def test_seconds_of_compiling_are_told_apart() -> None:
    from numba import njit

    @njit
    def double(x: float) -> float:
        return 2.0 * x

    with compiling() as first:
        double(1.0)
        assert first() > 0.0
    with compiling() as again:
        double(1.0)
        assert again() == 0.0
