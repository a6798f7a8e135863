"""Frequencies at which a joint rings beside the model: modes with little damping, which a missing spring leaves.

Such a mode fills the errors with decaying oscillations of one frequency. A fit finds it from close by only, and the
whitening filter takes it for coloured noise, so that it is sought in the errors as they are.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.signal import welch

from diagnosis.estimation import Fitted, Point
from diagnosis.hypotheses import Hypothesis, Start, extend
from diagnosis.problem import Problem
from methods.effects.base import Effect

SECONDS = 2.0
"""Length of the segments of which spectra are averaged: of lower modes a grid of starting values comes close enough."""
LEAST = 8
"""Periods of a mode that a segment has to hold."""
SIDES = ((0.6, 0.85), (1.18, 1.6))
"""Frequencies to both sides of a mode, relative to its own, over whose median its power stands."""
STRONG = 5.0
"""By how much."""
HIGHEST = 0.25
"""Highest mode as a share of the sampling rate: its neighbours have to be there, too."""
MOST = 2
"""Modes that are tried."""


def modes(problem: Problem, fitted: Fitted, joint: int) -> list[float]:
    """Frequencies [Hz] that stand out of a joint's errors, strongest first."""
    rate = 1.0 / problem.sample_time
    length = min(round(SECONDS * rate), int(np.min(np.diff(problem.bounds))) // 4)
    power, frequency = np.zeros(length // 2 + 1), np.fft.rfftfreq(length, problem.sample_time)
    for a, b in pairwise(problem.bounds):
        own = fitted.error[a:b, joint][problem.used[a:b]]
        power += welch(own, rate, nperseg=length)[1]
    height = np.zeros(len(power))
    for i in range(LEAST, int(np.searchsorted(frequency, HIGHEST * rate))):
        sides = [power[round(low * i) : round(high * i) + 1] for low, high in SIDES]
        height[i] = power[i] / max(*(float(np.median(side)) for side in sides), 1e-300)
    found: list[float] = []
    while len(found) < MOST and np.max(height, initial=0.0) > STRONG:
        best = int(np.argmax(height))
        found.append(float(frequency[best]))
        height[round(SIDES[0][1] * best) : round(SIDES[1][0] * best) + 1] = 0.0
    return found


def ringing(problem: Problem, base: Fitted, effect: Effect, joint: int) -> list[tuple[Start, Point]]:
    """Starting points of an effect with which the joint rings as its errors do."""
    if effect.ringing is None:
        return []
    found = []
    for frequency in modes(problem, base, joint):
        shapes = effect.ringing(frequency)
        for shape in shapes:
            values = np.tile(np.array(shape, float), (problem.logs, 1))
            start = Start(Hypothesis(effect, joint), values, 0.0, MOST * len(shapes))
            found.append((start, extend(problem, base.point, start.hypothesis, values)))
    return found
