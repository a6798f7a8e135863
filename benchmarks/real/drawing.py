"""What all figures of this folder share: one style, a few kinds of panel, SVG as text."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from envs.log import Array

WIDTH = 7.2  # in
MEASURED, BEFORE, AFTER, OTHER, FLOOR = "#000000", "#D55E00", "#0072B2", "#009E73", "#999999"
"""Colours after Okabe and Ito (2008): measurement, nominal model, extended model, a third one, noise."""
STYLE = Path(__file__).with_name("real.mplstyle")


def figure(rows: int = 1, columns: int = 1, height: float = 2.6, *, sharex: bool = False) -> tuple[Figure, np.ndarray]:
    """A figure of the page's width and its axes, (rows, columns)."""
    with plt.style.context(STYLE):
        drawn, axes = plt.subplots(rows, columns, figsize=(WIDTH, height), squeeze=False, sharex=sharex)
    return drawn, axes


def svg(drawn: Figure, name: str) -> str:
    """A figure as SVG text; `name` keeps its ids apart from those of other figures on the same page."""
    buffer = io.StringIO()
    with plt.style.context(STYLE):
        drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(drawn)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", text)
    text = re.sub(r'\b(d|x|y)="([^"]*)"', lambda found: f'{found[1]}="{_shortened(found[2])}"', text)
    return re.sub(r'<svg [^>]*viewBox="([^"]*)"[^>]*>', r'<svg viewBox="\1" role="img">', text, count=1).replace(
        "xlink:href", "href"
    )


def _shortened(coordinates: str) -> str:
    """Coordinates to a hundredth of a point, which no eye can see."""
    return re.sub(r"-?\d+\.\d+", lambda found: f"{float(found[0]):.2f}".rstrip("0").rstrip("."), coordinates)


def thin(*columns: Array, points: int = 1200) -> list[Array]:
    """Every n-th sample of equally long columns, about `points` of them."""
    step = max(1, len(columns[0]) // points)
    return [np.ravel(column)[::step] for column in columns]


def binned(axes: Axes, x: Array, y: Array, color: str, label: str, bins: int = 24) -> None:
    """Median of y in bins of x with equally many samples, and the range of the middle 80 %."""
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1)))
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    at: list[float] = []
    low: list[float] = []
    middle: list[float] = []
    high: list[float] = []
    for i in range(len(edges) - 1):
        mine = y[place == i]
        if len(mine) < 8:
            continue
        at.append(float(np.median(x[place == i])))
        for store, share in ((low, 0.1), (middle, 0.5), (high, 0.9)):
            store.append(float(np.quantile(mine, share)))
    axes.fill_between(at, low, high, color=color, alpha=0.18, linewidth=0)
    axes.plot(at, middle, color=color, marker="o", markersize=2.5, label=label)


def bars(
    names: Sequence[str], groups: Sequence[tuple[str, str, Sequence[float]]], unit: str, floor: tuple[str, float] | None
) -> Figure:
    """Horizontal bars of several quantities (label, colour, values) per model, the first model on top; log scale."""
    drawn, axes = figure(height=0.55 + 0.34 * len(names))
    panel = axes[0, 0]
    width = 0.8 / len(groups)
    for i, (label, color, values) in enumerate(groups):
        heights = np.arange(len(names)) + (i - 0.5 * (len(groups) - 1)) * width
        panel.barh(heights, values, 0.9 * width, color=color, label=label)
        for y, value in zip(heights, values, strict=True):
            panel.annotate(f"{value:.3g}", (value, y), (3, 0), textcoords="offset points", va="center", fontsize=7.5)
    if floor is not None:
        panel.axvline(floor[1], color=FLOOR, linestyle="--", label=floor[0])
    panel.set_yticks(range(len(names)), names)
    panel.invert_yaxis()
    finite = [v for _, _, values in groups for v in values if np.isfinite(v) and v > 0]
    if finite and max(finite) > 8 * min(finite):
        panel.set_xscale("log")
        panel.set_xlim(0.6 * min([*finite, *([floor[1]] if floor else [])]), 2.2 * max(finite))
    else:
        panel.set_xlim(0, 1.12 * max(finite, default=1.0))
    panel.set_xlabel(unit)
    panel.grid(axis="y", visible=False)
    panel.legend(loc="lower right")
    return drawn
