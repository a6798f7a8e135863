"""Rough physics of one joint of a recording: enough to notice a wrong sign, a wrong gear or another machine.

A regression of the command on smoothed derivatives gives inertia and damping to a factor, and the work of the command
tells its sign. Nothing here is an estimate to be used; it is compared with what should be, in factors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from envs.log import Array, Log

#: Smoothing of derivatives and command [s].
SMOOTHING = 0.05
#: Standard deviations by which the inertia has to differ from zero to count as known.
KNOWN = 10.0
#: Shortest path, in steps of the encoder, from which a joint counts as moved.
STEPS = 200.0
#: Net work of all commands over its magnitude below which a recording contradicts its own signs.
BACKWARDS = -0.2
#: A joint whose ends lie further apart than this share of its path may have been lowered or lifted.
RETURNED = 0.3
#: Share of the command's variance that a negative inertia has to explain before a sign is called wrong.
CONSISTENT = 0.5


@dataclass(frozen=True)
class Rough:
    """A joint in units of its command.

    inertia: [command s^2/rad or m], None when the recording does not determine it. explained: share of the command's
    variance that inertia, damping, dry friction and gravity explain, own_share: the part of it that only inertia does.
    work: net work of the command over its magnitude, -1 to 1; a motor that drives a joint with friction is above zero.
    """

    inertia: float | None
    explained: float
    own_share: float
    work: float


def rough(log: Log, joint: int) -> Rough | None:
    """The rough physics of a joint; None when it hardly moves or is not commanded."""
    column = log.index(joint)
    position, facts = log.position[:, column], log.facts[column]
    step = log.sample_time
    if (
        not np.all(np.isfinite(position))
        or np.ptp(position) <= STEPS * (facts.encoder_step or 0.0)
        or not np.ptp(log.command[:, column])
        or len(log) < 200
    ):
        return None
    span = 2 * round(0.5 * max(SMOOTHING, 8 * step) / step) + 1
    q, dq, ddq = (savgol_filter(position, span, 3, deriv=order, delta=step) for order in range(3))
    held = log.command[:, column]
    if facts.hold == "zero_order":
        held = np.concatenate([held[:1], 0.5 * (held[1:] + held[:-1])])
    u = savgol_filter(held, span, 3)
    if not np.std(dq) or not np.std(u):
        return None
    columns = [ddq, dq, np.tanh(dq / (0.05 * np.std(dq))), np.ones_like(q)]
    if facts.position_unit == "rad" and np.ptp(q) > 0.3:
        columns += [np.sin(q), np.cos(q)]
    power = u * dq
    work = float(np.sum(power) / max(np.sum(np.abs(power)), 1e-300))
    return Rough(*_inertia(np.column_stack(columns), u, span), work)


def _inertia(matrix: Array, target: Array, correlation: int) -> tuple[float | None, float, float]:
    """First coefficient where it is determined, and the shares of the variance that all and only the first explain."""
    scale = np.sqrt(np.mean(matrix**2, axis=0)) + 1e-300
    scaled = matrix / scale
    gram = scaled.T @ scaled
    if np.linalg.cond(gram) > 1e8:
        return None, 0.0, 0.0
    solution = np.linalg.solve(gram, scaled.T @ target)
    residual = target - scaled @ solution
    explained = 1.0 - float(np.var(residual) / np.var(target))
    spread = np.linalg.inv(gram)[0, 0]
    deviation = float(np.sqrt(correlation * np.mean(residual**2) * spread))
    known = abs(solution[0]) > KNOWN * deviation
    own_share = float(solution[0] ** 2 / spread / len(target) / np.var(target))
    return (float(solution[0] / scale[0]) if known else None), explained, own_share


def moved(log: Log) -> dict[int, Rough]:
    """The rough physics of every joint that moves and is commanded."""
    found = {joint: rough(log, joint) for joint in log.joints}
    return {joint: physics for joint, physics in found.items() if physics is not None}


def works_backwards(log: Log) -> bool:
    """Whether all commands together take energy out of joints that return to where they were.

    Friction only ever takes energy, so over a recording the motors have to bring it. A single joint of several may
    brake what the others drive; all of them together may not. A voltage leads its torque, and with a lag its product
    with the velocity can be negative in a sound recording: the inertias have to come out negative as well.
    """
    found = moved(log)
    for column in range(len(log.joints)):
        q = log.position[:, column]
        if abs(q[-1] - q[0]) > RETURNED * float(np.sum(np.abs(np.diff(q)))):
            return False
    backwards = [
        physics.work < BACKWARDS
        and physics.inertia is not None
        and physics.inertia < 0.0
        and physics.explained > CONSISTENT
        for physics in found.values()
    ]
    return bool(backwards) and all(backwards)
