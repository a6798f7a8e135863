"""Whether what an effect explains lies in the motion, or in how noise is predicted.

A prediction that is corrected towards the readings follows the noise, too. A stiff spring without damping moves a joint
as good as nowhere, and may still shape how its prediction goes on from a corrected angle: where noise drives the joint,
or joins what two joints read, that gains likelihood. What an effect does to the motion shows without any noise. The
free motion of the model with the effect is taken for the readings; the model without it, whose parameters have done
what they can to stand in for it, predicts them with innovations e. Beside the innovations e_0 of the logs they stand
for

    sum over joints of N ln(1 + sum e^2 / sum e_0^2)

of -2 log likelihood. Where an effect is real, that is what it gains, or more: the filter of a model without it takes a
part of it for coloured noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, errors
from diagnosis.problem import Problem

SHARE = 0.25
"""Least part of what an effect gains that the motion has to account for."""


def motion_gain(problem: Problem, whole: Fitted, smaller: Fitted) -> float:
    """-2 log likelihood for which the difference of two models' motion stands; infinity where a free motion is none."""
    free = errors(problem, [whole.point], leak=False)[0]
    if not problem.credible(free):
        return np.inf
    moved = replace(problem, reading=problem.reading - free)
    error = errors(moved, [smaller.point])[0]
    if not problem.credible(error):
        return np.inf
    rows = whole.whitener(error).reshape(problem.joints, -1)
    power = np.mean(rows**2, axis=1) / np.maximum(whole.variances + whole.floor, 1e-300)
    return float(rows.shape[1] * np.sum(np.log1p(power)))


def is_of_motion(problem: Problem, whole: Fitted, smaller: Fitted) -> bool:
    """Whether a model's gain over one without some effect comes from the motion."""
    return motion_gain(problem, whole, smaller) > SHARE * (smaller.criterion - whole.criterion)
