"""The house's rules, read from the source: who may import whom, and where the heavy libraries may stand."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FLOORS = ("envs", "methods", "diagnosis", "benchmarks")
"""From the ground up; a room imports itself and what is below. Root scripts stand above all."""
FILES = sorted(path for floor in FLOORS for path in (ROOT / floor).rglob("*.py"))
HEAVY = ("torch", "pysindy", "stable_baselines3", "mujoco", "pinocchio", "matplotlib", "pandas")
RECORDS_TRUTH = ("envs.", "benchmarks.blind", "benchmarks.tasks", "benchmarks.paper")
"""Rooms that may reach the plant, whose parameters are the truth that methods have to find: they make the logs."""


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path, *, only_at_start: bool = False) -> Iterator[str]:
    """Full names of everything that a file imports; imports for type checking only are left out."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    for node in tree.body if only_at_start else ast.walk(tree):
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("path", FILES, ids=module_name)
def test_imports_run_one_way(path: Path) -> None:
    own = FLOORS.index(module_name(path).partition(".")[0])
    for name in imports(path):
        room = name.partition(".")[0]
        assert room not in ("results", "tests", "adeptone", "paper_repro"), f"{name} is imported"
        if room in FLOORS:
            assert FLOORS.index(room) <= own, f"{name} is above {FLOORS[own]}"


@pytest.mark.parametrize("path", FILES, ids=module_name)
def test_the_plants_truth_is_out_of_reach(path: Path) -> None:
    if not f"{module_name(path)}.".startswith(RECORDS_TRUTH):
        hidden = ("envs.plant", "benchmarks.blind", "benchmarks.paper")
        reached = [name for name in imports(path) if name.startswith(hidden)]
        assert reached == []


def test_heavy_libraries_stand_only_where_they_are_needed() -> None:
    """What a file imports at its start is paid by everybody who imports it, down to ``adeptone --help``.

    A file that is made for one of these libraries may import it at its start; it must then be imported inside
    functions, so that nobody else pays. Benchmarks and the plant are exempt: they are there to simulate.
    """
    direct = {
        module_name(path): {name.partition(".")[0] for name in imports(path, only_at_start=True)} & set(HEAVY)
        for path in FILES
    }
    specialists = {name for name, heavy in direct.items() if heavy}
    for path in FILES:
        name = module_name(path)
        if name.startswith(("benchmarks.", "envs.plant.")):
            continue
        for imported in imports(path, only_at_start=True):
            if imported in specialists and name not in specialists:
                pytest.fail(f"{name} imports {imported} at its start, which imports {', '.join(direct[imported])}")


def test_the_command_line_imports_rooms_inside_its_commands() -> None:
    at_start = set(imports(ROOT / "adeptone.py", only_at_start=True))
    assert not [name for name in at_start if name.partition(".")[0] in (*FLOORS, *HEAVY)]
