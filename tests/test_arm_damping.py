"""Viscous friction on the arm's side of a spring, which belongs to the nominal robot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from diagnosis.arm_damping import (
    ARM_FRICTION,
    ARM_VISCOUS,
    arm_damping_open,
    arm_damping_settled,
    may_rub_behind,
    on_arms_side,
    rubbing_behind,
    undivided,
)
from diagnosis.engine import find
from diagnosis.estimation import Fitted, errors, finish, fit, measured_precisely, undetermined
from diagnosis.hypotheses import Hypothesis, extend, proposals, sizes_of, withdraw
from diagnosis.nominal import JointStructure, fit_nominal, point_at
from diagnosis.problem import Problem, stack
from diagnosis.pruning import without
from diagnosis.regression import View
from diagnosis.search import met, plays, price, try_all
from envs.log import JointFacts, Log
from methods.effects import built_in
from methods.kernel import NOMINAL, build

EFFECTS = built_in()
KERNEL = build(EFFECTS)
NAMED = {effect.name: effect for effect in EFFECTS}
DT, STEP = 2e-3, 1e-5
MOTOR, ARM, DRAG, EMF = 0.05, 0.04, 0.2, 0.5
HERTZ, RATIO = 6.0, 0.02
VISCOUS, BACK_EMF = NOMINAL.index("viscous"), NOMINAL.index("back_emf")


def dragged(seed: int, on_arm: float, input_: str = "current", *, on_load: bool = False) -> Log:
    """A motor that carries an arm on a spring, a share of the friction on the latter; the exact solution between
    samples. A voltage drives through back-EMF, with no inductance. on_load: the encoder sees the arm."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(5000)
    hertz = np.array([0.4, 1.1, 2.3, 4.1])
    command = np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0, 6, 4)), axis=1)
    stiffness, damping = ARM * (2 * np.pi * HERTZ) ** 2, 2 * RATIO * ARM * 2 * np.pi * HERTZ
    torque = np.array([stiffness, damping, -stiffness, -damping])
    rates = np.zeros((5, 5))  # angle and velocity of the motor, of the arm, and the command
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, :4], rates[3, :4], rates[1, 4] = -torque / MOTOR, torque / ARM, 1.0 / MOTOR
    rates[1, 1] -= ((1 - on_arm) * DRAG + (EMF if input_ == "voltage" else 0.0)) / MOTOR
    rates[3, 3] -= on_arm * DRAG / ARM
    step, state, position = expm(DT * rates), np.zeros(5), np.zeros(len(time))
    for k, u in enumerate(command):
        position[k], state[4] = state[2 if on_load else 0], u
        state = step @ state
    facts = JointFacts(input=input_, position_unit="rad", encoder_step=STEP)  # type: ignore[arg-type]
    return Log(time, command[:, None], STEP * np.round(position[:, None] / STEP), (1,), facts=(facts,), name=f"{seed}")


def sprung(on_arm: float, law: str = "joint_flexibility") -> tuple[Problem, Fitted]:
    """The fit of a spring with all friction on the motor."""
    on_load = law.endswith("load_side")
    problem = stack(KERNEL, [dragged(seed, on_arm, on_load=on_load) for seed in (1, 2)], (1,))
    known = {"inertia@0": MOTOR + ARM, "viscous@0": DRAG}
    rigid = point_at(problem, (JointStructure(input="current"),))[0]
    rigid = rigid.at(np.array([known.get(f.name, v) for f, v in zip(rigid.free, rigid.vector, strict=True)]))
    values = np.tile([ARM / (MOTOR + ARM), HERTZ, RATIO], (problem.logs, 1))
    return problem, fit(problem, extend(problem, rigid, Hypothesis(NAMED[law], 0), values))


def rms(problem: Problem, fitted: Fitted) -> float:
    return float(np.sqrt(np.mean(fitted.error[problem.used] ** 2)))


@pytest.mark.parametrize("on_arm", [1.0, 0.4])
def test_friction_on_the_arm_is_found_there(on_arm: float) -> None:
    problem, before = sprung(on_arm)
    after = arm_damping_settled(problem, before)
    row = after.point.parameters[0, 0]
    assert rms(problem, after) < 1.5 * STEP / np.sqrt(12.0) < 0.5 * rms(problem, before)
    assert row[ARM_VISCOUS] == pytest.approx(on_arm * DRAG, rel=0.02)
    assert row[VISCOUS] == pytest.approx((1 - on_arm) * DRAG, abs=0.02 * DRAG)
    assert arm_damping_settled(problem, after) is after


def test_friction_on_the_motor_stays_there() -> None:
    problem, before = sprung(0.0)
    after = arm_damping_settled(problem, before)
    assert after.criterion <= before.criterion
    assert after.point.parameters[0, 0, ARM_VISCOUS] == 0.0
    assert not any(f.name == "arm_viscous@0" for f in after.point.free)


def test_friction_on_the_arm_that_made_up_for_something_else_goes_back() -> None:
    """As a delay was missing: the model still has the friction on the arm that it then took."""
    problem, before = sprung(0.0)
    point = on_arms_side(before.point, [0], 0.3, 0.3)
    split = finish(problem, point, errors(problem, [point])[0], before.whitener)
    assert split.point.value("arm_viscous@0") > 0.01
    after = arm_damping_settled(problem, split)
    assert not any(f.name == "arm_viscous@0" for f in after.point.free)
    assert after.point.parameters[0, 0, ARM_VISCOUS] == 0.0
    assert after.criterion < split.criterion + np.log(split.samples)


def test_a_division_that_logs_leave_open_is_in_the_deviations() -> None:
    problem, before = sprung(0.0)
    found = arm_damping_open(problem, before)
    assert found.criterion <= before.criterion
    assert found.standard_error("viscous@0") > 3.0 * before.standard_error("viscous@0")
    assert abs(found.point.value("viscous@0") - DRAG) < 3.0 * found.standard_error("viscous@0")
    assert abs(found.point.value("arm_viscous@0")) < 3.0 * found.standard_error("arm_viscous@0")
    assert arm_damping_open(problem, found) is found


def test_behind_an_encoder_on_the_arm_the_division_of_the_inertia_is_open_too() -> None:
    """From a torque to the arm's angle there are five numbers for six parameters: with another division of the damping
    any division of the inertia does the same, as far as half of the damping goes. Differences over steps that change a
    sharp resonance by more than its width hide that."""
    problem, before = sprung(0.3, "joint_flexibility_load_side")
    found = arm_damping_open(problem, before)
    ratio = [f.name for f in found.point.free].index("joint_flexibility_load_side.inertia_ratio@0")

    def deviation() -> float:
        final = measured_precisely(problem, found)
        return float(np.sqrt((final.covariance + undetermined(final))[ratio, ratio]))

    away = abs(found.point.vector[ratio] - ARM / (MOTOR + ARM))
    assert away < 3.0 * deviation()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("diagnosis.estimation.SHORT_STEP", 1e-3)
        assert away > 5.0 * deviation()


def test_damping_is_one_number_again_without_the_spring() -> None:
    problem, before = sprung(1.0)
    fitted = arm_damping_settled(problem, before)
    point = fitted.point
    whole = undivided(problem, withdraw(problem, point, "joint_flexibility", 0))
    assert whole.parameters[0, 0, ARM_VISCOUS] == 0.0
    assert whole.parameters[0, 0, VISCOUS] == pytest.approx(DRAG, rel=0.02)
    assert not any(f.name == "arm_viscous@0" for f in whole.free)
    assert undivided(problem, point) is point
    spring = SimpleNamespace(name="joint_flexibility", joint=0)
    pruned = without(problem, fitted, spring)  # type: ignore[arg-type]
    assert not any(f.name == "arm_viscous@0" for f in pruned.point.free)


DRY, SQUARE = 0.25, 0.05
SIZES = {"coulomb_friction": DRY, "quadratic_drag": SQUARE}


def rubbed(seed: int, on_arm: float, law: str, seconds: float = 8.0, substeps: int = 100) -> Log:
    """A motor that carries an arm on a spring, and friction of which a share acts on the arm; semi-implicit Euler
    steps, dry friction as the impulse that brings each side to rest if it can."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(int(seconds / DT))
    hertz = np.array([0.4, 1.1, 2.3, 4.1])
    command = np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0, 6, 4)), axis=1)
    stiffness, damping = ARM * (2 * np.pi * HERTZ) ** 2, 2 * RATIO * ARM * 2 * np.pi * HERTZ
    sides = (MOTOR, 1.0 - on_arm), (ARM, on_arm)
    position, h = np.zeros(len(time)), DT / substeps
    q, w = [0.0, 0.0], [0.0, 0.0]
    for k, u in enumerate(command):
        position[k] = q[0]
        for _ in range(substeps):
            force = stiffness * (q[0] - q[1]) + damping * (w[0] - w[1])
            for i, (inertia, share) in enumerate(sides):
                torque = (u - DRAG * w[0] - force) if i == 0 else force
                torque -= share * SQUARE * abs(w[i]) * w[i] if law == "quadratic_drag" else 0.0
                w[i] += h * torque / inertia
                most = h * share * DRY / inertia if law == "coulomb_friction" else 0.0
                w[i] -= min(max(w[i], -most), most)
            q = [q[0] + h * w[0], q[1] + h * w[1]]
    facts = JointFacts(input="current", position_unit="rad", encoder_step=STEP)
    return Log(time, command[:, None], STEP * np.round(position[:, None] / STEP), (1,), facts=(facts,), name=f"{seed}")


@cache
def on_the_motor(on_arm: float, law: str) -> tuple[Problem, Fitted]:
    """The fit of a spring and a law of friction with all friction on the motor."""
    problem = stack(KERNEL, [rubbed(seed, on_arm, law) for seed in (1, 2)], (1,))
    known = {"inertia@0": MOTOR + ARM, "viscous@0": DRAG}
    point = point_at(problem, (JointStructure(input="current"),))[0]
    point = point.at(np.array([known.get(f.name, v) for f, v in zip(point.free, point.vector, strict=True)]))
    values = np.tile([ARM / (MOTOR + ARM), HERTZ, RATIO], (problem.logs, 1))
    point = extend(problem, point, Hypothesis(NAMED["joint_flexibility"], 0), values)
    values = np.full((problem.logs, 1), SIZES[law])
    return problem, fit(problem, extend(problem, point, Hypothesis(NAMED[law], 0), values))


@pytest.mark.parametrize(
    ("on_arm", "law"),
    [
        pytest.param(0.4, "coulomb_friction", marks=pytest.mark.slow),
        (1.0, "quadratic_drag"),
        (0.5, "quadratic_drag"),
    ],
)
def test_a_law_of_friction_is_found_on_the_arm(on_arm: float, law: str) -> None:
    problem, before = on_the_motor(on_arm, law)
    after = arm_damping_settled(problem, before)
    row = after.point.parameters[0, 0]
    assert row[ARM_FRICTION] == pytest.approx(on_arm, abs=0.03)
    assert row[KERNEL.own(NAMED[law])][0] == pytest.approx(SIZES[law], rel=0.02)
    assert rms(problem, after) < 2.0 * STEP / np.sqrt(12.0)
    assert rms(problem, before) > 2.0 * rms(problem, after)
    again = arm_damping_settled(problem, after)
    assert again.criterion <= after.criterion


def test_a_law_of_friction_on_the_motor_stays_there() -> None:
    problem, before = on_the_motor(0.0, "coulomb_friction")
    after = arm_damping_settled(problem, before)
    assert after.point.parameters[0, 0, ARM_FRICTION] == 0.0
    assert not any(f.name == "arm_friction@0" for f in after.point.free)


@pytest.mark.parametrize("on_arm", [1.0, 0.0])
def test_a_law_of_friction_beside_a_spring_is_begun_on_both_sides(on_arm: float) -> None:
    """From the wrong one a fit may not find the way to the other."""
    problem, whole = on_the_motor(on_arm, "coulomb_friction")
    if on_arm:
        point = rubbing_behind(whole.point, [0], 1.0)
        known = {"inertia@0": MOTOR + ARM, "viscous@0": DRAG, "coulomb_friction.torque@0": DRY, "arm_friction@0": 1.0}
        spring = {"inertia_ratio": ARM / (MOTOR + ARM), "frequency": HERTZ, "damping_ratio": RATIO}
        known |= {f"joint_flexibility.{name}@0": value for name, value in spring.items()}
        vector = [known.get(f.name, v) for f, v in zip(point.free, point.vector, strict=True)]
        whole = fit(problem, point.at(np.array(vector)))
    base = fit(problem, undivided(problem, withdraw(problem, whole.point, "coulomb_friction", 0)))
    law, sizes = NAMED["coulomb_friction"], sizes_of(problem, base)
    begun = proposals(problem, [View.of(problem, base)], [(law, 0)], sizes)[0]
    assert {start.hypothesis.behind for start in begun} == {True, False}
    start = next(start for start in begun if start.hypothesis.behind)
    point = extend(problem, base.point, start.hypothesis, start.values)
    assert point.parameters[0, 0, ARM_FRICTION] == 1.0
    assert any(f.name == "arm_friction@0" for f in point.free)
    assert not may_rub_behind(problem, point, NAMED["quadratic_drag"], 0)  # it would go where the first one is
    before = replace(start, hypothesis=replace(start.hypothesis, behind=False))
    assert price(problem, start, 1000) - price(problem, before, 1000) == pytest.approx(np.log(1000))
    (best,) = try_all(problem, base, [(law, 0)])
    assert best.start.hypothesis.behind == (on_arm == 1.0)
    assert best.fitted.point.parameters[0, 0, ARM_FRICTION] == pytest.approx(on_arm, abs=0.02)
    assert best.fitted.point.parameters[0, 0, KERNEL.own(law)][0] == pytest.approx(DRY, rel=0.02)


@pytest.mark.parametrize("gone", ["joint_flexibility", "coulomb_friction"])
def test_friction_has_one_side_again_without_the_spring_or_without_the_law(gone: str) -> None:
    problem, before = on_the_motor(0.0, "coulomb_friction")
    point = rubbing_behind(before.point, [0], 0.4)
    assert any(f.name == "arm_friction@0" for f in point.free)
    assert undivided(problem, point) is point
    whole = undivided(problem, withdraw(problem, point, gone, 0))
    assert whole.parameters[0, 0, ARM_FRICTION] == 0.0
    assert not any(f.name == "arm_friction@0" for f in whole.free)


@pytest.mark.slow
def test_the_search_finds_dry_friction_on_an_arm() -> None:
    """Found on the motor first, where it is exact neither with a spring nor without."""
    problem = stack(KERNEL, [rubbed(seed, 1.0, "coulomb_friction", 20.0) for seed in (1, 2)], (1,))
    held_out = stack(KERNEL, [rubbed(3, 1.0, "coulomb_friction")], (1,))
    candidates = [NAMED[name] for name in ("joint_flexibility", "coulomb_friction", "input_delay", "backlash")]
    finding = find(problem, (JointStructure(input="current"),), candidates, held_out=held_out)
    assert finding.verdict == "named"
    assert {item.name for item in finding.accepted} == {"joint_flexibility", "coulomb_friction"}
    row = finding.final.point.parameters[0, 0]
    assert row[ARM_FRICTION] == pytest.approx(1.0, abs=0.01)
    assert row[KERNEL.own(NAMED["coulomb_friction"])][0] == pytest.approx(DRY, rel=0.01)
    assert rms(problem, finding.final) < 1.5 * STEP / np.sqrt(12.0)


@pytest.mark.slow
def test_the_search_finds_friction_on_an_arm_that_a_voltage_drives() -> None:
    problem = stack(KERNEL, [dragged(seed, 1.0, "voltage") for seed in (1, 2)], (1,))
    held_out = stack(KERNEL, [dragged(3, 1.0, "voltage")], (1,))
    candidates = [NAMED[name] for name in ("joint_flexibility", "coulomb_friction", "input_delay")]
    finding = find(problem, (JointStructure(input="voltage"),), candidates, held_out=held_out)
    assert finding.verdict == "named"
    assert [item.name for item in finding.accepted] == ["joint_flexibility"]
    row = finding.final.point.parameters[0, 0]
    assert row[ARM_VISCOUS] == pytest.approx(DRAG, rel=0.2)  # a lag of the winding, which is not stated, trades with it
    assert row[[VISCOUS, BACK_EMF, ARM_VISCOUS]].sum() == pytest.approx(DRAG + EMF, rel=0.01)
    assert rms(problem, finding.final) < 1e-2 * rms(problem, finding.steps[0])


def behind_play(seed: int, seconds: float = 20.0, substeps: int = 20) -> Log:
    """A servo under PD control of the arm's angle, with a play between gear and arm and part of the damping on the
    arm; semi-implicit Euler steps, white noise on the readings."""
    rng = np.random.default_rng(seed)
    count, h = int(seconds / DT), DT / substeps
    noise = 5e-5 * rng.standard_normal(count)
    time = DT * np.arange(count)
    hertz, phases = np.array([0.3, 0.8, 1.7]), rng.uniform(0.0, 6.0, 3)
    wanted = np.sum([0.3, 0.1, 0.04] * np.sin(2 * np.pi * np.outer(time, hertz) + phases), axis=1)
    motor, arm, gap, contact, knock, drag, emf = 0.0126, 0.0067, 0.021, 1100.0, 1.35, 0.18, 1.3
    command, reading = np.zeros(count), np.zeros(count)
    q = np.full(2, wanted[0])
    w = np.zeros(2)
    before = wanted[0]
    for k in range(count):
        reading[k] = q[1] + noise[k]
        error = wanted[k] - reading[k]
        command[k] = np.clip(30.0 * error - 0.6 * (reading[k] - before) / DT, -12.0, 12.0)
        before = reading[k]
        for _ in range(substeps):
            twist, rate = q[0] - q[1], w[0] - w[1]
            force = 0.0
            if abs(twist) > gap / 2:
                force = contact * (twist - np.sign(twist) * gap / 2) + knock * rate
                force = max(force, 0.0) if twist > 0.0 else min(force, 0.0)
            w = w + h * np.array([(command[k] - emf * w[0] - force) / motor, (force - drag * w[1]) / arm])
            q = q + h * w
    facts = JointFacts(position_unit="rad", encoder_step=STEP)
    return Log(time, command[:, None], reading[:, None], (1,), facts=(facts,), name=f"{seed}")


@pytest.mark.slow
def test_a_play_of_which_the_encoder_sees_the_arm_is_begun_with_damping_behind_it() -> None:
    """With all damping on the motor's side no gap comes close to the motion, and none is found."""
    problem, effect = stack(KERNEL, [behind_play(seed) for seed in (1, 2)], (1,)), NAMED["backlash_load_side"]
    base = fit_nominal(problem, (JointStructure(),))
    size = sizes_of(problem, base)[0]
    plain = met(problem, base, effect, 0, size)
    fitted = plays(problem, base, [(effect, 0)], is_sought=False)[0].fitted
    assert fitted.criterion < min([base.criterion, *(other.criterion for _, other in plain)]) - 10_000.0
    gap = fitted.point.parameters[0, 0, KERNEL.own(effect)][0]
    assert gap == pytest.approx(0.021, rel=0.1)
