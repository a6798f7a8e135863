"""Logs that are only louder than the fitted ones: what nobody logged, as the noise of an amplifier in proportion to its
command, is stronger there.

A model then errs by more than the noise of the fitted logs accounts for, and is right all the same. What a wrong law
errs depends on the motion; what noise errs does not, and is met by no other values of the parameters either.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.stats import chi2

from diagnosis.beginning import VELOCITY, started
from diagnosis.command_levels import with_levels_counted
from diagnosis.estimation import Fitted, errors, finish, significance
from diagnosis.finding import Finding
from diagnosis.problem import Problem, free_velocity
from diagnosis.remainder import remainder
from diagnosis.whitening import whitener

CHANCE = 1e-3
"""Probability by chance alone below which errors depend on something."""


def is_louder(held_out: Problem, finding: Finding, joint: int) -> bool:
    """Whether what the final model errs on held-out logs is noise as far as they tell, beside the filter that their own
    noise asks for."""
    there = on_its_own(held_out, finding.final)
    left = remainder(held_out, there, joint)
    depends = any(dependence.p_value < CHANCE for dependence in left.dependences)
    drifts = any(drift.is_certain for drift in left.drifts)
    return not (depends or drifts or left.excess > 0.0 or left.wave or differs(finding, there))


def on_its_own(held_out: Problem, final: Fitted) -> Fitted:
    """The final model on other logs (begun as they begin) with a filter of its own, and with those of its parameters
    free that are properties of the machine, beside the velocities at their beginning."""
    point = started(held_out, final.point, final.whitener)
    free = [f for f in final.point.free if f.log < 0]
    for j in range(held_out.joints):
        for log, (a, b) in enumerate(pairwise(held_out.bounds)):
            fastest = float(np.max(np.abs(held_out.velocity[a:b, j])))
            free.append(free_velocity(held_out, j, log, fastest, float(point.starts[log, j, VELOCITY])))
    point = replace(point, free=tuple(free))
    error = errors(held_out, [point])[0]
    return with_levels_counted(held_out, finish(held_out, point, error, whitener(held_out, error)))


def differs(finding: Finding, there: Fitted) -> bool:
    """Whether the parameters that the held-out logs ask for, to first order, are others than those of the fitted ones,
    beyond what both leave uncertain."""
    residual = there.innovation * there.weights
    step = -there.covariance @ (there.jacobian @ residual)
    known = [f.name for f in finding.final.point.free]
    own = [i for i, f in enumerate(there.point.free) if f.log < 0]
    place = [known.index(there.point.free[i].name) for i in own]
    spread = there.covariance[np.ix_(own, own)] + finding.covariance[np.ix_(place, place)]
    return bool(chi2.sf(significance(step[own], spread), len(own)) < CHANCE)
