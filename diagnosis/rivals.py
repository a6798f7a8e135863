"""Least squares, least squares with a network, and a network alone, on the same logs and by the same yardstick.

Their states at the beginning of a window are the measurement's, smoothed as the method itself smooths. A method that
cannot work with the logs, or whose simulation diverges, stays in the table with the reason.
"""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from diagnosis.ledger import closed, quantiles, resampled, simulated
from diagnosis.nominal import Gravity
from diagnosis.problem import Problem, bounded
from diagnosis.replay import WINDOW, in_blocks, rms, window_width
from diagnosis.result import LedgerRow
from envs.log import Array, Log
from methods.base import Method, MethodError, Model
from methods.differentiation import BandLimited, Signals
from methods.least_squares import LeastSquares
from methods.regressor import HORIZONTAL, VERTICAL, ColumnName

BAND = 30.0
"""Bandwidth of the differentiator [Hz], less for logs of a low rate."""
COLUMNS: dict[Gravity, tuple[ColumnName, ...]] = {
    "none": HORIZONTAL,
    "constant": VERTICAL,
    "pendulum": (*HORIZONTAL, "sine", "cosine"),
}
"""Columns of the regression, by what gravity does to the joint in the nominal model."""
SAMPLES = 30_000
"""Samples of the fitted logs that the networks learn from, about."""


def methods(smooth: BandLimited, columns: tuple[ColumnName, ...], samples: int, *, networks: bool) -> dict[str, Method]:
    """The contestants by their name in the ledger; those with networks only when asked for."""
    plain = LeastSquares(smooth, columns)
    found: dict[str, Method] = {"least squares": plain}
    if networks:
        from methods.compensated_least_squares import CompensatedLeastSquares
        from methods.full_batch import FullBatch
        from methods.network_alone import NetworkAlone

        trainer = FullBatch(iterations=100, every=max(1, 5 * samples // SAMPLES))
        found["least squares + network"] = CompensatedLeastSquares(plain, trainer=trainer)
        found["network alone"] = NetworkAlone(smooth, trainer=trainer)
    return found


def rival_rows(
    fitted: Sequence[Log],
    held_out: Sequence[Log],
    problem: Problem,
    joint: int,
    scale: tuple[float, float],
    rng: np.random.Generator,
    *,
    gravity: Gravity,
    networks: bool,
) -> list[LedgerRow]:
    """One row per contestant for one joint of the held-out problem; gravity: what it does to the joint; scale: (before,
    noise floor) of the gap. The jerk is that of a winding: only a voltage drives one."""
    band = min(BAND, 0.2 / problem.sample_time)
    smooth = BandLimited(bandwidth=band)
    logs, unseen = [log.joint(joint) for log in fitted], [log.joint(joint) for log in held_out]
    rows = []
    driven = logs[0].facts[0].input
    columns = tuple(column for column in COLUMNS[gravity] if column != "jerk" or driven == "voltage")
    for name, method in methods(smooth, columns, sum(map(len, logs)), networks=networks).items():
        try:
            fit = method.fit(logs, rng)
            rows.append(_row(name, fit.model, unseen, smooth, joint, scale, rng))
        except MethodError as error:
            rows.append(LedgerRow(joint, name, "rival", None, None, None, note=str(error)))
    return rows


def _row(
    name: str,
    model: Model,
    logs: Sequence[Log],
    smooth: BandLimited,
    joint: int,
    scale: tuple[float, float],
    rng: np.random.Generator,
) -> LedgerRow:
    inverse, windows, whole, seconds, count = [], [], [], 0.0, 0
    for log in logs:
        signals = smooth.signals(log)
        command = model.inverse(signals.time, signals.motion, signals.command)
        inverse.append((signals.command - command)[:, 0])
        width = window_width(WINDOW, log.sample_time)
        started = clock.perf_counter()
        windows.append(np.concatenate([_free(model, log, signals, a, b) for a, b in _parts(signals, width)]))
        seconds += clock.perf_counter() - started
        count += len(windows[-1])
        whole.append(_free(model, log, signals, 0, len(signals)))
    error = bounded(np.concatenate(windows))
    bounds = np.cumsum([0, *map(len, windows)])
    blocks = in_blocks(error, bounds, window_width(WINDOW, logs[0].sample_time))
    parts, rest, note = simulated(error, bounded(np.concatenate(whole)))
    return LedgerRow(
        joint=joint,
        step=name,
        role="rival",
        inverse_error=rms(np.concatenate(inverse)),
        window_error=parts,
        whole_error=rest,
        interval=None if parts is None else quantiles(resampled(blocks[None], rng)[0]),
        closed=None if parts is None else closed(parts, *scale),
        microseconds=1e6 * seconds / max(count, 1),
        note=note,
    )


def _parts(signals: Signals, width: int) -> list[tuple[int, int]]:
    edges = [*range(0, len(signals) - width + 1, width)]
    return list(pairwise([*edges, edges[-1] + width])) if edges else [(0, len(signals))]


def _free(model: Model, log: Log, signals: Signals, start: int, stop: int) -> Array:
    """Reading minus free simulation over samples start..stop-1 of the signals, (N,)."""
    rows = slice(signals.start + start, signals.start + stop)
    motion = model.simulate(log.time[rows], log.command[rows], signals.motion.state(start), log.facts[0].hold)
    error: Array = log.position[rows, 0] - motion.position[:, 0]
    return error
