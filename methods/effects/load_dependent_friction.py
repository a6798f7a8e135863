"""Load-dependent friction: dry friction in proportion to the torque that the transmission carries.

Source: P. Hamon, M. Gautier, P. Garrec, New dry friction model with load- and velocity-dependence, IEEE ICRA 2011.
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter
from methods.effects.coulomb_friction import ROUNDING, WIDTHS, turns_slowly


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


def rounded(t, q, dq, w, x, p):
    """coefficient |w| tanh(dq / rounding)."""
    return p[0] * abs(w) * math.tanh(dq / p[1])


ROUNDED = replace(
    EFFECT,
    name="rounded_load_dependent_friction",
    kind="load_dependent_friction",
    slot="torque",
    parameters=(*EFFECT.parameters, ROUNDING),
    equation=r"\tau_f = \mu\,|\tau|\,\tanh(\dot q/v_0)",
    includes=("load_dependent_friction",),
    resolved=lambda p, s: turns_slowly(p[1], s),
    starts=lambda s: [(0.02, share * s.velocity_rms) for share in WIDTHS],
    function=rounded,
)
EFFECTS = (EFFECT, ROUNDED)
