"""Standings: one pooled figure per contestant with its interval, for a question and a group of tasks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.leaderboard.results import CEILING_TAG, FLOOR_TAG, OK, SKIPPED, Results
from benchmarks.statistics import Array, Estimate, Resampling, normalised_score, ranks

BASELINE = "least_squares"
"""Label of the contestant that the others are compared with: the paper's equations as printed."""


@dataclass(frozen=True)
class Question:
    """What a leaderboard ranks by: a metric of the yardstick and the noise floor that belongs to it."""

    name: str
    title: str
    metric: str
    noise_floor: str


QUESTIONS = (
    Question("inverse", "Inverse model: command from motion", "inverse_error", "inverse"),
    Question("simulation", "Free simulation: motion from command", "simulation_error", "simulation"),
)


@dataclass(frozen=True)
class Standing:
    """One line of a leaderboard. Indices are those of `Results.contestants`.

    score: interquartile mean of the normalised score (0 the constant predictor, 1 the noise floor). rank: mean rank on
    single runs. improvement: chance to beat the baseline on the same task and seed. tasks, runs: that count here.
    """

    contestant: int
    score: Estimate
    rank: Estimate
    improvement: Estimate
    tasks: int
    runs: int
    failed: int
    skipped: int
    fit_seconds: float
    step_microseconds: float
    parameter_count: float


@dataclass(frozen=True)
class Leaderboard:
    """Best first. tasks: that can be pooled; left_out: names of those where nothing can be gained or the floor is
    missing; without_noise_floor: those that are measured against the ceiling or the best contestant instead."""

    question: Question
    group: str
    standings: tuple[Standing, ...]
    baseline: int | None
    tasks: tuple[int, ...]
    left_out: tuple[str, ...]
    without_noise_floor: tuple[str, ...]


def leaderboard(results: Results, question: Question, tag: str | None, rng: np.random.Generator) -> Leaderboard:
    """The standings on all tasks with a tag; None takes all tasks."""
    scores = pooled_scores(results, question)
    group = results.group(tag)
    tasks = np.array([t for t in group if np.any(~np.isnan(scores[:, t]))], dtype=int)
    scores, errors = scores[:, tasks], results.errors(question.metric)[:, tasks]
    taking_part = [m for m in range(len(results.contestants)) if np.any(~np.isnan(scores[m]))]
    base = baseline(results)
    standings = []
    if taking_part:
        merit = -np.where(np.isnan(scores), np.nan, errors)
        resampling = Resampling.of(np.any(~np.isnan(scores), axis=0), rng)
        places = ranks([merit[m] for m in taking_part])
        for place, m in zip(places, taking_part, strict=True):
            there = ~np.isnan(scores[m])
            improvement = (
                Estimate(np.nan, None)
                if base is None or base == m
                else resampling.probability_of_improvement(merit[m], merit[base])
            )
            standings.append(
                Standing(
                    contestant=m,
                    score=resampling.interquartile_mean(scores[m]),
                    rank=resampling.mean(place),
                    improvement=improvement,
                    tasks=int(np.sum(np.any(there, axis=1))),
                    runs=int(np.sum(there)),
                    failed=int(np.sum(results.failed[m][group])),
                    skipped=int(np.sum(results.status[m][group] == SKIPPED)),
                    fit_seconds=_middle(results, "fit_seconds", m, tasks),
                    step_microseconds=_middle(results, "step_microseconds", m, tasks),
                    parameter_count=_middle(results, "parameter_count", m, tasks),
                )
            )
    standings.sort(key=lambda item: (-item.score.value, item.rank.value, results.contestants[item.contestant].name))
    floor = results.noise_floor(question.noise_floor)
    return Leaderboard(
        question=question,
        group=tag or "all",
        standings=tuple(standings),
        baseline=base,
        tasks=tuple(int(t) for t in tasks),
        left_out=tuple(results.tasks[t].name for t in group if t not in tasks),
        without_noise_floor=tuple(results.tasks[t].name for t in tasks if np.all(np.isnan(floor[t]))),
    )


def pooled_scores(results: Results, question: Question) -> Array:
    """Normalised scores (M, T, S); NaN where a run is missing or its task cannot be pooled.

    The scale of a task and seed runs from the constant predictor's error to the noise floor; where that is unknown, to
    the ceiling's error, and where there is no ceiling, to the least error of any contestant.
    """
    errors = results.errors(question.metric)
    worst = _of_role(results, errors, FLOOR_TAG)
    best = results.noise_floor(question.noise_floor)
    for substitute in (_of_role(results, errors, CEILING_TAG), _least(errors)):
        best = np.where(np.isnan(best), substitute, best)
    return np.stack([normalised_score(error, worst, best) for error in errors])


def baseline(results: Results) -> int | None:
    """Index of the contestant that others are compared with, or None."""
    labels = [contestant.label for contestant in results.contestants]
    return labels.index(BASELINE) if BASELINE in labels else None


def groups(results: Results) -> tuple[str | None, ...]:
    """None for all tasks, then every tag that at least one but not every task carries, alphabetically."""
    tags = sorted({tag for task in results.tasks for tag in task.tags})
    return (None, *(tag for tag in tags if 0 < len(results.group(tag)) < len(results.tasks)))


def _of_role(results: Results, errors: Array, role: str) -> Array:
    """Errors (T, S) of the contestant with a role; a seed that it lacks takes the median over its others."""
    m = results.role(role)
    if m is None:
        return np.full(errors.shape[1:], np.nan)
    own = np.where(np.isfinite(errors[m]), errors[m], np.nan)
    return np.where(np.isnan(own), _median(own)[:, None], own)


def _least(errors: Array) -> Array:
    """Least finite error (T, S) of any contestant; NaN where there is none."""
    least = np.min(np.where(np.isfinite(errors), errors, np.inf), axis=0)
    return np.where(np.isfinite(least), least, np.nan)


def _median(values: Array) -> Array:
    """Median (T,) over the seeds that there are."""
    return np.array([np.median(row[~np.isnan(row)]) if np.any(~np.isnan(row)) else np.nan for row in values])


def _middle(results: Results, metric: str, m: int, tasks: Array) -> float:
    """Median of a metric over the finished runs of a contestant."""
    values = results.column(metric)[m][tasks][results.status[m][tasks] == OK]
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")
