"""Which other explanations do as well as an accepted effect, once all effects are there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from diagnosis.choice import DRIVEN_BY, FORK, is_of_its_shape
from diagnosis.estimation import Fitted, fit
from diagnosis.finding import Accepted, competitors
from diagnosis.hypotheses import Hypothesis, Start, extend, sizes_of, withdraw
from diagnosis.other_bases import either
from diagnosis.problem import Problem
from diagnosis.pruning import without
from diagnosis.remainder import Remainder
from diagnosis.search import Scored, score, try_all
from diagnosis.settings import Settings
from diagnosis.turns import free_of_filter
from envs.log import Array
from methods.effects.base import Effect
from methods.parallel import each


def simpler_rivals(item: Accepted, left: Sequence[Remainder]) -> Accepted:
    """The effect without rivals of more parameters where it leaves nothing to explain: it does as well with fewer."""
    if left[item.joint].excess > 0.0:
        return item
    return replace(item, rivals=tuple(rival for rival in item.rivals if rival.effect.size <= item.effect.size))


def confirmed(
    problem: Problem, base: Fitted, item: Accepted, later: Sequence[Accepted], settings: Settings
) -> Accepted:
    """The effect with those of its rivals that do as well in its place beside the effects found after it.

    They are fitted as far as it has been since: what seemed equal may only have stopped short.
    """

    def cost(rival: Scored) -> float:
        point = rival.fitted.point
        for other in later:
            values = base.point.parameters[:, other.joint, problem.kernel.own(other.effect)]
            point = extend(problem, point, other.scored.start.hypothesis, values)
        fits = fit(problem, point, rounds=2, iterations=10), free_of_filter(problem, point)
        return min(fitted.criterion for fitted in fits) + rival.price

    limit = base.criterion + item.scored.price + settings.rival
    costs = each(cost, item.rivals)
    return replace(item, rivals=tuple(rival for rival, own in zip(item.rivals, costs, strict=True) if own < limit))


def disguised(
    problem: Problem,
    base: Fitted,
    item: Accepted,
    accepted: Sequence[Accepted],
    effects: Sequence[Effect],
    settings: Settings,
) -> Accepted:
    """The effect with those forms of it among its rivals that beside another effect are the same to any log.

    Dry friction that differs between the directions is dry friction and an offset. The first parameters are compared.
    The same they are to 2 % of what the effect explains: the law beside it may turn over a velocity, its rival at once.
    """
    size = lambda effect: np.abs(  # noqa: E731
        base.point.parameters[:, item.joint, problem.kernel.offsets[effect.name]]
    ).max()
    for effect in effects:
        bearers = [other.effect for other in accepted if other.label in effect.beside and other.joint == item.joint]
        if item.name not in effect.includes or size(item.effect) > sum(map(size, bearers)):
            continue
        smaller = without(problem, base, item)
        margin = max(settings.rival, 0.02 * (smaller.criterion - base.criterion))
        for rival in try_all(problem, smaller, [(effect, item.joint)])[:1]:
            if rival.fitted.criterion < base.criterion + margin:
                item = replace(item, rivals=(*item.rivals, rival))
    return item


def in_other_terms(
    problem: Problem, base: Fitted, item: Accepted, effects: Sequence[Effect], settings: Settings
) -> Accepted:
    """The effect, where it is a general form of its law, with such forms of other laws that do as well for rivals.

    Of other laws only the textbook's forms have competed with it: those that came near, and those that follow the
    command or the motor torque as it does. Where nothing lies between these, a gradual saturation of the amplifier is
    one of the torque constant, whose textbook's form may explain nothing of it.
    """
    if not item.effect.neutral:
        return item
    known, near = {item.label, *(rival.label for rival in item.rivals)}, competitors(item, FORK)
    group = DRIVEN_BY.get(item.effect.variable)
    near |= {effect.label for effect in effects if group == "motor" and DRIVEN_BY.get(effect.variable) == group}
    others = [(effect, item.joint) for effect in effects if effect.label in near - known and effect.neutral]
    if not others:
        return item
    limit, smaller = base.criterion + item.scored.price + settings.rival, without(problem, base, item)
    found = [imitating(problem, base, smaller, item, effect) for effect, _ in others]
    rivals = [
        rival
        for rival in either(try_all(problem, smaller, others), [rival for rival in found if rival is not None])
        if rival.fitted.criterion + rival.price < limit and is_of_its_shape(problem, rival)
    ]
    return replace(item, rivals=(*item.rivals, *rivals))


def imitating(problem: Problem, base: Fitted, smaller: Fitted, item: Accepted, other: Effect) -> Scored | None:
    """Another law in the place of one of the command or the motor torque, begun where it does the same to the commands
    of the logs; None where either is no function of these alone."""
    j, effect = item.joint, item.effect
    largest = float(np.max(np.abs(problem.command[:, j])))
    own, theirs = (static_law(law, np.linspace(-largest, largest, 41)) for law in (effect, other))
    if own is None or theirs is None or other.starts is None:
        return None
    wanted = own(base.point.parameters[0, j, problem.kernel.own(effect)])
    bounds = [p.lower for p in other.parameters], [p.upper for p in other.parameters]
    starts = [np.clip(values, *bounds) for values in other.starts(sizes_of(problem, smaller)[j])]
    fits = [least_squares(lambda p: theirs(p) - wanted, x, bounds=bounds, x_scale=np.abs(x) + 1e-12) for x in starts]
    values = np.tile(min(fits, key=lambda fitted: fitted.cost).x, (problem.logs, 1))
    start = Start(Hypothesis(other, j), values, 0.0, len(starts))
    point = extend(problem, withdraw(problem, base.point, effect.name, j), start.hypothesis, values)
    return score(problem, smaller, start, fit(problem, point, rounds=2, iterations=10))


def static_law(effect: Effect, command: Array) -> Callable[[Array], Array] | None:
    """What an effect makes of commands (T,), by its parameters, while the joint rests and the torque is the command;
    None if it is no law of these."""
    law = effect.function
    if law is None or effect.slot not in ("command", "gain"):
        return None
    if effect.slot == "command":
        return lambda p: np.array([law(u, 0.0, 0.0, 0.0, u, p) for u in command])
    return lambda p: np.array([u * law(0.0, 0.0, 0.0, u, p) for u in command])
