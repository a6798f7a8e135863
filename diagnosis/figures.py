"""The report's figures as SVG text: plain data in, one panel out. Colours after Okabe and Ito (2008).

A panel is 3.5 in wide (7.2 in where time needs room) and has its units on the axes; its ids carry the panel's own name,
so that many of them live in one page.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from html import escape
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from diagnosis.quantities import number, pretty_unit, scale_for, sentence_case, title
from diagnosis.result import Alternative, Gap, LedgerRow, PartialResidual, Series, Spectrum
from envs.log import Array

STYLE = Path(__file__).parent / "templates" / "report.mplstyle"
MEASURED, BEFORE, AFTER, LAW, NOISE = "#000000", "#D55E00", "#0072B2", "#000000", "#999999"
RIVALS = ("#CC79A7", "#009E73", "#E69F00")
LOGS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
NARROW, WIDE = 3.5, 7.2  # in
CHARACTER = 0.06  # in, of the waterfall's labels on average
LEFT, BOTTOM = 0.62, 0.4  # margins that hold labels [in]
LABEL = 0.16  # where the label of a vertical axis ends in a stack [in]
LEGEND = 0.19  # height of one line of a legend [in]
RANKED = 9
"""Hypotheses shown in a ranking."""
DECADES = 15.0
"""Ratio of errors from which an axis is logarithmic."""
QUANTITY = {
    "position": "position",
    "velocity": "velocity",
    "acceleration": "acceleration",
    "command": "command",
    "command direction": "change of the command",
    "motor torque": "motor torque, as command",
    "another joint": "acceleration of the other joint",
    "position since reversal": "travel since reversal",
    "elapsed time": "time",
}
RESIDUAL = {
    "command": "missing command",
    "resistance": "missing resistance, as command",
    "reading": "error of the reading",
}


@contextmanager
def report_style() -> Iterator[None]:
    """Everything drawn inside has the report's style."""
    with matplotlib.rc_context(fname=STYLE):
        yield


# ------------------------------------------------------------------------------------------------------------ the page


def svg(figure: Figure, name: str, label: str) -> str:
    """A figure as inline SVG that scales with its column; `name` makes its ids unique, `label` stands in for it."""
    buffer = io.StringIO()
    FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", text)
    text = re.sub(r"\n\s*", "\n", text)
    text = re.sub(r'\b(d|x|y)="([^"]*)"', lambda found: f'{found[1]}="{_shortened(found[2])}"', text)
    width, height = figure.get_size_inches()
    box = f'viewBox="0 0 {72 * width:g} {72 * height:g}" role="img" aria-label="{escape(label)}"'
    return f"<svg {box}>" + text[text.index(">") + 1 :].replace("xlink:href", "href")


def _shortened(coordinates: str) -> str:
    """Coordinates to a hundredth of a point, which no eye can see."""
    return re.sub(r"-?\d+\.\d+", lambda found: f"{float(found[0]):.2f}".rstrip("0").rstrip("."), coordinates)


def equation(tex: str, name: str, size: float = 12.0) -> str:
    """A formula as inline SVG, sized in em and sitting on the line of the text around it."""
    parser: MathTextParser = MathTextParser("path")
    prop = FontProperties(size=size, math_fontfamily="stix")
    width, height, depth, _, _ = parser.parse(f"${tex}$", 72, prop)
    figure = Figure(figsize=((width + 1) / 72, (height + 1) / 72), dpi=72)
    figure.text(0, (depth + 0.5) / (height + 1), f"${tex}$", fontproperties=prop)
    text = svg(figure, name, tex)
    em = f"width:{(width + 1) / size:.2f}em;height:{(height + 1) / size:.2f}em;vertical-align:{-depth / size:.2f}em"
    return text.replace("<svg", f'<svg class="formula" style="{em}"', 1)


def panel(
    width: float, height: float, left: float = LEFT, top: float = 0.12, right: float = 0.1
) -> tuple[Figure, Axes]:
    """A figure with one pair of axes; margins in inches, since automatic layout costs more time than drawing."""
    figure = Figure(figsize=(width, height))
    box = (left / width, BOTTOM / height, 1 - (left + right) / width, 1 - (BOTTOM + top) / height)
    return figure, figure.add_axes(box)


def stack(width: float, heights: Sequence[float], top: float = 0.12) -> tuple[Figure, list[Axes]]:
    """Axes above each other that share the horizontal axis; heights in inches."""
    total = sum(heights) + 0.1 * (len(heights) - 1) + BOTTOM + top
    figure = Figure(figsize=(width, total))
    found: list[Axes] = []
    top = total - top
    for height in heights:
        box = (LEFT / width, (top - height) / total, 1 - (LEFT + 0.1) / width, height / total)
        found.append(figure.add_axes(box, sharex=found[0] if found else None))
        top -= height + 0.1
    for axes in found:  # clear of the widest tick labels of any
        axes.yaxis.set_label_coords((LABEL - LEFT) / (width - LEFT - 0.1), 0.5)
    for axes in found[:-1]:
        axes.tick_params(labelbottom=False)
    return figure, found


def axis_label(text: str, unit: str) -> str:
    """``velocity (rad/s)``."""
    return f"{sentence_case(text)} ({pretty_unit(unit)})" if pretty_unit(unit) else sentence_case(text)


def legend(axes: Axes, columns: int = 2) -> None:
    """A legend above the axes, where it hides no data."""
    axes.legend(
        loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=columns, columnspacing=1.2, frameon=False, markerscale=1.0
    )


def dots(axes: Axes, x: Array, y: Array, colour: str, label: str | None = None, size: float = 1.7) -> None:
    """Many points as one path of round dots, a quarter of the bytes of as many markers."""
    pairs = np.full((len(x), 3), np.nan)
    pairs[:, :2] = x[:, None]
    heights = np.full((len(y), 3), np.nan)
    heights[:, :2] = y[:, None]
    (line,) = axes.plot(pairs.ravel(), heights.ravel(), color=colour, lw=size, solid_capstyle="round", alpha=0.5)
    line.get_path().should_simplify = False
    if label is not None:
        axes.plot([], [], "o", ms=3.5, color=colour, label=label)


def limits(*curves: Array, share: float = 0.005) -> tuple[float, float]:
    """Limits that hold nearly all finite values of the curves, with a margin of 8 %."""
    values = np.concatenate([np.ravel(c)[np.isfinite(np.ravel(c))] for c in curves])
    if not len(values):
        return -1.0, 1.0
    low, high = np.quantile(values, [share, 1 - share])
    margin = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    return float(low - margin), float(high + margin)


# ------------------------------------------------------------------------------------------------------------- the gap


@dataclass(frozen=True)
class Bar:
    """One row of the waterfall: the model, its error, the interval, and whether it competes instead of adding up."""

    text: str
    error: float
    interval: tuple[float, float] | None
    rival: bool


def bars(rows: Sequence[LedgerRow]) -> list[Bar]:
    """Rows of the ledger that have an error, with names in words."""
    return [
        Bar(title(row.step), row.window_error, row.interval, row.role == "rival")
        for row in rows
        if row.window_error is not None and np.isfinite(row.window_error)
    ]


def waterfall(rows: Sequence[LedgerRow], gap: Gap, name: str) -> str:
    """From the nominal model down to the noise floor: what every step takes away; rivals as points below."""
    shown = bars(rows)
    factor, unit = scale_for([max([bar.error for bar in shown], default=0.0), gap.noise_floor], gap.unit)
    floor = gap.noise_floor * factor
    left = max(1.75, 0.3 + CHARACTER * max((len(bar.text) for bar in shown), default=0))
    figure, axes = panel(WIDE, 0.62 + 0.27 * len(shown), left=left)
    positive = [bar.error * factor for bar in shown if bar.error > 0] + ([floor] if floor > 0 else [])
    logarithmic = max(positive) > DECADES * min(positive)
    origin = 0.55 * min(positive) if logarithmic else 0.0
    highest = max(positive + [factor * bar.interval[1] for bar in shown if bar.interval is not None])
    right = highest * (2.5 if logarithmic else 1.14)
    previous: float | None = None
    for row, bar in enumerate(shown):
        value = bar.error * factor
        if bar.rival:
            axes.plot(value, row, "D", color=RIVALS[0], ms=5)
        else:
            begin = origin if previous is None else previous
            colour = NOISE if previous is None else (AFTER if value <= previous else BEFORE)
            axes.barh(row, value - begin, left=begin, height=0.62, color=colour, zorder=2)
            if previous is not None:
                axes.plot([previous, previous], [row - 0.69, row - 0.31], color="#555555", lw=0.7, zorder=3)
            previous = value
        if bar.interval is not None:
            low, high = (max(v * factor, origin) for v in bar.interval)
            axes.plot([low, high], [row, row], color="#222222", lw=1.1, zorder=4)
        edge = max(value, (bar.interval[1] * factor) if bar.interval else value, begin if not bar.rival else value)
        axes.annotate(number(value), (edge, row), (4, 0), textcoords="offset points", va="center", fontsize=7.5)
    if floor > 0:
        axes.axvspan(origin, floor, color="#009E73", alpha=0.18, lw=0, zorder=0)
        axes.axvline(floor, color="#009E73", lw=1.0, zorder=1)
        axes.annotate(
            f"noise floor {number(floor)}",
            (floor, -0.55),
            (3, 1),
            textcoords="offset points",
            color="#00694d",
            fontsize=7.5,
            va="bottom",
        )
    if logarithmic:
        axes.set_xscale("log")
    axes.set_xlim(origin, right)
    axes.set_ylim(len(shown) - 0.45, -0.95)
    axes.set_yticks(range(len(shown)), [sentence_case(bar.text) for bar in shown])
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(f"Error of free simulation over {gap.window:g} s, rms ({unit})")
    return svg(figure, name, "Waterfall of the error from the nominal model down to the noise floor")


def models(before: Array, after: Array) -> list[tuple[Array, str, str, float]]:
    """What to draw of two models as (values, colour, label, line width); once where they are the same model."""
    if np.array_equal(before, after, equal_nan=True):
        return [(after, AFTER, "refitted nominal model", 1.0)]
    return [(before, BEFORE, "nominal", 1.5), (after, AFTER, "extended", 0.9)]


def residual_over_time(series: Series, unit: str, name: str) -> str:
    """Residual of nominal and extended model over time, in the command's unit."""
    figure, axes = panel(WIDE, 1.9, top=LEGEND)
    factor, scaled = scale_for(limits(series.before, series.after), unit)
    for values, colour, label, width in models(series.before, series.after):
        axes.plot(series.time, factor * values, color=colour, lw=0.8 * width, label=label)
    axes.set_ylim(*(factor * v for v in limits(series.before, series.after, share=0.001)))
    axes.set_xlim(series.time[0], series.time[-1])
    axes.set_xlabel("Time (s)")
    axes.set_ylabel(axis_label("residual", scaled))
    legend(axes)
    return svg(figure, name, "Residual of both models over time")


def residual_spectrum(spectrum: Spectrum, unit: str, name: str) -> str:
    """Amplitude density of both residuals over frequency."""
    figure, axes = panel(NARROW, 2.4, top=LEGEND)
    factor, scaled = scale_for([float(np.max(spectrum.before, initial=0.0))], unit)
    for values, colour, label, width in models(spectrum.before, spectrum.after):
        axes.loglog(*in_bands(spectrum.frequency, factor * values), color=colour, lw=width, label=label)
    low, high = axes.get_ylim()
    if high < 100.0 * low:  # few powers of ten to label, and long labels between them
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("Frequency (Hz)")
    axes.set_ylabel(f"Residual ({pretty_unit(scaled)}/√Hz)")
    legend(axes)
    return svg(figure, name, "Spectrum of the residual of both models")


def in_bands(frequency: Array, density: Array, per_decade: int = 40) -> tuple[Array, Array]:
    """Amplitude density as rms of bands that are equally wide on a logarithmic axis; frequency 0 is left out."""
    valid = frequency > 0
    band = np.round(per_decade * np.log10(frequency[valid])).astype(int)
    band -= band.min()
    count = np.bincount(band)
    filled = count > 0
    mean = lambda x: np.bincount(band, x)[filled] / count[filled]  # noqa: E731
    return mean(frequency[valid]), np.sqrt(mean(density[valid] ** 2))


def residual_against(series: Sequence[Series], signal: str, signal_unit: str, unit: str, name: str) -> str:
    """Residual of nominal and extended model against a recorded signal, all logs together."""
    figure, axes = panel(NARROW, 2.4, top=LEGEND)
    x = np.concatenate([_recorded(s, signal) for s in series])
    across, across_unit = scale_for(limits(x), signal_unit)
    step = max(1, len(x) // 900)
    before, after = (np.concatenate([getattr(s, which) for s in series]) for which in ("before", "after"))
    factor, scaled = scale_for(limits(before, after), unit)
    for values, colour, label, _ in models(before, after):
        dots(axes, across * x[::step], factor * values[::step], colour, label)
    axes.set_ylim(*(factor * v for v in limits(before, after)))
    axes.set_xlabel(axis_label(QUANTITY.get(signal, signal), across_unit))
    axes.locator_params(axis="x", nbins=6)
    axes.set_ylabel(axis_label("residual", scaled))
    legend(axes)
    return svg(figure, name, f"Residual of both models against {signal}")


def _recorded(series: Series, signal: str) -> Array:
    values: Array = {"position": series.reading, "motor torque": series.motor_torque}.get(signal, series.velocity)
    return values


# ----------------------------------------------------------------------------------------------------------- the cause


def partial_residual(data: PartialResidual, name: str, per_torque: float | None = None, torque_unit: str = "") -> str:
    """What an effect has to explain, its law on top, and what is left; a second axis in torque where it is known."""
    named = data.effect is not None
    wide = data.continuous and named
    twin_scale = per_torque if data.kind != "reading" and data.unit != torque_unit else None
    lines = 1 if wide or not named else 2 + (len(data.laws) > 2)
    figure, axes = panel(
        WIDE if wide else NARROW, 2.4 + LEGEND * lines, top=LEGEND * lines, right=0.1 if twin_scale is None else LEFT
    )
    curves = [data.before.low, data.before.high, data.after.low, data.after.high, *(law for _, law in data.laws)]
    low, high = limits(*curves, share=0.01)
    factor, unit = scale_for([low, high], data.unit)
    across, across_unit = scale_for(data.x, data.signal_unit)
    x, gap = across * data.x, np.zeros(0, dtype=int)
    if not data.continuous and len(x) > 2:
        gap = np.flatnonzero(np.diff(x) > 1.5 * np.min(np.diff(x))) + 1
    broken = lambda values: np.insert(values, gap, np.nan)  # noqa: E731
    dots(axes, across * data.samples[0], factor * data.samples[1], BEFORE if named else AFTER)
    if named:
        style = "-" if data.continuous else "o"
        middle = factor * data.before.middle
        axes.plot(x, middle, style, color=BEFORE, ms=2.6, lw=1.0, label="without it")
    if not data.continuous:
        lower, upper = (factor * broken(edge) for edge in (data.after.low, data.after.high))
        axes.fill_between(broken(x), lower, upper, color=AFTER, alpha=0.18, lw=0)
    label = "with it" if named else "left, median"
    axes.plot(broken(x), factor * broken(data.after.middle), color=AFTER, lw=1.0, label=label)
    for index, (law, values) in enumerate(data.laws):
        own = index == 0
        colour, dashes = (LAW, "-") if own else (RIVALS[(index - 1) % len(RIVALS)], "--")
        text = title(law) if own else f"rival: {title(law)}"
        axes.plot(broken(x), factor * broken(values), dashes, color=colour, lw=1.3, label=text, zorder=4)
    axes.set_ylim(factor * low, factor * high)
    axes.margins(x=0.02)
    axes.set_xlabel(axis_label(QUANTITY.get(data.signal, data.signal), across_unit))
    axes.locator_params(axis="x", nbins=10 if wide else 6)
    axes.set_ylabel(axis_label(RESIDUAL[data.kind] if named else "residual", unit))
    legend(axes, 4 if wide else 2)
    if twin_scale is not None:
        torque, torque_name = scale_for([low / twin_scale, high / twin_scale], torque_unit)
        slope = torque / (factor * twin_scale)
        twin = axes.secondary_yaxis("right", functions=(partial(np.multiply, slope), partial(np.multiply, 1 / slope)))
        twin.set_ylabel(f"({pretty_unit(torque_name)})")
        twin.spines["right"].set_visible(True)
    return svg(figure, name, f"{sentence_case(title(data.effect or 'remainder'))} against {data.signal}")


def ranking(
    considered: Sequence[Alternative], accepted: str | None, rivals: Sequence[str], threshold: float, name: str
) -> str:
    """Evidence of hypotheses, best first: the accepted one blue, what explains as much in rose, the others grey."""
    shown = sorted(considered, key=lambda a: -a.evidence.net)[:RANKED]
    several = len({a.joint for a in shown}) > 1
    names = [title(a.name) + (f" ({a.joint})" if several else "") for a in shown]
    margin = max(1.52, 0.2 + CHARACTER * max(map(len, names), default=0))
    figure, axes = panel(NARROW, 0.55 + 0.21 * len(shown), left=margin)
    left = max(1.0, 0.3 * threshold)
    for row, hypothesis in enumerate(shown):
        net = hypothesis.evidence.net
        colour = RIVALS[0] if hypothesis.name in rivals else NOISE
        colour = AFTER if hypothesis.name == accepted else colour
        axes.barh(row, max(net, left) - left, left=left, height=0.62, color=colour, zorder=2)
        axes.annotate(
            number(net), (max(net, threshold), row), (3, 0), textcoords="offset points", va="center", fontsize=7
        )
    axes.axvline(threshold, color=BEFORE, lw=0.9, ls="--", zorder=3)
    axes.set_xscale("log")
    axes.set_xlim(left, 12 * max([threshold, *(a.evidence.net for a in shown)]))
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_yticks(range(len(shown)), names)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("Evidence")
    return svg(figure, name, "Evidence of the hypotheses that were weighed")


# ------------------------------------------------------------------------------------------------------------ the logs


def coverage(series: Sequence[Series], position_unit: str, name: str) -> str:
    """Where the logs have been: velocity against position."""
    figure, axes = panel(NARROW, 2.4)
    across, across_unit = scale_for([float(np.max(np.abs(s.reading))) for s in series], position_unit)
    for index, s in enumerate(series):
        step = max(1, len(s.time) // 500)
        dots(axes, across * s.reading[::step], s.velocity[::step], colour_of(s, index))
    axes.set_xlabel(axis_label("position", across_unit))
    axes.locator_params(axis="x", nbins=6)
    axes.set_ylabel(axis_label("velocity", f"{position_unit}/s"))
    return svg(figure, name, "Velocity against position of every log")


def colour_of(series: Series, index: int) -> str:
    """The colour of a log, by its place in the table; held-out logs are grey."""
    return NOISE if series.held_out else LOGS[index % len(LOGS)]


def command_over_time(series: Sequence[Series], unit: str, name: str) -> str:
    """The commands of the logs below each other."""
    shown = series[:6]
    factor, scaled = scale_for(limits(*(s.command for s in shown), share=0.0), unit)
    figure, stacked = stack(NARROW, [1.88 / len(shown) - 0.1 * (len(shown) > 1)] * len(shown))
    for axes, s, index in zip(stacked, shown, range(len(shown)), strict=True):
        step = max(1, len(s.time) // 900)
        axes.plot(s.time[::step] - s.time[0], factor * s.command[::step], color=colour_of(s, index), lw=0.7)
        axes.set_ylim(*limits(factor * s.command, share=0.0))
        axes.margins(x=0)
        axes.locator_params(axis="y", nbins=3)
    stacked[-1].set_xlabel("Time (s)")
    stacked[len(stacked) // 2].set_ylabel(axis_label("command", scaled))
    return svg(figure, name, "Commands of the logs over time")


def free_run(series: Series, unit: str, window: float, name: str) -> str | None:
    """Free simulation before and after on a stretch of a log, its error below; None where nothing was simulated."""
    rows = _worst_stretch(series, window)
    if rows is None:
        return None
    figure, (upper, lower) = stack(WIDE, [1.35, 0.95], top=LEGEND)
    time = series.time[rows]
    before, after = series.free_before[rows], series.free_after[rows]
    high_factor, high_unit = scale_for(limits(series.reading[rows]), unit)
    factor, scaled = scale_for(limits(before, after), unit)
    upper.plot(time, high_factor * series.reading[rows], color=MEASURED, lw=2.0, label="measured")
    for error, colour, label, width in models(before, after):
        style = "--" if colour == AFTER else "-"
        upper.plot(time, high_factor * (series.reading[rows] - error), style, color=colour, lw=width, label=label)
        lower.plot(time, factor * error, color=colour, lw=width)
    upper.set_ylim(*(high_factor * v for v in limits(series.reading[rows], share=0.0)))
    upper.set_ylabel(axis_label("position", high_unit))
    legend(upper, 3)
    lower.set_ylim(*(factor * v for v in limits(before, after)))
    lower.set_ylabel(axis_label("error", scaled))
    lower.set_xlabel("Time (s)")
    lower.set_xlim(time[0], time[-1])
    return svg(figure, name, "Free simulation of both models beside the measurement")


def _worst_stretch(series: Series, window: float, count: int = 5) -> np.ndarray | None:
    """Rows of `count` whole windows [s] in which the nominal model errs most; None without finite errors."""
    simulated = np.flatnonzero(np.isfinite(series.free_before))
    error = np.nan_to_num(series.free_before) ** 2
    if not np.any(error > 0):
        return None
    first, last = int(simulated[0]), int(simulated[-1]) + 1
    width = max(2, round(window / float(np.median(np.diff(series.time)))))
    length = min(count * width, last - first)
    total = np.concatenate([[0.0], np.cumsum(error)])
    begins = np.arange(first, last - length + 1, width)
    begin = int(begins[np.argmax(total[begins + length] - total[begins])])
    return np.arange(begin, begin + length)
