"""Which effects are missing: propose by regression, decide by prediction error, prefer the simple, prune backwards."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress, filterfalse, product
from typing import TypeVar

import numpy as np

from diagnosis.arm_damping import on_arms_side, rubbing_behind, rubs, taken_back
from diagnosis.estimation import Fitted, Point, errors, fit, plain, scatters, sensitivities
from diagnosis.first_fits import across, first_fits, further, on_all_samples, retuned, seen_in_part
from diagnosis.glance import Glance, can_be_glanced_at, glance
from diagnosis.hypotheses import AT_ONCE, MEMORY, Hypothesis, Start, extend, proposals, sizes_of, withdraw
from diagnosis.instants import apart_in, retimed
from diagnosis.lags import BACK_EMF, INERTIA, VISCOUS
from diagnosis.problem import Problem
from diagnosis.regression import View
from diagnosis.resonance import ringing
from diagnosis.turns import either_way, free_of_filter, to_errors
from diagnosis.whitening import whitener
from envs.log import Array
from methods.effects.base import Effect, Scales
from methods.kernel import NOMINAL
from methods.parallel import each

LEAST = 3
"""Hypotheses that are fitted in any case."""
NEARLY = 0.5
"""Share of its price that a hypothesis has to promise to be fitted."""
FAR = 0.02
"""Share of the best promise below which a hypothesis is not fitted."""
HOPE = 0.5
"""Share of its promise that a first fit is given credit for; far from the optimum it may have stopped short."""
CHANCE = 0.2
"""Share of the best first fit's decrease below which a hypothesis is not carried on."""
FORM = 0.9
"""Share of what the general form of a law is worth from which its textbook form is taken first."""
OTHER_FORM = 0.5
"""The same of a form that stands beside the leading one, neither of which contains the other."""
RETRIED = 3
"""Laws that are fitted once more, to the errors as they are."""
COLOURED = 5.0
"""Rms of the errors over that of their innovations from which that is done."""
MET = 2
"""Starting values from which an effect is fitted in whose motion small causes grow."""
FEW = 3
"""Sensitivities by which fits to the errors as they are begin, of which the nearest ones are carried on."""
NEARBY = 4.0
"""Sum of squares, over that of the nearest one, up to which fits of such effects are."""
WAYS: tuple[Callable[[Problem, Point], Fitted], ...] = (partial(fit, rounds=2, iterations=8), free_of_filter)
"""How an effect is fitted in whose motion small causes grow."""
BEHIND = (0.0, 0.1, 0.2, 0.4)
"""Shares of all damping behind a play with which it is begun."""
LIGHTER = (1.0, 0.8)
"""Shares of the inertia of a joint without a play with which that is done."""
CLOSE = 0.75
"""Share of the best first fit's decrease from which a hypothesis is fitted to all samples, where a part is enough."""
NONE_BEHIND = 0.01
"""Share of friction behind a spring or a play up to which it may as well be on the motor's side."""
NEAR = 0.9
"""Share of the best decrease above which a hypothesis counts as its near equal."""


@dataclass(frozen=True, eq=False)
class Scored:
    """A fitted hypothesis beside its parent: decrease of -2 log likelihood, and the price it has to pay."""

    start: Start
    fitted: Fitted
    decrease: float
    price: float

    @property
    def effect(self) -> Effect:
        return self.start.hypothesis.effect

    @property
    def name(self) -> str:
        return self.effect.name

    @property
    def label(self) -> str:
        """The standard name, whichever instance of the effect it is."""
        return self.effect.label

    @property
    def evidence(self) -> float:
        return self.decrease - self.price

    def refitted(self, base: Fitted, fitted: Fitted) -> Scored:
        """The same hypothesis with another fit, beside its parent."""
        return replace(self, fitted=fitted, decrease=base.criterion - fitted.criterion)


@dataclass(frozen=True)
class Ranked:
    """The score of a hypothesis without its fit; joint is the index into the problem."""

    name: str
    joint: int
    decrease: float
    price: float


def ranking(scored: Sequence[Scored]) -> tuple[Ranked, ...]:
    """Scores in the same order, of every law the form that comes first."""
    found: dict[tuple[str, int], Ranked] = {}
    for s in scored:
        key = s.label, s.start.hypothesis.joint
        found.setdefault(key, Ranked(*key, s.decrease, s.price))
    return tuple(found.values())


def price(problem: Problem, start: Start, samples: int) -> float:
    """What an effect is charged: ln N per parameter and 2 ln(number of shapes searched)."""
    effect = start.hypothesis.effect
    extra = sum(problem.logs - 1 for f in effect.parameters if f.name in ("sine", "cosine") and effect.scan == "time")
    extra += max(len(start.hypothesis.apart) - 1, 0) + int(start.hypothesis.behind)
    return (effect.size + extra) * np.log(samples) + 2.0 * np.log(float(max(start.searched, 1)))


def try_all(
    problem: Problem,
    base: Fitted,
    effects: Sequence[tuple[Effect, int]],
    *,
    refine: int = 8,
    finals: int = 3,
    needed: float = -np.inf,
    is_hopeless: Callable[[Start], bool] = lambda start: False,
) -> list[Scored]:
    """Every hypothesis on top of a base model, best first; only the promising ones are refined.

    `needed`: linear prediction of the evidence below which a hypothesis is not refined; `is_hopeless`: whether it
    could not be taken for its size.
    """
    base = _with_reference(problem, base)
    bare_base, sizes = plain(problem, base), sizes_of(problem, base)
    views = [View.of(problem, view) for view in (base, bare_base)]
    parts = [contained(problem, base.point, *item) for item in effects]
    general = [(effect, own, j) for (effect, j), own in zip(effects, parts, strict=True) if own]
    plainly = [item for item, own in zip(effects, parts, strict=True) if not own]
    look = glance(problem, base)
    lists = proposals(problem, views, plainly, sizes, look)
    if look is not None and not look.is_enough(max([needed, *(start.promise for start in lists[0])])):
        lists = on_all(problem, views, plainly, sizes, lists, look.least_promise(needed))
        look = None
    own, bare = (
        first(filterfalse(is_hopeless, worth_fitting(problem, starts, base.samples, needed, least)), refine, law)
        for starts, least in zip((simplest(lists[0]), hidden(*lists)), (LEAST, 0), strict=True)
    )
    known = sensitivities(problem, base.point, base.error)
    rough = first_fits(problem, base, own, known, look)
    rough += further(problem, bare_base, bare, known, look)
    either = {s.hypothesis.key: s for s in [*bare, *own]}.values()
    other = [(start, p, 3) for start in either for p in exchanged(problem, base.point, start)]
    forms = each(lambda item: generalised(problem, views[0], *item, sizes[item[-1]]), general)
    hopeful = [form for form in forms if form[0].promise > NEARLY * max(needed, np.log(base.samples))]
    rough += each(lambda item: (item[0], fit(problem, item[1], rounds=1, iterations=item[2])), other)
    rough += each(lambda item: (item[0], containing(problem, base, item[1])), hopeful)
    rough += [found for effect, j in plainly for found in rung(problem, base, effect, j)]
    rough += [found for effect, j in plainly for found in met(problem, base, effect, j, sizes[j])]
    promised = {(start.hypothesis.effect.name, start.hypothesis.joint): start for start in reversed(lists[0])}
    scored = [score(problem, base, start, fitted) for start, fitted in rough]
    return _converged(problem, base, scored, promised, finals, known, look)


def on_all(
    problem: Problem,
    views: Sequence[View],
    effects: Sequence[tuple[Effect, int]],
    sizes: dict[int, Scales],
    lists: Sequence[list[Start]],
    least: float,
) -> list[list[Start]]:
    """What each view proposes on all samples, where a part of them was not enough; those that promise less than `least`
    on the part in any view stay as they are, and those that were not looked at on a part."""
    place = lambda start: (start.hypothesis.effect.name, start.hypothesis.joint)  # noqa: E731
    hopeful = {place(start) for starts in lists for start in starts if start.promise >= least}
    again = [(effect, j) for effect, j in effects if can_be_glanced_at(effect) and (effect.name, j) in hopeful]
    places = {(effect.name, j) for effect, j in again}
    found = []
    for starts, anew in zip(lists, proposals(problem, views, again, sizes), strict=True):
        kept = [start for start in starts if place(start) not in places]
        found.append(sorted([*kept, *anew], key=lambda start: -start.promise))
    return found


def rung(problem: Problem, base: Fitted, effect: Effect, joint: int) -> list[tuple[Start, Fitted]]:
    """The best fit of an effect from where it rings as the errors do, first to these as they are; the one that a few
    steps have brought nearest is carried on."""
    begun = each(lambda item: (item[0], to_errors(problem, item[1], FEW)), ringing(problem, base, effect, joint))
    if not begun:
        return []
    start, nearest = min(begun, key=lambda item: item[1].criterion)
    return [(start, free_of_filter(problem, nearest.point))]


def met(problem: Problem, base: Fitted, effect: Effect, joint: int, size: Scales) -> list[tuple[Start, Fitted]]:
    """The best fit of an effect in whose motion small causes grow, begun where it comes closest as it is.

    A regression on what it would do to the prediction tells nothing there: the same blow a little later is another
    motion. Simulated with each of its starting values, and with a filter of its own, it shows at once.
    """
    close = closest(problem, base, effect, joint, size)
    fits = each(lambda task: (task[1][0], task[0](problem, task[1][1])), product(WAYS, close))
    return [min(fits, key=lambda item: item[1].criterion)] if fits else []


def plays(
    problem: Problem, base: Fitted, effects: Sequence[tuple[Effect, int]], *, is_sought: bool = True
) -> list[Scored]:
    """Of all effects those in whose motion small causes grow, begun from everywhere, best first.

    They are also begun with some of the damping behind the play and with less inertia, since a joint without a play
    makes up for it by more; with all damping on the wrong side no play comes close. Those that a few steps have brought
    nearly as near to the readings as the nearest one, and nearer than the base, are fitted as in `met`.
    is_sought: where none comes close by itself, as beside a winding's lag that stands for the play, those that come
    closest are fitted nevertheless.
    """
    sizes = sizes_of(problem, base)
    from_everywhere = partial(closest, problem, base, is_thorough=True, is_sought=is_sought)
    begun = [item for effect, j in effects for item in from_everywhere(effect, j, sizes[j])]
    if not begun:
        return []
    tried = each(lambda item: to_errors(problem, item[1], iterations=FEW), begun)
    squares = [problem.squares(fitted.error) for fitted in tried]
    most = max(min(squares), min(problem.squares(base.error), NEARBY * min(squares)))
    near = [item for item, square in zip(begun, squares, strict=True) if square <= most]
    fits = each(lambda task: (task[1][0], task[0](problem, task[1][1])), product(WAYS, near))
    scored = sorted((score(problem, base, *found) for found in fits), key=lambda s: s.evidence)
    best = {(s.name, s.start.hypothesis.joint): s for s in scored}
    return sorted(best.values(), key=lambda s: -s.evidence)


def closest(
    problem: Problem,
    base: Fitted,
    effect: Effect,
    joint: int,
    size: Scales,
    *,
    is_thorough: bool = False,
    is_sought: bool = False,
) -> list[tuple[Start, Point]]:
    """An effect in whose motion small causes grow, with those of its starting values that do better than the base by
    themselves, `MET` at most; is_thorough, is_sought: see `plays`."""
    if not effect.scatters or effect.starts is None:
        return []
    every = [np.tile(np.array(values, float), (problem.logs, 1)) for values in effect.starts(size)]
    variants = partial(apportioned, problem, joint=joint) if is_thorough and not problem.pair else lambda point: [point]
    begun = [
        (values, point)
        for values in every
        for point in variants(extend(problem, base.point, Hypothesis(effect, joint), values))
    ]
    starts = [Start(Hypothesis(effect, joint), values, 0.0, len(begun)) for values, _ in begun]
    points = [point for _, point in begun]
    cost = price(problem, starts[0], base.samples)
    count, before = max(2, min(AT_ONCE, MEMORY // base.error.size)), problem.squares(base.error)
    close: list[tuple[float, Start, Point]] = []
    every_one: list[tuple[float, Start, Point]] = []
    for first_one in range(0, len(points), count):
        part = slice(first_one, first_one + count)
        outcomes = list(zip(starts[part], points[part], errors(problem, points[part]), strict=True))
        squares = [problem.squares(error) for _, _, error in outcomes]
        nearer = [item for item, square in zip(outcomes, squares, strict=True) if square < before]
        close += each(lambda item: (unfitted(problem, base, *item[1:]).criterion, *item[:2]), nearer)
        every_one += [(square, *item[:2]) for item, square in zip(outcomes, squares, strict=True)]
    better = [item for item in close if item[0] + cost < base.criterion]
    chosen = better or (every_one if is_sought else [])
    return [item[1:] for item in sorted(chosen, key=lambda item: item[0])[:MET]]


def apportioned(problem: Problem, point: Point, joint: int) -> list[Point]:
    """A model with a play with shares of its damping behind it, its laws of friction there or not, and with its inertia
    or less."""
    free = {f.name for f in point.free}
    points = [point]
    if f"arm_viscous@{joint}" not in free:
        points = [on_arms_side(point, [joint], share, share) if share else point for share in BEHIND]
    if rubs(problem, point, joint) and f"arm_friction@{joint}" not in free:
        points += [rubbing_behind(split, [joint], 1.0) for split in points]
    found = []
    for split, share in product(points, LIGHTER):
        parameters = split.parameters.copy()
        parameters[:, joint, INERTIA] *= share
        found.append(replace(split, parameters=parameters))
    return found


def unfitted(problem: Problem, base: Fitted, point: Point, error: Array) -> Fitted:
    """A model as it is, with its errors and their innovations behind a filter of its own; its sensitivities are those
    of the base."""
    innovation = whitener(problem, error)(error)
    return replace(base, point=point, error=error, innovation=innovation, credible=problem.credible(error))


def score(problem: Problem, base: Fitted, start: Start, fitted: Fitted) -> Scored:
    """A fitted hypothesis beside the base that it was put on."""
    return Scored(start, fitted, base.criterion - fitted.criterion, price(problem, start, base.samples))


def worth_fitting(problem: Problem, starts: Sequence[Start], samples: int, needed: float, least: int) -> list[Start]:
    """The starts whose promise comes near their price and the best promise; at least so many, if they are `needed`."""
    top = max((start.promise for start in starts), default=0.0)
    costs = [price(problem, start, samples) for start in starts]
    return [
        start
        for rank, (start, cost) in enumerate(zip(starts, costs, strict=True))
        if start.promise - cost >= needed and (rank < least or start.promise >= max(NEARLY * cost, FAR * top))
    ]


Ordered = TypeVar("Ordered")


def first(items: Iterable[Ordered], count: int, place: Callable[[Ordered], Hashable]) -> list[Ordered]:
    """The items of the first so many places."""
    items = list(items)
    kept = list(dict.fromkeys(map(place, items)))[:count]
    return [item for item in items if place(item) in kept]


def law(start: Start) -> tuple[str, int]:
    """The standard name of an effect, whichever form it has, and its joint."""
    return start.hypothesis.effect.label, start.hypothesis.joint


def simplest(starts: Sequence[Start]) -> list[Start]:
    """The starts without general forms of laws whose textbook form promises nearly as much.

    They can take its place when it is in the model (`generalised`).
    """

    def is_superfluous(start: Start) -> bool:
        effect = start.hypothesis.effect
        return bool(effect.neutral) and any(
            other.promise >= FORM * start.promise
            for other in starts
            if other.hypothesis.joint == start.hypothesis.joint
            and other.hypothesis.effect.label == effect.label
            and other.hypothesis.effect.name in effect.includes
        )

    return [start for start in starts if not is_superfluous(start)]


def hidden(filtered: Sequence[Start], bare: Sequence[Start]) -> list[Start]:
    """The starts that promise more in the errors as they are: the filter may have taken them for noise."""
    place = lambda start: (start.hypothesis.effect.name, start.hypothesis.joint)  # noqa: E731
    promised: dict[tuple[str, int], float] = {}
    for start in filtered:
        promised[place(start)] = max(start.promise, promised.get(place(start), 0.0))
    return simplest([start for start in bare if start.promise > promised.get(place(start), 0.0)])


def _converged(
    problem: Problem,
    base: Fitted,
    rough: Sequence[Scored],
    promised: Mapping[tuple[str, int], Start],
    finals: int,
    known: Array,
    look: Glance | None,
) -> list[Scored]:
    """The hypotheses in order of their evidence, the first ones fitted until they have converged.

    promised: by effect and joint the start that promises most in the filtered view; a first fit that stopped short of
    its promise is carried on, and begun again from there where that does not help (`begun_again`). So is one that ended
    worse than the base, as a fit to a part of the samples may: it says nothing of the hypothesis.
    known: sensitivities (K, T, n) of the base. look: a part of the samples that is enough to tell whether a hypothesis
    comes near the best one, if any; only those that do are fitted to all samples.
    """
    starts = lambda s: promised.get((s.name, s.start.hypothesis.joint), s.start)  # noqa: E731
    hoped = lambda s: max(s.decrease, HOPE * starts(s).promise)  # noqa: E731
    likeliest: dict[tuple[str, int], Scored] = {}
    for scored in sorted(rough, key=lambda s: -s.evidence):
        likeliest.setdefault((scored.name, scored.start.hypothesis.joint), scored)

    def continued(scored: Scored) -> Scored:
        hypothesis = scored.start.hypothesis
        if look is not None and scored.decrease < close:
            point = seen_in_part(problem, base, hypothesis, scored.fitted, look)
            if point is not None:
                part = fit(look.problem, point, rounds=2, iterations=4, tolerance=1e-4)
                other = scored.refitted(base, on_all_samples(problem, base, hypothesis, part, known))
                scored = max(scored, other, key=lambda s: s.decrease)
                if scored.decrease < close:
                    return scored
        fitted = fit(problem, scored.fitted.point, scored.fitted.whitener, rounds=2, iterations=4)
        return scored.refitted(base, fitted)

    order = first(sorted(likeliest.values(), key=lambda s: s.price - hoped(s)), finals + 1, lambda s: law(s.start))
    leading = {law(s.start): s for s in reversed(order)}  # of the forms that the logs can show, if there are any
    leading |= {law(s.start): s for s in reversed(order) if is_resolved(problem, s)}
    share = lambda s: OTHER_FORM if s.name in leading[law(s.start)].effect.excludes else FORM  # noqa: E731
    order = [s for s in order if hoped(s) - s.price >= share(s) * (hoped(leading[law(s.start)]) - s.price)]
    order = [s for s in order if not is_idle(s, order)]
    least, close = (share * max((s.decrease for s in order), default=0.0) for share in (CHANCE, CLOSE))
    final = each(continued, [s for s in order if hoped(s) >= least])
    short = CLOSE * max((s.decrease for s in final), default=0.0)
    lost = [s for s in final if starts(s).promise > (max(s.decrease, short) if s.decrease >= 0.0 else least)]
    final += each(lambda s: begun_again(problem, base, starts(s)), lost)
    top = max((scored.decrease for scored in final), default=0.0)
    best_form = best_forms(final).values()
    near = [scored.decrease > NEAR * top and any(scored is s for s in best_form) for scored in final]
    if sum(near) > 1:  # laws that are near equals are told apart only when all of them have converged
        final = each(
            lambda item: polish(problem, base, item[0], 6) if item[1] else item[0], zip(final, near, strict=True)
        )
    final += each(lambda s: unstuck(problem, base, s), stuck(problem, final))
    final = [on_the_motors_side(problem, base, scored) for scored in final]
    best: dict[tuple[str, int], Scored] = {}
    for scored in sorted([*final, *rough], key=lambda s: -s.evidence):
        best.setdefault((scored.name, scored.start.hypothesis.joint), scored)
    return list(best.values())


def on_the_motors_side(problem: Problem, base: Fitted, scored: Scored) -> Scored:
    """A law of friction that was begun behind a spring or a play, as one of the motor's side where it has ended there:
    it has a parameter less."""
    hypothesis, point = scored.start.hypothesis, scored.fitted.point
    if not hypothesis.behind or point.value(f"arm_friction@{hypothesis.joint}") > NONE_BEHIND:
        return scored
    before = taken_back(point, "arm_friction", [hypothesis.joint])
    fitted = fit(problem, before, scored.fitted.whitener, rounds=1, iterations=4)
    other = score(problem, base, replace(scored.start, hypothesis=replace(hypothesis, behind=False)), fitted)
    return max(scored, other, key=lambda s: s.evidence)


def best_forms(scored: Iterable[Scored]) -> dict[tuple[str, int], Scored]:
    """Of every law and joint the form with the most evidence."""
    return {law(s.start): s for s in sorted(scored, key=lambda s: s.evidence)}


def is_idle(scored: Scored, others: Sequence[Scored]) -> bool:
    """Whether a general form of a law explains no more than a form that it contains, whose place it may still take
    (`generalised`)."""
    inner = (s for s in others if law(s.start) == law(scored.start) and s.name in scored.effect.includes)
    return any(s.evidence >= scored.evidence for s in inner)


def stuck(problem: Problem, final: Sequence[Scored]) -> list[Scored]:
    """The best hypotheses, one form of each law, if even with the first of them the errors are far more than
    innovations.

    The filter may then have kept all of them where they began, taking for noise what they have yet to explain.
    """
    best = sorted(best_forms(final).values(), key=lambda s: -s.evidence)[:RETRIED]
    if not best:
        return []
    error, innovation = best[0].fitted.error[problem.used], np.sqrt(best[0].fitted.variances)
    return best if np.any(np.sqrt(np.mean(error**2, axis=0)) > COLOURED * innovation) else []


def unstuck(problem: Problem, base: Fitted, scored: Scored) -> Scored:
    """The hypothesis fitted to the errors as they are, and then to their innovations."""
    return scored.refitted(base, free_of_filter(problem, scored.fitted.point))


def begun_again(problem: Problem, base: Fitted, start: Start) -> Scored:
    """A hypothesis fitted from where a regression saw most of it, to the errors as they are, all sensitivities anew.

    The regression says what is reached to first order. Fits that end short of that have lost their way: first steps are
    taken by the sensitivities of the base, which are not those of a joint with most of its inertia behind a spring.
    Beside a wave or an event it is also fitted to the innovations from there: a part of the samples, or the errors as
    they are, may show nothing of what only the innovations of all samples tell, such as how long the wave is.
    """
    point = extend(problem, base.point, start.hypothesis, start.values)
    present = compress(problem.kernel.effects, np.any(base.point.switches, axis=0).tolist())
    is_beside_scanned = any(effect.scan for effect in present)
    return score(problem, base, start, (either_way if is_beside_scanned else free_of_filter)(problem, point))


def off_limits(problem: Problem, fitted: Fitted, hypothesis: Hypothesis) -> Fitted:
    """A fit that ended with parameters of the effect at their limits, begun again from within.

    There it stops because it can go no further, not at an optimum: with nearly all of the inertia behind a spring, or
    nearly none of it behind one that the encoder sees through, it hardly matters how much. Half of an upper limit is
    taken; from little inertia behind a spring half of it, with the frequency ``f / sqrt(1 - r)`` at which motor and
    load ring.
    """
    vector, point = fitted.point.vector.copy(), fitted.point
    name, joint = hypothesis.effect.name, hypothesis.joint
    for i, f in enumerate(point.free):
        if f.joint == joint and f.name.startswith(f"{name}.") and vector[i] >= f.upper:
            vector[i] *= 0.5
    free = {f.name: i for i, f in enumerate(point.free)}
    share, frequency = (free.get(f"{name}.{what}@{joint}") for what in ("inertia_ratio", "frequency"))
    if share is not None and frequency is not None and 0.0 < vector[share] <= point.free[share].lower:
        vector[frequency] *= np.sqrt(0.5 / (1.0 - vector[share]))
        vector[share] = 0.5
    if np.array_equal(vector, point.vector):
        return fitted
    return min(fitted, either_way(problem, point.at(vector)), key=lambda option: option.criterion)


def with_limiting_effects(problem: Problem, base: Fitted, ranked: Sequence[Scored]) -> list[Scored]:
    """The hypotheses, best first, with what the best of them stand for that the logs cannot show: the effect that one
    contains, begun with what both describe, where it has not done as well by itself."""
    every = {effect.name: effect for effect in problem.kernel.effects}
    best = {(s.name, s.start.hypothesis.joint): s for s in ranked}
    top = max((s.decrease for s in ranked), default=0.0)
    for scored in (s for s in ranked if s.decrease > NEAR * top):
        inner = next((every[name] for name in scored.effect.includes if every[name].resolved is None), None)
        if inner is None or is_resolved(problem, scored):
            continue
        joint = scored.start.hypothesis.joint
        alone = best.get((inner.name, joint))
        if alone is not None and alone.decrease >= NEAR * scored.decrease:
            continue
        limit = simpler(problem, base, scored, inner)
        if alone is None or limit.decrease > alone.decrease:
            best[inner.name, joint] = limit
    return sorted(best.values(), key=lambda s: -s.evidence)


def simpler(problem: Problem, base: Fitted, whole: Scored, inner: Effect) -> Scored:
    """An effect that another one contains, fitted in its place from what both describe; base: a model with neither."""
    start = Start(Hypothesis(inner, whole.start.hypothesis.joint), np.zeros((problem.logs, inner.size)), 0.0)
    return score(problem, base, start, fit(problem, within(problem, whole, start)))


def within(problem: Problem, whole: Scored, start: Start) -> Point:
    """A model with a simpler effect in place of one that contains it, which lends it parameters of the same name."""
    point, joint, lender = whole.fitted.point, whole.start.hypothesis.joint, whole.effect
    values = start.values.copy()
    for i, parameter in enumerate(start.hypothesis.effect.parameters):
        if parameter.name in {p.name for p in lender.parameters}:
            values[:, i] = point.parameters[:, joint, problem.kernel.column(lender, parameter.name)]
    return extend(problem, withdraw(problem, point, lender.name, joint), start.hypothesis, values)


def exchanged(problem: Problem, point: Point, start: Start) -> list[Point]:
    """The hypothesis with the value of the nominal parameter that has stood in for it, which falls back to its own.

    Lags in series can trade places: the fit then ends in the wrong one of several optima. The third lag is the
    mechanical one, inertia over damping; where the effect takes its value, the winding's lag stands for it. Only a
    stated inertia can say which is which.
    """
    effect, j = start.hypothesis.effect, start.hypothesis.joint
    free = {f.name: f for f in point.free}
    stand_in = free.get(f"{effect.exchanges}@{j}")
    if stand_in is None:
        return []
    found, lag = [], point.value(stand_in.name)
    inertia, damping = point.parameters[0, j, INERTIA], point.parameters[0, j, VISCOUS : BACK_EMF + 1].sum()
    places = [(lag, inertia)]
    if np.isfinite(free[f"inertia@{j}"].deviation):
        places.append((inertia / max(damping, 1e-300), lag * damping))
    for value, behind in places:
        values = start.values.copy()
        values[:, 0] = value
        other = extend(problem, point, start.hypothesis, values)
        other.parameters[:, j, INERTIA] = behind
        other.parameters[:, j, stand_in.column] = stand_in.centre if np.isfinite(stand_in.deviation) else 0.1 * lag
        found.append(other)
    return found


def contained(problem: Problem, point: Point, effect: Effect, joint: int) -> list[Effect]:
    """The form of the same law in the model whose place an effect would take: two of them side by side are a third."""
    on = problem.kernel.switches
    forms = (e for e in problem.kernel.effects if e.name in effect.includes and e.label == effect.label)
    return [form for form in forms if point.switches[joint, on[form.name]]][:1]


def described(problem: Problem, point: Point, effects: Sequence[Effect], joint: int) -> dict[str, Array]:
    """What effects in the model say of a joint, by name of the parameter, one value (logs,) each; amplitudes of one
    name, as levels of friction, add up."""
    known: dict[str, Array] = {}
    for effect in effects:
        for i, q in enumerate(effect.parameters):
            own = point.parameters[:, joint, problem.kernel.column(effect, q.name)]
            known[q.name] = own + known.get(q.name, 0.0) if i in effect.amplitudes else own
    return known


def generalised(
    problem: Problem, view: View, effect: Effect, parts: Sequence[Effect], joint: int, size: Scales
) -> tuple[Start, list[Point]]:
    """The more general form of a law in place of parts of it that are in the model, which lend it what they describe.

    What other laws than its own lend may be wrong, and is done without as well. Its further parameters are those that
    leave least of the errors, to first order in all parameters; a second point, where there is one, has those with
    which both forms are the same.
    """
    base, without = view.fitted, view.fitted.point
    apart = next((own for inner in parts if (own := apart_in(without, inner, joint))), ())
    hypothesis = Hypothesis(effect, joint, apart=apart)
    for inner in parts:
        without = withdraw(problem, without, inner.name, joint)
    shapes = [tuple(v) for v in effect.starts(size)] if effect.starts else []
    values: list[Array] = []
    has_same = False
    same_law = [inner for inner in parts if inner.label == effect.label]
    for lenders in (parts,) if same_law == list(parts) else (parts, same_law):
        known = described(problem, base.point, lenders, joint)
        lent = [i for i, parameter in enumerate(effect.parameters) if parameter.name in known]
        has_same = len(lent) + len(effect.neutral) == effect.size
        for shape in [*shapes, (0.0,) * len(lent) + effect.neutral] if has_same else shapes:
            values.append(np.tile(np.array(shape, float), (problem.logs, 1)))
            for i in lent:
                values[-1][:, i] = known[effect.parameters[i].name]
    points = [extend(problem, without, hypothesis, own) for own in values]
    outcomes = errors(problem, points)
    rests = view.residual + view.sensitivities(outcomes - base.error)
    nothing = rests[:0]
    costs = np.array([np.sum(view.least(nothing, rest)[2] ** 2) for rest in rests])
    best = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
    point = points[best]
    first = next(i for i, f in enumerate(point.free) if f.name.startswith(f"{effect.name}."))
    own_rows = view.sensitivities(sensitivities(problem, point, outcomes[best], first=first))
    kept = view.promise(problem, view.least(nothing, view.residual)[2])
    _, change, left = view.least(own_rows, rests[best])
    after = point.vector.copy()
    after[first:] += change
    reached = point.within(after)
    visible = resolved(effect, reached.parameters[0, joint, problem.kernel.own(effect)], size)
    promise = view.promise(problem, left) - kept if visible else -np.inf
    same = points[-1:] if has_same and best != len(points) - 1 else []
    return Start(hypothesis, values[best], promise, len(shapes)), [point, *same]


def containing(problem: Problem, base: Fitted, points: Sequence[Point]) -> Fitted:
    """The best fit, from several points, of a form that contains the one in the model.

    It cannot do worse than that. Where it seems to, the filter takes slow errors for noise, and it is fitted to the
    errors as they are, and with the filter of the other form.
    """
    best = min((fit(problem, p, rounds=1, iterations=6) for p in points), key=lambda fitted: fitted.criterion)
    if best.criterion <= base.criterion:
        return best
    others = free_of_filter(problem, points[-1]), fit(problem, points[-1], base.whitener)
    return min(best, *others, key=lambda fitted: fitted.criterion)


def resolved(effect: Effect, values: Array, size: Scales) -> bool:
    """Whether logs of these scales can show what an effect's parameters (size,) describe."""
    return effect.resolved is None or effect.resolved(values.tolist(), size)


def is_resolved(problem: Problem, scored: Scored) -> bool:
    """Whether the logs can show what the effect's parameters describe."""
    if scored.effect.resolved is None:
        return True
    joint = scored.start.hypothesis.joint
    values = scored.fitted.point.parameters[0, joint, problem.kernel.own(scored.effect)]
    return resolved(scored.effect, values, sizes_of(problem, scored.fitted)[joint])


def polish(problem: Problem, base: Fitted, scored: Scored, iterations: int = 12) -> Scored:
    """The same hypothesis fitted until it has converged.

    Where small causes grow there are many optima, fewer of them for the errors as they are.
    """
    hypothesis = scored.start.hypothesis
    fitted = retimed(problem, scored.fitted, hypothesis)
    fitted = fit(problem, fitted.point, rounds=2, iterations=iterations)
    if any(scatters(problem, fitted.point, j) for j in range(problem.joints)):
        fitted = min(fitted, free_of_filter(problem, fitted.point), key=lambda option: option.criterion)
    fitted = retuned(problem, off_limits(problem, fitted, hypothesis), hypothesis)
    fitted = across(problem, fitted, hypothesis)
    if fitted.criterion > scored.fitted.criterion:
        return scored
    return scored.refitted(base, fitted)


def _with_reference(problem: Problem, base: Fitted) -> Fitted:
    """The same fit with the mean square motor torque filled in, by which thermal effects are normalised."""
    point: Point = base.point
    parameters: Array = point.parameters.copy()
    for j, size in sizes_of(problem, base).items():
        parameters[:, j, NOMINAL.index("torque_square_mean")] = max(size.torque_rms**2, 1e-300)
    return replace(base, point=replace(point, parameters=parameters))


def hypotheses_of(
    effects: Sequence[Effect], joints: int, present: set[tuple[str, int]], arm: Collection[str] = ()
) -> list[tuple[Effect, int]]:
    """Effects not yet in the model, per joint; one that has to follow another only after that or a form of its own law
    that it contains. arm: what acts between the joints of a planar pair, as in `Effect.on_the_arm`."""
    forms = {effect.name: effect.label for effect in effects}

    def has_its_turn(effect: Effect, j: int) -> bool:
        own = (name for name in effect.includes if forms.get(name) == effect.label)
        return not effect.after or any((name, j) in present for name in (*effect.after, *own))

    return [
        (effect, j)
        for j in range(joints)
        for effect in effects
        if (effect.name, j) not in present
        and has_its_turn(effect, j)
        and (not effect.on_the_arm or (effect.on_the_arm in arm and j == 1))
    ]
