"""What counts as an effect, and as something unknown, where not all that is known is exact."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from diagnosis import ledger, pruning
from diagnosis.ledger import Step, doubt
from diagnosis.problem import Problem
from diagnosis.remainder import Drift, Remainder
from diagnosis.settings import Settings
from diagnosis.verdict import unexplained
from envs.log import Array
from methods.effects import built_in

NAMED = {effect.name: effect for effect in built_in()}
EXPLAINED = 10_000.0


@pytest.mark.parametrize(
    ("rounded", "decrease", "expected"), [(False, 400.0, True), (True, 400.0, False), (True, 2e3, True)]
)
def test_a_slow_change_beside_rounding_has_to_explain_more(rounded: bool, decrease: float, expected: bool) -> None:
    problem = cast(Problem, SimpleNamespace(arm=None, command_limits=()))
    drift = Drift("coulomb_friction.torque@0", decrease, 4, 1e-40, 2e-3)
    left = replace(Remainder((), 0.0, 10, 0.0, 0.0, 0.0), drifts=(drift,), rounded=rounded)
    assert drift.is_certain
    assert unexplained(problem, EXPLAINED, (left,), Settings()) is expected


@pytest.mark.parametrize(
    ("name", "share", "expected"),
    [("joint_flexibility", 0.95, False), ("backlash", 0.95, False), ("joint_flexibility", 0.8, True),
     ("input_delay", 0.95, True), ("input_delay", 1.05, False)],
)  # fmt: skip
def test_a_spring_beside_an_arm_has_to_help_clearly(
    name: str, share: float, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pruning, "astray", lambda held_out, fitted: fitted)
    anything = cast(Any, None)
    assert pruning.is_closer(anything, NAMED[name], cast(Any, share), cast(Any, 1.0)) is expected


@dataclass(frozen=True)
class HeldOut:
    """As much of a problem as `doubt` looks at."""

    neighbour: Array
    doubts: Array
    joints: int = 1


def test_torques_that_the_description_leaves_open_are_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a joint that moves in proportion to the torque: the rms over draws of the torques."""
    monkeypatch.setattr(
        ledger, "replay", lambda held, point, window: SimpleNamespace(windows=3.0 * held.neighbour[:, :, 3])
    )
    draws = np.random.default_rng(0).normal(size=(200, 4))
    held = HeldOut(np.random.default_rng(1).normal(size=(200, 1, 5)), draws)
    step = cast(Step, SimpleNamespace(point=None, replay=SimpleNamespace(windows=3.0 * held.neighbour[:, :, 3])))
    assert doubt(cast(Problem, held), step) == pytest.approx([3.0 * np.sqrt(np.mean(draws**2))])
    none = replace(held, doubts=np.zeros((0, 0)))
    assert doubt(cast(Problem, none), step) == pytest.approx([0.0])
