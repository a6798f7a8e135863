"""What is doubtful in the paper, measured: excitation, differentiation, and the choice of what to validate on.

All on the nominal robot, joint 1. The third doubt, validation on the training sine, needs no experiment of its own:
its figures are in the table of errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.paper.experiment import RATE, TRAINING, Draw, Trial, multisine, record, trials
from benchmarks.paper.study import true_model
from benchmarks.paper.truth import true_coefficients
from envs.excitation import PRBS, Chirp, Excitation, Multisine
from envs.log import Array, Log
from methods.base import State
from methods.cramer_rao import cramer_rao_bound
from methods.differentiation import BandLimited, Differentiator, FiniteDifferences
from methods.least_squares import LeastSquares, condition_number
from methods.regressor import HORIZONTAL

STEADY = 2.0
"""Seconds after which the transient of a sine from rest has died away."""
BANDWIDTHS = (3.0, 5.0, 8.0, 12.0, 18.0, 27.0, 40.0, 60.0, 90.0, 135.0)
"""Bandwidths of the differentiator [Hz]."""
COUNTS = (5e4, 5e5, 5e6)
"""Encoder resolutions [counts/rev]; the robot's own is the middle one."""


@dataclass(frozen=True)
class ExcitationRow:
    """What one excitation can tell about (a11, a12, a13).

    bound: Cramer-Rao bound on the relative standard deviation; clean, real: relative error of band-limited least
    squares without and with hidden effects; correlation of the columns jerk and velocity and condition number of the
    scaled regressor, both without noise and hidden effects.
    """

    excitation: str
    bound: tuple[float, ...]
    clean: tuple[float, ...]
    real: tuple[float, ...]
    correlation: float
    condition: float


@dataclass(frozen=True)
class BandwidthRow:
    """a11, a12, a13 over their truth by one differentiator; bandwidth None: raw differences.

    hold: False where the half-sample of the command's hold was forgotten.
    """

    excitation: str
    counts: float
    bandwidth: float | None
    hold: bool
    ratio: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Doubts:
    """Both experiments, and the band-limited columns (T, 2) of q' and q''' under sine and multisine, scaled to one."""

    excitations: tuple[ExcitationRow, ...]
    bandwidths: tuple[BandwidthRow, ...]
    columns: dict[str, Array]


def investigate(draw: Draw) -> Doubts:
    """Runs both experiments on one draw."""
    sine, many = trials(draw, 1, (TRAINING, "multisine"))
    excitations, columns = _compare_excitations(draw, sine, many)
    bandwidths = [row for trial in (many, sine) for row in _compare_bandwidths(trial, draw.seed)]
    return Doubts(tuple(excitations), tuple(bandwidths), columns)


def _compare_excitations(draw: Draw, sine: Trial, many: Trial) -> tuple[list[ExcitationRow], dict[str, Array]]:
    rich = multisine(draw.robot, draw.setups[1], draw.duration)
    level, frequency = float(rich.per_joint("amplitude")[0]), draw.setups[1].frequency
    tried: list[tuple[str, Trial, Excitation, float]] = [
        ("sine, steady state", sine, sine.excitation, STEADY),
        ("sine from rest", sine, sine.excitation, 0.0),
        ("two sines", many, _two_sines(level, frequency), 0.0),
        ("chirp", many, Chirp(amplitude=level, band=rich.band), 0.0),
        ("random binary", many, PRBS(amplitude=level, bit_time=0.05), 0.0),
        ("multisine", many, rich, 0.0),
    ]
    rows, columns = [], {}
    for name, trial, excitation, start in tried:
        trial = replace(trial, excitation=excitation)
        exact = record(trial, draw.seed, hidden=False, quantised=False)
        first, end = round(start * RATE), len(exact)
        real = record(trial, draw.seed).slice(first, end)
        truth = true_model(trial)
        state = truth.simulate(exact.time, exact.command, State.at_rest(exact.position[0])).state(first)
        bound = cramer_rao_bound(truth, real, state, _step(real) / np.sqrt(12.0))
        method = LeastSquares(BandLimited(), HORIZONTAL)
        noiseless = method.problem([exact.slice(first, end)]).regressor
        velocity, jerk = noiseless[:, 2], noiseless[:, 0]
        rows.append(
            ExcitationRow(
                excitation=name,
                bound=tuple((np.sqrt(np.diag(bound)) / truth.coefficients).tolist()),
                clean=_relative_errors(method, _quantised(exact, _step(real)).slice(first, end), trial),
                real=_relative_errors(method, real, trial),
                correlation=float(np.corrcoef(velocity, jerk)[0, 1]),
                condition=condition_number(noiseless),
            )
        )
        columns[name] = noiseless[:, (2, 0)] / np.max(np.abs(noiseless[:, (2, 0)]), axis=0)
    return rows, columns


def _two_sines(level: float, frequency: float) -> Multisine:
    """Equal sines at f and 2 f: the least that can separate three parameters."""
    return Multisine(amplitude=level, band=(frequency, 2.0 * frequency), period=1.0 / frequency)


def _step(log: Log) -> float:
    return log.facts[0].encoder_step or 0.0


def _relative_errors(method: LeastSquares, log: Log, trial: Trial) -> tuple[float, ...]:
    truth = true_coefficients(trial.robot, 1, trial.pose)
    found = method.fit([log], np.random.default_rng(0)).estimates
    return tuple(found[name] / truth[name] - 1.0 for name in HORIZONTAL)


def _compare_bandwidths(trial: Trial, seed: int) -> list[BandwidthRow]:
    truth = true_coefficients(trial.robot, 1, trial.pose)
    exact = record(trial, seed, hidden=False, quantised=False)
    rows = []
    for counts in COUNTS:
        log = _quantised(exact, 2.0 * np.pi / counts)
        tried: list[tuple[float | None, bool, Differentiator]] = [(None, True, FiniteDifferences())]
        tried += [(bandwidth, True, BandLimited(bandwidth)) for bandwidth in BANDWIDTHS]
        if counts == max(COUNTS):
            tried += [(bandwidth, False, BandLimited(bandwidth)) for bandwidth in BANDWIDTHS]
        for bandwidth, hold, differentiator in tried:
            facts = (replace(log.facts[0], hold="zero_order" if hold else "first_order"),)
            fit = LeastSquares(differentiator, HORIZONTAL).fit([replace(log, facts=facts)], np.random.default_rng(0))
            ratio = tuple(fit.estimates[name] / truth[name] for name in HORIZONTAL)
            rows.append(BandwidthRow(trial.name, counts, bandwidth, hold, ratio))
    return rows


def _quantised(log: Log, step: float) -> Log:
    return replace(
        log, position=np.round(log.position / step) * step, facts=(replace(log.facts[0], encoder_step=step),)
    )
