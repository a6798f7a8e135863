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
    """function(item) of all items, in their order. Where it is called within itself, threads that have nothing else to
    do help with the inner work: of many long tasks the last one would leave all others idle.

    Results do not depend on the number of threads as long as the function changes nothing that others read. The first
    error that a function raises is raised, once none of them works any more.
    """
    items = list(items)
    if len(items) < 2 or workers() == 1:
        return [function(item) for item in items]
    inside = getattr(_busy, "inside", False)
    pool, found = _pool(workers()), dict[int, Result]()
    left = iter(range(len(items)))  # its next() is atomic

    def work() -> None:
        try:
            for place in left:
                found[place] = function(items[place])
        except BaseException:
            for _ in left:
                pass
            raise

    helpers = [pool.submit(work) for _ in range(min(workers(), len(items)) - inside)]
    try:
        if inside:
            work()
    finally:  # who has not begun has nothing left to do
        begun = [helper for helper in helpers if not helper.cancel()] if inside else helpers
        errors = [helper.exception() for helper in begun]
    for error in errors:
        if error is not None:
            raise error
    return [found[place] for place in range(len(items))]


@lru_cache(maxsize=1)
def _pool(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, thread_name_prefix="each", initializer=_enter)


def _enter() -> None:
    _busy.inside = True
