"""Whether an event of one log happens in all of them, asked anew when another effect has been found.

Events of all logs have one instant in these: what is done to a joint in the same run of an experiment, each time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation import Fitted, fit
from diagnosis.finding import Accepted
from diagnosis.hypotheses import extend, withdraw
from diagnosis.problem import Problem


def recurrences_settled(problem: Problem, accepted: Sequence[Accepted], base: Fitted) -> tuple[list[Accepted], Fitted]:
    """The effects, each event of a single log put into all of them where that is likelier beside the others.

    It has as many parameters there. What was still missing when it was found may have hidden it in the other logs.
    """
    accepted = list(accepted)
    for place, item in enumerate(accepted if len(accepted) > 1 else ()):
        here = item.scored.start.hypothesis
        if item.effect.scan != "event" or here.log < 0:
            continue
        own = base.point.parameters[here.log, here.joint, problem.kernel.own(item.effect)]
        start = replace(item.scored.start, hypothesis=replace(here, log=-1), values=np.tile(own, (problem.logs, 1)))
        without = withdraw(problem, base.point, item.name, here.joint)
        fitted = fit(problem, extend(problem, without, start.hypothesis, start.values), rounds=2, iterations=10)
        if fitted.criterion < base.criterion:
            gained = base.criterion - fitted.criterion
            scored = replace(item.scored, start=start, fitted=fitted, decrease=item.scored.decrease + gained)
            accepted[place], base = replace(item, scored=scored), fitted
    return accepted, base
