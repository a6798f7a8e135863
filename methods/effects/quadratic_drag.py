"""Quadratic drag: a resistance that grows with the square of the velocity.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9 (friction polynomials).
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter


def torque(t, q, dq, w, x, p):
    """coefficient |dq| dq."""
    return p[0] * abs(dq) * dq


EFFECT = Effect(
    name="quadratic_drag",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("coefficient", "torque per velocity squared", "torque per squared velocity", lower=0.0),
    ),
    equation=r"\tau_f = c\,|\dot q|\,\dot q",
    variable="velocity",
    source="Khalil and Dombre",
    starts=lambda s: [(0.02 * s.torque_rms / s.velocity_rms**2,)],
    function=torque,
)


def power(t, q, dq, w, x, p):
    """coefficient |dq|^(exponent - 1) dq."""
    return p[0] * math.pow(abs(dq), p[1] - 1.0) * dq


POWER = replace(
    EFFECT,
    name="quadratic_drag_power",
    kind="quadratic_drag",
    parameters=(
        EffectParameter("coefficient", "torque per velocity squared", "torque at unit velocity", lower=0.0),
        EffectParameter("exponent", "ratio", "power of the velocity", 1.4, 3.0, "both"),
    ),
    equation=r"\tau_f = c\,|\dot q|^{n-1} \dot q",
    starts=lambda s: [(0.02 * s.torque_rms / s.velocity_rms**n, n) for n in (1.7, 2.4)],
    function=power,
    includes=("quadratic_drag",),
    neutral=(2.0,),
    expected_failures=(("dimensions", "the unit of its coefficient depends on its exponent"),),
)
EFFECTS = (EFFECT, POWER)
