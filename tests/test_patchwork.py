"""Laws that are pieces of another one: a spring and a tilt that are a polynomial, a friction that is there twice."""

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation import Fitted, fit
from diagnosis.finding import Accepted
from diagnosis.hypotheses import Hypothesis, Start, extend
from diagnosis.lags import BACK_EMF, WINDING
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.patchwork import Patchwork, draw_back, is_doubled, is_piece, is_polynomial, patchwork, rms_velocity
from diagnosis.problem import Problem, stack
from diagnosis.search import Scored
from envs.log import JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
NAMED = {effect.name: effect for effect in EFFECTS}
KERNEL = build(EFFECTS)
JOINT = {"inertia": 0.07, "viscous": 0.02, "back_emf": 0.7, "electrical_time_constant": 0.004}
HANGING = {
    "cable_spring": {"stiffness": 0.15, "pull": 0.02},
    "gravity_tilt": {"sine": 0.2, "cosine": 0.1},
}
STANDING = {
    "cable_spring": {"stiffness": 0.6, "pull": 0.02},
    "gravity_tilt": {"sine": -0.25, "cosine": 0.1},
}
MARGIN = 6.0


def problem_of(effects: dict[str, dict[str, float]], amplitude: float, step: float) -> Problem:
    """A voltage-driven joint under sines of this amplitude [V], read by an encoder of this step [rad]."""
    time = 2e-3 * np.arange(5000)
    hertz = np.array([0.3, 0.7, 1.3, 2.9, 5.3])
    command = amplitude * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + np.arange(5)), axis=1)[:, None]
    model = StructuredModel((StructuredJoint(1, "voltage", JOINT, effects),), 2e-3, None, EFFECTS)
    position = model.simulate(time, command, State.at_rest(0.0)).position
    facts = JointFacts(input="voltage", position_unit="rad", encoder_step=step)
    return stack(KERNEL, [Log(time, command, step * np.round(position / step), (1,), facts=(facts,))], (1,))


def fitted_with(problem: Problem, effects: dict[str, dict[str, float]]) -> tuple[Fitted, list[Accepted]]:
    """The nominal model with these effects, begun with the given parameters, and the effects as if accepted."""
    nominal = fit_nominal(problem, (JointStructure(),))
    point, starts = nominal.point, []
    for name, known in effects.items():
        effect = NAMED[name]
        values = np.array([[known[p.name] for p in effect.parameters]])
        starts.append(Start(Hypothesis(effect, 0), values, 0.0))
        point = extend(problem, point, starts[-1].hypothesis, values)
    fitted = fit(problem, point, rounds=3, iterations=12)
    return fitted, [Accepted(Scored(start, fitted, 1e3, 10.0), 0.1, ()) for start in starts]


@pytest.mark.parametrize(("amplitude", "step", "alike"), [(1.5, 1e-5, False), (0.2, 1e-3, True)])
@pytest.mark.parametrize("torques", [HANGING, STANDING])
def test_a_polynomial_is_as_good_as_spring_and_tilt_only_where_the_logs_show_no_sine(
    torques, amplitude, step, alike
) -> None:
    """There a weight that hangs beside a spring is one, and one that stands may be what makes a spring stiffen."""
    problem = problem_of(torques, amplitude, step)
    fitted, accepted = fitted_with(problem, torques)
    laws = [item.effect for item in accepted]
    assert is_polynomial(problem, fitted, 0, laws, MARGIN) is alike
    assert draw_back(problem, fitted, 0, laws) is (torques is HANGING)
    is_one = alike and torques is STANDING
    assert patchwork(problem, fitted, accepted, MARGIN) == ({0: Patchwork.POSITION} if is_one else {})
    assert patchwork(problem, fitted, accepted[:1], MARGIN) == {}  # one law is no patchwork


def test_what_may_as_well_draw_the_other_way_does_not_draw_back_for_certain() -> None:
    problem = problem_of(HANGING, 0.2, 1e-3)
    fitted, accepted = fitted_with(problem, HANGING)
    laws = [item.effect for item in accepted]
    assert not draw_back(problem, fitted.informed(fitted.jacobian, 1e6 * fitted.covariance), 0, laws)
    assert not draw_back(problem, fitted, 0, [*laws, NAMED["cogging_torque"]])


def test_the_same_friction_cannot_be_there_twice() -> None:
    problem = problem_of({"coulomb_friction": {"torque": 0.05}}, 1.2, 1e-5)
    fitted, accepted = fitted_with(problem, {"coulomb_friction": {"torque": 0.05}})

    def beside(name: str) -> dict[int, Patchwork]:
        start = Start(Hypothesis(NAMED[name], 0), np.zeros((1, 1)), 0.0)
        other = replace(accepted[0], scored=replace(accepted[0].scored, start=start))
        return patchwork(problem, fitted, [accepted[0], other], MARGIN)

    assert beside("stribeck_friction") == beside("presliding_friction") == {0: Patchwork.FRICTION}
    assert beside("quadratic_drag") == {}


@pytest.mark.parametrize(("rounding", "is_dry"), [(0.05, True), (0.3, True), (6.0, False)])
def test_dry_friction_that_never_reaches_its_level_is_none(rounding: float, is_dry: bool) -> None:
    """tanh(v / v0): at an rms velocity of about 1.9 rad/s nearly the whole level, or less than half of it."""
    friction = {"rounded_coulomb_friction": {"torque": 0.2, "rounding": rounding}}
    problem = problem_of(friction, 1.2, 1e-5)
    assert 1.6 < rms_velocity(problem, 0) < 2.2
    fitted, accepted = fitted_with(problem, friction)
    assert patchwork(problem, fitted, accepted, MARGIN) == ({} if is_dry else {0: Patchwork.FRICTION})


@pytest.mark.parametrize(("other", "step", "is_one"), [(6.2, 1e-5, False), (6.2, 2e-2, True), (12.0, 2e-2, False)])
def test_of_two_waves_of_nearly_one_length_only_the_sum_may_be_certain(other: float, step: float, is_one: bool) -> None:
    """Over about 3 rad, 6 and 6.2 cycles per revolution differ by a tenth of a period, 6 and 12 by three."""
    waves = {
        "cogging_torque": {"sine": 0.03, "cosine": 0.0, "cycles_per_rev": 6.0},
        "cogging_torque_2": {"sine": 0.0, "cosine": 0.03, "cycles_per_rev": other},
    }
    problem = problem_of(waves, 1.2, step)
    fitted, accepted = fitted_with(problem, waves)
    assert 2.0 < np.ptp(problem.reading) < 6.0
    assert is_piece(problem, fitted, 0, [item.effect for item in accepted]) is is_one


@pytest.mark.parametrize(("gap", "is_play"), [(0.004, True), (4e-4, True), (1e-6, False)])
def test_a_play_far_narrower_than_its_hardening_contact_is_deep_is_a_spring(gap: float, is_play: bool) -> None:
    """Hertz's contact, whatever the play with the same force 2 mrad deep."""
    frequency = 22.0 * (gap / 0.004) ** 0.25
    values = {"gap": gap, "inertia_ratio": 0.4, "frequency": frequency, "damping_ratio": 0.1, "exponent": 1.5}
    problem = problem_of({"backlash_power": values}, 1.2, 1e-5)
    fitted, accepted = fitted_with(problem, {"backlash_power": values})
    point = fitted.point.at(fitted.point.vector)
    for name, value in values.items():
        point.parameters[:, 0, KERNEL.column(NAMED["backlash_power"], name)] = value
    found = patchwork(problem, replace(fitted, point=point), accepted, MARGIN)
    assert found == ({} if is_play else {0: Patchwork.SPRING})


@pytest.mark.parametrize(
    ("frequency", "ratio", "is_spring"), [(8.0, 0.05, True), (2.0, 2.0, True), (0.05, 40.0, False)]
)
def test_a_spring_that_never_draws_back_what_its_damper_lets_slip_is_none(frequency, ratio, is_spring) -> None:
    """In a log of 10 s: two dampers that let as much slip per torque, one beside a spring and one without."""
    law = {"joint_flexibility": {"inertia_ratio": 0.4, "frequency": frequency, "damping_ratio": ratio}}
    problem = problem_of(law, 1.2, 1e-5)
    fitted, accepted = fitted_with(problem, law)
    assert fitted.point.value("joint_flexibility.frequency@0") == pytest.approx(frequency, rel=0.5)
    assert patchwork(problem, fitted, accepted, MARGIN) == ({} if is_spring else {0: Patchwork.SLIP})


@pytest.mark.parametrize(("recovery", "is_dry"), [(0.0095, True), (0.02, True), (0.09, False)])
def test_a_constraint_as_slow_as_the_joint_is_a_dead_zone(recovery: float, is_dry: bool) -> None:
    """The joint coasts to rest in 0.1 s."""
    friction = {"constrained_coulomb_friction": {"torque": 0.1, "recovery_time": recovery, "hold": 0.95}}
    problem = problem_of(friction, 1.2, 1e-5)
    fitted, accepted = fitted_with(problem, friction)
    assert patchwork(problem, fitted, accepted, MARGIN) == ({} if is_dry else {0: Patchwork.DEAD_ZONE})


@pytest.mark.parametrize(("offset", "difference", "is_one"), [(0.8, 1.5, True), (0.8, -1.5, False), (0.05, 0.3, False)])
def test_an_offset_and_an_asymmetry_that_cancel_are_pieces_of_another_law(
    offset: float, difference: float, is_one: bool
) -> None:
    """An amplifier whose gain depends on the sign of the command looks like that at one size of commands."""
    known = {"amplifier_offset": {"voltage": offset}, "friction_asymmetry": {"torque": difference, "viscous": 0.0}}
    problem = problem_of({}, 1.2, 1e-5)
    nominal, starts = fit_nominal(problem, (JointStructure(),)), []
    point = nominal.point
    for name, parameters in known.items():
        values = np.array([[parameters[p.name] for p in NAMED[name].parameters]])
        starts.append(Start(Hypothesis(NAMED[name], 0), values, 0.0))
        point = extend(problem, point, starts[-1].hypothesis, values)
    balanced = replace(nominal, point=point)
    accepted = [Accepted(Scored(start, balanced, 1e3, 10.0), 0.1, ()) for start in starts]
    assert patchwork(problem, balanced, accepted, MARGIN) == ({0: Patchwork.STATIC} if is_one else {})


@pytest.mark.parametrize(
    ("lag", "torque_law", "is_one"),
    [
        (0.0, "torque_constant_saturation_power", True),
        (0.0, "torque_constant_saturation", False),
        (0.004, "torque_constant_saturation_power", False),
    ],
)
def test_two_bent_saturations_of_a_drive_that_is_given_its_torque_are_one(
    lag: float, torque_law: str, is_one: bool
) -> None:
    nominal = fit_nominal(problem_of({}, 1.2, 1e-5), (JointStructure(),))
    parameters = nominal.point.parameters.copy()
    parameters[:, 0, [BACK_EMF, WINDING]] = 0.0, lag
    final = replace(nominal, point=replace(nominal.point, parameters=parameters))
    assert is_doubled(final, 0, [NAMED["gradual_voltage_saturation"], NAMED[torque_law]]) == is_one
