"""Eccentric encoder disc: the reading errs once per revolution.

Source: T. Tuma et al., angular error of eccentric encoders; product notes of encoder makers (once-per-turn error).
"""

import math

from methods.effects.base import Effect, EffectParameter

LARGEST = 0.5
"""Of either part [rad]; from an amplitude of 1 on the reading of a turning disc would go back."""


def sensor(q, p):
    """sine sin(q) + cosine cos(q)."""
    return p[0] * math.sin(q) + p[1] * math.cos(q)


EFFECT = Effect(
    name="encoder_eccentricity",
    stage="sensor",
    slot="sensor",
    parameters=(
        EffectParameter("sine", "position", "sine part of the error", lower=-LARGEST, upper=LARGEST),
        EffectParameter("cosine", "position", "cosine part of the error", lower=-LARGEST, upper=LARGEST),
    ),
    equation=r"y = q + A\,\sin(q + \varphi)",
    variable="position",
    source="once-per-turn error of eccentric discs",
    amplitudes=(0, 1),
    starts=lambda s: [(1e-3, 1e-3)] if s.revolute else [],
    function=sensor,
    turns=True,
)
