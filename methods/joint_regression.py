"""Inverse dynamic identification of one joint, the frame that all linear contestants share: IDIM.

Command and motion are low-passed by one zero-phase filter, the regressor Y of `methods.regressor` is formed, columns
that are not linear in the motion pass the same filter as the command, and both sides are thinned out by a zero-phase
decimation (parallel filtering); what remains is one overdetermined system v = Y a per log, whose solution is the
contestant's own business (M. Gautier, Dynamic identification of robots with power model, ICRA 1997; A. Janot,
P.-O. Vandanjon, M. Gautier, IEEE Trans. Control Syst. Technol. 22 (2014) 132, section II).

The filter's bandwidth follows the excitation: five times the band that holds 95 % of the velocity's power. Where the
noise of the encoder asks for it, it is narrowed until the noise in the highest derivative is less than
`attenuation` of that column's own power, which is the share by which least squares would shrink its coefficient.
"""

from __future__ import annotations

import abc
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import decimate, fftconvolve, savgol_filter

from envs.log import Array, JointFacts, Log
from envs.log_statistics import position_noise
from methods.base import Estimates, Fit, Method, MethodError, Status
from methods.differentiation import BandLimited, Signals
from methods.joint_model import JointModel
from methods.least_squares import ILL_CONDITIONED, condition_number
from methods.named_terms import causes_of, selected, verdict_of
from methods.regressor import ColumnName, column_unit, regressor
from methods.usable_logs import check_joint

NOT_LINEAR: tuple[ColumnName, ...] = ("coulomb", "sine", "cosine")
"""Columns that do not commute with a filter of the motion."""
NOT_NEGATIVE: tuple[ColumnName, ...] = ("jerk", "velocity", "coulomb")
"""Columns of lag and friction: a joint with a negative coefficient there would drive itself."""
WIDEST = 60.0
"""Bandwidth [Hz] that no joint of an arm needs more than."""


@dataclass(frozen=True, eq=False)
class Equations:
    """v = Y a for the stacked logs: regressor Y (N, p), command v (N,), `logs` (N,) the log of each row.

    rate: rows per second. Y's columns are `columns`; reversal_velocity: w of the Coulomb column; bandwidth: of the
    filter [Hz]; `sources`: the logs themselves.
    """

    regressor: Array
    command: Array
    logs: np.ndarray
    columns: tuple[ColumnName, ...]
    reversal_velocity: float
    rate: float
    bandwidth: float
    sources: tuple[Log, ...]

    def without(self, name: ColumnName) -> Equations:
        """The same equations with one column left out."""
        kept = [k for k, column in enumerate(self.columns) if column != name]
        return replace(self, regressor=self.regressor[:, kept], columns=tuple(self.columns[k] for k in kept))


@dataclass(frozen=True)
class Preparation:
    """From logs to equations; see the module.

    bandwidth: of the filter [Hz]; None: by excitation and noise. attenuation: share of noise in the highest
    derivative that is put up with. columns: of the regressor; None: those of the joint's physics (`physical_columns`).
    reversal_velocity: w of the Coulomb column as a share of the largest speed. decimation: rows are kept at
    2.5 `decimation` times the bandwidth.
    """

    bandwidth: float | None = None
    attenuation: float = 2e-4
    columns: tuple[ColumnName, ...] | None = None
    reversal_velocity: float = 1e-3
    decimation: float = 2.0

    def equations(self, logs: Sequence[Log]) -> Equations:
        """The stacked equations of all logs. Raises MethodError for unusable logs."""
        _, facts = check_joint(logs)
        columns = self.columns or physical_columns(facts)
        made = self._made(logs, columns, self.bandwidth or self._bandwidth(logs, columns))
        if self.columns is None and facts.position_unit == "rad" and gravity_turns(made):
            return made
        return made if self.columns is not None else made.without("sine").without("cosine")

    def signals(self, logs: Sequence[Log]) -> tuple[Signals, ...]:
        """Command and motion of every log behind the filter, before decimation."""
        bandwidth = self.equations(logs).bandwidth
        return tuple(BandLimited(bandwidth).signals(log) for log in logs)

    def _bandwidth(self, logs: Sequence[Log], columns: tuple[ColumnName, ...]) -> float:
        wide = max(excitation_band(log) for log in logs)
        bandwidth = min(max(5.0 * wide, 5.0), WIDEST, *(0.2 / log.sample_time for log in logs))
        highest: ColumnName = "jerk" if "jerk" in columns else "acceleration"
        for _ in range(8):
            if bandwidth <= 1.5 * wide or self._share_of_noise(logs, highest, bandwidth) < self.attenuation:
                break
            bandwidth *= 0.75
        return bandwidth

    def _share_of_noise(self, logs: Sequence[Log], highest: ColumnName, bandwidth: float) -> float:
        """Variance of the noise in the highest derivative over that of the column beside the other columns."""
        linear: tuple[ColumnName, ...] = ("jerk", "acceleration", "velocity")
        filter_ = BandLimited(bandwidth)
        noise, power, count = 0.0, 0.0, 0
        for log in logs:
            signals = filter_.signals(log)
            matrix = regressor(signals.motion, linear[linear.index(highest) :], 1.0)
            others = matrix[:, 1:]
            own = matrix[:, 0] - others @ np.linalg.lstsq(others, matrix[:, 0], rcond=None)[0]
            power += float(own @ own)
            order = 3 if highest == "jerk" else 2
            gain = float(np.sum(filter_.kernel(order, log.sample_time) ** 2))
            noise += position_noise(log.position[:, 0]) ** 2 * gain * len(own)
            count += len(own)
        return noise / max(power, 1e-300)

    def _made(self, logs: Sequence[Log], columns: tuple[ColumnName, ...], bandwidth: float) -> Equations:
        filter_ = BandLimited(bandwidth)
        signals = [filter_.signals(log) for log in logs]
        fastest = max(float(np.max(np.abs(part.motion.velocity))) for part in signals)
        reversal = self.reversal_velocity * fastest
        rows, sides, numbers = [], [], []
        for number, (log, part) in enumerate(zip(logs, signals, strict=True)):
            kernel = filter_.kernel(0, log.sample_time)
            every = max(1, int(1.0 / (log.sample_time * bandwidth * 2.5 * self.decimation)))
            half = len(kernel) // 2
            inner = slice(half, len(part) - half)
            remaining = len(part) - 2 * half
            if remaining < max(3 * len(columns), 30) * every:
                raise MethodError(
                    f"{log.name} is too short for a filter of {bandwidth:.3g} Hz: {max(remaining, 0)} samples remain",
                    remedy=f"Record {(len(log) - remaining + 40 * every) * log.sample_time:.2g} s or more",
                )
            matrix = parallel_filtered(regressor(part.motion, columns, reversal), columns, kernel)
            rows.append(thinned(matrix, every))
            sides.append(thinned(part.command[inner], every)[:, 0])
            numbers.append(np.full(len(rows[-1]), number))
        every = max(1, int(1.0 / (logs[0].sample_time * bandwidth * 2.5 * self.decimation)))
        return Equations(
            regressor=np.concatenate(rows),
            command=np.concatenate(sides),
            logs=np.concatenate(numbers),
            columns=columns,
            reversal_velocity=reversal,
            rate=1.0 / (logs[0].sample_time * every),
            bandwidth=bandwidth,
            sources=tuple(logs),
        )


class JointRegression(Method):
    """A contestant that solves v = Y a its own way. Subclasses are frozen dataclasses with a `preparation`."""

    preparation: Preparation

    @abc.abstractmethod
    def solve(self, equations: Equations) -> tuple[Array, Array, tuple[str, ...]]:
        """Coefficients (p,), their covariance (p, p), and notes."""

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Consumes no random numbers. A lag or a friction that comes out negative is left out, and a note says so."""
        begin = time.perf_counter()
        joint, facts = check_joint(logs)
        return linear_fit(joint, facts, self.preparation.equations(logs), self.solve, begin)


def linear_fit(joint, facts: JointFacts, equations: Equations, solve, begin: float) -> Fit:  # type: ignore[no-untyped-def]
    """The fit by `solve(equations)`, started at `begin` [s of `time.perf_counter`]; see `JointRegression.fit`."""
    notes: list[str] = []
    values, covariance, said = solve(equations)
    while (worst := most_negative(equations, values)) is not None:
        notes.append(f"the coefficient of {worst} came out negative and was left out")
        equations = equations.without(worst)
        values, covariance, said = solve(equations)
    condition = condition_number(equations.regressor)
    causes = causes_of(joint, selected(equations.columns, equations.regressor, equations.command, values, covariance))
    return Fit(
        model=JointModel(joint, facts.input, equations.columns, values, None, equations.reversal_velocity),
        estimates=Estimates(
            names=equations.columns,
            units=tuple(column_unit(name, facts) for name in equations.columns),
            values=values,
            covariance=covariance,
        ),
        residuals=equations.command - equations.regressor @ values,
        status=Status.CONVERGED if condition < ILL_CONDITIONED else Status.ILL_CONDITIONED,
        seconds=time.perf_counter() - begin,
        notes=(*notes, *said, f"condition number of the scaled regressor {condition:.3g}"),
        causes=causes,
        verdict=verdict_of(causes),
    )


def most_negative(equations: Equations, values: Array) -> ColumnName | None:
    """The lag or friction whose coefficient is most negative, by its column's size; None: all are as physics asks."""
    size = np.linalg.norm(equations.regressor, axis=0) * values
    bad = [(size[k], name) for k, name in enumerate(equations.columns) if name in NOT_NEGATIVE and size[k] < 0.0]
    return min(bad)[1] if bad else None


def physical_columns(facts: JointFacts) -> tuple[ColumnName, ...]:
    """What a joint of this kind may show: the winding's lag under voltage, gravity's pull on a hinge, friction."""
    lag: tuple[ColumnName, ...] = ("jerk",) if facts.input == "voltage" else ()
    turning: tuple[ColumnName, ...] = ("sine", "cosine") if facts.position_unit == "rad" else ()
    return (*lag, "acceleration", "velocity", "constant", "coulomb", *turning)


def gravity_turns(equations: Equations) -> bool:
    """True when gravity that turns with the joint explains more than chance would.

    The criterion is Schwarz's (Ann. Stat. 6 (1978) 461) with as many independent samples as the residuals of the
    larger model have by their autocorrelation at lag one.
    """
    residuals = []
    for used in (equations, equations.without("sine").without("cosine")):
        scale = np.linalg.norm(used.regressor, axis=0)
        scaled = used.regressor / np.where(scale > 0.0, scale, 1.0)
        residuals.append(used.command - scaled @ np.linalg.lstsq(scaled, used.command, rcond=1e-10)[0])
    with_it, without_it = (float(r @ r) for r in residuals)
    correlation = float(residuals[0][1:] @ residuals[0][:-1]) / max(with_it, 1e-300)
    samples = len(equations.command) * (1.0 - correlation) / (1.0 + max(correlation, 0.0))
    return samples * np.log(without_it / max(with_it, 1e-300)) > 2.0 * np.log(max(samples, 2.0)) + 10.0


def excitation_band(log: Log) -> float:
    """Frequency [Hz] below which 95 % of the power of the joint's velocity lies; at least one period of the log."""
    window = max(7, 2 * round(0.015 / log.sample_time) + 1)
    velocity = savgol_filter(log.position[:, 0], min(window, (len(log) - 1) // 2 * 2 - 1), 3, deriv=1)
    power = np.cumsum(np.abs(np.fft.rfft(velocity - np.mean(velocity))) ** 2)
    return (int(np.searchsorted(power, 0.95 * power[-1])) + 1) / log.duration


def parallel_filtered(matrix: Array, columns: tuple[ColumnName, ...], kernel: Array) -> Array:
    """Columns that are not linear in the motion pass the filter that the command passed; the others are cut alike."""
    half = len(kernel) // 2
    cut = matrix[half : len(matrix) - half].copy()
    for k, name in enumerate(columns):
        if name in NOT_LINEAR:
            cut[:, k] = fftconvolve(matrix[:, k], kernel, mode="valid")
    return cut


def thinned(columns: Array, every: int) -> Array:
    """Every n-th row behind a zero-phase low-pass."""
    while every > 1:
        step = next((n for n in range(min(every, 12), 1, -1) if every % n == 0), every)
        columns, every = decimate(columns, step, ftype="fir", axis=0, zero_phase=True), every // step
    return columns
