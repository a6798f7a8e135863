"""Real rigs: their nominal robots against formulas written apart, their files against what is known of them."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, decimate, filtfilt

from envs import data_sets
from envs.data_sets import DataSetError, data_set, fetch, locate, names, verify
from envs.log import LogError
from envs.log_files import load, load_with_findings
from envs.log_statistics import quantisation_step
from envs.rigs import rig, rigs
from envs.rigs.odrive_cogging import cogging_map
from envs.robot import RobotError
from envs.robots import find_robot, robot_names

needs_data = pytest.mark.skipif(
    not all(data_sets.available(name) for name in names()),
    reason="no measured data here: run adeptone data fetch, or set ADEPTONE_DATA to their folder",
)


@pytest.mark.parametrize("name", names())
def test_descriptions_fit_together(name: str) -> None:
    item = rig(name)
    files = {file.path for file in data_set(name).files}
    assert {run.file for run in item.runs} <= files
    assert len({run.name for run in item.runs}) == len(item.runs)
    assert {run.role for run in item.runs} >= {"fit", "held_out"}
    assert all(file.address.startswith("https://") and len(file.sha256) == 64 for file in data_set(name).files)


@pytest.mark.parametrize("name", robot_names())
def test_robots_by_name(name: str) -> None:
    robot = find_robot(name)
    assert robot.name.casefold() == name
    assert find_robot(robot.name) == robot
    inertia = robot.inertia_matrix(np.full(len(robot), 0.1))
    assert np.all(np.linalg.eigvalsh(inertia) > 0)


def test_unknown_robots_and_rigs() -> None:
    with pytest.raises(RobotError, match="did you mean emps"):
        find_robot("emsp")
    with pytest.raises(RobotError, match="says nothing of its drives"):
        find_robot("arm.urdf")
    with pytest.raises(DataSetError, match="Choose one of dfki_double_pendulum, emps"):
        rig("nobody")
    with pytest.raises(DataSetError, match="Choose one of estimation, pulses"):
        rig("emps").log("nothing")


def test_emps_is_a_mass_on_a_slider() -> None:
    robot, published = rig("emps").robot(), rig("emps").published()["Coulomb friction"]
    assert robot.inertia_matrix(np.zeros(1)) == pytest.approx(published["mass"])
    assert robot.body.bias(np.zeros(1), np.zeros(1)) == pytest.approx(0.0)
    assert robot.drives[0].viscous.value == published["viscous"]
    assert robot.input_equivalent(1) == pytest.approx(1 / 35.15)


def test_xl330_is_a_point_mass_on_a_rod() -> None:
    robot, published = rig("xl330").robot(), rig("xl330").published()["m1"]
    q = np.array([0.7])
    assert robot.inertia_matrix(q) == pytest.approx(0.49 * 0.10**2 + published["armature"], rel=1e-3)
    assert robot.body.bias(q, np.zeros(1)) == pytest.approx(0.49 * 9.80665 * 0.10 * np.sin(0.7))
    assert robot.input_equivalent(1) == pytest.approx(published["R"] / published["kt"], rel=1e-3)


def test_double_pendulum_moves_as_its_authors_say() -> None:
    robot = rig("dfki_double_pendulum").robot()
    p = rig("dfki_double_pendulum").published()["model 3.0"]
    q = np.array([0.4, -0.9])
    coupling = p["m2"] * p["l1"] * p["r2"] * np.cos(q[1])
    rotor = p["gr"] ** 2 * p["Ir"]
    m12 = p["I2"] + coupling
    expected = [[p["I1"] + p["I2"] + p["m2"] * p["l1"] ** 2 + 2 * coupling + rotor, m12], [m12, p["I2"] + rotor]]
    np.testing.assert_allclose(robot.inertia_matrix(q), expected, rtol=1e-6)
    elbow = p["m2"] * p["r2"] * p["g"] * np.sin(q.sum())
    shoulder = (p["m1"] * p["r1"] + p["m2"] * p["l1"]) * p["g"] * np.sin(q[0]) + elbow
    np.testing.assert_allclose(robot.body.bias(q, np.zeros(2)), [shoulder, elbow], rtol=1e-6)


@needs_data
@pytest.mark.parametrize("name", names())
def test_files_are_the_public_ones(name: str) -> None:
    assert {state for _, state in verify(name)} == {"sound"}


@needs_data
@pytest.mark.parametrize("name", names())
def test_every_run_loads(name: str) -> None:
    item = rig(name)
    robot = item.robot()
    for run in item.runs:
        log, findings = item.log_with_findings(run.name)
        assert log.robot == name
        assert log.loop in ("open", "closed")
        assert all(facts.input == joint.drive.command for facts, joint in zip(log.facts, robot.joints, strict=True))
        assert {finding.kind for finding in findings} <= {
            "jitter",
            "gaps",
            "uneven_clock",
            "constant_command",
            "rows_left_out",
        }


@needs_data
def test_emps_gives_the_published_parameters() -> None:
    """Least squares as the benchmark's own script does it: Butterworth at 100 Hz, central differences, decimation."""
    published = rig("emps").published()["Coulomb friction"]
    log = rig("emps").log("estimation")
    step = log.sample_time
    q = filtfilt(*butter(4, 100.0 / 500.0), log.position[:, 0])
    dq = np.gradient(q, step)
    ddq = np.gradient(dq, step)
    inner = slice(49, None)
    columns = np.column_stack([ddq, dq, np.sign(dq), np.ones_like(q)])[inner]
    observed = np.column_stack([decimate(column, 10) for column in columns.T])
    force = decimate(35.15 * log.command[inner, 0], 10)
    estimate, *_ = np.linalg.lstsq(observed, force, rcond=None)
    expected = [published[name] for name in ("mass", "viscous", "coulomb", "offset")]
    np.testing.assert_allclose(estimate, expected, rtol=5e-3)
    error = np.linalg.norm(force - observed @ estimate) / np.linalg.norm(force)
    assert error == pytest.approx(published["relative_force_error_estimation"], abs=1e-3)


@needs_data
def test_xl330_registers_are_decoded() -> None:
    """Signed register times measured supply: a pendulum held up needs the voltage of its weight, and of friction."""
    item = rig("xl330")
    log = item.log("up_and_down_400")
    assert np.abs(log.command).max() <= 9.2
    assert quantisation_step(log.position[:, 0]) == pytest.approx(2 * np.pi / 4096, rel=1e-9)
    still = np.abs(log.velocity[:, 0]) < 0.05  # type: ignore[index]
    held = still & (log.position[:, 0] > 0.5)
    published = item.published()["m1"]
    gravity = 0.49 * 9.80665 * 0.10 * np.sin(log.position[held, 0]) * published["R"] / published["kt"]
    assert np.median(log.command[held, 0] / gravity) == pytest.approx(1.0, abs=0.3)
    assert item.log("sin_time_square_800").command.min() < -7.0


@needs_data
def test_xl330_is_only_driven_while_it_is_on() -> None:
    log, findings = rig("xl330").log_with_findings("lift_and_drop_400")
    assert [finding.kind for finding in findings if finding.kind == "rows_left_out"]
    assert 1.9 < log.duration < 2.1


@needs_data
def test_rig_files_are_recognised_without_a_map() -> None:
    path = locate("emps", "DATA_EMPS.mat")
    assert load(path).content_hash == rig("emps").log("estimation").content_hash
    run = rig("xl330").run("sin_sin_100")
    assert load(locate("xl330", run.file)).robot == "xl330"


@needs_data
def test_cogging_map_and_motion_agree_on_the_scale() -> None:
    position, current = cogging_map("a_16")
    assert len(position) == 512
    assert np.all(np.diff(position) > 0)
    moving = rig("odrive_cogging").log("slow2_slower/nocomp_0")
    assert np.std(current) == pytest.approx(np.std(moving.command), rel=0.5)


@needs_data
def test_truncated_and_spiked_rig_files(tmp_path: Path) -> None:
    source = locate("dfki_double_pendulum", rig("dfki_double_pendulum").run("04").file)
    cut = tmp_path / "cut.csv.gz"
    cut.write_bytes(source.read_bytes()[:150_000])
    with pytest.raises(LogError, match="damaged or cut"):
        load(cut)
    rescued, findings = load_with_findings(cut, repair=True)
    assert 1000 < len(rescued) < 4999
    assert "cut_archive" in {finding.kind for finding in findings}


class TestDataFolder:
    """Own files first, then the cache; no network is said clearly."""

    @pytest.fixture
    def emps(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        """An empty data folder and an empty cache."""
        own = tmp_path / "data"
        (own / "emps").mkdir(parents=True)
        monkeypatch.setenv(data_sets.ENVIRONMENT_VARIABLE, str(own))
        monkeypatch.setattr(data_sets, "cache_folder", lambda: tmp_path / "cache")
        return own / "emps"

    def test_missing_data_say_how_to_get_them(self, emps: Path) -> None:
        assert not rig("emps").available
        with pytest.raises(DataSetError, match=r"Run adeptone data fetch emps, or set ADEPTONE_DATA"):
            rig("emps").log("estimation")

    def test_no_network(self, emps: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        import pooch
        from requests.exceptions import ConnectionError

        def offline(*args: object, **kwargs: object) -> str:
            raise ConnectionError("Name or service not known")

        monkeypatch.setattr(pooch, "retrieve", offline)
        with pytest.raises(DataSetError, match=r"DATA_EMPS.mat cannot be reached.*Connect to the network") as caught:
            list(fetch("emps"))
        assert "\n" not in str(caught.value)

    def test_changed_and_missing_files(self, emps: Path) -> None:
        (emps / "DATA_EMPS.mat").write_bytes(b"something else")
        assert [state for _, state in verify("emps")] == ["changed", "missing"]

    def test_fetched_files_are_checked(self, emps: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """pooch itself, fed from a local server's stand-in: the wrong content is refused, the right one kept."""
        import pooch

        content = b"measured"
        (tmp_path / "public.mat").write_bytes(content)
        original = pooch.retrieve

        def local(url: str, **options: object) -> str:
            def copy(_url: str, output: str, _pooch: object) -> None:
                shutil.copy(tmp_path / "public.mat", output)

            return original(url, downloader=copy, **options)  # type: ignore[arg-type]

        monkeypatch.setattr(pooch, "retrieve", local)
        with pytest.raises(DataSetError, match="has another content than expected"):
            list(fetch("emps"))
        monkeypatch.setattr(
            data_sets,
            "data_set",
            lambda name: data_sets.DataSet(
                name, "", "", "", (data_sets.DataFile("a.mat", "https://x/a.mat", hashlib.sha256(content).hexdigest()),)
            ),
        )
        assert [path.read_bytes() for path in fetch("emps")] == [content]

    def test_folder_that_does_not_exist(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv(data_sets.ENVIRONMENT_VARIABLE, "/nowhere/at/all")
        with pytest.raises(DataSetError, match="which is no folder"):
            data_sets.own_folder()


def test_rigs_are_listed_in_order() -> None:
    assert [item.name for item in rigs()] == sorted(item.name for item in rigs())
