"""Where a contestant works: a process of its own that gets training logs and questions, and gives back arrays.

Nothing of the benchmark is imported here but this file. The task's truth and the held-out measurement stay with the
parent; imports of whatever could make them again are refused in this process. That keeps honest plugins honest; it is
no prison for code that means harm.

Protocol over one pipe. To the child, pickled: a `Job`, then, once it has fitted, the `Questions`. To the parent, as
plain JSON and NumPy arrays (never pickled, so that nothing of a plugin runs in the parent): a report of the fit, then
the answers. A report carries a status; the child ends after the first one that is not ``ok``.
"""

from __future__ import annotations

import io
import json
import multiprocessing
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields, is_dataclass, replace
from importlib.abc import MetaPathFinder
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from envs.log import Array, Hold, Log
from methods.base import Cause, Fit, Method, MethodError, Model, Motion, State, Status
from methods.plugins import build_method
from methods.registry import METHODS, RegistryError

REFUSED = ("envs.plant", "benchmarks", "diagnosis.blind")
"""Packages that a contestant may not import: they make or hold the truth."""
GIB = 2**30
PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Contestant:
    """A method by name: its registry entry, the file of the plugin that registers it, or the specification itself.

    label: short name in tables. key: `repr` of the specification. code: hash of its source and of what that imports.
    libraries: slow ones that it imports, so that the server of child processes can import them once for all.
    """

    label: str
    key: str
    tags: tuple[str, ...] = ()
    plugin: str | None = None
    code: str = ""
    libraries: tuple[str, ...] = ()
    method: Method | None = None


@dataclass(frozen=True, eq=False)
class SimulationQuery:
    """A free run: stamps (T,) [s], command (T, n), state at the first stamp, hold of the command."""

    time: Array
    command: Array
    initial: State
    hold: Hold


@dataclass(frozen=True, eq=False)
class InverseQuery:
    """Which command belongs to this motion, at stamps (T,) [s]? The recorded command is not shown."""

    time: Array
    motion: Motion


@dataclass(frozen=True, eq=False)
class Job:
    """What a contestant is given to learn from. effects: names of hidden effects, for the ceiling contestant alone."""

    contestant: Contestant
    logs: tuple[Log, ...]
    entropy: int
    memory_gib: float
    effects: tuple[tuple[str, int], ...] | None = None


@dataclass(frozen=True, eq=False)
class Questions:
    """Asked after the fit, free runs first."""

    simulations: tuple[SimulationQuery, ...]
    inverses: tuple[InverseQuery, ...]


@dataclass(frozen=True, eq=False)
class Answers:
    """What came back. estimates: (name, unit) -> (value, standard error).

    simulations: positions (T, n) per question, inverses: commands (T, n) per question; None where the model does not
    answer that kind of question.
    """

    estimates: Mapping[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    causes: tuple[Cause, ...] | None = None
    verdict: str | None = None
    simulations: tuple[Array, ...] | None = None
    inverses: tuple[Array, ...] | None = None


class _Refuser(MetaPathFinder):
    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> None:
        if fullname != __name__ and f"{fullname}.".startswith(tuple(f"{name}." for name in REFUSED)):
            raise ImportError(f"{fullname} is closed to contestants: it can make the truth that they have to find")


def serve(pipe: Connection) -> None:
    """The child's life: one job, its questions, and the end."""
    _seclude()
    job: Job = pipe.recv()
    floor = _resident()
    _limit_memory(job.memory_gib)
    try:
        model, report = _fit(job)
    except BaseException as error:
        _say(pipe, _failure(error))
        os._exit(0)
    _say(pipe, report)
    try:
        answers, arrays = _answer(model, pipe.recv())
    except EOFError:
        os._exit(0)
    except BaseException as error:
        _say(pipe, _failure(error))
        os._exit(0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    _say(pipe, answers | {"peak_memory_gib": max(0.0, peak - floor) / GIB}, arrays)
    os._exit(0)


def _seclude() -> None:
    """A group of its own, no terminal, no truth, and no life after the parent's."""
    os.setsid()
    multiprocessing.set_start_method(None, force=True)  # a contestant's own processes start as they do elsewhere
    if sys.platform == "linux":
        import ctypes

        parent_died = 1  # PR_SET_PDEATHSIG
        ctypes.CDLL(None).prctl(parent_died, signal.SIGKILL)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nowhere, descriptor)
    for name in [name for name in sys.modules if name.startswith(("envs.plant", "benchmarks."))]:
        if name != __name__:
            del sys.modules[name]
    sys.meta_path.insert(0, _Refuser())


def _resident() -> int:
    with open("/proc/self/statm", encoding="ascii") as content:
        return int(content.read().split()[1]) * PAGE


def _limit_memory(gib: float) -> None:
    """A bound on writable memory, so that a request beyond it is refused before it is touched."""
    with open("/proc/self/statm", encoding="ascii") as content:
        written = int(content.read().split()[5]) * PAGE
    bound = written + int(gib * GIB)
    with suppress(ValueError, OSError):  # a lower bound may be in force already
        resource.setrlimit(resource.RLIMIT_DATA, (bound, bound))


def load(contestant: Contestant) -> Method:
    """The specification of a contestant. Raises RegistryError when there is none of that name."""
    if contestant.method is not None:
        return contestant.method
    if contestant.plugin is not None or contestant.label not in METHODS.names():
        load_methods(contestant.plugin)
    return METHODS[contestant.label].factory()


def load_methods(plugin: str | None = None) -> None:
    """Every method of the project, of installed packages, and of one file."""
    METHODS.load_package("methods")
    METHODS.load_entry_points()
    if plugin is not None:
        METHODS.load_path(Path(plugin))


def describe(pipe: Connection) -> None:
    """A child's life when it is only asked which methods there are, with those of a plugin file."""
    _seclude()
    plugin: str | None = pipe.recv()
    try:
        load_methods(plugin)
        found = []
        for entry in METHODS:
            module = sys.modules[entry.factory.__module__]
            found.append(
                {
                    "label": entry.name,
                    "key": repr(build_method(entry)),
                    "tags": sorted(entry.tags),
                    "source": module.__file__,
                    "plugin": module.__name__.startswith("adeptone_plugin_"),
                }
            )
        _say(pipe, {"status": "ok", "methods": found})
    except BaseException as error:
        reason = _line(error) if isinstance(error, RegistryError) else _failure(error)["reason"]
        _say(pipe, {"status": "failed", "reason": reason})
    os._exit(0)


@contextmanager
def compiling() -> Iterator[Callable[[], float]]:
    """Seconds that numba has spent on compiling so far: a machine does that once, for whichever method comes first."""
    from numba.core import event

    listener = event.TimingListener()
    with event.install_listener("numba:compile", listener):
        yield lambda: listener.duration if listener.done else 0.0


def _fit(job: Job) -> tuple[Model, dict[str, Any]]:
    method = load(job.contestant)
    if job.effects is not None:
        method = replace(method, effects=job.effects)  # type: ignore[type-var]
    rng = np.random.default_rng(job.entropy)
    logs = tuple(replace(log) for log in job.logs)  # read-only again, which pickling forgets
    with compiling() as spent:
        begin = time.perf_counter()
        fit = method.fit(logs, rng)
        seconds = time.perf_counter() - begin - spent()
    if not isinstance(fit, Fit):
        raise TypeError(f"fit returned {type(fit).__name__}, not a Fit")
    estimates = fit.estimates
    with np.errstate(invalid="ignore"):
        errors = estimates.standard_errors
    report = {
        "status": "failed" if fit.status is Status.FAILED else "ok",
        "reason": "; ".join(fit.notes) or "the method reports failure" if fit.status is Status.FAILED else "",
        "fit_seconds": seconds,
        "parameter_count": count_numbers(fit.model),
        "convergence": fit.status.name.lower(),
        "estimates": [
            (name, unit, float(value), float(error))
            for name, unit, value, error in zip(estimates.names, estimates.units, estimates.values, errors, strict=True)
        ],
        "causes": None if fit.causes is None else [(c.effect, c.joint, list(c.rivals)) for c in fit.causes],
        "verdict": fit.verdict,
    }
    return fit.model, report


def _answer(model: Model, questions: Questions) -> tuple[dict[str, Any], dict[str, Array]]:
    arrays: dict[str, Array] = {}
    report: dict[str, Any] = {"status": "ok", "reason": "", "unanswered": []}
    taken = steps = 0.0
    try:
        for k, query in enumerate(questions.simulations):
            begin = time.perf_counter()
            motion = model.simulate(query.time, query.command, query.initial, query.hold)
            if k:  # the first run may compile
                taken, steps = taken + time.perf_counter() - begin, steps + len(query.time)
            arrays[f"simulation_{k}"] = _checked(motion.position, query.command.shape, "simulate")
    except (MethodError, NotImplementedError) as error:
        report["unanswered"].append(f"simulate: {_line(error)}")
    try:
        for k, question in enumerate(questions.inverses):
            command = model.inverse(question.time, question.motion)
            arrays[f"inverse_{k}"] = _checked(command, question.motion.position.shape, "inverse")
    except (MethodError, NotImplementedError) as error:
        report["unanswered"].append(f"inverse: {_line(error)}")
    report["step_microseconds"] = 1e6 * taken / steps if steps else float("nan")
    return report, arrays


def _checked(array: Any, shape: tuple[int, ...], question: str) -> Array:
    found = np.asarray(array, dtype=np.float64)
    if found.shape != shape:
        raise ValueError(f"{question} answered with shape {found.shape} instead of {shape}")
    return found


def _failure(error: BaseException) -> dict[str, Any]:
    if isinstance(error, MethodError):
        return {"status": "skipped", "reason": _line(error)}
    if isinstance(error, MemoryError):
        return {"status": "out_of_memory", "reason": _line(error) or "MemoryError"}
    if isinstance(error, SystemExit):
        return {"status": "crashed", "reason": f"the method left the interpreter with exit status {error.code}"}
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return {"status": "failed", "reason": f"{type(error).__name__}: {_line(error)}{place}"}


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())


def _say(pipe: Connection, report: Mapping[str, Any], arrays: Mapping[str, Array] | None = None) -> None:
    buffer = io.BytesIO()
    text = np.frombuffer(json.dumps(report, default=str).encode(), dtype=np.uint8)
    np.savez(buffer, report=text, **dict(arrays or {}))  # type: ignore[arg-type]
    pipe.send_bytes(buffer.getvalue())


def hear(message: bytes) -> tuple[dict[str, Any], dict[str, Array]]:
    """A report and its arrays, in the parent. Raises ValueError for a message of another kind."""
    with np.load(io.BytesIO(message), allow_pickle=False) as content:
        arrays = {name: content[name] for name in content.files}
    report = json.loads(arrays.pop("report").tobytes().decode())
    return report, arrays


def answers(fitted: Mapping[str, Any], answered: Mapping[str, Any], arrays: Mapping[str, Array]) -> Answers:
    """The two reports of a child as one value."""
    causes = fitted["causes"]
    silent = {item.partition(":")[0] for item in answered["unanswered"]}

    def collected(kind: str, question: str) -> tuple[Array, ...] | None:
        count = sum(name.startswith(kind) for name in arrays)
        return None if question in silent else tuple(arrays[f"{kind}_{k}"] for k in range(count))

    return Answers(
        estimates={(name, unit): (value, error) for name, unit, value, error in fitted["estimates"]},
        causes=None if causes is None else tuple(Cause(name, joint, tuple(rivals)) for name, joint, rivals in causes),
        verdict=fitted["verdict"],
        simulations=collected("simulation", "simulate"),
        inverses=collected("inverse", "inverse"),
    )


def count_numbers(thing: Any) -> int:
    """Floating-point numbers that a model carries, in arrays, tensors and fields; shared ones count once."""
    return _count(thing, set())


def _count(thing: Any, seen: set[int]) -> int:
    if isinstance(thing, float):
        return 1
    if thing is None or isinstance(thing, str | bytes | int | type) or id(thing) in seen:
        return 0
    seen.add(id(thing))
    if isinstance(thing, np.ndarray):
        return thing.size if thing.dtype.kind == "f" else 0
    if type(thing).__module__.partition(".")[0] == "torch" and callable(getattr(thing, "numel", None)):
        return int(thing.numel())
    if is_dataclass(thing):
        return sum(_count(getattr(thing, item.name), seen) for item in fields(thing))
    if isinstance(thing, Mapping):
        return sum(_count(value, seen) for value in thing.values())
    if isinstance(thing, Sequence | set | frozenset):
        return sum(_count(value, seen) for value in thing)
    return sum(_count(value, seen) for value in getattr(thing, "__dict__", {}).values())
