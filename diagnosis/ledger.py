"""The gain, step by step, on data that nobody fitted: nominal, refitted, one effect after the other, and the rivals.

Intervals come from a moving-block bootstrap over the windows of free simulation (H. Kunsch, Annals of Statistics 17
(1989) 1217), the same blocks for every model, so that a share of the gap is compared window by window.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.stats import chi2

from diagnosis.beginning import started
from diagnosis.engine import JITTER
from diagnosis.estimation import Fitted, Point, predicted_motion
from diagnosis.finding import Finding
from diagnosis.problem import DIVERGED, Problem
from diagnosis.pruning import deviance, without
from diagnosis.replay import (
    WINDOW,
    Replay,
    imitated_floor,
    in_blocks,
    input_equivalent,
    noise_floor,
    replay,
    rms,
    transfer,
    window_width,
)
from diagnosis.result import RAN_AWAY, Failure, Gap, LedgerRow
from envs.log import Array
from envs.log_statistics import position_noise
from methods.kernel import NOMINAL

LEVEL = 0.90
"""Coverage of the intervals."""
RESAMPLES = 400
WORSE = 1.25
"""Factor by which effects that are there do not increase the error on data that nobody fitted."""
LEFT = 0.005
"""Share of the nominal model's error below which a model holds on other logs whatever the noise."""
UNREAD = 0.05
"""The same where the model errs by less than one step of the encoder."""
INEXACT = 5e-4
"""Share of the motion in a window below which the model of a coupled joint holds whatever the noise: the integrator's
small errors at the other joint reach it as well."""
BEYOND = 2.0
"""Error on held-out logs, as a multiple of what noise makes it, from which the model does not hold there."""
EARNED = 0.5
"""Share of what the nominal model errs there beyond noise that the effects have to explain."""
CLEAR = 1.5
"""Error on held-out logs, as a multiple of what noise makes it, from which that is asked."""
CERTAIN = 1e-12
"""Share of a covariance that makes a model as good as certain."""
CHANCE = 1e-4
"""Probability of a larger error by chance alone, where windows are few."""
GROWN = 10.0
"""How many times more a torque as small as the noise moves a joint in some windows than in the median one, from which
small causes count as growing."""
FAINT = (1e-3, 0.1)
"""Shares of the input-equivalent residual: with which that is tried first, and at most."""
DISTINCT = 1.05
"""The refitted nominal model has to err by this factor more than noise alone; otherwise there is no gap to explain."""


@dataclass(frozen=True, eq=False)
class Step:
    """One model of the ledger on the held-out logs, with its replay."""

    title: str
    role: str
    joint: int | None
    point: Point
    replay: Replay


def prefixes(problem: Problem, finding: Finding) -> list[Fitted]:
    """The refitted nominal model, then with one accepted effect after the other, each with everything refitted."""
    models: list[Fitted] = [finding.final]
    for count in range(len(finding.accepted) - 1, -1, -1):
        wanted = np.zeros_like(finding.final.point.switches)
        for item in finding.accepted[:count]:
            wanted[item.joint, problem.kernel.switches[item.name]] = True
        known = [step for step in finding.steps if np.array_equal(step.point.switches, wanted)]
        models.append(known[-1] if known else without(problem, models[-1], finding.accepted[count]))
    return models[::-1]


def steps(problem: Problem, held_out: Problem, finding: Finding, given: Point | None) -> list[Step]:
    """Every model of the ledger, replayed on the held-out logs."""
    fits = prefixes(problem, finding)
    titles: list[tuple[str, str, int | None, Point]] = []
    whiten = finding.final.whitener
    if given is not None:
        titles.append(("nominal as given", "as given", None, given))
    titles.append(("refit nominal parameters", "nominal", None, fits[0].point))
    for item, fitted in zip(finding.accepted, fits[1:], strict=True):
        titles.append((f"+ {item.label}", "effect", item.joint, fitted.point))
    found = []
    for title, role, joint, point in titles:
        moved = started(held_out, point, whiten)
        found.append(Step(title, role, joint, moved, replay(held_out, moved, WINDOW)))
    return found


def floor_of(problem: Problem, held_out: Problem, finding: Finding, j: int) -> float:
    """Window error of the true model [rad or m] on the held-out logs, from the noise in the fitted ones; sensor noise
    alone where something real is left unexplained."""
    if finding.verdict == "unknown":
        innovation = float(np.sqrt(finding.final.variances[j]))
        noise = [position_noise(problem.reading[a:b, j]) for a, b in pairwise(problem.bounds)]
        sensor = max(problem.encoder_step / np.sqrt(12.0), min(float(np.sqrt(np.mean(np.square(noise)))), innovation))
        return noise_floor(problem, finding.final, j, WINDOW, max(sensor, 1e-12), coloured=False)
    same = noise_of_fit(problem, finding, j)
    return float(np.sqrt(max(same**2 + faster(problem, held_out, finding, j), 0.1 * same**2)))


def noise_of_fit(problem: Problem, finding: Finding, j: int) -> float:
    """Window error [rad or m] of the true model on the fitted logs, by their noise."""
    innovation = float(np.sqrt(finding.final.variances[j]))
    return noise_floor(problem, finding.final, j, WINDOW, innovation, coloured=True)


def faster(problem: Problem, held_out: Problem, finding: Finding, j: int) -> float:
    """What a jitter of the sampling instants adds to the mean square of the window errors on the held-out logs beyond
    that on the fitted ones, of which it makes no more than all noise: the faster the joint moves the more it adds to
    the readings, those that a window begins with too."""
    item = next((item for item in finding.accepted if item.name == JITTER and item.joint == j), None)
    if item is None:
        return 0.0
    jitter = finding.final.point.parameters[0, j, problem.kernel.column(item.effect, "rms")]
    there, here = (
        np.mean(predicted_motion(own, transfer(own, finding.final.point))[own.used, j, 1] ** 2)
        for own in (held_out, problem)
    )
    by_jitter = noise_floor(problem, finding.final, j, WINDOW, float(jitter * np.sqrt(here)), coloured=False)
    return float(min(by_jitter, noise_of_fit(problem, finding, j)) ** 2 * (there / max(here, 1e-300) - 1.0))


def failures(problem: Problem, held_out: Problem, finding: Finding, found: Sequence[Step]) -> dict[int, Failure]:
    """The joints whose model errs on the held-out logs by more than noise accounts for, or than the nominal one.

    A patchwork of known effects can pass for an unknown one in the range of the fitted motion, not beyond it. The mean
    square of every window counts as a square of one normal deviate, so that few windows have to err by more. What the
    effects leave of the nominal model's error only in the third digit, or in the second where no reading shows it, is
    no failure of theirs. Events need not happen in another log, and states that a log does not show may be others at
    its beginning. Where small causes grow, a free simulation soon goes another way than the joint, and a model that
    stays in the middle errs less; there the prediction from one reading to the next has to be worse, too, and the
    typical window decides whether the model errs by more than noise. A model that is so uncertain that noise accounts
    for its errors still has to explain more of the nominal one's than it leaves, unless all that it has beyond that is
    a jitter, which does nothing in a free simulation.
    """
    if finding.verdict == "unknown":
        return {}
    elsewhere = any(item.effect.scan == "event" or item.effect.remembers for item in finding.accepted)
    nominal = next(step for step in found if step.role == "nominal")
    width, failing = window_width(WINDOW, held_out.sample_time), {}
    scatters = any(item.effect.scatters for item in finding.accepted)
    predicts = cache(lambda: deviance(held_out, finding.final) < deviance(held_out, finding.nominal))
    doubted = cache(lambda: doubt(held_out, found[-1]))
    floors = cache(  # by the share of the covariance that a model may be off
        lambda share: imitated_floor(held_out, finding.final, share * finding.covariance, found[-1].point, WINDOW)
    )
    for j in range(problem.joints):
        blocks = [in_blocks(item.replay.windows[:, j], held_out.bounds, width) for item in (nominal, found[-1])]
        count = len(blocks[1])
        if not count:
            continue
        before, after = (float(np.mean(squares)) for squares in blocks)
        enough = max(LEFT**2 * before, min(problem.encoder_step**2, UNREAD**2 * before))
        if problem.joints > 1:
            motion = float(np.mean(in_blocks(held_out.reading[:, j], held_out.bounds, width, about_mean=True)))
            enough = max(enough, INEXACT**2 * motion)
        if after < enough:
            continue
        most = max(BEYOND**2, chi2.isf(CHANCE, count) / count)
        floor = float(np.hypot(floor_of(problem, held_out, finding, j), doubted()[j]))
        times = np.sqrt(after) / floor
        typical = [float(np.median(squares)) for squares in blocks]
        grows = cache(lambda j=j, floor=floor: grown(held_out, found[-1], j, floor) > GROWN * floor)
        exceeds = not elsewhere and times**2 > most
        if exceeds and finding.band is None:  # dry friction, coupling and uncertainty make more of the noise
            unsure = doubted()[j] ** 2 + max(faster(problem, held_out, finding, j), 0.0)
            exceeds = after > most * (floors(1.0)[j] ** 2 + unsure)
        exceeds = exceeds and not (grows() and not is_unearned(typical[0], typical[1], floor))
        if exceeds:
            failing[j] = Failure(float(times), noise=True)
        elif (after > WORSE**2 * before and not ((scatters or grows()) and predicts())) or (
            not (elsewhere or scatters)
            and any(item.joint == j and item.name != JITTER for item in finding.accepted)
            and is_unearned(before, after, floor)
            and is_unearned(before, after, float(floors(CERTAIN)[j]))
            and not grows()
        ):
            failing[j] = Failure(float(np.sqrt(after / before)), noise=False)
    return failing


def doubt(held_out: Problem, step: Step) -> Array:
    """Window error (n,) that a model may owe to what the description, and the fitted logs, leave open of the torques of
    the rest of the arm: other motion asks for numbers that theirs did not."""
    squares = [np.zeros(held_out.joints)]
    for torque in held_out.doubts.T:
        near = held_out.neighbour.copy()
        near[:, :, 3] += torque[:, None]
        moved = replay(replace(held_out, neighbour=near), step.point, WINDOW)
        squares.append(np.nanmean((moved.windows - step.replay.windows) ** 2, axis=0))
    return np.asarray(np.sqrt(np.sum(squares, axis=0) / max(len(squares) - 1, 1)))


def grown(held_out: Problem, step: Step, j: int, floor: float) -> float:
    """Window error of joint index j that a constant torque makes which in the median window makes only the noise floor.

    Where a joint that is almost at rest stops or does not by the least torque, single windows err a thousand times more
    than the others, and a mean square over few of them says little.
    """
    residual = rms(input_equivalent(held_out, step.point, step.replay.prediction)[held_out.used, j])
    width, only = window_width(WINDOW, held_out.sample_time), np.arange(held_out.joints) == j

    def moved(torque: float) -> Array:
        return replay(replace(held_out, command=held_out.command + torque * only), step.point, WINDOW).windows[:, j]

    own = moved(0.0)

    def change(torque: float) -> Array:
        return in_blocks(moved(torque) - own, held_out.bounds, width)

    first, most = (share * residual for share in FAINT)
    typical = float(np.sqrt(np.median(change(first))))
    torque = min(first * floor / max(typical, 1e-300), most)
    return float(np.sqrt(np.mean(np.maximum(change(torque), change(-torque)))))


def is_unearned(before: float, after: float, floor: float) -> bool:
    """Whether effects leave more than noise makes, and more than they explain, of the nominal model's error; before and
    after are mean squares, the floor a root."""
    left, gap = np.sqrt(after) - floor, np.sqrt(before) - floor
    return bool(left > (CLEAR - 1.0) * floor and left > (1.0 - EARNED) * gap)


def rows(
    held_out: Problem, found: list[Step], j: int, joints: Sequence[int], floor: float, rng: np.random.Generator
) -> list[LedgerRow]:
    """The ledger of joint index j; joints: the numbers of all of them on the robot."""
    width = window_width(WINDOW, held_out.sample_time)
    blocks = np.array([in_blocks(step.replay.windows[:, j], held_out.bounds, width) for step in found])
    base = next(i for i, step in enumerate(found) if step.role == "nominal")
    draws = resampled(blocks, rng)
    table: list[LedgerRow] = []
    for i, step in enumerate(found):
        inverse = input_equivalent(held_out, step.point, step.replay.prediction)[held_out.used, j]
        parts, whole, note = simulated(step.replay.windows[:, j], step.replay.whole[:, j])
        table.append(
            LedgerRow(
                joint=joints[j],
                step=step.title if step.joint in (None, j) else f"{step.title} at joint {joints[step.joint]}",
                role=step.role,  # type: ignore[arg-type]
                inverse_error=rms(inverse),
                window_error=parts,
                whole_error=whole,
                interval=None if parts is None else quantiles(draws[i]),
                closed=None if parts is None else closed(parts, rms(found[base].replay.windows[:, j]), floor),
                microseconds=step.replay.microseconds,
                note=note,
            )
        )
    return table


def simulated(windows: Array, whole: Array) -> tuple[float | None, float | None, str]:
    """Root mean squares of the errors of free simulation, NaN not counted; None, and a note, where it ran away."""
    lost, ended = (float(np.nanmax(np.abs(errors), initial=0.0)) >= DIVERGED for errors in (windows, whole))
    notes = ["diverges in the windows"] * lost + ["diverges over the whole log"] * ended
    return None if lost else rms(windows), None if ended else rms(whole), ", ".join(notes)


def gap(
    held_out: Problem, found: list[Step], j: int, joint: int, unit: str, floor: float, on: str, rng: np.random.Generator
) -> Gap:
    """The gain of all named effects over the refitted nominal model for joint index j."""
    width = window_width(WINDOW, held_out.sample_time)
    base = next(step for step in found if step.role == "nominal")
    last = next(step for step in reversed(found) if step.role in ("nominal", "effect"))
    blocks = np.array([in_blocks(step.replay.windows[:, j], held_out.bounds, width) for step in (base, last)])
    before, after = (rms(step.replay.windows[:, j]) for step in (base, last))
    draws = resampled(blocks, rng)
    share = closed(after, before, floor)
    each = [closed(a, b, floor) for b, a in zip(*draws, strict=True)]
    return Gap(
        joint=joint,
        unit=unit,
        before=before,
        after=after,
        noise_floor=floor,
        closed=share,
        interval=None if share is None else quantiles(np.array([value for value in each if value is not None])),
        on=on,
        window=WINDOW,
    )


def closed(after: float, before: float, floor: float) -> float | None:
    """Share of the explainable gap (before - floor) that is closed, at most 1; None where there is no such gap, or
    none with a size: a simulation that ran away may be off by anything."""
    if not RAN_AWAY > before > DISTINCT * floor:
        return None
    return float(min(1.0, (before - after) / (before - floor)))


def resampled(blocks: Array, rng: np.random.Generator) -> Array:
    """Root mean squares of moving-block resamples of the windows' mean squares (M, blocks), shape (M, RESAMPLES)."""
    count = blocks.shape[1]
    if not count:
        return np.full((len(blocks), RESAMPLES), np.nan)
    length = max(1, round(count ** (1 / 3)))
    starts = rng.integers(0, count, (RESAMPLES, -(-count // length)))
    picks = ((starts[:, :, None] + np.arange(length)) % count).reshape(RESAMPLES, -1)[:, :count]
    return np.sqrt(blocks[:, picks].mean(axis=2))


def quantiles(values: Array) -> tuple[float, float] | None:
    """Interval of the given coverage; None without values."""
    if not len(values):
        return None
    low, high = np.quantile(values, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    return float(low), float(high)


def given_point(nominal: Fitted, j: int, numbers: dict[str, float]) -> Point:
    """The nominal model with a robot's own numbers (columns of the parameter array) in place of fitted ones."""
    parameters = nominal.point.parameters.copy()
    for name, value in numbers.items():
        parameters[:, j, NOMINAL.index(name)] = value
    return replace(nominal.point, parameters=parameters)
