"""From a recorded log to what a regression needs: command and motion with three derivatives, at the same instants.

A zero-order hold lets command[k] act from t[k] to t[k+1]; at the instant t[k] the motion has therefore seen a command
that lags by half a sample. Every differentiator here returns the command *effective at t[k]*. Whoever forgets this
biases the third-order coefficient by half a sample over the electrical time constant (4 to 5 % at 1 kHz and 10 ms).

Bias. `BandLimited` sends command and all derivatives through one and the same low-pass, and a linear time-invariant
filter commutes with a linear joint equation: the filter itself biases nothing, whatever its bandwidth. What remains is
the encoder noise in the regressor. With white position noise of variance s^2 at sample time T, the k-th derivative
carries s^2 2 T (2 pi)^(2k) B^(2k+1) / (2k+1) of noise variance below B [Hz]; a least-squares coefficient shrinks by
that share of its column's independent power (errors-in-variables attenuation). For the third derivative this grows
with B^7. Too little bandwidth, in turn, removes the frequencies at which the derivatives differ. Columns that are not
linear in the motion (friction's sign, cogging) do not commute with the filter: near a velocity reversal, within the
kernel's width, they leave a residual.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, fftconvolve, filtfilt

from envs.log import Array, Log
from methods.base import MethodError, Motion


@dataclass(frozen=True, eq=False)
class Signals:
    """Time (T,) [s], effective command (T, n) and motion (T, n) of one log at the same instants.

    `measured` is the position at these instants before any filter, (T, n); `start` the log's row of the first one.
    """

    time: Array
    command: Array
    motion: Motion
    measured: Array
    start: int

    def __len__(self) -> int:
        return len(self.time)


class Differentiator(abc.ABC):
    """Turns a log into signals. Subclasses are frozen dataclasses."""

    @abc.abstractmethod
    def signals(self, log: Log) -> Signals:
        """Command and motion of every joint of the log. Raises MethodError when the log is too short or too slow."""


@dataclass(frozen=True)
class FiniteDifferences(Differentiator):
    """The raw differences of the paper: measured velocity where the log has it, then difference by difference.

    ``central`` (no delay, the kinder reading of the paper) is (x[k+1] - x[k-1]) / 2T; ``backward`` is
    (x[k] - x[k-1]) / T, which lags by half a sample per derivative.
    """

    scheme: Literal["central", "backward"] = "central"

    def signals(self, log: Log) -> Signals:
        log = _uniform(log)
        step = log.sample_time
        if len(log) < 8:
            raise MethodError(f"{len(log)} samples are too few for three differences", remedy="Record 8 or more")
        velocity = self._difference(log.position, step) if log.velocity is None else log.velocity
        acceleration = self._difference(velocity, step)
        jerk = self._difference(acceleration, step)
        inner = slice(3, len(log) - 3)
        return Signals(
            time=log.time[inner],
            command=_effective_command(log)[inner],
            motion=Motion(log.position[inner], velocity[inner], acceleration[inner], jerk[inner]),
            measured=log.position[inner],
            start=3,
        )

    def _difference(self, signal: Array, step: float) -> Array:
        if self.scheme == "central":
            return np.gradient(signal, step, axis=0)
        return np.diff(signal, axis=0, prepend=signal[:1]) / step


@dataclass(frozen=True)
class ButterworthDifferences(Differentiator):
    """The textbook filter: the position through a zero-phase Butterworth low-pass, then central differences.

    The command is left as recorded; to filter it in parallel is the business of the regression
    (`LeastSquares.decimation`). `border` samples are dropped at the start, where filter and differences settle.
    Defaults and order of steps as in the scripts of the EMPS benchmark (Janot, Gautier, Brunot, Workshop on Nonlinear
    System Identification Benchmarks, 2019), which take a measured command and do not speak of its hold.
    """

    cutoff: float = 100.0
    order: int = 4
    border: int = 49

    def signals(self, log: Log) -> Signals:
        log = _uniform(log)
        step = log.sample_time
        if not 0.0 < self.cutoff < 0.5 / step:
            raise MethodError(
                f"a cutoff of {self.cutoff:g} Hz does not fit a log sampled at {1.0 / step:.4g} Hz",
                remedy=f"Choose a cutoff below {0.5 / step:.3g} Hz",
            )
        if len(log) <= self.border + 8 * self.order:
            raise MethodError(f"{len(log)} samples are too few", remedy=f"Record more than {self.border} by far")
        numerator, denominator = butter(self.order, 2.0 * self.cutoff * step)
        position = filtfilt(numerator, denominator, log.position, axis=0, padlen=3 * self.order)
        velocity = np.gradient(position, step, axis=0)
        acceleration = np.gradient(velocity, step, axis=0)
        jerk = np.gradient(acceleration, step, axis=0)
        inner = slice(self.border, len(log))
        return Signals(
            time=log.time[inner],
            command=log.command[inner],
            motion=Motion(position[inner], velocity[inner], acceleration[inner], jerk[inner]),
            measured=log.position[inner],
            start=self.border,
        )


@dataclass(frozen=True)
class BandLimited(Differentiator):
    """Zero-phase differentiator of stated bandwidth: symmetric FIR kernels h, h', h'', h''' of one low-pass.

    The low-pass has gain 1 up to `bandwidth` [Hz] and falls to 0 at (1 + `transition`) x bandwidth along a raised
    cosine. Kernels are corrected to differentiate polynomials up to degree 5 exactly. The command passes through the
    same low-pass and, for a zero-order hold, through the hold's own frequency response, so that both sides of the
    joint equation stay in step. Within half a kernel of either end there is no estimate: these samples are left out
    rather than invented by padding.
    """

    bandwidth: float = 30.0
    transition: float = 1.0

    def signals(self, log: Log) -> Signals:
        log = _uniform(log)
        step = log.sample_time
        stop = self.bandwidth * (1.0 + self.transition)
        if not 0.0 < stop < 0.5 / step:
            raise MethodError(
                f"a bandwidth of {self.bandwidth:g} Hz (stop band from {stop:g} Hz) does not fit a log sampled at "
                f"{1.0 / step:.4g} Hz",
                remedy=f"Choose a bandwidth below {0.5 / step / (1.0 + self.transition):.3g} Hz",
            )
        half = self.half_width(step)
        if len(log) <= 2 * half + 8:
            raise MethodError(
                f"{len(log)} samples are too few: the differentiator needs {half} on either side",
                remedy=f"Record more than {(2 * half + 8) * step:.2g} s or raise the bandwidth",
            )
        origin = log.position[:1]  # the kernels are exact on constants; removing one keeps round-off down
        position, velocity, acceleration, jerk = (
            _convolve(log.position - origin, self.kernel(order, step)) for order in range(4)
        )
        held = np.array([facts.hold == "zero_order" for facts in log.facts])
        command = np.where(
            held,
            _convolve(log.command, self.kernel(0, step, hold=True)),
            _convolve(log.command, self.kernel(0, step)),
        )
        inner = slice(half, len(log) - half)
        return Signals(
            time=log.time[inner],
            command=command,
            motion=Motion(position + origin, velocity, acceleration, jerk),
            measured=log.position[inner],
            start=half,
        )

    def half_width(self, sample_time: float) -> int:
        """Samples on either side that a kernel needs: two and a half periods of the transition band."""
        return int(np.ceil(2.5 / (self.transition * self.bandwidth) / sample_time))

    def kernel(self, order: int, sample_time: float, hold: bool = False) -> Array:
        """Impulse response (2L+1,) of the `order`-th derivative [1/s^order]; with `hold`, of the held command."""
        return _kernel(self.bandwidth, self.transition, self.half_width(sample_time), order, sample_time, hold)


@lru_cache(maxsize=256)
def _kernel(bandwidth: float, transition: float, half: int, order: int, step: float, hold: bool) -> Array:
    # The low-pass is designed once, made compact by a smooth window, and then differentiated in the frequency domain,
    # so that all orders share one gain: h_k = d^k h / dt^k, compact like h itself.
    stop = bandwidth * (1.0 + transition)
    lags = np.arange(-half, half + 1)
    frequency = np.linspace(0.0, stop, 4001)
    fall = np.clip((frequency - bandwidth) / (stop - bandwidth), 0.0, 1.0)
    gain = 0.5 * (1.0 + np.cos(np.pi * fall))
    ideal = 2.0 * step * np.trapezoid(gain * np.cos(2.0 * np.pi * np.outer(lags * step, frequency)), frequency, axis=1)
    window = np.cos(0.5 * np.pi * lags / (half + 1)) ** 4
    low_pass = ideal * window / np.sum(ideal * window)
    size = 8 * (2 * half + 1)
    bins = np.fft.rfftfreq(size, step)
    response = np.fft.rfft(np.concatenate((low_pass[half:], np.zeros(size - 2 * half - 1), low_pass[:half])))
    response = response * (2j * np.pi * bins) ** order
    if hold:
        response = response * np.sinc(bins * step) * np.exp(-1j * np.pi * bins * step)
    kernel = np.fft.irfft(response, size)[lags]
    kernel = _exact_on_polynomials(kernel, window, lags / half, order, half * step, 0.5 / half if hold else 0.0)
    kernel.flags.writeable = False
    return kernel


def _exact_on_polynomials(kernel: Array, window: Array, lags: Array, order: int, span: float, delay: float) -> Array:
    """The smallest windowed change that makes sum_n kernel[n] (-lag)^m the derivative of x^m at -delay, m <= 5.

    For a held command a delay of half a sample is exact on polynomials up to degree 1; higher moments are left alone.
    """
    degree = 1 if delay else 5
    powers = np.array([(-lags) ** m for m in range(degree + 1)])
    target = np.zeros(degree + 1)
    for m in range(order, degree + 1):
        falling = np.prod(np.arange(m, m - order, -1.0))
        target[m] = falling * (-delay) ** (m - order) / span**order
    weighted = powers * window**2
    return kernel + weighted.T @ np.linalg.solve(weighted @ powers.T, target - powers @ kernel)


def _convolve(columns: Array, kernel: Array) -> Array:
    return fftconvolve(columns, kernel[:, None], mode="valid", axes=0)


def _effective_command(log: Log) -> Array:
    """Command at the instants t[k]: under a zero-order hold the mean of the value before and the value after."""
    before = np.concatenate((log.command[:1], log.command[:-1]))
    held = np.array([facts.hold == "zero_order" for facts in log.facts])
    return np.where(held, 0.5 * (before + log.command), log.command)


def _uniform(log: Log) -> Log:
    """The log on an even time grid: unchanged when its stamps are even to 1 % of a sample, else resampled."""
    step = log.sample_time
    if np.max(np.abs(np.diff(log.time) - step)) <= 0.01 * step:
        return log
    time = np.arange(log.time[0], log.time[-1], step)
    latest = np.searchsorted(log.time, time, side="right") - 1
    position = CubicSpline(log.time, log.position, axis=0)(time)
    velocity = None if log.velocity is None else CubicSpline(log.time, log.velocity, axis=0)(time)
    held = np.array([facts.hold == "zero_order" for facts in log.facts])
    between = np.stack([np.interp(time, log.time, column) for column in log.command.T], axis=1)
    command = np.where(held, log.command[latest], between)
    return replace(log, time=time, command=command, position=position, velocity=velocity, temperature=None)
