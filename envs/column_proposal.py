"""Guesses a column map for a file with its own names, to be checked by its owner: never used without being shown."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from envs.column_map import ColumnMap, ColumnSource
from envs.log import Array
from envs.log_tables import Table
from envs.validation import SLOWEST_INTERVAL, WIDEST_SWING, counts_per_turn

#: Words that names of columns are made of, by the signal they speak of; the first match of a column counts.
WORDS: dict[str, tuple[str, ...]] = {
    "dq": ("velocity", "vel", "speed", "omega", "dq", "qd", "qdot", "rpm", "dtheta"),
    "temp": ("temperature", "temp"),
    "i": ("current", "cur", "iq", "amps", "amp", "ampere", "i", "ia", "ma"),
    "tau": ("torque", "effort", "tau", "force"),
    "v": (
        *("voltage", "volts", "volt", "dac", "u", "v", "vir", "mv", "pwm", "duty"),
        *("input", "command", "cmd", "control"),
    ),
    "t": ("time", "timestamp", "stamp", "zeit", "t", "secs", "seconds", "sec"),
    "q": ("position", "pos", "angle", "theta", "q", "qm", "encoder", "enc", "joint", "phi", "displacement"),
}
#: Words that mark a column as something that was wanted, filtered or derived, not measured.
SECOND_RATE = (
    *("des", "desired", "ref", "reference", "goal", "target", "setpoint", "commanded", "wanted"),
    *("filt", "filtered", "error", "err"),
)
#: Commands, in the order in which one is taken where a file has several, and their units where no name states one.
COMMANDS = {"v": "V", "i": "A", "tau": "N m"}
#: Numbers that only the owner of a file knows, as they stand in a proposed unit, and what they are.
UNKNOWNS = {
    "COUNTS_PER_TURN": "the encoder's counts per turn of the joint",
    "SUPPLY_VOLTAGE": "the supply voltage",
    "FULL_SCALE": "the count that stands for all of it",
}
#: Units as they are written into names: ``pos [deg]``, ``time_ms``, ``speed (rpm)``.
UNITS: dict[str, tuple[str, ...]] = {
    "t": ("s", "ms", "us", "ns"),
    "q": ("rad", "mrad", "deg", "turn", "rev", "m", "mm", "um"),
    "dq": ("rad/s", "deg/s", "rpm", "m/s", "mm/s"),
    "v": ("V", "mV"),
    "i": ("A", "mA"),
    "tau": ("N m", "N", "N mm", "mN m"),
    "temp": ("degC", "K"),
}


@dataclass(frozen=True)
class Proposal:
    """A guessed column map with the unit of every column, the joints whose position looks like a length, and the
    columns of numbers that it has no use for."""

    map: ColumnMap
    lengths: tuple[int, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def unknown(self) -> dict[str, str]:
        """The numbers that have to be put into the units, and what they are."""
        units = " ".join(item.unit or "" for item in self.map.columns.values())
        return {name: meaning for name, meaning in UNKNOWNS.items() if name in units}

    @property
    def missing(self) -> tuple[str, ...]:
        """What a log needs and no column looked like."""
        targets = self.map.columns
        needed = {"the time": ("t",), "a position": ("q1",), "a command": ("v1", "i1", "tau1")}
        return tuple(name for name, any_of in needed.items() if not any(target in targets for target in any_of))

    def toml(self) -> str:
        """The map as TOML, ready to be saved as sidecar."""
        lines = ["[columns]"]
        lines += [
            f'{target} = {{ column = "{item.column}", unit = "{item.unit}" }}'
            for target, item in self.map.columns.items()
        ]
        for joint in self.lengths:
            lines += ["", f"[joints.{joint}]", 'position_unit = "m"']
        return "\n".join(lines) + "\n"


def propose(table: Table) -> Proposal:
    """The likeliest map: by the words in the names, the units in them, and what the numbers allow.

    Joints are numbered in the order of the columns. Of several columns for the same signal a measured one is preferred
    to a wanted or filtered one. Positions beyond the number of commands are taken for further sensors of the joints.
    """
    numeric = {name: values.astype(np.float64) for name, values in table.columns.items() if values.dtype.kind in "fiu"}
    by_signal: dict[str, list[str]] = {signal: [] for signal in WORDS}
    for name in numeric:
        signal = signal_of(name)
        if signal is not None:
            by_signal[signal].append(name)
    if not by_signal["t"]:
        by_signal["t"] = [name for name, values in numeric.items() if is_clock(values)][:1]
    columns: dict[str, ColumnSource] = {}
    lengths: list[int] = []
    clock = next((name for name in by_signal["t"] if is_clock(numeric[name])), None)
    if clock is not None:
        columns["t"] = ColumnSource(clock, unit=unit_of(clock, "t") or time_unit(numeric[clock]))
    found = first_rate(by_signal["q"])
    commands = {signal: first_rate(by_signal[signal]) for signal in COMMANDS}
    most = max(map(len, commands.values()))
    positions = found[:most] if most else found
    for joint, position in enumerate(positions, start=1):
        unit = unit_of(position, "q") or angle_unit(numeric[position])
        columns[f"q{joint}"] = ColumnSource(position, unit=unit)
        if unit in ("m", "mm", "um"):
            lengths.append(joint)
    joints = max(1, len(positions))
    for signal, default in COMMANDS.items():
        if len(commands[signal]) >= joints:
            for joint, name in enumerate(commands[signal][:joints], start=1):
                unit = unit_of(name, signal) or command_unit(name, default, length=joint in lengths)
                columns[f"{signal}{joint}"] = ColumnSource(name, unit=unit)
            break
    speeds = first_rate(by_signal["dq"])
    if positions and len(speeds) == len(found):
        for joint, name in enumerate(speeds[: len(positions)], start=1):
            default = "m/s" if joint in lengths else "deg/s" if columns[f"q{joint}"].unit == "deg" else "rad/s"
            columns[f"dq{joint}"] = ColumnSource(name, unit=unit_of(name, "dq") or default)
    used = {item.column for item in columns.values()}
    left_out = tuple(name for name in numeric if name not in used)
    return Proposal(ColumnMap(columns, source=table.source), tuple(lengths), left_out)


def words_of(name: str) -> list[str]:
    """Words of a column name in lower case: split at punctuation, digits and changes of case."""
    parts = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return [word for word in re.split(r"[^A-Za-z]+", parts.lower()) if word]


def signal_of(name: str) -> str | None:
    """Which signal a name speaks of, None when it is none that a log holds.

    Where a name has words of several commands, such as effort and control, the unit in it decides.
    """
    words = words_of(name)
    spoken = [signal for signal in COMMANDS if any(word in WORDS[signal] for word in words)]
    stated = [signal for signal in spoken if unit_of(name, signal) is not None]
    if len(spoken) > 1 and len(stated) == 1:
        return stated[0]
    return next((signal for signal, known in WORDS.items() if any(word in known for word in words)), None)


def first_rate(names: list[str]) -> list[str]:
    """Measured columns; the wanted and filtered ones only when there is nothing else."""
    measured = [name for name in names if not any(word in SECOND_RATE for word in words_of(name))]
    best = [name for name in measured if "meas" in words_of(name) or "measured" in words_of(name)]
    return best or measured or names


def unit_of(name: str, signal: str) -> str | None:
    """A unit that stands in the name of a column, None when there is none."""
    match = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$", name) or re.search(r"_([A-Za-z]+)$", name)
    if match is None:
        return "rpm" if signal == "dq" and "rpm" in words_of(name) else None
    text = match[1].replace("Nm", "N m").replace("·", " ").replace("°", "deg")
    folded: Mapping[str, str] = {unit.casefold(): unit for unit in UNITS[signal]}
    return text if text in UNITS[signal] else folded.get(text.casefold())


def command_unit(name: str, default: str, *, length: bool) -> str:
    """Unit of a command whose name states none; a duty cycle needs its full scale from the owner of the file."""
    if {"pwm", "duty"} & set(words_of(name)):
        full_scale = "100" if "percent" in words_of(name) else "FULL_SCALE"
        return f"V * SUPPLY_VOLTAGE / {full_scale}"
    return "N" if default == "N m" and length else default


def is_clock(values: Array) -> bool:
    """Whether a column can be time: it increases in nearly every row."""
    return len(values) > 1 and bool(np.mean(np.diff(values) > 0) > 0.95)


def time_unit(values: Array) -> str:
    """The unit that makes the median interval plausible for a servo."""
    interval = float(np.median(np.diff(values)))
    for unit, limit in (("s", SLOWEST_INTERVAL), ("ms", 200.0), ("us", 2e5)):
        if interval < limit:
            return unit
    return "ns"


def angle_unit(values: Array) -> str:
    """rad, deg or encoder counts (of an unknown number per turn), by the range and by whether all are whole."""
    values = values[np.isfinite(values)]
    span = float(np.ptp(values)) if len(values) else 0.0
    if span > 0 and np.array_equal(values, np.round(values)):
        return "turn / COUNTS_PER_TURN"
    return "rad" if span <= WIDEST_SWING or counts_per_turn(values) == 2.0 * np.pi else "deg"
