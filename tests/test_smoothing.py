"""Accelerations from noisy readings: a Wiener filter keeps fast motion that long local polynomials take away."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.problem import smooth_derivatives
from diagnosis.smoothing import motion_of, window

DT = 4e-3
TIME = DT * np.arange(5000)
PARTS = ((0.6, 0.5), (0.2, 1.3), (0.02, 6.0))
"""Amplitudes [rad] and frequencies [Hz]."""


def motion(phase: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q, dq, ddq = (np.zeros(len(TIME)) for _ in range(3))
    for size, hertz in PARTS:
        omega = 2.0 * np.pi * hertz
        q += size * np.sin(omega * TIME + phase)
        dq += size * omega * np.cos(omega * TIME + phase)
        ddq -= size * omega**2 * np.sin(omega * TIME + phase)
    return q, dq, ddq


@pytest.mark.parametrize("noise", [3e-5, 1e-4])
def test_fast_motion_passes_the_filter(noise: float) -> None:
    exact = [np.column_stack(both) for both in zip(motion(0.0), motion(1.0), strict=True)]
    reading = exact[0] + 3.0 * TIME[:, None] + noise * np.random.default_rng(0).standard_normal(exact[0].shape)
    seconds = window([(TIME, reading)])
    found, local = motion_of(TIME, reading, seconds), smooth_derivatives(TIME, reading, seconds)
    exact[0], exact[1] = exact[0] + 3.0 * TIME[:, None], exact[1] + 3.0
    for order in (1, 2):
        size = np.std(exact[order])
        assert np.std(found[order] - exact[order]) < 0.4 * np.std(local[order] - exact[order])
        assert np.std(found[order] - exact[order]) < 0.02 * size
    assert np.std(found[0] - exact[0]) < 2.0 * noise


def test_short_readings_are_smoothed_locally() -> None:
    reading = motion(0.0)[0][:70, None] + 1e-4 * np.random.default_rng(0).standard_normal((70, 1))
    found, local = (function(TIME[:70], reading, 0.1) for function in (motion_of, smooth_derivatives))
    assert all(np.array_equal(a, b) for a, b in zip(found, local, strict=True))
