"""Cable spring: cables and hoses pull the joint towards an angle of rest.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9 (springs).
"""

from methods.effects.base import Effect, EffectParameter


def torque(t, q, dq, w, x, p):
    """stiffness q - pull."""
    return p[0] * q - p[1]


EFFECT = Effect(
    name="cable_spring",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("stiffness", "torque per position", "torque per angle", lower=0.0),
        EffectParameter("pull", "torque", "stiffness times angle of rest"),
    ),
    equation=r"\tau = k\,(q - q_r)",
    variable="position",
    source="Khalil and Dombre",
    amplitudes=(0, 1),
    starts=lambda s: [(0.02 * s.torque_rms / s.position_span, 0.01 * s.torque_rms)],
    function=torque,
    includes=("amplifier_offset",),
)
