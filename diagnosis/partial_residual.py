"""What an effect leaves behind in the logs, as a torque against the signal that tells it: a partial-residual plot.

The prediction errors of the whole model and of the model whose effect is switched off (all other parameters as finally
estimated) are turned into the commands d and d_off that explain them (`diagnosis.replay.input_equivalent`). Then
``law = d_off - d`` is the effect's share, and ``d_off = law + d`` is what it has to explain. For an error of the sensor
the same holds for the reading: the integral of the velocity error ``e' + L e`` of a simulation with leak L. In a
planar pair an effect moves both joints, and its share takes the errors of both; what is left takes the joint's own.
Without a torque a pair of little damping soon moves so differently that its mass matrix and weights are others: there
the law is that of an observer that corrects the velocities, too.

Source: R. D. Cook, Exploring partial residual plots, Technometrics 35 (1993).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.signal import detrend

from diagnosis.estimation import Fitted, Point, errors
from diagnosis.finding import Accepted, Finding
from diagnosis.nominal import COLUMN
from diagnosis.parameters import JointUnits
from diagnosis.problem import Problem, smooth_derivatives
from diagnosis.remainder import OWN_SENTENCE, Remainder
from diagnosis.replay import input_equivalent
from diagnosis.result import PartialResidual, Quantiles
from envs.log import Array
from methods.effects.base import Effect

WINDOWS = (0.015, 0.03, 0.06, 0.12, 0.24)
"""Smoothing windows [s] to choose from; the shortest that shows the effect well above the noise is taken."""
BINS = 61
SHOWN_RIVALS = 2
SHOWN_DEPENDENCES = 2
LINK = "angle of the link"
"""Signal that a law of the second link of a planar pair follows: the sum of both joints' angles."""


def partial_residuals(problem: Problem, finding: Finding, joint: int, units: JointUnits) -> tuple[PartialResidual, ...]:
    """One per named effect of a joint (index into the problem), then what is left against the most telling signals."""
    named = [_of_effect(problem, finding.final, item, units) for item in finding.accepted if item.joint == joint]
    signals = _signals_left(finding.remainders[joint])
    return (*named, *(_of_remainder(problem, finding.final, joint, signal, units) for signal in signals))


def _signals_left(left: Remainder) -> list[str]:
    """The strongest dependences; velocity and position where there are none, to show that nothing is there."""
    real = [d.signal for d in left.dependences if d.p_value < 1e-3 and d.signal not in OWN_SENTENCE]
    chosen = list(dict.fromkeys("velocity" if name == "direction" else name for name in real))
    return (chosen or ["velocity", "position"])[:SHOWN_DEPENDENCES]


def missing_reading(problem: Problem, error: Array, joint: int) -> Array:
    """Error of the reading (T,) that explains a prediction error (T, n), up to a straight line in each log."""
    out = np.zeros(len(problem.time))
    for a, b in pairwise(problem.bounds):
        e = error[a:b, joint]
        out[a:b] = detrend(e + problem.leak * problem.sample_time * np.cumsum(e))
    return out


def without_effect(problem: Problem, point: Point, effect: str, joint: int) -> Point:
    """The same model, nothing refitted, with one effect switched off."""
    switches = point.switches.copy()
    switches[joint, problem.kernel.switches[effect]] = False
    return replace(point, switches=switches)


def _of_effect(problem: Problem, final: Fitted, item: Accepted, units: JointUnits) -> PartialResidual:
    """The partial residual of one effect of the final model, with the laws of its closest rivals."""
    effect, joint = item.scored.start.hypothesis.effect, item.joint
    kind = _kind(effect)
    rivals = [s for s in item.rivals if s.start.hypothesis.joint == joint][:SHOWN_RIVALS]

    is_observed = problem.pair and kind != "reading"
    watched = replace(problem, rate_leak=problem.leak**2) if is_observed else problem

    def share(fitted: Fitted, name: str) -> Array:
        off = without_effect(problem, fitted.point, name, joint)
        if not is_observed:
            return errors(problem, [off])[0] - fitted.error
        without, whole = errors(watched, [off, fitted.point])
        return without - whole

    def transformed(error: Array, seconds: float, seen: Problem = watched) -> Array:
        if kind == "reading":
            return missing_reading(problem, error, joint)
        torque = input_equivalent(seen, final.point, error, seconds, coupled=seen is watched)[:, joint]
        return -torque if kind == "resistance" else torque

    own = share(final, item.name)
    seconds = WINDOWS[-1]
    for seconds in WINDOWS:
        law, after = transformed(own, seconds), transformed(final.error, seconds, problem)
        if np.std(after[problem.used]) < 0.3 * np.std(law[problem.used]):
            break
    laws = [(item.label, law), *((s.label, transformed(share(s.fitted, s.name), seconds)) for s in rivals)]
    name = "velocity" if effect.variable == "direction" else effect.variable
    if is_of_the_link(problem, effect, joint):
        name = LINK
    x, unit = _signal(problem, final.point, joint, name, units)
    frame = PartialResidual(
        effect=effect.label,
        kind=kind,
        signal=name if unit != "s" else "elapsed time",
        signal_unit=unit,
        unit=units.position if kind == "reading" else units.command,
        x=x,
        before=Quantiles(law + after, law + after, law + after),
        after=Quantiles(after, after, after),
        laws=tuple(laws),
        samples=np.zeros((2, 0)),
        continuous=unit == "s",
    )
    if frame.continuous:
        return _stretch(problem, frame, effect.scan == "event")
    return _binned(frame, _shown(problem, final.point, effect, joint, x))


def is_of_the_link(problem: Problem, effect: Effect, joint: int) -> bool:
    """Whether an effect of a joint is one of the second link of a planar pair, which turns with both joints."""
    return problem.pair and joint == 1 and bool(effect.of_the_link)


def _kind(effect: Effect) -> Literal["command", "resistance", "reading"]:
    """Laws on the left of the equation of motion resist; others change the command, the motor torque or the reading."""
    if effect.slot == "sensor":
        return "reading"
    return "resistance" if effect.slot in ("torque", "friction") or effect.stage == "arm" else "command"


def _of_remainder(problem: Problem, final: Fitted, joint: int, signal: str, units: JointUnits) -> PartialResidual:
    """What the final model leaves, against one signal of the log."""
    left = input_equivalent(problem, final.point, final.error, WINDOWS[2])[:, joint]
    x, unit = _signal(problem, final.point, joint, signal, units)
    same = Quantiles(left, left, left)
    frame = PartialResidual(
        None, "command", signal, unit, units.command, x, same, same, (), np.zeros((2, 0)), continuous=False
    )
    return _binned(frame, problem.used & _core(x, problem.used))


def _signal(problem: Problem, point: Point, joint: int, name: str, units: JointUnits) -> tuple[Array, str]:
    """A signal (T,) by its name in `Effect.variable`, and its unit; elapsed time [s] where the logs cannot give it."""
    parts: list[Array] = []
    unit = "s"
    seconds = max(0.02, 5 * problem.sample_time)
    for log, (a, b) in enumerate(pairwise(problem.bounds)):
        q, dq, ddq = (x[:, 0] for x in smooth_derivatives(problem.time[a:b], problem.reading[a:b, [joint]], seconds))
        if name == "position":
            unit, part = units.position, problem.reading[a:b, joint]
        elif name == LINK:
            unit, part = units.position, problem.reading[a:b].sum(axis=1)
        elif name == "velocity":
            unit, part = f"{units.position}/s", dq
        elif name == "acceleration":
            unit, part = f"{units.position}/s²", ddq
        elif name == "command":
            unit, part = units.command, problem.command[a:b, joint]
        elif name == "command direction":
            unit, part = f"{units.command}/s", np.gradient(problem.command[a:b, joint], problem.time[a:b])
        elif name == "motor torque":
            unit = units.command
            part = problem.command[a:b, joint] - point.parameters[log, joint, COLUMN["back_emf"]] * dq
        elif name == "position since reversal":
            unit, part = units.position, _since_reversal(q, dq)
        elif name == "another joint" and len(problem.neighbour):
            unit, part = f"{units.position}/s²", problem.neighbour[a:b, joint, 0]
        else:
            part = problem.time[a:b] - problem.time[a]
        parts.append(part)
    return np.concatenate(parts), unit


def _since_reversal(q: Array, dq: Array) -> Array:
    """Signed travel since the velocity last changed its sign (T,)."""
    turned = np.zeros(len(q), dtype=int)
    turns = np.flatnonzero(np.diff(np.sign(dq)) != 0) + 1
    turned[turns] = turns
    travel: Array = q - q[np.maximum.accumulate(turned)]
    return travel


def _core(x: Array, used: np.ndarray) -> np.ndarray:
    low, high = np.quantile(x[used], [0.002, 0.998])
    inside: np.ndarray = (x >= low) & (x <= high)
    return inside


def _shown(problem: Problem, point: Point, effect: Effect, joint: int, x: Array) -> np.ndarray:
    """Samples to be shown: the core of the signal's range, or six periods of an effect that repeats with the angle."""
    mask = problem.used & _core(x, problem.used)
    names = [parameter.name for parameter in effect.parameters]
    if "cycles_per_rev" not in names:
        return mask
    column = problem.kernel.offsets[effect.name] + names.index("cycles_per_rev")
    width = 6 * 2 * np.pi / float(point.parameters[0, joint, column])
    if np.ptp(x[mask]) <= width:
        return mask
    counts, edges = np.histogram(x[mask], bins=max(2, int(np.ptp(x[mask]) / width)))
    first = edges[int(np.argmax(counts))]
    return mask & (x >= first) & (x <= first + width)


def _binned(frame: PartialResidual, mask: np.ndarray) -> PartialResidual:
    """Medians and quantiles of samples (T,) in equal bins of the signal; bins of fewer than eight are left out."""
    x = frame.x[mask]
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, BINS - 1)
    order = np.argsort(place, kind="stable")
    limits = np.searchsorted(place[order], np.arange(BINS + 1))
    kept = [k for k in range(BINS) if limits[k + 1] - limits[k] >= 8]

    def quantiles(values: Array) -> Quantiles:
        y = values[mask][order]
        rows = [np.quantile(y[limits[k] : limits[k + 1]], [0.5, 0.1, 0.9]) for k in kept]
        return Quantiles(*np.array(rows).reshape(-1, 3).T)

    step = max(1, len(x) // 600)
    return replace(
        frame,
        x=0.5 * (edges[1:] + edges[:-1])[kept],
        before=quantiles(frame.before.middle),
        after=quantiles(frame.after.middle),
        laws=tuple((name, quantiles(values).middle) for name, values in frame.laws),
        samples=np.stack([x[::step], frame.before.middle[mask][::step]]),
    )


def _stretch(problem: Problem, frame: PartialResidual, event: bool) -> PartialResidual:
    """About twelve swings of the law around its largest value, or all of its log where it swings less.

    The first tenth of each log, in which initial states still settle, is left out unless an event may fall into it.
    """
    settled = problem.used.copy()
    if not event:
        for a, b in pairwise(problem.bounds):
            settled[a : a + (b - a) // 10] = False
    law = np.where(settled, frame.laws[0][1], 0.0)
    log = int(np.searchsorted(problem.bounds, int(np.argmax(np.abs(law))), side="right") - 1)
    own = np.flatnonzero(settled[problem.bounds[log] : problem.bounds[log + 1]]) + int(problem.bounds[log])
    time, values = frame.x[own], law[own]
    peak = int(np.argmax(np.abs(values)))
    active = np.abs(values) > 0.05 * np.abs(values[peak])
    swings = int(np.sum(np.diff(np.sign(values[active])) != 0))
    lasting = float(active.sum()) * problem.sample_time
    if active.mean() < 0.2:
        length = 6 * lasting
    elif swings > 12:
        length = 12 * lasting / swings
    else:
        length = float(time[-1] - time[0])
    length = max(length, 60 * problem.sample_time)
    begin = min(max(float(time[peak]) - length / 2, float(time[0])), max(float(time[-1]) - length, float(time[0])))
    rows = own[(time >= begin) & (time <= begin + length)]
    rows = rows[:: max(1, len(rows) // 600)]
    pick = lambda q: Quantiles(q.middle[rows], q.low[rows], q.high[rows])  # noqa: E731
    return replace(
        frame,
        x=frame.x[rows],
        before=pick(frame.before),
        after=pick(frame.after),
        laws=tuple((name, values[rows]) for name, values in frame.laws),
    )
