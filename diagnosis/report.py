"""`report.html`: a diagnosis as one self-contained page that an engineer reads from top to bottom.

`render` gives the page's text; figures are inline SVG, styles are inline, and nothing is fetched. Whatever comes from
logs (names, paths, findings) is escaped by the template.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from diagnosis import quantities
from diagnosis.model_equations import SYMBOLS, Formula, model_equations
from diagnosis.remainder import OWN_SENTENCE
from diagnosis.result import (
    RAN_AWAY,
    Alternative,
    Diagnosis,
    Gap,
    JointResult,
    LedgerRow,
    NamedEffect,
    NominalParameter,
    PartialResidual,
    Series,
    SignalDependence,
)
from diagnosis.settings import TYPICAL
from diagnosis.text import enumerated, in_words, is_helped, is_uncertain, joint_sentence

SIGNIFICANT = 1e-3
"""p-value below which the remainder counts as dependent on a signal."""
ALIKE = 15.0
"""Angle [degrees] between two effects below which logs hardly tell them apart."""
ADRIFT = 10.0
"""Error over whole logs, over that in windows, from which the page says why they differ."""
PAIRS = 8
"""Pairs of effects that are listed by name as not separable."""
MEANING = {
    "none": "The model is good: what the refitted nominal model leaves is noise, and no known effect would improve it.",
    "named": "Every named effect is significant, and no other known effect can take its place.",
    "ambiguous": "An effect is missing, but these logs cannot tell the listed names apart.",
    "unknown": "Something real is left that no known effect explains; what is known of it is stated.",
}


@dataclass(frozen=True, eq=False)
class EffectPage:
    """One named effect with its figures and formula.

    moved: whether its evidence beside all other effects is another than when it was taken. beaten: whether another
    hypothesis had more then.
    """

    effect: NamedEffect
    law: Markup | None
    wide: bool
    evidence: Markup
    formula: Markup
    moved: bool
    beaten: bool


NOTHING = 10.0
"""Ratio of deviation and value from which a share of the value says nothing."""
HELPED = "Nothing of its own is missing; it errs by what the other joint of the pair lacks."
"""The same of a joint that lacks nothing of its own."""
UNCERTAIN = (
    "No known effect would improve the model. It errs by more than the noise floor, but by no more than noise together "
    "with dry friction and what the logs or the description of the arm leave open."
)
"""The same of a joint that lacks nothing known, and is not good to the noise floor."""


@dataclass(frozen=True, eq=False)
class Excitation:
    """What one log did to the joint: ranges in SI, number of reversals of the direction."""

    series: Series
    command_rms: float
    command_peak: float
    travel: float
    speed_rms: float
    speed_peak: float
    reversals: int


@dataclass(frozen=True, eq=False)
class JointPage:
    """One joint with everything that the template shows of it; is_extended: whether named effects change its model."""

    result: JointResult
    gap: Gap | None
    sentence: str
    meaning: str
    is_extended: bool
    ledger: tuple[LedgerRow, ...]
    effects: tuple[EffectPage, ...]
    excitation: tuple[Excitation, ...]
    adequacy: tuple[str, ...]
    equations: tuple[tuple[Formula, Markup], ...]
    symbols: Mapping[str, Markup]
    figures: Mapping[str, Markup]
    left: tuple[Markup, ...]
    dependences: tuple[SignalDependence, ...]
    adrift: bool


def is_adrift(ledger: Sequence[LedgerRow]) -> bool:
    """Whether the final model errs over whole logs by far more than in windows."""
    final = next((row for row in reversed(ledger) if row.role in ("nominal", "effect")), None)
    if final is None or final.whole_error is None or final.window_error is None:
        return False
    return final.whole_error > ADRIFT * final.window_error


def render(diagnosis: Diagnosis) -> str:
    """The page as HTML."""
    from diagnosis.figures import report_style

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(
        number=quantities.number,
        quantity=quantities.quantity,
        percent=quantities.percent,
        unit=quantities.pretty_unit,
        title=quantities.title,
        capital=quantities.sentence_case,
        p_value=p_value,
        unbroken=quantities.unbroken,
        angle=angle,
        error=error,
        in_words=in_words,
    )
    environment.globals.update(
        measured=quantities.measured,
        scale_for=quantities.scale_for,
        MEANING=MEANING,
        ALIKE=ALIKE,
        PAIRS=PAIRS,
        TYPICAL=TYPICAL,
        RAN_AWAY=RAN_AWAY,
    )
    with report_style():
        joints = tuple(joint_page(diagnosis, joint) for joint in diagnosis.joints)
    template = environment.from_string((files("diagnosis") / "templates" / "report.html.j2").read_text("utf-8"))
    units = {joint.joint: joint.position_unit for joint in diagnosis.joints}
    return template.render(d=diagnosis, joints=joints, units=units)


def joint_page(diagnosis: Diagnosis, joint: JointResult) -> JointPage:
    """Figures, formulas and sentences of one joint."""
    from diagnosis.figures import equation

    gap = next((gap for gap in diagnosis.gaps if gap.joint == joint.joint), None)
    ledger = tuple(row for row in diagnosis.ledger if row.joint == joint.joint)
    slug = f"j{joint.joint}"
    formulas = model_equations(joint)
    threshold = float(diagnosis.provenance.settings.get("threshold", 12.0))
    remainder = [part for part in joint.partial_residuals if part.effect is None]
    return JointPage(
        result=joint,
        gap=gap,
        sentence=joint_sentence(joint, gap),
        meaning=meaning(joint, gap),
        is_extended=bool(joint.effects) or is_helped(joint, gap),
        ledger=ledger,
        effects=tuple(effect_page(joint, effect, threshold, f"{slug}e{i}") for i, effect in enumerate(joint.effects)),
        excitation=tuple(excitation(series) for series in joint.series),
        adequacy=tuple(adequacy(joint)),
        equations=tuple((f, Markup(equation(f.tex, f"{slug}q{i}"))) for i, f in enumerate(formulas)),
        symbols={p.name: Markup(equation(SYMBOLS[p.name], f"{slug}s{i}")) for i, p in enumerate(joint.nominal)},
        figures=joint_figures(joint, gap, ledger, threshold, slug),
        left=tuple(_partial(joint, part, f"{slug}r{i}") for i, part in enumerate(remainder)),
        dependences=tuple(d for d in joint.remainder if d.p_value < SIGNIFICANT and d.signal not in OWN_SENTENCE),
        adrift=is_adrift(ledger),
    )


def meaning(joint: JointResult, gap: Gap | None) -> str:
    """What the verdict of a joint says."""
    if is_helped(joint, gap):
        return HELPED
    return UNCERTAIN if is_uncertain(joint, gap) else MEANING[joint.verdict]


def joint_figures(
    joint: JointResult, gap: Gap | None, ledger: Sequence[LedgerRow], threshold: float, slug: str
) -> dict[str, Markup]:
    """The figures of one joint by name; those without data are left out."""
    from diagnosis import figures as draw

    found: dict[str, str | None] = {}
    if gap is not None and draw.bars(ledger):
        found["waterfall"] = draw.waterfall(ledger, gap, f"{slug}waterfall")
    held_out = [series for series in joint.series if series.held_out] or list(joint.series)
    if joint.series:
        found["command"] = draw.command_over_time(joint.series, joint.command_unit, f"{slug}command")
        found["coverage"] = draw.coverage(joint.series, joint.position_unit, f"{slug}coverage")
        found["over_time"] = draw.residual_over_time(held_out[0], joint.command_unit, f"{slug}time")
        for signal, unit in (
            ("velocity", f"{joint.position_unit}/s"),
            ("position", joint.position_unit),
            ("motor torque", joint.command_unit),
        ):
            name = f"{slug}{signal.split()[0]}"
            found[signal] = draw.residual_against(held_out, signal, unit, joint.command_unit, name)
        window = gap.window if gap is not None else 1.0
        runs = [draw.free_run(series, joint.position_unit, window, f"{slug}free") for series in held_out]
        found["free_run"] = next((run for run in runs if run is not None), None)
    if joint.refused:
        needed = max(threshold, joint.scattered)
        found["refused"] = draw.ranking(joint.refused, None, (), needed, f"{slug}refused")
    if joint.spectrum is not None:
        found["spectrum"] = draw.residual_spectrum(joint.spectrum, joint.command_unit, f"{slug}spectrum")
    return {name: Markup(text) for name, text in found.items() if text is not None}


def effect_page(joint: JointResult, effect: NamedEffect, threshold: float, slug: str) -> EffectPage:
    """An effect with the partial residual that belongs to it."""
    from diagnosis.figures import equation, ranking

    itself = Alternative(effect.name, effect.joint, effect.evidence)
    considered = effect.considered or (itself, *effect.alternatives)
    rivals = [other.name for other in effect.alternatives]
    part = next((part for part in joint.partial_residuals if part.effect == effect.name), None)
    then = next((other.evidence.net for other in considered if other.name == effect.name), effect.evidence.net)
    return EffectPage(
        effect=effect,
        law=None if part is None else _partial(joint, part, f"{slug}law"),
        wide=part is not None and part.continuous,
        evidence=Markup(ranking(considered, effect.name, rivals, threshold, f"{slug}evidence")),
        formula=Markup(equation(effect.equation, f"{slug}formula")),
        moved=abs(then - effect.evidence.net) > 0.01 * abs(effect.evidence.net),
        beaten=any(other.evidence.net > then for other in considered),
    )


def _partial(joint: JointResult, part: PartialResidual, name: str) -> Markup:
    from diagnosis.figures import partial_residual

    return Markup(partial_residual(part, name, joint.input_equivalent, joint.torque_unit))


def excitation(series: Series) -> Excitation:
    """Ranges of the signals of one log."""
    rms = lambda x: float(np.sqrt(np.mean(x**2)))  # noqa: E731
    moving = series.velocity[np.abs(series.velocity) > 0.02 * np.max(np.abs(series.velocity), initial=0.0)]
    return Excitation(
        series=series,
        command_rms=rms(series.command),
        command_peak=float(np.max(np.abs(series.command))),
        travel=float(np.ptp(series.reading)),
        speed_rms=rms(series.velocity),
        speed_peak=float(np.max(np.abs(series.velocity))),
        reversals=int(np.sum(np.diff(np.sign(moving)) != 0)),
    )


def adequacy(joint: JointResult) -> list[str]:
    """What the logs determine, in sentences: nominal parameters, visible effects, pairs that look alike."""
    said = []
    known = [(p, relative_deviation(p)) for p in joint.nominal]
    good = [f"{quantities.title(p.name)} to {quantities.percent(share, 2)}" for p, share in known if share < 0.05]
    poor = [f"{quantities.title(p.name)} ({deviation_said(p, share)})" for p, share in known if share >= 0.05]
    if good:
        said.append(f"The logs determine {enumerated(good)}.")
    if poor:
        said.append(f"Poorly determined, with relative standard deviation: {enumerated(poor)}.")
    seen = sorted(row.share for row in joint.isolability if row.share is not None and row.share < 1.0)
    if seen:
        middle = quantities.percent(seen[len(seen) // 2], 2)
        said.append(
            f"{len(seen)} of {len(joint.isolability)} known effects would be visible; half of them from {middle} "
            "of the command's rms or less."
        )
    large = [row for row in joint.isolability if row.share is not None and row.share >= 1.0]
    never = [row for row in joint.isolability if row.threshold is None]
    for why, rows in (("Visible only if they exceed the command's rms", large), ("Not visible in these logs", never)):
        if rows:
            said.append(f"{why}: {enumerated([quantities.title(row.effect) for row in rows])}.")
    return said


def relative_deviation(parameter: NominalParameter) -> float:
    """Standard deviation of a nominal parameter as a share of its value."""
    value = abs(parameter.final.value)
    return parameter.final.std / value if value > 0 else math.inf


def deviation_said(parameter: NominalParameter, share: float) -> str:
    """Standard deviation of a nominal parameter as a share of it; of one that is next to nothing beside it, both."""
    if share < NOTHING:
        return quantities.percent(share, 2)
    return quantities.measured(parameter.final.value, parameter.final.std, parameter.unit)


def p_value(p: float) -> str:
    """A p-value; below 1e-12 only that."""
    return "< 10⁻¹²" if p < 1e-12 else quantities.number(p, 2)


def error(value: float, unit: str, beside: float | None = None) -> str:
    """An error of free simulation with its unit, scaled as another one beside it would be."""
    if value > RAN_AWAY:
        return "runs away"
    factor, scaled = quantities.scale_for([value if beside is None else beside], unit)
    return f"{quantities.number(factor * value)}\u00a0{quantities.pretty_unit(scaled)}"


def angle(degrees: float) -> str:
    """An angle between two effects; below 0.01 degrees only that."""
    return "< 0.01°" if degrees < 0.01 else f"{quantities.number(degrees, 2)}°"
