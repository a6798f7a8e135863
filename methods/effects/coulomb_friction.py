"""Coulomb friction: a constant level of dry friction, with true stiction at rest.

Simulators have it as a constraint, too, that takes a velocity away as fast as a torque of that level can, and holds a
share of the other torques against the joint (``frictionloss`` in MuJoCo).

Source: C. A. de Coulomb 1785; H. Olsson et al., Friction models and friction compensation, Eur. J. Control 4 (1998).
"""

import math
from dataclasses import replace

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
    starts=lambda s: [(share * s.torque_rms,) for share in (0.02, 0.3, 1.0)],  # large: the joint rests for long
    function=friction,
)

ROUNDING = EffectParameter("rounding", "velocity", "over which the torque turns: no stiction below it", lower=1e-9)
QUICK = 0.03
"""Share of the velocity gained in a sample below which a rounding cannot be told from a sign."""
SETTLED = 0.5
"""Share of a sample in which a constraint that settles cannot be told from stiction."""
WIDTHS = (0.01, 0.03, 0.1, 0.3)
"""Velocities over which friction turns, as shares of the rms velocity, that are tried."""


def turns_slowly(rounding, s):
    """Whether friction of this rounding [rad/s, m/s] takes so long to turn that logs of scales `s` can show it."""
    return rounding > QUICK * min(s.torque_rms / s.inertia, s.acceleration_rms) * s.sample_time


def rounded(t, q, dq, w, x, p):
    """torque tanh(dq / rounding)."""
    return p[0] * math.tanh(dq / p[1])


def tapered(t, q, dq, w, x, p):
    """torque r / (1 + |r|^taper)^(1 / taper), r = dq / rounding."""
    ratio = abs(dq) / p[1]
    small = min(ratio, 1.0 / max(ratio, 1e-300))
    return math.copysign(p[0] * min(ratio, 1.0) * math.pow(abs(1.0 + math.pow(abs(small), p[2])), -1.0 / p[2]), dq)


ROUNDED = replace(
    EFFECT,
    name="rounded_coulomb_friction",
    kind="coulomb_friction",
    slot="torque",
    parameters=(*EFFECT.parameters, ROUNDING),
    equation=r"\tau_f = T_c\,\tanh(\dot q/v_0)",
    source="S. Andersson, A. Soderberg, S. Bjorklund, Friction models for sliding dry contacts, Tribol. Int. 40 (2007)",
    includes=("coulomb_friction",),
    starts=lambda s: [(0.02 * s.torque_rms, share * s.velocity_rms) for share in WIDTHS],
    function=rounded,
    resolved=lambda p, s: turns_slowly(p[1], s),
    tries=2,
)
TAPERED = replace(
    ROUNDED,
    name="tapered_coulomb_friction",
    parameters=(
        *ROUNDED.parameters,
        EffectParameter(
            "taper", "ratio", "1 like an arc tangent, 3 like a hyperbolic tangent, 20 with a corner", 0.7, 30.0, "lower"
        ),
    ),
    equation=r"\tau_f = T_c\,\dot q / (v_0^n + |\dot q|^n)^{1/n}",
    includes=("rounded_coulomb_friction", "coulomb_friction"),
    neutral=(2.6,),
    starts=lambda s: [(0.02 * s.torque_rms, share * s.velocity_rms, 1.5) for share in WIDTHS],
    function=tapered,
    tries=1,
)
CONSTRAINED = replace(
    EFFECT,
    name="constrained_coulomb_friction",
    kind="coulomb_friction",
    slot="structure",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("recovery_time", "time", "in which the constraint takes a velocity away", lower=1e-6),
        EffectParameter("hold", "ratio", "share of the other torques that is held: 1 is true stiction", 0.0, 1.0),
    ),
    equation=r"\tau_f = \mathrm{sat}_{T_c}\!\left(\kappa\,(\tau + J\dot q/t_r)\right)",
    source="E. Todorov, Convex and analytically-invertible dynamics with contacts and constraints, ICRA 2014",
    includes=("coulomb_friction", "rounded_coulomb_friction", "tapered_coulomb_friction"),
    resolved=lambda p, s: p[1] > SETTLED * s.sample_time,
    starts=lambda s: [
        (0.02 * s.torque_rms, share * s.velocity_rms * s.inertia / s.torque_rms, 0.8) for share in WIDTHS
    ],
    function=None,
    tries=2,
)
EFFECTS = (EFFECT, ROUNDED, TAPERED, CONSTRAINED)
