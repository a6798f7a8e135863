"""``python -m benchmarks.real``: the page on real machines, rig by rig; what is done is not done again."""

from __future__ import annotations

import hashlib
import importlib
import time as clock
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from benchmarks.real.outcome import Outcome
from benchmarks.real.page import write
from envs import data_sets
from envs.log_files import write_atomically
from envs.output_place import check_folder
from envs.rigs import rig

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("benchmarks/real", "diagnosis", "envs", "methods")
"""Folders whose text decides whether an outcome is still that of the present code."""


def key(name: str) -> str:
    """Hash of the code and of the rig's data."""
    digest = hashlib.sha256()
    for folder in SOURCES:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in (".py", ".toml", ".xml"):
                digest.update(path.read_bytes())
    for item in data_sets.data_set(name).files:
        digest.update(item.sha256.encode())
    return digest.hexdigest()


def outcome(name: str, kept: Path, *, again: bool) -> Outcome:
    """One rig: what was kept of it when code and data are the same, else anew. Failures become an outcome too."""
    title = rig(name).title
    if not rig(name).available:
        return Outcome(name, title, failure=f"Its data are not here. Run: uv run adeptone data fetch {name}")
    path, now = kept / f"{name}.json", key(name)
    if path.exists() and not again:
        before = Outcome.from_json(path.read_text(encoding="utf-8"))
        if before.key == now:
            return before
    started = clock.perf_counter()
    try:
        found: Outcome = importlib.import_module(f"benchmarks.real.{name}").run()
    except Exception as error:
        return Outcome(name, title, failure=f"It failed: {type(error).__name__}: {error}")
    found = Outcome(
        name, title, found.summary, found.sections, found.numbers, key=now, seconds=clock.perf_counter() - started
    )
    write_atomically({path: found.to_json().encode()})
    return Outcome.from_json(found.to_json())


def main(
    out: Annotated[Path, typer.Option(help="Folder of the page and its tables.")] = Path("results/real"),
    rigs: Annotated[list[str] | None, typer.Option("--rig", help="Only this rig; may be repeated.")] = None,
    again: Annotated[bool, typer.Option("--again", help="Do everything anew.")] = False,
) -> None:
    """Real machines: what their models miss. One page, its tables as CSV, its numbers as JSON."""
    console = Console(stderr=True, highlight=False)
    unknown = sorted(set(rigs or ()) - set(data_sets.names()))
    if unknown:
        console.print(f"there is no rig {unknown[0]}. Choose one of {', '.join(data_sets.names())}", soft_wrap=True)
        raise typer.Exit(2)
    try:
        check_folder(out)
    except OSError as error:
        console.print(str(error), soft_wrap=True)
        raise typer.Exit(2) from None
    outcomes = []
    for name in data_sets.names():
        if rigs and name not in rigs:
            continue
        with console.status(name):
            found = outcome(name, out / "kept", again=again)
        outcomes.append(found)
        for line in found.summary or (found.failure,):
            console.print(f"[bold]{name}[/bold] {line}", soft_wrap=True)
    write(outcomes, out)
    console.print(f"written: {out / 'index.html'}")
    if any(found.failure.startswith("It failed") for found in outcomes):
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
