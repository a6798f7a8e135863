"""What is left after the named effects: does it depend on any signal of the log, and on which?

The innovations are regressed on the whitened responses to smooth functions of position, velocity, motor torque, elapsed
time and so on, injected as torque into the simulated joint. Innovations that no such function explains are noise.

A model with the right law has the same parameters from the beginning of a log to its end, and in all logs. So the
innovations are also regressed on the sensitivity to each parameter times slow functions of time: a law that only
imitates another one, or a machine that changes, shows there first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve
from scipy.ndimage import grey_closing
from scipy.stats import chi2

from diagnosis.command_steps import COMMAND_STEPS, CommandSteps, command_steps
from diagnosis.encoder_waves import READINGS, STEPS, Wave, bumps, encoder_wave
from diagnosis.estimation import Fitted, errors, predicted_motion, scatters, sensitivities, sticks
from diagnosis.hypotheses import adjoint
from diagnosis.jitter import jitter
from diagnosis.problem import Problem, bandwidth
from diagnosis.projection import project
from diagnosis.replay import rms
from diagnosis.whitening import absorption, whitener
from envs.log import Array

FLOOR = 1e-9
"""Least response to a torque, as a share of the largest over frequency, by which the spectrum of errors is divided."""
SLOW = 3
"""Half waves over a log, and over the sequence of logs, of a parameter that drifts."""
CHANCE = 1e-5
"""p-value from which a parameter counts as constant."""
WIDER = 10.0
"""Times the band of the motion in which a torque is looked for that blows may be: a play that is taken for a spring
leaves little below."""
JITTERS = 100.0
"""Decrease of -2 log likelihood from which the innovations scatter as instants that jitter make them."""
ROUNDED = 2.0
"""Mean square of the innovations, in squares of an encoder step, up to which they may be its rounding."""
ROUNDING = 0.25
"""The same up to which they are little else: white rounding makes a twelfth."""
DRAWS = 10
"""Realisations of the noise that such a joint is simulated with."""
SMALL = 0.0015
"""Effect of a drift beside that of the command, up to which it is put down to integrators and inexact laws."""
DIP = 1.5
"""Ratio of the frequencies on both sides of an antiresonance."""
DISTURBANCE = 0.03
"""Unlogged torque, as a share of the motor torque, that may be noise whatever the amplifier."""
AMPLIFIER = 1.5e-3
"""The same as a share of the largest command: amplifiers are that noisy."""
RATHER = 2.0
"""What errors of the readings, or steps of the command, have to explain over what all torques of the remainder do."""
OWN_SENTENCE = (READINGS, COMMAND_STEPS)
"""Signals on which no torque depends smoothly."""
LUCKY = 0.5
"""Share of what noise lets all functions of the remainder explain that it may let one effect explain."""


@dataclass(frozen=True)
class Dependence:
    """One group of signals: decrease of -2 log likelihood, functions used, p-value (Bonferroni over the groups)."""

    signal: str
    decrease: float
    functions: int
    p_value: float


@dataclass(frozen=True)
class Drift:
    """A free parameter (its name in `Point.free`) that slow functions of time would change within the logs or from one
    to the next: decrease of -2 log likelihood, functions used, p-value (Bonferroni over the parameters), and the rms of
    the change's effect beside that of the whole command."""

    parameter: str
    decrease: float
    functions: int
    p_value: float
    share: float

    @property
    def is_certain(self) -> bool:
        """Whether it is neither chance nor too small to mean anything."""
        return self.p_value < CHANCE and self.share > SMALL


@dataclass(frozen=True)
class Remainder:
    """Dependences in order of strength, the decrease that all groups together would bring, and the rms of the torque
    that they stand for as a share of the command's rms.

    disturbance: rms of the torque that no logged signal accounts for, in units of the command; disturbance_share: the
    same over the rms of the motor torque. beyond, beyond_share: the same up to WIDER times the band of the motion,
    where readings tell (`shows_blows`), 0 elsewhere. drifts: parameters in the order of their p-values. scattered:
    the decrease that the groups bring where such a torque is all that the model lacks, if it is one in which small
    causes grow (`impacts`), or one that dry friction holds and lets go; deviations: rms of what it then makes of the
    free parameters, by their names. wave: one of the readings over the position (`diagnosis.encoder_waves`). rounded:
    whether the innovations are little else than the encoder's rounding, which is not independent of a slow motion, nor
    of rest. misread: decrease beyond what noise would give that errors of the readings over the position bring, where
    torques bring far less of it. coarse: steps of the command by which its torque goes, where torques bring far less.
    """

    dependences: tuple[Dependence, ...]
    decrease: float
    functions: int
    share: float
    disturbance: float
    disturbance_share: float
    beyond: float = 0.0
    beyond_share: float = 0.0
    drifts: tuple[Drift, ...] = ()
    scattered: float = 0.0
    deviations: Mapping[str, float] = field(default_factory=dict)
    wave: Wave | None = None
    rounded: bool = False
    impacts: bool = False
    misread: float = 0.0
    coarse: CommandSteps | None = None

    @property
    def growth(self) -> float:
        """How much more noise lets the functions explain than it would where small causes stay small; at least 1."""
        return max(1.0, self.scattered / self.functions)

    @property
    def excess(self) -> float:
        """Decrease beyond what noise alone would give.

        White noise gives one per function with a standard deviation of sqrt(2 functions), all of it larger where small
        causes grow, and where a torque that nobody logged moves the joint at some times and not at others.
        """
        return max(0.0, self.decrease - by_chance(self.functions) * self.growth)


def beyond_chance(steps: CommandSteps) -> float:
    """What steps of the command bring beyond what noise would give to as many functions, of the best of so many
    widths."""
    return steps.decrease - by_chance(steps.functions) - 2.0 * float(np.log(steps.searched))


def by_chance(functions: int) -> float:
    """Most of the decrease of -2 log likelihood that white noise lets functions explain."""
    return 1.3 * functions + 4.0 * float(np.sqrt(2.0 * functions))


def signals(problem: Problem, motion: Array, joint: int) -> dict[str, list[Array]]:
    """Groups of smooth functions (T,) of the joint's motion (T, 3) and torque, each of unit scale.

    The signals are the model's own predictions, which depend on readings before each sample only: a smoothed reading
    contains the noise that it is compared with, and in a closed loop the command answers to it. The command's direction
    is that of its last change, by which a drive with hysteresis lags behind it.
    """
    groups: dict[str, list[Array]] = {
        name: [] for name in ("position", "velocity", "direction", "motor torque", "command direction", "elapsed time")
    }
    pieces: dict[str, list[list[Array]]] = {name: [] for name in groups}
    used = motion[problem.used]
    q0, q1 = used[:, 0].min(), np.ptp(used[:, 0]) + 1e-300
    for a, b in pairwise(problem.bounds):
        time = problem.time[a:b] - problem.time[a]
        q = (motion[a:b, 0] - q0) / q1
        v = motion[a:b, 1] / (np.std(motion[a:b, 1]) + 1e-300)
        w = motion[a:b, 2] / (np.std(motion[a:b, 2]) + 1e-300)
        acceleration = np.diff(v, prepend=v[:1])
        acceleration /= np.std(acceleration) + 1e-300
        s = time / max(time[-1], 1e-9)
        sign = np.tanh(v / 0.03)
        pieces["position"].append([np.cos(np.pi * k * q) for k in range(1, 9)])
        pieces["velocity"].append(
            [sign, v * np.abs(v), v**3, sign * np.exp(-((v / 0.2) ** 2)), np.abs(v), v**2 * np.exp(-(v**2))]
        )
        pieces["direction"].append(
            [sign * np.cos(np.pi * k * q) for k in range(1, 5)] + [np.abs(v) * sign * np.cos(np.pi * q)]
        )
        pieces["motor torque"].append(
            [
                np.abs(w) * sign,
                w**3,
                w * np.abs(w),
                w * np.cos(np.pi * q),
                w * np.cos(2 * np.pi * q),
                np.abs(w),
                acceleration * np.cos(np.pi * q),
                acceleration * np.cos(2 * np.pi * q),
                acceleration * np.abs(v),
            ]
        )
        u = problem.command[a:b, joint] / (np.std(problem.command[a:b, joint]) + 1e-300)
        change = np.diff(u, prepend=u[0])
        turned = np.sign(change)[np.maximum.accumulate(np.where(change != 0.0, np.arange(len(u)), 0))]
        pieces["command direction"].append([turned, turned * np.abs(u)])
        pieces["elapsed time"].append(
            [np.cos(np.pi * k * s) for k in range(1, 5)] + [s * v, s * w, np.ones_like(s), s * s * w]
        )
    for name, parts in pieces.items():
        groups[name] = [np.concatenate([part[i] for part in parts]) for i in range(len(parts[0]))]
    if len(problem.neighbour):
        near = problem.neighbour[:, joint]
        near = near / (np.std(near, axis=0) + 1e-300)
        groups["another joint"] = [near[:, i] for i in range(3)] + [near[:, 1] * np.abs(near[:, 1])]
    return groups


def remainder(problem: Problem, fitted: Fitted, joint: int) -> Remainder:
    """Regression of the innovations on the responses to every function, together and group by group."""
    motion = predicted_motion(problem, fitted.point)[:, joint]
    groups = signals(problem, motion, joint)
    noise = fitted.weights
    residual = fitted.innovation * noise
    size = 1e-3 * float(np.sqrt(np.mean(problem.command[:, joint] ** 2)))
    responses: dict[str, Array] = {}
    for name, functions in groups.items():
        extra = np.zeros((len(functions), len(problem.time), problem.joints))
        extra[:, :, joint] = size * np.stack(functions)
        difference = errors(problem, [fitted.point] * len(functions), extra=extra) - fitted.error
        responses[name] = fitted.whitener(difference) * noise
    base = fitted.gain(fitted.jacobian)
    every = np.vstack([fitted.jacobian, *responses.values()])
    spectrum = torque_spectrum(problem, fitted, joint, motion)
    change, sizes = np.split(project(every, residual)[0], [len(fitted.jacobian)])
    torque = size * sizes @ np.vstack(list(groups.values()))
    noise_alone = spectrum
    if sticks(problem, fitted.point, joint) and not scatters(problem, fitted.point, joint):
        noise_alone = torque_spectrum(problem, relieved(problem, fitted, joint, torque, change), joint, motion)
    scatter = scattering(problem, fitted, joint, as_noise(problem, noise_alone, motion, joint))
    found = []
    for name, response in responses.items():
        basis = np.vstack([fitted.jacobian, response])
        decrease, degrees = fitted.gain(basis) - base, len(response)
        growth = max(1.0, scattered(fitted, basis, scatter) / degrees)
        p = float(min(1.0, len(responses) * chi2.sf(max(decrease, 0.0) / growth, degrees)))
        found.append(Dependence(name, decrease, degrees, p))
    whole = fitted.gain(every) - base
    misread, excess = misreading(problem, fitted, joint, scatter, whole)
    found += [misread] if excess > 0.0 else []
    steps = coarseness(problem, fitted, joint, whole)
    if steps is not None:
        p = float(min(1.0, steps.searched * chi2.sf(steps.decrease, steps.functions)))
        found.append(Dependence(COMMAND_STEPS, steps.decrease, steps.functions, p))
    return Remainder(
        tuple(sorted(found, key=lambda d: -d.decrease / d.functions)),
        whole,
        sum(len(r) for r in responses.values()),
        rms(torque[problem.used]) / max(rms(problem.command[problem.used, joint]), 1e-150),
        *disturbance(problem, spectrum, motion),
        *(disturbance(problem, spectrum, motion, WIDER) if shows_blows(problem, fitted, joint) else (0.0, 0.0)),
        drifts(problem, fitted, joint, scatter),
        scattered(fitted, every, scatter),
        deviations(fitted, scatter),
        encoder_wave(problem, fitted, joint),
        rounded=bool(fitted.variances[joint] < ROUNDING * problem.encoder_step**2),
        impacts=scatters(problem, fitted.point, joint),
        misread=excess,
        coarse=steps,
    )


def coarseness(problem: Problem, fitted: Fitted, joint: int, torques: float) -> CommandSteps | None:
    """Steps of the command that explain more than noise does; None where torques explain half as much, or small causes
    grow. torques: what all groups explain."""
    least = RATHER * torques
    steps = None if scatters(problem, fitted.point, joint) else command_steps(problem, fitted, joint, least)
    return steps if steps is not None and steps.decrease >= least and beyond_chance(steps) > 0.0 else None


def misreading(
    problem: Problem, fitted: Fitted, joint: int, scatter: Array, torques: float
) -> tuple[Dependence, float]:
    """What smooth errors of the readings over the position would explain, and the part of it that neither noise nor the
    rounding of the encoder accounts for; 0 where torques explain half as much, where small causes grow, or beside those
    of the rest of an arm, which are as inexact as the readings of its joints. torques: what all groups explain."""
    own, functions = bumps(problem, fitted, joint)
    rows = np.zeros((len(own), problem.joints, own.shape[1]))
    rows[:, joint] = own
    basis = np.vstack([fitted.jacobian, rows.reshape(len(own), -1) * fitted.weights])
    sizes = project(basis, fitted.innovation * fitted.weights)[0]
    decrease = fitted.gain(basis) - fitted.gain(fitted.jacobian)
    growth = max(1.0, scattered(fitted, basis, scatter) / len(own))
    p = float(min(1.0, chi2.sf(max(decrease, 0.0) / growth, len(own))))
    error = sizes[len(fitted.jacobian) :] @ functions[:, problem.used]
    doubtful = problem.arm is not None or scatters(problem, fitted.point, joint)
    excess = decrease - by_chance(len(own)) * growth
    if doubtful or decrease < RATHER * torques or np.ptp(error) < STEPS * problem.encoder_step:
        excess = 0.0
    return Dependence(READINGS, decrease, len(own), p), max(0.0, excess)


def remainders(problem: Problem, fitted: Fitted) -> tuple[Remainder, ...]:
    """What is left of every joint."""
    return tuple(remainder(problem, fitted, j) for j in range(problem.joints))


def lucky(left: Sequence[Remainder]) -> float:
    """What noise alone would let one effect explain, where small causes grow."""
    return LUCKY * sum(r.scattered for r in left if r.impacts)


def shows_blows(problem: Problem, fitted: Fitted, joint: int) -> bool:
    """Whether the innovations tell of torques far above the band of the motion: they are no rounding of the encoder nor
    the scatter of instants that jitter, whose spectrum is known the worse the more it changes with the velocity, and
    the model has no blows of its own. Torques of the rest of an arm that hold in the band of the motion alone say
    nothing of what is beyond."""
    if problem.arm is not None and problem.decimation * problem.thinning > 1:
        return False
    is_rounding = fitted.variances[joint] < ROUNDED * problem.encoder_step**2
    if is_rounding or scatters(problem, fitted.point, joint):
        return False
    found = jitter(problem, fitted, joint)
    return found is None or found.decrease < JITTERS


def relieved(problem: Problem, fitted: Fitted, joint: int, torque: Array, change: Array) -> Fitted:
    """The fit with errors as they would be, to first order, without a torque (T,) that the functions explain and the
    change (P,) of the parameters that goes with it, behind a filter of their own: the noise beside it."""
    extra = np.zeros((1, len(problem.time), problem.joints))
    extra[0, :, joint] = torque
    error = 2.0 * fitted.error - errors(problem, [fitted.point], extra=extra)[0]
    error -= np.tensordot(change, sensitivities(problem, fitted.point, fitted.error), 1)
    own = whitener(problem, error)
    return replace(fitted, error=error, whitener=own, innovation=own(error))


def scattering(problem: Problem, fitted: Fitted, joint: int, spectrum: TorqueSpectrum) -> Array:
    """What noise makes of the innovations (DRAWS, N n), weighted, of a joint in which small causes grow, or that dry
    friction holds at times; (0, N n) else.

    Behind impacts a small torque makes errors that are no longer small nor independent of the motion, whatever the
    whitening; at rest it makes none, and when the joint stops and breaks away hangs on it. So the model is simulated
    once more with a random torque that has the spectrum of the unexplained one: in the band of the motion, and beyond
    it no more than its mean there, falling with the square of the frequency, as behind a first-order lag. What blows
    make of the errors there is no torque.
    """
    nothing: Array = np.zeros((0, fitted.innovation.size))
    if not (scatters(problem, fitted.point, joint) or sticks(problem, fitted.point, joint)):
        return nothing
    generator, (frequency, power, _, band) = np.random.default_rng(0), spectrum
    count, noise = len(problem.time), fitted.weights
    edge = frequency[band][-1] if np.any(band) else 0.0
    beyond = np.mean(power[band]) * (edge / np.maximum(frequency, edge)) ** 2 if edge > 0.0 else 0.0
    power = np.where(band, power, np.minimum(power, beyond))
    size = np.sqrt(np.interp(np.fft.rfftfreq(count, problem.sample_time), frequency, power))
    extra = np.zeros((DRAWS, count, problem.joints))
    extra[:, :, joint] = np.fft.irfft(np.fft.rfft(generator.standard_normal((DRAWS, count))) * size, count)
    changed = errors(problem, [fitted.point] * DRAWS, extra=extra)
    if not problem.credible(changed):
        return nothing
    return np.asarray(fitted.whitener(changed - fitted.error) * noise)


def as_noise(problem: Problem, spectrum: TorqueSpectrum, motion: Array, joint: int) -> TorqueSpectrum:
    """The spectrum of an unlogged torque, with no more of it than noise may be.

    What is larger has a cause (`diagnosis.verdict`), and would excuse any law that is missing if it was simulated as
    noise.
    """
    size = disturbance(problem, spectrum, motion)[0]
    limit = problem.command_limits[joint] if problem.command_limits else 0.0
    most = max(DISTURBANCE * rms(motion[problem.used, 2]), AMPLIFIER * limit)
    return spectrum._replace(power=spectrum.power * min(1.0, most / max(size, 1e-300)) ** 2)


def scattered(fitted: Fitted, basis: Array, scatter: Array) -> float:
    """Decrease of -2 log likelihood that a basis (free parameters first) brings where noise alone has made the errors,
    `scatter`."""
    known = basis[: len(fitted.jacobian)]
    taken = [project(basis, own)[1] - project(known, own)[1] for own in scatter]
    share = float(np.mean(taken)) / fitted.total if taken else 0.0
    return float(-(scatter.shape[1] // len(fitted.variances)) * np.log(max(1.0 - share, 1e-12)))


def deviations(fitted: Fitted, scatter: Array) -> dict[str, float]:
    """Rms of the changes, to first order, that errors made by noise alone (`scattering`) bring to the free parameters.

    With J the sensitivities and C the covariance, errors d change the parameters by ``C J d``. Where small causes grow,
    such errors follow the motion from one instant to the next, and parameters are less certain than C says.
    """
    if not len(scatter):
        return {}
    rms = np.sqrt(np.mean((scatter @ fitted.jacobian.T @ fitted.covariance) ** 2, axis=0))
    return dict(zip((f.name for f in fitted.point.free), rms.tolist(), strict=True))


def slow_functions(problem: Problem) -> Array:
    """Half cosines over every log, and over the sequence of logs (K, T)."""
    functions = np.zeros((SLOW + min(SLOW, problem.logs - 1), len(problem.time)))
    for log, (a, b) in enumerate(pairwise(problem.bounds)):
        elapsed = problem.time[a:b] - problem.time[a]
        for k in range(SLOW):
            functions[k, a:b] = np.cos(np.pi * (k + 1) * elapsed / max(elapsed[-1], 1e-9))
        for k in range(len(functions) - SLOW):
            functions[SLOW + k, a:b] = np.cos(np.pi * (k + 1) * log / (problem.logs - 1))
    return functions


def drifts(problem: Problem, fitted: Fitted, joint: int, scatter: Array) -> tuple[Drift, ...]:
    """What slow changes of each of the joint's parameters would explain, all others refitted to first order.

    Those of an event act once and are left out. scatter: errors that noise alone makes (`scattering`), of which the
    same changes explain a part.

    The score test of constant parameters; J. Nyblom, Testing for the constancy of parameters over time, Journal of the
    American Statistical Association 84 (1989), with a fixed number of smooth alternatives.
    """
    events = {effect.name for effect in problem.kernel.effects if effect.scan == "event"}
    tested = [
        i
        for i, f in enumerate(fitted.point.free)
        if f.kind == "joint" and f.joint == joint and f.name.partition(".")[0] not in events
    ]
    basis, (total, count) = fitted.jacobian, (fitted.total, fitted.innovation.size // problem.joints)
    noise = fitted.weights
    residual = fitted.innovation * noise
    slow = np.tile(slow_functions(problem)[:, fitted.whitener.mask], (1, problem.joints))
    extra = np.zeros((2, len(problem.time), problem.joints))
    extra[1, :, joint] = 0.01 * problem.command[:, joint]
    both = fitted.whitener(errors(problem, [fitted.point] * 2, extra=extra)) * noise
    reference = max(100.0 * float(np.linalg.norm(both[1] - both[0])), 1e-300)
    certainty = np.diag(fitted.point.certainty)
    inverse = np.linalg.pinv(basis @ basis.T + certainty, rcond=1e-14, hermitian=True)
    samples, found = np.vstack([residual, scatter]), []
    right = samples @ basis.T
    for i in tested:
        changed = basis[i] * slow
        cross = changed @ basis.T @ inverse
        gram = changed @ changed.T - cross @ basis @ changed.T
        scores = samples @ changed.T - right @ cross.T
        scale = np.sqrt(np.maximum(np.diag(changed @ changed.T), 1e-300))
        inner = np.linalg.pinv(gram / np.outer(scale, scale), rcond=1e-8, hermitian=True) / np.outer(scale, scale)
        taken = np.einsum("ri,ij,rj->r", scores, inner, scores)
        size = inner @ scores[0]
        decrease = float(-count * np.log(max(1.0 - max(taken[0], 0.0) / total, 1e-12)))
        each = float(np.mean(taken[1:])) * count / (total * len(slow)) if len(scatter) else 1.0
        p = float(min(1.0, len(tested) * chi2.sf(decrease / max(each, 1.0), len(slow))))
        share = float(np.linalg.norm(size @ changed)) / reference
        found.append(Drift(fitted.point.free[i].name, decrease, len(slow), p, share))
    return tuple(sorted(found, key=lambda d: d.p_value))


class TorqueSpectrum(NamedTuple):
    """Spectrum of the unlogged torque that drives a joint, all (F,).

    Frequencies; the spectrum, whose mean over all frequencies is the mean square of the torque; its deviation where the
    sensor's noise is all there is; and the mask of the joint's band of motion.
    """

    frequency: Array
    power: Array
    deviation: Array
    band: np.ndarray


def disturbance(problem: Problem, spectrum: TorqueSpectrum, motion: Array, times: float = 1.0) -> tuple[float, float]:
    """Rms of the unlogged torque that drives the joint in so many times its band of motion, and its share of the motor
    torque's.

    Up to the frequency to which most of it exceeds its deviation: far above, where hardly any torque shows, the least
    of the sensor's noise would stand for a large one. motion: predicted angle, velocity and motor torque (T, 3).
    """
    frequency, power, chance, band = spectrum
    if times != 1.0 and np.any(band):
        band = frequency <= times * frequency[band][-1]
    certain = np.cumsum(np.where(band, power - chance, 0.0))
    size = float(np.sqrt(max(np.max(certain), 0.0) / (len(power) - 1)))
    return size, size / max(float(np.sqrt(np.mean(motion[problem.used, 2] ** 2))), 1e-300)


def torque_spectrum(problem: Problem, fitted: Fitted, joint: int, motion: Array) -> TorqueSpectrum:
    """What the innovations say of the torque that nobody logged.

    motion: predicted angle, velocity and motor torque (T, 3); a measured velocity shows the band of a coarse encoder.

    With S the spectrum of the prediction errors, S_0 what white noise of the sensor makes of it behind the leak l
    (``S_0 ~ w^2 / (w^2 + l^2)``, its level read off the upper half of the band) and H the response of the error to a
    torque, the spectrum of that torque is ``(S - S_0) / |H|^2``. What does not stand out of three deviations of S
    (`spectral_deviation`) is the sensor's, however little of a torque a joint shows that friction holds.
    """
    tool, dt = adjoint(problem, fitted, joint), problem.sample_time
    count = 1 << 15
    frequency = np.asarray(np.fft.rfftfreq(count, dt), dtype=np.float64)
    filter_power = np.abs(np.fft.rfft(fitted.whitener.coefficients[joint], count)) ** 2
    variance = float(fitted.variances[joint])
    spectrum = variance / np.maximum(filter_power, 1e-300)
    angular = 2 * np.pi * frequency
    sensor = float(np.quantile(spectrum[frequency > 0.25 / dt], 0.2)) * angular**2 / (angular**2 + problem.leak**2)
    deviation = spectral_deviation(problem, fitted, joint, count)
    power = tool.power(angular, dt)
    if not np.any(power > 0.0):  # friction holds the joint all the time: no torque shows
        nothing = np.zeros(len(frequency))
        return TorqueSpectrum(frequency, nothing, nothing, nothing > 0.0)
    power = without_dips(frequency, power)
    whole, noise = variance / np.maximum(power, FLOOR * np.max(power)), sensor / spectrum
    torque: Array = whole * np.clip(1.0 - (1.0 + 3.0 * deviation) * noise, 0.0, 1.0)
    lowest = 2.0 / (problem.time[problem.bounds[1] - 1] - problem.time[0])
    bands = (bandwidth(problem.time[a:b], motion[a:b, 1]) for a, b in pairwise(problem.bounds))
    band = frequency < max(lowest, *bands)
    return TorqueSpectrum(frequency, torque, whole * noise * deviation, band)


def without_dips(frequency: Array, power: Array) -> Array:
    """A response |H|^2 (F,) without its antiresonances, narrower than DIP: there hardly any torque shows, and the least
    of an error would stand for a large one."""
    even = np.geomspace(frequency[1], frequency[-1], 4096)
    size = max(1, round(np.log(DIP) / np.log(even[1] / even[0])))
    level = np.log(np.maximum(np.interp(even, frequency, power), 1e-300))
    around = np.pad(level, size, mode="reflect", reflect_type="odd")  # slopes go on beyond the ends
    filled = np.exp(grey_closing(around, size)[size:-size])
    return np.maximum(power, np.interp(frequency, even, filled))


def spectral_deviation(problem: Problem, fitted: Fitted, joint: int, count: int) -> Array:
    """Relative standard deviation (count / 2 + 1,) of the spectrum that an autoregression says the errors of a joint
    have.

    With A the response of the prediction-error filter, g (k,) that of the blocks of lags and C the covariance of the
    coefficients, ``ln S = ln s^2 - ln |A|^2`` has the variance ``4 Re(g / A)' C Re(g / A)``. Slow waves meet all blocks
    alike, so that their power is known the worst.
    """
    taken, own = absorption(problem, fitted.error, fitted.whitener), fitted.whitener
    means = np.zeros((len(own.blocks), 1 << 13))
    for mean, (first, last) in zip(means, own.blocks, strict=True):
        mean[first * own.every : last * own.every : own.every] = 1.0 / (last - first)
    response = np.fft.rfft(means)
    assert own.solution is not None
    slope = np.real(response / (1.0 - own.solution[joint] @ response))
    share = len(taken.positions) * problem.joints / fitted.samples
    covariance = float(fitted.variances[joint]) * share * cho_solve(taken.factors[joint], slope)
    deviation = 2.0 * np.sqrt(np.sum(slope * covariance, axis=0))
    return np.interp(np.linspace(0.0, 1.0, count // 2 + 1), np.linspace(0.0, 1.0, len(deviation)), deviation)
