"""The leaderboard: figures that can be checked by hand, tables in four formats, and a page that needs no network."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from bench_table import SKILL, table
from typer.testing import CliRunner

import adeptone
from benchmarks.leaderboard.page import render
from benchmarks.leaderboard.report import leaderboards, report_tables, write
from benchmarks.leaderboard.results import ReportError, Results, TaskInfo
from benchmarks.leaderboard.standings import QUESTIONS, Leaderboard, groups, leaderboard, pooled_scores
from benchmarks.leaderboard.summary import cell, curve, losses, naming
from benchmarks.leaderboard.tables import Table, published_table, task_table
from benchmarks.store import Store
from benchmarks.tasks.base import Published

RIG = TaskInfo(
    "rig_drive",
    "Measured drive",
    ("real", "single"),
    (Published("their <network>", "simulation_error", 0.00264, "Somebody 2021"),),
)


@pytest.fixture(scope="module")
def results() -> Results:
    return Results.of(table(), {"rig_drive": RIG})


@pytest.fixture(scope="module")
def boards(results: Results) -> tuple[Leaderboard, ...]:
    return leaderboards(results)


def index(results: Results, label: str) -> int:
    return next(m for m, contestant in enumerate(results.contestants) if contestant.label == label)


def task(results: Results, name: str) -> int:
    return next(t for t, info in enumerate(results.tasks) if info.name == name)


def test_the_constant_scores_zero_and_the_order_is_that_of_the_skills(results: Results) -> None:
    board = leaderboard(results, QUESTIONS[0], "clean", np.random.default_rng(0))
    scores = {results.contestants[s.contestant].label: s.score.value for s in board.standings}
    assert scores["constant"] == pytest.approx(0.0, abs=0.08)
    for name in ("least_squares", "idim_ls", "diagnosis", "full_model"):
        assert scores[name] == pytest.approx(SKILL[name][0], abs=0.08)
    assert list(scores.values()) == sorted(scores.values(), reverse=True)


def test_a_score_by_hand(results: Results) -> None:
    m, t = index(results, "idim_ls"), task(results, "joint1_clean")
    own, worst = (results.column("inverse_error")[index(results, name), t, 0] for name in ("idim_ls", "constant"))
    assert pooled_scores(results, QUESTIONS[0])[m, t, 0] == pytest.approx(np.log(worst / own) / np.log(worst / 0.002))


def test_failed_runs_score_zero_and_skipped_ones_do_not_count(results: Results) -> None:
    scores = pooled_scores(results, QUESTIONS[0])
    process, sindy = index(results, "gaussian_process"), index(results, "sindy")
    assert np.all(scores[process, task(results, "joint2_noise_high")] == 0.0)
    assert np.all(np.isnan(scores[sindy, task(results, "arm_clean")]))
    board = leaderboard(results, QUESTIONS[0], None, np.random.default_rng(0))
    line = next(s for s in board.standings if s.contestant == process)
    assert (line.failed, line.tasks) == (8, 10)


def test_a_method_without_answers_of_a_kind_is_not_on_that_board(results: Results) -> None:
    board = leaderboard(results, QUESTIONS[1], None, np.random.default_rng(0))
    assert index(results, "network_alone") not in [s.contestant for s in board.standings]


def test_a_lost_free_run_is_infinitely_wrong_not_missing(results: Results) -> None:
    m, t = index(results, "least_squares"), task(results, "joint1_backlash")
    assert pooled_scores(results, QUESTIONS[1])[m, t, 1] == 0.0
    assert cell(results, "simulation_error", m, t).high == np.inf


def test_without_a_noise_floor_the_least_error_stands_for_it(results: Results) -> None:
    t = task(results, "rig_drive")
    board = leaderboard(results, QUESTIONS[0], None, np.random.default_rng(0))
    assert board.without_noise_floor == ("rig_drive",)
    assert np.nanmax(pooled_scores(results, QUESTIONS[0])[:, t]) == pytest.approx(1.0)


def test_without_a_constant_predictor_nothing_can_be_pooled() -> None:
    rows = table(2)
    alone = Results.of(rows[(rows["label"] != "constant") | (rows["task"] != "joint1_clean")], {})
    board = leaderboard(alone, QUESTIONS[0], "clean", np.random.default_rng(0))
    assert board.left_out == ("joint1_clean",)


def test_boards_repeat_and_do_not_depend_on_the_order_of_rows(results: Results) -> None:
    shuffled = Results.of(table().sample(frac=1.0, random_state=1), {"rig_drive": RIG})
    question = QUESTIONS[0]
    once, again = (leaderboard(r, question, None, np.random.default_rng(0)) for r in (results, shuffled))
    assert repr(once) == repr(again)


def test_groups_are_the_tags_that_divide(results: Results) -> None:
    assert groups(results)[0] is None
    assert {"single", "pair", "arm", "noise", "real", "extrapolation"} <= set(groups(results))


def test_curve_and_naming_and_losses(results: Results) -> None:
    found = curve(results, index(results, "diagnosis"), task(results, "joint1_clean"))
    assert found is not None
    assert found.horizon[-1] == pytest.approx(2.0)
    assert all(low <= mid <= high for low, mid, high in zip(found.low, found.median, found.high, strict=True))
    named = {item.task: dict(item.named) for item in naming(results)}
    assert set(named) == {"joint1_backlash", "joint1_cogging_torque", "joint1_coulomb_friction"}
    assert sum(named["joint1_backlash"].values()) == 4
    reasons = {(item.contestants, item.status): item.runs for item in losses(results)}
    assert reasons[("gaussian_process",), "timed_out"] == 8
    assert reasons[("compensated_least_squares", "sindy", "total_least_squares"), "skipped"] == 4


def test_every_table_has_noise_floor_and_ceiling(results: Results) -> None:
    own = task_table(results, task(results, "joint1_clean"))
    labels = [row[0] for row in own.rows]
    assert labels[0] == "constant (floor)"
    assert labels[-2:] == ["full_model (ceiling)", "noise floor"]
    assert "2.00" in own.rows[-1]


def test_published_figures_stand_beside_ours(results: Results) -> None:
    found = published_table(results)
    assert ("rig_drive", "Simulation error", "their <network>", "2.64 mm", "Somebody 2021") in found.rows
    assert len(found.rows) == len(SKILL) - 1  # without the ceiling and the network that is not simulated, plus theirs


def test_tables_in_three_formats(results: Results, boards: tuple[Leaderboard, ...]) -> None:
    tables = {t.name: t for t in report_tables(results, boards)}
    board = tables["standings_inverse_all"]
    lines = list(csv.DictReader(board.csv().splitlines()))
    assert len(lines) == len(board.rows) == len(SKILL)
    assert float(lines[0]["score_low"]) < float(lines[0]["score"]) < float(lines[0]["score_high"])
    assert board.markdown().count("\n|") == len(SKILL) + 2
    latex = board.latex()
    assert r"full\_model" in latex
    head, _, *body = latex.splitlines()[5 : 7 + len(SKILL)]
    assert {line.count("&") for line in (head, *body)} == {len(board.columns) - 1}


def test_latex_and_markdown_survive_awkward_text() -> None:
    awkward = Table("t", "100 % & more", ("a_b", "c"), (("x|y", "1 × 10⁻³ <µ>"),), ("a",), ((1.0,),))
    assert r"100 \% \& more" in awkward.latex()
    assert r"$\times$ 10$^-$$^3$" in awkward.latex()
    assert "x\\|y" in awkward.markdown()


def test_the_page_is_one_file_and_holds_every_figure(results: Results, boards: tuple[Leaderboard, ...]) -> None:
    page = render(results, boards, ())
    assert not re.search(r'(?:src|href)="(?!#)', page)
    assert "their <network>" not in page
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])  # type: ignore[index]
    t, m = task(results, "joint1_clean"), index(results, "idim_ls")
    shown = data["tasks"][t]["cells"][str(m)]["inverse_error"]
    expected = cell(results, "inverse_error", m, t)
    assert shown == pytest.approx([expected.median, expected.low, expected.high], rel=1e-4)
    assert len(data["runs"]["seed"]) == len(results.frame)
    assert set(data["runs"]["maker"]) == {0}
    assert len(data["boards"]) == len(boards)


def test_a_hostile_reason_stays_text() -> None:
    rows = table(1)
    rows.loc[rows["status"] == "crashed", "reason"] = "</script><b onclick='x'>"
    own = Results.of(rows, {})
    assert "</script><b" not in render(own, leaderboards(own), ())


def test_files_are_written_from_a_store(tmp_path: Path) -> None:
    rows = table(1)
    store = Store(tmp_path / "bench")
    for row in rows[rows["task"] == "joint1_clean"].to_dict("records"):
        store.append(row | {"finished_at": "2026-01-01"})
    command = ["bench", "report", "--results", str(tmp_path / "bench"), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(adeptone.app, command)
    assert result.exit_code == 0, result.exception
    assert (tmp_path / "out" / "index.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    names = {path.name for path in (tmp_path / "out" / "tables").iterdir()}
    assert {"standings_inverse_all.tex", "task_joint1_clean.md", "runs.csv"} <= names


def test_nothing_to_report_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(ReportError, match="no results"):
        Results.of(pd.DataFrame(columns=["task"]), {})
    with pytest.raises(ReportError, match="lacks"):
        Results.of(pd.DataFrame({"task": ["a"]}), {})
    results = CliRunner().invoke(adeptone.app, ["bench", "report", "--results", str(tmp_path / "nowhere")])
    assert isinstance(results.exception, ReportError)


def test_the_page_is_complete_without_any_pooled_task() -> None:
    rows = table(1)
    own = Results.of(rows[rows["label"] == "sindy"], {})
    assert "No task has a constant predictor" in render(own, leaderboards(own), ())


def test_the_same_results_give_the_same_files(tmp_path: Path) -> None:
    own = Results.of(table(1), {"rig_drive": RIG})
    first = write(own, tmp_path / "out").read_bytes()
    assert write(own, tmp_path / "out").read_bytes() == first
