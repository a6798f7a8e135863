"""What a log can tell at best: the Cramer-Rao bound on the linear coefficients of a joint.

Position readings y_k = q(t_k; a, x0) + e_k with independent errors of standard deviation s carry the information
J = S'S / s^2 with the sensitivities S = d q / d (a, x0), shape (T, p + 3); no unbiased estimator of a has a smaller
covariance than the leading block of J^-1. The unknown initial state x0 = (q, q', q'') is part of the bound. An encoder
of step d has s = d / sqrt(12). Effects that the model lacks are no noise and are not in the bound.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from envs.log import Array, Log
from methods.base import State
from methods.joint_model import JointModel


def cramer_rao_bound(model: JointModel, log: Log, initial: State, position_deviation: float) -> Array:
    """Lower bound (p, p) on the covariance of the model's coefficients from this log's command.

    The sensitivities are central differences of the model's own simulation, 1e-4 relative to a typical size of each
    parameter; for a model that is linear in its state they are exact to rounding. Raises LinAlgError when the
    simulation of the model diverges.
    """
    size = len(model.coefficients)
    steps = 1e-4 * np.concatenate((np.abs(model.coefficients) + 1e-3 * np.max(np.abs(model.coefficients)), np.ones(3)))
    sensitivity = np.empty((len(log), size + 3))
    hold = log.facts[0].hold
    for k, step in enumerate(steps):
        ends = []
        for sign in (1.0, -1.0):
            shift = np.zeros(size + 3)
            shift[k] = sign * step
            moved = replace(model, coefficients=model.coefficients + shift[:size])
            start = State(
                initial.position + shift[size],
                initial.velocity + shift[size + 1],
                initial.acceleration + shift[size + 2],
            )
            ends.append(moved.simulate(log.time, log.command, start, hold).position[:, 0])
        sensitivity[:, k] = (ends[0] - ends[1]) / (2.0 * step)
    scale = np.linalg.norm(sensitivity, axis=0)
    _, singular, right = np.linalg.svd(sensitivity / scale, full_matrices=False)
    with np.errstate(divide="ignore"):
        inverse = (right.T / singular**2) @ right
    bound = position_deviation**2 * inverse / np.outer(scale, scale)
    return bound[:size, :size]
