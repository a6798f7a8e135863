"""Logs in files: CSV, Parquet and NPZ both ways, with the sidecar NAME.toml; other formats through a column map.

Columns: ``t`` [s], per joint ``v{j}`` [V] or ``i{j}`` [A] or ``tau{j}`` [N m or N], ``q{j}`` [rad or m],
optionally ``dq{j}`` [rad/s or m/s] and ``temp{j}`` [deg C]. A file with ``t, v1, q1`` is enough.

The sidecar holds ``robot``, ``loop`` and the fields of `JointFacts`, those of one joint in its table ``[joints.J]``,
those of every joint above the tables. ``encoder_counts`` or ``encoder_counts_per_rev`` stands for an ``encoder_step``
of 2 pi / counts.
"""

from __future__ import annotations

import math
import os
import re
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

import numpy as np

from envs.column_map import STANDARD_COLUMN, ColumnMap, apply, parse_column_map
from envs.foreign_tables import read_bag, read_hdf5, read_json, read_mat, read_npy
from envs.log import COMMAND_PREFIX, PREFIX_OF, Array, Hold, InputKind, JointFacts, Log, LogError
from envs.log_tables import Reader, Table, listed, read_csv, read_npz, read_parquet
from envs.repair import repair as repaired
from envs.validation import Finding, check, columns_of

READERS: dict[str, Reader] = {
    ".csv": read_csv,
    ".csv.gz": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    ".parquet": read_parquet,
    ".npz": read_npz,
    ".npy": read_npy,
    ".mat": read_mat,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".json": read_json,
    ".mcap": read_bag,
    ".db3": read_bag,
    ".bag": read_bag,
}
WRITABLE = (".csv", ".parquet", ".npz")
JOINT_FACTS = tuple(item.name for item in fields(JointFacts))
ENCODER_COUNTS = ("encoder_counts", "encoder_counts_per_rev")
SIDECAR_ENTRIES = ("robot", "loop", "columns", "rows", "joints", *JOINT_FACTS, *ENCODER_COUNTS)
CHOICES: dict[str, tuple[str, ...]] = {
    "input": get_args(InputKind),
    "hold": get_args(Hold),
    "position_unit": ("rad", "m"),
}


def load(path: str | Path, column_map: ColumnMap | str | Path | None = None, *, repair: bool = False) -> Log:
    """A log from a file. Raises LogError, one line, when the file is unusable.

    column_map: names and units of a foreign layout, or the TOML that holds them (see `envs.column_map`). Without one,
        the ``[columns]`` of the sidecar are used, then the layout of a known rig if the file has its columns.
    repair: mend what can be mended instead of refusing the file (see `envs.repair`).
    """
    return load_with_findings(path, column_map, repair=repair)[0]


def load_with_findings(
    path: str | Path, column_map: ColumnMap | str | Path | None = None, *, repair: bool = False
) -> tuple[Log, tuple[Finding, ...]]:
    """`load`, and what was noticed and repaired on the way."""
    path = Path(path)
    table = read_table(path, repair=repair)
    facts_file, content = sidecar_of(path, column_map, table)
    columns = column_map if isinstance(column_map, ColumnMap) else parse_column_map(content, str(facts_file))
    table = wanted_rows(table, content.get("rows", {}), str(facts_file))
    log, found = assemble(table, columns, content, name=stem_of(path), facts_file=str(facts_file))
    mended: tuple[Finding, ...] = ()
    if repair:
        log, mended = repaired(log)
    in_joints = content.get("joints", {})
    in_sidecar = {
        f"q{j}" for j in log.joints if "position_unit" in content or "position_unit" in in_joints.get(str(j), {})
    }
    in_file = {name for name in (*columns.columns, *table.units) if columns.names[name] in table.units}
    names = replace(columns.names, stated=columns.names.stated | in_sidecar | in_file)
    unread = [
        Finding("entry_not_read", f"{name} of {facts_file.name} is not an entry of a sidecar; it was not read")
        for name in content
        if name not in SIDECAR_ENTRIES
    ]
    return log, (*table.findings, *unread, *found, *mended, *check(log, names))


def sidecar_of(path: Path, column_map: ColumnMap | str | Path | None, table: Table) -> tuple[Path, dict[str, Any]]:
    """The TOML that holds the facts of a log, and its content: the one given, the sidecar, or a known rig's."""
    if isinstance(column_map, str | Path):
        if not Path(column_map).exists():
            raise LogError("there is no such column map", remedy="Check the path", source=str(column_map))
        return Path(column_map), read_toml(Path(column_map))
    own = sidecar_path(path)
    if own.exists() or column_map is not None:
        return own, read_toml(own) if own.exists() else {}
    from envs.rigs import recognise

    layout = recognise(table.columns)
    return (layout, read_toml(layout)) if layout is not None else (own, {})


def read_table(path: Path, *, repair: bool = False) -> Table:
    """The columns of a file as they are. Raises LogError for a file that is missing, empty or of no known type."""
    source = str(path)
    if not path.exists():
        raise LogError("there is no such file", remedy="Check the path", source=source)
    if path.is_dir():
        if (path / "metadata.yaml").exists():
            return read_bag(path, repair)
        raise LogError(
            "this is a folder, not a log file", remedy="Give a file or the folder of a ROS 2 bag", source=source
        )
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


def read_toml(path: Path) -> dict[str, Any]:
    """A sidecar or column map as a dictionary. Raises LogError when it is not TOML or an entry seems misspelt."""
    if path.is_dir():
        raise LogError("this is a folder, not a column map", remedy="Give a TOML file", source=str(path))
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise LogError(f"this is not valid TOML ({error})", remedy="Correct it", source=str(path)) from None
    for name in sorted(set(content) - set(SIDECAR_ENTRIES)):
        if meant := get_close_matches(name, SIDECAR_ENTRIES, n=1, cutoff=0.75):
            raise LogError(f"{name} is not an entry of a sidecar", remedy=f"Write {meant[0]}", source=str(path))
    for name in ("columns", "rows", "joints"):
        if not isinstance(content.get(name, {}), dict):
            raise LogError(f"{name} is not a table", remedy=f"Write [{name}]", source=str(path))
    for joint, entry in content.get("joints", {}).items():
        if not isinstance(entry, dict):
            raise LogError(f"joints.{joint} is not a table", remedy=f"Write [joints.{joint}]", source=str(path))
    return content


def wanted_rows(table: Table, entry: Mapping[str, Any], facts_file: str) -> Table:
    """The longest stretch of rows in which the column ``rows.where`` is not zero; all rows when nothing is stated."""
    if not entry:
        return table
    if set(entry) != {"where"} or not isinstance(entry["where"], str):
        raise LogError("rows cannot be read", remedy='Write where = "COLUMN"', source=facts_file)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], table.numbers(entry["where"]) != 0.0, [False]])))
    if not len(edges):
        raise LogError(
            "no row is wanted: the column is zero throughout",
            remedy="Correct rows.where",
            source=table.source,
            column=entry["where"],
        )
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts))
    start, stop = int(starts[longest]), int(stops[longest])
    size = len(next(iter(table.columns.values())))
    if stop - start == size:
        return table
    said = Finding("rows_left_out", f"rows {start + 1} to {stop} of {size} used: {entry['where']} is zero elsewhere")
    columns = {name: values[start:stop] for name, values in table.columns.items()}
    return replace(table, columns=columns, findings=(*table.findings, said))


def assemble(
    table: Table, columns: ColumnMap, facts: Mapping[str, Any], *, name: str, facts_file: str
) -> tuple[Log, tuple[Finding, ...]]:
    """A Log from a file's columns, a column map and the facts of the sidecar, not yet validated."""
    stated = facts.get("joints", {})
    for_all = {name: facts[name] for name in (*JOINT_FACTS, *ENCODER_COUNTS) if name in facts}
    units: defaultdict[int, str] = defaultdict(lambda: for_all.get("position_unit", "rad"))
    units |= {int(j): entry["position_unit"] for j, entry in stated.items() if j.isdigit() and "position_unit" in entry}
    whole, table = table, apply(columns, table, units)
    found: dict[int, set[str]] = {}
    for column in table.columns:
        if match := STANDARD_COLUMN.fullmatch(column):
            found.setdefault(int(match[2]), set()).add(match[1])
    joints = tuple(sorted(joint for joint, prefixes in found.items() if "q" in prefixes))
    for needed, there in (("t", "t" in table.columns), ("q1", bool(joints))):
        if not there:
            whole.numbers(needed)  # says so, with the names that the file has
    check_facts(columns, stated, joints, facts_file)
    time, findings = from_epoch(table.numbers("t"))
    joint_facts = tuple(
        facts_of(joint, found[joint], (own, stated.get(str(joint), {})), whole, facts_file)
        for joint, own in zip(joints, for_each(for_all, joints, facts_file), strict=True)
    )

    def stack(names: list[str]) -> Array:
        return np.column_stack([table.numbers(column) for column in names])

    def optional(prefix: str) -> Array | None:
        names = [f"{prefix}{joint}" for joint in joints]
        there = [column for column in names if column in table.columns]
        if there and len(there) < len(names):
            findings.append(Finding("partial_signal", f"{', '.join(there)} left out: not every joint has {prefix}"))
        return stack(names) if len(there) == len(names) else None

    loop = facts.get("loop")
    if loop not in (None, "open", "closed"):
        raise LogError(f"loop = {loop!r} is unknown", remedy="Write open or closed", source=facts_file)
    log = Log(
        time=time,
        command=stack([f"{PREFIX_OF[fact.input]}{joint}" for fact, joint in zip(joint_facts, joints, strict=True)]),
        position=stack([f"q{joint}" for joint in joints]),
        velocity=optional("dq"),
        temperature=optional("temp"),
        joints=joints,
        facts=joint_facts,
        robot=from_here(facts.get("robot"), facts_file),
        loop=loop,
        name=name,
        source=table.source,
    )
    return log, tuple(findings)


def from_here(robot: Any, facts_file: str) -> Any:
    """What a sidecar names as the robot; a description that lies beside it by its path from here."""
    if isinstance(robot, str) and robot.lower().endswith(".toml"):
        beside = Path(facts_file).parent / robot
        return str(beside) if beside.is_file() else robot
    return robot


def check_facts(columns: ColumnMap, stated: Mapping[str, Any], joints: Sequence[int], facts_file: str) -> None:
    """Refuses facts and mapped columns of joints that have no position: they would be passed over in silence."""
    there = ", ".join(map(str, joints))
    for joint in stated:
        if joint not in map(str, joints):
            raise LogError(
                f"[joints.{joint}] speaks of a joint that the log does not hold (it holds {there})",
                remedy=f"Map a column to q{joint}, or remove the table" if joint.isdigit() else "Correct its number",
                source=facts_file,
            )
    for target in columns.columns:
        match = STANDARD_COLUMN.fullmatch(target)
        if match is not None and int(match[2]) not in joints:
            raise LogError(
                f"columns.{target} belongs to joint {match[2]}, which has no position",
                remedy=f"Map a column to q{match[2]}, too, or remove {target}",
                source=columns.source or facts_file,
            )


def from_epoch(time: Array) -> tuple[Array, list[Finding]]:
    """Time [s] counted from its first sample where it is a date (seconds since 1970), unchanged otherwise."""
    if len(time) and np.isfinite(time[0]) and time[0] > 1e8 and np.ptp(time) < 0.1 * time[0]:
        return time - time[0], [Finding("epoch", "time is a date; it is counted from the first sample")]
    return time, []


def for_each(entries: Mapping[str, Any], joints: Sequence[int], facts_file: str) -> list[dict[str, Any]]:
    """Facts stated above all tables, joint by joint: one value holds for all of them, a list has one for each."""
    for name, value in entries.items():
        if isinstance(value, list) and len(value) != len(joints):
            raise LogError(
                f"{name} has {len(value)} values, and the log {len(joints)} joints ({', '.join(map(str, joints))})",
                remedy="Give one value, or one per joint in their order",
                source=facts_file,
            )
    return [
        {name: value[i] if isinstance(value, list) else value for name, value in entries.items()}
        for i in range(len(joints))
    ]


def facts_of(
    joint: int, prefixes: set[str], entries: Sequence[Mapping[str, Any]], table: Table, facts_file: str
) -> JointFacts:
    """Facts of one joint: what its command column says, then what is stated for all joints, then ``[joints.J]``."""
    commands = sorted(prefixes & set(COMMAND_PREFIX))
    stated: dict[str, Any] = {}
    for entry in entries:
        if unknown := sorted(set(entry) - {*JOINT_FACTS, *ENCODER_COUNTS}):
            raise LogError(
                f"[joints.{joint}] has the unknown entry {unknown[0]}",
                remedy=f"Use {', '.join(JOINT_FACTS)}",
                source=facts_file,
            )
        steps = {"encoder_step", *ENCODER_COUNTS}
        if steps & set(entry):
            stated = {name: value for name, value in stated.items() if name not in steps}
        stated |= entry
    stated = with_step(stated, facts_file)
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
        if isinstance(stated.get(key), str):
            stated[key] = "_".join(re.split(r"[\s_-]+", stated[key].strip().lower()))
        if key in stated and stated[key] not in allowed:
            raise LogError(
                f"{key} = {stated[key]!r} of [joints.{joint}] is unknown",
                remedy=f"Write {' or '.join(allowed)}",
                source=facts_file,
            )
    for key in ("encoder_step", "command_step", "command_limit"):
        value = stated.get(key)
        if value is not None and not (isinstance(value, int | float) and 0 < value < np.inf):
            raise LogError(
                f"{key} = {value!r} of [joints.{joint}] is not a positive number",
                remedy="Correct it or leave it out",
                source=facts_file,
            )
    return JointFacts(**stated)


def with_step(entry: Mapping[str, Any], facts_file: str) -> dict[str, Any]:
    """Stated facts, counts of an encoder in them turned into its step, 2 pi / counts [rad]."""
    stated = {name: value for name, value in entry.items() if name not in ENCODER_COUNTS}
    for name in ENCODER_COUNTS:
        counts = entry.get(name)
        if counts is None:
            continue
        if not (isinstance(counts, int | float) and 0 < counts < np.inf):
            raise LogError(f"{name} = {counts!r} is not a positive number", remedy="Correct it", source=facts_file)
        if "encoder_step" in stated:
            raise LogError(f"{name} and encoder_step say the same", remedy="Keep one of them", source=facts_file)
        if stated.get("position_unit") == "m":
            raise LogError(f"{name} says nothing of a position in m", remedy="State encoder_step", source=facts_file)
        stated["encoder_step"] = 2.0 * math.pi / counts
    return stated


def check_writable(path: Path) -> str:
    """The suffix of a file that is to be written. Raises LogError when logs have no such format."""
    suffix = suffix_of(path)
    if suffix not in WRITABLE:
        raise LogError(f"cannot write {suffix or 'no suffix'}", remedy=f"Use {', '.join(WRITABLE)}", source=str(path))
    return suffix


def save(log: Log, path: str | Path) -> Path:
    """Writes a log and its sidecar, whole or not at all. Raises LogError for a suffix that cannot be written."""
    import tomli_w

    path = Path(path)
    suffix = check_writable(path)
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
