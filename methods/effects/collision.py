"""Collision: a torque pulse of short duration at an instant within the log.

Source: S. Haddadin, A. De Luca, A. Albu-Schaeffer, Robot collisions: a survey, IEEE T-RO 33 (2017).
"""

import math

from methods.effects.base import Effect, EffectParameter


def torque(t, q, dq, w, x, p):
    """-torque between time and time + duration: the collision pushes. It rises and falls along half a cosine each."""
    since = (t - p[1]) / p[2]
    near = min(since, 1.0 - since)
    if near <= 0.0:
        return 0.0
    if near >= 0.5 * p[3]:
        return -p[0]
    return -0.5 * p[0] * (1.0 - math.cos(2.0 * math.pi * near / p[3]))


EFFECT = Effect(
    name="collision",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("torque", "torque", "height of the pulse"),
        EffectParameter("time", "time", "instant at which it begins"),
        EffectParameter("duration", "time", "length of the pulse", lower=1e-6),
        EffectParameter("shape", "ratio", "share of the length in which it rises and falls", lower=0.02, upper=1.0),
    ),
    equation=r"\tau_d = T\,w((t - t_0) / \Delta t),\ w:\ \mathrm{tapered\ cosine\ window}",
    variable="elapsed time",
    source="Haddadin, De Luca, Albu-Schaeffer 2017",
    function=torque,
    scan="event",
)
