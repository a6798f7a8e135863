"""One yardstick for every contestant: from its answers to figures.

The reference is the held-out log itself, band-limited with zero phase, the same for all. An inverse error compares the
command that a model gives for the reference motion with the recorded one. A free run starts from a state of the
reference and sees nothing but commands; its position is compared with the reference. Samples within
`Task.initialisation_seconds` of either end of a log are not scored. Where several joints have different units, errors
with a unit are those of the rotary ones; relative errors and the columns `..._by_joint` cover all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from benchmarks.tasks.base import Task, TaskData, Truth
from benchmarks.worker import Answers, InverseQuery, SimulationQuery
from envs.log import COMMAND_UNIT, Array, Log
from envs.scara import ScaraBody
from methods.differentiation import BandLimited, Signals

NEAR_REVERSAL = 0.1
"""Share of the rms speed below which a joint counts as near a reversal."""
STARTS = 6
"""Free runs per log for the error against the horizon."""
CURVE_POINTS = 13
QUANTILE = 1.6448536269514722
"""Standard deviations on either side of a normal distribution's centre that hold 90 %."""


@dataclass(frozen=True)
class Metric:
    """One column of figures. Infinite: the model has no answer; NaN: the metric does not apply to the task or method.

    timing: the figure depends on the machine and is left out when tables are compared.
    """

    name: str
    unit: str
    better: Literal["lower", "higher"]
    title: str
    meaning: str
    timing: bool = False


METRICS: dict[str, Metric] = {
    metric.name: metric
    for metric in (
        Metric(
            "inverse_error",
            "command unit",
            "lower",
            "Inverse error",
            "rms of modelled minus recorded command along the held-out motion",
        ),
        Metric(
            "inverse_error_relative",
            "1",
            "lower",
            "Relative inverse error",
            "inverse error over the rms of the command about its mean; rms over joints",
        ),
        Metric(
            "inverse_error_reversals",
            "command unit",
            "lower",
            "Inverse error near reversals",
            "where the joint is slower than a tenth of its rms speed",
        ),
        Metric("inverse_error_elsewhere", "command unit", "lower", "Inverse error elsewhere", "at all other samples"),
        Metric(
            "simulation_error",
            "position unit",
            "lower",
            "Simulation error",
            "rms of the position over one free run per held-out log, from its start to its end",
        ),
        Metric(
            "simulation_error_relative",
            "1",
            "lower",
            "Relative simulation error",
            "simulation error over the rms of the position about its mean; rms over joints",
        ),
        Metric(
            "simulation_error_short",
            "position unit",
            "lower",
            "Simulation error, short horizon",
            "rms over free runs from several instants, at the task's short horizon",
        ),
        Metric(
            "simulation_error_medium", "position unit", "lower", "Simulation error, medium horizon", "as the short one"
        ),
        Metric("simulation_error_long", "position unit", "lower", "Simulation error, long horizon", "as the short one"),
        Metric(
            "tip_error",
            "m",
            "lower",
            "Tip error",
            "rms distance of the tool flange in space at the medium horizon, by the arm's kinematics",
        ),
        Metric(
            "parameter_error",
            "1",
            "lower",
            "Parameter error",
            "median relative error of the identifiable combinations that the method estimates",
        ),
        Metric(
            "interval_coverage",
            "1",
            "higher",
            "Interval coverage",
            "share of these combinations whose 90 % interval holds the truth",
        ),
        Metric("naming", "1", "higher", "Naming", "1 right, 0.5 left open with the truth among it, 0 missed or wrong"),
        Metric("fit_seconds", "s", "lower", "Fit", "wall time of the fit", timing=True),
        Metric("step_microseconds", "µs", "lower", "Step", "wall time of a free run per simulated sample", timing=True),
        Metric("parameter_count", "1", "lower", "Numbers", "numbers that the model carries"),
        Metric(
            "peak_memory_gib",
            "GiB",
            "lower",
            "Memory",
            "largest resident memory of fit and answers beyond the interpreter's",
            timing=True,
        ),
    )
}


@dataclass(frozen=True, eq=False)
class Reference:
    """One held-out log: its band-limited signals, the recorded command (T, n) at their instants, and what is scored."""

    log: Log
    signals: Signals
    command: Array
    first: int
    last: int

    @staticmethod
    def of(log: Log, task: Task) -> Reference:
        """Raises MethodError when the log is too short for the reference's bandwidth."""
        signals = BandLimited(task.bandwidth).signals(log)
        inside = (signals.time >= log.time[0] + task.initialisation_seconds) & (
            signals.time <= log.time[-1] - task.initialisation_seconds
        )
        rows = np.flatnonzero(inside)
        latest = np.searchsorted(log.time, signals.time, side="right") - 1
        return Reference(log, signals, log.command[latest], int(rows[0]), int(rows[-1]) + 1)

    @property
    def scored(self) -> slice:
        return slice(self.first, self.last)

    @cached_property
    def position(self) -> Array:
        """Scored positions, (S, n)."""
        return self.signals.motion.position[self.scored]


@dataclass(frozen=True)
class Stretch:
    """A free run: rows start..stop-1 of a reference's signals."""

    log: int
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Examination:
    """The questions that a task asks of a model, and the answers that the measurement gives."""

    task: Task
    data: TaskData
    references: tuple[Reference, ...]
    whole: tuple[Stretch, ...]
    windows: tuple[Stretch, ...]

    @staticmethod
    def of(task: Task, data: TaskData) -> Examination:
        """Raises MethodError when a held-out log is too short."""
        references = tuple(Reference.of(log, task) for log in data.held_out)
        whole = tuple(Stretch(k, item.first, item.last) for k, item in enumerate(references))
        windows: list[Stretch] = []
        for k, item in enumerate(references):
            length = round(task.horizons_seconds[-1] / item.log.sample_time) + 1
            length = min(length, item.last - item.first)
            starts = np.unique(np.linspace(item.first, item.last - length, STARTS).astype(int))
            windows += [Stretch(k, int(start), int(start) + length) for start in starts]
        return Examination(task, data, references, whole, tuple(windows))

    def simulations(self) -> Iterator[SimulationQuery]:
        """Free runs over the whole logs, then those of the windows."""
        for part in (*self.whole, *self.windows):
            reference = self.references[part.log]
            rows = slice(part.start, part.stop)
            yield SimulationQuery(
                reference.signals.time[rows],
                reference.command[rows],
                reference.signals.motion.state(part.start),
                reference.log.facts[0].hold,
            )

    def inverses(self) -> Iterator[InverseQuery]:
        """The motion of every held-out log."""
        return (InverseQuery(item.signals.time, item.signals.motion) for item in self.references)

    @cached_property
    def horizons(self) -> tuple[float, ...]:
        """Instants after the start at which the curve is taken [s]."""
        short, medium, longest = self.task.horizons_seconds
        grid = np.geomspace(short / 4.0, longest, CURVE_POINTS).tolist()
        return tuple(sorted({*(float(f"{value:.3g}") for value in grid), short, medium, longest}))

    @cached_property
    def rotary(self) -> np.ndarray:
        """Columns that errors with a unit are taken from, shape (n,)."""
        turning = np.array([facts.position_unit == "rad" for facts in self.data.held_out[0].facts])
        return turning if turning.any() else ~turning


def unanswered() -> dict[str, Any]:
    """Every column that `score` fills, empty."""
    return {
        **{name: float("nan") for name in METRICS},
        "noise_floor_inverse": float("nan"),
        "noise_floor_simulation": float("nan"),
        "command_unit": "",
        "position_unit": "",
        "inverse_error_by_joint": [],
        "simulation_error_by_joint": [],
        "curve": [],
        "curve_horizons": [],
        "named": "",
        "naming_outcome": "",
    }


def score(examination: Examination, answers: Answers) -> dict[str, Any]:
    """Every column of a row that follows from the answers."""
    row = unanswered()
    facts = examination.data.held_out[0].facts[int(np.argmax(examination.rotary))]
    row |= {"command_unit": COMMAND_UNIT[facts.input], "position_unit": facts.position_unit}
    row["curve_horizons"] = list(examination.horizons)
    if examination.data.floor is not None:
        row["noise_floor_inverse"] = examination.data.floor.inverse
        row["noise_floor_simulation"] = examination.data.floor.simulation
    if answers.inverses is not None:
        row |= _inverse(examination, answers.inverses)
    if answers.simulations is not None:
        row |= _simulation(examination, answers.simulations)
    row |= _parameters(examination.data.truth, answers)
    if answers.causes is not None:
        row["named"] = "+".join(sorted(f"{cause.effect}@{cause.joint}" for cause in answers.causes))
        if examination.data.judge is not None:
            row["naming_outcome"], row["naming"] = examination.data.judge(answers.verdict, answers.causes)
    return row


def _inverse(examination: Examination, answered: Sequence[Array]) -> dict[str, Any]:
    errors, recorded, near = [], [], []
    for reference, command in zip(examination.references, answered, strict=True):
        rows = reference.scored
        own = reference.signals.command[rows]
        speed = np.abs(reference.signals.motion.velocity[rows])
        errors.append(command[rows] - own)
        recorded.append(own - np.mean(own, axis=0))
        near.append(speed < NEAR_REVERSAL * np.sqrt(np.mean(speed**2, axis=0)))
    error, slow, mean = np.concatenate(errors), np.concatenate(near), examination.rotary
    by_joint = _rms(error, axis=0)
    share = by_joint / _rms(np.concatenate(recorded), axis=0)
    return {
        "inverse_error": _pool(by_joint[mean]),
        "inverse_error_relative": _pool(share),
        "inverse_error_reversals": _rms_of(error[:, mean][slow[:, mean]]),
        "inverse_error_elsewhere": _rms_of(error[:, mean][~slow[:, mean]]),
        "inverse_error_by_joint": by_joint.tolist(),
    }


def _simulation(examination: Examination, answered: Sequence[Array]) -> dict[str, Any]:
    whole = answered[: len(examination.whole)]
    free = answered[len(examination.whole) :]
    error = np.concatenate(
        [run - examination.references[part.log].position for part, run in zip(examination.whole, whole, strict=True)]
    )
    spread = np.concatenate([item.position - np.mean(item.position, axis=0) for item in examination.references])
    by_joint = _rms(error, axis=0)
    mean = examination.rotary
    curve = {
        horizon: _rms_of(np.concatenate([e[:, mean].ravel() for e in _at(examination, free, horizon)]))
        for horizon in examination.horizons
    }
    short, medium, longest = examination.task.horizons_seconds
    return {
        "simulation_error": _pool(by_joint[mean]),
        "simulation_error_relative": _pool(by_joint / _rms(spread, axis=0)),
        "simulation_error_by_joint": by_joint.tolist(),
        "simulation_error_short": curve[short],
        "simulation_error_medium": curve[medium],
        "simulation_error_long": curve[longest],
        "curve": list(curve.values()),
        "tip_error": _tip(examination, free, medium),
    }


def _at(examination: Examination, free: Sequence[Array], horizon: float) -> Iterator[Array]:
    """Position errors (1, n) of the free runs that last long enough, at the horizon."""
    for found, true in _pairs(examination, free, horizon):
        yield found - true


def _pairs(examination: Examination, free: Sequence[Array], horizon: float) -> Iterator[tuple[Array, Array]]:
    yield np.empty((0, len(examination.rotary))), np.empty((0, len(examination.rotary)))
    for part, run in zip(examination.windows, free, strict=True):
        reference = examination.references[part.log]
        row = round(horizon / reference.log.sample_time)
        if row < len(run):
            yield run[row : row + 1], reference.signals.motion.position[part.start + row : part.start + row + 1]


def _tip(examination: Examination, free: Sequence[Array], horizon: float) -> float:
    body = examination.data.kinematics
    if body is None:
        return float("nan")
    joints = examination.data.held_out[0].joints
    found, true = (np.concatenate(part) for part in zip(*_pairs(examination, free, horizon), strict=True))
    away = _tool(body, joints, found) - _tool(body, joints, true)
    return _rms_of(np.linalg.norm(away, axis=-1))


def _tool(body: ScaraBody, joints: tuple[int, ...], position: Array) -> Array:
    full = np.zeros((len(position), 4))
    full[:, [joint - 1 for joint in joints]] = position
    return body.tool_pose(full)[:, :3]


def _parameters(truth: Truth | None, answers: Answers) -> dict[str, float]:
    """A combination counts when the method reports it under the same name and in the same unit."""
    known = {} if truth is None else {(name, item.unit): item.value for name, item in truth.parameters.items()}
    shared = [key for key in answers.estimates if known.get(key, 0.0) != 0.0]
    if not shared:
        return {"parameter_error": float("nan"), "interval_coverage": float("nan")}
    true = np.array([known[key] for key in shared])
    found, errors = np.array([answers.estimates[key] for key in shared]).T
    inside = np.abs(found - true) <= QUANTILE * errors
    return {
        "parameter_error": float(np.median(np.abs(found / true - 1.0))),
        "interval_coverage": float(np.mean(inside)) if np.isfinite(errors).all() else float("nan"),
    }


def _rms(values: Array, axis: int) -> Array:
    """Root mean squares; infinite where a value is missing."""
    with np.errstate(over="ignore", invalid="ignore"):
        found = np.sqrt(np.mean(values**2, axis=axis))
    return np.where(np.isfinite(found), found, np.inf)


def _rms_of(values: Array) -> float:
    """Root mean square of all values; NaN when there are none."""
    return float(_rms(values.ravel(), axis=0)) if values.size else float("nan")


def _pool(values: Array) -> float:
    """Root mean square of root mean squares over equally many samples."""
    return _rms_of(values)
