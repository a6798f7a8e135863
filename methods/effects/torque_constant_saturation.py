"""Saturation of the torque constant: the iron saturates and the torque per current falls at high current.

Source: MuJoCo's and motor makers' rational law; D. Hanselman, Brushless Motors, section on saturation.
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter, exclusive


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


def tanh(t, q, dq, w, p):
    """tanh(x) / x, x = (3 coefficient)^(1/2) |w|; 1 below 1e-5."""
    x = max(math.sqrt(3.0 * p[0]) * abs(w), 1e-5)
    return math.tanh(x) / x


TANH = replace(
    EFFECT,
    name="torque_constant_saturation_tanh",
    kind="torque_constant_saturation",
    equation=r"\tau_m = \alpha\,i_s \tanh(i / i_s),\ c = 1 / (3\,i_s^2)",
    function=tanh,
)
"""Towards a largest torque."""


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
    """1 / (1 + (coefficient w^2)^sharpness / exponent)^exponent."""
    return math.pow(abs(1.0 + math.pow(abs(p[0] * w * w), p[2]) / p[1]), -p[1])


KNEE = replace(
    EFFECT,
    name="torque_constant_saturation_knee",
    kind="torque_constant_saturation",
    parameters=(
        *POWER.parameters,
        EffectParameter("sharpness", "ratio", "half of the power by which the loss sets in", lower=0.5, upper=2.5),
    ),
    equation=r"\tau_m = \alpha i / (1 + (c\,i^2)^m / n)^n",
    starts=lambda s: [
        (0.6 / s.torque_peak**2, exponent, sharpness) for exponent, sharpness in ((0.5, 1.2), (0.3, 1.7))
    ],
    function=knee,
    includes=("torque_constant_saturation", "torque_constant_saturation_power"),
    after=("torque_constant_saturation", "torque_constant_saturation_power"),
    neutral=(1.0, 1.0),
    expected_failures=(("linear_in_amplitudes", "its loss grows with a power of its coefficient"),),
)
"""Iron that gives its torque until it saturates: little is lost at first, and more the sooner beyond the knee."""
EFFECTS = exclusive((EFFECT, POWER, TANH, EARLY, LEVELLING, KNEE))
