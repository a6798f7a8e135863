"""The generated simulator is compiled once: by one process at a time, for one kind of arguments."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numba.core.sigutils import normalize_signature

from benchmarks.worker import compiling
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import stack
from diagnosis.replay import replay
from envs.log import JointFacts, Log
from methods.base import State
from methods.compiling import LANES_SIGNATURE, generated, lock_of, once_per_machine
from methods.effects import vocabulary
from methods.kernel import BEGINNING, Kernel, build
from methods.lane_check import Check
from methods.structured import PlanarCoupling, StructuredJoint, StructuredModel

FILE = """
from numba import njit

@njit(cache=True)
def inner(x):
    return 2.0 * x

@njit(cache=True)
def outer(x):
    return inner(x)
"""
CALLS = """
import sys
from pathlib import Path
from methods.compiling import generated
module = generated(Path(sys.argv[1]))
print("ready", flush=True)
assert module.inner(1.0) == 2.0
print(sum(module.inner.stats.cache_hits.values()), sum(module.inner.stats.cache_misses.values()))
"""
HOLDS = """
import sys, time
from pathlib import Path
from methods.compiling import lock_of
with lock_of(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(1.0)
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "kernel_of_a_test.py"
    file.write_text(FILE)
    sys.modules.pop(f"adeptone_{file.stem}", None)
    return file


@contextmanager
def running(script: str, path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that has said its first word."""
    with subprocess.Popen([sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() in ("ready\n", "held\n")
        yield other


def test_who_comes_second_waits_and_reads_from_the_disk(path: Path) -> None:
    """Whatever the arguments are: numba's cache gives the same number to two functions that come at once."""
    with lock_of(path), running(CALLS, path) as other:
        with pytest.raises(subprocess.TimeoutExpired):
            other.wait(timeout=3)
        assert generated(path).outer(1.0) == 2.0  # who holds the lock may take it again
        lock_of(path).release()
        assert other.communicate(timeout=60)[0] == "1 0\n"


def test_to_wait_for_another_process_is_to_compile(path: Path) -> None:
    module = generated(path)
    with running(HOLDS, path), compiling() as spent:
        assert module.outer(1.0) == 2.0
    assert spent() > 0.5


def test_to_wait_for_another_process_to_check_is_to_compile(path: Path) -> None:
    done: list[str] = []
    with running(HOLDS, path), compiling() as spent:
        once_per_machine(path, "check", lambda: done.append("checked"))
    once_per_machine(path, "check", lambda: done.append("again"))
    assert done == ["checked"]
    assert spent() > 0.5


def test_the_vocabularys_simulator_is_compiled_once_for_all_who_use_it() -> None:
    """Whoever simulates, fits and replays, one joint or two, logs that may be written to and others: another kind of
    arguments would cost a minute."""
    kernel = build(tuple(vocabulary()))
    nominal = {"inertia": 0.05, "viscous": 0.1, "back_emf": 0.1, "electrical_time_constant": 2e-3}
    stepping = [kernel.module.begin, kernel.module.advance]
    known: list[set[object]] = []
    for count, written in ((1, True), (1, False), (2, True), (2, False)):
        parts = tuple(StructuredJoint(j + 1, "voltage", nominal, {}) for j in range(count))
        model = StructuredModel(parts, 2e-3, PlanarCoupling(0.02, 1.0, 0.05) if count == 2 else None)
        time = np.arange(400) * 2e-3
        command = np.sin(np.outer(time, np.arange(1, count + 1)))
        for array in (time, command):
            array.setflags(write=written)
        moving = State(np.zeros(count), np.ones(count), np.ones(count))
        position = model.simulate(time, command, moving).position
        facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=1e-5),) * count
        log = Log(time, command, position, tuple(range(1, count + 1)), facts=facts)
        problem = stack(kernel, [log], log.joints, pair=count == 2, burn_in=0.1)
        replay(problem, fit_nominal(problem, (JointStructure(),) * count).point, window=0.2)
        known.append({signature for function in stepping for signature in function.signatures})
    assert known[1:] == known[:-1]
    lanes = normalize_signature(LANES_SIGNATURE)[0]
    assert kernel.module.batch_one.signatures == kernel.of_pairs.module.batch_pair.signatures == [lanes]


def test_what_is_compiled_anew_is_compared_with_one_candidate_at_a_time() -> None:
    kernel = build(tuple(vocabulary()))
    for joints in (1, 2):
        kernel.prepare(joints)
        check = Check.of(kernel, joints)
        assert check.holds(kernel)
        assert np.ptp(check.alone, axis=1).min() > 0.0
        resting = list(check.arguments)
        place = next(i for i, own in enumerate(resting) if np.shape(own)[-1:] == (len(BEGINNING),))
        resting[place] = resting[place] * (np.arange(len(BEGINNING)) != 1)  # all velocities left out
        assert not replace(check, arguments=tuple(resting)).holds(kernel)


@pytest.mark.parametrize("holds", [True, False])
def test_lanes_that_err_are_compiled_without_vectors_once(
    holds: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    monkeypatch.setenv("ADEPTONE_CACHE", str(tmp_path))
    monkeypatch.setattr("methods.kernel.compile_lanes", lambda module, name, wide: done.append(name))
    monkeypatch.setattr("methods.kernel.compile_plainly", lambda module, name: done.append(f"{name} plainly"))
    monkeypatch.setattr(Kernel, "begin_a_lane", lambda self: done.append("beginning"))
    monkeypatch.setattr(Check, "of", lambda kernel, joints: SimpleNamespace(holds=lambda kernel: holds))
    for _ in range(2):  # the second one is another process's
        kernel = build(tuple(vocabulary())[:1])
        kernel.prepare(1)
        kernel.prepare(1)
    anew = ["beginning", "batch_one"] + ["batch_one plainly"] * (not holds)
    assert done == [*anew, "batch_one", "batch_one"]
