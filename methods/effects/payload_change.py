"""Change of payload: from an instant within the log on the inertia is larger or smaller, and so is the weight of an arm
that gravity pulls.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9 (payload).
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter

ON_THE_ARM = ("payload_change_carried", "payload_change_hung")
"""The forms that two links of a planar pair have."""
EFFECT = Effect(
    name="payload_change",
    stage="arm",
    slot="structure",
    parameters=(
        EffectParameter("inertia", "inertia", "inertia added"),
        EffectParameter("time", "time", "instant of the change"),
    ),
    equation=r"J(t) = J + \Delta J\ \mathrm{for}\ t \geq t_0",
    variable="elapsed time",
    source="Khalil and Dombre",
    scan="event",
)

AT_REST = replace(
    EFFECT,
    name="payload_change_at_rest",
    kind="payload_change",
    parameters=(replace(EFFECT.parameters[0], lower=0.0), EFFECT.parameters[1]),
    equation=r"J \to J + m,\ \dot q \to \dot q\,J / (J + m)\ \mathrm{at}\ t = t_0",
    excludes=("payload_change", *ON_THE_ARM),
)
"""The load rested when it was picked up: the momentum is continuous, not the velocity."""
EFFECT = replace(EFFECT, excludes=("payload_change_at_rest",))


def weight(t, q, dq, w, x, p):
    """weight_sine sin(q) + weight_cosine cos(q) from `time` on."""
    if t < p[1]:
        return 0.0
    return p[2] * math.sin(q) + p[3] * math.cos(q)


def weights(s):
    """Weights that are felt, as of a tilted axis."""
    size = 0.02 * s.torque_rms / min(s.position_span, 1.0)
    return [(0.02 * s.inertia, 0.4 * s.duration, *own) for own in ((size, 0.0), (0.0, size))] if s.revolute else []


WEIGHED = replace(
    EFFECT,
    name="payload_change_weighed",
    kind="payload_change",
    slot="torque",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("weight_sine", "torque", "sine part of the torque of its weight"),
        EffectParameter("weight_cosine", "torque", "cosine part of the torque of its weight"),
    ),
    equation=r"J(t) = J + \Delta J,\ \tau_g(t) = \tau_g + W_s\sin q + W_c\cos q\ \mathrm{for}\ t \geq t_0",
    amplitudes=(0, 2, 3),
    function=weight,
    starts=weights,
    scan=None,
    includes=("payload_change",),
    neutral=(0.0, 0.0),
    after=("payload_change",),
    excludes=(*EFFECT.excludes, *ON_THE_ARM),
)
"""The load has a weight, too, about an axis that is not vertical."""


def carried(s):
    """A load as far from its joint as that is from the first one."""
    return [(0.05 * s.inertia, 0.4 * s.duration, 1.0)]


def hung(s):
    """The same with a weight that is felt."""
    size = 0.05 * s.torque_rms / min(s.position_span, 1.0)
    return [(0.05 * s.inertia, 0.4 * s.duration, 1.0, size, size)]


CARRIED = replace(
    EFFECT,
    name="payload_change_carried",
    kind="payload_change",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("reach", "ratio", "length of the first link over the load's lever", lower=0.0, upper=20.0),
    ),
    equation=(
        r"J_2 \to J_2 + m,\ J_1 \to J_1 + r^2 m,\ p_3 \to p_3 + r m,\ p_2 \to p_2 + m"
        r"\ \mathrm{for}\ t \geq t_0"
    ),
    excludes=("payload_change_at_rest", "payload_change_weighed"),
    includes=("payload_change",),
    neutral=(0.0,),
    starts=carried,
    on_the_arm="coupling",
)
"""The load is a mass at the end of the second link of a planar pair, which the first joint carries and feels, too."""
HUNG = replace(
    CARRIED,
    name="payload_change_hung",
    parameters=(*CARRIED.parameters, *WEIGHED.parameters[2:]),
    equation=(
        r"J_2 \to J_2 + m,\ J_1 \to J_1 + r^2 m,\ p_3 \to p_3 + r m,\ p_2 \to p_2 + m,\ "
        r"\tau_2 \to \tau_2 + W(q_1 + q_2),\ \tau_1 \to \tau_1 + W(q_1 + q_2) + r W(q_1)"
        r"\ \mathrm{for}\ t \geq t_0"
    ),
    amplitudes=(0, 3, 4),
    includes=("payload_change", "payload_change_carried"),
    neutral=(0.0, 0.0, 0.0),
    starts=hung,
    on_the_arm="weight",
)
"""The same where gravity pulls the arm: W(q) = weight_sine sin q + weight_cosine cos q is the load's weight."""
EFFECTS = (EFFECT, AT_REST, WEIGHED, CARRIED, HUNG)
