"""Excitations: spectra, limits and shapes against independent computations; the text form."""

import dataclasses
import itertools

import numpy as np
import pytest

from envs.adeptone import adeptone
from envs.excitation import (
    PRBS,
    REGISTRY,
    Chirp,
    ExcitationError,
    FourierSeries,
    Multisine,
    Sine,
    Steps,
    TriangularSweep,
    low_crest_phases,
    parse,
    register,
)

TIME = np.arange(20_000) * 1e-3


def sample(excitation, seed=0, time=TIME):
    return excitation.sample(time, np.random.default_rng(seed))


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_shape_joints_and_bits(name):
    excitation = parse(f"{name}:joints=1+2", robot=adeptone())
    first = sample(excitation)
    assert first.shape == (len(TIME), 2)
    assert np.isfinite(first).all()
    assert np.array_equal(first, sample(excitation))


@pytest.mark.parametrize("name", ["multisine", "fourier_series", "prbs", "steps"])
def test_other_seed_other_signal(name):
    excitation = parse(name, robot=adeptone())
    assert not np.allclose(sample(excitation), sample(excitation, seed=1))


@pytest.mark.parametrize("name", sorted(set(REGISTRY) - {"fourier_series"}))
def test_amplitude_and_offset_per_joint(name):
    values = sample(parse(f"{name}:joints=1+3,amplitude=2+0.5,offset=0+1"))
    assert np.all(np.abs(values[:, 0]) <= 2.0 + 1e-9)
    assert np.abs(values[:, 0]).max() > 1.0
    assert np.all(np.abs(values[:, 1] - 1.0) <= 0.5 + 1e-9)


def test_sine_is_the_sine():
    expected = 3.0 * np.sin(2 * np.pi * 0.7 * TIME + 0.2)
    assert np.allclose(sample(Sine(amplitude=3.0, frequency=0.7, phase=0.2))[:, 0], expected)


def test_multisine_has_its_band_and_flat_lines():
    values = sample(Multisine(band=(0.5, 4.0), period=10.0), time=np.arange(10_000) * 1e-3)[:, 0]
    lines = np.abs(np.fft.rfft(values))
    inside = slice(5, 41)
    assert np.allclose(lines[inside], lines[inside].mean(), rtol=1e-6)
    lines[inside] = 0.0
    assert lines.max() < 1e-6


def test_multisine_joints_are_orthogonal():
    values = sample(Multisine(joints=(1, 2, 4)), time=np.arange(10_000) * 1e-3)
    gram = values.T @ values
    assert np.abs(gram - np.diag(np.diag(gram))).max() < 1e-8 * gram.max()


def test_crest_factor_is_reached_and_beats_random_phases():
    harmonics = np.arange(1, 81)
    grid = np.arange(8192) / 8192

    def crest(phases):
        wave = np.cos(2 * np.pi * harmonics * grid[:, None] + phases).sum(axis=1)
        return np.abs(wave).max() / wave.std()

    found = crest(low_crest_phases(harmonics, np.random.default_rng(0)))
    random = min(crest(np.random.default_rng(seed).uniform(0, 2 * np.pi, 80)) for seed in range(20))
    assert found < 1.65 < 2.2 < random
    assert crest(low_crest_phases(harmonics, np.random.default_rng(0), 2.0)) <= 2.0 * (1 + 1e-2)
    with pytest.raises(ExcitationError, match=r"crest factor 1\.0"):
        low_crest_phases(harmonics, np.random.default_rng(0), 1.0)


def test_fourier_series_respects_position_and_velocity():
    excitation = FourierSeries(
        joints=(1, 2), robot=adeptone(), output="position", position=(0.5, 0.3), velocity=1.2, command=50.0
    )
    motion = sample(excitation)
    speed = np.gradient(motion, TIME, axis=0)
    assert np.all(np.abs(motion).max(axis=0) <= np.array([0.5, 0.3]) * (1 + 1e-9))
    assert np.abs(speed).max() <= 1.2 * (1 + 1e-6)
    reaches = np.abs(motion).max(axis=0) / [0.5, 0.3], np.abs(speed).max(axis=0) / 1.2
    assert np.max(reaches) > 0.999  # the largest scale was taken


def test_fourier_series_command_is_limited_and_yields_the_motion():
    robot = adeptone()
    common = {"robot": robot, "position": 1.0, "velocity": 5.0, "command": 0.8, "pose": (0.0, np.pi / 2, 0.1, 0.0)}
    command = sample(FourierSeries(**common))[:, 0]
    motion = sample(FourierSeries(**common, output="position"))[:, 0]
    assert 0.79 < np.abs(command).max() <= 0.8
    # joint 1 alone is linear: integrate its equation, written out here, under the command
    drive = robot.joint(1).drive
    inertia = robot.inertia_matrix(np.array(common["pose"]))[0, 0]
    k, r, inductance = drive.torque_constant, drive.resistance.value, drive.inductance.value
    state = np.zeros(3)

    def rate(x, u):
        _q, w, i = x
        return np.array([w, (k * i - drive.viscous.value * w) / inertia, (30.0 * u - r * i - k * w) / inductance])

    path = []
    for u, ahead in itertools.pairwise(command):
        path.append(state[0])
        middle = 0.5 * (u + ahead)
        a = rate(state, u)
        b = rate(state + 0.5e-3 * a, middle)
        c = rate(state + 0.5e-3 * b, middle)
        d = rate(state + 1e-3 * c, ahead)
        state = state + 1e-3 / 6 * (a + 2 * b + 2 * c + d)
    assert np.abs(np.array(path) - motion[:-1]).max() < 1e-4 * np.abs(motion).max()


def test_fourier_series_needs_a_robot_and_a_possible_pose():
    with pytest.raises(ExcitationError, match="no robot"):
        sample(FourierSeries())
    with pytest.raises(ExcitationError, match="holding the pose"):
        sample(FourierSeries(joints=(3,), robot=adeptone(), command=0.1))


def test_chirp_sweeps_its_band():
    values = sample(Chirp(band=(1.0, 10.0)))[:, 0]
    crossings = TIME[1:][np.diff(np.signbit(values).astype(int)) != 0]
    frequency = 0.5 / np.diff(crossings)
    assert values[0] == pytest.approx(0.0, abs=1e-9)
    assert frequency[0] == pytest.approx(1.0, rel=0.1)
    assert frequency[-1] == pytest.approx(10.0, rel=0.05)
    assert np.interp(10.0, crossings[1:], frequency) == pytest.approx(np.sqrt(10.0), rel=0.05)


def test_prbs_is_white_over_its_length():
    length = 2**6 - 1
    time = (np.arange(length) + 0.5) * 0.05
    bits = sample(PRBS(order=6, bit_time=0.05), time=time - time[0])[:, 0]
    assert set(bits) == {-1.0, 1.0}
    assert abs(bits.sum()) == 1.0
    correlation = np.array([bits @ np.roll(bits, shift) for shift in range(length)])
    assert np.array_equal(correlation, np.r_[length, -np.ones(length - 1)])


def test_triangle_rises_at_constant_rate():
    values = sample(TriangularSweep(period=20.0))[:, 0]
    assert values[0] == pytest.approx(0.0, abs=1e-12)
    assert values[5000] == pytest.approx(1.0, abs=1e-3)
    assert np.allclose(np.diff(values[:4990]), 1e-3 / 5.0)


def test_steps_hold_their_levels():
    assert np.array_equal(sample(Steps(levels=(0.0, 1.0, -1.0), dwell=2.0))[[0, 1999, 2000, 4000], 0], [0, 0, 1, -1])
    values = sample(Steps(dwell=2.0))[:, 0]
    assert len(set(values)) == 10


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_text_form_round_trip(name):
    given = {
        "multisine": Multisine(joints=(1, 2), amplitude=(1.0, 2.0), band=(0.2, 5.0), crest_factor=1.7),
        "fourier_series": FourierSeries(harmonics=3, pose=(0.0, 1.5, 0.1, 0.0), output="position"),
        "chirp": Chirp(law="linear", sweep_time=3.0),
        "steps": Steps(levels=(1.0, -0.5)),
    }.get(name, dataclasses.replace(REGISTRY[name](), joints=(3,)))
    assert parse(given.text) == given


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sin", "Did you mean sine"),
        ("multisine:amp=2", "no field of multisine 'amp'"),
        ("multisine:band=8-1", "low < high"),
        ("multisine:band=8", "not a range"),
        ("sine:frequency=fast", "not a number"),
        ("sine:frequency=1,", "no assignment"),
        ("sine:frequency=1,frequency=2", "given twice"),
        ("sine:frequency=-1", "positive"),
        ("chirp:law=quadratic", "linear, logarithmic"),
        ("prbs:order=2.5", "whole number"),
        ("prbs:order=1", "from 2 to 32"),
        ("sine:joints=1+1", "different joint numbers"),
    ],
)
def test_unusable_text_is_one_clear_line(text, said):
    with pytest.raises(ExcitationError, match=said) as caught:
        parse(text)
    assert "\n" not in str(caught.value)
    assert text in str(caught.value)


def test_wrong_count_and_empty_band_are_refused():
    with pytest.raises(ExcitationError, match="2 entries for 1 joints"):
        sample(Sine(amplitude=(1.0, 2.0)))
    with pytest.raises(ExcitationError, match="harmonics"):
        sample(Multisine(band=(0.11, 0.19), period=5.0))


def test_registry_refuses_a_duplicate():
    with pytest.raises(ExcitationError, match="exists already"):
        register("sine")(Sine)
