"""A first look at hypotheses on a part of the samples, segments of the logs spread evenly, and with few steps.

In the middle of a log the model without the hypothesis knows its state, from which a segment can begin. What decides
between strong effects is in every stretch of the motion, so that their first ranking needs no more; weak ones need all
samples, and so do those that count time or remember what went before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from diagnosis.estimation import Fitted, Point, errors, finish, plain, predicted_motion, sensitivities
from diagnosis.problem import Free, Problem
from diagnosis.regression import View
from diagnosis.whitening import filterable
from envs.log import Array
from methods.effects.base import Effect
from methods.kernel import BEGINNING

SAMPLES = 15_000
"""Samples of all segments together, as far as their length allows; of joints that move together, of all of them."""
SECONDS = 4.0
"""Length of a segment: what the filters cannot use of it is a small part."""
LARGEST = 0.5
"""Share of all samples above which the look at a part saves too little."""
EXACT = 1.2
"""Mean square of the innovations with one step per sample, over that with all steps, above which these are needed."""
TELLING = 30.0
"""Decrease of -2 log likelihood on the part (of deviation twice its root) that is told from none."""
HIDDEN = 0.25
"""Share of such a decrease that is seen at least."""
STRONG = 100.0
"""Decrease of -2 log likelihood on the part from which the look at it is enough."""


@dataclass(frozen=True, eq=False)
class Glance:
    """The segments as a problem, the views of the model on it, the log of each segment, and the share of all samples
    that the segments' usable ones are.

    known: what the model's own parameters promise there, by view: they were fitted to all samples.
    """

    problem: Problem
    views: tuple[View, ...]
    logs: np.ndarray
    share: float
    known: tuple[float, ...]

    @cached_property
    def slopes(self) -> Array:
        """Sensitivities (K, T, n) of the model's parameters on the part, those of all its views."""
        fitted = self.views[0].fitted
        return sensitivities(self.problem, fitted.point, fitted.error)

    def is_enough(self, promise: float) -> bool:
        """Whether the best promise, for all samples, is strong enough on the part."""
        return promise * self.share >= STRONG

    def least_promise(self, needed: float) -> float:
        """Promise, for all samples, that an effect which needs so much shows on the part at least; minus infinity where
        the part's share of it is too small to tell."""
        return HIDDEN * needed if needed * self.share >= TELLING else -np.inf

    def shift_of(self, point: Point, shift: Array) -> Array:
        """A change of the free parameters of the model on the segments as one of those on all logs."""
        known = dict(zip((f.name for f in self.views[0].fitted.point.free), shift, strict=True))
        return np.array([known.get(f.name, 0.0) for f in point.free])


def can_be_glanced_at(effect: Effect) -> bool:
    """Whether an effect is the same in every stretch of the motion, whatever happened before."""
    return not (effect.has_time or effect.remembers)


def can_be_cut(problem: Problem, point: Point) -> bool:
    """Whether a model is the same in every stretch of the logs, and nothing of it is of one log only."""
    there = (problem.kernel.effects[i] for i in np.flatnonzero(point.switches.any(axis=0)))
    return all(map(can_be_glanced_at, there)) and not any(f.kind == "log" for f in point.free)


def glance(problem: Problem, base: Fitted) -> Glance | None:
    """The model on segments of its logs and in one step per sample, filtered and with its errors as they are; None
    where that saves too little, or the model itself needs whole logs or shorter steps."""
    if not can_be_cut(problem, base.point):
        return None
    length = round(SECONDS / problem.sample_time)
    count = max(SAMPLES // problem.joints // length, 2 * problem.logs // problem.joints)
    places = np.zeros(0, dtype=int)
    if count * length <= LARGEST * len(problem.time):
        places = _places(problem, length, count)
    elif problem.substeps == 1:
        return None
    part, point, filter_, logs = replace(problem, substeps=1), base.point, base.whitener, np.arange(problem.logs)
    if len(places):
        logs = np.searchsorted(problem.bounds, places, side="right") - 1
        part = _cut(part, predicted_motion(problem, point), places, length)
        free = _free(point, part, logs)
        point = replace(point, parameters=point.parameters[logs], starts=part.starts, free=free)
        filter_ = replace(filter_, mask=filterable(part, filter_.coefficients.shape[1]), first=())
    error = errors(part, [point])[0]
    if not filter_.mask.any() or not part.credible(error):
        return None
    fitted = finish(part, point, error, filter_)
    if not len(places) and np.any(fitted.variances > EXACT * base.variances):
        return None
    views = tuple(View.of(part, view) for view in (fitted, plain(part, fitted)))
    known = tuple(view.promise(part, view.least(view.jacobian[:0], view.residual)[2]) for view in views)
    return Glance(part, views, logs, fitted.samples / base.samples, known)


def _places(problem: Problem, length: int, count: int) -> np.ndarray:
    """First samples of `count` segments, spread evenly over all logs, each within one of them."""
    found: list[int] = []
    for a, b in pairwise(problem.bounds.tolist()):
        own = max(1, round(count * (b - a) / len(problem.time)))
        if b - a >= length:
            found += np.linspace(a, b - length, own + 2)[1:-1].astype(int).tolist()
    return np.array(found, dtype=int)


def _cut(problem: Problem, motion: Array, places: np.ndarray, length: int) -> Problem:
    """Segments as logs that begin in the state of the model's motion (T, n, 3)."""
    rows = (places[:, None] + np.arange(length)).ravel()
    names = tuple(f"at {problem.time[place]:.1f} s" for place in places)
    starts = np.pad(motion[places], ((0, 0), (0, 0), (0, len(BEGINNING) - motion.shape[2])))
    return problem.part(rows, length * np.arange(len(places) + 1), starts, names)


def _free(point: Point, part: Problem, logs: np.ndarray) -> tuple[Free, ...]:
    """The free parameters of the model; initial states are those of the segments, about the model's own."""
    found = [f for f in point.free if f.kind != "start"]
    for f in point.free:
        if f.kind == "start":
            for segment in np.flatnonzero(logs == f.log):
                centre = float(part.starts[segment, f.joint, f.column])
                found.append(replace(f, name=f"{f.name}/{segment}", log=int(segment), centre=centre))
    return tuple(found)
