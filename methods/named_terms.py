"""Which effects the terms of a regression stand for, so that methods that select terms compete in naming causes.

A regression knows no phases, lags or states: most effects have no term of their own. What stands in for them is named
all the same, as it would be by anybody who reads the equation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from envs.log import Array
from methods.base import Cause

EFFECTS: Mapping[str, str] = {
    "constant": "amplifier_offset",
    "coulomb": "coulomb_friction",
    "velocity |velocity|": "quadratic_drag",
    "velocity^3": "quadratic_drag",
    "position": "cable_spring",
    "sine": "gravity_tilt",
    "cosine": "gravity_tilt",
}
"""Term -> effect; the terms of the rigid joint stand for none."""
MATERIAL = 0.01
"""Least share of the command's rms that a term has to carry."""
SIGNIFICANT = 3.0
"""Least size of a coefficient in its standard errors."""


def causes_of(joint: int, terms: Sequence[str]) -> tuple[Cause, ...]:
    """The effects of selected terms, each once, in the terms' order."""
    return tuple(Cause(name, joint) for name in dict.fromkeys(EFFECTS[term] for term in terms if term in EFFECTS))


def verdict_of(causes: Sequence[Cause]) -> str:
    """``named`` or ``none``: a regression knows no doubt."""
    return "named" if causes else "none"


def selected(names: Sequence[str], regressor: Array, command: Array, values: Array, covariance: Array) -> list[str]:
    """The terms of a regression, command (N,) = regressor (N, p) values, that are significant and material."""
    carried = np.sqrt(np.mean(regressor**2, axis=0)) * np.abs(values)
    with np.errstate(invalid="ignore"):
        errors = np.sqrt(np.diag(covariance))
    enough = (carried > MATERIAL * np.sqrt(np.mean(command**2))) & (np.abs(values) > SIGNIFICANT * errors)
    return [name for name, is_enough in zip(names, enough, strict=True) if is_enough]
