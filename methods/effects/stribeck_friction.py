"""Stribeck friction: dry friction that falls from a static level to the Coulomb level as the joint speeds up.

Source: B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, A survey of models ... Automatica 30 (1994).
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter
from methods.effects.coulomb_friction import ROUNDING, turns_slowly


def friction(t, q, dq, w, p):
    """torque + excess exp(-|dq / velocity|^exponent)."""
    return p[0] + p[1] * math.exp(-math.pow(abs(dq / p[2]), p[3]))


EFFECT = Effect(
    name="stribeck_friction",
    stage="arm",
    slot="friction",
    parameters=(
        EffectParameter("torque", "torque", "Coulomb level", lower=0.0),
        EffectParameter("excess", "torque", "static level minus Coulomb level", lower=0.0),
        EffectParameter("velocity", "velocity", "Stribeck velocity", lower=1e-9),
        EffectParameter(
            "exponent", "ratio", "shape: 2 in the Gaussian, 1 in the exponential form", lower=0.5, upper=3.0
        ),
    ),
    equation=r"\tau_f = [T_c + (T_s - T_c)\,e^{-|\dot q/v_s|^{\delta}}]\,\mathrm{sign}(\dot q)",
    variable="velocity",
    source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
    amplitudes=(0, 1),
    starts=lambda s: [
        (0.02 * s.torque_rms, 0.01 * s.torque_rms, fraction * s.velocity_rms, 1.5)
        for fraction in (0.03, 0.1, 0.25, 0.6)
    ],
    function=friction,
    includes=("coulomb_friction",),
    excludes=("rounded_coulomb_friction", "tapered_coulomb_friction"),
    expected_failures=(("linear_in_amplitudes", "a joint sticks or slips near rest, however small the friction"),),
)


def rounded(t, q, dq, w, x, p):
    """(torque + excess exp(-|dq / velocity|^exponent)) tanh(dq / rounding).

    The rounding is at most the velocity: beyond that there is no peak that friction falls from.
    """
    return (p[0] + p[1] * math.exp(-math.pow(abs(dq / p[2]), p[3]))) * math.tanh(dq / min(p[4], p[2]))


ROUNDED = replace(
    EFFECT,
    name="rounded_stribeck_friction",
    kind="stribeck_friction",
    slot="torque",
    parameters=(*EFFECT.parameters, ROUNDING),
    equation=r"\tau_f = [T_c + (T_s - T_c)\,e^{-|\dot q/v_s|^{\delta}}]\,\tanh(\dot q/v_0)",
    includes=("stribeck_friction", "coulomb_friction", "rounded_coulomb_friction"),
    after=("rounded_coulomb_friction",),
    starts=lambda s: [
        (0.02 * s.torque_rms, 0.01 * s.torque_rms, share * s.velocity_rms, 1.5, rounding * share * s.velocity_rms)
        for share, rounding in ((0.1, 0.02), (0.1, 0.05), (0.1, 0.15), (0.25, 0.15), (0.6, 0.15))
    ],
    function=rounded,
    resolved=lambda p, s: turns_slowly(p[4], s) and p[4] < p[2],
    expected_failures=(),
)


def tailed(t, q, dq, w, p):
    """torque + excess (1 + tail |dq / velocity|^exponent)^(-1 / tail)."""
    return p[0] + p[1] * math.pow(abs(1.0 + p[4] * math.pow(abs(dq / p[2]), p[3])), -1.0 / p[4])


TAILED = replace(
    EFFECT,
    name="tailed_stribeck_friction",
    kind="stribeck_friction",
    parameters=(
        *EFFECT.parameters,
        EffectParameter(
            "tail",
            "ratio",
            "slowness of the fall at high velocity: 0 the exponential, 1 the Lorentzian form",
            1e-3,
            2.0,
        ),
    ),
    equation=r"\tau_f = [T_c + (T_s - T_c)\,(1 + h\,|\dot q/v_s|^{\delta})^{-1/h}]\,\mathrm{sign}(\dot q)",
    source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994; Lorentzian: Hess, Soom 1990",
    includes=("stribeck_friction", "coulomb_friction"),
    after=("stribeck_friction",),
    starts=lambda s: [
        (0.02 * s.torque_rms, 0.01 * s.torque_rms, share * s.velocity_rms, 2.0, 1.0) for share in (0.03, 0.1, 0.25, 0.6)
    ],
    function=tailed,
    neutral=(1e-3,),
)
EFFECTS = (EFFECT, ROUNDED, TAILED)
