"""A diagnosis in words: the one sentence, and the table for the terminal."""

from __future__ import annotations

import math
from io import StringIO

from diagnosis.result import Diagnosis, Estimate, Gap, JointResult, NamedEffect

PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: ""}


def with_prefix(value: float, unit: str) -> tuple[float, str]:
    """A length or an angle in a unit that keeps it between 1 and 1000: (scaled value, unit)."""
    if value == 0.0 or not math.isfinite(value):
        return value, unit
    exponent = min(0, max(-9, 3 * math.floor(math.log10(abs(value)) / 3)))
    return value / 10.0**exponent, PREFIXES[exponent] + unit


def rounded(estimate: Estimate) -> str:
    """Value and standard deviation, rounded to two digits of the latter: ``6.93 ± 0.11 N m``."""
    unit = "" if estimate.unit == "1" else f" {estimate.unit}"
    if not estimate.std > 0.0 or not math.isfinite(estimate.std):
        return f"{estimate.value:.4g}{unit}"
    digits = max(0, 1 - math.floor(math.log10(estimate.std)))
    if digits > 6:
        return f"{estimate.value:.6g} ± {estimate.std:.2g}{unit}"
    return f"{estimate.value:.{digits}f} ± {estimate.std:.{digits}f}{unit}"


def spoken(name: str) -> str:
    """An effect's name as words."""
    return name.replace("_", " ")


def describe(effect: NamedEffect) -> str:
    """An effect with its first parameter: ``coulomb friction of 6.9 ± 0.1 N m``."""
    return f"{spoken(effect.name)} of {rounded(effect.parameters[0].physical)}"


def gain(gap: Gap) -> str:
    """How an error changed: ``from 41 to 3.1 mrad, noise floor 1 mrad``."""
    _, unit = with_prefix(gap.before, gap.unit)
    scale = with_prefix(gap.before, gap.unit)[0] / gap.before if gap.before else 1.0
    before, after, floor = (f"{scale * value:.3g}" for value in (gap.before, gap.after, gap.noise_floor))
    return f"from {before} to {after} {unit}, noise floor {floor} {unit}"


def joint_sentence(joint: JointResult, gap: Gap | None) -> str:
    """One sentence about one joint."""
    start = f"Joint {joint.joint}: "
    error = "held-out error" if gap is None or gap.on == "held-out" else "error on the data kept apart"
    named = " and ".join(describe(effect) for effect in joint.effects)
    plural = len(joint.effects) > 1
    adding = f"adding {'them' if plural else 'it'} changes the {error} {gain(gap)}" if gap else ""
    if joint.verdict == "none":
        tail = f"; its {error} is {gain(gap).split(' to ')[0][5:]} {gain(gap).split(' ')[-1]}" if gap else ""
        return f"{start}the refitted nominal model is good to the noise floor{tail}."
    if joint.verdict == "unknown":
        signals = [d.signal for d in joint.remainder[:2] if d.p_value < 1e-3]
        depends = f"; it depends on {' and '.join(signals)}" if signals else ""
        found = f"{named} explain{'' if plural else 's'} part of the gap ({adding}), but " if named else ""
        return f"{start}{found}something is missing that no known effect explains{depends}."
    missing = f"{start}{named} {'are' if plural else 'is'} missing; {adding}"
    rivals = sorted({spoken(other.name) for effect in joint.effects for other in effect.alternatives})
    if joint.verdict == "ambiguous" and rivals:
        return f"{missing}; these logs cannot tell this from {' or '.join(rivals)}."
    return f"{missing}."


def table(diagnosis: Diagnosis, width: int = 100) -> str:
    """Sentence, effects and ledger for the terminal."""
    from rich.console import Console
    from rich.table import Table

    page = StringIO()
    console = Console(file=page, width=width, highlight=False, force_terminal=False)
    console.print(diagnosis.sentence, markup=False)
    if diagnosis.effects:
        grid = Table(title="named effects", title_justify="left", box=None)
        for head in ("joint", "effect", "parameters", "evidence", "alternatives"):
            grid.add_column(head)
        for effect in diagnosis.effects:
            values = ", ".join(f"{p.name} {rounded(p.physical)}" for p in effect.parameters)
            others = ", ".join(other.name for other in effect.alternatives) or "none"
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
            _number(row.inverse_error, command),
            _number(row.window_error, position),
            _number(row.whole_error, position),
            "" if row.closed is None else f"{100 * row.closed:.1f} %",
            "" if row.microseconds is None else f"{row.microseconds:.2g}",
        )
    console.print(grid)
    if diagnosis.next_experiment is not None:
        proposal = diagnosis.next_experiment
        console.print(f"Next: {proposal.excitation} ({proposal.purpose}): {proposal.benefit}", markup=False)
    return "\n".join(line.rstrip() for line in page.getvalue().splitlines())


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    scaled, named = with_prefix(value, unit)
    return f"{scaled:.3g} {named}"
