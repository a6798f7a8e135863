"""The Python examples of the documentation, run as they are written."""

from __future__ import annotations

import dataclasses
import importlib.util
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.parameters import JointUnits, canonical, units
from envs.excitation import REGISTRY, parse
from envs.log import Log
from envs.log_files import save
from methods.base import State
from methods.effects import built_in
from methods.structured import StructuredJoint, StructuredModel

ROOT = Path(__file__).resolve().parents[1]
NOMINAL = {"inertia": 0.02, "viscous": 0.1, "back_emf": 0.4, "electrical_time_constant": 0.005}


def examples(page: str) -> list[str]:
    """The Python blocks of a page."""
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


def test_a_saved_model_is_simulated_inverted_and_put_into_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a log that the model itself made, so that nothing but the way there can err."""
    part = StructuredJoint(1, "voltage", NOMINAL, {"coulomb_friction": {"torque": 0.3}})
    model = StructuredModel((part,), 1e-3)
    time = 1e-3 * np.arange(4000)
    command = 2.0 * np.sin(2.0 * np.pi * np.outer(time, [0.7, 1.9])).sum(axis=1, keepdims=True)
    position = model.simulate(time, command, State.at_rest(0.2)).position
    monkeypatch.chdir(tmp_path)
    save(Log(time, command, position), "test.csv")
    Path("out").mkdir()
    Path("out/extended_model.json").write_text(model.to_json(), encoding="utf-8")

    names: dict[str, Any] = {}
    use, play = examples("docs/model.md")
    exec(use, names)
    simulated, inverted = map(float, re.findall(r"\[(.*)\]", capsys.readouterr().out))
    assert simulated < 1e-3 * float(np.std(position))
    assert inverted < 0.05 * float(np.std(command))
    exec(play, names)
    assert names["environment"].unwrapped.simulator.held == (2, 3, 4)
    assert np.all(np.isfinite(names["observation"]))


def rows(page: str, columns: int) -> list[list[str]]:
    """The cells of all table rows of a page that have so many columns, without heads."""
    lines = re.findall(r"^\| (.*) \|$", (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE)
    cells = [[cell.strip() for cell in line.split("|")] for line in lines]
    return [row for row in cells if len(row) == columns and row[0] != "kind"]


def test_every_excitation_is_described_with_its_parameters_and_defaults() -> None:
    assert {kind for kind, _ in rows("docs/excitations.md", 2)} == {f"`{name}`" for name in REGISTRY}
    told = {(kind, parameter): default for kind, parameter, default, *_ in rows("docs/excitations.md", 5)}
    shared = {"joints": "all", "amplitude": "all but `fourier_series`", "offset": "all but `fourier_series`"}
    known = {}
    for name, kind in REGISTRY.items():
        for item in dataclasses.fields(kind):
            if item.name != "robot":
                known[shared.get(item.name, f"`{name}`"), f"`{item.name}`"] = (name, item.name, item.default)
    assert set(told) == set(known)
    for place, (name, parameter, default) in known.items():
        if default in (None, ()):
            assert "`" not in told[place], place
        else:
            assert getattr(parse(f"{name}:{parameter}={told[place].strip('`')}"), parameter) == default, place


def test_a_proposed_experiment_becomes_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    [example] = examples("docs/excitations.md")
    exec(example, {})
    written = Path("experiment.csv").read_text(encoding="utf-8")
    assert written.startswith("t,v1\n0,0\n0.001,0.0016\n")
    time, command = np.loadtxt("experiment.csv", delimiter=",", skiprows=1, unpack=True)
    assert np.allclose(np.diff(time), 1e-3)
    assert np.max(np.abs(command)) == 2.0
    assert np.allclose(command[:15000], command[5000:], atol=1e-6)


def test_the_lines_of_excitations_are_read() -> None:
    page = (ROOT / "docs/excitations.md").read_text(encoding="utf-8")
    block = page.split("```\n")[1]
    assert [parse(line).joints for line in block.splitlines()] == [(1,), (1,), (1, 2)]
    assert parse("steps:levels=0+1+0+-1").levels == (0.0, 1.0, 0.0, -1.0)  # type: ignore[attr-defined]


def test_the_page_of_effects_is_what_their_definitions_say() -> None:
    place = ROOT / "docs" / "make_effects.py"
    spec = importlib.util.spec_from_file_location("make_effects", place)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    assert made.PAGE.read_text(encoding="utf-8") == made.page(), "uv run python docs/make_effects.py"


def test_a_gain_per_command_is_not_one_per_ampere() -> None:
    drive = JointUnits("voltage", "rad", 0.1, 2.0)
    for name, unit, factor in (
        ("supply_sag", "1/A", 2.0),
        ("supply_sag_by_command", "1/V", 1.0),
        ("supply_sag_by_power", "1/(V A)", 2.0),
    ):
        (effect,) = (effect for effect in built_in() if effect.name == name)
        assert units(canonical(effect).dimensions["gain"], drive)[::2] == (unit, factor)
