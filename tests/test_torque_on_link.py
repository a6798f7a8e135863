"""What the rest of an arm does to a joint with a spring acts on the link behind the spring, not on the motor."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.estimation import fit
from diagnosis.hypotheses import Hypothesis, extend
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import stack
from envs.excitation import parse
from envs.log import Array, JointFacts, Log
from methods.effects import built_in
from methods.kernel import build

DT, STEPS, STEP = 2e-3, 40, 1e-6
MOTOR, LINK, VISCOUS, STIFFNESS, DAMPING = 0.04, 0.06, 0.3, 0.06 * (2.0 * np.pi * 9.0) ** 2, 0.2
SPRING = next(effect for effect in built_in() if effect.name == "joint_flexibility")


class Known:
    """A torque on the link that is known from the motion of other joints."""

    def of(self, log: Log) -> tuple[Array, Array]:
        """(T, 2), the inertia as it is, and no doubts (T, 0); on average from one sample to the next."""
        torque = pull(log.time)
        torque[:-1] = 0.5 * (torque[1:] + torque[:-1])
        return np.column_stack([torque, np.zeros_like(torque)]), np.zeros((len(torque), 0))


def pull(time: Array) -> Array:
    """That torque (T,)."""
    return 0.8 * np.sin(7.0 * time) + 0.5 * np.sin(31.0 * time)


def two_masses(command: Array, load: Array) -> Array:
    """Angle of the motor: semi-implicit Euler in small steps, command and load held."""
    q, dq, found = np.zeros(2), np.zeros(2), np.empty(len(command))
    h = DT / STEPS
    for k, (u, outer) in enumerate(zip(command, load, strict=True)):
        found[k] = q[0]
        for _ in range(STEPS):
            between = STIFFNESS * (q[0] - q[1]) + DAMPING * (dq[0] - dq[1])
            dq = dq + h * np.array([(u - VISCOUS * dq[0] - between) / MOTOR, (between - outer) / LINK])
            q = q + h * dq
    return found


def test_a_spring_is_found_where_the_rest_of_the_arm_pulls_behind_it() -> None:
    time = DT * np.arange(3000)
    excitation = parse("multisine:amplitude=1.5,band=0.3-20,period=3,joints=1")
    command = excitation.sample(time, np.random.default_rng(0))[:, 0]
    known = pull(time)
    held = np.append(0.5 * (known[:-1] + known[1:]), known[-1])
    position = STEP * np.round(two_masses(command, held) / STEP)
    facts = (JointFacts(input="torque", encoder_step=STEP),) * 2
    both = np.column_stack([command, np.zeros_like(command)]), np.column_stack([position, known])
    log = Log(time, *both, (1, 2), facts=facts, name="two masses")
    problem = stack(build(built_in()), [log], (1,), arm=Known())
    base = fit_nominal(problem, (JointStructure(input="torque", electrical=False),))
    start = extend(problem, base.point, Hypothesis(SPRING, 0), np.array([[0.5, 10.0, 0.05]]))
    fitted = fit(problem, start, rounds=3, iterations=12)
    found = {name.split("@")[0]: value for name, value in fitted.point.values.items()}
    assert found["inertia"] == pytest.approx(MOTOR + LINK, rel=2e-3)
    assert found["joint_flexibility.inertia_ratio"] == pytest.approx(LINK / (MOTOR + LINK), rel=2e-3)
    assert found["joint_flexibility.frequency"] == pytest.approx(9.0, rel=2e-3)
    assert np.sqrt(np.mean(fitted.innovation**2)) < 2.0 * STEP / np.sqrt(12.0)
