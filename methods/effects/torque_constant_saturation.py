"""Saturation of the torque constant: the iron saturates and the torque per current falls at high current.

Source: MuJoCo's and motor makers' rational law; D. Hanselman, Brushless Motors, section on saturation.
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter


def gain(t, q, dq, w, p):
    """1 / (1 + coefficient w^2)."""
    return 1.0 / (1.0 + p[0] * w * w)


EFFECT = Effect(
    name="torque_constant_saturation",
    stage="motor",
    slot="gain",
    parameters=(
        EffectParameter("coefficient", "1/command squared", "relative loss per squared motor torque", lower=0.0),
    ),
    equation=r"\tau_m = \alpha i / (1 + c\,i^2)",
    variable="motor torque",
    source="Hanselman",
    starts=lambda s: [(0.02 / s.torque_rms**2,)],
    function=gain,
    excludes=(
        "torque_constant_saturation_early",
        "torque_constant_saturation_levelling",
        "torque_constant_saturation_knee",
    ),
)


def power(t, q, dq, w, p):
    """1 / (1 + coefficient w^2 / exponent)^exponent."""
    return math.pow(abs(1.0 + p[0] * w * w / p[1]), -p[1])


POWER = replace(
    EFFECT,
    name="torque_constant_saturation_power",
    kind="torque_constant_saturation",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("exponent", "ratio", "of the fall at high torque, half of its power", 0.05, 8.0),
    ),
    equation=r"\tau_m = \alpha i / (1 + c\,i^2 / n)^n",
    starts=lambda s: [(0.02 / s.torque_rms**2, exponent) for exponent in (0.5, 2.0)],
    function=power,
    includes=("torque_constant_saturation",),
    neutral=(1.0,),
)


def early(t, q, dq, w, p):
    """1 / (1 + coefficient |w|)."""
    return 1.0 / (1.0 + p[0] * abs(w))


EARLY = replace(
    EFFECT,
    name="torque_constant_saturation_early",
    kind="torque_constant_saturation",
    parameters=(EffectParameter("coefficient", "1/command", "relative loss per motor torque", lower=0.0),),
    equation=r"\tau_m = \alpha i / (1 + c\,|i|)",
    starts=lambda s: [(0.02 / s.torque_rms,)],
    function=early,
    excludes=("torque_constant_saturation", "torque_constant_saturation_power"),
)


def levelling(t, q, dq, w, p):
    """1 - coefficient |w| / (1 + levelling coefficient |w|)."""
    loss = p[0] * abs(w)
    return max(0.0, 1.0 - loss / (1.0 + p[1] * loss))


LEVELLING = replace(
    EARLY,
    name="torque_constant_saturation_levelling",
    parameters=(
        *EARLY.parameters,
        EffectParameter("levelling", "ratio", "of the loss at high torque; with 0 it is 1 - c |i|", 0.0, 20.0),
    ),
    equation=r"\tau_m = \alpha i \left(1 - \frac{c\,|i|}{1 + l\,c\,|i|}\right)",
    starts=lambda s: [(0.02 / s.torque_rms, 0.0)],
    function=levelling,
    includes=("torque_constant_saturation_early",),
    neutral=(1.0,),
)
"""As a straight line has it, or iron of which a part saturates and the rest does not."""


def knee(t, q, dq, w, p):
    """(1 + |coefficient w|^sharpness)^(-1/sharpness)."""
    return math.pow(abs(1.0 + math.pow(abs(p[0] * w), p[1])), -1.0 / p[1])


KNEE = replace(
    EARLY,
    name="torque_constant_saturation_knee",
    parameters=(
        *EARLY.parameters,
        EffectParameter("sharpness", "ratio", "of the knee, beyond which more current gives no torque", 1.0, 5.0),
    ),
    equation=r"\tau_m = \alpha i / (1 + |c\,i|^n)^{1/n}",
    starts=lambda s: [(0.8 / s.torque_peak, sharpness) for sharpness in (2.0, 3.5)],
    function=knee,
    includes=("torque_constant_saturation_early",),
    neutral=(1.0,),
    excludes=(*EARLY.excludes, "torque_constant_saturation_levelling"),
)
"""Iron that gives its torque until it saturates: nothing is lost at first, and all beyond the knee."""
LEVELLING = replace(LEVELLING, excludes=(*LEVELLING.excludes, KNEE.name))
EFFECTS = (EFFECT, POWER, EARLY, LEVELLING, KNEE)
