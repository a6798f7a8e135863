"""An amplifier that rounds its set point: torque that is periodic in the command, however fine.

Rounding to steps of the width D leaves ``u - D round(u / D)`` of a command u. That jumps with every step and looks like
noise in time, so that no smooth function of the log's signals explains it and a whitening filter takes it for noise.
Over the command it is a wave with 1/D cycles per unit: the correlation of the innovations with a change of the command,
as a function of the command itself, shows it as a line.

Source of the law: B. Widrow, I. Kollar, Quantization Noise, Cambridge University Press (2008).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import fftconvolve

from diagnosis.estimation import Fitted, errors
from diagnosis.hypotheses import matched, peaks, pulses
from diagnosis.problem import Problem
from envs.log import Array

COMMAND_STEPS = "command, in steps"
"""The signal on which the rounding of an amplifier depends."""
HARMONICS = 3
"""Waves of the command by which its rounding is described."""
FEWEST, MOST = 4.0, 400.0
"""Steps over the range of the command that are sought."""
FINER = 3.0
"""Times the resolution of the logged command, the least width that is sought."""
AROUND = 101
"""Lines of the spectrum by whose median one is judged."""
TRIED = 3
"""Lines whose waves are tried."""
LUCKY = 6.0
"""How far a line has to stand out of noise beyond the highest of all that are searched."""
NEAR = 0.5
"""Share of what is asked that the line itself has to explain, before widths around it are tried."""
PADDING = 4
"""Lines per width of one."""


@dataclass(frozen=True)
class CommandSteps:
    """Width of an amplifier's steps [command units], the decrease of -2 log likelihood that waves of that width bring,
    how many functions they are, and how many widths were searched."""

    width: float
    decrease: float
    functions: int
    searched: int


def command_steps(problem: Problem, fitted: Fitted, joint: int, least: float = 0.0) -> CommandSteps | None:
    """The rounding of the command that explains most of the innovations, all parameters refitted to first order; None
    where no line stands out, none comes near the decrease that is asked at `least`, or the command has too few levels
    to tell."""
    command = problem.command[:, joint]
    answer = command_answer(problem, fitted, joint)
    whitened = np.convolve(answer, fitted.whitener.coefficients[joint])[: len(answer)]
    cycles, height = lines(command, matched(problem, fitted, joint, whitened).correlation, resolution(command))
    outstanding = [i for i in peaks(height, TRIED, PADDING) if height[i] >= np.log(len(cycles)) + LUCKY]
    if not outstanding:
        return None
    known, spacing = fitted.gain(fitted.jacobian), cycles[1] - cycles[0]

    def steps(count: float) -> CommandSteps:
        rows = waves_of(problem, fitted, joint, answer, 1.0 / count)
        decrease = fitted.gain(np.vstack([fitted.jacobian, rows])) - known
        return CommandSteps(float(1.0 / count), decrease, len(rows), len(cycles))

    best = max((steps(cycles[i]) for i in outstanding), key=lambda option: option.decrease)
    if best.decrease < NEAR * least:
        return None
    around = 1.0 / best.width + spacing * np.linspace(-1.0, 1.0, 9)
    return max(map(steps, around), key=lambda option: option.decrease)


def resolution(command: Array) -> float:
    """The least difference between levels of a command (T,)."""
    levels = np.diff(np.unique(command))
    levels = levels[levels > 1e-9 * np.ptp(command)]
    return float(np.min(levels)) if len(levels) else np.inf


def command_answer(problem: Problem, fitted: Fitted, joint: int) -> Array:
    """What a pulse of the command, of size one where the joint is fast, makes of the errors from its sample on (M,).

    It is simulated, so that lags and dead times between command and torque are in it.
    """
    (at, *_), length, size = pulses(problem, fitted, joint)
    command = problem.command.copy()
    command[at, joint] += size
    error = errors(replace(problem, command=command), [fitted.point])[0]
    return np.asarray((error - fitted.error)[at : at + length, joint] / size)


def lines(command: Array, correlated: Array, finest: float) -> tuple[Array, Array]:
    """Numbers of cycles per unit of a command (T,) that its waves may have, and how far the correlation (T,) with each
    stands out of those around it: a mean of one for noise."""
    span, nothing = float(np.ptp(command)), (np.zeros(0), np.zeros(0))
    most = min(MOST, span / max(FINER * finest, 1e-300))
    if most < 2.0 * FEWEST:
        return nothing
    bins = 1 << int(np.ceil(np.log2(16 * most)))
    place = np.clip(((command - command.min()) / span * bins).astype(int), 0, bins - 1)
    power = np.abs(np.fft.rfft(np.bincount(place, correlated, bins), PADDING * bins)) ** 2
    height = power * np.log(2.0) / np.maximum(median_filter(power, PADDING * AROUND, mode="nearest"), 1e-300)
    number = np.arange(len(power)) / PADDING
    chosen = (number >= FEWEST) & (number <= most)
    return number[chosen] / span, height[chosen]


def waves_of(problem: Problem, fitted: Fitted, joint: int, answer: Array, width: float) -> Array:
    """What waves of the command of so many harmonics make of the innovations (2 HARMONICS, N n), weighted."""
    phase = 2.0 * np.pi / width * problem.command[:, joint]
    waves = np.stack([function(k * phase) for k in range(1, 1 + HARMONICS) for function in (np.sin, np.cos)])
    change = np.zeros((len(waves), len(phase), problem.joints))
    for a, b in pairwise(problem.bounds):
        change[:, a:b, joint] = fftconvolve(waves[:, a:b], answer[None], axes=1)[:, : b - a]
    return np.asarray(fitted.whitener(change) * fitted.weights)
