"""Load-dependent friction: dry friction in proportion to the torque that the transmission carries.

That is the motor's torque or, behind the inertia of a motor that is no small part of the joint's, what is left for the
arm: ``load = share inertia q'' + torque of the arm's position``.

Source: P. Hamon, M. Gautier, P. Garrec, New dry friction model with load- and velocity-dependence, IEEE ICRA 2011.
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter
from methods.effects.coulomb_friction import ROUNDING, WIDTHS, turns_slowly

BY_THE_LINK = "link_load_dependent_friction"
SPRINGS = tuple(f"joint_flexibility{form}" for form in ("", "_load_side", "_stiffening", "_stiffening_load_side"))
PLAYS = ("backlash", "backlash_load_side", "backlash_power")


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
LINK = replace(
    EFFECT,
    name=BY_THE_LINK,
    kind="load_dependent_friction",
    parameters=(
        *EFFECT.parameters,
        EffectParameter(
            "link_share",
            "ratio",
            "share of the inertia behind it; without a weight only its product with the coefficient is seen",
            0.0,
            1.0,
        ),
    ),
    equation=r"\tau_f = \mu\,|s\,J\ddot q + \tau_{arm}|\,\mathrm{sign}(\dot q)",
    excludes=(EFFECT.name, ROUNDED.name, *SPRINGS, *PLAYS),
    starts=lambda s: [] if s.coupled else [(0.02, 0.0), (0.02, 0.9)],
)
"""Friction by the torque that the arm takes; the kernel knows it by its name, for it depends on the acceleration that
it has a part in. Not for planar pairs, nor beside a spring, whose torque this is."""
EFFECT = replace(EFFECT, excludes=(LINK.name,))
ROUNDED = replace(ROUNDED, excludes=(LINK.name,))
EFFECTS = (EFFECT, ROUNDED, LINK)
