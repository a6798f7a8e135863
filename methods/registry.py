"""One tagged registry per kind of plugin. Every list of names in the project is derived from it.

Three ways in: a file of this package (imported by `load_package`), a path given by the user (`load_path`), and an
installed package's entry point (`load_entry_points`). A name that is taken is refused, never replaced.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.metadata
import importlib.util
import pkgutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar

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
        """Run a plugin file and return the names that it registered. Raises RegistryError when it registers none.

        A file that was run before is not run again, so that its classes stay what they were. A file that fails leaves
        the registry as it was.
        """
        before = dict(self._entries)
        try:
            module = run_file(path, f"a {self.kind}")
        except RegistryError:
            self._entries.clear()
            self._entries.update(before)
            raise
        own = tuple(entry.name for entry in self if entry.factory.__module__ == module.__name__)
        if not own:
            raise RegistryError(f"{path} registers no {self.kind}. Decorate its class with register(NAME)")
        return own

    def load_entry_points(self) -> tuple[str, ...]:
        """Import the entry points of installed packages and return the names that they registered."""
        before = set(self._entries)
        entry_points(self.group)
        return tuple(sorted(set(self._entries) - before))


def entry_points(group: str) -> tuple[tuple[str, Any], ...]:
    """What installed packages offer under `group`: pairs of the entry point's name and the object that it names.

    Raises RegistryError, naming the package, for one that cannot be imported.
    """
    found = []
    for point in sorted(importlib.metadata.entry_points(group=group), key=lambda point: point.name):
        package = f" of the package {point.dist.name}" if point.dist is not None else ""
        try:
            found.append((point.name, point.load()))
        except RegistryError:
            raise
        except (Exception, SystemExit) as error:
            raise RegistryError(
                f"the plugin {point.name}{package} does not run: {one_line(error)}. Mend or uninstall it"
            ) from error
    return tuple(found)


def run_file(path: Path, wanted: str) -> ModuleType:
    """The module of a plugin file, run once. `wanted` says in an error what the file should define.

    Raises RegistryError when there is no such file or it does not run.
    """
    path = Path(path)
    if path.resolve().parent == Path(__file__).resolve().parent and path.is_file():
        return importlib.import_module(f"methods.{path.stem}")  # a file of this folder is no plugin
    if not path.is_file() or path.suffix != ".py":
        problem = "is no Python file" if path.is_file() else "is not a file"
        raise RegistryError(f"{path} {problem}. Give the path of a Python file that defines {wanted}")
    place = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]
    name = f"adeptone_plugin_{path.stem}_{place}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # so that the plugin's classes can be pickled
    try:
        spec.loader.exec_module(module)
    except RegistryError:
        del sys.modules[name]
        raise
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise RegistryError(f"{path} does not run: {one_line(error)}. Mend the file") from error
    return module


def one_line(error: BaseException) -> str:
    """``ZeroDivisionError: division by zero``, whatever line breaks the text has."""
    return " ".join(f"{type(error).__name__}: {error}".split())


METHODS: Registry = Registry("method", "adeptone.methods")
