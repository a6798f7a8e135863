"""A load that an arm picks up adds to its inertia and, where gravity pulls the arm, to its weight."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.engine import find
from diagnosis.nominal import JointStructure
from diagnosis.problem import stack
from envs.log import JointFacts, Log
from methods.effects import built_in
from methods.kernel import build

EFFECTS = built_in()
KERNEL = build(EFFECTS)
NAMED = {effect.name: effect for effect in EFFECTS}
DT, STEP = 4e-3, 1e-5
INERTIA, DRAG, WEIGHT = 0.05, 0.4, 0.9
LOAD, PULL, PICKED_UP = 0.01, 0.3, 8.4


def lifting(seed: int, pull: float) -> Log:
    """A pendulum that picks up a load, in thirty steps of its equations a sample."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(5000)
    hertz = np.array([0.3, 0.7, 1.3, 3.1])
    command = 0.8 * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0, 6, 4)), axis=1)
    position, angle, speed, part = np.zeros(len(time)), 0.0, 0.0, DT / 30
    for k, u in enumerate(command):
        position[k] = angle
        for i in range(30):
            carries = time[k] + i * part >= PICKED_UP
            weight = (WEIGHT + pull * carries) * np.sin(angle)
            speed += part * (u - DRAG * speed - weight) / (INERTIA + LOAD * carries)
            angle += part * speed
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
