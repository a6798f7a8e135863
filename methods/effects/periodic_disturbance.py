"""Periodic disturbance: a torque that is periodic in time, whatever the joint does.

Source: B. A. Francis, W. M. Wonham, The internal model principle of control theory, Automatica 12 (1976).
"""

import math

from methods.effects.base import Effect, EffectParameter


def torque(t, q, dq, w, x, p):
    """-[sine sin(2 pi f t) + cosine cos(2 pi f t)]: the disturbance pushes."""
    angle = 2.0 * math.pi * p[2] * t
    return -p[0] * math.sin(angle) - p[1] * math.cos(angle)


EFFECT = Effect(
    name="periodic_disturbance",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("sine", "torque", "sine part of the torque"),
        EffectParameter("cosine", "torque", "cosine part of the torque"),
        EffectParameter("frequency", "frequency", "frequency", lower=1e-6),
    ),
    equation=r"\tau_d = T\,\sin(2\pi f t + \varphi)",
    variable="elapsed time",
    source="Francis and Wonham 1976",
    amplitudes=(0, 1),
    function=torque,
    scan="time",
    expected_failures=(
        (
            "recovers_itself",
            "in a log without noise a pure tone is predicted from its own past by the whitening filter",
        ),
    ),
)
