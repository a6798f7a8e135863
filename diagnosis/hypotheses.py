"""From an effect's name to a model that contains it: free parameters, starting values, scans.

A hypothesis is one effect on one joint, in all logs or in one of them (an event need not happen in every recording).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress, pairwise
from math import prod

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from diagnosis.arm_damping import may_rub_behind, rubbing_behind
from diagnosis.behind import borne
from diagnosis.estimation import Fitted, Point, errors, predicted_motion, scatters
from diagnosis.glance import Glance, can_be_glanced_at
from diagnosis.problem import NEVER, Free, Problem, free_damping, scales, smooth_derivatives
from diagnosis.regression import View
from envs.log import Array
from methods.effects.base import Effect, Scales
from methods.effects.payload_change import AT_REST
from methods.kernel import NOMINAL
from methods.parallel import each

OTHER = 1.5
"""Factor by which a shape has to differ from another one to be worth a fit of its own."""
VISCOUS, BACK_EMF = "viscous", "back_emf"
FOLLOWING = NOMINAL.index("following")
FIXED = 1e-4
"""Standard deviation, as a share of its scale, of a parameter that is held."""
SAMPLES = 500.0
"""Scale of an event's instant: its derivative is taken over half a sample."""
PHASE = 50.0
"""Scale of a wave's rate, as the phase [rad] that it changes at most: its derivative is taken over a thousandth."""
CYCLES = 40_000
"""Most cycles per revolution (or per metre) that are scanned."""
PULSE = (0.004, 1.0)
"""Lengths of pulses that are scanned [s]."""
CLOSE = 0.07
"""Relative distance of these lengths."""
LENGTHS = 40
"""How many of them count as searched."""
RINGING = 1.5
"""Time [s] for which a joint answers to a short pulse, at most."""
STRUCK = 6
"""Responses to such pulses that are compared."""
AT_ONCE = 16
"""Hypotheses that are simulated at once."""
MEMORY = 4_000_000
"""Prediction errors of all of them that are kept at a time, about."""
PER_LOG = {"periodic_disturbance": (0, 1)}
"""Parameters that may differ from log to log: the phase of a disturbance has no reason to restart with a recording."""


@dataclass(frozen=True)
class Hypothesis:
    """One effect on one joint (index into the problem's joints); log: the only log it lives in, or -1 for all.

    apart: the logs in each of which it happens at an instant of its own, if it does so. behind: whether it is a law of
    friction that begins behind the joint's spring or play.
    """

    effect: Effect
    joint: int
    log: int = -1
    apart: tuple[int, ...] = ()
    behind: bool = False

    @property
    def where(self) -> str:
        """Whether it is in all logs alike, in one of them, or at an instant of its own in each."""
        return "##" if self.apart else ("#" if self.log >= 0 else "")

    @property
    def key(self) -> str:
        side = "behind" if self.behind else ""
        return f"{self.effect.name}@{self.joint}{self.where}{side}" + (f"{self.log}" if self.log >= 0 else "")

    def logs_of(self, parameter: int, logs: int) -> tuple[int, ...]:
        """The logs, of so many, that have a value of their own of a parameter; -1 for one value in all."""
        if self.apart and self.effect.parameters[parameter].name == "time":
            return self.apart
        return tuple(range(logs)) if parameter in PER_LOG.get(self.effect.name, ()) else (self.log,)


Job = tuple[Hypothesis, Array, int]
"""A hypothesis, the values (L, size) to begin from, and how many were searched for them."""
Slot = tuple[int, list[int]]
"""An amplitude's place among the parameters, and the logs it is for (-1: all)."""


@dataclass(frozen=True, eq=False)
class Start:
    """A hypothesis with values (L, size) to begin from and the decrease of the criterion that they promise.

    others: values of other shapes, next best first, as many as the effect wants to be tried. shift: change of the free
    parameters of the model without it that goes with the values, to first order. share: torque that these values stand
    for as a share of the command's rms, infinite where no regression tells it.
    """

    hypothesis: Hypothesis
    values: Array
    promise: float
    searched: int = 1
    others: tuple[Array, ...] = ()
    shift: Array | None = None
    share: float = np.inf


def extend(problem: Problem, point: Point, hypothesis: Hypothesis, values: Array) -> Point:
    """The model with one more effect, or with other values of one that it has; values (L, size)."""
    effect, j = hypothesis.effect, hypothesis.joint
    if point.switches[j, problem.kernel.switches[effect.name]]:
        point = withdraw(problem, point, effect.name, j)
    if hypothesis.behind and f"arm_friction@{j}" not in {f.name for f in point.free}:
        point = rubbing_behind(point, [j], 1.0)
    offset = problem.kernel.offsets[effect.name]
    parameters, switches = point.parameters.copy(), point.switches.copy()
    if effect.scatters or scatters(problem, point, j):
        parameters[:, j, FOLLOWING] = 0.0
    elif is_wave(effect) and not has_wave(problem, point, j):
        parameters[:, j, FOLLOWING] = 1.0
    parameters[:, j, problem.kernel.own(effect)] = values
    switches[j, problem.kernel.switches[effect.name]] = True
    if problem.pair and effect.parts_the_arm:
        parting = [
            next((e for e, on in zip(problem.kernel.effects, row, strict=True) if on and e.parts_the_arm), None)
            for row in switches
        ]
        parameters = borne(problem, point.rigid, parameters, parting, j)
    if hypothesis.log >= 0:
        for a in effect.amplitudes:
            parameters[[log for log in range(problem.logs) if log != hypothesis.log], j, offset + a] = 0.0
    free = list(point.free)
    if effect.replaces:
        parameters[:, j, NOMINAL.index(effect.replaces)] = 0.0
        held = f"{effect.replaces}@{j}"  # it stays in its place, so that sensitivities do
        free = [replace(f, centre=0.0, deviation=FIXED * f.scale) if f.name == held else f for f in free]
    for i, parameter in enumerate(effect.parameters):
        size = float(np.max(np.abs(values[:, i])))
        size = size if size > 0 else 1e-3
        if effect.scan == "event" and parameter.name == "time":
            size = SAMPLES * problem.sample_time
        if effect.scan in ("time", "position") and i not in effect.amplitudes:
            size = min(size, PHASE / _reach(problem, effect, j))
        for log in hypothesis.logs_of(i, problem.logs):
            name = f"{effect.name}.{parameter.name}@{j}" + (f"#{log}" if log >= 0 else "")
            kind = "log" if log >= 0 else "joint"
            free.append(Free(name, kind, j, offset + i, size, parameter.lower, parameter.upper, log))
    known = {f.name: f for f in free}
    if effect.has_motor_torque and f"{BACK_EMF}@{j}" in known and f"{VISCOUS}@{j}" not in known:
        size = known[f"{BACK_EMF}@{j}"].scale
        begin = float(parameters[0, j, NOMINAL.index(VISCOUS)])
        free.append(free_damping(j, size, begin))
    return replace(point, parameters=parameters, switches=switches, free=tuple(free))


def _reach(problem: Problem, effect: Effect, joint: int) -> float:
    """How far a wave's phase moves at most in a log, over its rate: what the rate is multiplied by."""
    if effect.scan == "time":
        return 2.0 * np.pi * problem.longest
    return max(float(problem.farthest[joint]), 1e-12)


def resists(effect: Effect) -> bool:
    """Whether an effect resists behind a winding's lag, which holds up the back-EMF only."""
    return effect.slot in ("torque", "friction") or effect.stage in ("transmission", "arm")


def is_divided(problem: Problem, effects: Iterable[Effect], stated: float) -> bool:
    """Whether mechanical damping and back-EMF may be two parameters of a joint with these effects: the motor torque
    drives one of them, one is a spring or a play or, where nobody stated the former, one resists. stated: mechanical
    damping as stated, or 0."""
    if problem.divides_damping:
        return True
    return any(e.has_motor_torque or e.parts_the_arm or (stated == 0.0 and resists(e)) for e in effects)


def is_wave(effect: Effect) -> bool:
    """Whether an effect is a wave over the position that acts on the joint: where it is on the wave has to be known
    better than models predict it that noise drives away, so that its position follows the readings."""
    return effect.scan == "position" and effect.slot != "sensor"


def has_wave(problem: Problem, point: Point, joint: int) -> bool:
    """Whether a joint's model has a wave over its position."""
    return any(map(is_wave, compress(problem.kernel.effects, point.switches[joint])))


def withdraw(problem: Problem, point: Point, name: str, joint: int, *, divided: bool = False) -> Point:
    """The model without an effect; the inverse of `extend`.

    divided: mechanical damping and back-EMF stay two parameters, whatever effects are withdrawn later.
    """
    switches = point.switches.copy()
    switches[joint, problem.kernel.switches[name]] = False
    free = [f for f in point.free if not (f.name.startswith(f"{name}.") and f.joint == joint)]
    replaced = next(effect.replaces for effect in problem.kernel.effects if effect.name == name)
    free = [replace(f, deviation=np.inf) if replaced and f.name == f"{replaced}@{joint}" else f for f in free]
    left = [effect for effect, on in zip(problem.kernel.effects, switches[joint], strict=True) if on]
    parameters = point.parameters
    shared = next((f for f in free if f.name == f"{VISCOUS}@{joint}" and np.isfinite(f.deviation)), None)
    if shared is not None and divided:
        free[free.index(shared)] = replace(shared, deviation=np.inf)
    elif shared is not None and not is_divided(problem, left, shared.centre):
        parameters = parameters.copy()  # the damping as a whole stays
        moved = parameters[:, joint, shared.column] - shared.centre
        parameters[:, joint, shared.column] -= moved
        parameters[:, joint, NOMINAL.index(BACK_EMF)] += moved
        free.remove(shared)
    return replace(point, parameters=parameters, switches=switches, free=tuple(free))


def proposals(
    problem: Problem,
    views: Sequence[View],
    candidates: Iterable[tuple[Effect, int]],
    sizes: dict[int, Scales],
    look: Glance | None = None,
) -> list[list[Start]]:
    """Best starting values per hypothesis, by regression of the nominal errors on its sensitivities, best first.

    views: the same model seen through several whitening filters, each of which gets a list of its own. Sensitivities
    come from the kernel itself (one simulation per amplitude and shape), so that the filter from an effect to the
    prediction error is exact, friction and coupling included. look: part of the samples, with the same views, on which
    effects are regressed that are the same in every stretch of the motion.
    """
    jobs: list[Job] = []
    for effect, joint in candidates:
        if effect.scan is not None:
            for view in views:
                jobs += scan(problem, view.fitted, effect, joint, sizes[joint])
        elif effect.starts is not None:
            every = list(effect.starts(sizes[joint]))
            shapes = len({tuple(v[i] for i in effect.shapes) for v in every})
            sides = (False, True) if may_rub_behind(problem, views[0].fitted.point, effect, joint) else (False,)
            jobs += [
                (Hypothesis(effect, joint, behind=side), np.tile(np.array(v, float), (problem.logs, 1)), shapes)
                for side in sides
                for v in every
            ]
    found: list[dict[str, list[Start]]] = [{} for _ in views]
    if look is None:
        proposed = _regressions(problem, views, jobs)
    else:
        brief = [can_be_glanced_at(hypothesis.effect) for hypothesis, _, _ in jobs]
        short = iter(_regressions_at_a_glance(problem, views[0].fitted, look, list(compress(jobs, brief))))
        long = iter(_regressions(problem, views, [job for job, own in zip(jobs, brief, strict=True) if not own]))
        proposed = [next(short if own else long) for own in brief]
    for (hypothesis, _, _), starts in zip(jobs, proposed, strict=True):
        # an event in all logs and one in a single log are told apart by a fit only, and so are the sides of a spring
        key = f"{hypothesis.effect.name}@{hypothesis.joint}{hypothesis.where}{hypothesis.behind}"
        for own, start in zip(found, starts, strict=True):
            own.setdefault(key, []).append(start)
    lists = []
    for own in found:
        best = []
        for group in own.values():
            group.sort(key=lambda s: -s.promise)
            effect = group[0].hypothesis.effect
            chosen: list[Array] = []
            for start in group:
                other = all(_other_shape(effect, start.values[0], values[0]) for values in chosen)
                if len(chosen) < effect.tries and np.isfinite(start.promise) and other:
                    chosen.append(start.values)
            best.append(replace(group[0], others=tuple(chosen[1:])))
        lists.append(sorted(best, key=lambda s: -s.promise))
    return lists


def _other_shape(effect: Effect, one: Array, other: Array) -> bool:
    """Whether two parameter vectors differ enough in what no linear regression can tell."""
    ratio = [max(abs(one[i]), abs(other[i])) > OTHER * min(abs(one[i]), abs(other[i])) for i in effect.shapes]
    return any(ratio)


def _regressions(problem: Problem, views: Sequence[View], jobs: Sequence[Job]) -> list[list[Start]]:
    """The start that each view proposes for each of the jobs; so many at a time are simulated at once."""
    point, size = views[0].fitted.point, len(problem.time) * problem.joints
    per_command = {j: command_response(problem, point, j) for j in {hypothesis.joint for hypothesis, _, _ in jobs}}
    found: list[list[Start]] = []
    count = max(2, min(AT_ONCE, MEMORY // size))
    for part in (jobs[first : first + count] for first in range(0, len(jobs), count)):
        trials = [_trials(problem, point, *job) for job in part]
        outcomes = iter(errors(problem, [trial for own, _ in trials for trial in own]))
        simulated = [np.stack([next(outcomes) for _ in own]) for own, _ in trials]
        parts = list(zip(part, (slots for _, slots in trials), simulated, strict=True))
        found += each(lambda item: _regress(problem, views, *item, per_command[item[0][0].joint]), parts)
    return found


def command_response(problem: Problem, point: Point, joint: int) -> float:
    """Rms of what a small change of the command of a joint does to its prediction error, over that change's share."""
    size = 0.01
    extra = np.zeros((2, len(problem.time), problem.joints))
    extra[1, :, joint] = size * problem.command[:, joint]
    one, other = errors(problem, [point, point], extra=extra)
    return max(float(np.sqrt(np.mean((other - one)[problem.used, joint] ** 2))), 1e-300) / size


def _trials(
    problem: Problem, point: Point, hypothesis: Hypothesis, values: Array, _searched: int
) -> tuple[list[Point], list[Slot]]:
    """The model with each amplitude of an effect alone, and which amplitude that is, in which logs."""
    effect = hypothesis.effect
    trials, slots = [], []
    for a in effect.amplitudes or (-1,):
        single = values.copy()
        for other in effect.amplitudes:
            if other != a:
                single[:, other] = 0.0
        trials.append(extend(problem, point, hypothesis, single))
        slots.append((a, list(hypothesis.logs_of(a, problem.logs))))
    return trials, slots


def _regress(
    problem: Problem, views: Sequence[View], job: Job, slots: Sequence[Slot], simulated: Array, per_command: float
) -> list[Start]:
    """The start that each view proposes, amplitudes scaled by linear regression; simulated: errors (A, T, n);
    per_command: what all of the command does to them (`command_response`)."""
    hypothesis, values, searched = job
    effect, base = hypothesis.effect, views[0].fitted
    if not problem.credible(simulated[0]):
        return [Start(hypothesis, values, -np.inf, searched) for _ in views]
    difference = simulated - base.error
    columns, owners = [], []
    for d, (a, logs) in zip(difference, slots, strict=True):
        for log in logs:
            part = d
            if log >= 0:
                part = np.zeros_like(d)
                window = slice(problem.bounds[log], problem.bounds[log + 1])
                part[window] = d[window]
            columns.append(part)
            owners.append((a, log))
    stacked = np.stack(columns)
    starts = []
    for view in views:
        sensitivity, residual = view.sensitivities(stacked), view.residual
        adjusted = values.copy()
        shift, own, left = view.least(sensitivity, residual)
        response = np.tensordot(own, stacked[:, problem.used, hypothesis.joint], 1)
        share = float(np.sqrt(np.mean(response**2))) / per_command
        if effect.amplitudes:
            for (a, log), c in zip(owners, own, strict=True):
                rows = slice(None) if log < 0 else log
                factor = np.clip(c, -50.0, 50.0)
                if effect.parameters[a].lower == 0.0 and factor <= 0.0:
                    factor, left, shift, share = 0.02, 0.3 * left + 0.7 * residual, 0.0 * shift, np.inf
                scaled = values[rows, a] * factor
                adjusted[rows, a] = np.clip(scaled, effect.parameters[a].lower, 0.9 * effect.parameters[a].upper)
        else:
            shift, _, left = view.least(sensitivity[:0], residual + sensitivity[0])
        starts.append(Start(hypothesis, adjusted, view.promise(problem, left), searched, shift=shift, share=share))
    return starts


def _regressions_at_a_glance(problem: Problem, base: Fitted, look: Glance, jobs: Sequence[Job]) -> list[list[Start]]:
    """The start that each view of the segments proposes for each of the jobs, for all samples."""
    found = []
    parts = [(hypothesis, values[look.logs], searched) for hypothesis, values, searched in jobs]
    for proposed in _regressions(look.problem, look.views, parts):
        starts = []
        for start, known in zip(proposed, look.known, strict=True):
            shift = None if start.shift is None else look.shift_of(base.point, start.shift)
            own = np.repeat(start.values[:1], problem.logs, axis=0)
            starts.append(replace(start, values=own, promise=(start.promise - known) / look.share, shift=shift))
        found.append(starts)
    return found


# ---------------------------------------------------------------------------------------------------------------- scans


@dataclass(frozen=True, eq=False)
class Adjoint:
    """Correlation of the innovations with an input-equivalent torque at every instant, for one joint.

    With h the whitened impulse response from torque to prediction error,
            ``c = h(-t) * innovation``: the inner product of
    the innovations with the response to any torque d(t) is ``sum c d``, and its squared norm ``sum |h * d|^2``.
    """

    correlation: Array  # (T,)
    response: Array  # (M,)
    variance: float

    @cached_property
    def spectrum(self) -> Array:
        """|H|^2 of the whitened response at equally spaced frequencies from 0 to the Nyquist frequency."""
        n = 1 << int(np.ceil(np.log2(4 * len(self.response))))
        return np.abs(np.fft.rfft(self.response, n)) ** 2

    def power(self, angular: NDArray[np.floating], dt: float) -> Array:
        """|H|^2 of the whitened response at angular frequencies [rad/s]."""
        place = np.abs(angular) * dt / np.pi * (len(self.spectrum) - 1)
        return np.interp(place, np.arange(len(self.spectrum)), self.spectrum)


def adjoint(problem: Problem, base: Fitted, joint: int) -> Adjoint:
    """Impulse response by simulation of short pulses, correlation by FFT per log.

    The pulses come where the joint is fast and moves most while the response lasts: one that friction holds would not
    answer. The weakest response of those that are no weaker than their mean square is taken.
    """
    at, length, size = pulses(problem, base, joint)
    extra = np.zeros((len(at) + 1, len(problem.time), problem.joints))
    extra[np.arange(len(at)), at, joint] = size
    out = errors(problem, [base.point] * len(extra), extra=extra)[:, :, joint]
    responses = [
        np.convolve((own - out[-1])[i : i + length] / size, base.whitener.coefficients[joint])[:length]
        for i, own in zip(at, out[:-1], strict=True)
    ]
    energy = np.sum(np.square(responses), axis=1)
    chosen = int(np.argmin(np.where(energy >= np.mean(energy), energy, np.inf)))
    return matched(problem, base, joint, responses[chosen])


def pulses(problem: Problem, base: Fitted, joint: int) -> tuple[list[int], int, float]:
    """Instants of pulses, best first, the samples for which a joint answers to one, and its size [command units]."""
    length = min(int(RINGING / problem.sample_time), int(np.min(np.diff(problem.bounds))) // 2)
    at = _struck(problem, np.abs(predicted_motion(problem, base.point)[:, joint, 1]), length)
    return at, length, 0.05 * float(np.sqrt(np.mean(problem.command[:, joint] ** 2))) + 1e-12


def _struck(problem: Problem, speed: Array, length: int) -> list[int]:
    """Instants of pulses: where the speed (T,) is largest early in each of the windows of so many samples in which the
    joint moves most."""
    found = []
    for a, b in pairwise(problem.bounds):
        last = b - length
        for begin in range(min(a + int(problem.burn_in / problem.sample_time), last), last + 1, length):
            early = speed[begin : min(begin + length // 2, last) + 1]
            found.append((float(np.sum(speed[begin : begin + length])), begin + int(np.argmax(early))))
    return [at for _, at in sorted(found, reverse=True)[:STRUCK]]


def matched(problem: Problem, base: Fitted, joint: int, response: Array) -> Adjoint:
    """The filter that is matched to a whitened impulse response (M,)."""
    innovation = np.zeros(len(problem.time))
    innovation[base.whitener.mask] = base.innovation.reshape(problem.joints, -1)[joint]
    correlation = np.zeros(len(problem.time))
    for a, b in zip(problem.bounds[:-1], problem.bounds[1:], strict=True):
        correlation[a:b] = fftconvolve(innovation[a:b], response[::-1])[len(response) - 1 :][: b - a]
    return Adjoint(correlation, response, float(base.variances[joint]))


def scan(
    problem: Problem, base: Fitted, effect: Effect, joint: int, size: Scales
) -> list[tuple[Hypothesis, Array, int]]:
    """Starting values from a scan over frequencies, cycles per revolution or instants, whitened throughout."""
    tool = adjoint(problem, base, joint)
    if effect.scan == "time":
        return _scan_time(problem, tool, effect, joint, size)
    if effect.scan == "position":
        return _scan_position(problem, base, tool, effect, joint, size)
    return _scan_events(problem, tool, effect, joint, size)


def fastest_wave(problem: Problem) -> float:
    """The highest frequency [Hz] at which a wave is sought: a little below what the filter's lags can tell apart."""
    return 0.45 / (problem.decimation * problem.sample_time)


def _scan_time(
    problem: Problem, tool: Adjoint, effect: Effect, joint: int, size: Scales
) -> list[tuple[Hypothesis, Array, int]]:
    """Periodogram of the correlation, summed over logs (the phase is free in each)."""
    longest = int(np.max(np.diff(problem.bounds)))
    n = 1 << int(np.ceil(np.log2(2 * longest)))
    frequency = np.fft.rfftfreq(n, problem.sample_time)
    score = np.zeros(len(frequency))
    power = np.maximum(tool.power(2 * np.pi * frequency, problem.sample_time), 1e-300)
    for a, b in zip(problem.bounds[:-1], problem.bounds[1:], strict=True):
        score += 2 * np.abs(np.fft.rfft(tool.correlation[a:b], n)) ** 2 / ((b - a) * power * tool.variance)
    valid = (frequency > 0.7 / size.duration) & (frequency < fastest_wave(problem))
    score[~valid] = 0.0
    found = []
    for index in peaks(score, 3, spacing=4):
        values = np.tile([0.02 * size.torque_rms, 0.02 * size.torque_rms, frequency[index]], (problem.logs, 1))
        found.append((Hypothesis(effect, joint), values, int(valid.sum() // 2)))
    return found


def _scan_position(
    problem: Problem, base: Fitted, tool: Adjoint, effect: Effect, joint: int, size: Scales
) -> list[tuple[Hypothesis, Array, int]]:
    """Waves over the position; of a gain effect they act on the motor torque."""
    motion = predicted_motion(problem, base.point)[:, joint]
    weight = motion[:, 2] if effect.has_motor_torque else np.ones(len(motion))
    if not np.any(weight):
        return []
    cycles, score = waves(problem, tool, joint, motion[:, 1], weight)
    found = []
    amplitude = 0.02 * size.torque_rms if effect.slot == "torque" else 0.02
    for index in peaks(score, 4, spacing=3):
        values = np.tile([amplitude, amplitude, cycles[index]], (problem.logs, 1))
        found.append((Hypothesis(effect, joint), values, len(cycles)))
    return found


def waves(problem: Problem, tool: Adjoint, joint: int, velocity: Array, weight: Array) -> tuple[Array, Array]:
    """Cycles per revolution, or per 2 pi m, of waves over the readings, and the decrease of -2 log likelihood by each:
    transform of the correlation, weighted (T,), over the readings. None where the way is too short for any."""
    q, nothing = problem.position[:, joint], (np.zeros(0), np.zeros(0))
    span = max(float(np.ptp(q)), 1e-12)
    least = 2.0 if problem.revolute else 2 * np.pi / span
    spacing = min(np.pi / span / 3, 1.0) if not problem.revolute else min(np.pi / span / 3, 0.5)
    fastest = max(float(np.sqrt(np.mean(problem.velocity[:, joint] ** 2))), 1e-12)
    most = min(2 * np.pi * fastest_wave(problem) / fastest, CYCLES * spacing)
    if problem.revolute:
        most = min(most, 1200.0)
    cycles = np.arange(least, most, spacing)
    if len(cycles) < 2:
        return nothing
    # bin the correlation on a fine grid of angles, then transform
    bins = 1 << int(np.ceil(np.log2(min(2**17, max(64, 12 * span * cycles[-1] / (2 * np.pi))))))
    place = np.clip(((q - q.min()) / span * bins).astype(int), 0, bins - 1)
    folded = np.bincount(place, tool.correlation * weight, bins)
    length = 4 * bins  # zero padding: cycles every pi / (2 span)
    transform = np.fft.rfft(folded, length)
    spacing = 2 * np.pi * bins / (span * length)
    chosen = np.unique(np.round(cycles / spacing).astype(int))
    chosen = chosen[(chosen > 0) & (chosen < len(transform))]
    if not len(chosen):
        return nothing
    cycles, transform = chosen * spacing, transform[chosen]
    edges = np.quantile(np.abs(velocity), np.linspace(0, 1, 33))
    speeds = 0.5 * (edges[1:] + edges[:-1])
    norm = np.mean(tool.power(np.outer(cycles, speeds), problem.sample_time), axis=1) * np.sum(weight**2) / 2
    return cycles, np.abs(transform) ** 2 / np.maximum(norm * tool.variance, 1e-300)


def _scan_events(
    problem: Problem, tool: Adjoint, effect: Effect, joint: int, size: Scales
) -> list[tuple[Hypothesis, Array, int]]:
    """What matched filters show best, as an event of one log, of all at one instant, and of each at its own."""
    found = []
    seen = [seen_events(problem, tool, effect, joint, size, log) for log in range(problem.logs)]
    for log, event in ((log, event) for log, events in enumerate(seen) for event in events):
        values = np.tile(event.values, (problem.logs, 1))
        found.append((event.score, Hypothesis(effect, joint, log), values, event.searched))
        found.append((event.score, Hypothesis(effect, joint), values, event.searched))
    found.sort(key=lambda item: -item[0])
    return [*(item[1:] for item in found[:6]), *_apart(problem, effect, joint, size, seen)]


@dataclass(frozen=True, eq=False)
class Event:
    """What a matched filter shows in one log: decrease of -2 log likelihood, values (size,), and how many were
    searched."""

    score: float
    values: Array
    searched: int


def seen_events(problem: Problem, tool: Adjoint, effect: Effect, joint: int, size: Scales, log: int) -> list[Event]:
    """Matched filters on one log: pulses of several lengths (collision) or a step of inertia or weight (payload), or
    the blow of a load that rested."""
    a, b = problem.bounds[log], problem.bounds[log + 1]
    time = problem.time[a:b] - problem.time[a]
    usable = time > problem.burn_in
    c = tool.correlation[a:b] * usable
    searched = int((b - a) / max(1, len(tool.response) // 10))
    if effect.name == "collision":
        pulses = _pulses(c, tool, problem.sample_time)
        shapes = [(score, time[index], width * problem.sample_time) for score, width, index in pulses]
        first = 0.05 * size.torque_rms
        return [Event(score, np.array([first, at, lasts, 0.3]), LENGTHS * searched) for score, at, lasts in shapes]
    q = problem.reading[a:b]
    signals = [smooth_derivatives(time, q[:, joint : joint + 1], 0.02)[2][:, 0]]
    if effect.on_the_arm == "weight":
        signals += [np.sin(q[:, 0] + q[:, 1]), np.cos(q[:, 0] + q[:, 1])]
    steps = [_step(c, signal * usable, tool) for signal in signals]
    score, index = max(steps)
    further = next(iter(effect.starts(size) if effect.starts else ()), (0.0,) * effect.size)[2:]
    best = [(score, index)]
    if effect.name in AT_REST:
        best += [(score, index) for score, _, index in _pulses(c, tool, problem.sample_time)[:1]]
    values = np.array([[0.05 * size.inertia, time[index], *further] for _, index in best])
    count = (len(steps) + len(best) - 1) * searched
    return [Event(score, own, count) for (score, _), own in zip(best, values, strict=True) if score > 0.0]


def _step(correlation: Array, signal: Array, tool: Adjoint) -> tuple[float, int]:
    """Decrease of -2 log likelihood by a torque that follows a signal (T,) from some instant on, beside one that does
    so all along; and the index of the best instant."""
    filtered = fftconvolve(signal, tool.response)[: len(signal)]
    part, norm = np.cumsum(correlation * signal), np.cumsum(filtered**2)
    if norm[-1] <= 0:
        return 0.0, 0
    share = norm / norm[-1]
    spread = norm * (1 - share) * tool.variance
    inside = (share > 0.02) & (share < 0.98)
    score = np.where(inside, (part - share * part[-1]) ** 2 / np.maximum(spread, 1e-300), 0.0)
    return float(np.max(score)), int(np.argmax(score))


def _apart(
    problem: Problem, effect: Effect, joint: int, size: Scales, seen: Sequence[Sequence[Event]]
) -> list[tuple[Hypothesis, Array, int]]:
    """The strongest event at an instant of its own in every log that shows one of about its length; none where only one
    log does."""
    every = [event for events in seen for event in events]
    if not every:
        return []
    strongest, names = max(every, key=lambda event: event.score), [p.name for p in effect.parameters]
    lasts = [i for i, name in enumerate(names) if name == "duration"]

    def is_alike(event: Event) -> bool:
        worth = event.score > np.log(len(problem.time)) + 2.0 * np.log(event.searched)
        return bool(worth and np.all(np.abs(np.log2(event.values[lasts] / strongest.values[lasts])) <= 1.0))

    best = {
        log: max(alike, key=lambda event: event.score)
        for log, events in enumerate(seen)
        if (alike := [event for event in events if is_alike(event)])
    }
    if len(best) < 2:
        return []
    values = np.tile(strongest.values, (problem.logs, 1))
    values[:, names.index("time")] = NEVER * size.duration
    for log, event in best.items():
        values[log, names.index("time")] = event.values[names.index("time")]
    return [(Hypothesis(effect, joint, apart=tuple(best)), values, prod(event.searched for event in best.values()))]


def _pulses(correlation: Array, tool: Adjoint, dt: float) -> list[tuple[float, int, int]]:
    """(score, length and first sample) of the pulses that match best, one per octave of their lengths, shortest first.

    A whitened response is short, so that a pulse only matches where both of its ends do: lengths are close together.
    """
    total = np.concatenate([[0.0], np.cumsum(correlation)])
    shortest, longest = max(1.0, PULSE[0] / dt), max(1.0, min(PULSE[1] / dt, len(correlation) / 8))
    count = 1 + int(np.log(max(longest / shortest, 1.0)) / np.log(1.0 + CLOSE))
    best: dict[int, tuple[float, int, int]] = {}
    for width in np.unique(np.round(np.geomspace(shortest, max(shortest, longest), count)).astype(int)).tolist():
        step = np.cumsum(np.pad(tool.response, (0, width)))
        step[width:] -= step[:-width].copy()
        score = (total[width:] - total[:-width]) ** 2 / max(float(step @ step) * tool.variance, 1e-300)
        index, octave = int(np.argmax(score)), int(np.log2(width))
        if octave not in best or score[index] > best[octave][0]:
            best[octave] = float(score[index]), width, index
    return list(best.values())


def peaks(score: Array, count: int, spacing: int) -> list[int]:
    """Indices of the highest values that keep a distance from each other."""
    left, found = score.copy(), []
    for _ in range(count if len(score) else 0):
        index = int(np.argmax(left))
        if left[index] <= 0:
            break
        found.append(index)
        left[max(0, index - spacing) : index + spacing + 1] = 0.0
    return found


def sizes_of(problem: Problem, base: Fitted) -> dict[int, Scales]:
    """Typical magnitudes per joint; the motor torque is taken from the command less the back-EMF."""
    result = {}
    for j in range(problem.joints):
        nominal = base.point.parameters[0, j]
        result[j] = scales(problem, nominal, problem.command[:, j] - nominal[2] * problem.velocity[:, j], j)
    return result
