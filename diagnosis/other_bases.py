"""The hypotheses tried again from what the nominal model may have settled wrongly without them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.estimation import Fitted, Point, fit
from diagnosis.hypotheses import Hypothesis, Start, extend, sizes_of
from diagnosis.nominal import HOPELESS, JointStructure, limits_settled, point_at, without_limits
from diagnosis.problem import Problem
from diagnosis.search import Scored, best_forms, law, score, try_all, unfitted
from diagnosis.timing import is_timed, timing_settled
from diagnosis.turns import in_turns, to_errors, to_innovations
from envs.log import Array
from methods.effects.base import Effect, Scales
from methods.parallel import each

STRONG = 3.0
"""Size, as a multiple of the effect's own starting values, from which a fit by steps of its own begins."""
DRY = "coulomb_friction"
"""The effect that the regression of the starting point knows."""
FALLING = "stribeck_friction"
"""The one that it may stand for where joints stick and slip."""
DRAG = 0.02
"""Torque of dry friction as a share of the command's rms, from which both are tried as it was regressed."""
HELD = 0.5
"""The same for torques of the place."""
FELT = 0.1
"""The same for both of two effects at once."""
TIMED = 0.75
"""Share of the best evidence from which the best form of a law is compared with a timing of its own."""
TWIN = 0.5
"""The same for the leading law on the other joint of an arm."""
LIMITED = 0.25
"""The same for torque limits that act or do not."""
BRIEF = 3
"""Steps after which the closest of several starts is carried on."""


def also_without_limits(
    problem: Problem, base: Fitted, candidates: Sequence[tuple[Effect, int]], ranked: list[Scored]
) -> list[Scored]:
    """The hypotheses, each as good as with the stated torque limits that act in the base or without them.

    A limit may act there only because something is missing that it can stand in for. Beside it the right effect may
    explain nothing at all. Errors that no hypothesis brings down to noise (`diagnosis.search.stuck`) are a sign of it.
    """
    free = without_limits(problem, base)
    if free is None:
        return ranked
    return either(ranked, [s.refitted(base, s.fitted) for s in try_all(problem, free, candidates)])


def also_by_own_steps(
    problem: Problem, base: Fitted, candidates: Sequence[tuple[Effect, int]], ranked: list[Scored]
) -> list[Scored]:
    """The hypotheses, those of one parameter in a motor as good as after first steps by the sensitivities of the base
    or by their own, from a strong effect.

    A motor that loses most of its torque as it saturates is fitted without that as one with several times its inertia.
    From there the sensitivities of the base lead nowhere. Errors that no hypothesis brings down to noise
    (`diagnosis.search.stuck`) are a sign of it.
    """
    sizes = sizes_of(problem, base)
    starts = [
        Start(Hypothesis(effect, j), np.tile(STRONG * np.array(values, float), (problem.logs, 1)), 0.0)
        for effect, j in candidates
        if effect.stage == "motor" and effect.size == 1 and effect.starts is not None
        for values in effect.starts(sizes[j])
    ]

    def found(start: Start) -> Scored:
        point = extend(problem, base.point, start.hypothesis, start.values)
        return score(problem, base, start, fit(problem, point, rounds=2, iterations=10))

    return either(ranked, each(found, starts))


def also_from_regression(
    problem: Problem,
    structures: tuple[JointStructure, ...],
    base: Fitted,
    candidates: Sequence[tuple[Effect, int]],
    ranked: list[Scored],
) -> list[Scored]:
    """The hypotheses, dry friction and torques of the place as good as from the base or from the regression of the
    command on the motion.

    Where a slow joint takes much of its torque to overcome friction, the base that does without may be far from all
    that the joint is, and no way leads from there. Where a spring or its weight moves a joint more than its motor does,
    the best base without them may be a joint of any inertia, which no torque moves.
    """
    if not ranked:
        return ranked
    command, sizes = np.sqrt(np.mean(problem.command**2, axis=0)), sizes_of(problem, base)
    dry, friction, *_ = point_at(problem, structures)
    starts: list[tuple[Point, list[Start]]] = []
    for effect in dict.fromkeys(effect for effect, _ in candidates):
        if effect.name in (DRY, FALLING) and ranked[0].label != DRY:
            point, values = dry, [of_friction(effect, own, sizes[j]) for j, own in enumerate(friction)]
            is_felt = friction > DRAG * command
        elif effect.is_linear_in_place:
            point, _, torques, change = point_at(problem, structures, effect)
            values, is_felt = [[own] for own in torques], change > HELD * command
        else:
            continue
        is_offered = [effect.starts is None or any(effect.starts(own)) for own in sizes.values()]
        for j in (j for other, j in candidates if other is effect and is_felt[j] and is_offered[j]):
            alike = [Start(Hypothesis(effect, j), np.tile(own, (problem.logs, 1)), 0.0) for own in values[j]]
            starts.append((point, alike))
    limit = ranked[0].fitted.criterion + base.samples * np.log(HOPELESS)

    def carried_on(item: tuple[Point, list[Start]]) -> Scored | None:
        point, alike = item
        points = [extend(problem, point, start.hypothesis, start.values) for start in alike]
        if len(points) > 1:
            fits = [to_errors(problem, begun, BRIEF) for begun in points]
            points = [min(fits, key=lambda fitted: problem.squares(fitted.error)).point]
        found = to_errors(problem, points[0])
        if unfitted(problem, base, found.point, found.error).criterion > limit:
            return None
        return score(problem, base, alike[0], to_innovations(problem, found))

    return either(ranked, [scored for scored in each(carried_on, starts) if scored is not None])


def two_at_once(
    problem: Problem,
    structures: tuple[JointStructure, ...],
    base: Fitted,
    candidates: Sequence[tuple[Effect, int]],
) -> list[tuple[Start, Start, Fitted]]:
    """Dry friction beside each torque of the place, both as they are regressed together, and the fit with both; the
    likeliest first. Only where both are felt.

    A joint that friction and a spring hold is far from any joint with one of them: the best base without the other one
    moves for other reasons.
    """
    command = np.sqrt(np.mean(problem.command**2, axis=0))
    offered = {effect.name: effect for effect, _ in candidates}
    begun: list[tuple[Start, Start, Point]] = []
    for effect in offered.values():
        if DRY not in offered or not effect.is_linear_in_place:
            continue
        point, friction, torques, change = point_at(problem, structures, effect)
        for j in (j for other, j in candidates if other is effect and (offered[DRY], j) in candidates):
            if min(friction[j], change[j]) > FELT * command[j]:
                of = lambda law, own, j=j: Start(Hypothesis(law, j), np.tile(own, (problem.logs, 1)), 0.0)  # noqa: E731
                dry, place = of(offered[DRY], friction[j : j + 1]), of(effect, torques[j])
                both = extend(
                    problem, extend(problem, point, dry.hypothesis, dry.values), place.hypothesis, place.values
                )
                begun.append((dry, place, both))
    fits = each(lambda item: (*item[:2], to_innovations(problem, to_errors(problem, item[2]))), begun)
    return sorted(fits, key=lambda item: item[2].criterion)


def of_friction(effect: Effect, friction: float, size: Scales) -> list[Array]:
    """Parameters (size,) with which a law of dry friction of this strength begins: where joints stick and slip, many a
    start leads astray."""
    if effect.name == DRY or effect.starts is None:
        return [np.array([friction])]
    every, levels = [np.array(values, float) for values in effect.starts(size)], list(effect.amplitudes)
    for values in every:
        values[levels] *= friction / values[levels].sum()
    return every


def either(ranked: Sequence[Scored], others: Sequence[Scored]) -> list[Scored]:
    """Of every hypothesis the fit that explains more, best first."""
    best = {(s.name, s.start.hypothesis.joint): s for s in ranked}
    for scored in others:
        place = scored.name, scored.start.hypothesis.joint
        if place not in best or scored.decrease > best[place].decrease:
            best[place] = scored
    return sorted(best.values(), key=lambda s: -s.evidence)


def settled_anew(
    problem: Problem, structures: tuple[JointStructure, ...], base: Fitted, ranked: list[Scored]
) -> list[Scored]:
    """The hypotheses, those of different laws that compete for the first place with what the base may have settled
    wrongly without them: whether a stated torque limit acts, and when commands do, unless their timing is free.

    A law that does no better than one that it contains has nothing to gain from it that this one has not.
    """
    leading = best_forms(ranked)
    best = max((s.evidence for s in ranked), default=0.0)
    alone = {(s.name, s.start.hypothesis.joint): s.evidence for s in ranked}

    def competes(scored: Scored, share: float) -> bool:
        ahead = scored is leading[law(scored.start)] and scored.evidence > max(share * best, 0.0)
        inner = ((name, scored.start.hypothesis.joint) for name in scored.effect.includes)
        return ahead and not any(alone[own] >= scored.evidence for own in inner if own in alone)

    def anew(scored: Scored) -> Scored:
        fitted = scored.fitted
        if competes(scored, LIMITED):
            fitted = limits_settled(problem, fitted, structures)
        if competes(scored, TIMED) and not is_timed(fitted):
            fitted = timing_settled(problem, fitted)
        return scored if fitted is scored.fitted else scored.refitted(base, fitted)

    return sorted(each(anew, ranked), key=lambda scored: -scored.evidence)


def on_either_joint(problem: Problem, base: Fitted, ranked: list[Scored]) -> list[Scored]:
    """The hypotheses, where two joints are one arm the leading law of either of them as far as it goes.

    A soft spring in one joint moves the other one, too, and which of them has it shows only in the end: the right fit
    may still have to come all the way from a base that has taken the spring for something else.
    """
    if not (problem.pair and ranked):
        return ranked
    label, joint = law(ranked[0].start)
    twins = [scored for scored in ranked if law(scored.start) == (label, 1 - joint)][:1]
    if not any(twin.evidence > TWIN * ranked[0].evidence for twin in twins):
        return ranked

    def further(scored: Scored) -> Scored:
        fitted = timing_settled(problem, in_turns(problem, scored.fitted))
        return scored.refitted(base, in_turns(problem, fitted))

    both = [ranked[0], *twins]
    found = dict(zip(map(id, both), each(further, both), strict=True))
    return sorted((found.get(id(scored), scored) for scored in ranked), key=lambda s: -s.evidence)
