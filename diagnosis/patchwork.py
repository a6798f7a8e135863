"""Several laws of one variable that make up a law which none of them is.

A line, a sine of the angle and a piece of a wave are an expansion of any smooth torque of the position, and a dry
friction beside another one is an expansion of any friction. Such names describe the logs without saying what is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import Enum
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.estimation import Fitted, errors, predicted_motion, significance
from diagnosis.imitation import Signals, resistance
from diagnosis.lags import BACK_EMF, INERTIA, VISCOUS, WINDING
from diagnosis.problem import Problem
from diagnosis.projection import project
from envs.log import Array
from methods.effects.base import Effect

if TYPE_CHECKING:
    from diagnosis.finding import Accepted

PERIODS = 1.5
"""Periods of a wave that the logs have to show, where other torques of the position are there as well."""
VAGUE = 0.02
"""Relative deviation of a wave's length from which it is no finding of its own."""
REACHED = 0.5
"""Share of its level that a rounded dry friction has to have reached at the rms velocity."""
SOFTEST = 0.03
"""Longest recovery time of a soft constraint that is friction in any case [s]; MuJoCo's own is 0.0095 s."""
COASTING = 0.6
"""Recovery time over that in which the joint itself coasts to rest, from which a constraint is no friction."""
DEEP = 20.0
"""Depth to which a hardening contact is pressed, in halves of its play, from which there is no play to speak of."""
FOLLOWS = 2.0 * np.pi
"""Time constants, of a spring that draws back what its own damper lets slip, that the longest log has to last."""
CERTAIN = 3.0
"""Standard deviations from nothing at which a law draws a joint back for certain."""
CANCELLING = 0.25
"""Sum of torques, as a share of the largest, below which they only describe another law."""


class Patchwork(Enum):
    """What several named laws of a joint stand for together."""

    FRICTION = "one law of friction"
    DEAD_ZONE = "a dead zone of the motor torque"
    POSITION = "one smooth torque of the position"
    STATIC = "one static law"
    DRIVE = "one law of the drive"
    SPRING = "a spring that stiffens"
    SLIP = "a coupling that slips"


def patchwork(problem: Problem, final: Fitted, accepted: Sequence[Accepted], margin: float) -> dict[int, Patchwork]:
    """The joints (by index) whose accepted laws are pieces of another one.

    Frictions: both contain dry friction, which cannot be there twice, or one is so rounded that it never comes near its
    level. A soft constraint that takes the velocity away as slowly as the joint itself coasts is no friction either.
    Torques of the position: they nearly cancel, a wave shows for less than PERIODS and its length stays VAGUE, of two
    waves of neighbouring lengths only the sum is certain, or a polynomial of the position with as many coefficients
    explains the logs as well, up to `margin` of -2 log likelihood (where they do not each draw the joint back).
    All laws without a memory: an offset far beyond the commands that an asymmetry takes back is a piece of another law.
    Laws of the command and of the motor torque, where this is the command: neither has its textbook's form. A play
    whose contact hardens and is pressed far deeper than the play is wide. A flexibility whose spring takes
    so long to draw back what its damper lets slip that the longest log lasts less than FOLLOWS of its time constants.
    """
    found: dict[int, Patchwork] = {}
    for j in range(problem.joints):
        own = [item.effect for item in accepted if item.joint == j]
        places = [effect for effect in own if of_position(effect)]
        dry = [effect for effect in own if effect.is_dry]
        if len(dry) > 1 or any(is_damping(problem, final, j, effect) for effect in dry):
            found[j] = Patchwork.FRICTION
        elif any(is_dead_zone(problem, final, j, effect) for effect in dry):
            found[j] = Patchwork.DEAD_ZONE
        elif len(places) > 1 and (
            is_piece(problem, final, j, places)
            or is_cancelling(problem, final, j, places)
            or (not draw_back(problem, final, j, places) and is_polynomial(problem, final, j, places, margin))
        ):
            found[j] = Patchwork.POSITION
        elif is_balanced(problem, final, j, own):
            found[j] = Patchwork.STATIC
        elif is_doubled(final, j, own):
            found[j] = Patchwork.DRIVE
        elif any(is_spring(problem, final, j, effect) for effect in own if effect.scatters):
            found[j] = Patchwork.SPRING
        elif any(is_slipping(problem, final, j, effect) for effect in own):
            found[j] = Patchwork.SLIP
    return found


def of_position(effect: Effect) -> bool:
    """Whether an effect is a torque that the position alone sets."""
    return (effect.variable, effect.slot) == ("position", "torque")


def is_damping(problem: Problem, final: Fitted, j: int, law: Effect) -> bool:
    """Whether a rounded dry friction still grows with the velocity where the joint moves, so that it has no level."""
    if "rounding" not in {parameter.name for parameter in law.parameters} or law.function is None:
        return False
    values = final.point.parameters[0, j, problem.kernel.own(law)].tolist()
    at, level = (law.function(0.0, 0.0, velocity, 1.0, [], values) for velocity in (rms_velocity(problem, j), 1e9))
    return bool(at < REACHED * level)


def is_dead_zone(problem: Problem, final: Fitted, j: int, law: Effect) -> bool:
    """Whether a soft constraint asks for what the joint does by itself.

    It holds ``w - b q' + J q' / t`` up to its level (motor torque w, damping b, inertia J, recovery time t), which at
    ``t = J / b`` is the motor torque: a dead zone. Constraints of simulators recover in milliseconds.
    """
    if "recovery_time" not in {parameter.name for parameter in law.parameters}:
        return False
    row = final.point.parameters[0, j]
    recovery = float(row[problem.kernel.column(law, "recovery_time")])
    damping = float(row[VISCOUS] + row[BACK_EMF])
    return recovery > max(SOFTEST, COASTING * float(row[INERTIA]) / max(damping, 1e-300))


def is_spring(problem: Problem, final: Fitted, j: int, play: Effect) -> bool:
    """Whether a play is there for its contact only, which hardens from the first.

    A contact of exponent n accelerates the arm by ``a = w^2 h y^n``, pressed y halves h of the play deep (w: angular
    frequency half a play deep). At the rms acceleration of the joint y is at least DEEP then.
    """
    names = {parameter.name for parameter in play.parameters}
    if "exponent" not in names:
        return False
    value = {name: float(final.point.parameters[0, j, problem.kernel.column(play, name)]) for name in names}
    velocity = predicted_motion(problem, final.point)[:, j, 1]
    changes = np.concatenate([np.diff(velocity[a:b]) for a, b in pairwise(problem.bounds)])
    acceleration = float(np.sqrt(np.mean(changes**2))) / problem.sample_time
    unit = (2.0 * np.pi * value["frequency"]) ** 2 * 0.5 * value["gap"]
    return acceleration > unit * DEEP ** value["exponent"]


def is_slipping(problem: Problem, final: Fitted, j: int, law: Effect) -> bool:
    """Whether a flexibility is a damper between two inertias: with the angular frequency w and the damping ratio z its
    spring draws a twist back at the rate ``w / (2 z)``, too slowly for the longest log."""
    if law.label != "joint_flexibility":
        return False
    frequency, ratio = (
        float(final.point.parameters[0, j, problem.kernel.column(law, name)]) for name in ("frequency", "damping_ratio")
    )
    return np.pi * frequency * problem.longest < FOLLOWS * ratio


def rms_velocity(problem: Problem, j: int) -> float:
    """Rms of the measured velocity of a joint [rad/s or m/s]."""
    return float(np.sqrt(np.mean(problem.velocity[problem.used, j] ** 2)))


def is_piece(problem: Problem, final: Fitted, j: int, laws: Sequence[Effect]) -> bool:
    """Whether one of the laws is a wave of which the logs show a piece only, or one of two that differ by less than a
    period over the way that the logs show, of which neither the one nor the other is certain: such a pair is a wave
    whose height changes along that way."""
    free = {f.name: i for i, f in enumerate(final.point.free)}
    span = float(np.ptp(problem.reading[problem.used, j]))
    certain: list[tuple[float, bool]] = []
    for effect in laws:
        if effect.scan == "position":
            cycles = float(final.point.parameters[0, j, problem.kernel.column(effect, "cycles_per_rev")])
            length = free.get(f"{effect.name}.cycles_per_rev@{j}")
            vague = length is not None and np.sqrt(final.covariance[length, length]) > VAGUE * cycles
            if vague and cycles * span < 2.0 * np.pi * PERIODS:
                return True
            certain.append((cycles, is_high(final, [f"{effect.name}.{part}@{j}" for part in ("sine", "cosine")])))
    return any(
        abs(one - other) * span < 2.0 * np.pi and not (is_certain and is_other_certain)
        for (one, is_certain), (other, is_other_certain) in combinations(certain, 2)
    )


def is_high(final: Fitted, amplitudes: Sequence[str]) -> bool:
    """Whether a wave of these amplitudes, by their names, is certainly there beside all else that is uncertain."""
    own = [i for i, f in enumerate(final.point.free) if f.name in amplitudes]
    return significance(final.point.vector[own], final.covariance[np.ix_(own, own)]) > CERTAIN**2


def torques(problem: Problem, final: Fitted, j: int, laws: Sequence[Effect], places: Array) -> Array:
    """Torques (laws, N) of the position at places (N,)."""
    row = final.point.parameters[0, j]
    known = [(effect.function, row[problem.kernel.own(effect)].tolist()) for effect in laws]
    return np.array([[law(0.0, q, 0.0, 0.0, [], p) for q in places.tolist()] for law, p in known if law is not None])


def is_cancelling(problem: Problem, final: Fitted, j: int, laws: Sequence[Effect]) -> bool:
    """Whether the sum of the laws varies far less than the largest of them."""
    reading = problem.reading[problem.used, j]
    every = torques(problem, final, j, laws, np.quantile(reading, np.linspace(0.0, 1.0, 200)))
    return bool(np.std(every.sum(axis=0)) < CANCELLING * np.max(np.std(every, axis=1)))


def draw_back(problem: Problem, final: Fitted, j: int, laws: Sequence[Effect]) -> bool:
    """Whether all laws are known ones of a machine, no waves, and each certainly draws the joint back on the whole.

    A spring beside a weight that hangs is what it seems, also over angles at which a polynomial is as good. Laws that
    draw against each other are an expansion: a spring that stiffens looks like one beside a weight that stands.
    """
    reading = problem.reading[problem.used, j]
    ends, free = np.array([np.min(reading), np.max(reading)]), {f.name: i for i, f in enumerate(final.point.free)}
    for effect in laws:
        names = [f"{effect.name}.{parameter.name}@{j}" for parameter in effect.parameters]
        if effect.scan is not None or effect.neutral or not free.keys() >= set(names):
            return False
        own = [free[name] for name in names]
        rise = float(np.diff(torques(problem, final, j, [effect], ends)[0])[0])
        slopes = np.zeros(len(own))
        for k, i in enumerate(own):
            step = np.zeros(len(free))
            step[i] = final.point.free[i].scale
            moved = replace(final, point=final.point.at(final.point.vector + step))
            slopes[k] = (np.diff(torques(problem, moved, j, [effect], ends)[0])[0] - rise) / step[i]
        if rise < CERTAIN * np.sqrt(slopes @ final.covariance[np.ix_(own, own)] @ slopes):
            return False
    return True


def is_balanced(problem: Problem, final: Fitted, j: int, laws: Sequence[Effect]) -> bool:
    """Whether the torques that all laws without a memory take from the motor's nearly cancel along the logs."""
    if len(laws) < 2:
        return False
    signals, row = Signals.of(problem, final, j), final.point.parameters[0, j]
    known = [(resistance(effect, signals), row[problem.kernel.own(effect)]) for effect in laws]
    taken = [law(values) for law, values in known if law is not None]
    if len(taken) < 2:
        return False
    size = np.sqrt(np.mean(np.square([*taken, np.sum(taken, axis=0)]), axis=1))
    return bool(size[-1] < CANCELLING * np.max(size[:-1]))


def is_doubled(final: Fitted, j: int, laws: Sequence[Effect]) -> bool:
    """Whether a general form of a law of the command and one of the motor torque stand side by side where these are the
    same signal: a drive that is given its torque saturates once, in a way that neither describes."""
    row = final.point.parameters[0, j]
    general = {effect.variable for effect in laws if effect.neutral}
    return row[BACK_EMF] == row[WINDING] == 0.0 and {"command", "motor torque"} <= general


def is_polynomial(problem: Problem, final: Fitted, j: int, laws: Sequence[Effect], margin: float) -> bool:
    """Whether a polynomial of the position with as many coefficients as the laws explains the logs as well.

    It takes their place as the torque along the predicted motion that comes nearest to theirs; its coefficients and all
    free parameters but the laws' own are then refitted to first order in the innovations.
    """
    names = {effect.name for effect in laws}
    others = [not (f.joint == j and f.name.partition(".")[0] in names) for f in final.point.free]
    position = predicted_motion(problem, final.point)[:, j, 0]
    middle, half = (np.max(position) + np.min(position)) / 2.0, max(float(np.ptp(position)) / 2.0, 1e-300)
    grid = np.linspace(-1.0, 1.0, 400)  # smooth laws: their torque in between is interpolated
    law = np.interp(
        (position - middle) / half, grid, torques(problem, final, j, laws, middle + half * grid).sum(axis=0)
    )
    powers = np.polynomial.legendre.legvander((position - middle) / half, len(others) - sum(others) - 1)
    nearest = powers @ np.linalg.lstsq(powers, law, rcond=None)[0]
    size = float(np.std(law))
    extra = np.zeros((2 + powers.shape[1], len(position), problem.joints))
    extra[1, :, j] = nearest - law
    extra[2:, :, j] = 1e-3 * size * powers.T
    outcome = errors(problem, [final.point] * len(extra), extra=extra)
    scale = final.weights
    filtered = final.whitener(outcome - outcome[0])[1:] * scale
    basis = np.vstack([final.jacobian[others], filtered[1:]])
    away, certainty = np.zeros(len(basis)), np.zeros(len(basis))
    away[: sum(others)] = (final.point.vector - [f.centre for f in final.point.free])[others]
    certainty[: sum(others)] = final.point.certainty[others]
    rest = final.innovation * scale + filtered[0]
    cost = float(rest @ rest) - project(basis, rest, certainty, away)[1]
    return cost - float((final.innovation * scale) @ (final.innovation * scale)) < margin
