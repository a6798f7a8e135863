"""The ceiling: told the names of the hidden effects, it finds their numbers."""

from __future__ import annotations

import numpy as np
import pytest
from test_contestants import CURRENT, VOLTAGE, recorded

from diagnosis.full_model import FullModel
from methods.base import MethodError
from methods.plugins import find_method
from methods.regressor import ColumnName

RNG = np.random.default_rng(0)


def test_the_ceiling_is_told_the_names_and_finds_the_numbers() -> None:
    law: dict[ColumnName, float] = {**CURRENT}
    del law["constant"]  # without a description nobody knows that the joint is loaded
    current = recorded(law, "current", "m")
    found = FullModel((("coulomb_friction", 1),)).fit([current], RNG).estimates
    for name in ("acceleration", "coulomb"):
        assert found[name] == pytest.approx(CURRENT[name], rel=0.02), name
    assert "coulomb" not in FullModel().fit([recorded(VOLTAGE | {"constant": 0.0}, seconds=3.0)], RNG).estimates.names
    for effects, words in (((("stiction", 1),), "no effect stiction"), ((("backlash", 3),), "do not hold joint 3")):
        with pytest.raises(MethodError, match=words):
            FullModel(effects).fit([current], RNG)


def test_a_winding_without_lag_gives_estimates_all_the_same() -> None:
    law: dict[ColumnName, float] = {"acceleration": 0.03, "velocity": 0.4}
    found = FullModel((("coulomb_friction", 1),)).fit([recorded(law, seconds=3.0)], RNG).estimates
    assert found.names[-3:] == ("acceleration", "velocity", "coulomb")  # before them a lag, if it is any
    assert found["velocity"] == pytest.approx(0.4, rel=0.01)


def test_the_ceiling_is_known_to_everybody() -> None:
    assert find_method("full-model").factory is FullModel
