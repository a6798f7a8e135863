"""Repairs of a recording, made on request only; each says what it did."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from envs.log import Array, Log, LogError
from envs.log_statistics import MAD_TO_STD, Rows, lost_spells, spikes, timing
from envs.text_form import counted
from envs.validation import Finding, columns_of, stale_readings

#: Share of the repeated stamps that whole rows have to repeat for those to be copies. Where stamps are merely rounded,
#: different samples share one.
COPIED = 0.9
#: Distance from a measured sample, in intervals, from which on a sample counts as interpolated.
APART = 0.02


def repair(log: Log) -> tuple[Log, tuple[Finding, ...]]:
    """The log with broken rows left out, time in order, angles unwrapped, spikes replaced and a regular clock.

    What is done, in this order, and only where needed:
    1. rows with missing or infinite values are left out;
    2. rows that stand twice, stamp and values, are left out;
    3. noisy stamps of a regular clock are replaced by it, otherwise rows are sorted and repeated stamps left out;
    4. angles that jump by full turns are unwrapped;
    5. single-sample spikes of the position are replaced by the mean of their neighbours;
    6. positions that repeat the one before while the joint moves on are interpolated;
    7. an irregular recording is interpolated to a regular clock (see `resample`), but for long gaps.
    """
    done: list[Finding] = []
    steps = (
        without_broken_rows,
        without_copies,
        with_ordered_time,
        unwrapped,
        without_spikes,
        without_stale_readings,
        with_regular_clock,
    )
    for step in steps:
        log, found = step(log)
        done += found
    return log, tuple(done)


def rows_of(log: Log, rows: Rows) -> Log:
    """The log reduced to some rows, in the order given."""
    return replace(
        log,
        time=log.time[rows],
        command=log.command[rows],
        position=log.position[rows],
        velocity=None if log.velocity is None else log.velocity[rows],
        temperature=None if log.temperature is None else log.temperature[rows],
    )


def without_broken_rows(log: Log) -> tuple[Log, list[Finding]]:
    """Leaves out rows in which any signal is missing or infinite."""
    good = np.all([np.isfinite(values) for values in columns_of(log).values()], axis=0)
    lost = int(np.sum(~good))
    if not lost:
        return log, []
    if not good.any():
        raise LogError("no row has all its values", remedy="Check the export", source=log.source)
    return rows_of(log, np.flatnonzero(good)), [
        Finding(
            "repaired_rows",
            f"{counted(lost, 'row')} with missing values left out, the first was row {np.argmin(good) + 1}",
        )
    ]


def without_copies(log: Log) -> tuple[Log, list[Finding]]:
    """Leaves out rows that repeat another one in its stamp and in all its values."""
    repeated = len(log) - len(np.unique(log.time))
    if not repeated:
        return log, []
    _, first = np.unique(np.column_stack(list(columns_of(log).values())), axis=0, return_index=True)
    copies = len(log) - len(first)
    if copies < COPIED * repeated:
        return log, []
    return rows_of(log, np.sort(first)), [Finding("repaired_copies", f"{counted(copies, 'double row')} left out")]


def with_ordered_time(log: Log) -> tuple[Log, list[Finding]]:
    """Strictly increasing time: a fitted clock where stamps are merely noisy, sorted unique rows otherwise."""
    backwards = np.diff(log.time) <= 0
    if not backwards.any() or len(log) < 3:
        return log, []
    number = np.arange(len(log), dtype=np.float64)
    interval, start = np.polyfit(number, log.time, 1)
    error = log.time - (start + interval * number)
    if interval > 0 and np.abs(error).max() < 10.0 * interval and np.mean(backwards) > 0.01:
        said = f"time stamps were noisy ({1e3 * error.std():.3g} ms rms) and replaced by a regular clock"
        return replace(log, time=start + interval * number), [Finding("repaired_clock", said)]
    _, rows = np.unique(log.time, return_index=True)
    said = (
        f"{counted(int(backwards.sum()), 'row')} out of order: sorted, "
        f"{counted(len(log) - len(rows), 'row')} with a repeated stamp left out"
    )
    return rows_of(log, rows), [Finding("repaired_order", said)]


def unwrapped(log: Log) -> tuple[Log, list[Finding]]:
    """Angles without jumps of a full turn."""
    angles = [column for column, facts in enumerate(log.facts) if facts.position_unit == "rad"]
    position = log.position.copy()
    position[:, angles] = np.unwrap(position[:, angles], axis=0, discont=1.5 * math.pi)
    if np.array_equal(position, log.position):
        return log, []
    return replace(log, position=position), [Finding("repaired_wrap", "angles unwrapped at full turns")]


def without_spikes(log: Log) -> tuple[Log, list[Finding]]:
    """Single-sample spikes of the position replaced by the mean of their neighbours."""
    position = log.position.copy()
    done = []
    for column, joint in enumerate(log.joints):
        rows = spikes(position[:, column])
        if len(rows):
            position[rows, column] = 0.5 * (position[rows - 1, column] + position[rows + 1, column])
            done.append(
                Finding(
                    "repaired_spikes", f"{counted(len(rows), 'spike')} of q{joint} replaced by the neighbours' mean"
                )
            )
    return (replace(log, position=position) if done else log), done


def without_stale_readings(log: Log) -> tuple[Log, list[Finding]]:
    """Positions that the logger repeated instead of reading them anew, interpolated linearly between those that it
    read."""
    position = log.position.copy()
    done = []
    for column, joint in enumerate(log.joints):
        rows = stale_readings(position[:, column])
        if len(rows):
            fresh = np.setdiff1d(np.arange(len(log)), rows)
            position[rows, column] = np.interp(log.time[rows], log.time[fresh], position[fresh, column])
            said = f"{counted(len(rows), 'repeated reading')} of q{joint} interpolated"
            done.append(Finding("repaired_stale", said))
    return (replace(log, position=position) if done else log), done


def with_regular_clock(log: Log) -> tuple[Log, list[Finding]]:
    """`resample` at the median interval where the clock is irregular; long gaps stay what they are."""
    if len(log) < 3:
        return log, []
    clock = timing(log.time)
    if clock.uniform:
        return log, []
    interval = clock.sample_time
    intervals = np.diff(log.time)
    if MAD_TO_STD * float(np.median(np.abs(intervals - interval))) > 0.1 * interval:
        interval = float(np.mean(intervals))
    regular = resample(log, interval)
    for row in lost_spells(log.time):
        begin, end = log.time[row] + 0.5 * interval, log.time[row + 1] - 0.5 * interval
        regular = rows_of(regular, np.flatnonzero((regular.time < begin) | (regular.time > end)))
    after = np.clip(np.searchsorted(log.time, regular.time), 1, len(log) - 1)
    distance = np.minimum(np.abs(regular.time - log.time[after - 1]), np.abs(regular.time - log.time[after]))
    between = int(np.sum(distance > APART * interval))
    said = (
        f"interpolated to a regular clock of {1e3 * interval:.6g} ms: {between} of {len(regular)} samples are "
        "interpolated, not measured"
    )
    return regular, [Finding("resampled", said)]


def resample(log: Log, sample_time: float) -> Log:
    """The log on the regular clock t0, t0 + sample_time, … [s], within the recorded time.

    Measured signals are interpolated linearly; a command that is held between samples keeps its last value. Quantised
    positions lose their steps by this, so `encoder_step` stays as the sensor's fact only.
    """
    count = math.floor((log.time[-1] - log.time[0]) / sample_time * (1.0 + 1e-12)) + 1
    time = log.time[0] + sample_time * np.arange(count)
    before = np.clip(np.searchsorted(log.time, time * (1.0 + 1e-15), side="right") - 1, 0, len(log) - 1)

    def between(signals: Array | None) -> Array | None:
        if signals is None:
            return None
        return np.column_stack([np.interp(time, log.time, signals[:, column]) for column in range(signals.shape[1])])

    command = between(log.command)
    assert command is not None
    for column, facts in enumerate(log.facts):
        if facts.hold == "zero_order":
            command[:, column] = log.command[before, column]
    position = between(log.position)
    assert position is not None
    return replace(
        log,
        time=time,
        command=command,
        position=position,
        velocity=between(log.velocity),
        temperature=between(log.temperature),
    )
