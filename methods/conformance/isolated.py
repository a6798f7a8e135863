"""Checks in a process of their own, so that a plugin that hangs or crashes the interpreter fails one check only.

The child sends ``(BEGIN, check)`` before each check and the result after it; ``(REFUSED, text)`` when there is nothing
to check. A child that says nothing for longer than the patience is killed.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from methods.conformance.check import Check, Outcome, Result, examine_all, undeclared
from methods.registry import RegistryError, one_line

BEGIN, RESULT, REFUSED, END = "begin", "result", "refused", "end"
STARTUP = 120.0
"""Seconds that importing a plugin and everything it needs may take."""
FITS = 5
"""Fits within one check, at most: the patience is as many budgets."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """What is checked: the table, the subject, and the failures that it declares."""

    checks: Sequence[Check[Any]]
    subject: Any
    expected: dict[str, str]


Prepare = Callable[[str, float], Prepared]
"""From what the user names, and the budget [s], to what is checked; a function at module level."""


def examine_isolated(prepare: Prepare, text: str, budget: float) -> Iterator[Result]:
    """Results as they come. Raises RegistryError when there is nothing to check."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=_work, args=(there, prepare, text, budget), daemon=True)
    child.start()
    there.close()
    running: Check[Any] | None = None
    try:
        while True:
            patience = STARTUP if running is None else FITS * budget
            if not here.poll(patience):
                yield _lost(running, f"it does not end within {patience:g} s")
                return
            try:
                kind, content = here.recv()
            except EOFError:
                child.join()
                yield _lost(running, f"it ends the interpreter (exit status {child.exitcode})")
                return
            if kind == REFUSED:
                raise RegistryError(content)
            if kind == END:
                return
            if kind == BEGIN:
                running = content
            else:
                yield content
    finally:
        child.kill()
        child.join()
        here.close()


def _lost(running: Check[Any] | None, reason: str) -> Result:
    """The result of a check that never came back; those after it are not run."""
    if running is None:
        raise RegistryError(f"the plugin cannot be loaded: {reason}. Mend it")
    return Result(running.name, running.promise, Outcome.FAILED, f"{reason}; the checks after it are not run")


def _work(pipe: Connection, prepare: Prepare, text: str, budget: float) -> None:
    try:
        prepared = prepare(text, budget)
        if unknown := undeclared(prepared.checks, prepared.expected):
            raise RegistryError(f"{text} declares the failure of {unknown[0]!r}, which is no check. Correct the name")
    except RegistryError as error:
        pipe.send((REFUSED, str(error)))
        return
    except (Exception, SystemExit) as error:
        pipe.send((REFUSED, f"{text} cannot be checked: {one_line(error)}. Mend the plugin"))
        return
    for check in prepared.checks:
        pipe.send((BEGIN, check))
        for result in examine_all([check], prepared.subject, prepared.expected):
            pipe.send((RESULT, result))
    pipe.send((END, None))
