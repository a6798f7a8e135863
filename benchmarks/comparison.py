"""Fresh runs against the runs of a reference: what moved, and whether it moved further than it may."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchmarks import tolerance
from benchmarks.reference import COMPARED, SECONDS, Run, Trial
from benchmarks.yardstick import METRICS

Verdict = Literal["regression", "better", "same", "not compared"]
Key = tuple[str, str, str]
"""Task, method, metric."""
Series = dict[Key, dict[int, float]]
"""Values by seed, on the scale on which they are compared."""
ALL_TASKS = "all tasks"
SKIPPED = "skipped"
SHARES = ("interval_coverage", "naming")
"""Metrics from 0 to 1, compared as they are; all others are errors, compared as ratios."""
SLOWER = 5.0
"""Factor by which a method's share of the fitting time may grow, and the least growth that counts [s]."""
SECONDS_THAT_COUNT = 2.0


@dataclass(frozen=True)
class Finding:
    """One comparison. now, before: geometric means of errors, means of shares, over the seeds that were compared.

    change, allowed: factors for errors, differences for shares; NaN where something else was compared.
    """

    verdict: Verdict
    task: str
    method: str
    metric: str
    now: float = float("nan")
    before: float = float("nan")
    change: float = float("nan")
    allowed: float = float("nan")
    basis: str = ""
    note: str = ""


def compare(fresh: Sequence[Run], reference: Sequence[Run], absent: Mapping[str, str]) -> list[Finding]:
    """All findings, by method and task.

    Runs on seeds that the reference knows are compared one by one; with other seeds, distributions are compared.
    absent: tasks that cannot be had here, with the reason.
    """
    known = {(run.task, run.method) for run in reference}
    found = [Finding("not compared", task, "", "", note=reason) for task, reason in sorted(absent.items())]
    methods = {method for _, method in known}
    strange = {(run.task, run.method) for run in fresh} - known
    strange = {(task if method in methods else ALL_TASKS, method) for task, method in strange}
    found += [
        Finding("not compared", task, method, "", note="not in the reference") for task, method in sorted(strange)
    ]
    here = [run for run in fresh if run.task not in absent and (run.task, run.method) in known]
    asked = {(run.task, run.method) for run in here}
    before = [run for run in reference if (run.task, run.method) in asked]
    same = {run.seed for run in here} <= {run.seed for run in before if run.trial == "run"}
    found += _lost_on_same_seeds(here, before) if same else _lost_on_other_seeds(here, before)
    found += _moved(here, before, same=same)
    found += _slower(here, before)
    return sorted(found, key=lambda item: (item.method, item.task == ALL_TASKS, item.task, item.metric))


def series(runs: Iterable[Run], trial: Trial) -> Series:
    """Finite values by task, method and metric, and their means over tasks under ALL_TASKS."""
    found: Series = {}
    for run in runs:
        if run.trial == trial:
            for name in COMPARED:
                if name in run.figures and math.isfinite(run.figures[name]):
                    found.setdefault((run.task, run.method, name), {})[run.seed] = _scaled(name, run.figures[name])
    return found


def pooled(values: Series, tasks: Mapping[tuple[str, str], Sequence[str]]) -> Series:
    """Means over the given tasks by method and metric, for the seeds that all of them have."""
    found: Series = {}
    for (method, metric), names in tasks.items():
        parts = [values.get((task, method, metric), {}) for task in names]
        seeds = set.intersection(*(set(part) for part in parts)) if parts else set()
        if len(parts) > 1 and seeds:
            found[ALL_TASKS, method, metric] = {
                seed: float(np.mean([part[seed] for part in parts])) for seed in sorted(seeds)
            }
    return found


def _moved(fresh: Sequence[Run], reference: Sequence[Run], *, same: bool) -> list[Finding]:
    now, before, rounded = series(fresh, "run"), series(reference, "run"), series(reference, "rounding")
    tasks: dict[tuple[str, str], list[str]] = {}
    for task, method, metric in sorted(set(now) & set(before)):
        tasks.setdefault((method, metric), []).append(task)
    now, before, rounded = (values | pooled(values, tasks) for values in (now, before, rounded))
    keys = sorted(set(now) & set(before))
    alpha = tolerance.FALSE_ALARMS / max(len(keys), 1)
    return [
        item
        for key in keys
        if (item := _judged(key, now[key], before[key], rounded.get(key, {}), alpha, same, len(tasks[key[1:]])))
    ]


def _judged(
    key: Key,
    now: Mapping[int, float],
    before: Mapping[int, float],
    rounded: Mapping[int, float],
    alpha: float,
    same: bool,
    tasks: int,
) -> Finding | None:
    """A comparison of one series; None when there is too little to compare."""
    task, method, metric = key
    values = np.array([before[seed] for seed in sorted(before)])
    share, sign = metric in SHARES, 1.0 if METRICS[metric].better == "lower" else -1.0
    if same:
        seeds = tolerance.shared(now, before)
        if not seeds:
            return None
        own, theirs = (np.array([part[seed] for seed in seeds]) for part in (now, before))
        changes = np.array([rounded[seed] - before[seed] for seed in tolerance.shared(rounded, before)])
        allowed = float(np.max(np.abs(changes), initial=0.0)) + 1e-9 if share else tolerance.for_same_seeds(changes)
        if not share and len(values) >= tolerance.FEWEST_SEEDS and allowed > tolerance.STEADY:
            allowed = min(allowed, max(tolerance.STEADY, tolerance.for_other_seeds(values, len(seeds), alpha)))
        beyond_all = True
    else:
        if len(values) < tolerance.FEWEST_SEEDS or (share and task != ALL_TASKS):
            return None
        own, theirs = np.array(list(now.values())), values
        least = tolerance.share_deviation(values, tasks) if share else 0.0
        allowed = max(tolerance.for_other_seeds(values, len(own), alpha, least), 1e-9 if share else tolerance.STEADY)
        beyond_all = share or sign * float(np.mean(own)) > float(np.max(sign * values))
    change = sign * float(np.mean(own) - np.mean(theirs))
    verdict: Verdict = "regression" if change > allowed and beyond_all else "better" if -change > allowed else "same"
    basis = "same seeds" if same else "other seeds"
    shown = [_shown(metric, float(np.mean(part))) for part in (own, theirs)]
    limits = (sign * change, sign * allowed) if share else (math.exp(change), math.exp(allowed))
    return Finding(verdict, task, method, metric, shown[0], shown[1], limits[0], limits[1], basis)


def _lost_on_same_seeds(fresh: Sequence[Run], reference: Sequence[Run]) -> list[Finding]:
    """Runs that gave a figure in the reference and give none now."""
    before = {(run.task, run.method, run.seed): run for run in reference if run.trial == "run"}
    shaky = _shaky(reference)
    found: dict[tuple[str, str], Finding] = {}
    for run in fresh:
        old = before.get((run.task, run.method, run.seed))
        if old is None:
            continue
        what, why = _lost(run)
        if what and not _lost(old)[0] and old.status == "ok":
            verdict: Verdict = "same" if (run.task, run.method) in shaky else "regression"
            found.setdefault(
                (run.task, run.method),
                Finding(verdict, run.task, run.method, what, basis="same seeds", note=f"seed {run.seed}: {why}"),
            )
        elif not what and _lost(old)[0]:
            note = f"seed {run.seed} gives figures; before: {_lost(old)[1]}"
            found.setdefault((run.task, run.method), Finding("better", run.task, run.method, "status", note=note))
    return list(found.values())


def _lost_on_other_seeds(fresh: Sequence[Run], reference: Sequence[Run]) -> list[Finding]:
    """Methods that lose more of their runs than before."""
    tried = {(run.task, run.method) for run in reference if run.trial == "run" and run.status != SKIPPED}
    found, methods = [], sorted({method for _, method in tried})
    for method in methods:
        own = [run for run in fresh if run.method == method and (run.task, method) in tried]
        old = [run for run in reference if run.method == method and run.trial == "run" and (run.task, method) in tried]
        lost, lost_before = ([run for run in runs if _lost(run)[0]] for runs in (own, old))
        if lost:
            chance = tolerance.chance_of_losses(len(lost), len(own), len(lost_before), len(old))
            first = f"the first on {lost[0].task}, seed {lost[0].seed}: {_lost(lost[0])[1]}"
            note = f"{len(lost)} of {len(own)} runs, before {len(lost_before)} of {len(old)}; {first}"
            verdict: Verdict = "regression" if chance < tolerance.FALSE_ALARMS / len(methods) else "same"
            found.append(Finding(verdict, ALL_TASKS, method, "status", basis="other seeds", note=note))
    return found


def _shaky(reference: Sequence[Run]) -> set[tuple[str, str]]:
    """Tasks and methods where rounding alone decided whether a run is lost."""
    first = {(run.task, run.method, run.seed): _lost(run)[0] for run in reference if run.trial == "run"}
    return {
        (run.task, run.method)
        for run in reference
        if run.trial == "rounding" and _lost(run)[0] != first.get((run.task, run.method, run.seed), _lost(run)[0])
    }


def _lost(run: Run) -> tuple[str, str]:
    """What a run lost and why; two empty texts when nothing is lost."""
    if run.status != "ok":
        return "status", f"{run.status.replace('_', ' ')}: {run.reason}"
    infinite = [name for name, value in run.figures.items() if math.isinf(value)]
    return (infinite[0], f"{METRICS[infinite[0]].title.lower()} is infinite") if infinite else ("", "")


def _slower(fresh: Sequence[Run], reference: Sequence[Run]) -> list[Finding]:
    """Methods whose fits take a much larger part of the whole run's time than before."""
    now, before = _seconds(fresh), _seconds([run for run in reference if run.trial == "run"])
    found = []
    for method in sorted(set(now) & set(before)):
        others = [other for other in sorted(set(now) & set(before)) if other != method]
        cells = set(now[method]) & set(before[method])
        rest = {other: set(now[other]) & set(before[other]) for other in others}
        if not cells or not any(rest.values()):
            continue
        own, old = (sum(part[method][cell] for cell in cells) for part in (now, before))
        all_own, all_old = (sum(part[o][cell] for o, both in rest.items() for cell in both) for part in (now, before))
        if min(own, old, all_own, all_old) > 0.0:
            speed = all_own / all_old
            factor = own / old / speed
            if factor > SLOWER and own - old * speed > SECONDS_THAT_COUNT:
                note = f"fits take {factor:.1f} times as long beside the other methods of the same run"
                found.append(
                    Finding("regression", ALL_TASKS, method, SECONDS, own, old, factor, SLOWER, "same run", note)
                )
    return found


def _seconds(runs: Sequence[Run]) -> dict[str, dict[str, float]]:
    """Mean time of a fit by method and task."""
    found: dict[str, dict[str, list[float]]] = {}
    for run in runs:
        if SECONDS in run.figures:
            found.setdefault(run.method, {}).setdefault(run.task, []).append(run.figures[SECONDS])
    return {method: {task: float(np.mean(v)) for task, v in tasks.items()} for method, tasks in found.items()}


def _scaled(metric: str, value: float) -> float:
    return value if metric in SHARES else math.log(value + tolerance.RESOLUTION)


def _shown(metric: str, value: float) -> float:
    return value if metric in SHARES else max(math.exp(value) - tolerance.RESOLUTION, 0.0)
