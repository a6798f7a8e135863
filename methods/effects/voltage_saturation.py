"""Saturation of the amplifier: the output is clipped at a limit below the largest command.

Source: G. F. Franklin, J. D. Powell, A. Emami-Naeini, Feedback Control of Dynamic Systems, section 9.
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter, exclusive, grid


def command(u, t, q, dq, w, p):
    """min(max(u, -voltage), voltage)."""
    return min(max(u, -p[0]), p[0])


EFFECT = Effect(
    name="voltage_saturation",
    stage="amplifier",
    slot="command",
    parameters=(EffectParameter("voltage", "command", "largest magnitude that the amplifier gives", lower=0.0),),
    equation=r"v_a = \min(\max(v, -v_{max}), v_{max})",
    variable="command",
    source="Franklin, Powell, Emami-Naeini",
    amplitudes=(),
    starts=lambda s: [(fraction * s.command_peak,) for fraction in (0.97, 0.9, 0.8, 0.65, 0.5, 0.35)],
    function=command,
)


def gradual(u, t, q, dq, w, p):
    """u / (1 + |u / voltage|^sharpness)^(1/sharpness)."""
    ratio = abs(u) / max(p[0], 1e-12)
    small = min(ratio, 1.0 / max(ratio, 1e-300))
    return u * math.pow(abs(1.0 + math.pow(abs(small), p[1])), -1.0 / p[1]) / max(ratio, 1.0)


GRADUAL = replace(
    EFFECT,
    name="gradual_voltage_saturation",
    kind="voltage_saturation",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("sharpness", "ratio", "of the transition; a hard limit beyond 30", 1.0, 60.0, "lower"),
    ),
    equation=r"v_a = v / (1 + |v / v_{max}|^n)^{1/n}",
    includes=("voltage_saturation",),
    neutral=(30.0,),
    starts=lambda s: grid((f * s.command_peak for f in (1.0, 0.8, 0.6, 0.4)), (3.0, 8.0)),
    function=gradual,
    tries=2,
)


def tanh(u, t, q, dq, w, p):
    """voltage tanh(u / voltage)."""
    return p[0] * math.tanh(u / max(p[0], 1e-12))


TANH = replace(
    EFFECT,
    name="voltage_saturation_tanh",
    kind="voltage_saturation",
    equation=r"v_a = v_{max} \tanh(v / v_{max})",
    starts=lambda s: [(fraction * s.command_peak,) for fraction in (2.0, 1.0, 0.5)],
    function=tanh,
)
EFFECTS = exclusive((EFFECT, GRADUAL, TANH))
