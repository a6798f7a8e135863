"""Medians over seeds, error against horizon, causes named, and runs that gave nothing."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

import numpy as np

from benchmarks.leaderboard.results import OK, SKIPPED, Results
from benchmarks.yardstick import METRICS


@dataclass(frozen=True)
class Cell:
    """A metric of one contestant on one task: median and range over its finished seeds, and how many runs there are."""

    median: float
    low: float
    high: float
    finished: int
    failed: int
    skipped: int


@dataclass(frozen=True)
class Curve:
    """Error of free runs against their horizon [s]: median and range over seeds."""

    horizon: tuple[float, ...]
    median: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True)
class Loss:
    """Runs that gave nothing for one reason; numbers in it are those of the first run. runs: of each contestant."""

    contestants: tuple[str, ...]
    status: str
    reason: str
    tasks: tuple[str, ...]
    runs: int


@dataclass(frozen=True)
class Naming:
    """What one contestant named on one task: how often each cause was named, and how often each outcome was judged."""

    contestant: str
    task: str
    runs: int
    named: tuple[tuple[str, int], ...]
    outcomes: tuple[tuple[str, int], ...]
    score: float


def cell(results: Results, metric: str, m: int, t: int) -> Cell:
    """Summary of a metric; NaN where no finished run has it."""
    status = results.status[m, t]
    values = results.column(metric)[m, t][status == OK]
    known = values[~np.isnan(values)]
    return Cell(
        median=float(np.median(known)) if known.size else float("nan"),
        low=float(np.min(known)) if known.size else float("nan"),
        high=float(np.max(known)) if known.size else float("nan"),
        finished=int(np.sum(status == OK)),
        failed=int(np.sum(results.failed[m, t])),
        skipped=int(np.sum(status == SKIPPED)),
    )


def metrics_of(results: Results, t: int) -> tuple[str, ...]:
    """Metrics that at least one finished run of a task has, in the yardstick's order."""
    done = results.status[:, t] == OK
    return tuple(name for name in METRICS if np.any(~np.isnan(results.column(name)[:, t][done])))


def noise_floors(results: Results, t: int) -> dict[str, float]:
    """Median over seeds of the errors that noise alone causes, by metric, where they are known."""
    found = {}
    for metric, kind in (("inverse_error", "inverse"), ("simulation_error", "simulation")):
        values = results.noise_floor(kind)[t]
        if np.any(~np.isnan(values)):
            found[metric] = float(np.median(values[~np.isnan(values)]))
    return found


def curve(results: Results, m: int, t: int) -> Curve | None:
    """Error against horizon of one contestant on one task, or None."""
    if "curve" not in results.frame.columns or "curve_horizons" not in results.frame.columns:
        return None
    rows = [int(row) for row in results.rows[m, t] if row >= 0 and results.frame["status"].iloc[row] == OK]
    pairs = [(results.frame["curve_horizons"].iloc[row], results.frame["curve"].iloc[row]) for row in rows]
    pairs = [(h, c) for h, c in pairs if h is not None and c is not None and len(c) and len(h) == len(c)]
    pairs = [(h, c) for h, c in pairs if len(h) == len(pairs[0][0])]
    if not pairs:
        return None
    values = np.array([np.asarray(c, float) for _, c in pairs])
    return Curve(
        horizon=tuple(float(h) for h in pairs[0][0]),
        median=tuple(float(v) for v in np.median(values, axis=0)),
        low=tuple(float(v) for v in np.min(values, axis=0)),
        high=tuple(float(v) for v in np.max(values, axis=0)),
    )


def losses(results: Results) -> tuple[Loss, ...]:
    """Every run that is not finished, failures first; contestants that lost the same runs for one reason together."""
    found: dict[tuple[str, str, str], list[tuple[str, str]]] = {}
    for m, contestant in enumerate(results.contestants):
        for t, task in enumerate(results.tasks):
            for row in results.rows[m, t]:
                status = "" if row < 0 else str(results.frame["status"].iloc[row])
                if status not in ("", OK):
                    reason = results.text(int(row), "reason") or "no reason was given"
                    key = (contestant.name, status, re.sub(r"\d+", "0", reason))
                    found.setdefault(key, []).append((task.name, reason))
    alike: dict[tuple[str, str, tuple[str, ...], int], tuple[list[str], str]] = {}
    for (name, status, pattern), lost in found.items():
        tasks = tuple(sorted({task for task, _ in lost}))
        alike.setdefault((status, pattern, tasks, len(lost)), ([], lost[0][1]))[0].append(name)
    gathered = [
        Loss(tuple(names), status, reason, tasks, runs) for (status, _, tasks, runs), (names, reason) in alike.items()
    ]
    return tuple(sorted(gathered, key=lambda item: (item.status == SKIPPED, item.contestants, item.reason)))


def naming(results: Results) -> tuple[Naming, ...]:
    """What was named where, for contestants that name causes on tasks that judge it."""
    if "naming" not in results.frame.columns:
        return ()
    scores, found = results.column("naming"), []
    for m, contestant in enumerate(results.contestants):
        for t, task in enumerate(results.tasks):
            rows = [int(row) for row in results.rows[m, t][~np.isnan(scores[m, t])]]
            if rows:
                causes = Counter(cause for row in rows for cause in _causes(results.text(row, "named")))
                outcomes = Counter(results.text(row, "naming_outcome") for row in rows)
                score = float(np.nanmean(scores[m, t]))
                found.append(Naming(contestant.name, task.name, len(rows), _sorted(causes), _sorted(outcomes), score))
    return tuple(found)


def _causes(named: str) -> set[str]:
    """Effects in ``coulomb_friction@1+dead_zone@1`` without their joints; ``nothing`` for none."""
    return {cause.partition("@")[0] for cause in named.split("+") if cause} or {"nothing"}


def _sorted(counter: Counter[str]) -> tuple[tuple[str, int], ...]:
    return tuple(sorted(counter.items()))
