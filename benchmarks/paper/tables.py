"""Tables: every number of the study as CSV, its summary over the draws as CSV and Markdown.

Numbers are written with six significant digits; the same seed gives the same bytes.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.paper.doubts import Doubts
from benchmarks.paper.experiment import CHOICES
from benchmarks.paper.study import DrawResult, ErrorRow, ParameterRow
from envs.log import Array
from methods.regressor import ColumnName

METRICS = ("inverse", "inverse_relative", "position", "velocity", "acceleration")
INTERVAL = (0.1, 0.9)
"""Quantiles over the draws that bound every interval."""
SYMBOL: Mapping[ColumnName, str] = {
    "jerk": "a_{j}1",
    "acceleration": "a_{j}2",
    "velocity": "a_{j}3",
    "constant": "a_{j}4",
    "coulomb": "coulomb_{j}",
}


@dataclass(frozen=True)
class Table:
    """A title, column names and rows of text or numbers; people see numbers with so many significant `digits`."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]
    digits: int = 3

    def csv(self) -> str:
        """Comma-separated, one header line."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([[text_of(value, 6) for value in row] for row in self.rows])
        return buffer.getvalue()

    def markdown(self) -> str:
        """A Markdown table under its title."""
        lines = [f"**{self.title}**", "", _line(self.columns), _line("---" for _ in self.columns)]
        lines += [_line(text_of(value, self.digits) for value in row) for row in self.rows]
        return "\n".join(lines) + "\n"


def text_of(value: object, digits: int) -> str:
    """A cell as text: numbers with so many significant digits, None empty, a lost free run as ``diverged``."""
    if value is None:
        return ""
    if isinstance(value, float):
        return "diverged" if np.isinf(value) else f"{value:.{digits}g}"
    return str(value)


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


@dataclass(frozen=True)
class ErrorSummary:
    """Errors of one contestant on one log over the draws; `values` by metric (D,), infinite where it diverged."""

    joint: int
    method: str
    log: str
    values: Mapping[str, Array]

    def median(self, metric: str) -> float:
        """Median over the draws."""
        return float(np.quantile(self.values[metric], 0.5, method="inverted_cdf"))

    def interval(self, metric: str) -> tuple[float, float]:
        """The quantiles `INTERVAL` over the draws."""
        low, high = (float(np.quantile(self.values[metric], part, method="inverted_cdf")) for part in INTERVAL)
        return low, high

    @property
    def lost(self) -> int:
        """Number of draws in which the free run diverged."""
        return int(np.sum(np.isinf(self.values["position"])))

    def cell(self, metric: str) -> str:
        """Median and interval as text."""
        low, high = self.interval(metric)
        return f"{text_of(self.median(metric), 3)} [{text_of(low, 2)}, {text_of(high, 2)}]"


def summarise_errors(results: Sequence[DrawResult]) -> tuple[ErrorSummary, ...]:
    """One summary per joint, contestant and log, in the order of the first draw."""
    grouped: dict[tuple[int, str, str], list[ErrorRow]] = {}
    for result in results:
        for row in result.errors:
            grouped.setdefault((row.joint, row.method, row.log), []).append(row)
    return tuple(
        ErrorSummary(*key, {metric: np.array([getattr(row.errors, metric) for row in rows]) for metric in METRICS})
        for key, rows in grouped.items()
    )


def choices_table() -> Table:
    """What the paper leaves open."""
    return Table("choices", "What the paper leaves open, as chosen here", ("what", "chosen", "why"), CHOICES)


def parameter_tables(results: Sequence[DrawResult]) -> tuple[Table, Table, Table]:
    """Every estimate; per coefficient and estimator the summary over the draws; and the nominal robot in short."""
    rows = [row for result in results for row in result.parameters]
    everything = Table(
        "parameters",
        "Estimates of step 1 against the truth",
        (
            "draw",
            "joint",
            "estimator",
            "coefficient",
            "unit",
            "truth",
            "estimate",
            "standard_error",
            "standard_error_if_white",
            "cramer_rao_bound",
            "condition_number",
        ),
        tuple(
            (
                row.draw,
                row.joint,
                row.estimator,
                symbol(row),
                row.unit,
                row.truth,
                row.estimate,
                row.standard_error,
                row.error_if_white,
                row.bound,
                row.condition,
            )
            for row in rows
        ),
    )
    grouped: dict[tuple[int, str, str], list[ParameterRow]] = {}
    for row in sorted(rows, key=lambda row: row.joint):
        grouped.setdefault((row.joint, symbol(row), row.estimator), []).append(row)
    summary = Table(
        "parameters_summary",
        "Parameters per joint: nominal robot, and relative error over the draws (median and 10 to 90 % range)",
        (
            "joint",
            "coefficient",
            "unit",
            "estimator",
            "truth",
            "estimate",
            "standard error",
            "Cramér-Rao bound",
            "condition number",
            "relative error over the draws",
        ),
        tuple(
            (
                joint,
                name,
                first.unit,
                estimator,
                first.truth,
                first.estimate,
                first.standard_error,
                first.bound,
                first.condition,
                _spread([row.estimate / row.truth - 1.0 for row in group]),
            )
            for (joint, name, estimator), group in grouped.items()
            for first in group[:1]
        ),
    )
    return everything, summary, _parameters_in_short([row for row in rows if row.draw == results[0].draw])


def _parameters_in_short(rows: Sequence[ParameterRow]) -> Table:
    """One row per joint and coefficient: truth, estimates with standard errors, bound and condition under the sine."""
    estimators = list(dict.fromkeys(row.estimator for row in rows))
    grouped: dict[tuple[int, str], dict[str, ParameterRow]] = {}
    for row in sorted(rows, key=lambda row: row.joint):
        grouped.setdefault((row.joint, symbol(row)), {})[row.estimator] = row
    return Table(
        "parameters_nominal",
        "Nominal robot: estimate ± standard error (error against the truth); bound and condition number under the sine",
        ("coefficient", "unit", "truth", *estimators, "Cramér-Rao bound", "condition number"),
        tuple(
            (
                name,
                first.unit,
                first.truth,
                *(_against_truth(group[estimator]) for estimator in estimators),
                first.bound,
                first.condition,
            )
            for (_, name), group in grouped.items()
            for first in (group[estimators[0]],)
        ),
    )


def _against_truth(row: ParameterRow) -> str:
    off = 100.0 * (row.estimate / row.truth - 1.0)
    return f"{text_of(row.estimate, 3)} ± {text_of(row.standard_error, 2)} ({off:+.1f} %)"


def symbol(row: ParameterRow) -> str:
    """The paper's name of a coefficient, such as a_11."""
    return symbol_of(row.column, row.joint)


def symbol_of(column: ColumnName, joint: int) -> str:
    """The paper's name of a column's coefficient; friction, which it has not, by its own name."""
    return SYMBOL[column].format(j=joint)


def _spread(values: Sequence[float]) -> str:
    low, middle, high = np.quantile(values, (INTERVAL[0], 0.5, INTERVAL[1]), method="inverted_cdf")
    return f"{100 * middle:+.1f} % [{100 * low:+.1f}, {100 * high:+.1f}]"


def error_tables(results: Sequence[DrawResult], summaries: Sequence[ErrorSummary]) -> tuple[Table, ...]:
    """Every error; the summary in numbers; and one readable table per log of joint 1."""
    everything = Table(
        "errors",
        "Errors of every method on every log",
        ("draw", "joint", "method", "log", *METRICS, "diverged_at"),
        tuple(
            (
                row.draw,
                row.joint,
                row.method,
                row.log,
                *(getattr(row.errors, metric) for metric in METRICS),
                row.errors.diverged,
            )
            for result in results
            for row in result.errors
        ),
    )
    quantiles = tuple(f"{metric}_{part}" for metric in METRICS for part in ("median", "low", "high"))
    summary = Table(
        "errors_summary",
        "Errors over the draws: median and 10 to 90 % range",
        ("joint", "method", "log", *quantiles, "diverged"),
        tuple(
            (
                item.joint,
                item.method,
                item.log,
                *(value for metric in METRICS for value in (item.median(metric), *item.interval(metric))),
                item.lost,
            )
            for item in summaries
        ),
    )
    return everything, summary, *(log_table(summaries, log) for log in _logs(summaries))


def log_table(summaries: Sequence[ErrorSummary], log: str) -> Table:
    """All contestants of joint 1 on one log."""
    return Table(
        "errors_" + log.replace(" ", "_"),
        f"Joint 1, {log}: median and 10 to 90 % range over the draws",
        (
            "method",
            "inverse [V]",
            "inverse, relative",
            "position [rad]",
            "velocity [rad/s]",
            "acceleration [rad/s²]",
            "diverged",
        ),
        tuple(
            (item.method, *(item.cell(metric) for metric in METRICS), f"{item.lost} of {len(item.values['position'])}")
            for item in summaries
            if item.joint == 1 and item.log == log
        ),
    )


def _logs(summaries: Sequence[ErrorSummary]) -> list[str]:
    return list(dict.fromkeys(item.log for item in summaries if item.joint == 1))


def joints_table(summaries: Sequence[ErrorSummary]) -> Table:
    """The paper's method on every joint, training sine."""
    return Table(
        "errors_joints",
        "All joints, training sine: median and 10 to 90 % range over the draws",
        ("joint", "method", "inverse [V]", "inverse, relative", "position", "velocity", "acceleration"),
        tuple(
            (item.joint, item.method, *(item.cell(metric) for metric in METRICS))
            for item in summaries
            if item.log == "training sine" and (item.joint > 1 or _on_every_joint(item, summaries))
        ),
    )


def _on_every_joint(item: ErrorSummary, summaries: Sequence[ErrorSummary]) -> bool:
    return any(other.joint == 2 and other.method == item.method for other in summaries)


def structure_table(results: Sequence[DrawResult]) -> Table:
    """Training error against hidden nodes, beside the model and alone."""
    return Table(
        "structures",
        "Training error over voltage against hidden nodes",
        ("draw", "hidden_nodes", "beside_the_model", "alone"),
        tuple((row.draw, row.nodes, row.beside_model, row.alone) for result in results for row in result.structures),
    )


def doubt_tables(doubts: Doubts) -> tuple[Table, Table]:
    """Excitations and bandwidths."""
    parameters = ("a_11", "a_12", "a_13")
    excitations = Table(
        "doubt_excitation",
        "What an excitation can tell: relative Cramér-Rao bound and relative errors of band-limited least squares",
        (
            "excitation",
            *(f"bound {name}" for name in parameters),
            *(f"error {name}, no hidden effects" for name in parameters),
            *(f"error {name}" for name in parameters),
            "correlation of jerk and velocity",
            "condition number",
        ),
        tuple(
            (row.excitation, *row.bound, *row.clean, *row.real, row.correlation, row.condition)
            for row in doubts.excitations
        ),
    )
    bandwidths = Table(
        "doubt_bandwidth",
        "Estimate over truth against bandwidth and encoder resolution, no hidden effects",
        ("excitation", "counts_per_rev", "bandwidth", "hold_respected", *parameters),
        tuple(
            (row.excitation, row.counts, "raw" if row.bandwidth is None else row.bandwidth, row.hold, *row.ratio)
            for row in doubts.bandwidths
        ),
    )
    return excitations, bandwidths
