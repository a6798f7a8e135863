"""Multiple shooting: where small causes grow, a model is fitted to many short pieces of the logs, each from a state of
its own.

Behind impacts the motion of a whole log depends on the parameters as irregularly as on noise. Over half a second only a
few blows follow one another, and if every piece begins in a state that is free, its errors are smooth functions of the
parameters: the fit goes straight to where the pieces agree. The states are eliminated piece by piece, so that many of
them cost hardly more than a few.

H. G. Bock, Recent advances in parameter identification techniques for ODE (1983); E. Baake et al., Fitting ordinary
differential equations to chaotic data, Physical Review A 45 (1992).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np

from diagnosis.estimation import Fitted, Point, bounded_step, errors, forward_steps
from diagnosis.glance import can_be_cut
from diagnosis.problem import Free, Problem
from diagnosis.replay import begun
from diagnosis.turns import free_of_filter
from envs.log import Array
from methods.kernel import BEGINNING, STATES
from methods.parallel import each

LENGTHS = (0.5, 0.25, 0.15)
"""Lengths of pieces [s] that are tried; all end with the first one."""
SHORTEST = 50
"""Least length in samples."""
SAMPLES = 60_000
"""Samples of all pieces at most; of longer logs they are spread evenly."""
STATE = tuple(BEGINNING.index(name) for name in ("angle", "velocity", "twist", "twist rate"))
"""What is free at the beginning of each piece."""
ANGLE, TORQUE = BEGINNING.index("angle"), BEGINNING.index("motor torque")
AS_GOOD = 0.1
"""Difference of the logarithms of mean square errors up to which pieces of other lengths agree as well."""
ITERATIONS = 12
"""Gauss-Newton steps at most."""
TURNS = 3
"""Most times that the pieces begin anew from the model that they have led to."""
STEP = 1e-3
"""Step of finite differences, as a share of a parameter's scale."""
FACTORS = (0.01, 1.0, 100.0)
"""Dampings tried at once, over the last one that led on."""
ENOUGH = 1e-5
"""Relative decrease of the sum of squares below which a fit ends."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A fit of whole logs that multiple shooting led to, and the standard deviations of the parameters by their names
    that the pieces tell; none of the fit that it began from."""

    fitted: Fitted
    deviations: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Agreement:
    """What pieces agree on: values of the free parameters and their standard deviations, by their names, and the sum
    over joints of the logarithms of the mean square errors."""

    values: Mapping[str, float]
    deviations: Mapping[str, float]
    square: float


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of logs as logs of their own, the model there, and what is free: parameters (G), and the states that every
    piece has, with their typical size (n, 4)."""

    problem: Problem
    point: Point
    free: tuple[Free, ...]
    size: Array


def shot(problem: Problem, fitted: Fitted) -> list[Shot]:
    """The fit, and those of whole logs that multiple shooting leads to from it, as long as they get better; the fit
    alone where the model depends on what came before, or something of it is of one log only."""
    found = [Shot(fitted)]
    for _ in range(TURNS if can_be_cut(problem, fitted.point) else 0):
        told = each(partial(led, problem, found[-1].fitted.point), LENGTHS)
        agreement = min(told, key=lambda own: own.square)
        whole = free_of_filter(problem, fitted.point.taking(agreement.values))
        is_better = whole.criterion < best_of(found).criterion - 1.0
        found.append(Shot(whole, spread(agreement, told)))
        if not is_better:
            break
    return found


def led(problem: Problem, point: Point, seconds: float) -> Agreement:
    """What pieces of the first of `LENGTHS` agree on, begun from what pieces of this length do."""
    agreement = agreed(cut(problem, point, seconds))
    if seconds == LENGTHS[0]:
        return agreement
    return agreed(cut(problem, point.taking(agreement.values)))


def spread(best: Agreement, others: Sequence[Agreement]) -> dict[str, float]:
    """Standard deviations of the parameters by their names: those of the best agreement, and its rms distance from
    those that err as little."""
    near = [own for own in others if own.square < best.square + AS_GOOD]
    apart = {name: np.mean([(own.values[name] - value) ** 2 for own in near]) for name, value in best.values.items()}
    return {name: float(np.hypot(own, np.sqrt(apart[name]))) for name, own in best.deviations.items()}


def best_of(shots: Sequence[Shot]) -> Fitted:
    """The likeliest of the fits."""
    return min((own.fitted for own in shots), key=lambda fitted: fitted.criterion)


def cut(problem: Problem, point: Point, seconds: float = LENGTHS[0]) -> Pieces:
    """Pieces of a length [s] that begin in the states of the observer, of a model that can be cut."""
    width = max(round(seconds / problem.sample_time), SHORTEST)
    share = min(1.0, SAMPLES / len(problem.time))
    rows, starts, owners = [], [], []
    for log, (a, b) in enumerate(pairwise(problem.bounds.tolist())):
        early = min(int(np.argmax(problem.used[a:b])), max(b - a - width, 0))
        count = max(1, int(share * (b - a - early) / width))
        begins = np.unique(np.linspace(early, max(b - a - width, early), count).astype(int))
        for begin, state in zip(begins, _states(problem, point, log, begins), strict=True):
            rows.append(np.arange(a + begin, min(a + begin + width, b)))
            starts.append(state)
            owners.append(log)
    beginning = np.array(starts)
    part = problem.part(np.concatenate(rows), np.cumsum([0, *map(len, rows)]), beginning)
    size = np.std(beginning[:, :, STATE], axis=0)
    size[:, STATE.index(ANGLE)] = np.std(np.diff(problem.reading, axis=0), axis=0)
    own = replace(point, parameters=point.parameters[owners], starts=beginning, free=())
    return Pieces(replace(part, burn_in=0.0), own, tuple(f for f in point.free if f.log < 0), np.maximum(size, 1e-12))


def _states(problem: Problem, point: Point, log: int, begins: np.ndarray) -> list[Array]:
    """The states of the model's observer at some samples of a log, (n, 6) each as in `BEGINNING`."""
    n, (a, b) = problem.joints, problem.bounds[log : log + 2]
    signals, model, (states, bristles) = begun(problem, point, log, problem.reading)
    parameters, switches = model[:2]
    module, scratch, none, found, at = problem.kernel.module, np.zeros((b - a, n)), np.zeros((0, n, 3)), [], 0
    motor, arm = [module.Q, module.DQ], [module.QL, module.DQL]
    for begin in begins:
        pull = (problem.leak, problem.rate_leak, problem.substeps)
        module.advance(at, begin, *signals, none[:, :, 0], states, bristles, *model, *pull, scratch, none)
        at, start, hanging = begin, np.zeros((n, len(BEGINNING))), np.zeros((n, STATES))
        for j in range(n):
            start[j, :2] = states[j, arm if module._load_side(switches[j]) else motor]
        start[:, TORQUE] = states[:, module.W]
        module.begin(start, signals[1][begin], hanging, parameters, switches)
        twist = states[:, motor] - states[:, arm] - (hanging[:, motor] - hanging[:, arm])
        start[:, [BEGINNING.index("twist"), BEGINNING.index("twist rate")]] = twist
        found.append(start)
    return found


def agreed(pieces: Pieces) -> Agreement:
    """The values of the free parameters that suit all pieces best, each from the state that suits it best.

    Levenberg-Marquardt on the errors as they are, of each joint over their rms. A state is held by its typical size
    about the observer's. The deviations are those of independent pieces, whatever the errors do within one: with the
    gradients g of the pieces and the matrix H of all, their states eliminated, ``H^-1 (sum g g') H^-1``.
    """
    problem, point = pieces.problem, replace(pieces.point, free=pieces.free)
    centre = np.array([f.centre for f in pieces.free])
    certainty = point.certainty
    lower, upper = point.bounds
    observed = _state_of(pieces.point)
    held = 1.0 / np.tile(pieces.size.ravel(), (problem.logs, 1)) ** 2
    error = errors(problem, [point])[0]
    damping = 1e-3
    for _ in range(ITERATIONS):
        scale = 1.0 / np.maximum(np.sqrt(np.mean(error**2, axis=0)), 1e-300)
        cost = lambda error, point: (  # noqa: E731
            np.sum((error * scale) ** 2)  # noqa: B023
            + (point.vector - centre) ** 2 @ certainty
            + np.sum((_state_of(point) - observed) ** 2 * held)
        )
        before = cost(error, point)
        slopes = _slopes(pieces, point, error) * scale
        gram, gradient = _blocks(problem, slopes, error * scale)
        count = len(pieces.free)
        gradient[:, count:] += held * (_state_of(point) - observed)
        prior = certainty * (point.vector - centre)
        room = lower - point.vector, upper - point.vector
        trials = []
        for factor in FACTORS:
            own, states = _step(gram, gradient, certainty, prior, held, damping * factor, room)
            moved = point.within(point.vector + own)
            trials.append((damping * factor, _at_states(moved, _state_of(point) + states)))
        outcomes = errors(problem, [trial for _, trial in trials])
        costs = [
            cost(outcome, trial) if problem.credible(outcome) else np.inf
            for outcome, (_, trial) in zip(outcomes, trials, strict=True)
        ]
        best = int(np.argmin(costs))
        if not costs[best] < before:
            if damping >= 1e3:
                break
            damping *= 1e3
            continue
        damping, point, error = max(trials[best][0], 1e-6), trials[best][1], outcomes[best]
        if costs[best] > before * (1.0 - ENOUGH):
            break
    squares = np.maximum(np.mean(error**2, axis=0), 1e-300)
    deviations = _deviations(gram, gradient, certainty, held)
    told = dict(zip((f.name for f in pieces.free), deviations.tolist(), strict=True))
    return Agreement(point.values, told, float(np.sum(np.log(squares))))


def _state_of(point: Point) -> Array:
    """The free states of all pieces, (K, 4 n)."""
    return point.starts[:, :, STATE].reshape(len(point.starts), -1)


def _at_states(point: Point, states: Array) -> Point:
    """The same model with pieces that begin in other states."""
    starts = point.starts.copy()
    starts[:, :, STATE] = states.reshape(len(starts), -1, len(STATE))
    return replace(point, starts=starts)


def _slopes(pieces: Pieces, point: Point, error: Array) -> Array:
    """Derivatives (G + 4 n, T, n) of the errors by the parameters, and by the states of all pieces at once."""
    steps = forward_steps(point, STEP)
    moved = [point.at(point.vector + row) for row in np.diag(steps)]
    own = STEP * pieces.size.ravel()
    moved += [_at_states(point, _state_of(point) + row) for row in np.diag(own)]
    return (errors(pieces.problem, moved) - error) / np.array([*steps, *own])[:, None, None]


def _blocks(problem: Problem, slopes: Array, error: Array) -> tuple[Array, Array]:
    """Normal equations of every piece: matrices (K, P, P) and gradients (K, P)."""
    grams, gradients = [], []
    for a, b in pairwise(problem.bounds):
        rows = slopes[:, a:b].reshape(len(slopes), -1)
        grams.append(rows @ rows.T)
        gradients.append(rows @ error[a:b].ravel())
    return np.array(grams), np.array(gradients)


def _step(
    gram: Array,
    gradient: Array,
    certainty: Array,
    prior: Array,
    held: Array,
    damping: float,
    room: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Damped step of the parameters (G,) and of the states of all pieces (K, S), these eliminated (Schur complement).

    certainty (G,) and held (K, S): what is known beforehand of parameters and states. room: least and largest step of
    each parameter.
    """
    matrix, towards, mixed, inverse = _eliminated(gram, gradient, certainty, held, damping)
    step = bounded_step(matrix, towards.sum(axis=0) + prior, *room)
    rest = gradient[:, len(certainty) :] + np.einsum("kgs,g->ks", mixed, step)
    return step, -np.einsum("kst,kt->ks", inverse, rest)


def _eliminated(
    gram: Array, gradient: Array, certainty: Array, held: Array, damping: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The matrix (G, G) of all pieces and the gradient of each (K, G) with the states eliminated; the pieces' mixed
    blocks (K, G, S), and the inverse of those of the states (K, S, S)."""
    count, states = len(certainty), np.arange(held.shape[1])
    both, mixed, own = gram[:, :count, :count].sum(axis=0), gram[:, :count, count:], gram[:, count:, count:].copy()
    own[:, states, states] = (own[:, states, states] + held) * (1.0 + damping)
    both[np.diag_indices(count)] = (np.diag(both) + certainty) * (1.0 + damping)
    inverse = np.linalg.inv(own)
    pulled = np.einsum("kgs,kst->kgt", mixed, inverse, optimize=True)
    matrix = both - np.einsum("kgs,khs->gh", pulled, mixed, optimize=True)
    return matrix, gradient[:, :count] - np.einsum("kgs,ks->kg", pulled, gradient[:, count:]), mixed, inverse


def _deviations(gram: Array, gradient: Array, certainty: Array, held: Array) -> Array:
    """Standard deviations of the parameters (G,) by how much the pieces differ, see `agreed`."""
    matrix, towards, _, _ = _eliminated(gram, gradient, certainty, held)
    root = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.pinv(matrix / np.outer(root, root), rcond=1e-13) / np.outer(root, root)
    return np.sqrt(np.maximum(np.diag(inverse @ (towards.T @ towards) @ inverse), 0.0))
