"""One tagged registry per kind of plugin. Every list of names in the project is derived from it.

Three ways in: a file of this package (imported by `load_package`), a path given by the user (`load_path`), and an
installed package's entry point (`load_entry_points`). A name that is taken is refused, never replaced.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import pkgutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Generic, TypeVar

T = TypeVar("T")


class RegistryError(ValueError):
    """A plugin could not be registered or found, said in one line."""


@dataclass(frozen=True)
class Entry(Generic[T]):
    """One registered plugin: its name, the class or factory, its tags and where it came from."""

    name: str
    factory: Callable[..., T]
    tags: frozenset[str]
    origin: str


@dataclass(frozen=True)
class Registry(Generic[T]):
    """Name -> entry, for one kind of plugin; `group` is the entry-point group of installed packages."""

    kind: str
    group: str
    _entries: dict[str, Entry[T]] = field(default_factory=dict, repr=False)

    def register(self, name: str, *tags: str) -> Callable[[Callable[..., T]], Callable[..., T]]:
        """Decorator that registers a class or factory under `name`. Raises RegistryError when the name is taken."""

        def add(factory: Callable[..., T]) -> Callable[..., T]:
            origin = f"{factory.__module__}.{factory.__qualname__}"
            taken = self._entries.get(name)
            if taken is not None and taken.origin != origin:
                raise RegistryError(
                    f"{self.kind} {name!r} is already registered by {taken.origin}, refused from {origin}. "
                    "Choose another name"
                )
            self._entries[name] = Entry(name, factory, frozenset(tags), origin)
            return factory

        return add

    def __getitem__(self, name: str) -> Entry[T]:
        try:
            return self._entries[name]
        except KeyError:
            raise RegistryError(
                f"there is no {self.kind} {name!r}. Known: {', '.join(self.names()) or 'none'}"
            ) from None

    def __iter__(self) -> Iterator[Entry[T]]:
        return iter(self._entries[name] for name in sorted(self._entries))

    def __len__(self) -> int:
        return len(self._entries)

    def names(self, *tags: str) -> tuple[str, ...]:
        """Names in alphabetical order of all entries that carry every given tag."""
        return tuple(entry.name for entry in self if entry.tags.issuperset(tags))

    def load_package(self, package: str) -> None:
        """Import every file of a package, so that its decorators run."""
        module = importlib.import_module(package)
        for found in pkgutil.iter_modules(module.__path__, prefix=f"{package}."):
            importlib.import_module(found.name)

    def load_path(self, path: Path) -> tuple[str, ...]:
        """Run a plugin file and return the names that it registered. Raises RegistryError when it registers none."""
        before = set(self._entries)
        _run(path, self.kind)
        added = tuple(sorted(set(self._entries) - before))
        if not added:
            raise RegistryError(f"{path} registers no {self.kind}. Decorate its class with register(NAME)")
        return added

    def load_entry_points(self) -> tuple[str, ...]:
        """Import the entry points of installed packages and return the names that they registered."""
        before = set(self._entries)
        for point in importlib.metadata.entry_points(group=self.group):
            point.load()
        return tuple(sorted(set(self._entries) - before))


def _run(path: Path, kind: str) -> ModuleType:
    if not path.is_file():
        raise RegistryError(f"{path} is not a file. Give the path of a Python file that registers a {kind}")
    name = f"adeptone_plugin_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise RegistryError(f"{path} is no Python file. Give the path of a Python file that registers a {kind}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # so that the plugin's classes can be pickled
    try:
        spec.loader.exec_module(module)
    except RegistryError:
        raise
    except Exception as error:
        del sys.modules[name]
        raise RegistryError(f"{path} does not run: {type(error).__name__}: {error}. Mend the file") from error
    return module


METHODS: Registry = Registry("method", "adeptone.methods")
