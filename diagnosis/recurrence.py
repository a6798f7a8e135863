"""Whether an event happens in all logs, and whether at one instant, asked anew when the model has changed.

Events of all logs have one instant in these, what is done to a joint in the same run of an experiment each time, unless
each log has it at another one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, fit
from diagnosis.finding import Accepted
from diagnosis.hypotheses import Start, extend, withdraw
from diagnosis.problem import Problem
from diagnosis.search import price


def recurrences_settled(problem: Problem, accepted: Sequence[Accepted], base: Fitted) -> tuple[list[Accepted], Fitted]:
    """The effects, each event put into all logs at one instant where that is likelier beside the others.

    In a single log it has as many parameters; what was still missing when it was found may have hidden it in the other
    logs. Instants of its own in every log have to be worth their price.
    """
    accepted = list(accepted)
    for place, item in enumerate(accepted):
        for start in alternatives(problem, base, item, is_alone=len(accepted) == 1):
            without = withdraw(problem, base.point, item.name, item.joint)
            fitted = fit(problem, extend(problem, without, start.hypothesis, start.values), rounds=2, iterations=10)
            cost = price(problem, start, base.samples)
            if fitted.criterion + cost < base.criterion + item.scored.price:
                gained = base.criterion - fitted.criterion
                decrease = item.scored.decrease + gained
                scored = replace(item.scored, start=start, fitted=fitted, decrease=decrease, price=cost)
                item = accepted[place] = replace(item, scored=scored)
                base = fitted
    return accepted, base


def alternatives(problem: Problem, base: Fitted, item: Accepted, *, is_alone: bool) -> Iterator[Start]:
    """An event as one of all logs: at its instant in the only log that has had it, unless nothing has been found beside
    it, or at each of those that the logs have had."""
    start, columns = item.scored.start, problem.kernel.own(item.effect)
    here = start.hypothesis
    if item.effect.scan != "event":
        return
    for log in here.apart or (() if here.log < 0 or is_alone else (here.log,)):
        values = np.tile(base.point.parameters[log, here.joint, columns], (problem.logs, 1))
        searched = round(start.searched ** (1.0 / max(len(here.apart), 1)))
        yield replace(start, hypothesis=replace(here, log=-1, apart=()), values=values, searched=searched)
