"""Quadratic drag: a resistance that grows with the square of the velocity.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9 (friction polynomials).
"""

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
