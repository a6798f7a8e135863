"""The report's tables as CSV for programs, and as Markdown and LaTeX for people."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from benchmarks.leaderboard.results import Results
from benchmarks.leaderboard.standings import Leaderboard
from benchmarks.leaderboard.summary import Cell, Loss, Naming, cell, metrics_of, noise_floors
from benchmarks.statistics import Estimate
from benchmarks.yardstick import METRICS
from diagnosis.quantities import number, pretty_unit, scale_for

LATEX = str.maketrans(
    {
        "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}", "\\": r"\textbackslash{}", "−": r"$-$", "×": r"$\times$", "∞": r"$\infty$",
        "–": "--", "µ": r"$\mu$", "\u00a0": "~", "²": r"$^2$", "³": r"$^3$", "⁻": r"$^-$", "¹": r"$^1$", "⁰": r"$^0$",
        "⁴": r"$^4$", "⁵": r"$^5$", "⁶": r"$^6$", "⁷": r"$^7$", "⁸": r"$^8$", "⁹": r"$^9$", "<": r"\textless{}",
        ">": r"\textgreater{}", "|": r"\textbar{}",
    }
)  # fmt: skip

OURS, NOISE = "this benchmark", "measurement noise"
"""Sources of figures that nobody has published."""


@dataclass(frozen=True)
class Table:
    """Rows of text for people under a title; `data` are the same and more as plain values for programs."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    data_columns: tuple[str, ...]
    data: tuple[tuple[object, ...], ...]

    def csv(self) -> str:
        """Comma-separated values, one header line, six significant digits; empty cells are unknown."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self.data_columns)
        writer.writerows([[_plain(value) for value in row] for row in self.data])
        return buffer.getvalue()

    def markdown(self) -> str:
        """A Markdown table under its title."""
        lines = [f"**{self.title}**", "", _line(self.columns), _line("---" for _ in self.columns)]
        lines += [_line(value.replace("|", "\\|") for value in row) for row in self.rows]
        return "\n".join(lines) + "\n"

    def latex(self) -> str:
        """A LaTeX table that needs the package booktabs."""
        body = [" & ".join(value.translate(LATEX) for value in row) + r" \\" for row in self.rows]
        head = " & ".join(column.translate(LATEX) for column in self.columns) + r" \\"
        return "\n".join(
            [
                r"\begin{table}", r"\centering", rf"\caption{{{self.title.translate(LATEX)}}}",
                rf"\begin{{tabular}}{{l{'r' * (len(self.columns) - 1)}}}", r"\toprule", head, r"\midrule", *body,
                r"\bottomrule", r"\end{tabular}", r"\end{table}", "",
            ]
        )  # fmt: skip


def standings_table(results: Results, board: Leaderboard) -> Table:
    """One leaderboard."""
    base = None if board.baseline is None else results.contestants[board.baseline].name
    beats = "Beats the baseline" if base is None else f"Beats {base}"
    rows, data = [], []
    for place, item in enumerate(board.standings, start=1):
        contestant = results.contestants[item.contestant]
        rows.append(
            (
                str(place), _label(results, item.contestant), _estimate(item.score), _estimate(item.rank),
                _estimate(item.improvement), str(item.tasks), str(item.runs), str(item.failed), str(item.skipped),
                number(item.fit_seconds, 2), number(item.step_microseconds, 2), _count(item.parameter_count),
            )
        )  # fmt: skip
        data.append(
            (
                board.question.name, board.group, place, contestant.key, contestant.name, contestant.role,
                *_ends(item.score), *_ends(item.rank), *_ends(item.improvement), base or "",
                item.tasks, item.runs, item.failed, item.skipped, item.fit_seconds, item.step_microseconds,
                item.parameter_count,
            )
        )  # fmt: skip
    tasks = "1 task" if len(board.tasks) == 1 else f"{len(board.tasks)} tasks"
    return Table(
        name=f"standings_{board.question.name}_{board.group}",
        title=f"{board.question.title}, {tasks} ({board.group}): score 0 is the constant predictor, "
        "1 the noise floor; 95 % intervals over seeds",
        columns=(
            "", "Contestant", "Score", "Mean rank", beats, "Tasks", "Runs", "Failed", "Skipped", "Fit (s)",
            "Step (µs)", "Numbers",
        ),
        rows=tuple(rows),
        data_columns=(
            "question", "group", "place", "method", "name", "role", "score", "score_low", "score_high", "rank",
            "rank_low", "rank_high", "improvement", "improvement_low", "improvement_high", "baseline", "tasks", "runs",
            "failed", "skipped", "fit_seconds", "step_microseconds", "parameter_count",
        ),
        data=tuple(data),
    )  # fmt: skip


def task_table(results: Results, t: int) -> Table:
    """All contestants on one task: median over seeds, and the range where there are several."""
    task, metrics = results.tasks[t], metrics_of(results, t)
    floors = noise_floors(results, t)
    cells = {(name, m): cell(results, name, m, t) for name in metrics for m in _present(results, t)}
    scales = {
        name: _middle_scale([c.median for (own, _), c in cells.items() if own == name], results.unit(name, t))
        for name in metrics
    }
    rows, data = [], []
    for m in _present(results, t):
        contestant = results.contestants[m]
        counts = cell(results, "fit_seconds", m, t)
        rows.append((_label(results, m), *(_range(cells[name, m], scales[name][0]) for name in metrics), _runs(counts)))
        for name in metrics:
            one = cells[name, m]
            data.append(
                (
                    task.name, contestant.key, contestant.name, contestant.role, name, results.unit(name, t),
                    one.median, one.low, one.high, one.finished, one.failed, one.skipped, floors.get(name),
                )
            )  # fmt: skip
    floor_row = tuple(number(floors[n] * scales[n][0]) if n in floors else "" for n in metrics)
    rows.append(("noise floor" if floors else "noise floor (unknown)", *floor_row, ""))
    for item in task.published:
        rows.append(
            (
                f"{item.label} (published: {item.source})",
                *(number(item.value * scales[name][0]) if name == item.metric else "" for name in metrics),
                "",
            )
        )
    return Table(
        name=f"task_{task.name}",
        title=f"{task.title}: median over seeds [least – greatest]",
        columns=("Contestant", *(_heading(name, scales[name][1]) for name in metrics), "Runs"),
        rows=tuple(rows),
        data_columns=(
            "task", "method", "name", "role", "metric", "unit", "median", "low", "high", "finished", "failed",
            "skipped", "noise_floor",
        ),
        data=tuple(data),
    )  # fmt: skip


def losses_table(found: Sequence[Loss]) -> Table:
    """Runs that gave nothing, with their reasons."""
    rows = tuple(
        (", ".join(item.contestants), item.status, item.reason, ", ".join(item.tasks), str(item.runs)) for item in found
    )
    columns = ("Contestants", "Status", "Reason", "Tasks", "Runs of each")
    lower = tuple(column.lower().replace(" ", "_") for column in columns)
    return Table("failed_and_skipped", "Runs that gave nothing, and why", columns, rows, lower, rows)


def published_table(results: Results) -> Table:
    """Published figures, and ours on the same data."""
    rows, data = [], []
    for t, task in enumerate(results.tasks):
        for metric in dict.fromkeys(item.metric for item in task.published):
            unit = results.unit(metric, t)
            ours = {m: cell(results, metric, m, t).median for m in _present(results, t)}
            ours = {m: value for m, value in ours.items() if not math.isnan(value)}
            theirs = [(item.label, item.value, item.source) for item in task.published if item.metric == metric]
            lines = [*theirs, *((_label(results, m), value, OURS) for m, value in ours.items())]
            floor = noise_floors(results, t).get(metric)
            lines += [] if floor is None else [("noise floor", floor, NOISE)]
            factor, shown = _middle_scale([value for _, value, _ in theirs], unit)
            for label, value, source in sorted(lines, key=lambda line: line[1]):
                title = METRICS[metric].title
                rows.append((task.name, title, label, f"{number(value * factor)} {pretty_unit(shown)}".strip(), source))
                data.append((task.name, metric, label, value, unit, source))
    return Table(
        "published",
        "Published figures and ours on the same data, best first",
        ("Task", "Metric", "Method", "Value", "Source"),
        tuple(rows),
        ("task", "metric", "method", "value", "unit", "source"),
        tuple(data),
    )


def naming_table(found: Sequence[Naming]) -> Table:
    """What was named, task by task."""
    rows = tuple(
        (
            item.contestant,
            item.task,
            str(item.runs),
            number(item.score, 2),
            ", ".join(f"{cause} {count}×" for cause, count in item.named),
            ", ".join(f"{outcome} {count}×" for outcome, count in item.outcomes),
        )
        for item in found
    )
    columns = ("Contestant", "Task", "Runs", "Score", "Named", "Judged")
    return Table("naming", "Causes that were named", columns, rows, tuple(c.lower() for c in columns), rows)


def _present(results: Results, t: int) -> list[int]:
    """Contestants that have a row on a task: floor first, then alphabetically, the ceiling last."""
    there = [m for m in range(len(results.contestants)) if (results.rows[m, t] >= 0).any()]
    order = {"floor": 0, "": 1, "ceiling": 2}
    return sorted(there, key=lambda m: order[results.contestants[m].role])


def _label(results: Results, m: int) -> str:
    """A contestant's name, and its role behind it."""
    contestant = results.contestants[m]
    return f"{contestant.name} ({contestant.role})" if contestant.role else contestant.name


def _middle_scale(values: Sequence[float], unit: str) -> tuple[float, str]:
    """Factor and unit in which the middle one of the finite values has one to three digits before the point."""
    known = sorted(value for value in values if math.isfinite(value) and value > 0.0)
    return scale_for(known[len(known) // 2 :][:1], unit)


def _heading(metric: str, unit: str) -> str:
    shown = pretty_unit(unit)
    return f"{METRICS[metric].title} ({shown})" if shown else METRICS[metric].title


def _estimate(item: Estimate) -> str:
    if math.isnan(item.value):
        return "–"
    if item.interval is None:
        return number(item.value)
    return f"{number(item.value)} [{number(item.interval[0])} – {number(item.interval[1])}]"


def _ends(item: Estimate) -> tuple[float, float | None, float | None]:
    low, high = item.interval if item.interval is not None else (None, None)
    return item.value, low, high


def _range(item: Cell, factor: float) -> str:
    if math.isnan(item.median):
        return "–"
    middle = number(item.median * factor)
    if item.finished < 2 or item.low == item.high:
        return middle
    return f"{middle} [{number(item.low * factor)} – {number(item.high * factor)}]"


def _runs(item: Cell) -> str:
    parts = [f"{item.finished} finished"]
    parts += [f"{item.failed} failed"] if item.failed else []
    parts += [f"{item.skipped} skipped"] if item.skipped else []
    return ", ".join(parts)


def _count(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.0f}"


def _plain(value: object) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
