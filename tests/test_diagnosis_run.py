"""The diagnosis from files to files: contract, gain, extended model in MuJoCo, ledger, what cannot be used."""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import mujoco
import numba
import numpy as np
import pytest
from scipy.signal import lfilter

import adeptone
from diagnosis import ledger
from diagnosis.beginning import started, with_phases
from diagnosis.engine import find
from diagnosis.estimation import Point, covariance, errors, fit, predicted_motion, undetermined
from diagnosis.finding import Finding
from diagnosis.hypotheses import Hypothesis, extend
from diagnosis.ledger import closed, failures, floor_of, grown
from diagnosis.nominal import COLUMN, Gravity, JointStructure, fit_nominal
from diagnosis.output import as_dict, to_json
from diagnosis.parameters import HEAT, REFERENCE, JointUnits, canonical, effect_parameters, heat
from diagnosis.planar_arm import in_commands, planar_pair
from diagnosis.preparation import (
    DiagnosisError,
    Recordings,
    arrange,
    gathered,
    given_numbers,
    groups,
    moving_joints,
    recordings,
    shared_sidecar,
    structure,
)
from diagnosis.problem import DIVERGED, Problem, stack
from diagnosis.replay import WINDOW, Replay, replay, rms, transfer
from diagnosis.result import (
    Diagnosis,
    Estimate,
    Evidence,
    Failure,
    NamedEffect,
    NominalParameter,
    ParameterEstimate,
)
from diagnosis.run import (
    Solved,
    applying,
    arm_said,
    check_turns,
    constants_said,
    diagnose,
    doubts,
    is_dated,
    is_determined,
    joint_title,
    louder_said,
    open_law_said,
    scale_said,
    solve,
    together_said,
)
from diagnosis.settings import Settings
from envs.adeptone import adeptone as adept_robot
from envs.excitation import parse
from envs.log import Array, InputKind, JointFacts, Log
from envs.log_files import load, save
from envs.plant.plant import record
from envs.robot import Quantity
from methods.base import State
from methods.effects import built_in
from methods.effects.base import Effect
from methods.kernel import build
from methods.structured import PlanarCoupling, StructuredJoint, StructuredModel
from methods.two_layer_network import TWO_SIGNALS, TwoLayerNetwork

DT = 2e-3
STEP = 1e-5
NOMINAL = {"inertia": 0.07, "viscous": 0.02, "back_emf": 0.7, "electrical_time_constant": 0.01}
FRICTION = {"coulomb_friction": {"torque": 0.06}}


def model_of(effects: dict[str, dict[str, float]], **others: object) -> StructuredModel:
    return StructuredModel((StructuredJoint(1, "voltage", NOMINAL, effects, **others),), DT)  # type: ignore[arg-type]


def recorded(
    model: StructuredModel, seed: int, seconds: float = 8.0, amplitude: float = 1.5, noise: float = 0.0
) -> Log:
    """A log of the model under a multisine, encoder steps included. noise: rms of what the amplifier adds to the
    command unlogged, correlated over 20 ms."""
    time = DT * np.arange(round(seconds / DT))
    rng = np.random.default_rng(seed)
    joints = model.joints
    command = np.column_stack(
        [
            parse(f"multisine:amplitude={amplitude},band=0.3-12,period=4,joints=1").sample(time, rng)[:, 0]
            for _ in joints
        ]
    )
    pole = np.exp(-DT / 0.02)
    added = noise * np.sqrt(1.0 - pole**2) * lfilter([1.0], [1.0, -pole], rng.standard_normal(command.shape), axis=0)
    position = model.simulate(time, command + added, State.at_rest(np.zeros(len(joints)))).position
    return Log(
        time=time,
        command=command,
        position=STEP * np.round(position / STEP),
        joints=joints,
        facts=tuple(JointFacts(encoder_step=STEP) for _ in joints),
        name=f"log_{seed}",
    )


def read_of(model: StructuredModel) -> Recordings:
    return arrange([recorded(model, 1), recorded(model, 2)], [recorded(model, 3)], None)


def effects_of(*names: str) -> list:
    return [effect for effect in built_in() if effect.name in names]


def solved_of(read: Recordings, *names: str) -> Solved:
    return solve(
        read,
        (1,),
        (structure(read.fitted[0], 1, read.robot),),
        effects_of(*names),
        Settings(limit=1),
        lambda text: None,
        {},
    )


@pytest.mark.parametrize(("command", "sags"), [("voltage", True), ("current", False), ("torque", False)])
def test_a_drive_that_controls_current_makes_up_for_its_supply(command: InputKind, sags: bool) -> None:
    effects = effects_of("supply_sag", "supply_sag_by_duty", "torque_constant_saturation")
    names = {effect.name for effect in applying(effects, [JointStructure(input=command)])}
    assert names == {"torque_constant_saturation"} | ({"supply_sag", "supply_sag_by_duty"} if sags else set())


@pytest.fixture(scope="module")
def with_friction() -> tuple[Recordings, Diagnosis, StructuredModel, object]:
    read = read_of(model_of(FRICTION))
    return read, *diagnose(read, effects=effects_of("coulomb_friction", "dead_zone", "cable_spring"))


def test_a_diagnosis_is_the_same_bit_by_bit_with_any_number_of_threads(
    with_friction: tuple[Recordings, Diagnosis, StructuredModel, object],
) -> None:
    read, *_ = with_friction
    before, found = numba.get_num_threads(), []
    for threads in (1, numba.config.NUMBA_NUM_THREADS):
        numba.set_num_threads(threads)
        try:
            diagnosis, model, _ = diagnose(read, effects=effects_of("coulomb_friction", "dead_zone", "cable_spring"))
        finally:
            numba.set_num_threads(before)
        data = as_dict(diagnosis)
        del data["provenance"]["seconds"]
        for row in data["ledger"]:
            del row["microseconds"]
        found.append((data, model.to_json()))
    assert found[0] == found[1]


# ------------------------------------------------------------------------------------------------------ files to files


def run(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["adeptone", *arguments])
    with pytest.raises(SystemExit) as caught:
        adeptone.main()
    return int(caught.value.code or 0)


@pytest.fixture(scope="module")
def plant_logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Joint 1 of the plant with 7 N m of Coulomb friction, written as files."""
    folder = tmp_path_factory.mktemp("logs")
    paths = []
    for seed in range(3):
        recording = record(
            adept_robot(),
            ["coulomb_friction=7"],
            "multisine:amplitude=0.9,band=0.3-10,period=6",
            duration=6.0,
            rate=500.0,
            seed=seed,
            name=f"log_{seed}",
        )
        paths.append(recording.save(folder / f"log_{seed}.csv"))
    return paths


def test_command_line_keeps_the_contract(
    plant_logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "deep" / "result"
    train, holdout = [str(path) for path in plant_logs[:2]], str(plant_logs[2])
    assert run("diagnose", *train, "--holdout", holdout, "--out", str(out), monkeypatch=monkeypatch) == 0
    assert {path.name for path in out.iterdir()} == {
        "diagnosis.json",
        "report.html",
        "extended_model.json",
        "extended_model.xml",
    }
    found = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    assert set(found) >= {
        "verdict", "effects", "gap", "ledger", "remainder", "next_experiment", "provenance", "isolability",
    }  # fmt: skip
    assert found["verdict"] in ("none", "named", "ambiguous", "unknown")
    named = {effect["name"]: effect for effect in found["effects"]}
    assert "coulomb_friction" in named
    torque = named["coulomb_friction"]["parameters"]["torque"]
    assert torque["unit"] == "N m"
    assert torque["value"] == pytest.approx(7.0, rel=0.02)
    equivalent = torque["input_equivalent"]
    assert equivalent["unit"] == "V"
    assert equivalent["value"] == pytest.approx(torque["value"] * adept_robot().input_equivalent(1), rel=1e-9)
    gap = found["gap"]
    assert gap["on"] == "held-out"
    assert gap["after"] < 0.1 * gap["before"]
    assert gap["interval"][0] <= gap["closed"] <= gap["interval"][1]
    assert [row["step"] for row in found["ledger"]][:2] == ["nominal as given", "refit nominal parameters"]
    assert found["provenance"]["logs"][0]["sha256"] == load(plant_logs[0]).content_hash
    assert found["provenance"]["robot_sha256"] == adept_robot().content_hash
    printed = capsys.readouterr().out
    assert " ".join(printed.split()).startswith(found["sentence"])
    mujoco.MjModel.from_xml_path(str(out / "extended_model.xml"))
    StructuredModel.from_json((out / "extended_model.json").read_text())


def test_unusable_input_is_one_line_and_nothing_is_written(
    plant_logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log, other = str(plant_logs[0]), str(plant_logs[1])
    taken = tmp_path / "file"
    taken.write_text("mine")
    cases = [
        ([str(tmp_path / "none.csv")], "there is no such file"),
        ([log, "--holdout", log], "is also fitted"),
        ([log, log, "--holdout", other], "is given twice"),
        ([log, "--holdout", other, "--joint", "3"], "not joint 3"),
        ([log, "--holdout", other, "--robot", "emsp"], "did you mean emps"),
    ]
    for arguments, complaint in cases:
        assert run("diagnose", *arguments, "--out", str(tmp_path / "out"), monkeypatch=monkeypatch) == 2
        error = capsys.readouterr().err
        assert complaint in error
        assert error.strip().count("\n") == 0
    assert run("diagnose", log, "--out", str(taken), monkeypatch=monkeypatch) == 2
    assert taken.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [taken]


def test_what_is_said_of_many_logs_is_said_once() -> None:
    jitters = [(f"run_{i}", f"time stamps jitter by 0.1{i} ms rms") for i in range(3)]
    ranges = [("run_0", "joint 1 stays within 3 steps"), ("run_1", "joint 2 stays within 3 steps")]
    spikes = [("run_0", "2 spikes"), ("run_0", "4 spikes"), ("run_1", "2 spikes")]
    same = [(f"run_{i}", "no gaps") for i in range(4)]
    assert gathered([*jitters, *ranges, *spikes, *same]) == [
        "run_0 and 2 other logs: time stamps jitter by 0.10 ms rms (figures of run_0)",
        *(f"{name}: {text}" for name, text in (*ranges, *spikes)),
        "run_0 and 3 other logs: no gaps",
    ]


def test_a_quarter_is_kept_apart_without_held_out_logs() -> None:
    logs = [recorded(model_of({}), seed) for seed in (1, 2)]
    read = arrange(logs, [], None)
    assert [len(log) for log in read.fitted] == [3000, 3000]
    assert [len(log) for log in read.held_out] == [1000, 1000]
    assert "quarter" in read.on
    assert any("kept apart" in finding for finding in read.findings)
    with pytest.raises(DiagnosisError, match="cannot be divided"):
        arrange([logs[0].slice(0, 300)], [], None)


def without_rows(log: Log, *spans: tuple[int, int]) -> Log:
    """The log without some rows, a..b-1."""
    lost = np.concatenate([np.arange(a, b) for a, b in spans])
    return replace(
        log, **{name: np.delete(getattr(log, name), lost, axis=0) for name in ("time", "command", "position")}
    )


def test_what_lies_between_long_gaps_are_logs_of_their_own() -> None:
    log = recorded(model_of({}), 1)
    other = replace(without_rows(recorded(model_of({}), 2), (1000, 1300), (1350, 1400), (2000, 2003)), name="gappy")
    read = arrange([log, other], [], None)
    assert [len(part) for part in read.fitted] == [3000, 750, 1947]
    assert [len(part) for part in read.held_out] == [1000, 250, 650]
    assert any("gappy" in said and "2 separate parts; 50 samples" in said for said in read.findings)
    held = other.position.copy()
    held[1050:] = held[1050]
    still = arrange([log], [replace(other, position=held)], None)
    assert [len(part) for part in still.held_out] == [len(other)]
    short = without_rows(log.slice(0, 1600), *((i, i + 50) for i in range(50, 1600, 100)))
    assert arrange([short], [log], None).fitted == (short,)


def test_a_gap_does_not_spoil_a_diagnosis() -> None:
    """Over it no model goes on."""
    model = model_of({"coulomb_friction": {"torque": 0.2}})
    wanted = [effect for effect in built_in() if effect.name in ("coulomb_friction", "periodic_disturbance")]
    gappy = without_rows(recorded(model, 2), (1500, 2100))
    found, *_ = diagnose(arrange([recorded(model, 1), gappy], [recorded(model, 3)], None), effects=wanted)
    (effect,) = found.joints[0].effects
    assert found.verdict == "named"
    assert effect.name == "coulomb_friction"
    assert effect.parameters[0].physical.value == pytest.approx(0.2, rel=0.002)


# -------------------------------------------------------------------------------------------------------------- joints


def test_held_joints_are_skipped_and_said() -> None:
    log = recorded(model_of({}), 1)
    two = replace(
        log,
        joints=(1, 2),
        command=np.hstack([log.command, log.command]),
        position=np.hstack([log.position, 0.3 + 0.0 * log.position]),
        facts=log.facts * 2,
    )
    said: list[str] = []
    assert moving_joints([two], None, said) == (1,)
    assert said == ["joint 2 is held still in log_1 and is skipped"]
    passive = replace(
        two,
        command=np.hstack([log.command, 0.0 * log.command]),
        position=np.hstack([log.position, 0.3 * log.position]),
    )
    assert moving_joints([passive], None, said) == (1,)
    assert said[1] == "joint 2 moves without a command in log_1 and is skipped"


def test_a_command_that_stays_the_same_drives_a_joint() -> None:
    log = recorded(model_of({}), 1)
    assert moving_joints([replace(log, command=np.full_like(log.command, 2.0))], None, []) == (1,)


def test_planar_pair_is_recognised_in_the_logs() -> None:
    second = StructuredJoint(2, "voltage", {"inertia": 0.02, "viscous": 0.01, "back_emf": 0.4}, {})
    first = StructuredJoint(1, "voltage", {**NOMINAL, "electrical_time_constant": 0.0}, {})
    pair = recorded(
        StructuredModel((first, second), DT, PlanarCoupling(0.025, 1.2, second.nominal["inertia"] / 1.2)), 1
    )
    apart = recorded(StructuredModel((first, second), DT), 1)
    kinds = lambda log, robot=None: [  # noqa: E731
        (joints, [item.gravity for item in structures])
        for joints, structures in groups([log], (1, 2), robot, built_in())
    ]
    assert kinds(pair) == [((1, 2), ["none", "none"])]
    assert kinds(apart) == [((1,), ["none"]), ((2,), ["none"])]
    assert kinds(apart, adept_robot()) == [((1, 2), ["none", "none"])]
    hanging = [
        replace(part, nominal={**part.nominal, "gravity_sine": size}) for part, size in ((first, 0.8), (second, 0.2))
    ]
    coupling = PlanarCoupling(0.025, 1.2, second.nominal["inertia"] / 1.2)
    heavy = recorded(StructuredModel(tuple(hanging), DT, coupling), 1)
    assert kinds(heavy) == [((1, 2), ["pendulum", "pendulum"])]


@pytest.mark.parametrize("friction", [pytest.param(0.0, marks=pytest.mark.slow), 0.1])
def test_planar_pair_is_recognised_behind_noise(friction: float) -> None:
    """In the derivatives of such readings the coupling cannot be seen; predictions tell it, with friction or not."""
    effects = {"coulomb_friction": {"torque": friction}} if friction else {}
    first = StructuredJoint(1, "voltage", {**NOMINAL, "electrical_time_constant": 0.0}, effects)
    second = StructuredJoint(2, "voltage", {"inertia": 0.02, "viscous": 0.01, "back_emf": 0.4}, effects)
    for coupling, kind in ((PlanarCoupling(0.025, 1.2, 0.02 / 1.2), "none"), (None, None)):
        log = recorded(StructuredModel((first, second), DT, coupling), 1)
        noise = 2e-3 * np.random.default_rng(0).standard_normal(log.position.shape)
        noisy = replace(log, position=log.position + noise)
        assert not in_commands(noisy, 1, 2)[0]
        structures = structure(noisy, 1, None), structure(noisy, 2, None)
        assert planar_pair([noisy], (1, 2), structures, built_in()) == kind


def test_an_arm_that_only_the_logs_show_is_said() -> None:
    logs = Recordings((), (), "", None, ())
    plain = JointStructure()
    assert arm_said(logs, (1,), (plain,)) == ""
    assert "joint 1, 2: the logs show a planar arm, the second link on the first; " in arm_said(
        logs, (1, 2), (plain,) * 2
    )
    heavy = replace(plain, gravity="pendulum")
    assert ", with its weight; " in arm_said(logs, (1, 2), (heavy,) * 2)
    assert arm_said(replace(logs, robot=adept_robot()), (1, 2), (plain,) * 2) == ""


def test_what_the_robot_says_of_a_joint() -> None:
    log = recorded(model_of({}), 1)
    robot = adept_robot()
    drive = robot.joint(1).drive
    known = structure(log, 1, robot)
    assert (known.input, known.gravity, known.electrical) == ("voltage", "none", True)
    assert known.electrical_time_constant == pytest.approx(drive.inductance.value / drive.resistance.value)
    assert structure(replace(log, joints=(3,)), 3, robot).gravity == "constant"
    numbers = given_numbers(robot, 1, log)
    # u = k q' at constant speed without friction: back-EMF over the amplifier's gain
    assert numbers["back_emf"] == pytest.approx(drive.torque_constant / drive.amplifier_gain.value)
    assert known.damping == pytest.approx(numbers["viscous"] + numbers["back_emf"])
    unknown = structure(log, 1, None)
    assert (unknown.gravity, unknown.torque_limit) == ("none", 0.0)
    # ten times the inertia: of this robot no number is known
    assert structure(replace(log, position=0.1 * log.position), 1, robot) == replace(unknown, gravity="none")


# ---------------------------------------------------------------------------------------------------------------- gain


def test_ledger_shows_the_gain(with_friction: tuple) -> None:
    _, diagnosis, _, _ = with_friction
    assert [effect.name for effect in diagnosis.effects] == ["coulomb_friction"]
    rows = {row.step: row for row in diagnosis.ledger}
    before, after = rows["refit nominal parameters"], rows["+ coulomb_friction"]
    assert after.window_error < 0.02 * before.window_error
    assert after.inverse_error < 0.2 * before.inverse_error
    assert after.interval[0] <= after.window_error <= after.interval[1]
    assert before.closed == 0.0
    assert after.closed > 0.98
    assert rows["+ compensator"].note
    assert rows["least squares"].window_error > 10 * after.window_error
    assert 0.0 < after.microseconds < 1000.0
    gap = diagnosis.gaps[0]
    # nothing but the encoder's steps is left: the floor is of their size
    assert 0.1 * STEP < gap.noise_floor < 10 * STEP
    assert gap.after < 5 * gap.noise_floor


def test_effect_and_misattribution(with_friction: tuple) -> None:
    _, diagnosis, _, _ = with_friction
    torque = diagnosis.effects[0].parameters[0]
    assert torque.input_equivalent.unit == torque.physical.unit == "V"
    assert abs(torque.physical.value - 0.06) < max(5 * torque.physical.std, 1e-4)
    damping = next(p for p in diagnosis.joints[0].nominal if p.name == "damping")
    # friction left out has been taken for damping, which is too high then
    assert damping.shift > 0.01
    assert damping.final.value == pytest.approx(0.72, rel=0.01)


def test_json_has_no_numbers_that_json_lacks(with_friction: tuple) -> None:
    _, diagnosis, _, _ = with_friction
    text = to_json(diagnosis)
    assert "NaN" not in text
    assert "Infinity" not in text
    assert json.loads(text)["effects"][0]["evidence"]["net"] > 12.0


def test_share_of_the_gap() -> None:
    assert closed(1.0, 5.0, 1.0) == 1.0
    assert closed(3.0, 5.0, 1.0) == 0.5
    assert closed(1.0, 1.02, 1.0) is None


def test_phase_of_a_disturbance_is_that_of_the_held_out_log() -> None:
    def disturbed(phase: float) -> StructuredModel:
        values = {"sine": 0.1 * np.cos(phase), "cosine": 0.1 * np.sin(phase), "frequency": 2.3}
        return model_of({"periodic_disturbance": values})

    (effect,) = effects_of("periodic_disturbance")
    kernel = build(built_in())
    problem = stack(kernel, [recorded(disturbed(0.4), 1)], (1,))
    nominal = fit_nominal(problem, (JointStructure(),))
    point = extend(problem, nominal.point, Hypothesis(effect, 0), np.array([[0.08, 0.03, 2.3]]))
    final = fit(problem, point)
    shifted = stack(kernel, [recorded(disturbed(2.4), 5)], (1,))
    plain = transfer(shifted, final.point)
    right = with_phases(shifted, plain, final.whitener)
    assert rms(replay(shifted, right).windows) < 0.02 * rms(replay(shifted, plain).windows)


@pytest.mark.slow
def test_phase_of_a_disturbance_is_not_that_of_a_badly_known_velocity_at_the_beginning() -> None:
    """A joint with little friction remembers for seconds what a coarse encoder has shown of its first velocity."""
    parameters = {"inertia": 0.07, "viscous": 0.005, "back_emf": 0.0, "electrical_time_constant": 0.0}

    def disturbed(phase: float) -> StructuredModel:
        values = {"sine": 0.02 * np.cos(phase), "cosine": 0.02 * np.sin(phase), "frequency": 2.3}
        joint = StructuredJoint(1, "torque", parameters, {"periodic_disturbance": values})
        return StructuredModel((joint,), DT, None, effects_of("periodic_disturbance"))

    def coarse(phase: float, seed: int) -> Log:
        log = recorded(disturbed(phase), seed, 16.0)
        return replace(log, position=1e-3 * np.round(log.position / 1e-3), facts=(JointFacts(encoder_step=1e-3),))

    kernel = build(built_in())
    problem, held_out = (stack(kernel, [coarse(p, s)], (1,)) for p, s in ((0.4, 1), (2.4, 5)))
    nominal = fit_nominal(problem, (JointStructure(input="torque"),))
    (effect,) = effects_of("periodic_disturbance")
    final = fit(problem, extend(problem, nominal.point, Hypothesis(effect, 0), np.array([[0.015, 0.01, 2.3]])))
    wrong = held_out.starts + np.array([0.0, 0.5 * np.std(held_out.velocity), 0.0, 0.0, 0.0, 0.0])
    held_out = replace(held_out, starts=wrong)
    found = with_phases(held_out, transfer(held_out, final.point), final.whitener)
    sine, cosine, _ = found.parameters[0, 0, kernel.own(effect)]
    assert np.arctan2(cosine, sine) == pytest.approx(2.4, abs=0.05)


def test_velocities_at_the_beginning_of_other_logs_are_what_their_readings_tell() -> None:
    kernel = build(built_in())
    problem, held_out = (stack(kernel, [recorded(model_of(FRICTION), seed)], (1,)) for seed in (1, 5))
    nominal = fit_nominal(problem, (JointStructure(),))
    point = extend(problem, nominal.point, Hypothesis(effects_of("coulomb_friction")[0], 0), np.array([[0.06]]))
    final = fit(problem, point)
    error = 0.04 * np.max(np.abs(held_out.velocity))
    wrong = replace(held_out, starts=held_out.starts + np.array([0.0, error, 0.0, 0.0, 0.0, 0.0]))
    found = started(wrong, final.point, final.whitener)
    assert abs(found.starts[0, 0, 1]) < 0.02 * error  # it began at rest
    before, after = (rms(error[:100]) for error in errors(wrong, [transfer(wrong, final.point), found]))
    assert after < 0.1 * before


# ------------------------------------------------------------------------------------------ parameters and their spread


def test_canonical_parameters() -> None:
    known = {effect.name: effect for effect in built_in()}
    wave = canonical(known["gravity_tilt"]).change({"sine": 0.3, "cosine": 0.4})
    angle = np.linspace(0.0, 6.0, 50)
    np.testing.assert_allclose(
        wave["torque"] * np.sin(angle + wave["phase"]), 0.3 * np.sin(angle) + 0.4 * np.cos(angle), atol=1e-12
    )
    static = canonical(known["stribeck_friction"]).change(
        {"torque": 0.3, "excess": 0.2, "velocity": 0.1, "exponent": 2.0}
    )
    assert static["static_torque"] == pytest.approx(0.5)
    blended = canonical(known["rounded_stribeck_friction"])
    values = {"torque": 0.3, "excess": 0.2, "velocity": 0.1, "exponent": 2.0, "rounding": 0.01}
    assert blended.change(values) == pytest.approx({**static, "exponent": 2.0, "rounding": 0.01})
    assert list(blended.dimensions) == ["torque", "static_torque", "velocity", "exponent", "rounding"]
    assert list(canonical(known["tailed_stribeck_friction"]).dimensions)[3:] == ["exponent", "tail"]
    assert canonical(known["backlash_power"]).dimensions["exponent"] == "ratio"
    spring = canonical(known["cable_spring"]).change({"stiffness": 0.5, "pull": 0.1})
    assert spring["rest_angle"] == pytest.approx(0.2)


@pytest.mark.parametrize("feedback", [0.0, 1.0])
def test_the_rise_of_the_resistance_is_that_at_the_current_of_the_logs(feedback: float) -> None:
    """Where it stands in the end: ``rise = h r (1 + s rise) / (1 + s r)`` at h times the losses that r refers to."""
    known = {effect.name: effect for effect in built_in()}
    own = canonical(known["thermal_drift_copper" if feedback else "thermal_drift"])
    rise = own.change({"resistance_rise": 0.4, "time_constant": 9.0, "feedback": feedback, HEAT: 0.7})
    balance = 0.7 * 0.4 * (1.0 + feedback * rise["resistance_rise"]) / (1.0 + feedback * 0.4)
    assert rise["resistance_rise"] == pytest.approx(balance)
    assert rise["time_constant"] == 9.0


def test_heat_is_the_mean_square_of_the_final_motor_torque() -> None:
    """Warm, a motor takes less current from the same voltage."""
    drift = {"thermal_drift": {"resistance_rise": 0.5, "time_constant": 1.0}}
    log = recorded(model_of(drift), 1)
    kernel = build(built_in())
    problem = stack(kernel, [log], (1,))
    point = fit_nominal(problem, (JointStructure(viscous_share=0.02 / 0.72),)).point
    point.parameters[:, 0, REFERENCE] = 2.0
    cold = heat(problem, point, 0)
    torque = log.command[:, 0] - 0.7 * problem.velocity[:, 0]
    assert cold == pytest.approx(np.mean(torque**2) / 2.0, rel=0.3)
    hot = extend(problem, point, Hypothesis(effects_of("thermal_drift")[0], 0), np.array([[0.5, 1.0]]))
    assert heat(problem, hot, 0) < 0.9 * cold


def test_heat_is_that_between_the_samples_as_well() -> None:
    """At the samples alone the torque of a switching command has just settled."""
    held = 20
    switching = np.random.default_rng(0).choice([-1.0, 1.0], 1000)
    part = StructuredJoint(1, "voltage", NOMINAL | {"electrical_time_constant": DT}, {})
    found = []
    for step, command in ((DT, switching), (DT / held, np.repeat(switching, held))):
        instants = step * np.arange(len(command))
        position = StructuredModel((part,), step).simulate(instants, command[:, None], State.at_rest(0.0)).position
        facts = JointFacts(input="voltage", position_unit="rad")
        problem = stack(build(built_in()), [Log(instants, command[:, None], position, (1,), facts=(facts,))], (1,))
        point = fit_nominal(problem, (JointStructure(),)).point
        parameters = point.parameters.copy()
        parameters[:, 0, [COLUMN[name] for name in part.nominal]] = list(part.nominal.values())
        found.append(heat(problem, replace(point, parameters=parameters), 0))
    sampled = np.mean(predicted_motion(problem, replace(point, parameters=parameters))[::held, 0, 2] ** 2)
    assert found[0] == pytest.approx(found[1], rel=2e-3)
    assert sampled > 1.02 * found[1]


def test_what_logs_leave_open_is_said_to_be_open() -> None:
    """Without a weight on the arm, friction by its load shows the product of coefficient and share of the link only."""
    truth = {"link_load_dependent_friction": {"coefficient": 0.1, "link_share": 0.8}}
    problem = stack(build(built_in()), [recorded(model_of(truth), 1)], (1,))
    nominal = fit_nominal(problem, (JointStructure(viscous_share=0.02 / 0.72),))
    (effect,) = (effect for effect in built_in() if effect.name in truth)
    final = fit(problem, extend(problem, nominal.point, Hypothesis(effect, 0), np.array([[0.16, 0.5]])))
    names = [f.name for f in final.point.free]
    own = [names.index(f"{effect.name}.{name}@0") for name in truth[effect.name]]
    product = float(np.prod(final.point.vector[own]))
    share = final.point.vector[own[1]]
    assert product == pytest.approx(0.08, rel=0.01)
    known, open_to = (np.sqrt(np.diag(spread))[own] for spread in (covariance(final), undetermined(final)))
    assert np.all(known < 0.02)
    assert open_to[1] == pytest.approx(1.0 / np.sqrt(12.0), rel=1e-3)
    assert open_to[0] == pytest.approx(open_to[1] * product / share**2, rel=0.01)
    others = np.delete(np.diag(undetermined(final)), own)
    assert np.all(others <= 1e-6 * np.diag(covariance(final)).max())
    assert not undetermined(nominal).any()
    free = [replace(f, deviation=0.1) if i == own[1] else f for i, f in enumerate(final.point.free)]
    exact = final.informed(1e6 * final.jacobian, final.covariance)
    exact = replace(exact, point=replace(final.point, free=tuple(free)))
    assert np.sqrt(undetermined(exact)[own[1], own[1]]) == pytest.approx(0.1)  # as is known beforehand


def test_pushes_in_all_logs_have_the_sign_that_they_have_in_each() -> None:
    push = {"torque": -0.3, "duration": 0.2, "shape": 0.5}
    kernel, effects = build(built_in()), effects_of("collision")
    logs = [recorded(model_of({"collision": push | {"time": time}}), seed) for seed, time in ((1, 2.0), (2, 4.0))]
    problem = stack(kernel, logs, (1,))
    finding = find(problem, (JointStructure(viscous_share=0.02 / 0.72),), effects)
    (item,) = finding.accepted
    found = effect_parameters(problem, finding.final, finding.covariance, item, JointUnits("voltage", "rad"))
    assert found[0].name == "torque"
    assert found[0].physical.value == pytest.approx(-0.3, rel=0.02)


def test_standard_deviations_hold() -> None:
    """Coulomb friction from logs with coloured, unlogged noise scatters as its standard deviation says."""
    (effect,) = effects_of("coulomb_friction")
    kernel = build(built_in())
    log = recorded(model_of(FRICTION), 1)
    problem = stack(kernel, [log], (1,))
    nominal = fit_nominal(problem, (JointStructure(viscous_share=0.02 / 0.72),))
    truth = fit(problem, extend(problem, nominal.point, Hypothesis(effect, 0), np.array([[0.06]]))).point
    decay = np.exp(-DT / 0.02)
    deviations = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        noise = 0.005 * lfilter([np.sqrt(1 - decay**2)], [1.0, -decay], rng.standard_normal(len(log)))
        silent = replace(problem, reading=np.zeros_like(problem.reading))
        position = -errors(silent, [truth], extra=noise[None, :, None], leak=False)[0]
        noisy = replace(problem, reading=STEP * np.round(position / STEP))
        final = fit(noisy, truth)
        place = [f.name for f in final.point.free].index("coulomb_friction.torque@0")
        spread = np.sqrt(covariance(final)[place, place])
        deviations.append((final.point.vector[place] - truth.vector[place]) / spread)
    assert 0.3 < np.sqrt(np.mean(np.square(deviations))) < 2.0


# ------------------------------------------------------------------------------------------------------ extended model


def excitation(samples: int) -> tuple[Array, Array]:
    time = DT * np.arange(samples)
    command = 1.2 * np.sin(2 * np.pi * 0.7 * time) + 0.7 * np.sin(2 * np.pi * 3 * time + 1)
    return time, command[:, None]


IN_MUJOCO = {
    "coulomb_friction": {"torque": 0.1},
    "constrained_coulomb_friction": {"torque": 0.1, "recovery_time": 0.0095, "hold": 0.9},
    "stribeck_friction": {"torque": 0.1, "excess": 0.05, "velocity": 0.2, "exponent": 2.0},
    "presliding_friction": {"torque": 0.1, "deflection": 5e-4, "damping_time": 0.003},
    "presliding_friction_stribeck": {
        "torque": 0.1,
        "deflection": 5e-4,
        "damping_time": 0.003,
        "rise": 0.6,
        "velocity": 0.2,
        "fall_exponent": 2.0,
    },
    "quadratic_drag": {"coefficient": 0.05},
    "cable_spring": {"stiffness": 0.3, "pull": 0.1},
    "cable_spring_stiffening": {"stiffness": 0.3, "pull": -0.1, "stiffening": 2.0},
    "gravity_tilt": {"sine": 0.1, "cosine": 0.2},
    "cogging_torque": {"sine": 0.1, "cosine": 0.1, "cycles_per_rev": 12.0},
    "amplifier_offset": {"voltage": 0.1},
    "voltage_saturation": {"voltage": 1.0},
    "input_delay": {"delay": 0.0043},
    "joint_flexibility": {"inertia_ratio": 0.5, "frequency": 1.9, "damping_ratio": 0.02},
}


@pytest.mark.parametrize("name", ["nothing", *IN_MUJOCO])
def test_mujoco_follows_the_extended_model(name: str) -> None:
    from diagnosis.mjcf_export import export, reproduction

    model = model_of({} if name == "nothing" else {name: IN_MUJOCO[name]})
    time, command = excitation(1000)
    exported = export(model, [0.008], ["shoulder"])
    assert exported.missing == ()
    difference = reproduction(model, exported, ["shoulder"], command)[0]
    start = State.at_rest(0.0)
    effect = rms(
        model.simulate(time, command, start).position - model.without(1, name).simulate(time, command, start).position
    )
    assert difference < 5e-5 + 0.02 * effect


def moved_on_the_arm(effects: dict[str, dict[str, float]], **friction: float) -> tuple[float, float]:
    """Rms by which friction on the arm moves a model, and by which MuJoCo, which lacks nothing of it, differs then."""
    from diagnosis.mjcf_export import export, reproduction

    plain = model_of(effects)
    (part,) = plain.parts
    model = replace(plain, parts=(replace(part, nominal={**part.nominal, **friction}),))
    time, command = excitation(1000)
    exported = export(model, [0.008], ["shoulder"])
    assert exported.missing == ()
    ours, bare = (own.simulate(time, command, State.at_rest(0.0)).position for own in (model, plain))
    return rms(ours - bare), float(reproduction(model, exported, ["shoulder"], command)[0])


@pytest.mark.parametrize("name", ["coulomb_friction", "joint_flexibility"])
def test_mujoco_follows_a_model_with_friction_on_the_arm(name: str) -> None:
    effect, difference = moved_on_the_arm({name: IN_MUJOCO[name]}, arm_viscous=0.1)
    assert difference < 5e-5 + 0.02 * effect


@pytest.mark.parametrize("name", ["coulomb_friction", "quadratic_drag"])
@pytest.mark.parametrize("share", [0.3, 1.0])
def test_mujoco_follows_a_model_with_a_share_of_a_friction_law_on_the_arm(name: str, share: float) -> None:
    effects = {known: IN_MUJOCO[known] for known in ("joint_flexibility", name)}
    effect, difference = moved_on_the_arm(effects, arm_friction=share)
    assert effect > 1e-4
    assert difference < 5e-5 + 0.05 * effect


@pytest.mark.parametrize("effect", [effect for effect in built_in() if effect.parameters], ids=lambda e: e.name)
def test_mujoco_loads_an_effect_at_its_lower_bounds(effect: Effect) -> None:
    from diagnosis.mjcf_export import export, reproduction

    least = {p.name: p.lower if np.isfinite(p.lower) else 0.0 for p in effect.parameters}
    model = model_of({"coulomb_friction": {"torque": 0.1}} | {effect.name: least})
    exported = export(model, [0.008], ["shoulder"])
    assert {name for _, name in exported.missing} <= {effect.name}
    assert np.all(np.isfinite(reproduction(model, exported, ["shoulder"], excitation(300)[1])))


def test_joints_whose_arm_is_not_described_may_act_on_one_another() -> None:
    results = [SimpleNamespace(joint=1, verdict="unknown"), SimpleNamespace(joint=3, verdict="named")]
    bare, described = SimpleNamespace(robot=None), SimpleNamespace(robot=object())
    (said,) = together_said(bare, 2, results)  # type: ignore[arg-type]
    assert said.startswith("joint 1: ")
    assert "--robot" in said
    assert together_said(described, 2, results) == []  # type: ignore[arg-type]
    assert together_said(bare, 1, results) == []  # type: ignore[arg-type]
    assert together_said(bare, 2, results[1:]) == []  # type: ignore[arg-type]


def test_mujoco_follows_a_planar_pair() -> None:
    from diagnosis.mjcf_export import export, reproduction

    second = StructuredJoint(2, "voltage", {"inertia": 0.03, "viscous": 0.02, "back_emf": 0.3}, {})
    first = StructuredJoint(1, "voltage", {"inertia": 0.04, "viscous": 0.02, "back_emf": 0.7}, {})
    pair = StructuredModel((first, second), DT, PlanarCoupling(0.01, 1.5, second.nominal["inertia"] / 1.5))
    _, command = excitation(1000)
    exported = export(pair, [0.008, None], ["a", "b"])
    assert np.max(reproduction(pair, exported, ["a", "b"], np.hstack([command, -0.5 * command]))) < 1e-5


def test_what_mujoco_lacks_is_listed_with_its_cost() -> None:
    read = read_of(model_of({"dead_zone": {"voltage": 0.15}}))
    diagnosis, _, twin = diagnose(read, effects=effects_of("dead_zone"))
    (item,) = diagnosis.missing_in_mujoco
    assert (item["effect"], item["joint"]) == ("dead_zone", 1)
    assert item["error_without"] > 20 * item["error_with"]
    assert twin.difference[1] < 1e-4  # type: ignore[attr-defined]


def test_model_travels_as_json() -> None:
    network = TwoLayerNetwork(
        TWO_SIGNALS, np.eye(2), np.array([0.1, -0.2]), np.array([0.3, 0.4]), -0.35, np.zeros(2), np.ones(2)
    )
    model = model_of(FRICTION, compensator=network)
    again = StructuredModel.from_json(model.to_json())
    assert again.to_json() == model.to_json()
    time, command = excitation(500)
    start = State.at_rest(0.2)
    np.testing.assert_array_equal(
        again.simulate(time, command, start).position, model.simulate(time, command, start).position
    )
    assert not np.allclose(
        model.without(1, "compensator").simulate(time, command, start).position,
        model.simulate(time, command, start).position,
    )


def test_inverse_undoes_the_simulation() -> None:
    model = model_of({**FRICTION, "input_delay": {"delay": 0.003}, "cable_spring": {"stiffness": 0.4, "pull": 0.1}})
    time, command = excitation(3000)
    motion = model.simulate(time, command, State.at_rest(0.0), "first_order")
    error = model.inverse(time, motion) - command
    assert rms(error[200:-200]) < 0.02 * rms(command)


def test_extended_model_runs_in_the_environment(with_friction: tuple) -> None:
    import gymnasium

    import envs  # noqa: F401  registers the environment
    from methods.structured import StructuredSimulator

    robot = adept_robot()
    model = replace(with_friction[2], sample_time=1e-3)
    simulator = StructuredSimulator(model, robot)
    assert simulator.held == (2, 3, 4)
    commands = robot.quantise(np.column_stack([np.sin(0.01 * np.arange(5000)), *np.zeros((3, 5000))]))
    simulator.reset(np.zeros(4), np.random.default_rng(0))
    stepped = np.array([simulator.step(command)[0] for command in commands])
    whole = model.simulate(1e-3 * np.arange(5001), np.vstack([commands[:, :1], [[0.0]]]), State.at_rest(0.0)).position
    np.testing.assert_allclose(stepped, whole[1:, 0], atol=robot.facts(1).encoder_step)
    environment = gymnasium.make("AdeptOne-v0", simulator=simulator)
    observation, _ = environment.reset(seed=1)
    assert observation.shape == (3,)
    assert np.isfinite(environment.step(environment.action_space.sample())[1])


# ------------------------------------------------------------------------------------- what the data can and cannot say


@pytest.mark.parametrize(
    ("command", "amplitude", "offset"),
    [([0.0, 2.0, 0.0, 2.0], 1.0, 1.0), ([2.0, 2.0, 2.0, 2.0], 2.0, 0.0), ([1.0, -1.0, 1.0, -1.0], 1.0, 0.0)],
    ids=["on and off", "constant", "about zero"],
)
def test_experiments_swing_as_the_logs_did(command: list[float], amplitude: float, offset: float) -> None:
    from diagnosis.next_experiment import excitations

    problem = SimpleNamespace(command=np.array(command)[:, None], sample_time=8.9e-3)
    proposed = list(excitations(problem, 0, 1, None))
    assert {(largest, excitation.offset) for excitation, largest in proposed} == {(amplitude, offset)}
    assert proposed[1][0].band == (0.5, 11.0)


def test_isolability_and_next_experiment(with_friction: tuple) -> None:
    from diagnosis.isolability import isolability
    from diagnosis.next_experiment import next_experiment, seen

    read = with_friction[0]
    solved = solved_of(read, "coulomb_friction")
    wanted = effects_of("input_delay", "amplifier_lag", "cable_spring", "dead_zone")
    rows, _ = isolability(solved.problem, solved.finding, 0, 1, wanted, Settings())
    by_name = {row.effect: row for row in rows}
    assert by_name["input_delay"].nearest == "amplifier_lag"
    assert all(0.0 < row.share < 0.1 for row in rows)
    # beside another effect it takes more than to be more than noise
    lenient = replace(Settings(), relevant=0.0, minor=0.0, faint=0.0)
    seen_at_all, _ = isolability(solved.problem, solved.finding, 0, 1, wanted, lenient)
    assert all(row.share >= least.share for row, least in zip(rows, seen_at_all, strict=True))
    assert by_name["input_delay"].share > 3.0 * next(row.share for row in seen_at_all if row.effect == "input_delay")
    assert by_name["cable_spring"].share == pytest.approx(Settings().faint)
    # a noisier encoder raises every threshold
    rng = np.random.default_rng(0)
    noisy = [
        replace(log, position=log.position + 20 * STEP * rng.standard_normal(log.position.shape)) for log in read.fitted
    ]
    louder = solved_of(replace(read, fitted=tuple(noisy)), "coulomb_friction")
    again, _ = isolability(louder.problem, louder.finding, 0, 1, wanted, lenient)
    assert all(loud.share > 3 * quiet.share for loud, quiet in zip(again, seen_at_all, strict=True))
    # in a linear joint without a winding a constant load hides an offset however large it is
    bare = StructuredModel((StructuredJoint(1, "current", {"inertia": 0.07, "viscous": 0.3}, {}),), DT)
    problem = solved_of(read_of(bare), "coulomb_friction").problem
    constant = find(problem, (JointStructure("current", gravity="constant"),), effects_of("coulomb_friction"))
    (offset,), _ = isolability(problem, constant, 0, 1, effects_of("amplifier_offset"), Settings())
    assert offset.threshold is None
    proposal = next_experiment(solved.problem, solved.finding, 0, 1, None)
    assert proposal is not None
    assert proposal.factor > 1.0
    assert proposal.purpose == "to sharpen the torque of Coulomb friction, the least certain parameter"
    amplitude = parse(proposal.excitation).amplitude
    assert 0.0 < amplitude <= 1.01 * seen(solved.problem, 0).command
    # a parameter to which arithmetic gives no variance is not asked
    final, spread = solved.finding.final, solved.finding.final.covariance.copy()
    spread[0, 0] = -1e-9
    other = replace(solved.finding, final=final.informed(final.jacobian, spread))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = next_experiment(solved.problem, other, 0, 1, None)
    assert again is not None
    assert again.purpose == proposal.purpose
    assert 1.0 < again.factor < np.inf


def test_compensator_has_to_earn_its_place(with_friction: tuple) -> None:
    from diagnosis.compensator import compensators, not_refused

    rng = np.random.default_rng(0)
    read = with_friction[0]
    quiet = solved_of(read, "coulomb_friction")
    networks, reason = compensators(read.fitted, quiet.problem, quiet.finding, (1,), rng)
    assert networks == (None,)
    assert reason
    bump = TwoLayerNetwork(
        TWO_SIGNALS, np.array([[30.0, 0.0], [30.0, 0.0]]), np.array([-1.0, 1.0]), np.array([0.3, -0.3]), 0.0,
        np.zeros(2), np.ones(2),
    )  # fmt: skip
    foreign = read_of(model_of({}, compensator=bump))
    solved = solved_of(foreign, "dead_zone")
    steps = {step.role: step for step in solved.ledger}
    assert solved.finding.verdict == "unknown"
    assert rms(steps["compensator"].replay.windows) < 0.5 * rms(steps["nominal"].replay.windows)
    # the held-out logs can refuse it
    (network,) = solved.compensators
    assert network is not None
    worse = replace(network, output=-network.output)
    before = solved.last
    kept, step, why = not_refused(solved.held_out, before, (network,))
    assert (kept, why) == ((network,), "")
    assert step is not None
    kept, step, why = not_refused(solved.held_out, before, (worse,))
    assert (kept, step) == ((None,), None)
    assert why.startswith("it makes the held-out error ")


def test_effects_that_make_held_out_logs_worse_are_not_the_right_ones() -> None:
    solved = solved_of(read_of(model_of(FRICTION)), "coulomb_friction")
    assert not solved.failing
    nominal, after = solved.ledger[-2:]
    assert (nominal.role, after.role) == ("nominal", "effect")
    better = replace(nominal, replay=replace(after.replay, windows=0.5 * after.replay.windows))
    found = failures(solved.problem, solved.held_out, solved.finding, [better, after])
    assert found == {0: Failure(pytest.approx(2.0), noise=False)}


def taken_for(finding: Finding, name: str) -> Finding:
    """The same with another effect in the place of those that were accepted."""
    hypothesis = Hypothesis(effects_of(name)[0], 0)
    accepted = tuple(
        replace(item, scored=replace(item.scored, start=replace(item.scored.start, hypothesis=hypothesis)))
        for item in finding.accepted
    )
    return replace(finding, accepted=accepted)


def test_effects_have_to_explain_more_of_held_out_logs_than_they_leave() -> None:
    """However uncertain the model is, so that noise could account for its errors."""
    solved = solved_of(read_of(model_of(FRICTION)), "coulomb_friction")
    nominal, after = solved.ledger[-2:]
    floor = floor_of(solved.problem, solved.held_out, solved.finding, 0)
    vague = np.diag(np.full(len(solved.finding.final.point.free), 1e-2))

    def failing(before: float, left: float, finding: Finding = solved.finding) -> dict[int, Failure]:
        steps = [
            replace(step, replay=replace(step.replay, windows=np.where(np.isnan(step.replay.windows), np.nan, error)))
            for step, error in ((nominal, before * floor), (after, left * floor))
        ]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(type(solved.finding), "covariance", property(lambda self: vague))
            return failures(replace(solved.problem, encoder_step=0.0), solved.held_out, finding, steps)

    assert failing(4.0, 3.0) == {0: Failure(pytest.approx(0.75), noise=False)}
    assert not failing(8.0, 3.0)  # explains five of the seven parts that noise does not
    assert not failing(1.8, 1.45)  # too little beyond noise to tell
    assert not failing(4.0, 3.0, taken_for(solved.finding, "timestamp_jitter"))  # which simulates as without it


def test_where_small_causes_grow_the_prediction_has_to_be_worse_too() -> None:
    """A free simulation behind impacts soon goes another way than the joint; a model in the middle errs less."""
    solved = solved_of(read_of(model_of(FRICTION)), "coulomb_friction")
    nominal, after = solved.ledger[-2:]
    better = replace(nominal, replay=replace(after.replay, windows=0.5 * after.replay.windows))
    rough = taken_for(solved.finding, "backlash")
    assert not failures(solved.problem, solved.held_out, rough, [better, after])
    worse = replace(rough, final=rough.nominal, nominal=rough.final)
    assert failures(solved.problem, solved.held_out, worse, [better, after])


def test_where_single_windows_go_astray_by_the_least_torque_the_typical_one_decides() -> None:
    """A joint that is almost at rest stops or does not: a mean square over few windows says little then."""
    solved = solved_of(read_of(model_of(FRICTION)), "coulomb_friction")
    held_out, (nominal, after) = solved.held_out, solved.ledger[-2:]
    floor = floor_of(solved.problem, held_out, solved.finding, 0)
    windows = (held_out.time // WINDOW)[:, None]

    def responding(astray: Array) -> Callable[..., Replay]:
        def moved(problem: Problem, point: Point, window: float) -> Replay:
            torque = problem.command - held_out.command
            far = after.replay.windows + np.where(np.isin(windows, astray), 1e3, 1.0) * torque
            return replace(after.replay, windows=far)

        return moved

    def failing(typical: float, astray: Array) -> dict[int, Failure]:
        error = np.where(windows == 4, 100.0, typical) * floor
        steps = [
            replace(step, replay=replace(step.replay, windows=np.where(np.isnan(step.replay.windows), np.nan, left)))
            for step, left in ((nominal, np.full_like(error, 60.0 * floor)), (after, error))
        ]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ledger, "replay", responding(astray))
            return failures(replace(solved.problem, encoder_step=0.0), held_out, solved.finding, steps)

    nowhere, somewhere = np.array([]), np.array([4, 6])
    assert failing(4.0, nowhere) == {0: Failure(pytest.approx(100.0 / np.sqrt(7.0), rel=0.1), noise=True)}
    assert not failing(4.0, somewhere)
    assert failing(50.0, somewhere)  # the typical window, too, errs nearly as the nominal model does
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ledger, "replay", responding(somewhere))
        assert grown(held_out, after, 0, floor) == pytest.approx(1e3 * floor * np.sqrt(2.0 / 7.0), rel=0.05)


def test_errors_that_no_reading_shows_are_no_failure() -> None:
    """Less than a step of the encoder and than a twentieth of the nominal model's error, whatever the noise floor."""
    solved = solved_of(read_of(model_of(FRICTION)), "coulomb_friction")
    nominal, after = solved.ledger[-2:]

    def failing(before: float, left: float) -> bool:
        steps = [
            replace(step, replay=replace(step.replay, windows=np.where(np.isnan(step.replay.windows), np.nan, error)))
            for step, error in ((nominal, before * STEP), (after, left * STEP))
        ]
        coarse = replace(solved.problem, encoder_step=10 * STEP)
        return bool(failures(coarse, solved.held_out, solved.finding, steps))

    assert not failing(1000.0, 9.0)
    assert failing(100.0, 9.0)
    assert failing(1000.0, 15.0)


def test_a_law_that_fails_on_held_out_logs_is_not_the_right_one() -> None:
    smooth, rough = model_of({}), model_of(FRICTION)
    fitted = [recorded(smooth, 1), recorded(smooth, 2)]
    wanted = effects_of("dead_zone")
    agreeing, *_ = diagnose(arrange(fitted, [recorded(smooth, 3)], None), effects=wanted)
    assert agreeing.verdict == "none"
    assert agreeing.joints[0].fails_by is None
    failing, *_ = diagnose(arrange(fitted, [recorded(rough, 3)], None), effects=wanted)
    joint, gap = failing.joints[0], failing.gaps[0]
    assert failing.verdict == joint.verdict == "unknown"
    assert joint.fails_by.noise
    assert joint.fails_by.times == pytest.approx(gap.after / gap.noise_floor, rel=0.1)
    assert joint.fails_by.times > 2.0
    assert f"errs {joint.fails_by.times:.2g} times as much as noise accounts for" in failing.sentence


def test_held_out_logs_may_be_louder_than_the_fitted_ones() -> None:
    """Noise in proportion to the command is stronger where the command is larger, and no law is wrong for that."""
    smooth, rough = model_of({}), model_of({"coulomb_friction": {"torque": 0.02}})
    fitted = [recorded(smooth, seed, amplitude=0.5, noise=0.002) for seed in (1, 2)]

    def solved_on(model: StructuredModel) -> Solved:
        return solved_of(arrange(fitted, [recorded(model, 3, amplitude=2.5, noise=0.01)], None), "dead_zone")

    louder, drier = solved_on(smooth), solved_on(rough)
    assert louder.verdict == "none"
    assert louder.louder[0].noise
    assert louder.louder[0].times == pytest.approx(5.0, rel=0.3)
    assert "noise that nobody logged is stronger there" in louder_said(louder, 0)
    assert drier.verdict == "unknown"
    assert not drier.louder
    assert not louder_said(drier, 0)
    # an inertia that is another one there is no noise either
    other = replace(smooth, parts=(replace(smooth.parts[0], nominal=NOMINAL | {"inertia": 1.05 * NOMINAL["inertia"]}),))
    assert solved_on(other).verdict == "unknown"


def test_a_law_may_go_on_in_any_way_that_the_fitted_logs_leave_open() -> None:
    """Small currents do not tell how the iron saturates at ten times as much; that nothing rubs they do."""
    early = {"torque_constant_saturation_power": {"coefficient": 0.3, "exponent": 0.4}}
    iron, other = model_of(early), model_of(early | {"coulomb_friction": {"torque": 0.3}})
    wanted = ("torque_constant_saturation", "torque_constant_saturation_power")
    fitted = [recorded(iron, seed, amplitude=0.15) for seed in (1, 2)]

    def solved_on(model: StructuredModel) -> Solved:
        return solved_of(arrange(fitted, [recorded(model, 3, amplitude=1.5)], None), *wanted)

    same, drier = solved_on(iron), solved_on(other)
    assert [item.name for item in same.finding.accepted] == [wanted[0]]
    assert not same.failing
    law, failure = same.left_open[0]
    assert law == "torque_constant_saturation"
    assert failure.noise
    assert failure.times > 2.0
    assert same.verdict == "named"
    said = open_law_said(same, 0)
    assert said.startswith("joint 1: the fitted logs leave open how the torque constant saturation goes on")
    assert drier.verdict == "unknown"
    assert not drier.left_open
    assert not open_law_said(drier, 0)


def test_rivals_that_fail_stay_in_the_table() -> None:
    from diagnosis.rivals import rival_rows

    read = read_of(model_of({}))
    problem = stack(solved_of(read, "dead_zone").problem.kernel, read.held_out, (1,))
    arguments = {"gravity": "none", "networks": False}
    rng = np.random.default_rng(0)
    (row,) = rival_rows(read.fitted, read.held_out, problem, 1, (1.0, 0.0), rng, **arguments)
    # the joint is linear: least squares with the jerk's column describes it
    assert row.window_error < 1e-3
    short = [log.slice(0, 60) for log in read.fitted]
    (row,) = rival_rows(short, read.held_out, problem, 1, (1.0, 0.0), rng, **arguments)
    assert row.window_error is None
    assert "too few" in row.note
    assert row.step == "least squares"


def test_least_squares_has_a_winding_where_a_voltage_drives_one(monkeypatch: pytest.MonkeyPatch) -> None:
    from diagnosis import rivals

    asked: list[tuple[str, ...]] = []
    monkeypatch.setattr(rivals, "methods", lambda smooth, columns, *given, **named: asked.append(columns) or {})
    read = read_of(model_of({}))
    problem = stack(build(built_in()), read.held_out, (1,))
    for kind in ("voltage", "current", "torque"):
        logs = [replace(log, facts=(replace(log.facts[0], input=kind),)) for log in read.fitted]
        rng = np.random.default_rng(0)
        rivals.rival_rows(logs, logs, problem, 1, (1.0, 0.0), rng, gravity="none", networks=False)
    assert ["jerk" in columns for columns in asked] == [True, False, False]


def test_least_squares_has_the_gravity_of_the_nominal_model() -> None:
    from diagnosis.rivals import rival_rows

    hanging = {**NOMINAL, "gravity_sine": 0.4, "gravity_cosine": 0.2}
    read = read_of(StructuredModel((StructuredJoint(1, "voltage", hanging, {}),), DT))
    problem = stack(solved_of(read, "dead_zone").problem.kernel, read.held_out, (1,))

    def error(gravity: Gravity) -> float:
        rng = np.random.default_rng(0)
        (row,) = rival_rows(read.fitted, read.held_out, problem, 1, (1.0, 0.0), rng, gravity=gravity, networks=False)
        assert row.window_error is not None
        return row.window_error

    assert error("pendulum") < 1e-3 < 0.05 < error("none")


def test_saved_logs_give_the_same_diagnosis(tmp_path: Path, with_friction: tuple) -> None:
    read = with_friction[0]
    path = save(read.fitted[0], tmp_path / "log.csv")
    assert load(path).content_hash == read.fitted[0].content_hash


def test_a_model_that_runs_away_is_replayed_to_the_end() -> None:
    problem = stack(build(built_in()), [recorded(model_of({}), 1)], (1,))
    point = fit_nominal(problem, (JointStructure(),)).point
    parameters = point.parameters.copy()
    parameters[..., COLUMN["viscous"]] = -1e9
    run = replay(problem, replace(point, parameters=parameters))
    assert np.all(np.isfinite(run.prediction))
    assert np.nanmax(np.abs(run.whole)) == DIVERGED


@pytest.mark.parametrize(
    ("name", "title"), [("joint_2", ""), ("Joint2", ""), ("q2", ""), ("elbow", "elbow"), ("joint_3", "joint_3")]
)
def test_a_joint_has_a_title_where_its_name_says_more_than_its_number(name: str, title: str) -> None:
    robot = SimpleNamespace(joint=lambda number: SimpleNamespace(name=name))
    assert joint_title(SimpleNamespace(robot=robot), 2) == title


@pytest.mark.parametrize(
    ("inertia", "damping", "gravity", "said"),
    [(10.0, 10.0, 9.5, "9.8 times"), (0.1, 0.1, 0.1, "0.1 times"), (1.2, 0.8, 1.0, ""), (10.0, 1.0, 1.0, "")],
)
def test_parameters_that_all_differ_by_one_factor_speak_of_another_scale(
    inertia: float, damping: float, gravity: float, said: str
) -> None:
    stated = {"inertia": 0.1, "damping": 0.7, "gravity_sine": 0.3, "gravity_cosine": -0.4, "load": None}
    factors = {"inertia": inertia, "damping": damping}

    def parameter(name: str, value: float | None) -> NominalParameter:
        found = Estimate((value or 1.0) * factors.get(name, gravity), 0.0, "V")
        return NominalParameter(name, "V", value, found, found)

    result = SimpleNamespace(nominal=[parameter(*item) for item in stated.items()], joint=3)
    text = scale_said(result)
    assert (f"joint 3: inertia, damping and gravity are all about {said}" in text) if said else not text


def test_values_in_newton_metres_are_as_uncertain_as_the_drive_s_constants() -> None:
    def joint(unit: str, *, torque_unit: str = "N m", command_unit: str = "V") -> SimpleNamespace:
        found = ParameterEstimate("torque", Estimate(0.83, 0.001, unit), Estimate(0.43, 0.0005, command_unit))
        effects = [SimpleNamespace(parameters=(found,))]
        return SimpleNamespace(effects=effects, torque_unit=torque_unit, command_unit=command_unit, joint=2)

    drive = adept_robot().joint(1).drive
    exact = replace(drive, resistance=Quantity(1.3, "ohm", "data sheet", 0.1), motor_constant=Quantity(0.05, "", ""))
    assert exact.input_equivalent_uncertainty == pytest.approx(0.1)
    assert drive.input_equivalent_uncertainty == pytest.approx(3.0)  # resistance and motor constant by a factor of two
    assert "may together be 10\u00a0% off" in constants_said(joint("N m"), 0.1)
    assert "may together be a factor of 4 off" in constants_said(joint("N m s/rad"), 3.0)
    assert not constants_said(joint("N m"), 0.0)
    assert not constants_said(joint("s"), 0.1)
    assert not constants_said(joint("N m", command_unit="N m"), 0.1)


def test_an_effect_of_which_no_parameter_is_known_is_not_determined() -> None:
    def flexible(*deviations: float) -> NamedEffect:
        names = ("stiffness", "damping", "inertia_ratio")
        own = [
            ParameterEstimate(name, Estimate(10.0, std, "1"), Estimate(1.0, 0.1 * std, "1"))
            for name, std in zip(names, deviations, strict=False)
        ]
        none = Evidence(0.0, 0.0, 0.0)
        return NamedEffect("joint_flexibility", 1, "transmission", "", "position", tuple(own), none, ())

    assert is_determined(flexible(80.0, 70.0, 1.0))
    assert not is_determined(flexible(80.0, 70.0, 100.0))
    assert is_determined(flexible(80.0))


def test_an_event_that_may_have_been_at_any_time_is_not_named() -> None:
    """What dry friction leaves on a slide was once called a collision at 5 +- 5 s of 6."""

    def collision(deviation: float) -> NamedEffect:
        own = {"torque": Estimate(2.7, 1.0, "N"), "time": Estimate(4.7, deviation, "s")}
        parameters = tuple(ParameterEstimate(name, found, found) for name, found in own.items())
        return NamedEffect("collision", 1, "arm", "", "time", parameters, Evidence(0.0, 0.0, 0.0), ())

    assert is_determined(collision(5.2))
    assert not is_dated(collision(5.2), 6.0)
    assert is_dated(collision(0.1), 6.0)

    accepted = SimpleNamespace(joint=0, effect=SimpleNamespace(scan="event"))
    known = {"finding": SimpleNamespace(accepted=[accepted]), "problem": SimpleNamespace(longest=6.0)}
    solved = cast(Solved, SimpleNamespace(joints=(1,), **known))
    assert doubts(solved, 0, [collision(0.1)]) == []
    (said,) = doubts(solved, 0, [collision(5.2)])
    assert said.startswith("joint 1: the instant of the collision is uncertain by 5.2 s: ")


def test_a_sidecar_is_that_of_all_logs_that_have_none(tmp_path: Path) -> None:
    logs = [replace(recorded(model_of({}), seed), name=f"log{seed}") for seed in (1, 2, 3)]
    paths = [save(replace(log, facts=(JointFacts(position_unit="m"),)), tmp_path / f"{log.name}.csv") for log in logs]
    first, *others = [path.with_suffix(".toml") for path in paths]
    for sidecar in others:
        sidecar.unlink()
    read = recordings(paths[:2], paths[2:], None, None, repair=False)
    assert [log.facts[0].position_unit for log in (*read.fitted, *read.held_out)] == 3 * ["m"]
    assert "log2.csv has no sidecar: what log1.toml states is taken for it" in read.findings
    stated = first.read_text(encoding="utf-8")
    first.write_text("rows = { last = 900 }\n" + stated, encoding="utf-8")  # which are those of its own log
    assert shared_sidecar(paths) == {}
    others[0].write_text(stated, encoding="utf-8")  # another one: whose holds for the third?
    assert shared_sidecar(paths) == {}


@pytest.mark.parametrize(
    ("name", "cycles", "verdict", "refused"),
    [
        ("coulomb_friction", None, "named", False),
        ("gravity_tilt", None, "named", False),  # once in a turn: it is one
        ("cogging_torque", 12.01, "named", False),
        ("cogging_torque", 12.3, "named", True),
        ("cogging_torque", 0.01, "named", True),
        ("cogging_torque", 12.3, "unknown", False),  # which claims nothing
    ],
)
def test_what_a_turn_is_has_to_be_known_where_the_answer_depends_on_it(
    name: str, cycles: float | None, verdict: str, refused: bool
) -> None:
    read = arrange([recorded(model_of({}), 1)], [recorded(model_of({}), 2)], None)
    read = replace(read, doubtful={1: "back and forth"})
    named = {effect.name: effect for effect in built_in()}
    point = SimpleNamespace(value={f"{name}.cycles_per_rev@0": cycles}.__getitem__)
    finding = SimpleNamespace(accepted=[Named(named[name])], final=SimpleNamespace(point=point))
    solved = cast(Solved, SimpleNamespace(joints=(1,), finding=finding, verdict=verdict))
    if refused:
        with pytest.raises(DiagnosisError, match=r"cogging torque of joint 1.* what a turn is: back and forth"):
            check_turns(read, solved)
    else:
        check_turns(read, solved)


@dataclass(frozen=True)
class Named:
    """An effect of the first joint as a search names it."""

    effect: Effect
    joint: int = 0

    @property
    def name(self) -> str:
        return self.effect.name

    @property
    def label(self) -> str:
        return self.effect.label


def test_without_a_terminal_a_line_now_and_then_says_what_is_going_on() -> None:
    from diagnosis.run import in_lines

    said: list[str] = []
    tell = in_lines(said.append, 0.2)
    for text in ("at once", "at once again"):
        tell(text)
    assert said == []
    time.sleep(0.25)
    for text in ("later", "right after that"):
        tell(text)
    assert len(said) == 1
    assert said[0].endswith(" s: later")
