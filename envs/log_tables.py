"""Tables from files: named columns of numbers out of CSV, Parquet and NPZ, before they become a Log.

Nothing here knows what a column means; `envs.log_files` does. Rows are counted from 1, the header left out.
"""

from __future__ import annotations

import gzip
import io
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from envs.log import Array, LogError
from envs.text_form import counted
from envs.text_lines import are_numbers, as_utf8, has_decimal_commas, heading
from envs.validation import Finding

if TYPE_CHECKING:
    import pyarrow as pa

#: First bytes of the formats that are easily taken for one another.
SIGNATURES: tuple[tuple[bytes, str], ...] = (
    (b"PAR1", "Parquet"),
    (b"PK\x03\x04", "NPZ or another zip archive"),
    (b"\x1f\x8b", "gzip"),
    (b"\x89HDF\r\n\x1a\n", "HDF5 (MATLAB v7.3)"),
    (b"MATLAB 5.0", "MATLAB v5"),
    (b"MATLAB 7.3", "HDF5 (MATLAB v7.3)"),
    (b"\x93NUMPY", "NPY"),
    (b"\x89MCAP0\r\n", "MCAP"),
    (b"SQLite format 3", "SQLite (a ROS 2 bag)"),
    (b"\x89PNG", "PNG image"),
    (b"\xff\xd8\xff", "JPEG image"),
    (b"%PDF", "PDF"),
)


@dataclass(frozen=True, eq=False)
class Table:
    """Named columns of one file, each of shape (T,), as read; text columns stay text until they are asked for.

    units: of the columns for which the file itself states one.
    """

    columns: Mapping[str, NDArray[Any]]
    source: str
    findings: tuple[Finding, ...] = field(default=())
    units: Mapping[str, str] = field(default_factory=dict)

    def numbers(self, name: str) -> Array:
        """One column as float64. Raises LogError when it is missing or holds text."""
        if name not in self.columns:
            raise LogError(
                f"there is no such column; the file has {listed(self.columns)}",
                remedy="Rename a column or give a column map (adeptone data inspect proposes one)",
                source=self.source,
                column=name,
            )
        values = self.columns[name]
        if values.dtype.kind in "fiub":
            return values.astype(np.float64)
        for row, value in enumerate(values, start=1):
            try:
                float(value or "nan")
            except ValueError:
                raise LogError(
                    f"{str(value)[:40]!r} is not a number",
                    remedy="Write plain numbers with a decimal point",
                    source=self.source,
                    column=name,
                    row=row,
                ) from None
        return np.array([float(value or "nan") for value in values])


def listed(names: Iterable[str], most: int = 12) -> str:
    """Names as they are printed in a message: the first few, then how many more."""
    names = list(names)
    shown = ", ".join(names[:most])
    return shown + (f" and {len(names) - most} more" if len(names) > most else "") if names else "no columns"


def true_format(head: bytes) -> str | None:
    """What the first bytes of a file say that it is; None when they are plain text."""
    for signature, name in SIGNATURES:
        if head.startswith(signature):
            return name
    return "binary data" if b"\0" in head else None


def damaged(source: str, expected: str, head: bytes, error: Exception) -> LogError:
    """The one line for a file that its reader could not open: another type, or cut."""
    found = true_format(head)
    if found is not None and found.split()[0] not in expected:
        return LogError(
            f"the file is {found}, not {expected}", remedy="Give it the suffix of its true format", source=source
        )
    if found is None:
        return LogError(
            f"the file is not {expected}", remedy="Export it again or give it its true suffix", source=source
        )
    reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
    return LogError(
        f"the {expected} file is damaged or cut ({reason})", remedy="Copy or record it again", source=source
    )


def flatten(name: str, value: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """An array as columns: (T,), (T, 1) and (1, T) keep their name, (T, n) becomes NAME1 … NAMEn."""
    if value.ndim == 2 and 1 in value.shape:
        value = value.reshape(-1)
    if value.ndim == 1:
        return {name: value}
    if value.ndim == 2:
        tall = value if value.shape[0] >= value.shape[1] else value.T
        return {f"{name}{number}": column for number, column in enumerate(tall.T, start=1)}
    return {}


def of_one_length(columns: Mapping[str, NDArray[Any]], source: str) -> Table:
    """Keeps the columns that have a row per time stamp; single values (constants) are left out."""
    lengths = [len(values) for values in columns.values() if len(values) > 1]
    if not lengths:
        raise LogError("the file holds no signals", remedy="Record t, v1 and q1 at least", source=source)
    rows = len(columns["t"]) if "t" in columns else max(set(lengths), key=lengths.count)
    return Table({name: values for name, values in columns.items() if len(values) == rows}, source)


def read_csv(path: Path, repair: bool) -> Table:
    """A text table with a header line; comma, semicolon, tab or blanks between cells, gzip or not.

    Comments above the header are passed over; a row of units below it states the units of the columns.

    Rows with too few or too many cells raise LogError; with `repair` they are left out and said.
    """
    import pyarrow as pa
    from pyarrow import csv

    source = str(path)
    raw = path.read_bytes()
    findings: list[Finding] = []
    if raw[:2] == b"\x1f\x8b":
        raw = unzipped(raw, source, repair, findings)
    if not raw.strip():
        raise LogError("the file is empty", remedy="Record it again", source=source)
    found = true_format(raw[:4096])
    if found is not None:
        raise LogError(
            f"the file is {found}, not a text table",
            remedy="Give it the suffix of its true format or export it as CSV",
            source=source,
        )
    raw = as_utf8(raw, findings)
    lines = raw[:65536].decode("utf-8", errors="ignore").split("\n")
    head = heading(lines, source)
    names, delimiter = head.names, head.delimiter
    check_header(names, source)
    body = raw.split(b"\n", head.lines)[-1] if raw.count(b"\n") >= head.lines else b""
    if not body.strip():
        raise LogError("there is a header but no row", remedy="Record it again", source=source)
    if delimiter == " ":
        body = b"\n".join(b" ".join(line.split()) for line in body.splitlines())
    comma = has_decimal_commas(lines[head.lines :], delimiter)
    bad_rows: list[Any] = []

    def keep_aside(row: Any) -> str:
        bad_rows.append(row)
        return "skip"

    try:
        table = csv.read_csv(
            io.BytesIO(body),
            read_options=csv.ReadOptions(use_threads=False, column_names=names),
            parse_options=csv.ParseOptions(delimiter=delimiter, invalid_row_handler=keep_aside),
            convert_options=csv.ConvertOptions(decimal_point="," if comma else "."),
        )
    except pa.ArrowInvalid as error:
        raise LogError(
            f"the table cannot be read ({str(error).splitlines()[0][:120]})",
            remedy="Export it as CSV with one header line",
            source=source,
        ) from None
    if bad_rows:
        first = bad_rows[0]
        problem = f"{counted(first.actual_columns, 'cell')} where the header has {first.expected_columns}"
        if not repair:
            last = " (the file seems to be cut)" if not raw.endswith(b"\n") and len(bad_rows) == 1 else ""
            raise LogError(
                problem + last, remedy="Copy the file again or load it with --repair", source=source, row=first.number
            )
        rows = tuple(int(row.number) for row in bad_rows)
        findings.append(
            Finding(
                "broken_rows",
                f"{counted(len(rows), 'row')} with missing or surplus cells left out, first row {rows[0]}",
            )
        )
    elif not raw.endswith((b"\n", b"\r")) and not bad_rows:
        findings.append(Finding("no_final_newline", "the last line has no line end: the file may have been cut"))
    if head.units:
        stated = listed((f"{name} in {unit}" for name, unit in head.units.items()), most=40)
        findings.append(Finding("units_row", f"the line below the header states units: {stated}"))
    return Table({name: from_arrow(table.column(name)) for name in names}, source, tuple(findings), head.units)


def check_header(names: list[str], source: str) -> None:
    """Refuses a header of numbers (a table without one) and names that stand twice."""
    if are_numbers(names):
        raise LogError(
            "the first line holds numbers, not column names",
            remedy="Add a header line such as t,v1,q1",
            source=source,
            row=1,
        )
    for name in names:
        if names.count(name) > 1:
            raise LogError(f"{name!r} stands twice in the header", remedy="Rename one", source=source, column=name)


def unzipped(raw: bytes, source: str, repair: bool, findings: list[Finding]) -> bytes:
    """The text inside a gzip file; a cut archive raises LogError, or gives its whole lines with `repair`."""
    try:
        return gzip.decompress(raw)
    except (EOFError, OSError, zlib.error):
        if not repair:
            raise LogError(
                "the gzip file is damaged or cut", remedy="Copy the file again or load it with --repair", source=source
            ) from None
    rescued = zlib.decompressobj(zlib.MAX_WBITS | 16).decompress(raw)
    findings.append(Finding("cut_archive", "the gzip file is cut: only its whole lines were read"))
    return rescued[: rescued.rfind(b"\n") + 1]


def from_arrow(column: pa.ChunkedArray) -> NDArray[Any]:
    """An Arrow column as numpy: numbers as float64 or integers (missing values as NaN), dates as seconds, else text."""
    import pyarrow as pa

    if pa.types.is_timestamp(column.type):
        nanoseconds = column.cast(pa.timestamp("ns")).to_numpy()
        return (nanoseconds - nanoseconds[0]).astype("timedelta64[ns]").astype(np.float64) * 1e-9
    numbers = pa.types.is_floating(column.type) or pa.types.is_integer(column.type)
    if numbers and not column.null_count:
        return np.from_dlpack(column.combine_chunks())  # to_numpy would import pandas
    if numbers or pa.types.is_boolean(column.type):
        return column.cast(pa.float64()).to_numpy() if column.null_count else column.to_numpy()
    if pa.types.is_null(column.type):
        return np.full(len(column), np.nan)
    return np.array(["" if value is None else str(value) for value in column.to_pylist()])


def read_parquet(path: Path, repair: bool) -> Table:
    """A Parquet file with flat columns."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        table = parquet.read_table(path)
    except (pa.ArrowInvalid, OSError) as error:
        raise damaged(str(path), "Parquet", head_of(path), error) from None
    return Table({name: from_arrow(table.column(name)) for name in table.column_names}, str(path))


def read_npz(path: Path, repair: bool) -> Table:
    """A numpy archive; arrays (T, n) become n columns."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise damaged(str(path), "NPZ", head_of(path), error) from None
    columns = {key: column for name, array in arrays.items() for key, column in flatten(name, array).items()}
    return of_one_length(columns, str(path))


def head_of(path: Path) -> bytes:
    """The first bytes of a file, enough to know its format."""
    with path.open("rb") as file:
        return file.read(4096)


Reader = Callable[[Path, bool], Table]
