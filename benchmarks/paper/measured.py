"""The paper's pipeline on measured logs: step 1, step 2, inverse and forward validation, without any truth.

The first log is fitted, the others are held out; of a single log the last 40 % are held out. Beside the paper's three
columns stands the textbook regression with dry friction and offset (`IDIM`), and, for a rig whose figures others have
published, the comparison with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.paper.contestants import RAW, Contestant, contestants
from benchmarks.paper.evaluation import Reference, score
from benchmarks.paper.study import Showcase, fit_all, history
from benchmarks.paper.tables import Table, symbol_of
from envs.data_sets import names as rig_names
from envs.log import COMMAND_UNIT, Log, LogError
from envs.rigs import rig
from methods.base import Fit, MethodError
from methods.differentiation import BandLimited, ButterworthDifferences
from methods.least_squares import LeastSquares, condition_number
from methods.regressor import HORIZONTAL, ColumnName

IDIM = "LS, Coulomb and offset columns (IDIM)"
FITTED_SHARE = 0.6
WINDOW = 1.0
"""Seconds after which a free run starts anew from the measurement: a closed loop forgives no open-loop drift."""
PUBLISHED: tuple[tuple[str, ColumnName], ...] = (
    ("mass", "acceleration"),
    ("viscous", "velocity"),
    ("coulomb", "coulomb"),
    ("offset", "constant"),
)


@dataclass(frozen=True, eq=False)
class Measured:
    """Everything about one joint of some measured logs."""

    log: Log
    held_out: tuple[Log, ...]
    showcase: Showcase
    tables: tuple[Table, ...]
    notes: tuple[str, ...]


def joint_of(logs: Sequence[Log], joint: int | None) -> tuple[Log, ...]:
    """The logs reduced to one joint: the one asked for, else the only one. Raises LogError."""
    if joint is None:
        found = {log.joints for log in logs}
        if any(len(joints) > 1 for joints in found):
            raise LogError(
                f"the log holds joints {sorted({number for joints in found for number in joints})}",
                remedy="Choose one of them with --joint",
                source=next(log.source for log in logs if len(log.joints) > 1),
            )
        return tuple(logs)
    return tuple(log.joint(joint) for log in logs)


def split(logs: Sequence[Log]) -> tuple[Log, tuple[Log, ...]]:
    """What is fitted and what is held out."""
    first, *others = logs
    if others:
        return first, tuple(others)
    cut = round(FITTED_SHARE * len(first))
    return first.slice(0, cut), (first.slice(cut, len(first)),)


def study_measured(logs: Sequence[Log], seed: int) -> Measured:
    """Runs the pipeline on logs of one joint. Raises MethodError or LogError when they cannot carry it."""
    log, held_out = split(logs)
    for other in held_out:
        _check_alike(log, other)
    smooth = fitting_bandwidth(log)
    idim = idim_for(log)
    for part in (log, *held_out):
        _check_long_enough(part, smooth)
    chosen = (*contestants(HORIZONTAL, smooth), Contestant(IDIM, idim))
    fits = fit_all(chosen, log, seed)
    estimators: dict[str, LeastSquares] = {
        "three columns, raw": LeastSquares(RAW),
        "three columns, band-limited": LeastSquares(smooth),
        "three columns, Coulomb, offset": LeastSquares(smooth, (*HORIZONTAL, "coulomb", "constant")),
    }
    showcase = Showcase(
        log=log,
        fits=fits,
        histories={name: history(method, log) for name, method in estimators.items()},
        truth={},
        filtered=smooth,
        window=WINDOW,
    )
    published, notes = published_table(log, held_out, idim, fits[IDIM])
    return Measured(
        log=log,
        held_out=held_out,
        showcase=showcase,
        tables=(
            *published,
            left_over_table(log, held_out, {**estimators, IDIM: idim}),
            parameter_table(log, {**estimators, IDIM: idim}),
            error_table(fits, (log, *held_out), smooth),
        ),
        notes=notes,
    )


def _check_long_enough(log: Log, smooth: BandLimited) -> None:
    """Raises LogError for a log that the differentiator would eat up."""
    needed = 4 * smooth.half_width(log.sample_time)
    if len(log) < needed:
        raise LogError(
            f"{len(log)} samples are too few: a differentiator of {smooth.bandwidth:.3g} Hz needs {needed}",
            remedy=f"Record {needed * log.sample_time:.2g} s or more",
            source=log.source,
        )


def _check_alike(log: Log, other: Log) -> None:
    """Raises LogError when `other` cannot be a held-out log of the same joint."""
    differs = {
        "of another joint": other.joints != log.joints,
        "of another robot": other.robot != log.robot,
        "driven by another kind of input": other.facts[0].input != log.facts[0].input,
        f"sampled every {1e3 * other.sample_time:.3g} ms, the fitted one every {1e3 * log.sample_time:.3g} ms": not (
            0.95 < other.sample_time / log.sample_time < 1.05
        ),
    }
    for what, found in differs.items():
        if found:
            raise LogError(f"this log is {what}", remedy="Give logs of one joint, recorded alike", source=other.source)


def fitting_bandwidth(log: Log) -> BandLimited:
    """30 Hz, or a sixth of the sampling rate where that is less."""
    return BandLimited(min(30.0, 1.0 / log.sample_time / 6.0))


def idim_for(log: Log) -> LeastSquares:
    """Inverse dynamic identification as in the EMPS scripts, its frequencies scaled to the log's sampling rate."""
    rate = 1.0 / log.sample_time
    return LeastSquares(
        ButterworthDifferences(cutoff=min(100.0, 0.2 * rate)),
        ("acceleration", "velocity", "coulomb", "constant"),
        reversal_velocity=1e-9,
        decimation=max(1, round(rate / 100.0)),
    )


def relative_error(method: LeastSquares, fit: Fit, log: Log) -> float:
    """Residual over command on the method's own equations, norm over norm [1]."""
    problem = method.problem([log])
    residual = problem.command - problem.regressor @ fit.estimates.values
    return float(np.linalg.norm(residual) / np.linalg.norm(problem.command))


def published_table(
    log: Log, held_out: Sequence[Log], idim: LeastSquares, fit: Fit
) -> tuple[tuple[Table, ...], tuple[str, ...]]:
    """The regression with Coulomb and offset columns against published figures of the rig, if there are any."""
    if log.robot not in rig_names():
        return (), ()
    machine = rig(log.robot)
    figures = machine.published().get("Coulomb friction")
    if figures is None or not all(name in figures for name, _ in PUBLISHED):
        return (), ()
    factor = 1.0 / machine.robot().input_equivalent(log.joints[0])
    unit = machine.robot().joint(log.joints[0]).torque_unit
    units = {"mass": "kg" if unit == "N" else "kg m^2", "viscous": f"{unit} s/{log.facts[0].position_unit}"}
    rows: list[tuple[object, ...]] = []
    for name, column in PUBLISHED:
        value = factor * fit.estimates[column]
        spread = factor * float(fit.estimates.standard_errors[fit.estimates.names.index(column)])
        stated = figures[name]
        rows.append((name, units.get(name, unit), stated, value, spread, f"{100 * (value / stated - 1):+.2f} %"))
    errors = ("relative_force_error_estimation", "relative_force_error_pulses")
    for name, part in zip(errors, (log, *held_out), strict=False):
        if name in figures:
            value, stated = 100 * relative_error(idim, fit, part), 100 * figures[name]
            rows.append((name.replace("_", " "), "%", stated, value, None, f"{value - stated:+.2f} points"))
    table = Table(
        "published",
        f"{machine.title}: least squares with Coulomb and offset columns against the published figures",
        ("figure", "unit", "published", "here", "standard error", "deviation"),
        tuple(rows),
        digits=5,
    )
    note = f"{log.name} is recognised as the rig {machine.name}; published figures stand beside ours."
    return (table,), (note,)


def left_over_table(log: Log, held_out: Sequence[Log], estimators: Mapping[str, LeastSquares]) -> Table:
    """What each way through step 1 leaves of the command, and how much of that a friction term would explain."""
    unit = COMMAND_UNIT[log.facts[0].input]
    rows: list[tuple[object, ...]] = []
    for name, method in estimators.items():
        fit = method.fit([log], np.random.default_rng(0))
        for part in (log, *held_out):
            problem = method.problem([part])
            residual = problem.command - problem.regressor @ fit.estimates.values
            velocity = np.concatenate([signals.motion.velocity[:, 0] for signals in problem.signals])
            direction = np.sign(velocity) if method.decimation == 1 else None
            rows.append(
                (
                    name,
                    part.name,
                    float(np.sqrt(np.mean(residual**2))),
                    100.0 * float(np.linalg.norm(residual) / np.linalg.norm(problem.command)),
                    None if direction is None else f"{100.0 * _explained(residual, direction):.1f}",
                )
            )
    return Table(
        "left_over",
        "What step 1 leaves of the command",
        ("estimator", "log", f"residual [{unit}]", "relative [%]", "explained by direction and offset [%]"),
        tuple(rows),
    )


def _explained(residual: np.ndarray, direction: np.ndarray) -> float:
    """Share of the residual's mean square that a constant and the sign of the velocity explain."""
    columns = np.column_stack((direction, np.ones_like(direction)))
    rest = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
    return 1.0 - float(np.sum(rest**2) / np.sum(residual**2))


def parameter_table(log: Log, estimators: Mapping[str, LeastSquares]) -> Table:
    """Estimates with standard errors and condition numbers."""
    rows: list[tuple[object, ...]] = []
    for name, method in estimators.items():
        fit = method.fit([log], np.random.default_rng(0))
        condition = condition_number(method.problem([log]).regressor)
        rows += [
            (name, symbol_of(column, log.joints[0]), unit, float(value), float(spread), condition)  # type: ignore[arg-type]
            for column, unit, value, spread in zip(
                fit.estimates.names,
                fit.estimates.units,
                fit.estimates.values,
                fit.estimates.standard_errors,
                strict=True,
            )
        ]
    return Table(
        "parameters",
        "Estimates of step 1",
        ("estimator", "coefficient", "unit", "estimate", "standard error", "condition number"),
        tuple(rows),
    )


def error_table(fits: Mapping[str, Fit], logs: Sequence[Log], smooth: BandLimited) -> Table:
    """Inverse and forward errors of all contestants on all logs."""
    unit, position = COMMAND_UNIT[logs[0].facts[0].input], logs[0].facts[0].position_unit
    rows: list[tuple[object, ...]] = []
    for k, log in enumerate(logs):
        reference = Reference.of(log, smooth)
        for name, fit in fits.items():
            windowed, free = score(fit.model, reference, WINDOW), score(fit.model, reference)
            rows.append(
                (
                    name,
                    log.name + (" (fitted)" if k == 0 else ""),
                    windowed.inverse,
                    windowed.inverse_relative,
                    windowed.position,
                    windowed.velocity,
                    windowed.acceleration,
                    free.position,
                )
            )
    return Table(
        "errors",
        f"Errors; forward from a fresh start every {WINDOW:g} s, and position in a free run over the whole log",
        (
            "method",
            "log",
            f"inverse [{unit}]",
            "inverse, relative",
            f"position [{position}]",
            f"velocity [{position}/s]",
            f"acceleration [{position}/s²]",
            f"free run [{position}]",
        ),
        tuple(rows),
    )


def readable(logs: Sequence[Log]) -> tuple[Log, ...]:
    """The logs with names that tell them apart. Raises MethodError for logs without any motion."""
    for log in logs:
        if float(np.ptp(log.position)) == 0.0:
            raise MethodError(f"{log.source or log.name}: the joint never moves", remedy="Give a log in which it does")
    counted = {log.name for log in logs}
    if len(counted) == len(logs):
        return tuple(logs)
    return tuple(replace(log, name=f"{log.name} {number}") for number, log in enumerate(logs, start=1))
