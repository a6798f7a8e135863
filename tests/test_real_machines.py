"""The page on real machines: estimation in windows, harmonics by pursuit, the authors' models, outcomes, the page."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.real import __main__ as command
from benchmarks.real import bam
from benchmarks.real.odrive_cogging import pursue
from benchmarks.real.outcome import Outcome, Picture, Section, Table, rows
from benchmarks.real.page import cell, render, write
from benchmarks.real.robustness import Answer, judge
from benchmarks.real.windowed import Free, Model, errors, fit, free_of, ladder, rms, score, windows
from envs import data_sets
from envs.log import Array, JointFacts, Log

STEP = 2e-3
MASS, VISCOUS, DRY = 2.7, 5.8, 0.6


def slider(dry: float, seed: int, seconds: float = 6.0) -> Log:
    """A slider with dry friction under a multisine, integrated here with ten small steps per sample."""
    rng = np.random.default_rng(seed)
    time = np.asarray(STEP * np.arange(round(seconds / STEP)), dtype=np.float64)
    phases = rng.uniform(0.0, 2.0 * np.pi, 10)
    frequencies = np.linspace(0.4, 5.0, 10)
    waves = [0.6 * np.sin(2.0 * np.pi * f * time + p) for f, p in zip(frequencies, phases, strict=True)]
    volts = np.sum(waves, axis=0)
    position, x, v, h = np.zeros(len(time)), 0.0, 0.0, STEP / 10
    for k, u in enumerate(volts):
        position[k] = x
        for _ in range(10):
            stop = MASS * v / h + u - VISCOUS * v
            v += h * (u - VISCOUS * v - np.clip(stop, -dry, dry)) / MASS
            x += h * v
    facts = (JointFacts(position_unit="m", encoder_step=1e-9),)
    return Log(time, np.asarray(volts)[:, None], position[:, None], facts=facts, name=f"slider {seed}")


def nominal() -> Model:
    return Model.of((Free("nominal", "inertia", 2.0, lower=1e-3), Free("nominal", "viscous", 8.0, lower=0.0)))


@pytest.fixture(scope="module")
def logs() -> tuple[Log, Log]:
    return slider(DRY, 0), slider(DRY, 1)


def test_windows_begin_in_the_measured_state(logs: tuple[Log, Log]) -> None:
    problem = windows(logs[:1], (1,), 0.5)
    assert problem.logs == 12
    assert np.all(np.diff(problem.bounds) == 250)
    np.testing.assert_allclose(problem.starts[:, 0, 0], logs[0].position[::250, 0], atol=1e-5)
    whole = windows(logs[:1], (1,), None)
    assert whole.logs == 1
    with pytest.raises(ValueError, match="no log is as long"):
        windows(logs[:1], (1,), 60.0)


def test_free_simulation_finds_the_parameters(logs: tuple[Log, Log]) -> None:
    problem, other = (windows([log], (1,), 0.5) for log in logs)
    model = fit(problem, nominal().extended(free_of("coulomb_friction", [0.2])))
    for label, truth in (("inertia", MASS), ("viscous", VISCOUS), ("coulomb_friction.torque", DRY)):
        assert model.value(label) == pytest.approx(truth, rel=0.02)
        assert 0.0 < model.deviation(label) < 0.1 * truth
    assert score(other, model)[0] < 0.03 * score(other, fit(problem, nominal()))[0]
    np.testing.assert_allclose(rms(errors(other, model)[0]), score(other, model))


def test_the_ladder_takes_dry_friction_and_nothing_else(logs: tuple[Log, Log]) -> None:
    fitted, held_out = (windows([log], (1,), 0.5) for log in logs)
    candidates = [
        ("quadratic_drag", [free_of("quadratic_drag", [0.5])]),
        ("coulomb_friction", [free_of("coulomb_friction", [0.2])]),
        ("amplifier_offset", [free_of("amplifier_offset", [0.01])]),
    ]
    steps, tried = ladder(fitted, held_out, nominal(), candidates, least=0.2)
    assert [step.name for step in steps] == ["refitted", "+ coulomb_friction"]
    assert {name for where, name, _ in tried if where == "step 1"} == {name for name, _ in candidates}
    nothing = windows([slider(0.0, 3)], (1,), 0.5)
    assert [step.name for step in ladder(nothing, nothing, nominal(), candidates, least=0.2)[0]] == ["refitted"]


def test_orders_are_found_and_not_given() -> None:
    rng = np.random.default_rng(0)
    q = np.linspace(0.0, 2.0 * np.pi, 1500)
    truth = {7: (0.8, 0.3), 12: (0.3, -1.0), 84: (0.1, 2.0)}
    current = 0.2 + sum(a * np.sin(n * q + p) for n, (a, p) in truth.items()) + 0.02 * rng.standard_normal(len(q))
    found = pursue(q, np.ones((len(q), 1)), np.asarray(current, dtype=np.float64), 1)
    assert np.round(found.orders).astype(int).tolist() == list(truth)
    for order, amplitude, phase in zip(found.orders, found.amplitudes, found.phases, strict=True):
        a, p = truth[round(order)]
        assert order == pytest.approx(round(order), abs=0.05)
        assert amplitude == pytest.approx(a, rel=0.05)
        assert math.cos(phase - p) > 0.98
    assert found.rest[0] == pytest.approx(0.2, abs=0.01)
    assert len(pursue(q, np.ones((len(q), 1)), 0.02 * rng.standard_normal(len(q)), 1).orders) == 0


class TestAuthorsModels:
    """The servo's friction models against limits that can be worked out by hand."""

    @staticmethod
    def pendulum(start: float, volts: float = 0.0) -> tuple[object, Array]:
        time = np.asarray(1e-3 * np.arange(1500), dtype=np.float64)
        zero = np.zeros((len(time), 1))
        log = Log(time, zero + volts + 1e-12 * time[:, None], zero + start, facts=(JointFacts(),))
        return windows([log], (1,), None), time

    def test_without_friction_it_swings_as_a_pendulum(self) -> None:
        problem, time = self.pendulum(0.05)
        free = {"kt": 1e-6, "R": 1.0, "armature": 0.0}
        angle = 0.05 - bam.errors(problem, bam.Bam("m1", free).vector())[0]  # type: ignore[arg-type]
        np.testing.assert_allclose(angle, 0.05 * np.cos(math.sqrt(bam.GRAVITY / bam.LENGTH) * time), atol=2e-3)

    def test_dry_friction_above_the_weight_holds_it(self) -> None:
        problem, _ = self.pendulum(0.5)
        held = {"kt": 0.4, "R": 4.0, "armature": 0.002, "friction_base": 0.3}
        np.testing.assert_allclose(bam.errors(problem, bam.Bam("m1", held).vector())[0], 0.0, atol=1e-12)  # type: ignore[arg-type]

    def test_friction_grows_with_the_load(self) -> None:
        problem, _ = self.pendulum(0.0, volts=2.0)
        motor = {"kt": 0.4, "R": 4.0, "armature": 0.002}
        reach = [
            float(-bam.errors(problem, bam.Bam("m3", motor | {"load_friction_base": c}).vector())[0].min())  # type: ignore[arg-type]
            for c in (0.0, 0.3, 1.0)
        ]
        assert reach[0] > reach[1] > reach[2] == 0.0

    def test_every_model_is_a_case_of_the_richest(self) -> None:
        assert all(len(bam.Bam(name, dict.fromkeys(free, 0.1)).vector()) == 15 for name, free in bam.FREE.items())
        same = bam.Bam("m4", {"load_friction_base": 0.2, "load_friction_stribeck": 0.1}).vector()
        assert same[9:13].tolist() == [0.2, 0.2, 0.1, 0.1]


def example() -> Outcome:
    table = Table("errors", "Errors", ("model", "error"), rows([("a < b", np.float64(1.5)), ("c", np.nan)]))
    picture = Picture("bars", "Bars.", "<svg viewBox='0 0 1 1'></svg>")
    return Outcome(
        "emps", "A rig", ("Found.",), (Section("Part", ("Text & more.",), (picture,), (table,)),), {"x": 1.0}, key="k"
    )


def test_outcomes_survive_json_and_make_a_page(tmp_path: Path) -> None:
    before = example()
    assert Outcome.from_json(before.to_json()) == before
    absent = Outcome("xl330", "Another", failure="Run: uv run adeptone data fetch xl330")
    write([before, absent], tmp_path)
    page = (tmp_path / "index.html").read_text()
    assert "a &lt; b" in page
    assert "Text &amp; more." in page
    assert "<svg viewBox='0 0 1 1'>" in page
    assert "data fetch xl330" in page
    assert "http" not in page
    assert (tmp_path / "tables" / "emps_errors.csv").read_text().splitlines() == ["model,error", "a < b,1.5", "c,"]
    numbers = json.loads((tmp_path / "results.json").read_text())
    assert numbers["emps"]["tables"]["errors"]["rows"] == [["a < b", 1.5], ["c", None]]
    assert render([absent])


CELLS = [(None, "–"), (0.0, "0.00"), (-12.345, "−12.3"), (1234.5, "1234"), (1.2e-5, "1.20 × 10^−5"), ("m1", "m1")]


@pytest.mark.parametrize(("value", "shown"), CELLS)
def test_cells(value: object, shown: str) -> None:
    assert cell(value, 3) == shown


def test_one_rig_does_not_stop_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A rig that fails and a rig whose data are absent become lines on the page; what is kept is not done again."""
    import benchmarks.real.emps as emps

    calls = []

    def broken() -> Outcome:
        calls.append("emps")
        raise ArithmeticError("nothing converged")

    monkeypatch.setattr(emps, "run", broken)
    monkeypatch.setattr(data_sets, "available", lambda name: name == "emps")
    found = command.outcome("emps", tmp_path, again=False)
    assert found.failure == "It failed: ArithmeticError: nothing converged"
    assert "uv run adeptone data fetch xl330" in command.outcome("xl330", tmp_path, again=False).failure
    monkeypatch.setattr(emps, "run", example)
    kept = command.outcome("emps", tmp_path, again=False)
    monkeypatch.setattr(emps, "run", broken)
    assert command.outcome("emps", tmp_path, again=False) == kept
    assert calls == ["emps"]
    assert command.outcome("emps", tmp_path, again=True).failure


def test_judgements() -> None:
    sound = Answer("m", "as recorded", "named", ("coulomb_friction",))
    assert judge(sound, sound) == "reference"
    assert judge(Answer("m", "x", "named", ("coulomb_friction",)), sound) == "same"
    assert judge(Answer("m", "x", "refused", message="wrong"), sound) == "caught: refused"
    assert judge(Answer("m", "x", "named", ("backlash",)), sound) == "WRONG"
    assert judge(Answer("m", "x", "unknown", ("backlash",)), sound) == "not confident"
    assert judge(Answer("m", "x", "crashed", message="LinAlgError"), sound) == "CRASHED"
    other = Answer("xl330", "as recorded", "unknown", ("supply_sag",))
    assert judge(Answer("xl330", "x", "named", ("load_dependent_friction",)), other) == "same names, other verdict"
    said = Answer("m", "x", "named", ("backlash",), findings=("log: wrong gear ratio?",))
    assert judge(said, sound) == "caught: said"
