"""Friction by the torque that the arm takes from its transmission, in logs of a simulation written apart from it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from diagnosis.engine import find
from diagnosis.nominal import JointStructure
from diagnosis.problem import stack
from envs.log import JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

DT, STEPS = 2e-3, 20
MOTOR, LINK, VISCOUS, WEIGHT = 0.02, 0.05, 0.3, 1.1
COEFFICIENT = 0.12
LAW = "load_dependent_friction"


def acceleration(dq: float, drive: float, weight: float) -> float:
    """Of the joint under the motor's torque less its damping: the load is what the link takes, friction follows it, and
    both by turns until they agree. At rest friction holds what it can."""
    sign = math.copysign(1.0, dq if dq != 0.0 else drive - weight)
    if dq == 0.0 and abs(drive - weight) <= COEFFICIENT * abs(weight):
        return 0.0
    change = 0.0
    for _ in range(12):
        load = LINK * change + weight
        change = (drive - weight - sign * COEFFICIENT * abs(load)) / (MOTOR + LINK)
    return change


def record(seed: int, seconds: float = 10.0) -> Log:
    """A pendulum with a torque motor of its own inertia behind a worm."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(round(seconds / DT))
    hertz = np.linspace(0.2, 5.0, 14) * (1.0 + 0.1 * seed)
    command = 0.45 * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0.0, 6.28, 14)), axis=1)
    q, dq, h, reading = 0.2, 0.0, DT / STEPS, np.empty(len(time))
    for k, u in enumerate(command.tolist()):
        reading[k] = q
        for _ in range(STEPS):
            after = dq + h * acceleration(dq, u - VISCOUS * dq, WEIGHT * math.sin(q))
            dq = 0.0 if after * dq < 0.0 else after
            q += h * dq
    reading += 1e-5 * rng.standard_normal(len(time))
    facts = JointFacts(input="torque", position_unit="rad")
    return Log(time, command[:, None], reading[:, None], (1,), facts=(facts,), name=f"log {seed}")


def test_the_load_that_the_arm_is_decides_the_friction() -> None:
    kinds = (LAW, "coulomb_friction", "stribeck_friction", "amplifier_offset")
    effects = tuple(effect for effect in built_in() if effect.label in kinds)
    joint = JointStructure(input="torque", electrical=False, gravity="pendulum")
    finding = find(stack(build(built_in()), [record(0), record(1)], (1,)), (joint,), effects)
    (item,) = finding.accepted
    assert item.label == LAW
    found = {name: finding.final.point.value(f"{item.name}.{name}@0") for name in ("coefficient", "link_share")}
    assert found["coefficient"] == pytest.approx(COEFFICIENT, rel=0.01)
    assert found["link_share"] == pytest.approx(LINK / (MOTOR + LINK), rel=0.05)


def test_friction_by_the_link_and_a_spring_or_a_play_exclude_each_other() -> None:
    link = next(effect for effect in built_in() if effect.name == "link_load_dependent_friction")
    for effect in built_in():
        if effect.parts_the_arm:
            assert effect.name in link.excludes
            assert link.name in effect.excludes


@pytest.mark.parametrize("arm_friction_share", [0.0, 1.0])
@pytest.mark.parametrize("command", [0.5, -2.0])
def test_friction_follows_the_torque_that_a_saturated_motor_gives(command: float, arm_friction_share: float) -> None:
    """At a steady speed ``u / (1 + c u^2) (1 - mu)`` is left for the damping, on either side of a spring."""
    friction, saturation = 0.12, 0.3
    effects = {LAW: {"coefficient": friction}, "torque_constant_saturation": {"coefficient": saturation}}
    nominal = {"inertia": MOTOR + LINK, "viscous": VISCOUS}
    if arm_friction_share:
        effects["joint_flexibility"] = {"inertia_ratio": 0.5, "frequency": 8.0, "damping_ratio": 0.3}
        nominal["arm_friction"] = arm_friction_share
    model = StructuredModel((StructuredJoint(1, "torque", nominal, effects),), DT, None, built_in())
    time = DT * np.arange(2000)
    moved = model.simulate(time, np.full((2000, 1), command), State.at_rest(0.0)).position[:, 0]
    given = command / (1.0 + saturation * command**2)
    assert np.diff(moved)[-1] / DT == pytest.approx(given * (1.0 - friction) / VISCOUS, rel=1e-6)
