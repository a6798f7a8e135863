"""Forward selection with backward pruning over the vocabulary, and the verdict that follows from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from diagnosis.arm_damping import arm_damping_settled, undivided
from diagnosis.beginning import started, twists_settled
from diagnosis.estimation import Fitted, Point, covariance, errors, fit, plain, scatters
from diagnosis.following import following_settled
from diagnosis.hopping import Optimum, distances, hopped
from diagnosis.hypotheses import PER_LOG, Hypothesis, Start, command_response, extend, proposals, sizes_of, withdraw
from diagnosis.jitter import Jitter, jitter
from diagnosis.lags import told_apart
from diagnosis.nominal import (
    HOPELESS,
    JointStructure,
    fit_nominal,
    limits_settled,
    point_at,
    windings_settled,
    without_limits,
)
from diagnosis.patchwork import Patchwork, patchwork
from diagnosis.problem import Problem, Work, in_band
from diagnosis.regression import View
from diagnosis.remainder import Remainder, remainder
from diagnosis.search import (
    FORM,
    Ranked,
    Scored,
    best_forms,
    containing,
    generalised,
    hypotheses_of,
    is_resolved,
    law,
    polish,
    price,
    ranking,
    score,
    stuck,
    try_all,
    unfitted,
    with_limiting_effects,
    within,
)
from diagnosis.timing import SHIFT, timing_settled
from diagnosis.turns import free_of_filter, in_turns, to_errors, to_innovations
from diagnosis.whitening import on_logs
from envs.log import Array
from methods.effects.base import Effect
from methods.parallel import each

DRY = "coulomb_friction"
"""The effect that the regression of the starting point knows."""
DRAG = 0.02
"""Its torque as a share of the command's rms, from which it is tried as it was regressed."""
HELD = 0.5
"""The same for torques of the place."""
LAG = "amplifier_lag"
"""The effect that may trade places with the joint's own lags."""
JITTER = "timestamp_jitter"
"""The effect that shows in the scatter of the readings only."""
Verdict = Literal["none", "named", "ambiguous", "unknown"]
FORK = 0.5
"""Share of the chosen effect's evidence from which another one may have been the better choice."""
FORKS = 2
"""Other ways that are tried."""
EQUAL = 0.9
"""Share of an effect's evidence from which another law is tried in its place once all effects are there."""
LUCKY = 0.5
"""Share of what noise lets all functions of the remainder explain that it may let one effect explain."""
CLOSER = 0.3
"""Errors as they are, over those that the chosen effect leaves, from which another one may have been the better choice,
whatever its evidence: the filter may have taken what it explains for slow noise."""
TAKEN_BACK = 0.5
"""Share of a lag by which the command may act earlier than it is logged."""
AT_END = 0.99
"""Share of the largest possible size from which an effect is at the end of its range."""
SIMULTANEOUS = 0.2
"""Time [s] between two events that are taken for one."""
TIMED = 0.75
"""Share of the best evidence from which the best form of a law is compared with a timing of its own."""
LIMITED = 0.25
"""The same for torque limits that act or do not."""
END = 2.0
"""Budgets of simulations after which a search seeks no further effects."""
LENGTH = 60_000
"""Samples of all logs with which one simulation counts as one of the budget."""
SHORTEST = 0.5
"""What one of short logs counts."""
DRIVEN_BY = {"position": "place", "motor torque": "motor", "command": "motor"}
"""By the signals that effects follow, groups whose laws are too unlike for one to stand in for another."""
UNDERSTATED = 4.0
"""By what factor a fit may exceed what a regression says of an effect."""
FORESEEN = 100.0
"""Rms of the nominal errors over that of their innovations from which the band of the motion is searched first."""
STEADY = 0.5
"""Amplitude of a disturbance in one log as a share of that in another, below which it is not one and the same."""
CLEARED = 0.1
"""What may stay unexplained, as a share of what a small effect explains, for it to be more than a repair of a law."""
WORST: tuple[Verdict, ...] = ("unknown", "ambiguous", "named", "none")
"""Verdicts of several joints: the first that any of them has is that of all."""


@dataclass(frozen=True)
class Settings:
    """Decision rules. Evidence is -2 log likelihood gained less the price of parameters and searched shapes.

    threshold: least evidence of an effect. weak: evidence below which an effect also has to do something for data that
    nobody fitted. material: least effect of its torque, as a share of the command's rms, beside others. faint: the same
    of the first one, beside which no inexact law of another one can need repair.
    rival: evidence within which two explanations cannot be told apart. limit: largest number of effects per joint; more
    would be patchwork around something unknown. banded: the same in the band of the motion, where the whole band has
    left something unexplained.
    minor: share of all that was explained below which a further effect, or a drift of a parameter that is not
    `relevant` either, is taken for an inexact law of another.
    doubtful: the same while something else stays unexplained. unexplained: share that makes a verdict `unknown`.
    disturbance: unlogged torque, as a share of the motor torque, that does so too, unless it
    stays below `amplifier` times the largest command: amplifiers are that noisy. jitter: least jitter of the sampling
    instants as a share of the interval. patched: evidence of what was refused for its size, as a share of what was
    explained, above which something unknown must be there. relevant: torque of what stays
    unexplained, as a share of the command's rms, below which it is put down to integrators and inexact laws; a further
    effect needs half of that, or all beside one in which small causes grow. inexact: share of what was explained above
    which no such excuse holds, unless the torque stays below `seen`: rounding is not quite noise.
    budget: simulations of all logs, of each joint by itself, after which no other ways are tried; after twice as many
    no further effects are sought. It is that of logs with `LENGTH` samples; of others more or fewer, in proportion.
    """

    threshold: float = 12.0
    weak: float = 60.0
    material: float = 2.5e-4
    faint: float = 5e-5
    rival: float = 6.0
    limit: int = 3
    banded: int = 2
    minor: float = 0.005
    doubtful: float = 0.15
    unexplained: float = 0.03
    disturbance: float = 0.03
    amplifier: float = 1.5e-3
    jitter: float = 0.002
    patched: float = 2.0
    relevant: float = 0.008
    inexact: float = 0.1
    seen: float = 0.0015
    budget: int = 10_000


@dataclass(frozen=True, eq=False)
class Accepted:
    """One effect of the final model with its competition at the moment of acceptance."""

    scored: Scored
    material: float
    rivals: tuple[Scored, ...]
    considered: tuple[Ranked, ...] = ()

    @property
    def effect(self) -> Effect:
        return self.scored.effect

    @property
    def name(self) -> str:
        return self.scored.name

    @property
    def label(self) -> str:
        """The standard name, whichever instance of the effect it is."""
        return self.scored.label

    @property
    def joint(self) -> int:
        return self.scored.start.hypothesis.joint


@dataclass(frozen=True, eq=False)
class Finding:
    """Outcome for one problem: the nominal fit, the accepted effects in order, the final fit, what is left.

    band: upper frequency [Hz] of the comparison that chose the effects; None: the whole band.
    refused: what was tried last and not accepted, best first. patched: joints whose effects are pieces of another law.
    optima: see `Path`. traded: the fits in which the amplifier's lag is another one of the lags in series.
    is_cut: whether other ways were left untried, or further effects, because the search had taken its budget.
    """

    verdict: Verdict
    nominal: Fitted
    accepted: tuple[Accepted, ...]
    final: Fitted
    remainders: tuple[Remainder, ...]
    steps: tuple[Fitted, ...]
    band: float | None = None
    refused: tuple[Ranked, ...] = ()
    patched: Mapping[int, Patchwork] = field(default_factory=dict)
    optima: tuple[Optimum, ...] = ()
    traded: tuple[Optimum, ...] = ()
    is_cut: bool = False

    @property
    def scattered(self) -> float:
        """What noise alone would let a further effect explain, where small causes grow in the final model."""
        return lucky(self.remainders)

    @property
    def covariance(self) -> Array:
        """Covariance (P, P) of the final model's parameters, with what noise and other optima do in rough ground and
        other orders of lags in series mean."""
        rough = any(item.effect.scatters for item in self.accepted)
        apart = distances(self.optima if rough else (), max(left.growth for left in self.remainders))
        least: dict[str, float] = {}
        for deviations in (apart, distances(self.traded), *(left.deviations for left in self.remainders)):
            for name, deviation in deviations.items():
                least[name] = float(np.hypot(least.get(name, 0.0), deviation))
        return covariance(self.final, least)


def materiality(problem: Problem, fitted: Fitted, name: str, joint: int) -> float:
    """Torque of an effect as a share of the command's rms: its influence on the prediction beside that of the
    command."""
    off = fitted.point.switches.copy()
    off[joint, problem.kernel.switches[name]] = False
    without = replace(fitted.point, switches=off)
    one = (errors(problem, [without])[0] - fitted.error)[problem.used, joint]
    return float(np.sqrt(np.mean(one**2))) / command_response(problem, fitted.point, joint)


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
    apart (`is_foreseen`), its search begins from what the band shows in which the joint moved. Where something is left
    (`unknown`), the effects are sought again in that band, and those that shape the motion there are reported, unless
    those of the whole band do better there, too; the verdict stays. Only where the search in the whole band, begun
    again from them, leaves nothing, they are what was missing.
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
        banded = in_motion(replace(problem, work=Work()), structures, effects, settings, tell)
        longer = continued(search, banded, search.nominal.criterion, held_out)
        if longer is not None and longer.verdict != "unknown":
            return quiet(problem, longer, effects, settings)
    whole = search.concluded(search.completed(search.grown(search.start)), held_out)
    if whole.verdict in ("none", "named"):
        return quiet(problem, whole, effects, settings)
    dearest = cost(problem, whole.final, whole.accepted) - settings.threshold
    if longer is not None and cost(problem, longer.final, longer.accepted) < dearest:
        whole = longer
    depends = sum(r.excess for r in whole.remainders) > 0.0
    if whole.verdict != "unknown" or not depends:
        return whole
    if banded is None:
        banded = in_motion(problem, structures, effects, settings, tell)
        if not search.is_spent:
            longer = continued(search, banded, dearest, held_out)
            if longer is not None and longer.verdict != "unknown":
                return quiet(problem, longer, effects, settings)
    if banded is None:
        return whole
    narrow, found = banded
    is_cut = whole.is_cut or (search.is_spent and bool(found.accepted))
    if whole.accepted and does_better(narrow, held_out, whole, found, settings.threshold):
        return replace(whole, is_cut=is_cut)
    band = 0.4 / (narrow.decimation * problem.sample_time)
    return replace(found, verdict="unknown", remainders=whole.remainders, band=band, is_cut=is_cut)


def is_foreseen(problem: Problem, nominal: Fitted) -> bool:
    """Whether each reading follows from those before it whatever the model: the errors of the nominal one are far more
    than their innovations.

    The whole band then hardly tells models apart, and fits there may stop anywhere.
    """
    error = np.mean(nominal.error[problem.used] ** 2, axis=0)
    return bool(np.any(error > FORESEEN**2 * (nominal.variances + nominal.floor)))


def in_motion(
    problem: Problem,
    structures: tuple[JointStructure, ...],
    effects: Sequence[Effect],
    settings: Settings,
    tell: Callable[[str], None],
) -> tuple[Problem, Finding] | None:
    """What the band in which the joint moved shows by itself, and the problem there; None where it is no narrower or
    too short."""
    narrow = in_band(problem)
    if narrow.decimation == 1 or narrow.used.sum() // narrow.decimation < 60:
        return None
    tell("in the band of the motion")
    inner = Search.begin(narrow, structures, effects, replace(settings, limit=settings.banded), tell)
    return narrow, inner.concluded(inner.grown(inner.start))


def continued(
    search: Search, banded: tuple[Problem, Finding] | None, most: float, held_out: Problem | None
) -> Finding | None:
    """What the search in the whole band concludes when it goes on from what the band of the motion has shown; None
    where nothing was shown, or it costs more than `most` there."""
    path = None if banded is None else carried_over(search, banded[1], most)
    if path is None:
        return None
    search.tell("again in the whole band")
    return search.concluded(search.grown(path), held_out)


def quiet(problem: Problem, finding: Finding, effects: Sequence[Effect], settings: Settings) -> Finding:
    """The finding, with a jitter if there is one; only where nothing else is left."""
    still = sum(r.excess for r in finding.remainders) == 0.0
    return with_jitter(problem, finding, effects, settings) if still else finding


def carried_over(search: Search, banded: Finding, most: float) -> Path | None:
    """What was found in the band of the motion, fitted in the whole band; None where that does not cost less than
    `most`.

    Where no single hypothesis brings errors in the whole band down to noise, a fit there may stop at any distance of
    what the band of the motion shows at once.
    """
    problem = search.problem
    if not banded.accepted:
        return None
    base = in_turns(problem, free_of_filter(problem, banded.final.point))
    if not cost(problem, base, banded.accepted) < most:
        return None
    accepted = tuple(
        replace(item, scored=item.scored.refitted(without(problem, base, item), base)) for item in banded.accepted
    )
    present = frozenset(place for item in accepted for place in stood_for(item))
    return Path(base, accepted, present, (search.nominal, base))


def does_better(narrow: Problem, held_out: Problem | None, whole: Finding, banded: Finding, threshold: float) -> bool:
    """Whether what the whole band has found does better in the band of the motion, too: on the fitted logs, where it
    may have more effects, and by the evidence that an effect needs on those that nobody fitted."""
    fitted = in_turns(narrow, fit(narrow, whole.final.point))
    better = cost(narrow, fitted, whole.accepted) < cost(narrow, banded.final, banded.accepted)
    if not better or held_out is None:
        return better
    apart = replace(held_out, decimation=narrow.decimation)
    return deviance(apart, fitted) < deviance(apart, banded.final) - threshold


def cost(problem: Problem, fitted: Fitted, accepted: Sequence[Accepted]) -> float:
    """-2 log likelihood and the price of all effects."""
    return fitted.criterion + sum(price(problem, item.scored.start, fitted.samples) for item in accepted)


@dataclass(frozen=True, eq=False)
class Path:
    """A way through the search: the effects accepted so far, the model with them, and where it could have gone instead.

    forks: at every step the hypotheses that came much closer or explained nearly as much, with the path up to there,
    best first. equals: effects with their joints and the laws that explained nearly as much when they were taken.
    unsteady: the evidence for disturbances that were refused because not all logs have them. optima: where
    fits stopped in rough ground when a play was found (`diagnosis.hopping`). is_cut: whether the budget left other ways
    from here untried, or further effects.
    """

    base: Fitted
    accepted: tuple[Accepted, ...]
    present: frozenset[tuple[str, int]]
    steps: tuple[Fitted, ...]
    left: tuple[Remainder, ...] = ()
    refused: tuple[Ranked, ...] = ()
    unsteady: float = 0.0
    forks: tuple[tuple[Path, Accepted], ...] = ()
    equals: frozenset[tuple[str, int, str]] = frozenset()
    optima: tuple[Optimum, ...] = ()
    is_cut: bool = False

    @property
    def excess(self) -> float:
        """What noise does not account for in all remainders."""
        return sum(r.excess for r in self.left)

    @property
    def scattered(self) -> float:
        """What noise alone would let an effect explain, where small causes grow in the model."""
        return lucky(self.left)


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

    @property
    def start(self) -> Path:
        """The nominal model alone."""
        return Path(self.nominal, (), frozenset(), (self.nominal,))

    def grown(self, path: Path) -> Path:
        """The path continued as far as effects are found; at their limit, as far as one takes the place of another."""
        problem, settings = self.problem, self.settings
        limit = settings.limit * problem.joints
        while candidates := self.candidates(path, is_full=distinct(path.accepted) >= limit):
            if path.accepted and self.taken > END:
                path = replace(path, left=remainders(problem, path.base))
                path = replace(path, is_cut=path.excess > 0.0)
                break
            self.tell(f"looking for effect {len(path.accepted) + 1}")
            explained = self.nominal.criterion - path.base.criterion
            needed = -np.inf
            if path.accepted:
                path = replace(path, left=remainders(problem, path.base))
                complete = path.excess <= allowance(self.nominal, path.base)
                needed = max(settings.threshold, settings.minor * explained) * (1.0 if complete else 0.3)
                needed = max(needed, path.scattered)
            hopeless = partial(is_too_small, path.accepted, settings, explained)
            ranked = try_all(problem, path.base, candidates, needed=needed, is_hopeless=hopeless)
            if not path.accepted and stuck(problem, ranked):
                ranked = also_without_limits(problem, path.base, candidates, ranked)
            if not path.accepted:
                ranked = also_from_regression(problem, self.structures, path.base, candidates, ranked)
            ranked = [scored for scored in ranked if not coincides(problem, scored, path.accepted)]
            ranked = settled_anew(problem, self.structures, path.base, ranked)
            ranked = with_limiting_effects(problem, path.base, ranked)
            chosen = choose(problem, ranked, settings, explained, path.accepted, least=path.scattered)
            if chosen is None:
                unsteady = max((s.evidence for s in ranked if not is_steady(problem, s)), default=0.0)
                path = replace(path, refused=ranking(ranked), unsteady=unsteady)
                break
            before = replace(path, forks=())
            chosen, nearer = firm_ground_first(chosen, much_closer(problem, chosen, ranked, settings))
            closer = tuple((before, other) for other in nearer)
            others = tuple((before, other) for other in nearly_as_good(chosen, ranked))
            longer = self.advanced(replace(path, forks=closer + path.forks + others), chosen)
            if distinct(longer.accepted) > limit:
                break
            path = longer
        return path if path.left else replace(path, left=remainders(problem, path.base))

    def candidates(self, path: Path, *, is_full: bool) -> list[tuple[Effect, int]]:
        """The effects that may come next: all others, or those that contain one that is there."""
        others = hypotheses_of(self.effects, self.problem.joints, set(path.present))
        there = {(item.name, item.joint) for item in path.accepted}
        contains = lambda effect, j: any((name, j) in there for name in effect.includes)  # noqa: E731
        return [(effect, j) for effect, j in others if not is_full or contains(effect, j)]

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
        base = arm_damping_settled(problem, twists_settled(problem, base))
        base = timing_settled(problem, windings_settled(problem, base))
        base = following_settled(problem, base)
        steps = (*path.steps, base)
        accepted, base = prune(problem, accepted, base, settings)
        accepted, base = simplified_afterwards(problem, accepted, base, self.effects, settings)
        accepted, base = merged_afterwards(problem, accepted, base, settings)
        accepted, base = unified(problem, accepted, base, self.effects, settings)
        present = path.present.union(unseen, stood_for(chosen), *map(stood_for, accepted))
        return replace(
            path,
            base=base,
            accepted=tuple(accepted),
            present=present,
            steps=steps,
            left=(),
            equals=equals,
            optima=optima,
        )

    def exchanged(self, path: Path) -> Path:
        """The path with another law in the place of one of its effects, where that does better beside all others, and
        continued from there.

        What stands beside an effect now may have been missing when it was taken, and a near equal have come second only
        for that.
        """
        problem, settings = self.problem, self.settings
        for item in path.accepted:
            others = tuple(other for other in path.accepted if other is not item)
            near = {name for label, joint, name in path.equals if (label, joint) == (item.label, item.joint)}
            near -= {other.label for other in path.accepted if other.joint == item.joint}
            rivals = [(effect, item.joint) for effect in self.effects if effect.label in near]
            if not rivals:
                continue
            self.tell(f"another law in the place of {item.label}")
            smaller = without(problem, path.base, item)
            explained = self.nominal.criterion - smaller.criterion
            best = choose(problem, try_all(problem, smaller, rivals), settings, explained, others)
            if best is None:
                continue
            cost = best.scored.fitted.criterion + best.scored.price
            if cost < path.base.criterion + item.scored.price - settings.threshold:
                present = frozenset(place for other in others for place in stood_for(other))
                shorter = replace(path, base=smaller, accepted=others, present=present, left=())
                return self.grown(self.advanced(shorter, best))
        return path

    def completed(self, path: Path) -> Path:
        """The path with other laws in place of its own and, where something is left, other ways that lead further.

        Greedy selection can start from a stand-in: an offset and dry friction first look like asymmetric friction.
        """
        asks = path.excess > 0.0 and (len(path.accepted) > 1 or self.incomplete(path))
        is_cut = path.is_cut or (asks and self.is_spent)
        if asks and not is_cut:
            path = self.exchanged(path)
        for earlier, other in path.forks[:FORKS]:
            if not self.incomplete(path):
                break
            if self.is_spent:
                is_cut = True
                break
            self.tell(f"once more with {other.label}")
            second = self.grown(self.advanced(earlier, other))
            if self.cost(second) < self.cost(path) - self.settings.threshold:
                path = second
        return replace(path, is_cut=is_cut)

    def concluded(self, path: Path, held_out: Problem | None = None) -> Finding:
        """What stands at the end of a path: effects that are not needed are taken back, and the verdict is given."""
        problem, nominal, settings = self.problem, self.nominal, self.settings
        accepted, base = one_dry_friction(problem, nominal, list(path.accepted), path.base, settings)
        left = path.left if base is path.base else remainders(problem, base)
        accepted, base, left = trim(problem, nominal, accepted, base, left, settings)
        before = base
        accepted, base = significant(problem, accepted, base, settings)
        if held_out is not None:
            accepted, base = general(problem, held_out, accepted, base, settings)
        lag = next((item for item in accepted if item.label == LAG), None)
        base, traded = (base, ()) if lag is None else told_apart(problem, base, lag.effect, lag.joint)
        if base is not before:
            left = remainders(problem, base)
        accepted = [
            confirmed(problem, base, simpler_rivals(item, left), accepted[i + 1 :], settings)
            for i, item in enumerate(accepted)
        ]
        accepted = [disguised(problem, base, item, accepted, self.effects, settings) for item in accepted]
        accepted = [in_other_terms(problem, base, item, self.effects, settings) for item in accepted]
        pieces = patchwork(problem, base, accepted, settings.rival)
        said = verdict(problem, nominal, base, accepted, left, settings)
        if pieces or not all(stays_itself(problem, replace(item.scored, fitted=base)) for item in accepted):
            said = "unknown"
        refused = max((r.decrease - r.price for r in path.refused), default=0.0)
        explained = nominal.criterion - base.criterion
        if (accepted and refused > settings.patched * explained) or (
            path.unsteady > max(settings.threshold, settings.inexact * explained)
        ):
            said = "unknown"
        return Finding(
            said,
            nominal,
            tuple(accepted),
            base,
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
        simulations = self.problem.joints * self.problem.work.samples / len(self.problem.time)
        return simulations / max(self.settings.budget, 1) * max(len(self.problem.time) / LENGTH, SHORTEST)

    @property
    def is_spent(self) -> bool:
        """Whether the search has taken its budget of simulations."""
        return self.taken > 1.0

    def incomplete(self, path: Path) -> bool:
        """Whether something is left that neither noise nor inexact laws account for."""
        explained = self.nominal.criterion - path.base.criterion
        return unexplained(self.problem, explained, path.left, self.settings)

    def cost(self, path: Path) -> float:
        """-2 log likelihood and the price of all effects."""
        return cost(self.problem, path.base, path.accepted)


def near_equals(item: Accepted) -> frozenset[tuple[str, int, str]]:
    """An effect, its joint, and each law that explains nearly as much there when it is taken."""
    least = EQUAL * item.scored.evidence
    found = (r for r in item.considered if r.joint == item.joint and r.decrease - r.price > least)
    return frozenset((item.label, item.joint, r.name) for r in found if r.name != item.label)


def stood_for(item: Accepted) -> frozenset[tuple[str, int]]:
    """The effects, each with its joint, that are not tried again beside an accepted one: itself, those that it includes
    and those that it excludes."""
    effect = item.effect
    return frozenset((name, item.joint) for name in (effect.name, *effect.includes, *effect.excludes))


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
    command = np.sqrt(np.mean(problem.command**2, axis=0))
    starts: list[tuple[Point, Start]] = []
    for effect in dict.fromkeys(effect for effect, _ in candidates):
        if effect.name == DRY and ranked[0].label != DRY:
            point, friction, *_ = point_at(problem, structures)
            values, is_felt = friction[:, None], friction > DRAG * command
        elif effect.is_linear_in_place:
            point, _, values, change = point_at(problem, structures, effect)
            is_felt = change > HELD * command
        else:
            continue
        starts += [
            (point, Start(Hypothesis(effect, j), np.tile(values[j], (problem.logs, 1)), 0.0))
            for other, j in candidates
            if other is effect and is_felt[j]
        ]
    limit = ranked[0].fitted.criterion + base.samples * np.log(HOPELESS)

    def carried_on(item: tuple[Point, Start]) -> Scored | None:
        point, start = item
        found = to_errors(problem, extend(problem, point, start.hypothesis, start.values))
        if unfitted(problem, base, found.point, found.error).criterion > limit:
            return None
        return score(problem, base, start, to_innovations(problem, found))

    return either(ranked, [scored for scored in each(carried_on, starts) if scored is not None])


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
    wrongly without them: whether a stated torque limit acts, and when commands do.

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
        if competes(scored, TIMED):
            fitted = timing_settled(problem, fitted)
        return scored if fitted is scored.fitted else scored.refitted(base, fitted)

    return sorted(each(anew, ranked), key=lambda scored: -scored.evidence)


def coincides(problem: Problem, scored: Scored, accepted: Sequence[Accepted]) -> bool:
    """Whether an event happens when another one does that has a name already: it would repair the law of that one."""
    if scored.effect.scan != "event":
        return False
    instants = lambda s: s.fitted.point.parameters[  # noqa: E731
        :, s.start.hypothesis.joint, problem.kernel.column(s.effect, "time")
    ]
    return any(
        np.any(np.abs(instants(scored) - instants(item.scored)) < SIMULTANEOUS)
        for item in accepted
        if item.effect.scan == "event"
    )


def nearly_as_good(chosen: Accepted, ranked: Sequence[Scored]) -> list[Accepted]:
    """Other effects that explain a good part of what the chosen one does: first other forms of its law that do nearly
    as well, then one form of each other law, best first."""
    limit = chosen.scored.evidence

    def differs(s: Scored) -> bool:
        return s.name != chosen.name and chosen.name not in s.effect.includes and s.name not in chosen.effect.includes

    def is_form(s: Scored) -> bool:
        return (s.label, s.start.hypothesis.joint) == (chosen.label, chosen.joint)

    forms = [s for s in ranked if differs(s) and is_form(s) and s.evidence > FORM * limit]
    others = [s for s in textbook(ranked) if differs(s) and not is_form(s) and s.evidence > FORK * limit]
    return [Accepted(scored, 0.0, (), chosen.considered) for scored in (*forms, *others)]


def much_closer(problem: Problem, chosen: Accepted, ranked: Sequence[Scored], settings: Settings) -> list[Accepted]:
    """Other effects with which the errors as they are fall far below those that the chosen one leaves; least first.

    A torque that moves the joint far off what is simulated without it makes a rough ground for all other parameters.
    """

    def size(scored: Scored) -> float:
        return float(np.sum(np.log(np.mean(scored.fitted.error[problem.used] ** 2, axis=0) + 1e-300)))

    limit = size(chosen.scored) + 2.0 * np.log(CLOSER)
    found = [s for s in textbook(ranked) if s.evidence > settings.threshold and size(s) < limit]
    return [Accepted(scored, 0.0, (), chosen.considered) for scored in sorted(found, key=size)]


def firm_ground_first(chosen: Accepted, nearer: list[Accepted]) -> tuple[Accepted, list[Accepted]]:
    """What is taken next and what instead of it: nothing in which small causes grow before what comes much closer.

    Beside the former the latter, which all logs show plainly, would no longer be found.
    """
    if not nearer or not chosen.effect.scatters:
        return chosen, nearer
    return nearer[0], [chosen, *nearer[1:]]


def choose(
    problem: Problem,
    ranked: list[Scored],
    settings: Settings,
    explained: float,
    accepted: Sequence[Accepted] = (),
    least: float = 0.0,
) -> Accepted | None:
    """The best hypothesis that is significant and material; among near equals the one with fewest parameters.

    accepted: effects that are there already, whose inexact laws a small further one may repair. least: decrease of
    -2 log likelihood that noise alone can bring. A general form of a law that is there is how to repair it.
    """
    ranked = [s for s in ranked if is_resolved(problem, s) and is_steady(problem, s) and is_possible(problem, s)]
    ranked = textbook(ranked)
    if not ranked:
        return None
    top = ranked[0]
    material = settings.material if accepted else settings.faint
    margin = max(settings.rival, 0.02 * top.decrease)
    there = {(item.label, item.joint) for item in accepted}
    if top.decrease < max(0.0 if law(top.start) in there else settings.minor * explained, least):
        return None
    best = max(s.evidence for s in ranked)
    near = [
        s
        for s in ranked
        if s.evidence > settings.threshold
        and (s.decrease >= top.decrease - margin or s.evidence >= best - settings.rival)
    ]
    for scored in sorted(near, key=lambda s: (s.effect.size, -s.evidence)):
        hypothesis = scored.start.hypothesis
        share = materiality(problem, scored.fitted, scored.name, hypothesis.joint)
        least_share = material
        if scored.decrease <= settings.inexact * explained and law(scored.start) not in there:
            least_share = least_beside(scored.effect, hypothesis.joint, scored.evidence, accepted, settings)
        if share >= least_share:
            rivals = tuple(
                s
                for s in ranked
                if s is not scored
                and s.evidence > scored.evidence - settings.rival
                and (s.label, s.start.hypothesis.joint) != (scored.label, hypothesis.joint)
                and scored.name not in s.effect.includes
            )
            return Accepted(scored, share, rivals, ranking(ranked))
    return None


def least_beside(
    effect: Effect, joint: int, evidence: float, accepted: Sequence[Accepted], settings: Settings
) -> float:
    """Least torque, as a share of the command's rms, of a small further effect beside others of the same joint.

    It may only make up for an inexact law of one of them. What follows the position and what follows the motor do not
    stand in for each other where the evidence is strong.
    """
    beside = [item.effect for item in accepted if item.joint == joint]
    own = DRIVEN_BY.get(effect.variable) if evidence > settings.weak else None
    others = [DRIVEN_BY.get(other.variable) for other in beside]
    if not any(own is None or other is None or own == other for other in others):
        return settings.material if accepted else settings.faint
    return (1.0 if any(other.scatters for other in beside) else 0.5) * settings.relevant


def is_too_small(accepted: Sequence[Accepted], settings: Settings, explained: float, start: Start) -> bool:
    """Whether a regression says, with a wide margin, that a further effect could not be taken for its size."""
    most, hypothesis = UNDERSTATED * start.promise, start.hypothesis
    if not accepted or most > settings.inexact * explained:
        return False
    return UNDERSTATED * start.share < least_beside(hypothesis.effect, hypothesis.joint, most, accepted, settings)


def textbook(ranked: Sequence[Scored]) -> list[Scored]:
    """One form of every law, best first: the likeliest, or the one that it includes where that does nearly as well and
    leaves no other law ahead.

    A form with more freedom than the textbook's repairs what other effects have yet to explain; it can still take the
    textbook's place when they do (`diagnosis.search.generalised`).
    """
    forms: dict[tuple[str, int], list[Scored]] = {}
    for scored in ranked:
        forms.setdefault((scored.label, scored.start.hypothesis.joint), []).append(scored)
    likeliest = {place: max(own, key=lambda s: s.evidence) for place, own in forms.items()}
    chosen = []
    for place, own in forms.items():
        best = likeliest[place]
        rival = max((s.evidence for other, s in likeliest.items() if other != place), default=-np.inf)
        least = max(FORM * best.evidence, rival if rival < best.evidence else -np.inf)
        simple = [s for s in own if s.name in best.effect.includes and s.evidence > least]
        chosen.append(simple[0] if simple else best)
    return sorted(chosen, key=lambda s: -s.evidence)


def is_steady(problem: Problem, scored: Scored) -> bool:
    """Whether a disturbance that may begin anywhere in its period is as strong in every log, as one machine's would be.

    Where it could stand in one log only, something else moves there: another axis, another excitation.
    """
    effect, joint = scored.effect, scored.start.hypothesis.joint
    free = PER_LOG.get(effect.name, ())
    if not free or problem.logs < 2:
        return True
    columns = [problem.kernel.own(effect).start + i for i in free]
    size = np.sqrt(np.sum(scored.fitted.point.parameters[:, joint, columns] ** 2, axis=1))
    known = np.zeros((problem.logs, len(free)))
    for i, f in enumerate(scored.fitted.point.free):
        if f.kind == "log" and f.joint == joint and f.column in columns:
            known[f.log, columns.index(f.column)] = max(scored.fitted.covariance[i, i], 0.0)
    deviation = np.sqrt(np.max(known, axis=1))
    largest = int(np.argmax(size))
    return bool(np.all(size + 3.0 * deviation > STEADY * (size[largest] - 3.0 * deviation[largest])))


def is_possible(problem: Problem, scored: Scored) -> bool:
    """Whether an effect of either sign stays within the size that it can have: at the end of its range it stands in for
    another one. A lag that a command which acts earlier than logged takes back is none: together they repair how
    integrators differ."""
    effect, joint = scored.effect, scored.start.hypothesis.joint
    if effect.label == LAG:
        own, shift = scored.fitted.point.parameters[0, joint, [problem.kernel.own(effect).start, SHIFT]]
        if -shift > TAKEN_BACK * own:
            return False
    values = np.abs(scored.fitted.point.parameters[:, joint, problem.kernel.own(effect)])
    either = {i: p.upper for i, p in enumerate(effect.parameters) if p.lower == -p.upper and np.isfinite(p.upper)}
    return all(np.all(values[:, i] < AT_END * end) for i, end in either.items())


def stays_itself(problem: Problem, scored: Scored) -> bool:
    """Whether an effect is in the final model what its name says: within the size that it can have and, of what is
    periodic in the position, half a period at least. Beside others it may have become a piece of another law."""
    periodic = scored.effect.scan == "position"
    return (
        is_possible(problem, scored)
        and is_of_its_shape(problem, scored)
        and (not periodic or is_resolved(problem, scored))
    )


def is_of_its_shape(problem: Problem, scored: Scored) -> bool:
    """Whether the shape of a general law lies within what such laws have: at some ends of that range it stands in for
    another one."""
    values = scored.fitted.point.parameters[0, scored.start.hypothesis.joint, problem.kernel.own(scored.effect)]
    return not any(
        (p.stands_in_at in ("lower", "both") and value < p.lower / AT_END)
        or (p.stands_in_at in ("upper", "both") and value > p.upper * AT_END)
        for value, p in zip(values, scored.effect.parameters, strict=True)
    )


def prune(
    problem: Problem, accepted: list[Accepted], base: Fitted, settings: Settings
) -> tuple[list[Accepted], Fitted]:
    """Drop effects that the later ones made superfluous."""
    changed = len(accepted) > 1
    while changed:
        changed = False
        for item in accepted:
            if wald(base, item) > 20.0 * (item.scored.price + settings.threshold):
                continue
            smaller = without(problem, base, item)
            if smaller.criterion - base.criterion < item.scored.price + settings.threshold:
                accepted = [other for other in accepted if other is not item]
                base, changed = smaller, len(accepted) > 1
                break
    return accepted, base


def distinct(accepted: Sequence[Accepted]) -> int:
    """Number of effects; the harmonics of one count once."""
    return len({(item.label, item.joint) for item in accepted})


def simplified(
    problem: Problem, base: Fitted, chosen: Accepted, effects: Sequence[Effect], settings: Settings
) -> Accepted:
    """The effect that the chosen one includes as its limit, where that does as well with fewer parameters."""
    joint = chosen.joint
    inner = [(other, joint) for other in effects if other.name in chosen.effect.includes]
    if not inner:
        return chosen
    visible = is_resolved(problem, chosen.scored)
    for start in proposals(problem, [View.of(problem, base)], inner, sizes_of(problem, base))[0]:
        point = within(problem, chosen.scored, start)
        fitted = fit(problem, point, chosen.scored.fitted.whitener, rounds=2, iterations=6)
        simple = score(problem, base, start, fitted)
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

    One that came as a more general form of an earlier one and is back in its simplest is that one.
    """
    for item in accepted:
        if item.name not in (chosen.name, *chosen.effect.includes) or item.joint != chosen.joint:
            continue
        both = chosen.scored.fitted
        allowed = item.scored.price + settings.threshold
        for fitted in alone(problem, item, chosen):
            if fitted.criterion - both.criterion < allowed:
                decrease = chosen.scored.decrease + item.scored.decrease + both.criterion - fitted.criterion
                chosen = replace(chosen, scored=replace(chosen.scored, fitted=fitted, decrease=decrease))
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
    least, known = FORK * item.scored.evidence, {item.label, *(rival.label for rival in item.rivals)}
    near = {r.name for r in item.considered if r.joint == item.joint and r.decrease - r.price > least}
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


def simplified_afterwards(
    problem: Problem, accepted: list[Accepted], base: Fitted, effects: Sequence[Effect], settings: Settings
) -> tuple[list[Accepted], Fitted]:
    """The effects but the last in their simplest form: before the last one was there they may have stood in for it."""
    for item in accepted[:-1]:
        if not item.effect.includes:
            continue
        smaller = without(problem, base, item)
        whole = replace(item.scored, fitted=base, decrease=smaller.criterion - base.criterion)
        simple = simplified(problem, smaller, replace(item, scored=whole), effects, settings)
        if simple.name != item.name:
            accepted = [simple if other is item else other for other in accepted]
            base = simple.scored.fitted
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
    for effect, joint in ((effect, j) for effect in effects for j in range(problem.joints)):
        laws = {effect.label, *effect.includes}
        parts = [item for item in accepted if item.joint == joint and {item.name, item.label} & laws]
        if len({item.label for item in parts}) < 2 or effect in [item.effect for item in parts]:
            continue
        view, size = View.of(problem, base), sizes_of(problem, base)[joint]
        start, points = generalised(problem, view, effect, [item.effect for item in parts], joint, size)
        fitted = containing(problem, base, points)
        fitted = min(fitted, fit(problem, fitted.point, rounds=2, iterations=12), key=lambda option: option.criterion)
        smaller = base
        for item in parts:
            smaller = without(problem, smaller, item)
        whole = score(problem, smaller, start, fitted)
        allowed = sum(item.scored.price for item in parts) + settings.threshold
        if fitted.criterion + whole.price > base.criterion + allowed:
            continue
        one = Accepted(whole, materiality(problem, fitted, whole.name, joint), ())
        one = simplified(problem, smaller, one, effects, settings)
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
    problem: Problem, held_out: Problem, accepted: list[Accepted], base: Fitted, settings: Settings
) -> tuple[list[Accepted], Fitted]:
    """Without weak effects that make data that nobody fitted less likely; an event need not happen there."""
    for item in sorted(accepted, key=lambda item: item.scored.evidence):
        if item.scored.evidence > settings.weak or item.effect.scan == "event":
            continue
        smaller = without(problem, base, item)
        if deviance(held_out, smaller) < deviance(held_out, base):
            accepted, base = [other for other in accepted if other is not item], smaller
    return accepted, base


def deviance(held_out: Problem, fitted: Fitted) -> float:
    """-2 log likelihood, up to a constant, of data that were not fitted: their innovations by the fit's own filter."""
    point, joints = started(held_out, fitted.point, fitted.whitener), held_out.joints
    innovation = on_logs(held_out, fitted.whitener)(errors(held_out, [point])[0]).reshape(joints, -1)
    if not innovation.size:
        return 0.0
    return float(innovation.shape[1] * np.sum(np.log(np.mean(innovation**2, axis=1) + fitted.floor)))


def with_jitter(problem: Problem, finding: Finding, effects: Sequence[Effect], settings: Settings) -> Finding:
    """The finding with a jitter of the sampling instants where the scatter or the stamps show one.

    Where small causes grow, the errors are larger in motion, too, whatever the instants.
    """
    effect = next((effect for effect in effects if effect.name == JITTER), None)
    if effect is None:
        return finding
    cost, dt = float(np.log(finding.final.samples)), problem.sample_time
    for j in range(problem.joints):
        found = None if scatters(problem, finding.final.point, j) else jitter(problem, finding.final, j)
        if problem.stamps is not None:
            found = Jitter(problem.stamps.error, problem.stamps.error / np.sqrt(2.0 * cost), problem.stamps.decrease)
        if found is None or found.decrease < cost + settings.threshold or found.rms < settings.jitter * dt:
            continue
        hypothesis, values = Hypothesis(effect, j), np.full((problem.logs, 1), found.rms)
        fitted = finding.final
        size = len(fitted.point.free)
        spread = np.zeros((size + 1, size + 1))
        spread[:size, :size], spread[size, size] = fitted.covariance, found.deviation**2
        fitted = replace(
            fitted,
            point=extend(problem, fitted.point, hypothesis, values),
            covariance=spread,
            jacobian=np.vstack([fitted.jacobian, np.zeros_like(fitted.jacobian[:1])]),
        )
        scored = Scored(Start(hypothesis, values, found.decrease), fitted, found.decrease, cost)
        finding = replace(
            finding,
            verdict="named",
            accepted=(*finding.accepted, Accepted(scored, 0.0, ())),
            final=fitted,
            steps=(*finding.steps, fitted),
        )
    return finding


def allowance(nominal: Fitted, base: Fitted) -> float:
    """Excess of the remainder that is put down to inexact laws and integrators rather than to something missing."""
    return max(20.0, 0.005 * (nominal.criterion - base.criterion))


def lucky(left: Sequence[Remainder]) -> float:
    """What noise alone would let one effect explain, where small causes grow."""
    return LUCKY * sum(r.scattered for r in left)


def remainders(problem: Problem, fitted: Fitted) -> tuple[Remainder, ...]:
    """What is left of every joint."""
    return tuple(remainder(problem, fitted, j) for j in range(problem.joints))


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
        dry = [item for item in accepted if item.joint == j and DRY in (item.label, *item.effect.includes)]
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


def without(problem: Problem, base: Fitted, item: Accepted) -> Fitted:
    """The model refitted without one of its effects."""
    point = undivided(problem, withdraw(problem, base.point, item.name, item.joint))
    return fit(problem, point, rounds=2, iterations=4, tolerance=1e-4)


def unexplained(problem: Problem, explained: float, left: Sequence[Remainder], settings: Settings) -> bool:
    """Whether something is left that neither noise nor inexact laws account for."""
    excess = sum(r.excess for r in left)
    share = max(r.share for r in left)
    relevant = share > settings.relevant or (share > settings.seen and excess > settings.inexact * explained)
    if excess > max(settings.unexplained * explained, 20.0) and relevant:
        return True
    for r, limit in zip(left, problem.command_limits or (0.0,) * len(left), strict=True):
        torques = ((r.disturbance_share, r.disturbance), (r.beyond_share, r.beyond))
        if any(share > settings.disturbance and size > settings.amplifier * limit for share, size in torques):
            return True
    drifts = [drift for r in left for drift in r.drifts if drift.is_certain]
    return any(drift.decrease > settings.minor * explained or drift.share > settings.relevant for drift in drifts)


def verdict(
    problem: Problem,
    nominal: Fitted,
    final: Fitted,
    accepted: Sequence[Accepted],
    left: Sequence[Remainder],
    settings: Settings,
) -> Verdict:
    """none, named, ambiguous or unknown."""
    if unexplained(problem, nominal.criterion - final.criterion, left, settings):
        return "unknown"
    if any(item.rivals for item in accepted):
        return "ambiguous"
    return "named" if accepted else "none"
