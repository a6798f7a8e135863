"""Coupling with another axis: its acceleration, velocity or command acts on this joint.

The joints of a planar pair are simulated together. What their inertias do to one another is in the nominal model there,
whatever its size; what is left are the other joint's velocity and motor torque.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9 (coupled transmissions).
"""

from dataclasses import replace

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
    excludes=("axis_coupling_in_a_pair",),
    starts=lambda s: [(0.01 * s.inertia, 0.01 * s.damping, 0.01)] if s.joints > 1 and not s.coupled else [],
    function=torque,
)


def torque_in_a_pair(t, q, dq, w, x, p):
    """velocity x1 + motor torque x2 of the other joint."""
    return p[0] * x[1] + p[1] * x[2]


IN_A_PAIR = replace(
    EFFECT,
    name="axis_coupling_in_a_pair",
    kind="axis_coupling",
    parameters=(
        EFFECT.parameters[1],
        EffectParameter("motor_torque", "ratio", "torque per motor torque of the other joint"),
    ),
    equation=r"\tau = c_v \dot q_k + c_\tau \tau_{m,k}",
    amplitudes=(0, 1),
    starts=lambda s: [(0.01 * s.damping, 0.01)] if s.coupled else [],
    excludes=("axis_coupling",),
    function=torque_in_a_pair,
)
"""The same for two joints that are simulated together."""
EFFECTS = (EFFECT, IN_A_PAIR)
