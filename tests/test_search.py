"""The search for missing effects: forms of laws, the unfiltered view, what becomes free, what is put together."""

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.engine import Accepted, Settings, confirmed, merged
from diagnosis.estimation import errors, fit, plain
from diagnosis.hypotheses import Hypothesis, effective_samples, extend, proposals, sizes_of, withdraw
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem, stack
from diagnosis.search import Scored, exchanged, price
from envs.log import Array, JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.effects.base import Effect, geometric
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
KERNEL = build(EFFECTS)
NAMED = {effect.name: effect for effect in EFFECTS}
DT, STEP = 2e-3, 1e-5
JOINT = {"inertia": 0.07, "viscous": 0.02, "back_emf": 0.7, "electrical_time_constant": 0.004}


def record(effects: dict[str, dict[str, float]], noise: Array | None = None, seconds: float = 10.0) -> Log:
    """A voltage-driven joint with these effects under a multisine; noise (T,): a torque that nobody logged."""
    time = DT * np.arange(int(seconds / DT))
    hertz = np.array([0.3, 0.7, 1.3, 2.9, 5.3])
    command = np.sum(1.2 * np.sin(2 * np.pi * np.outer(time, hertz) + np.arange(5)), axis=1)[:, None]
    model = StructuredModel((StructuredJoint(1, "voltage", JOINT, effects),), DT, None, EFFECTS)
    applied = command if noise is None else command + noise[:, None]
    motion = model.simulate(time, applied, State.at_rest(0.0))
    facts = JointFacts(input="voltage", position_unit="rad", encoder_step=STEP)
    return Log(time, command, STEP * np.round(motion.position / STEP), (1,), facts=(facts,), name="synthetic")


def problem_of(effects: dict[str, dict[str, float]], noise: Array | None = None) -> Problem:
    return stack(KERNEL, [record(effects, noise)], (1,))


def free(problem: Problem, point) -> set[str]:
    return {f.name for f in point.free}


def test_effects_in_whose_law_the_motor_torque_enters() -> None:
    found = {effect.label for effect in EFFECTS if effect.has_motor_torque}
    assert found == {
        "load_dependent_friction",
        "supply_sag",
        "thermal_drift",
        "torque_constant_saturation",
        "torque_ripple",
    }


def test_mechanical_damping_becomes_free_with_the_motor_torque_and_only_with_it() -> None:
    problem = problem_of({})
    nominal = fit_nominal(problem, (JointStructure(),)).point
    friction = Hypothesis(NAMED["load_dependent_friction"], 0)
    larger = extend(problem, nominal, friction, np.full((1, 1), 0.1))
    assert free(problem, larger) - free(problem, nominal) == {"load_dependent_friction.coefficient@0", "viscous@0"}
    moved = larger.at(larger.vector + np.array([0.2 * (f.name == "viscous@0") for f in larger.free]))
    back = withdraw(problem, moved, "load_dependent_friction", 0)
    assert free(problem, back) == free(problem, nominal)
    assert back.parameters[0, 0, 1:3].sum() == pytest.approx(moved.parameters[0, 0, 1:3].sum())
    dry = extend(problem, nominal, Hypothesis(NAMED["coulomb_friction"], 0), np.full((1, 1), 0.1))
    assert "viscous@0" not in free(problem, dry)


def test_load_dependent_friction_needs_the_split_of_the_damping() -> None:
    """With the split at its wrong given value the law does not fit; freed, coefficient and split are found."""
    problem = problem_of({"load_dependent_friction": {"coefficient": 0.25}})
    nominal = fit_nominal(problem, (JointStructure(),))
    point = extend(problem, nominal.point, Hypothesis(NAMED["load_dependent_friction"], 0), np.full((1, 1), 0.1))
    fitted = fit(problem, point, rounds=3, iterations=12)
    assert fitted.point.value("load_dependent_friction.coefficient@0") == pytest.approx(0.25, rel=0.01)
    assert fitted.point.value("viscous@0") == pytest.approx(0.02, rel=0.1)
    fixed = replace(point, free=tuple(f for f in point.free if f.name != "viscous@0"))
    assert fit(problem, fixed, rounds=3, iterations=12).criterion > fitted.criterion + 100.0


def test_no_view_takes_an_offset_for_noise() -> None:
    noise = 0.02 * np.random.default_rng(0).standard_normal(5000)
    problem = problem_of({"amplifier_offset": {"voltage": 0.1}}, noise)
    nominal = fit_nominal(problem, (JointStructure(),))
    views = [nominal, plain(problem, nominal)]
    candidates = [(NAMED["amplifier_offset"], 0)]
    filtered, bare = (starts[0] for starts in proposals(problem, views, candidates, sizes_of(problem, nominal)))
    assert min(bare.promise, filtered.promise) > 100.0
    assert bare.values[0, 0] == pytest.approx(0.1, rel=0.05)


def test_effective_samples() -> None:
    rng = np.random.default_rng(1)
    white = rng.standard_normal(20_000)
    assert effective_samples(white, 1) == pytest.approx(20_000, rel=0.1)
    slow = np.convolve(white, np.ones(50), mode="same")
    assert 200 < effective_samples(slow, 1) < 800


@pytest.mark.parametrize("name", ["dead_zone", "voltage_saturation"])
def test_gradual_forms_become_the_one_with_corners(name: str) -> None:
    hard, gradual = NAMED[name].function, NAMED[f"gradual_{name}"].function
    assert hard is not None
    assert gradual is not None
    command = np.linspace(-2.0, 2.0, 81)
    arguments = (0.0, 0.0, 0.0, 0.0)
    sharp = [gradual(u, *arguments, (0.7, 60.0)) for u in command]
    assert np.max(np.abs(sharp - np.array([hard(u, *arguments, (0.7,)) for u in command]))) < 0.02
    soft = np.array([gradual(u, *arguments, (0.7, 2.0)) for u in command])
    assert np.all(np.diff(soft) > 0.0)


def test_saturation_by_a_power_contains_the_rational_law() -> None:
    rational, power = (NAMED[n].function for n in ("torque_constant_saturation", "torque_constant_saturation_power"))
    assert rational is not None
    assert power is not None
    assert power(0.0, 0.0, 0.0, 1.7, (0.3, 1.0)) == pytest.approx(rational(0.0, 0.0, 0.0, 1.7, (0.3,)))


def test_a_load_picked_up_at_rest_keeps_the_momentum() -> None:
    """J v = (J + m) v' at the instant; a load that moves along keeps the velocity."""
    time = DT * np.arange(400)
    coasting = {"inertia": 0.07, "viscous": 0.0, "back_emf": 0.0, "electrical_time_constant": 0.0}
    after = {}
    for name in ("payload_change", "payload_change_at_rest"):
        effects = {name: {"inertia": 0.03, "time": 0.5}}
        model = StructuredModel((StructuredJoint(1, "torque", coasting, effects),), DT, None, EFFECTS)
        start = State(np.zeros(1), np.full(1, 2.0), np.zeros(1))
        after[name] = model.simulate(time, np.zeros((400, 1)), start).velocity[-1, 0]
    assert after["payload_change"] == pytest.approx(2.0)
    assert after["payload_change_at_rest"] == pytest.approx(2.0 * 0.07 / 0.10)


def test_an_encoder_on_the_load_lags_behind_one_on_the_motor() -> None:
    shape = {"inertia_ratio": 0.4, "frequency": 6.0, "damping_ratio": 0.05}
    motor, load = (
        record({name: shape}, seconds=2.0).position[:, 0]
        for name in ("joint_flexibility", "joint_flexibility_load_side")
    )
    stiff = record({}, seconds=2.0).position[:, 0]
    span = np.ptp(stiff)
    assert np.max(np.abs(motor - load)) > 0.005 * span
    twist = load - motor  # J_l q_l'' over the spring: a low-pass of the acceleration, zero at rest
    assert abs(twist[0]) <= 2 * STEP


def accepted(problem: Problem, base, name: str, values: list[float]) -> Accepted:
    """An effect that was fitted on top of a base."""
    hypothesis = Hypothesis(NAMED[name], 0)
    fitted = fit(problem, extend(problem, base.point, hypothesis, np.array([values])), rounds=3, iterations=12)
    from diagnosis.hypotheses import Start

    start = Start(hypothesis, np.array([values]), 0.0)
    return Accepted(
        Scored(start, fitted, base.criterion - fitted.criterion, price(problem, start, base.samples)), 0.1, ()
    )


def test_a_friction_law_takes_the_place_of_the_simpler_one_that_it_contains() -> None:
    law = {"torque": 0.2, "excess": 0.2, "velocity": 0.3, "exponent": 2.0}
    problem = problem_of({"stribeck_friction": law})
    nominal = fit_nominal(problem, (JointStructure(),))
    coulomb = accepted(problem, nominal, "coulomb_friction", [0.2])
    both = accepted(problem, coulomb.scored.fitted, "stribeck_friction", [0.05, 0.1, 0.3, 1.5])
    left, whole = merged(problem, coulomb.scored.fitted, [coulomb], both, Settings())
    assert left == []
    point = whole.scored.fitted.point
    assert not any(f.name.startswith("coulomb") for f in point.free)
    assert point.value("stribeck_friction.torque@0") == pytest.approx(0.2, rel=0.02)
    assert point.value("stribeck_friction.excess@0") == pytest.approx(0.2, rel=0.05)


def test_rivals_are_judged_beside_what_was_found_later() -> None:
    noise = 1e-4 * np.random.default_rng(0).standard_normal(5000)
    problem = problem_of({"coulomb_friction": {"torque": 0.2}}, noise)
    nominal = fit_nominal(problem, (JointStructure(),))
    true = accepted(problem, nominal, "coulomb_friction", [0.2])
    wrong = accepted(problem, nominal, "quadratic_drag", [0.01]).scored
    same = true.scored
    spring = accepted(problem, true.scored.fitted, "cable_spring", [0.01, 0.0])
    item = confirmed(problem, spring.scored.fitted, replace(true, rivals=(wrong, same)), [spring], Settings())
    assert [rival.name for rival in item.rivals] == ["coulomb_friction"]


def test_lags_trade_places() -> None:
    """The three lags in series of a joint with a slow amplifier: the effect is tried as each of the other two."""
    problem = problem_of({"amplifier_lag": {"time_constant": 0.02}})
    nominal = fit_nominal(problem, (JointStructure(electrical_time_constant=0.005, inertia=0.08),))
    starts = proposals(problem, [nominal], [(NAMED["amplifier_lag"], 0)], sizes_of(problem, nominal))[0]
    fits = [fit(problem, p, rounds=3, iterations=12) for p in exchanged(problem, nominal.point, starts[0])]
    lags = [fitted.point.value("amplifier_lag.time_constant@0") for fitted in fits]
    assert lags[0] == pytest.approx(0.02, rel=0.02)
    assert fits[0].point.value("inertia@0") == pytest.approx(JOINT["inertia"], rel=0.02)
    assert lags[1] == pytest.approx(JOINT["inertia"] / 0.72, rel=0.1)


@pytest.mark.parametrize(
    ("name", "parameters"), [("collision", (0.3, 1.0, 0.5, 1.0)), ("periodic_disturbance", (0.3, 0.0, 0.2))]
)
def test_what_comes_from_outside_pushes(name: str, parameters: tuple[float, ...]) -> None:
    """A positive torque drives the joint forwards: the slot's function, which resists, is negative."""
    function = NAMED[name].function
    assert function is not None
    assert function(1.25, 0.0, 0.0, 0.0, np.zeros(3), parameters) == pytest.approx(-0.3)


def test_geometric() -> None:
    assert geometric(1.0, 8.0, 2.1) == pytest.approx([1.0, 2.0, 4.0, 8.0])
    assert geometric(3.0, 2.0, 2.0) == [3.0]


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.tries > 1], ids=lambda effect: effect.name)
def test_shapes_are_all_parameters_but_the_amplitudes(effect: Effect) -> None:
    assert sorted((*effect.shapes, *effect.amplitudes)) == list(range(effect.size))


def test_reused_sensitivities_lead_to_the_same_optimum() -> None:
    problem = problem_of({"coulomb_friction": {"torque": 0.2}})
    nominal = fit_nominal(problem, (JointStructure(),))
    fitted = accepted(problem, nominal, "coulomb_friction", [0.05]).scored.fitted
    again = fit(problem, fitted.point, rounds=3, iterations=20)
    assert fitted.criterion - again.criterion < 6.0  # the filter goes on settling
    assert np.array_equal(errors(problem, [fitted.point])[0], fitted.error)
