"""Cogging: a torque that is periodic in the angle of the rotor and independent of the current.

Source: D. Hanselman, Brushless Permanent Magnet Motor Design, section 4.
"""

import math

from methods.effects.base import Effect, EffectParameter, instances, is_periodic


def torque(t, q, dq, w, x, p):
    """sine sin(N q) + cosine cos(N q)."""
    return p[0] * math.sin(p[2] * q) + p[1] * math.cos(p[2] * q)


EFFECT = Effect(
    name="cogging_torque",
    stage="motor",
    slot="torque",
    parameters=(
        EffectParameter("sine", "torque", "sine part of the torque"),
        EffectParameter("cosine", "torque", "cosine part of the torque"),
        EffectParameter("cycles_per_rev", "cycles per revolution", "cycles per revolution (2 pi per metre)", lower=1.5),
    ),
    equation=r"\tau_c = A\,\sin(N q + \varphi)",
    variable="position",
    source="Hanselman",
    amplitudes=(0, 1),
    function=torque,
    scan="position",
    turns=True,
    resolved=lambda p, s: is_periodic(p[2], s),
)

HARMONICS = 6
"""A motor's cogging has several harmonics; each is an instance of its own."""

EFFECTS = instances(EFFECT, HARMONICS)
