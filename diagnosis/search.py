"""Which effects are missing: propose by regression, decide by prediction error, prefer the simple, prune backwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation import Fitted, Point, errors, fit, weights
from diagnosis.hypotheses import Start, extend, proposals, sizes_of, variants
from diagnosis.problem import Problem, beginning, in_band
from diagnosis.remainder import remainder
from envs.log import Array
from methods.effects.base import Effect
from methods.kernel import NOMINAL

NEAR = 0.9
"""Share of the best decrease above which a hypothesis counts as its near equal."""


NOTHING = 20.0
"""Excess of a remainder that is put down to inexact laws and integrators."""
STILL = 0.01
"""Unlogged torque, as a share of the motor's, that is put down to noise of the amplifier."""
CARRIED = 2
"""Fits in the narrow band that are carried on in the whole band."""
SCREENED = 15_000
"""Samples on which starting values are compared."""


@dataclass(frozen=True, eq=False)
class Scored:
    """A fitted hypothesis beside its parent: decrease of -2 log likelihood, and the price it has to pay."""

    start: Start
    fitted: Fitted
    decrease: float
    price: float

    @property
    def name(self) -> str:
        return self.start.hypothesis.effect.name

    @property
    def label(self) -> str:
        """The standard name, whichever instance of the effect it is."""
        return self.start.hypothesis.effect.label

    @property
    def evidence(self) -> float:
        return self.decrease - self.price


@dataclass(frozen=True)
class Ranked:
    """The score of a hypothesis without its fit; joint is the index into the problem."""

    name: str
    joint: int
    decrease: float
    price: float


def ranking(scored: Sequence[Scored]) -> tuple[Ranked, ...]:
    """Scores in the same order."""
    return tuple(Ranked(s.label, s.start.hypothesis.joint, s.decrease, s.price) for s in scored)


def price(problem: Problem, start: Start, samples: int) -> float:
    """What an effect is charged: ln N per parameter and 2 ln(number of shapes searched)."""
    effect = start.hypothesis.effect
    extra = sum(problem.logs - 1 for f in effect.parameters if f.name in ("sine", "cosine") and effect.scan == "time")
    return (effect.size + extra) * np.log(samples) + 2.0 * np.log(max(start.searched, 1))


def try_all(
    problem: Problem,
    base: Fitted,
    effects: Sequence[tuple[Effect, int]],
    *,
    refine: int = 7,
    finals: int = 3,
    needed: float = -np.inf,
    restarts: bool = True,
) -> list[Scored]:
    """Every hypothesis on top of a base model, best first; only the promising ones are refined.

    `needed`: linear prediction of the evidence below which a hypothesis is not refined. `restarts`: whether the effects
    that are linear in none of their parameters take part, which need many fits.
    """
    base = _with_reference(problem, base)
    linear = [(effect, j) for effect, j in effects if effect.amplitudes or effect.starts is None]
    starts = proposals(problem, base, linear, sizes_of(problem, base))
    starts = [start for start in starts if start.promise - price(problem, start, base.samples) >= needed]
    rough = []
    known = base.jacobian / weights(base.innovation, problem.joints)
    for start in starts[:refine]:
        point = extend(problem, base.point, start.hypothesis, start.values)
        fits = [fit(problem, point, base.whitener, rounds=1, iterations=3, tolerance=1e-3, known=known)]
        if (other := exchanged(problem, base.point, start)) is not None:
            fits.append(fit(problem, other, rounds=2, iterations=8))
        cost = price(problem, start, base.samples)
        rough += [Scored(start, fitted, base.criterion - fitted.criterion, cost) for fitted in fits]
    ranked = _converged(problem, base, rough, finals)
    best = ranked[0].fitted if ranked and ranked[0].evidence > 0.0 else base
    rest = [item for item in effects if item not in linear]
    if not rest or not restarts or leaves_nothing(problem, best):
        return ranked
    further = [
        Scored(start, fitted, base.criterion - fitted.criterion, price(problem, start, base.samples))
        for start, fitted in nonlinear(problem, base, rest)
    ]
    return _converged(problem, base, [*ranked, *further], finals)


def leaves_nothing(problem: Problem, fitted: Fitted) -> bool:
    """True where no signal and no unlogged torque accounts for the errors: there is nothing left to search for."""
    left = [remainder(problem, fitted, j) for j in range(problem.joints)]
    return all(r.excess <= NOTHING and r.disturbance_share <= STILL for r in left)


def _converged(problem: Problem, base: Fitted, rough: Sequence[Scored], finals: int) -> list[Scored]:
    """The hypotheses in order of their evidence, the first ones fitted until they have converged."""
    rough = sorted(rough, key=lambda s: -s.evidence)
    final: list[Scored] = []
    for scored in rough[: finals + 1]:
        if final and scored.decrease < 0.2 * final[0].decrease:
            break
        fitted = fit(problem, scored.fitted.point, scored.fitted.whitener, rounds=3, iterations=5)
        final.append(replace(scored, fitted=fitted, decrease=base.criterion - fitted.criterion))
    top = max((scored.decrease for scored in final), default=0.0)
    near = [scored.decrease > NEAR * top and len(final) > 1 for scored in final]
    if sum(near) > 1:  # near equals are told apart only when all of them have converged
        final = [polish(problem, base, s) if is_near else s for s, is_near in zip(final, near, strict=True)]
    best: dict[tuple[str, int], Scored] = {}
    for scored in sorted([*final, *rough[len(final) :]], key=lambda s: -s.evidence):
        best.setdefault((scored.name, scored.start.hypothesis.joint), scored)
    return list(best.values())


def nonlinear(problem: Problem, base: Fitted, candidates: Sequence[tuple[Effect, int]]) -> list[tuple[Start, Fitted]]:
    """First fits of the effects that are linear in none of their parameters, from several starting values each.

    In the whole band of the encoder their likelihood has many local optima, in the band of the motion few: there they
    are fitted first.
    """
    if not candidates:
        return []
    narrow = in_band(beginning(problem, SCREENED))
    banded = fit(narrow, base.point, rounds=3, iterations=8)
    found = []
    for start in proposals(narrow, banded, candidates, sizes_of(narrow, banded)):
        first = [
            fit(narrow, point, banded.whitener, rounds=1, iterations=4, tolerance=1e-3)
            for point in variants(narrow, banded.point, start)
            if narrow.credible(errors(narrow, [point])[0])
        ]
        if not first:
            continue
        first.sort(key=lambda fitted: fitted.criterion)
        whole = [
            fit(problem, fitted.point, rounds=2, iterations=5)
            for fitted in first[:CARRIED]
            if banded.criterion - fitted.criterion > price(narrow, start, banded.samples)
        ]
        if whole:
            found.append((start, min(whole, key=lambda fitted: fitted.criterion)))
    return found


def exchanged(problem: Problem, point: Point, start: Start) -> Point | None:
    """The hypothesis with the value of the nominal parameter that has stood in for it, which falls back to its own.

    Two lags in series can trade places: the fit then ends in the wrong one of two optima.
    """
    effect, j = start.hypothesis.effect, start.hypothesis.joint
    free = {f.name: f for f in point.free}
    stand_in = free.get(f"{effect.exchanges}@{j}")
    if stand_in is None:
        return None
    values = start.values.copy()
    values[:, 0] = point.value(stand_in.name)
    other = extend(problem, point, start.hypothesis, values)
    other.parameters[:, j, stand_in.column] = stand_in.centre if np.isfinite(stand_in.deviation) else 0.1 * values[0, 0]
    return other


def polish(problem: Problem, base: Fitted, scored: Scored) -> Scored:
    """The same hypothesis fitted until it has converged."""
    fitted = fit(problem, scored.fitted.point, rounds=2, iterations=12)
    if fitted.criterion > scored.fitted.criterion:
        return scored
    return replace(scored, fitted=fitted, decrease=base.criterion - fitted.criterion)


def _with_reference(problem: Problem, base: Fitted) -> Fitted:
    """The same fit with the mean square motor torque filled in, by which thermal effects are normalised."""
    point: Point = base.point
    parameters: Array = point.parameters.copy()
    for j, size in sizes_of(problem, base).items():
        parameters[:, j, NOMINAL.index("torque_square_mean")] = max(size.torque_rms**2, 1e-300)
    return replace(base, point=replace(point, parameters=parameters))


def hypotheses_of(effects: Sequence[Effect], joints: int, present: set[tuple[str, int]]) -> list[tuple[Effect, int]]:
    """Effects not yet in the model, per joint; a further instance of one only after the instance before it."""
    return [
        (effect, j)
        for j in range(joints)
        for effect in effects
        if (effect.name, j) not in present and (not effect.after or (effect.after, j) in present)
    ]
