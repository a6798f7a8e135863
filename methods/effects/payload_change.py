"""Change of payload: from an instant within the log on the inertia is larger or smaller.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9 (payload).
"""

from dataclasses import replace

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
)

AT_REST = replace(
    EFFECT,
    name="payload_change_at_rest",
    kind="payload_change",
    parameters=(replace(EFFECT.parameters[0], lower=0.0), EFFECT.parameters[1]),
    equation=r"J \to J + m,\ \dot q \to \dot q\,J / (J + m)\ \mathrm{at}\ t = t_0",
    excludes=("payload_change",),
)
"""The load rested when it was picked up: the momentum is continuous, not the velocity."""
EFFECT = replace(EFFECT, excludes=("payload_change_at_rest",))
EFFECTS = (EFFECT, AT_REST)
