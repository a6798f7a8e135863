"""Estimation on free simulation in short windows: the judge of this folder, independent of the diagnosis' likelihood.

Every log is cut into windows that begin in the measured state; the compiled kernel runs freely through each, and the
rms distance from the measured position is minimised over the free parameters. Nothing pulls the simulation towards the
measurement inside a window, so a biased regression (noisy velocity, small net torque near resonance) finds no excuse.

Standard deviations are those of the sandwich with whole windows as clusters, which holds for coloured errors too
(K.-Y. Liang, S. Zeger, Biometrika 73 (1986) 13).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from diagnosis.problem import Problem, stack
from envs.log import Array, Log
from methods.effects import built_in
from methods.effects.base import Effect
from methods.kernel import BEGINNING, NOMINAL, Kernel, build

SMOOTHING = 0.03
"""Length of the local cubic fit that gives the state at the beginning of a window [s]."""
LONGEST_STEP = 2e-3
"""Step of the integration, about [s]."""
STEP = 2e-3
"""Relative step of the finite differences; dry friction makes smaller ones rough."""
SCREENING, CONTESTED, CONTEST = 4, 3, 10
"""Evaluations for every candidate of a ladder, how many of the best are compared further, and with how many more."""
SIGNIFICANT = 3.0
"""Standard deviations by which an effect's amplitude has to differ from zero."""


@cache
def kernel() -> Kernel:
    """The compiled simulator with every built-in effect."""
    return build(built_in())


@dataclass(frozen=True)
class Free:
    """One free parameter of a model: a nominal parameter or one of an effect, on a joint (index), or of the coupling.

    owner: ``nominal``, ``coupling`` or the name of an effect. begin: where the search starts; scale: its typical size.
    """

    owner: str
    name: str
    begin: float
    joint: int = 0
    scale: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf

    @property
    def label(self) -> str:
        """``coulomb_friction.torque`` or ``inertia``."""
        return self.name if self.owner in ("nominal", "coupling") else f"{self.owner}.{self.name}"

    @property
    def size(self) -> float:
        """Scale of the search."""
        return self.scale or abs(self.begin) or 1e-3


COUPLING = ("coupling_inertia", "unit_ratio", "shared_inertia")
"""Parameters of a planar pair in the order of the kernel."""


@dataclass(frozen=True, eq=False)
class Model:
    """Free parameters with values, and their covariance (P, P) where it was estimated."""

    free: tuple[Free, ...]
    values: Array
    covariance: Array | None = None

    @classmethod
    def of(cls, free: Sequence[Free]) -> Model:
        """A model at its starting values."""
        return cls(tuple(free), np.array([f.begin for f in free], dtype=float))

    @property
    def deviations(self) -> Array:
        """Standard deviations (P,); NaN without a covariance."""
        if self.covariance is None:
            return np.full(len(self.free), np.nan)
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def value(self, label: str, joint: int = 0) -> float:
        """Value of a parameter by its label. Raises ValueError when the model has none."""
        return float(self.values[[(f.label, f.joint) for f in self.free].index((label, joint))])

    def deviation(self, label: str, joint: int = 0) -> float:
        """Standard deviation of a parameter by its label."""
        return float(self.deviations[[(f.label, f.joint) for f in self.free].index((label, joint))])

    def extended(self, more: Sequence[Free]) -> Model:
        """The same model with more parameters, at their starting values."""
        begins = np.array([f.begin for f in more], dtype=float)
        return Model((*self.free, *more), np.concatenate([self.values, begins]))


def effect(name: str) -> Effect:
    """A built-in effect by its name."""
    return kernel().effects[kernel().switches[name]]


def free_of(name: str, begins: Sequence[float | None], joint: int = 0) -> tuple[Free, ...]:
    """Parameters of an effect as free ones, with the effect's own bounds; None leaves one at zero.

    Zero is for parameters that a nominal parameter already stands for, such as a constant torque beside a load.
    """
    return tuple(
        Free(name, p.name, begin, joint, lower=p.lower, upper=p.upper)
        for p, begin in zip(effect(name).parameters, begins, strict=True)
        if begin is not None
    )


def windows(
    logs: Sequence[Log],
    joints: tuple[int, ...],
    seconds: float | None,
    *,
    pair: bool = False,
    simulator: Kernel | None = None,
) -> Problem:
    """Logs cut into windows of some seconds (None: each log as a whole), each from the measured state.

    Position and velocity at the beginning of a window come from a local cubic fit; the rest of a log that does not fill
    a window is left out.
    """
    problem = stack(simulator or kernel(), logs, joints, pair=pair, neighbours=False, burn_in=0.0)
    problem = replace(problem, substeps=max(1, round(problem.sample_time / LONGEST_STEP)))
    if seconds is None:
        return replace(problem, starts=_states(problem, problem.bounds[:-1]))
    width = max(8, round(seconds / problem.sample_time))
    keep, bounds, begins = [], [0], []
    for a, b in pairwise(problem.bounds):
        for begin in range(a, b - width + 1, width):
            keep.append(np.arange(begin, begin + width))
            bounds.append(bounds[-1] + width)
            begins.append(begin)
    if not keep:
        raise ValueError(f"no log is as long as a window of {seconds} s")
    rows = np.concatenate(keep)
    near = problem.neighbour
    return replace(
        problem,
        time=problem.time[rows],
        command=np.ascontiguousarray(problem.command[rows]),
        reading=np.ascontiguousarray(problem.reading[rows]),
        bounds=np.array(bounds),
        neighbour=near[rows] if len(near) else near,
        names=tuple(f"window {i + 1}" for i in range(len(begins))),
        starts=_states(problem, np.array(begins)),
    )


def _states(problem: Problem, begins: np.ndarray) -> Array:
    """Position and velocity at samples of a problem, in what a joint begins with (`methods.kernel.BEGINNING`), the rest
    of which is zero, (L, n, 6)."""
    states = np.zeros((len(begins), problem.joints, len(BEGINNING)))
    for a, b in pairwise(problem.bounds):
        mine = (begins >= a) & (begins < b)
        dt = float(np.median(np.diff(problem.time[a:b])))
        span = min(max(7, 2 * round(0.5 * SMOOTHING / dt) + 1), (b - a - 1) // 2 * 2 + 1)
        for order in range(2):
            smooth = savgol_filter(problem.reading[a:b], span, 3, deriv=order, delta=dt, axis=0)
            states[mine, :, order] = smooth[begins[mine] - a]
    return states


def errors(problem: Problem, model: Model, values: Array | None = None) -> Array:
    """Measured minus simulated position (C, T, n) of candidates `values` (C, P); of the model itself when left out."""
    values = np.atleast_2d(model.values if values is None else values)
    count, kernel_ = len(values), problem.kernel
    parameters = np.zeros((count, problem.logs, problem.joints, kernel_.columns))
    parameters[..., NOMINAL.index("torque_square_mean")] = 1.0
    switches = np.zeros((count, problem.joints, len(kernel_.effects)), dtype=bool)
    rigid = np.tile([0.0, 1.0, 0.0], (count, 1))
    for i, f in enumerate(model.free):
        if f.owner == "coupling":
            rigid[:, COUPLING.index(f.name)] = values[:, i]
            continue
        if f.owner == "nominal":
            column = NOMINAL.index(f.name)
        else:
            names = [p.name for p in kernel_.effects[kernel_.switches[f.owner]].parameters]
            column = kernel_.offsets[f.owner] + names.index(f.name)
            switches[:, f.joint, kernel_.switches[f.owner]] = True
        parameters[:, :, f.joint, column] = values[:, i, None]
    starts = np.tile(problem.starts, (count, 1, 1, 1))
    return problem.errors(parameters, switches, rigid, starts, leak=False)


def fit(problem: Problem, model: Model, evaluations: int = 40) -> Model:
    """The model with the values that minimise the sum of squared errors, joints weighted by the range of their motion.

    Levenberg-Marquardt inside the bounds (trust region reflective), Jacobian by forward differences.
    """
    scale = np.array([f.size for f in model.free])
    lower, upper = (np.array([getattr(f, end) for f in model.free]) / scale for end in ("lower", "upper"))
    weight = 1.0 / np.std(problem.reading, axis=0)

    def residual(z: Array) -> Array:
        return (errors(problem, model, z * scale)[0] * weight).T.ravel()

    def jacobian(z: Array) -> Array:
        steps = np.where(z + STEP > upper, -STEP, STEP)
        moved = errors(problem, model, (z + np.diag(steps)) * scale)
        base = errors(problem, model, z * scale)
        found = (moved - base) * weight / steps[:, None, None]
        return found.transpose(2, 1, 0).reshape(-1, len(z))

    begin = np.clip(model.values / scale, lower + 1e-9, upper - 1e-9)
    found = least_squares(residual, begin, jacobian, bounds=(lower, upper), max_nfev=evaluations, xtol=1e-7, ftol=1e-7)
    return Model(model.free, found.x * scale, _clustered(problem, found.fun, jacobian(found.x), scale))


def _clustered(problem: Problem, residual: Array, jacobian: Array, scale: Array) -> Array:
    """Sandwich covariance with windows (or, where these are few, tenths of logs) as clusters."""
    bread = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12)
    edges = list(problem.bounds)
    if len(edges) < 21:
        edges = sorted({int(e) for a, b in pairwise(edges) for e in np.linspace(a, b, 11)})
    meat = np.zeros_like(bread)
    total = len(problem.time)
    for a, b in pairwise(edges):
        rows = np.concatenate([np.arange(a, b) + j * total for j in range(problem.joints)])
        score = jacobian[rows].T @ residual[rows]
        meat += np.outer(score, score)
    clusters = len(edges) - 1
    meat *= clusters / max(1, clusters - jacobian.shape[1])
    return bread @ meat @ bread * np.outer(scale, scale)


def rms(error: Array) -> Array:
    """Root mean square per joint, (n,), of errors (T, n)."""
    found: Array = np.sqrt(np.mean(error**2, axis=0))
    return found


def score(problem: Problem, model: Model) -> Array:
    """Rms distance of the free simulation per joint, (n,) [rad or m]."""
    return rms(errors(problem, model)[0])


@dataclass(frozen=True, eq=False)
class Step:
    """One model of a ladder with its errors on the windows that were fitted and on those that were not, each (n,)."""

    name: str
    model: Model
    fitted: Array
    held_out: Array


def ladder(
    fitted: Problem,
    held_out: Problem,
    base: Model,
    candidates: Sequence[tuple[str, Sequence[tuple[Free, ...]]]],
    *,
    least: float = 0.02,
    limit: int = 4,
) -> tuple[list[Step], list[tuple[str, str, float]]]:
    """Effects one after the other, each time the one that lowers the error of the fitted windows most.

    candidates: name and alternative starting points of each effect. A step has to lower the rms error of the fitted
    windows by `least`, half of that again when the model is fitted on every other window and judged on the others, and
    its size has to be determined. Of two effects one of which contains the other, the simpler one is taken where the
    rest of the richer one is not determined. Held-out windows are only looked at for the figures. Returns the steps
    and (step, candidate, relative decrease) of everything that was tried.
    """
    weight = 1.0 / np.std(fitted.reading, axis=0)
    total = lambda p, m: float(np.sqrt(np.mean((errors(p, m)[0] * weight) ** 2)))  # noqa: E731
    odd, even = halves(fitted)
    model = fit(fitted, base)
    steps = [Step("refitted", model, score(fitted, model), score(held_out, model))]
    tried: list[tuple[str, str, float]] = []
    left = list(candidates)
    while left and len(steps) <= limit:
        now = total(fitted, model)
        rough = []
        for name, starts in left:
            options = [fit(fitted, model.extended(start), SCREENING) for start in starts]
            best = min(options, key=lambda option: total(fitted, option))
            rough.append((total(fitted, best), name, best))
        rough.sort(key=lambda item: item[0])
        found = []
        for _, name, start in rough[:CONTESTED]:
            better = fit(fitted, start, CONTEST)
            found.append((total(fitted, better), name, better))
        tried += [(f"step {len(steps)}", name, 1.0 - value / now) for value, name, _ in (*found, *rough[CONTESTED:])]
        for value, name, better in sorted(found, key=lambda item: item[0]):
            if value > (1.0 - least) * now:
                return steps, tried
            gains = []
            for learn, judge in ((odd, even), (even, odd)):
                with_it, without = (total(judge, fit(learn, start, CONTEST)) for start in (better, model))
                gains.append(1.0 - with_it / without)
            if min(gains) < 0.5 * least or not determined(better, name):
                continue
            simple, shorter = simpler(fitted, model, better, name)
            if shorter is not None and total(fitted, shorter) < (1.0 - least) * now:
                name, better = simple, shorter
            model = fit(fitted, better)
            steps.append(Step(f"+ {name}", model, score(fitted, model), score(held_out, model)))
            left = [item for item in left if item[0] != name]
            break
        else:
            return steps, tried
    return steps, tried


def simpler(fitted: Problem, model: Model, better: Model, name: str) -> tuple[str, Model | None]:
    """What an effect contains (bristles contain Coulomb friction) in its place where nothing of the rest is determined.

    Returns the name and the model with the simpler effect, from the values of the richer one; None where there is none.
    """
    spreads = zip(better.free, better.values, better.deviations, strict=True)
    own = [(f, float(v), float(s)) for f, v, s in spreads if f.owner == name]
    for included in effect(name).includes:
        wanted = {p.name for p in effect(included).parameters}
        kept = tuple(replace(f, owner=included, begin=v, scale=0.0) for f, v, _ in own if f.name in wanted)
        rest = any(abs(v) > SIGNIFICANT * s for f, v, s in own if f.name not in wanted)
        if not rest and {f.name for f in kept} == wanted:
            return included, fit(fitted, Model(model.free, better.values[: len(model.free)]).extended(kept))
    return name, None


def determined(model: Model, name: str) -> bool:
    """Whether the size of an effect is different from zero beyond doubt."""
    amplitudes = effect(name).amplitudes or (0,)
    names = {effect(name).parameters[a].name for a in amplitudes}
    return any(
        abs(value) > SIGNIFICANT * spread
        for f, value, spread in zip(model.free, model.values, model.deviations, strict=True)
        if f.owner == name and f.name in names
    )


def halves(problem: Problem) -> tuple[Problem, Problem]:
    """Every other window."""
    return tuple(_some(problem, range(first, problem.logs, 2)) for first in (0, 1))  # type: ignore[return-value]


def _some(problem: Problem, which: Sequence[int]) -> Problem:
    """Some windows of a problem."""
    rows = np.concatenate([np.arange(problem.bounds[i], problem.bounds[i + 1]) for i in which])
    lengths = [problem.bounds[i + 1] - problem.bounds[i] for i in which]
    near = problem.neighbour
    return replace(
        problem,
        time=problem.time[rows],
        command=np.ascontiguousarray(problem.command[rows]),
        reading=np.ascontiguousarray(problem.reading[rows]),
        bounds=np.cumsum([0, *lengths]),
        neighbour=near[rows] if len(near) else near,
        names=tuple(problem.names[i] for i in which),
        starts=problem.starts[list(which)],
    )
