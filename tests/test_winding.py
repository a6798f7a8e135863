"""A winding's lag holds up the back-EMF and not the friction of bearings, so that what resists tells the two apart."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from diagnosis.arm_damping import arm_damping_open
from diagnosis.estimation import Fitted, finish, fit, measured_precisely, sensitivities, undetermined
from diagnosis.hypotheses import Hypothesis, extend, withdraw
from diagnosis.nominal import JointStructure, damping_settled, fit_nominal
from diagnosis.problem import MECHANICAL, Problem, stack
from envs.log import Array, JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
KERNEL = build(EFFECTS)
NAMED = {effect.name: effect for effect in EFFECTS}
DT, STEP = 1e-3, 1e-5
INERTIA, VISCOUS, BACK_EMF, WINDING, FRICTION = 0.02, 0.15, 0.15, 0.006, 0.2
FRICTIONAL = {"coulomb_friction": {"torque": FRICTION}}
SPRUNG = {"joint_flexibility": {"inertia_ratio": 0.5, "frequency": 6.0, "damping_ratio": 0.05}}


@cache
def recorded(is_sprung: bool = False) -> Problem:
    """Two logs of a motor half of whose damping is mechanical, with dry friction or with an arm on a spring."""
    time, rng, logs = DT * np.arange(15000), np.random.default_rng(0), []
    known = {"inertia": INERTIA, "viscous": VISCOUS, "back_emf": BACK_EMF, "electrical_time_constant": WINDING}
    effects = SPRUNG if is_sprung else FRICTIONAL
    model = StructuredModel((StructuredJoint(1, "voltage", known, effects),), DT, None, EFFECTS)
    for number in range(2):
        hertz = np.linspace(0.2, 6.0, 14) * (1.0 + 0.05 * number)
        phase = rng.uniform(0.0, 6.28, 14)
        command = 0.4 * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + phase), axis=1)[:, None]
        position = model.simulate(time, command, State.at_rest(np.zeros(1))).position
        facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=STEP),)
        logs.append(Log(time, command, STEP * np.round(position / STEP), (1,), facts=facts, name=f"log {number}"))
    return stack(KERNEL, logs, (1,))


def floors(problem: Problem, fitted: Fitted) -> float:
    """Rms of the errors over that of the encoder's steps."""
    return float(np.sqrt(12.0 * np.mean(fitted.error[problem.used] ** 2))) / STEP


def with_friction(problem: Problem, share: float) -> Fitted:
    """The joint with the friction that it has, a share of the damping being mechanical as stated."""
    nominal = fit_nominal(problem, (JointStructure(viscous_share=share),))
    friction = Hypothesis(NAMED["coulomb_friction"], 0)
    return fit(problem, extend(problem, nominal.point, friction, np.full((problem.logs, 1), 0.1)), iterations=12)


def test_dry_friction_tells_the_share_that_nobody_stated() -> None:
    problem = recorded()
    before = with_friction(problem, 0.0)
    assert floors(problem, before) > 5.0
    found = damping_settled(problem, before)
    assert floors(problem, found) < 2.0
    assert found.point.value("coulomb_friction.torque@0") == pytest.approx(FRICTION, rel=1e-3)
    assert found.point.value("viscous@0") == pytest.approx(VISCOUS, rel=0.05)
    also = extend(problem, found.point, Hypothesis(NAMED["quadratic_drag"], 0), np.full((problem.logs, 1), 0.01))
    fewer = withdraw(problem, also, "quadratic_drag", 0)
    assert fewer.value("viscous@0") == found.point.value("viscous@0")  # the friction still tells it
    bare = withdraw(problem, fewer, "coulomb_friction", 0)
    assert "viscous@0" not in {f.name for f in bare.free}
    assert bare.value("back_emf@0") == pytest.approx(VISCOUS + BACK_EMF, rel=0.01)
    assert damping_settled(problem, fit_nominal(problem, (JointStructure(),))).point.free == before.point.free[:-1]


def test_a_stated_mechanical_damping_is_no_share_of_what_a_fit_gives_without_the_effects() -> None:
    """Without the spring the fit damps ten times as much here."""
    stated = JointStructure(viscous_share=0.4, damping=2.0 * VISCOUS)
    problem = recorded(is_sprung=True)
    point = fit_nominal(problem, (stated,)).point
    assert point.value("back_emf@0") > 10.0 * BACK_EMF
    assert point.parameters[0, 0, 1] == pytest.approx(0.8 * VISCOUS)
    point.parameters[:, 0, 0], point.parameters[:, 0, 2:4] = INERTIA, (BACK_EMF, WINDING)
    spring = Hypothesis(NAMED["joint_flexibility"], 0)
    values = np.tile(list(SPRUNG["joint_flexibility"].values()), (problem.logs, 1))
    found = damping_settled(problem, fit(problem, extend(problem, point, spring, values), iterations=12))
    (free,) = (f for f in found.point.free if f.name == "viscous@0")
    assert (free.centre, free.deviation) == (pytest.approx(0.8 * VISCOUS), pytest.approx(VISCOUS))
    assert found.point.value("viscous@0") == pytest.approx(VISCOUS, rel=0.05)


def test_a_stated_share_is_left_as_it_is() -> None:
    problem = recorded()
    stated = with_friction(problem, 0.4)
    assert damping_settled(problem, stated) is stated


def test_a_spring_tells_the_share_though_another_was_stated() -> None:
    """Without it the spring is off by far more than its standard deviation."""
    problem = recorded(is_sprung=True)
    point = fit_nominal(problem, (JointStructure(viscous_share=0.4),)).point
    point.parameters[:, 0, :4] = INERTIA, 0.8 * VISCOUS, BACK_EMF + 0.2 * VISCOUS, WINDING
    values = np.tile(list(SPRUNG["joint_flexibility"].values()), (problem.logs, 1))
    point = extend(problem, point, Hypothesis(NAMED["joint_flexibility"], 0), values)
    before = fit(problem, point, iterations=12)
    found = damping_settled(problem, before)
    assert floors(problem, before) > 3.0 > 2.0 > floors(problem, found)
    assert found.point.value("viscous@0") == pytest.approx(VISCOUS, rel=0.05)
    assert found.point.value("joint_flexibility.frequency@0") == pytest.approx(6.0, rel=1e-3)
    also = extend(problem, found.point, Hypothesis(NAMED["quadratic_drag"], 0), np.full((problem.logs, 1), 0.01))
    fewer = withdraw(problem, also, "quadratic_drag", 0)
    assert fewer.value("viscous@0") == found.point.value("viscous@0")


def test_deviations_are_those_of_parameters_that_stand_in_for_one_another() -> None:
    """Behind a spring back-EMF and friction on either side do so but for a little, less than what forward differences
    over a thousandth of each are wrong by."""
    problem = recorded(is_sprung=True)
    known = JointStructure(viscous_share=0.4, inertia=INERTIA, electrical_time_constant=WINDING)
    point = fit_nominal(problem, (known,)).point
    point.parameters[:, 0, :4] = INERTIA, VISCOUS, BACK_EMF, WINDING
    values = np.tile(list(SPRUNG["joint_flexibility"].values()), (problem.logs, 1))
    point = extend(problem, point, Hypothesis(NAMED["joint_flexibility"], 0), values)
    found = arm_damping_open(problem, damping_settled(problem, fit(problem, point, iterations=12)))
    fine = sensitivities(problem, found.point, found.error, step=1e-6)
    told = finish(problem, found.point, found.error, found.whitener, slopes=fine)
    names = [f.name for f in found.point.free]
    deviations = [
        dict(zip(names, np.sqrt(np.diag(own.covariance + undetermined(own))), strict=True))
        for own in (found, measured_precisely(problem, found), told)
    ]
    for name in ("back_emf@0", "arm_viscous@0", "joint_flexibility.inertia_ratio@0"):
        forward, precise, true = (own[name] for own in deviations)
        assert precise == pytest.approx(true, rel=0.3)
        assert forward < 0.1 * true
    assert deviations[1]["arm_viscous@0"] < 1.1 * MECHANICAL * (VISCOUS + BACK_EMF)  # as is known beforehand


@pytest.mark.parametrize(("winding", "most"), [(0.009, 0.002), (0.003, 0.003)])
def test_a_supply_gives_way_to_the_current_while_it_grows(winding: float, most: float) -> None:
    """Within a sample, too: a current that rises within a few of them is not the one of the sample's beginning."""
    gain, substeps = 0.05, 25
    rng = np.random.default_rng(0)
    command = 3.0 * np.sign(np.repeat(rng.standard_normal(60), 25))

    def moved(gain: float) -> Array:
        q = v = w = 0.0
        found, h = [], DT / substeps
        for u in command:
            found.append(q)
            for _ in range(substeps):  # the middle of the step by half of it
                half = w + 0.5 * h * (u / (1.0 + gain * abs(w)) - BACK_EMF * v - w) / winding
                rate = v + 0.5 * h * (w - VISCOUS * v) / INERTIA
                q += h * rate
                v += h * (half - VISCOUS * rate) / INERTIA
                w += h * (u / (1.0 + gain * abs(half)) - BACK_EMF * rate - half) / winding
        return np.array(found)

    joint = {
        "inertia": INERTIA,
        "viscous": VISCOUS,
        "back_emf": BACK_EMF,
        "electrical_time_constant": winding,
    }
    sag = {"supply_sag_levelling": {"gain": gain, "levelling": 1.0}}
    model = StructuredModel((StructuredJoint(1, "voltage", joint, sag),), DT, None, EFFECTS)
    position = model.simulate(DT * np.arange(len(command)), command[:, None], State.at_rest(0.0)).position[:, 0]
    true, without = moved(gain), moved(0.0)
    assert np.sqrt(np.mean((position - true) ** 2)) < most * np.sqrt(np.mean((true - without) ** 2))
