"""A joint by its physical parameters, in units of the command: what nonlinear contestants estimate.

    T_e w' = u - k q' - w,   J q'' = w - b q' - load - g_s sin q - g_c cos q - T_c sign q'

The names are those of `methods.kernel.NOMINAL` and `FRICTION`. Command and position cannot tell b from k: under
voltage all damping is back-EMF k, otherwise all is viscous b.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from envs.log import Array, JointFacts, Log
from methods.base import Estimates
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


def columns_of(parameters: Mapping[str, float]) -> dict[ColumnName, float]:
    """Coefficients of the linear equation (4) that these parameters amount to.

    a1 = J T_e, a2 = J + T_e b, a3 = b + k, and the others as they are.
    """
    inertia, viscous = parameters["inertia"], parameters.get("viscous", 0.0)
    lag = parameters.get("electrical_time_constant", 0.0)
    found: dict[ColumnName, float] = {"jerk": inertia * lag} if lag > 0.0 else {}
    found["acceleration"] = inertia + lag * viscous
    found["velocity"] = viscous + parameters.get("back_emf", 0.0)
    same: dict[str, ColumnName] = {
        "load": "constant",
        FRICTION: "coulomb",
        "gravity_sine": "sine",
        "gravity_cosine": "cosine",
    }
    return found | {column: parameters[name] for name, column in same.items() if name in parameters}


def coefficient_estimates(parameters: Mapping[str, float], covariance: Array, facts: JointFacts) -> Estimates:
    """The coefficients of `columns_of` with their covariance to first order, so that all contestants' compare."""
    centre = columns_of(parameters)
    slopes = np.zeros((len(centre), len(parameters)))
    for k, (name, value) in enumerate(parameters.items()):
        step = 1e-6 * (abs(value) + 1e-9)
        moved = columns_of({**parameters, name: value + step})
        slopes[:, k] = [(moved[column] - centre[column]) / step for column in centre]
    return Estimates(
        names=tuple(centre),
        units=tuple(column_unit(column, facts) for column in centre),
        values=np.array(list(centre.values())),
        covariance=slopes @ covariance @ slopes.T,
    )


def physical_model(joint: int, facts: JointFacts, values: Mapping[str, float], logs: Sequence[Log]) -> StructuredModel:
    """The joint with these parameters; friction below a millionth of the command's deviation is none."""
    nominal = dict(values)
    friction = nominal.pop(FRICTION, 0.0)
    least = 1e-6 * max(float(np.std(log.command)) for log in logs)
    effects = {FRICTION: {"torque": friction}} if friction > least else {}
    part = StructuredJoint(joint, facts.input, nominal, effects, facts.position_unit)
    return StructuredModel((part,), logs[0].sample_time)
