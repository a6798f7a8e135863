"""Tasks: coherent descriptions, the same bits for the same seed, floors that a true model reaches, judges, skips."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.tasks.base import TAGS, TASKS, Task, TaskData, load_tasks
from benchmarks.tasks.recording import NOISE, Experiment, Setting
from benchmarks.yardstick import METRICS, Examination
from envs.data_sets import ENVIRONMENT_VARIABLE
from envs.rigs import rig
from methods.base import Cause
from methods.least_squares import LeastSquares

load_tasks()


@pytest.mark.parametrize("name", TASKS.names())
def test_descriptions_are_coherent(name: str) -> None:
    task = TASKS[name].factory()
    assert isinstance(task, Task)
    assert task.name == name
    assert task.tags == TASKS[name].tags
    assert task.tags & set(TAGS)
    assert {1: "single", 2: "pair", 4: "arm"}[len(task.joints)] in task.tags
    assert 0.0 < task.horizons_seconds[0] < task.horizons_seconds[1] < task.horizons_seconds[2]
    assert all(item.metric in METRICS for item in task.published)


def test_every_kind_of_task_is_there() -> None:
    tags = {tag for entry in TASKS for tag in entry.tags}
    assert set(TAGS) <= tags
    assert {"friction", "drive", "transmission", "load", "sensor", "time-varying"} <= tags
    assert {f"noise-{level}" for level in NOISE} <= tags
    assert {f"joint{joint}_clean" for joint in (1, 2, 3, 4)} <= set(TASKS.names("single", "clean"))
    assert TASKS.names("real") == ("dfki_double_pendulum", "emps", "odrive_cogging", "xl330")


def same(one: TaskData, other: TaskData) -> bool:
    pairs = zip((*one.train, *one.held_out), (*other.train, *other.held_out), strict=True)
    return all(a.content_hash == b.content_hash for a, b in pairs)


@pytest.fixture(scope="module")
def clean() -> TaskData:
    return TASKS["joint1_clean"].factory().make(0)


def test_a_seed_gives_the_same_bits_and_another_seed_another_robot(clean: TaskData) -> None:
    task = TASKS["joint1_clean"].factory()
    again, other = task.make(0), task.make(1)
    assert same(clean, again)
    assert clean.truth is not None
    assert other.truth is not None
    assert clean.truth.parameters == again.truth.parameters  # type: ignore[union-attr]
    assert all(
        other.truth.parameters[name].value != item.value for name, item in clean.truth.parameters.items() if item.value
    )


def test_nothing_of_the_held_out_logs_is_shown(clean: TaskData) -> None:
    shown = {log.content_hash for log in clean.train}
    assert not shown & {log.content_hash for log in clean.held_out}
    names = {log.name for log in clean.train}
    assert all(name.startswith("train") for name in names)


def test_the_right_equation_comes_down_to_the_noise_floor(clean: TaskData) -> None:
    task = TASKS["joint1_clean"].factory()
    examination = Examination.of(task, clean)
    fit = LeastSquares().fit(clean.train, np.random.default_rng(0))
    errors = [
        (fit.model.inverse(item.signals.time, item.signals.motion) - item.signals.command)[item.scored]
        for item in examination.references
    ]
    floor = clean.floor
    assert floor is not None
    assert float(np.sqrt(np.mean(np.concatenate(errors) ** 2))) == pytest.approx(floor.inverse, rel=0.3)
    assert clean.truth is not None
    for name in ("acceleration", "velocity"):
        assert fit.estimates[name] == pytest.approx(clean.truth.parameters[name].value, rel=0.01)
        assert fit.estimates.units[fit.estimates.names.index(name)] == clean.truth.parameters[name].unit


def test_noise_raises_the_floor_and_a_payload_makes_the_arm_heavier() -> None:
    short = (Experiment("train", "multisine", duration=2.0),)
    floors = [Setting("probe", (1,), short, short, noise=level).make(0).floor for level in NOISE]
    values = [floor.inverse for floor in floors if floor is not None]
    assert values == sorted(values)
    assert values[2] > 5.0 * values[0]
    loaded = (Experiment("held-out", "multisine", duration=2.0, payload=5.0),)
    data = Setting("probe", (1,), short, loaded).make(0)
    inertias = [
        LeastSquares().fit([log], np.random.default_rng(0)).estimates["acceleration"]
        for log in (data.train[0], data.held_out[0])
    ]
    assert inertias[1] > 1.1 * inertias[0]


def test_a_real_machine_without_its_recordings_is_skipped_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: object
) -> None:
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, str(tmp_path))
    reason = TASKS["emps"].factory().skip()
    if rig("emps").available:
        pytest.skip("the recordings are in the user's cache")
    assert reason is not None
    assert "adeptone data fetch emps" in reason


@pytest.mark.skipif(not rig("emps").available, reason="no recordings on this machine")
def test_published_figures_stand_beside_real_machines() -> None:
    task = TASKS["emps"].factory()
    assert {item.metric for item in task.published} == {"inverse_error_relative", "simulation_error"}
    assert task.identity() == TASKS["emps"].factory().identity() != ""
    data = task.make(0)
    assert same(data, task.make(7))
    assert data.truth is None


@pytest.mark.parametrize(
    ("verdict", "named", "outcome", "points"),
    [
        ("named", ("cogging_torque",), "right", 1.0),
        ("named", ("backlash",), "wrong", 0.0),
        ("none", (), "missed", 0.0),
        ("unknown", (), "unsure", 0.5),
    ],
)
def test_a_naming_is_judged_by_the_rules_of_blind_trials(
    verdict: str, named: tuple[str, ...], outcome: str, points: float, trial: TaskData
) -> None:
    assert trial.judge is not None
    assert trial.truth is not None
    ((hidden, joint),) = trial.truth.effects
    causes = tuple(Cause(hidden if name == "cogging_torque" else name, joint) for name in named)
    assert trial.judge(verdict, causes) == (outcome, points)


@pytest.fixture(scope="module")
def trial() -> TaskData:
    """A trial whose hidden effect is not backlash."""
    make = TASKS["naming_single"].factory().make
    data = make(0)
    assert data.truth is not None
    return data if data.truth.effects[0][0] != "backlash" else make(1)


def test_suites_name_what_there_is() -> None:
    from benchmarks.suites import SUITES
    from methods.registry import METHODS

    for suite in SUITES.values():
        assert set(suite.tasks) <= set(TASKS.names())
        assert set(suite.methods) <= set(METHODS.names())
        assert len(suite.seeds) == len(set(suite.seeds)) > 0
    assert len(SUITES["everything"].tasks) >= 100  # other test files may have registered tasks and methods since
    tags = {tag for name in SUITES["full"].tasks for tag in TASKS[name].tags}
    assert tags >= {tag for name in TASKS.names() for tag in TASKS[name].tags} - {"naming", "noise-low", "noise-medium"}
    assert len(SUITES["full"].methods) >= 20
    kinds = {tag for name in SUITES["quick"].tasks for tag in TASKS[name].tags}
    assert {"single", "pair", "clean", "hidden", "noise", "second-world"} <= kinds
