"""Terms of regressions as names of effects."""

from __future__ import annotations

import numpy as np

from methods.base import Cause
from methods.effects import built_in
from methods.named_terms import EFFECTS, causes_of, selected, verdict_of


def test_every_term_stands_for_an_effect_of_the_vocabulary() -> None:
    assert set(EFFECTS.values()) <= {effect.label for effect in built_in()}


def test_the_rigid_joint_has_no_cause_and_every_effect_is_named_once() -> None:
    assert causes_of(2, ["jerk", "acceleration", "velocity", "command"]) == ()
    found = causes_of(2, ["velocity", "sine", "coulomb", "cosine"])
    assert found == (Cause("gravity_tilt", 2), Cause("coulomb_friction", 2))
    assert verdict_of(found) == "named"
    assert verdict_of(()) == "none"


def test_a_term_has_to_be_significant_and_material() -> None:
    regressor = np.random.default_rng(0).standard_normal((1000, 3))
    values, errors = np.array([1.0, 1.0, 0.004]), np.array([0.1, 0.5, 0.0001])
    command = regressor @ values
    assert selected(["a", "b", "c"], regressor, command, values, np.diag(errors**2)) == ["a"]
    unknown = np.full((3, 3), np.nan)
    assert selected(["a", "b", "c"], regressor, command, values, unknown) == []
