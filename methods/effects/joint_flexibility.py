"""Flexible joint: motor and load are joined by a spring and a damper; the encoder sits on the motor.

``J (1 - r) q'' = tau - F``, ``J r q_l'' = F``, ``F = (q - q_l) / compliance + damping (q' - q_l')``. The compliance
goes to zero continuously, which is why it, not the stiffness, is fitted.

Source: M. W. Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Syst. Meas. Control 109 (1987).
"""

import math

from methods.effects.base import Effect, EffectParameter


def starts(s):
    """Resonances of the free-free pair from 2 to 60 Hz (below half the Nyquist frequency), half of the load behind."""
    found = []
    for hertz in (2.0, 5.0, 12.0, 28.0, 60.0):
        if hertz < 0.25 / s.sample_time:
            stiffness = (2 * math.pi * hertz) ** 2 * s.inertia * 0.25
            found.append((1.0 / stiffness, 2 * 0.05 * stiffness / (2 * math.pi * hertz), 0.5))
    return found


EFFECT = Effect(
    name="joint_flexibility",
    stage="transmission",
    slot="structure",
    parameters=(
        EffectParameter("compliance", "position", "wind-up per input-equivalent torque", lower=0.0),
        EffectParameter("damping", "torque per velocity", "damping of the spring", lower=0.0),
        EffectParameter("inertia_ratio", "ratio", "share of the inertia behind the spring", lower=0.02, upper=0.98),
    ),
    equation=r"J(1-r)\ddot q = \tau - F,\ J r\,\ddot q_l = F,\ F = K(q-q_l) + D(\dot q-\dot q_l)",
    variable="acceleration",
    source="Spong 1987",
    amplitudes=(),
    starts=starts,
    substeps=2,
)
