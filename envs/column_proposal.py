"""Guesses a column map for a file with its own names, to be checked by its owner: never used without being shown."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from envs.column_map import STANDARD_COLUMN, ColumnMap, ColumnSource
from envs.log import Array
from envs.log_tables import Table
from envs.validation import SLOWEST_INTERVAL, WIDEST_SWING, counts_per_turn

#: Words that names of columns are made of, by the signal they speak of; the first match of a column counts.
WORDS: dict[str, tuple[str, ...]] = {
    "dq": ("velocity", "vel", "speed", "omega", "dq", "qd", "qdot", "rpm", "dtheta", "drehzahl"),
    "temp": ("temperature", "temp", "temperatur"),
    "i": ("current", "cur", "iq", "amps", "amp", "ampere", "i", "ia", "ma", "strom"),
    "tau": ("torque", "effort", "tau", "force", "drehmoment", "kraft"),
    "v": (
        *("voltage", "volts", "volt", "dac", "u", "v", "vir", "mv", "pwm", "duty", "spannung"),
        *("input", "command", "cmd", "control"),
    ),
    "t": ("time", "timestamp", "stamp", "zeit", "t", "secs", "seconds", "sec"),
    "q": ("position", "pos", "angle", "theta", "q", "qm", "encoder", "enc", "joint", "phi", "displacement", "winkel"),
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
    columns of numbers that it has no use for.

    guessed: targets whose unit stands nowhere in the file, and what it was guessed from. own: columns of the file that
    have the names of a log already.
    """

    map: ColumnMap
    lengths: tuple[int, ...] = ()
    left_out: tuple[str, ...] = ()
    guessed: Mapping[str, str] = field(default_factory=dict)
    own: tuple[str, ...] = ()

    @property
    def unknown(self) -> dict[str, str]:
        """The numbers that have to be put into the units, and what they are."""
        units = " ".join(item.unit or "" for item in self.map.columns.values())
        return {name: meaning for name, meaning in UNKNOWNS.items() if name in units}

    @property
    def missing(self) -> tuple[str, ...]:
        """What a log needs and no column looked like."""
        signals = {name.rstrip("0123456789") for name in (*self.map.columns, *self.own)}
        needed = {"the time": ("t",), "a position": ("q",), "a command": tuple(COMMANDS)}
        return tuple(name for name, any_of in needed.items() if signals.isdisjoint(any_of))

    def toml(self) -> str:
        """The map as TOML, ready to be saved as sidecar."""
        lines = ["[columns]"]
        lines += [
            f'{target} = {{ column = "{item.column}", unit = "{item.unit}" }}{self._remark(target)}'
            for target, item in self.map.columns.items()
        ]
        for joint in self.lengths:
            lines += ["", f"[joints.{joint}]", 'position_unit = "m"']
        return "\n".join(lines) + "\n"

    def _remark(self, target: str) -> str:
        return f"  # {self.guessed[target]}" if target in self.guessed else ""


def propose(table: Table) -> Proposal:
    """The likeliest map: by the words in the names, the units in them, and what the numbers allow.

    Joints are numbered in the order of the columns. Of several columns for the same signal a measured one is preferred
    to a wanted or filtered one. Positions beyond the number of commands are taken for further sensors of the joints.
    Positions and commands under the names of a log stay what they are.
    """
    numeric = {name: values.astype(np.float64) for name, values in table.columns.items() if values.dtype.kind in "fiu"}
    own = {name: match for name in numeric if (match := STANDARD_COLUMN.fullmatch(name))}
    positioned = sorted(int(match[2]) for match in own.values() if match[1] == "q")
    commanded = sorted({int(match[2]) for match in own.values() if match[1] in COMMANDS})
    by_signal: dict[str, list[str]] = {signal: [] for signal in WORDS}
    for name in numeric:
        signal = signal_of(name)
        if signal is not None and not (name in own and (positioned or commanded)):
            by_signal[signal].append(name)
    if not by_signal["t"]:
        by_signal["t"] = [name for name, values in numeric.items() if is_clock(values)][:1]
    columns: dict[str, ColumnSource] = {}
    guessed: dict[str, str] = {}

    def take(target: str, name: str, guess: str, reason: str = "unit guessed: check it") -> str:
        stated = table.units.get(name) or unit_of(name, target.rstrip("0123456789"))
        columns[target] = ColumnSource(name, unit=stated or guess)
        if stated is None:
            guessed[target] = reason
        return stated or guess

    lengths: list[int] = []
    clock = next((name for name in by_signal["t"] if is_clock(numeric[name])), None)
    if clock is not None:
        take("t", clock, time_unit(numeric[clock]))
    found = [] if positioned else first_rate(by_signal["q"])
    commands = {signal: [] if commanded else first_rate(by_signal[signal]) for signal in COMMANDS}
    most = max(len(commanded), *map(len, commands.values()))
    positions = found[:most] if most else found
    joints = positioned or commanded or list(range(1, max(1, len(positions)) + 1))
    for joint, position in zip(joints, positions, strict=False):
        if take(f"q{joint}", position, *angle_unit(numeric[position])) in ("m", "mm", "um"):
            lengths.append(joint)
    for signal, default in COMMANDS.items():
        if len(commands[signal]) >= len(joints):
            for joint, name in zip(joints, commands[signal], strict=False):
                take(f"{signal}{joint}", name, command_unit(name, default, length=joint in lengths))
            break
    speeds = first_rate(by_signal["dq"])
    if positions and len(speeds) == len(found):
        for joint, name in zip(joints, speeds[: len(positions)], strict=False):
            default = "m/s" if joint in lengths else "deg/s" if columns[f"q{joint}"].unit == "deg" else "rad/s"
            take(f"dq{joint}", name, default)
    used = {item.column for item in columns.values()} | set(own)
    left_out = tuple(name for name in numeric if name not in used)
    return Proposal(ColumnMap(columns, source=table.source), tuple(lengths), left_out, guessed, tuple(own))


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


def angle_unit(values: Array) -> tuple[str, str]:
    """rad, deg or encoder counts (of an unknown number per turn), and why: by the step, the range, and whether all
    values are whole."""
    values = values[np.isfinite(values)]
    span = float(np.ptp(values)) if len(values) else 0.0
    if span > 0 and np.array_equal(values, np.round(values)):
        return "turn / COUNTS_PER_TURN", "unit guessed from whole numbers: check it"
    turn = counts_per_turn(values)
    if turn is not None:
        return (
            "deg" if turn == 360.0 else "rad",
            "unit guessed from the step, which divides a turn: check it",
        )
    return "rad" if span <= WIDEST_SWING else "deg", "unit guessed from the range: check it"
