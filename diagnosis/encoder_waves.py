"""Errors of the readings themselves over the position: waves, as encoders bring that interpolate between their lines,
and any other that comes again at the same place, as dirt on a disc or a coupling out of line brings it.

No torque makes it, so that no effect of the joint explains it: an error ``A sin(N q + phi)`` of the reading makes the
prediction err at once, and behind the leak and the whitening filter it is a wave in the innovations (`jitter`). The
steps of the encoder are such a wave as well, with one cycle per step, and none is sought near that. What is no wave is
a smooth function of the position: the innovations are regressed on bumps of it behind the same response.

Source: P. L. M. Heydemann, Determination and correction of quadrature fringe measurement errors (1981).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from diagnosis.estimation import Fitted, predicted_motion
from diagnosis.hypotheses import matched, waves
from diagnosis.jitter import reading_response
from diagnosis.problem import Problem
from diagnosis.projection import project
from envs.log import Array
from methods.filters import prediction_filter

SHARE = 0.1
"""Least share of the mean square innovation that is a wave."""
PERIODS = 8.0
"""Periods that the logs have to show: fewer may be any error of the model."""
COARSE = 0.4
"""Cycles of a wave over those of the encoder's steps up to which it is sought."""
FINER = np.linspace(-1.0, 1.0, 9)
"""Numbers of cycles that are tried around the best one, in widths of a spectral line."""
READINGS = "readings over the position"
"""The signal on which errors of the readings themselves depend."""
BUMPS = 16
"""Raised cosines over the range of the position."""
STEPS = 2.0
"""Steps of the encoder that a function of the position has to span: rounding does not, nor where the joint rests."""


@dataclass(frozen=True)
class Wave:
    """Cycles per revolution (per 2 pi m of a slide), amplitude [rad or m], and share of the mean square innovation."""

    cycles: float
    amplitude: float
    share: float


def encoder_wave(problem: Problem, fitted: Fitted, joint: int) -> Wave | None:
    """The strongest wave of a joint's readings, if it makes up a good part of the innovations."""
    motion, response = predicted_motion(problem, fitted.point)[:, joint], reading_response(problem, fitted, joint)
    tool = matched(problem, fitted, joint, response)
    cycles, score = waves(problem, tool, joint, motion[:, 1], np.ones(len(motion)))
    span, step = float(np.ptp(problem.reading[problem.used, joint])), problem.encoder_step
    sought = cycles * span > 2.0 * np.pi * PERIODS
    if step > 0.0:
        sought &= cycles < COARSE * 2.0 * np.pi / step
    count = len(fitted.whitener.rows)
    if not np.any(sought) or np.max(score[sought]) < 0.5 * SHARE * count:
        return None
    best = float(cycles[sought][np.argmax(score[sought])])
    found = [_wave(problem, fitted, joint, motion[:, 0], response, best + f * np.pi / span) for f in FINER]
    wave = max(found, key=lambda wave: wave.share)
    return wave if wave.share > SHARE else None


def _wave(problem: Problem, fitted: Fitted, joint: int, position: Array, response: Array, cycles: float) -> Wave:
    """Regression of the innovations on a wave of so many cycles in the readings."""
    phase = cycles * position
    basis = prediction_filter(np.stack([np.sin(phase), np.cos(phase)]), response)[:, fitted.whitener.rows]
    innovation = fitted.innovation.reshape(problem.joints, -1)[joint]
    parts, explained = project(basis, innovation)
    return Wave(cycles, float(np.hypot(*parts)), explained / max(float(innovation @ innovation), 1e-300))


def bumps(problem: Problem, fitted: Fitted, joint: int) -> tuple[Array, Array]:
    """What smooth functions (BUMPS, T) of the position in the readings of a joint make of its innovations (BUMPS, N),
    and the functions."""
    position = predicted_motion(problem, fitted.point)[:, joint, 0]
    least, span = float(np.min(position[problem.used])), float(np.ptp(position[problem.used])) + 1e-300
    place = np.clip((position - least) / span, 0.0, 1.0) * (BUMPS - 1)
    away = np.minimum(np.abs(place - np.arange(BUMPS)[:, None]), 1.0)
    functions = 0.5 + 0.5 * np.cos(np.pi * away)
    response, rows = reading_response(problem, fitted, joint), np.zeros_like(functions)
    for a, b in pairwise(problem.bounds):
        own = functions[:, a:b]  # what a log has of it all along is where it begins
        rows[:, a:b] = prediction_filter(np.ascontiguousarray(own - own[:, :1]), response)
    return rows[:, fitted.whitener.rows], functions
