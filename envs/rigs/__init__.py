"""Real rigs: the nominal robot of each, its recordings as logs, and which of them are fitted and which held out.

A rig is a folder of descriptions: ``rig.toml`` (origin, files, runs), ``robot.toml`` and ``body.xml`` (nominal robot),
``layout.toml`` (column map of its files), ``published.toml`` (figures that others have published).
"""

from __future__ import annotations

import tomllib
from collections.abc import Container
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from envs import data_sets
from envs.log import Log

if TYPE_CHECKING:
    from envs.robot import Robot
    from envs.validation import Finding

Role = Literal["fit", "held_out", "other"]


@dataclass(frozen=True)
class Run:
    """One recording of a rig. role: fitted, held out, or kept for special questions."""

    name: str
    file: str
    role: Role
    note: str
    loop: Literal["open", "closed"] | None = None


@dataclass(frozen=True)
class Rig:
    """One real machine with its recordings."""

    name: str
    title: str
    runs: tuple[Run, ...]

    @property
    def folder(self) -> Path:
        """Where the descriptions of the rig stand."""
        return data_sets.DESCRIPTIONS / self.name

    @property
    def layout(self) -> Path:
        """The column map of its files."""
        return self.folder / "layout.toml"

    @property
    def available(self) -> bool:
        """Whether its data are on this machine."""
        return data_sets.available(self.name)

    def robot(self) -> Robot:
        """The nominal robot."""
        from envs.robot import load_robot

        return load_robot(self.folder / "robot.toml")

    def published(self) -> dict[str, dict[str, float]]:
        """Figures that others have published, by the name of their model; empty when there are none."""
        path = self.folder / "published.toml"
        return tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}

    def run(self, name: str) -> Run:
        """A run by its name. Raises DataSetError for any other."""
        for run in self.runs:
            if run.name == name:
                return run
        raise data_sets.DataSetError(
            f"{self.name} has no run {name!r}", remedy=f"Choose one of {', '.join(run.name for run in self.runs)}"
        )

    def log(self, name: str) -> Log:
        """A run as a log. Raises DataSetError when its file is not on this machine."""
        return self.log_with_findings(name)[0]

    def log_with_findings(self, name: str) -> tuple[Log, tuple[Finding, ...]]:
        """`log`, and what was noticed in the file."""
        from envs.log_files import load_with_findings

        run = self.run(name)
        log, findings = load_with_findings(data_sets.locate(self.name, run.file), self.layout)
        return replace(log, name=f"{self.name}/{run.name}", loop=run.loop or log.loop), findings

    def logs(self, role: Role) -> tuple[Log, ...]:
        """All runs of a role as logs, in the order of the description."""
        return tuple(self.log(run.name) for run in self.runs if run.role == role)


@cache
def rig(name: str) -> Rig:
    """A rig by its name. Raises DataSetError when there is none."""
    content = data_sets.description(name)
    return Rig(name=name, title=content["title"], runs=tuple(Run(**entry) for entry in content["run"]))


def rigs() -> tuple[Rig, ...]:
    """All rigs, in alphabetical order."""
    return tuple(rig(name) for name in data_sets.names())


@cache
def _columns_of_layouts() -> tuple[tuple[Path, frozenset[str]], ...]:
    found: list[tuple[Path, frozenset[str]]] = []
    for item in rigs():
        entries: dict[str, Any] = tomllib.loads(item.layout.read_text(encoding="utf-8"))["columns"]
        found.append((item.layout, frozenset(entry["column"] for entry in entries.values())))
    return tuple(found)


def recognise(columns: Container[str]) -> Path | None:
    """The layout of the rig whose files have these columns, None when it is nobody's.

    Layouts without names of their own (bare numpy arrays) are never recognised.
    """
    for layout, needed in _columns_of_layouts():
        if all(column in columns for column in needed) and "column1" not in needed:
            return layout
    return None
