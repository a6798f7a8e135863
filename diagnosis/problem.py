"""The logs of one joint (or of a coupled pair) laid out for the compiled kernel.

Several logs are stacked one after the other; `bounds` says where each begins. Long recordings are represented by
evenly spaced segments: what a diagnosis needs to know saturates long before ten million samples.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from scipy.signal import savgol_filter

from envs.log import Array, JointFacts, Log
from envs.log_statistics import quantisation_step
from methods.effects.base import Scales
from methods.kernel import BEGINNING, DAMPING, LANES, NOMINAL, Kernel

SEGMENT = 60_000  # samples of one segment of a long recording
DIVERGED = 1e6  # prediction error [rad or m] that stands for a simulation that left all bounds
LIMIT = 240_000  # samples that take part in a fit
MANY_LEVELS = 10  # different levels of a command from which its resolution may be read off them
DITHER = 0.02  # rms of the noise that continuous readings are given, as a share of that of the motion between two
STEP = 2e-3  # longest step of a simulation [s]
ROOM = 4  # least number by which the samples of a simulation are decimated where their steps are several of the logs'
UNEVEN = 0.01  # share of a step by which others may differ for that
EVEN = 1e-3  # share of a step by which stamps may miss even instants and still be written in so many digits only
INDEPENDENT = (
    0.5  # mean square change of the stamps' error over twice its mean square, 1 where one does not know the next
)
MECHANICAL = 0.5
"""Share of the damping by which its mechanical part may differ from the stated one (one standard deviation)."""
NEVER = 2.0
"""Instant, over the length of the longest log, of an event that a log does not have."""


@dataclass(frozen=True)
class Free:
    """One free parameter of a fit.

    kind: ``joint`` (a column of the parameter array, for all logs), ``log`` (the same for one log only), ``start``
    (initial state of one log, see `methods.kernel.BEGINNING`), ``rigid`` (coupling parameters of a pair).
    deviation: standard deviation around `centre` that is known beforehand (infinite: nothing is known).
    """

    name: str
    kind: str
    joint: int
    column: int
    scale: float
    lower: float = -np.inf
    upper: float = np.inf
    log: int = -1
    centre: float = 0.0
    deviation: float = np.inf


class KnownTorques(Protocol):
    """Torques on a joint, and changes of its inertia, that are known of a log up to their sizes."""

    def of(self, log: Log) -> tuple[Array, Array]:
        """In command units, on average from one sample to the next, (T, 2 R): torques that resist, the first known with
        its size, and by how much more the joint's inertia is than around its pose; and draws (T, M) of the torques that
        these may be off by."""


@dataclass(frozen=True)
class Stamps:
    """Time stamps that were replaced by even ones: rms of their error [s], decrease of -2 log likelihood by that."""

    error: float
    decrease: float


@dataclass
class Work:
    """Steps of all simulations of candidates so far, one per sample or several: the same on any machine.

    Candidates are simulated several at once, which takes as long as one of them: so lanes that stay idle count as well.
    """

    steps: float = 0
    _adding: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def add(self, steps: int, runs: int) -> None:
        """So many steps in all of so many runs at once."""
        with self._adding:
            self.steps += steps * (1.0 + (-runs % LANES) / runs)


@dataclass(frozen=True, eq=False)
class Problem:
    """Stacked logs. Shapes: time (T,), command and reading (T, n), bounds (L + 1,),
    neighbour (T, n, 3 + 2 R) or (0, n, 3).

    neighbour: acceleration, velocity and command of the next joint, then R known torques of the rest of the `arm`, and
    R changes of the joint's inertia with its pose; the same R numbers are the sizes of both.

    leak [rad/s] pulls the predicted angle towards the measured one, rate_leak [1/s^2] the velocity; burn_in [s] is what
    is discarded at the beginning of every log while initial errors of the angle decay. decimation: the errors are
    compared in a band up to 0.4 / (decimation sample_time) only (1: in the whole band). thinning: samples of the logs
    that one of these stands for (`coarser`). stamps: see `Stamps`.
    command_limits: largest command per joint, of its logs where the drive's is unknown. command_steps: resolution of a
    measured command per joint, 0 of one that acts as it is written. dither: see `dither_of`.
    motions: see `diagnosis.estimation.predicted_motion`. doubts: what the torques of the arm may be off by, (T, draws)
    or (0, 0).
    """

    kernel: Kernel
    time: Array
    command: Array
    reading: Array
    bounds: np.ndarray
    hold: np.ndarray
    neighbour: Array
    pair: bool
    substeps: int
    leak: float
    rate_leak: float
    burn_in: float
    encoder_step: float
    revolute: bool
    names: tuple[str, ...] = ()
    decimation: int = 1
    thinning: int = 1
    stamps: Stamps | None = None
    command_limits: tuple[float, ...] = ()
    command_steps: tuple[float, ...] = ()
    starts: Array = field(default_factory=lambda: np.zeros((0, 0, len(BEGINNING))))
    arm: KnownTorques | None = None
    doubts: Array = field(default_factory=lambda: np.zeros((0, 0)))
    dither: Array = field(default_factory=lambda: np.zeros(0))
    work: Work = field(default_factory=Work)
    motions: WeakKeyDictionary[Any, Array] = field(default_factory=WeakKeyDictionary, init=False, repr=False)

    @property
    def joints(self) -> int:
        return self.command.shape[1]

    @property
    def divides_damping(self) -> bool:
        """Whether the pose changes the inertia, so that mechanical damping and back-EMF behind a winding differ: under
        an inertia that stays the same either can stand in for the other, with another inertia and winding."""
        return self.pair or self.arm is not None

    @property
    def logs(self) -> int:
        return len(self.bounds) - 1

    @property
    def arm_shapes(self) -> int:
        """Number of known torques of the rest of an arm."""
        return (self.neighbour.shape[2] - 3) // 2

    @cached_property
    def sample_time(self) -> float:
        """Median interval between samples [s]."""
        return float(np.median(np.diff(self.time[: self.bounds[1]])))

    @cached_property
    def longest(self) -> float:
        """Length [s] of the longest log."""
        return max(float(self.time[b - 1] - self.time[a]) for a, b in pairwise(self.bounds))

    @cached_property
    def instants(self) -> Array:
        """Time since the beginning of its log (T,), of logs that are evenly sampled the same numbers bit by bit: these
        can be simulated together."""
        found: list[Array] = []
        steps: list[float] = []
        for a, b in pairwise(self.bounds):
            since, count = self.time[a:b] - self.time[a], np.arange(b - a)
            own = float(since[-1]) / max(b - a - 1, 1)
            even = (step for step in (*steps, own) if np.max(np.abs(since - step * count)) <= EVEN * step)
            step = next(even, None)
            found.append(since if step is None else step * count)
            steps += [] if step is None or step in steps else [step]
        return np.concatenate(found)

    @cached_property
    def used(self) -> np.ndarray:
        """Mask (T,) of the samples after the burn-in of their log."""
        mask = np.zeros(len(self.time), dtype=bool)
        for start, stop in zip(self.bounds[:-1], self.bounds[1:], strict=True):
            mask[start:stop] = self.time[start:stop] - self.time[start] >= self.burn_in
        return mask

    @cached_property
    def velocity(self) -> Array:
        """Smoothed velocity of the readings (T, n)."""
        return self._derivatives[1]

    @cached_property
    def acceleration(self) -> Array:
        """Smoothed acceleration of the readings (T, n)."""
        return self._derivatives[2]

    @cached_property
    def position(self) -> Array:
        """Smoothed readings (T, n)."""
        return self._smoothed(0.01)[0]

    @cached_property
    def _derivatives(self) -> tuple[Array, ...]:
        return self._smoothed(0.03)

    def _smoothed(self, seconds: float) -> tuple[Array, ...]:
        """Angle, velocity and acceleration (T, n) of the readings over windows within their logs."""
        parts = [smooth_derivatives(self.time[a:b], self.reading[a:b], seconds) for a, b in pairwise(self.bounds)]
        return tuple(np.concatenate(signals) for signals in zip(*parts, strict=True))

    @cached_property
    def cumulative(self) -> Array:
        """Integral of the held command over samples, per log (T, n)."""
        total = np.zeros_like(self.command)
        for start, stop in zip(self.bounds[:-1], self.bounds[1:], strict=True):
            u = self.command[start:stop]
            for j in range(self.joints):
                step = u[:-1, j] if self.hold[j] == 0 else 0.5 * (u[:-1, j] + u[1:, j])
                total[start + 1 : stop, j] = np.cumsum(step)
        return total

    def credible(self, error: Array) -> bool:
        """False for a simulation that ran away: a constant, absurd error would be predicted perfectly."""
        return bool(max(error.max(), -error.min()) < min(DIVERGED, 20.0 * self.extent))

    def squares(self, error: Array) -> float:
        """Sum of squares of errors (T, n) over the samples that count."""
        return float(np.sum(error[self.used] ** 2))

    @cached_property
    def farthest(self) -> Array:
        """Largest magnitude of each joint's readings (n,)."""
        return np.max(np.abs(self.reading), axis=0)

    @cached_property
    def extent(self) -> float:
        """How far the readings reach, of the joint that moves farthest."""
        return float(np.max(np.ptp(self.reading, axis=0)))

    def errors(
        self,
        parameters: Array,
        switches: np.ndarray,
        rigid: Array,
        starts: Array,
        extra: Array | None = None,
        substeps: int | None = None,
        leak: bool = True,
    ) -> Array:
        """Prediction errors (C, T, n) of C candidates: parameters (C, L, n, columns), switches (C, n, effects)."""
        out = np.empty((len(parameters), len(self.time), self.joints))
        interval = float(self.instants[1] - self.instants[0])
        steps = (
            self.kernel.steps(own[0], on, interval, substeps or self.substeps)
            for own, on in zip(parameters, switches, strict=True)
        )
        self.work.add(sum(steps) * len(self.time), len(parameters) * self.logs)
        self.kernel.batch(
            self.instants,
            self.command,
            self.cumulative,
            self.hold,
            self.reading,
            self.neighbour,
            np.zeros((0, 0, self.joints)) if extra is None else extra,
            self.bounds,
            starts,
            parameters,
            switches,
            self.pair,
            rigid,
            self.leak if leak else 0.0,
            self.rate_leak if leak else 0.0,
            substeps or self.substeps,
            out,
        )
        if not np.isfinite(out.sum()):  # a candidate that diverged is as wrong as can be, not undefined
            bounded(out)
        return out

    def part(self, rows: np.ndarray, bounds: np.ndarray, starts: Array, names: tuple[str, ...] = ()) -> Problem:
        """Some of the samples (K,) as logs of their own between bounds, which begin in these states."""
        return replace(
            self,
            time=self.time[rows],
            command=self.command[rows],
            reading=self.reading[rows],
            neighbour=self.neighbour[rows] if len(self.neighbour) else self.neighbour,
            bounds=bounds,
            names=names,
            starts=starts,
        )

    def motion(self, parameters: Array, switches: np.ndarray, rigid: Array, starts: Array) -> Array:
        """Predicted angle, velocity and motor torque (T, n, 3) of one model, from readings before each sample only.

        Shapes: parameters (L, n, columns), switches (n, effects), starts (L, n, 5), see
        `methods.kernel.BEGINNING`.
        """
        found = np.zeros((len(self.time), self.joints, 3))
        out = np.empty((len(self.time), self.joints))
        none = np.zeros((0, self.joints, 3))
        for log, (a, b) in enumerate(pairwise(self.bounds)):
            self.kernel.motion(
                self.instants[a:b],
                self.command[a:b],
                self.cumulative[a:b],
                self.hold,
                self.reading[a:b],
                self.neighbour[a:b] if len(self.neighbour) else none,
                none[:, :, 0],
                starts[log],
                parameters[log],
                switches,
                self.pair,
                rigid,
                self.leak,
                self.rate_leak,
                self.substeps,
                out[a:b],
                found[a:b],
            )
        return np.nan_to_num(found, copy=False)


def evenly(problem: Problem) -> tuple[Problem, float] | None:
    """The same readings at even instants, and the rms [s] by which the stamps miss them; None where they do not.

    Whether the clock or the sampling jitters cannot be seen in the stamps: a fit has to decide. Gaps are left alone,
    and so are stamps whose errors add up from one to the next: a loop that took longer took longer.
    """
    time, error, change = problem.time.copy(), 0.0, 0.0
    for a, b in pairwise(problem.bounds):
        count = np.arange(b - a)
        step, begin = np.polyfit(count, problem.time[a:b], 1)
        even = begin + step * count
        missed = problem.time[a:b] - even
        if np.max(np.abs(missed)) > 1.5 * step:
            return None
        time[a:b] = even
        error += float(np.sum(missed**2))
        change += float(np.sum(np.diff(missed) ** 2))
    error = float(np.sqrt(error / len(time)))
    is_jitter = error >= 0.01 * problem.sample_time and change > INDEPENDENT * 2.0 * len(time) * error**2
    return (replace(problem, time=time), error) if is_jitter else None


def excitation_band(problem: Problem) -> float:
    """Frequency [Hz] below which 95 % of the power of the measured velocities lies, the largest over joints."""
    found = 0.0
    for j in range(problem.joints):
        a, b = problem.bounds[0], problem.bounds[1]
        velocity = smooth_derivatives(problem.time[a:b], problem.reading[a:b, j : j + 1], 0.03)[1][:, 0]
        found = max(found, bandwidth(problem.time[a:b], velocity))
    return found


def bandwidth(time: Array, signal: Array) -> float:
    """Frequency [Hz] below which 95 % of a signal's power (T,) lies."""
    power = np.cumsum(np.abs(np.fft.rfft(signal - signal.mean())) ** 2)
    return int(np.searchsorted(power, 0.95 * power[-1])) / (time[-1] - time[0])


def centred(command: Array, hold: int) -> Array:
    """The command (T, n) that acts around the instants of the samples: between two levels where it is held (0)."""
    return np.vstack([command[:1], 0.5 * (command[1:] + command[:-1])]) if hold == 0 else command


def in_band(problem: Problem) -> Problem:
    """The same logs, compared only up to five times the band in which the joint moved.

    Far above that band a real machine's errors are those of its structure and electronics; a likelihood over the whole
    band would weigh them above everything that matters for its motion.
    """
    nyquist = 0.5 / problem.sample_time
    wanted = max(5.0 * excitation_band(problem), 2.0)
    return coarser(problem, max(1, int(0.8 * nyquist / wanted)))


def coarser(problem: Problem, decimation: int) -> Problem:
    """The same logs, compared up to 0.4 / (decimation sample_time) only, and simulated in steps of several samples, as
    far as these are short enough and the band leaves room.

    Over such a step acts the mean of the command.
    """
    dt = problem.sample_time
    even = all(np.ptp(np.diff(problem.time[a:b])) < UNEVEN * dt for a, b in pairwise(problem.bounds))
    several = max(1, min(int(STEP / dt + 0.05), decimation // ROOM)) if even else 1
    if several == 1:
        return replace(problem, decimation=decimation)
    rows = [np.arange(a, b, several) for a, b in pairwise(problem.bounds)]
    every = np.concatenate(rows)
    steps = [np.minimum(own[:, None] + np.arange(several), own[-1]) for own in rows]
    levels = [np.diff(problem.cumulative[own], axis=0) / several for own in rows]
    mean = lambda signal: signal[np.concatenate(steps)].mean(axis=1) if len(signal) else signal  # noqa: E731
    return replace(
        problem,
        time=problem.time[every],
        command=np.concatenate([np.vstack([own, own[-1:]]) for own in levels]),
        reading=problem.reading[every],
        neighbour=mean(problem.neighbour),
        doubts=mean(problem.doubts),
        bounds=np.cumsum([0, *map(len, rows)]),
        hold=np.zeros_like(problem.hold),
        substeps=1,
        decimation=decimation // several,
        thinning=several,
    )


def start_window(sample_time: float) -> float:
    """Length [s] of the stretch from which the velocity at the beginning of a log is read."""
    return max(0.03, 8 * sample_time)


def start_deviation(problem: Problem, fastest: Array) -> Array:
    """Standard deviation of the velocity that is read at the beginning of a log, of joints that are as fast as this.

    That of a cubic fitted to rounded readings, and what a cubic misses.
    """
    return 5.0 * problem.encoder_step / start_window(problem.sample_time) + 0.05 * np.maximum(fastest, 1e-9)


def free_damping(joint: int, damping: float, stated: float) -> Free:
    """Mechanical damping of a joint beside its back-EMF, by a share of the damping about what was stated."""
    column, deviation = NOMINAL.index("viscous"), MECHANICAL * damping
    return Free(f"viscous@{joint}", "joint", joint, column, damping, 0.0, centre=stated, deviation=deviation)


def free_velocity(problem: Problem, joint: int, log: int, fastest: float, centre: float) -> Free:
    """The velocity at the beginning of a log as a free parameter, about the one that is read there, of a joint that is
    as fast as this."""
    fastest = max(fastest, 1e-9)
    deviation = float(start_deviation(problem, np.array(fastest)))
    column = BEGINNING.index("velocity")
    return Free(f"velocity@{joint}#{log}", "start", joint, column, fastest, log=log, centre=centre, deviation=deviation)


def smooth_derivatives(time: Array, reading: Array, seconds: float) -> tuple[Array, Array, Array]:
    """Smoothed angle, velocity and acceleration by local cubic fits over a window [s]; reading (T, n)."""
    dt = float(np.median(np.diff(time)))
    window = max(7, 2 * round(0.5 * seconds / dt) + 1)
    window = min(window, (len(time) - 1) // 2 * 2 - 1)
    order = 3 if window > 4 else 2
    parts = [savgol_filter(reading, window, order, deriv=d, delta=dt, axis=0) for d in range(3)]
    return parts[0], parts[1], parts[2]


def bounded(error: Array) -> Array:
    """Errors, changed in place: those of a simulation that ran away are DIVERGED."""
    np.nan_to_num(error, copy=False, nan=DIVERGED, posinf=DIVERGED, neginf=-DIVERGED)
    return np.clip(error, -DIVERGED, DIVERGED, out=error)


def dither_of(readings: Sequence[Array]) -> Array:
    """Rms (n,) of the noise that continuous readings of these logs (T, n) are given."""
    return DITHER * np.std(np.concatenate([np.diff(reading, axis=0) for reading in readings]), axis=0)


def dithered(readings: Sequence[Array], size: Array) -> Array:
    """Continuous readings of every log (T, n), one after the other, with a little noise (n,), which no sensor is free
    of.

    Simulators write logs without any. Whatever a model misses is then infinitely more than noise, and what it predicts
    to the last bit has no likelihood.
    """
    reading = np.concatenate(readings)
    return reading + size * np.random.default_rng(0).standard_normal(reading.shape)


def segments(log: Log, budget: int) -> list[Log]:
    """The log itself when it is short, else evenly spaced segments of at most `budget` samples together."""
    if len(log) <= max(budget, SEGMENT):
        return [log]
    count = max(1, budget // SEGMENT)
    begins = np.linspace(0, len(log) - SEGMENT, count).astype(int)
    return [log.slice(begin, begin + SEGMENT) for begin in begins]


def stack(
    kernel: Kernel,
    logs: Sequence[Log],
    joints: tuple[int, ...],
    *,
    pair: bool = False,
    neighbours: bool = True,
    burn_in: float | None = None,
    arm: KnownTorques | None = None,
    dither: Array | None = None,
) -> Problem:
    """Lay out logs for a fit of the named joints; other joints of the logs serve as neighbours for coupling effects.

    arm: known torques of the rest of the arm on a single joint. dither: that of other logs (n,), where these are
    compared with them: a sensor has the same noise in all.
    """
    parts = [part for log in logs for part in segments(log, LIMIT // len(logs))]
    times, commands, readings, others, starts, doubts = [], [], [], [], [], []
    for log in parts:
        columns = [log.index(joint) for joint in joints]
        times.append(log.time)
        commands.append(log.command[:, columns])
        readings.append(log.position[:, columns])
        dt = log.sample_time
        smooth = smooth_derivatives(log.time, log.position, start_window(dt))
        beginning = np.zeros((len(joints), len(BEGINNING)))
        beginning[:, 0] = log.position[0, columns]
        beginning[:, 1] = smooth[1][0, columns]
        starts.append(beginning)
        rest = [column for column in range(len(log.joints)) if column not in columns]
        if neighbours and not pair and len(log.joints) > 1:
            near = np.zeros((len(log), len(joints), 3))
            for i, column in enumerate(columns):
                other = min(rest, key=lambda c: abs(c - column))
                near[:, i, 0] = smooth[2][:, other]
                near[:, i, 1] = smooth[1][:, other]
                near[:, i, 2] = log.command[:, other]
            if arm is not None:
                known, off = arm.of(log)
                near = np.concatenate([near, known[:, None]], axis=2)
                doubts.append(off)
            others.append(near)
    first = parts[0]
    facts = [first.facts[first.index(joint)] for joint in joints]
    dt = max(part.sample_time for part in parts)
    steps = [
        fact.encoder_step
        or next((step for part in readings if (step := quantisation_step(part[:, j])) is not None), 0.0)
        for j, fact in enumerate(facts)
    ]
    command = np.ascontiguousarray(np.concatenate(commands))
    dither = dither_of(readings) if dither is None else dither
    smooth_readings = dithered(readings, dither)
    return Problem(
        kernel=kernel,
        time=np.concatenate(times),
        command=command,
        reading=np.ascontiguousarray(np.where(np.array(steps) > 0.0, np.concatenate(readings), smooth_readings)),
        dither=dither,
        bounds=np.cumsum([0, *(len(part) for part in parts)]),
        hold=np.array([0 if fact.hold == "zero_order" else 1 for fact in facts], dtype=np.int64),
        neighbour=np.concatenate(others) if others else np.zeros((0, len(joints), 3)),
        pair=pair,
        substeps=max(1, int(np.ceil(dt / STEP - 0.05))),
        leak=min(30.0, 0.1 / dt),
        rate_leak=0.0,
        burn_in=0.25 if burn_in is None else burn_in,
        encoder_step=steps[0],
        revolute=facts[0].position_unit == "rad",
        names=tuple(part.name for part in parts),
        command_limits=tuple(
            fact.command_limit or float(np.max(np.abs(own))) for fact, own in zip(facts, command.T, strict=True)
        ),
        command_steps=tuple(measured_step(fact, own) for fact, own in zip(facts, command.T, strict=True)),
        starts=np.array(starts),
        arm=arm,
        doubts=np.concatenate(doubts) if doubts else np.zeros((0, 0)),
    )


def measured_step(facts: JointFacts, command: Array) -> float:
    """Resolution of a command (T,) that was measured: as stated or, where it takes many levels, as it shows."""
    if facts.hold == "zero_order":
        return 0.0
    if facts.command_step or len(np.unique(command)) < MANY_LEVELS:
        return facts.command_step or 0.0
    return quantisation_step(command) or 0.0


def scales(problem: Problem, nominal: Array, torque: Array, joint: int) -> Scales:
    """Typical magnitudes for the starting values of effects; nominal (columns,), torque (T,) motor torque."""
    q = problem.reading[:, joint]
    velocity = problem.velocity[:, joint]
    u = problem.command[:, joint]
    rms = lambda x: float(np.sqrt(np.mean(x**2)))  # noqa: E731
    return Scales(
        command_rms=rms(u),
        command_peak=float(np.max(np.abs(u))),
        torque_rms=max(rms(torque), 1e-12),
        torque_peak=max(float(np.max(np.abs(torque))), 1e-12),
        position_span=float(np.ptp(q)),
        position_mean=float(np.mean(q)),
        velocity_rms=max(rms(velocity), 1e-12),
        velocity_peak=max(float(np.max(np.abs(velocity))), 1e-12),
        inertia=float(nominal[NOMINAL.index("inertia")]),
        damping=float(sum(nominal[NOMINAL.index(name)] for name in DAMPING)),
        duration=problem.longest,
        sample_time=problem.sample_time,
        encoder_step=problem.encoder_step,
        revolute=problem.revolute,
        joints=2 if problem.pair or len(problem.neighbour) else 1,
        coupled=problem.pair,
        acceleration_rms=rms(problem.acceleration[:, joint]),
    )
