"""How much a figure may move before it is a regression, derived from what the reference's own runs show.

Errors are compared on a logarithmic scale: x = log(error + RESOLUTION), so that a change is a ratio.

Same seeds. The fresh run repeats runs of the reference on the same logs, so nothing but rounding may differ: other
processors and libraries add in another order. How far that carries is measured, not guessed: the reference holds the
runs on the suite's own seeds a second time, on logs whose values are all larger by SCALED - 1 and which therefore round
differently everywhere. The allowance is ROUNDING_MARGIN times the largest change that this caused, at least STEADY. A
method that is trained for thousands of steps may amplify rounding to the size of its seed spread; never more than the
allowance for other seeds is granted.

Other seeds. With n values of mean m and standard deviation s in the reference, the mean of k fresh ones lies above
m + t s sqrt(1/n + 1/k) with probability alpha, where t is Student's quantile at 1 - alpha with n - 1 degrees of freedom
(a prediction interval for the mean of future observations, Hahn and Meeker 1991). All comparisons of one check share
FALSE_ALARMS (Bonferroni). Figures have heavier tails than the normal distribution; a fresh mean must therefore also be
worse than every single value of the reference.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.stats import betabinom
from scipy.stats import t as student

from benchmarks.statistics import Array

RESOLUTION = 1e-6
"""Below this (V, rad, m, or as a ratio) errors are equal: a microvolt, a microradian, a micrometre."""
STEADY = 1e-3
"""Least allowance on the same seeds: a thousandth of the error."""
SCALED = 1.0 + 2.0**-40
"""Factor on the logs of the second run of a reference."""
ROUNDING_MARGIN = 10.0
FALSE_ALARMS = 0.002
"""Chance that a check with other seeds finds a regression where there is none, were all figures log-normal."""
FEWEST_SEEDS = 5
"""A reference needs this many seeds before it says anything about spread."""


def for_same_seeds(rounding: Array) -> float:
    """Allowance from the changes that rounding caused, of any shape."""
    return max(STEADY, ROUNDING_MARGIN * float(np.max(np.abs(rounding), initial=0.0)))


def for_other_seeds(reference: Array, fresh: int, alpha: float, least: float = 0.0) -> float:
    """Allowance for the mean of `fresh` values from the reference's values (n,); `least` bounds the deviation below."""
    n = len(reference)
    deviation = max(float(np.std(reference, ddof=1)), least)
    return float(student.isf(alpha, n - 1)) * deviation * float(np.sqrt(1.0 / n + 1.0 / fresh))


def share_deviation(shares: Array, cells: int) -> float:
    """Standard deviation of a share over so many cells that chance alone causes, from shares (n,) near 0 or 1 too."""
    share = (float(np.sum(shares)) * cells + 1.0) / (len(shares) * cells + 2.0)
    return float(np.sqrt(share * (1.0 - share) / cells))


def chance_of_losses(lost: int, runs: int, lost_before: int, runs_before: int) -> float:
    """Chance of at least `lost` of `runs` when so many were lost before: beta-binomial with Jeffreys' prior."""
    return float(betabinom.sf(lost - 1, runs, lost_before + 0.5, runs_before - lost_before + 0.5))


def shared(one: Mapping[int, float], other: Mapping[int, float]) -> list[int]:
    """Seeds of both, in order."""
    return sorted(set(one) & set(other))
