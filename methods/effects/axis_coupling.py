"""Coupling with another axis: its acceleration, velocity or command acts on this joint.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9 (coupled transmissions).
"""

from methods.effects.base import Effect, EffectParameter


def torque(t, q, dq, w, x, p):
    """acceleration x0 + velocity x1 + command x2 of the neighbour."""
    return p[0] * x[0] + p[1] * x[1] + p[2] * x[2]


EFFECT = Effect(
    name="axis_coupling",
    stage="transmission",
    slot="torque",
    parameters=(
        EffectParameter("acceleration", "inertia", "torque per acceleration of the neighbour"),
        EffectParameter("velocity", "torque per velocity", "torque per velocity of the neighbour"),
        EffectParameter("command", "ratio", "torque per command of the neighbour"),
    ),
    equation=r"\tau = c_a \ddot q_k + c_v \dot q_k + c_u u_k",
    variable="another joint",
    source="Khalil and Dombre",
    amplitudes=(0, 1, 2),
    starts=lambda s: [(0.01 * s.inertia, 0.01 * s.damping, 0.01)] if s.joints > 1 else [],
    function=torque,
)
