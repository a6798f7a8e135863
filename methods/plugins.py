"""From what a user writes to a registered method: a name, the path of a file, or an installed package's entry point."""

from __future__ import annotations

import difflib
import importlib
import importlib.util
from pathlib import Path

from methods.base import Method, MethodError
from methods.registry import METHODS, Entry, RegistryError, one_line


def load_all() -> None:
    """Make every method known: those of the folder, then those of installed packages."""
    METHODS.load_package("methods")
    METHODS.load_entry_points()


def find_method(text: str) -> Entry[Method]:
    """The method of a registered name or of a plugin file that registers exactly one.

    Raises RegistryError when there is none or the file registers several.
    """
    if text in METHODS.names():
        return METHODS[text]
    if Path(text).suffix == ".py" or Path(text).is_file():
        load_all()  # before the file, so that a name that is taken is refused
        names = METHODS.load_path(Path(text))
        if len(names) > 1:
            raise RegistryError(f"{text} registers several methods: {', '.join(names)}. Give each a file of its own")
        return METHODS[names[0]]
    if text.isidentifier() and importlib.util.find_spec(f"methods.{text}") is not None:
        importlib.import_module(f"methods.{text}")  # most files are named after their method; the others stay unread
    if text not in METHODS.names():
        load_all()
    if text not in METHODS.names():
        near = difflib.get_close_matches(text, METHODS.names(), 1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise RegistryError(
            f"there is no method {text!r}; {hint}known are {', '.join(METHODS.names())}. "
            "Give one of these or the path of a file that registers one"
        )
    return METHODS[text]


def build_method(entry: Entry[Method]) -> Method:
    """The method with its default arguments. Raises RegistryError when it cannot be built so or lacks `fit`."""
    try:
        method = entry.factory()
    except MethodError:
        raise
    except Exception as error:
        raise RegistryError(
            f"method {entry.name!r} cannot be built with its default arguments: {one_line(error)}. "
            "Give every field a default and write fit(self, logs, rng)"
        ) from error
    if not isinstance(method, Method):
        raise RegistryError(
            f"method {entry.name!r} is a {type(method).__name__}, not a methods.base.Method. Derive its class from it"
        )
    return method
