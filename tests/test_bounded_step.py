"""Steps of a fit between bounds, against a solver for bounded least squares."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from diagnosis.estimation import bounded_step


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**31), size=st.integers(1, 7), decades=st.floats(0.0, 3.0))
def test_a_step_is_the_best_one_beside_the_bounds_that_it_meets(seed: int, size: int, decades: float) -> None:
    rng = np.random.default_rng(seed)
    jacobian = rng.standard_normal((3 * size, size)) * 10.0 ** (decades * rng.standard_normal(size))
    target, scale = rng.standard_normal(3 * size), 1.0 / np.linalg.norm(jacobian, axis=0)
    lower, upper = -scale * rng.exponential(size=size), scale * rng.exponential(size=size)
    lower[rng.random(size) < 0.3], upper[rng.random(size) < 0.3] = -np.inf, np.inf
    step = bounded_step(jacobian.T @ jacobian, jacobian.T @ target, lower, upper)
    assert np.all((step >= lower) & (step <= upper))
    met = (step == lower) | (step == upper)
    slope = jacobian.T @ (jacobian @ step + target)
    assert np.allclose((slope * scale)[~met], 0.0, atol=1e-6)
    clipped = np.clip(np.linalg.lstsq(jacobian, -target, rcond=None)[0], lower, upper)
    left = lambda x: float(np.sum((jacobian @ x + target) ** 2))  # noqa: E731
    assert left(step) <= left(clipped) * (1.0 + 1e-9)
    best = lsq_linear(jacobian * scale, -target, (lower / scale, upper / scale), tol=1e-12).x * scale
    assert left(best) <= left(step) * (1.0 + 1e-9)


def test_what_would_follow_another_one_beyond_its_bound_stays_with_it() -> None:
    """In the valley x = -y towards y = 1, with x at its lower bound already: clipped, the step leaves the valley."""
    jacobian, target = np.array([[1.0, 1.0], [0.0, 1e-3]]), np.array([0.0, -1e-3])
    step = bounded_step(jacobian.T @ jacobian, jacobian.T @ target, np.array([0.0, -9.0]), np.full(2, 9.0))
    assert step[0] == 0.0
    assert 0.0 < step[1] < 1e-5
