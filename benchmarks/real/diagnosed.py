"""The diagnosis itself on a rig: what it names, with evidence and uncertainty, and what it says is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.real.outcome import Section, Table, rows
from diagnosis.preparation import DiagnosisError, arrange
from diagnosis.result import Diagnosis
from diagnosis.run import diagnose
from envs.log import Log, LogError
from methods.effects.base import Effect

SIGNIFICANT = 1e-3
"""p-value below which the remainder counts as dependent on a signal."""


@dataclass(frozen=True)
class Said:
    """Verdict and names of the diagnosis, and the section of the page that shows them."""

    verdict: str
    names: tuple[str, ...]
    section: Section


def said(
    fitted: Sequence[Log],
    held_out: Sequence[Log],
    robot: str,
    joint: int | None = None,
    effects: Sequence[Effect] | None = None,
) -> Said:
    """Diagnose logs and put the outcome into a section; unusable input is said there in its own words."""
    heading = "What the diagnosis says"
    try:
        diagnosis, _, _ = diagnose(arrange(fitted, held_out, robot), joint, effects=effects)
    except (LogError, DiagnosisError) as error:
        return Said("refused", (), Section(heading, (f"The diagnosis refuses these logs: {error}",)))
    names = tuple(f"{effect.name}@{effect.joint}" for effect in diagnosis.effects)
    text = (
        f"Verdict of adeptone diagnose on the fitted runs: {diagnosis.verdict}. {diagnosis.sentence}",
        left(diagnosis),
    )
    return Said(
        diagnosis.verdict, names, Section(heading, text, (), (effects_table(diagnosis), ledger_table(diagnosis)))
    )


def left(diagnosis: Diagnosis) -> str:
    """What the remainder depends on, in a sentence."""
    parts = []
    for joint in diagnosis.joints:
        found = [item for item in joint.remainder if item.p_value < SIGNIFICANT]
        if found:
            signals = ", ".join(f"{item.signal} ({item.decrease:.0f})" for item in found)
            parts.append(f"joint {joint.joint}: {signals}")
    if not parts:
        return "What is left depends on no signal of the logs."
    return f"What is left depends on (decrease of −2 ln L by smooth functions of a signal): {'; '.join(parts)}."


def effects_table(diagnosis: Diagnosis) -> Table:
    """Named effects in the order of acceptance, one row per parameter."""
    found = [
        (e.joint, e.name, p.name, p.physical.value, p.physical.std, p.physical.unit, e.evidence.net,
         ", ".join(a.name for a in e.alternatives))
        for e in diagnosis.effects
        for p in e.parameters
    ]  # fmt: skip
    columns = ("joint", "effect", "parameter", "value", "standard deviation", "unit", "evidence", "rivals")
    return Table("diagnosis_effects", "Effects that the diagnosis names", columns, rows(found))


def ledger_table(diagnosis: Diagnosis) -> Table:
    """Every model of the ledger on the held-out runs."""
    found = [
        (r.joint, r.step, r.role, r.inverse_error, r.window_error, r.whole_error, r.closed, r.note)
        for r in diagnosis.ledger
    ]
    columns = (
        "joint",
        "model",
        "role",
        "command error",
        "error of 1 s windows",
        "error of whole logs",
        "closed",
        "note",
    )
    title = "Ledger of the diagnosis on held-out runs (command's unit; rad or m)"
    return Table("diagnosis_ledger", title, columns, rows(found), folded=True)
