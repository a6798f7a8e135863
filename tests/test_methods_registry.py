"""The registry: duplicates refused, three ways in, one line per failure; and what every registered method promises."""

from __future__ import annotations

import dataclasses
import importlib.metadata
from pathlib import Path

import pytest

from methods.base import Method
from methods.registry import METHODS, Registry, RegistryError

PLUGIN = """
from methods.registry import METHODS

@METHODS.register("guess", "black-box")
class Guess:
    pass
"""


def test_names_come_from_decorators_and_duplicates_are_refused() -> None:
    registry: Registry = Registry("thing", "adeptone.things")

    @registry.register("first", "good", "cheap")
    class First: ...

    @registry.register("second", "good")
    class Second: ...

    assert registry.names() == ("first", "second")
    assert registry.names("good", "cheap") == ("first",)
    assert registry["first"].factory is First
    with pytest.raises(RegistryError, match=r"'first' is already registered by .*First"):
        registry.register("first")(Second)
    with pytest.raises(RegistryError, match="no thing 'third'"):
        registry["third"]


def test_a_missing_plugin_file_is_named() -> None:
    with pytest.raises(RegistryError, match="is not a file"):
        METHODS.load_path(Path("nowhere.py"))


def test_a_plugin_file_is_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entries = dict(METHODS._entries)
    path = tmp_path / "guess.py"
    path.write_text(PLUGIN, encoding="utf-8")
    try:
        assert METHODS.load_path(path) == ("guess",)
        assert "adeptone_plugin_guess" in METHODS["guess"].origin
    finally:
        METHODS._entries.clear()
        METHODS._entries.update(entries)


@pytest.mark.parametrize(
    ("content", "message"),
    [("x = 1\n", "registers no method"), ("1 / 0\n", "does not run: ZeroDivisionError"), ("def (\n", "does not run")],
)
def test_broken_plugins_are_named_in_one_line(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "broken.py"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(RegistryError, match=message) as caught:
        METHODS.load_path(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_entry_points_of_installed_packages_are_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entries = dict(METHODS._entries)
    (tmp_path / "adeptone_guess.py").write_text(PLUGIN, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    point = importlib.metadata.EntryPoint("guess", "adeptone_guess:Guess", "adeptone.methods")
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: [point] if group == METHODS.group else [])
    try:
        assert METHODS.load_entry_points() == ("guess",)
    finally:
        METHODS._entries.clear()
        METHODS._entries.update(entries)


def test_built_in_methods_are_frozen_specifications_that_name_themselves() -> None:
    METHODS.load_package("methods")
    assert {"least_squares", "compensated_least_squares", "network_alone", "sindy"} <= set(METHODS.names())
    for entry in METHODS:
        method = entry.factory()
        assert isinstance(method, Method)
        assert dataclasses.is_dataclass(method)
        assert type(method).__dataclass_params__.frozen  # type: ignore[attr-defined]
        assert method == entry.factory()
        assert " at 0x" not in repr(method)
