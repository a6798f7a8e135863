"""Saturation of the amplifier: the output is clipped at a limit below the largest command.

Source: G. F. Franklin, J. D. Powell, A. Emami-Naeini, Feedback Control of Dynamic Systems, section 9.
"""

from methods.effects.base import Effect, EffectParameter


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
