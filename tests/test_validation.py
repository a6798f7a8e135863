"""Every kind of bad recording gets one line with place and remedy; what is worth knowing is kept as a finding."""

from __future__ import annotations

import gzip
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envs.column_proposal import propose
from envs.inspection import inspect, inspect_file
from envs.log import JointFacts, Log, LogError
from envs.log_files import load, load_with_findings, read_table, save
from envs.log_statistics import jumps, quantisation_step, saturation, spikes, stale, timing
from envs.repair import repair, resample
from envs.validation import DOUBTFUL_UNIT, check

Columns = dict[str, np.ndarray]


def swing(samples: int = 400, interval: float = 1e-3) -> Columns:
    """A plausible motion of one joint, with its velocity."""
    t = interval * np.arange(samples)
    return {
        "t": t,
        "v1": 2.0 * np.sin(20.0 * t),
        "q1": 0.3 * (1.0 - np.cos(20.0 * t)),
        "dq1": 6.0 * np.sin(20.0 * t),
    }


def write(path: Path, columns: Columns) -> Path:
    rows = zip(*columns.values(), strict=True)
    text = [",".join(columns)] + [",".join(repr(float(value)) for value in row) for row in rows]
    path.write_text("\n".join(text) + "\n")
    return path


def log_of(columns: Columns, **changes: object) -> Log:
    """The columns as a log that was not validated."""
    log = Log(
        columns["t"], columns["v1"][:, None], columns["q1"][:, None], velocity=columns["dq1"][:, None], source="log.csv"
    )
    return replace(log, **changes)  # type: ignore[arg-type]


def put(name: str, row: int, value: float) -> Callable[[Columns], None]:
    def change(columns: Columns) -> None:
        columns[name][row] = value

    return change


def drop(*names: str) -> Callable[[Columns], None]:
    def change(columns: Columns) -> None:
        for name in names:
            del columns[name]

    return change


def scale(name: str, factor: float) -> Callable[[Columns], None]:
    def change(columns: Columns) -> None:
        columns[name] *= factor

    return change


def keep(rows: slice) -> Callable[[Columns], None]:
    def change(columns: Columns) -> None:
        for name in columns:
            columns[name] = columns[name][rows]

    return change


def irregular(columns: Columns) -> None:
    columns["t"][:] = np.cumsum(np.random.default_rng(1).exponential(1e-3, len(columns["t"])))


def rename(columns: Columns) -> None:
    for old, new in {"t": "time", "q1": "angle_1", "v1": "volts_1"}.items():
        columns[new] = columns.pop(old)
    del columns["dq1"]


def silent(columns: Columns) -> None:
    columns["t"][300:] += 1.0


def wrap(columns: Columns) -> None:
    columns["q1"] = np.mod(10.0 * columns["q1"] - math.pi, 2.0 * math.pi) - math.pi
    del columns["dq1"]


def counts(columns: Columns) -> None:
    columns["q1"] = np.round(8192 / (2 * math.pi) * columns["q1"])
    del columns["dq1"]


def degrees(columns: Columns) -> None:
    columns["q1"] = 360.0 / 8192 * np.round(8192 / (2 * math.pi) * columns["q1"])
    del columns["dq1"]


def small_motion_in_degrees(columns: Columns) -> None:
    columns["dq1"] /= 10.0
    columns["q1"] *= 18.0 / math.pi


BAD: dict[str, tuple[Callable[[Columns], None], str, str | None, int | None]] = {
    "no time": (drop("t"), "there is no such column; the file has v1, q1, dq1", "t", None),
    "other names": (rename, "there is no such column; the file has time, angle_1, volts_1", "t", None),
    "no position": (drop("q1", "dq1"), "there is no such column", "q1", None),
    "no command": (drop("v1"), "joint 1 has a position but no command", "v1", None),
    "nan": (put("q1", 6, math.nan), "1 of 400 values are missing or not finite", "q1", 7),
    "infinite": (put("v1", 0, math.inf), "missing or not finite", "v1", 1),
    "time runs backwards": (put("t", 9, 0.002), "time runs backwards from 0.008 to 0.002", "t", 10),
    "time repeats": (put("t", 9, 0.008), "the time stamp of the row before is repeated", "t", 10),
    "irregular time": (irregular, "time is irregular", "t", None),
    "long silence": (silent, "nothing was recorded for", "t", 301),
    "milliseconds": (scale("t", 1e3), "looks like ms", "t", 1),
    "microseconds": (scale("t", 1e6), "looks like us", "t", 1),
    "hours": (scale("t", 1 / 3.6e6), "is implausible", "t", 1),
    "degrees": (degrees, "looks like degrees", "q1", None),
    "counts": (counts, "looks like encoder counts", "q1", None),
    "velocity in degrees": (scale("dq1", 180 / math.pi), "the velocity looks like deg/s", "dq1", None),
    "small motion in degrees": (small_motion_in_degrees, "the position looks like deg", "dq1", None),
    "velocity in rpm": (scale("dq1", 30 / math.pi), "the velocity looks like rpm", "dq1", None),
    "full turns": (wrap, "the angle jumps by a full turn", "q1", None),
    "position stands still": (lambda c: c["q1"].fill(0.1), "the signal is constant (0.1): nothing moves", "q1", None),
    "command stands still": (lambda c: c["v1"].fill(0.0), "nothing is commanded", "v1", None),
    "too few samples": (keep(slice(0, 15)), "the recording has 15 samples, at least 16", None, None),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_recordings(name: str, tmp_path: Path) -> None:
    change, complaint, column, row = BAD[name]
    columns = swing()
    change(columns)
    path = write(tmp_path / "log.csv", columns)
    with pytest.raises(LogError) as caught:
        load(path)
    assert complaint in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.remedy
    if column is not None:
        assert caught.value.column == column
    if row is not None:
        assert caught.value.row == row


@pytest.mark.parametrize("counts", [4096, 2**16])
@pytest.mark.parametrize(("turn", "sound"), [(2.0 * math.pi, True), (360.0, False)])
def test_counts_per_turn_tell_radians_from_degrees(turn: float, sound: bool, counts: int, tmp_path: Path) -> None:
    columns = swing()
    del columns["dq1"]
    columns["q1"] = turn / counts * np.round(columns["q1"] * 40.0 / np.ptp(columns["q1"]) / (turn / counts))
    path = write(tmp_path / "log.csv", columns)
    if sound:
        assert np.ptp(load(path).position) == pytest.approx(40.0, abs=0.1)
    else:
        with pytest.raises(LogError, match="looks like degrees"):
            load(path)


def test_where_counts_do_not_tell_the_unit_is_doubtful(tmp_path: Path) -> None:
    columns = swing()
    del columns["dq1"]
    columns["q1"] *= 57.3
    _, (finding,) = load_with_findings(write(tmp_path / "log.csv", columns))
    assert (finding.kind, finding.joint) == (DOUBTFUL_UNIT, 1)
    assert "if these are degrees, state" in finding.text


def test_a_response_to_a_step_may_be_cut_where_it_begins(tmp_path: Path) -> None:
    columns = swing()
    columns["v1"].fill(2.0)
    log, findings = load_with_findings(write(tmp_path / "log.csv", columns))
    assert np.all(log.command == 2.0)
    assert [finding.text for finding in findings] == ["v1 is constant (2 V)"]


def test_a_sound_recording_has_no_findings(tmp_path: Path) -> None:
    assert load_with_findings(write(tmp_path / "log.csv", swing()))[1] == ()


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("log.csv", b"", "the file is empty"),
        ("log.csv", b"\n\n", "the file is empty"),
        ("log.csv", b"t,v1,q1\n", "there is a header but no row"),
        ("log.csv", b"0.0,1.0,2.0\n0.1,1.0,2.0\n", "the first line holds numbers"),
        ("log.csv", b"t,v1,v1\n0,1,2\n", "'v1' stands twice"),
        ("log.csv", b"t,v1,q1\n0,1,2\n0.1,1\n", "2 cells where the header has 3"),
        ("log.csv", b"t,v1,q1\n0,1,2\n0.1,off,2\n", "'off' is not a number"),
        ("log.csv", b"\x89PNG\r\n\x1a\n0000", "the file is PNG image"),
        ("log.csv", b"PAR1\0\0\0", "the file is Parquet, not a text table"),
        ("log.csv", b"\xff\xfet\0,\0v\0", "binary data"),
        ("log.csv", b"\xe9t\xe9,v1,q1\n0,1,2\n", "the file has été, v1, q1"),
        ("log.csv", b"t,v1,q1\nfoo,bar,baz\n0,1,2\n", "neither numbers nor units (foo, bar, baz)"),
        ("log.csv", b"t,v1,q1\ns,V,banana\n0,1,2\n", "'banana' is unknown. Correct the unit, or state one in a column"),
        ("log.parquet", b"t,v1,q1\n0,1,2\n", "the file is not Parquet"),
        ("log.parquet", b"PAR1 and then nothing", "damaged or cut"),
        ("log.npz", b"t,v1,q1\n0,1,2\n", "the file is not NPZ"),
        ("log.npz", b"PK\x03\x04 and then nothing", "damaged or cut"),
        ("log.npy", b"\x93NUMPY\x01\x00", "damaged or cut"),
        ("log.mat", b"t,v1,q1\n0,1,2\n", "the file is not MATLAB"),
        ("log.h5", b"\x89HDF\r\n\x1a\n", "damaged or cut"),
        ("log.json", b'{"t": [0, 1', "not valid JSON at line 1"),
        ("log.json", b'{"t": 1}', "no list of records"),
        ("log.mcap", b"\x89MCAP0\r\n and then nothing", "damaged or cut"),
        ("log.db3", b"not a bag", "the file is not ROS bag or MCAP"),
        ("log.xlsx", b"PK\x03\x04", ".xlsx is not a known log format"),
        ("log", b"t,v1,q1\n", "a file without suffix is not a known log format"),
        ("log.csv.gz", gzip.compress(b"t,v1,q1\n0,1,2\n" * 50, mtime=0)[:-12], "the gzip file is damaged or cut"),
    ],
)
def test_bad_files(name: str, content: bytes, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(LogError) as caught:
        load(path)
    assert complaint in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz"])
def test_truncated_files(suffix: str, tmp_path: Path) -> None:
    path = save(load(write(tmp_path / "whole.csv", swing())), tmp_path / f"cut{suffix}")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])
    if suffix == ".csv":
        assert len(load(path, repair=True)) < 400
    with pytest.raises(LogError, match=r"cut|cells"):
        load(path)


def test_no_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="there is no such file"):
        load(tmp_path / "none.csv")
    with pytest.raises(LogError, match="this is a folder"):
        load(tmp_path)


def test_one_is_no_plural(tmp_path: Path) -> None:
    columns = {name: values[:1] for name, values in swing().items()}
    with pytest.raises(LogError, match="the recording has 1 sample, at least"):
        load(write(tmp_path / "log.csv", columns))
    path = write(tmp_path / "log.csv", swing())
    path.write_text(path.read_text() + "1\n")
    with pytest.raises(LogError, match=r"1 cell where .* load it with --repair"):
        load(path)
    assert "1 row with missing or surplus cells left out" in load_with_findings(path, repair=True)[1][0].text


def test_stated_units_are_believed(tmp_path: Path) -> None:
    columns = swing()
    columns["q1"] *= 60.0
    del columns["dq1"]
    path = write(tmp_path / "log.csv", columns)
    (tmp_path / "log.toml").write_text('[columns]\nq1 = { column = "q1", unit = "rad" }\n')
    assert np.ptp(load(path).position) > 30.0


def test_messages_speak_the_language_of_the_file(tmp_path: Path) -> None:
    columns = {"zeit": swing()["t"], "strom": swing()["v1"], "winkel": swing()["q1"]}
    columns["winkel"][3] = math.nan
    path = write(tmp_path / "log.csv", columns)
    (tmp_path / "log.toml").write_text('[columns]\nt = "zeit"\ni1 = "strom"\nq1 = "winkel"\n')
    with pytest.raises(LogError) as caught:
        load(path)
    assert caught.value.column == "winkel"


class TestFindings:
    """What is said and does not stop."""

    def kinds(self, log: Log) -> list[str]:
        return [finding.kind for finding in check(log)]

    def test_jitter(self) -> None:
        columns = swing()
        columns["t"] += np.random.default_rng(0).normal(0.0, 1e-4, 400)
        assert self.kinds(log_of(columns)) == ["jitter"]

    def test_dropped_samples(self) -> None:
        columns = swing()
        lost = np.sort(np.random.default_rng(0).choice(np.arange(1, 399), 8, replace=False))
        columns = {name: np.delete(values, lost) for name, values in columns.items()}
        (finding,) = check(log_of(columns))
        assert finding.kind == "gaps"
        assert "about 8 samples (2.0%) missing in 8 gaps" in finding.text

    def test_spikes(self) -> None:
        columns = swing()
        columns["q1"][[50, 200]] += 1.0
        (finding,) = check(log_of(columns))
        assert finding.kind == "spikes"
        assert "2 single-sample spikes, the first in row 51" in finding.text

    def test_repeated_readings(self) -> None:
        columns = swing()
        held = [60, 61, 130, 290]
        truth = columns["q1"].copy()
        for row in held:
            columns["q1"][row] = columns["q1"][row - 1]
        log = log_of(columns)
        (finding,) = check(log)
        assert finding.kind == "stale_readings"
        assert "q1 repeats the reading before it in 4 rows while it moves on, first in row 61" in finding.text
        mended, (done,) = repair(log)
        assert done.kind == "repaired_stale"
        assert check(mended) == ()
        assert np.max(np.abs(mended.position[:, 0] - truth)) < 0.1 * np.max(np.abs(columns["q1"] - truth))

    def test_jump(self) -> None:
        columns = swing()
        columns["q1"][150:] += 0.5
        assert "jump" in self.kinds(log_of(columns))

    def test_held_joint(self) -> None:
        columns = swing()
        signals = np.column_stack([columns["q1"], np.full(400, 0.2)])
        log = Log(columns["t"], np.column_stack([columns["v1"], np.zeros(400)]), signals, joints=(1, 2))
        assert self.kinds(log) == ["held_joint", "constant_command"]

    def test_beyond_the_limit(self) -> None:
        assert self.kinds(log_of(swing(), facts=(JointFacts(command_limit=1.5),))) == ["beyond_limit"]

    def test_velocity_of_another_size(self) -> None:
        columns = swing()
        columns["dq1"] *= 2.0
        assert self.kinds(log_of(columns)) == ["velocity_ratio"]

    def test_velocity_of_the_wrong_sign(self) -> None:
        columns = swing()
        columns["dq1"] *= -1.0
        (finding,) = check(log_of(columns))
        assert finding.kind == "velocity_ratio"
        assert "-1 times" in finding.text


class TestRepair:
    """Made on request, and said."""

    def test_a_sound_log_stays_as_it_is(self) -> None:
        log = log_of(swing())
        assert repair(log) == (log, ())

    def test_everything_at_once(self) -> None:
        columns = swing()
        truth = columns["q1"].copy()
        columns["q1"][100] = math.nan
        columns["q1"][200] += 1.0
        columns["t"][301], columns["t"][300] = columns["t"][300], columns["t"][301]
        columns["q1"][301], columns["q1"][300] = columns["q1"][300], columns["q1"][301]
        mended, done = repair(log_of(columns))
        assert {finding.kind for finding in done} == {
            "repaired_rows",
            "repaired_order",
            "repaired_spikes",
            "resampled",
        }
        assert check(mended) == ()
        np.testing.assert_allclose(mended.position[:, 0], truth[: len(mended)], atol=1e-4)

    def test_noisy_stamps_of_a_regular_clock(self) -> None:
        columns = swing()
        truth = columns["t"].copy()
        columns["t"] += np.random.default_rng(0).normal(0.0, 1e-3, 400)
        mended, done = repair(log_of(columns))
        assert [finding.kind for finding in done] == ["repaired_clock"]
        np.testing.assert_allclose(mended.time, truth, atol=3e-4)

    def test_wrapped_angles(self) -> None:
        columns = swing()
        angle = 15.0 * columns["q1"]
        columns["q1"] = np.mod(angle, 2.0 * math.pi)
        mended, done = repair(log_of(columns, velocity=None))
        assert [finding.kind for finding in done] == ["repaired_wrap"]
        np.testing.assert_allclose(mended.position[:, 0], angle, atol=1e-12)

    @pytest.mark.parametrize("order", ["beside", "behind"])
    def test_a_log_in_which_every_row_stands_twice(self, order: str) -> None:
        columns = swing()
        log = log_of(columns)
        twice = np.repeat if order == "beside" else np.tile
        mended, done = repair(log_of({name: twice(values, 2) for name, values in columns.items()}))
        assert [finding.text for finding in done] == ["400 double rows left out"]
        assert mended.content_hash == log.content_hash

    def test_samples_that_share_a_rounded_stamp_stay(self) -> None:
        columns = swing()
        truth = columns["t"].copy()
        columns["t"] = np.round(columns["t"] / (5.0 * truth[1])) * 5.0 * truth[1]
        columns["q1"][:20] = columns["v1"][:20] = columns["dq1"][:20] = 0.0
        mended, done = repair(log_of(columns))
        assert [finding.kind for finding in done] == ["repaired_clock"]
        np.testing.assert_allclose(mended.time, truth, atol=truth[1])

    def test_samples_between_measured_ones_are_counted(self) -> None:
        columns = swing()
        kept = np.r_[0:200, 200:400:2]
        mended, done = repair(log_of({name: values[kept] for name, values in columns.items()}))
        assert [finding.kind for finding in done] == ["resampled"]
        assert "99 of 399 samples are interpolated, not measured" in done[0].text
        assert len(mended) == 399

    def test_long_gaps_are_not_filled_and_what_lies_beyond_is_no_jump(self) -> None:
        columns = swing()
        columns["q1"] += np.linspace(0.0, 8.0, 400) ** 2
        kept = np.r_[0:150, 180:300, 301:400]
        log = log_of({name: values[kept] for name, values in columns.items()}, velocity=None)
        found = check(log)
        assert "gaps" in {finding.kind for finding in found}
        assert "jump" not in {finding.kind for finding in found}
        mended, done = repair(log)
        assert "1 of 370 samples are interpolated, not measured" in done[0].text
        np.testing.assert_allclose(mended.time, np.delete(columns["t"], np.arange(150, 180)), atol=1e-9)

    def test_held_commands_are_not_interpolated(self) -> None:
        t = np.array([0.0, 1.0, 2.0, 4.0])
        log = Log(t, np.array([[0.0], [1.0], [0.0], [1.0]]), t[:, None])
        assert resample(log, 0.5).command[:, 0].tolist() == [0, 0, 1, 1, 0, 0, 0, 0, 1]
        assert resample(log, 0.5).position[:, 0].tolist() == (0.5 * np.arange(9)).tolist()


class TestStatistics:
    """Instruments are recognised by their numbers."""

    @pytest.mark.parametrize("step", [2 * math.pi / 4096, 2 * math.pi / 500_000, 5e-6])
    def test_quantisation(self, step: float) -> None:
        rng = np.random.default_rng(0)
        values = np.cumsum(rng.normal(size=2000)) * 20 * step
        found = quantisation_step(step * np.round(values / step))
        assert found == pytest.approx(step, rel=1e-9)
        assert quantisation_step(values) is None

    def test_too_few_levels_say_nothing(self) -> None:
        assert quantisation_step(np.array([0.0, 1.0, 2.0] * 10)) is None

    def test_clock(self) -> None:
        t = np.delete(1e-3 * np.arange(100), [10, 50, 51])
        clock = timing(t)
        assert (clock.missing, clock.gap_rows.tolist()) == (3, [9, 48])
        assert clock.sample_time == pytest.approx(1e-3)
        assert not clock.uniform

    def test_collisions_are_neither_spikes_nor_jumps(self) -> None:
        t = 1e-3 * np.arange(1000)
        bouncing = np.abs(np.sin(9.0 * t))
        assert len(spikes(bouncing)) == 0
        assert len(jumps(bouncing)) == 0

    @pytest.mark.parametrize("step", [1e-3, 5e-3, 2e-2])
    def test_steps_of_a_coarse_encoder_and_a_joint_that_sticks_are_no_repeated_readings(self, step: float) -> None:
        t = 1e-3 * np.arange(4000)
        moving = step * np.round((np.sin(3.0 * t) + 0.2 * np.sin(31.0 * t)) / step)
        sticking = np.cumsum(np.where(np.sin(9.0 * t) > 0.3, step * np.round(8.0 * np.sin(9.0 * t)), 0.0))
        assert len(stale(moving)) == len(stale(sticking)) == 0

    def test_a_joint_that_creeps_with_stops_repeats_no_readings(self) -> None:
        rng = np.random.default_rng(4)
        change = np.where(rng.random(20_000) < 0.2, 0.0, rng.integers(5, 200, 20_000))
        assert len(stale(1e-5 * np.cumsum(change))) == 0

    def test_saturation(self) -> None:
        command = np.clip(3.0 * np.sin(np.linspace(0, 40, 2000)), -2.0, 2.0)
        level, share = saturation(command)
        assert level == 2.0
        assert 0.2 < share < 0.6
        assert saturation(3.0 * np.sin(np.linspace(0, 40, 2000)))[1] == 0.0


def test_inspection(tmp_path: Path) -> None:
    columns = swing(4000)
    step = 2 * math.pi / 8192
    columns["q1"] = step * np.round(columns["q1"] / step)
    inspection = inspect(load(write(tmp_path / "log.csv", columns)))
    (joint,) = inspection.joints
    assert joint.encoder_step == pytest.approx(step)
    assert joint.excitation_band[0] <= 20 / (2 * math.pi) <= joint.excitation_band[1] < 6.0
    assert joint.largest_speed == pytest.approx(6.0, rel=0.05)
    assert inspection.clock.rate == pytest.approx(1000.0)


def test_a_drive_with_a_second_encoder_and_a_set_point_is_one_joint(tmp_path: Path) -> None:
    columns = swing()
    counts = np.round(columns["q1"] * 2546.5)
    foreign = {
        "time_s": columns["t"],
        "commanded_position_counts": np.full_like(counts, 1000.0),
        "control_effort_V": columns["v1"],
        "encoder1_counts": counts,
        "encoder2_counts": np.round(counts / 4.0),
    }
    path = write(tmp_path / "drive.csv", foreign)
    proposal = propose(read_table(path))
    assert {target: item.column for target, item in proposal.map.columns.items()} == {
        "t": "time_s",
        "q1": "encoder1_counts",
        "v1": "control_effort_V",
    }
    assert proposal.left_out == ("commanded_position_counts", "encoder2_counts")
    with pytest.raises(LogError, match="COUNTS_PER_TURN is the encoder's counts per turn of the joint: put in"):
        list(inspect_file(path))


@pytest.mark.parametrize(
    ("turn", "counts", "unit", "reason"),
    [
        (360.0, 204_800, "deg", "guessed from the step"),
        (360.0, 4096, "deg", "guessed from the step"),
        (2.0 * math.pi, 8192, "rad", "guessed from the step"),
        (2.0 * math.pi, None, "rad", "guessed from the range"),
    ],
)
def test_a_guessed_unit_is_marked(turn: float, counts: int | None, unit: str, reason: str, tmp_path: Path) -> None:
    columns = swing()
    angle = 4.0 * columns["q1"]
    if counts is not None:
        angle = turn / counts * np.round(angle / (turn / counts))
    path = write(tmp_path / "log.csv", {"time": columns["t"], "angle": angle, "motor_V": columns["v1"]})
    proposed = propose(read_table(path)).toml().splitlines()
    assert proposed[1] == 't = { column = "time", unit = "s" }  # unit guessed: check it'
    assert proposed[2].startswith(f'q1 = {{ column = "angle", unit = "{unit}" }}  # ')
    assert reason in proposed[2]
    assert proposed[3] == 'v1 = { column = "motor_V", unit = "V" }'


def test_a_row_of_units_is_no_guess(tmp_path: Path) -> None:
    columns = swing()
    path = write(
        tmp_path / "log.csv", {"time": columns["t"], "angle": columns["q1"], "motor": columns["v1"], "u": columns["v1"]}
    )
    path.write_text(path.read_text().replace("\n", "\ns,mrad,,mV\n", 1))
    proposal = propose(read_table(path))
    assert {target: item.unit for target, item in proposal.map.columns.items()} == {"t": "s", "q1": "mrad", "v1": "mV"}
    assert proposal.guessed == {}


def test_a_command_is_proposed_beside_positions_that_have_their_names(tmp_path: Path) -> None:
    columns = swing()
    signals = {
        "t": columns["t"],
        "/cmd/voltage/data1": columns["v1"],
        "elbow.position": columns["q1"],
        "q1": columns["q1"],
    }
    path = write(tmp_path / "log.csv", signals)
    lines = list(inspect_file(path))
    assert any('v1 = { column = "/cmd/voltage/data1", unit = "V" }' in line for line in lines)
    assert not any("q1 = {" in line for line in lines)
    assert any("joint 1: position" in line for line in lines)
    signals = {"t": columns["t"], "v2": columns["v1"], "angle_rad": columns["q1"]}
    assert "q2" in propose(read_table(write(tmp_path / "log.csv", signals))).map.columns
    del signals["angle_rad"]
    with pytest.raises(LogError, match="no column looks like a position"):
        list(inspect_file(write(tmp_path / "log.csv", signals)))


def test_proposed_map_reads_the_file(tmp_path: Path) -> None:
    columns = swing()
    foreign = {
        "Time_ms": 1e3 * columns["t"],
        "joint position [deg]": np.rad2deg(columns["q1"]),
        "pos_des1": columns["q1"],
        "speed (rpm)": columns["dq1"] * 30 / math.pi,
        "motor voltage": columns["v1"],
    }
    path = write(tmp_path / "foreign.csv", foreign)
    with pytest.raises(LogError, match="adeptone data inspect proposes one"):
        load(path)
    lines = list(inspect_file(path))
    start = next(row for row, line in enumerate(lines) if "[columns]" in line)
    proposal = [line.strip() for line in lines[start : start + 5]]
    (tmp_path / "foreign.toml").write_text("\n".join(proposal))
    log, findings = load_with_findings(path)
    np.testing.assert_allclose(log.position[:, 0], columns["q1"], atol=1e-12)
    np.testing.assert_allclose(log.velocity[:, 0], columns["dq1"], atol=1e-12)  # type: ignore[index]
    np.testing.assert_allclose(log.time, columns["t"], atol=1e-12)
    assert findings == ()
