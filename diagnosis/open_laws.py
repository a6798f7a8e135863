"""Laws whose course the fitted logs leave open where other logs go beyond them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from diagnosis.beginning import started
from diagnosis.estimation import fit
from diagnosis.finding import Accepted, Finding
from diagnosis.hypotheses import sizes_of
from diagnosis.ledger import Step, failures
from diagnosis.problem import Problem
from diagnosis.regression import View
from diagnosis.replay import WINDOW, replay
from diagnosis.result import Failure
from diagnosis.search import containing, generalised
from methods.effects.base import Effect


def left_open(
    problem: Problem,
    held_out: Problem,
    finding: Finding,
    ledger: Sequence[Step],
    failing: Mapping[int, Failure],
    effects: Sequence[Effect],
) -> dict[int, tuple[str, Failure]]:
    """The law, by joint, for whose course beyond the fitted logs the errors on the held-out ones may stand, and how
    large these are.

    Logs of small currents do not tell how the iron saturates at large ones, so that the textbook's law, right as the
    cause, errs there by any factor. A more general form of that law, fitted to the same logs, is as uncertain there as
    it errs, or as the textbook's errs; and one of them explains more of what the nominal model errs than it leaves
    (`diagnosis.ledger.failures`).
    """
    models = [step for step in ledger if step.role in ("nominal", "effect")]
    nominal, textbook = models[0], models[-1]
    found: dict[int, tuple[str, Failure]] = {}
    for j, failure in failing.items():
        for label, wider in _generalised(problem, finding, effects, j):
            point = started(held_out, wider.final.point, wider.final.whitener)
            itself = Step("", "effect", j, point, replay(held_out, point, WINDOW))
            as_uncertain = replace(itself, replay=textbook.replay)
            if any(j not in failures(problem, held_out, wider, [nominal, step]) for step in (itself, as_uncertain)):
                found[j] = label, failure
                break
    return found


def _generalised(
    problem: Problem, finding: Finding, effects: Sequence[Effect], joint: int
) -> Iterator[tuple[str, Finding]]:
    """The finding with a general form of one of a joint's laws in its place, refitted, and that law's name."""
    own = [item for item in finding.accepted if item.joint == joint]
    there = {item.name for item in own}
    for item in own:
        for effect in effects:
            if effect.label != item.label or item.name not in effect.includes or effect.name in there:
                continue
            view, size = View.of(problem, finding.final), sizes_of(problem, finding.final)[joint]
            start, points = generalised(problem, view, effect, [item.effect], joint, size)
            whole = containing(problem, finding.final, points)
            final = fit(problem, whole.point, whole.whitener, iterations=12)
            scored = replace(item.scored, start=start, fitted=final)
            accepted = (Accepted(scored, 0.0, ()) if other is item else other for other in finding.accepted)
            yield item.label, replace(finding, final=final, accepted=tuple(accepted))
