"""Tables from scored blind trials: outcomes, confusion of effects, detection against visibility, parameters."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import norm

FALSE_ALARM = 1e-3
"""False alarms granted to the likelihood-ratio test that the diagnosis is compared with."""
LIMIT = float(norm.isf(FALSE_ALARM))
"""Visibility at which that test, which knows the effect, finds it in every second log."""
INTERVAL = 1.645
"""Half-width of a 90 % interval in standard deviations."""
TOLD_BY = {"none": "(none)", "unknown": "(unknown)"}
"""What a verdict says that names nothing for sure."""


def outcomes(data: pd.DataFrame) -> pd.DataFrame:
    """Number of trials per kind and outcome."""
    return pd.crosstab(data.kind, data.outcome)


def confusion(data: pd.DataFrame) -> pd.DataFrame:
    """Trials with a single effect: what was hidden (rows), what was said (columns), counts.

    What is known of the machine beforehand, such as a pendulum's gravity, is no answer; names that cannot be told
    apart stand together.
    """
    single = data[data.kind.isin(["single", "clean"])]
    return pd.crosstab(single.hidden, [_said(row) for row in single.to_dict("records")], rownames=["hidden"])


def _listed(table: pd.DataFrame) -> str:
    """One line per effect that was hidden: what was said, and how often."""
    width = max((len(name) for name in table.index), default=0)
    return "\n".join(
        f"{name:{width}s} -> " + ", ".join(f"{said} {count}" for said, count in row[row > 0].items())
        for name, row in table.iterrows()
    )


def _said(row: dict[str, object]) -> str:
    named = {name for name in str(row["named"]).split("+") if name}
    if row["outcome"] == "right" and row["hidden"] != "nothing":
        return str(row["hidden"])
    if row["verdict"] in TOLD_BY:
        return TOLD_BY[str(row["verdict"])]
    rivals = {name for name in str(row["rivals"]).split("+") if name} if row["verdict"] == "ambiguous" else set()
    known = {"gravity_tilt"} if row["family"] == "pendulum" and row["hidden"] != "gravity_tilt" else set()
    return " or ".join(sorted((named | rivals) - known)) or "(none)"


def detection(data: pd.DataFrame) -> tuple[float, int]:
    """Visibility at which every second weak effect is found, by logistic regression on its logarithm; and of how many.

    An effect is found when the diagnosis names it, alone or among others that the logs cannot tell from it. NaN
    where all or none were found.
    """
    weak = data[data.kind == "weak"]
    found = np.array([_is_found(row) for row in weak.to_dict("records")], dtype=float)
    if not len(found) or found.min() == found.max():
        return float("nan"), len(found)
    size = np.log(weak.visibility.to_numpy(float))

    def surprise(x: np.ndarray) -> float:
        chance = np.clip(expit(np.exp(x[1]) * (size - x[0])), 1e-9, 1.0 - 1e-9)
        doubt = 0.5 * (x[1] - np.log(4.0)) ** 2  # keeps the slope finite where the two groups do not overlap
        return float(-np.sum(found * np.log(chance) + (1.0 - found) * np.log(1.0 - chance)) + doubt)

    best = minimize(surprise, [float(np.mean(size)), np.log(4.0)], method="Nelder-Mead")
    return float(np.exp(best.x[0])), len(found)


def _is_found(row: dict[str, object]) -> bool:
    names = f"{row['named']}+{row['rivals']}".split("+")
    return row["verdict"] in ("named", "ambiguous") and row["hidden"] in names


def parameters(data: pd.DataFrame) -> pd.DataFrame:
    """Errors of the parameters of rightly named single effects, and the share of 90 % intervals that hold the truth.

    Apart for logs with encoder noise alone and with unlogged noise of the amplifier, and for the laws that the search
    knows in the very form that was hidden (``textbook``) and others, whose parameters mean nearly the same.
    """
    single = data[(data.kind == "single") & (data.outcome == "right")]
    rows = [
        (abs(value / true - 1.0), abs(value - true) < INTERVAL * std, noise > 0.0, law == "textbook")
        for found, noise, law in zip(single.parameters, single.amplifier_noise.astype(float), single.law, strict=True)
        for _, true, value, std in json.loads(found)
        if true
    ]
    table = pd.DataFrame(rows, columns=["error", "covered", "amplifier noise", "textbook"])
    return table.groupby(["amplifier noise", "textbook"]).agg(
        parameters=("error", "size"), median_error=("error", "median"), coverage=("covered", "mean")
    )


def confident_wrong(data: pd.DataFrame) -> float:
    """Share of all trials with a wrong name and the verdict ``named``."""
    return float(np.mean((data.outcome == "wrong") & (data.verdict == "named"))) if len(data) else float("nan")


def text(data: pd.DataFrame) -> str:
    """All tables, and every trial that was not right."""
    threshold, weak = detection(data)
    closed = pd.to_numeric(data[(data.kind == "single") & (data.outcome == "right")].closed, errors="coerce")
    columns = ["seed", "kind", "family", "hidden", "law", "visibility", "verdict", "named", "rivals", "outcome"]
    parts = [
        outcomes(data).to_string(),
        f"confident wrong names: {confident_wrong(data):.1%} of {len(data)} trials",
        _listed(confusion(data)),
        parameters(data).to_string(),
        f"median share of the explainable gap closed: {closed.median():.4f}",
        f"weak effects: every second of {weak} is found from visibility {threshold:.1f}; a likelihood-ratio test that "
        f"knows the effect, with {FALSE_ALARM:.1%} false alarms: {LIMIT:.1f}",
        f"median seconds {data.seconds.astype(float).median():.1f}",
        data[data.outcome != "right"][columns].to_string(index=False),
    ]
    return "\n\n".join(parts)
