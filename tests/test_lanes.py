"""Candidates that are simulated eight at a time: the same bits as one at a time, whatever stands beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from methods import lane_check
from methods.effects import vocabulary
from methods.kernel import BEGINNING, LANES, NOMINAL, SHAPES, Kernel, build, same_instants

KERNEL: Kernel = build(tuple(vocabulary()))
SIZES = replace(lane_check.SIZES, damping=0.3, duration=2.0)
SAMPLES, LOGS = 700, 2


def candidates(count: int, seed: int, effects: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters (C, L, 1, columns), switches (C, 1, effects) and starts (C, L, 1, 6) with random effects."""
    rng = np.random.default_rng(seed)
    parameters = np.zeros((count, LOGS, 1, KERNEL.columns))
    switches = np.zeros((count, 1, len(KERNEL.effects)), dtype=bool)
    column = {name: i for i, name in enumerate(NOMINAL)}
    for c in range(count):
        own = parameters[c, :, 0]
        own[:, column["inertia"]] = rng.uniform(0.02, 0.08)
        own[:, column["viscous"]], own[:, column["back_emf"]] = rng.uniform(0.05, 0.2, 2)
        own[:, column["arm_viscous"]] = rng.choice([0.0, 0.1])
        own[:, column["arm_friction"]] = rng.choice([0.0, 0.4, 1.0])
        own[:, column["electrical_time_constant"]] = rng.choice([0.0, 3e-4, 1.5e-3, 4e-3])
        own[:, column["torque_square_mean"]] = 4.0
        own[:, column["timing"]] = rng.choice([0.0, 1e-3])
        own[:, column["following"]] = rng.choice([0.0, 1.0])
        if rng.uniform() < 0.3:
            own[:, column["gravity_sine"]], own[:, column["gravity_cosine"]] = rng.uniform(-1.0, 1.0, 2)
        own[:, column["torque_limit"]] = rng.choice([0.0, 3.0])
        for effect in rng.choice(len(KERNEL.effects), effects, replace=False):
            chosen = KERNEL.effects[effect]
            starts = list(chosen.starts(SIZES)) if chosen.starts else []
            if starts:
                switches[c, 0, effect] = True
                own[:, KERNEL.own(chosen)] = starts[rng.integers(len(starts))]
    return parameters, switches, np.tile([0.1, 0.4, -0.2, 0.01, -0.3, 0.05], (count, LOGS, 1, 1))


def stacked(seed: int) -> tuple[np.ndarray, ...]:
    """Time, command, its integral over samples, reading, motion of a neighbour and bounds of LOGS logs."""
    rng = np.random.default_rng(seed)
    time = np.tile(np.arange(SAMPLES) * SIZES.sample_time, LOGS)
    command = (6.0 * np.sin(9.0 * time) * (rng.uniform(size=len(time)) < 0.9))[:, None]
    bounds = SAMPLES * np.arange(LOGS + 1)
    cumulative = np.zeros_like(command)
    for a, b in pairwise(bounds):
        cumulative[a + 1 : b] = np.cumsum(command[a : b - 1], axis=0)
    reading = 0.5 * np.sin(9.0 * time)[:, None]
    return time, command, cumulative, reading, rng.normal(size=(len(time), 1, 3)), bounds


def torques(count: int, samples: int) -> np.ndarray:
    """Further torques (C, T, 1) on the candidates."""
    return np.random.default_rng(3).normal(size=(count, samples, 1))


def arm_of(samples: int) -> np.ndarray:
    """Motion of a neighbour, what an arm does to a joint and changes of its inertia, (T, 1, 3 + 2 (1 + SHAPES))."""
    found = np.random.default_rng(4).normal(size=(samples, 1, 5 + 2 * SHAPES))
    found[..., 4 + SHAPES :] *= 0.01
    return found


def batched(
    parameters: np.ndarray,
    switches: np.ndarray,
    starts: np.ndarray,
    *,
    outside: bool = False,
    arm: bool = False,
    substeps: int = 1,
) -> np.ndarray:
    """Prediction errors (C, T) in lanes; outside: with torques from outside and an observer of the velocity; arm: with
    what an arm does."""
    time, command, cumulative, reading, near, bounds = stacked(0)
    out = np.empty((len(parameters), len(time), 1))
    hold, rigid = np.zeros(1, dtype=np.int64), np.zeros((len(parameters), 3))
    extra = torques(len(parameters), len(time)) if outside else np.zeros((0, 0, 1))
    near = arm_of(len(time)) if arm else near
    arguments = (time, command, cumulative, hold, reading, near, extra, bounds, starts, parameters, switches)
    KERNEL.batch(*arguments, False, rigid, 20.0, 100.0 * outside, substeps, out)
    return out[..., 0]


def one_by_one(
    parameters: np.ndarray, switches: np.ndarray, starts: np.ndarray, *, outside: bool = False, arm: bool = False
) -> np.ndarray:
    """The same by the function for any number of joints."""
    time, command, cumulative, reading, near, bounds = stacked(0)
    out = np.empty((len(parameters), len(time), 1))
    hold, none = np.zeros(1, dtype=np.int64), np.zeros((0, 1, 3))
    near = arm_of(len(time)) if arm else near
    extra = torques(len(parameters), len(time)) if outside else np.zeros((len(parameters), 0, 1))
    for c in range(len(parameters)):
        for log, (a, b) in enumerate(pairwise(bounds)):
            KERNEL.module.run(
                *(x[a:b] for x in (time, command, cumulative)),
                hold,
                reading[a:b],
                near[a:b],
                extra[c, a:b],
                starts[c, log],
                parameters[c, log],
                switches[c],
                False,
                np.zeros(3),
                20.0,
                100.0 * outside,
                1,
                out[c, a:b],
                none,
            )
    return out[..., 0]


@pytest.mark.parametrize(("effects", "seed"), [(0, 0), (1, 1), (1, 2), (2, 3), (3, 4)])
def test_lanes_are_one_candidate_at_a_time_bit_by_bit(effects: int, seed: int) -> None:
    every = candidates(5 * LANES + 3, seed, effects)
    assert np.array_equal(batched(*every), one_by_one(*every))


@pytest.mark.parametrize("late", [0.0, 1e-3])
def test_a_supply_that_sags_by_the_current_of_a_winding_does_so_beside_others(late: float) -> None:
    """Held commands and such that jump within the step, with and without a lag of the amplifier between."""
    parameters, switches, starts = candidates(2 * LANES, 5, 0)
    parameters[..., NOMINAL.index("electrical_time_constant")] = 4e-3
    parameters[..., NOMINAL.index("timing")] = late
    sags = [effect for effect in KERNEL.effects if effect.label == "supply_sag"]
    lag = next(effect for effect in KERNEL.effects if effect.name == "amplifier_lag")
    for c in range(1, len(parameters), 2):
        sag = sags[c // 2 % len(sags)]
        for effect in (sag, lag) if c % 4 == 1 else (sag,):
            switches[c, 0, KERNEL.switches[effect.name]] = True
            parameters[c, :, 0, KERNEL.own(effect)] = next(iter(effect.starts(SIZES)))
    assert np.array_equal(batched(parameters, switches, starts), one_by_one(parameters, switches, starts))


@pytest.mark.parametrize("spring", [False, True])
@pytest.mark.parametrize("name", ["payload_change_at_rest", "payload_change_weighed_at_rest"])
def test_loads_that_rested_are_picked_up_within_a_step(name: str, spring: bool) -> None:
    parameters, switches, starts = candidates(2 * LANES + 3, 6, 0)
    by_name = {effect.name: effect for effect in KERNEL.effects}
    plain = batched(parameters, switches, starts)
    switches[:, 0, KERNEL.switches[name]] = True
    parameters[..., 0, KERNEL.own(by_name[name])] = (0.02, 0.3007, 0.4, 0.2)[: by_name[name].size]
    if spring:
        switches[::2, 0, KERNEL.switches["joint_flexibility"]] = True
        parameters[..., 0, KERNEL.own(by_name["joint_flexibility"])] = 0.4, 9.0, 0.1
    found = batched(parameters, switches, starts)
    assert np.array_equal(found, one_by_one(parameters, switches, starts))
    assert spring or np.array_equal(found[:, :150], plain[:, :150])
    assert np.all(np.any(found != plain, axis=1))


@pytest.mark.parametrize("arm", [False, True])
def test_torques_from_outside_and_an_observer_of_the_velocity(arm: bool) -> None:
    parameters, switches, starts = candidates(2 * LANES + 3, 9, 1)
    first = NOMINAL.index("arm")
    parameters[..., first : first + 1 + SHAPES] = np.random.default_rng(5).normal(
        size=(*parameters.shape[:3], 1 + SHAPES)
    )
    found = batched(parameters, switches, starts, outside=True, arm=arm)
    assert np.array_equal(found, one_by_one(parameters, switches, starts, outside=True, arm=arm))
    assert np.max(np.abs(found - batched(parameters, switches, starts))) > 1e-3


@pytest.mark.parametrize(("effects", "hold"), [(0, 0), (1, 0), (2, 1)])
def test_logs_share_lanes_where_their_instants_are_the_same_as_far_as_they_go(effects: int, hold: int) -> None:
    lengths, count, rng = (300, 700, 451, 400), LANES + 3, np.random.default_rng(11)
    steps = (1.0, 1.0, 1.0, 0.9)  # the last one's are others
    time = np.concatenate([0.002 * step * np.arange(n) for step, n in zip(steps, lengths, strict=True)])
    bounds = np.cumsum([0, *lengths])
    assert same_instants(time, bounds) == [(0, 3), (3, 1)]
    command = (6.0 * np.sin(9.0 * time + np.arange(len(time)) // 350))[:, None]
    cumulative, reading = np.zeros_like(command), 0.5 * np.sin(9.0 * time)[:, None]
    for a, b in pairwise(bounds):
        levels = command[a : b - 1] if hold == 0 else 0.5 * (command[a : b - 1] + command[a + 1 : b])
        cumulative[a + 1 : b] = np.cumsum(levels, axis=0)
    one, switches, _ = candidates(count, 12, effects)
    parameters = np.concatenate([one, one], axis=1) * rng.uniform(0.9, 1.0, (count, 4, 1, 1))
    parameters[3, 1, 0, 0] = -1e-4  # runs away
    parameters[..., NOMINAL.index("stepping")] = 0.0
    if hold == 1:  # all commands are as late: where one log ends and another begins shows in nothing else
        parameters[..., NOMINAL.index("timing")] = 1e-3
        parameters[..., NOMINAL.index("electrical_time_constant")] = 4e-3
    starts, extra = rng.normal(0.0, 0.1, (count, 4, 1, len(BEGINNING))), rng.normal(size=(count, len(time), 1))
    signals, none = (time, command, cumulative, np.array([hold]), reading), np.zeros((0, 1, 3))
    lanes, alone = np.empty((2, count, len(time), 1))
    tail = (20.0, 0.0, 1)
    KERNEL.batch(*signals, none, extra, bounds, starts, parameters, switches, False, np.zeros((count, 3)), *tail, lanes)
    for c in range(count):
        for log, (a, b) in enumerate(pairwise(bounds)):
            cut = (*(x[a:b] for x in signals[:3]), signals[3], reading[a:b], none, extra[c, a:b], starts[c, log])
            model = (parameters[c, log], switches[c], False, np.zeros(3))
            KERNEL.module.run(*cut, *model, *tail, alone[c, a:b], none)
    assert np.array_equal(lanes, alone)
    assert np.any(lanes == 1e6)


def pairs(count: int, seed: int, effects: int) -> tuple[np.ndarray, ...]:
    """Parameters (C, L, 2, columns), switches (C, 2, effects), starts (C, L, 2, 6) and constants (C, 3) of planar
    pairs, some of which hang, some of which rest for a while."""
    rng = np.random.default_rng(seed)
    one, two = candidates(count, seed, effects), candidates(count, seed + 100, effects)
    parameters, starts = (np.concatenate([one[i], two[i]], axis=2) for i in (0, 2))
    switches = np.concatenate([one[1], two[1]], axis=1)
    switches[..., [effect.parts_the_arm for effect in KERNEL.effects]] = False
    sign = np.where(np.arange(count) % 2, 1.0, 0.6)
    rigid = np.stack([0.02 * rng.uniform(-1.0, 1.0, count), sign, 0.9 * parameters[:, 0, 1, 0] / sign], axis=1)
    parameters[..., NOMINAL.index("stepping")] = 0.0
    return parameters, switches, starts, rigid


def of_pairs(parameters: np.ndarray, switches: np.ndarray, starts: np.ndarray, rigid: np.ndarray) -> list[np.ndarray]:
    """Prediction errors (C, T, 2) in lanes, and one by one."""
    time, command, cumulative, reading, _, bounds = stacked(0)
    both = [np.concatenate([x, 0.7 * x[::-1]], axis=1) for x in (command, reading)]
    other = stacked(0)[1][::-1] * 0.7
    sums = np.concatenate([cumulative, np.zeros_like(cumulative)], axis=1)
    for a, b in pairwise(bounds):
        sums[a + 1 : b, 1] = np.cumsum(other[a : b - 1, 0])
    hold, none = np.array([0, 1]), np.zeros((0, 2, 3))
    found = [np.empty((len(parameters), len(time), 2)) for _ in range(2)]
    signals = (time, both[0], sums, hold, both[1])
    outer, tail = np.random.default_rng(6).normal(size=(len(parameters), len(time), 2)), (20.0, 100.0, 1)
    KERNEL.batch(*signals, none, outer, bounds, starts, parameters, switches, True, rigid, *tail, found[0])
    for c in range(len(parameters)):
        for log, (a, b) in enumerate(pairwise(bounds)):
            cut = (*(x[a:b] for x in signals[:3]), hold, both[1][a:b], none, outer[c, a:b], starts[c, log])
            model = (parameters[c, log], switches[c], True, rigid[c])
            KERNEL.module.run(*cut, *model, *tail, found[1][c, a:b], none)
    return found


@pytest.mark.parametrize(("effects", "seed"), [(0, 0), (1, 1), (1, 2), (2, 3), (3, 4)])
def test_planar_pairs_in_lanes_are_one_at_a_time_bit_by_bit(effects: int, seed: int) -> None:
    lanes, alone = of_pairs(*pairs(3 * LANES + 3, seed, effects))
    assert np.array_equal(lanes, alone)
    assert np.max(np.abs(lanes)) > 0.1


def test_planar_pairs_on_logs_with_the_same_instants_share_lanes() -> None:
    lengths, count, rng = (300, 700, 451, 400), LANES + 3, np.random.default_rng(13)
    steps = (1.0, 1.0, 1.0, 0.9)  # the last one's are others
    time = np.concatenate([0.002 * step * np.arange(n) for step, n in zip(steps, lengths, strict=True)])
    bounds = np.cumsum([0, *lengths])
    command = 6.0 * np.sin(np.outer(time, (9.0, 7.0)) + (np.arange(len(time)) // 350)[:, None])
    cumulative, reading = np.zeros_like(command), 0.5 * np.sin(np.outer(time, (9.0, 7.0)))
    for a, b in pairwise(bounds):
        cumulative[a + 1 : b] = np.cumsum(command[a : b - 1], axis=0)
    one, switches, _, rigid = pairs(count, 12, 2)
    for c, columns in enumerate(transmissions(count, 3)):  # those with a spring or a play run by themselves
        for j, column in enumerate(columns if c % 3 == 0 else ()):
            if column >= 0:
                switches[c, j, column] = True
                one[c, :, j, KERNEL.own(KERNEL.effects[column])] = next(iter(KERNEL.effects[column].starts(SIZES)))
    parameters = np.concatenate([one, one], axis=1) * rng.uniform(0.9, 1.0, (count, 4, 1, 1))
    parameters[4, 1, 0, 0] = -1e-4  # runs away
    starts, extra = rng.normal(0.0, 0.1, (count, 4, 2, len(BEGINNING))), rng.normal(size=(count, len(time), 2))
    signals, none = (time, command, cumulative, np.zeros(2, dtype=np.int64), reading), np.zeros((0, 2, 3))
    lanes, alone = np.empty((2, count, len(time), 2))
    tail = (20.0, 0.0, 1)
    KERNEL.batch(*signals, none, extra, bounds, starts, parameters, switches, True, rigid, *tail, lanes)
    for c in range(count):
        for log, (a, b) in enumerate(pairwise(bounds)):
            cut = (*(x[a:b] for x in signals[:3]), signals[3], reading[a:b], none, extra[c, a:b], starts[c, log])
            model = (parameters[c, log], switches[c], True, rigid[c])
            KERNEL.module.run(*cut, *model, *tail, alone[c, a:b], none)
    assert np.array_equal(lanes, alone)
    assert np.any(lanes == 1e6)


WITHOUT_TRACE = ("timestamp_jitter", "link_load_dependent_friction")
"""What does nothing to a pair that lies and whose clock is even."""
ON_ONE_JOINT = [e.name for e in KERNEL.effects if e.name not in WITHOUT_TRACE and not e.parts_the_arm]


@pytest.mark.parametrize(("name", "joint"), [(name, i % 2) for i, name in enumerate(ON_ONE_JOINT)])
def test_an_effect_on_one_joint_of_all_pairs_and_of_some(name: str, joint: int) -> None:
    """In all lanes of that joint, where it may have machine code of its own, and in some of them."""
    count = LANES + 3
    parameters, switches, starts, rigid = pairs(count, 5, 0)
    with_it = with_effect(name, count, 5)[0]
    effect = next(effect for effect in KERNEL.effects if effect.name == name)
    parameters[:, :, joint, KERNEL.own(effect)] = with_it[:, :, 0, KERNEL.own(effect)]
    switches[:, joint, KERNEL.switches[name]] = True
    lanes, alone = of_pairs(parameters, switches, starts, rigid)
    assert np.array_equal(lanes, alone)
    switches[::2, joint, KERNEL.switches[name]] = False
    some, plain = of_pairs(parameters, switches, starts, rigid)
    assert np.array_equal(some, plain)
    assert np.array_equal(some[1::2], lanes[1::2])
    assert not np.array_equal(some[::2], lanes[::2])


@pytest.mark.parametrize("parted", [False, True])
@pytest.mark.parametrize(
    "name",
    [
        "payload_change_carried",
        "payload_change_hung",
        "payload_change_at_rest",
        "payload_change_hung_at_rest",
        "gravity_tilt",
    ],
)
def test_what_acts_on_both_joints_of_a_pair(name: str, parted: bool) -> None:
    by_name = {effect.name: effect for effect in KERNEL.effects}
    effect = by_name[name]
    count, column, own = 2 * LANES + 3, KERNEL.switches[name], KERNEL.own(effect)
    parameters, switches, starts, rigid = pairs(count, 12, 0)
    plain = of_pairs(parameters, switches, starts, rigid)[0]
    values = {"inertia": 0.02, "time": 0.3, "reach": 1.4}
    switches[::2, 1, column] = True
    parameters[..., 1, own] = [values.get(parameter.name, 0.3) for parameter in effect.parameters]
    if parted:
        switches[1::3, 0, KERNEL.switches["joint_flexibility"]] = True
        parameters[..., 0, KERNEL.own(by_name["joint_flexibility"])] = 0.4, 9.0, 0.1
    lanes, alone = of_pairs(parameters, switches, starts, rigid)
    assert np.array_equal(lanes, alone)
    changed = np.any(lanes != plain, axis=(1, 2))
    assert np.all(changed[::2])
    assert parted or not np.any(changed[1::2])


@pytest.mark.parametrize(("name", "pulls"), [("gravity_tilt", True), ("gravity_tilt_in_one_joint", False)])
def test_a_tilt_of_the_second_joint_pulls_at_the_first_unless_it_keeps_its_direction(name: str, pulls: bool) -> None:
    effect = next(effect for effect in KERNEL.effects if effect.name == name)
    parameters, switches, starts, rigid = pairs(LANES, 12, 0)
    rigid[:, [0, 2]] = 0.0  # neither inertia nor weight couples the joints
    parameters[..., [NOMINAL.index("gravity_sine"), NOMINAL.index("gravity_cosine")]] = 0.0
    plain = of_pairs(parameters, switches, starts, rigid)[0]
    switches[:, 1, KERNEL.switches[name]] = True
    parameters[..., 1, KERNEL.own(effect)] = 0.3, 0.2
    lanes, alone = of_pairs(parameters, switches, starts, rigid)
    assert np.array_equal(lanes, alone)
    changed = np.any(lanes != plain, axis=1)
    assert np.all(changed[:, 1])
    assert np.all(changed[:, 0]) if pulls else not np.any(changed[:, 0])


def transmissions(count: int, seed: int) -> np.ndarray:
    """Which spring or play each joint of so many pairs has, as a column of the switches; -1 where it is stiff."""
    known = [KERNEL.switches[effect.name] for effect in KERNEL.effects if effect.parts_the_arm]
    return np.random.default_rng(seed).choice([-1, *known], (count, 2))


@pytest.mark.parametrize(("effects", "friction", "seed"), [(0, False, 1), (1, False, 2), (1, True, 3), (0, True, 4)])
def test_planar_pairs_with_springs_and_plays_are_one_at_a_time_bit_by_bit(
    effects: int, friction: bool, seed: int
) -> None:
    count = 4 * LANES + 3
    parameters, switches, starts, rigid = pairs(count, seed, effects)
    rigid[::2, 2] *= 1.0 / 0.9  # rotors that turn with the first joint, too
    dry = next(effect for effect in KERNEL.effects if effect.name == "coulomb_friction")
    for c, columns in enumerate(transmissions(count, seed)):
        for j, column in enumerate(columns):
            if column < 0:
                continue
            effect = KERNEL.effects[column]
            switches[c, j, column] = True
            values = list(effect.starts(SIZES))
            parameters[c, :, j, KERNEL.own(effect)] = values[(3 * c + j) % len(values)]
        if friction:
            switches[c, :, KERNEL.switches[dry.name]] = True
            parameters[c, ..., KERNEL.own(dry)] = 1.5
    lanes, alone = of_pairs(parameters, switches, starts, rigid)
    assert np.array_equal(lanes, alone)
    stiff = of_pairs(parameters, switches & ~np.array([e.parts_the_arm for e in KERNEL.effects]), starts, rigid)[0]
    parted = np.any(transmissions(count, seed) >= 0, axis=1)
    assert np.all(np.any(lanes[parted] != stiff[parted], axis=(1, 2)))


def test_planar_pairs_that_stick() -> None:
    every = pairs(2 * LANES + 1, 7, 0)
    friction = next(effect for effect in KERNEL.effects if effect.name == "coulomb_friction")
    every[1][:, :, KERNEL.switches[friction.name]] = np.random.default_rng(2).uniform(size=every[1].shape[:2]) < 0.8
    every[0][..., KERNEL.own(friction)] = np.random.default_rng(1).uniform(0.3, 5.0, (*every[0].shape[:3], 1))
    lanes, alone = of_pairs(*every)
    assert np.array_equal(lanes, alone)


def with_effect(name: str, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Candidates that have nothing but one effect, each from another of its starting values."""
    parameters, switches, starts = candidates(count, seed, 0)
    effect = next(effect for effect in KERNEL.effects if effect.name == name)
    values = list(effect.starts(SIZES)) if effect.starts else []
    values = values or [[0.3 * (1.0 if p.upper > 1.0 else p.upper) for p in effect.parameters]]
    for c in range(count):
        switches[c, 0, KERNEL.switches[name]] = True
        parameters[c, :, 0, KERNEL.own(effect)] = values[c % len(values)]
    return parameters, switches, starts


@pytest.mark.parametrize("name", [effect.name for effect in KERNEL.effects if effect.name != "timestamp_jitter"])
def test_an_effect_in_all_lanes_and_in_some(name: str) -> None:
    """Alone with itself, where it may have machine code of its own, and beside lanes without it."""
    own, plain = with_effect(name, LANES - 1, 5), candidates(LANES + 2, 6, 0)
    alone = one_by_one(*own)
    assert np.array_equal(batched(*own), alone)
    mixed = tuple(np.concatenate([mine[:3], other]) for mine, other in zip(own, plain, strict=True))
    assert np.array_equal(batched(*mixed)[:3], alone[:3])
    assert not np.array_equal(alone[:3], batched(*candidates(LANES - 1, 5, 0))[:3])


def turning(name: str, count: int, spring: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Candidates with friction that turns within less than a sample; with a spring, of which the arm rubs, too."""
    parameters, switches, starts = with_effect(name, count, 7)
    effect = next(effect for effect in KERNEL.effects if effect.name == name)
    level, inertia = KERNEL.column(effect, "torque"), parameters[..., 0, NOMINAL.index("inertia")]
    rounding = KERNEL.column(effect, "rounding")
    parameters[..., 0, level] = 1.5
    parameters[..., 0, rounding] = 1.5 * SIZES.sample_time / inertia * np.linspace(0.7, 1.1, count)[:, None]
    if name == "rounded_stribeck_friction":
        parameters[..., 0, KERNEL.column(effect, "velocity")] = 3.0
    for exact in ("electrical_time_constant", "timing"):  # a command that jumps within a step is right to second order
        parameters[..., 0, NOMINAL.index(exact)] = 0.0
    if spring:
        flexible = next(effect for effect in KERNEL.effects if effect.name == "joint_flexibility")
        switches[:, 0, KERNEL.switches["joint_flexibility"]] = True
        parameters[..., 0, KERNEL.own(flexible)] = (0.6, 12.0, 0.1)
    return parameters, switches, starts


@pytest.mark.parametrize("spring", [False, True])
@pytest.mark.parametrize("name", ["rounded_coulomb_friction", "tapered_coulomb_friction", "rounded_stribeck_friction"])
def test_rounded_friction_takes_its_steps_where_it_turns(name: str, spring: bool) -> None:
    """In all other samples it is as smooth as the rest, and one step is as good as four."""
    own = turning(name, LANES - 1, spring)
    parameters, switches, _ = own
    module, dt = KERNEL.module, SIZES.sample_time
    for c in range(len(parameters)):
        model = parameters[c, 0], switches[c], dt, 1
        assert module._calm_steps(*model) < module._steps(*model)
    found = batched(*own)
    assert np.array_equal(found, one_by_one(*own))
    always = batched(*own, substeps=4)
    moved = np.std(always)
    assert np.max(np.abs(found - always)) < 2e-5 * moved


def test_the_motion_is_that_of_one_at_a_time() -> None:
    time, command, cumulative, reading, near, _ = (x[:SAMPLES] for x in stacked(0))
    parameters, switches, starts = candidates(6, 8, 2)
    hold, none = np.zeros(1, dtype=np.int64), np.zeros((0, 1, 3))
    for own, on, start in zip(parameters[:, 0], switches, starts[:, 0], strict=True):
        found = []
        for simulate in (KERNEL.motion, KERNEL.module.run):
            out, motion = np.empty((SAMPLES, 1)), np.zeros((SAMPLES, 1, 3))
            signals = (time, command, cumulative, hold, reading, near, none[:, :, 0], start, own, on)
            simulate(*signals, False, np.zeros(3), 20.0, 0.0, 1, out, motion)
            found.append((out, motion))
        assert np.array_equal(found[0][0], found[1][0])
        assert np.array_equal(found[0][1], found[1][1])
        assert np.any(found[0][1][:, 0, 2])


def test_a_lane_that_runs_away_leaves_the_others_alone() -> None:
    parameters, switches, starts = candidates(LANES, 6, 1)
    parameters[2, :, 0, NOMINAL.index("viscous")] = -40.0
    together = batched(parameters, switches, starts)
    assert np.all(together[2, -100:] == 1e6)
    rest = [c for c in range(LANES) if c != 2]
    assert np.array_equal(together[rest], batched(parameters[rest], switches[rest], starts[rest]))
    assert np.max(np.abs(together[rest])) < 1e3


@pytest.mark.parametrize(("own", "library"), [("_sine", np.sin), ("_cosine", np.cos)])
def test_sine_and_cosine_are_those_of_the_library(own: str, library: Callable[[np.ndarray], np.ndarray]) -> None:
    """To the rounding of a number near 1, from the first turn to the hundred-thousandth."""
    rng = np.random.default_rng(7)
    spans = [rng.uniform(-span, span, 2000) for span in (1.0, 10.0, 1e3, 6e5)]
    angles = np.concatenate([*spans, 0.25 * np.pi * np.arange(-20, 21)])
    found = np.array([getattr(KERNEL.module, own)(angle) for angle in angles])
    assert np.max(np.abs(found - library(angles))) < 2.3e-16


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("presliding_friction", (0.8, 0.02, 0.0)),
        ("presliding_friction", (0.8, 5e-4, 0.0)),
        ("presliding_friction", (0.8, 0.005, 0.002)),
        ("presliding_friction_power", (0.8, 0.02, 0.001, 2.0)),
        ("presliding_friction_stribeck", (0.5, 0.01, 0.001, 0.6, 0.3, 2.0)),
    ],
)
def test_bristles_are_right_to_a_few_ten_thousandths_in_one_step_per_sample(
    name: str, values: tuple[float, ...]
) -> None:
    """Torques half a step late would be wrong by some thousandths, and damp too little."""
    effect, dt, samples = next(e for e in KERNEL.effects if e.name == name), 1e-3, 4000
    parameters = np.zeros((1, 1, 1, KERNEL.columns))
    for parameter, value in (("inertia", 0.05), ("viscous", 0.1), ("back_emf", 0.1)):
        parameters[..., NOMINAL.index(parameter)] = value
    parameters[..., KERNEL.own(effect)] = values
    switches = np.zeros((1, 1, len(KERNEL.effects)), dtype=bool)
    switches[..., KERNEL.switches[name]] = True
    time = dt * np.arange(samples)
    command = (2.0 * np.sin(7.0 * time) + 0.5 * np.sin(31.0 * time))[:, None]
    cumulative = np.vstack([np.zeros((1, 1)), np.cumsum(command[:-1], axis=0)])

    def moved(steps: int) -> np.ndarray:
        out = np.empty((1, samples, 1))
        signals = (time, command, cumulative, np.zeros(1, dtype=np.int64), np.zeros((samples, 1)), np.zeros((0, 1, 3)))
        model = (np.zeros((1, 1, 1, len(BEGINNING))), parameters, switches, False, np.zeros((1, 3)))
        KERNEL.batch(*signals, np.zeros((0, 0, 1)), np.array([0, samples]), *model, 0.0, 0.0, steps, out)
        return out[0, :, 0]

    exact = moved(64)
    assert np.std(moved(1) - exact) < 5e-4 * np.std(exact)


def test_arithmetic_of_the_lanes_is_that_of_the_library() -> None:
    rng, module = np.random.default_rng(8), KERNEL.module
    exponents = np.concatenate([rng.uniform(-700.0, 700.0, 2000), rng.uniform(-2.0, 2.0, 2000), [0.0, -1e9, 1e9]])
    found = np.array([module._exponential(x) for x in exponents])
    assert np.allclose(found, np.exp(np.clip(exponents, -708.0, 709.0)), rtol=1e-15, atol=0.0)
    sizes = np.concatenate([10.0 ** rng.uniform(-300.0, 300.0, 2000), rng.uniform(0.5, 2.0, 2000)])
    found = np.array([module._logarithm(x) for x in sizes])
    assert np.allclose(found, np.log(sizes), rtol=1e-15, atol=1e-16)
    for power in (0.5, 1.0, 1.7, 3.0):
        found = np.array([module._power(x, power) for x in sizes[2000:]])
        assert np.allclose(found, sizes[2000:] ** power, rtol=1e-15, atol=0.0)
        assert module._power(0.0, power) < 1e-150
    slopes = np.concatenate([rng.uniform(-20.0, 20.0, 2000), [0.0, 1e9, -1e9]])
    found = np.array([module._hyperbolic_tangent(x) for x in slopes])
    assert np.allclose(found, np.tanh(slopes), rtol=0.0, atol=4e-16)
    assert module._hyperbolic_tangent(0.0) == 0.0


def test_beginnings_of_another_width_are_refused() -> None:
    """Compiled code would read beyond them."""
    parameters, switches, starts = candidates(2, 5, 0)
    with pytest.raises(ValueError, match="BEGINNING"):
        batched(parameters, switches, starts[..., :3])


@pytest.mark.parametrize("name", ["", "joint_flexibility", "joint_flexibility_load_side", "backlash"])
def test_a_heavier_pose_is_a_heavier_arm_behind_the_same_spring(name: str) -> None:
    """A change of inertia that stays is one of the parameters: stiffness and damping are what they were."""
    more, column = 0.03, {other: i for i, other in enumerate(NOMINAL)}
    parameters, switches, starts = candidates(2, 5, 0)
    parameters[:, :, 0, [column["gravity_sine"], column["gravity_cosine"]]] = 0.0
    parameters[:, :, :, column["inertia"]], parameters[:, :, :, column["arm"]] = 0.05, 1.0
    parameters[1], starts[:] = parameters[0], 0.0
    if name:
        effect = next(effect for effect in KERNEL.effects if effect.name == name)
        switches[:, 0, KERNEL.effects.index(effect)] = True
        parameters[:, :, 0, KERNEL.own(effect)] = next(iter(effect.starts(SIZES)))
        share, hertz, damping = (KERNEL.column(effect, key) for key in ("inertia_ratio", "frequency", "damping_ratio"))
        parameters[:, :, 0, share], parameters[:, :, 0, hertz], parameters[:, :, 0, damping] = 0.4, 12.0, 0.1
        behind, slower = 0.4 * 0.05, np.sqrt(0.4 * 0.05 / (0.4 * 0.05 + more))
        parameters[1, :, 0, share] = (behind + more) / (0.05 + more)
        parameters[1, :, 0, hertz] *= slower
        parameters[1, :, 0, damping] *= slower
    parameters[1, :, 0, column["inertia"]] += more
    time, command, cumulative, reading, near, bounds = stacked(0)
    motion = np.concatenate([near, np.zeros((*near.shape[:2], 2))], axis=2)
    found = []
    for c, change in enumerate((more, 0.0)):
        motion[..., 4], out = change, np.empty((1, len(time), 1))
        KERNEL.batch(
            *(time, command, cumulative, np.zeros(1, dtype=np.int64), reading, motion, np.zeros((0, 0, 1)), bounds),
            *(starts[[c]], parameters[[c]], switches[[c]], False, np.zeros((1, 3)), 0.0, 0.0, 1, out),
        )
        found.append(out[0, :, 0])
    assert np.std(found[0]) > 0.1
    assert found[0] == pytest.approx(found[1], abs=1e-9)
