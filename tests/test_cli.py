"""The command line: quick, one line for an input error, status 2, nothing half-written."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import adeptone
from envs import data_sets

HEAVY = (
    "torch",
    "mujoco",
    "numba",
    "pandas",
    "pinocchio",
    "pysindy",
    "stable_baselines3",
    "scipy",
    "pyarrow",
    "matplotlib",
)


def run(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """The exit status of ``adeptone ARGUMENTS`` in this process."""
    monkeypatch.setattr(sys, "argv", ["adeptone", *arguments])
    with pytest.raises(SystemExit) as caught:
        adeptone.main()
    return int(caught.value.code or 0)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    t = 1e-3 * np.arange(300)
    rows = np.column_stack([t, 2.0 * np.sin(20.0 * t), 0.3 * (1.0 - np.cos(20.0 * t))])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, delimiter=",", header="t,v1,q1", comments="")
    return path


def test_help_imports_nothing_heavy_and_is_quick() -> None:
    program = (
        "import sys, adeptone\n"
        "try:\n    adeptone.app(['--help'])\nexcept SystemExit:\n    pass\n"
        f"sys.exit(' '.join(name for name in {HEAVY!r} if name in sys.modules))"
    )
    before = os.times()
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    after = os.times()
    assert done.stderr.strip() == ""
    assert "diagnose" in done.stdout
    processor_seconds = (after.children_user - before.children_user) + (after.children_system - before.children_system)
    assert processor_seconds < 0.5


def test_inspect(recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("data", "inspect", str(recording), monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    assert "300 samples, 0.299 s, 1000 Hz" in printed
    assert "command v1: -2 to 2 V" in printed


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "the file is empty"),
        ("t,v1,q1\n0,1,2\n0.001,1,nan\n" + "0.002,1,2\n" * 20, "column q1, row 2: 1 of 22 values are missing"),
        ("time,volts\n0,1\n0.001,2\n", "no column looks like a position. Complete the proposed map"),
    ],
)
def test_input_errors_are_one_line(
    content: str, complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(content)
    assert run("data", "inspect", str(path), monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"adeptone: {path}")
    assert complaint in error
    assert error.count("\n") == 1


def test_programming_errors_are_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise ValueError("a mistake of ours")

    monkeypatch.setattr(adeptone, "app", broken)
    with pytest.raises(ValueError, match="a mistake of ours"):
        adeptone.main()


def test_unknown_command_and_option(monkeypatch: pytest.MonkeyPatch) -> None:
    assert run("improve", monkeypatch=monkeypatch) == 2
    assert run("data", "inspect", "--fast", monkeypatch=monkeypatch) == 2


def test_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    log, options = str(tmp_path / "synthetic.csv"), ["--excitation", "sine:amplitude=2,frequency=1", "--duration", "1"]
    hidden = ["--effect", "coulomb_friction=7", "--effect", "cogging_torque=amplitude:2,cycles_per_rev:150"]
    assert run("record", *options, *hidden, "--out", log, monkeypatch=monkeypatch) == 0
    assert run("data", "inspect", log, monkeypatch=monkeypatch) == 0
    assert "1000 Hz" in capsys.readouterr().out
    assert "coulomb" not in (tmp_path / "synthetic.toml").read_text()


@pytest.mark.parametrize(
    ("option", "value", "complaint"),
    [
        ("--effect", "colomb_friction=7", "coulomb_friction"),
        ("--excitation", "sinus", "sine"),
        ("--robot", "emsp", "did you mean emps"),
        ("--out", "log.xlsx", "cannot write .xlsx"),
    ],
)
def test_record_refuses_in_one_line(
    option: str,
    value: str,
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    options = {"--excitation": "sine:amplitude=2,frequency=1", "--out": "log.csv", "--duration": "0.1", option: value}
    assert run("record", *(part for pair in options.items() for part in pair), monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


COMMANDS_THAT_WRITE = {
    "record": ["--excitation", "sine:amplitude=2,frequency=1"],
    "diagnose": ["log.csv"],
    "fit": ["log.csv", "--method", "least_squares"],
    "new-method": ["my_method"],
    "new-effect": ["my_effect"],
    "bench run": [],
    "bench report": ["--results", "."],
}


@pytest.mark.parametrize("command", COMMANDS_THAT_WRITE)
@pytest.mark.parametrize(
    ("place", "complaint"), [("/proc/x", "nothing can be created in /proc"), ("taken/sub", "taken is no folder")]
)
def test_where_nothing_can_be_written_nothing_is_computed(
    command: str,
    place: str,
    complaint: str,
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("mine")
    for computation in ("envs.log_files.load_with_findings", "envs.plant.plant.record", "benchmarks.runner.run_cells"):
        monkeypatch.setattr(computation, None)
    out = f"{place}/out.csv" if command == "record" else f"{place}/out"
    arguments = [*command.split(), *COMMANDS_THAT_WRITE[command], "--out", out]
    assert run(*arguments, monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert f"{out} cannot be written" in error
    assert "--out" in error
    assert error.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv", "taken"]


def test_data_list_and_verify(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(data_sets.ENVIRONMENT_VARIABLE, str(tmp_path))
    monkeypatch.setattr(data_sets, "cache_folder", lambda: tmp_path / "cache")
    assert run("data", "list", monkeypatch=monkeypatch) == 0
    assert "(not here; adeptone data fetch emps)" in capsys.readouterr().out
    assert run("data", "verify", "emps", monkeypatch=monkeypatch) == 1
    assert "emps: 0 of 2 files sound" in capsys.readouterr().out
    assert run("data", "verify", "nobody", monkeypatch=monkeypatch) == 2
    assert "Choose one of" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "understood"),
    [
        ("a b --holdout c d --out o", "a b --holdout c --holdout d --out o"),
        ("a b --holdout c --holdout d --out o", "a b --holdout c --holdout d --out o"),
        ("a --out o --holdout=c d", "a --out o --holdout=c --holdout d"),
        ("--holdout c d --out o a b", "--holdout c --holdout d --out o a b"),
        ("--holdout c --repair a b", "--holdout c --repair a b"),
        ("--holdout c a b --out o", "--holdout c a b --out o"),
        ("a --holdout c -- d", "a --holdout c -- d"),
        ("a --holdout", "a --holdout"),
    ],
)
def test_all_files_that_follow_holdout_are_held_out(given: str, understood: str) -> None:
    """As the usage line reads; without other files, only the first, since something has to be fitted."""
    assert adeptone.held_out_together(given.split(), {"--holdout", "--out"}) == understood.split()


def test_diagnose_and_fit_hold_several_files_out(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[Path]] = []

    def said(logs: list[Path], holdout: list[Path], *others: object, **options: object) -> str:
        seen.extend([logs, holdout])
        return ""

    monkeypatch.setattr("diagnosis.run.diagnose_files", said)
    run("diagnose", "a.csv", "b.csv", "--holdout", "c.csv", "d.csv", "--out", "o", monkeypatch=monkeypatch)
    assert [[path.name for path in paths] for paths in seen] == [["a.csv", "b.csv"], ["c.csv", "d.csv"]]

    def fitted(method: str, logs: list[Path], out: Path, *, holdout: list[Path], **options: object) -> str:
        return said(logs, holdout)

    monkeypatch.setattr("methods.fitting.fit_files", fitted)
    words = ["fit", "--method", "ridge", "a.csv", "--holdout", "c.csv", "d.csv", "--out", "o.json"]
    run(*words, monkeypatch=monkeypatch)
    assert [[path.name for path in paths] for paths in seen[2:]] == [["a.csv"], ["c.csv", "d.csv"]]
