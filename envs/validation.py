"""Is a log usable? Errors stop (`LogError`: one line with place and remedy); findings are said and the log is kept."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from envs.log import COMMAND_UNIT, PREFIX_OF, Array, Log, LogError
from envs.log_statistics import MAD_TO_STD, Rows, jumps, lost_spells, quantisation_step, spikes, stale, timing
from envs.text_form import counted, lasting

#: Fewer samples than this cannot carry an experiment.
MINIMUM_SAMPLES = 16
#: Interval [s] from which on time is taken for milliseconds: no servo is logged as slowly as this.
SLOWEST_INTERVAL = 0.5
#: Range [rad] of a motion back and forth that few joints make (two turns): it may be in degrees or counts.
WIDEST_SWING = 4.0 * math.pi
#: Share of readings that repeat the one before them while the joint moves on, from which the logger is said to miss
#: some; noise makes fewer.
STALE = 1e-3
#: Kind of the finding that an angle may be in another unit.
DOUBTFUL_UNIT = "doubtful_unit"
#: Counts per turn up to which a step read off a file tells whether they are whole, and those of finer encoders.
COUNTED = 2e4
USUAL_COUNTS = tuple(
    count for twos in range(33) for fives in range(14) if COUNTED / 2 <= (count := 2.0**twos * 5.0**fives) <= 2.0**32
)
#: Ratios of velocity units that are mistaken for one another: deg/s, rpm and 1/1000.
VELOCITY_FACTORS = {"deg/s": 180.0 / math.pi, "rpm": 30.0 / math.pi, "mrad/s or mm/s": 1000.0, "turn/s": 0.5 / math.pi}


@dataclass(frozen=True)
class Finding:
    """Something worth saying about a log that does not make it unusable. `kind` is stable, `text` is for people.

    joint: the joint that it is about, where others rely on that.
    """

    kind: str
    text: str
    joint: int | None = None


@dataclass(frozen=True)
class Names:
    """How the file speaks of the standard columns.

    own: the file's own name of a standard column.
    stated: standard columns whose unit a column map states; their plausibility is not questioned.
    """

    own: Mapping[str, str] = field(default_factory=dict)
    stated: frozenset[str] = frozenset()

    def __getitem__(self, column: str) -> str:
        return self.own.get(column, column)


def columns_of(log: Log) -> dict[str, Array]:
    """The signals of a log by their standard column names, each of shape (T,)."""
    columns: dict[str, Array] = {"t": log.time}
    for column, joint in enumerate(log.joints):
        columns[command_column(log, joint)] = log.command[:, column]
        columns[f"q{joint}"] = log.position[:, column]
        if log.velocity is not None:
            columns[f"dq{joint}"] = log.velocity[:, column]
        if log.temperature is not None:
            columns[f"temp{joint}"] = log.temperature[:, column]
    return columns


def command_column(log: Log, joint: int) -> str:
    """Standard name of a joint's command column: v1, i1 or tau1."""
    return f"{PREFIX_OF[log.facts[log.index(joint)].input]}{joint}"


def check(log: Log, names: Names | None = None) -> tuple[Finding, ...]:
    """Raises LogError when the log is unusable, otherwise returns what is worth saying about it."""
    names = names or Names()
    check_length(log)
    check_finite(log, names)
    check_order(log, names)
    check_time_unit(log, names)
    check_motion(log, names)
    check_position_unit(log, names)
    return tuple(
        finding
        for examine in (clock_findings, position_findings, velocity_findings, command_findings)
        for finding in examine(log, names)
    )


def check_length(log: Log) -> None:
    """Refuses a recording with too few samples."""
    if len(log) < MINIMUM_SAMPLES:
        raise LogError(
            f"the recording has {counted(len(log), 'sample')}, at least {MINIMUM_SAMPLES} are needed",
            remedy="Record for longer",
            source=log.source,
        )


def check_finite(log: Log, names: Names) -> None:
    """Refuses missing and infinite values."""
    for name, values in columns_of(log).items():
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise LogError(
                f"{len(bad)} of {len(values)} values are missing or not finite",
                remedy="Remove these rows or load the file with --repair",
                source=log.source,
                column=names[name],
                row=int(bad[0]) + 1,
            )


def check_order(log: Log, names: Names) -> None:
    """Refuses time that stands still or runs backwards, and a clock without any regularity."""
    intervals = np.diff(log.time)
    for wrong, what in ((intervals == 0, "the time stamp of the row before is repeated"), (intervals < 0, None)):
        rows = np.flatnonzero(wrong)
        if len(rows):
            row = int(rows[0])
            said = what or f"time runs backwards from {log.time[row]:.6g} to {log.time[row + 1]:.6g}"
            raise LogError(
                f"{said} ({counted(len(rows), 'such row')})",
                remedy="Remove or sort these rows, or load the file with --repair",
                source=log.source,
                column=names["t"],
                row=row + 2,
            )
    median = float(np.median(intervals))
    spread = MAD_TO_STD * float(np.median(np.abs(intervals - median)))
    if spread > 0.5 * median:
        row = int(np.argmax(np.abs(intervals - median)))
        raise LogError(
            f"time is irregular: intervals from {intervals.min():.3g} to {intervals.max():.3g}, median {median:.3g}",
            remedy="Record at a constant rate, or load the file with --repair (interpolates to a regular clock)",
            source=log.source,
            column=names["t"],
            row=row + 2,
        )
    longest = int(np.argmax(intervals))
    if intervals[longest] > 0.2 * log.duration and len(log) > MINIMUM_SAMPLES:
        raise LogError(
            f"nothing was recorded for {intervals[longest]:.3g} of {log.duration:.3g} s",
            remedy="Split the recording there",
            source=log.source,
            column=names["t"],
            row=longest + 2,
        )


def check_time_unit(log: Log, names: Names) -> None:
    """Refuses a clock that can hardly be in seconds."""
    if "t" in names.stated:
        return
    interval = log.sample_time
    if interval >= SLOWEST_INTERVAL:
        unit = "ms" if interval < 200 else "us" if interval < 2e5 else "ns"
        raise LogError(
            f"one sample per {interval:.6g} s is implausible, this looks like {unit}",
            remedy=f'Convert to seconds or state t = {{ column = "{names["t"]}", unit = "{unit}" }} in a column map',
            source=log.source,
            column=names["t"],
            row=1,
        )
    if interval < 1e-6:
        raise LogError(
            f"one sample per {interval:.3g} s is implausible",
            remedy=f'Convert to seconds or state t = {{ column = "{names["t"]}", unit = … }} in a column map',
            source=log.source,
            column=names["t"],
            row=1,
        )


def check_motion(log: Log, names: Names) -> None:
    """Refuses a recording in which nothing moves or nothing is commanded. Single joints may be held.

    A command that stays the same drives a joint, too: a response to a step may be cut where it begins.
    """
    joint = log.joints[0]
    if not np.ptp(log.position, axis=0).any():
        raise LogError(
            f"the signal is constant ({log.position[0, 0]:.6g}): nothing moves",
            remedy="Excite the joint, or map the column that carries its position",
            source=log.source,
            column=names[f"q{joint}"],
        )
    if not log.command.any():
        raise LogError(
            "the signal is constant (0): nothing is commanded",
            remedy="Drive the joint, or map the column that carries its command",
            source=log.source,
            column=names[command_column(log, joint)],
        )


def check_position_unit(log: Log, names: Names) -> None:
    """Refuses positions that can hardly be in radians or metres, and angles that wrap around."""
    for column, joint in enumerate(log.joints):
        name, position = f"q{joint}", log.position[:, column]
        unit = log.facts[column].position_unit
        if unit == "rad":
            check_wrap(position, name, log, names)
        if name in names.stated:
            continue
        position = np.delete(position, spikes(position))
        span = float(np.ptp(position))
        whole = np.array_equal(position, np.round(position))
        if is_wide(position, unit) and (whole or unit == "m" or counts_per_turn(position) == 360.0):
            if unit == "rad":
                guess, spoken = ("turn / COUNTS", "encoder counts") if whole else ("deg", "degrees")
            else:
                guess, spoken = ("m / COUNTS", "encoder counts") if whole else ("mm", "millimetres")
            raise LogError(
                f"back and forth over {span:.4g} {unit} is implausible, this looks like {spoken}",
                remedy=f'Convert to {unit} or state {name} = {{ column = "{names[name]}", unit = "{guess}" }} '
                f'in a column map (unit = "{unit}" if it is so)',
                source=log.source,
                column=names[name],
                row=int(np.argmax(np.abs(position))) + 1,
            )


def is_wide(position: Array, unit: str) -> bool:
    """Whether a joint moves back and forth over more than joints usually do."""
    path = float(np.abs(np.diff(position)).sum())
    returns = abs(position[-1] - position[0]) < 0.5 * path
    return bool(returns and np.ptp(position) > (WIDEST_SWING if unit == "rad" else 10.0))


def counts_per_turn(position: Array) -> float | None:
    """The turn, 2 pi or 360, of which the angle comes in whole counts, and not of the other one; None if none."""
    step = quantisation_step(position)
    turns = () if step is None else [turn for turn in (2.0 * math.pi, 360.0) if is_counted(turn / step)]
    return turns[0] if len(turns) == 1 else None


def is_counted(counts: float) -> bool:
    """Whether an encoder may have so many counts per turn: a whole number, or where the step is not known as exactly as
    that takes, one that encoders do have."""
    if counts < COUNTED:
        return abs(counts - round(counts)) < 0.01
    return any(abs(counts / usual - 1.0) < 1e-6 for usual in USUAL_COUNTS)


def check_wrap(position: Array, name: str, log: Log, names: Names) -> None:
    """Refuses an angle that jumps by a full turn."""
    change = np.abs(np.diff(position))
    for turn, unit in ((2.0 * math.pi, "rad"), (360.0, "deg")):
        rows = np.flatnonzero(np.abs(change - turn) < 0.05 * turn)
        rest = np.delete(change, rows)
        if len(rows) and rest.max(initial=0.0) < 0.25 * turn:
            raise LogError(
                f"the angle jumps by a full turn ({turn:.4g} {unit})",
                remedy="Unwrap it, or load the file with --repair",
                source=log.source,
                column=names[name],
                row=int(rows[0]) + 2,
            )


def clock_findings(log: Log, names: Names) -> Iterator[Finding]:
    """Jitter and gaps."""
    clock = timing(log.time)
    if clock.jitter > 0.02 * clock.sample_time:
        yield Finding(
            "jitter",
            f"time stamps jitter by {1e3 * clock.jitter:.3g} ms rms ({clock.jitter / clock.sample_time:.0%} of the "
            f"interval of {1e3 * clock.sample_time:.4g} ms)",
        )
    gaps = len(clock.gap_rows)
    if gaps > 0.05 * len(log):
        yield Finding(
            "uneven_clock", f"{gaps} of {len(log) - 1} intervals are longer than one and a half times the median"
        )
    elif gaps:
        yield Finding(
            "gaps",
            f"about {counted(clock.missing, 'sample')} ({clock.missing / (len(log) + clock.missing):.1%}) missing in "
            f"{counted(gaps, 'gap')}, the longest {lasting(clock.largest_gap)}, the first after row "
            f"{int(clock.gap_rows[0]) + 1}",
        )


def position_findings(log: Log, names: Names) -> Iterator[Finding]:
    """Joints that are held, angles that may be in another unit, single-sample spikes and lasting jumps."""
    for column, joint in enumerate(log.joints):
        position = log.position[:, column]
        name = names[f"q{joint}"]
        if not np.ptp(position):
            yield Finding("held_joint", f"{name} is constant: joint {joint} did not move and cannot be identified")
            continue
        unit = log.facts[column].position_unit
        kept = np.delete(position, spikes(position))
        if f"q{joint}" not in names.stated and is_wide(kept, unit) and counts_per_turn(kept) != 2.0 * math.pi:
            yield Finding(
                DOUBTFUL_UNIT,
                f"{name} moves back and forth over {np.ptp(kept):.4g} rad: if these are degrees, state "
                f'q{joint} = {{ column = "{name}", unit = "deg" }} in a column map (unit = "rad" if it is so)',
                joint,
            )
        yield from spike_findings(position, name)
        yield from stale_findings(position, name)
        moved = np.setdiff1d(jumps(position), lost_spells(log.time))  # over a gap a joint may go anywhere
        if len(moved):
            row = int(moved[0])
            yield Finding(
                "jump",
                f"{name} jumps by {position[row + 1] - position[row]:.3g} {log.facts[column].position_unit} after row "
                f"{row + 1} and stays there: two recordings joined, or the sensor lost its zero?",
            )


def spike_findings(values: Array, name: str) -> Iterator[Finding]:
    """Single samples far from both neighbours."""
    rows = spikes(values)
    if len(rows):
        yield Finding(
            "spikes",
            f"{name} has {counted(len(rows), 'single-sample spike')}, the first in row "
            f"{int(rows[0]) + 1}; --repair replaces them",
        )


def stale_readings(values: Array) -> Rows:
    """Rows of readings that repeat the one before them while the joint moves on; none where noise makes as many."""
    rows = stale(values)
    return rows if len(rows) > STALE * len(values) else rows[:0]


def stale_findings(values: Array, name: str) -> Iterator[Finding]:
    """Readings that the logger repeated."""
    rows = stale_readings(values)
    if len(rows):
        yield Finding(
            "stale_readings",
            f"{name} repeats the reading before it in {counted(len(rows), 'row')} while it moves on, first in row "
            f"{int(rows[0]) + 1}: the logger missed new readings; --repair interpolates them",
        )


def velocity_findings(log: Log, names: Names) -> Iterator[Finding]:
    """Whether the measured velocity is the derivative of the position: its unit and its sign.

    Raises LogError when the ratio is that of two known units.
    """
    if log.velocity is None:
        return
    for column, joint in enumerate(log.joints):
        ratio = velocity_ratio(log.time, log.position[:, column], log.velocity[:, column])
        name = f"dq{joint}"
        if ratio is None or abs(ratio - 1.0) < 0.2:
            continue
        known = [
            (unit, "position" if swapped else "velocity")
            for unit, factor in VELOCITY_FACTORS.items()
            for swapped in (False, True)
            if abs(abs(ratio) * (factor if swapped else 1.0 / factor) - 1.0) < 0.1
        ]
        if known and name not in names.stated and f"q{joint}" not in names.stated:
            unit, which = known[0]
            told = unit if which == "velocity" else unit.replace("/s", "")
            raise LogError(
                f"the velocity is {ratio:.4g} times the derivative of {names[f'q{joint}']}: the {which} looks like "
                f"{told}",
                remedy="Convert it or state the unit in a column map",
                source=log.source,
                column=names[name],
            )
        yield Finding("velocity_ratio", f"{names[name]} is {ratio:.3g} times the derivative of {names[f'q{joint}']}")


def velocity_ratio(time: Array, position: Array, velocity: Array) -> float | None:
    """Least-squares ratio of the measured velocity to the derivative of the position, None when it cannot be told.

    Compared as displacements over windows of at least 20 samples, so that quantisation does not matter.
    """
    window = max(20, len(time) // 200)
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])
    measured = (position[window:] - position[:-window])[::window]
    integrated = (travelled[window:] - travelled[:-window])[::window]
    if len(measured) < 5 or not measured.any() or not integrated.any():
        return None
    cosine = float(measured @ integrated / math.sqrt((measured @ measured) * (integrated @ integrated)))
    return None if abs(cosine) < 0.8 else float(measured @ integrated / (measured @ measured))


def command_findings(log: Log, names: Names) -> Iterator[Finding]:
    """Commands that stand still, spike or exceed the stated limit."""
    for column, joint in enumerate(log.joints):
        facts, command = log.facts[column], log.command[:, column]
        name, unit = names[command_column(log, joint)], COMMAND_UNIT[facts.input]
        if not np.ptp(command):
            yield Finding("constant_command", f"{name} is constant ({command[0]:.4g} {unit})")
        largest = float(np.abs(command).max())
        if facts.command_limit is not None and largest > 1.01 * facts.command_limit:
            yield Finding(
                "beyond_limit", f"{name} reaches {largest:.4g} {unit}, beyond its limit of {facts.command_limit:.4g}"
            )
