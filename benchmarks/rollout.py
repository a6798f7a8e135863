"""MuJoCo's batched simulation as a thing to time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np

from envs.log import Array


def rollout(model: Any, control: Array, position: Array, threads: int = 1) -> Callable[[], None]:
    """A function that simulates `control` (B, T, nu) from rest at `position` (nq,), on so many threads.

    It keeps every state in memory that was allocated before.
    """
    data = [mujoco.MjData(model) for _ in range(threads)]
    data[0].qpos[:] = position
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.zeros((len(control), mujoco.mj_stateSize(model, kind)))
    mujoco.mj_getState(model, data[0], initial[0], kind)
    initial[:] = initial[0]
    states = np.zeros((*control.shape[:2], initial.shape[1]))
    pool = mujoco.rollout.Rollout(nthread=threads if threads > 1 else 0)

    def run() -> None:
        pool.rollout(model, data, initial, control, state=states)

    return run


def seconds(run: Callable[[], None]) -> float:
    """Wall time of one run [s]."""
    begin = time.perf_counter()
    run()
    return time.perf_counter() - begin
