"""Compiles the functions of a generated simulator, one process at a time.

What one process has compiled others read from the disk. Of two that need the same at once the second one waits: it
would take just as long by itself, on a core that could do something else. And numba's cache does not stand two at once:
both may give the same number to functions of different arguments, and who reads them calls the wrong one.
"""

from __future__ import annotations

import importlib.util
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
from filelock import FileLock
from numba.core import event
from numba.core.dispatcher import Dispatcher
from numba.core.sigutils import normalize_signature

LANES_SIGNATURE = (
    "(f8[::1], f8[:, ::1], f8[:, ::1], i8[::1], f8[:, ::1], f8[:, :, ::1], f8[:, :, ::1], i8[::1], f8[:, :, :, ::1],"
    " f8[:, :, :, ::1], b1[:, :, ::1], b1, f8[:, ::1], f8, f8, i8, f8[:, :, ::1], f8[:, :, ::1], i8, i8, i8, i8)"
)
"""What `batch_one` and `batch_pair` of a generated module take."""
_one_at_a_time = threading.RLock()


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
        lock = lock_of(path)
        for function in vars(module).values():
            if isinstance(function, Dispatcher):
                function.compile = _by_one_process(function.compile, lock)  # type: ignore[method-assign, assignment]
    return sys.modules[name]


def lock_of(path: Path) -> FileLock:
    """The lock that who compiles functions of a generated file holds; a thread may hold it several times."""
    return FileLock(path.with_suffix(".lock"), is_singleton=True)


def _by_one_process(compile_: Callable[[Any], Any], lock: FileLock) -> Callable[[Any], Any]:
    """A function's own `compile`, while no other thread and no other process is at this file. Waiting for them counts
    as compiling."""

    def compiled(signature: Any) -> Any:
        with event.trigger_event("numba:compile", {"lock": lock.lock_file}), _one_at_a_time, _held(lock):
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


def main() -> None:
    """Have the simulator of planar pairs on the disk, before anybody needs it."""
    from methods.effects import vocabulary
    from methods.kernel import build

    pairs = build(tuple(vocabulary())).of_pairs
    compile_lanes(pairs.module.batch_pair, normalize_signature(LANES_SIGNATURE)[0], wide=True)


if __name__ == "__main__":
    main()
