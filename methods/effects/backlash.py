"""Backlash: motor and load are joined through a play; the encoder sits on the motor.

Inside the play no force acts; beyond it a stiff contact does, with the frequency and the damping ratio of the load on
it (see `joint_flexibility` for the equations). With no inertia behind the play it has no effect; with no play it is a
flexible joint.

Source: M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash: a survey, Automatica 38 (2002).
"""

from dataclasses import replace

from methods.effects.base import Effect, EffectParameter, geometric, grid, is_readable
from methods.effects.load_dependent_friction import BY_THE_LINK


def starts(s):
    """Gaps relative to the motion, contacts well above the motion."""
    gaps = geometric(max(2.0 * s.encoder_step, 1e-4 * s.position_span), 0.1 * s.position_span, 2.5)
    return grid(gaps, (0.15, 0.5), (min(30.0, 0.1 / s.sample_time),), (0.3,))


EFFECT = Effect(
    name="backlash",
    stage="transmission",
    slot="structure",
    parameters=(
        EffectParameter("gap", "position", "total width of the play", lower=0.0),
        EffectParameter("inertia_ratio", "ratio", "share of the inertia behind the play", lower=0.0, upper=0.98),
        EffectParameter("frequency", "frequency", "of the load on the contact, the motor standing still", lower=1e-3),
        EffectParameter("damping_ratio", "ratio", "of the load on the contact, the motor standing still", 0.0, 2.0),
    ),
    equation=r"F = K\,(\delta - \mathrm{clip}(\delta, \pm b/2)),\ \delta = q - q_l",
    variable="direction",
    source="Nordin and Gutman 2002",
    amplitudes=(1,),
    scatters=True,
    starts=starts,
    resolved=lambda p, s: is_readable(p[0], s),
    tries=3,
    excludes=("joint_flexibility", "joint_flexibility_load_side", "backlash_load_side", BY_THE_LINK),
    includes=("joint_flexibility",),
    expected_failures=(
        (
            "sensitivities_are_finite_differences",
            "a contact that opens and closes has no derivative by the gap",
        ),
    ),
)

LOAD_SIDE = replace(
    EFFECT,
    name="backlash_load_side",
    kind="backlash",
    parameters=(EFFECT.parameters[0], replace(EFFECT.parameters[1], lower=0.1), *EFFECT.parameters[2:]),
    amplitudes=(),
    excludes=("joint_flexibility", "joint_flexibility_load_side", "backlash", BY_THE_LINK),
    includes=("joint_flexibility_load_side",),
    starts=lambda s: [values for values in starts(s) if values[1] == 0.5],
)
"""The same with the encoder behind the play, which sees it even where little inertia hangs behind it."""
POWER = replace(
    EFFECT,
    name="backlash_power",
    kind="backlash",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("exponent", "ratio", "of the contact: 1.5 by Hertz", 0.8, 2.5, "both"),
    ),
    equation=r"F = K\,x\,|2x/b|^{n-1},\ x = \delta - \mathrm{clip}(\delta, \pm b/2),\ \delta = q - q_l",
    source="Hunt and Crossley 1975",
    excludes=("joint_flexibility", "joint_flexibility_load_side", "backlash_load_side", BY_THE_LINK),
    includes=("backlash",),
    neutral=(1.0,),
    after=("backlash",),
    starts=lambda s: [(*values, 1.5) for values in starts(s)[:1]],
    expected_failures=(),
)
"""A contact that hardens: frequency and damping are those half a gap deep."""
EFFECTS = (EFFECT, LOAD_SIDE, POWER)
