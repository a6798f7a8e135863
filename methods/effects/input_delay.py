"""Delay between command and amplifier: a dead time, in general no whole number of samples.

The kernel averages the delayed, held command exactly over each integration step. A delay within half a sample is the
recording's as well as the drive's (`methods.kernel.NOMINAL`: timing).

Source: K. J. Astrom, B. Wittenmark, Computer-Controlled Systems, section 2 (systems with time delay).
"""

from methods.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="input_delay",
    stage="amplifier",
    slot="structure",
    parameters=(EffectParameter("delay", "time", "dead time", lower=0.0),),
    equation=r"v_a(t) = v(t - T_d)",
    variable="elapsed time",
    source="Astrom and Wittenmark",
    starts=lambda s: [(0.5 * s.sample_time,), (3.0 * s.sample_time,), (10.0 * s.sample_time,)],
    resolved=lambda p, s: p[0] > 0.5 * s.sample_time,
    exchanges="electrical_time_constant",
    replaces="timing",
)
