"""Whether logs can be used at all: asked once, before any method begins, and answered in one line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.log import JointFacts, Log
from methods.base import MethodError, single_joint

SHORTEST = 64
"""Samples below which nothing can be learned from a log."""


def check_logs(logs: Sequence[Log]) -> tuple[int, ...]:
    """The joints of logs that belong together and that move.

    Raises MethodError for no log, for logs of different joints, inputs or units, for a log of less than `SHORTEST`
    samples, with samples that are no numbers, with a constant command or with a joint that stands still.
    """
    if not logs:
        raise MethodError("there is no log to fit", remedy="Give at least one log")
    first = logs[0]
    for log in logs:
        if log.joints != first.joints:
            raise MethodError(
                f"{log.name} holds the joints {list(log.joints)}, {first.name} {list(first.joints)}",
                remedy="Give logs of the same joints: log.select(joints)",
            )
        for a, b, joint in zip(log.facts, first.facts, log.joints, strict=True):
            if (a.input, a.position_unit) != (b.input, b.position_unit):
                raise MethodError(
                    f"joint {joint} is commanded by {b.input} over {b.position_unit} in {first.name}, by {a.input} "
                    f"over {a.position_unit} in {log.name}",
                    remedy="Fit logs of one kind at a time",
                )
        if len(log) < SHORTEST:
            raise MethodError(f"{log.name} has {len(log)} samples only", remedy=f"Record {SHORTEST} or more")
        for name, signal in (("command", log.command), ("position", log.position)):
            if not np.all(np.isfinite(signal)):
                raise MethodError(f"{log.name} has samples of {name} that are no numbers", remedy="Repair the log")
    for column, joint in enumerate(first.joints):
        if not any(np.ptp(log.command[:, column]) > 0.0 for log in logs):
            raise MethodError(f"the command of joint {joint} is constant", remedy="Give a log that excites the joint")
        if not any(np.ptp(log.position[:, column]) > 0.0 for log in logs):
            raise MethodError(f"joint {joint} never moves in these logs", remedy="Give a log in which it does")
    return first.joints


def check_joint(logs: Sequence[Log]) -> tuple[int, JointFacts]:
    """The joint of logs of one and the same joint, and its facts. Raises MethodError as `check_logs`."""
    joint = single_joint(logs)
    check_logs(logs)
    return joint, logs[0].facts[0]
