"""What logs leave undecided about an effect that is certain: which of two forms its law has.

A plain form and a more general one that are equally plausible may explain the same logs with other values of the same
parameters. Then neither is right to be certain of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, fit
from diagnosis.finding import Accepted
from diagnosis.problem import Free, Problem
from methods.effects.base import Effect

FAINT = 1e-8
"""Relative decrease of the mean square that ends a fit along a direction in which it hardly changes."""


def left_undecided(
    problem: Problem, base: Fitted, accepted: Sequence[Accepted], effects: Sequence[Effect]
) -> tuple[list[Accepted], Fitted]:
    """The effects and their model, with the general form in the place of each plain one from which logs do not tell it,
    as far as it is known beforehand (`Effect.undecided`); the deviations of what both describe then cover both."""
    found = list(accepted)
    for i, item in enumerate(found):
        contains = (form for form in effects if form.label == item.label and item.name in form.includes)
        form = next((form for form in contains if form.undecided), None)
        if form is None:
            continue
        fitted = _begun(problem, base, item, form)
        if fitted.criterion >= base.criterion + np.log(base.samples):
            continue
        start = item.scored.start
        start = replace(start, hypothesis=replace(start.hypothesis, effect=form))
        found[i], base = replace(item, scored=replace(item.scored, start=start, fitted=fitted)), fitted
    return found, base


def _begun(problem: Problem, base: Fitted, item: Accepted, form: Effect) -> Fitted:
    """The base with a general form in the place of an effect, fitted from where both are the same."""
    kernel, point, j = problem.kernel, base.point, item.joint
    parameters, switches = point.parameters.copy(), point.switches.copy()
    parameters[:, j, kernel.own(form)] = np.column_stack(
        [parameters[:, j, kernel.own(item.effect)], np.tile(form.neutral, (problem.logs, 1))]
    )
    switches[j, kernel.switches[item.name]], switches[j, kernel.switches[form.name]] = False, True
    moved = kernel.offsets[form.name] - kernel.offsets[item.name]
    own, free = f"{item.name}.", []
    for f in point.free:
        if f.joint == j and f.name.startswith(own):
            f = replace(f, name=f"{form.name}.{f.name.removeprefix(own)}", column=f.column + moved)
        free.append(f)
    for parameter, (mean, deviation) in zip(form.parameters[item.effect.size :], form.undecided, strict=True):
        name, column = f"{form.name}.{parameter.name}@{j}", kernel.column(form, parameter.name)
        bounds = (parameter.lower, parameter.upper)
        free.append(Free(name, "joint", j, column, deviation, *bounds, centre=mean, deviation=deviation))
    begun = replace(point, parameters=parameters, switches=switches, free=tuple(free))
    return fit(problem, begun, base.whitener, iterations=12, tolerance=FAINT)
