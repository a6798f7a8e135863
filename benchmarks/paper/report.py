"""From results to files: figures, tables, page. Nothing is written before everything is done."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.paper import contestants as names
from benchmarks.paper import doubt_figures, figures
from benchmarks.paper.claims import claims_table, judge
from benchmarks.paper.doubts import Doubts
from benchmarks.paper.drawing import paper_style, save
from benchmarks.paper.experiment import HELD_OUT, TRAINING
from benchmarks.paper.measured import IDIM, Measured
from benchmarks.paper.page import Page, Picture, Section, render
from benchmarks.paper.study import DrawResult
from benchmarks.paper.tables import (
    ErrorSummary,
    Table,
    choices_table,
    doubt_tables,
    error_tables,
    joints_table,
    parameter_tables,
    structure_table,
    summarise_errors,
)

Drawing = tuple[str, Callable[..., Figure], tuple[object, ...]]
"""File name, function and its arguments."""


@dataclass(frozen=True, eq=False)
class Report:
    """Everything that is to be written: drawings, tables by file name, and the page."""

    drawings: tuple[Drawing, ...]
    tables: tuple[Table, ...]
    page: Page


def draw(drawing: Drawing, folder: Path) -> str:
    """One figure into a folder; its name."""
    name, function, arguments = drawing
    with paper_style():
        save(function(*arguments), folder, name)
    return name


def write(report: Report, out: Path, draw_all: Callable[[Sequence[Drawing], Path], None]) -> None:
    """Figures, tables and page into `out`; they appear together once all of them are complete."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=".paper-") as place:
        folder = Path(place) / "paper"
        (folder / "figures").mkdir(parents=True)
        (folder / "tables").mkdir()
        draw_all(report.drawings, folder / "figures")
        for table in report.tables:
            (folder / "tables" / f"{table.name}.csv").write_text(table.csv(), encoding="utf-8")
            (folder / "tables" / f"{table.name}.md").write_text(table.markdown(), encoding="utf-8")
        claims = folder / "tables" / "claims.csv"
        if claims.exists():
            claims.rename(folder / "claims.csv")
        (folder / "index.html").write_text(render(report.page, folder / "figures"), encoding="utf-8")
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                target = out / path.relative_to(folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                path.replace(target)


def paper_report(results: Sequence[DrawResult], doubts: Doubts) -> Report:
    """The report on the synthetic experiment."""
    show = results[0].showcase
    assert show is not None
    summaries = summarise_errors(results)
    verdicts = claims_table(judge(results))
    all_parameters, parameters, parameters_compact = parameter_tables(results)
    all_errors, all_summaries, *by_log = error_tables(results, summaries)
    joints, structures, choices = joints_table(summaries), structure_table(results), choices_table()
    excitations, bandwidths = doubt_tables(doubts)
    drawings: tuple[Drawing, ...] = (
        ("fig1_robot_and_network", figures.robot_and_network, ()),
        ("fig2_input", figures.excitation, (show,)),
        ("fig3_responses", figures.responses, (show,)),
        ("fig4_parameters", figures.parameter_history, (show,)),
        ("fig5_inverse", figures.inverse_outputs, (show,)),
        ("fig6_learning", figures.learning, ([result.learning_curves for result in results],)),
        ("fig7_forward", figures.forward, (show,)),
        ("fig8_doubt_excitation", doubt_figures.excitation, (doubts,)),
        ("fig9_doubt_bandwidth", doubt_figures.bandwidth, (doubts,)),
        ("fig10_doubt_validation", doubt_figures.comparison, (summaries,)),
    )
    page = Page(
        title="Two-step identification of a voltage-driven arm: the paper's method repeated and judged",
        abstract=_abstract(results, summaries, verdicts),
        verdicts=verdicts,
        sections=(
            Section(
                "The method",
                (
                    "Each joint is moved alone by a periodic converter voltage while brakes hold the others. Step 1 "
                    "fits v = a₁q‴ + a₂q″ + a₃q′ (plus a constant where gravity acts) by the pseudo-inverse. Step 2 "
                    "trains a two-layer network v₂ = Uᵀf(Ws) on what is left, sample by sample, with s = (q, q′) or "
                    "s = (q, q′, q″, q‴). The result is scored as an inverse model in volts and, solved forward, in "
                    "position, velocity and acceleration.",
                    "The measured machine is a MuJoCo plant of the AdeptOne with dry friction, cogging and a dead zone "
                    "that no method is told about; every table covers an ensemble of such machines.",
                ),
                (
                    Picture(
                        "fig1_robot_and_network",
                        "Fig. 1. (a) The robot. (b) The compensator beside the identified model.",
                    ),
                    Picture("fig2_input", "Fig. 2. Input voltage of joint 1."),
                    Picture(
                        "fig3_responses",
                        "Fig. 3. Responses of joint 1: (a) position, (b) velocity, (c) acceleration, (d) jerk; the "
                        "window in (d) magnifies the band-limited jerk of two seconds.",
                    ),
                ),
                folded=(choices,),
            ),
            Section(
                "Step 1: parameters",
                (
                    "Standard errors allow for residuals that are correlated in time. The Cramér-Rao bound counts only "
                    "the encoder's resolution: it is what the log could tell if the model were complete. The gap "
                    "between the two is what unmodelled effects cost.",
                ),
                (
                    Picture(
                        "fig4_parameters",
                        "Fig. 4. Estimates against the number of samples, by the paper's recipe and with one change "
                        "after another.",
                    ),
                ),
                (parameters_compact,),
                (parameters,),
            ),
            Section(
                "Step 2: compensator",
                (),
                (
                    Picture(
                        "fig5_inverse",
                        "Fig. 5. Inverse system: (a, b) recorded input and model outputs, (c, d) output of the "
                        "compensator, (e, f) errors without and with it.",
                    ),
                    Picture(
                        "fig6_learning",
                        "Fig. 6. Mean squared error against learning time; lines are medians, bands the 10 to 90 % "
                        "range over the ensemble.",
                    ),
                    Picture(
                        "fig7_forward",
                        "Fig. 7. Free run under the training sine: (a to c) motion, (d to f) errors as printed, (g to "
                        "i) errors on band-limited signals.",
                    ),
                ),
                (joints,),
                (structures,),
            ),
            Section(
                "What is doubtful",
                (
                    "One sine cannot identify three parameters: in steady state the jerk column is the negative "
                    "velocity column. Raw finite differences drown a₁₁ in the encoder's quantisation noise. Validation "
                    "on the training sine flatters the compensator.",
                ),
                (
                    Picture(
                        "fig8_doubt_excitation",
                        "Fig. 8. (a) Jerk against velocity column. (b) Relative Cramér-Rao bound (bars) and relative "
                        "error of band-limited least squares (markers) by excitation.",
                    ),
                    Picture(
                        "fig9_doubt_bandwidth",
                        "Fig. 9. Estimate of a₁₁ over its true value against the bandwidth of the differentiator, for "
                        "three encoders, without hidden effects; diamonds: raw differences.",
                    ),
                    Picture(
                        "fig10_doubt_validation",
                        "Fig. 10. All contestants, fitted on the training sine only: (a) inverse, (b) free run; "
                        "medians over the ensemble.",
                    ),
                ),
                folded=(excitations, bandwidths),
            ),
            Section(
                "All contestants in numbers",
                (
                    "Median and 10 to 90 % range over the ensemble. A model that leaves the finite numbers counts as "
                    "infinitely wrong; networks without a model have no unique forward solution.",
                ),
                tables=tuple(by_log[:1]),
                folded=tuple(by_log[1:]),
            ),
        ),
    )
    return Report(
        drawings,
        (
            verdicts,
            choices,
            all_parameters,
            parameters,
            parameters_compact,
            all_errors,
            all_summaries,
            *by_log,
            joints,
            structures,
            excitations,
            bandwidths,
        ),
        page,
    )


def _abstract(results: Sequence[DrawResult], summaries: Sequence[ErrorSummary], verdicts: Table) -> tuple[str, ...]:
    median = {(item.method, item.log): item.median("inverse") for item in summaries if item.joint == 1}
    counted = [str(row[-1]) for row in verdicts.rows]
    whole = sum(verdict == "reproduced" for verdict in counted)
    partly = sum(verdict.startswith("reproduced only") for verdict in counted)
    worst = max(HELD_OUT, key=lambda log: median[names.PRINTED, log])
    off = 100.0 * float(np.median([row.off[0] for result in results for row in result.histories[:1]]))
    before, after = (1e3 * median[name, TRAINING] for name in (names.LS_RAW, names.PRINTED))
    return (
        f"The method was repeated on {len(results)} parameter draws of a simulated AdeptOne with hidden friction, "
        f"cogging and dead zone. Of {len(counted)} claims {whole} reproduced as printed, {partly} only under a "
        f"condition, {len(counted) - whole - partly} did not.",
        f"On the training sine the compensator takes the inverse error from {before:.0f} mV to {after:.0f} mV; "
        f"on the least kind held-out log ({worst}) from {1e3 * median[names.LS_RAW, worst]:.0f} mV to "
        f"{1e3 * median[names.PRINTED, worst]:.0f} mV. The estimate of a₁₁ by raw differences of one sine is off by "
        f"{off:.1f} %.",
    )


def measured_report(measured: Measured) -> Report:
    """The report on measured logs."""
    show, log = measured.showcase, measured.log
    tables = {table.name: table for table in measured.tables}
    left = {(row[0], row[1]): row[3] for row in tables["left_over"].rows}
    three, full = left["three columns, band-limited", log.name], left[IDIM, log.name]
    held = ", ".join(other.name for other in measured.held_out)
    drawings: tuple[Drawing, ...] = (
        ("fig2_input", figures.excitation, (show,)),
        ("fig3_responses", figures.responses, (show,)),
        ("fig4_parameters", figures.parameter_history, (show,)),
        ("fig5_inverse", figures.inverse_outputs, (show,)),
        ("fig6_learning", figures.learning, ([{k: fit.learning_curve for k, fit in show.fits.items()}],)),
        ("fig7_forward", figures.forward, (show,)),
        ("left_over", figures.left_over, (show,)),
    )
    page = Page(
        title=f"Two-step identification of joint {log.joints[0]} from measured logs",
        abstract=(
            f"Fitted: {log.name} ({len(log)} samples, {log.duration:.1f} s). Held out: {held}.",
            f"The paper's three columns leave {three:.1f} % of the command unexplained; with columns for dry friction "
            f"and offset {full:.1f} % are left.",
            *measured.notes,
        ),
        verdicts=None,
        sections=(
            *((Section("Published figures", tables=(tables["published"],)),) if "published" in tables else ()),
            Section(
                "What the three-column model leaves over",
                (
                    "The paper's regressor has no column for dry friction and none for an offset. What it leaves is "
                    "shown against velocity; a step at zero is dry friction.",
                ),
                (Picture("left_over", "What is left of the command, against velocity and against time."),),
                (tables["left_over"],),
            ),
            Section(
                "The record",
                pictures=(
                    Picture("fig2_input", "Fig. 2. Input."),
                    Picture("fig3_responses", "Fig. 3. Position and its derivatives, raw and band-limited."),
                ),
            ),
            Section(
                "Step 1",
                pictures=(Picture("fig4_parameters", "Fig. 4. Estimates against the number of samples."),),
                tables=(tables["parameters"],),
            ),
            Section(
                "Step 2",
                (f"Free runs start anew from the measurement every {show.window:g} s.",),
                (
                    Picture("fig5_inverse", "Fig. 5. Outputs of the inverse system without and with compensator."),
                    Picture("fig6_learning", "Fig. 6. Mean squared error against learning time."),
                    Picture("fig7_forward", "Fig. 7. Simulation and measurement, without and with compensator."),
                ),
                (tables["errors"],),
            ),
        ),
    )
    return Report(drawings, measured.tables, page)
