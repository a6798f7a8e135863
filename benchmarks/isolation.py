"""Child processes with limits: what goes wrong in one costs its own row and nothing else.

Children are forked from a server that has imported NumPy, SciPy, numba and every method once, so that a start takes
milliseconds. The server runs with one thread per library, so that results do not depend on the number of cores.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from types import ModuleType
from typing import Any

import psutil

from benchmarks.worker import GIB, Job, Questions, answers, describe, hear, serve
from methods.registry import RegistryError

SLOW_LIBRARIES = ("torch", "pysindy", "mujoco")
"""Imported by the server only where a contestant of the run needs them."""
SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
WATCH_SECONDS = 0.02


@dataclass(frozen=True, eq=False)
class Outcome:
    """How an attempt ended. `fitted` and `answered` are the child's reports as far as they came."""

    status: str
    reason: str
    fitted: dict[str, Any] = field(default_factory=dict)
    answered: dict[str, Any] = field(default_factory=dict)
    answers: Any = None


@dataclass
class _Server:
    """The server that children are forked from, one per process: its lock, and the slow libraries that it has."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    libraries: frozenset[str] = frozenset()


_SERVER = _Server()


def preload(libraries: Iterable[str]) -> None:
    """Makes sure that the server has these libraries. To be called before the first child of a run: a restart of the
    server ends the children that it has.
    """
    with _SERVER.lock:
        if not _SERVER.libraries.issuperset(libraries):
            _SERVER.libraries = _SERVER.libraries.union(libraries)
            forkserver._forkserver._stop()  # type: ignore[attr-defined] # it starts again with the next child


class Watch:
    """Kills a child with its whole group at a deadline or above a bound on memory, and remembers why."""

    def __init__(self, process: ForkServerProcess, memory_gib: float):
        self.process, self.memory_gib = process, memory_gib
        self.deadline, self.budget = float("inf"), float("inf")
        self.verdict: tuple[str, str] | None = None
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def allow(self, seconds: float) -> None:
        """Sets the deadline `seconds` from now."""
        self.budget, self.deadline = seconds, time.monotonic() + seconds

    def stop(self) -> None:
        """Ends the watch and whatever is left of the child."""
        self._done.set()
        self._thread.join()
        kill(self.process)
        self.process.join()

    def _run(self) -> None:
        base: int | None = None
        rounds = 0
        while not self._done.wait(WATCH_SECONDS):
            if not _alive(self.process.pid):
                kill(self.process)  # grandchildren that hold the pipe open
                return
            resident = _resident(self.process.pid, descendants=rounds % 10 == 9)
            rounds += 1
            base = min(base or resident, resident)
            if resident - base > self.memory_gib * GIB:
                self._end("out_of_memory", f"more than {self.memory_gib:g} GiB of memory")
            elif time.monotonic() > self.deadline:
                self._end("timed_out", f"no result within {self.budget:g} s")

    def _end(self, status: str, reason: str) -> None:
        self.verdict = self.verdict or (status, reason)
        kill(self.process)


def attempt(job: Job, questions: Questions, budget_seconds: float) -> Outcome:
    """A contestant's fit and answers in a child of their own."""
    process, pipe = _start(serve)
    watch = Watch(process, job.memory_gib)
    fitted: dict[str, Any] = {}
    try:
        watch.allow(budget_seconds)
        pipe.send(job)
        fitted, _ = hear(pipe.recv_bytes())
        if fitted["status"] == "skipped" or "estimates" not in fitted:
            return Outcome(fitted["status"], fitted["reason"], fitted)
        watch.allow(budget_seconds)
        pipe.send(questions)
        answered, arrays = hear(pipe.recv_bytes())
        if answered["status"] != "ok":
            return Outcome(answered["status"], answered["reason"], fitted)
        reason = "; ".join([*([fitted["reason"]] if fitted["reason"] else []), *answered["unanswered"]])
        return Outcome(fitted["status"], reason, fitted, answered, answers(fitted, answered, arrays))
    except (EOFError, ConnectionError):
        ended = _ending(process)
        status, reason = watch.verdict or ("crashed", f"the interpreter ended: {ended}")
        return Outcome(status, reason, fitted)
    except (ValueError, KeyError, TypeError) as error:
        return Outcome("failed", f"the answer cannot be read: {' '.join(str(error).split())}", fitted)
    finally:
        pipe.close()
        watch.stop()


def describe_methods(plugin: str | None, seconds: float = 120.0) -> list[dict[str, Any]]:
    """The methods of the project and of one plugin file; a plugin's code runs in a child only.

    Raises RegistryError, in one line, when the plugin cannot be loaded.
    """
    process, pipe = _start(describe)
    watch = Watch(process, 4.0)
    try:
        watch.allow(seconds)
        pipe.send(plugin)
        report, _ = hear(pipe.recv_bytes())
    except (EOFError, ConnectionError):
        ended = _ending(process)
        _, reason = watch.verdict or ("", f"it ends the interpreter: {ended}")
        raise RegistryError(f"{plugin or 'an installed plugin'} cannot be loaded: {reason}. Mend it") from None
    finally:
        pipe.close()
        watch.stop()
    if report["status"] != "ok":
        raise RegistryError(report["reason"])
    return report["methods"]


def call(function: Callable[..., Any], *arguments: Any) -> Any:
    """The project's own function in a child of its own, without limits. Raises what it raises."""
    process, pipe = _start(_answer_call)
    try:
        pipe.send_bytes(pickle.dumps((function, arguments)))
        good, result = pipe.recv()
    except (EOFError, ConnectionError):
        raise RuntimeError(f"{function.__name__} ended the interpreter: {_ending(process)}") from None
    finally:
        pipe.close()
        kill(process)
        process.join()
    if good:
        return result
    raise result


def _answer_call(pipe: Connection) -> None:
    os.setsid()
    function, arguments = pickle.loads(pipe.recv_bytes())
    try:
        answer = (True, function(*arguments))
    except Exception as error:
        answer = (False, error)
    try:
        pipe.send(answer)
    except (pickle.PicklingError, AttributeError, TypeError):
        pipe.send((False, RuntimeError(f"{type(answer[1]).__name__}: {answer[1]}")))


def _start(target: Callable[[Connection], None]) -> tuple[ForkServerProcess, Connection]:
    context = multiprocessing.get_context("forkserver")
    here, there = context.Pipe()
    with _SERVER.lock, _plain_process(), _single_threaded():
        context.set_forkserver_preload(["benchmarks.preload", *sorted(_SERVER.libraries)])
        resource_tracker.ensure_running()
        forkserver.ensure_running()
        process = context.Process(target=target, args=(there,))
        process.start()
    there.close()
    return process, here


@contextlib.contextmanager
def _plain_process() -> Iterator[None]:
    """Children import neither the caller's main script nor mind that a cluster's worker is a daemon."""
    main, config = sys.modules["__main__"], multiprocessing.current_process()._config  # type: ignore[attr-defined]
    daemon = config.pop("daemon", None)
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        if daemon is not None:
            config["daemon"] = daemon


@contextlib.contextmanager
def _single_threaded() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in SINGLE_THREADED}
    os.environ.update(dict.fromkeys(SINGLE_THREADED, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def kill(process: ForkServerProcess) -> None:
    """Ends a child and everything that it started."""
    if process.pid is None:
        return
    with contextlib.suppress(ProcessLookupError, PermissionError):
        if os.getpgid(process.pid) == process.pid:
            os.killpg(process.pid, signal.SIGKILL)
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    if process.is_alive():
        process.kill()


def _alive(pid: int | None) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.Error:
        return False


def _resident(pid: int | None, *, descendants: bool) -> int:
    """Resident memory of a process [B], with that of its descendants when asked for; 0 when it is gone."""
    try:
        process = psutil.Process(pid)
        whole = [process, *(process.children(recursive=True) if descendants else ())]
        return sum(item.memory_info().rss for item in whole)
    except psutil.Error:
        return 0


def _ending(process: ForkServerProcess) -> str:
    """How a child ended. A start asks after all children, too, and only who asks first is told."""
    with _SERVER.lock:
        process.join(1.0)
        code = process.exitcode
    if code is None:
        return "unknown"
    if code < 0:
        return f"signal {signal.Signals(-code).name}"
    return f"exit status {code}"
