"""Presliding friction: bristles bend elastically before the joint slides (Dahl's law with bristle damping).

``z' = q' - |q'| z stiffness / torque``, friction ``stiffness z + damping z'``,
        damping ``2 damping_ratio sqrt(stiffness inertia)``. Stiff bristles are Coulomb friction.

Source: P. Dahl 1968; C. Canudas de Wit et al., A new model for control of systems with friction, IEEE TAC 40 (1995).
"""

from methods.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="presliding_friction",
    stage="arm",
    slot="structure",
    parameters=(
        EffectParameter("torque", "torque", "level in sliding", lower=0.0),
        EffectParameter("compliance", "position", "bristle deflection per torque (1 / stiffness)", lower=1e-12),
        EffectParameter(
            "damping_ratio", "ratio", "bristle damping over 2 sqrt(stiffness inertia)", lower=0.0, upper=2.0
        ),
    ),
    equation=r"\dot z = \dot q - |\dot q|\,\sigma_0 z/T_c,\ \tau_f = \sigma_0 z + \sigma_1 \dot z",
    variable="position since reversal",
    source="Dahl 1968; Canudas de Wit et al. 1995",
    includes=("coulomb_friction",),
    resolved=lambda p, s: p[0] * p[1] > 0.3 * s.encoder_step,
    amplitudes=(),
    starts=lambda s: [
        (level * s.torque_rms, deflection * s.position_span / (level * s.torque_rms), 0.1)
        for level in (0.03, 0.12)
        for deflection in (3e-4, 3e-3, 3e-2)
    ],
    substeps=2,
)
