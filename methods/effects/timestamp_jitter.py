"""Jitter of the sampling instants: the reading belongs to another instant than its stamp.

It changes no expected reading, only its scatter, ``y = q(t + d) ~ q + q' d`` with d of rms `rms`; it is therefore found
by the law of the scatter (`diagnosis.jitter`) and is no part of a simulation.

Source: A. Papoulis, Probability, Random Variables, and Stochastic Processes, section on random sampling.
"""

from methods.effects.base import Effect, EffectParameter


def sensor(q, p):
    """No mean error."""
    return 0.0


EFFECT = Effect(
    name="timestamp_jitter",
    stage="sensor",
    slot="sensor",
    parameters=(EffectParameter("rms", "time", "rms of the sampling instants' error", lower=0.0),),
    equation=r"y = q(t + \delta), \quad \operatorname{rms}(\delta) = \sigma_t",
    variable="velocity",
    source="random sampling",
    amplitudes=(),
    function=sensor,
    expected_failures=(
        ("starting_values", "it is found by the law of the scatter, not by a search"),
        ("recovers_itself", "a simulation with it is one without: it moves no expected reading"),
    ),
)
