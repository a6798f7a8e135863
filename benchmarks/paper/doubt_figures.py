"""Figures 8 to 10: what is doubtful in the paper, and how all contestants compare."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, PercentFormatter

from benchmarks.paper.doubts import COUNTS, Doubts
from benchmarks.paper.drawing import MEASURED, NOISE, TRUTH, WIDTH, WITH, WITHOUT, letter, thin
from benchmarks.paper.experiment import TRAINING
from benchmarks.paper.tables import ErrorSummary

PARAMETERS = ("$a_{11}$", "$a_{12}$", "$a_{13}$")
COLORS = (WITHOUT, WITH, TRUTH)


def excitation(doubts: Doubts) -> Figure:
    """Fig. 8: one sine cannot identify three parameters."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 3.1), width_ratios=(1.0, 1.9))
    for name, color in (("multisine", NOISE), ("sine, steady state", WITHOUT)):
        velocity, jerk = thin(*doubts.columns[name].T, points=3000)
        left.plot(velocity, jerk, color=color, linewidth=0.5 if color == NOISE else 1.6, label=name)
    left.set_xlabel("velocity column, scaled")
    left.set_ylabel("jerk column, scaled")
    left.set_aspect("equal")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=1)
    letter(left, "a")
    places = np.arange(len(doubts.excitations))
    for k, (parameter, color) in enumerate(zip(PARAMETERS, COLORS, strict=True)):
        offset = 0.26 * (k - 1)
        bound = np.array([row.bound[k] for row in doubts.excitations])
        right.bar(places + offset, bound, 0.22, bottom=1e-8, color=color, alpha=0.45, label=f"{parameter} bound")
        for marker, face, name in (("v", "white", "clean"), ("o", color, "real")):
            error = np.abs([getattr(row, name)[k] for row in doubts.excitations])
            right.plot(places + offset, error, marker, markerfacecolor=face, markeredgecolor=color, markersize=4.5)
    right.plot([], [], "v", markerfacecolor="white", markeredgecolor=MEASURED, label="error, no hidden effects")
    right.plot([], [], "o", color=MEASURED, label="error, with hidden effects")
    right.axhline(1.0, color=MEASURED, linewidth=0.7, linestyle=":")
    right.set_yscale("log")
    right.set_ylim(1e-7, 3.0)
    right.set_xticks(places, [row.excitation.replace(" ", "\n", 1) for row in doubts.excitations])
    right.tick_params(axis="x", labelsize=7)
    right.set_ylabel("relative standard deviation,\nrelative error")
    right.legend(loc="upper center", bbox_to_anchor=(0.45, -0.2), ncols=3)
    letter(right, "b")
    return figure


def bandwidth(doubts: Doubts) -> Figure:
    """Fig. 9: raw differences drown a11; what the bandwidth of the differentiator does."""
    figure, grid = plt.subplots(1, 2, figsize=(WIDTH, 3.0), sharey=True)
    for axes, excited, label in zip(grid, ("multisine", TRAINING), "ab", strict=True):
        rows = [row for row in doubts.bandwidths if row.excitation == excited]
        for counts, color, style, place in zip(COUNTS, COLORS, ("--", "-", "-."), (235.0, 265.0, 298.0), strict=True):
            filtered = [row for row in rows if row.counts == counts and row.bandwidth and row.hold]
            axes.plot(
                [row.bandwidth for row in filtered],
                [row.ratio[0] for row in filtered],
                color=color,
                linestyle=style,
                marker="o",
                markersize=3,
                label=f"{counts:.0e}".replace("e+0", r"·10$^") + "$ counts/rev",
            )
            (raw,) = (row for row in rows if row.counts == counts and row.bandwidth is None)
            axes.plot(place, raw.ratio[0], "D", color=color, markersize=5, clip_on=False)
        forgotten = [row for row in rows if not row.hold]
        axes.plot(
            [row.bandwidth for row in forgotten],
            [row.ratio[0] for row in forgotten],
            color="#CC79A7",
            linestyle=":",
            label="hold of the command forgotten",
        )
        axes.axhline(1.0, color=MEASURED, linewidth=0.7)
        axes.axvline(190.0, color=MEASURED, linewidth=0.5, linestyle=":")
        axes.set_xscale("log")
        axes.set_xlim(2.7, 350.0)
        axes.set_ylim(-0.05, 1.35)
        axes.set_xticks((3, 10, 30, 100, 260), ("3", "10", "30", "100", "raw"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("bandwidth of the differentiator [Hz]")
        letter(axes, label)
        axes.annotate(excited, (0.5, 1.04), xycoords="axes fraction", ha="center", va="bottom", fontweight="bold")
    grid[0].set_ylabel("$a_{11}$ over its true value")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def comparison(summaries: Sequence[ErrorSummary]) -> Figure:
    """Fig. 10: all contestants on the training sine and on what they have not seen, median over the draws."""
    figure, grid = plt.subplots(1, 2, figsize=(WIDTH, 4.2), sharey=True)
    first = [item for item in summaries if item.joint == 1]
    methods = list(dict.fromkeys(item.method for item in first))
    places = {name: len(methods) - 1 - k for k, name in enumerate(methods)}
    markers = dict(zip(dict.fromkeys(item.log for item in first), "osD^vX", strict=False))
    panels = (
        ("inverse_relative", "inverse: voltage error over voltage"),
        ("velocity", "free run: velocity error [rad/s]"),
    )
    for axes, (metric, label), panel in zip(grid, panels, "ab", strict=True):
        values = {(item.method, item.log): item.median(metric) for item in first}
        for name, place in places.items():
            finite = [values[name, log] for log in markers if np.isfinite(values[name, log])]
            if finite:
                axes.plot((min(finite), max(finite)), (place, place), color=NOISE, linewidth=1.0, zorder=1)
            else:
                axes.annotate(
                    "diverges", (0.5, place), xycoords=("axes fraction", "data"), ha="center", va="center", fontsize=7.5
                )
        for log, marker in markers.items():
            trained = log == TRAINING
            axes.plot(
                [values[name, log] for name in methods],
                [places[name] for name in methods],
                marker,
                color=WITHOUT if trained else WITH,
                markerfacecolor=WITHOUT if trained else "white",
                markersize=5.5 if trained else 4.5,
                label=log,
                zorder=3 if trained else 2,
            )
        axes.set_xscale("log")
        axes.set_xlabel(label)
        letter(axes, panel)
    grid[0].xaxis.set_major_formatter(PercentFormatter(1.0, decimals=1))
    grid[0].set_yticks(list(places.values()), list(places))
    grid[0].set_ylim(-0.7, len(methods) - 0.3)
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=7)
    return figure
