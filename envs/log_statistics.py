"""What the numbers of a recording say about the instruments: clock, quantisation, spikes, jumps, saturation, band.

Every function takes plain arrays of shape (T,) and knows nothing of robots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from envs.log import Array

Rows = NDArray[np.signedinteger]

#: Median absolute deviation of a normal variable is its standard deviation divided by this.
MAD_TO_STD = 1.4826

#: Sampling intervals from which two samples are parts of different recordings: what was commanded meanwhile, and where
#: the joint went, is not known.
LOST = 10.0


@dataclass(frozen=True, eq=False)
class Timing:
    """The clock of a recording.

    sample_time: median interval [s].
    jitter: rms deviation of the intervals from their median, gaps left out [s].
    gap_rows: index of the sample before each gap, shape (g,).
    missing: samples that would have fitted into the gaps, in total.
    largest_gap: longest interval [s].
    """

    sample_time: float
    jitter: float
    gap_rows: Rows
    missing: int
    largest_gap: float

    @property
    def rate(self) -> float:
        """Samples per second [Hz]."""
        return 1.0 / self.sample_time

    @property
    def uniform(self) -> bool:
        """True when the clock can be taken as regular: jitter below 2 % of the interval and no gap."""
        return self.jitter <= 0.02 * self.sample_time and not len(self.gap_rows)


def timing(time: Array) -> Timing:
    """Statistics of increasing time stamps.

    A gap is an interval of more than 1.5 medians that also lies 5 robust standard deviations above the median, so that
    the long tail of a jittered clock does not count as lost samples.
    """
    intervals = np.diff(time)
    median = float(np.median(intervals))
    spread = MAD_TO_STD * float(np.median(np.abs(intervals - median)))
    gaps = np.flatnonzero(intervals > max(1.5 * median, median + 5.0 * spread))
    regular = np.delete(intervals, gaps) - median
    return Timing(
        sample_time=median,
        jitter=float(np.sqrt(np.mean(regular**2))) if len(regular) else 0.0,
        gap_rows=gaps,
        missing=int(np.sum(np.round(intervals[gaps] / median) - 1)) if median > 0 else 0,
        largest_gap=float(intervals.max()),
    )


def lost_spells(time: Array) -> Rows:
    """Index of the sample before each interval longer than LOST medians, longest first (g,)."""
    intervals = np.diff(time)
    order = np.argsort(-intervals, kind="stable")
    return order[intervals[order] > LOST * np.median(intervals)]


def quantisation_step(values: Array, share: float = 0.99) -> float | None:
    """Step of a quantised signal, None when it is not quantised or too few levels were visited.

    The step s is the smallest spacing of the visited levels, refined on multiples of it by least squares; it is
    accepted when at least `share` of all spacings lie within 0.05 s of a multiple of s.
    """
    levels = np.unique(values)
    if len(levels) < 4:
        return None
    resolution = 64.0 * np.spacing(np.abs(levels).max())
    spacing = np.diff(levels)
    spacing = spacing[spacing > resolution]
    if len(spacing) < 3:
        return None
    step = float(np.median(spacing[spacing < 1.5 * spacing.min()]))
    for reach in (2, 8, 32, 128, 512):
        multiples = np.round(spacing / step)
        near = (multiples >= 1) & (multiples <= reach)
        if near.any():
            step = float(spacing[near] @ multiples[near] / (multiples[near] @ multiples[near]))
    deviation = np.abs(spacing / step - np.round(spacing / step))
    return step if np.mean(deviation < 0.05) >= share else None


def position_noise(position: Array) -> float:
    """Standard deviation [rad or m] of white noise on the position, from what lies in the upper half of its spectrum.

    Half the power of white noise lies there; the smooth motion of an arm leaves nothing.
    """
    curved = np.diff(position, 4)  # differences of order 4 have the power gain (2 - 2 cos w)^4, mean 70
    return float(np.sqrt(np.mean(curved**2) / 70.0))


def spikes(values: Array, threshold: float = 12.0) -> Rows:
    """Indices of single samples that stand out from both neighbours while these agree with each other.

    With e = x[k] - (x[k-1] + x[k+1])/2 a sample is a spike when |e| exceeds `threshold` robust standard deviations of
    e, `threshold` steps of the quantised signal, and three times the distance of its neighbours and of typical change.
    """
    if len(values) < 5:
        return np.array([], dtype=np.intp)
    deviation = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    scale = MAD_TO_STD * float(np.median(np.abs(deviation)))
    typical = float(np.quantile(np.abs(values[2:] - values[:-2]), 0.99))
    step = quantisation_step(values) or 0.0
    bound = max(threshold * scale, threshold * step, 3.0 * typical, 1e-12)
    apart = np.abs(values[2:] - values[:-2])
    found = (np.abs(deviation) > bound) & (np.abs(deviation) > 3.0 * apart)
    return np.flatnonzero(found) + 1


def stale(values: Array, steps: float = 4.0, longest: int = 5) -> Rows:
    """Indices of samples that repeat the one before them while the signal moves on: the next one makes up for it.

    A run of r samples, `longest` at most, counts where the changes before it and after the next one are alike (one
    sign, within a factor of two, `steps` steps of the quantised signal or more) and the change that ends it is 1 + r/2
    to 1 + 3r/2 times their mean: a steady motion makes it 1 + r times. A joint that sticks starts again slowly or
    speeds on; none counts where most of the runs within a motion end like that.
    """
    change = np.diff(values)
    same = np.concatenate([[False], change == 0.0, [False]])  # of sample i, and none beyond either end
    first, last = np.flatnonzero(~same[:-1] & same[1:]) + 1, np.flatnonzero(same[:-1] & ~same[1:])
    inner = (first >= 2) & (last < len(values) - 2) & (last - first < longest)
    first, last = first[inner], last[inner]
    before, after, beyond, run = change[first - 2], change[last], change[last + 1], last - first + 1
    slower, faster = np.minimum(np.abs(before), np.abs(beyond)), np.maximum(np.abs(before), np.abs(beyond))
    made_up = after / np.where(before + beyond == 0.0, np.inf, 0.5 * (before + beyond)) - 1.0
    moving = slower > steps * (quantisation_step(values) or 0.0)
    found = moving & (before * beyond > 0.0) & (faster <= 2.0 * slower) & (np.abs(made_up / run - 1.0) <= 0.5)
    if 2 * np.count_nonzero(found) < np.count_nonzero(moving):
        return np.array([], np.intp)
    return np.array([row for a, b in zip(first[found], last[found], strict=True) for row in range(a, b + 1)], np.intp)


def jumps(values: Array, ratio: float = 10.0) -> Rows:
    """Indices before a lasting jump: a change between two samples of more than `ratio` times the 99.9 % quantile.

    Spikes (which return at once) are not jumps. A jump also has to exceed 2 % of the range of the signal.
    """
    change = np.diff(values)
    size = np.abs(change)
    bound = max(ratio * float(np.quantile(size, 0.999, method="lower")), 0.02 * float(np.ptp(values)))
    rows = np.flatnonzero(size > bound)
    single = spikes(values)
    return np.setdiff1d(rows, np.concatenate([single, single - 1]))


def saturation(values: Array) -> tuple[float, float]:
    """(level, share): the magnitude at which a signal is cut off, and the share of samples there; (nan, 0) if nowhere.

    A signal is cut off where it stays at exactly its largest or smallest value for at least three samples in a row,
    and the value lies alone: no other sample within 2 % of the range beside it is as frequent.
    """
    span = float(np.ptp(values))
    if span == 0.0:
        return float("nan"), 0.0
    best = (float("nan"), 0.0)
    for extreme, inward in ((values.max(), -1.0), (values.min(), 1.0)):
        at = values == extreme
        if not (at[2:] & at[1:-1] & at[:-2]).any():
            continue
        share = float(np.mean(at))
        depth = (values - extreme) * inward
        beside = float(np.mean((depth > 0) & (depth < 0.02 * span)))
        if share > max(0.005, 2.0 * beside) and share > best[1] and len(np.unique(values)) > 8:
            best = (abs(float(extreme)), share)
    return best


def excitation_band(values: Array, sample_time: float) -> tuple[float, float]:
    """(lowest, highest) frequency [Hz] between which the signal has 98 % of its power, its mean removed."""
    from scipy.signal import welch

    if np.ptp(values) == 0.0:
        return 0.0, 0.0
    segment = min(len(values), max(256, len(values) // 4))
    frequency, power = welch(values - values.mean(), fs=1.0 / sample_time, nperseg=segment)
    cumulated = np.cumsum(power) / np.sum(power)
    return float(frequency[np.searchsorted(cumulated, 0.01)]), float(frequency[np.searchsorted(cumulated, 0.99)])
