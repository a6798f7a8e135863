"""The lines of a text table before they are cells: its encoding, comments, the header, and a row of units below it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from envs.log import LogError
from envs.units import NO_UNIT, is_unit, plain
from envs.validation import Finding

COMMENTS = ("#", "%")
"""What a line that is no data begins with, above the header. Some programs write the header itself like this."""


@dataclass(frozen=True)
class Heading:
    """What stands above the data.

    names: of the columns. delimiter: of the cells, a blank for any number of them. units: of the columns that state
    one in a row of their own. lines: how many lines this takes.
    """

    names: list[str]
    delimiter: str
    units: dict[str, str]
    lines: int


def as_utf8(raw: bytes, findings: list[Finding]) -> bytes:
    """The text as UTF-8. What is something else is taken for Windows-1252, of which Latin-1 is a part, and said."""
    raw = raw.removeprefix(b"\xef\xbb\xbf")
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError:
        findings.append(Finding("encoding", "the file is not UTF-8 text and was read as Windows-1252 (Latin-1)"))
        return raw.decode("cp1252", errors="replace").encode("utf-8")
    return raw


def heading(lines: Sequence[str], source: str) -> Heading:
    """Finds the header and a row of units below it; comments and empty lines above are passed over.

    Where only comments stand above the numbers, the last one is the header. Raises LogError for text below the header
    that is no row of units.
    """
    filled = [row for row, line in enumerate(lines) if line.strip()]
    row = next((row for row in filled if not lines[row].lstrip().startswith(COMMENTS)), len(lines))
    comments = [number for number in filled if number < row]
    if comments and (row == len(lines) or are_numbers(loose_cells(lines[row]))):
        row = comments.pop()
    if comments and states_units(loose_cells(lines[row])):
        above = comments[-1]
        row = above if len(loose_cells(lines[above])) == len(loose_cells(lines[row])) else row
    header = bare(lines[row])
    delimiter = next((mark for mark in ",;\t" if mark in header), " ")
    names = cells_of(header, delimiter)
    below = cells_of(bare(lines[row + 1]), delimiter) if row + 1 < len(lines) else []
    if len(below) != len(names) or not any(below) or any(is_number(cell) for cell in below):
        return Heading(names, delimiter, {}, row + 1)
    units = {name: cell.strip("[]()") for name, cell in zip(names, below, strict=True)}
    if not any(is_unit(unit) for unit in units.values()):
        raise LogError(
            f"the line below the header holds neither numbers nor units ({', '.join(below)[:60]})",
            remedy="Remove it, or write units such as s, V, rad into it",
            source=source,
            row=1,
        )
    stated = {name: plain(unit) for name, unit in units.items() if unit not in NO_UNIT}
    return Heading(names, delimiter, stated, row + 2)


def has_decimal_commas(lines: Sequence[str], delimiter: str) -> bool:
    """Whether numbers are written 0,5: by the first line in which a comma or a point says so."""
    if delimiter == ",":
        return False
    telling = next((line for line in lines if "," in line or "." in line), "")
    return "," in telling and "." not in telling


def bare(line: str) -> str:
    """A line without the mark of a comment."""
    return line.strip().lstrip("".join(COMMENTS)).strip()


def cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of one line without blanks and quotes around them."""
    parts = line.split() if delimiter == " " else line.split(delimiter)
    return [part.strip().strip('"').strip() for part in parts]


def loose_cells(line: str) -> list[str]:
    """The cells of a line whose delimiter is not yet known."""
    return [cell for cell in re.split(r"[,;\t ]+", bare(line)) if cell]


def are_numbers(cells: Sequence[str]) -> bool:
    """Whether all cells are numbers."""
    return all(is_number(cell) for cell in cells)


def states_units(cells: Sequence[str]) -> bool:
    """Whether every cell is a unit."""
    return bool(cells) and all(is_unit(cell.strip("[]()")) for cell in cells)


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
