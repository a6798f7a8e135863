"""One yardstick for every contestant: how far its model is from a recorded log, inverse and forward.

The reference is the log itself, band-limited with zero phase; the same reference serves all contestants, whatever
signals they were fitted on. Forward errors are those of a free run from the first reference state, over the whole log
or over consecutive windows that each start from the reference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from envs.log import Array, Log
from methods.base import Model, Motion
from methods.differentiation import BandLimited, Differentiator, Signals


@dataclass(frozen=True)
class Errors:
    """Root mean square errors; infinite where the model has no answer.

    inverse [unit of the command], inverse_relative [1] as a share of the command's rms about its mean, position
    [rad or m], velocity, acceleration of the free run; `diverged` [s]: when the free run left the finite numbers.
    """

    inverse: float
    inverse_relative: float
    position: float
    velocity: float
    acceleration: float
    diverged: float | None


@dataclass(frozen=True, eq=False)
class Reference:
    """A log and its band-limited signals."""

    log: Log
    signals: Signals

    @staticmethod
    def of(log: Log, differentiator: Differentiator | None = None) -> Reference:
        """Raises MethodError when the log is too short for the differentiator (by default 30 Hz)."""
        return Reference(log, (differentiator or BandLimited()).signals(log))


def free_run(model: Model, reference: Reference, window: float | None = None) -> Motion:
    """The model's own motion (T, n) under the recorded command; with `window` [s] restarted that often."""
    signals, log = reference.signals, reference.log
    rows = len(signals)
    command = log.command[signals.start : signals.start + rows]
    length = rows if window is None else max(2, round(window / log.sample_time))
    pieces = [
        model.simulate(
            signals.time[at : at + length],
            command[at : at + length],
            signals.motion.state(at),
            log.facts[0].hold,
        )
        for at in range(0, rows, length)
    ]
    return Motion(
        *(
            np.concatenate([getattr(piece, name) for piece in pieces])
            for name in ("position", "velocity", "acceleration", "jerk")
        )
    )


def score(model: Model, reference: Reference, window: float | None = None) -> Errors:
    """Errors of a model on one log."""
    signals = reference.signals
    inverse = _rms(model.inverse(signals.time, signals.motion, signals.command) - signals.command)
    run = free_run(model, reference, window)
    lost = np.flatnonzero(~np.isfinite(run.position[:, 0]))
    return Errors(
        inverse=inverse,
        inverse_relative=inverse / float(np.std(signals.command)),
        position=_rms(run.position - signals.motion.position),
        velocity=_rms(run.velocity - signals.motion.velocity),
        acceleration=_rms(run.acceleration - signals.motion.acceleration),
        diverged=float(signals.time[lost[0]]) if len(lost) else None,
    )


def _rms(difference: Array) -> float:
    value = float(np.sqrt(np.mean(difference**2)))
    return value if np.isfinite(value) else float("inf")
