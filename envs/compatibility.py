"""Do these logs belong to this robot, and to one another? Errors stop (LogError), findings are said."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from envs.log import JointFacts, Log, LogError
from envs.log_statistics import quantisation_step
from envs.robot import Robot
from envs.validation import Finding, command_column

#: Share of a joint's range by which a position may exceed its limits before that is worth saying.
MARGIN = 0.05


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


def check_together(logs: Sequence[Log]) -> tuple[Finding, ...]:
    """Whether several logs can come from one machine.

    Raises LogError when joints, kinds of command or named robots differ; says when resolutions or rates differ.
    """
    findings: list[Finding] = []
    first = logs[0]
    for log in logs[1:]:
        for name, one, other in (
            ("the joints", list(first.joints), list(log.joints)),
            ("the commands", [fact.input for fact in first.facts], [fact.input for fact in log.facts]),
            ("the units", [fact.position_unit for fact in first.facts], [fact.position_unit for fact in log.facts]),
            ("the robots", first.robot or log.robot, log.robot or first.robot),
        ):
            if one != other:
                raise LogError(
                    f"{name} differ from {first.name}: {other} instead of {one}",
                    remedy="Give logs of one machine only",
                    source=log.source or log.name,
                )
        findings += difference_findings(first, log)
    return tuple(findings)


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
