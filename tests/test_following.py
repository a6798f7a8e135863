"""Waves over the position that the joint sees where it is, not where a model predicts it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from diagnosis.engine import find
from diagnosis.estimation import fit
from diagnosis.following import following_settled
from diagnosis.hypotheses import FOLLOWING, Hypothesis, extend, withdraw
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem, stack
from diagnosis.remainder import remainder
from diagnosis.replay import replay
from envs.log import JointFacts, Log
from methods.effects import built_in
from methods.kernel import build

EFFECTS = built_in()
KERNEL = build(EFFECTS)
NAMED = {effect.name: effect for effect in EFFECTS}
WAVES, HEIGHT = 60.0, 0.08
STRUCTURES = (JointStructure(input="torque", electrical=False),)


def record(seed: int, noise: float, step: float) -> Log:
    """A rotor with a cogging torque, in twenty small steps per sample; noise: rms of a torque that nobody logged."""
    rng, dt, small = np.random.default_rng(seed), 1e-3, 20
    time = dt * np.arange(12_000)
    hertz = np.array([0.21, 0.37, 0.83, 1.7, 3.1])
    command = 0.5 * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + rng.uniform(0.0, 6.28, 5)), axis=1)
    push = np.zeros(len(time))
    for k in range(1, len(time)):
        push[k] = 0.95 * push[k - 1] + noise * math.sqrt(1.0 - 0.95**2) * rng.standard_normal()
    angle, speed, reading = 0.0, 0.0, np.empty(len(time))
    for k in range(len(time)):
        reading[k] = angle
        for _ in range(small):
            torque = command[k] + push[k] - 0.05 * speed - HEIGHT * math.sin(WAVES * angle)
            angle += dt / small * speed + 0.5 * (dt / small) ** 2 * torque / 0.02
            speed += dt / small * torque / 0.02
    facts = JointFacts(input="torque", position_unit="rad", encoder_step=step)
    rounded = step * np.round(reading / step)
    return Log(time, command[:, None], rounded[:, None], (1,), facts=(facts,), name=f"log {seed}")


def problem_of(noise: float, step: float) -> Problem:
    return stack(KERNEL, [record(seed, noise, step) for seed in (0, 1)], (1,))


def test_waves_act_where_the_readings_say_if_noise_drives_the_joint() -> None:
    problem = problem_of(noise=0.02, step=1e-4)
    nominal = fit_nominal(problem, STRUCTURES)
    wave = Hypothesis(NAMED["cogging_torque"], 0)
    point = extend(problem, nominal.point, wave, np.tile([HEIGHT, 0.0, WAVES], (2, 1)))
    assert np.all(point.parameters[:, 0, FOLLOWING] == 1.0)
    seen = fit(problem, point, rounds=3, iterations=10)
    parameters = seen.point.parameters.copy()
    parameters[..., FOLLOWING] = 0.0
    predicted = fit(problem, replace(seen.point, parameters=parameters), rounds=3, iterations=10)
    assert seen.criterion < predicted.criterion - 100.0
    assert following_settled(problem, seen) is seen
    assert following_settled(problem, predicted).criterion < predicted.criterion - 100.0
    assert seen.point.value("cogging_torque.sine@0") == pytest.approx(HEIGHT, rel=0.02)
    assert seen.point.value("cogging_torque.cycles_per_rev@0") == pytest.approx(WAVES, rel=1e-3)
    assert remainder(problem, seen, 0).excess == 0.0
    in_pieces = replay(problem, seen.point)  # what is followed goes on from piece to piece, and not in free simulation
    assert np.allclose(in_pieces.prediction, seen.error, rtol=0.0, atol=1e-12)
    free = replay(problem, replace(seen.point, parameters=parameters))
    assert np.nanstd(in_pieces.windows - free.windows) < 1e-2 * np.nanstd(problem.reading)


def test_waves_act_where_the_model_predicts_if_readings_are_coarse_and_nothing_drives_the_joint() -> None:
    problem = problem_of(noise=0.0, step=0.02)
    nominal = fit_nominal(problem, STRUCTURES)
    wave = Hypothesis(NAMED["cogging_torque"], 0)
    point = extend(problem, nominal.point, wave, np.tile([HEIGHT, 0.0, WAVES], (2, 1)))
    seen = fit(problem, point, rounds=3, iterations=10)
    settled = following_settled(problem, seen)
    assert settled.criterion < seen.criterion
    assert np.all(settled.point.parameters[:, 0, FOLLOWING] == 0.0)
    other = extend(problem, settled.point, Hypothesis(NAMED["cogging_torque_2"], 0), np.tile([0.01, 0.0, 7.0], (2, 1)))
    assert np.all(other.parameters[:, 0, FOLLOWING] == 0.0)  # it stays as it was settled
    without = following_settled(problem, fit(problem, withdraw(problem, settled.point, "cogging_torque", 0), rounds=1))
    assert np.all(without.point.parameters[:, 0, FOLLOWING] == 0.0)


@pytest.mark.slow
def test_a_wave_is_found_on_a_joint_that_noise_drives() -> None:
    found = find(problem_of(noise=0.02, step=1e-4), STRUCTURES, EFFECTS)
    assert found.verdict == "named"
    assert [item.label for item in found.accepted] == ["cogging_torque"]


def test_beside_a_play_waves_act_where_the_model_predicts() -> None:
    problem = problem_of(noise=0.0, step=1e-4)
    nominal = fit_nominal(problem, STRUCTURES)
    wave, play = (Hypothesis(NAMED[name], 0) for name in ("cogging_torque", "backlash"))
    waves, gap = np.tile([HEIGHT, 0.0, WAVES], (2, 1)), np.tile([0.01, 0.3, 30.0, 0.1], (2, 1))
    for first, second in (((wave, waves), (play, gap)), ((play, gap), (wave, waves))):
        point = extend(problem, extend(problem, nominal.point, *first), *second)
        assert np.all(point.parameters[:, 0, FOLLOWING] == 0.0)
        rough = fit(problem, point, rounds=1, iterations=1)
        assert following_settled(problem, rough) is rough
