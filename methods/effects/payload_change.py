"""Change of payload: from an instant within the log on the inertia is larger or smaller.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9 (payload).
"""

from methods.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="payload_change",
    stage="arm",
    slot="structure",
    parameters=(
        EffectParameter("inertia", "inertia", "inertia added"),
        EffectParameter("time", "time", "instant of the change"),
    ),
    equation=r"J(t) = J + \Delta J\ \mathrm{for}\ t \geq t_0",
    variable="elapsed time",
    source="Khalil and Dombre",
    scan="event",
    expected_failures=(
        (
            "sensitivities_are_finite_differences",
            "the change takes effect at the next step, so that its instant acts in jumps",
        ),
    ),
)
