"""The diagnosis as a contestant: it finds the effects, extends the model by them, and names them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from diagnosis.engine import find
from diagnosis.nominal import JointStructure, settle_stamps
from diagnosis.problem import Problem
from diagnosis.structured_method import Settled, StructuredMethod
from methods.base import Cause
from methods.effects.base import Effect
from methods.registry import METHODS


@METHODS.register("diagnosis", "single-joint", "multi-joint", "physics", "naming", "slow")
@dataclass(frozen=True)
class Diagnosis(StructuredMethod):
    """`diagnosis.engine.find` on every joint, or on a planar pair at once."""

    def settle(
        self, problem: Problem, structures: tuple[JointStructure, ...], group: tuple[int, ...], known: Sequence[Effect]
    ) -> Settled:
        """The final model of the finding, its verdict and the names in it."""
        problem, _ = settle_stamps(problem, problem, structures)
        finding = find(problem, structures, known)
        causes = tuple(
            Cause(item.label, group[item.joint], tuple(dict.fromkeys(rival.label for rival in item.rivals)))
            for item in finding.accepted
        )
        return Settled(finding.final, (), causes, finding.verdict)
