"""Offset of the amplifier: a constant voltage is added to every command.

Source: A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, 2019 (parameter ``offset``).
"""

from methods.effects.base import Effect, EffectParameter


def command(u, t, q, dq, w, p):
    """u + voltage."""
    return u + p[0]


EFFECT = Effect(
    name="amplifier_offset",
    stage="amplifier",
    slot="command",
    parameters=(EffectParameter("voltage", "command", "voltage added to the command"),),
    equation=r"v_a = v + v_{off}",
    variable="elapsed time",
    source="Janot, Gautier, Brunot 2019",
    starts=lambda s: [(0.02 * s.command_rms,)],
    function=command,
)
