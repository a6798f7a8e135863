"""Tables from the files of other programs: MATLAB (v5, v7.3), HDF5, JSON, numpy arrays, ROS bags and MCAP."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.log import LogError
from envs.log_tables import Table, damaged, flatten, head_of, listed, of_one_length
from envs.validation import Finding

JOINT_STATE = "sensor_msgs/msg/JointState"
#: Message types whose numbers can be a command, with the attribute that holds them.
COMMAND_MESSAGES = {"std_msgs/msg/Float64": "data", "std_msgs/msg/Float64MultiArray": "data"}


def read_mat(path: Path, repair: bool) -> Table:
    """A MATLAB file of any version; fields of structures become columns NAME.FIELD."""
    head = head_of(path)
    if head.startswith(b"\x89HDF") or head[512:520] == b"\x89HDF\r\n\x1a\n":
        return read_hdf5(path, repair)
    from scipy.io import loadmat

    try:
        content = loadmat(path)
    except Exception as error:  # scipy raises whatever a cut file makes it stumble over
        raise damaged(str(path), "MATLAB", head, error) from None
    columns: dict[str, NDArray[Any]] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            columns.update(matlab_columns(name, value))
    return of_one_length(columns, str(path))


def matlab_columns(name: str, value: Any) -> dict[str, NDArray[Any]]:
    """Numeric columns of a MATLAB variable, structures opened."""
    if not isinstance(value, np.ndarray):
        return {}
    if value.dtype.names and value.size == 1:
        record = value.reshape(-1)[0]
        found: dict[str, NDArray[Any]] = {}
        for field in value.dtype.names:
            found.update(matlab_columns(f"{name}.{field}", record[field]))
        return found
    return flatten(name, value) if value.dtype.kind in "fiub" else {}


def read_hdf5(path: Path, repair: bool) -> Table:
    """An HDF5 file (MATLAB v7.3 is one); datasets in groups become columns GROUP.NAME."""
    import h5py

    columns: dict[str, NDArray[Any]] = {}

    def collect(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub" and not name.startswith("#"):
            columns.update(flatten(name.replace("/", "."), np.asarray(item)))

    try:
        with h5py.File(path, "r") as file:
            file.visititems(collect)
    except (OSError, RuntimeError, KeyError) as error:
        raise damaged(str(path), "HDF5 (MATLAB v7.3)", head_of(path), error) from None
    return of_one_length(columns, str(path))


def read_json(path: Path, repair: bool) -> Table:
    """JSON: a list of records, an object of lists, or an object with one of these in it (``entries``, ``data`` …)."""
    source = str(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        where = f" at line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise LogError(
            f"this is not valid JSON{where}: the file is damaged or cut",
            remedy="Copy or record it again",
            source=source,
        ) from None
    records = json_records(content)
    if records is None:
        raise LogError(
            "no list of records and no lists of numbers in it",
            remedy='Write [{"t": 0.0, "v1": …}, …] or {"t": […], "v1": […]}',
            source=source,
        )
    return of_one_length(
        {name: array for name, values in records.items() if (array := as_array(values)) is not None}, source
    )


def json_records(content: Any) -> dict[str, list[Any]] | None:
    """The first table found in a JSON value, as lists by name; None when there is none."""
    if isinstance(content, list) and content and all(isinstance(entry, Mapping) for entry in content):
        names = list(dict.fromkeys(name for entry in content for name in entry))
        return {name: [entry.get(name) for entry in content] for name in names}
    if not isinstance(content, Mapping):
        return None
    lists = {name: value for name, value in content.items() if isinstance(value, list) and value}
    if len([value for value in lists.values() if not isinstance(value[0], Mapping)]) >= 2:
        return lists
    return next((found for value in content.values() if (found := json_records(value)) is not None), None)


def as_array(values: list[Any]) -> NDArray[Any] | None:
    """Numbers as float64 (null as NaN), other values as text; None for nested lists."""
    if any(isinstance(value, list | Mapping) for value in values):
        return None
    if all(value is None or isinstance(value, int | float) for value in values):
        return np.array([np.nan if value is None else float(value) for value in values])
    return np.array(["" if value is None else str(value) for value in values])


def read_npy(path: Path, repair: bool) -> Table:
    """One numpy array (T, n) or (n, T): columns column1 … columnN, for a column map."""
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise damaged(str(path), "NPY", head_of(path), error) from None
    return of_one_length(flatten("column", array), str(path))


def read_bag(path: Path, repair: bool) -> Table:
    """A ROS 2 bag (folder, .mcap or .db3) or ROS 1 bag with sensor_msgs/JointState.

    The topic with positions gives ``t`` (header stamps, from zero) and ``JOINT.position``, ``JOINT.velocity``,
    ``JOINT.effort``; and, joints numbered in the order of the message, ``q{j}``, ``dq{j}`` and the effort as
    ``tau{j}``. Other JointState, Float64 and Float64MultiArray topics are held at these times as ``TOPIC/…``.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    source = str(path)
    topics: dict[str, tuple[list[float], list[dict[str, float]]]] = {}
    joint_topics: list[str] = []
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
            wanted = [item for item in bag.connections if item.msgtype in (JOINT_STATE, *COMMAND_MESSAGES)]
            joint_topics = list(dict.fromkeys(item.topic for item in wanted if item.msgtype == JOINT_STATE))
            for connection, stamp, raw in bag.messages(connections=wanted) if wanted else ():
                message = bag.deserialize(raw, connection.msgtype)
                times, values = topics.setdefault(connection.topic, ([], []))
                times.append(message_time(message, stamp))
                values.append(dict(message_values(message, connection.msgtype)))
    except Exception as error:  # a cut bag fails inside SQLite, zstd, YAML or the CDR parser
        head = head_of(path) if path.is_file() else b""
        raise damaged(source, "ROS bag or MCAP", head, error) from None
    states = [
        topic
        for topic in joint_topics
        if any(name.endswith(".position") for name in topics.get(topic, ([], [{}]))[1][0])
    ]
    if not states:
        raise LogError(
            f"no {JOINT_STATE} with positions in it ({listed(topics)})",
            remedy="Record the topic /joint_states",
            source=source,
        )
    base = max(states, key=lambda topic: ("command" not in topic, len(topics[topic][0])))
    return bag_table(base, topics, source)


def message_time(message: Any, stamp: int) -> float:
    """Time of a message [s]: its header's stamp, or when it was received where the header has none."""
    header = getattr(message, "header", None)
    if header is None or not (header.stamp.sec or header.stamp.nanosec):
        return stamp * 1e-9
    return float(header.stamp.sec) + header.stamp.nanosec * 1e-9


def message_values(message: Any, kind: str) -> Iterator[tuple[str, float]]:
    """Named numbers of a message."""
    if kind != JOINT_STATE:
        data = np.atleast_1d(np.asarray(getattr(message, COMMAND_MESSAGES[kind]), dtype=np.float64))
        yield from ((f"data{number}", float(value)) for number, value in enumerate(data, start=1))
        return
    for quantity in ("position", "velocity", "effort"):
        values = getattr(message, quantity)
        if len(values) == len(message.name):
            yield from ((f"{name}.{quantity}", float(value)) for name, value in zip(message.name, values, strict=True))


def bag_table(base: str, topics: Mapping[str, tuple[list[float], list[dict[str, float]]]], source: str) -> Table:
    """One table at the times of the base topic; values of other topics are those last received."""
    times, _ = topics[base]
    time = np.array(times)
    columns: dict[str, NDArray[Any]] = {"t": time - time[0]}
    for topic, (stamps, entries) in topics.items():
        names = list(dict.fromkeys(name for entry in entries for name in entry))
        rows = np.searchsorted(np.array(stamps), time, side="right") - 1
        for name in names:
            series = np.array([entry.get(name, np.nan) for entry in entries])
            if topic == base:
                columns[name] = series
            else:
                columns[f"{topic}/{name}"] = np.where(rows >= 0, series[np.clip(rows, 0, None)], np.nan)
    joints = [name.removesuffix(".position") for name in columns if name.endswith(".position") and "/" not in name]
    for number, joint in enumerate(joints, start=1):
        for prefix, quantity in (("q", "position"), ("dq", "velocity"), ("tau", "effort")):
            if f"{joint}.{quantity}" in columns:
                columns[f"{prefix}{number}"] = columns[f"{joint}.{quantity}"]
    said = ", ".join(f"{number} {joint}" for number, joint in enumerate(joints, start=1))
    return Table(columns, source, (Finding("joint_order", f"joints of {base}: {said}"),))
