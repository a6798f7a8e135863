"""The interactive page: one HTML file with its data, styles and code inside, that needs no network.

Figures are computed here, the same that stand in the tables; the page only selects, sorts and draws. Numbers keep five
significant digits, infinite ones are written as text because JSON has none.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from benchmarks.leaderboard.results import OK, PROVENANCE, Results
from benchmarks.leaderboard.standings import QUESTIONS, Leaderboard, Standing, baseline, pooled_scores
from benchmarks.leaderboard.summary import cell, curve, losses, metrics_of, naming, noise_floors
from benchmarks.leaderboard.tables import Table, published_table
from benchmarks.statistics import Array, Estimate, task_weights, wins
from benchmarks.yardstick import METRICS
from diagnosis.quantities import number


@dataclass(frozen=True)
class Headline:
    """The page's first sentences and its counts."""

    lead: str
    counts: tuple[tuple[str, str], ...]


def render(results: Results, boards: Sequence[Leaderboard], tables: Sequence[Table]) -> str:
    """The page as HTML; `tables` are shown where a browser runs no scripts."""
    place = files("benchmarks") / "leaderboard" / "templates"
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string((place / "report.html.j2").read_text("utf-8"))
    return template.render(
        headline=headline(results, boards),
        style=Markup((place / "report.css").read_text("utf-8")),
        code=Markup("\n".join((place / name).read_text("utf-8") for name in ("drawing.js", "report.js"))),
        data=Markup(embedded(page_data(results, boards))),
        tables=tables,
        provenance=results.provenance,
        provenance_columns=PROVENANCE,
        metrics=METRICS.values(),
        losses=losses(results),
        published=published_table(results),
        naming=bool(naming(results)),
    )


def headline(results: Results, boards: Sequence[Leaderboard]) -> Headline:
    """Who leads, and what stands behind it."""
    sentences = []
    for board in boards:
        if board.group == "all":
            free = [item for item in board.standings if not results.contestants[item.contestant].role]
            if free:
                sentences.append(_leader(results, board, free))
    status = results.frame["status"].astype(str)
    counts = (
        ("contestants", str(len(results.contestants))),
        ("tasks", str(len(results.tasks))),
        ("seeds", str(len(results.seeds))),
        ("runs", str(len(results.frame))),
        ("failed", str(int(np.sum(results.failed)))),
        ("skipped", str(int(np.sum(status == "skipped")))),
    )
    return Headline(" ".join(sentences) or "No task has a constant predictor to measure others by.", counts)


def _leader(results: Results, board: Leaderboard, standings: Sequence[Standing]) -> str:
    question = board.question.title.partition(":")[0]
    first, *others = ((results.contestants[item.contestant].name, _with_interval(item.score)) for item in standings[:2])
    before = f", before {others[0][0]} with {others[0][1]}" if others else ""
    return f"{question}, {len(board.tasks)} tasks: {first[0]} leads with a score of {first[1]}{before}."


def _with_interval(score: Estimate) -> str:
    interval = score.interval
    between = f" [{number(interval[0])} – {number(interval[1])}]" if interval is not None else ""
    return number(score.value) + between


def page_data(results: Results, boards: Sequence[Leaderboard]) -> dict[str, Any]:
    """Everything that the page's code draws."""
    return {
        "contestants": [
            {"name": c.name, "key": c.key, "role": c.role, "tags": [tag for tag in c.tags if tag != c.role]}
            for c in results.contestants
        ],
        "tasks": [_task(results, t) for t in range(len(results.tasks))],
        "metrics": {name: asdict(metric) for name, metric in METRICS.items()},
        "questions": [asdict(question) for question in QUESTIONS],
        "baseline": baseline(results),
        "boards": [_board(board) for board in boards],
        "scores": {question.name: _task_scores(pooled_scores(results, question)) for question in QUESTIONS},
        "wins": {question.name: _wins(results.errors(question.metric)) for question in QUESTIONS},
        "naming": [asdict(item) for item in naming(results)],
        "runs": _runs(results),
        "provenance": {"columns": PROVENANCE, "makers": results.provenance},
    }


def embedded(data: Any) -> str:
    """JSON that can stand inside a script element."""
    text = json.dumps(_compact(data), ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _task(results: Results, t: int) -> dict[str, Any]:
    task, metrics = results.tasks[t], metrics_of(results, t)
    present = [m for m in range(len(results.contestants)) if np.any(results.rows[m, t] >= 0)]
    curves = {m: curve(results, m, t) for m in present}
    cells = {
        m: {name: [c.median, c.low, c.high] for name in metrics if (c := cell(results, name, m, t)) and c.finished}
        for m in present
    }
    return {
        "name": task.name,
        "title": task.title,
        "tags": task.tags,
        "metrics": metrics,
        "units": {name: results.unit(name, t) for name in metrics},
        "floors": noise_floors(results, t),
        "published": [asdict(item) for item in task.published],
        "cells": {m: {name: c for name, c in row.items() if not math.isnan(c[0])} for m, row in cells.items()},
        "lost": {
            m: [int(np.sum(results.failed[m, t])), int(np.sum(results.status[m, t] == "skipped"))] for m in present
        },
        "runs": {m: [int(row) for row in results.rows[m, t] if row >= 0] for m in present},
        "curves": {m: asdict(c) for m, c in curves.items() if c is not None},
    }


def _board(board: Leaderboard) -> dict[str, Any]:
    return {
        "question": board.question.name,
        "group": board.group,
        "tasks": board.tasks,
        "left_out": board.left_out,
        "without_noise_floor": board.without_noise_floor,
        "standings": [
            asdict(item) | {name: _estimate(getattr(item, name)) for name in ("score", "rank", "improvement")}
            for item in board.standings
        ],
    }


def _estimate(item: Estimate) -> list[float | None]:
    low, high = item.interval if item.interval is not None else (None, None)
    return [item.value, low, high]


def _task_scores(scores: Array) -> list[list[float]]:
    """Mean score over seeds by contestant and task."""
    known = ~np.isnan(scores)
    count = np.sum(known, axis=2)
    mean = np.divide(np.nansum(scores, axis=2), count, out=np.full(count.shape, np.nan), where=count > 0)
    return mean.tolist()


def _wins(errors: Array) -> list[list[float]]:
    """Chance that the row's contestant beats the column's on the same task and seed."""
    merit = -errors
    return [[_mean(wins(first, second)) for second in merit] for first in merit]


def _mean(values: Array) -> float:
    weights = task_weights(values)
    return float(np.nansum(values * weights) / np.sum(weights)) if np.any(weights) else float("nan")


def _runs(results: Results) -> dict[str, list[Any]]:
    """The rows of the table, column by column, as far as a reader may ask for them."""
    frame = results.frame
    makers = {maker: k for k, maker in enumerate(results.provenance)}
    done = (frame["status"] == OK).to_numpy()
    figures = {
        name: [value if ok else float("nan") for value, ok in zip(frame[name].astype(float), done, strict=True)]
        for name in METRICS
        if name in frame.columns
    }
    return {
        "seed": [int(seed) for seed in frame["seed"]],
        "status": frame["status"].astype(str).tolist(),
        "reason": [results.text(row, "reason") for row in range(len(frame))],
        "fingerprint": [str(mark)[:16] for mark in frame["fingerprint"]],
        "maker": [makers[maker] for maker in results.maker],
    } | figures


def _compact(value: Any) -> Any:
    """Plain data with five digits: NaN becomes null, an infinite number the text ``inf``."""
    if isinstance(value, bool) or value is None or isinstance(value, str | int):
        return value
    if isinstance(value, float | np.floating):
        if math.isnan(value):
            return None
        return "inf" if math.isinf(value) else float(f"{value:.5g}")
    if isinstance(value, dict):
        return {str(key): _compact(item) for key, item in value.items()}
    if isinstance(value, Iterable):
        return [_compact(item) for item in value]
    return str(value)
