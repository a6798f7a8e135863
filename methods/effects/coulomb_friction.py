"""Coulomb friction: a constant level of dry friction, with true stiction at rest.

Source: C. A. de Coulomb 1785; H. Olsson et al., Friction models and friction compensation, Eur. J. Control 4 (1998).
"""

from methods.effects.base import Effect, EffectParameter


def friction(t, q, dq, w, p):
    """torque."""
    return p[0]


EFFECT = Effect(
    name="coulomb_friction",
    stage="arm",
    slot="friction",
    parameters=(EffectParameter("torque", "torque", "level of dry friction", lower=0.0),),
    equation=r"\tau_f = T_c\,\mathrm{sign}(\dot q)",
    variable="velocity",
    source="Olsson et al. 1998",
    starts=lambda s: [(0.02 * s.torque_rms,)],
    function=friction,
)
