"""A mode with little damping is found where the errors ring, from which a fit of the missing spring begins."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem, stack
from diagnosis.resonance import modes, ringing
from diagnosis.search import try_all
from envs.log import JointFacts, Log
from methods.effects import built_in
from methods.kernel import build

EFFECTS = built_in()
KERNEL = build(EFFECTS)
NAMED = {effect.name: effect for effect in EFFECTS}
INTERVAL, SECONDS, ENCODER = 5e-4, 12.0, 3e-4
MOTOR, LOAD, DAMPING = 0.008, 0.06, 0.09
"""Inertias [V s^2/rad] and the motor's damping [V s/rad]."""
HERTZ, RATIO = 25.0, 0.0005
"""Of the load behind a motor that stands still: frequency and damping ratio."""


def recording(seed: int, stiff: bool) -> Log:
    """Two masses with a spring between them, in their exact discrete form; the encoder sits on the first."""
    rng = np.random.default_rng(seed)
    count = round(SECONDS / INTERVAL)
    steps = rng.choice([-1.0, 1.0], count // 40 + 1) * rng.uniform(2.0, 12.0, count // 40 + 1)
    command = np.repeat(steps, 40)[:count]
    omega = 2.0 * np.pi * HERTZ
    spring, damper = LOAD * omega**2, 2.0 * RATIO * LOAD * omega
    if stiff:
        rates = np.array([[0.0, 1.0], [0.0, -DAMPING / (MOTOR + LOAD)]])
        drive = np.array([[0.0], [1.0 / (MOTOR + LOAD)]])
    else:
        rates = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [-spring / MOTOR, -(damper + DAMPING) / MOTOR, spring / MOTOR, damper / MOTOR],
                [0.0, 0.0, 0.0, 1.0],
                [spring / LOAD, damper / LOAD, -spring / LOAD, -damper / LOAD],
            ]
        )
        drive = np.array([[0.0], [1.0 / MOTOR], [0.0], [0.0]])
    angle = np.eye(1, len(rates))
    discrete = cont2discrete((rates, drive, angle, np.zeros((1, 1))), INTERVAL)
    time, motion, _ = dlsim(discrete, command[:, None])
    reading = ENCODER * np.round(motion / ENCODER)
    facts = JointFacts(input="voltage", position_unit="rad", encoder_step=ENCODER)
    return Log(time, command[:, None], reading, (1,), facts=(facts,), name=f"log{seed}")


def problem_of(stiff: bool) -> Problem:
    return stack(KERNEL, [recording(seed, stiff) for seed in range(2)], (1,))


def test_a_stiff_joint_does_not_ring() -> None:
    problem = problem_of(stiff=True)
    base = fit_nominal(problem, (JointStructure(),))
    assert modes(problem, base, 0) == []
    assert ringing(problem, base, NAMED["joint_flexibility"], 0) == []


@pytest.mark.slow
def test_a_spring_with_little_damping_is_found_at_once() -> None:
    problem = problem_of(stiff=False)
    base = fit_nominal(problem, (JointStructure(),))
    share = LOAD / (MOTOR + LOAD)
    assert modes(problem, base, 0)[0] == pytest.approx(HERTZ / np.sqrt(1.0 - share), rel=0.03)
    assert ringing(problem, base, NAMED["coulomb_friction"], 0) == []
    rivals = ("joint_flexibility", "backlash", "constrained_coulomb_friction", "amplifier_lag")
    best = try_all(problem, base, [(NAMED[name], 0) for name in rivals])[0]
    assert best.name == "joint_flexibility"
    found = best.fitted.point
    assert found.value("joint_flexibility.frequency@0") == pytest.approx(HERTZ, rel=1e-3)
    assert found.value("joint_flexibility.inertia_ratio@0") == pytest.approx(share, rel=2e-3)
    assert found.value("joint_flexibility.damping_ratio@0") == pytest.approx(RATIO, rel=0.05)
