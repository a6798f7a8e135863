"""Sag of the supply: the voltage that a given duty cycle yields falls with the current drawn.

Source: Rhoban, BAM: better actuator models for servo actuators, 2024 (supply measured under load).
"""

from methods.effects.base import Effect, EffectParameter


def command(u, t, q, dq, w, p):
    """u (1 - gain |w|)."""
    return u * max(0.0, 1.0 - p[0] * abs(w))


EFFECT = Effect(
    name="supply_sag",
    stage="amplifier",
    slot="command",
    parameters=(EffectParameter("gain", "1/command", "relative loss of voltage per motor torque", lower=0.0),),
    equation=r"v_a = v\,(1 - g\,|i|)",
    variable="motor torque",
    source="Rhoban BAM",
    starts=lambda s: [(0.02 / s.torque_rms,)],
    function=command,
)
