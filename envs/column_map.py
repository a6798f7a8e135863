"""Column maps: how a file with its own names and units becomes a log.

A map is TOML, a file of its own or the sidecar NAME.toml of the log::

    robot = "my_arm"
    loop = "closed"
    [columns]
    t  = { column = "stamp", unit = "ms" }
    q1 = { column = "position", unit = "turn / 8192" }
    v1 = { column = "pwm", unit = "1 / 885", signed_bits = 16, times = "supply", times_unit = "mV" }
    [joints.1]
    encoder_step = 0.000767

value = (column + offset) * scale * times, `offset` in the column's own numbers. Units are checked (`envs.units`): the
product of `unit` and `times_unit` has to be convertible to the standard unit of the target.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from envs.log import Array, LogError
from envs.log_tables import Table
from envs.units import UnitError, convert
from envs.validation import Names

STANDARD_COLUMN = re.compile(r"(v|i|tau|q|dq|temp)([1-9]\d*)")


@dataclass(frozen=True)
class ColumnSource:
    """Where a standard column comes from.

    column: name in the file. unit: an expression of `envs.units`; None: the one that the file states, else already in
    the standard unit. scale: a factor without unit, -1 turns the sign. offset: added first. signed_bits: width of a
    register in two's complement that was logged unsigned. times: a second column that multiplies (the supply), in
    times_unit.
    """

    column: str
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    signed_bits: int | None = None
    times: str | None = None
    times_unit: str = "share"


@dataclass(frozen=True)
class ColumnMap:
    """Standard columns by name, the rest of the sidecar's facts, and where the map was read."""

    columns: Mapping[str, ColumnSource] = field(default_factory=dict)
    source: str | None = None

    @property
    def names(self) -> Names:
        """How the mapped file speaks of the standard columns."""
        return Names(
            own={name: item.column for name, item in self.columns.items()},
            stated=frozenset(name for name, item in self.columns.items() if item.unit is not None),
        )


def parse_column_map(content: Mapping[str, Any], source: str) -> ColumnMap:
    """The table ``[columns]`` of a TOML file. Raises LogError for targets and entries that do not exist."""
    columns: dict[str, ColumnSource] = {}
    known = [item.name for item in fields(ColumnSource)]
    for target, entry in content.get("columns", {}).items():
        if target != "t" and not STANDARD_COLUMN.fullmatch(target):
            raise LogError(
                f"columns.{target} is not a column of a log",
                remedy="Use t and, per joint J, vJ or iJ or tauJ, qJ, dqJ, tempJ",
                source=source,
            )
        table = {"column": entry} if isinstance(entry, str) else entry
        unknown = sorted(set(table) - set(known)) if isinstance(table, Mapping) else ["it is no table"]
        if unknown or "column" not in table:
            raise LogError(
                f"columns.{target} cannot be read ({unknown[0] if unknown else 'no column'})",
                remedy=f"Give column and, where needed, {', '.join(known[1:])}",
                source=source,
            )
        item = ColumnSource(**table)
        numeric = isinstance(item.scale, int | float) and isinstance(item.offset, int | float) and item.scale != 0
        if not numeric or not (item.signed_bits is None or item.signed_bits in range(2, 65)):
            raise LogError(
                f"columns.{target} has a scale, offset or signed_bits that is no usable number",
                remedy="Correct it or leave it out",
                source=source,
            )
        columns[target] = item
    return ColumnMap(columns, source)


def standard_unit(target: str, position_unit: str) -> str:
    """Unit of a standard column: t in s, q1 in rad or m, and so on."""
    prefix = target.rstrip("0123456789")
    length = position_unit == "m"
    return {
        "t": "s",
        "v": "V",
        "i": "A",
        "tau": "N" if length else "N m",
        "q": position_unit,
        "dq": f"{position_unit}/s",
        "temp": "degC",
    }[prefix]


def apply(columns: ColumnMap, table: Table, position_units: defaultdict[int, str]) -> Table:
    """The table in standard columns. Mapped columns replace columns of the same name; standard ones stay."""
    mapped = {name: values for name, values in table.columns.items() if name == "t" or STANDARD_COLUMN.fullmatch(name)}
    stated = {name: ColumnSource(name) for name in mapped if name in table.units}
    for target, item in (stated | dict(columns.columns)).items():
        joint = int(target.lstrip("abcdefghijklmnopqrstuvwxyz") or 0)
        mapped[target] = converted(item, table, standard_unit(target, position_units[joint]), target)
    return replace(table, columns=mapped)


def converted(item: ColumnSource, table: Table, unit: str, target: str) -> Array:
    """One standard column in its standard unit."""
    values = table.numbers(item.column)
    if item.signed_bits is not None:
        half = 2.0 ** (item.signed_bits - 1)
        values = np.where(values >= half, values - 2.0 * half, values)
    values = (values + item.offset) * item.scale
    stated = item.unit or table.units.get(item.column)
    if item.times is not None:
        values = values * table.numbers(item.times)
        stated = f"({stated or 'share'}) * ({item.times_unit})"
    if stated is None:
        return values
    try:
        return convert(values, stated, unit)
    except UnitError as error:
        remedy = "Correct the unit of the column map" if item.unit else "Correct the unit, or state one in a column map"
        raise LogError(
            f"{target} from column {item.column}: {error}",
            remedy=remedy,
            source=table.source,
            column=item.column,
        ) from None
