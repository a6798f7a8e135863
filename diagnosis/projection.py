"""Linear least squares on few columns of many samples."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from envs.log import Array


def project(
    basis: Array, target: Array, certainty: Array | None = None, expected: Array | None = None
) -> tuple[Array, float]:
    """Least-squares coefficients of target (N,) on basis (K, N) and the decrease of the sum of squares.

    certainty (K,): one over the variances of the coefficients, where they are expected (K,) beforehand. Where a signal
    is not finite, as that of a model that runs away, nothing is explained.
    """
    return solve(basis @ basis.T, basis @ target, certainty, expected)


def solve(
    gram: Array, right: Array, certainty: Array | None = None, expected: Array | None = None
) -> tuple[Array, float]:
    """`project` by the products of the basis with itself (K, K) and with the target (K,)."""
    if certainty is not None and expected is not None:
        gram = gram + np.diag(certainty)
        right = right + certainty * expected
    if not (np.all(np.isfinite(gram)) and np.all(np.isfinite(right))):
        return np.zeros(len(right)), 0.0
    diagonal = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    try:
        factor = cho_factor(gram / np.outer(diagonal, diagonal) + 1e-10 * np.eye(len(gram)))
        coefficients = cho_solve(factor, right / diagonal) / diagonal
    except np.linalg.LinAlgError:
        coefficients = np.linalg.lstsq(gram, right, rcond=1e-10)[0]
    return coefficients, float(right @ coefficients)
