"""Whether waves over the position see the readings or the prediction.

Noise that nobody logged drives the joint off the prediction. Where a cogging torque or a ripple has many waves in a
revolution, a few milliradians turn its phase by as many times more, and the wave acts as the readings say. Coarse
readings are worse than the prediction where there is little such noise. Behind a play small causes grow: there a wave
that saw the readings would correct the motion by them, and a false one explain something.
"""

from __future__ import annotations

from dataclasses import replace

from diagnosis.estimation import Fitted, fit, scatters
from diagnosis.hypotheses import FOLLOWING, has_wave
from diagnosis.problem import Problem


def following_settled(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with the positions of its waves as the readings have them or as they are predicted, whichever is
    likelier."""
    point = fitted.point
    parameters = point.parameters.copy()
    for j in range(problem.joints):
        if has_wave(problem, point, j) and not scatters(problem, point, j):
            parameters[:, j, FOLLOWING] = 1.0 - parameters[:, j, FOLLOWING]
    if (parameters == point.parameters).all():
        return fitted
    other = fit(problem, replace(point, parameters=parameters), rounds=2, iterations=4)
    return min(fitted, other, key=lambda option: option.criterion)
