"""Is a log usable? Errors stop (LogError: one line with place and remedy); findings are reported and kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from envs.log import PREFIX_OF, Array, Log, LogError

#: Fewer samples than this cannot carry an experiment.
MINIMUM_SAMPLES = 16


@dataclass(frozen=True)
class Finding:
    """Something worth saying about a log that does not make it unusable. `kind` is stable, `text` is for people."""

    kind: str
    text: str


def columns_of(log: Log) -> dict[str, Array]:
    """The signals of a log by their standard column names, each of shape (T,)."""
    columns: dict[str, Array] = {"t": log.time}
    for column, joint in enumerate(log.joints):
        columns[f"{PREFIX_OF[log.facts[column].input]}{joint}"] = log.command[:, column]
        columns[f"q{joint}"] = log.position[:, column]
        if log.velocity is not None:
            columns[f"dq{joint}"] = log.velocity[:, column]
        if log.temperature is not None:
            columns[f"temp{joint}"] = log.temperature[:, column]
    return columns


def check(log: Log, names: Mapping[str, str] | None = None) -> tuple[Finding, ...]:
    """Raises LogError when the log is unusable, otherwise returns what is worth saying about it.

    `names` gives the file's own name of a standard column, for the messages.
    """
    spoken = dict(names or {})
    if len(log) < MINIMUM_SAMPLES:
        raise LogError(
            f"{len(log)} samples are too few, at least {MINIMUM_SAMPLES} are needed",
            remedy="Record for longer",
            source=log.source,
        )
    for name, values in columns_of(log).items():
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise LogError(
                f"{len(bad)} of {len(values)} values are missing or not finite",
                remedy="Remove these rows or load the file with repair",
                source=log.source,
                column=spoken.get(name, name),
                row=int(bad[0]) + 1,
            )
    backwards = np.flatnonzero(np.diff(log.time) <= 0)
    if len(backwards):
        raise LogError(
            f"time does not increase in {len(backwards)} places",
            remedy="Sort the rows and remove double ones, or load the file with repair",
            source=log.source,
            column=spoken.get("t", "t"),
            row=int(backwards[0]) + 2,
        )
    return ()
