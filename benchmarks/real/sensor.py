"""The error that the true model would have in windows of free simulation: rounding of the encoder alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.real.windowed import Model, errors, score, windows
from envs.log import Array, Log


def sensor_floor(logs: Sequence[Log], joints: tuple[int, ...], model: Model, seconds: float, *, pair: bool) -> Array:
    """Rms window error per joint, (n,), of a model on recordings that it made itself, read by the rig's encoder.

    Each log is simulated as a whole, rounded to the encoder's steps, cut into windows and simulated anew from the
    states that these readings give.
    """
    made = []
    for log in logs:
        whole = windows([log], joints, None, pair=pair)
        columns = [log.index(joint) for joint in joints]
        position = log.position.copy()
        for column, j in zip(columns, range(len(joints)), strict=True):
            step = log.facts[column].encoder_step or 0.0
            true = whole.reading[:, j] - errors(whole, model)[0][:, j]
            position[:, column] = step * np.round(true / step) if step else true
        made.append(replace(log, position=position))
    return score(windows(made, joints, seconds, pair=pair), model)
