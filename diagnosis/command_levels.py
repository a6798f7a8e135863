"""What the rounding of a measured command leaves open.

The error of a command that changes is noise, which the filter knows. Of a level that is held for long, as those of a
binary sequence or of steps are, it is the same number all the while: an amplitude that is off by half a step of the
converter is as much inertia and friction, whatever the encoder says.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise, zip_longest

import numpy as np

from diagnosis.estimation import Fitted, errors
from diagnosis.instants import log_of
from diagnosis.problem import Problem
from envs.log import Array
from methods.parallel import each

HELD = 0.01
"""Share of a log's samples from which on a level of the command counts as held."""
LEVELS = 24
"""Most levels of a log that are looked at, those that are held longest."""


def with_levels_counted(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with what parameters may owe to the rounding of held levels in its covariance.

    To first order a level that is off by d moves them by ``C J' r d``, with r what a unit of it does to the
    innovations; d is uniform over one step, independently for every level of every log.
    """
    moved = [off for j, step in enumerate(problem.command_steps) if step for off in with_one_level_off(problem, j)]
    if not moved:
        return fitted
    estimator = fitted.plain_covariance @ fitted.jacobian
    in_log = np.tile(log_of(problem, fitted.whitener), problem.joints) == np.arange(problem.logs)[:, None]

    def shifts(there: Problem) -> Array:
        """Change (P, L) of the parameters by the level of every log."""
        response = fitted.whitener(errors(there, [fitted.point])[0] - fitted.error) * fitted.weights
        return np.asarray(estimator @ (in_log * response).T)

    every = np.concatenate(each(shifts, moved), axis=1)
    return fitted.informed(fitted.jacobian, fitted.covariance + every @ every.T)


def with_one_level_off(problem: Problem, j: int) -> Iterator[Problem]:
    """The logs with one held level of each, of the command of joint index j, off by the deviation of its rounding; as
    often as a log holds levels."""
    held = [held_levels(problem.command[a:b, j]) for a, b in pairwise(problem.bounds)]
    for levels in zip_longest(*held):
        command = problem.command.copy()
        for level, (a, b) in zip(levels, pairwise(problem.bounds), strict=True):
            if level is not None:
                command[a:b, j] += (command[a:b, j] == level) * problem.command_steps[j] / np.sqrt(12.0)
        yield replace(problem, command=command)


def held_levels(command: Array) -> list[float]:
    """Levels that a command (T,) holds, the longest first."""
    levels, counts = np.unique(command, return_counts=True)
    order = np.argsort(-counts, kind="stable")[:LEVELS]
    return [float(levels[i]) for i in order if counts[i] >= HELD * len(command)]
