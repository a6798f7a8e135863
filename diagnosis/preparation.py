"""From log files to problems: read and check the logs, choose the joints, say what is known of them beforehand."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from diagnosis.nominal import Gravity, JointStructure
from diagnosis.planar_arm import is_planar_arm, planar_pair
from envs.compatibility import check_apart, check_together, other_inertia, with_robot
from envs.log import Array, Log, LogError
from envs.log_files import load_with_findings, read_toml, sidecar_path
from envs.log_statistics import lost_spells
from envs.robot import Robot, RobotError
from envs.robots import find_robot
from envs.validation import DOUBTFUL_UNIT
from methods.effects.base import Effect

STILL = 20.0
"""A joint whose position stays within this many encoder steps is held still."""
GIVES_WAY = 0.02
"""A joint whose way is a smaller share of the widest one is held by its controller."""
KEPT_APART = 0.25
"""Share of each log that is kept apart for the gain when no held-out log is given."""
SHORTEST = 400
"""Samples below which a log is not divided."""
PART = 100
"""Samples below which a part of a log between gaps is left out."""
PARTS = 20
"""Parts of a log at most, between its longest gaps."""
MOST_LEFT_OUT = 0.25
"""Share of a log that may be left out so; of one that is all gaps nothing would remain."""
SEVERAL = 3
"""Logs of which the same is said once."""
FIGURE = re.compile(r"(?<!joint )\b\d[\d.]*")
"""Figures of a finding that may differ from log to log."""


class DiagnosisError(ValueError):
    """A diagnosis cannot be made, said in one line: what is wrong, what to do."""


@dataclass(frozen=True, eq=False)
class Recordings:
    """Logs to fit and logs to measure the gain on, with everything that was noticed. `on` says what the latter are.

    doubtful: what was noticed of joints whose angle may be in another unit than radians.
    """

    fitted: tuple[Log, ...]
    held_out: tuple[Log, ...]
    on: str
    robot: Robot | None
    findings: tuple[str, ...]
    doubtful: Mapping[int, str] = field(default_factory=dict)


def recordings(
    logs: Sequence[Path], holdout: Sequence[Path], robot: str | None, columns: Path | None, repair: bool
) -> Recordings:
    """Read, complete and check all logs. Raises LogError, RobotError or DiagnosisError, one line."""
    if not logs:
        raise DiagnosisError("there is no log to diagnose. Give at least one")
    lent = shared_sidecar((*logs, *holdout)) if columns is None else {}
    read = [load_with_findings(path, lent.get(path, columns), repair=repair) for path in (*logs, *holdout)]
    said = gathered((log.name, finding.text) for log, findings in read for finding in findings)
    said += [f"{path.name} has no sidecar: what {own.name} states is taken for it" for path, own in lent.items()]
    found = arrange([log for log, _ in read[: len(logs)]], [log for log, _ in read[len(logs) :]], robot, said)
    if found.robot is not None:  # whose range the angles have been compared with
        return found
    doubts = (finding for _, findings in read for finding in findings if finding.kind == DOUBTFUL_UNIT)
    return replace(found, doubtful={doubt.joint: doubt.text for doubt in doubts if doubt.joint is not None})


def shared_sidecar(paths: Sequence[Path]) -> dict[Path, Path]:
    """The sidecar of another log for those that have none, where all sidecars say the same, and not which rows of their
    own log to read."""
    own = {path: sidecar_path(path) for path in paths}
    there = [sidecar for sidecar in own.values() if sidecar.exists()]
    if not there or len({sidecar.read_bytes() for sidecar in there}) > 1 or "rows" in read_toml(there[0]):
        return {}
    return {path: there[0] for path, sidecar in own.items() if path.is_file() and not sidecar.exists()}


def arrange(logs: Sequence[Log], holdout: Sequence[Log], robot: str | None, said: Sequence[str] = ()) -> Recordings:
    """The same for logs in memory, which have been checked."""
    findings = list(said)
    described = named_robot(logs[0], robot, findings)
    complete = list(logs), list(holdout)
    if described is not None:
        compared = []
        for group in complete:
            for i, log in enumerate(group):
                group[i], found = with_robot(log, described)
                compared += [(log.name, finding.text) for finding in found]
        findings += gathered(compared)
    check_apart(*complete)
    findings += [finding.text for finding in check_together([*complete[0], *complete[1]])]
    if not complete[1] and any(len(log) < SHORTEST for log in complete[0]):
        short = min(complete[0], key=len)
        raise DiagnosisError(
            f"{short.source or short.name}: no held-out log was given, and a log of {len(short)} samples cannot be "
            f"divided: {SHORTEST} are needed. Record for longer, or give another log with --holdout"
        )
    fitted, held_out = ([part for log in own for part in between_gaps(log, findings)] for own in complete)
    if held_out:
        return Recordings(tuple(fitted), tuple(held_out), "held-out", described, tuple(findings))
    findings.append("no held-out log was given: the last quarter of each log is kept apart for the gain")
    cuts = [(log, int(len(log) * (1.0 - KEPT_APART))) for log in fitted if len(log) >= SHORTEST]
    return Recordings(
        tuple(log.slice(0, cut) for log, cut in cuts) + tuple(log for log in fitted if len(log) < SHORTEST),
        tuple(log.slice(cut, len(log)) for log, cut in cuts),
        "last quarter of each log, kept apart",
        described,
        tuple(findings),
    )


def between_gaps(log: Log, findings: list[str]) -> list[Log]:
    """The parts of a log between gaps over which no model can be simulated, said; the log itself where it has none, or
    little but short parts. Those in which a joint stands still that moves in others are left out."""
    ends = [0, *(np.sort(lost_spells(log.time)[: PARTS - 1]) + 1).tolist(), len(log)]
    parts = [log.slice(a, b) for a, b in pairwise(ends) if b - a >= PART]
    moving = [joint for joint in log.joints if driven(log, joint)]
    parts = [part for part in parts if all(driven(part, joint) for joint in moving)]
    left_out = len(log) - sum(map(len, parts))
    if len(ends) == 2 or left_out > MOST_LEFT_OUT * len(log):
        return [log]
    apart = f"; {left_out} samples between them are left out" if left_out else ""
    findings.append(
        f"{log.name}: what was commanded in its gaps is not known: it is taken as {len(parts)} separate "
        f"part{'s' * (len(parts) > 1)}{apart}"
    )
    return parts


def gathered(said: Iterable[tuple[str, str]]) -> list[str]:
    """What was noticed of logs (name, text), a line each, or one for SEVERAL of which the same is said up to figures;
    these are then those of the first."""
    alike: dict[str, dict[str, list[str]]] = {}
    for name, text in said:
        alike.setdefault(FIGURE.sub("", text), {}).setdefault(name, []).append(text)
    lines = []
    for group in alike.values():
        if len(group) < SEVERAL:
            lines += [f"{name}: {text}" for name, texts in group.items() for text in texts]
            continue
        name, (text, *_) = next(iter(group.items()))
        differ = len({item for texts in group.values() for item in texts}) > 1
        lines.append(f"{name} and {len(group) - 1} other logs: {text}" + (f" (figures of {name})" if differ else ""))
    return lines


def named_robot(log: Log, name: str | None, findings: list[str]) -> Robot | None:
    """The robot asked for, else the one that the log names if it is known."""
    if name is not None:
        return find_robot(name)
    if log.robot is None:
        return None
    try:
        return find_robot(log.robot)
    except RobotError:
        findings.append(f"the log names the robot {log.robot}, which is not known here: physical units are left out")
        return None


def moving_joints(logs: Sequence[Log], wanted: int | None, findings: list[str]) -> tuple[int, ...]:
    """Joints that move in every log; the one asked for must. Others are said and skipped."""
    first = logs[0]
    if wanted is not None:
        first.index(wanted)
    chosen = []
    for joint in first.joints if wanted is None else (wanted,):
        still = [log.name for log in logs if not moves(log, joint)]
        if len(still) < len(logs):  # what others drive moves too, and tells of the coupling
            still = [log.name for log in logs if not driven(log, joint)]
        if not still:
            chosen.append(joint)
        else:
            idle = all(driven(log, joint) and not moves(log, joint) for log in logs)
            why = "moves without a command" if idle else "is held still"
            findings.append(f"joint {joint} {why} in {', '.join(still)} and is skipped")
    if wanted is None:
        chosen = [joint for joint in chosen if not stands_beside(logs, joint, chosen, findings)]
    if not chosen:
        raise LogError(
            f"no joint to diagnose: {findings[-1]}",
            remedy="Give logs in which the joint moves and is commanded",
            source=first.source,
        )
    return tuple(chosen)


def stands_beside(logs: Sequence[Log], joint: int, others: Sequence[int], findings: list[str]) -> bool:
    """True, and said, for a joint that a controller holds while others move: all it does is give way to them."""
    first = logs[0]
    unit = first.facts[first.index(joint)].position_unit

    def way(number: int) -> float:
        found = max(float(np.ptp(log.position[:, log.index(number)])) for log in logs)
        return min(found, 2.0 * np.pi) if unit == "rad" else found

    alike = [number for number in others if first.facts[first.index(number)].position_unit == unit]
    widest = max(alike, key=way)
    if way(joint) >= GIVES_WAY * way(widest):
        return False
    findings.append(
        f"joint {joint} is skipped: it moves by {way(joint):.2g} {unit}, joint {widest} by {way(widest):.2g} {unit}. "
        f"--joint {joint} asks for it"
    )
    return True


def driven(log: Log, joint: int) -> bool:
    """True when a joint moves by more than its encoder's noise and it or another joint of the log is commanded."""
    column = log.index(joint)
    step = log.facts[column].encoder_step or 0.0
    return bool(log.command.any() and np.ptp(log.position[:, column]) > max(STILL * step, 1e-9))


def moves(log: Log, joint: int) -> bool:
    """True when a joint is commanded and moves by more than its encoder's noise."""
    return driven(log, joint) and bool(log.command[:, log.index(joint)].any())


def groups(
    logs: Sequence[Log], joints: tuple[int, ...], robot: Robot | None, effects: Sequence[Effect]
) -> Sequence[tuple[tuple[int, ...], tuple[JointStructure, ...]]]:
    """Joints that are modelled together, with what is known of them: a planar pair, by the robot's description or by
    the logs, which then tell of gravity, too; else each alone."""
    known = {joint: structure(logs[0], joint, robot) for joint in joints}
    alone = [((joint,), (known[joint],)) for joint in joints]
    if len(joints) < 2:
        return alone
    first, second = joints[:2]
    pair = known[first], known[second]
    if robot is None:
        gravity = planar_pair(logs, (first, second), pair, effects)
        if gravity is None:
            return alone
        pair = replace(pair[0], gravity=gravity), replace(pair[1], gravity=gravity)
    elif (first, second) != (1, 2) or not is_planar_arm(robot, pose(logs[0], robot), others(logs, (1, 2))):
        return alone
    return [((first, second), pair), *alone[2:]]


def others(logs: Sequence[Log], joints: tuple[int, ...]) -> dict[int, tuple[float, float]]:
    """Least and largest position of the other joints that move, by number."""
    found: dict[int, tuple[float, float]] = {}
    for log in logs:
        for joint in set(log.joints) - set(joints):
            if driven(log, joint):
                own = log.position[:, log.index(joint)]
                low, high = found.get(joint, (np.inf, -np.inf))
                found[joint] = min(low, float(own.min())), max(high, float(own.max()))
    return found


def structure(log: Log, joint: int, robot: Robot | None) -> JointStructure:
    """What is known of a joint before any fit: the log says what the command is, the robot the rest.

    Of a robot whose inertia the motion contradicts only what kind of joint it is counts as known, and no number.
    """
    kind = log.facts[log.index(joint)].input
    if robot is None:
        return JointStructure(input=kind, electrical=kind == "voltage")
    drive = robot.joint(joint).drive
    amplified = drive.amplifier == "voltage"
    back_emf = drive.torque_constant**2 / drive.resistance.value if amplified else 0.0
    viscous = drive.viscous.value
    total = viscous + back_emf
    lag = drive.inductance.value / drive.resistance.value if amplified else 0.0
    known = JointStructure(
        input=drive.amplifier,
        electrical=amplified and lag > 0.0,
        gravity=gravity_kind(robot, joint, pose(log, robot)),
    )
    contradicted, _ = other_inertia(log, robot) or (None, 1.0)
    if joint == contradicted:
        return known
    return replace(
        known,
        viscous_share=viscous / total if total > 0.0 else 0.0,
        damping=drive.input_equivalent * total or None,
        electrical_time_constant=lag or None,
        inertia=drive.input_equivalent * float(robot.inertia_matrix(pose(log, robot))[joint - 1, joint - 1]),
        torque_limit=torque_limit(robot, joint),
    )


def torque_limit(robot: Robot, joint: int) -> float:
    """Torque at the drive's current limit, in command units; 0 where there is none."""
    drive = robot.joint(joint).drive
    current = drive.current_limit.value
    if drive.amplifier == "torque" or not np.isfinite(current):
        return 0.0
    return current * drive.torque_constant * drive.input_equivalent


def pose(log: Log, robot: Robot) -> Array:
    """Mean position of every joint of the robot during a log; the middle of the range for joints it does not hold."""
    found = np.array([_middle(joint.lower.value, joint.upper.value) for joint in robot.joints])
    for column, joint in enumerate(log.joints):
        found[joint - 1] = float(np.mean(log.position[:, column]))
    return found


def _middle(lower: float, upper: float) -> float:
    return 0.5 * (lower + upper) if np.isfinite(lower + upper) else 0.0


def gravity_kind(robot: Robot, joint: int, at: Array) -> Gravity:
    """What gravity does to a joint around a pose: ``none``, ``constant`` or ``pendulum``."""
    places = np.tile(at, (8, 1))
    turn = 2.0 * np.pi if robot.joint(joint).unit == "rad" else 0.1
    places[:, joint - 1] += turn * np.arange(8) / 8
    torque = robot.body.bias(places, np.zeros_like(places))[:, joint - 1]
    size = float(np.max(np.abs(torque)))
    if size < 1e-9:
        return "none"
    return "constant" if np.ptp(torque) < 1e-6 * size else "pendulum"


def given_numbers(robot: Robot, joint: int, log: Log) -> dict[str, float]:
    """The robot's own nominal parameters in the models' units, by the names of the kernel's columns."""
    drive = robot.joint(joint).drive
    at, unit = pose(log, robot), drive.input_equivalent
    numbers = {
        "inertia": unit * float(robot.inertia_matrix(at)[joint - 1, joint - 1]),
        "viscous": unit * drive.viscous.value,
    }
    if drive.amplifier == "voltage":
        numbers["back_emf"] = drive.torque_constant / drive.amplifier_gain.value
        numbers["electrical_time_constant"] = drive.inductance.value / drive.resistance.value
    kind = gravity_kind(robot, joint, at)

    def bias(angle: float) -> float:
        there = np.where(np.arange(len(at)) == joint - 1, angle, at)
        return unit * float(robot.body.bias(there, np.zeros_like(at))[joint - 1])

    if kind == "constant":
        numbers["load"] = bias(at[joint - 1])
    elif kind == "pendulum":
        numbers["gravity_sine"], numbers["gravity_cosine"] = bias(0.5 * np.pi), bias(0.0)
    return numbers
