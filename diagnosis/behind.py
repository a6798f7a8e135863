"""Inertia behind a spring or a play in a planar pair: as much as the pair's coupling needs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.problem import Problem
from envs.log import Array
from methods.effects.base import Effect
from methods.kernel import NOMINAL

INERTIA = NOMINAL.index("inertia")
DEFINITE = 0.1
"""Least determinant of the mass matrix of an arm behind its transmissions, over the product of its diagonal."""
MOST = 0.98
"""Largest share of a joint's inertia behind its transmission."""


def borne(problem: Problem, rigid: Array, parameters: Array, parting: Sequence[Effect | None], joint: int) -> Array:
    """Parameters (L, 2, columns) of a planar pair in which the arm behind the transmissions is a body.

    Its mass matrix ``[[p1 + p2 + 2 p3 cos q2, p2 + p3 cos q2], [., I2]]``, with what of p1 and I2 is behind, has to be
    positive definite wherever the elbow was. Where it is not, the joint gets what is missing behind, and the motor
    keeps its own: above the resonance of a soft spring the logs show nothing but the motor, and that is what the joint
    was fitted with. rigid: p3, unit ratio and p2. parting: per joint its effect with a share of the inertia behind.
    """
    coupling, ratio, carried = rigid
    swing = coupling * np.cos(problem.reading[:, 1])
    swing = np.array([swing.min(), swing.max()])  # what is needed is largest at one end
    found = parameters.copy()
    columns = [None if e is None else problem.kernel.column(e, "inertia_ratio") for e in parting]
    for log in range(len(found)):
        whole = found[log, :, INERTIA] / (1.0, ratio)
        shares = np.array([1.0 if own is None else found[log, j, own] for j, own in enumerate(columns)])
        behind = whole * shares
        turning = carried if columns[1] is None else min(carried, behind[1])
        sides = turning + swing
        if np.all((behind[0] + turning + 2.0 * swing) * behind[1] * (1.0 - DEFINITE) > sides**2):
            continue
        if joint == 1:
            sides = carried + swing
            needed = max(float(np.max(sides**2 / (behind[0] + carried + 2.0 * swing))) / (1.0 - DEFINITE), carried)
            motor = whole[1] if whole[1] < needed else whole[1] - behind[1]
        else:
            needed = float(np.max(sides**2 / ((1.0 - DEFINITE) * behind[1]) - turning - 2.0 * swing))
            motor = whole[0] - behind[0]
        if not 0.0 < needed < np.inf:
            continue
        total = max(needed + motor, needed / MOST)
        found[log, joint, INERTIA] = total * (1.0, ratio)[joint]
        found[log, joint, columns[joint]] = needed / total
    return found
