"""Do these logs belong to this robot, and to one another? Errors stop (LogError), findings are said."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from envs.log import JointFacts, Log, LogError
from envs.log_statistics import quantisation_step
from envs.plausibility import Rough, moved, rough, works_backwards
from envs.robot import Robot
from envs.validation import Finding, command_column

#: Share of a joint's range by which a position may exceed its limits before that is worth saying.
MARGIN = 0.05
#: Factor between the inertia of a recording and that of a robot's description from which this is said.
OTHER_INERTIA = 4.0
#: Factors between the inertias of two recordings from which this is said, and from which they are refused.
OTHER_MACHINE, REFUSED_MACHINE = 2.5, 5.0
#: What may be wrong where units differ.
STATED_FOR_ALL = "; sidecars that differ hold for their own logs only, what --columns states for all"
#: Share of the command's variance that the rough physics has to explain before its inertia is believed.
EXPLAINED = 0.7
#: The same before a recording may be refused for it: what else drives a joint must not be taken for its inertia.
SURE = 0.9
#: The same for what only the inertia explains: beside a large back-EMF, a winding's lag passes for a smaller one.
OWN = 0.03
#: Shares of the largest command at which a drive may clip it, and how much less that may explain.
LIMITS, LOST = np.geomspace(0.7, 0.02, 16), 0.02


def with_robot(log: Log, robot: Robot) -> tuple[Log, tuple[Finding, ...]]:
    """The log with the sensor facts that only the robot's description knows, and what does not fit the description.

    Facts that the log states itself stay. Raises LogError when a joint does not exist, takes another kind of command,
    or moves far beyond its limits in a way that a wrong unit explains.
    """
    facts: list[JointFacts] = []
    findings: list[Finding] = []
    for column, joint in enumerate(log.joints):
        if joint > len(robot):
            raise LogError(
                f"{robot.name} has joints 1 to {len(robot)}, not {joint}",
                remedy="Name another robot or map the columns to its joints",
                source=log.source,
                column=f"q{joint}",
            )
        own, known = log.facts[column], robot.facts(joint)
        if own.input != known.input:
            raise LogError(
                f"the log holds a {own.input} for joint {joint}, {robot.name} takes a {known.input}",
                remedy="Name another robot, or map the column of the command that its drive takes",
                source=log.source,
                column=command_column(log, joint),
            )
        facts.append(
            replace(
                own,
                position_unit=known.position_unit,
                encoder_step=own.encoder_step or known.encoder_step,
                command_step=own.command_step or known.command_step,
                command_limit=own.command_limit or known.command_limit,
            )
        )
        findings += range_findings(log, robot, joint)
    findings += inertia_findings(log, robot)
    return replace(log, facts=tuple(facts), robot=log.robot or robot.name), tuple(findings)


def range_findings(log: Log, robot: Robot, joint: int) -> Iterator[Finding]:
    """Positions against the joint's limits, commands against the amplifier's range.

    Raises LogError for positions that lie within the limits when they are taken for degrees, millimetres or counts.
    """
    item, column = robot.joint(joint), log.index(joint)
    lower, upper = item.lower.value, item.upper.value
    slack = MARGIN * (upper - lower)
    low, high = float(log.position[:, column].min()), float(log.position[:, column].max())
    if not (lower - slack <= low and high <= upper + slack):
        unit, factor = ("degrees", math.pi / 180.0) if item.unit == "rad" else ("millimetres", 1e-3)
        inside = lower - slack <= factor * low and factor * high <= upper + slack
        if inside and (high - low) > 2.0 * (upper - lower):
            raise LogError(
                f"position from {low:.4g} to {high:.4g} {item.unit}, but {item.name} of {robot.name} moves from "
                f"{lower:.4g} to {upper:.4g}: this looks like {unit}",
                remedy=f"Convert to {item.unit} or state the unit of q{joint} in a column map",
                source=log.source,
                column=f"q{joint}",
                row=int(np.argmax(np.abs(log.position[:, column]))) + 1,
            )
        yield Finding(
            "beyond_range",
            f"q{joint} runs from {low:.4g} to {high:.4g} {item.unit}, beyond the range of {item.name} of {robot.name} "
            f"({lower:.4g} to {upper:.4g}): is it this robot, with this gear and this unit?",
        )
    limit, largest = item.drive.command_limit.value, float(np.abs(log.command[:, column]).max())
    if largest > 1.01 * limit:
        yield Finding(
            "beyond_limit",
            f"{command_column(log, joint)} reaches {largest:.4g}, beyond the {limit:.4g} that {robot.name} accepts",
        )


def inertia_findings(log: Log, robot: Robot) -> Iterator[Finding]:
    """Whether the motion needs about the inertia that the robot has; only for a joint that moves alone."""
    found = other_inertia(log, robot)
    if found is not None:
        joint, ratio = found
        yield Finding(
            "other_inertia",
            f"joint {joint} moves as if it had {ratio:.2g} times the inertia that {robot.name} describes: wrong gear "
            "ratio, unit or robot? Its numbers are not taken for known",
        )


def other_inertia(log: Log, robot: Robot) -> tuple[int, float] | None:
    """The joint that moves alone and its inertia as a multiple of the described one, where that is far from 1."""
    known = lone_inertia(log)
    if known is None:
        return None
    joint, physics = known
    at = np.array([0.5 * (item.lower.value + item.upper.value) for item in robot.joints])
    at[~np.isfinite(at)] = 0.0
    for column, number in enumerate(log.joints):
        at[number - 1] = float(np.mean(log.position[:, column]))
    described = float(robot.inertia_matrix(at)[joint - 1, joint - 1]) * robot.input_equivalent(joint)
    assert physics.inertia is not None
    ratio = physics.inertia / described
    return None if 1.0 / OTHER_INERTIA < ratio < OTHER_INERTIA else (joint, ratio)


def lone_inertia(log: Log) -> tuple[int, Rough] | None:
    """The joint and its rough physics of a recording of one joint, where its inertia can be told."""
    found = moved(log)
    if len(found) != 1 or np.sum(np.ptp(log.position, axis=0) > 0.0) != 1:
        return None
    ((joint, physics),) = found.items()
    if physics.inertia is None or physics.inertia <= 0.0 or physics.explained < EXPLAINED or physics.own_share < OWN:
        return None
    return joint, physics


def check_signs(log: Log) -> None:
    """Refuses a recording in which the motors take energy out of joints with friction."""
    if works_backwards(log):
        raise LogError(
            "over the whole recording the commands take energy out of the joints, which no machine with friction does: "
            "the sign of a command or of a position is wrong",
            remedy="Turn the sign of one of them (scale = -1 in a column map)",
            source=log.source or log.name,
        )


def check_apart(fitted: Sequence[Log], held_out: Sequence[Log]) -> None:
    """Refuses a recording that is given twice, whatever its files are called: it would count double, or judge itself.

    Raises LogError.
    """
    seen: dict[str, tuple[str, str]] = {}
    for role, group in (("fitted", fitted), ("held-out", held_out)):
        for log in group:
            before, name = seen.setdefault(log.content_hash, ("", log.name))
            if before == "fitted" != role:
                raise LogError(
                    f"the held-out log {log.name} is also fitted ({name})",
                    remedy="Give another one",
                    source=log.source,
                )
            if before:
                other = f", also as {name}" if name != log.name else ""
                raise LogError(
                    f"the {role} log {log.name} is given twice{other}",
                    remedy="Give each recording once",
                    source=log.source,
                )
            seen[log.content_hash] = role, log.name


def check_together(logs: Sequence[Log]) -> tuple[Finding, ...]:
    """Whether several logs can come from one machine.

    Raises LogError when joints, kinds of command or named robots differ; says when resolutions or rates differ.
    """
    findings: list[Finding] = []
    first = logs[0]
    for log in logs:
        check_signs(log)
    for log in logs[1:]:
        for name, one, other in (
            ("the joints", list(first.joints), list(log.joints)),
            ("the commands", [fact.input for fact in first.facts], [fact.input for fact in log.facts]),
            ("the units", [fact.position_unit for fact in first.facts], [fact.position_unit for fact in log.facts]),
            ("the robots", first.robot or log.robot, log.robot or first.robot),
        ):
            if one != other:
                apart = STATED_FOR_ALL if name in ("the commands", "the units") else ""
                raise LogError(
                    f"{name} differ from {first.name}: {other} instead of {one}",
                    remedy=f"Give logs of one machine only{apart}",
                    source=log.source or log.name,
                )
        findings += difference_findings(first, log)
    findings += machine_findings(logs)
    return tuple(findings)


def machine_findings(logs: Sequence[Log]) -> Iterator[Finding]:
    """Whether all logs move the same inertia.

    Raises LogError when it differs as that of one machine never does, and neither an inertia between the two nor a
    limit of the command explains both: a drive that clips a large command makes it look like a multiple of the inertia.
    """
    known = [(log, item) for log in logs if (item := lone_inertia(log)) is not None]
    for log, (joint, physics) in known[1:]:
        other, (same, reference) = known[0]
        assert physics.inertia is not None
        assert reference.inertia is not None
        factor = physics.inertia / reference.inertia
        if joint != same or 1.0 / OTHER_MACHINE < factor < OTHER_MACHINE:
            continue
        said = f"joint {joint} of {log.name} moves {factor:.2g} times the inertia of that of {other.name}"
        sure = min(physics.explained, reference.explained) > SURE
        refused = max(factor, 1.0 / factor) >= REFUSED_MACHINE and sure
        if (
            refused
            and explained_by_one(physics, reference) < EXPLAINED
            and not explained_by_a_limit((log, physics), (other, reference), joint)
        ):
            raise LogError(
                f"{said}: these are recordings of different machines, or in different units",
                remedy="Give logs of one machine in the same units",
                source=log.source or log.name,
            )
        yield Finding("different_machine", f"{said}: are they recordings of one machine?")


def explained_by_one(first: Rough, second: Rough) -> float:
    """Share of the command's variance that the same inertia in two recordings explains, in that of them which it fits
    less well.

    Away from the best inertia of one recording, the unexplained share grows by own_share (inertia / best - 1)^2.
    """
    best, own = (np.array([getattr(item, name) for item in (first, second)]) for name in ("inertia", "own_share"))
    common = np.sum(own / best) / np.sum(own / best**2)
    explained = np.array([first.explained, second.explained]) - own * (common / best - 1.0) ** 2
    return float(np.min(explained))


def explained_by_a_limit(one: tuple[Log, Rough], two: tuple[Log, Rough], joint: int) -> bool:
    """Whether with some limit of the command both recordings, each with its rough physics, move about the same inertia,
    explained as well as without.

    Where all commands of a recording are cut to a tenth, they stand for ten times the inertia.
    """
    column = one[0].index(joint)
    largest = max(float(np.max(np.abs(log.command[:, column]))) for log, _ in (one, two))
    for limit in largest * LIMITS:
        cut: list[float] = []
        for log, free in (one, two):
            limited = rough(replace(log, command=np.clip(log.command, -limit, limit)), joint)
            if limited is None or limited.inertia is None or limited.explained < free.explained - LOST:
                break
            cut.append(limited.inertia)
        if len(cut) == 2 and 1.0 / OTHER_MACHINE < cut[0] / cut[1] < OTHER_MACHINE:
            return True
    return False


def difference_findings(first: Log, log: Log) -> Iterator[Finding]:
    """Different encoder steps mean different sensors; rates may differ and are only said."""
    for column, joint in enumerate(log.joints):
        steps = [
            item.facts[column].encoder_step or quantisation_step(item.position[:, column]) for item in (first, log)
        ]
        if steps[0] and steps[1] and abs(steps[1] / steps[0] - 1.0) > 0.01:
            yield Finding(
                "different_encoder",
                f"q{joint} of {log.name} has steps of {steps[1]:.4g}, that of {first.name} {steps[0]:.4g}: "
                "are they recordings of one machine?",
            )
    if not 0.8 < log.sample_time / first.sample_time < 1.25:
        yield Finding(
            "different_rate",
            f"{log.name} was recorded at {1 / log.sample_time:.4g} Hz, {first.name} at {1 / first.sample_time:.4g} Hz",
        )
