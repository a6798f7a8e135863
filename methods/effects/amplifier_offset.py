"""Offset of the amplifier: a constant voltage is added to every command.

Source: A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, 2019 (parameter ``offset``).
"""

from dataclasses import replace

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


def torque(t, q, dq, w, x, p):
    """-voltage: in the command's unit, a load that no dead zone and no limit of the command changes."""
    return -p[0]


AT_OUTPUT = replace(
    EFFECT,
    name="amplifier_offset_at_output",
    kind="amplifier_offset",
    slot="torque",
    equation=r"v_a = v + v_{off}\ \mathrm{(output)}",
    after=("dead_zone", "gradual_dead_zone", "voltage_saturation", "gradual_voltage_saturation"),
    excludes=("amplifier_offset",),
    function=torque,
)
"""Where the amplifier has a dead zone or a limit, its output stage may be what is off, and not what comes in."""
EFFECTS = (replace(EFFECT, excludes=(AT_OUTPUT.name,)), AT_OUTPUT)
