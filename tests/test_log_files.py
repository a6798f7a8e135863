"""Logs survive the way into a file and back; files of other programs come in."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.io import savemat

from envs import log_files
from envs.log import JointFacts, Log, LogError
from envs.log_files import WRITABLE, load, load_with_findings, save

SAMPLES = 40
signal = arrays(np.float64, SAMPLES, elements=st.floats(-1.0, 1.0, allow_nan=False)).filter(lambda x: np.ptp(x) > 0)
step = st.none() | st.floats(1e-9, 1e3)


@st.composite
def facts(draw: st.DrawFn) -> JointFacts:
    return JointFacts(
        input=draw(st.sampled_from(["voltage", "current", "torque"])),
        position_unit=draw(st.sampled_from(["rad", "m"])),
        encoder_step=draw(step),
        command_step=draw(step),
        command_limit=draw(st.none() | st.floats(1.0, 1e6)),
        hold=draw(st.sampled_from(["zero_order", "first_order"])),
    )


@st.composite
def logs(draw: st.DrawFn) -> Log:
    joints = tuple(sorted(draw(st.sets(st.integers(1, 7), min_size=1, max_size=3))))
    intervals = draw(arrays(np.float64, SAMPLES, elements=st.floats(0.9e-3, 1.1e-3)))

    def signals() -> np.ndarray:
        return np.column_stack([draw(signal) for _ in joints])

    return Log(
        time=np.cumsum(intervals),
        command=signals(),
        position=signals(),
        velocity=draw(st.none() | st.just(True)) and signals(),
        temperature=draw(st.none() | st.just(True)) and signals(),
        joints=joints,
        facts=tuple(draw(facts()) for _ in joints),
        robot=draw(st.none() | st.text(min_size=1, max_size=12)),
        loop=draw(st.sampled_from([None, "open", "closed"])),
        name="recording",
    )


def swing(samples: int = 200, interval: float = 1e-3) -> dict[str, np.ndarray]:
    """A plausible motion of one joint in standard columns."""
    t = interval * np.arange(samples)
    return {"t": t, "v1": 2.0 * np.sin(20.0 * t), "q1": 0.3 * (1.0 - np.cos(20.0 * t))}


def write_csv(path: Path, columns: dict[str, np.ndarray], delimiter: str = ",") -> Path:
    rows = zip(*columns.values(), strict=True)
    lines = [delimiter.join(columns)] + [delimiter.join(repr(float(value)) for value in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("suffix", WRITABLE)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(log=logs())
def test_round_trip_keeps_every_bit(log: Log, suffix: str, tmp_path: Path) -> None:
    path = save(log, tmp_path / f"recording{suffix}")
    again = load(path)
    assert again.content_hash == log.content_hash
    assert (again.name, again.robot, again.loop, again.facts) == (log.name, log.robot, log.loop, log.facts)


def test_bare_file_is_enough(tmp_path: Path) -> None:
    columns = swing()
    log = load(write_csv(tmp_path / "bare.csv", columns))
    assert log.joints == (1,)
    assert log.facts == (JointFacts(),)
    np.testing.assert_array_equal(log.position[:, 0], columns["q1"])


def test_command_column_says_the_kind_of_input(tmp_path: Path) -> None:
    columns = swing()
    log = load(write_csv(tmp_path / "torque.csv", {"t": columns["t"], "tau2": columns["v1"], "q2": columns["q1"]}))
    assert log.joints == (2,)
    assert log.facts[0].input == "torque"


def test_failed_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = load(write_csv(tmp_path / "bare.csv", swing()))

    def fail(self: Path, target: Path) -> Path:
        raise OSError("disk full")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        save(log, tmp_path / "new" / "copy.csv")
    assert list((tmp_path / "new").iterdir()) == []


def test_no_other_suffix_is_written(tmp_path: Path) -> None:
    log = load(write_csv(tmp_path / "bare.csv", swing()))
    with pytest.raises(LogError, match=r"cannot write \.xlsx"):
        save(log, tmp_path / "copy.xlsx")


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_text_tables(delimiter: str, tmp_path: Path) -> None:
    columns = swing()
    log = load(write_csv(tmp_path / "table.txt", columns, delimiter))
    np.testing.assert_array_equal(log.command[:, 0], columns["v1"])


@pytest.mark.parametrize("delimiter", [";", "\t", " "])
def test_decimal_comma(delimiter: str, tmp_path: Path) -> None:
    path = write_csv(tmp_path / "german.csv", swing(), delimiter)
    path.write_text(path.read_text().replace(".", ","))
    np.testing.assert_array_equal(load(path).position[:, 0], swing()["q1"])


def test_decimal_comma_below_whole_numbers(tmp_path: Path) -> None:
    lines = write_csv(tmp_path / "german.csv", swing(), "\t").read_text().replace(".", ",").splitlines()
    (tmp_path / "german.csv").write_text("\n".join([lines[0], "0\t0\t0", *lines[2:]]) + "\n")
    np.testing.assert_array_equal(load(tmp_path / "german.csv").position[:, 0], swing()["q1"])


def test_text_that_is_not_utf8(tmp_path: Path) -> None:
    columns = swing()
    path = write_csv(tmp_path / "labor.csv", {"t": columns["t"], "v1": columns["v1"], "Winkel [°]": columns["q1"]}, ";")
    path.write_bytes(path.read_text().encode("cp1252"))
    (tmp_path / "labor.toml").write_text('[columns]\nq1 = { column = "Winkel [°]", unit = "°" }\n', encoding="utf-8")
    log, findings = load_with_findings(path)
    np.testing.assert_allclose(log.position[:, 0], np.deg2rad(columns["q1"]), rtol=1e-12)
    assert [finding.kind for finding in findings] == ["encoding"]


@pytest.mark.parametrize(
    "above",
    [
        "# my rig, 2025\n# unit: V\n\nt,v1,q1\n",
        "% my rig, 2025\nt,v1,q1\n",
        "# my rig, 2025\n# t,v1,q1\n",
        "%t,v1,q1\n",
        "# rig 7\n#t,v1,q1\n#s,V,rad\n",
        "# rig 7\n# t,v1,q1\ns,V,rad\n",
        "t,v1,q1\ns,V,rad\n",
        "# rig 7\r\nt,v1,q1\r\n[s],[V],[rad]\r\n",
        "t,v1,q1\ns,,-\n",
    ],
)
def test_comments_and_units_around_the_header(above: str, tmp_path: Path) -> None:
    columns = swing()
    path = write_csv(tmp_path / "log.csv", columns)
    path.write_text(above + path.read_text().partition("\n")[2])
    log = load(path)
    np.testing.assert_array_equal(log.time, columns["t"])
    np.testing.assert_array_equal(log.position[:, 0], columns["q1"])


def test_a_row_of_units_states_the_units(tmp_path: Path) -> None:
    columns = swing()
    raw = {"t": 1e3 * columns["t"], "volts": 1e3 * columns["v1"], "q1": 100.0 * columns["q1"], "state": columns["t"]}
    path = write_csv(tmp_path / "log.csv", raw)
    head, rest = path.read_text().split("\n", 1)
    path.write_text(f"{head}\nms,mV,deg,mode\n{rest}")
    (tmp_path / "log.toml").write_text('[columns]\nv1 = "volts"\n')
    log, findings = load_with_findings(path)
    np.testing.assert_allclose(log.time, columns["t"], atol=1e-15)
    np.testing.assert_allclose(log.command[:, 0], columns["v1"], atol=1e-15)
    np.testing.assert_allclose(log.position[:, 0], np.deg2rad(100.0 * columns["q1"]), atol=1e-12)
    assert [finding.kind for finding in findings] == ["units_row"]
    (tmp_path / "log.toml").write_text('[columns]\nv1 = { column = "volts", unit = "V" }\n')
    np.testing.assert_allclose(load(path).command[:, 0], 1e3 * columns["v1"], rtol=1e-12)


def test_gzip(tmp_path: Path) -> None:
    plain = write_csv(tmp_path / "plain.csv", swing())
    packed = tmp_path / "packed.csv.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    assert load(packed).content_hash == load(plain).content_hash
    assert load(packed).name == "packed"


def test_matlab_and_hdf5(tmp_path: Path) -> None:
    columns = swing()
    stacked = {"t": columns["t"][:, None], "data": {"v": columns["v1"][:, None], "q": np.rad2deg(columns["q1"])}}
    savemat(tmp_path / "v5.mat", stacked)
    with h5py.File(tmp_path / "v73.mat", "w") as file:
        file["t"] = columns["t"][None, :]
        file["data/v"] = columns["v1"][None, :]
        file["data/q"] = np.rad2deg(columns["q1"])[None, :]
    layout = tmp_path / "map.toml"
    layout.write_text('[columns]\nv1 = "data.v"\nq1 = { column = "data.q", unit = "deg" }\n')
    for name in ("v5.mat", "v73.mat"):
        log = load(tmp_path / name, layout)
        np.testing.assert_allclose(log.position[:, 0], columns["q1"], atol=1e-15)
        np.testing.assert_array_equal(log.command[:, 0], columns["v1"])


@pytest.mark.parametrize("records", [True, False])
def test_json(records: bool, tmp_path: Path) -> None:
    columns = {name: values.tolist() for name, values in swing().items()}
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    (tmp_path / "log.json").write_text(json.dumps({"mass": 1.0, "entries": rows} if records else columns))
    assert load(tmp_path / "log.json").command[:, 0].tolist() == columns["v1"]


def test_numpy_arrays_of_many_joints(tmp_path: Path) -> None:
    columns = swing()
    two = np.column_stack([columns["q1"], -columns["q1"]])
    np.savez(tmp_path / "arm.npz", t=columns["t"], q=two, v=2.0 * two)
    log = load(tmp_path / "arm.npz")
    assert log.joints == (1, 2)
    np.testing.assert_array_equal(log.position, two)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_ros_bag(storage: str, tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    state, header, stamp_type = (
        types.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    columns = swing(50)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    start = 1_700_000_000
    with Writer(tmp_path / "bag", version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/joint_states", state.__msgtype__, typestore=types)
        for t, v, q in zip(*columns.values(), strict=True):
            nanoseconds = round(t * 1e9)
            message = state(
                header=header(stamp=stamp_type(sec=start, nanosec=nanoseconds), frame_id=""),
                name=["shoulder", "elbow"],
                position=np.array([q, -q]),
                velocity=np.array([]),
                effort=np.array([v, -v]),
            )
            stamp = start * 10**9 + nanoseconds
            writer.write(connection, stamp, types.serialize_cdr(message, state.__msgtype__))
    bag = tmp_path / "bag"
    for path in (bag, next(bag.glob("*.mcap" if storage == "mcap" else "*.db3"))):
        log, findings = load_with_findings(path)
        assert log.joints == (1, 2)
        assert log.facts[0].input == "torque"
        np.testing.assert_allclose(log.time, columns["t"], atol=1e-6)
        np.testing.assert_array_equal(log.position[:, 1], -columns["q1"])
        assert any("1 shoulder, 2 elbow" in finding.text for finding in findings)


def test_column_map_with_units(tmp_path: Path) -> None:
    """Counts, milliamperes, a shifted zero and an unsigned register times a measured supply."""
    t = 2e-3 * np.arange(100)
    register = np.round(300.0 * np.sin(25.0 * t))
    raw = {
        "ms": 1e3 * t + 5.0,
        "enc": np.round(400.0 * np.sin(15.0 * t)) + 2048.0,
        "pwm": np.where(register < 0, register + 65536.0, register),
        "supply": np.full(100, 7400.0),
        "elbow": np.sin(9.0 * t),
        "mA": 500.0 * np.cos(9.0 * t),
    }
    path = write_csv(tmp_path / "servo.csv", raw)
    (tmp_path / "servo.toml").write_text("""
        loop = "closed"
        [columns]
        t = { column = "ms", unit = "ms" }
        q1 = { column = "enc", unit = "turn / 4096", offset = -2048, scale = -1 }
        v1 = { column = "pwm", unit = "share / 885", signed_bits = 16, times = "supply", times_unit = "mV" }
        q2 = "elbow"
        i2 = { column = "mA", unit = "mA" }
        [joints.1]
        encoder_step = 0.0015
    """)
    log = load(path)
    np.testing.assert_allclose(log.time, t + 0.005, atol=1e-12)
    np.testing.assert_allclose(log.position[:, 0], -(raw["enc"] - 2048.0) * 2 * np.pi / 4096, atol=1e-12)
    np.testing.assert_allclose(log.command[:, 0], register / 885 * 7.4, atol=1e-12)
    np.testing.assert_allclose(log.command[:, 1], raw["mA"] / 1e3, atol=1e-15)
    assert [facts.input for facts in log.facts] == ["voltage", "current"]
    assert (log.loop, log.facts[0].encoder_step) == ("closed", 0.0015)


@pytest.mark.parametrize(
    ("entry", "complaint"),
    [
        ('q1 = { column = "q1", unit = "count" }', "write turn / COUNTS_PER_TURN"),
        ('q1 = { column = "q1", unit = "percent" }', "cannot be converted to rad"),
        ('q1 = { column = "q1", unit = "banana" }', "'banana' is unknown"),
        ('q1 = { column = "q1", unit = "9 ** 9 ** 9" }', "is not understood"),
        ('v1 = { column = "v1", unit = "A" }', "cannot be converted to V"),
        ('v1 = { column = "volts" }', "there is no such column"),
        ('angle1 = { column = "q1" }', "columns.angle1 is not a column of a log"),
        ('q1 = { column = "q1", units = "deg" }', "columns.q1 cannot be read"),
        ('q1 = { column = "q1", scale = 0 }', "no usable number"),
    ],
)
def test_wrong_column_maps(entry: str, complaint: str, tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", swing())
    (tmp_path / "map.toml").write_text(f"[columns]\n{entry}\n")
    with pytest.raises(LogError) as caught:
        load(path, tmp_path / "map.toml")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_description_that_lies_beside_the_sidecar_is_found_from_anywhere(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", swing())
    for named, there in (("arm.toml", False), ("arm.toml", True), ("adeptone", True)):
        if there:
            (tmp_path / "arm.toml").write_text("")
        path.with_suffix(".toml").write_text(f'robot = "{named}"\n')
        expected = str(tmp_path / named) if there and named.endswith(".toml") else named
        assert load(path).robot == expected


@pytest.mark.parametrize(
    ("sidecar", "complaint"),
    [
        ("robot = ", "not valid TOML"),
        ('robots = "x"', "robots is not an entry of a sidecar. Write robot"),
        ("encoder_steps = 0.1", "Write encoder_step"),
        ("encoder_counts = 0", "not a positive number"),
        ("encoder_counts = 4096\nencoder_step = 0.1", "say the same"),
        ('position_unit = "m"\nencoder_counts = 4096', "says nothing of a position in m"),
        ("encoder_step = -1", "not a positive number"),
        ('loop = "ajar"', "loop = 'ajar' is unknown"),
        ("joints = 3", "joints is not a table"),
        ("[joints]\n1 = 3", "joints.1 is not a table"),
        ("encoder_step = [0.1, 0.2]", "encoder_step has 2 values, and the log 1 joints (1)"),
        ('encoder_step = ["fine"]', "encoder_step = 'fine' of [joints.1] is not a positive number"),
        ('position_unit = ["m", "m"]', "position_unit"),
        ("[joints.1]\nspeed = 3", "unknown entry speed"),
        ('[joints.1]\ninput = "pressure"', "input = 'pressure'"),
        ("[joints.1]\nencoder_step = -1", "not a positive number"),
        ("[joints.2]\nencoder_step = 0.1", "[joints.2] speaks of a joint that the log does not hold (it holds 1)"),
        ("[joints.elbow]\nencoder_step = 0.1", "Correct its number"),
        ('[columns]\ni2 = { column = "v1", unit = "A" }', "columns.i2 belongs to joint 2, which has no position"),
        ('[rows]\nwhere = "on"', "there is no such column"),
    ],
)
def test_wrong_sidecars(sidecar: str, complaint: str, tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", swing())
    (tmp_path / "log.toml").write_text(sidecar)
    with pytest.raises(LogError) as caught:
        load(path)
    assert complaint in str(caught.value)


def test_facts_for_all_joints_stand_above_those_of_one(tmp_path: Path) -> None:
    motion = swing()
    two = {**motion, "v2": motion["v1"], "q2": motion["q1"]}
    path = write_csv(tmp_path / "log.csv", two)
    (tmp_path / "log.toml").write_text(
        'rig = "bench 3"\nencoder_counts_per_rev = 4096\nhold = "First-Order"\n[joints.2]\nencoder_step = 0.01\n'
    )
    log, found = load_with_findings(path)
    assert [fact.encoder_step for fact in log.facts] == [2.0 * np.pi / 4096, 0.01]
    assert [fact.hold for fact in log.facts] == ["first_order", "first_order"]
    assert [item.text for item in found if item.kind == "entry_not_read"] == [
        "rig of log.toml is not an entry of a sidecar; it was not read"
    ]


def test_facts_of_all_joints_may_be_a_list(tmp_path: Path) -> None:
    motion = swing()
    path = write_csv(tmp_path / "log.csv", {**motion, "v3": motion["v1"], "q3": motion["q1"]})
    (tmp_path / "log.toml").write_text('encoder_step = [0.01, 0.02]\nhold = "zero-order"\n')
    assert [fact.encoder_step for fact in load(path).facts] == [0.01, 0.02]


def test_a_folder_is_no_column_map(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="this is a folder, not a column map"):
        load(write_csv(tmp_path / "log.csv", swing()), tmp_path)


def test_rows_where_a_drive_was_on(tmp_path: Path) -> None:
    columns = swing()
    enabled = np.ones(200)
    enabled[:20] = enabled[150:] = 0.0
    path = write_csv(tmp_path / "log.csv", {**columns, "on": enabled})
    (tmp_path / "log.toml").write_text('[rows]\nwhere = "on"\n')
    log, findings = load_with_findings(path)
    np.testing.assert_array_equal(log.time, columns["t"][20:150])
    assert [finding.kind for finding in findings] == ["rows_left_out"]


def test_dates_are_counted_from_the_start(tmp_path: Path) -> None:
    columns = swing()
    path = write_csv(tmp_path / "log.csv", {**columns, "t": 1.7e9 + columns["t"]})
    log, findings = load_with_findings(path)
    np.testing.assert_allclose(log.time, columns["t"], atol=1e-6)
    assert "epoch" in [finding.kind for finding in findings]


def test_every_reader_has_a_suffix_of_its_own() -> None:
    assert set(WRITABLE) <= set(log_files.READERS)
