"""A load that an arm picks up adds to its inertia and, where gravity pulls the arm, to its weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.engine import find
from diagnosis.estimation import fit
from diagnosis.hypotheses import Hypothesis, extend, scan, sizes_of
from diagnosis.instants import retimed, with_instants
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import stack
from diagnosis.replay import transfer
from envs.log import JointFacts, Log
from methods.effects import built_in
from methods.kernel import build

EFFECTS = built_in()
KERNEL = build(EFFECTS)
NAMED = {effect.name: effect for effect in EFFECTS}
DT, STEP = 4e-3, 1e-5
INERTIA, DRAG, WEIGHT = 0.05, 0.4, 0.9
LOAD, PULL, PICKED_UP = 0.01, 0.3, 8.4


def lifting(seed: int, pull: float, load: float = LOAD, rested: bool = False, wave: float = 0.0, dt: float = DT) -> Log:
    """A pendulum that picks up a load, which may have rested, in thirty steps of its equations a sample; its encoder's
    disc may be off centre by a wave."""
    rng = np.random.default_rng(seed)
    time = dt * np.arange(round(20.0 / dt))
    hertz = np.array([0.3, 0.7, 1.3, 3.1])
    command = 0.8 * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0, 6, 4)), axis=1)
    position, angle, speed, part, carried = np.zeros(len(time)), 0.0, 0.0, dt / 30, False
    for k, u in enumerate(command):
        position[k] = angle
        for i in range(30):
            carries = time[k] + i * part >= PICKED_UP
            weight = (WEIGHT + pull * carries) * np.sin(angle)
            if rested and not carried and carries:
                speed *= INERTIA / (INERTIA + load)
            carried = carries
            speed += part * (u - DRAG * speed - weight) / (INERTIA + load * carries)
            angle += part * speed
    position += wave * np.sin(position + 0.4)
    facts = JointFacts(input="torque", position_unit="rad", encoder_step=STEP)
    return Log(time, command[:, None], STEP * np.round(position[:, None] / STEP), (1,), facts=(facts,), name=f"{seed}")


@pytest.mark.parametrize(("pull", "form"), [(PULL, "payload_change_weighed"), (0.0, "payload_change")])
def test_a_load_is_found_with_its_weight_if_it_has_one(pull: float, form: str) -> None:
    problem, held_out = (stack(KERNEL, [lifting(seed, pull) for seed in own], (1,)) for own in ((1, 2), (3,)))
    candidates = [
        effect for effect in EFFECTS if effect.label in ("payload_change", "coulomb_friction", "cable_spring")
    ]
    structure = (JointStructure(input="torque", gravity="pendulum"),)
    finding = find(problem, structure, candidates, held_out=held_out)
    assert finding.verdict == "named"
    assert [item.name for item in finding.accepted] == [form]
    values = finding.final.point.parameters[0, 0, KERNEL.own(NAMED[form])]
    assert values[:2] == pytest.approx([LOAD, PICKED_UP], rel=0.02)
    assert values[2:] == pytest.approx([pull, 0.0][: len(values) - 2], abs=0.01)


def test_a_weighed_load_on_a_slide_is_looked_for_in_other_logs() -> None:
    """Of slides nobody proposes the weight's torque, which grows out of the load's; this once ended in a traceback."""
    logs = [
        replace(log, facts=(replace(log.facts[0], position_unit="m"),)) for log in (lifting(1, 0.0), lifting(2, 0.0))
    ]
    problem, held_out = stack(KERNEL, logs[:1], (1,)), stack(KERNEL, logs[1:], (1,))
    nominal = fit_nominal(problem, (JointStructure(input="torque", gravity="pendulum"),))
    weighed = NAMED["payload_change_weighed"]
    assert not list(weighed.starts(sizes_of(problem, nominal)[0]))
    point = extend(problem, nominal.point, Hypothesis(weighed, 0), np.array([[LOAD, 0.5 * PICKED_UP, 0.0, 0.0]]))
    there = with_instants(held_out, transfer(held_out, point), nominal.whitener)
    assert there.parameters[0, 0, KERNEL.column(weighed, "time")] == pytest.approx(PICKED_UP, abs=0.05)


def test_a_load_that_one_fitted_log_picks_up_is_looked_for_in_other_logs() -> None:
    """It may be picked up there as well, at another instant, or not."""
    fitted = stack(KERNEL, [lifting(1, 0.0, load=0.0), lifting(2, 0.0)], (1,))
    held_out = stack(KERNEL, [lifting(3, 0.0), lifting(4, 0.0, load=0.0)], (1,))
    nominal = fit_nominal(fitted, (JointStructure(input="torque", gravity="pendulum"),))
    change = NAMED["payload_change"]
    point = extend(fitted, nominal.point, Hypothesis(change, 0, 1), np.tile([LOAD, PICKED_UP + 0.1], (2, 1)))
    found = retimed(fitted, fit(fitted, point), Hypothesis(change, 0, 1))
    there = transfer(held_out, found.point)
    column = KERNEL.column(change, "time")
    assert np.all(there.parameters[:, 0, column] > held_out.longest)
    asked = with_instants(held_out, there, found.whitener).parameters[:, 0]
    assert asked[0, column] == pytest.approx(PICKED_UP, abs=0.05)
    assert asked[1, column] > held_out.longest
    assert asked[:, KERNEL.own(change)][:, 0] == pytest.approx(LOAD, rel=0.05)


def test_the_blow_of_a_load_that_rested_tells_its_instant() -> None:
    problem = stack(KERNEL, [lifting(seed, 0.0, load=1e-3, rested=True, wave=5e-3, dt=1e-3) for seed in (1, 2)], (1,))
    base = fit_nominal(problem, (JointStructure(input="torque", gravity="pendulum"),))
    rested = NAMED["payload_change_at_rest"]
    column = [parameter.name for parameter in rested.parameters].index("time")
    starts = scan(problem, base, rested, 0, sizes_of(problem, base)[0])
    assert min(abs(values[:, column] - PICKED_UP).max() for _, values, _ in starts) < 4e-3
