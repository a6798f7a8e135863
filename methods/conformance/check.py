"""What a check is, how it ends, and how the end is printed: one line per check with the reason of a failure."""

from __future__ import annotations

import enum
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from methods.base import MethodError
from methods.registry import one_line

Subject = TypeVar("Subject")


class CheckFailed(Exception):
    """The promise is not kept; the text is the reason, one line."""


class NotApplicable(Exception):
    """The check has nothing to look at here; the text says why."""


class Outcome(enum.Enum):
    """How a check ended. The value is the word that is printed."""

    PASSED = "passed"
    FAILED = "FAILED"
    EXPECTED = "expected failure"
    NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True)
class Check(Generic[Subject]):
    """One promise: `examine` returns when it is kept, raises CheckFailed when not. Its docstring is the promise."""

    examine: Callable[[Subject], None]

    @property
    def name(self) -> str:
        return self.examine.__name__

    @property
    def promise(self) -> str:
        """The first sentence of the docstring, without its full stop."""
        text = inspect.getdoc(self.examine) or ""
        return " ".join(text.split("\n\n")[0].split()).rstrip(".")


@dataclass(frozen=True)
class Result:
    """One check's end, with the reason of anything but a pass."""

    check: str
    promise: str
    outcome: Outcome
    reason: str = ""

    @property
    def line(self) -> str:
        """``FAILED  same_bits: the same generator gives the same bits. Estimates differ by up to 3e-4``."""
        tail = f". {self.reason[:1].upper()}{self.reason[1:]}" if self.reason else ""
        return f"{self.outcome.value:16}  {self.check}: {self.promise}{tail}"


def examine_all(
    checks: Iterable[Check[Subject]], subject: Subject, expected: Mapping[str, str] | None = None
) -> Iterator[Result]:
    """Every check on one subject, as they end. `expected`: name of a check -> why it is known to fail.

    An expected failure that does not happen is a failure: the declaration is out of date.
    """
    for check in checks:
        outcome, reason = examine(check, subject)
        declared = (expected or {}).get(check.name)
        if declared is not None and outcome is Outcome.FAILED:
            outcome, reason = Outcome.EXPECTED, f"{reason}. Declared: {declared}"
        elif declared is not None and outcome is Outcome.PASSED:
            outcome, reason = Outcome.FAILED, f"it passes although a failure is declared ({declared}): remove the entry"
        yield Result(check.name, check.promise, outcome, reason)


def examine(check: Check[Subject], subject: Subject) -> tuple[Outcome, str]:
    """How one check ends on a subject, and why."""
    try:
        check.examine(subject)
    except NotApplicable as error:
        return Outcome.NOT_APPLICABLE, str(error)
    except CheckFailed as error:
        return Outcome.FAILED, str(error)
    except MethodError as error:
        return Outcome.FAILED, f"it refuses: {error}"
    except Exception as error:
        return Outcome.FAILED, f"it raises {one_line(error)} ({_place(error)})"
    return Outcome.PASSED, ""


def _place(error: BaseException) -> str:
    """File and line in which an exception was raised."""
    frames = inspect.getinnerframes(error.__traceback__) if error.__traceback__ is not None else []
    return f"{frames[-1].filename.rpartition('/')[2]}, line {frames[-1].lineno}" if frames else "unknown place"


def undeclared(checks: Iterable[Check[Subject]], expected: Mapping[str, str]) -> tuple[str, ...]:
    """Names in `expected` that are no check: mistyped declarations."""
    return tuple(sorted(set(expected) - {check.name for check in checks}))
