"""Asymmetric friction: dry and viscous friction differ between the two directions.

``T+ = T + torque / 2``, ``T- = T - torque / 2`` and likewise for the viscous coefficient. A joint that dry friction
holds is held between ``-T-`` and ``T+``. Where only the dry part differs, by no more than there is of it, this is dry
friction and a constant torque: no log tells it from an offset of the amplifier.

Source: B. Armstrong-Helouvry, Control of Machines with Friction, 1991 (direction-dependent Coulomb and viscous terms).
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter
from methods.effects.coulomb_friction import ROUNDING, WIDTHS, turns_slowly


def torque(t, q, dq, w, x, p):
    """torque / 2 + viscous / 2 |dq|; at rest it shifts the band in which dry friction holds the joint."""
    return 0.5 * p[0] + 0.5 * p[1] * abs(dq)


EFFECT = Effect(
    name="friction_asymmetry",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("torque", "torque", "dry friction forwards minus backwards"),
        EffectParameter("viscous", "torque per velocity", "viscous coefficient forwards minus backwards"),
    ),
    equation=r"\tau_f = \Delta T/2 + \Delta b/2\,|\dot q|",
    variable="direction",
    source="Armstrong-Helouvry 1991",
    amplitudes=(0, 1),
    starts=lambda s: [(0.02 * s.torque_rms, 0.02 * s.torque_rms / s.velocity_rms)],
    function=torque,
    includes=("amplifier_offset", "amplifier_offset_at_output"),
    beside=("coulomb_friction", "stribeck_friction", "presliding_friction"),
)


def rounded(t, q, dq, w, x, p):
    """torque / 2 |tanh(dq / rounding)| + viscous / 2 |dq|."""
    return 0.5 * p[0] * abs(math.tanh(dq / p[2])) + 0.5 * p[1] * abs(dq)


ROUNDED = replace(
    EFFECT,
    name="rounded_friction_asymmetry",
    kind="friction_asymmetry",
    parameters=(*EFFECT.parameters, ROUNDING),
    equation=r"\tau_f = \Delta T/2\,|\tanh(\dot q/v_0)| + \Delta b/2\,|\dot q|",
    includes=("friction_asymmetry", "amplifier_offset", "amplifier_offset_at_output"),
    beside=(),
    resolved=lambda p, s: turns_slowly(p[2], s),
    starts=lambda s: [
        (0.02 * s.torque_rms, 0.02 * s.torque_rms / s.velocity_rms, share * s.velocity_rms) for share in WIDTHS
    ],
    function=rounded,
)
EFFECTS = (EFFECT, ROUNDED)
