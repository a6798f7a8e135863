"""A joint by its physical parameters, in units of the command: what nonlinear contestants estimate.

    T_e w' = u - k q' - w,   J q'' = w - b q' - load - g_s sin q - g_c cos q - T_c sign q'

The names are those of `methods.kernel.NOMINAL` and `FRICTION`. Command and position cannot tell b from k: under
voltage all damping is back-EMF k, otherwise all is viscous b.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from envs.log import JointFacts, Log
from methods.joint_model import JointModel
from methods.regressor import ColumnName, column_unit
from methods.structured import StructuredJoint, StructuredModel

FRICTION = "coulomb_friction"
"""Name of T_c among the parameters, and of the effect that it belongs to."""
SIGNED = ("load", "gravity_sine", "gravity_cosine")
"""Parameters that may be negative."""


def physical_parameters(model: JointModel) -> dict[str, float]:
    """Kernel parameters from linear coefficients, a1 = J T_e, a2 = J, all damping in one place; friction >= 0."""
    given = dict(zip(model.columns, model.coefficients.tolist(), strict=True))
    inertia = given["acceleration"]
    voltage = model.input == "voltage"
    found = {"inertia": inertia, "back_emf" if voltage else "viscous": max(given.get("velocity", 0.0), 0.0)}
    if "jerk" in given:
        found["electrical_time_constant"] = given["jerk"] / inertia
    if "constant" in given:
        found["load"] = given["constant"]
    if "sine" in given:
        found["gravity_sine"], found["gravity_cosine"] = given["sine"], given["cosine"]
    found[FRICTION] = max(given.get("coulomb", 0.0), 0.0)
    return found


def parameter_unit(name: str, facts: JointFacts) -> str:
    """Unit of a kernel parameter in units of the command."""
    if name == "electrical_time_constant":
        return "s"
    columns: dict[str, ColumnName] = {"inertia": "acceleration", "viscous": "velocity", "back_emf": "velocity"}
    return column_unit(columns.get(name, "constant"), facts)


def physical_model(joint: int, facts: JointFacts, values: Mapping[str, float], logs: Sequence[Log]) -> StructuredModel:
    """The joint with these parameters; friction below a millionth of the command's deviation is none."""
    nominal = dict(values)
    friction = nominal.pop(FRICTION, 0.0)
    least = 1e-6 * max(float(np.std(log.command)) for log in logs)
    effects = {FRICTION: {"torque": friction}} if friction > least else {}
    part = StructuredJoint(joint, facts.input, nominal, effects, facts.position_unit)
    return StructuredModel((part,), logs[0].sample_time)
