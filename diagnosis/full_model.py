"""The ceiling: a contestant that is told which effects hide, and only has to find their numbers.

Prediction-error estimation of the nominal joint and the named effects, one after the other in the order in which they
explain most, then all together (`diagnosis.estimation`). No method that has to find the names can do better than this,
save by luck. It is here and not among the methods because it needs the diagnosis' estimator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation import fit
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem
from diagnosis.search import try_all
from diagnosis.structured_method import Settled, StructuredMethod
from envs.log import Log
from methods.base import Fit, MethodError
from methods.effects import built_in, vocabulary
from methods.effects.base import Effect
from methods.registry import METHODS
from methods.usable_logs import check_logs


@METHODS.register("full-model", "single-joint", "multi-joint", "physics", "ceiling")
@dataclass(frozen=True)
class FullModel(StructuredMethod):
    """effects: what is hidden, as pairs of effect name and joint number; none of them makes it the nominal model."""

    effects: tuple[tuple[str, int], ...] = ()

    def vocabulary(self) -> tuple[Effect, ...]:
        """The project's own effects unless others are asked for."""
        own = {effect.name for effect in built_in()} >= {name for name, _ in self.effects}
        return built_in() if own else vocabulary()

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """See `StructuredMethod.fit`. Raises MethodError for effects or joints that do not exist."""
        joints = check_logs(logs)
        known = {effect.name for effect in self.vocabulary()}
        for name, joint in self.effects:
            if name not in known:
                raise MethodError(f"there is no effect {name}", remedy=f"Known are {', '.join(sorted(known))}")
            if joint not in joints:
                raise MethodError(f"the logs do not hold joint {joint}", remedy=f"They hold {list(joints)}")
        return super().fit(logs, rng)

    def settle(
        self, problem: Problem, structures: tuple[JointStructure, ...], group: tuple[int, ...], known: Sequence[Effect]
    ) -> Settled:
        """The effects that were told, in the order in which they explain most, then everything together."""
        named = {effect.name: effect for effect in known}
        wanted = [(named[name], group.index(joint)) for name, joint in self.effects if joint in group]
        notes: list[str] = []
        fitted = fit_nominal(problem, structures)
        while wanted:
            ranked = try_all(problem, fitted, wanted, refine=max(7, 3 * len(wanted)), finals=2)
            if not ranked:
                notes += [f"nothing of {effect.name} shows in the logs of joint {group[j]}" for effect, j in wanted]
                break
            best = ranked[0]
            fitted = best.fitted
            wanted = [(e, j) for e, j in wanted if (e.name, j) != (best.name, best.start.hypothesis.joint)]
        return Settled(fit(problem, fitted.point, rounds=3, iterations=20), tuple(notes))
