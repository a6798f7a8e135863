"""Lag of the amplifier: the output follows the command through a first-order low-pass.

Solved exactly between samples by the kernel (the command is held), so that the time constant may go to zero.

Source: G. F. Franklin, J. D. Powell, A. Emami-Naeini, Feedback Control of Dynamic Systems, section 3.
"""

from methods.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="amplifier_lag",
    stage="amplifier",
    slot="structure",
    parameters=(EffectParameter("time_constant", "time", "time constant of the low-pass", lower=0.0),),
    equation=r"T\,\dot v_a + v_a = v",
    variable="elapsed time",
    source="Franklin, Powell, Emami-Naeini",
    starts=lambda s: [(0.5 * s.sample_time,), (3.0 * s.sample_time,), (10.0 * s.sample_time,)],
    expected_failures=(
        (
            "recovers_itself",
            "it stands in series with the winding's lag, and the two time constants may change places",
        ),
    ),
    exchanges="electrical_time_constant",
)
