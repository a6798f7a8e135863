"""Stated torque limits that no fitted log reaches: the logs that nobody fitted decide whether they act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, predicted_motion
from diagnosis.finding import Finding
from diagnosis.nominal import JointStructure, with_limit
from diagnosis.problem import Problem
from diagnosis.pruning import deviance

REACHED = 0.999
"""Share of a limit from which a torque has reached it."""


def limits_decided(
    problem: Problem, held_out: Problem, finding: Finding, structures: Sequence[JointStructure], threshold: float
) -> tuple[Finding, dict[int, bool]]:
    """The finding with every such limit acting or not, whichever makes the held-out logs likelier, and the joints where
    that matters, with the choice.

    A limit that no torque of the fitted logs reaches is the same to them whether it acts or not, however much it does
    in others. threshold: -2 log likelihood from which it matters.
    """
    chosen: dict[int, bool] = {}
    for j, structure in enumerate(structures):
        if structure.torque_limit == 0.0 or _is_reached(problem, finding.final, j, structure.torque_limit):
            continue
        free, limited = (_limited(finding.final, j, limit) for limit in (0.0, structure.torque_limit))
        gained = deviance(held_out, free) - deviance(held_out, limited)
        if abs(gained) < threshold:
            continue
        chosen[j] = gained > 0.0
        limit = structure.torque_limit if chosen[j] else 0.0
        nominal, final, *steps = (
            fitted if _is_reached(problem, fitted, j, structure.torque_limit) else _limited(fitted, j, limit)
            for fitted in (finding.nominal, finding.final, *finding.steps)
        )
        finding = replace(finding, nominal=nominal, final=final, steps=tuple(steps))
    return finding, chosen


def _is_reached(problem: Problem, fitted: Fitted, joint: int, limit: float) -> bool:
    torque = predicted_motion(problem, fitted.point)[:, joint, 2]
    return bool(np.max(np.abs(torque)) >= REACHED * limit)


def _limited(fitted: Fitted, joint: int, limit: float) -> Fitted:
    return replace(fitted, point=with_limit(fitted.point, joint, limit))
