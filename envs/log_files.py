"""Logs in files: CSV, Parquet and NPZ both ways, with the sidecar NAME.toml; other formats through a column map.

Columns: ``t`` [s], per joint ``v{j}`` [V] or ``i{j}`` [A] or ``tau{j}`` [N m or N], ``q{j}`` [rad or m],
optionally ``dq{j}`` [rad/s or m/s] and ``temp{j}`` [deg C]. A file with ``t, v1, q1`` is enough.

The sidecar holds ``robot``, ``loop`` and one table ``[joints.J]`` per joint with the fields of `JointFacts`.
"""

from __future__ import annotations

import os
import re
import tempfile
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, get_args

import numpy as np

from envs.log import COMMAND_PREFIX, Hold, InputKind, JointFacts, Log, LogError
from envs.log_tables import Reader, Table, listed, read_csv, read_npz, read_parquet
from envs.validation import Finding, check, columns_of

READERS: dict[str, Reader] = {
    ".csv": read_csv,
    ".csv.gz": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    ".parquet": read_parquet,
    ".npz": read_npz,
}
WRITABLE = (".csv", ".parquet", ".npz")
STANDARD_COLUMN = re.compile(r"(v|i|tau|q|dq|temp)([1-9]\d*)")
CHOICES: dict[str, tuple[str, ...]] = {
    "input": get_args(InputKind),
    "hold": get_args(Hold),
    "position_unit": ("rad", "m"),
}


def load(path: str | Path, *, repair: bool = False) -> Log:
    """A log from a file. Raises LogError, one line, when the file is unusable.

    repair: leave out broken rows instead of refusing the file.
    """
    return load_with_findings(path, repair=repair)[0]


def load_with_findings(path: str | Path, *, repair: bool = False) -> tuple[Log, tuple[Finding, ...]]:
    """`load`, and what was noticed on the way."""
    path = Path(path)
    table = read_table(path, repair=repair)
    log = assemble(table, read_sidecar(sidecar_path(path)), name=stem_of(path))
    return log, (*table.findings, *check(log))


def read_table(path: Path, *, repair: bool = False) -> Table:
    """The columns of a file as they are. Raises LogError for a file that is missing, empty or of no known type."""
    source = str(path)
    if path.is_dir() or not path.exists():
        problem = "this is a folder, not a log file" if path.is_dir() else "there is no such file"
        raise LogError(problem, remedy="Check the path", source=source)
    suffix = suffix_of(path)
    if suffix not in READERS:
        raise LogError(
            f"{suffix or 'a file without suffix'} is not a known log format",
            remedy=f"Use one of {', '.join(READERS)}",
            source=source,
        )
    if path.stat().st_size == 0:
        raise LogError("the file is empty", remedy="Record it again", source=source)
    return READERS[suffix](path, repair)


def suffix_of(path: Path) -> str:
    """``.csv.gz`` for a compressed table, the last suffix otherwise, in lower case."""
    suffixes = [suffix.lower() for suffix in path.suffixes]
    return ".csv.gz" if suffixes[-2:] == [".csv", ".gz"] else "".join(suffixes[-1:])


def stem_of(path: Path) -> str:
    """File name without the suffix that says its format."""
    return path.name[: len(path.name) - len(suffix_of(path))]


def sidecar_path(path: Path) -> Path:
    """Where the facts of a log file stand: NAME.toml beside NAME.csv."""
    return path.with_name(stem_of(path) + ".toml")


def read_sidecar(path: Path) -> dict[str, Any]:
    """The sidecar as a dictionary, empty when there is none. Raises LogError when it is not TOML."""
    if not path.exists():
        return {}
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise LogError(f"this is not valid TOML ({error})", remedy="Correct it", source=str(path)) from None


def assemble(table: Table, sidecar: Mapping[str, Any], *, name: str) -> Log:
    """A Log from standard columns and the sidecar's facts."""
    found: dict[int, set[str]] = {}
    for column in table.columns:
        match = STANDARD_COLUMN.fullmatch(column)
        if match:
            found.setdefault(int(match[2]), set()).add(match[1])
    joints = tuple(sorted(joint for joint, prefixes in found.items() if "q" in prefixes))
    time = table.numbers("t")
    if not joints:
        table.numbers("q1")
    facts = tuple(facts_of(joint, found[joint], sidecar, table) for joint in joints)
    prefixes = [next(prefix for prefix, kind in COMMAND_PREFIX.items() if kind == fact.input) for fact in facts]

    def stack(names: list[str]) -> np.ndarray:
        return np.column_stack([table.numbers(column) for column in names])

    def optional(prefix: str) -> np.ndarray | None:
        names = [f"{prefix}{joint}" for joint in joints]
        return stack(names) if all(column in table.columns for column in names) else None

    loop = sidecar.get("loop")
    if loop not in (None, "open", "closed"):
        raise LogError(f"loop = {loop!r} is unknown", remedy="Write open or closed", source=table.source)
    return Log(
        time=time,
        command=stack([f"{prefix}{joint}" for prefix, joint in zip(prefixes, joints, strict=True)]),
        position=stack([f"q{joint}" for joint in joints]),
        velocity=optional("dq"),
        temperature=optional("temp"),
        joints=joints,
        facts=facts,
        robot=sidecar.get("robot"),
        loop=loop,
        name=name,
        source=table.source,
    )


def facts_of(joint: int, prefixes: set[str], sidecar: Mapping[str, Any], table: Table) -> JointFacts:
    """Facts of one joint: what its command column says, then what the sidecar says."""
    commands = sorted(prefixes & set(COMMAND_PREFIX))
    stated = dict(sidecar.get("joints", {}).get(str(joint), {}))
    unknown = set(stated) - {item.name for item in fields(JointFacts)}
    if unknown:
        raise LogError(
            f"[joints.{joint}] has the unknown entry {sorted(unknown)[0]}",
            remedy=f"Use {', '.join(item.name for item in fields(JointFacts))}",
            source=str(sidecar_path(Path(table.source))),
        )
    if not commands:
        raise LogError(
            f"joint {joint} has a position but no command; the file has {listed(table.columns)}",
            remedy=f"Add v{joint} [V], i{joint} [A] or tau{joint} [N m], or give a column map",
            source=table.source,
            column=f"v{joint}",
        )
    if "input" not in stated:
        if len(commands) > 1:
            raise LogError(
                f"joint {joint} has {len(commands)} commands ({', '.join(f'{prefix}{joint}' for prefix in commands)})",
                remedy=f"State input of [joints.{joint}] in the sidecar",
                source=table.source,
            )
        stated["input"] = COMMAND_PREFIX[commands[0]]
    for key, allowed in CHOICES.items():
        if key in stated and stated[key] not in allowed:
            raise LogError(
                f"{key} = {stated[key]!r} of [joints.{joint}] is unknown",
                remedy=f"Write {' or '.join(allowed)}",
                source=str(sidecar_path(Path(table.source))),
            )
    for key in ("encoder_step", "command_step", "command_limit"):
        value = stated.get(key)
        if value is not None and not (isinstance(value, (int, float)) and value > 0):
            raise LogError(
                f"{key} = {value!r} of [joints.{joint}] is not a positive number",
                remedy="Correct it or leave it out",
                source=str(sidecar_path(Path(table.source))),
            )
    return JointFacts(**stated)


def save(log: Log, path: str | Path) -> Path:
    """Writes a log and its sidecar, whole or not at all. Raises LogError for a suffix that cannot be written."""
    import tomli_w

    path = Path(path)
    suffix = suffix_of(path)
    if suffix not in WRITABLE:
        raise LogError(f"cannot write {suffix or 'no suffix'}", remedy=f"Use {', '.join(WRITABLE)}", source=str(path))
    sidecar: dict[str, Any] = {key: value for key in ("robot", "loop") if (value := getattr(log, key)) is not None}
    sidecar["joints"] = {
        str(joint): {key: value for key, value in asdict(facts).items() if value is not None}
        for joint, facts in zip(log.joints, log.facts, strict=True)
    }
    write_atomically(
        {sidecar_path(path): tomli_w.dumps(sidecar).encode(), path: encoded(columns_of(log), suffix)},
    )
    return path


def encoded(columns: Mapping[str, np.ndarray], suffix: str) -> bytes:
    """The bytes of a file with these columns. Numbers survive the way there and back to the last bit."""
    import io

    buffer = io.BytesIO()
    if suffix == ".npz":
        np.savez_compressed(buffer, **columns)  # type: ignore[arg-type]
        return buffer.getvalue()
    import pyarrow as pa
    from pyarrow import csv, parquet

    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    if suffix == ".csv":
        csv.write_csv(table, buffer, csv.WriteOptions(quoting_style="none"))
    else:
        parquet.write_table(table, buffer)
    return buffer.getvalue()


def write_atomically(files: Mapping[Path, bytes]) -> None:
    """Writes several files so that a crash leaves each of them whole or absent. Creates missing folders."""
    written: list[tuple[Path, Path]] = []
    try:
        for path, content in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
                written.append((Path(file.name), path))
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        for temporary, path in written:
            temporary.chmod(0o644)
            temporary.replace(path)
    finally:
        for temporary, _ in written:
            temporary.unlink(missing_ok=True)
