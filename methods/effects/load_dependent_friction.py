"""Load-dependent friction: dry friction in proportion to the torque that the transmission carries.

Source: P. Hamon, M. Gautier, P. Garrec, New dry friction model with load- and velocity-dependence, IEEE ICRA 2011.
"""

from methods.effects.base import Effect, EffectParameter


def friction(t, q, dq, w, p):
    """coefficient |w|."""
    return p[0] * abs(w)


EFFECT = Effect(
    name="load_dependent_friction",
    stage="arm",
    slot="friction",
    parameters=(EffectParameter("coefficient", "ratio", "friction per transmitted torque", lower=0.0),),
    equation=r"\tau_f = \mu\,|\tau|\,\mathrm{sign}(\dot q)",
    variable="motor torque",
    source="Hamon, Gautier, Garrec 2011",
    starts=lambda s: [(0.02,)],
    function=friction,
)
