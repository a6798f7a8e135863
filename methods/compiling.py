"""Compiles the functions of a generated simulator, one process at a time.

What one process has compiled others read from the disk. Of two that need the same at once the second one waits: it
would take just as long by itself, on a core that could do something else. And numba's cache does not stand two at once:
both may give the same number to functions of different arguments, and who reads them calls the wrong one.
"""

from __future__ import annotations

import hashlib
import importlib.util
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
from filelock import FileLock
from numba.core import event
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
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


def compile_lanes(module: ModuleType, name: str, wide: bool) -> None:
    """Compile a generated module's function of several lanes: into instructions for these from lines that are written
    out, which only these functions gain from, and if they are too many to be written out from loops over them, too."""
    _compile(getattr(module, name), int(wide), 1)


def compile_plainly(module: ModuleType, name: str) -> None:
    """The same without such instructions, all functions that it calls compiled anew."""
    functions: list[Any] = [own for own in vars(module).values() if isinstance(own, Dispatcher)]
    for function in functions:
        function._reset_overloads()
        function._cache.flush()
    _compile(getattr(module, name), 0, 0)


def _compile(function: Any, loops: int, lines: int) -> None:
    options: Any = numba.config
    with _one_at_a_time:
        before = options.SLP_VECTORIZE, options.LOOP_VECTORIZE
        options.SLP_VECTORIZE, options.LOOP_VECTORIZE = lines, loops
        try:
            function.compile(normalize_signature(LANES_SIGNATURE)[0])
        finally:
            options.SLP_VECTORIZE, options.LOOP_VECTORIZE = before


def once_per_machine(path: Path, name: str, work: Callable[[], None]) -> None:
    """Do something to a generated file's machine code unless it has been done on this kind of processor; no other
    thread and no other process is at the file meanwhile. It counts as compiling, as does waiting for these."""
    processor = repr((numba.__version__, cpu_target.target_context.codegen().magic_tuple()))
    done = path.with_name(f"{path.stem}.{name}.{hashlib.sha256(processor.encode()).hexdigest()[:8]}")
    if done.exists():
        return
    lock = lock_of(path)
    with event.trigger_event("numba:compile", {"lock": lock.lock_file}), _one_at_a_time, _held(lock):
        if not done.exists():
            work()
            with suppress(OSError):
                done.touch()


def main() -> None:
    """Have the simulator of planar pairs on the disk, before anybody needs it."""
    from methods.effects import vocabulary
    from methods.kernel import build

    build(tuple(vocabulary())).prepare(2)


if __name__ == "__main__":
    main()
