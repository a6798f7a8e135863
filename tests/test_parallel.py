"""Work on all cores: order, errors, and idle threads that help with inner work."""

from __future__ import annotations

import threading
import time

import pytest

from methods import parallel
from methods.parallel import each


@pytest.fixture(autouse=True)
def _two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "workers", lambda: 2)


def test_results_come_in_the_order_of_the_items() -> None:
    assert each(lambda n: each(lambda m: (n, m), range(n)), range(6)) == [[(n, m) for m in range(n)] for n in range(6)]


def test_an_idle_thread_helps_with_the_inner_work_of_the_last_task() -> None:
    def whoever(_: int) -> str:
        time.sleep(0.02)
        return threading.current_thread().name

    threads = each(lambda count: set(each(whoever, range(count))), (1, 20))
    assert len(threads[1]) == 2


def test_no_more_threads_work_at_once_than_there_are() -> None:
    working, most, lock = 0, 0, threading.Lock()

    def counted(depth: int) -> None:
        nonlocal working, most
        if depth:
            each(counted, [depth - 1] * 3)
            return
        with lock:
            working += 1
            most = max(most, working)
        time.sleep(0.002)
        with lock:
            working -= 1

    each(counted, [3, 3, 3])
    assert most == 2


@pytest.mark.parametrize("depth", [0, 1, 2])
def test_an_error_is_raised_once_nothing_works_any_more(depth: int) -> None:
    running = 0

    def failing(item: int) -> None:
        nonlocal running
        running += 1
        try:
            time.sleep(0.002)
            if item == 2:
                raise ValueError("item 2")
        finally:
            running -= 1

    def nested(level: int) -> list:
        return each(failing, range(20)) if level == 0 else each(nested, [level - 1] * 2)

    with pytest.raises(ValueError, match="item 2"):
        nested(depth)
    assert running == 0
    assert each(str, range(3)) == ["0", "1", "2"]
