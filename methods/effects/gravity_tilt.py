"""Tilted axis: gravity acts on a joint whose axis was taken to be vertical.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9.
"""

import math

from methods.effects.base import Effect, EffectParameter


def torque(t, q, dq, w, x, p):
    """sine sin(q) + cosine cos(q)."""
    return p[0] * math.sin(q) + p[1] * math.cos(q)


EFFECT = Effect(
    name="gravity_tilt",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("sine", "torque", "sine part of the torque"),
        EffectParameter("cosine", "torque", "cosine part of the torque"),
    ),
    equation=r"\tau_g = T\,\sin(q + \varphi)",
    variable="position",
    source="Khalil and Dombre",
    amplitudes=(0, 1),
    starts=lambda s: [(0.02 * s.torque_rms, 0.02 * s.torque_rms)] if s.revolute else [],
    function=torque,
)
