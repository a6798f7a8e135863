"""Columns of the single-joint regressor, equations (4) and (20): v = Y(q, q', q'', q''') a.

The paper's joint 1 has Y = [q''' q'' q']. A joint that gravity loads (joint 3, vertical) needs a constant column. What
the paper leaves to its compensator, dry friction, is offered as a column for the textbook method beside it.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from envs.log import Array, JointFacts
from methods.base import MethodError, Motion

ColumnName = Literal["jerk", "acceleration", "velocity", "constant", "coulomb", "position", "sine", "cosine"]
"""jerk q''', acceleration q'', velocity q', constant 1 (gravity and offset), coulomb tanh(q'/reversal_velocity),
position q (a spring), sine sin q and cosine cos q (gravity on a hinge that is not vertical)."""

COLUMN_ORDER: tuple[ColumnName, ...] = get_args(ColumnName)
HORIZONTAL: tuple[ColumnName, ...] = ("jerk", "acceleration", "velocity")
VERTICAL: tuple[ColumnName, ...] = (*HORIZONTAL, "constant")

_TIME_POWER: dict[ColumnName, int] = {"jerk": 3, "acceleration": 2, "velocity": 1, "position": 0}


def regressor(motion: Motion, columns: tuple[ColumnName, ...], reversal_velocity: float) -> Array:
    """Y, shape (T, p), for the single joint of `motion`, columns in the order given."""
    position, velocity = motion.position[:, 0], motion.velocity[:, 0]
    available: dict[ColumnName, Array] = {
        "jerk": motion.jerk[:, 0],
        "acceleration": motion.acceleration[:, 0],
        "velocity": velocity,
        "constant": np.ones(len(motion)),
        "coulomb": np.tanh(velocity / reversal_velocity),
        "position": position,
        "sine": np.sin(position),
        "cosine": np.cos(position),
    }
    return np.column_stack([available[name] for name in columns])


def check_columns(columns: tuple[ColumnName, ...]) -> None:
    """Raises MethodError when a column is unknown or stands twice, or none is given."""
    unknown = [name for name in columns if name not in COLUMN_ORDER]
    if unknown or not columns or len(set(columns)) != len(columns):
        problem = f"there is no regressor column {unknown[0]!r}" if unknown else f"the columns {columns} repeat or lack"
        raise MethodError(problem, remedy=f"Choose from {', '.join(COLUMN_ORDER)}, each once")


def column_unit(name: ColumnName, facts: JointFacts) -> str:
    """Unit of a column's coefficient, such as ``V s^2/rad``."""
    command = facts.command_unit
    power = _TIME_POWER.get(name)
    if power is None:
        return command
    times = "" if power == 0 else " s" if power == 1 else f" s^{power}"
    return f"{command}{times}/{facts.position_unit}"
