"""Basin hopping: where small causes grow, a fit is begun again from places nearby, in search of a better optimum.

Behind impacts the errors depend on the parameters as irregularly as on noise. A fit stops at one of many optima, within
some percent of the best one, and each alone looks far more certain than they are together.

D. J. Wales and J. P. K. Doye, Global optimization by basin-hopping, Journal of Physical Chemistry A 101 (1997).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from diagnosis.estimation import Fitted, Point, fit
from diagnosis.problem import Problem
from diagnosis.shooting import best_of, shot
from methods.parallel import each

WIDTHS = (0.001, 0.1)
"""Least and largest rms of a hop, as a share of each parameter; drawn anew for every hop, their logarithm uniformly."""
ABREAST = 2
"""Hops from one optimum that are made at the same time."""
PATIENCE = 4
"""Hops without gain after which the best optimum counts as found."""
HOPS = 12
"""Most hops."""


@dataclass(frozen=True)
class Optimum:
    """Where a fit stopped: its criterion, the values of its free parameters by their names, and the standard deviations
    that multiple shooting tells, if any."""

    criterion: float
    values: Mapping[str, float]
    deviations: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, fitted: Fitted, deviations: Mapping[str, float] | None = None) -> Optimum:
        """That of a fit."""
        return cls(fitted.criterion, fitted.point.values, deviations or {})


def hopped(problem: Problem, fitted: Fitted) -> tuple[Fitted, tuple[Optimum, ...]]:
    """The best of many optima, where multiple shooting leads to from a fit and near there, and all of them."""
    generator = np.random.default_rng(0)
    lasting = np.array([f.log < 0 for f in fitted.point.free])  # not what is of one log: its initial state
    fits = shot(problem, fitted)
    best = best_of(fits)
    found, since = [Optimum.of(own.fitted, own.deviations) for own in fits], 0

    def beside(best: Fitted) -> Point:
        width = np.exp(generator.uniform(*np.log(WIDTHS)))
        moved = best.point.vector * (1.0 + width * lasting * generator.standard_normal(len(lasting)))
        return best.point.within(moved)

    while since < PATIENCE and len(found) < HOPS + len(fits):
        hop = partial(fit, problem, filter_=best.whitener, rounds=1)
        for other in each(hop, [beside(best) for _ in range(ABREAST)]):
            since = 0 if other.criterion < best.criterion else since + 1
            best = min(best, other, key=lambda option: option.criterion)
            found.append(Optimum.of(other))
    return best, tuple(found)


def likely(optima: Sequence[Optimum], growth: float = 1.0) -> list[Optimum]:
    """The best optimum and those that are as likely, the best first.

    Their criterion is higher by no more than the squares of two deviations of each parameter, times the growth of what
    noise does.
    """
    ordered = sorted(optima, key=lambda optimum: optimum.criterion)
    return [o for o in ordered if o.criterion <= ordered[0].criterion + 4.0 * len(ordered[0].values) * growth]


def with_laws(optima: Sequence[Optimum], laws: Collection[str], wanted: Collection[str]) -> tuple[Optimum, ...]:
    """The optima in which of some laws just those wanted are free: beside another one a law means something else."""
    free = lambda optimum: {name.partition(".")[0] for name in optimum.values} & set(laws)  # noqa: E731
    return tuple(optimum for optimum in optima if free(optimum) == set(wanted))


def distances(optima: Sequence[Optimum], growth: float = 1.0) -> dict[str, float]:
    """Uncertainty of each free parameter, by its name: its rms distance between the best optimum and those that are as
    likely, and its standard deviation over the pieces of the best one that comes of multiple shooting."""
    found = likely(optima, growth)
    told = min((o for o in optima if o.deviations), key=lambda optimum: optimum.criterion, default=None)
    return {
        name: float(
            np.hypot(
                np.sqrt(np.mean([(optimum.values[name] - value) ** 2 for optimum in found])),
                0.0 if told is None else told.deviations.get(name, 0.0),
            )
        )
        for name, value in (found[0].values.items() if found else ())
    }
