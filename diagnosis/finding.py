"""What a search finds: the accepted effects with their competition, the final fit, and what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from diagnosis.estimation import Fitted, covariance
from diagnosis.hopping import Optimum, distances
from diagnosis.patchwork import Patchwork
from diagnosis.problem import Problem
from diagnosis.remainder import Remainder, lucky
from diagnosis.search import Ranked, Scored, price
from envs.log import Array
from methods.effects.base import Effect

Verdict = Literal["none", "named", "ambiguous", "unknown"]
EQUAL = 0.9
"""Share of an effect's evidence from which another law is tried in its place once all effects are there."""
WORST: tuple[Verdict, ...] = ("unknown", "ambiguous", "named", "none")
"""Verdicts of several joints: the first that any of them has is that of all."""


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


def cost(problem: Problem, fitted: Fitted, accepted: Sequence[Accepted]) -> float:
    """-2 log likelihood and the price of all effects."""
    return fitted.criterion + sum(price(problem, item.scored.start, fitted.samples) for item in accepted)


def near_equals(item: Accepted) -> frozenset[tuple[str, int, str]]:
    """An effect, its joint, and each law that explained nearly as much there when it was taken."""
    return frozenset((item.label, item.joint, name) for name in competitors(item, EQUAL))


def competitors(item: Accepted, share: float) -> set[str]:
    """The other laws of the joint with more than a share of an effect's evidence when it was taken."""
    there = {r.name: r.decrease - r.price for r in item.considered if r.joint == item.joint}
    own = there.pop(item.label, item.scored.evidence)
    return {name for name, evidence in there.items() if evidence > share * own}


def stood_for(item: Accepted) -> frozenset[tuple[str, int]]:
    """The effects, each with its joint, that are not tried again beside an accepted one: itself, those that it includes
    and those that it excludes."""
    effect = item.effect
    return frozenset((name, item.joint) for name in (effect.name, *effect.includes, *effect.excludes))


def distinct(accepted: Sequence[Accepted]) -> int:
    """Number of effects; the harmonics of one count once."""
    return len({(item.label, item.joint) for item in accepted})
