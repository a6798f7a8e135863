"""Presliding friction: bristles bend elastically before the joint slides (Dahl's law with bristle damping).

``z' = q' - |q'| z / deflection``, friction ``torque (z + damping_time z') / deflection``. It is linear in the torque;
bristles that hardly bend are Coulomb friction. In Dahl's general law the bristle's slope falls with a power of what is
left to the level of sliding, ``z' = q' (1 - sign(q') z / deflection)^exponent``. In the LuGre model this level falls
from a static one to the Coulomb level as the joint speeds up: ``deflection`` is then multiplied by
``1 + rise exp(-|q' / velocity|^fall_exponent)`` where it stands in ``z'``.

Source: P. Dahl 1968; C. Canudas de Wit et al., A new model for control of systems with friction, IEEE TAC 40 (1995).
"""

from dataclasses import replace

from methods.effects.base import Effect, EffectParameter, geometric, is_readable
from methods.effects.coulomb_friction import turns_slowly


def starts(s):
    """Deflections from what the encoder resolves to a third of the motion."""
    least = max(s.encoder_step, 1e-4 * s.position_span)
    return [(0.05 * s.torque_rms, deflection, 0.0) for deflection in geometric(least, 0.3 * s.position_span, 3.0)]


def is_seen(p, s):
    """Whether logs can show bristles that bend and slide: those that bend as far as the joint goes are a spring."""
    return is_readable(p[1], s) and p[1] < s.position_span


EFFECT = Effect(
    name="presliding_friction",
    stage="arm",
    slot="structure",
    parameters=(
        EffectParameter("torque", "torque", "level in sliding", lower=0.0),
        EffectParameter("deflection", "position", "of the bristles in sliding", lower=1e-12),
        EffectParameter("damping_time", "time", "bristle damping over stiffness", lower=0.0),
    ),
    equation=r"\dot z = \dot q - |\dot q|\,\sigma_0 z/T_c,\ \tau_f = \sigma_0 z + \sigma_1 \dot z",
    variable="position since reversal",
    source="Dahl 1968; Canudas de Wit et al. 1995",
    includes=("coulomb_friction",),
    resolved=is_seen,
    starts=starts,
    tries=2,
)

POWER = replace(
    EFFECT,
    name="presliding_friction_power",
    kind="presliding_friction",
    parameters=(*EFFECT.parameters, EffectParameter("exponent", "ratio", "of Dahl's law", 0.5, 4.0)),
    equation=r"\dot z = \dot q\,(1 - \mathrm{sign}(\dot q)\,\sigma_0 z/T_c)^n,\ \tau_f = \sigma_0 z + \sigma_1 \dot z",
    includes=("presliding_friction", "coulomb_friction"),
    neutral=(1.0,),
    excludes=("presliding_friction_stribeck",),
    starts=lambda s: [(*values, 2.0) for values in starts(s)],
    tries=1,
)

LUGRE = replace(
    EFFECT,
    name="presliding_friction_stribeck",
    kind="presliding_friction",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("rise", "ratio", "static level over Coulomb level, minus 1", lower=0.0, upper=20.0),
        EffectParameter("velocity", "velocity", "Stribeck velocity", lower=1e-9),
        EffectParameter("fall_exponent", "ratio", "2 in the Gaussian, 1 in the exponential form", lower=0.5, upper=3.0),
    ),
    equation=(
        r"\dot z = \dot q - |\dot q|\,\sigma_0 z/g,\ g = T_c + (T_s - T_c)\,e^{-|\dot q/v_s|^{\delta}},"
        r"\ \tau_f = \sigma_0 z + \sigma_1 \dot z"
    ),
    includes=("presliding_friction", "stribeck_friction", "coulomb_friction"),
    excludes=("presliding_friction_power",),
    resolved=lambda p, s: is_seen(p, s) and turns_slowly(p[4], s) and p[4] < s.velocity_peak,  # or it never falls
    starts=lambda s: [
        (*values, 0.5, share * s.velocity_rms, 1.5) for values in starts(s)[::2] for share in (0.03, 0.1, 0.3)
    ],
    tries=1,
)
EFFECTS = (EFFECT, POWER, LUGRE)
