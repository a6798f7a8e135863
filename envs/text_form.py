"""Small records written on one line: ``name:field=value,field=value``, the text form of excitations and effects.

Values: numbers, words, ranges ``0.1-8`` (two numbers) and lists ``1+2`` (one entry per joint).
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_RANGE = re.compile(rf"({_NUMBER})-({_NUMBER})")


class TextFormError(ValueError):
    """An unreadable text form, said in one line: what is wrong and what to write instead."""


def counted(number: int, noun: str) -> str:
    """A number of things: 1 row, 2 rows."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def lasting(seconds: float) -> str:
    """A time span in milliseconds, or in seconds from one on: 13 ms, 1.3 s."""
    return f"{seconds:.3g} s" if seconds >= 1.0 else f"{1e3 * seconds:.3g} ms"


def split_assignments(text: str, separator: str) -> dict[str, str]:
    """``a=1,b=2`` as a mapping; `separator` stands between name and value. Raises TextFormError."""
    assignments: dict[str, str] = {}
    for part in text.split(","):
        name, found, value = (item.strip() for item in part.partition(separator))
        if not (found and name and value):
            raise TextFormError(f"{part.strip()!r} is no assignment. Write name{separator}value, separated by commas")
        if name in assignments:
            raise TextFormError(f"{name} is given twice. Give it once")
        assignments[name] = value
    return assignments


def read_number(text: str, name: str) -> float:
    """One number. Raises TextFormError."""
    try:
        return float(text)
    except ValueError:
        raise TextFormError(f"{name} is {text!r}, not a number. Write a number such as 0.5") from None


def read_range(text: str, name: str) -> tuple[float, float]:
    """Two numbers written ``low-high``. Raises TextFormError."""
    match = _RANGE.fullmatch(text.strip())
    if match is None:
        raise TextFormError(f"{name} is {text!r}, not a range. Write low-high, such as 0.1-8")
    return float(match[1]), float(match[2])


def read_list(text: str, name: str) -> tuple[float, ...]:
    """Numbers joined by ``+``. Raises TextFormError."""
    return tuple(read_number(part, name) for part in re.split(r"(?<![eE])\+", text))


def choose(name: str, known: Iterable[str], what: str) -> str:
    """`name` when it is known; raises TextFormError that lists what is, nearest first."""
    names = sorted(known)
    if name in names:
        return name
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"Did you mean {near[0]}? Known are" if near else "Known are"
    raise TextFormError(f"there is no {what} {name!r}. {hint} {', '.join(names)}")


def write_assignments(values: Mapping[str, object], separator: str) -> str:
    """The inverse of `split_assignments` for numbers, words, and tuples (joined by ``+``)."""
    return ",".join(f"{name}{separator}{_write(value)}" for name, value in values.items())


def _write(value: object) -> str:
    if isinstance(value, tuple):
        return "+".join(_write(item) for item in value)
    return f"{value:.12g}" if isinstance(value, float) else str(value)
