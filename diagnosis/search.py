"""Which effects are missing: propose by regression, decide by prediction error, prefer the simple, prune backwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation import Fitted, Point, fit, weights
from diagnosis.hypotheses import Start, extend, proposals, sizes_of
from diagnosis.problem import Problem
from envs.log import Array
from methods.effects.base import Effect
from methods.kernel import NOMINAL


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
    return tuple(Ranked(s.name, s.start.hypothesis.joint, s.decrease, s.price) for s in scored)


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
) -> list[Scored]:
    """Every hypothesis on top of a base model, best first; only the promising ones are refined.

    `needed`: linear prediction of the evidence below which a hypothesis is not refined.
    """
    base = _with_reference(problem, base)
    starts = proposals(problem, base, effects, sizes_of(problem, base))
    starts = [start for start in starts if start.promise - price(problem, start, base.samples) >= needed]
    rough = []
    known = base.jacobian / weights(base.innovation, problem.joints)
    for start in starts[:refine]:
        point = extend(problem, base.point, start.hypothesis, start.values)
        fitted = fit(problem, point, base.whitener, rounds=1, iterations=3, tolerance=1e-3, known=known)
        rough.append(Scored(start, fitted, base.criterion - fitted.criterion, price(problem, start, base.samples)))
    rough.sort(key=lambda s: -s.evidence)
    final: list[Scored] = []
    for scored in rough[:finals]:
        if final and scored.decrease < 0.2 * final[0].decrease:
            break
        fitted = fit(problem, scored.fitted.point, scored.fitted.whitener, rounds=3, iterations=5)
        final.append(replace(scored, fitted=fitted, decrease=base.criterion - fitted.criterion))
    return sorted(final + rough[len(final) :], key=lambda s: -s.evidence)


def _with_reference(problem: Problem, base: Fitted) -> Fitted:
    """The same fit with the mean square motor torque filled in, by which thermal effects are normalised."""
    point: Point = base.point
    parameters: Array = point.parameters.copy()
    for j, size in sizes_of(problem, base).items():
        parameters[:, j, NOMINAL.index("torque_square_mean")] = max(size.torque_rms**2, 1e-300)
    return replace(base, point=replace(point, parameters=parameters))


def hypotheses_of(effects: Sequence[Effect], joints: int, present: set[tuple[str, int]]) -> list[tuple[Effect, int]]:
    """Effects not yet in the model, per joint."""
    return [(effect, j) for j in range(joints) for effect in effects if (effect.name, j) not in present]
