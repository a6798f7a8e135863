"""Forward selection with backward pruning over the vocabulary, and the verdict that follows from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from threadpoolctl import threadpool_limits

from diagnosis.arm_damping import arm_damping_open, arm_damping_settled
from diagnosis.beginning import beginnings_settled
from diagnosis.choice import (
    FORK,
    LAG,
    STEADY,
    choose,
    coincides,
    comes_much_closer,
    firm_ground_first,
    is_steady,
    is_too_small,
    much_closer,
    nearly_as_good,
    stays_itself,
)
from diagnosis.command_levels import with_levels_counted
from diagnosis.competition import (
    beside,
    confirmed,
    disguised,
    in_another_form,
    in_other_terms,
    other_forms,
    other_laws,
    simpler_rivals,
)
from diagnosis.estimation import Fitted, errors, fit, measured_precisely, scatters, sticks
from diagnosis.finding import Accepted, Finding, cost, distinct, near_equals, stood_for
from diagnosis.following import following_settled
from diagnosis.hopping import Optimum, hopped, with_laws
from diagnosis.hypotheses import Hypothesis, Start, extend, sizes_of
from diagnosis.imitation import alike, imitating, in_place, together
from diagnosis.jitter import Jitter, jitter
from diagnosis.lags import told_apart
from diagnosis.nominal import JointStructure, damping_settled, fit_nominal, limits_settled, windings_settled
from diagnosis.of_motion import is_of_motion
from diagnosis.other_bases import (
    DRY,
    also_by_own_steps,
    also_from_regression,
    also_without_limits,
    either,
    on_either_joint,
    settled_anew,
    two_at_once,
)
from diagnosis.patchwork import Patchwork, of_position, patchwork
from diagnosis.problem import Problem, Work, coarser, in_band
from diagnosis.pruning import (
    deviance,
    elsewhere,
    general,
    left_out,
    merged,
    merged_afterwards,
    one_dry_friction,
    prune,
    significant,
    simplified,
    simplified_afterwards,
    trim,
    unified,
    without,
)
from diagnosis.recurrence import recurrences_settled
from diagnosis.remainder import Remainder, lucky, remainders
from diagnosis.search import (
    Ranked,
    Scored,
    hypotheses_of,
    is_resolved,
    plays,
    polish,
    price,
    ranking,
    score,
    simpler,
    stuck,
    try_all,
    unfitted,
    with_limiting_effects,
)
from diagnosis.settings import LENGTH, SHORTEST, Settings
from diagnosis.shooting import best_of, shot
from diagnosis.timing import timing_settled
from diagnosis.turns import either_way, free_of_filter, in_turns
from diagnosis.undecided import left_undecided
from diagnosis.verdict import allowance, unexplained, verdict
from methods.effects.base import Effect
from methods.kernel import acts_on_either_side
from methods.parallel import each

JITTER = "timestamp_jitter"
"""The effect that shows in the scatter of the readings only."""
FORKS = 2
"""Other ways that are tried."""
SLIGHT = 3
"""Slight effects that are tried in the place of others."""
MANY = 3
"""Torques of the position beside which no further one is sought if they are pieces of another one."""
REFINED = 0.25
"""Budgets of simulations that laws may be exchanged for where no more is left than noise and inexact laws leave."""
WHOLE = 0.1
"""Share of all that is left that a general form has to promise to be tried as what explains all of it."""
END = 1.5
"""Budgets of simulations after which a search seeks no further effects."""
LATEST = 2.5
"""The same after which it begins no play in the place of a spring that stiffens."""
FORESEEN = 50.0
"""Rms of the nominal errors over that of their innovations from which the band of the motion is searched first."""
SPRUNG = 5.0
"""The same from which a play is begun from everywhere where a spring has been found."""


def find(
    problem: Problem,
    structures: tuple[JointStructure, ...],
    effects: Sequence[Effect],
    settings: Settings | None = None,
    tell: Callable[[str], None] = lambda text: None,
    held_out: Problem | None = None,
) -> Finding:
    """Name what the nominal model misses. held_out: data that are not fitted, on which weak effects have to show.

    The whole band of the encoder decides: there an exact model leaves nothing but noise. Where it hardly tells models
    apart (`is_foreseen`), its search begins from what the band shows in which the joint moved, and begins anew where
    the model that came of that is no better there. Where something is left (`unknown`), the effects are sought again in
    that band, and those that shape the motion there are reported, unless those of the whole band do better there, too;
    the verdict stays. Only where the search in the whole band, begun again from them, leaves nothing, they are what was
    missing. Torques of the rest of an arm come from smoothed motion and are right in its band only: where that shows
    nothing and neither search has found an effect, there is none.
    """
    settings = settings or Settings()
    with threadpool_limits(1, "blas"):  # the kernels run in parallel; matrix products of this size do not gain from it
        return _find(problem, structures, effects, settings, tell, held_out)


def _find(
    problem: Problem,
    structures: tuple[JointStructure, ...],
    effects: Sequence[Effect],
    settings: Settings,
    tell: Callable[[str], None],
    held_out: Problem | None,
) -> Finding:
    search = Search.begin(problem, structures, effects, settings, tell)
    banded = longer = None
    if is_foreseen(problem, search.nominal):
        banded = in_motion(replace(problem, work=Work()), structures, effects, settings, tell, is_enough=search.tells)
        longer = continued(search, banded, search.nominal.criterion, held_out)
    settled = None if longer is None or longer.verdict == "unknown" else longer
    if settled is not None and not is_foreseen(problem, settled.final):
        return quiet(problem, settled, effects, settings, held_out)
    if longer is not None and (search.is_over or is_in_vain(longer)):
        whole = longer
    else:
        whole = search.concluded(search.completed(search.grown(search.start)), held_out)
    if settled is not None:  # its errors are as slow as those of the nominal model were: noise, or another law
        likelier = cost(problem, settled.final, settled.accepted) - settings.threshold
        if cost(problem, whole.final, whole.accepted) >= likelier:
            return quiet(problem, settled, effects, settings, held_out)
        longer = None
    if whole.verdict in ("none", "named"):
        return quiet(problem, whole, effects, settings, held_out)
    dearest = cost(problem, whole.final, whole.accepted) - settings.threshold
    if whole.verdict == "unknown" and longer is not None and cost(problem, longer.final, longer.accepted) < dearest:
        whole = longer
    depends = sum(r.excess for r in whole.remainders) > 0.0
    if whole.verdict != "unknown" or not depends:
        return whole
    if banded is None:
        banded = in_motion(problem, structures, effects, settings, tell)
        if not search.is_spent:
            longer = continued(search, banded, dearest, held_out)
            if longer is not None and longer.verdict != "unknown":
                return quiet(problem, longer, effects, settings, held_out)
    if banded is None:
        return whole
    narrow, found = banded.search.problem, banded.concluded
    band = 0.4 / (narrow.decimation * narrow.sample_time)
    is_slight = all(item.material < settings.relevant for item in whole.accepted)
    if problem.arm is not None and is_slight and found.verdict == "none":
        return replace(found, band=band)
    is_cut = whole.is_cut or (search.is_spent and bool(found.accepted))
    if whole.accepted and does_better(narrow, held_out, whole, found, settings.threshold):
        return replace(whole, is_cut=is_cut)
    return replace(found, verdict="unknown", remainders=whole.remainders, band=band, is_cut=is_cut)


def is_in_vain(finding: Finding) -> bool:
    """Whether a search has ended in so many pieces of one torque of the position that another one would, too."""
    return bool(crowded(finding.accepted, lambda: finding.patched))


def is_foreseen(problem: Problem, nominal: Fitted, times: float = FORESEEN) -> bool:
    """Whether each reading follows from those before it whatever the model: the errors of the nominal one are far more,
    so many times as much, than their innovations.

    The whole band then hardly tells models apart, and fits there may stop anywhere.
    """
    error = np.mean(nominal.error[problem.used] ** 2, axis=0)
    return bool(np.any(error > times**2 * (nominal.variances + nominal.floor)))


@dataclass(frozen=True, eq=False)
class Banded:
    """A search in the band in which the joint moved, and where it ended."""

    search: Search
    path: Path

    @cached_property
    def concluded(self) -> Finding:
        """What it says by itself."""
        return self.search.concluded(self.path)


def in_motion(
    problem: Problem,
    structures: tuple[JointStructure, ...],
    effects: Sequence[Effect],
    settings: Settings,
    tell: Callable[[str], None],
    *,
    is_enough: Callable[[Fitted], bool] | None = None,
) -> Banded | None:
    """What the band in which the joint moved shows by itself, and the problem there; None where it is no narrower or
    too short.

    is_enough: whether the whole band, which is still to be searched, takes over from a model. Nothing more is sought
    here then, nor where noise alone is left. Where more is, other laws are tried: here that is cheap, and the whole
    band begins from what is found.
    """
    narrow = in_band(problem)
    if narrow.decimation == 1 or narrow.used.sum() // narrow.decimation < 60:
        return None
    tell("in the band of the motion")
    budget = settings.budget if is_enough is None else settings.budget // 2
    inner = Search.begin(narrow, structures, effects, replace(settings, limit=settings.banded, budget=budget), tell)
    path = inner.grown(inner.start, is_enough=is_enough)
    if is_enough is None:
        return Banded(inner, inner.needed(path))
    if path.accepted and is_enough(path.base):
        return Banded(inner, path)
    shorter = inner.needed(path)
    doubts = inner.doubts(shorter, inner.pieces(shorter))
    return Banded(inner, inner.needed(inner.exchanged(path)) if doubts else shorter)


def continued(search: Search, banded: Banded | None, most: float, held_out: Problem | None) -> Finding | None:
    """What the search in the whole band concludes when it goes on from what the band of the motion has shown; None
    where nothing was shown, or it ends with what costs more than `most` there."""
    path = None if banded is None else carried_over(search, banded.path, most)
    if path is None:
        return None
    search.tell("again in the whole band")
    path = search.grown(path)
    if search.cost(path) >= most:
        return None
    path = search.exchanged(search.with_play(path))
    accepted = (
        item if item.scored.evidence > search.settings.threshold else scored_anew(search.problem, path.base, item)
        for item in path.accepted
    )
    return search.concluded(replace(path, accepted=tuple(accepted)), held_out)


def quiet(
    problem: Problem, finding: Finding, effects: Sequence[Effect], settings: Settings, held_out: Problem | None
) -> Finding:
    """The finding, with a jitter if there is one; only where nothing else is left.

    Noise that grows with the velocity lets any function explain a little."""
    still = sum(r.excess for r in finding.remainders) <= allowance(finding.nominal, finding.final)
    return with_jitter(problem, finding, effects, settings, held_out) if still else finding


def carried_over(search: Search, banded: Path, most: float) -> Path | None:
    """What was found in the band of the motion, fitted in the whole band; None where that neither costs less than
    `most` nor brings the errors as they are far below those of the nominal model: where these drown a wave, and the
    others are left with it, the former are the likelier ones until the wave is found, which no filter may foresee.

    Where no single hypothesis brings errors in the whole band down to noise, a fit there may stop at any distance of
    what the band of the motion shows at once. When commands act shows in the whole band only.
    """
    problem = search.problem
    if not banded.accepted:
        return None
    base = in_turns(problem, free_of_filter(problem, banded.base.point))
    base = timing_settled(problem, windings_settled(problem, base))
    is_dearer = cost(problem, base, banded.accepted) >= most
    if is_dearer and not comes_much_closer(problem, base, free_of_filter(problem, search.nominal.point)):
        return None
    accepted = tuple(scored_anew(problem, base, item) for item in banded.accepted)
    present = frozenset(place for item in accepted for place in stood_for(item))
    equals = frozenset(near for item in banded.accepted for near in near_equals(item))
    return Path(base, accepted, present, (search.nominal, base), equals=equals)


def scored_anew(problem: Problem, base: Fitted, item: Accepted) -> Accepted:
    """An effect of the base and its rivals, fitted in another band, with their fits and scores in this one."""
    smaller = without(problem, base, item)
    fits = each(lambda rival: free_of_filter(problem, rival.fitted.point), item.rivals)
    rivals = tuple(rival.refitted(smaller, fitted) for rival, fitted in zip(item.rivals, fits, strict=True))
    return replace(item, scored=item.scored.refitted(smaller, base), rivals=rivals)


def does_better(narrow: Problem, held_out: Problem | None, whole: Finding, banded: Finding, threshold: float) -> bool:
    """Whether what the whole band has found does better in the band of the motion, too: on the fitted logs, where it
    may have more effects, and by the evidence that an effect needs on those that nobody fitted."""
    fitted = in_turns(narrow, fit(narrow, whole.final.point))
    better = cost(narrow, fitted, whole.accepted) < cost(narrow, banded.final, banded.accepted)
    if not better or held_out is None:
        return better
    apart = coarser(held_out, narrow.decimation * narrow.thinning)
    return deviance(apart, fitted) < deviance(apart, banded.final) - threshold


@dataclass(frozen=True, eq=False)
class Fork:
    """A step at which the search could have gone another way: the path up to there, the effect that was taken, by its
    name and joint, and another one that came much closer or explained nearly as much."""

    earlier: Path
    taken: tuple[str, int]
    other: Accepted


@dataclass(frozen=True, eq=False)
class Path:
    """A way through the search: the effects accepted so far, the model with them, and where it could have gone instead.

    forks: the other ways at every step, best first. slight: what has evidence beside all the others, but was refused,
    best first. equals: effects with their joints and the laws that explained nearly as much when they were taken.
    unsteady: the evidence for disturbances that were refused because not all logs have them. optima: where fits stopped
    in rough ground when a play was found (`diagnosis.hopping`). is_cut: whether the budget left other ways from here
    untried, or further effects. is_played: whether a play has been begun from everywhere in the place of its spring.
    """

    base: Fitted
    accepted: tuple[Accepted, ...]
    present: frozenset[tuple[str, int]]
    steps: tuple[Fitted, ...]
    left: tuple[Remainder, ...] = ()
    refused: tuple[Ranked, ...] = ()
    slight: tuple[Scored, ...] = ()
    unsteady: float = 0.0
    forks: tuple[Fork, ...] = ()
    equals: frozenset[tuple[str, int, str]] = frozenset()
    optima: tuple[Optimum, ...] = ()
    is_cut: bool = False
    is_played: bool = False

    @property
    def excess(self) -> float:
        """What noise does not account for in all remainders."""
        return sum(r.excess for r in self.left)

    @property
    def scattered(self) -> float:
        """What noise alone would let an effect explain, where small causes grow in the model."""
        return lucky(self.left)


Way = Callable[[Path, Accepted], Path | None]
"""From a path and one of its effects to another path that does better, if there is one."""


def has_play(path: Path) -> bool:
    """Whether small causes grow in the motion of a path's model."""
    return any(item.effect.scatters for item in path.accepted)


def has_spring(path: Path) -> bool:
    """Whether an arm hangs on a spring in a path's model, for which a play may have been taken."""
    return any(item.effect.parts_the_arm and not item.effect.scatters for item in path.accepted)


def stiffens(path: Path) -> bool:
    """Whether an arm hangs on a spring that is soft about its rest only, as one in a play seems to be."""
    return any("stiffening" in {parameter.name for parameter in item.effect.parameters} for item in path.accepted)


def bends(item: Accepted) -> bool:
    """Whether it is dry friction of bristles, which cannot be behind a play."""
    return item.effect.is_dry and not acts_on_either_side(item.effect)


def crowded(accepted: Sequence[Accepted], pieces: Callable[[], Mapping[int, Patchwork]]) -> set[int]:
    """The joints (by index) where `MANY` torques of the position are there, but as pieces of another one; pieces: what
    the effects of joints are pieces of, asked only where so many are."""
    places = [item.joint for item in accepted if of_position(item.effect)]
    many = {j for j in places if places.count(j) >= MANY}
    return {j for j, law in pieces().items() if j in many and law is Patchwork.POSITION} if many else set()


def of_one_law(one: Accepted, other: Accepted) -> bool:
    """Whether two effects are forms of one law on one joint."""
    return (one.label, one.joint) == (other.label, other.joint)


def laws_of_one_signal(item: Accepted, candidates: Sequence[tuple[Effect, int]]) -> list[Effect]:
    """The textbook's forms among the candidates of other laws that follow the signal of an effect of the joint."""
    return [
        effect
        for effect, joint in candidates
        if joint == item.joint and effect.variable == item.effect.variable and effect.label != item.label
        if effect.name == effect.label and effect.scan is None and not effect.scatters
        if item.name not in effect.includes
    ]


def shortened(path: Path, others: tuple[Accepted, ...], base: Fitted) -> Path:
    """The path with some of its effects only; base: the model with these."""
    present = frozenset(place for other in others for place in stood_for(other))
    return replace(path, base=base, accepted=others, present=present, left=(), slight=())


@dataclass(frozen=True, eq=False)
class Search:
    """What stays the same all along a search."""

    problem: Problem
    structures: tuple[JointStructure, ...]
    effects: Sequence[Effect]
    settings: Settings
    nominal: Fitted
    tell: Callable[[str], None]

    @classmethod
    def begin(
        cls,
        problem: Problem,
        structures: tuple[JointStructure, ...],
        effects: Sequence[Effect],
        settings: Settings,
        tell: Callable[[str], None],
    ) -> Search:
        """A search in the problem's band, with its nominal model."""
        return cls(problem, structures, effects, settings, fit_nominal(problem, structures), tell)

    def tells(self, fitted: Fitted) -> bool:
        """Whether this band tells models apart from one of another band on."""
        outcome = errors(self.problem, [fitted.point])[0]
        return not is_foreseen(self.problem, unfitted(self.problem, self.nominal, fitted.point, outcome))

    @property
    def start(self) -> Path:
        """The nominal model alone."""
        return Path(self.nominal, (), frozenset(), (self.nominal,))

    def grown(self, path: Path, *, is_enough: Callable[[Fitted], bool] | None = None) -> Path:
        """The path continued as far as effects are found; at their limit, as far as one takes the place of another, or
        one more explains a good part of all.

        is_enough: whether another search takes over from a model; only that far, and as far as something is left.
        """
        problem, settings = self.problem, self.settings
        while True:
            if path.accepted:
                path = replace(path, left=remainders(problem, path.base))
            candidates = self.candidates(path, is_full=self.is_full(path))
            if not candidates:
                break
            explained = self.nominal.criterion - path.base.criterion
            needed = -np.inf
            if path.accepted:
                is_quiet = path.excess == 0.0 and not self.incomplete(path)
                if is_enough is not None and (is_quiet or is_enough(path.base)):
                    break
                complete = path.excess <= allowance(self.nominal, path.base) and not self.incomplete(path)
                needed = max(settings.threshold, settings.minor * explained) * (1.0 if complete else 0.3)
                needed = max(needed, path.scattered)
            repaired = None
            if not self.is_over:
                repaired = self.reformed(path) or self.renamed(path) or self.repaired(path, candidates, explained)
            if repaired is not None:
                path = repaired
                continue
            if path.accepted and self.is_over:
                path = replace(path, is_cut=path.excess > 0.0)
                break
            self.tell(f"looking for effect {len(path.accepted) + 1}")
            hopeless = partial(is_too_small, path.accepted, settings, explained)
            ranked = try_all(problem, path.base, candidates, needed=needed, is_hopeless=hopeless)
            if not path.accepted and stuck(problem, ranked):
                ranked = also_without_limits(problem, path.base, candidates, ranked)
                ranked = also_by_own_steps(problem, path.base, candidates, ranked)
            if not path.accepted:
                ranked = also_from_regression(problem, self.structures, path.base, candidates, ranked)
                both = self.with_two(path, candidates, ranked)
                if both is not None:
                    path = both
                    continue
            if ranked and ranked[0].effect.scatters and not has_play(path):
                ranked = either(ranked, plays(problem, path.base, candidates))
            elif ranked and self.may_be_a_play(path, ranked[0]):
                path, ranked = replace(path, is_played=True), self.or_a_play(path, candidates, ranked)
            elif not has_play(path):
                ranked = self.led_by_pieces(path, ranked)
            ranked = [scored for scored in ranked if not coincides(problem, scored, path.accepted)]
            ranked = settled_anew(problem, self.structures, path.base, ranked)
            ranked = on_either_joint(problem, path.base, ranked)
            ranked = with_limiting_effects(problem, path.base, ranked)
            chosen = choose(problem, path.base, ranked, settings, explained, path.accepted, least=path.scattered)
            if chosen is None:
                unsteady = max((s.evidence for s in ranked if not is_steady(problem, s)), default=0.0)
                real = [
                    s for s in ranked if s.evidence < settings.threshold or is_of_motion(problem, s.fitted, path.base)
                ]
                slight = tuple(s for s in ranked if s.evidence > settings.threshold and not s.effect.scatters)
                path = replace(path, refused=ranking(real), slight=slight[:SLIGHT], unsteady=unsteady)
                break
            before = replace(path, forks=())
            chosen, nearer = firm_ground_first(chosen, much_closer(problem, chosen, ranked, settings))
            taken = chosen.label, chosen.joint
            closer = tuple(Fork(before, taken, other) for other in nearer)
            others = tuple(Fork(before, taken, other) for other in nearly_as_good(chosen, ranked))
            longer = self.advanced(replace(path, forks=closer + path.forks + others), chosen)
            gained = path.base.criterion - longer.base.criterion
            if self.beyond(longer) > 0 and gained < settings.inexact * explained:
                break
            path = longer
        return path if path.left else replace(path, left=remainders(problem, path.base))

    def with_two(self, path: Path, candidates: Sequence[tuple[Effect, int]], ranked: Sequence[Scored]) -> Path | None:
        """The path with dry friction and a torque of the place at once, where these come much closer than any single
        hypothesis, which leaves errors that are far more than innovations; None otherwise."""
        problem = self.problem
        if not stuck(problem, ranked) or ranked[0].effect.scatters:
            return None
        found = two_at_once(problem, self.structures, path.base, candidates)
        if not found or not all(comes_much_closer(problem, found[0][-1], s.fitted) for s in ranked):
            return None
        self.tell("two effects at once")
        dry, place, both = found[0]
        alone = without(problem, both, Accepted(score(problem, path.base, place, both), 0.0, ()))
        first = Accepted(score(problem, path.base, dry, alone), 0.0, ())
        rivals = (score(problem, alone, other, fitted) for _, other, fitted in found[1:])
        second = score(problem, alone, place, both)
        near = tuple(rival for rival in rivals if rival.evidence > second.evidence - self.settings.rival)
        begun = Path(alone, (first,), stood_for(first), (*path.steps, alone))
        longer = self.advanced(begun, Accepted(second, 0.0, near, ranking([second, *near])))
        least = min(s.fitted.criterion + s.price for s in ranked) - self.settings.threshold
        if len(longer.accepted) < 2 or self.cost(longer) >= least:
            return None
        beside = each(partial(scored_anew, problem, longer.base), longer.accepted)  # neither is anything by itself
        return replace(longer, accepted=tuple(beside))

    def may_be_a_play(self, path: Path, best: Scored) -> bool:
        """Whether the best hypothesis is a spring of a joint with dry friction, which holds an arm in its play: of a
        play that imitates most, and its own starting values seldom come close."""
        joint = best.start.hypothesis.joint
        is_spring = best.effect.parts_the_arm and not best.effect.scatters
        return is_spring and not has_play(path) and sticks(self.problem, path.base.point, joint)

    def or_a_play(self, path: Path, candidates: Sequence[tuple[Effect, int]], ranked: list[Scored]) -> list[Scored]:
        """The hypotheses, with plays of the joint of the best one, a spring, begun from everywhere."""
        self.tell("a play in the place of a spring, begun from everywhere")
        joint = ranked[0].start.hypothesis.joint
        begun = plays(self.problem, path.base, [(effect, j) for effect, j in candidates if j == joint])
        return self.led_by_pieces(path, either(ranked, begun))

    def led_by_pieces(self, path: Path, ranked: list[Scored]) -> list[Scored]:
        """The hypotheses, with those in whose motion small causes grow fitted by multiple shooting, where they are
        nearly the best and that one leaves something: fitted to whole logs they may have stopped far from where they
        fit."""
        close = [s for s in ranked if s.effect.scatters and s.evidence > FORK * ranked[0].evidence]
        if not close or all(left.excess == 0.0 for left in remainders(self.problem, ranked[0].fitted)):
            return ranked
        self.tell(f"{close[0].label} by multiple shooting")
        fits = each(lambda s: best_of(shot(self.problem, s.fitted)), close)
        return either(ranked, [s.refitted(path.base, fitted) for s, fitted in zip(close, fits, strict=True)])

    def reformed(self, path: Path) -> Path | None:
        """The path with another form of the law of an earlier effect in its place, where that does better beside those
        that came later; None otherwise, or where nothing is left."""
        if path.excess == 0.0:
            return None
        problem, accepted = self.problem, path.accepted
        options = [(item, form) for item in accepted[:-1] for form in other_forms(item, accepted, self.effects)]
        if not options:
            return None
        self.tell("other forms of the laws that are there")
        smaller = {item: without(problem, path.base, item) for item, _ in options}
        found = each(lambda option: in_another_form(problem, path.base, smaller[option[0]], *option), options)
        fits = [(item, scored) for (item, _), scored in zip(options, found, strict=True) if scored is not None]
        if not fits:
            return None
        item, best = min(fits, key=lambda option: option[1].fitted.criterion + option[1].price - option[0].scored.price)
        others = tuple(other for other in accepted if other is not item)
        chosen = replace(item, scored=best)
        if cost(problem, best.fitted, (*others, chosen)) >= self.cost(path) - self.settings.threshold:
            return None
        longer = self.advanced(shortened(path, others, smaller[item]), chosen)
        return longer if self.cost(longer) < self.cost(path) - self.settings.threshold else None

    def renamed(self, path: Path) -> Path | None:
        """The path with another law of the same signal in the place of an earlier effect, where that does better beside
        those that came later; None otherwise.

        Which law of a signal it is may show only once others are there: beside large friction a weight is as good as a
        spring, and waves over the position then make up for what that lacks.
        """
        problem, accepted = self.problem, path.accepted
        candidates = self.candidates(path, is_full=False)
        options = [(item, effect) for item in accepted[:-1] for effect in laws_of_one_signal(item, candidates)]
        starts = each(lambda option: alike(problem, path.base, option[0].effect, option[1], option[0].joint), options)
        begun = [(item, start) for (item, _), start in zip(options, starts, strict=True) if start is not None]
        if not begun:
            return None
        self.tell("other laws of the same signals")
        points = [in_place(problem, path.base, item.effect, start) for item, start in begun]
        fits = each(partial(either_way, problem), points)
        others = [tuple(other for other in accepted if other is not item) for item, _ in begun]
        costs = [
            cost(problem, fitted, rest) + price(problem, start, fitted.samples)
            for fitted, rest, (_, start) in zip(fits, others, begun, strict=True)
        ]
        first = int(np.argmin(costs))
        if costs[first] >= self.cost(path) - self.settings.threshold:
            return None
        (item, start), rest = begun[first], others[first]
        smaller = without(problem, path.base, item)
        scored = score(problem, smaller, start, fits[first])
        explained = self.nominal.criterion - smaller.criterion
        chosen = choose(problem, smaller, [scored], self.settings, explained, rest)
        if chosen is None:
            return None
        longer = self.advanced(shortened(path, rest, smaller), replace(chosen, considered=item.considered))
        return longer if self.cost(longer) < self.cost(path) - self.settings.threshold else None

    def repaired(self, path: Path, candidates: Sequence[tuple[Effect, int]], explained: float) -> Path | None:
        """The path with a general form of a law that is there in its place, where that leaves nothing; None otherwise.

        No other effect could do more, and all are sought beside it next. A parameter that does not stay the same over
        the logs asks for one as well, where nothing else is left.
        """
        if path.excess == 0.0 and not (path.left and self.incomplete(path)):
            return None
        there = {(item.label, item.joint) for item in path.accepted}
        forms = [(effect, j) for effect, j in candidates if (effect.label, j) in there and effect.neutral]
        if not forms:
            return None
        self.tell("general forms of the laws that are there")
        needed = max(self.settings.threshold, WHOLE * path.excess)
        ranked = try_all(self.problem, path.base, forms, needed=needed)
        chosen = choose(self.problem, path.base, ranked, self.settings, explained, path.accepted, least=path.scattered)
        if chosen is None or any(left.excess > 0.0 for left in remainders(self.problem, chosen.scored.fitted)):
            return None
        longer = self.advanced(path, chosen)
        is_new = chosen.name in {item.name for item in longer.accepted if item.joint == chosen.joint}
        return longer if is_new else None

    def beyond(self, path: Path) -> int:
        """Number of effects beyond the limit."""
        return distinct(path.accepted) - self.settings.limit * self.problem.joints

    def is_full(self, path: Path) -> bool:
        """Whether no further effects are taken: at the limit where nothing is left, and one beyond it."""
        return self.beyond(path) > 0 or (self.beyond(path) == 0 and path.excess == 0.0)

    def candidates(self, path: Path, *, is_full: bool) -> list[tuple[Effect, int]]:
        """The effects that may come next: all others, or those that contain one that is there.

        Where small causes grow and nothing is left but what noise may do there, not those whose frequency or instant is
        searched for: among many fits that end elsewhere by chance, some end better. Where `MANY` torques of the
        position are pieces of another one, not one more.
        """
        arm: tuple[str, ...] = ()
        if self.problem.pair:
            arm = ("coupling", "weight") if self.structures[0].gravity == "pendulum" else ("coupling",)
        others = hypotheses_of(self.effects, self.problem.joints, set(path.present), arm)
        there = {(item.name, item.joint) for item in path.accepted}
        contains = lambda effect, j: any((name, j) in there for name in effect.includes)  # noqa: E731
        joints = range(self.problem.joints)
        rough = {j for j in joints if path.left and path.excess == 0.0 and scatters(self.problem, path.base.point, j)}
        crowded = self.crowded(path)
        return [
            (effect, j)
            for effect, j in others
            if contains(effect, j)
            or not (is_full or (j in rough and effect.scan is not None) or (j in crowded and of_position(effect)))
        ]

    def crowded(self, path: Path) -> set[int]:
        """The joints (by index) whose torques of the position are many pieces of another one."""
        return crowded(path.accepted, lambda: self.pieces(path))

    def advanced(self, path: Path, chosen: Accepted) -> Path:
        """The path with one more effect, in its simplest form, and without those that it makes superfluous."""
        problem, settings, accepted = self.problem, self.settings, list(path.accepted)
        equals = path.equals | near_equals(chosen)
        scored = polish(problem, path.base, chosen.scored)
        fitted, optima = in_turns(problem, scored.fitted), path.optima
        if chosen.effect.scatters:  # an effect found beside it changes little of where the optimum is
            fitted, optima = hopped(problem, arm_damping_settled(problem, fitted))
        chosen = replace(chosen, scored=scored.refitted(path.base, fitted))
        unseen = frozenset() if is_resolved(problem, chosen.scored) else stood_for(chosen)
        chosen = simplified(problem, path.base, chosen, self.effects, settings)
        accepted, chosen = merged(problem, accepted, chosen, settings)
        accepted.append(chosen)
        base = limits_settled(problem, chosen.scored.fitted, self.structures)
        base = arm_damping_settled(problem, beginnings_settled(problem, base))
        base = damping_settled(problem, timing_settled(problem, windings_settled(problem, base)))
        accepted, base = recurrences_settled(problem, accepted, following_settled(problem, base))
        steps = (*path.steps, base)
        accepted, base = prune(problem, accepted, base, settings)
        accepted, base = simplified_afterwards(problem, accepted, base, self.effects, settings)
        fewer, base = merged_afterwards(problem, accepted, base, settings)
        if len(fewer) < len(accepted):  # what two forms of a law were for may be there in the simplest one
            fewer, base = simplified_afterwards(problem, fewer, base, self.effects, settings, is_last_simple=False)
        accepted, base = unified(problem, fewer, base, self.effects, settings)
        present = path.present.union(unseen, stood_for(chosen), *map(stood_for, accepted))
        plays = {effect.name for effect in self.effects if effect.scatters}
        own = partial(with_laws, laws=plays, wanted=plays.intersection(item.name for item in accepted))
        return replace(
            path,
            base=base,
            accepted=tuple(accepted),
            present=present,
            steps=steps,
            left=(),
            slight=(),
            equals=equals,
            optima=own(optima) or own(path.optima),
        )

    def exchanged(self, path: Path, most: float | None = None) -> Path:
        """The path with other laws in the place of its effects, where these do better beside all others, and continued
        from there.

        What stands beside an effect now may have been missing when it was taken, and a near equal have come second only
        for that. Where something is left, any law may have been what the effect stands in for, but where many torques
        of the position are pieces of one that no law is. However long the search has taken, each effect is left out
        once: what is named has to be needed.

        most: budgets after which laws are no longer exchanged where what is left may be noise, `REFINED` from here on
        unless given.
        """
        most = self.taken + REFINED if most is None else most
        cheap: list[Way] = [self.with_second, self.in_other_terms, self.recast, self.with_nothing, self.with_plainer]
        dear: list[Way] = [partial(self.with_another_law, any_law=any_law) for any_law in (False, True)]
        for way in cheap if self.crowded(path) else cheap + dear:
            for item in path.accepted:
                is_late = self.is_over if way in cheap else not self.asks(path) or self.taken > self.enough(path, most)
                if is_late and way != self.with_nothing:
                    break
                other = way(path, item)
                if other is not None:
                    return self.exchanged(other, most)
        return path

    def enough(self, path: Path, most: float) -> float:
        """Budgets after which no other laws are tried: one where more is left than noise and inexact laws leave."""
        return 1.0 if self.incomplete(path) else min(most, 1.0)

    def with_nothing(self, path: Path, item: Accepted) -> Path | None:
        """The path without an effect, the others fitted as far as they go; None if that costs more.

        What was taken first may have stood in for all that came later, and hold these where they began.
        """
        others = tuple(other for other in path.accepted if other is not item)
        if not others:
            return None
        best = either_way(self.problem, left_out(self.problem, path.base.point, item))
        shorter = shortened(path, others, best)
        if self.cost(shorter) >= self.cost(path):
            return None
        longer = self.grown(shorter)
        return longer if self.cost(longer) < self.cost(path) else None

    def with_plainer(self, path: Path, item: Accepted) -> Path | None:
        """The path with a plainer effect in the place of one that contains it, and another law in its general form;
        None if that costs more, or the plainer one by itself does less than half of what the effect does.

        An effect with more to adjust may have made up for what the textbook's form of another one lacks: Stribeck
        friction for a drag that grows with less than the square of the velocity.
        """
        problem = self.problem
        others = tuple(other for other in path.accepted if other is not item)
        plain = [
            effect for effect in self.effects if effect.name in item.effect.includes and effect.label != item.label
        ]
        general = {(inner, form.label) for form in self.effects if form.neutral for inner in form.includes}
        if not plain or not general & {(other.name, other.label) for other in others}:
            return None
        self.tell(f"a plainer law in the place of {item.label}")
        smaller = without(problem, path.base, item)
        whole = replace(item.scored, fitted=path.base)
        fits = each(lambda effect: simpler(problem, smaller, whole, effect), plain)
        best = max(fits, key=lambda scored: scored.evidence)
        if best.decrease < FORK * (smaller.criterion - path.base.criterion):
            return None
        chosen = replace(item, scored=best)
        plainer = self.advanced(shortened(path, others, smaller), chosen)
        plainer = replace(plainer, left=remainders(problem, plainer.base))
        explained = self.nominal.criterion - plainer.base.criterion
        longer = self.repaired(plainer, self.candidates(plainer, is_full=False), explained)
        if longer is None or self.cost(longer) >= self.cost(path):
            return None
        return replace(longer, left=remainders(problem, longer.base))

    def in_other_terms(self, path: Path, item: Accepted) -> Path | None:
        """The path with a general form of another law of the same signal in the place of one; None if that does no
        better.

        The textbook's forms of both have competed, of which the other law's may have come closer to what is neither.
        """
        if not item.effect.neutral:
            return None
        problem, others = self.problem, tuple(other for other in path.accepted if other is not item)
        self.tell(f"another law in the place of {item.label}")
        options = in_other_terms(problem, path.base, replace(item, rivals=()), self.effects, self.settings).rivals
        excluded = {place for other in others for place in stood_for(other)}
        options = tuple(scored for scored in options if (scored.name, item.joint) not in excluded)
        if not options:
            return None
        smaller = without(problem, path.base, item)
        explained = self.nominal.criterion - smaller.criterion
        best = choose(problem, smaller, list(options), self.settings, explained, others)
        return None if best is None else self.instead(path, others, smaller, best, self.settings.threshold)

    def recast(self, path: Path, item: Accepted) -> Path | None:
        """The path with another torque of the position in the place of one, where several only describe one smooth
        torque; None if none does better.

        Over a small angle gravity alone has taken in the most of a spring, which to first order then pulls the wrong
        way, and a wave is left for the rest. So what is there moves along.
        """
        problem, joint = self.problem, item.joint
        others = tuple(other for other in path.accepted if other is not item)
        own = [other.effect for other in others if other.joint == joint and of_position(other.effect)]
        if not (own and of_position(item.effect)):
            return None
        rivals = [
            effect
            for effect, j in self.candidates(shortened(path, others, path.base), is_full=False)
            if j == joint and of_position(effect) and effect.scan is None and effect.name == effect.label != item.label
        ]
        if not rivals or self.pieces(path).get(joint) is not Patchwork.POSITION:
            return None
        self.tell(f"another law in the place of {item.label}")
        smaller = without(problem, path.base, item)
        fits = each(lambda rival: together(problem, path.base, smaller, item.effect, rival, joint, own), rivals)
        explained = self.nominal.criterion - smaller.criterion
        options = [scored for scored in fits if scored is not None]
        best = choose(problem, smaller, options, self.settings, explained, others) if options else None
        return None if best is None else self.instead(path, others, smaller, best, self.settings.threshold)

    def with_second(self, path: Path, item: Accepted) -> Path | None:
        """The path with what came second in the place of what was taken then, as it was fitted then but beside all the
        others, or with what is slight beside them, or with a lag for a spring; None if none does better.

        Another form of the second's law that came later goes, too: it made up for what the first one lacks.
        """
        rest = tuple(other for other in path.accepted if other is not item)
        seconds = [
            fork.other
            for fork in (path.forks if rest else ())
            if fork.taken == (item.label, item.joint) and fork.other.label != item.label
            if (fork.other.name, fork.other.joint) not in {(other.name, other.joint) for other in rest}
        ]
        excluded = {place for other in rest for place in stood_for(other)}
        seconds += [
            Accepted(scored, 0.0, ())
            for scored in path.slight
            if scored.start.hypothesis.joint == item.joint and scored.effect.size <= item.effect.size
            if scored.label != item.label and (scored.name, item.joint) not in excluded
        ]
        seconds += self.late(path, item, rest)
        options = [(second, tuple(other for other in rest if not of_one_law(other, second))) for second in seconds]
        if not options:
            return None
        self.tell(f"what came second to {item.label}")
        fits = each(lambda option: beside(self.problem, path.base, option[0].scored, option[1]), options)
        margins = [self.settings.threshold if len(others) == len(rest) else 0.0 for _, others in options]
        costs = [
            cost(self.problem, fitted, (*others, second)) + margin
            for fitted, margin, (second, others) in zip(fits, margins, options, strict=True)
        ]
        first = int(np.argmin(costs))
        if costs[first] >= self.cost(path):
            return None
        fitted, (best, others) = fits[first], options[first]
        smaller = self.reduced(path, others).base
        explained = self.nominal.criterion - smaller.criterion
        scored = best.scored.refitted(smaller, fitted)
        chosen = choose(self.problem, smaller, [scored], self.settings, explained, others)
        if chosen is None:
            return None
        chosen = replace(chosen, considered=best.considered)
        return self.instead(path, others, smaller, chosen, margins[first])

    def late(self, path: Path, item: Accepted, others: tuple[Accepted, ...]) -> list[Accepted]:
        """The lags of the command, not fitted yet, in the place of a spring: one that hardly bends may stand for such a
        lag, and leave nothing of it to explain."""
        problem, base, joint = self.problem, path.base, item.joint
        if item.effect.scatters or not item.effect.parts_the_arm:
            return []
        candidates = self.candidates(shortened(path, others, base), is_full=False)
        size, found = sizes_of(problem, base)[joint], []
        for effect, j in candidates:
            if j == joint and effect.exchanges and effect.starts is not None:
                values = np.tile(np.array(next(iter(effect.starts(size))), float), (problem.logs, 1))
                start = Start(Hypothesis(effect, j), values, 0.0)
                point = in_place(problem, base, item.effect, start)
                begun = unfitted(problem, base, point, errors(problem, [point])[0])
                found.append(Accepted(score(problem, base, start, begun), 0.0, ()))
        return found

    def with_another_law(self, path: Path, item: Accepted, *, any_law: bool) -> Path | None:
        """The path with another law in the place of an effect: any, or one of its near equals; None if none does
        better."""
        problem, settings = self.problem, self.settings
        others = tuple(other for other in path.accepted if other is not item)
        near = {name for label, joint, name in path.equals if (label, joint) == (item.label, item.joint)}
        near -= {other.label for other in others if other.joint == item.joint}
        rivals = [
            (effect, joint)
            for effect, joint in self.candidates(shortened(path, others, path.base), is_full=False)
            if joint == item.joint and (effect.label in near or (any_law and effect.name != item.name))
        ]
        if not rivals:
            return None
        self.tell(f"another law in the place of {item.label}")
        smaller = without(problem, path.base, item)
        needed, explained = smaller.criterion - path.base.criterion, self.nominal.criterion - smaller.criterion
        alike = each(lambda rival: imitating(problem, path.base, smaller, item.effect, *rival), rivals)
        ranked = try_all(problem, smaller, rivals, needed=needed)
        ranked = either(ranked, [scored for scored in alike if scored is not None])
        if any_law:
            ranked = either(ranked, plays(problem, smaller, rivals, is_sought=False))
        best = choose(problem, smaller, ranked, settings, explained, others)
        if best is None or best.scored.decrease < FORK * needed:
            return None
        return self.instead(path, others, smaller, best, settings.threshold)

    def instead(
        self, path: Path, others: tuple[Accepted, ...], smaller: Fitted, best: Accepted, margin: float
    ) -> Path | None:
        """The path with another effect beside those that stay, and continued; None if it does no better by a margin.
        smaller: the model of those that stay."""
        longer = self.grown(self.advanced(shortened(path, others, smaller), best))
        return longer if self.cost(longer) < self.cost(path) - margin else None

    def asks(self, path: Path) -> bool:
        """Whether what is left beside the effects is worth another look at them."""
        return path.excess > 0.0 and (len(path.accepted) > 1 or self.incomplete(path))

    def completed(self, path: Path) -> Path:
        """The path with other laws in place of its own and, where something is left, other ways that lead further.

        Greedy selection can start from a stand-in: an offset and dry friction first look like asymmetric friction.
        """
        path = self.with_play(path)
        is_cut = path.is_cut or (self.asks(path) and self.is_spent)
        path = self.exchanged(path)
        for fork in path.forks[:FORKS]:
            if not self.incomplete(path):
                break
            if self.is_spent:
                is_cut = True
                break
            self.tell(f"once more with {fork.other.label}")
            second = self.grown(self.advanced(fork.earlier, fork.other))
            if self.cost(second) < self.cost(path) - self.settings.threshold:
                path = second
        return replace(path, is_cut=is_cut)

    def with_play(self, path: Path) -> Path:
        """The path, or the one that begins with a play, where something is left that this explains, or where it is
        taken for slow noise or for a spring that stiffens.

        Few of its starting values come close to the motion, and what other laws imitate of it is found first. It is
        begun beside all but a spring, which may stand for it, also with dry friction for bristles, beside the friction
        of the path alone, since friction holds an arm in its play, which drifts without, and by itself.
        """
        best, rubbing = path, tuple(item for item in path.accepted if acts_on_either_side(item.effect))
        rigid = tuple(item for item in path.accepted if not item.effect.parts_the_arm)
        beside = dict.fromkeys((rigid, rubbing, ()))
        turns = [(kept, False) for kept in beside if not has_play(path)]
        turns += [(kept, True) for kept in beside if any(map(bends, kept))]
        most = LATEST if stiffens(path) else END
        if not turns or self.taken > most:
            return path
        is_left = path.excess > allowance(self.nominal, path.base)
        times = SPRUNG if is_left or (has_spring(path) and not path.is_played) else FORESEEN
        is_doubtful = self.incomplete(path) or stiffens(path) or is_foreseen(self.problem, path.base, times)
        if not is_doubtful or self.crowded(path):
            return path
        self.tell("a play, begun from everywhere")
        for kept, is_dry in turns:
            if self.taken > most or (best is not path and not self.incomplete(best)):
                break
            begun = self.reduced(path, kept) if kept else self.start
            begun = self.without_bristles(begun) if is_dry else begun
            ranked = plays(self.problem, begun.base, self.candidates(begun, is_full=False))
            ranked = self.led_by_pieces(begun, ranked)
            explained = self.nominal.criterion - begun.base.criterion
            chosen = choose(self.problem, begun.base, ranked, self.settings, explained, begun.accepted)
            if chosen is not None:
                other = self.grown(self.advanced(begun, chosen))
                best = other if self.cost(other) < self.cost(best) - self.settings.threshold else best
        return best

    def without_bristles(self, path: Path) -> Path:
        """The path with Coulomb friction in the place of bristles, which are on the motor's side: what rubs behind a
        play seems to yield as the play does."""
        problem = self.problem
        dry = next((effect for effect in self.effects if effect.name == DRY), None)
        for item in path.accepted:
            if dry is None or not bends(item):
                continue
            others = tuple(other for other in path.accepted if other is not item)
            level = path.base.point.parameters[:, item.joint, problem.kernel.column(item.effect, "torque")]
            start = Start(Hypothesis(dry, item.joint), level[:, None], 0.0)
            smaller = without(problem, path.base, item)
            fitted = either_way(problem, in_place(problem, path.base, item.effect, start))
            scored = score(problem, smaller, start, fitted)
            path = shortened(path, (*others, Accepted(scored, item.material, ())), fitted)
        return path

    def reduced(self, path: Path, kept: tuple[Accepted, ...]) -> Path:
        """The path with some of its effects only, refitted without the others."""
        base = path.base
        for item in path.accepted:
            base = base if item in kept else without(self.problem, base, item)
        return shortened(path, kept, base)

    def needed(self, path: Path) -> Path:
        """The path without the effects that are not needed."""
        problem, nominal, settings = self.problem, self.nominal, self.settings
        accepted, base = one_dry_friction(problem, nominal, list(path.accepted), path.base, settings)
        left = path.left if base is path.base else remainders(problem, base)
        accepted, base, left = trim(problem, nominal, accepted, base, left, settings)
        before = base
        accepted, base = significant(problem, accepted, base, settings)
        left = left if base is before else remainders(problem, base)
        return replace(path, accepted=tuple(accepted), base=base, left=left)

    def pieces(self, path: Path) -> dict[int, Patchwork]:
        """The joints (by index) whose effects only describe another law."""
        return patchwork(self.problem, path.base, path.accepted, self.settings.rival)

    def doubts(self, path: Path, pieces: Mapping[int, Patchwork]) -> bool:
        """Whether something is left that no effect of the path explains, or they are not what they seem. pieces: of the
        path (`pieces`)."""
        problem, settings, base = self.problem, self.settings, path.base
        if verdict(problem, self.nominal, base, path.accepted, path.left, settings) == "unknown" or pieces:
            return True
        if not all(stays_itself(problem, replace(item.scored, fitted=base)) for item in path.accepted):
            return True
        refused = max((r.decrease - r.price for r in path.refused), default=0.0)
        explained = self.nominal.criterion - base.criterion
        is_refused = bool(path.accepted) and refused > settings.patched * explained
        return is_refused or path.unsteady > max(settings.threshold, settings.inexact * explained)

    def concluded(self, path: Path, held_out: Problem | None = None) -> Finding:
        """What stands at the end of a path: effects that are not needed are taken back, and the verdict is given."""
        problem, nominal, settings = self.problem, self.nominal, self.settings
        path = self.needed(path)
        accepted, base, left = list(path.accepted), path.base, path.left
        if held_out is not None:
            shown, base = general(problem, held_out, nominal, accepted, base, settings)
            if len(shown) < len(accepted):  # what was found beside the others may be nothing without them
                accepted, base = prune(problem, shown, base, settings, sure=np.inf)
        lag = next((item for item in accepted if item.label == LAG), None)
        base, traded = (base, ()) if lag is None else told_apart(problem, base, lag.effect, lag.joint)
        if base is not path.base:
            left = remainders(problem, base)
        accepted = [
            confirmed(problem, base, simpler_rivals(item, left), [*accepted[:i], *accepted[i + 1 :]], settings)
            for i, item in enumerate(accepted)
        ]
        accepted = [disguised(problem, base, item, accepted, self.effects, settings) for item in accepted]
        accepted = [other_laws(in_other_terms(problem, base, item, self.effects, settings)) for item in accepted]
        said = verdict(problem, nominal, base, accepted, left, settings)
        path = replace(path, accepted=tuple(accepted), base=base, left=left)
        pieces = self.pieces(path)
        if self.doubts(path, pieces):
            said = "unknown"
        if said != "unknown":
            accepted, base = left_undecided(problem, arm_damping_open(problem, base), accepted, self.effects)
        return Finding(
            said,
            nominal,
            tuple(accepted),
            with_levels_counted(problem, measured_precisely(problem, base)) if accepted else base,
            left,
            path.steps,
            refused=path.refused,
            patched=pieces,
            optima=path.optima,
            traded=traded,
            is_cut=said == "unknown" and path.is_cut,
        )

    @property
    def taken(self) -> float:
        """Simulations so far over the budget; two joints that move together take twice as long for one, and long logs
        longer."""
        length = len(self.problem.time)
        simulations = self.problem.joints * self.problem.work.steps / length
        return simulations / max(self.settings.budget, 1) * max(length / LENGTH, SHORTEST)

    @property
    def is_spent(self) -> bool:
        """Whether the search has taken its budget of simulations."""
        return self.taken > 1.0

    @property
    def is_over(self) -> bool:
        """Whether it has taken so many budgets that it only concludes."""
        return self.taken > END

    def incomplete(self, path: Path) -> bool:
        """Whether something is left that neither noise nor inexact laws account for."""
        explained = self.nominal.criterion - path.base.criterion
        return unexplained(self.problem, explained, path.left, self.settings)

    def cost(self, path: Path) -> float:
        """-2 log likelihood and the price of all effects."""
        return cost(self.problem, path.base, path.accepted)


def with_jitter(
    problem: Problem,
    finding: Finding,
    effects: Sequence[Effect],
    settings: Settings,
    held_out: Problem | None = None,
) -> Finding:
    """The finding with a jitter of the sampling instants where the scatter or the stamps show one.

    Where small causes grow, the errors are larger in motion, too, whatever the instants. A weak one has to show in the
    held-out logs as well: the steps of an encoder do not scatter quite as noise does.
    """
    effect = next((effect for effect in effects if effect.name == JITTER), None)
    if effect is None:
        return finding
    cost, dt = float(np.log(finding.final.samples)), problem.sample_time
    for j in range(problem.joints):
        found = None if scatters(problem, finding.final.point, j) else jitter(problem, finding.final, j)
        if found is not None and found.decrease < cost + settings.weak and held_out is not None:
            shown = jitter(held_out, elsewhere(held_out, finding.final), j)
            found = None if shown is None or shown.rms < STEADY * found.rms else found
        if problem.stamps is not None:
            found = Jitter(problem.stamps.error, problem.stamps.error / np.sqrt(2.0 * cost), problem.stamps.decrease)
        if found is None or found.decrease < cost + settings.threshold or found.rms < settings.jitter * dt:
            continue
        hypothesis, values = Hypothesis(effect, j), np.full((problem.logs, 1), found.rms)
        fitted = finding.final
        size = len(fitted.point.free)
        spread = np.zeros((size + 1, size + 1))
        spread[:size, :size], spread[size, size] = fitted.covariance, found.deviation**2
        jacobian = np.vstack([fitted.jacobian, np.zeros_like(fitted.jacobian[:1])])
        point = extend(problem, fitted.point, hypothesis, values)
        fitted = replace(fitted.informed(jacobian, spread), point=point)
        scored = Scored(Start(hypothesis, values, found.decrease), fitted, found.decrease, cost)
        finding = replace(
            finding,
            verdict="named",
            accepted=(*finding.accepted, Accepted(scored, 0.0, ())),
            final=fitted,
            steps=(*finding.steps, fitted),
        )
    return finding
