"""Ladders of effects on the page: bars, tables of steps, parameters and of everything that was tried."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.real import drawing
from benchmarks.real.outcome import Table, rows
from benchmarks.real.windowed import Model, Step, score
from diagnosis.problem import Problem
from envs.log import Array

RIVAL = 0.8
"""An effect that would have brought this share of the accepted one's gain is called its rival."""


def gains(
    steps: Sequence[Step],
    given_fitted: Array,
    given_held_out: Array,
    factor: float,
    unit: str,
    floor: float | None = None,
    joint: int = 0,
) -> str:
    """Bars of the errors of a joint, the nominal model as given first; floor in the same unit as the bars."""
    names = ["as given", *(step.name for step in steps)]
    fitted = [factor * float(given_fitted[joint]), *(factor * float(step.fitted[joint]) for step in steps)]
    held_out = [factor * float(given_held_out[joint]), *(factor * float(step.held_out[joint]) for step in steps)]
    drawn = drawing.bars(
        names,
        [("fitted runs", drawing.AFTER, fitted), ("held-out runs", drawing.BEFORE, held_out)],
        f"rms error of free simulation [{unit}]",
        None if floor is None else ("sensor alone", floor),
    )
    return drawing.svg(drawn, f"ladder{joint}{unit}")


def steps_table(
    steps: Sequence[Step], given: Model, fitted: Problem, held_out: Problem, factor: float, unit: str
) -> Table:
    """One row per model and joint; `closed` is the share of the refitted model's held-out error that is gone."""
    found = []
    for j in range(fitted.joints):
        first = score(fitted, given)[j], score(held_out, given)[j]
        found.append((j + 1, "as given", 0, factor * first[0], factor * first[1], None))
        base = steps[0].held_out[j]
        for step in steps:
            share = None if step is steps[0] else 1.0 - step.held_out[j] / base
            count = len(step.model.free)
            found.append((j + 1, step.name, count, factor * step.fitted[j], factor * step.held_out[j], share))
    columns = ("joint", "model", "free parameters", f"fitted [{unit}]", f"held-out [{unit}]", "closed")
    return Table("ladder", "Models in the order of their gain: rms error of free simulation", columns, rows(found))


def parameters_table(model: Model, name: str = "extended_model") -> Table:
    """Free parameters with standard deviations, in units of the command."""
    found = [
        (f.joint + 1, f.label, value, spread)
        for f, value, spread in zip(model.free, model.values, model.deviations, strict=True)
    ]
    title = (
        "Extended model: parameters in units of the command (V, A or N m; s, rad, m), standard deviations by windows"
    )
    return Table(name, title, ("joint", "parameter", "value", "standard deviation"), rows(found), 4)


def tried_table(tried: Sequence[tuple[str, str, float]]) -> Table:
    """Everything that was tried: relative decrease of the error on the fitted windows."""
    found = sorted(tried, key=lambda row: (row[0], -row[2]))
    title = "Every effect that was tried, with the decrease of the fitted windows' error that it would have brought"
    return Table("tried", title, ("step", "effect", "decrease"), rows(found), folded=True)


def rivals_sentence(steps: Sequence[Step], tried: Sequence[tuple[str, str, float]]) -> str:
    """Which names are not alone."""
    parts = [f"{name}: {', '.join(others) or 'none'}" for name, others in rivals(steps, tried).items()]
    return f"Rivals that would have brought at least 80 % of an accepted effect's gain: {'; '.join(parts) or 'none'}."


def rivals(steps: Sequence[Step], tried: Sequence[tuple[str, str, float]]) -> dict[str, tuple[str, ...]]:
    """For every accepted effect the others that would have done nearly as well at that step."""
    found = {}
    for number, step in enumerate(steps[1:], start=1):
        accepted = step.name.removeprefix("+ ")
        at = {name: gain for where, name, gain in tried if where == f"step {number}"}
        best = at.get(accepted, np.nan)
        found[accepted] = tuple(
            n for n, g in sorted(at.items(), key=lambda i: -i[1]) if n != accepted and g > RIVAL * best
        )
    return found
