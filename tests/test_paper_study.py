"""The paper's experiment: the regression finds the plant's own coefficients, runs repeat to the byte, verdicts follow
their rule."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.paper import contestants as names
from benchmarks.paper.claims import Variant, claims_table, judge, verdict_of
from benchmarks.paper.doubts import investigate
from benchmarks.paper.evaluation import Reference, score
from benchmarks.paper.experiment import HELD_OUT, SETUPS, TRAINING, draws, record, trials
from benchmarks.paper.study import DrawResult, run_draw, true_model
from benchmarks.paper.tables import error_tables, parameter_tables, summarise_errors
from benchmarks.paper.truth import true_coefficients
from methods.least_squares import LeastSquares


@pytest.fixture(scope="module")
def results() -> list[DrawResult]:
    return [run_draw(draw, draw.number == 0) for draw in draws(2, seed=7, duration=3.0)]


@pytest.mark.parametrize("joint", sorted(SETUPS))
def test_the_regression_finds_the_plants_own_coefficients(joint: int) -> None:
    """Without hidden effects, an exact encoder and a rich excitation: plant, truth and method check one another."""
    (trial,) = trials(draws(1, 0)[0], joint, ("multisine",))
    log = record(trial, 0, hidden=False, quantised=False)
    fit = LeastSquares(columns=trial.setup.columns).fit([log], np.random.default_rng(0))
    truth = true_coefficients(trial.robot, joint, trial.pose)
    for column in trial.setup.columns:
        assert fit.estimates[column] == pytest.approx(truth[column], rel=2e-3), column


def test_the_true_model_simulates_the_plant_without_hidden_effects() -> None:
    (trial,) = trials(draws(1, 0)[0], 1, (TRAINING,))
    log = record(trial, 0, hidden=False)
    errors = score(true_model(trial), Reference.of(log))
    assert errors.position < 1e-4
    assert errors.inverse < 5e-3
    assert errors.diverged is None


def test_held_out_logs_differ_from_the_training_sine_as_their_names_say() -> None:
    draw = draws(1, 0)[0]
    by_name = {trial.name: trial for trial in trials(draw, 1, (TRAINING, *HELD_OUT))}
    inertia = {name: trial.robot.inertia_matrix(np.array(trial.pose))[0, 0] for name, trial in by_name.items()}
    assert inertia["other pose of joint 2"] > 1.3 * inertia[TRAINING]
    assert inertia["payload"] > 1.1 * inertia[TRAINING]
    for name in ("other amplitude", "other frequency", "multisine"):
        assert by_name[name].excitation != by_name[TRAINING].excitation
        assert inertia[name] == pytest.approx(inertia[TRAINING])


def test_draws_are_reproducible_and_the_first_is_nominal() -> None:
    first, again = draws(3, 5), draws(3, 5)
    assert first == again
    assert first[0].setups == SETUPS
    assert first[1].setups != first[2].setups
    assert first[1].robot != draws(3, 6)[1].robot


def test_the_same_seed_gives_the_same_bytes(results: list[DrawResult]) -> None:
    repeated = run_draw(draws(2, seed=7, duration=3.0)[1], False)

    def text(result: DrawResult) -> str:
        tables = (*parameter_tables([result]), *error_tables([result], summarise_errors([result])))
        return "".join(table.csv() for table in tables)

    assert text(results[1]) == text(repeated)


def test_every_contestant_is_scored_on_every_log(results: list[DrawResult]) -> None:
    summaries = summarise_errors(results)
    scored = {(item.method, item.log) for item in summaries if item.joint == 1}
    methods = {item.method for item in summaries if item.joint == 1}
    assert scored == {(method, log) for method in methods for log in (TRAINING, *HELD_OUT)}
    assert {names.PRINTED, names.PRINTED_4, names.SINDY_WEAK, names.ALONE, names.NOMINAL} <= methods
    assert {item.joint for item in summaries} == {1, 2, 3, 4}
    assert all(len(item.values["inverse"]) == len(results) for item in summaries)


def test_verdicts_on_all_claims(results: list[DrawResult]) -> None:
    verdicts = judge(results)
    assert [item.number for item in verdicts] == [f"C{k}" for k in range(1, 8)]
    for item in verdicts:
        assert item.verdict.startswith(("reproduced", "not reproduced"))
        assert item.criterion
        assert item.figures
    assert claims_table(verdicts).csv().count("\n") == 8


def test_a_claim_is_judged_by_what_happened(results: list[DrawResult]) -> None:
    falling = np.geomspace(1.0, 0.1, 50)
    for curve, expected in ((falling, "reproduced"), (falling[::-1], "not reproduced")):
        staged = [replace(result, learning_curves=dict.fromkeys(result.learning_curves, curve)) for result in results]
        assert {item.number: item.verdict for item in judge(staged)}["C3"] == expected


def test_the_first_variant_that_holds_names_the_condition() -> None:
    own, changed = Variant(None, 0.5), Variant("something is changed", 0.95)
    assert verdict_of((own, changed)) == "reproduced only if something is changed"
    assert verdict_of((replace(own, share=1.0), changed)) == "reproduced"
    assert verdict_of((own, replace(changed, share=0.8))) == "not reproduced"


def test_doubts_show_what_they_are_about() -> None:
    doubts = investigate(draws(1, 0, duration=6.0)[0])
    by_name = {row.excitation: row for row in doubts.excitations}
    sine, rich = by_name["sine, steady state"], by_name["multisine"]
    assert sine.correlation < -0.99
    assert sine.bound[0] > 100.0 * rich.bound[0]
    assert abs(sine.clean[0]) > 0.5 > 100.0 * abs(rich.clean[0])
    ratios = {
        (row.bandwidth, row.hold): row.ratio[0]
        for row in doubts.bandwidths
        if row.excitation == "multisine" and row.counts == 5e6
    }
    assert ratios[27.0, True] == pytest.approx(1.0, abs=1e-3)
    assert 1.03 < ratios[27.0, False] < 1.07
    raw = [row.ratio[0] for row in doubts.bandwidths if row.bandwidth is None and row.counts == 5e5]
    assert max(raw) < 0.2
