"""First fits of many hypotheses: enough to tell which of them are worth fitting until they have converged.

Where a part of the samples is enough for a first look (`diagnosis.glance`), it is also enough for these, of every
effect that is the same in every stretch of the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, Point, errors, finish, fit
from diagnosis.glance import Glance, can_be_glanced_at
from diagnosis.hypotheses import Hypothesis, Start, extend
from diagnosis.instants import retimed
from diagnosis.problem import Problem
from diagnosis.whitening import whitener
from envs.log import Array
from methods.parallel import each

CARRIED = 2
"""Fits to the unfiltered errors that are carried on to the filtered ones; twice as many converge before."""
SHARES = (1.0, 0.5, 0.25, 0.125)
"""Shares of what a regression says of a hypothesis, of which the one that comes closest is fitted further."""
ALIKE = 1.1
"""Squares that another share may leave, over those of the best one, to be fitted as well."""
WORTH = 0.3
"""Least share of the best first fit's decrease for that."""
LOBES = (-0.25, -0.1, 0.1, 0.25)
"""Moves of a disturbance's frequency, in widths of a spectral line of the longest log."""


def first_fits(
    problem: Problem, base: Fitted, starts: Sequence[Start], known: Array, look: Glance | None
) -> list[tuple[Start, Fitted]]:
    """First fits to the innovations; known: sensitivities (K, T, n) of the base. look: a part of the samples that is
    enough, if any."""

    def fits(start: Start) -> list[Fitted]:
        if look is None or not can_be_glanced_at(start.hypothesis.effect):
            return roughly(problem, base, start, known)
        found = roughly(look.problem, look.views[0].fitted, part_of(base.point, start, look), look.slopes)
        return [on_all_samples(problem, base, start.hypothesis, fitted, known) for fitted in found]

    return [(start, fitted) for start, several in zip(starts, each(fits, starts), strict=True) for fitted in several]


def part_of(point: Point, start: Start, look: Glance) -> Start:
    """A start for all logs as one for the segments of a part of them."""
    shift = start.shift
    if shift is not None:
        changes = dict(zip((f.name for f in point.free), shift, strict=True))
        shift = np.array([changes.get(f.name, 0.0) for f in look.views[0].fitted.point.free])
    others = tuple(values[look.logs] for values in start.others)
    return replace(start, values=start.values[look.logs], others=others, shift=shift)


def seen_in_part(problem: Problem, base: Fitted, hypothesis: Hypothesis, fitted: Fitted, look: Glance) -> Point | None:
    """The model of a hypothesis on the segments of a part; None where it differs from the base in more than that, or
    the segments do not tell."""
    added = fitted.point.switches ^ base.point.switches
    effect, joint = hypothesis.effect, hypothesis.joint
    column = problem.kernel.switches[effect.name]
    if not can_be_glanced_at(effect) or added.sum() != 1 or not added[joint, column]:
        return None
    values = np.repeat(fitted.point.parameters[:1, joint, problem.kernel.own(effect)], look.problem.logs, axis=0)
    return extend(look.problem, look.views[0].fitted.point, hypothesis, values).taking(fitted.point.values)


def on_all_samples(
    problem: Problem, base: Fitted, hypothesis: Hypothesis, part: Fitted, known: Array, *, renewed: bool = True
) -> Fitted:
    """A hypothesis with the parameters of its fit to a part of the samples, seen on all; initial states are those of
    the base. The filter is its own if `renewed`, else the base's."""
    own = problem.kernel.own(hypothesis.effect)
    values = np.repeat(part.point.parameters[:1, hypothesis.joint, own], problem.logs, axis=0)
    point = extend(problem, base.point, hypothesis, values).taking(part.point.values)
    error = errors(problem, [point])[0]
    return finish(problem, point, error, whitener(problem, error) if renewed else base.whitener, known=known)


def roughly(problem: Problem, view: Fitted, start: Start, known: Array, *, renewed: bool = True) -> list[Fitted]:
    """First fits of a hypothesis from each of its starting values; the sensitivities (K, T, n) of the view stay.

    The filter is the fit's own if `renewed`, else the view's.
    """
    others = [extend(problem, view.point, start.hypothesis, values) for values in start.others]
    points = [*nearest(problem, view, start, renewed=renewed), *others]
    return [
        fit(
            problem,
            p,
            None if renewed else view.whitener,
            rounds=1,
            iterations=3,
            tolerance=1e-3,
            known=known,
            renewed=renewed,
        )
        for p in points
    ]


def nearest(problem: Problem, view: Fitted, start: Start, *, renewed: bool) -> list[Point]:
    """First points of a hypothesis: as much of what the regression says as comes closest, and another share of it that
    comes nearly as close.

    A law of the command may be far from what it promises in first order: a dead zone that is wider than all commands of
    a log does nothing more, and no way leads back. The other parameters are moved along, or stay.
    """
    effect, shift = start.hypothesis.effect, start.shift
    amplitudes = list(effect.amplitudes)
    tried: list[tuple[float, Point]] = []
    for share in SHARES if effect.slot == "command" else SHARES[:1]:
        values = start.values.copy()
        values[:, amplitudes] *= share
        tried.append((share, extend(problem, view.point, start.hypothesis, values)))
        if shift is not None:
            moved = view.point.within(view.point.vector + share * shift)
            tried.append((share, extend(problem, moved, start.hypothesis, values)))
    if len(tried) == 1:
        return [tried[0][1]]
    outcomes = errors(problem, [point for _, point in tried])
    filters = [whitener(problem, e) if renewed else view.whitener for e in outcomes]
    left = [float(np.sum(own(e) ** 2)) for own, e in zip(filters, outcomes, strict=True)]
    ranked = sorted(zip(left, tried, strict=True), key=lambda option: option[0])
    least, (best, first) = ranked[0]
    close = [point for value, (share, point) in ranked if share != best and value < ALIKE * least]
    return [first, *close[:1]]


def further(
    problem: Problem, view: Fitted, starts: Sequence[Start], known: Array, look: Glance | None
) -> list[tuple[Start, Fitted]]:
    """Fits to the errors as they are, the best of them carried on with a filter of their own."""
    brief = [] if look is None else [start for start in starts if can_be_glanced_at(start.hypothesis.effect)]
    best = _unfiltered(problem, view, [start for start in starts if not any(start is own for own in brief)], known)
    if look is not None and brief:
        parts = [part_of(view.point, start, look) for start in brief]
        whole = {id(part): start for part, start in zip(parts, brief, strict=True)}
        for part, fitted in _unfiltered(look.problem, look.views[1].fitted, parts, look.slopes):
            start = whole[id(part)]
            seen = on_all_samples(problem, view, start.hypothesis, fitted, known, renewed=False)
            best.append((start, seen))
    best.sort(key=lambda item: item[1].criterion)

    def filtered(item: tuple[Start, Fitted]) -> tuple[Start, Fitted]:
        start, fitted = item
        return start, retimed(problem, fit(problem, fitted.point, rounds=1, iterations=4), start.hypothesis)

    return each(filtered, best[:CARRIED])


def _unfiltered(problem: Problem, view: Fitted, starts: Sequence[Start], known: Array) -> list[tuple[Start, Fitted]]:
    """Fits to the errors as they are: first ones of all, the best of which converge."""
    fits = each(lambda start: roughly(problem, view, start, known, renewed=False), starts)
    found = [(start, fitted) for start, several in zip(starts, fits, strict=True) for fitted in several]
    found.sort(key=lambda item: item[1].criterion)
    limit = view.criterion - WORTH * (view.criterion - found[0][1].criterion) if found else 0.0

    def converged(item: tuple[Start, Fitted]) -> tuple[Start, Fitted]:
        start, fitted = item
        return start, fit(problem, fitted.point, view.whitener, rounds=1, iterations=6, renewed=False)

    return each(converged, [item for item in found[: 2 * CARRIED] if item[1].criterion < limit])


def retuned(problem: Problem, fitted: Fitted, hypothesis: Hypothesis) -> Fitted:
    """The fit with the frequency of a disturbance begun again a little beside where it ended: its phase in every log
    makes up for most of a wrong one, and the way to the right one is long and narrow. What else there is stays."""
    effect, j = hypothesis.effect, hypothesis.joint
    name = f"{effect.name}.frequency@{j}"
    if effect.scan != "time" or name not in fitted.point.values:
        return fitted
    frequency = fitted.point.value(name)
    points = [fitted.point.taking({name: frequency + share / problem.longest}) for share in LOBES]
    fits = each(lambda point: fit(problem, point, rounds=2, iterations=6), points)
    return min(fitted, *fits, key=lambda option: option.criterion)


def across(problem: Problem, fitted: Fitted, hypothesis: Hypothesis) -> Fitted:
    """The fit with an effect begun again on the other side of a ridge of its law (`Effect.across`)."""
    effect, j = hypothesis.effect, hypothesis.joint
    if effect.across is None:
        return fitted
    own = problem.kernel.own(effect)
    sides = [effect.across(values) for values in fitted.point.parameters[:, j, own].tolist()]
    points = []
    for rows in zip(*sides, strict=True):
        parameters = fitted.point.parameters.copy()
        parameters[:, j, own] = rows
        point = replace(fitted.point, parameters=parameters)
        points.append(point.within(point.vector))
    fits = each(lambda point: fit(problem, point, rounds=2, iterations=12), points)
    return min(fitted, *fits, key=lambda option: option.criterion)
