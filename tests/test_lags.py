"""The amplifier's lag and those of the joint stand in series, and their order does not show."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_search import JOINT, NAMED, problem_of

from diagnosis.engine import find
from diagnosis.estimation import errors
from diagnosis.hopping import distances
from diagnosis.hypotheses import Hypothesis, extend
from diagnosis.lags import instead_of_winding, joint_with, poles, told_apart, traded
from diagnosis.nominal import JointStructure, point_at
from diagnosis.search import fit
from methods.kernel import NOMINAL

LAG = 0.003


@given(*(st.floats(low, high) for low, high in ((1e-3, 10.0), (0.0, 1.0), (1e-2, 1.0), (1e-4, 0.1))))
def test_a_joint_with_the_lags_of_another_is_that_joint(inertia: float, viscous: float, emf: float, winding: float):
    own = poles(inertia, viscous, emf, winding)
    if not own:  # it oscillates
        assert (inertia + viscous * winding) ** 2 < 4.0 * inertia * winding * (viscous + emf)
        return
    for lag in own:  # the characteristic polynomial vanishes at -1 / lag
        s = -1.0 / lag
        terms = np.array([inertia * winding * s**2, (inertia + viscous * winding) * s, viscous + emf])
        assert abs(terms.sum()) < 1e-6 * np.abs(terms).max()
    again = joint_with(own, viscous, emf)
    assert again is not None
    assert poles(again[0], viscous, emf, again[1]) == pytest.approx(own, rel=1e-5)


def test_a_joint_without_a_winding_has_one_lag():
    assert poles(0.07, 0.02, 0.68, 0.0) == pytest.approx((0.1,))
    assert joint_with((0.1,), 0.02, 0.68) == pytest.approx((0.07, 0.0))


def test_a_joint_that_oscillates_has_no_lags_and_too_much_drag_leaves_no_joint():
    assert poles(0.001, 0.0, 1.0, 0.1) == ()
    assert joint_with((0.1, 0.1), 1.0, 0.0) is not None
    assert joint_with((0.1, 0.1), 1.0, 1e-6) is not None
    assert joint_with((0.1, 0.1001), 1.0, -1e-3) is None


def lagging(**further: dict[str, float]):
    """Logs of a joint whose amplifier lags, and the fit of the model that they come from."""
    effects = {"amplifier_lag": {"time_constant": LAG}, **further}
    problem = problem_of(effects)
    point = point_at(problem, (JointStructure(),))[0]
    for name, values in effects.items():
        own = np.tile(list(values.values()), (problem.logs, 1))
        point = extend(problem, point, Hypothesis(NAMED[name], 0), own)
    for name, value in JOINT.items():
        point.parameters[:, :, NOMINAL.index(name)] = value
    return problem, fit(problem, point, rounds=1)


def test_a_linear_joint_with_lags_in_another_order_moves_in_the_same_way():
    problem, fitted = lagging()
    column = problem.kernel.column(NAMED["amplifier_lag"], "time_constant")
    (other,) = traded(fitted.point, 0, column)
    assert other.parameters[0, 0, column] == pytest.approx(0.0042, rel=0.05)  # that of the winding
    before, after = (errors(problem, [point])[0] for point in (fitted.point, other))
    settled = problem.time > 5.0
    assert np.max(np.abs(after - before)[settled]) < 0.01 * problem.encoder_step
    best, optima = told_apart(problem, fitted, NAMED["amplifier_lag"], 0)
    assert len(optima) == 2
    assert best.criterion == min(optimum.criterion for optimum in optima)


def test_dry_friction_tells_which_lag_is_the_amplifiers():
    problem, fitted = lagging(coulomb_friction={"torque": 0.3})
    optima = told_apart(problem, fitted, NAMED["amplifier_lag"], 0)[1]
    assert len(optima) == 2
    assert [optimum.values["amplifier_lag.time_constant@0"] for optimum in optima] == pytest.approx([LAG] * 2, rel=0.01)
    assert distances(optima)["inertia@0"] < 1e-3 * JOINT["inertia"]


def test_the_order_that_nobody_knows_is_part_of_the_uncertainty():
    problem, _ = lagging()
    structure = JointStructure()
    effects = [NAMED[name] for name in ("amplifier_lag", "coulomb_friction")]
    finding = find(problem, (structure,), effects, tell=lambda text: None)
    assert [item.label for item in finding.accepted] == ["amplifier_lag"]
    names = [f.name for f in finding.final.point.free]
    i = names.index("amplifier_lag.time_constant@0")
    value, deviation = finding.final.point.vector[i], np.sqrt(finding.covariance[i, i])
    for lag in (LAG, 0.0042):
        assert abs(value - lag) < 1.645 * deviation < 0.002


def test_a_winding_that_nobody_stated_may_be_an_amplifier():
    said = []
    for stated in (None, 0.01):
        problem = problem_of({})
        point = point_at(problem, (JointStructure(electrical_time_constant=stated),))[0]
        for name, value in JOINT.items():
            point.parameters[:, :, NOMINAL.index(name)] = value
        said.append(instead_of_winding(point, 0))
    assert said[1] == 0.0
    lag, longest = poles(*(JOINT[name] for name in ("inertia", "viscous", "back_emf", "electrical_time_constant")))
    assert said[0] == lag < longest
