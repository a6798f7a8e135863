"""What noise leaves of a joint in which small causes grow is no sign of a missing effect; a missing effect still is."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.signal import lfilter

from diagnosis.estimation import Fitted, covariance, fit, predicted_motion
from diagnosis.hypotheses import Hypothesis, extend, sizes_of
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import KnownTorques, Problem, stack
from diagnosis.remainder import (
    Remainder,
    TorqueSpectrum,
    as_noise,
    disturbance,
    lucky,
    remainder,
    scattering,
    torque_spectrum,
    without_dips,
)
from diagnosis.run import growth_said
from diagnosis.search import met
from diagnosis.settings import Settings
from diagnosis.verdict import unexplained
from diagnosis.whitening import unfiltered
from envs.log import JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
NAMED = {effect.name: effect for effect in EFFECTS}
KERNEL = build(EFFECTS)
JOINT = {"inertia": 0.07, "viscous": 0.02, "back_emf": 0.7, "electrical_time_constant": 0.004}
PLAY = {"backlash": {"gap": 0.004, "inertia_ratio": 0.4, "frequency": 22.0, "damping_ratio": 0.05}}
DRY = {"coulomb_friction": {"torque": 0.5}}
SPRING = {"joint_flexibility": {"inertia_ratio": 0.4, "frequency": 12.0, "damping_ratio": 0.05}}
COGGING = {"cogging_torque": {"sine": 0.1, "cosine": 0.0, "cycles_per_rev": 40.0}}
STEP, NOISE = 1e-5, 0.005


def problem_of(effects: dict[str, dict[str, float]], drift: float = 0.0, hysteresis: float = 0.0) -> Problem:
    """A joint under sines and the slow noise of its amplifier (5 mV rms, 20 ms), which no log shows.

    drift: share by which the amplifier's gain falls from the beginning to the end. hysteresis: half the play through
    which its voltage follows the command [V]."""
    rng = np.random.default_rng(3)
    time, hertz = 1e-3 * np.arange(20_000), np.array([0.3, 0.7, 1.3, 2.9, 5.3])
    command = np.sum(0.8 * np.sin(2 * np.pi * np.outer(time, hertz) + np.arange(5)), axis=1)[:, None]
    decay = np.exp(-1e-3 / 0.02)
    slow = lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], rng.standard_normal(len(time)))
    model = StructuredModel((StructuredJoint(1, "voltage", JOINT, effects),), 1e-3, None, EFFECTS)
    gain = (1.0 + 0.5 * drift * np.cos(np.pi * time / time[-1]))[:, None]
    own = command.copy()
    for k in range(1, len(own)):
        own[k] = np.clip(own[k - 1], command[k] - hysteresis, command[k] + hysteresis)
    position = model.simulate(time, gain * own + NOISE * slow[:, None], State.at_rest(0.0)).position
    facts = JointFacts(input="voltage", position_unit="rad", encoder_step=STEP)
    return stack(KERNEL, [Log(time, command, STEP * np.round(position / STEP), (1,), facts=(facts,))], (1,))


def fitted_with(problem: Problem, effects: dict[str, dict[str, float]]) -> Fitted:
    """The nominal model with these effects, begun with these parameters."""
    point = fit_nominal(problem, (JointStructure(),)).point
    for name, known in effects.items():
        values = np.array([[known[p.name] for p in NAMED[name].parameters]])
        point = extend(problem, point, Hypothesis(NAMED[name], 0), values)
    bare = fit(problem, point, unfiltered(problem), rounds=1, iterations=20, renewed=False)
    return fit(problem, bare.point, rounds=3, iterations=12)


@pytest.fixture(scope="module")
def play() -> tuple[Problem, Fitted, Remainder]:
    problem = problem_of(PLAY)
    fitted = fitted_with(problem, PLAY)
    return problem, fitted, remainder(problem, fitted, 0)


def test_what_noise_leaves_behind_impacts_is_noise(play: tuple[Problem, Fitted, Remainder]) -> None:
    _, _, left = play
    assert left.decrease > 3.0 * left.functions  # the innovations do depend on the motion
    assert left.scattered > 1.5 * left.functions
    assert left.excess == 0.0
    assert not any(drift.is_certain for drift in left.drifts)


def test_parameters_behind_impacts_are_less_certain_than_noise_alone_would_leave_them(
    play: tuple[Problem, Fitted, Remainder],
) -> None:
    _, fitted, left = play
    own, told = (np.sqrt(np.diag(spread)) for spread in (covariance(fitted), covariance(fitted, left.deviations)))
    names = [f.name for f in fitted.point.free]
    places = [i for i, name in enumerate(names) if name.startswith("backlash.")]
    widest = max(places, key=lambda i: told[i] / own[i])  # which one it is, rounding decides
    assert told[widest] > 1.5 * own[widest]
    assert told[widest] == pytest.approx(left.deviations[names[widest]])


def test_that_no_model_can_follow_is_said(play: tuple[Problem, Fitted, Remainder]) -> None:
    _, _, left = play

    def said(scattered: float) -> str:
        finding = SimpleNamespace(remainders=[replace(left, scattered=scattered)])
        return growth_said(SimpleNamespace(joints=[2], finding=finding), 0)  # type: ignore[arg-type]

    assert said(left.scattered).startswith("joint 2: from one blow of its play to the next small causes grow")
    assert said(0.0) == ""


def test_what_noise_leaves_of_a_joint_that_friction_holds_at_times_is_noise() -> None:
    """A torque that nobody logged does nothing at rest, and decides when the joint stops and breaks away."""
    problem = problem_of(DRY)
    left = remainder(problem, fitted_with(problem, DRY), 0)
    assert left.decrease > 4.0 * left.functions
    assert left.scattered > 3.0 * left.functions
    assert left.excess == 0.0
    assert not any(drift.is_certain for drift in left.drifts)
    assert lucky([left]) == 0.0  # other effects are found beside it as ever
    finding = SimpleNamespace(remainders=[left])
    said = growth_said(SimpleNamespace(joints=[2], finding=finding), 0)  # type: ignore[arg-type]
    assert said.startswith("joint 2: noise that nobody logged decides when friction holds")


def test_a_missing_effect_beside_friction_that_holds_a_joint_is_no_noise() -> None:
    hidden = DRY | {"cable_spring": {"stiffness": 0.05, "pull": 0.0}}
    problem = problem_of(hidden)
    assert remainder(problem, fitted_with(problem, DRY), 0).excess > 100.0


def test_a_torque_larger_than_noise_may_be_is_simulated_as_the_largest_that_may() -> None:
    """Else all that a model lacks would be its own excuse."""
    problem = problem_of(DRY)
    motion = predicted_motion(problem, fitted_with(problem, DRY).point)[:, 0]
    frequency = np.linspace(0.0, 500.0, 5001)
    power = np.where(frequency < 5.0, 1.0, 0.0)
    deviation, band = np.zeros(len(frequency)), frequency < 20.0
    of = lambda factor: TorqueSpectrum(frequency, factor**2 * power, deviation, band)  # noqa: E731
    share = lambda spectrum: disturbance(problem, spectrum, motion)[1]  # noqa: E731
    most = Settings().disturbance / share(of(1.0))
    assert share(as_noise(problem, of(100.0 * most), motion, 0)) == pytest.approx(Settings().disturbance)
    assert share(as_noise(problem, of(0.5 * most), motion, 0)) == pytest.approx(0.5 * Settings().disturbance)
    loud = replace(problem, command_limits=(1e6,))  # so that 0.15 % of it is more
    assert share(as_noise(loud, of(2.0 * most), motion, 0)) == pytest.approx(2.0 * Settings().disturbance)


def test_where_no_drive_is_known_the_largest_command_stands_for_its_limit() -> None:
    problem = problem_of({})
    largest = float(np.max(np.abs(problem.command)))
    assert problem.command_limits == (largest,)
    loud = Remainder((), 0.0, 10, 0.0, disturbance=0.02, disturbance_share=0.05)
    for limit, missing in ((24.0, False), (5.0, True)):
        problem = cast(Problem, SimpleNamespace(arm=None, command_limits=(limit,)))
        assert unexplained(problem, 0.0, (loud,), Settings()) is missing


def without_its_cable(stiffness: float) -> Remainder:
    """What a play leaves of a joint that a cable pulls as well."""
    problem = problem_of(PLAY | {"cable_spring": {"stiffness": stiffness, "pull": 0.0}})
    return remainder(problem, fitted_with(problem, PLAY), 0)


def shows(left: Remainder) -> bool:
    """Whether something is missing: in the motion or, where the fit stops short, as a torque as no amplifier has."""
    return left.excess > 5.0 * left.scattered or left.disturbance_share > 1.5 * Settings().disturbance


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [0.25, 0.35])
def test_a_missing_effect_is_no_noise(stiffness: float, play: tuple[Problem, Fitted, Remainder]) -> None:
    assert shows(without_its_cable(stiffness))
    assert not shows(play[2])


def test_where_a_fit_stops_short_a_missing_effect_is_a_torque_as_no_amplifier_has(
    play: tuple[Problem, Fitted, Remainder],
) -> None:
    assert play[2].disturbance_share < Settings().disturbance
    assert without_its_cable(1.0).disturbance_share > 2.0 * Settings().disturbance


@pytest.mark.slow
def test_behind_impacts_a_play_is_begun_where_it_comes_closest() -> None:
    """Its motion is so far from that without it that no regression leads there, and the simulation itself does."""
    problem, effect = problem_of(PLAY), NAMED["backlash"]
    base = fit_nominal(problem, (JointStructure(),))
    size = sizes_of(problem, base)[0]
    ((start, fitted),) = met(problem, base, effect, 0, size)
    assert start.searched == len(list(effect.starts(size)))
    assert fitted.criterion < base.criterion - 10_000.0
    found = fitted.point.parameters[0, 0, KERNEL.own(effect)]
    assert found[:2] == pytest.approx([PLAY["backlash"]["gap"], PLAY["backlash"]["inertia_ratio"]], rel=0.05)


@pytest.mark.parametrize(("hidden", "tried"), [({}, "backlash"), (PLAY, "joint_flexibility")])
def test_nothing_is_begun_where_there_is_no_play_and_no_other_effect(
    hidden: dict[str, dict[str, float]], tried: str
) -> None:
    problem = problem_of(hidden)
    base = fit_nominal(problem, (JointStructure(),))
    assert met(problem, base, NAMED[tried], 0, sizes_of(problem, base)[0]) == []


def test_a_missing_effect_explains_more_than_noise_lets_others_explain() -> None:
    problem = problem_of(PLAY | COGGING)
    without, complete = (fitted_with(problem, effects) for effects in (PLAY, PLAY | COGGING))
    assert without.criterion - complete.criterion > 3.0 * remainder(problem, without, 0).scattered


def test_only_joints_in_which_small_causes_grow_are_simulated_with_noise() -> None:
    problem = problem_of(SPRING)
    fitted = fitted_with(problem, SPRING)
    spectrum = torque_spectrum(problem, fitted, 0, predicted_motion(problem, fitted.point)[:, 0])
    assert len(scattering(problem, fitted, 0, spectrum)) == 0
    left = remainder(problem, fitted, 0)
    assert left.scattered == 0.0
    assert left.excess == 0.0


def test_spectrum_of_the_unlogged_torque_has_its_rms() -> None:
    problem = problem_of({})
    fitted = fitted_with(problem, {})
    frequency, power, _, band = torque_spectrum(problem, fitted, 0, predicted_motion(problem, fitted.point)[:, 0])
    density = NOISE**2 * 2.0 * 0.02 / (1.0 + (2 * np.pi * frequency * 0.02) ** 2) / 1e-3  # per sample, as `power` is
    assert np.sqrt(np.mean(power[band])) == pytest.approx(np.sqrt(np.mean(density[band])), rel=0.3)


def test_a_torque_ends_where_noise_would_stand_for_it() -> None:
    """What stands out by chance far above the band is none; a torque in the band counts whatever noise hides above."""
    problem = problem_of({})
    motion = np.ones((len(problem.time), 3))
    frequency = np.linspace(0.0, 500.0, 5001)
    deviation = 1e-3 + (frequency / 100.0) ** 4
    chance = np.where(np.random.default_rng(0).random(len(frequency)) < 0.02, deviation, 0.0)
    slow = np.where(frequency < 5.0, 40.0, 0.0)
    size = lambda power: disturbance(problem, TorqueSpectrum(frequency, power, deviation, frequency < 400.0), motion)[0]  # noqa: E731
    assert size(chance) < 1e-2 * np.sqrt(np.mean(chance))
    assert size(slow + chance) == pytest.approx(np.sqrt(np.mean(slow)), rel=0.02)


def test_a_drive_with_hysteresis_shows_in_the_direction_of_the_command() -> None:
    """The voltage follows the command through a play, which no law of the joint's motion describes."""
    left, plain = (
        remainder(problem, fit_nominal(problem, (JointStructure(),)), 0)
        for problem in (problem_of({}, hysteresis=0.05), problem_of({}))
    )
    assert left.dependences[0].signal == "command direction"
    assert left.excess > 100.0
    assert plain.excess == 0.0
    assert all(dependence.p_value > 1e-3 for dependence in plain.dependences)


def test_antiresonances_are_filled_and_slopes_stay() -> None:
    frequency = np.linspace(0.0, 500.0, 5001)
    slope = 1.0 / (1.0 + frequency**4)
    assert without_dips(frequency, slope) == pytest.approx(slope, rel=0.02)
    notch = slope * (1.0 - 0.999 * np.exp(-(((frequency - 28.0) / 1.5) ** 2)))
    ratio = without_dips(frequency, notch) / slope
    assert np.min(notch / slope) < 2e-3
    assert np.all(ratio > 0.5)
    assert np.all(ratio < 1.05)


@pytest.mark.parametrize(("friction", "drift", "missing"), [(0.4, 0.02, False), (0.4, 0.03, True), (0.01, 0.011, True)])
def test_a_drift_too_small_for_an_effect_of_its_own_is_nothing_unknown(
    friction: float, drift: float, missing: bool
) -> None:
    """Beside an effect that explains much more, it may be the inexact law of that; beside none it is missing."""
    effects = {"coulomb_friction": {"torque": friction}}
    problem = problem_of(effects, drift)
    nominal, fitted = fit_nominal(problem, (JointStructure(),)), fitted_with(problem, effects)
    left = remainder(problem, fitted, 0)
    explained = nominal.criterion - fitted.criterion
    assert any(item.is_certain for item in left.drifts)
    assert unexplained(problem, explained, (left,), Settings()) == missing
    known = replace(problem, arm=cast(KnownTorques, object()))  # torques of an arm are no more exact than that
    assert not unexplained(known, 0.0, (left,), Settings(relevant=0.1))
