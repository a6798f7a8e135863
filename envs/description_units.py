"""Units of the numbers in a robot description: which ones each entry may be given in, and the way to SI.

An entry lists its units with the standard one first; all of them are SI, so that they differ in their dimension alone
(V s/rad is N m/A). A stated unit has to be convertible to one of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from envs.units import NO_UNIT, UnitError, convert, plain

Units = Mapping[str, tuple[str, ...]]

LINK_UNITS: Units = {
    "length": ("m",),
    "mass": ("kg",),
    "centre_of_mass": ("m",),
    "inertia": ("kg m^2",),
    "rotor_inertia": ("kg m^2",),
}
"""Of the parts of a SCARA arm."""


def joint_units(kind: Any) -> Units:
    """Units of the entries of a joint that turns (revolute) or slides (prismatic)."""
    unit = "m" if kind == "prismatic" else "rad"
    return {"lower": (unit,), "upper": (unit,), "encoder_step": (unit,), "speed_limit": (f"{unit}/s",)}


def drive_units(drive: Mapping[str, Any], kind: Any) -> Units:
    """Units of the entries of a drive. What its amplifier sets and what commands it decide some of them.

    A joint that slides has a motor that turns, behind a screw, or a linear motor.
    """
    slides = kind == "prismatic"
    signals = {"voltage": "V", "current": "A", "torque": "N" if slides else "N m"}
    output, command = (signals.get(str(drive.get(name, "voltage")), "V") for name in ("amplifier", "command"))
    divisor = f"({command})" if " " in command else command
    gain = ("V/V", "share") if output == command else (f"{output}/{divisor}",)
    return {
        "amplifier_gain": gain,
        "resistance": ("ohm",),
        "inductance": ("H",),
        "motor_constant": ("N m/A", "V s/rad", "N/A") if slides else ("N m/A", "V s/rad"),
        "gear_ratio": ("rad/m", "1/m", "share") if slides else ("rad/rad", "share"),
        "rotor_inertia": ("kg m^2", "kg") if slides else ("kg m^2",),
        "viscous": ("N s/m",) if slides else ("N m s/rad", "N m s"),
        "voltage_limit": ("V",),
        "current_limit": ("A",),
        "command_limit": (command,),
    }


def in_standard_unit(value: float, unit: str, expected: tuple[str, ...]) -> tuple[float, str]:
    """A number in the standard unit, and how that is called; as it is where none is stated.

    Raises UnitError for a unit that is not understood or that has none of the expected dimensions.
    """
    written = plain(unit)
    if written in NO_UNIT or written in expected or not expected:
        return value, unit
    refusal = None
    for standard in expected:
        try:
            return value * float(convert(1.0, written, standard)), standard
        except UnitError as error:
            refusal = refusal or error
    assert refusal is not None
    raise refusal
