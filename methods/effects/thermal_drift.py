"""Thermal drift of the winding: resistance rises with the heat of the current through one thermal time constant.

``rise' = (resistance_rise w^2 / mean(w^2) - rise) / time_constant`` with ``R = R0 (1 + rise)``. A log begins with a
cold winding unless its readings tell otherwise (`diagnosis.beginning`). Where the heat is that of the whole machine as
it warms up, of bearings, brakes or the room, it does not follow the current: ``rise' = (resistance_rise - rise) /
time_constant``.

Source: A. Hughes, B. Drury, Electric Motors and Drives, section 1 (thermal time constant).
"""

from dataclasses import replace

from methods.effects.base import Effect, EffectParameter

EFFECT = Effect(
    drives=True,
    name="thermal_drift",
    stage="motor",
    slot="structure",
    parameters=(
        EffectParameter(
            "resistance_rise", "ratio", "relative rise reached in the end at the mean square current of all fitted logs"
        ),
        EffectParameter("time_constant", "time", "thermal time constant", lower=1.0),
    ),
    equation=r"R = R_0(1+\vartheta),\ T\dot\vartheta = r\,i^2/\overline{i^2} - \vartheta",
    variable="elapsed time",
    remembers=True,
    source="Hughes and Drury",
    starts=lambda s: [(0.02, max(1.0, fraction * s.duration)) for fraction in (0.05, 0.1, 0.3, 1.0, 4.0)],
)

COPPER = replace(
    EFFECT,
    name="thermal_drift_copper",
    kind="thermal_drift",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("feedback", "ratio", "share of the losses that grows with the resistance", 0.0, 1.5),
    ),
    equation=r"R = R_0(1+\vartheta),\ "
    r"T\dot\vartheta = \frac{1 + s\vartheta}{1 + s r}\, r\,i^2/\overline{i^2} - \vartheta",
    includes=("thermal_drift",),
    excludes=("thermal_drift",),
    neutral=(0.0,),
    undecided=((0.5, 0.5),),
    after=("thermal_drift",),
    starts=lambda s: [(0.02, s.duration, 1.0)],
)
"""Copper losses grow with the resistance that they heat, which shows where it rises by a third; where it rises less,
they look like heat that does not grow, with a time constant that is longer by the rise."""
STEADY = replace(
    EFFECT,
    name="thermal_drift_steady",
    kind="thermal_drift",
    equation=r"R = R_0(1+\vartheta),\ T\dot\vartheta = r - \vartheta",
    excludes=("thermal_drift", "thermal_drift_copper"),
)
"""Heat that comes at a steady rate, whatever the current."""
EFFECT = replace(EFFECT, excludes=(STEADY.name,))
COPPER = replace(COPPER, excludes=(*COPPER.excludes, STEADY.name))
EFFECTS = (EFFECT, COPPER, STEADY)
