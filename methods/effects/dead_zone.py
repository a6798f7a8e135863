"""Dead zone of the amplifier: commands smaller than a threshold have no effect.

Source: G. Tao, P. V. Kokotovic, Adaptive Control of Systems with Actuator and Sensor Nonlinearities, Wiley 1996.
"""

import math
from dataclasses import replace

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


def gradual(u, t, q, dq, w, p):
    """u (1 - voltage / (|u|^sharpness + voltage^sharpness)^(1/sharpness))."""
    ratio = abs(u) / max(p[0], 1e-12)
    small = min(ratio, 1.0 / max(ratio, 1e-300))
    return u * (1.0 - math.pow(abs(1.0 + math.pow(abs(small), p[1])), -1.0 / p[1]) / max(ratio, 1.0))


GRADUAL = replace(
    EFFECT,
    name="gradual_dead_zone",
    kind="dead_zone",
    parameters=(
        *EFFECT.parameters,
        EffectParameter(
            "sharpness", "ratio", "of the transition; a dead zone with corners beyond 20", 1.0, 60.0, "lower"
        ),
    ),
    equation=r"v_a = v\,[1 - v_0 / (|v|^n + v_0^n)^{1/n}]",
    includes=("dead_zone",),
    neutral=(30.0,),
    starts=lambda s: [(0.02 * s.command_rms, sharpness) for sharpness in (2.0, 6.0)],
    function=gradual,
)
EFFECTS = (EFFECT, GRADUAL)
