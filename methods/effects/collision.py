"""Collision: a torque pulse of short duration at an instant within the log.

Source: S. Haddadin, A. De Luca, A. Albu-Schaeffer, Robot collisions: a survey, IEEE T-RO 33 (2017).
"""

import math

from methods.effects.base import Effect, EffectParameter


def torque(t, q, dq, w, x, p):
    """-torque sin(pi (t - time) / duration)^shape while that is between its zeros: the collision pushes."""
    since = (t - p[1]) / p[2]
    if since <= 0.0 or since >= 1.0:
        return 0.0
    return -p[0] * math.sin(math.pi * since) ** p[3]


EFFECT = Effect(
    name="collision",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("torque", "torque", "height of the pulse"),
        EffectParameter("time", "time", "instant at which it begins"),
        EffectParameter("duration", "time", "length of the pulse", lower=1e-6),
        EffectParameter("shape", "ratio", "1: half a sine, towards 0: a box", lower=0.02, upper=4.0),
    ),
    equation=r"\tau_d = T \sin^s(\pi (t - t_0) / \Delta t)\ \mathrm{for}\ t_0 \leq t < t_0 + \Delta t",
    variable="elapsed time",
    source="Haddadin, De Luca, Albu-Schaeffer 2017",
    function=torque,
    scan="event",
)
