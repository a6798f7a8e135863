"""A cable whose pull grows faster than its deflection, from an integrator of its own, found in logs with its rest; and
what is no cable."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.engine import find
from diagnosis.finding import Finding
from diagnosis.nominal import JointStructure
from diagnosis.problem import stack
from envs.log import Array, JointFacts, Log
from methods.effects import built_in
from methods.kernel import build

DT, STEP, INERTIA, VISCOUS = 2e-3, 1e-6, 0.05, 0.3
STIFFNESS, REST, STIFFENING = 2.0, 0.25, 1.5
NAMES = ("cable_spring", "gravity_tilt", "quadratic_drag", "cogging_torque", "amplifier_offset")


def command_of(time: Array, seed: int) -> Array:
    hertz, phases = np.array([0.3, 0.7, 1.6, 3.1]), np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 4)
    return np.asarray(np.sum(0.4 * np.sin(2.0 * np.pi * np.outer(time, hertz) + phases), axis=1))


def moved(command: Array, linear: float, cubic: float) -> Array:
    """Angle (T,) of an inertia against ``linear (q - REST) + cubic (q - REST)^3``, by Runge and Kutta's rule."""

    def rate(s: Array, u: float) -> Array:
        way = s[0] - REST
        return np.array([s[1], (u - VISCOUS * s[1] - linear * way - cubic * way**3) / INERTIA])

    states = [np.array([REST, 0.0])]
    for u in command[:-1]:
        s = states[-1]
        a = rate(s, u)
        b = rate(s + 0.5 * DT * a, u)
        c = rate(s + 0.5 * DT * b, u)
        d = rate(s + DT * c, u)
        states.append(s + DT / 6.0 * (a + 2.0 * b + 2.0 * c + d))
    return np.array(states)[:, 0]


def found(linear: float, cubic: float) -> Finding:
    logs = []
    for seed in (1, 2):
        time = DT * np.arange(4000)
        command = command_of(time, seed)
        position = STEP * np.round(moved(command, linear, cubic)[:, None] / STEP)
        facts = (JointFacts(input="torque", position_unit="rad", encoder_step=STEP),)
        logs.append(Log(time, command[:, None], position, (1,), facts=facts, name=f"log {seed}"))
    effects = built_in()
    candidates = [effect for effect in effects if effect.label in NAMES]
    return find(stack(build(effects), logs, (1,)), (JointStructure(input="torque"),), candidates)


def test_it_is_found_with_its_rest_and_named_alone() -> None:
    finding = found(STIFFNESS, STIFFNESS * STIFFENING)
    assert finding.verdict == "named"
    assert [item.label for item in finding.accepted] == ["cable_spring"]
    values = {f.split(".")[-1]: value for f, value in finding.final.point.values.items()}
    assert values["stiffness@0"] == pytest.approx(STIFFNESS, rel=2e-3)
    assert values["pull@0"] == pytest.approx(STIFFNESS * REST, rel=2e-3)
    assert values["stiffening@0"] == pytest.approx(STIFFENING, rel=1e-2)


@pytest.mark.slow
def test_what_has_no_stiffness_at_rest_is_no_cable() -> None:
    finding = found(0.0, 20.0)
    assert finding.verdict == "unknown"
