"""Tilted axis: gravity acts on a joint whose axis was taken to be vertical.

In a planar pair it is a weight of the link (`methods.kernel`): the second one's turns with both joints, unless what
gravity pulls keeps its direction while the first joint turns.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9.
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter


def torque(t, q, dq, w, x, p):
    """sine sin(q) + cosine cos(q)."""
    return p[0] * math.sin(q) + p[1] * math.cos(q)


def starts(s):
    """Weights that are felt: over a short range it is their difference that is, the rest being a constant load."""
    size = 0.02 * s.torque_rms / min(s.position_span, 1.0)
    return [(size, size)] if s.revolute else []


EFFECT = Effect(
    name="gravity_tilt",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("sine", "torque", "sine part of the torque"),
        EffectParameter("cosine", "torque", "cosine part of the torque"),
    ),
    equation=r"\tau_g = T\,\sin(q + \varphi)",
    variable="position",
    source="Khalil and Dombre",
    amplitudes=(0, 1),
    starts=starts,
    function=torque,
    turns=True,
    excludes=("gravity_tilt_in_one_joint",),
    of_the_link=r"\tau_g = T\,\sin(q_1 + q + \varphi),\ \tau_1 \to \tau_1 + \tau_g",
)

IN_ONE_JOINT = replace(
    EFFECT,
    name="gravity_tilt_in_one_joint",
    kind="gravity_tilt",
    starts=lambda s: starts(s) if s.coupled else [],
    excludes=("gravity_tilt",),
    of_the_link="",
)
"""Of a joint in a planar pair by itself: as a motor on the base pulls a link by a belt, or as a simulator has it that
takes joint by joint."""
EFFECTS = (EFFECT, IN_ONE_JOINT)
