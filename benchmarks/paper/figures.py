"""Figures 1 to 7 as the paper describes them, drawn from the nominal robot's joint 1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch

from benchmarks.paper import contestants as names
from benchmarks.paper.contestants import RAW
from benchmarks.paper.drawing import MEASURED, NOISE, TRUTH, WIDTH, WITH, WITHOUT, letter, thin
from benchmarks.paper.evaluation import Reference, free_run
from benchmarks.paper.study import Showcase
from envs.adeptone import adeptone
from envs.log import COMMAND_UNIT, Array, Log
from envs.rendering import RenderingError, render_robot
from methods.base import Fit
from methods.differentiation import Differentiator
from methods.joint_model import JointModel
from methods.regressor import HORIZONTAL, column_unit

SHOWN = (0.3, 1.2, 0.08, 0.0)
"""Pose of the robot in Fig. 1."""
MOTION = ("position", "velocity", "acceleration", "jerk")
ACCENTS = {"position": "", "velocity": r"\dot", "acceleration": r"\ddot", "jerk": r"\dddot"}
POWERS = {"position": "", "velocity": "/s", "acceleration": "/s$^2$", "jerk": "/s$^3$"}


def symbol(log: Log, name: str) -> str:
    """Axis label of a signal of the log's joint, such as its angular velocity in rad/s."""
    letter_of_joint = r"\theta" if log.facts[0].position_unit == "rad" else "q"
    return f"${ACCENTS[name]}{{{letter_of_joint}}}_{log.joints[0]}$ [{log.facts[0].position_unit}{POWERS[name]}]"


def command_unit(log: Log) -> str:
    """Unit of the log's command."""
    return COMMAND_UNIT[log.facts[0].input]


def robot_and_network() -> Figure:
    """Fig. 1: the robot and the two-layer network beside the identified model."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 3.3), width_ratios=(1.0, 1.25))
    for axes in (left, right):
        axes.set_axis_off()
    letter(left, "a")
    letter(right, "b")
    try:
        left.imshow(render_robot(adeptone(), np.array(SHOWN), width=900, height=900))
    except RenderingError as error:
        left.text(0.5, 0.5, str(error), ha="center", va="center", wrap=True, transform=left.transAxes)
    _draw_network(right)
    return figure


def _draw_network(axes: Axes) -> None:
    axes.set_xlim(0.0, 10.0)
    axes.set_ylim(0.0, 8.2)
    axes.set_aspect("equal")
    inputs = [(r"$\theta$", 7.2), (r"$\dot\theta$", 6.0), (r"$\ddot\theta$", 4.8), (r"$\dddot\theta$", 3.6)]
    hidden = [(1, 7.6), (2, 6.5), (3, 5.4), (None, 4.45), (10, 3.4)]
    output = (6.3, 5.4)
    for row, (_, y) in enumerate(inputs):
        for _, h in (item for item in hidden if item[0]):
            style = "-" if row < 2 else (0, (3, 2))
            axes.plot((1.0, 3.6), (y, h), color=NOISE, linewidth=0.7, linestyle=style, zorder=1)
    for _, h in (item for item in hidden if item[0]):
        axes.plot((3.6, output[0]), (h, output[1]), color=NOISE, linewidth=0.7, zorder=1)
    for row, (symbol, y) in enumerate(inputs):
        face = "#DCEBF5" if row < 2 else "white"
        axes.add_patch(Circle((1.0, y), 0.42, facecolor=face, edgecolor=WITH, linewidth=1.0, zorder=2))
        axes.text(1.0, y, symbol, ha="center", va="center", zorder=3)
    for number, h in hidden:
        if number is None:
            axes.text(3.6, h, "⋮", ha="center", va="center", fontsize=12)
            continue
        axes.add_patch(Circle((3.6, h), 0.42, facecolor="#F3F3F3", edgecolor=MEASURED, linewidth=0.8, zorder=2))
        x = np.linspace(-0.25, 0.25, 30)
        axes.plot(3.6 + x, h - 0.18 + 0.36 / (1.0 + np.exp(-20.0 * x)), color=MEASURED, linewidth=0.9, zorder=3)
    axes.add_patch(Circle(output, 0.42, facecolor="#F3F3F3", edgecolor=MEASURED, linewidth=0.8, zorder=2))
    axes.text(*output, "Σ", ha="center", va="center", zorder=3)
    axes.text(2.3, 7.75, "$W$", ha="center")
    axes.text(5.1, 6.9, "$U$", ha="center")
    box = FancyBboxPatch((2.2, 0.75), 3.4, 1.2, boxstyle="round,pad=0.08", facecolor="#FBEBDD", edgecolor=WITHOUT)
    axes.add_patch(box)
    axes.text(3.9, 1.35, "identified model\n" + r"$v_1=Y a$", ha="center", va="center")
    arrow = {"arrowstyle": "-|>", "color": MEASURED, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (2.12, 1.35), (0.15, 1.35), arrowprops=arrow)
    axes.plot((0.15, 0.15), (1.35, 7.2), color=MEASURED, linewidth=0.9)
    for _, y in inputs:
        axes.plot((0.15, 0.58), (y, y), color=MEASURED, linewidth=0.9)
    total = (8.2, 3.4)
    axes.add_patch(Circle(total, 0.42, facecolor="white", edgecolor=MEASURED, linewidth=0.9))
    axes.text(*total, "+", ha="center", va="center")
    axes.annotate("", (8.2, 3.83), (6.75, 5.4), arrowprops={**arrow, "connectionstyle": "angle,angleA=0,angleB=90"})
    axes.annotate("", (8.2, 2.97), (5.7, 1.35), arrowprops={**arrow, "connectionstyle": "angle,angleA=0,angleB=90"})
    axes.annotate("", (9.8, 3.4), (8.64, 3.4), arrowprops=arrow)
    axes.text(7.5, 5.6, "$v_2$", ha="center")
    axes.text(7.3, 1.5, "$v_1$", ha="center")
    axes.text(9.3, 3.6, "$v$", ha="center")
    axes.text(2.5, 2.55, "dashed: four-signal variant only", ha="left", va="center", fontsize=7)


def excitation(show: Showcase) -> Figure:
    """Fig. 2: the input."""
    figure, axes = plt.subplots(figsize=(WIDTH, 1.9))
    time, command = thin(show.log.time, show.log.command)
    axes.plot(time, command, color=MEASURED)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"$v_d$ [{command_unit(show.log)}]")
    axes.set_xlim(show.log.time[0], show.log.time[-1])
    return figure


def responses(show: Showcase) -> Figure:
    """Fig. 3: position, velocity, acceleration and jerk; raw differences behind the band-limited signals."""
    figure, grid = plt.subplots(2, 2, figsize=(WIDTH, 3.9), sharex=True)
    raw, smooth = RAW.signals(show.log), show.filtered.signals(show.log)
    for axes, name, label in zip(grid.flat, MOTION, "abcd", strict=True):
        axes.plot(
            *thin(raw.time, getattr(raw.motion, name), points=5000),
            color=NOISE,
            linewidth=0.5,
            label="measured position and its raw differences",
        )
        axes.plot(
            *thin(smooth.time, getattr(smooth.motion, name)),
            color=WITH,
            label=f"band-limited, {show.filtered.bandwidth:g} Hz",
        )
        axes.set_ylabel(symbol(show.log, name))
        letter(axes, label)
    for axes in grid[1]:
        axes.set_xlabel("time [s]")
    _magnify(grid[1, 1], smooth.time, smooth.motion.jerk[:, 0])
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _magnify(axes: Axes, time: Array, jerk: Array) -> None:
    """The band-limited jerk of two seconds, in a window of its own."""
    low, high = axes.get_ylim()
    axes.set_yticks([tick for tick in axes.get_yticks() if low <= tick <= high])
    axes.set_ylim(low, high + 1.3 * (high - low))
    inset = axes.inset_axes((0.12, 0.62, 0.84, 0.36))
    start = time[0] + 0.2 * (time[-1] - time[0])
    rows = (time >= start) & (time < start + 2.0)
    inset.plot(*thin(time[rows], jerk[rows]), color=WITH, linewidth=0.9)
    inset.set_xlim(start, start + 2.0)
    inset.tick_params(labelsize=6.5, length=2)


def parameter_history(show: Showcase) -> Figure:
    """Fig. 4: the three coefficients against the number of samples."""
    figure, grid = plt.subplots(1, 3, figsize=(WIDTH, 2.7))
    styles = ((WITHOUT, "--"), (WITH, "-"), ("#CC79A7", "-."), ("#E69F00", ":"))
    for column, (axes, name) in enumerate(zip(grid, HORIZONTAL, strict=True)):
        finals = []
        for (estimator, (samples, estimates)), (color, style) in zip(show.histories.items(), styles, strict=False):
            if column >= estimates.shape[1]:
                continue
            first = np.searchsorted(samples, 50)
            axes.plot(
                *thin(samples[first:], estimates[first:, column], points=600),
                color=color,
                linestyle=style,
                label=estimator,
            )
            finals.append(estimates[-1, column])
        if name in show.truth:
            axes.axhline(show.truth[name], color=TRUTH, linewidth=2.0, alpha=0.6, zorder=0, label="truth")
            finals.append(show.truth[name])
        margin = 0.6 * (max(finals) - min(finals)) + 0.02 * abs(finals[-1])
        axes.set_ylim(min(finals) - margin, max(finals) + margin)
        axes.ticklabel_format(axis="y", scilimits=(-3, 3), useMathText=True)
        axes.set_xlabel("number of samples")
        unit = column_unit(name, show.log.facts[0]).replace("^2", "$^2$").replace("^3", "$^3$")
        axes.set_ylabel(f"$a_{{{show.log.joints[0]}{column + 1}}}$ [{unit}]")
        letter(axes, "abc"[column])
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def inverse_outputs(show: Showcase) -> Figure:
    """Fig. 5: outputs of the inverse system, on raw differences and on band-limited signals."""
    figure, grid = plt.subplots(3, 2, figsize=(WIDTH, 5.0), sharex=True, sharey="row")
    cases = (
        ("as printed: raw differences", names.PRINTED, RAW),
        (f"band-limited, {show.filtered.bandwidth:g} Hz", names.HYBRID, show.filtered),
    )
    for column, (title, name, differentiator) in enumerate(cases):
        inverse_column(grid[:, column], show.fits[name], show.log, differentiator)
        grid[0, column].annotate(
            title, (0.5, 1.04), xycoords="axes fraction", ha="center", va="bottom", fontweight="bold"
        )
    for axes, label in zip(grid.flat, "abcdef", strict=True):
        letter(axes, label)
    for axes, label in zip(grid[:, 0], ("input", "$v_2$", "error"), strict=True):
        axes.set_ylabel(f"{label} [{command_unit(show.log)}]")
    for axes in grid[2]:
        axes.set_xlabel("time [s]")
    handles = [
        pair for axes in (grid[0, 0], grid[2, 0]) for pair in zip(*axes.get_legend_handles_labels(), strict=True)
    ]
    figure.legend(*zip(*handles, strict=True), loc="outside lower center", ncols=5)
    return figure


def inverse_column(panels: Sequence[Axes], fit: Fit, log: Log, differentiator: Differentiator) -> None:
    """vd, v, v1; v2; e1, e2 of one compensated fit, in three panels."""
    model = fit.model
    assert isinstance(model, JointModel)
    signals = differentiator.signals(log)
    wanted = signals.command[:, 0]
    first, second = model.linear_part(signals.motion), model.compensation(signals.motion)
    points = {"points": 2500}
    panels[0].plot(*thin(signals.time, first, **points), color=WITHOUT, linewidth=0.8, label="$v_1$, without")
    panels[0].plot(*thin(signals.time, first + second, **points), color=WITH, linewidth=1.0, label="$v$, with")
    panels[0].plot(*thin(signals.time, wanted, **points), color=MEASURED, linestyle="--", linewidth=1.0, label="$v_d$")
    panels[1].plot(*thin(signals.time, second, **points), color=WITH, linewidth=1.0)
    panels[2].plot(*thin(signals.time, wanted - first, **points), color=WITHOUT, linewidth=0.7, label="$e_1=v_d-v_1$")
    panels[2].plot(
        *thin(signals.time, wanted - first - second, **points), color=WITH, linewidth=0.7, label="$e_2=v_d-v$"
    )


def learning(curves_of_draws: Sequence[Mapping[str, Array]]) -> Figure:
    """Fig. 6: mean squared error against learning time, median and range over the draws; one mapping per draw."""
    figure, axes = plt.subplots(figsize=(WIDTH, 2.8))
    lines = (
        (names.PRINTED, WITHOUT, "--"),
        (names.HYBRID, WITH, "-"),
        (names.HYBRID_4, TRUTH, "-."),
        (names.MODERN, "#CC79A7", ":"),
    )
    for name, color, style in lines:
        curves = [draw[name] / draw[name][0] for draw in curves_of_draws]
        longest = max(len(curve) for curve in curves)
        stacked = np.array([np.pad(curve, (0, longest - len(curve)), mode="edge") for curve in curves])
        passes = np.arange(longest)
        axes.fill_between(passes, *np.quantile(stacked, (0.1, 0.9), axis=0), color=color, alpha=0.15, linewidth=0)
        axes.plot(passes, np.median(stacked, axis=0), color=color, linestyle=style, label=name)
    axes.set_yscale("log")
    axes.set_xlim(0, 150)
    axes.set_xlabel("learning time [passes over the record; L-BFGS: evaluations of the loss]")
    axes.set_ylabel("mean squared error\nover its start")
    axes.legend(loc="upper right")
    return figure


def forward(show: Showcase) -> Figure:
    """Fig. 7: position, velocity and acceleration, measured and simulated without and with compensator."""
    figure, grid = plt.subplots(3, 3, figsize=(WIDTH, 5.0), sharex=True)
    for row in grid:
        row[1].sharey(row[2])
    reference = Reference.of(show.log, show.filtered)
    printed, sound = (names.LS_RAW, names.PRINTED), (names.LS, names.HYBRID)
    forward_panels(grid[:, 0], show.fits, reference, sound, errors=False, window=show.window)
    forward_panels(grid[:, 1], show.fits, reference, printed, errors=True, window=show.window)
    forward_panels(grid[:, 2], show.fits, reference, sound, errors=True, window=show.window)
    titles = ("motion, band-limited", "error, as printed", "error, band-limited")
    for column, title in enumerate(titles):
        grid[0, column].annotate(
            title, (0.55, 1.04), xycoords="axes fraction", ha="center", va="bottom", fontweight="bold"
        )
        grid[2, column].set_xlabel("time [s]")
    for row, name in zip(grid, MOTION[:3], strict=True):
        row[0].set_ylabel(symbol(show.log, name))
    for axes, label in zip(grid.T.flat, "abcdefghi", strict=True):
        letter(axes, label)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def forward_panels(
    panels: Sequence[Axes],
    fits: Mapping[str, Fit],
    reference: Reference,
    pair: tuple[str, str],
    *,
    errors: bool,
    window: float | None = None,
) -> None:
    """Free runs of two fits, without and with compensator, in three panels: the motion itself or its error."""
    time = reference.signals.time
    runs = [free_run(fits[name].model, reference, window) for name in pair]
    for axes, name in zip(panels, MOTION[:3], strict=True):
        measured: Array = getattr(reference.signals.motion, name)
        if not errors:
            axes.plot(*thin(time, measured, points=2500), color=MEASURED, linewidth=2.0, alpha=0.4, label="measured")
        for run, color, style, label in zip(
            runs, (WITHOUT, WITH), ("--", "-"), ("without compensator", "with compensator"), strict=True
        ):
            shown = getattr(run, name) - (measured if errors else 0.0)
            axes.plot(*thin(time, shown), color=color, linestyle=style, linewidth=0.9, label=label)


def left_over(show: Showcase) -> Figure:
    """What the three columns and the compensated model leave of the command, against velocity and time."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 2.8), width_ratios=(1.0, 1.6), sharey=True)
    signals = show.filtered.signals(show.log)
    for name, color, label in ((names.LS, WITHOUT, "three columns"), (names.HYBRID, WITH, "with compensator")):
        rest = signals.command - show.fits[name].model.inverse(signals.time, signals.motion)
        left.plot(*thin(signals.motion.velocity, rest, points=4000), ".", color=color, markersize=1.5, alpha=0.5)
        right.plot(*thin(signals.time, rest, points=4000), color=color, linewidth=0.7, label=label)
    left.set_xlabel(symbol(show.log, "velocity"))
    left.set_ylabel(f"left over [{command_unit(show.log)}]")
    right.set_xlabel("time [s]")
    letter(left, "a")
    letter(right, "b")
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure
