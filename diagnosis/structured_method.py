"""What the contestants that end in an extended model have in common: logs to problems, and a fit to a `Fit`.

Such a contestant says only how the model of one group of joints is found (`StructuredMethod.settle`).
"""

from __future__ import annotations

import abc
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from diagnosis.estimation import Fitted
from diagnosis.extension import Extension, extended_model
from diagnosis.finding import WORST
from diagnosis.nominal import JointStructure
from diagnosis.parameters import joint_units
from diagnosis.preparation import groups
from diagnosis.problem import Problem, stack
from envs.log import Array, JointFacts, Log
from envs.robot import Robot, RobotError
from envs.robots import find_robot
from methods.base import Cause, Estimates, Fit, Method, MethodError, Status
from methods.effects import built_in, compiled_with, vocabulary
from methods.effects.base import Effect
from methods.kernel import NOMINAL, build
from methods.physical_joint import FRICTION, columns_of
from methods.regressor import ColumnName, column_unit
from methods.usable_logs import check_logs


@dataclass(frozen=True, eq=False)
class Settled:
    """The model of one group of joints, and what its contestant has to say of it. causes: None when it names none."""

    fitted: Fitted
    notes: tuple[str, ...] = ()
    causes: tuple[Cause, ...] | None = None
    verdict: str | None = None


class StructuredMethod(Method):
    """A contestant whose model is the nominal one with effects."""

    def vocabulary(self) -> tuple[Effect, ...]:
        """The effects that the kernel is built for."""
        return vocabulary()

    @abc.abstractmethod
    def settle(
        self, problem: Problem, structures: tuple[JointStructure, ...], group: tuple[int, ...], known: Sequence[Effect]
    ) -> Settled:
        """The model of the joints `group`, which the problem holds in this order."""

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Consumes no random numbers. Residuals are the innovations, each over its joint's deviation."""
        begin = time.perf_counter()
        joints = check_logs(logs)
        known = self.vocabulary()
        effects = compiled_with(known)
        kernel = build(effects)
        robot = _robot(logs[0])
        extensions, settled, values = [], [], []
        for group, structures in groups(logs, joints, robot, known):
            problem = stack(kernel, logs, group, pair=len(group) > 1)
            facts = [logs[0].facts[logs[0].index(joint)] for joint in group]
            measures = tuple(
                joint_units(item.input, fact.position_unit, None if robot is None else robot.joint(joint))
                for item, fact, joint in zip(structures, facts, group, strict=True)
            )
            result = self.settle(problem, structures, group, known)
            settled.append(result)
            inputs = tuple(fact.input for fact in facts)
            extensions.append(Extension(group, inputs, measures, problem, result.fitted.point, (None,) * len(group)))
            values.append(_estimates(problem, result.fitted, group, facts))
        model = extended_model(extensions)
        order = [joint for joint in joints if joint in model.joints]
        if tuple(order) != model.joints:
            raise MethodError(
                f"the joints {list(joints)} stand in another order than the model's", remedy="Order them by number"
            )
        named = [item.causes for item in settled if item.causes is not None]
        verdicts = [item.verdict for item in settled if item.verdict is not None]
        return Fit(
            model=replace(model, vocabulary=()) if effects == built_in() else model,
            estimates=_joined(values),
            residuals=np.concatenate([f for _, f in values]),
            status=Status.CONVERGED,
            seconds=time.perf_counter() - begin,
            notes=tuple(note for item in settled for note in item.notes),
            causes=tuple(cause for causes in named for cause in causes) if named else None,
            verdict=next((verdict for verdict in WORST if verdict in verdicts), None),
        )


def _robot(log: Log) -> Robot | None:
    """The nominal description that the log names, where it is known."""
    try:
        return None if log.robot is None else find_robot(log.robot)
    except RobotError:
        return None


def _estimates(
    problem: Problem, fitted: Fitted, group: tuple[int, ...], facts: Sequence[JointFacts]
) -> tuple[Estimates, np.ndarray]:
    """Coefficients of the joints' linear equations with their covariance, and the scaled innovations.

    The names are those of `methods.regressor`, followed by the joint where several are fitted together.
    """
    vector = fitted.point.vector

    def coefficients(values: Array) -> list[dict[ColumnName, float]]:
        point = fitted.point.at(values)
        found = []
        for j in range(len(group)):
            row = point.parameters[0, j]
            named = dict(zip(NOMINAL[:7], row[:7].tolist(), strict=True))
            named["viscous"] += row[NOMINAL.index("arm_viscous")]
            if point.switches[j, problem.kernel.switches[FRICTION]]:
                named[FRICTION] = float(row[problem.kernel.offsets[FRICTION]])
            free = {f.name.partition("@")[0] for f in point.free if f.joint == j} | {FRICTION, "inertia", "viscous"}
            found.append(columns_of({name: v for name, v in named.items() if name in free or name == "back_emf"}))
        return found

    centre = coefficients(vector)
    names = [(column, j) for j, found in enumerate(centre) for column in found]
    values = np.array([centre[j][column] for column, j in names])
    slopes = np.zeros((len(values), len(vector)))
    for k, free in enumerate(fitted.point.free):
        if free.kind != "start":
            step = np.zeros(len(vector))
            step[k] = 1e-6 * free.scale
            beside = coefficients(vector + step)  # with a jerk where the lag of a winding was at its bound of 0
            slopes[:, k] = (np.array([beside[j][column] for column, j in names]) - values) / step[k]
    scaled = fitted.innovation.reshape(len(group), -1) / np.sqrt(np.maximum(fitted.variances, 1e-300))[:, None]
    estimates = Estimates(
        names=tuple(column if len(group) == 1 else f"{column} of joint {group[j]}" for column, j in names),
        units=tuple(column_unit(column, facts[j]) for column, j in names),
        values=values,
        covariance=slopes @ fitted.covariance @ slopes.T,
    )
    return estimates, scaled.ravel()


def _joined(parts: Sequence[tuple[Estimates, np.ndarray]]) -> Estimates:
    """Estimates of separate problems side by side."""
    found = [part for part, _ in parts]
    return Estimates(
        names=tuple(name for part in found for name in part.names),
        units=tuple(unit for part in found for unit in part.units),
        values=np.concatenate([part.values for part in found]),
        covariance=block_diag(*(part.covariance for part in found)),
    )
