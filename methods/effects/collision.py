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


def moments(shape):
    """Mean and variance over its length of a pulse of height and length 1."""
    instants = [(i + 0.5) / 200.0 for i in range(200)]
    heights = [-torque(x, 0.0, 0.0, 0.0, (), (1.0, 0.0, 1.0, shape)) for x in instants]
    mean = sum(heights) / 200.0
    return mean, sum(h * (x - 0.5) ** 2 for x, h in zip(instants, heights, strict=True)) / (200.0 * mean)


def across(p):
    """The pulse of the other kind, edged or a power of half a sine, with the same middle, impulse and variance: at a
    shape of 1, where both meet, either may be farther from what is seen than before."""
    shape = 2.0 if p[3] <= 1.0 else 0.5
    (mean, variance), (other_mean, other_variance) = moments(p[3]), moments(shape)
    lasts = p[2] * math.sqrt(variance / other_variance)
    return [(p[0] * p[2] * mean / (lasts * other_mean), p[1] + 0.5 * (p[2] - lasts), lasts, shape)]


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
    across=across,
)
