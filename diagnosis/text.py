"""A diagnosis in words: the one sentence, and the table for the terminal."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from io import StringIO

from diagnosis.quantities import measured, number, percent, plain, quantity, scale_for, title
from diagnosis.remainder import OWN_SENTENCE
from diagnosis.result import RAN_AWAY, Alternative, Diagnosis, Estimate, Gap, JointResult, NamedEffect
from diagnosis.settings import Settings

HEADLINE = {
    "joint_flexibility": "of {stiffness}",
    "stribeck_friction": "of {torque}, {static_torque} from rest",
    "thermal_drift": "by {resistance_rise} times the cold resistance",
    "torque_ripple": "of {share} times the torque",
    "load_dependent_friction": "of {coefficient} times the torque",
}
"""How strong an effect is, in its parameters; others are as strong as their first one says."""
BY_THEMSELVES = {"axis_coupling", "friction_asymmetry"}
"""Effects each of whose parameters is a strength by itself: the one that stands out most says how strong they are."""
WITHOUT_VOLTAGE = {"thermal_drift": "to 1/(1 + {resistance_rise}) of the cold torque"}
"""The same on drives whose current does not depend on the resistance: what falls there is the torque of the command."""
DAMPING = {"viscous": "viscous damping", "back_emf": "back-EMF"}
"""What the nominal parameters of the damping are called."""
ELAPSED = "elapsed time"
"""The signal of the remainder that parameters drift with."""
RIVAL = Settings.rival
"""Decrease of -2 log likelihood within which one drift cannot be told from another."""
ABOVE = 2.0
"""Error, as a multiple of the noise floor, from which a model is not called good to it."""
ARM = re.compile(r"arm(_shape_\d+)?")
"""Nominal parameters that correct what the rest of a described arm does to a joint."""
IN_WORDS = {"direction": "direction by position (as friction that differs along the travel does)"}
"""Signals whose functions are more than their name says."""


def in_words(signal: str) -> str:
    """A signal that a remainder depends on, as a sentence says it."""
    return IN_WORDS.get(signal, signal)


def describe(effect: NamedEffect, command_unit: str = "V") -> str:
    """An effect with the parameters that say how strong it is: ``Coulomb friction of 6.9 ± 0.1 N m``; of an event in
    one log also when; only its name where the logs do not tell how strong it is."""
    named = {p.name: rounded(p.physical) for p in effect.parameters}
    first = effect.parameters[0]
    if effect.name in BY_THEMSELVES:
        first = max(effect.parameters, key=lambda p: abs(p.physical.value) / max(p.physical.std, 1e-300))
    if abs(first.physical.value) < first.physical.std:
        return title(effect.name)
    plainly = f"of {named[first.name]}"
    own = HEADLINE if command_unit == "V" else HEADLINE | WITHOUT_VOLTAGE
    said = own.get(effect.name, plainly).format(**named).replace("+ −", "− ")
    instant = next((p.physical for p in effect.parameters if p.name == "time"), None)
    when = f" at {quantity(instant.value, instant.unit)} in {effect.only_in}" if effect.only_in and instant else ""
    return f"{title(effect.name)} {said}{when}"


def rounded(estimate: Estimate) -> str:
    """A number with its standard deviation and unit."""
    return measured(estimate.value, estimate.std, estimate.unit)


def parameter_title(name: str) -> str:
    """A free parameter of the fit in words: ``input_delay.delay@0`` is the delay of input delay."""
    effect, _, own = name.partition("@")[0].rpartition(".")
    if ARM.fullmatch(own):
        return "torque of the rest of the arm, as described,"
    return f"{title(own)} of {title(effect)}" if effect else DAMPING.get(own, title(own))


def gain(gap: Gap) -> str:
    """How an error changed: ``cuts the held-out error from 41 to 3.1 mrad, noise floor 1 mrad``."""
    if gap.after > RAN_AWAY:
        verb = "leaves the simulation running" if gap.before > RAN_AWAY else "makes the simulation run"
        return f"{verb} away on the {'held-out logs' if gap.on == 'held-out' else 'data kept apart'}"
    factor, unit = scale_for([gap.after if gap.before > RAN_AWAY else gap.before], gap.unit)
    before, after, floor = (number(factor * value) for value in (gap.before, gap.after, gap.noise_floor))
    if gap.before > RAN_AWAY:
        return (
            f"makes the {error_name(gap)} {after} {unit} where the nominal model runs away, noise floor {floor} {unit}"
        )
    if before == after:
        return f"leaves the {error_name(gap)} at {after} {unit}, noise floor {floor} {unit}"
    verb = "cuts" if gap.after < gap.before else "changes"
    return f"{verb} the {error_name(gap)} from {before} to {after} {unit}, noise floor {floor} {unit}"


def error_name(gap: Gap) -> str:
    """What the error was measured on."""
    return "held-out error" if gap.on == "held-out" else "error on the data kept apart"


def joint_sentence(joint: JointResult, gap: Gap | None) -> str:
    """One sentence about one joint, in plain spaces."""
    return plain(f"Joint {joint.joint}: {_finding(joint, gap)}.")


def enumerated(items: Sequence[str]) -> str:
    """``a, b and c``."""
    return " and ".join(filter(None, [", ".join(items[:-1]), *items[-1:]]))


def is_helped(joint: JointResult, gap: Gap | None) -> bool:
    """Whether a joint of a planar pair that lacks nothing of its own follows closer with what the other one lacks."""
    lacks_nothing = joint.beside is not None and joint.verdict == "none"
    return lacks_nothing and gap is not None and gap.closed is not None and gap.after < gap.before


def is_uncertain(joint: JointResult, gap: Gap | None) -> bool:
    """Whether a model that lacks no known effect errs on other logs by clearly more than the noise floor: by what dry
    friction, short logs or the description of an arm leave open."""
    return joint.verdict == "none" and gap is not None and gap.before > ABOVE * gap.noise_floor


def _finding(joint: JointResult, gap: Gap | None) -> str:
    named = enumerated([describe(effect, joint.command_unit) for effect in joint.effects])
    plural = len(joint.effects) > 1
    further = "" if joint.beside is None else f", with what is named at joint {joint.beside},"
    adding = f"adding {'them' if plural else 'it'}{further} {gain(gap)}" if gap else ""
    if gap is not None and is_helped(joint, gap):
        return f"nothing of its own is missing; adding what is named at joint {joint.beside} {gain(gap)}"
    if gap is not None and is_uncertain(joint, gap):
        factor, unit = scale_for([gap.before], gap.unit)
        before, floor = (number(factor * value) for value in (gap.before, gap.noise_floor))
        return f"no known effect is missing; the {error_name(gap)} is {before} {unit}, noise floor {floor} {unit}"
    if joint.verdict == "none":
        tail = f"; its {error_name(gap)} is {quantity(gap.before, gap.unit)}" if gap else ""
        return f"the refitted nominal model is good to the noise floor{tail}"
    if joint.patched is not None:
        pieces = "describe the logs{}, but only as pieces of" if plural else "describes the logs{}, but only as part of"
        return (
            f"{named} {pieces.format(f' ({adding})' if adding else '')} {joint.patched.value} that no known effect is"
        )
    if joint.verdict == "unknown":
        signals = [d.signal for d in joint.remainder[:2] if d.p_value < 1e-3 and d.signal not in OWN_SENTENCE]
        depends = f"; it depends on {' and '.join(map(in_words, signals))}" if signals else ""
        if not signals or signals[0] == ELAPSED:
            drifting = [d for d in joint.drifts if d.is_certain]
            likeliest = [d for d in drifting if d.decrease > drifting[0].decrease - RIVAL]
            changes = " or ".join(f"the {parameter_title(d.parameter)}" for d in likeliest)
            own = f"{changes} does not stay the same over the logs" if likeliest else ""
            depends = (f"{depends}: {own}" if depends else f"; {own}") if own else depends
        if joint.wave is not None:
            turn = "revolution" if joint.position_unit == "rad" else f"{2 * math.pi:.3g} m"
            size = quantity(joint.wave.amplitude, joint.position_unit)
            depends = f"; the readings themselves err by {size}, {joint.wave.cycles:.4g} times per {turn}"
        elif joint.coarse is not None:
            depends = (
                f"; the amplifier rounds its command to steps of {quantity(joint.coarse.width, joint.command_unit)}"
            )
        elif joint.misread:
            depends = "; the readings themselves err over the position"
        elif joint.fails_by is not None:
            where = "the held-out logs" if gap and gap.on == "held-out" else "the data kept apart"
            depends = f"; on {where} the model errs {joint.fails_by}"
        measured_gain, third = f" ({adding})" if adding else "", "" if plural else "s"
        missing = f"something is missing that no known effect explains{depends}"
        if not named:
            return missing
        if gap is not None and gap.after >= gap.before:
            return f"{missing}; {named} fit{third} these logs better but not others{measured_gain}"
        part = f"{named} explain{third} part of the gap{measured_gain}"
        is_less = gap is not None and gap.closed is not None and gap.closed < 0.5
        return f"{missing}; {part}" if is_less else f"{part}, but {missing}"
    missing = f"{named} {'are' if plural else 'is'} missing{f'; {adding}' if adding else ''}"
    rivals = sorted(
        {with_joint(other, effect, title(other.name)) for effect in joint.effects for other in effect.alternatives}
    )
    if joint.verdict == "ambiguous" and rivals:
        return f"{missing}; these logs cannot tell this from {' or '.join(rivals)}"
    return missing


def with_joint(other: Alternative, effect: NamedEffect, name: str) -> str:
    """The name of an alternative, with its joint where that is not the effect's."""
    return name if other.joint == effect.joint else f"{name} at joint {other.joint}"


def table(diagnosis: Diagnosis, width: int = 100) -> str:
    """Sentence, effects and ledger for the terminal."""
    from rich.console import Console
    from rich.table import Table

    page = StringIO()
    console = Console(file=page, width=width, highlight=False, force_terminal=False)
    console.print(diagnosis.sentence, markup=False)
    if diagnosis.effects:
        sure = any(joint.effects and joint.verdict != "unknown" for joint in diagnosis.joints)
        heading = "named effects" if sure else "effects that explain a part; they may stand in for what is missing"
        grid = Table(title=heading, title_justify="left", box=None)
        for head in ("joint", "effect", "parameters", "evidence", "alternatives"):
            grid.add_column(head)
        for effect in diagnosis.effects:
            values = ", ".join(f"{p.name} {rounded(p.physical)}" for p in effect.parameters)
            others = ", ".join(with_joint(other, effect, other.name) for other in effect.alternatives) or "none"
            grid.add_row(str(effect.joint), effect.name, values, f"{effect.evidence.net:.0f}", others)
        console.print(grid)
    grid = Table(title="gain on data that nobody fitted", title_justify="left", box=None)
    for head in ("joint", "model", "command error", "1 s windows", "whole log", "closed", "us/step"):
        grid.add_column(head)
    units = {joint.joint: (joint.command_unit, joint.position_unit) for joint in diagnosis.joints}
    for row in diagnosis.ledger:
        command, position = units[row.joint]
        grid.add_row(
            str(row.joint),
            row.step,
            quantity(row.inverse_error, command),
            quantity(row.window_error, position),
            quantity(row.whole_error, position),
            percent(row.closed),
            number(row.microseconds, 2),
        )
    console.print(grid)
    for row in diagnosis.ledger:
        if row.note:
            console.print(f"joint {row.joint}, {row.step}: {row.note}", markup=False)
    for finding in diagnosis.provenance.findings:
        console.print(f"Noted: {finding}", markup=False)
    if diagnosis.next_experiment is not None:
        proposal = diagnosis.next_experiment
        console.print(f"Next: {proposal.excitation} ({proposal.purpose}): {proposal.benefit}", markup=False)
    return plain("\n".join(line.rstrip() for line in page.getvalue().splitlines()))
