"""Compiles the long functions of a generated simulator, each by one process at a time and some ahead of their use.

What one process has compiled others read from the disk. Of two that need the same at once the second one waits: it
would take just as long by itself, on a core that could do something else.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
from filelock import FileLock, Timeout
from numba.core import event
from numba.core.sigutils import normalize_signature

ENTRIES = ("begin", "_rates", "advance", "compensated", "run", "batch", "batch_one", "batch_pair")
"""Functions of a generated module that are called from outside and that take seconds to compile."""
_SIGNALS = "f8[::1], f8[:, ::1], f8[:, ::1], i8[::1], f8[:, ::1], f8[:, :, ::1]"
_LANES = (
    f"({_SIGNALS}, f8[:, :, ::1], i8[::1], f8[:, :, :, ::1], f8[:, :, :, ::1], b1[:, :, ::1], b1, f8[:, ::1], f8, f8,"
    " i8, f8[:, :, ::1], f8[:, :, ::1], i8, i8, i8, i8)"
)
SIGNATURES = {
    "begin": "(f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], b1[:, ::1])",
    "advance": (
        f"(i8, i8, {_SIGNALS}, f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], b1[:, ::1], b1, f8[::1], f8, f8, i8,"
        " f8[:, ::1], f8[:, :, ::1])"
    ),
    "batch_one": _LANES,
    "batch_pair": _LANES,
}
"""What those that can be compiled ahead take, whichever effects they are about."""
_one_at_a_time = threading.RLock()
_ahead: list[subprocess.Popen[bytes]] = []


def generated(path: Path) -> ModuleType:
    """The generated module of a file."""
    name = f"adeptone_{path.stem}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
        for entry in ENTRIES:
            function = getattr(module, entry)
            function.compile = _by_one_process(function, function.compile, lock_of(path, entry))
    return sys.modules[name]


def lock_of(path: Path, entry: str) -> FileLock:
    """The lock that who compiles a function of a generated file holds; a thread may hold it several times."""
    return FileLock(path.with_suffix(f".{entry}.lock"), is_singleton=True)


def _by_one_process(function: Any, compile_: Callable[[Any], Any], lock: FileLock) -> Callable[[Any], Any]:
    """A function's own `compile`, while no other thread and no other process does the same: numba then finds what they
    have left on the disk. To wait for them counts as compiling."""

    def compiled(signature: Any) -> Any:
        with event.trigger_event("numba:compile", {"dispatcher": function}), _one_at_a_time, _held(lock):
            return compile_(signature)

    return compiled


@contextmanager
def _held(lock: FileLock) -> Iterator[None]:
    try:
        held: Any = lock.acquire()
    except NotImplementedError:  # a file system without locks: each process compiles by itself
        held = nullcontext()
    with held:
        yield


def compile_lanes(function: Any, signature: tuple[Any, ...], wide: bool) -> None:
    """Compile a function of several lanes: into instructions for these from lines that are written out, which only
    these functions gain from, and if they are too many to be written out from loops over them, too."""
    options: Any = numba.config
    with _one_at_a_time:
        before = options.SLP_VECTORIZE, options.LOOP_VECTORIZE
        options.SLP_VECTORIZE, options.LOOP_VECTORIZE = 1, int(wide)
        try:
            function.compile(signature)
        finally:
            options.SLP_VECTORIZE, options.LOOP_VECTORIZE = before


def compile_entry(path: Path, entry: str) -> None:
    """Compile one of `SIGNATURES` of a generated file, unless another process is at it."""
    function, (signature, _) = getattr(generated(path), entry), normalize_signature(SIGNATURES[entry])
    try:
        with lock_of(path, entry).acquire(timeout=0):
            if entry.startswith("batch"):
                compile_lanes(function, signature, wide=entry == "batch_pair")
            else:
                function.compile(signature)
    except (Timeout, NotImplementedError):
        pass


def ahead(path: Path, entries: Sequence[str]) -> None:
    """Have another process compile some of `SIGNATURES` of a generated file, if there is a core for it."""
    if numba.get_num_threads() > 1:
        command = [sys.executable, "-m", "methods.compiling", os.fspath(path), *entries]
        quiet: Any = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        _ahead.append(subprocess.Popen(command, **quiet))


def main(path: str = "", *entries: str) -> None:
    """Compile some of `SIGNATURES` of a generated file; without arguments all of them, for the whole vocabulary."""
    if path:
        for entry in entries:
            compile_entry(Path(path), entry)
        return
    from methods.effects import vocabulary
    from methods.kernel import build

    kernel = build(tuple(vocabulary()))
    for its, entry in ((kernel, "batch_one"), (kernel.of_pairs, "batch_pair"), (kernel, "begin"), (kernel, "advance")):
        assert its.module
        compile_entry(its.path, entry)


if __name__ == "__main__":
    main(*sys.argv[1:])
