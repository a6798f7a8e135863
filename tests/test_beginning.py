"""States in which logs begin and that no reading shows: a spring or a play that is not at rest, a warm winding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from diagnosis.beginning import HEAT, TWIST, TWIST_RATE, beginnings_settled, heats, started, twists
from diagnosis.engine import find
from diagnosis.estimation import Point, criterion_at, errors, fit, sensitivities
from diagnosis.hypotheses import Hypothesis, Start, extend
from diagnosis.nominal import JointStructure, fit_nominal, point_at
from diagnosis.parameters import JointUnits, effect_parameters
from diagnosis.problem import Problem, stack
from diagnosis.search import Scored, _converged, score
from diagnosis.turns import in_turns
from envs.log import Array, JointFacts, Log
from methods.effects import built_in
from methods.effects.base import Effect
from methods.kernel import build

EFFECTS = built_in()
KERNEL = build(EFFECTS)
NAMED = {effect.name: effect for effect in EFFECTS}
DT, STEP = 2e-3, 1e-5
MOTOR, ARM, DRAG, WEIGHT = 0.05, 0.02, 0.3, 0.2
HERTZ, DAMPING = 6.0, 0.02
STIFFNESS, FRICTION = ARM * (2 * np.pi * HERTZ) ** 2, 2 * DAMPING * ARM * 2 * np.pi * HERTZ
STRUCTURE = (JointStructure(input="current", gravity="constant"),)
EMF, RISE, SECONDS = 0.4, 0.3, 6.0
WARM = np.array([[RISE, SECONDS]])
HANGING = WEIGHT / STIFFNESS
"""Angle of the motor before the arm at rest."""


def swinging(seed: int, twist: float = 0.0, rate: float = 0.0) -> Log:
    """A motor that carries an arm on a spring; motor angle less arm angle begins at `twist`, with `rate`. The exact
    solution between samples, whose command is held."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(5000)
    hertz = np.array([0.4, 1.1, 2.3, 4.1])
    command = WEIGHT + np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0, 6, 4)), axis=1)
    twisted, twisting = np.array([1.0, 0.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0, -1.0])
    torque = STIFFNESS * twisted + FRICTION * twisting
    rates = np.zeros((6, 6))  # angle and velocity of the motor, of the arm, the command, and one
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, :4], rates[3, :4] = -torque / MOTOR, torque / ARM
    rates[1, 1] -= DRAG / MOTOR
    rates[1, 4], rates[3, 5] = 1.0 / MOTOR, -WEIGHT / ARM
    step, state, position = expm(DT * rates), np.array([0.0, 0.0, -twist, -rate, 0.0, 1.0]), np.zeros(len(time))
    for k, u in enumerate(command):
        position[k], state[4] = state[0], u
        state = step @ state
    facts = JointFacts(input="current", position_unit="rad", encoder_step=STEP)
    return Log(time, command[:, None], STEP * np.round(position[:, None] / STEP), (1,), facts=(facts,), name=f"{seed}")


def model_of(problem: Problem, name: str = "joint_flexibility", first: tuple[float, ...] = ()) -> Point:
    """The model of the joint with a spring, or with an effect that has another parameter before those of the spring."""
    known, rigid = {"inertia@0": MOTOR + ARM, "viscous@0": DRAG, "load@0": WEIGHT}, point_at(problem, STRUCTURE)[0]
    rigid = rigid.at(np.array([known.get(f.name, v) for f, v in zip(rigid.free, rigid.vector, strict=True)]))
    values = np.tile([*first, ARM / (MOTOR + ARM), HERTZ, DAMPING], (problem.logs, 1))
    return extend(problem, rigid, Hypothesis(NAMED[name], 0), values)


def rms(problem: Problem, error: Array) -> float:
    return float(np.sqrt(np.mean(error[problem.used] ** 2)))


def test_a_spring_that_begins_beside_its_rest_is_found_there() -> None:
    """It begins unstretched, as in simulators, and swings about the angle in which it would hang."""
    problem = stack(KERNEL, [swinging(1), swinging(2, twist=0.03, rate=-0.5)], (1,))
    before = in_turns(problem, fit(problem, model_of(problem)))
    after = beginnings_settled(problem, before)
    assert rms(problem, after.error) < 0.3 * rms(problem, before.error)
    assert rms(problem, after.error) < 1.5 * STEP / np.sqrt(12.0)
    assert after.point.starts[:, 0, TWIST] == pytest.approx([-HANGING, 0.03 - HANGING], abs=0.05 * HANGING)
    assert after.point.starts[:, 0, TWIST_RATE] == pytest.approx([0.0, -0.5], abs=0.02)
    assert beginnings_settled(problem, after) is after


def test_the_search_names_a_spring_that_begins_beside_its_rest() -> None:
    problem = stack(KERNEL, [swinging(1), swinging(2)], (1,))
    held_out = stack(KERNEL, [swinging(3)], (1,))
    candidates = [NAMED[name] for name in ("joint_flexibility", "coulomb_friction", "quadratic_drag")]
    finding = find(problem, STRUCTURE, candidates, held_out=held_out)
    assert finding.verdict == "named"
    assert [item.name for item in finding.accepted] == ["joint_flexibility"]
    assert any(f.column == TWIST for f in finding.final.point.free if f.kind == "start")


def test_a_spring_at_rest_stays_there() -> None:
    problem = stack(KERNEL, [swinging(seed, twist=HANGING) for seed in (1, 2)], (1,))
    fitted = in_turns(problem, fit(problem, model_of(problem)))
    assert rms(problem, fitted.error) < 1.5 * STEP / np.sqrt(12.0)
    assert beginnings_settled(problem, fitted) is fitted


def test_other_logs_begin_as_their_readings_tell() -> None:
    problem = stack(KERNEL, [swinging(1, twist=HANGING), swinging(2, twist=HANGING)], (1,))
    fitted = in_turns(problem, fit(problem, model_of(problem)))
    other = stack(KERNEL, [swinging(3, twist=-0.02, rate=1.0)], (1,))
    point = started(other, fitted.point, fitted.whitener)
    assert point.starts[0, 0, TWIST] == pytest.approx(-0.02 - HANGING, abs=0.05 * HANGING)
    assert point.starts[0, 0, TWIST_RATE] == pytest.approx(1.0, abs=0.03)
    unknown = replace(point, starts=point.starts * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))
    assert rms(other, errors(other, [point])[0]) < 0.3 * rms(other, errors(other, [unknown])[0])


def test_the_twist_of_a_play_is_of_the_size_of_its_gap_and_of_what_the_torque_bends() -> None:
    gap, problem = 0.02, stack(KERNEL, [swinging(1)], (1,))
    twist, rate = twists(problem, model_of(problem, "backlash", (gap,)))
    assert (twist.joint, twist.column, rate.column) == (0, TWIST, TWIST_RATE)
    assert twist.size == pytest.approx(0.5 * gap + np.max(np.abs(problem.command)) / STIFFNESS, rel=0.02)
    assert rate.size == pytest.approx(2 * np.pi * HERTZ * twist.size)


def test_only_springs_and_plays_have_a_twist() -> None:
    problem = stack(KERNEL, [swinging(1)], (1,))
    nominal = fit_nominal(problem, STRUCTURE)
    assert list(twists(problem, nominal.point)) == []
    assert beginnings_settled(problem, nominal) is nominal


def warmed(seed: int, heat: float, *, is_steady: bool = False) -> Log:
    """A motor whose resistance begins higher than cold by the share `heat`; thirty Euler steps a sample. is_steady: it
    warms up whatever the current, under a command that fades."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(10000)
    hertz = np.array([0.4, 1.1, 2.3, 4.1])
    command = np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0, 6, 4)), axis=1)
    if is_steady:
        command *= np.linspace(1.5, 0.3, len(time))
    position, angle, speed, part = np.zeros(len(time)), 0.0, 0.0, DT / 30
    for k, u in enumerate(command):
        position[k] = angle
        for _ in range(30):
            current = (u - EMF * speed) / (1.0 + heat)
            heat += part * (RISE * (1.0 if is_steady else current**2) - heat) / SECONDS
            speed += part * (current - DRAG * speed) / (MOTOR + ARM)
            angle += part * speed
    facts = JointFacts(input="voltage", position_unit="rad", encoder_step=STEP)
    return Log(time, command[:, None], STEP * np.round(position[:, None] / STEP), (1,), facts=(facts,), name=f"{seed}")


def test_a_winding_that_begins_warm_is_found_warm() -> None:
    """In the fitted logs, and in others; beside it nothing else stands for what it cools down."""
    problem = stack(KERNEL, [warmed(1, 0.0), warmed(2, 0.15)], (1,))
    held_out = stack(KERNEL, [warmed(3, 0.2)], (1,))
    candidates = [NAMED[name] for name in ("thermal_drift", "collision", "payload_change", "coulomb_friction")]
    finding = find(problem, (JointStructure(),), candidates, held_out=held_out)
    assert finding.verdict == "named"
    assert [item.name for item in finding.accepted] == ["thermal_drift"]
    point = finding.final.point
    assert point.starts[:, 0, HEAT] == pytest.approx([0.0, 0.15], abs=0.01)
    assert point.parameters[0, 0, KERNEL.column(NAMED["thermal_drift"], "time_constant")] == pytest.approx(SECONDS, 0.1)
    other = started(held_out, point, finding.final.whitener)
    assert other.starts[0, 0, HEAT] == pytest.approx(0.2, abs=0.02)


def test_a_hot_beginning_of_another_log_is_found_though_a_first_step_does_not_reach_it() -> None:
    problem, other = stack(KERNEL, [warmed(1, 0.0)], (1,)), stack(KERNEL, [warmed(3, 0.8)], (1,))
    point = fit_nominal(problem, (JointStructure(),)).point
    drift = extend(problem, point, Hypothesis(NAMED["thermal_drift"], 0), np.array([[RISE, SECONDS]]))
    fitted = in_turns(problem, fit(problem, drift, rounds=2, iterations=8))
    begun = started(other, fitted.point, fitted.whitener)
    assert begun.starts[0, 0, HEAT] == pytest.approx(0.8, abs=0.01)


def test_a_machine_that_warms_up_whatever_the_current_is_a_thermal_drift() -> None:
    """With its rise and time constant, and from cold: a cold winding that is said to begin colder yet would look alike
    in these logs and in no others."""
    problem, held_out = stack(KERNEL, [warmed(1, 0.0, is_steady=True)], (1,)), stack(KERNEL, [warmed(2, 0.0)], (1,))
    names = ("thermal_drift", "thermal_drift_steady", "payload_change", "coulomb_friction")
    finding = find(problem, (JointStructure(),), [NAMED[name] for name in names], held_out=held_out)
    assert finding.verdict == "named"
    assert [(item.name, item.label) for item in finding.accepted] == [("thermal_drift_steady", "thermal_drift")]
    units = JointUnits("voltage", "rad")
    found = effect_parameters(problem, finding.final, finding.covariance, finding.accepted[0], units)
    assert {p.name: p.physical.value for p in found} == pytest.approx(
        {"resistance_rise": RISE, "time_constant": SECONDS}, rel=0.02
    )
    assert np.all(finding.final.point.starts[:, 0, HEAT] >= 0.0)


def test_no_winding_begins_colder_than_cold() -> None:
    problem = stack(KERNEL, [warmed(1, 0.1)], (1,))
    point = fit_nominal(problem, (JointStructure(),)).point
    drift = extend(problem, point, Hypothesis(NAMED["thermal_drift"], 0), np.array([[-0.3, SECONDS]]))
    settled = beginnings_settled(problem, fit(problem, drift, rounds=2, iterations=2))
    assert [f.lower for f in settled.point.free if f.column == HEAT and f.kind == "start"] in ([], [0.0])
    assert np.all(settled.point.starts[:, 0, HEAT] >= 0.0)
    assert np.all(started(problem, settled.point, settled.whitener).starts[:, 0, HEAT] >= 0.0)


def test_only_windings_that_drift_have_a_heat() -> None:
    problem = stack(KERNEL, [swinging(1)], (1,))
    drift = extend(problem, fit_nominal(problem, STRUCTURE).point, Hypothesis(NAMED["thermal_drift"], 0), WARM)
    (heat,) = heats(problem, drift)
    assert (heat.joint, heat.column, heat.size) == (0, HEAT, RISE)
    assert list(heats(problem, model_of(problem))) == []


def test_forms_of_a_law_that_exclude_each_other_are_all_fitted_until_they_converge() -> None:
    """A first fit that stops short of its optimum does not decide between them."""
    problem = stack(KERNEL, [warmed(1, 0.0), warmed(2, 0.0)], (1,))
    base = fit_nominal(problem, (JointStructure(),))
    power, steady = (NAMED[name] for name in ("thermal_drift", "thermal_drift_steady"))

    def rough(effect: Effect, values: list[float], iterations: int) -> Scored:
        start = Start(Hypothesis(effect, 0), np.tile(values, (2, 1)), 0.0)
        point = extend(problem, base.point, start.hypothesis, start.values)
        return score(problem, base, start, fit(problem, point, rounds=1, iterations=iterations))

    first = [rough(power, [0.15, 40.0], 2), rough(steady, [0.3, 6.0], 12)]
    assert 0.5 < first[0].evidence / first[1].evidence < 0.9
    known = sensitivities(problem, base.point, base.error)
    best = _converged(problem, base, first, {}, 3, known, None)[0]
    assert best.name == "thermal_drift"
    assert best.evidence > first[1].evidence + 12.0


def test_no_fit_ends_where_its_renewed_filter_does_worse_than_the_one_that_it_began_with() -> None:
    problem = stack(KERNEL, [warmed(1, 0.0), warmed(2, 0.0)], (1,))
    base = fit_nominal(problem, (JointStructure(),))
    for values in ([0.1, 4.0], [0.2, 30.0], [0.1, 10.0]):
        start = Start(Hypothesis(NAMED["thermal_drift"], 0), np.tile(values, (2, 1)), 0.0)
        first = fit(problem, extend(problem, base.point, start.hypothesis, start.values), rounds=1, iterations=2)
        again = fit(problem, first.point, first.whitener, rounds=2, iterations=4)
        assert again.criterion <= first.criterion
        assert first.criterion == pytest.approx(
            criterion_at(problem, first.point, first.error, first.whitener), rel=1e-12
        )
