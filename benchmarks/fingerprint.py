"""What a row depends on, as hashes: code, versions, settings. The same fingerprint means the same row.

Code is followed statically: a file's hash covers the file and everything of the project, or of the plugin's own
package, that it imports directly or indirectly. A package that is imported as such (``methods.effects`` collects its
files at run time) counts with all its files. Comments count too: a fingerprint may change without need, never the
other way round.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
import json
import platform
import subprocess
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("envs", "methods", "diagnosis", "benchmarks")
PACKAGES = ("numpy", "scipy", "numba", "torch", "pysindy", "scikit-learn", "mujoco", "pin", "cvxpy", "gpytorch")
"""Packages whose version may change a figure; those that are not installed do not count."""
EMPTY = hashlib.sha256(b"").hexdigest()


def digest(*parts: Any) -> str:
    """SHA-256 of plain data, in the order given."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


@cache
def source_hash(*files: Path) -> str:
    """Hash of files and of everything of their own that they import."""
    return digest([(name, _content_hash(path)) for name, path in sorted(_closure(files).items())])


def libraries(file: Path, names: Iterable[str]) -> tuple[str, ...]:
    """Which of these libraries a file or anything of its own that it imports asks for."""
    asked = {module.partition(".")[0] for path in _closure([file]).values() for module in _imports(path)}
    return tuple(sorted(asked.intersection(names)))


def _closure(files: Iterable[Path]) -> dict[str, Path]:
    """Name of a file below its root -> its path."""
    found: dict[str, Path] = {}
    waiting = [(path.resolve(), _root(path.resolve())) for path in files]
    while waiting:
        path, root = waiting.pop()
        name = str(path.relative_to(root))
        if name in found:
            continue
        found[name] = path
        own = path.relative_to(root).parts[0].removesuffix(".py")
        for module in _imports(path):
            top = module.partition(".")[0]
            place = ROOT if top in ROOMS else root if top == own and root != ROOT else None
            if place is not None:
                waiting += [(item, place) for item in _resolve(module, place)]
    return found


def _root(path: Path) -> Path:
    """The folder from which a file's top-level package is imported."""
    folder = path.parent
    while (folder / "__init__.py").exists():
        folder = folder.parent
    return folder


def _resolve(module: str, root: Path) -> Iterator[Path]:
    """The file of a module name; all files of a package below a room; nothing for a name inside a module."""
    place = root.joinpath(*module.split("."))
    if place.with_suffix(".py").is_file():
        yield place.with_suffix(".py")
    elif (place / "__init__.py").is_file() and "." in module:
        yield from sorted(place.glob("*.py"))


@cache
def _imports(path: Path) -> tuple[str, ...]:
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(dict.fromkeys(names))


@cache
def _content_hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def file_hash(paths: Iterable[Path]) -> str:
    """Hash of data files, missing ones by their name alone."""
    return digest([(path.name, _content_hash(path) if path.is_file() else "missing") for path in paths])


@cache
def versions() -> dict[str, str]:
    """Python's and the packages' versions."""
    found = {"python": ".".join(platform.python_version_tuple()[:2])}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


@cache
def installation() -> str:
    """Hash of all code of the project and of the versions: whether two machines compute the same rows."""
    files = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    return digest([(str(path.relative_to(ROOT)), _content_hash(path)) for path in files], versions())


@cache
def provenance() -> dict[str, str]:
    """Where a row comes from, for its reader; no part of its fingerprint but `versions_hash`."""
    return {
        "version": _own_version(),
        "commit": _commit(),
        "python": platform.python_version(),
        "versions": ", ".join(f"{name} {version}" for name, version in versions().items()),
        "versions_hash": digest(versions())[:16],
        "machine": f"{platform.node()}, {processor()}",
    }


def _own_version() -> str:
    try:
        return importlib.metadata.version("adeptone")
    except importlib.metadata.PackageNotFoundError:
        return ""


def _commit() -> str:
    """The checkout's commit, with + when files differ from it; empty outside a checkout."""
    ask = ("git", "-C", str(ROOT), "describe", "--always", "--abbrev=12", "--dirty=+", "--exclude=*")
    try:
        return subprocess.run(ask, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""


def processor() -> str:
    """Architecture and model of this machine's processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{platform.machine()}, {names[0] if names else platform.processor()}"
