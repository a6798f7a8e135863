"""Collision: a torque pulse of short duration at an instant within the log.

Source: S. Haddadin, A. De Luca, A. Albu-Schaeffer, Robot collisions: a survey, IEEE T-RO 33 (2017).
"""

import math

from methods.effects.base import Effect, EffectParameter


def torque(t, q, dq, w, x, p):
    """-torque between time and time + duration: the collision pushes. It rises and falls along a squared sine each,
    over a share of its length up to all of it; from there on the power of the sine falls from 2 to 1 and below."""
    since = (t - p[1]) / p[2]
    near = min(since, 1.0 - since)
    if near <= 0.0:
        return 0.0
    taper = min(p[3], 1.0)
    if near >= 0.5 * taper:
        return -p[0]
    s = math.sin(math.pi * near / taper)
    if p[3] <= 1.0:
        return -p[0] * s * s
    return -p[0] * s ** (3.0 - p[3])


EFFECT = Effect(
    name="collision",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("torque", "torque", "height of the pulse"),
        EffectParameter("time", "time", "instant at which it begins"),
        EffectParameter("duration", "time", "length of the pulse", lower=1e-6),
        EffectParameter(
            "shape",
            "ratio",
            "share of the length in which it rises and falls; above 1: 3 less the power of half a sine",
            lower=0.02,
            upper=2.5,
        ),
    ),
    equation=(
        r"\tau_d = T\,w((t - t_0) / \Delta t),"
        r"\ w:\ \mathrm{tapered\ cosine\ window\ or\ power\ of\ half\ a\ sine}"
    ),
    variable="elapsed time",
    source="Haddadin, De Luca, Albu-Schaeffer 2017",
    function=torque,
    scan="event",
)
