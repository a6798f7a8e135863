"""Prediction-error estimation: simulate with a weak leak, whiten what remains (`whitening`), minimise it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from diagnosis.problem import Free, Problem
from diagnosis.projection import project
from diagnosis.whitening import Absorption, Whitener, absorption, unfiltered, whitener
from envs.log import Array
from methods.parallel import each


@dataclass(frozen=True, eq=False)
class Point:
    """A model: parameters (L, n, columns), switches (n, effects), rigid (3,), initial states (L, n, 3), free
    parameters."""

    parameters: Array
    switches: np.ndarray
    rigid: Array
    starts: Array
    free: tuple[Free, ...]

    @property
    def vector(self) -> Array:
        """Values of the free parameters."""
        return np.array([self._get(f) for f in self.free])

    def _get(self, f: Free) -> float:
        if f.kind == "start":
            return float(self.starts[f.log, f.joint, f.column])
        if f.kind == "rigid":
            return float(self.rigid[f.column])
        return float(self.parameters[max(f.log, 0), f.joint, f.column])

    def at(self, vector: Array) -> Point:
        """The same model with other values of the free parameters."""
        parameters, rigid, starts = self.parameters.copy(), self.rigid.copy(), self.starts.copy()
        for f, value in zip(self.free, vector, strict=True):
            if f.kind == "start":
                starts[f.log, f.joint, f.column] = value
            elif f.kind == "rigid":
                rigid[f.column] = value
            elif f.kind == "log":
                parameters[f.log, f.joint, f.column] = value
            else:
                parameters[:, f.joint, f.column] = value
        return replace(self, parameters=parameters, rigid=rigid, starts=starts)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest values (P,) of the free parameters."""
        return np.array([f.lower for f in self.free]), np.array([f.upper for f in self.free])

    @property
    def certainty(self) -> Array:
        """Information (P,) about the free parameters that was there beforehand: one over their variances."""
        return np.array([f.deviation for f in self.free]) ** -2.0

    def within(self, vector: Array) -> Point:
        """The same with each value at its bound where it lies beyond."""
        return self.at(np.clip(vector, *self.bounds))

    @property
    def values(self) -> dict[str, float]:
        """Values of the free parameters by name."""
        return dict(zip((f.name for f in self.free), self.vector.tolist(), strict=True))

    def taking(self, values: Mapping[str, float]) -> Point:
        """The same with the values of those of its free parameters that are among the given ones, within bounds."""
        return self.within(np.array([{**self.values, **values}[f.name] for f in self.free]))

    @property
    def contradicted(self) -> float:
        """Sum of squares by which the free parameters miss what is known of them, over their standard deviations."""
        return float(sum(((x - f.centre) / f.deviation) ** 2 for f, x in zip(self.free, self.vector, strict=True)))

    def value(self, name: str) -> float:
        return self.vector[[f.name for f in self.free].index(name)]


def scatters(problem: Problem, point: Point, joint: int) -> bool:
    """Whether a joint's model has an effect in which small causes grow."""
    present = zip(problem.kernel.effects, point.switches[joint], strict=True)
    return any(on and effect.scatters for effect, on in present)


def sticks(problem: Problem, point: Point, joint: int) -> bool:
    """Whether a joint's model has dry friction, which holds it and lets it go."""
    present = zip(problem.kernel.effects, point.switches[joint], strict=True)
    return any(on and (effect.slot == "friction" or effect.is_dry) for effect, on in present)


def errors(problem: Problem, points: Sequence[Point], extra: Array | None = None, leak: bool = True) -> Array:
    """Prediction errors (C, T, n) of several points with the same switches or not."""
    return problem.errors(
        np.stack([p.parameters for p in points]),
        np.stack([p.switches for p in points]),
        np.stack([p.rigid for p in points]),
        np.stack([p.starts for p in points]),
        extra=extra,
        leak=leak,
    )


def predicted_motion(problem: Problem, point: Point) -> Array:
    """Predicted angle, velocity and motor torque (T, n, 3) of a point; see `Problem.motion`. Simulated once as long as
    the point lives; not to be written into."""
    motion = problem.motions.get(point)
    if motion is None:
        motion = problem.motion(point.parameters, point.switches, point.rigid, point.starts)
        motion.flags.writeable = False
        problem.motions[point] = motion
    return motion


def plain(problem: Problem, fitted: Fitted) -> Fitted:
    """The same model with its errors as they are: a filter that may have taken a missing effect for noise is put aside.

    What the nominal parameters can explain of them to first order is taken away.
    """
    mask = fitted.whitener.mask.copy()
    mask[fitted.whitener.rows] = fitted.whitener.late
    filter_ = unfiltered(problem, mask)
    view = finish(problem, fitted.point, fitted.error, filter_, fitted.iterations)
    scale = view.weights
    scaled = view.innovation * scale
    left = scaled - project(view.jacobian, scaled)[0] @ view.jacobian
    again = weights(left / scale, problem.joints)
    jacobian = view.jacobian / scale * again
    return replace(view.informed(jacobian, view.covariance), innovation=left / scale, filtered=False)


SINGULAR = 1e-14
"""Share of the largest eigenvalue of the scaled information below which a direction is not determined at all."""
SHORT_STEP = 1e-4
"""Steps of the differences that tell how certain parameters are, as a share of their sizes."""
ROUGH_STEP = 1e-3
"""The same where small causes grow."""
FAR = 1e3
"""Sizes of a parameter that one which is not determined, nor bounded, may be off."""
LAGS = 60
"""Lags of the sandwich's kernel [samples]."""


@dataclass(frozen=True, eq=False)
class Information:
    """What a fit tells of its free parameters, worked out when it is first asked for: most fits are only compared.

    made: gives the sensitivities (P, N n) of the innovations over their rms, and the covariance (P, P).
    """

    made: Callable[[], tuple[Array, Array]]
    _making: threading.Lock = field(default_factory=threading.Lock, init=False, repr=False)

    @classmethod
    def of(cls, jacobian: Array, covariance: Array) -> Information:
        """That which is known already."""
        return cls(lambda: (jacobian, covariance))

    @cached_property
    def _both(self) -> tuple[Array, Array]:
        return self.made()

    @property
    def both(self) -> tuple[Array, Array]:
        """Sensitivities and covariance."""
        with self._making:
            return self._both


@dataclass(frozen=True, eq=False)
class Fitted:
    """Outcome of a fit: model, errors (T, n), innovations (N n,), and what they tell of the free parameters.

    filtered: whether the innovations are meant to be white.
    """

    point: Point
    error: Array
    innovation: Array
    whitener: Whitener
    information: Information
    iterations: int
    floor: Array
    credible: bool = True
    filtered: bool = True

    @property
    def jacobian(self) -> Array:
        """Sensitivities (P, N n) of the innovations, over their rms."""
        return self.information.both[0]

    @property
    def covariance(self) -> Array:
        """Covariance (P, P) of the free parameters."""
        return self.information.both[1]

    def informed(self, jacobian: Array, covariance: Array) -> Fitted:
        """The same fit with other sensitivities and another covariance."""
        return replace(self, information=Information.of(jacobian, covariance))

    @property
    def samples(self) -> int:
        return self.innovation.size

    @property
    def variances(self) -> Array:
        """Mean square innovation per joint (n,)."""
        return np.mean(self.innovation.reshape(len(self.whitener.coefficients), -1) ** 2, axis=1)

    @property
    def weights(self) -> Array:
        """One over the rms innovation of each sample's joint (N n,)."""
        return weights(self.innovation, len(self.whitener.coefficients))

    @property
    def plain_covariance(self) -> Array:
        """Inverse information (P, P) of the free parameters behind a filter that stays."""
        return _inverse(self.jacobian @ self.jacobian.T + np.diag(self.point.certainty))

    @property
    def criterion(self) -> float:
        """-2 log likelihood up to a constant: sum over joints of N ln(mean square innovation + floor).

        What is known of parameters beforehand is part of it. A simulation that ran away counts with its errors as
        they are: from one another they could be predicted perfectly.
        """
        return _criterion(self.point, self.error, self.innovation, self.whitener, self.floor, self.credible)

    @property
    def total(self) -> float:
        """Sum of squares of the innovations, each over its joint's rms, with the floor added."""
        count = self.samples // len(self.variances)
        return float(count * np.sum(1.0 + self.floor / np.maximum(self.variances, 1e-300)))

    def gain(self, basis: Array) -> float:
        """Decrease of -2 log likelihood that a basis (K, N n), weighted as `weights`, brings to first order."""
        share = project(basis, self.innovation * self.weights)[1] / self.total
        return float(-(self.samples // len(self.variances)) * np.log(max(1.0 - share, 1e-12)))

    def standard_error(self, name: str) -> float:
        i = [f.name for f in self.point.free].index(name)
        return float(np.sqrt(max(self.covariance[i, i], 0.0)))


def sensitivities(problem: Problem, point: Point, error: Array, step: float = 1e-3, first: int = 0) -> Array:
    """Derivative (P, T, n) of the prediction error with respect to the free parameters, by forward differences.

    Parameters that live in different logs are perturbed together, since they cannot touch the same samples. Those
    before `first` are left out: (P - first, T, n).
    """
    return _slopes(problem, point, error, forward_steps(point, step), first)


def precise_sensitivities(problem: Problem, point: Point, error: Array) -> Array:
    """The same to second order, by central differences over short steps, or by two on one side at a bound.

    Where parameters can nearly stand in for one another, what is left of their difference is of the second order: a
    forward difference may err by more than that, and the parameters then seem far more certain than they are. So may
    a central one over a step that is not much less than the width of a resonance, a few per cent of its frequency.
    Where small causes grow a short step would tell of a single history only.
    """
    is_rough = any(scatters(problem, point, j) for j in range(problem.joints))
    step = ROUGH_STEP if is_rough else SHORT_STEP
    vector, steps, (lower, upper) = point.vector, forward_steps(point, step), point.bounds
    central = (vector - steps >= lower) & (vector - steps <= upper)
    one = _slopes(problem, point, error, steps)
    other = _slopes(problem, point, error, np.where(central, -steps, 2.0 * steps))
    return np.where(central[:, None, None], 0.5 * (one + other), 2.0 * one - other)


def forward_steps(point: Point, step: float) -> Array:
    """Steps (P,) of finite differences, as a share of each free parameter's size; backwards where its bound is near."""
    steps = np.array([step * f.scale for f in point.free])
    return np.where(point.vector + steps > point.bounds[1], -steps, steps)


def _slopes(problem: Problem, point: Point, error: Array, steps: Array, first: int = 0) -> Array:
    """Differences (P - first, T, n) of the prediction error over steps (P,) of the free parameters."""
    groups: dict[tuple, list[int]] = {}
    for i, f in enumerate(point.free):
        if i < first:
            continue
        key = (f.kind, f.joint, f.column) if f.log >= 0 else (f.kind, f.joint, f.column, i)
        groups.setdefault(key, []).append(i)
    vector = point.vector
    moved = []
    for members in groups.values():
        shifted = vector.copy()
        shifted[members] += steps[members]
        moved.append(point.at(shifted))
    out = errors(problem, moved) - error
    result = np.zeros((len(vector) - first, *error.shape))
    for difference, members in zip(out, groups.values(), strict=True):
        for i in members:
            f = point.free[i]
            where = slice(None) if f.log < 0 else slice(problem.bounds[f.log], problem.bounds[f.log + 1])
            result[i - first, where] = difference[where] / steps[i]
    return result


def weights(innovation: Array, joints: int) -> Array:
    """One over the rms innovation of each joint, repeated per sample: joints with different units weigh alike."""
    rms = np.sqrt(np.mean(innovation.reshape(joints, -1) ** 2, axis=1))
    return np.repeat(1.0 / np.maximum(rms, 1e-300), innovation.size // joints)


def fit(
    problem: Problem,
    point: Point,
    filter_: Whitener | None = None,
    *,
    rounds: int = 2,
    iterations: int = 6,
    tolerance: float = 1e-5,
    known: Array | None = None,
    renewed: bool = True,
) -> Fitted:
    """Levenberg-Marquardt on the innovations; the whitening filter is renewed between rounds and, if `renewed`, after.

    Such a filter also moves with the parameters in every step (`whitening.Absorption`). Where renewed filters do not
    keep what moved ones promised, the fit ends where it was best when one was renewed. Sensitivities serve for several
    steps, as long as these get on; iterations: how often a round computes them. tolerance: relative decrease of the
    mean square below which a round ends. known: sensitivities (K, T, n) of the first K parameters, taken for constant,
    in a fit of one round that only has to tell hypotheses apart.
    """
    error = errors(problem, [point])[0]
    lower, upper = point.bounds
    centre = np.array([f.centre for f in point.free])
    certainty = point.certainty
    first = 0 if known is None else len(known)
    damping, count, age = 1e-3, 0, 0
    slopes: Array | None = None  # taken `age` steps ago
    innovation: Array | None = None
    absorbed: Absorption | None = None
    systems: list[tuple[Array, Array | None]] = []
    filter_ = filter_ or whitener(problem, error)
    scale = scaled = np.ones(0)
    lowest, kept = np.inf, (point, error, filter_)
    for turn in range(rounds):
        if turn:
            filter_ = whitener(problem, error)
        reached = criterion_at(problem, point, error, filter_)
        if reached < lowest:
            lowest, kept = reached, (point, error, filter_)
        left, jacobian, innovation = iterations, None, None
        for _ in range(ATTEMPTS * iterations):
            if innovation is None:
                innovation = filter_(error)
            if slopes is None or age >= REUSED:
                if not left:
                    break
                slopes, jacobian = sensitivities(problem, point, error, first=first), None
                if renewed and filter_.solution is not None and (known is None or absorbed is None):
                    absorbed = absorption(problem, error, filter_)
                age, left, count = 0, left - 1, count + 1
            if jacobian is None:
                jacobian = _jacobian(filter_, slopes, known)
                scale = weights(innovation, problem.joints)
                scaled = jacobian * scale
                systems = _systems(jacobian, scaled, np.diag(certainty), absorbed)
            now = point.vector
            away = now - centre
            base = float(np.sum((innovation * scale) ** 2) + away**2 @ certainty)
            gradient = scaled @ (innovation * scale) + certainty * away
            if not (np.all(np.isfinite(systems[0][0])) and np.all(np.isfinite(gradient)) and np.any(systems[0][0])):
                break
            trials = []
            for gram, follow in systems:
                diagonal = np.maximum(np.diag(gram), 1e-30 * max(np.max(np.diag(gram)), 1e-300))
                for factor in (damping * 0.1, damping * 100.0):
                    step = bounded_step(gram + factor * np.diag(diagonal), gradient, lower - now, upper - now)
                    vector = np.clip(now + step, lower, upper)
                    own = filter_ if follow is None else filter_.moved(follow @ (vector - now))
                    trials.append((factor, point.at(vector), own))
            outcomes = errors(problem, [trial for _, trial, _ in trials])
            filtered = each(
                lambda option: option[1][-1](option[0]) if problem.credible(option[0]) else None,
                zip(outcomes, trials, strict=True),
            )
            costs = [
                np.inf if own is None else float(np.sum((own * scale) ** 2) + (trial.vector - centre) ** 2 @ certainty)
                for own, (_, trial, _) in zip(filtered, trials, strict=True)
            ]
            best = int(np.argmin(costs))
            if not costs[best] < base:
                if age:
                    age = REUSED
                    continue
                if damping >= 1e3:
                    break
                damping *= 1e4
                continue
            damping = max(trials[best][0], 1e-7)
            point, error, filter_, innovation = trials[best][1], outcomes[best], trials[best][2], filtered[best]
            age += 1
            if costs[best] > base * (1.0 - tolerance):
                if (
                    age == 1 or turn < rounds - 1
                ):  # by the sensitivities of the point itself, or soon to be filtered anew
                    break
                age = REUSED
    if renewed:
        filter_ = whitener(problem, error)
    if criterion_at(problem, point, error, filter_) > lowest:
        (point, error, filter_), slopes = kept, None
    return finish(problem, point, error, filter_, count, known, slopes if age <= 1 else None)


def bounded_step(matrix: Array, gradient: Array, lower: Array, upper: Array) -> Array:
    """Minimum (P,) of ``g s + s M s / 2`` between bounds on the step s; M (P, P) is positive definite.

    What would go beyond a bound stays there, and the others take the best step beside it: if all went their way as if
    there were no bound, a valley that leads along it could only be followed in small steps.
    """
    root = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled, step = matrix / np.outer(root, root), np.zeros(len(gradient))
    moving = np.ones(len(gradient), dtype=bool)
    while np.any(moving):
        pull = (gradient[moving] + matrix[np.ix_(moving, ~moving)] @ step[~moving]) / root[moving]
        step[moving] = np.linalg.lstsq(scaled[np.ix_(moving, moving)], -pull, rcond=1e-13)[0] / root[moving]
        beyond = moving & ((step < lower) | (step > upper))
        if not np.any(beyond):
            break
        step[beyond] = np.clip(step, lower, upper)[beyond]
        moving &= ~beyond
    return step


def criterion_at(problem: Problem, point: Point, error: Array, filter_: Whitener) -> float:
    """`Fitted.criterion` of errors (T, n) behind a filter, without sensitivities."""
    return _criterion(point, error, filter_(error), filter_, rounding_floor(problem), problem.credible(error))


def _criterion(point: Point, error: Array, innovation: Array, filter_: Whitener, floor: Array, credible: bool) -> float:
    rows = innovation.reshape(len(filter_.coefficients), -1)
    spread = np.mean(rows**2, axis=1) if credible else np.mean(error**2, axis=0)
    began = float(np.sum(filter_.log_determinant))
    return float(rows.shape[1] * np.sum(np.log(spread + floor)) + began + point.contradicted)


def _systems(
    jacobian: Array, scaled: Array, prior: Array, absorbed: Absorption | None
) -> list[tuple[Array, Array | None]]:
    """Matrices (P, P) of the normal equations for sensitivities (P, N n): for a filter that stays, and for one that
    follows the parameters, which comes with the change (n, k, P) of its coefficients.

    scaled: the sensitivities over the innovations' rms.
    """
    found: list[tuple[Array, Array | None]] = [(scaled @ scaled.T + prior, None)]
    if absorbed is not None:
        some = absorbed.samples(scaled)
        rest = absorbed.left(some)
        share = some.shape[2] / (scaled.shape[1] / len(some))
        follow = absorbed.followed(absorbed.samples(jacobian))
        found.append((np.einsum("npr,nqr->pq", rest, rest, optimize=True) / share + prior, follow))
    return found


REUSED = 4
"""Steps that may be taken by the same sensitivities."""
ATTEMPTS = 4
"""Steps per computation of sensitivities that a fit may try on average."""


def _jacobian(filter_: Whitener, slopes: Array, known: Array | None) -> Array:
    """Whitened sensitivities (P, N n) of the known parameters, (K, T, n), and of the others, (P - K, T, n)."""
    return filter_(slopes) if known is None else np.vstack([filter_(known), filter_(slopes)])


def finish(
    problem: Problem,
    point: Point,
    error: Array,
    filter_: Whitener,
    count: int = 0,
    known: Array | None = None,
    slopes: Array | None = None,
) -> Fitted:
    """Innovations and, when asked for, sensitivities and covariance at a point; slopes: sensitivities that are good
    enough, if any."""
    innovation = filter_(error)

    def made() -> tuple[Array, Array]:
        first = 0 if known is None else len(known)
        own = sensitivities(problem, point, error, first=first) if slopes is None else slopes
        jacobian = _jacobian(filter_, own, known) * weights(innovation, problem.joints)
        gram = jacobian @ jacobian.T + np.diag(point.certainty)
        if np.all(np.isfinite(gram)):
            return jacobian, _inverse(gram)
        # a model that runs away determines nothing
        return np.zeros_like(jacobian), np.diag(np.full(len(gram), np.inf))

    return Fitted(
        point,
        error,
        innovation,
        filter_,
        Information(made),
        count,
        rounding_floor(problem),
        problem.credible(error),
    )


def _inverse(gram: Array) -> Array:
    """Inverse of an information matrix (P, P), silent about what it does not determine at all."""
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return np.asarray(np.linalg.pinv(gram / np.outer(size, size), rcond=SINGULAR) / np.outer(size, size))


def significance(values: Array, spread: Array) -> float:
    """Squared distance ``x' C^-1 x`` of values x (P,) from nothing, in standard deviations; spread: their covariance C
    (P, P)."""
    size = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    scaled = values / size
    return float(scaled @ np.linalg.pinv(spread / np.outer(size, size), hermitian=True) @ scaled)


def measured_precisely(problem: Problem, fitted: Fitted) -> Fitted:
    """The same fit with the covariance that the likelihood has with the best filter for every value of the parameters,
    from sensitivities of second order.

    Parameters can nearly stand in for one another, and the filter for them: in a closed loop, where noise comes back
    with the command, and where errors of the model look like slow noise. Then what a fixed filter tells of them is too
    much (`whitening.Absorption`).
    """
    slopes = precise_sensitivities(problem, fitted.point, fitted.error)
    precise = finish(problem, fitted.point, fitted.error, fitted.whitener, fitted.iterations, slopes=slopes)
    if fitted.whitener.solution is None or not np.all(np.isfinite(precise.covariance)):
        return precise
    absorbed = absorption(problem, fitted.error, fitted.whitener)
    gram, _ = _systems(precise.jacobian, precise.jacobian, np.diag(fitted.point.certainty), absorbed)[-1]
    return precise.informed(precise.jacobian, _inverse(gram))


def rounding_floor(problem: Problem) -> Array:
    """A quarter of the variance of the encoder's rounding, per joint (n,), whatever the filter.

    A joint that rests within one step of its encoder is predicted perfectly; such samples must not count as evidence.
    """
    return np.full(problem.joints, 0.25 * problem.encoder_step**2 / 12.0)


def covariance(fitted: Fitted, least: Mapping[str, float] = MappingProxyType({})) -> Array:
    """Covariance (P, P) of the free parameters: that of the fit, widened where the sandwich is wider than the inverse
    information C of a filter that stays.

    With scores s_k = j_k e_k (Jacobian times innovation) the sandwich is ``C (sum_l w_l sum_k s_k s_{k+l}') C``,
    Bartlett weights w over LAGS samples. least: standard deviations that parameters have at least, by their names.
    """
    scores = fitted.jacobian * (fitted.innovation * fitted.weights)
    length = scores.shape[1]
    # Bartlett weights are a triangle, the autocorrelation of a box: running sums of LAGS scores give the same matrix
    running = np.cumsum(np.pad(scores, ((0, 0), (LAGS, 0))), axis=1)
    blocks = running[:, LAGS:] - running[:, :length]
    meat = blocks @ blocks.T / LAGS
    own = fitted.plain_covariance
    wider = np.maximum(np.diag(own @ meat @ own) / np.maximum(np.diag(own), 1e-300), 1.0)
    variances = np.maximum(np.diag(fitted.covariance), 1e-300)
    known = np.array([least.get(f.name, 0.0) for f in fitted.point.free]) ** 2
    wider = np.sqrt(np.maximum(wider, known / variances))
    return fitted.covariance * np.outer(wider, wider)


def undetermined(fitted: Fitted) -> Array:
    """Covariance (P, P) along those directions of the free parameters that the data do not determine at all.

    Along each the parameters may be anywhere in their range, or within what is known of them beforehand, and where
    neither says anything off by any number. The inverse information, a pseudo-inverse, is silent about it. What shapes
    no prediction, and yet has a variance, is known from elsewhere: the jitter of the instants from the scatter of the
    errors.
    """
    certainty = fitted.point.certainty
    certainty[~np.any(fitted.jacobian, axis=1) & (np.diag(fitted.covariance) > 0.0)] = 1.0
    gram = fitted.jacobian @ fitted.jacobian.T + np.diag(certainty)
    size = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, axes = np.linalg.eigh(gram * np.outer(size, size))
    most = np.array([min((f.upper - f.lower) / math.sqrt(12.0), FAR * f.scale, f.deviation) for f in fitted.point.free])
    found = np.zeros_like(gram)
    for axis in axes.T[values < SINGULAR * values[-1]]:
        way = size * axis
        way *= np.min(most / np.maximum(np.abs(way), 1e-300))
        found += np.outer(way, way)
    return found
