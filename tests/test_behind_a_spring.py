"""What acts on the arm acts behind the spring of its transmission: loads, blows, waves, weights and other joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation import errors
from diagnosis.hypotheses import Hypothesis, extend
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import stack
from envs.log import Array, JointFacts, Log
from methods.effects import built_in
from methods.kernel import NOMINAL, build

KERNEL = build(built_in())
NAMED = {effect.name: effect for effect in KERNEL.effects}
DT, SAMPLES, PARTS, BEGINS = 2e-3, 1500, 8, 1.2
MOTOR, ARM, DRAG, WEIGHT = 0.05, 0.04, 0.2, 0.9
HERTZ, RATIO, GAP = 6.0, 0.02, 0.02
LOAD, PULL, BLOW, LASTS, WAVE, WAVING = 0.03, 0.5, 0.4, 0.2, 0.3, 1.7
STIFFNESS, DAMPING = ARM * (2 * np.pi * HERTZ) ** 2, 2 * RATIO * ARM * 2 * np.pi * HERTZ
Push = Callable[[float, float], float]
"""Torque on the arm at a time and its angle."""


def still(t: float, q: float) -> float:
    return 0.0


def struck(t: float, q: float) -> float:
    return BLOW * np.sin(np.pi * (t - BEGINS) / LASTS) ** 2 if 0.0 < t - BEGINS < LASTS else 0.0


def waved(t: float, q: float) -> float:
    return WAVE * np.sin(2 * np.pi * WAVING * t)


def laden(t: float, q: float) -> float:
    return -PULL * np.sin(q)


def moved(gap: float, push: Push, load: float, rested: bool) -> tuple[Log, Array]:
    """Motor and arm with a spring between them, or a play, in Runge-Kutta steps of an eighth of a sample; from BEGINS
    on the arm carries a load, which is pulled as `push` says if it has any weight."""
    time = DT * np.arange(SAMPLES)
    command = np.sin(2 * np.pi * np.outer(time, (0.4, 1.1, 2.3)) + (0.3, 1.0, 2.0)).sum(axis=1)

    def rates(t: float, state: Array, u: float, carried: float) -> Array:
        q, w, ql, wl = state
        twist = q - ql
        deep = twist - np.sign(twist) * min(abs(twist), 0.5 * gap)
        between = STIFFNESS * deep + DAMPING * (w - wl) if deep != 0.0 else 0.0
        if gap > 0.0 and between * twist < 0.0:
            between = 0.0
        pull = push(t, ql) if load == 0.0 or carried > 0.0 or push is not laden else 0.0
        arm = between - WEIGHT * np.sin(ql) + pull
        return np.array([w, (u - DRAG * w - between) / MOTOR, wl, arm / (ARM + carried)])

    state, states, carried = np.zeros(4), np.zeros((SAMPLES, 4)), 0.0
    h = DT / PARTS
    for k, u in enumerate(command):
        states[k] = state
        if load > 0.0 and carried == 0.0 and time[k] >= BEGINS - 1e-9:
            carried = load
            if rested:
                state[3] *= ARM / (ARM + load)
        for i in range(PARTS):
            t = time[k] + i * h
            k1 = rates(t, state, u, carried)
            k2 = rates(t + h / 2, state + h / 2 * k1, u, carried)
            k3 = rates(t + h / 2, state + h / 2 * k2, u, carried)
            k4 = rates(t + h, state + h * k3, u, carried)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    facts = JointFacts(input="torque", position_unit="rad", encoder_step=1e-7)
    return Log(time, command[:, None], states[:, :1], (1,), facts=(facts,), name="moved"), states


CASES: dict[str, tuple[Push, float, bool, tuple[float, ...]]] = {
    "payload_change": (still, LOAD, False, (LOAD, BEGINS)),
    "payload_change_at_rest": (still, LOAD, True, (LOAD, BEGINS)),
    "payload_change_weighed": (laden, LOAD, False, (LOAD, BEGINS, PULL, 0.0)),
    "payload_change_weighed_at_rest": (laden, LOAD, True, (LOAD, BEGINS, PULL, 0.0)),
    "collision": (struck, 0.0, False, (BLOW, BEGINS, LASTS, 1.0)),
    "periodic_disturbance": (waved, 0.0, False, (WAVE, 0.0, WAVING)),
}


@pytest.mark.parametrize("transmission", ["joint_flexibility", "backlash"])
@pytest.mark.parametrize("name", CASES)
def test_it_acts_on_the_arm(name: str, transmission: str) -> None:
    push, load, rested, values = CASES[name]
    gap = GAP if transmission == "backlash" else 0.0
    log, states = moved(gap, push, load, rested)
    problem = stack(KERNEL, [log], (1,))
    base = fit_nominal(problem, (JointStructure(input="torque", gravity="pendulum"),))
    spring = (ARM / (MOTOR + ARM), HERTZ, RATIO)
    point = extend(problem, base.point, Hypothesis(NAMED[transmission], 0), np.array([[gap, *spring][gap == 0.0 :]]))
    whole = extend(problem, point, Hypothesis(NAMED[name], 0), np.array([values]))

    def deviation(point) -> float:  # type: ignore[no-untyped-def]
        parameters = point.parameters.copy()
        for column, value in {
            "inertia": MOTOR + ARM,
            "viscous": DRAG,
            "arm_viscous": 0.0,
            "gravity_sine": WEIGHT,
            "gravity_cosine": 0.0,
            "load": 0.0,
            "timing": 0.0,
        }.items():
            parameters[:, 0, NOMINAL.index(column)] = value
        starts = np.zeros_like(point.starts)
        found = errors(problem, [replace(point, parameters=parameters, starts=starts)], leak=False)
        return float(np.abs(found[0]).max())

    moves, effect = float(np.ptp(states[:, 0])), deviation(point)
    assert effect > 0.02 * moves
    sharp = gap > 0.0 or push is laden  # what sets in within a step
    assert deviation(whole) < (2e-3 if sharp else 1e-4) * effect
