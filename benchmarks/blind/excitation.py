"""Experiments that an engineer would run: open-loop command signals, and smooth references under a position loop."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.blind.machines import Machine, Rng, damping, input_equivalent, log_uniform, total_inertia
from benchmarks.blind.world import OPEN, Array, Joint, Loop, Motion, simulate

OPEN_FORMS = ("sine", "multisine", "sweep", "steps", "prbs")
CLOSED_FORMS = ("sine", "multisine", "sweep", "moves", "injection")


@dataclass(frozen=True)
class Experiment:
    """One planned recording. feed, reference: (samples, joints) [command units; rad, m]; start: (joints,) [rad, m]."""

    form: str
    mode: Literal["open", "closed"]
    feed: Array
    reference: Array
    start: Array
    loop: Loop


def shape(form: str, time: Array, rng: Rng) -> Array:
    """A signal of the form, magnitude about one, zero at the start and of nearly zero mean. (T,)"""
    duration = time[-1]
    fade = np.minimum(1.0, time / 0.5)
    if form == "sine":
        return fade * np.sin(2 * np.pi * log_uniform(rng, 0.25, 2.0) * time)
    if form == "sweep":
        low, high = log_uniform(rng, 0.1, 0.3), log_uniform(rng, 4.0, 15.0)
        growth = math.log(high / low)
        return fade * np.sin(2 * np.pi * low * duration / growth * np.expm1(growth * time / duration))
    if form in ("multisine", "injection"):
        offered = np.arange(3, int(log_uniform(rng, 3.0, 12.0) * duration))
        lines = rng.choice(offered, min(int(rng.integers(8, 30)), len(offered)), replace=False)
        weight = lines ** -rng.uniform(0.0, 0.5)
        waves = np.sin(2 * np.pi * np.outer(time, lines / duration) + rng.uniform(0, 2 * np.pi, len(lines)))
        signal = waves @ weight
        return fade * signal / np.abs(signal).max()
    if form in ("steps", "prbs"):
        dwell = rng.uniform(0.4, 1.5) if form == "steps" else log_uniform(rng, 0.03, 0.12)
        count = int(duration / dwell) // 2 * 2 + 2
        levels = rng.uniform(0.3, 1.0, count // 2) if form == "steps" else np.ones(count // 2)
        levels = np.concatenate([levels, -levels])
        # shuffled within short stretches, so that the sum never runs far from zero
        order = np.argsort(np.tile(np.arange(count // 2), 2) + rng.uniform(0, 2.5, count))
        return levels[order][np.minimum((time / dwell).astype(int), count - 1)]
    if form == "moves":
        return _moves(time, rng)
    raise ValueError(f"unknown form {form}. Use one of {sorted({*OPEN_FORMS, *CLOSED_FORMS})}")


def _moves(time: Array, rng: Rng) -> Array:
    """Minimum-jerk moves between random points with dwells. (T,)"""
    signal = np.zeros_like(time)
    at, now = 0.3, 0.0
    while at < time[-1]:
        goal = rng.uniform(-1.0, 1.0)
        lasting = rng.uniform(0.5, 1.3) * (0.4 + abs(goal - now))
        s = np.clip((time - at) / lasting, 0.0, 1.0)
        signal += (goal - now) * s**3 * (10 - 15 * s + 6 * s * s)
        at += lasting + rng.uniform(0.0, 0.6)
        now = goal
    return signal


def position_loop(machine: Machine, rng: Rng) -> Loop:
    """PD gains for a random bandwidth within the machine's range, from its rough data."""
    n = len(machine.joints)
    kp, kd, tf = np.zeros(n), np.zeros(n), np.zeros(n)
    for j, joint in enumerate(machine.joints):
        highest = min(machine.bandwidth[1], 1.0 / (12.0 * machine.sample_time))
        if joint.inductance > 0.0:
            highest = min(highest, 0.4 * joint.resistance / joint.inductance)
        bandwidth = log_uniform(rng, min(machine.bandwidth[0], 0.7 * highest), highest)
        inertia = total_inertia(joint)
        if machine.coupling_inertia and j == 0:
            inertia += machine.joints[1].link_inertia + machine.coupling_inertia
        per_torque = input_equivalent(joint)
        kp[j] = per_torque * inertia * bandwidth**2
        kd[j] = per_torque * max(2.0 * rng.uniform(0.6, 1.0) * inertia * bandwidth - damping(joint), 0.0)
        tf[j] = 1.0 / (8.0 * bandwidth)
    return Loop(True, kp, kd, tf)


def plan(
    machine: Machine, form: str, mode: Literal["open", "closed"], loop: Loop, duration: float, rng: Rng
) -> Experiment:
    """An experiment scaled so that the clean machine uses a random share of its travel, speed or command limit."""
    time: Array = machine.sample_time * np.arange(round(duration / machine.sample_time), dtype=np.float64)
    n = len(machine.joints)
    signals = np.column_stack([shape(form, time, rng) for _ in range(n)])
    share = np.array([log_uniform(rng, 0.3, 0.9) for _ in range(n)])
    start = rng.uniform(-0.1, 0.1, n) * np.array(machine.travel)
    limit, travel, speed = (np.array(x) for x in (machine.command_limit, machine.travel, machine.speed))
    weight = np.array([joint.weight * input_equivalent(joint) for joint in machine.joints])
    amplitude = share.copy()
    experiment = Experiment(form, mode, np.zeros_like(signals), np.zeros_like(signals), start, OPEN)
    for _ in range(6):
        if mode == "open":
            experiment = replace(experiment, feed=amplitude * limit * signals + weight)
        else:
            moving = shape("multisine", time, np.random.default_rng(1)) if form == "injection" else None
            path = signals if moving is None else np.tile(moving[:, None], (1, n))
            rest = start + amplitude * (0.8 * travel) * (path - path[0])
            feed = np.tile(weight, (len(time), 1))
            if form == "injection":
                feed = feed + 0.3 * amplitude * limit * signals
            experiment = replace(experiment, feed=feed, reference=rest, loop=loop)
        motion = run_quietly(machine, machine.joints, experiment)
        span = np.abs(motion.position - (0.0 if np.isfinite(travel).all() else start)).max(axis=0) / travel
        fast = np.abs(motion.velocity).max(axis=0) / speed
        hard = np.abs(motion.command).max(axis=0) / (0.9 * limit)
        used = np.maximum(np.maximum(span, fast), hard) / share
        if not np.isfinite(used).all():
            amplitude = amplitude * 0.3
        elif (used > 1.1).any() or (used < 0.8).any():
            amplitude = amplitude / np.clip(used, 0.2, 5.0)
        else:
            break
    return experiment


def run_quietly(machine: Machine, joints: tuple[Joint, ...], experiment: Experiment) -> Motion:
    """The experiment without noise on joints of the machine, which may carry effects."""
    return simulate(
        joints,
        experiment.feed,
        machine.sample_time,
        coupling_inertia=machine.coupling_inertia,
        loop=experiment.loop,
        reference=experiment.reference,
        command_step=np.array(machine.command_step),
        command_limit=np.array(machine.command_limit),
        start=experiment.start,
        ramp=machine.hold == "first_order" and experiment.mode == "open",
        step_limit=2e-4,
    )
