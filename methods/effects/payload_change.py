"""Change of payload: from an instant within the log on the inertia is larger or smaller, and so is the weight of an arm
that gravity pulls.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9 (payload).
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter, exclusive

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


MOVING = (EFFECT, WEIGHED, CARRIED, HUNG)
AT_REST = tuple(f"{form.name}_at_rest" for form in MOVING)
"""Forms of a load that rested when it was picked up: the momentum is continuous, not the velocity."""


def at_rest(form: Effect) -> Effect:
    """The same of a load that rested."""
    rested = lambda names: tuple(f"{name}_at_rest" for name in names)  # noqa: E731
    inertia, *others = form.parameters
    return replace(
        form,
        name=f"{form.name}_at_rest",
        kind="payload_change",
        parameters=(replace(inertia, lower=0.0), *others),
        equation=form.equation + r",\ \dot q \to (M + \Delta M)^{-1} M\,\dot q\ \mathrm{at}\ t = t_0",
        includes=rested(form.includes),
        after=rested(form.after),
        expected_failures=(
            (
                "sensitivities_are_finite_differences",
                "damping acts as if the blow came at the beginning of its step: the velocity behind it jumps by some "
                "per cent of its change where the instant goes from one step to the next",
            ),
        ),
    )


EFFECTS = exclusive((*MOVING, *map(at_rest, MOVING)))
