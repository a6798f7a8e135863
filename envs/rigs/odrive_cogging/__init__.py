"""The static cogging map of the ODrive rig, which is not a recording in time."""

from __future__ import annotations

import math

import numpy as np

from envs import data_sets
from envs.log import Array

COUNTS_PER_TURN = 8192


def cogging_map(name: str = "a_16") -> tuple[Array, Array]:
    """(position [rad], holding current [A]) of a static map, shape (n,) each, positions that were measured only.

    name: repetition and step, as in ``cogging_measure_final_a_16.npy``. Repetition ``c`` was taken after a restart that
    moved the zero by half a turn; ``rev`` and ``e_16r`` run backwards; ``iso`` is without the neighbouring motor.
    Raises DataSetError when the file is not on this machine.
    """
    currents: Array = np.load(data_sets.locate("odrive_cogging", f"coggingmap_0/cogging_measure_final_{name}.npy"))
    measured = np.flatnonzero(currents)
    return 2.0 * math.pi / COUNTS_PER_TURN * measured.astype(np.float64), currents[measured]
