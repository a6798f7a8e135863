"""Work on all cores by threads: compiled simulations, filters and matrix products let go of the interpreter's lock."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TypeVar

import numba

Item = TypeVar("Item")
Result = TypeVar("Result")
_busy = threading.local()


def workers() -> int:
    """Threads that work at once: those of numba (NUMBA_NUM_THREADS), all cores unless said otherwise."""
    return numba.get_num_threads()


def each(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """function(item) of all items, in their order. Where it is called within itself, the inner work is serial.

    Results do not depend on the number of threads as long as the function changes nothing that others read.
    """
    items = list(items)
    if len(items) < 2 or workers() == 1 or getattr(_busy, "inside", False):
        return [function(item) for item in items]
    return list(_pool(workers()).map(function, items))


@lru_cache(maxsize=1)
def _pool(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, thread_name_prefix="each", initializer=_enter)


def _enter() -> None:
    _busy.inside = True
