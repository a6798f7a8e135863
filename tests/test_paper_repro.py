"""The one command: measured logs in, a complete report out; unusable input in, one line and exit status 2 out."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import paper_repro
from benchmarks.paper.experiment import TRAINING, draws, record, trials
from envs.data_sets import locate
from envs.log import Log
from envs.log_files import save
from envs.rigs import rig

ROOT = Path(__file__).resolve().parents[1]
MEASURED_FIGURES = (
    "fig2_input",
    "fig3_responses",
    "fig4_parameters",
    "fig5_inverse",
    "fig6_learning",
    "fig7_forward",
    "left_over",
)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def assert_complete(out: Path, figures: tuple[str, ...]) -> None:
    for name in figures:
        assert (out / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (out / "figures" / f"{name}.svg").read_text(encoding="utf-8")[:2000]
    page = (out / "index.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml;base64,") == len(figures)
    for outside in ("http://", "https://", 'src="figures', "<script", "<link"):
        assert outside not in page
    for table in (out / "tables").glob("*.csv"):
        assert table.with_suffix(".md").exists()
        assert rows(table)


def test_a_plain_log_gives_a_complete_report(tmp_path: Path) -> None:
    (trial,) = trials(draws(1, 0, duration=4.0)[0], 1, (TRAINING,))
    path = save(record(trial, 0), tmp_path / "own.csv")
    assert paper_repro.main(["--log", str(path), "--out", str(tmp_path / "out")]) == 0
    assert_complete(tmp_path / "out", MEASURED_FIGURES)
    errors = rows(tmp_path / "out" / "tables" / "errors.csv")
    assert {row["log"] for row in errors} == {"own[0:2400] (fitted)", "own[2400:4000]"}


@pytest.mark.skipif(not rig("emps").available, reason="the EMPS recordings are not on this machine (ADEPTONE_DATA)")
def test_emps_stands_beside_its_published_figures(tmp_path: Path) -> None:
    logs = [str(locate("emps", name)) for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")]
    assert paper_repro.main(["--log", *logs, "--out", str(tmp_path)]) == 0
    assert_complete(tmp_path, MEASURED_FIGURES)
    published = {row["figure"]: row for row in rows(tmp_path / "tables" / "published.csv")}
    for name in ("mass", "viscous", "coulomb", "offset"):
        row = published[name]
        assert float(row["here"]) == pytest.approx(float(row["published"]), rel=0.005)
    for name in ("relative force error estimation", "relative force error pulses"):
        row = published[name]
        assert float(row["here"]) == pytest.approx(float(row["published"]), abs=0.1)
    left = {
        (row["estimator"], row["log"]): float(row["relative [%]"])
        for row in rows(tmp_path / "tables" / "left_over.csv")
    }
    assert left["three columns, band-limited", "DATA_EMPS"] > 3.0 * left["three columns, Coulomb, offset", "DATA_EMPS"]


def written(path: Path, time_: np.ndarray, command: np.ndarray, position: np.ndarray) -> str:
    return str(save(Log(time=time_, command=command, position=position), path))


def test_unusable_input_gets_one_line_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stamps = np.arange(3000) * 1e-3
    sine = np.sin(3.0 * stamps)
    good = written(tmp_path / "good.csv", stamps, sine, sine)
    empty = tmp_path / "empty.csv"
    empty.touch()
    cases: dict[str, list[str]] = {
        "no such file": [str(tmp_path / "missing.csv")],
        "is empty": [str(empty)],
        "never": [written(tmp_path / "still.csv", stamps, sine, 0.0 * sine)],
        "too few": [written(tmp_path / "short.csv", stamps[:100], sine[:100], sine[:100])],
        "sampled every": [good, written(tmp_path / "slow.csv", 4.0 * stamps, sine, sine)],
    }
    out = tmp_path / "out"
    for problem, logs in cases.items():
        assert paper_repro.main(["--log", *logs, "--out", str(out)]) == 2
        message = capsys.readouterr().err.strip()
        assert message.startswith("paper_repro: ")
        assert "\n" not in message, message
        assert problem in message or "constant" in message, message
        assert Path(logs[-1]).name in message
        assert not out.exists()


def test_the_folder_for_the_report_has_to_be_writable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (trial,) = trials(draws(1, 0, duration=4.0)[0], 1, (TRAINING,))
    path = save(record(trial, 0), tmp_path / "own.csv")
    blocked = tmp_path / "file"
    blocked.touch()
    assert paper_repro.main(["--log", str(path), "--out", str(blocked / "out")]) == 2
    assert "\n" not in capsys.readouterr().err.strip().splitlines()[-1]


@pytest.mark.slow
def test_the_quick_study_is_complete_and_repeats_to_the_byte(tmp_path: Path) -> None:
    for name in ("first", "second"):
        begin = time.perf_counter()
        subprocess.run(
            [sys.executable, "paper_repro.py", "--quick", "--out", str(tmp_path / name)],
            cwd=ROOT,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": "random"},
        )
        print(f"{name} run: {time.perf_counter() - begin:.1f} s")
    tables = sorted((tmp_path / "first" / "tables").iterdir())
    assert len(tables) > 20
    for table in (*tables, tmp_path / "first" / "claims.csv"):
        other = tmp_path / "second" / table.relative_to(tmp_path / "first")
        assert table.read_bytes() == other.read_bytes(), table.name
    numbers = [int(path.name.partition("_")[0][3:]) for path in (tmp_path / "first" / "figures").glob("*.svg")]
    assert sorted(numbers) == list(range(1, 11))
    assert len(rows(tmp_path / "first" / "claims.csv")) == 7
