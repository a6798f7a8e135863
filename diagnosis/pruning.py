"""Accepted effects taken back, merged, or put into a simpler form, where the model does as well without."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache, partial, reduce

import numpy as np

from diagnosis.arm_damping import undivided
from diagnosis.beginning import started
from diagnosis.choice import materiality, tells_no_amplifier
from diagnosis.constancy import is_certain_everywhere, is_the_same_everywhere, stands_apart
from diagnosis.estimation import Fitted, Point, covariance, errors, fit, plain
from diagnosis.finding import Accepted
from diagnosis.hypotheses import PER_LOG, extend, proposals, sizes_of, withdraw
from diagnosis.instants import happens
from diagnosis.of_motion import is_of_motion
from diagnosis.problem import Problem
from diagnosis.regression import View
from diagnosis.remainder import Remainder, remainders
from diagnosis.replay import WINDOW, replay
from diagnosis.search import Ranked, containing, generalised, is_resolved, price, score, within
from diagnosis.settings import Settings
from diagnosis.whitening import on_logs
from envs.log import Array
from methods.effects.base import Effect
from methods.parallel import each

SURE = 20.0
"""Wald statistic of an effect, over what its removal has to cost, from which it is taken to cost that."""
CLEARLY = 0.9
"""Share of the error of free simulation that a spring or a play leaves at most, beside torques of an arm."""
KEPT = 0.25
"""Share of what a wave explains per fitted sample that it has to explain per sample of data that nobody fitted."""
CLEARED = 0.1
"""What may stay unexplained, as a share of what a small effect explains, for it to be more than a repair of a law."""


def prune(
    problem: Problem, accepted: list[Accepted], base: Fitted, settings: Settings, sure: float = SURE
) -> tuple[list[Accepted], Fitted]:
    """Drop effects that the others, or a better fit without them, made superfluous.

    What an effect of the motor torque tells of mechanical damping and back-EMF may be all that it is still there for.
    sure: Wald statistic, over the least cost of a removal, from which an effect is not asked.
    """
    while accepted:
        asked = [item for item in accepted if wald(base, item) <= sure * (item.scored.price + settings.threshold)]
        fits = each(partial(dispensed_with, problem, base, settings), asked)
        dropped = next(((item, fitted) for item, fitted in zip(asked, fits, strict=True) if fitted is not None), None)
        if dropped is None:
            break
        accepted, base = [other for other in accepted if other is not dropped[0]], dropped[1]
    return accepted, base


def dispensed_with(problem: Problem, base: Fitted, settings: Settings, item: Accepted) -> Fitted | None:
    """The model refitted without an effect, where it does as well; None otherwise."""
    allowed = base.criterion + item.scored.price + settings.threshold
    smaller = without(problem, base, item)
    if smaller.criterion >= allowed and item.effect.has_motor_torque:
        smaller = without(problem, base, item, divided=True)
    return smaller if smaller.criterion < allowed else None


def simplified(
    problem: Problem, base: Fitted, chosen: Accepted, effects: Sequence[Effect], settings: Settings
) -> Accepted:
    """The effect that the chosen one includes as its limit, where that does as well with fewer parameters.

    It is begun with what the chosen one lends, which describes little where that has stood in for another law, too (a
    Stribeck friction that falls to nothing for a Coulomb friction and a viscous one), and with what a model without
    either leaves to it.
    """
    joint = chosen.joint
    inner = [(other, joint) for other in effects if other.name in chosen.effect.includes]
    if not inner:
        return chosen
    visible = is_resolved(problem, chosen.scored)
    for start in proposals(problem, [View.of(problem, base)], inner, sizes_of(problem, base))[0]:
        lent = within(problem, chosen.scored, start), chosen.scored.fitted.whitener
        left = extend(problem, base.point, start.hypothesis, start.values), None
        begun = each(lambda begin: fit(problem, *begin, rounds=2, iterations=12), (lent, left))
        simple = score(problem, base, start, min(begun, key=lambda fitted: fitted.criterion))
        saved = chosen.scored.price - simple.price
        if chosen.scored.decrease - simple.decrease < saved + settings.threshold or not visible:
            share = materiality(problem, simple.fitted, simple.name, joint)
            rivals = tuple(
                rival
                for rival in chosen.rivals
                if rival.name != simple.name and simple.name not in rival.effect.includes
            )
            return replace(chosen, scored=simple, material=share, rivals=rivals)
    return chosen


def merged(
    problem: Problem, accepted: list[Accepted], chosen: Accepted, settings: Settings
) -> tuple[list[Accepted], Accepted]:
    """An effect that contains an earlier one takes its place, where both together do no better.

    One that came as a more general form of an earlier one and is back in its simplest is that one. It inherits the
    competition of what it replaces: it has been compared with the other laws only beside that.
    """
    for item in accepted:
        if item.name not in (chosen.name, *chosen.effect.includes) or item.joint != chosen.joint:
            continue
        both = chosen.scored.fitted
        allowed = item.scored.price + settings.threshold
        for fitted in alone(problem, item, chosen):
            if fitted.criterion - both.criterion < allowed:
                decrease = chosen.scored.decrease + item.scored.decrease + both.criterion - fitted.criterion
                scored = replace(chosen.scored, fitted=fitted, decrease=decrease)
                own = Ranked(chosen.label, chosen.joint, decrease, scored.price)
                others = (r for r in item.considered if (r.name, r.joint) != (chosen.label, chosen.joint))
                chosen = replace(chosen, scored=scored, considered=(own, *others))
                accepted = [other for other in accepted if other is not item]
                break
    return accepted, chosen


def alone(problem: Problem, item: Accepted, chosen: Accepted) -> Iterator[Fitted]:
    """Fits of the model with the chosen effect that contains `item` and without the latter.

    Begun with the sum of what they have in common; then from the unfiltered errors, since what they share may bear
    different names.
    """
    effect, joint, column = chosen.effect, chosen.joint, problem.kernel.column
    both = chosen.scored.fitted
    if item.name == chosen.name or not both.point.switches[joint, problem.kernel.switches[item.name]]:
        yield both  # the chosen form has begun in its place
        return
    point = withdraw(problem, both.point, item.name, joint)
    shared = {p.name for p in item.effect.parameters} & {p.name for p in effect.parameters}
    if shared:
        parameters = point.parameters.copy()
        for name in shared:
            parameters[:, joint, column(effect, name)] += parameters[:, joint, column(item.effect, name)]
        yield fit(problem, replace(point, parameters=parameters), rounds=2, iterations=8)
    bare = fit(problem, point, plain(problem, both).whitener, rounds=1, iterations=8, renewed=False)
    yield fit(problem, bare.point, rounds=2, iterations=8)


def simplified_afterwards(
    problem: Problem,
    accepted: list[Accepted],
    base: Fitted,
    effects: Sequence[Effect],
    settings: Settings,
    *,
    is_last_simple: bool = True,
) -> tuple[list[Accepted], Fitted]:
    """The effects in their simplest form, but for the last, which is (`is_last_simple`): before that one was there they
    may have stood in for it. Where one of them has, so has the last one for what that has lacked."""
    before, whole = accepted, base

    def simple(item: Accepted) -> Accepted:
        smaller = without(problem, base, item)
        scored = replace(item.scored, fitted=base, decrease=smaller.criterion - base.criterion)
        return simplified(problem, smaller, replace(item, scored=scored), effects, settings)

    asked = [item for item in before if item.effect.includes and not (is_last_simple and item is before[-1])]
    ahead = dict(zip(asked, each(simple, asked), strict=True))  # which hold as long as none is in a simpler form
    for item in before:
        if not item.effect.includes or (is_last_simple and item is before[-1] and accepted is before):
            continue
        found = ahead[item] if base is whole else simple(item)
        if found.name != item.name:
            accepted = [found if other is item else other for other in accepted]
            base = found.scored.fitted
    return accepted, base


def merged_afterwards(
    problem: Problem, accepted: list[Accepted], base: Fitted, settings: Settings
) -> tuple[list[Accepted], Fitted]:
    """The effects without those that others contain: it may show only when all are in their simplest form."""
    for item in accepted if len(accepted) > 1 else ():
        others = [other for other in accepted if other is not item]
        left, whole = merged(problem, others, replace(item, scored=replace(item.scored, fitted=base)), settings)
        if len(left) < len(others):
            return merged_afterwards(problem, [*left, whole], whole.scored.fitted, settings)
    return accepted, base


def unified(
    problem: Problem, accepted: list[Accepted], base: Fitted, effects: Sequence[Effect], settings: Settings
) -> tuple[list[Accepted], Fitted]:
    """The effects with one law in the place of parts of it, another form of it among them, where it does as well."""
    options = []
    for effect, joint in ((effect, j) for effect in effects for j in range(problem.joints)):
        laws = {effect.label, *effect.includes}
        parts = [item for item in accepted if item.joint == joint and {item.name, item.label} & laws]
        if len({item.label for item in parts}) > 1 and effect not in [item.effect for item in parts]:
            options.append((effect, joint, parts))
    if not options:
        return accepted, base
    view, sizes = View.of(problem, base), sizes_of(problem, base)

    def united(option: tuple[Effect, int, list[Accepted]]) -> Accepted | None:
        effect, joint, parts = option
        start, points = generalised(problem, view, effect, [item.effect for item in parts], joint, sizes[joint])
        fitted = containing(problem, base, points)
        fitted = min(fitted, fit(problem, fitted.point, rounds=2, iterations=12), key=lambda found: found.criterion)
        allowed = sum(item.scored.price for item in parts) + settings.threshold
        if fitted.criterion + price(problem, start, base.samples) > base.criterion + allowed:
            return None
        smaller = reduce(partial(without, problem), parts, base)
        whole = score(problem, smaller, start, fitted)
        one = Accepted(whole, materiality(problem, fitted, whole.name, joint), ())
        return simplified(problem, smaller, one, effects, settings)

    for one, (_, _, parts) in zip(each(united, options), options, strict=True):
        if one is not None:
            return [*(item for item in accepted if item not in parts), one], one.scored.fitted
    return accepted, base


def significant(
    problem: Problem, accepted: list[Accepted], base: Fitted, settings: Settings
) -> tuple[list[Accepted], Fitted]:
    """Without the effects whose amplitudes do not stand out of their own robust deviations.

    An amplitude may be uncertain only because another parameter can take a part of it (a delay beside a winding's lag
    too short for the steps). So what counts is what the removal costs, over how much wider the robust deviation is.
    """
    while accepted:
        spread, weak = covariance(base), None
        for item in sorted(accepted, key=lambda item: wald(base, item, spread)):
            statistic = wald(base, item, spread)
            if statistic > settings.threshold:
                break
            smaller = without(problem, base, item)
            wider = wald(base, item) / max(statistic, 1e-300)
            if smaller.criterion - base.criterion < settings.threshold * max(wider, 1.0):
                weak = item, smaller
                break
        if weak is None:
            break
        accepted, base = [other for other in accepted if other is not weak[0]], weak[1]
    return accepted, base


def general(
    problem: Problem,
    held_out: Problem,
    nominal: Fitted,
    accepted: list[Accepted],
    base: Fitted,
    settings: Settings,
) -> tuple[list[Accepted], Fitted]:
    """Without effects that do not pay for themselves beside the others, weak ones that make data that nobody fitted
    less likely, or waves that make them likelier by less than a share of what they explain (their phase there is free
    to follow what else moves), and weak events that do not happen there: that one happens in one log only needs more
    evidence. So counts a wave whose phase every log has of its own and that does not stand out in each.

    A small one beside others counts as weak whatever its evidence: where small causes grow, or a law beside it is
    inexact, any law that shapes the fitted motion a little finds some. So does one beside torques of the rest of an
    arm, which are as inexact as the measured motion: it also has to bring free simulations closer, unless without it a
    stated number would be wrong beyond what it costs. What it gains has to be of the motion, too, and more than a trace
    of the nominal model's errors, unless its torque is more than inexact laws err by, or no law beside it could be
    inexact by that.
    """
    explained = nominal.criterion - base.criterion
    small = settings.doubtful * explained
    before = cache(lambda: astray(held_out, elsewhere(held_out, nominal)))
    for item in sorted(accepted, key=lambda item: item.scored.evidence):
        is_free = item.effect.name in PER_LOG
        is_weak = item.scored.evidence <= settings.weak or (
            is_free and not is_certain_everywhere(problem, base, item.effect, item.joint)
        )
        is_sure = not is_weak and problem.arm is None
        if is_sure and len(accepted) < 2:
            continue
        smaller = without(problem, base, item)
        if len(accepted) == 1:
            smaller = min(smaller, nominal, key=lambda option: option.criterion)
        loss = smaller.criterion - base.criterion
        if is_sure and loss > small:
            continue
        there, less = elsewhere(held_out, base), elsewhere(held_out, smaller)
        others = [other.effect for other in accepted if other is not item]
        gain, own_share = misfit(less) - misfit(there), loss * held_out.used.sum() / problem.used.sum()
        shows = (
            loss > item.scored.price
            and (not is_weak or happens(held_out, there.point, item.effect, item.joint))
            and gain >= (KEPT * own_share if is_weak and is_free else 0.0)
            and (
                problem.arm is None
                or is_stated(item, base, smaller, settings)
                or is_closer(held_out, item.effect, there, less)
            )
            and is_of_motion(problem, base, smaller)
            and (
                len(accepted) < 2
                or item.effect.scan == "event"
                or loss > settings.unexplained * explained
                or (not is_weak and item.material > settings.relevant)
                or (not is_weak and all(tells_no_amplifier(item.effect, other) for other in others))
                or moved_by(held_out, before(), there, less) > settings.trace
                or (
                    not is_weak
                    and stands_apart(item.effect, others)
                    and gain > KEPT * own_share
                    and is_the_same_everywhere(problem, base, item.effect, item.joint)
                )
            )
        )
        if not shows:
            accepted, base = [other for other in accepted if other is not item], smaller
    return accepted, base


def is_stated(item: Accepted, base: Fitted, smaller: Fitted, settings: Settings) -> bool:
    """Whether the model without an effect contradicts what is known of its parameters by more than the effect costs: a
    winding's lag of five times the stated one stands for a delay."""
    more = smaller.point.contradicted - base.point.contradicted
    return more > item.scored.price + settings.threshold


def is_closer(held_out: Problem, effect: Effect, there: Fitted, less: Fitted) -> bool:
    """Whether free simulations of data that are not fitted come closer with an effect than without it.

    A spring or a play filters what the rest of the arm does to a motor, and makes up for what that is measured with; it
    has to bring them clearly closer.
    """
    return bool(np.all(astray(held_out, there) < (CLEARLY if effect.parts_the_arm else 1.0) * astray(held_out, less)))


def astray(held_out: Problem, there: Fitted) -> Array:
    """Rms (n,) by which free simulations of each joint go astray within a window on other logs."""
    return np.asarray(np.sqrt(np.nanmean(replay(held_out, there.point, WINDOW).windows ** 2, axis=0)))


def moved_by(held_out: Problem, before: Array, there: Fitted, less: Fitted) -> float:
    """Share of the nominal model's errors in free simulation that an effect accounts for, at the joint where it is
    most. before (n,): those errors. there, less: the model with the effect and without."""
    after, without_it = astray(held_out, there), astray(held_out, less)
    return float(np.max(np.sqrt(np.maximum(without_it**2 - after**2, 0.0)) / np.maximum(before, 1e-300)))


def deviance(held_out: Problem, fitted: Fitted) -> float:
    """-2 log likelihood, up to a constant, of data that were not fitted: their innovations by the fit's own filter."""
    return misfit(elsewhere(held_out, fitted))


def misfit(there: Fitted) -> float:
    """-2 log likelihood, up to a constant, of the innovations that a model leaves as it is."""
    innovation = there.innovation.reshape(len(there.whitener.coefficients), -1)
    if not innovation.size:
        return 0.0
    return float(innovation.shape[1] * np.sum(np.log(np.mean(innovation**2, axis=1) + there.floor)))


def elsewhere(held_out: Problem, fitted: Fitted) -> Fitted:
    """The errors and innovations that a fit leaves on other logs, begun as these begin."""
    point, whiten = started(held_out, fitted.point, fitted.whitener), on_logs(held_out, fitted.whitener)
    error = errors(held_out, [point])[0]
    return replace(fitted, point=point, error=error, whitener=whiten, innovation=whiten(error))


def wald(base: Fitted, item: Accepted, spread: Array | None = None) -> float:
    """Wald statistic of an effect's amplitudes: what its removal would cost to first order.

    spread: covariance of the free parameters, that of the fit unless given.
    """
    effect = item.effect
    amplitudes = {effect.parameters[a].name for a in (effect.amplitudes or range(effect.size))}
    own = {
        i: f.name.partition(".")[2].partition("@")[0]
        for i, f in enumerate(base.point.free)
        if f.name.startswith(f"{item.name}.") and f.joint == item.joint
    }
    wanted = [i for i, name in own.items() if name in amplitudes]
    shapes = [i for i, name in own.items() if name not in amplitudes]
    spread = base.covariance if spread is None else spread
    inner = spread[np.ix_(wanted, wanted)]
    if shapes:  # an amplitude may be uncertain only because the shape is: the shape counts as known
        cross = spread[np.ix_(wanted, shapes)]
        inner = inner - cross @ np.linalg.pinv(spread[np.ix_(shapes, shapes)]) @ cross.T
    values = base.point.vector[wanted]
    return float(values @ np.linalg.pinv(inner) @ values)


def one_dry_friction(
    problem: Problem, nominal: Fitted, accepted: list[Accepted], base: Fitted, settings: Settings
) -> tuple[list[Accepted], Fitted]:
    """The effects without a second dry friction of a joint that only repairs the law of the first: what it explains
    may as well stay unexplained."""
    allowed = settings.unexplained * (nominal.criterion - base.criterion)
    for j in range(problem.joints):
        dry = [item for item in accepted if item.joint == j and item.effect.is_dry]
        if len(dry) < 2:
            continue
        item, loss, smaller = _weakest(problem, base, dry)
        if loss < allowed:
            accepted, base = [other for other in accepted if other is not item], smaller
    return accepted, base


def trim(
    problem: Problem,
    nominal: Fitted,
    accepted: list[Accepted],
    base: Fitted,
    left: tuple[Remainder, ...],
    settings: Settings,
) -> tuple[list[Accepted], Fitted, tuple[Remainder, ...]]:
    """Take back small effects while the model stays incomplete: they may only repair the inexact law of a large one."""
    explained = nominal.criterion - base.criterion
    while len(accepted) > 1 and sum(r.excess for r in left) > 0.0:
        weakest = _weakest(problem, base, accepted)
        if sum(r.excess for r in left) <= CLEARED * weakest[1]:
            break
        item, loss, smaller = weakest
        if loss > settings.doubtful * explained:
            break
        accepted = [other for other in accepted if other is not item]
        base = smaller
        left = remainders(problem, base)
    return accepted, base, left


def _weakest(problem: Problem, base: Fitted, accepted: Sequence[Accepted]) -> tuple[Accepted, float, Fitted]:
    """The effect whose removal costs least, that cost, and the model without it."""
    smaller = each(lambda item: without(problem, base, item), accepted)
    item, best = min(zip(accepted, smaller, strict=True), key=lambda option: option[1].criterion)
    return item, best.criterion - base.criterion, best


def without(problem: Problem, base: Fitted, item: Accepted, *, divided: bool = False) -> Fitted:
    """The model refitted without one of its effects; divided: see `diagnosis.hypotheses.withdraw`."""
    return fit(problem, left_out(problem, base.point, item, divided=divided), rounds=2, iterations=4, tolerance=1e-4)


def left_out(problem: Problem, point: Point, item: Accepted, *, divided: bool = False) -> Point:
    """The model as it is without one of its effects."""
    return undivided(problem, withdraw(problem, point, item.name, item.joint, divided=divided))
