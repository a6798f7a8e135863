"""Backlash: motor and load are joined through a play; the encoder sits on the motor.

Inside the play no force acts; beyond it a stiff, damped contact does. With a gap of zero the pair is nearly rigid.

Source: M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash: a survey, Automatica 38 (2002).
"""

import math

from methods.effects.base import Effect, EffectParameter


def starts(s):
    """Gaps relative to the motion, contact resonances well above the motion, load shares."""
    found = []
    for gap in (3e-4, 1e-3, 4e-3, 1.5e-2):
        hertz = min(30.0, 0.1 / s.sample_time)
        compliance = 1.0 / ((2 * math.pi * hertz) ** 2 * s.inertia * 0.25)
        found.append((gap * s.position_span, 0.5, compliance))
    return found


EFFECT = Effect(
    name="backlash",
    stage="transmission",
    slot="structure",
    parameters=(
        EffectParameter("gap", "position", "total width of the play", lower=0.0),
        EffectParameter("inertia_ratio", "ratio", "share of the inertia behind the play", lower=0.02, upper=0.98),
        EffectParameter("compliance", "position", "wind-up of the contact per input-equivalent torque", lower=0.0),
    ),
    equation=r"F = K\,(\delta - \mathrm{clip}(\delta, \pm b/2)),\ \delta = q - q_l",
    variable="direction",
    source="Nordin and Gutman 2002",
    amplitudes=(),
    starts=starts,
    substeps=4,
    expected_failures=(
        (
            "sensitivities_are_finite_differences",
            "a contact that opens and closes has no derivative by the gap",
        ),
    ),
)
