"""What these logs can tell: at what magnitude each effect would be seen, and which effects look alike.

Every effect is put into the final model at a trial size; its whitened response is freed of what nominal parameters and
the effects already named can imitate. The energy that is left, over the variance of the innovations, is the expected
decrease of -2 log likelihood (the noncentrality of the likelihood-ratio test); an effect that is x times as large has
x^2 times that energy. What is large enough for that may still be put down to inexact laws of the effects that are
there. Two effects are told apart by the part of one response that lies outside the span of the other's.

Source: L. Ljung, System Identification, 1999, section 16; the angle between subspaces is that of G. Golub, C. Van Loan,
Matrix Computations, section 6.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.choice import least_of_all
from diagnosis.estimation import Fitted, Point, errors, finish
from diagnosis.finding import Finding
from diagnosis.hypotheses import Hypothesis, extend, sizes_of
from diagnosis.problem import Problem
from diagnosis.replay import stretch
from diagnosis.result import Confusable, Isolability
from diagnosis.settings import TYPICAL, Settings
from diagnosis.whitening import on_logs
from envs.log import Array
from methods.effects.base import Effect, Scales
from methods.kernel import NOMINAL

STRETCH = 10.0
"""Length of the stretch of the first log on which responses are computed [s]; the rest is taken to be like it."""
SHAPES = 2
"""Trial shapes per effect: the easiest and the hardest to see of its starting values bound the answer."""
ROUNDING = 1e-9
"""Share of a response's energy below which what the nominal parameters leave of it is what arithmetic leaves."""


@dataclass(frozen=True, eq=False)
class Response:
    """What one effect at trial size does: whitened columns (K, N) in standard deviations, freed of the nominal ones.

    direction: their sum, the response at the trial size. share: its torque relative to the command's rms. whole: the
    energy of the response before it was freed.
    """

    effect: Effect
    columns: Array
    direction: Array
    share: float
    whole: float

    @property
    def energy(self) -> float:
        """Expected decrease of -2 log likelihood at trial size."""
        return float(self.direction @ self.direction)


def isolability(
    problem: Problem, finding: Finding, j: int, joint: int, effects: Sequence[Effect], settings: Settings
) -> tuple[tuple[Isolability, ...], tuple[Confusable, ...]]:
    """Thresholds per effect for joint index j, and the pairs that cannot be told apart at a typical size."""
    part, ratio = stretch(problem, STRETCH)
    base = on_stretch(part, finding.final)
    command = float(np.sqrt(np.mean(part.command[part.used, j] ** 2)))
    named = {item.label for item in finding.accepted if item.joint == j}
    effects = [effect for effect in effects if not effect.kind]
    candidates = [effect for effect in effects if effect.name not in named]
    found = responses(part, base, candidates, j)
    count = finding.final.samples
    rows: list[Isolability] = []
    pairs: dict[frozenset[str], Confusable] = {}
    best = {r.effect.name: r for r in sorted(found, key=lambda r: r.energy / max(r.share, 1e-12) ** 2)}
    degrees = dict(zip(best, angles(list(best.values())).tolist(), strict=True))
    for effect in effects:
        if effect.name in named:
            continue
        response = best.get(effect.name)
        if response is None or not response.energy > ROUNDING * response.whole:
            rows.append(Isolability(effect.name, joint, None, None, None, None))
            continue
        price = effect.size * np.log(count)
        size = least_size(response, response.energy * ratio, price, finding, j, settings)
        apart = {name: own for name, own in zip(best, degrees[effect.name], strict=True) if name != effect.name}
        nearest = min(apart, key=lambda name: apart[name], default=None)
        rows.append(
            Isolability(
                effect=effect.name,
                joint=joint,
                threshold=size * response.share * command,
                share=size * response.share,
                nearest=nearest,
                separation=None if nearest is None else apart[nearest],
            )
        )
        typical = response.energy * ratio * (TYPICAL / max(response.share, 1e-12)) ** 2
        for name, own in apart.items():
            left = typical * np.sin(np.radians(own)) ** 2
            if left < settings.rival and typical > settings.threshold + price:
                key = frozenset((effect.name, name))
                if key not in pairs or own < pairs[key].separation:
                    pairs[key] = Confusable(effect.name, name, joint, own)
    return tuple(rows), tuple(sorted(pairs.values(), key=lambda pair: pair.separation))


def least_size(response: Response, energy: float, price: float, finding: Finding, j: int, settings: Settings) -> float:
    """Least multiple of its trial size from which an effect on joint index j would be taken.

    It has to be more than noise, and than what the search puts down to inexact laws of the effects that are there
    (`diagnosis.choice.least_of_all`), unless it explains a good part of all. energy: of its response in all logs.
    """
    explained = finding.nominal.criterion - finding.final.criterion if finding.accepted else 0.0
    known = (settings.threshold + price) / energy
    certain = float(np.sqrt(max(known, settings.minor * explained / energy)))
    evidence = energy * certain**2 - price
    beside = least_of_all(response.effect, j, evidence, finding.accepted, settings) / max(response.share, 1e-300)
    large = np.sqrt(max(known, settings.inexact * explained / energy))
    return min(max(certain, beside), max(float(large), settings.faint / max(response.share, 1e-300)))


def on_stretch(part: Problem, fitted: Fitted) -> Fitted:
    """The fit's model and whitening filter on a stretch, with its sensitivities there."""
    point = fitted.point
    free = tuple(f for f in point.free if f.log <= 0)
    point = replace(point, parameters=point.parameters[:1], starts=point.starts[:1], free=free)
    return finish(part, point, errors(part, [point])[0], on_logs(part, fitted.whitener))


def responses(part: Problem, base: Fitted, effects: Sequence[Effect], j: int) -> list[Response]:
    """Freed responses of every trial shape of every effect on joint index j."""
    size = sizes_of(part, base)[j]
    point = _with_reference(base.point, j, size)
    trials: list[tuple[Effect, list[Point]]] = []
    for effect in effects:
        for values in shapes(effect, size):
            full = np.tile(np.array(values, dtype=float), (1, 1))
            singles = []
            for a in effect.amplitudes or (None,):
                single = full.copy()
                for other in effect.amplitudes:
                    if a is not None and other != a:
                        single[:, other] = 0.0
                singles.append(extend(part, point, Hypothesis(effect, j), single))
            trials.append((effect, singles))
    points = [p for _, singles in trials for p in singles]
    if not points:
        return []
    extra = np.zeros((2, len(part.time), part.joints))
    extra[1, :, j] = 0.01 * part.command[:, j]
    known = errors(part, [base.point, base.point], extra=extra)
    reference = _rms((known[1] - known[0])[part.used, j])
    difference = errors(part, points) - base.error
    scale = np.repeat(1.0 / np.sqrt(base.variances), base.innovation.size // part.joints)
    whitened = base.whitener(difference) * scale
    freed = outside(base.jacobian, whitened)
    found, at = [], 0
    for effect, singles in trials:
        own = slice(at, at + len(singles))
        at += len(singles)
        if not np.all(np.isfinite(difference[own])) or np.max(np.abs(difference[own])) > 1e5:
            continue
        share = 0.01 * _rms(difference[own].sum(axis=0)[part.used, j]) / max(reference, 1e-300)
        direction, whole = freed[own].sum(axis=0), float(np.sum(whitened[own].sum(axis=0) ** 2))
        found.append(Response(effect, freed[own], direction, share, whole))
    return found


def shapes(effect: Effect, size: Scales) -> list[tuple[float, ...]]:
    """A few parameter vectors of an effect: of its starting values, or of the range that its scan covers."""
    torque = 0.02 * size.torque_rms
    if effect.scan == "time":
        return [(torque, torque, hertz) for hertz in (1.0, 5.0)]
    if effect.scan == "position":
        amplitude = torque if effect.slot == "torque" else 0.02
        return [(amplitude, amplitude, periods * 2 * np.pi / max(size.position_span, 1e-12)) for periods in (4.0, 16.0)]
    if effect.scan == "event":
        middle = 0.4 * size.duration
        return [(torque, middle, 0.1, 0.3)] if effect.name == "collision" else [(0.02 * size.inertia, middle)]
    every = list(effect.starts(size)) if effect.starts is not None else []
    return every[:: max(1, -(-len(every) // SHAPES))][:SHAPES]


def outside(basis: Array, vectors: Array) -> Array:
    """The part of vectors (K, N) outside the span of basis (P, N)."""
    if not len(basis):
        return vectors
    scaled = basis / np.maximum(np.linalg.norm(basis, axis=1, keepdims=True), 1e-300)
    gram = scaled @ scaled.T
    coefficients = np.linalg.lstsq(gram, scaled @ vectors.T, rcond=1e-10)[0]
    result: Array = vectors - coefficients.T @ scaled
    return result


def angles(found: Sequence[Response]) -> Array:
    """Angle [degrees] between each effect's response and the span of each other's (M, M).

    With the unit response d and unit vectors U that span the other's, its cosine squared is ``d U' (U U')^-1 U d'``.
    """
    if not found:
        return np.zeros((0, 0))
    directions = np.stack([r.direction / max(float(np.linalg.norm(r.direction)), 1e-300) for r in found])
    inside = []
    for r in found:
        units = r.columns / np.maximum(np.linalg.norm(r.columns, axis=1, keepdims=True), 1e-300)
        inner = units @ directions.T
        inside.append(np.sum(inner * np.linalg.lstsq(units @ units.T, inner, rcond=1e-10)[0], axis=0))
    left = np.maximum(np.sum(directions**2, axis=1)[:, None] - np.stack(inside, axis=1), 0.0)
    return np.asarray(np.degrees(np.arcsin(np.minimum(np.sqrt(left), 1.0))))


def _with_reference(point: Point, j: int, size: Scales) -> Point:
    """The point with the mean square motor torque filled in, by which thermal effects are normalised."""
    parameters = point.parameters.copy()
    parameters[:, j, NOMINAL.index("torque_square_mean")] = max(size.torque_rms**2, 1e-300)
    return replace(point, parameters=parameters)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
