"""Torque ripple: the torque constant varies periodically with the angle of the rotor.

Source: D. Hanselman, Brushless Permanent Magnet Motor Design, section on ripple torque.
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter, instances, is_periodic


def gain(t, q, dq, w, p):
    """1 + sine sin(N q) + cosine cos(N q)."""
    return 1.0 + p[0] * math.sin(p[2] * q) + p[1] * math.cos(p[2] * q)


EFFECT = Effect(
    name="torque_ripple",
    stage="motor",
    slot="gain",
    parameters=(
        EffectParameter("sine", "ratio", "sine part of the share", lower=-1.0, upper=1.0),
        EffectParameter("cosine", "ratio", "cosine part of the share", lower=-1.0, upper=1.0),
        EffectParameter(
            "cycles_per_rev", "cycles per revolution", "cycles per revolution (2 pi per metre)", lower=1e-3
        ),
    ),
    equation=r"\tau_m = \alpha i\,(1 + s\,\sin(N q + \varphi))",
    variable="position",
    source="Hanselman",
    amplitudes=(0, 1),
    function=gain,
    scan="position",
    turns=True,
    resolved=lambda p, s: is_periodic(p[2], s),
)

HARMONICS = 3
"""Each harmonic of the ripple is an instance of its own."""

RECIPROCAL = replace(
    EFFECT,
    name="torque_ripple_reciprocal",
    kind="torque_ripple",
    slot="structure",
    equation=r"\tau_m = c(q)\,\alpha i,\ e = c(q)\,k\,\dot q,\ c = 1 + s\,\sin(N q + \varphi)",
    function=None,
    drives=True,
    excludes=tuple(effect.name for effect in instances(EFFECT, HARMONICS)),
)
"""The back-EMF ripples as well, as energy demands; in many a simulator the torque alone does."""
EFFECTS = (*(replace(effect, excludes=(RECIPROCAL.name,)) for effect in instances(EFFECT, HARMONICS)), RECIPROCAL)
