"""Lags in series: which of them is the amplifier's, the logs of a linear joint cannot tell.

A voltage passes through the amplifier's lag T and through the joint, ``J L s^2 + (J + b L) s + (b + k)`` with inertia
J, viscous friction b, back-EMF k and the winding's time constant L, whose two poles are two further lags as long as
they do not oscillate. Any of the three may be the amplifier's; J and L follow, and the motion is the same to the last
digit. A known inertia decides, and so may a law that does not act on the command, such as dry friction. What is left
out is an amplifier that is slower than the joint's own mechanical time constant, ``J / (b + k)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, Point, fit
from diagnosis.hopping import Optimum
from diagnosis.problem import Problem
from methods.effects.base import Effect
from methods.kernel import NOMINAL

INERTIA, VISCOUS, BACK_EMF, WINDING = (
    NOMINAL.index(name) for name in ("inertia", "viscous", "back_emf", "electrical_time_constant")
)


def poles(inertia: float, viscous: float, back_emf: float, winding: float) -> tuple[float, ...]:
    """Time constants of a joint that moves without oscillating, shortest first; none of one that oscillates."""
    square, linear = inertia * winding, inertia + viscous * winding
    damping = viscous + back_emf
    inside = linear**2 - 4.0 * square * damping
    if damping <= 0.0 or inside < 0.0:
        return ()
    longest = 0.5 * (linear + np.sqrt(inside)) / damping
    return (longest,) if square <= 0.0 else (square / damping / longest, longest)


def joint_with(lags: Sequence[float], viscous: float, back_emf: float) -> tuple[float, float] | None:
    """Inertia and winding's time constant of a joint with these one or two lags; None where no such joint exists."""
    damping = viscous + back_emf
    if len(lags) == 1:
        return lags[0] * damping, 0.0
    linear, square = damping * sum(lags), damping * lags[0] * lags[1]
    inside = linear**2 - 4.0 * viscous * square
    if inside < 0.0:
        return None
    inertia = 0.5 * (linear + np.sqrt(inside))
    return inertia, square / inertia


def traded(point: Point, j: int, column: int) -> list[Point]:
    """The models in which one of joint index j's own lags is the amplifier's (its `column`), and that one the joint's.

    Empty for a joint that oscillates."""
    row = point.parameters[0, j]
    viscous, back_emf, lag = row[VISCOUS], row[BACK_EMF], row[column]
    own = poles(row[INERTIA], viscous, back_emf, row[WINDING])
    found = []
    for i, other in enumerate(own):
        solution = joint_with((lag, *own[:i], *own[i + 1 :]), viscous, back_emf)
        if solution is None or other * (viscous + back_emf) > solution[0]:
            continue
        parameters = point.parameters.copy()
        parameters[:, j, column] = other
        parameters[:, j, INERTIA], parameters[:, j, WINDING] = solution
        found.append(replace(point, parameters=parameters))
    return found


def instead_of_winding(point: Point, j: int) -> float:
    """Lag of an amplifier [s] that would look like the winding of joint index j, which then had none; 0 where the
    winding is known, or where the joint oscillates."""
    winding = next((f for f in point.free if f.name == f"electrical_time_constant@{j}"), None)
    row = point.parameters[0, j]
    if winding is None or np.isfinite(winding.deviation):
        return 0.0
    own = poles(row[INERTIA], row[VISCOUS], row[BACK_EMF], row[WINDING])
    return own[0] if len(own) == 2 else 0.0


def told_apart(problem: Problem, fitted: Fitted, effect: Effect, j: int) -> tuple[Fitted, tuple[Optimum, ...]]:
    """The best of the fits that begin where lags have traded places, and all optima, its own among them.

    Those of a planar pair do not trade places: its inertias also couple the joints."""
    free = {f.name for f in fitted.point.free}
    movable = {f"inertia@{j}", f"electrical_time_constant@{j}"} <= free or (
        f"inertia@{j}" in free and fitted.point.parameters[0, j, WINDING] == 0.0
    )
    if problem.pair or not movable:
        return fitted, ()
    points = traded(fitted.point, j, problem.kernel.column(effect, "time_constant"))
    fits = [fitted, *(fit(problem, point.within(point.vector), fitted.whitener) for point in points)]
    return min(fits, key=lambda option: option.criterion), tuple(map(Optimum.of, fits))
