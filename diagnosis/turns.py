"""Fits to the errors as they are and to their innovations in turns.

A filter that is estimated from the errors may keep a fit where it began: it takes for slow noise what the model has yet
to explain. The errors as they are have other local optima, and share the best one with their innovations.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from diagnosis.estimation import Fitted, Point, fit
from diagnosis.problem import Problem
from diagnosis.whitening import unfiltered
from methods.parallel import each

TURNS = 4
"""Most turns between the errors as they are and their innovations."""


def in_turns(problem: Problem, fitted: Fitted) -> Fitted:
    """A fit carried on with the errors as they are and their innovations in turns, as long as that finds better.

    The two have the same best optimum but not the same others, and where one stops the other may go on.
    """
    for _ in range(TURNS):
        other = free_of_filter(problem, fitted.point)
        if not fitted.criterion - other.criterion > 1.0:
            break
        fitted = other
    return fitted


def free_of_filter(problem: Problem, point: Point) -> Fitted:
    """Fit to the errors as they are, and from there to their innovations."""
    return to_innovations(problem, to_errors(problem, point))


def either_way(problem: Problem, point: Point) -> Fitted:
    """The better one of a fit to the innovations and one that begins with the errors as they are."""
    ways: list[Callable[[Problem, Point], Fitted]] = [partial(fit, rounds=2, iterations=10), free_of_filter]
    return min(each(lambda way: way(problem, point), ways), key=lambda fitted: fitted.criterion)


def to_errors(problem: Problem, point: Point, iterations: int = 10) -> Fitted:
    """Fit to the errors as they are."""
    return fit(problem, point, unfiltered(problem), rounds=1, iterations=iterations, renewed=False)


def to_innovations(problem: Problem, fitted: Fitted) -> Fitted:
    """A fit to the errors as they are carried on to their innovations."""
    return fit(problem, fitted.point, rounds=2, iterations=6)
