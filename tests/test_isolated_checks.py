"""Checks in a process of their own: a plugin that hangs or crashes costs its own check, nothing else."""

from __future__ import annotations

import os
import time as clock

import pytest

from methods.conformance.check import Check, Outcome
from methods.conformance.isolated import Prepared, examine_isolated
from methods.registry import RegistryError


def fine(subject: str) -> None:
    """It is fine."""


def hangs(subject: str) -> None:
    """It ends."""
    clock.sleep(60.0)


def crashes(subject: str) -> None:
    """It leaves the interpreter alone."""
    os._exit(3)


def prepare(text: str, budget: float) -> Prepared:
    tables = {"hangs": (fine, hangs, fine), "crashes": (crashes,), "fine": (fine,)}
    if text == "absent":
        raise RegistryError("there is no such thing")
    return Prepared([Check(examine) for examine in tables[text]], text, {})


@pytest.mark.parametrize(("text", "reason"), [("hangs", "does not end within"), ("crashes", "exit status 3")])
def test_a_plugin_that_hangs_or_crashes_costs_its_own_check(text: str, reason: str) -> None:
    *before, last = examine_isolated(prepare, text, 0.2)
    assert all(result.outcome is Outcome.PASSED for result in before)
    assert last.outcome is Outcome.FAILED
    assert reason in last.reason


def test_what_cannot_be_loaded_is_refused() -> None:
    assert [result.outcome for result in examine_isolated(prepare, "fine", 0.2)] == [Outcome.PASSED]
    with pytest.raises(RegistryError, match="no such thing"):
        list(examine_isolated(prepare, "absent", 0.2))
    with pytest.raises(RegistryError, match="cannot be checked: KeyError"):
        list(examine_isolated(prepare, "unheard", 0.2))
