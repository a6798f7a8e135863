"""The generated simulator is compiled once: by one process at a time, for one kind of arguments."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from numba.core.sigutils import normalize_signature

from benchmarks.worker import compiling
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import stack
from diagnosis.replay import replay
from envs.log import JointFacts, Log
from methods.base import State
from methods.compiling import ENTRIES, SIGNATURES, compile_entry, generated, lock_of
from methods.effects import vocabulary
from methods.kernel import build
from methods.structured import PlanarCoupling, StructuredJoint, StructuredModel

FILE = "from numba import njit\n" + "".join(
    f"@njit(cache=True)\ndef {entry}(x):\n    return 2.0 * x\n" for entry in ENTRIES
)
CALLS_BEGIN = """
import sys
from pathlib import Path
from methods.compiling import generated
module = generated(Path(sys.argv[1]))
print("ready", flush=True)
assert module.begin(1.0) == 2.0
print(sum(module.begin.stats.cache_hits.values()), sum(module.begin.stats.cache_misses.values()))
"""


HOLDS = """
import sys, time
from pathlib import Path
from methods.compiling import lock_of
with lock_of(Path(sys.argv[1]), sys.argv[2]):
    print("held", flush=True)
    time.sleep(float(sys.argv[3]))
"""


@contextmanager
def held_by_another_process(path: Path, entry: str, seconds: float) -> Iterator[None]:
    command = [sys.executable, "-c", HOLDS, str(path), entry, str(seconds)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        yield
        other.kill()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "kernel_of_a_test.py"
    file.write_text(FILE)
    sys.modules.pop(f"adeptone_{file.stem}", None)
    return file


def test_who_comes_second_waits_and_reads_from_the_disk(path: Path) -> None:
    with lock_of(path, "begin"):
        other = subprocess.Popen([sys.executable, "-c", CALLS_BEGIN, str(path)], stdout=subprocess.PIPE, text=True)
        assert other.stdout is not None
        assert other.stdout.readline() == "ready\n"
        with pytest.raises(subprocess.TimeoutExpired):
            other.wait(timeout=3)
        assert generated(path).begin(1.0) == 2.0  # who holds a lock may take it again
    assert other.communicate(timeout=60)[0] == "1 0\n"


def test_to_wait_for_another_process_is_to_compile(path: Path) -> None:
    module = generated(path)
    with held_by_another_process(path, "advance", 1.0), compiling() as spent:
        assert module.advance(1.0) == 2.0
    assert spent() > 0.5


def test_what_another_process_compiles_is_not_compiled_ahead(path: Path) -> None:
    with held_by_another_process(path, "begin", 5.0):
        compile_entry(path, "begin")
    assert generated(path).begin.signatures == []


def test_the_vocabularys_simulator_is_called_as_it_is_compiled_ahead() -> None:
    """By whoever simulates, fits and replays: what is called otherwise is compiled again, for a minute."""
    kernel = build(tuple(vocabulary()))
    entries = {name: getattr(kernel.module, name) for name in SIGNATURES}
    entries["batch_pair"] = kernel.of_pairs.module.batch_pair
    expected = {name: {normalize_signature(SIGNATURES[name])[0]} for name in entries}
    others = {name: set(function.signatures) - expected[name] for name, function in entries.items()}
    nominal = {"inertia": 0.05, "viscous": 0.1, "back_emf": 0.1, "electrical_time_constant": 2e-3}
    time = np.arange(400) * 2e-3
    for count in (1, 2):
        parts = tuple(StructuredJoint(j + 1, "voltage", nominal, {}) for j in range(count))
        model = StructuredModel(parts, 2e-3, PlanarCoupling(0.02, 1.0, 0.05) if count == 2 else None)
        command = np.sin(np.outer(time, np.arange(1, count + 1)))
        for array in (time, command):
            array.setflags(write=False)
        moving = State(np.zeros(count), np.ones(count), np.ones(count))
        position = model.simulate(time, command, moving).position
        facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=1e-5),) * count
        log = Log(time, command, position, tuple(range(1, count + 1)), facts=facts)
        problem = stack(kernel, [log], log.joints, pair=count == 2, burn_in=0.1)
        point = fit_nominal(problem, (JointStructure(),) * count).point
        replay(problem, point, window=0.2)
    for name, function in entries.items():
        assert set(function.signatures) - others[name] == expected[name], name
