"""Whether a wave is the same everywhere.

A wave over the position or over time that a machine makes has one amplitude and one phase, wherever the joint moves and
however. One that makes up for the inexact law of another effect follows that law's errors, which change with the
motion. With J_i the sensitivities to its amplitudes and 1_b the blocks into which every log is divided, the innovations
are regressed on ``J_i 1_b`` beside all sensitivities: the decrease of -2 log likelihood follows a chi-squared
distribution where the wave is the same everywhere, with one degree of freedom per amplitude and block beyond the first.

Source: G. Chow, Tests of equality between sets of coefficients in two linear regressions, Econometrica 28 (1960).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from diagnosis.estimation import Fitted
from diagnosis.hypotheses import PER_LOG
from diagnosis.problem import Problem
from methods.effects.base import Effect

BLOCKS = 4
"""Parts of a log in which a wave may have amplitudes of their own."""
DEVIATIONS = 3.0
"""Standard deviations by which the decrease may exceed what chance gives."""
CERTAIN = 4.0
"""Standard deviations that a wave whose phase is free in every log has to have in each."""


def is_wave(effect: Effect) -> bool:
    """Whether an effect is a wave over the position or over time."""
    return effect.scan in ("position", "time") or effect.slot == "sensor"


def stands_apart(effect: Effect, others: Sequence[Effect]) -> bool:
    """Whether an effect is a wave beside others of which none follows its signal, and none makes small causes grow."""
    return is_wave(effect) and not any(other.variable == effect.variable or other.scatters for other in others)


def variation(problem: Problem, fitted: Fitted, effect: Effect, joint: int) -> tuple[float, int]:
    """Decrease of -2 log likelihood that amplitudes of their own in every block would bring, and how many more these
    are."""
    rows, basis = _amplitudes(fitted, effect, joint), fitted.jacobian
    divided = []
    for i in rows:
        log = fitted.point.free[i].log
        for place, (a, b) in enumerate(pairwise(problem.bounds)):
            if log >= 0 and log != place:
                continue
            for first, last in pairwise(np.linspace(a, b, BLOCKS + 1).astype(int)):
                block = np.zeros(len(problem.time))
                block[first:last] = 1.0
                divided.append(basis[i] * np.tile(block[fitted.whitener.mask], problem.joints))
    return fitted.gain(np.vstack([basis, *divided])) - fitted.gain(basis), len(divided) - len(rows)


def is_the_same_everywhere(problem: Problem, fitted: Fitted, effect: Effect, joint: int) -> bool:
    """Whether a wave of the model has one amplitude and one phase all along the logs, of which there are several.

    Where its phase is free in every log it has to be certain in each: a line of one excitation is none of another.
    """
    if problem.logs < 2:
        return False
    if effect.name in PER_LOG and not is_certain_everywhere(problem, fitted, effect, joint):
        return False
    decrease, functions = variation(problem, fitted, effect, joint)
    return decrease < functions + DEVIATIONS * np.sqrt(2.0 * functions)


def _amplitudes(fitted: Fitted, effect: Effect, joint: int) -> list[int]:
    """Indices of an effect's amplitudes among the free parameters."""
    names = {f"{effect.name}.{effect.parameters[a].name}" for a in effect.amplitudes}
    return [i for i, f in enumerate(fitted.point.free) if f.joint == joint and f.name.partition("@")[0] in names]


def is_certain_everywhere(problem: Problem, fitted: Fitted, effect: Effect, joint: int) -> bool:
    """Whether the amplitudes in each log stand out of their deviations."""
    rows, values = np.array(_amplitudes(fitted, effect, joint)), fitted.point.vector
    logs = np.array([fitted.point.free[i].log for i in rows])
    for log in range(problem.logs):
        own = rows[logs == log]
        inner = fitted.covariance[np.ix_(own, own)]
        if not len(own) or values[own] @ np.linalg.pinv(inner) @ values[own] < CERTAIN**2:
            return False
    return True
