"""``adeptone fit``: one method on log files, its model in a JSON file, its errors on logs that it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from envs.compatibility import check_apart, check_together, with_robot
from envs.log import Array, Log
from envs.log_files import load, write_atomically
from envs.output_place import check_file
from envs.robots import find_robot
from methods.base import Fit, Method, MethodError, Model, State, Status
from methods.differentiation import BandLimited, Signals
from methods.model_files import fit_to_json
from methods.plugins import build_method, find_method
from methods.registry import Entry, one_line

WINDOW = 1.0
"""Length of a window of free simulation [s], each begun at the measured state."""
BAND = 30.0
"""Bandwidth of the differentiator that gives the measured motion [Hz], less for logs of a low rate."""


@dataclass(frozen=True)
class HeldOutError:
    """Errors of one joint on one log, root mean squares; NaN where the model has no answer or its simulation diverges.

    command [command_unit]: of the inverse along the measured motion. windows, whole [position_unit]: of free
    simulation in windows of `WINDOW`, and over the whole log.
    """

    log: str
    joint: int
    command: float
    command_unit: str
    windows: float
    whole: float
    position_unit: str


def fit_files(
    name: str,
    logs: Sequence[Path],
    out: Path,
    *,
    holdout: Sequence[Path] = (),
    robot: str | None = None,
    joint: int | None = None,
    columns: Path | None = None,
    repair: bool = False,
    seed: int = 0,
) -> str:
    """Fit a method to log files, write its model to `out`, and return what the terminal shows.

    name: of a registered method, or the path of a file that registers one. Nothing is written unless all went well.
    Raises LogError, RobotError, RegistryError or MethodError for unusable input.
    """
    check_file(out)
    entry = find_method(name)
    method = build_method(entry)
    fitted, unseen = read_logs(entry, logs, holdout, robot, joint, columns, repair=repair)
    fit = run(entry, method, fitted, seed)
    text = fit_to_json(method, entry.name, fit, fitted, seed)
    errors = [error for log in unseen for error in held_out_errors(fit.model, log)]
    write_atomically({out: text.encode()})
    return "\n".join([*told(entry, fit), *(told_error(error) for error in errors), f"written to {out}"])


def read_logs(
    entry: Entry[Method],
    logs: Sequence[Path],
    holdout: Sequence[Path],
    robot: str | None,
    joint: int | None,
    columns: Path | None,
    *,
    repair: bool,
) -> tuple[list[Log], list[Log]]:
    """Logs to fit and logs to measure errors on, checked, and reduced to `joint` where it is given."""
    read = [load(path, columns, repair=repair) for path in (*logs, *holdout)]
    if robot is not None:
        described = find_robot(robot)
        read = [with_robot(log, described)[0] for log in read]
    check_together(read)
    if joint is not None:
        read = [log.joint(joint) for log in read]
    several = next((log for log in read if len(log.joints) > 1), None)
    if several is not None and "multi-joint" not in entry.tags:
        raise MethodError(
            f"{several.name} holds the joints {', '.join(map(str, several.joints))} and {entry.name} fits one",
            remedy="Choose it with --joint",
        )
    fitted, unseen = read[: len(logs)], read[len(logs) :]
    check_apart(fitted, unseen)
    return fitted, unseen


def run(entry: Entry[Method], method: Method, logs: Sequence[Log], seed: int) -> Fit:
    """The fit. What a foreign method raises becomes a MethodError; a fit that failed is one too."""
    try:
        fit = method.fit(logs, np.random.default_rng(seed))
    except MethodError:
        raise
    except Exception as error:
        if entry.factory.__module__.startswith("methods."):
            raise
        raise MethodError(
            f"{entry.name} fails in fit: {one_line(error)}", remedy="Mend the method; adeptone check-method says more"
        ) from error
    if not isinstance(fit, Fit):
        raise MethodError(
            f"fit of {entry.name} returns a {type(fit).__name__}", remedy="Return a methods.base.Fit from it"
        )
    if fit.status is Status.FAILED:
        reasons = "; ".join(fit.notes) or "it gives no reason"
        raise MethodError(f"{entry.name} found nothing: {reasons}", remedy="Try other logs or another method")
    return fit


def held_out_errors(model: Model, log: Log) -> list[HeldOutError]:
    """Errors per joint on one log."""
    log = log.select(model.joints)
    signals = BandLimited(bandwidth=min(BAND, 0.2 / log.sample_time)).signals(log)
    modelled = model.inverse(signals.time, signals.motion, signals.command)
    width = max(8, round(WINDOW / log.sample_time))
    starts = range(0, max(1, len(signals) - width + 1), width)
    parts = np.concatenate([free_run_error(model, log, signals, a, min(a + width, len(signals))) for a in starts])
    whole = free_run_error(model, log, signals, 0, len(signals))
    return [
        HeldOutError(
            log=log.name,
            joint=number,
            command=_rms((signals.command - modelled)[:, j]),
            command_unit=facts.command_unit,
            windows=_rms(parts[:, j]),
            whole=_rms(whole[:, j]),
            position_unit=facts.position_unit,
        )
        for j, (number, facts) in enumerate(zip(log.joints, log.facts, strict=True))
    ]


def free_run_error(model: Model, log: Log, signals: Signals, start: int, stop: int) -> Array:
    """Measured minus simulated position over samples start..stop-1 of the signals, (N, n)."""
    rows = slice(signals.start + start, signals.start + stop)
    initial: State = signals.motion.state(start)
    motion = model.simulate(log.time[rows], log.command[rows], initial, log.facts[0].hold)
    error: Array = log.position[rows] - motion.position
    return error


def told(entry: Entry[Method], fit: Fit) -> list[str]:
    """Status, notes, and the estimates as a table with standard errors."""
    lines = [f"{entry.name}: {fit.status.value} after {fit.seconds:.3g} s", *fit.notes]
    estimates = fit.estimates
    if not estimates.names:
        return [*lines, "no estimates: the model is not made of physical parameters"]
    rows = [("estimate", "value", "standard error", "unit")]
    for name, unit, value, error in zip(
        estimates.names, estimates.units, estimates.values, estimates.standard_errors, strict=True
    ):
        rows.append((name, f"{value:.6g}", f"{error:.2g}" if np.isfinite(error) else "not given", unit))
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    table = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return [*lines, *table]


def told_error(error: HeldOutError) -> str:
    """One line on a held-out log."""
    figures = [
        ("command", error.command, error.command_unit, "no inverse"),
        (f"free simulation over {WINDOW:g} s", error.windows, error.position_unit, "diverges"),
        ("over the whole log", error.whole, error.position_unit, "diverges"),
    ]
    shown = (
        f"{what} {value:.4g} {unit}" if np.isfinite(value) else f"{what} {lost}" for what, value, unit, lost in figures
    )
    return f"rms error on {error.log}, joint {error.joint}: {', '.join(shown)}"


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
