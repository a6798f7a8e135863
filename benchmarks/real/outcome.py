"""What one rig gives: sentences, figures, tables, numbers; as JSON, as CSV, and back."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

Cell = str | float | int | None


@dataclass(frozen=True)
class Table:
    """A tidy table: one row per thing, one column per property. digits: significant ones on the page."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    digits: int = 3
    folded: bool = False

    def csv(self) -> str:
        """All rows at full precision."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(self.rows)
        return buffer.getvalue()


@dataclass(frozen=True)
class Picture:
    """A figure as SVG text with its caption."""

    name: str
    caption: str
    svg: str


@dataclass(frozen=True)
class Section:
    """A heading, then paragraphs, figures and tables in this order."""

    heading: str
    paragraphs: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """One rig. summary: what was found, for a reader in a hurry. numbers: the figures that the summary rests on.

    failure: why there is nothing else (data absent, or an error), in one line; key: what the outcome was computed from.
    """

    rig: str
    title: str
    summary: tuple[str, ...] = ()
    sections: tuple[Section, ...] = ()
    numbers: dict[str, float] = field(default_factory=dict)
    failure: str = ""
    key: str = ""
    seconds: float = 0.0

    def tables(self) -> Iterator[Table]:
        """All tables of the rig."""
        for section in self.sections:
            yield from section.tables

    def pictures(self) -> Iterator[Picture]:
        """All figures of the rig."""
        for section in self.sections:
            yield from section.pictures

    def to_json(self) -> str:
        """Everything; `from_json` gives an equal outcome."""
        return json.dumps(finite(asdict(self)), ensure_ascii=False, indent=1)

    @classmethod
    def from_json(cls, text: str) -> Outcome:
        """The outcome that `to_json` wrote."""
        content = json.loads(text)
        sections = tuple(
            Section(
                heading=entry["heading"],
                paragraphs=tuple(entry["paragraphs"]),
                pictures=tuple(Picture(**item) for item in entry["pictures"]),
                tables=tuple(
                    Table(**{**item, "columns": tuple(item["columns"]), "rows": tuple(map(tuple, item["rows"]))})
                    for item in entry["tables"]
                ),
            )
            for entry in content.pop("sections")
        )
        return cls(**{**content, "summary": tuple(content["summary"]), "sections": sections})


def finite(value: Any) -> Any:
    """Plain Python values; numbers that are not finite become null, since JSON has no word for them."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, bool | str | int) or value is None:
        return value
    number = float(value)
    return number if math.isfinite(number) else None


def rows(values: Sequence[Sequence[Any]]) -> tuple[tuple[Cell, ...], ...]:
    """Rows of a table from anything number-like."""
    return tuple(tuple(finite(list(row))) for row in values)
