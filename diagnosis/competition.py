"""Which other explanations do as well as an accepted effect, once all effects are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.choice import DRIVEN_BY, FORK, is_of_its_shape
from diagnosis.estimation import Fitted
from diagnosis.finding import Accepted, competitors
from diagnosis.hypotheses import Hypothesis, Start, extend, withdraw
from diagnosis.imitation import alike, imitating, in_place
from diagnosis.other_bases import either
from diagnosis.problem import Problem
from diagnosis.pruning import without
from diagnosis.remainder import Remainder
from diagnosis.search import Scored, described, law, score, try_all
from diagnosis.settings import Settings
from diagnosis.turns import either_way
from methods.effects.base import Effect
from methods.parallel import each


def simpler_rivals(item: Accepted, left: Sequence[Remainder]) -> Accepted:
    """The effect without rivals of more parameters where it leaves nothing to explain: it does as well with fewer."""
    if left[item.joint].excess > 0.0:
        return item
    return replace(item, rivals=tuple(rival for rival in item.rivals if rival.effect.size <= item.effect.size))


def beside(problem: Problem, base: Fitted, rival: Scored, others: Sequence[Accepted]) -> Fitted:
    """The model in which a rival was fitted, with just the others beside it; those it lacks are as in the base."""
    point, joint = rival.fitted.point, rival.start.hypothesis.joint
    wanted = {(rival.name, joint)} | {(other.name, other.joint) for other in others}
    for effect in problem.kernel.effects:
        for j in np.flatnonzero(point.switches[:, problem.kernel.switches[effect.name]]):
            if (effect.name, j) not in wanted:
                point = withdraw(problem, point, effect.name, int(j))
    for other in others:
        if not point.switches[other.joint, problem.kernel.switches[other.name]]:
            values = base.point.parameters[:, other.joint, problem.kernel.own(other.effect)]
            point = extend(problem, point, other.scored.start.hypothesis, values)
    return either_way(problem, point)


def other_forms(item: Accepted, accepted: Sequence[Accepted], effects: Sequence[Effect]) -> list[Effect]:
    """The forms of an effect's law that cannot be beside it, and can be beside all others of its joint."""
    there = {other.name for other in accepted if other.joint == item.joint and other is not item}
    return [
        form
        for form in effects
        if form.label == item.label and form.name in set(item.effect.excludes) - set(item.effect.includes)
        if not form.scatters and not there & {form.name, *form.excludes}
    ]


def in_another_form(problem: Problem, base: Fitted, smaller: Fitted, item: Accepted, form: Effect) -> Scored | None:
    """An effect of the base in another form of its law, begun where that does the same, or with what both describe;
    None where they have nothing in common. smaller: the model without the effect, to which the score refers.

    Which form it has may show only beside another effect: a sine's heat follows its current once that is known.
    """
    start = alike(problem, base, item.effect, form, item.joint)
    if start is None:
        known = described(problem, base.point, [item.effect], item.joint)
        if not known.keys() >= {parameter.name for parameter in form.parameters}:
            return None
        values = np.column_stack([known[parameter.name] for parameter in form.parameters])
        apart = item.scored.start.hypothesis.apart
        start = Start(Hypothesis(form, item.joint, apart=apart), values, 0.0, item.scored.start.searched)
    return score(problem, smaller, start, either_way(problem, in_place(problem, base, item.effect, start)))


def confirmed(
    problem: Problem, base: Fitted, item: Accepted, others: Sequence[Accepted], settings: Settings
) -> Accepted:
    """The effect with those of its rivals that do as well in its place beside all other effects.

    They are fitted as far as it has been since: what seemed equal may only have stopped short.
    """
    limit = base.criterion + item.scored.price + settings.rival
    costs = each(lambda rival: beside(problem, base, rival, others).criterion + rival.price, item.rivals)
    return replace(item, rivals=tuple(rival for rival, own in zip(item.rivals, costs, strict=True) if own < limit))


def other_laws(item: Accepted) -> Accepted:
    """The effect with one rival, the likeliest, of each other law and joint: a form of its own law is none."""
    best: dict[tuple[str, int], Scored] = {}
    for rival in sorted(item.rivals, key=lambda rival: rival.fitted.criterion + rival.price):
        best.setdefault(law(rival.start), rival)
    best.pop((item.label, item.joint), None)
    return replace(item, rivals=tuple(best.values()))


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
    one of the torque constant, whose textbook's form may explain nothing of it. How many numbers describe its shape is
    no argument for either.
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
    found = [imitating(problem, base, smaller, item.effect, effect, item.joint) for effect, _ in others]
    rivals = [
        rival
        for rival in either(try_all(problem, smaller, others), [rival for rival in found if rival is not None])
        if rival.fitted.criterion + min(rival.price, item.scored.price) < limit and is_of_its_shape(problem, rival)
    ]
    return replace(item, rivals=(*item.rivals, *rivals))
