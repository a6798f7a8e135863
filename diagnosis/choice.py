"""Which hypothesis is taken next: what an effect must be, and do, to be accepted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.constancy import is_the_same_everywhere, stands_apart
from diagnosis.estimation import Fitted, errors
from diagnosis.finding import Accepted
from diagnosis.hypotheses import PER_LOG, Start, command_response
from diagnosis.of_motion import is_of_motion
from diagnosis.problem import Problem
from diagnosis.search import FORM, Scored, is_resolved, law, ranking
from diagnosis.settings import Settings
from diagnosis.timing import SHIFT
from envs.log import Array
from methods.effects.base import Effect

LAG = "amplifier_lag"
"""The effect that may trade places with the joint's own lags."""
CONSTANT = "amplifier_offset"
"""The effect whose law cannot be inexact."""
FORK = 0.5
"""Share of the chosen effect's evidence from which another one may have been the better choice."""
CLOSER = 0.3
"""Errors as they are, over those that the chosen effect leaves, from which another one may have been the better choice,
whatever its evidence: the filter may have taken what it explains for slow noise."""
TAKEN_BACK = 0.5
"""Share of a lag by which the command may act earlier than it is logged."""
AT_END = 0.99
"""Share of the largest possible size from which an effect is at the end of its range."""
BRIEF = 0.5
"""Samples below which a lag takes strong evidence."""
SIMULTANEOUS = 0.2
"""Time [s] between two events that are taken for one."""
DRIVEN_BY = {"position": "place", "motor torque": "motor", "command": "motor"}
"""By the signals that effects follow, groups whose laws are too unlike for one to stand in for another."""
UNDERSTATED = 4.0
"""By what factor a fit may exceed what a regression says of an effect."""
STEADY = 0.5
"""Amplitude of a disturbance in one log as a share of that in another, below which it is not one and the same."""


def materiality(problem: Problem, fitted: Fitted, name: str, joint: int) -> float:
    """Torque of an effect as a share of the command's rms: its influence on the prediction beside that of the
    command."""
    off = fitted.point.switches.copy()
    off[joint, problem.kernel.switches[name]] = False
    without = replace(fitted.point, switches=off)
    one = (errors(problem, [without])[0] - fitted.error)[problem.used, joint]
    return float(np.sqrt(np.mean(one**2))) / command_response(problem, fitted.point, joint)


def coincides(problem: Problem, scored: Scored, accepted: Sequence[Accepted]) -> bool:
    """Whether an event happens while another one does that has a name already: it would repair the law of that one."""
    if scored.effect.scan != "event":
        return False
    begin, end = _spans(problem, scored)
    others = (_spans(problem, item.scored) for item in accepted if "time" in (p.name for p in item.effect.parameters))
    return any(np.any((begin < last + SIMULTANEOUS) & (first < end + SIMULTANEOUS)) for first, last in others)


def _spans(problem: Problem, scored: Scored) -> tuple[Array, Array]:
    """When an event begins and ends in every log [s]."""
    own = scored.fitted.point.parameters[:, scored.start.hypothesis.joint]
    begin = own[:, problem.kernel.column(scored.effect, "time")]
    lasts = "duration" in (p.name for p in scored.effect.parameters)
    return begin, begin + own[:, problem.kernel.column(scored.effect, "duration")] if lasts else begin


def nearly_as_good(chosen: Accepted, ranked: Sequence[Scored]) -> list[Accepted]:
    """Other effects that explain a good part of what the chosen one does: first other forms of its law that do nearly
    as well, then one form of each other law, best first."""
    limit = chosen.scored.evidence

    def differs(s: Scored) -> bool:
        return s.name != chosen.name and chosen.name not in s.effect.includes and s.name not in chosen.effect.includes

    def is_form(s: Scored) -> bool:
        return (s.label, s.start.hypothesis.joint) == (chosen.label, chosen.joint)

    forms = [s for s in ranked if differs(s) and is_form(s) and s.evidence > FORM * limit]
    others = [s for s in textbook(ranked) if differs(s) and not is_form(s) and s.evidence > FORK * limit]
    return [Accepted(scored, 0.0, (), chosen.considered) for scored in (*forms, *others)]


def much_closer(problem: Problem, chosen: Accepted, ranked: Sequence[Scored], settings: Settings) -> list[Accepted]:
    """Other effects with which the errors as they are fall far below those that the chosen one leaves; least first.

    A torque that moves the joint far off what is simulated without it makes a rough ground for all other parameters.
    """
    fitted = chosen.scored.fitted
    found = [
        s for s in textbook(ranked) if s.evidence > settings.threshold and comes_much_closer(problem, s.fitted, fitted)
    ]
    found = sorted(found, key=lambda s: size_of_errors(problem, s.fitted))
    return [Accepted(scored, 0.0, (), chosen.considered) for scored in found]


def size_of_errors(problem: Problem, fitted: Fitted) -> float:
    """Logarithm of the mean square of the errors as they are, summed over joints."""
    return float(np.sum(np.log(np.mean(fitted.error[problem.used] ** 2, axis=0) + 1e-300)))


def comes_much_closer(problem: Problem, one: Fitted, other: Fitted) -> bool:
    """Whether the errors of one model, as they are, fall far below those of another one."""
    return size_of_errors(problem, one) < size_of_errors(problem, other) + 2.0 * np.log(CLOSER)


def firm_ground_first(chosen: Accepted, nearer: list[Accepted]) -> tuple[Accepted, list[Accepted]]:
    """What is taken next and what instead of it: nothing in which small causes grow before what comes much closer.

    Beside the former the latter, which all logs show plainly, would no longer be found.
    """
    if not nearer or not chosen.effect.scatters:
        return chosen, nearer
    return nearer[0], [chosen, *nearer[1:]]


def choose(
    problem: Problem,
    base: Fitted,
    ranked: list[Scored],
    settings: Settings,
    explained: float,
    accepted: Sequence[Accepted] = (),
    least: float = 0.0,
) -> Accepted | None:
    """The best hypothesis that is significant, material and of the motion; among near equals the one with fewest
    parameters.

    base: the model without any of them. accepted: effects that are there already, whose inexact laws a small further
    one may repair. least: decrease of -2 log likelihood that noise alone can bring. A general form of a law that is
    there is how to repair it, and comes first where it explains half as much as another effect would: the other one is
    still found beside it if it is there.
    """
    ranked = [s for s in ranked if is_resolved(problem, s) and is_steady(problem, s) and is_possible(problem, s)]
    ranked = textbook(ranked, settings.rival)
    if not ranked:
        return None
    top = ranked[0]
    margin = max(settings.rival, 0.02 * top.decrease)
    there = {(item.label, item.joint) for item in accepted}
    if top.decrease < max(0.0 if law(top.start) in there else settings.minor * explained, least):
        return None
    best = max(s.evidence for s in ranked)
    near = [
        s
        for s in ranked
        if s.evidence > (settings.weak if is_brief(problem, s) else settings.threshold)
        and (s.decrease >= top.decrease - margin or s.evidence >= best - settings.rival)
    ]
    repairs = [
        s
        for s in ranked
        if s.evidence > max(FORK * best, settings.threshold)
        and any(law(s.start) == (item.label, item.joint) and item.name in s.effect.includes for item in accepted)
    ]
    for scored in sorted(repairs or near, key=lambda s: (s.effect.size, -s.evidence)):
        hypothesis = scored.start.hypothesis
        share = materiality(problem, scored.fitted, scored.name, hypothesis.joint)
        least_share = settings.material
        is_first = not accepted and is_foreign_to_motion(scored.effect)
        if problem.arm is not None and (is_first or scored.effect.has_neighbour):  # inexact as the measured motion
            least_share = settings.relevant if scored.effect.has_neighbour else settings.material
        elif is_first and scored.evidence > settings.weak:
            least_share = 0.0
        elif scored.decrease > settings.inexact * explained:
            least_share = settings.faint
        elif law(scored.start) not in there:
            least_share = least_beside(scored.effect, hypothesis.joint, scored.evidence, accepted, settings)
            least = least_of_all(scored.effect, hypothesis.joint, scored.evidence, accepted, settings)
            if least <= share < least_share and is_the_same_everywhere(
                problem, scored.fitted, scored.effect, hypothesis.joint
            ):
                least_share = least
        if share >= least_share:
            if not is_of_motion(problem, scored.fitted, base):
                others = [s for s in ranked if s is not scored]
                return choose(problem, base, others, settings, explained, accepted, least)
            rivals = tuple(
                s
                for s in ranked
                if s is not scored
                and s.evidence > scored.evidence - settings.rival
                and (s.label, s.start.hypothesis.joint) != (scored.label, hypothesis.joint)
                and scored.name not in s.effect.includes
                and is_of_motion(problem, s.fitted, base)
            )
            return Accepted(scored, share, rivals, ranking(ranked))
    return None


def is_foreign_to_motion(effect: Effect) -> bool:
    """Whether integrators and rounding, which err as the joint moves, do not bring what an effect does: it begins at an
    instant, or follows another joint."""
    return effect.scan == "event" or effect.has_neighbour


def tells_no_amplifier(effect: Effect, other: Effect) -> bool:
    """Whether an effect is of what is read, and the other one of the amplifier: no law of the latter errs by where a
    disc is."""
    return effect.slot == "sensor" and other.stage == "amplifier"


def least_beside(
    effect: Effect, joint: int, evidence: float, accepted: Sequence[Accepted], settings: Settings
) -> float:
    """Least torque, as a share of the command's rms, of a small further effect beside others of the same joint.

    It may only make up for an inexact law of one of them, all the more where the evidence is weak and both follow the
    same signal. What follows the position and what follows the motor do not stand in for each other where the evidence
    is strong, nor does what a reading has of its place for any law of the amplifier. An offset is a constant: there is
    nothing about it to repair.
    """
    accepted = [item for item in accepted if item.label != CONSTANT]
    beside = [item.effect for item in accepted if item.joint == joint]
    is_weak = evidence <= settings.weak
    own = None if is_weak else DRIVEN_BY.get(effect.variable)
    others = ["motor" if tells_no_amplifier(effect, other) else DRIVEN_BY.get(other.variable) for other in beside]
    if not any(own is None or other is None or own == other for other in others):
        return settings.material if accepted else settings.faint
    doubtful = any(other.scatters or (is_weak and other.variable == effect.variable) for other in beside)
    return (1.0 if doubtful else 0.5) * settings.relevant


def least_of_all(
    effect: Effect, joint: int, evidence: float, accepted: Sequence[Accepted], settings: Settings
) -> float:
    """`least_beside` of an effect that is the same everywhere: a wave that stands apart is then no repair of what is
    there, however small it is."""
    beside = [item.effect for item in accepted if item.joint == joint]
    if evidence > settings.weak and stands_apart(effect, beside):
        return settings.material
    return least_beside(effect, joint, evidence, accepted, settings)


def is_too_small(accepted: Sequence[Accepted], settings: Settings, explained: float, start: Start) -> bool:
    """Whether a regression says, with a wide margin, that a further effect could not be taken for its size."""
    most, hypothesis = UNDERSTATED * start.promise, start.hypothesis
    if not accepted or most > settings.inexact * explained:
        return False
    return UNDERSTATED * start.share < least_of_all(hypothesis.effect, hypothesis.joint, most, accepted, settings)


def excludes(one: Scored, other: Scored) -> bool:
    """Whether two forms of a law cannot stand beside each other."""
    return one.name in other.effect.excludes


def textbook(ranked: Sequence[Scored], tied: float = 0.0) -> list[Scored]:
    """One form of every law, best first: the likeliest, or the one that it includes where that does nearly as well and
    leaves no other law ahead. Of forms that exclude each other the textbook's comes first where they are tied.

    A form with more freedom than the textbook's repairs what other effects have yet to explain; it can still take the
    textbook's place when they do (`diagnosis.search.generalised`).
    """
    forms: dict[tuple[str, int], list[Scored]] = {}
    for scored in ranked:
        forms.setdefault((scored.label, scored.start.hypothesis.joint), []).append(scored)
    likeliest = {place: max(own, key=lambda s: s.evidence) for place, own in forms.items()}
    chosen = []
    for place, own in forms.items():
        best = likeliest[place]
        rival = max((s.evidence for other, s in likeliest.items() if other != place), default=-np.inf)
        least = max(FORM * best.evidence, rival if rival < best.evidence else -np.inf)
        simple = [s for s in own if s.name in best.effect.includes and s.evidence > least]
        simple += [s for s in own if s.name == s.label and s.evidence > best.evidence - tied and excludes(s, best)]
        chosen.append(simple[0] if simple else best)
    return sorted(chosen, key=lambda s: -s.evidence)


def is_steady(problem: Problem, scored: Scored) -> bool:
    """Whether a disturbance that may begin anywhere in its period is as strong in every log, as one machine's would be.

    Where it could stand in one log only, something else moves there: another axis, another excitation.
    """
    effect, joint = scored.effect, scored.start.hypothesis.joint
    free = PER_LOG.get(effect.name, ())
    if not free or problem.logs < 2:
        return True
    columns = [problem.kernel.own(effect).start + i for i in free]
    size = np.sqrt(np.sum(scored.fitted.point.parameters[:, joint, columns] ** 2, axis=1))
    known = np.zeros((problem.logs, len(free)))
    for i, f in enumerate(scored.fitted.point.free):
        if f.kind == "log" and f.joint == joint and f.column in columns:
            known[f.log, columns.index(f.column)] = max(scored.fitted.covariance[i, i], 0.0)
    deviation = np.sqrt(np.max(known, axis=1))
    largest = int(np.argmax(size))
    return bool(np.all(size + 3.0 * deviation > STEADY * (size[largest] - 3.0 * deviation[largest])))


def is_possible(problem: Problem, scored: Scored) -> bool:
    """Whether an effect of either sign stays within the size that it can have: at the end of its range it stands in for
    another one. A lag that a command which acts earlier than logged takes back is none: together they repair how
    integrators differ."""
    effect, joint = scored.effect, scored.start.hypothesis.joint
    if effect.label == LAG:
        own, shift = scored.fitted.point.parameters[0, joint, [problem.kernel.own(effect).start, SHIFT]]
        if -shift > TAKEN_BACK * own:
            return False
    values = np.abs(scored.fitted.point.parameters[:, joint, problem.kernel.own(effect)])
    either = {i: p.upper for i, p in enumerate(effect.parameters) if p.lower == -p.upper and np.isfinite(p.upper)}
    return all(np.all(values[:, i] < AT_END * end) for i, end in either.items())


def is_brief(problem: Problem, scored: Scored) -> bool:
    """Whether a lag is so short that it may be the instants at which the logs were written (`diagnosis.timing`)."""
    own = scored.fitted.point.parameters[0, scored.start.hypothesis.joint, problem.kernel.own(scored.effect).start]
    return scored.label == LAG and bool(own < BRIEF * problem.sample_time)


def stays_itself(problem: Problem, scored: Scored) -> bool:
    """Whether an effect is in the final model what its name says: within the size that it can have and, of what is
    periodic in the position, half a period at least. Beside others it may have become a piece of another law."""
    periodic = scored.effect.scan == "position"
    return (
        is_possible(problem, scored)
        and is_of_its_shape(problem, scored)
        and (not periodic or is_resolved(problem, scored))
    )


def is_of_its_shape(problem: Problem, scored: Scored) -> bool:
    """Whether the shape of a general law lies within what such laws have: at some ends of that range it stands in for
    another one."""
    values = scored.fitted.point.parameters[0, scored.start.hypothesis.joint, problem.kernel.own(scored.effect)]
    return not any(
        (p.stands_in_at in ("lower", "both") and value < p.lower / AT_END)
        or (p.stands_in_at in ("upper", "both") and value > p.upper * AT_END)
        for value, p in zip(values, scored.effect.parameters, strict=True)
    )
