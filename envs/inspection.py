"""What a log is made of: clock, ranges, quantisation, saturation and excitation of every joint."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from envs.column_map import STANDARD_COLUMN
from envs.column_proposal import propose
from envs.log import COMMAND_UNIT, Log, LogError
from envs.log_files import load_with_findings, read_table, sidecar_path
from envs.log_statistics import Timing, excitation_band, quantisation_step, saturation, timing
from envs.log_tables import listed
from envs.rigs import recognise
from envs.text_form import counted
from envs.validation import Finding, check, command_column

STANDARD_NEEDED = (frozenset({"q"}), frozenset({"v", "i", "tau"}))
"""A file with one of each of these columns, of any joint, is taken to be in the standard layout."""


@dataclass(frozen=True)
class JointInspection:
    """One joint of a log.

    command_range, position_range: (smallest, largest) [command unit; rad or m].
    largest_speed: 99 % quantile of the speed over 20 ms [rad/s or m/s].
    encoder_step, command_step: found in the data, None when not quantised.
    saturation_level, saturation_share: where the command is cut off and for which share of the samples; nan, 0 if not.
    excitation_band: (lowest, highest) frequency with 98 % of the command's power [Hz].
    """

    joint: int
    command: str
    command_unit: str
    position_unit: str
    command_range: tuple[float, float]
    position_range: tuple[float, float]
    largest_speed: float
    encoder_step: float | None
    command_step: float | None
    saturation_level: float
    saturation_share: float
    excitation_band: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Inspection:
    """A whole log."""

    source: str
    samples: int
    duration: float
    clock: Timing
    joints: tuple[JointInspection, ...]
    findings: tuple[Finding, ...]

    def lines(self) -> Iterator[str]:
        """The inspection for people, one fact per line."""
        clock = self.clock
        yield f"{self.source}: {self.samples} samples, {self.duration:.4g} s, {clock.rate:.5g} Hz"
        yield (
            f"  clock: jitter {1e3 * clock.jitter:.3g} ms rms, {counted(len(clock.gap_rows), 'gap')} with about "
            f"{counted(clock.missing, 'missing sample')}, longest interval {1e3 * clock.largest_gap:.4g} ms"
        )
        for joint in self.joints:
            yield from joint_lines(joint)
        for finding in self.findings:
            yield f"  note: {finding.text}"


def joint_lines(joint: JointInspection) -> Iterator[str]:
    """One joint for people."""
    unit, command_unit = joint.position_unit, joint.command_unit
    step = "not quantised" if joint.encoder_step is None else f"step {joint.encoder_step:.6g} {unit}"
    yield (
        f"  joint {joint.joint}: position {joint.position_range[0]:.4g} to {joint.position_range[1]:.4g} {unit}, "
        f"speed up to {joint.largest_speed:.3g} {unit}/s, {step}"
    )
    cut = (
        ""
        if not joint.saturation_share
        else (
            f", cut off at {joint.saturation_level:.4g} {command_unit} for {joint.saturation_share:.1%} of the samples"
        )
    )
    step = "" if joint.command_step is None else f", step {joint.command_step:.4g} {command_unit}"
    yield (
        f"    command {joint.command}: {joint.command_range[0]:.4g} to {joint.command_range[1]:.4g} {command_unit}, "
        f"excites {joint.excitation_band[0]:.3g} to {joint.excitation_band[1]:.3g} Hz{step}{cut}"
    )


def inspect(log: Log, findings: tuple[Finding, ...] | None = None) -> Inspection:
    """Looks at a log. `findings` of its loading are passed on; without them it is validated here (LogError)."""
    return Inspection(
        source=log.source or log.name,
        samples=len(log),
        duration=log.duration,
        clock=timing(log.time),
        joints=tuple(inspect_joint(log, joint) for joint in log.joints),
        findings=check(log) if findings is None else findings,
    )


def inspect_joint(log: Log, joint: int) -> JointInspection:
    """Looks at one joint of a log."""
    column = log.index(joint)
    command, position, facts = log.command[:, column], log.position[:, column], log.facts[column]
    width = max(1, round(0.02 / log.sample_time))
    speed = np.abs(position[width:] - position[:-width]) / (log.time[width:] - log.time[:-width])
    level, share = saturation(command)
    return JointInspection(
        joint=joint,
        command=command_column(log, joint),
        command_unit="N" if (facts.input, facts.position_unit) == ("torque", "m") else COMMAND_UNIT[facts.input],
        position_unit=facts.position_unit,
        command_range=(float(command.min()), float(command.max())),
        position_range=(float(position.min()), float(position.max())),
        largest_speed=float(np.quantile(speed, 0.99)) if len(speed) else 0.0,
        encoder_step=quantisation_step(position),
        command_step=quantisation_step(command),
        saturation_level=level,
        saturation_share=share,
        excitation_band=excitation_band(command, log.sample_time),
    )


def inspect_file(path: Path, column_map: Path | None = None, *, repair: bool = False) -> Iterator[str]:
    """The inspection of a file, line by line; a column map is proposed where the file has its own names.

    Raises LogError when the file is unusable even with the proposed map.
    """
    table = read_table(path, repair=repair)
    known = column_map is not None or sidecar_path(path).exists() or recognise(table.columns) is not None
    signals = {match[1] for name in table.columns if (match := STANDARD_COLUMN.fullmatch(name))}
    if known or not any(any_of.isdisjoint(signals) for any_of in STANDARD_NEEDED):
        log, findings = load_with_findings(path, column_map, repair=repair)
        yield from inspect(log, findings).lines()
        return
    proposal = propose(table)
    yield f"{path}: columns {listed(table.columns, most=40)}"
    yield f"The names are not those of a log. Proposed map, to be checked and saved as {sidecar_path(path).name}:"
    yield ""
    yield from (f"    {line}" if line else "" for line in proposal.toml().splitlines())
    yield ""
    if proposal.left_out:
        yield f"Left out: {listed(proposal.left_out, most=40)}"
    if proposal.missing:
        raise LogError(
            f"no column looks like {' or '.join(proposal.missing)}",
            remedy=f"Complete the proposed map and save it as {sidecar_path(path).name}",
            source=str(path),
        )
    if proposal.unknown:
        stand_for = ", ".join(f"{name} is {meaning}" for name, meaning in proposal.unknown.items())
        raise LogError(
            "the proposed map needs numbers that only the owner of the file knows",
            remedy=f"{stand_for}: put in the number and save the map as {sidecar_path(path).name}",
            source=str(path),
        )
    log, findings = load_with_findings(path, proposal.map, repair=repair)
    yield from inspect(log, findings).lines()
