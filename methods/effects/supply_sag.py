"""Sag of the supply: the voltage that a given duty cycle yields falls with the current in the motor, with the duty
itself, or with the power that the bridge draws from a rectifier or a battery.

Source: Rhoban, BAM: better actuator models for servo actuators, 2024 (supply measured under load).
"""

from dataclasses import replace

from methods.effects.base import Effect, EffectParameter, exclusive


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
    inputs=("voltage",),
    starts=lambda s: [(0.02 / s.torque_rms,)],
    function=command,
)


def levelling(u, t, q, dq, w, p):
    """u (1 - gain |w| / (1 + levelling gain |w|))."""
    loss = p[0] * abs(w)
    return u * max(0.0, 1.0 - loss / (1.0 + p[1] * loss))


LEVELLING = replace(
    EFFECT,
    name="supply_sag_levelling",
    kind="supply_sag",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("levelling", "ratio", "of the loss at high torque; with 1 it is v / (1 + g |i|)", 0.0, 20.0),
    ),
    equation=r"v_a = v\,\left(1 - \frac{g\,|i|}{1 + c\,g\,|i|}\right)",
    includes=("supply_sag",),
    neutral=(0.0,),
    starts=lambda s: [(0.02 / s.torque_rms, 1.0)],
    function=levelling,
)
"""As a source gives way whose voltage falls ever less."""


def by_command(u, t, q, dq, w, p):
    """u (1 - gain |u|)."""
    return u * max(0.0, 1.0 - p[0] * abs(u))


BY_COMMAND = replace(
    EFFECT,
    name="supply_sag_by_command",
    kind="supply_sag",
    parameters=(EffectParameter("gain", "1/voltage", "relative loss of voltage per commanded voltage", lower=0.0),),
    equation=r"v_a = v\,(1 - g\,|v|)",
    variable="command",
    starts=lambda s: [(0.02 / s.command_rms,)],
    function=by_command,
)
"""As a simulator may have it that does not look at the current."""


def by_power(u, t, q, dq, w, p):
    """u (1 - gain max(u w, 0))."""
    return u * max(0.0, 1.0 - p[0] * max(u * w, 0.0))


BY_POWER = replace(
    EFFECT,
    name="supply_sag_by_power",
    kind="supply_sag",
    parameters=(EffectParameter("gain", "1/power", "relative loss of voltage per command times current", lower=0.0),),
    equation=r"v_a = v\,(1 - g\,\max(v i, 0))",
    variable="motor torque",
    starts=lambda s: [(0.02 / (s.command_rms * s.torque_rms),)],
    function=by_power,
)
"""As a bridge draws it: a supply gives the power that the motor takes, and takes back none."""


def by_duty(u, t, q, dq, w, p):
    """u (1 - gain |u w|)."""
    return u * max(0.0, 1.0 - p[0] * abs(u * w))


BY_DUTY = replace(
    BY_POWER,
    name="supply_sag_by_duty",
    equation=r"v_a = v\,(1 - g\,|v i|)",
    function=by_duty,
)
"""As a simulator may have it in which the supply's current is the share of the motor's, whatever its sign."""


def by_battery(u, t, q, dq, w, p):
    """u (1 - gain u w), no less than none of it."""
    return u * max(0.0, 1.0 - p[0] * u * w)


BY_BATTERY = replace(
    BY_POWER,
    name="supply_sag_by_battery",
    equation=r"v_a = v\,(1 - g\,v i)",
    function=by_battery,
)
"""As behind the resistance of a battery, which takes power back: its voltage rises while the motor brakes."""
FORMS = (EFFECT, LEVELLING, BY_COMMAND, BY_POWER, BY_DUTY, BY_BATTERY)
EFFECTS = exclusive(FORMS)
