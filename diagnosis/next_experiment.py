"""Which experiment would tell most: a few excitations, simulated on the extended model, compared by information.

While two names compete, the best experiment is the one in which their responses differ most (largest expected decrease
of -2 log likelihood by the right one). Where no names compete, or no experiment separates them, it is the one that
sharpens the least certain parameter of the named effects, or of the nominal model, the most. The noise is taken to be
that of the logs at hand.

Source: G. C. Goodwin, R. L. Payne, Dynamic System Identification: Experiment Design and Data Analysis, 1977.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation import Fitted, Information, errors, sensitivities
from diagnosis.finding import Finding
from diagnosis.isolability import outside
from diagnosis.problem import Problem
from diagnosis.quantities import number, title
from diagnosis.replay import stretch, transfer
from diagnosis.result import NextExperiment
from diagnosis.whitening import on_logs
from envs.excitation import Chirp, Multisine, ScaledExcitation, Steps, TriangularSweep
from methods.kernel import BEGINNING

LENGTH = 10.0
"""Length of a simulated experiment [s]; the benefit is stated for one as long as all the logs at hand."""
ATTEMPTS = 6
"""How often an excitation is made smaller until the joint stays within its range."""
ENOUGH = 12.0
"""Expected evidence from which on two names can be told apart."""
WORTH = 1.1
"""Least factor of improvement that is worth an experiment."""


@dataclass(frozen=True)
class Range:
    """What the joint may do: smallest and largest position [rad or m], largest command."""

    lower: float
    upper: float
    command: float


def next_experiment(
    problem: Problem, finding: Finding, j: int, joint: int, limits: Range | None
) -> NextExperiment | None:
    """The best of a few excitations of joint index j; None when none is clearly better than the logs at hand."""
    if problem.joints > 1:
        return None
    found = []
    for excitation, amplitude in excitations(problem, j, joint, limits):
        trial = experiment(problem, finding.final, excitation, amplitude, limits or seen(problem, j))
        if trial is not None:
            found.append(trial)
    if not found:
        return None
    rivals = [(item, rival) for item in finding.accepted if item.joint == j for rival in item.rivals]
    if rivals:
        item, rival = rivals[0]
        here = separation(problem, item.scored.fitted, rival.fitted)
        gains = [separation(part, item.scored.fitted, rival.fitted) * ratio for _, part, ratio in found]
        best = int(np.argmax(gains))
        if gains[best] >= max(ENOUGH, WORTH * here):
            return NextExperiment(
                joint=joint,
                excitation=found[best][0].text,
                purpose=f"to tell {title(item.label)} from {title(rival.label)}",
                benefit=f"expected evidence {gains[best]:.3g} instead of {here:.3g}",
                factor=float(gains[best] / max(here, 1e-12)),
            )
    return _sharpest(problem, finding.final, found, joint)


def _sharpest(
    problem: Problem, final: Fitted, found: list[tuple[ScaledExcitation, Problem, float]], joint: int
) -> NextExperiment | None:
    """The experiment that reduces the relative deviation of the least certain parameter most.

    Parameters that trade places so exactly that arithmetic gives them no variance are not asked.
    """
    free = final.point.free
    kept = [i for i, f in enumerate(free) if f.kind == "joint" and f.log < 0]
    sizes = np.abs(final.point.vector)
    variance = np.maximum(np.diag(final.covariance), 0.0)
    relative = [np.sqrt(variance[i]) / max(sizes[i], 1e-3 * free[i].scale) for i in kept]
    of_effects = [k for k, i in enumerate(kept) if "." in free[i].name] or list(range(len(kept)))
    weakest = max(of_effects, key=lambda k: relative[k])
    spread = final.covariance[np.ix_(kept, kept)]
    gains = []
    for _, part, ratio in found:
        own = on_experiment(part, final)
        if not np.all(np.isfinite(own.covariance)):
            gains.append(0.0)
            continue
        places = [[f.name for f in own.point.free].index(free[i].name) for i in kept]
        more = np.linalg.pinv(own.covariance[np.ix_(places, places)]) * ratio
        after = np.linalg.pinv(np.linalg.pinv(spread) + more)[weakest, weakest]
        gains.append(float(np.sqrt(variance[kept[weakest]] / after)) if after > 0.0 else 0.0)
    best = int(np.argmax(gains))
    if gains[best] < WORTH:
        return None
    effect, _, parameter = free[kept[weakest]].name.partition("@")[0].rpartition(".")
    label = next((title(e.label) for e in problem.kernel.effects if e.name == effect), "")
    what = "amplitude" if parameter in ("sine", "cosine") else title(parameter)
    name = f"the {what} of {label}" if label else f"the {what}"
    return NextExperiment(
        joint=joint,
        excitation=found[best][0].text,
        purpose=f"to sharpen {name}, the least certain parameter",
        benefit=f"its standard deviation falls by a factor of {number(gains[best], 2)}",
        factor=gains[best],
    )


def excitations(problem: Problem, j: int, joint: int, limits: Range | None) -> Iterator[tuple[ScaledExcitation, float]]:
    """Candidates with the amplitude to begin with: the largest command seen, or what the drive accepts."""
    mean = float(np.mean(problem.command[:, j]))
    swing = float(np.max(np.abs(problem.command[:, j] - mean)))
    peak = swing or abs(mean)
    largest = peak if limits is None or not np.isfinite(limits.command) else min(2.0 * peak, limits.command)
    fastest = float(f"{min(25.0, 0.1 / problem.sample_time):.2g}")
    offset = float(f"{mean:.3g}") if swing > 0.0 and abs(mean) > 0.2 * swing else 0.0
    common = {"joints": (joint,), "amplitude": largest, "offset": offset}
    yield Multisine(band=(0.1, 2.0), **common), largest  # type: ignore[arg-type]
    yield Multisine(band=(0.5, fastest), **common), largest  # type: ignore[arg-type]
    yield Chirp(band=(0.1, fastest), **common), largest  # type: ignore[arg-type]
    yield Steps(dwell=0.5, **common), largest  # type: ignore[arg-type]
    yield TriangularSweep(period=5.0, **common), largest  # type: ignore[arg-type]


def seen(problem: Problem, j: int) -> Range:
    """The range of the logs at hand with a tenth of margin."""
    q = problem.reading[:, j]
    slack = 0.1 * float(np.ptp(q))
    return Range(float(q.min()) - slack, float(q.max()) + slack, float(np.max(np.abs(problem.command[:, j]))))


def experiment(
    problem: Problem, final: Fitted, excitation: ScaledExcitation, amplitude: float, limits: Range
) -> tuple[ScaledExcitation, Problem, float] | None:
    """The excitation as large as the range allows, its noise-free recording, and how many times longer the logs are."""
    part, ratio = stretch(problem, LENGTH)
    time = problem.sample_time * np.arange(len(part.time), dtype=float)
    middle = 0.5 * (limits.lower + limits.upper)
    for _ in range(ATTEMPTS):
        scaled = replace(excitation, amplitude=float(f"{amplitude:.3g}"))
        command = scaled.sample(time, np.random.default_rng(0))
        starts = np.zeros((1, 1, len(BEGINNING)))
        starts[..., 0] = middle
        trial = replace(part, time=time, command=command, reading=np.zeros_like(command), starts=starts)
        point = transfer(trial, final.point)
        position = -errors(trial, [point], leak=False)[0]
        inside = np.all(np.isfinite(position)) and limits.lower <= position.min() <= position.max() <= limits.upper
        if inside:
            return scaled, replace(trial, reading=position), ratio
        amplitude *= 0.6
    return None


def on_experiment(part: Problem, fitted: Fitted) -> Fitted:
    """The fit's model and noise on a simulated experiment, whose prediction errors are zero."""
    free = tuple(f for f in fitted.point.free if f.log <= 0)
    point = replace(transfer(part, fitted.point), switches=fitted.point.switches, free=free)
    filter_, error = on_logs(part, fitted.whitener), errors(part, [point])[0]
    jacobian = filter_(sensitivities(part, point, error)) / np.sqrt(fitted.variances[0])
    sizes = np.maximum(np.linalg.norm(jacobian, axis=1), 1e-150)  # its square is still a number
    scaled = jacobian / sizes[:, None]
    covariance = np.linalg.pinv(scaled @ scaled.T, rcond=1e-14) / np.outer(sizes, sizes)
    information, floor = Information.of(jacobian, covariance), np.zeros(len(filter_.coefficients))
    return Fitted(point, error, filter_(error), filter_, information, 0, floor)


def separation(part: Problem, one: Fitted, other: Fitted) -> float:
    """Expected decrease of -2 log likelihood by the right one of two models, nominal parameters refitted."""
    here = on_problem(part, one)
    difference = errors(part, [on_problem(part, other).point])[0] - here.error
    whitened = here.whitener(difference)[None] / np.sqrt(one.variances[0])
    left = outside(here.jacobian, whitened)[0]
    return float(left @ left)


def on_problem(part: Problem, fitted: Fitted) -> Fitted:
    """A fit on its own logs as it is, on a simulated experiment as `on_experiment` has it."""
    same = len(part.time) == len(fitted.error) and part.logs == len(fitted.point.starts)
    return fitted if same else on_experiment(part, fitted)
