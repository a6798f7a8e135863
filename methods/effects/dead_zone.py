"""Dead zone of the amplifier: commands smaller than a threshold have no effect.

Source: G. Tao, P. V. Kokotovic, Adaptive Control of Systems with Actuator and Sensor Nonlinearities, Wiley 1996.
"""

import math

from methods.effects.base import Effect, EffectParameter


def command(u, t, q, dq, w, p):
    """0 for |u| <= voltage, else u - voltage sign(u)."""
    return 0.0 if abs(u) <= p[0] else u - math.copysign(p[0], u)


EFFECT = Effect(
    name="dead_zone",
    stage="amplifier",
    slot="command",
    parameters=(EffectParameter("voltage", "command", "half width of the dead zone", lower=0.0),),
    equation=r"v_a = v - v_0\,\mathrm{sign}(v)\ \mathrm{for}\ |v| > v_0,\ \mathrm{else}\ 0",
    variable="command",
    source="Tao and Kokotovic 1996",
    starts=lambda s: [(0.02 * s.command_rms,)],
    function=command,
)
