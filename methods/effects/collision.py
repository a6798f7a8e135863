"""Collision: a torque pulse of short duration at an instant within the log.

Source: S. Haddadin, A. De Luca, A. Albu-Schaeffer, Robot collisions: a survey, IEEE T-RO 33 (2017).
"""

from methods.effects.base import Effect, EffectParameter


def torque(t, q, dq, w, x, p):
    """torque for time <= t < time + duration, with edges softened over a tenth of the duration."""
    since = (t - p[1]) / p[2]
    if since <= -0.05 or since >= 1.05:
        return 0.0
    rise = min(1.0, (since + 0.05) / 0.1)
    fall = min(1.0, (1.05 - since) / 0.1)
    return p[0] * min(rise, fall)


EFFECT = Effect(
    name="collision",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("torque", "torque", "height of the pulse"),
        EffectParameter("time", "time", "instant at which it begins"),
        EffectParameter("duration", "time", "length of the pulse", lower=1e-6),
    ),
    equation=r"\tau_d = T\ \mathrm{for}\ t_0 \leq t < t_0 + \Delta t",
    variable="elapsed time",
    source="Haddadin, De Luca, Albu-Schaeffer 2017",
    function=torque,
    scan="event",
)
