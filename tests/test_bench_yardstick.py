"""The yardstick against answers whose errors are known beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.tasks.base import Floor, Parameter, Task, TaskData, Truth
from benchmarks.worker import Answers, count_numbers
from benchmarks.yardstick import METRICS, Examination, Reference, score, unanswered
from envs.adeptone import adeptone
from envs.log import JointFacts, Log
from methods.base import Cause

RATE = 500.0
TIME = np.arange(3000) / RATE


def make_task(joints: tuple[int, ...] = (1,)) -> Task:
    return Task("t", "t", frozenset({"single"}), joints, make=lambda seed: TaskData((), ()))


def examine(joints: tuple[int, ...] = (1,), units: tuple[str, ...] = ("rad",), **more: object) -> Examination:
    position = np.stack([np.sin(2 * np.pi * (0.5 + 0.3 * k) * TIME) for k in range(len(joints))], axis=1)
    command = np.stack([3.0 * np.cos(2 * np.pi * (0.5 + 0.3 * k) * TIME) for k in range(len(joints))], axis=1)
    facts = tuple(JointFacts(position_unit=unit, hold="first_order") for unit in units)  # type: ignore[arg-type]
    log = Log(TIME, command, position, joints=joints, facts=facts)
    return Examination.of(make_task(joints), TaskData((), (log,), **more))  # type: ignore[arg-type]


def perfect(examination: Examination) -> Answers:
    reference = examination.references[0]
    runs = tuple(reference.signals.motion.position[part.start : part.stop] for part in all_runs(examination))
    return Answers(simulations=runs, inverses=(reference.signals.command.copy(),))


def all_runs(examination: Examination):
    return (*examination.whole, *examination.windows)


def shifted(answers: Answers, command: np.ndarray, position: np.ndarray) -> Answers:
    assert answers.simulations is not None
    assert answers.inverses is not None
    return Answers(
        simulations=tuple(run + position for run in answers.simulations),
        inverses=tuple(item + command for item in answers.inverses),
    )


def test_perfect_answers_have_no_error() -> None:
    examination = examine(floor=Floor(0.1, 0.2))
    row = score(examination, perfect(examination))
    for name in METRICS:
        if "error" in name and name not in ("tip_error", "parameter_error"):
            assert row[name] == 0.0, name
    assert row["curve"] == [0.0] * len(row["curve_horizons"])
    assert (row["noise_floor_inverse"], row["noise_floor_simulation"]) == (0.1, 0.2)
    assert (row["command_unit"], row["position_unit"]) == ("V", "rad")
    assert set(row) == set(unanswered())


def test_constant_errors_come_back_as_they_are() -> None:
    examination = examine()
    row = score(examination, shifted(perfect(examination), np.array([0.5]), np.array([-0.02])))
    for name in ("inverse_error", "inverse_error_reversals", "inverse_error_elsewhere"):
        assert row[name] == pytest.approx(0.5)
    for name in ("simulation_error", "simulation_error_short", "simulation_error_medium", "simulation_error_long"):
        assert row[name] == pytest.approx(0.02)
    # 3 V of a cosine have an rms of 3 / sqrt(2) V over whole periods
    assert row["inverse_error_relative"] == pytest.approx(0.5 / (3.0 / np.sqrt(2.0)), rel=0.05)
    assert row["simulation_error_relative"] == pytest.approx(0.02 / (1.0 / np.sqrt(2.0)), rel=0.05)


def test_an_error_at_reversals_is_told_from_one_elsewhere() -> None:
    examination = examine()
    reference = examination.references[0]
    speed = np.abs(reference.signals.motion.velocity)
    slow = speed < 0.1 * np.sqrt(np.mean(speed[reference.scored] ** 2))
    answers = perfect(examination)
    assert answers.inverses is not None
    row = score(examination, Answers(inverses=(answers.inverses[0] + 0.3 * slow,)))
    assert row["inverse_error_reversals"] == pytest.approx(0.3)
    assert row["inverse_error_elsewhere"] == 0.0
    assert np.isnan(row["simulation_error"])


def test_the_curve_is_the_error_at_that_instant() -> None:
    examination = examine()
    answers = perfect(examination)
    assert answers.simulations is not None
    drifting = tuple(run + 0.1 * (np.arange(len(run)) / RATE)[:, None] for run in answers.simulations)
    row = score(examination, Answers(simulations=drifting))
    expected = 0.1 * np.array(row["curve_horizons"])
    assert row["curve"] == pytest.approx(expected.tolist(), abs=0.1 * 0.51 / RATE)  # to the nearest sample
    assert row["simulation_error_long"] == pytest.approx(0.1 * examination.task.horizons_seconds[2])


def test_no_answer_is_an_infinite_error_and_only_where_it_is_scored() -> None:
    examination = examine()
    answers = perfect(examination)
    assert answers.inverses is not None
    assert answers.simulations is not None
    outside, inside = answers.inverses[0].copy(), answers.inverses[0].copy()
    outside[0], inside[len(inside) // 2] = np.nan, np.nan
    assert score(examination, Answers(inverses=(outside,)))["inverse_error"] == 0.0
    assert score(examination, Answers(inverses=(inside,)))["inverse_error"] == np.inf
    lost = (np.full_like(answers.simulations[0], np.nan), *answers.simulations[1:])
    row = score(examination, Answers(simulations=lost))
    assert row["simulation_error"] == np.inf
    assert row["simulation_error_long"] == 0.0


def test_errors_with_a_unit_are_those_of_the_rotary_joints() -> None:
    examination = examine((1, 3), ("rad", "m"))
    row = score(examination, shifted(perfect(examination), np.array([0.1, 0.9]), np.array([0.01, 0.05])))
    assert row["simulation_error"] == pytest.approx(0.01)
    assert row["inverse_error"] == pytest.approx(0.1)
    assert row["simulation_error_by_joint"] == pytest.approx([0.01, 0.05])
    assert row["position_unit"] == "rad"


def test_the_tip_moves_by_the_reach_of_the_arm() -> None:
    body = adeptone().body
    examination = examine((1, 2), ("rad", "rad"), kinematics=body)
    row = score(examination, shifted(perfect(examination), np.zeros(2), np.array([1e-3, 0.0])))
    l1, l2 = body.link_1.length.value, body.link_2.length.value  # type: ignore[attr-defined]
    assert abs(l1 - l2) * 1e-3 < row["tip_error"] < (l1 + l2) * 1e-3
    assert np.isnan(score(examine(), perfect(examine()))["tip_error"])


def test_parameters_count_by_name_and_unit() -> None:
    known = {"inertia": Parameter(2.0, "kg"), "friction": Parameter(10.0, "N"), "nothing": Parameter(0.0, "N")}
    examination = examine(truth=Truth(known))
    estimates = {
        ("inertia", "kg"): (2.2, 0.01),  # ten per cent off, interval far too short
        ("friction", "N"): (10.3, 1.0),  # three per cent off, inside
        ("nothing", "N"): (5.0, 1.0),  # a truth of zero has no relative error
        ("friction", "V"): (99.0, 1.0),  # another quantity
    }
    row = score(examination, Answers(estimates=estimates))
    assert row["parameter_error"] == pytest.approx(np.median([0.1, 0.03]))
    assert row["interval_coverage"] == 0.5
    vague = score(examination, Answers(estimates={("inertia", "kg"): (2.0, float("nan"))}))
    assert vague["parameter_error"] == 0.0
    assert np.isnan(vague["interval_coverage"])


def test_a_naming_is_judged_where_the_task_has_a_judge() -> None:
    causes = (Cause("backlash", 2), Cause("coulomb_friction", 1))
    examination = examine(judge=lambda verdict, causes: (f"{verdict} {len(causes)}", 0.5))
    row = score(examination, Answers(causes=causes, verdict="named"))
    assert row["named"] == "backlash@2+coulomb_friction@1"
    assert (row["naming_outcome"], row["naming"]) == ("named 2", 0.5)
    assert np.isnan(score(examine(), Answers(causes=causes))["naming"])


def test_the_reference_leaves_out_both_ends() -> None:
    reference = examine().references[0]
    first, last = reference.signals.time[[reference.first, reference.last - 1]]
    margin = make_task().initialisation_seconds
    assert first >= TIME[0] + margin
    assert last <= TIME[-1] - margin
    assert first - TIME[0] - margin < 2.0 / RATE


def test_a_resampled_reference_takes_the_command_in_force() -> None:
    stamps = TIME + 2e-4 * np.sin(40.0 * TIME)
    log = Log(stamps, np.floor(10.0 * stamps), np.sin(stamps))
    reference = Reference.of(log, make_task())
    latest = np.searchsorted(stamps, reference.signals.time, side="right") - 1
    assert np.array_equal(reference.command[:, 0], np.floor(10.0 * stamps)[latest])


def test_numbers_of_a_model_are_counted_once() -> None:
    weights = np.ones((3, 4))
    assert count_numbers({"a": weights, "b": weights, "c": (1.5, 2, "x", None)}) == 13
