"""Blind trials from the second world: logs with something hidden in them, and the truth kept in another folder.

    python -m benchmarks.blind.trials --seed 1 --kind single --out DIR

writes ``DIR/logs/NAME/`` with train_0.csv, train_1.csv, holdout_0.csv, their sidecars and `nominal.toml`, the data
sheet an engineer would have at hand; and ``DIR/truth/NAME/truth.json``. NAME says nothing about the trial.

Seeds from KEPT_APART upward are kept apart: they are scored, never looked at while a method is being tuned.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer

from benchmarks.blind.excitation import CLOSED_FORMS, OPEN_FORMS, Experiment, plan, position_loop, run_quietly
from benchmarks.blind.hidden import FOREIGN, VOCABULARY, Draw, Hidden, Scales, applicable, at_heat, compatible, rms
from benchmarks.blind.machines import COMMON, FAMILIES, Machine, Rng, input_equivalent, log_uniform, total_inertia
from benchmarks.blind.visibility import Streams, jitter_visibility, visibility
from benchmarks.blind.world import Array, Drive, Joint, Motion, simulate
from envs.log import Log

KEPT_APART = 1_000_000
"""Seeds from here on are for scoring alone."""

VISIBLE = 12.0
"""Least visibility of the hidden effects, in standard deviations of the test that knows the effect."""

EDGE = (1.5, 15.0)
"""Range of visibility of weak effects."""

NOISE_CORRELATION = 0.02
"""Correlation time of the unlogged amplifier noise [s]."""


class Kind(StrEnum):
    """What a trial hides: nothing, one effect, two, one outside the vocabulary, or one near the edge of visibility."""

    CLEAN = "clean"
    SINGLE = "single"
    PAIR = "pair"
    FOREIGN = "foreign"
    WEAK = "weak"


@dataclass(frozen=True)
class TrueEffect:
    """An effect as it was hidden; `visibility` (benchmarks.blind.visibility) on the training logs."""

    joint: int
    hidden: Hidden
    visibility: float = math.nan


@dataclass(frozen=True)
class Truth:
    """What the logs do not tell.

    structure: names that describe known physics of the machine (a pendulum's gravity, a vertical axis' weight) and that
    a diagnosis without a robot description is right to name. equivalent: complete sets of names that are as right as
    the hidden ones.
    """

    seed: int
    kind: Kind
    family: str
    effects: tuple[TrueEffect, ...]
    foreign: bool
    structure: tuple[tuple[int, str], ...]
    amplifier_noise: tuple[float, ...]
    sensor_noise: tuple[float, ...]
    forms: tuple[str, ...]
    machine: Machine
    joints: tuple[Joint, ...]
    streams: tuple[Streams, ...] = field(default=(), repr=False)


@dataclass(frozen=True)
class Trial:
    """Logs for a diagnosis, and the truth that it must not see."""

    train: tuple[Log, ...]
    holdout: tuple[Log, ...]
    truth: Truth


def make_trial(
    seed: int,
    kind: Kind | str,
    family: str | None = None,
    *,
    effect: str | None = None,
    duration: float = 30.0,
    train: int = 2,
) -> Trial:
    """A trial, the same bits for the same arguments.

    Consecutive seeds go through the vocabulary (or the foreign effects) in turn, so that any range of seeds covers it
    evenly; `effect` and `family` (a key of FAMILIES) force the choice.
    """
    kind = Kind(kind)
    rng = np.random.default_rng([seed, list(Kind).index(kind)])
    names = _names(kind, seed, effect)
    for _ in range(40):
        machine = FAMILIES[family or _family(names, rng)](rng)
        offered = applicable(FOREIGN if kind == Kind.FOREIGN else VOCABULARY, machine)
        if all(name in offered for name in names):
            trial = _attempt(seed, kind, machine, names, duration, train, rng)
            if trial is not None:
                return trial
    raise ValueError(f"no {family or 'machine'} found that can hide {names}. Choose another family or effect")


def _names(kind: Kind, seed: int, effect: str | None) -> tuple[str, ...]:
    if effect is not None or kind == Kind.CLEAN:
        return () if effect is None else (effect,)
    table = list(FOREIGN if kind == Kind.FOREIGN else VOCABULARY)
    return (table[seed % len(table)],)


def _family(names: tuple[str, ...], rng: Rng) -> str:
    return str(rng.choice([*COMMON, "gantry"] if "axis_coupling" in names else COMMON))


def _attempt(
    seed: int, kind: Kind, machine: Machine, names: tuple[str, ...], duration: float, train: int, rng: Rng
) -> Trial | None:
    """Experiments and hidden effects for a machine; None when no draw of them is as visible as it should be."""
    if kind == Kind.PAIR and len(names) == 1:
        partners = [name for name in applicable(VOCABULARY, machine) if compatible(names[0], name)]
        names = (names[0], str(rng.choice(partners)))
    experiments = _experiments(machine, duration, train, rng)
    quiet = [run_quietly(machine, machine.joints, experiment) for experiment in experiments[:train]]
    scales = [_scales(machine, index, quiet, duration) for index in range(len(machine.joints))]
    if kind == Kind.WEAK:
        return _steered(seed, machine, names, experiments, scales, rng)
    for _ in range(6):
        trial = _hide(seed, kind, machine, names, experiments, scales, 1.0, rng)
        if trial is not None and all(effect.visibility >= VISIBLE for effect in trial.truth.effects):
            return trial
    return None


def _steered(
    seed: int, machine: Machine, names: tuple[str, ...], experiments: list[Experiment], scales: list[Scales], rng: Rng
) -> Trial | None:
    """A weak effect: one draw, whose strength is steered to a visibility drawn log-uniformly from EDGE."""
    target, strength, draw = log_uniform(rng, *EDGE), 0.01, int(rng.integers(2**62))
    for _ in range(8):
        again = np.random.default_rng(draw)
        trial = _hide(seed, Kind.WEAK, machine, names, experiments, scales, strength, again)
        if trial is None:
            return None
        seen = trial.truth.effects[0].visibility
        if 0.6 * target <= seen <= 1.6 * target and EDGE[0] <= seen <= EDGE[1]:
            return trial
        strength *= min(max(target / max(seen, 1e-9), 0.02), 50.0)
        if not 1e-9 < strength < 10.0:
            return None
    return None


def _hide(
    seed: int,
    kind: Kind,
    machine: Machine,
    names: tuple[str, ...],
    experiments: list[Experiment],
    scales: list[Scales],
    strength: float,
    rng: Rng,
) -> Trial | None:
    """One draw of effects and the recordings with them; None when a recording fails."""
    table = FOREIGN if kind == Kind.FOREIGN else VOCABULARY
    effects = []
    for name in names:
        index = int(rng.integers(len(machine.joints)))
        draw = Draw(rng, machine, index, scales[index], strength)
        effects.append(TrueEffect(machine.numbers[index], table[name][0](draw)))
    train = len(experiments) - 1
    joints = _joints_with(machine, effects)
    level = 0.0 if rng.random() < 0.3 else log_uniform(rng, 1e-5, 1e-3)
    amplifier_noise = tuple(level * limit for limit in machine.command_limit)
    counts = 0.0 if rng.random() < 0.5 else rng.uniform(0.0, 1.0)
    sensor_noise = tuple(counts * joint.encoder_step for joint in joints)
    truth = Truth(
        seed=seed,
        kind=kind,
        family=machine.family,
        effects=tuple(effects),
        foreign=kind == Kind.FOREIGN,
        structure=_structure(machine),
        amplifier_noise=amplifier_noise,
        sensor_noise=sensor_noise,
        forms=tuple(f"{experiment.mode} {experiment.form}" for experiment in experiments),
        machine=machine,
        joints=joints,
    )
    logs: list[Log] = []
    streams: list[Streams] = []
    squares = []
    for number, experiment in enumerate(experiments):
        name = f"train_{number}" if number < train else f"holdout_{number - train}"
        recording = record(truth, experiment, name, rng)
        if recording is None:
            return None
        log, signals, square = recording
        logs.append(log)
        streams.append(signals)
        squares.append(square)
    truth = replace(truth, streams=tuple(streams))
    heats = np.mean(squares[:train], axis=0)
    seen = tuple(
        replace(
            effect,
            hidden=at_heat(effect.hidden, heats[machine.numbers.index(effect.joint)]),
            visibility=_visibility(truth, effect, tuple(logs[:train])),
        )
        for effect in truth.effects
    )
    return Trial(tuple(logs[:train]), tuple(logs[train:]), replace(truth, effects=seen))


def _visibility(truth: Truth, effect: TrueEffect, logs: tuple[Log, ...]) -> float:
    """Visibility of one effect when the others are known to be there."""
    index = truth.machine.numbers.index(effect.joint)
    if "timestamp_jitter" in effect.hidden.streams:
        speed = np.concatenate([np.gradient(log.position[:, index], truth.machine.sample_time) for log in logs])
        floor = math.hypot(truth.joints[index].encoder_step / math.sqrt(12.0), truth.sensor_noise[index])
        return jitter_visibility(effect.hidden.streams["timestamp_jitter"], speed, floor)
    others = [other for other in truth.effects if other is not effect]
    without = _joints_with(truth.machine, others)
    with_streams = truth.streams[: len(logs)]
    fewer = tuple(Streams() for _ in logs) if effect.hidden.streams else with_streams
    return visibility(truth.machine, truth.joints, without, logs, with_streams, fewer)


def _experiments(machine: Machine, duration: float, train: int, rng: Rng) -> list[Experiment]:
    """Training experiments of different forms and one held-out experiment of yet another."""
    mode: Literal["open", "closed"] = "open" if str(rng.choice(machine.loops)) == "open" else "closed"
    forms = [str(form) for form in rng.permutation(OPEN_FORMS if mode == "open" else CLOSED_FORMS)]
    # the first log has to excite more than one frequency
    rich = next(k for k, form in enumerate(forms) if form not in ("sine", "moves"))
    forms = [forms[rich], *forms[:rich], *forms[rich + 1 :]]
    loop = position_loop(machine, rng)
    return [plan(machine, forms[k], mode, loop, duration, rng) for k in range(train + 1)]


def _scales(machine: Machine, index: int, motions: list[Motion], duration: float) -> Scales:
    def stacked(name: str, column: int) -> Array:
        return np.concatenate([getattr(motion, name)[:, column] for motion in motions])

    position = [motion.position[:, index] for motion in motions]
    speed = stacked("velocity", index)
    acceleration = np.diff(speed) / machine.sample_time
    command = np.concatenate([m.command[:, index] - np.mean(m.command[:, index]) for m in motions])
    torque = stacked("motor_torque", index) - machine.joints[index].weight
    other = 1 - index if len(machine.joints) == 2 else index
    return Scales(
        command=rms(command),
        command_peak=float(np.abs(stacked("command", index)).max()),
        torque=rms(torque),
        speed=rms(speed),
        speed_peak=float(np.abs(speed).max()),
        acceleration=rms(acceleration),
        current=rms(stacked("current", index)),
        current_peak=float(np.abs(stacked("current", index)).max()),
        spread=float(np.mean([p.std() for p in position])),
        range=float(np.mean([np.ptp(p) for p in position])),
        duration=duration,
        other_torque=rms(stacked("motor_torque", other)),
        other_speed=rms(stacked("velocity", other)),
        other_acceleration=rms(np.diff(stacked("velocity", other)) / machine.sample_time),
    )


def _joints_with(machine: Machine, effects: list[TrueEffect]) -> tuple[Joint, ...]:
    joints = list(machine.joints)
    for effect in effects:
        index = machine.numbers.index(effect.joint)
        joints[index] = replace(joints[index], **effect.hidden.changes)
    return tuple(joints)


def _structure(machine: Machine) -> tuple[tuple[int, str], ...]:
    found = []
    for number, joint in zip(machine.numbers, machine.joints, strict=True):
        if joint.gravity:
            found.append((number, "gravity_tilt"))
        if joint.weight:
            found.append((number, "amplifier_offset"))
    return tuple(found)


def coloured_noise(samples: int, sample_time: float, level: float, rng: Rng) -> Array:
    """First-order coloured noise of rms `level` and correlation time NOISE_CORRELATION. (samples,)"""
    from scipy.signal import lfilter

    keep = math.exp(-sample_time / NOISE_CORRELATION)
    white = rng.standard_normal(samples)
    start = [keep * rng.standard_normal()]
    return level * lfilter([math.sqrt(1.0 - keep**2)], [1.0, -keep], white, zi=np.array(start))[0]


def stray_signal(time: Array, level: float, rng: Rng) -> Array:
    """What a neighbour's unlogged motion does to a joint: smooth, irregular, rms `level`. (T,)"""
    wave = np.zeros_like(time)
    for _ in range(12):
        rate = log_uniform(rng, 0.2, 6.0)
        wandering = np.cumsum(rng.standard_normal(len(time))) * math.sqrt(time[1] - time[0]) * 0.7
        wave += np.sin(2 * np.pi * rate * time + rng.uniform(0, 2 * np.pi) + wandering)
    return level * wave / rms(wave)


def wandering(time: Array, largest: float, rng: Rng) -> Array:
    """A delay that wanders between 0 and `largest` within seconds. (T,)"""
    rate = log_uniform(rng, 0.1, 0.6)
    return 0.5 * largest * (1.0 - np.cos(2 * np.pi * rate * time + 0.8 * np.sin(2 * np.pi * 0.37 * rate * time)))


def record(truth: Truth, experiment: Experiment, name: str, rng: Rng) -> tuple[Log, Streams, Array] | None:
    """The experiment on the true machine, its hidden signals, and the mean square current per joint (n,).

    None when it leaves its range, runs away or sticks.
    """
    machine, joints = truth.machine, truth.joints
    samples, n = experiment.feed.shape
    time: Array = machine.sample_time * np.arange(samples, dtype=np.float64)
    columns = range(n)
    streams = Streams()
    jitter, stamped = 0.0, False
    for effect in truth.effects:
        index = machine.numbers.index(effect.joint)
        wanted = effect.hidden.streams
        own = np.arange(n) == index
        if "stray_torque" in wanted:
            streams = replace(streams, stray_torque=np.outer(stray_signal(time, wanted["stray_torque"], rng), own))
        if "arrival_delay" in wanted:
            streams = replace(streams, arrival_delay=np.outer(wandering(time, wanted["arrival_delay"], rng), own))
        if "timestamp_jitter" in wanted:
            jitter, stamped = wanted["timestamp_jitter"], bool(wanted["jitter_in_stamps"])
    drive_noise = [coloured_noise(samples, machine.sample_time, truth.amplifier_noise[j], rng) for j in columns]
    sensor_noise = rng.standard_normal((samples, n)) * np.array(truth.sensor_noise)
    motion = simulate(
        joints,
        experiment.feed,
        machine.sample_time,
        coupling_inertia=machine.coupling_inertia,
        loop=experiment.loop,
        reference=experiment.reference,
        command_step=np.array(machine.command_step),
        command_limit=np.array(machine.command_limit),
        start=experiment.start,
        amplifier_noise=np.column_stack(drive_noise),
        sensor_noise=sensor_noise,
        ramp=machine.hold == "first_order" and experiment.mode == "open",
        fine=jitter > 0.0,
        step_limit=machine.step,
        stray_torque=streams.stray_torque,
        arrival_delay=streams.arrival_delay,
    )
    travel, speed = np.array(machine.travel), np.array(machine.speed)
    inside = np.abs(motion.position).max(axis=0) <= 1.6 * travel
    slow = np.abs(motion.velocity).max(axis=0) <= 2.0 * speed
    moved = np.ptp(motion.position, axis=0)
    moving = moved >= np.maximum(100.0 * np.array([joint.encoder_step for joint in joints]), 0.02 * travel)
    if not (np.isfinite(motion.position).all() and inside.all() and slow.all() and moving.all()):
        return None
    measured = motion.measured
    if jitter > 0.0:
        shift = np.clip(jitter * rng.standard_normal(samples), -0.9 * machine.sample_time, 0.9 * machine.sample_time)
        if stamped:
            time = np.sort(time + np.clip(shift, -0.45 * machine.sample_time, 0.45 * machine.sample_time))
            time = time - time[0]
        else:
            measured = _resampled(truth, motion, np.clip(time + shift, 0.0, time[-1]), sensor_noise)
    log = Log(
        time=time,
        command=motion.command,
        position=measured,
        joints=machine.numbers,
        facts=machine.facts(),
        robot=machine.robot,
        loop=experiment.mode,
        name=name,
    )
    return log, streams, np.mean(motion.current_square, axis=0)


def _resampled(truth: Truth, motion: Motion, instants: Array, noise: Array) -> Array:
    """Encoder readings at other instants than the planned ones, by cubic Hermite interpolation of the true motion."""
    from scipy.interpolate import CubicHermiteSpline

    count = len(motion.fine_position)
    grid = truth.machine.sample_time * (len(motion.command) / (count - 1)) * np.arange(count)
    true = CubicHermiteSpline(grid, motion.fine_position, motion.fine_velocity)(instants)
    reading = true + noise
    for j, joint in enumerate(truth.joints):
        reading[:, j] += joint.eccentricity * np.sin(true[:, j] + joint.eccentricity_phase)
        reading[:, j] = joint.encoder_step * np.floor(reading[:, j] / joint.encoder_step + 0.5)
    return reading


def data_sheet(machine: Machine, seed: int) -> dict[str, Any]:
    """Rough values an engineer would know, each within about 20 % of the truth. Keys carry units."""
    rng = np.random.default_rng([seed, 77])
    sheet: dict[str, Any] = {"family": machine.family, "joints": {}}
    for number, joint in zip(machine.numbers, machine.joints, strict=True):
        about = lambda value: float(f"{value * rng.uniform(0.8, 1.25):.2g}")  # noqa: E731
        facts = {"inertia": about(total_inertia(joint)), "viscous": about(joint.viscous)}
        if joint.drive != Drive.TORQUE:
            facts |= {"torque_constant": about(joint.torque_constant), "amplifier_gain": joint.gain}
        if joint.drive == Drive.VOLTAGE:
            facts |= {"resistance": about(joint.resistance), "inductance": about(joint.inductance)}
        if joint.gravity:
            facts["gravity_torque"] = about(joint.gravity)
        if joint.weight:
            facts["weight"] = about(joint.weight)
        sheet["joints"][str(number)] = facts
    return sheet


def truth_table(truth: Truth) -> dict[str, Any]:
    """The truth as plain data for JSON."""
    joints = []
    for number, joint in zip(truth.machine.numbers, truth.joints, strict=True):
        values = {key: value for key, value in asdict(joint).items() if value != getattr(Joint(), key)}
        joints.append({"joint": number, "input_equivalent_per_torque": input_equivalent(joint), **values})
    return {
        "seed": truth.seed,
        "kind": truth.kind.value,
        "family": truth.family,
        "foreign": truth.foreign,
        "effects": [
            {
                "name": effect.hidden.name,
                "joint": effect.joint,
                "law": effect.hidden.law,
                "parameters": {
                    key: {k: v for k, v in asdict(value).items() if v is not None}
                    for key, value in effect.hidden.parameters.items()
                },
                "visibility": effect.visibility,
                "equivalent": [sorted(names) for names in effect.hidden.equivalent],
            }
            for effect in truth.effects
        ],
        "structure": [{"joint": joint, "name": name} for joint, name in truth.structure],
        "amplifier_noise_rms": list(truth.amplifier_noise),
        "sensor_noise_rms": list(truth.sensor_noise),
        "experiments": list(truth.forms),
        "sample_time": truth.machine.sample_time,
        "coupling_inertia": truth.machine.coupling_inertia,
        "joints": joints,
    }


def write_trial(trial: Trial, logs: Path, truth: Path) -> None:
    """Logs, sidecars and data sheet into one folder, `truth.json` into another one."""
    import tomli_w

    from envs.log_files import save

    if logs.resolve() == truth.resolve():
        raise ValueError(f"logs and truth would share {logs}. Give two folders")
    for log in (*trial.train, *trial.holdout):
        save(log, logs / f"{log.name}.csv")
    sheet = data_sheet(trial.truth.machine, trial.truth.seed)
    (logs / "nominal.toml").write_text(tomli_w.dumps(sheet), encoding="utf-8")
    truth.mkdir(parents=True, exist_ok=True)
    (truth / "truth.json").write_text(json.dumps(truth_table(trial.truth), indent=1) + "\n", encoding="utf-8")


def main(
    seed: Annotated[int, typer.Option(help="Same seed, same trial; from 1000000 upward kept apart for scoring.")],
    kind: Annotated[Kind, typer.Option(help="What is hidden.")],
    out: Annotated[Path, typer.Option(help="Folder to write below.")],
    family: Annotated[str | None, typer.Option(help="Force the family of machines.")] = None,
    effect: Annotated[str | None, typer.Option(help="Force the hidden effect.")] = None,
) -> None:
    """Writes one trial below OUT: logs/NAME/ and truth/NAME/."""
    name = hashlib.sha256(repr((seed, kind.value, family, effect)).encode()).hexdigest()[:12]
    write_trial(make_trial(seed, kind, family, effect=effect), out / "logs" / name, out / "truth" / name)


if __name__ == "__main__":
    typer.run(main)
