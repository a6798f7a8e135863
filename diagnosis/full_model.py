"""The ceiling: a contestant that is told which effects hide, and only has to find their numbers.

Prediction-error estimation of the nominal joint and the named effects, one after the other in the order in which they
explain most, then all together (`diagnosis.estimation`). No method that has to find the names can do better than this,
save by luck. It is here and not among the methods because it needs the diagnosis' estimator.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from diagnosis.estimation import Fitted, fit
from diagnosis.extension import Extension, extended_model
from diagnosis.nominal import fit_nominal
from diagnosis.parameters import joint_units
from diagnosis.preparation import groups, structure
from diagnosis.problem import Problem, stack
from diagnosis.search import try_all
from envs.log import Array, JointFacts, Log
from envs.robot import Robot, RobotError
from envs.robots import find_robot
from methods.base import Estimates, Fit, Method, MethodError, Status
from methods.effects import built_in, vocabulary
from methods.kernel import NOMINAL, build
from methods.physical_joint import FRICTION, columns_of
from methods.registry import METHODS
from methods.regressor import ColumnName, column_unit
from methods.usable_logs import check_logs


@METHODS.register("full-model", "single-joint", "multi-joint", "physics", "ceiling")
@dataclass(frozen=True)
class FullModel(Method):
    """effects: what is hidden, as pairs of effect name and joint number; none of them makes it the nominal model."""

    effects: tuple[tuple[str, int], ...] = ()

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Consumes no random numbers. Residuals are the innovations, each over its joint's deviation."""
        begin = time.perf_counter()
        joints = check_logs(logs)
        known = {effect.name: effect for effect in vocabulary()}
        for name, joint in self.effects:
            if name not in known:
                raise MethodError(f"there is no effect {name}", remedy=f"Known are {', '.join(known)}")
            if joint not in joints:
                raise MethodError(f"the logs do not hold joint {joint}", remedy=f"They hold {list(joints)}")
        own = {effect.name for effect in built_in()} >= {name for name, _ in self.effects}
        kernel = build(built_in() if own else vocabulary())
        robot = _robot(logs[0])
        extensions, notes, values = [], [], []
        for group in groups(logs, joints, robot):
            structures = tuple(structure(logs[0], joint, robot) for joint in group)
            problem = stack(kernel, logs, group, pair=len(group) > 1)
            facts = [logs[0].facts[logs[0].index(joint)] for joint in group]
            measures = tuple(
                joint_units(item.input, fact.position_unit, None if robot is None else robot.joint(joint))
                for item, fact, joint in zip(structures, facts, group, strict=True)
            )
            wanted = [(known[name], group.index(joint)) for name, joint in self.effects if joint in group]
            fitted = fit_nominal(problem, structures)
            while wanted:
                ranked = try_all(problem, fitted, wanted, refine=max(7, 3 * len(wanted)), finals=2)
                if not ranked:
                    notes += [f"nothing of {effect.name} shows in the logs of joint {group[j]}" for effect, j in wanted]
                    break
                best = ranked[0]
                fitted = best.fitted
                wanted = [(e, j) for e, j in wanted if (e.name, j) != (best.name, best.start.hypothesis.joint)]
            fitted = fit(problem, fitted.point, rounds=3, iterations=20)
            inputs = tuple(fact.input for fact in facts)
            extensions.append(Extension(group, inputs, measures, problem, fitted.point, (None,) * len(group)))
            values.append(_estimates(problem, fitted, group, facts))
        model = extended_model(extensions)
        order = [joint for joint in joints if joint in model.joints]
        if tuple(order) != model.joints:
            raise MethodError(
                f"the joints {list(joints)} stand in another order than the model's", remedy="Order them by number"
            )
        return Fit(
            model=replace(model, vocabulary=()) if own else model,
            estimates=_joined(values),
            residuals=np.concatenate([f for _, f in values]),
            status=Status.CONVERGED,
            seconds=time.perf_counter() - begin,
            notes=tuple(notes),
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
    center = fitted.point.vector

    def coefficients(vector: Array) -> list[dict[ColumnName, float]]:
        point = fitted.point.at(vector)
        found = []
        for j in range(len(group)):
            row = point.parameters[0, j]
            named = dict(zip(NOMINAL[:7], row[:7].tolist(), strict=True))
            if point.switches[j, problem.kernel.switches[FRICTION]]:
                named[FRICTION] = float(row[problem.kernel.offsets[FRICTION]])
            free = {f.name.partition("@")[0] for f in point.free if f.joint == j} | {FRICTION, "inertia", "viscous"}
            found.append(columns_of({name: v for name, v in named.items() if name in free or name == "back_emf"}))
        return found

    names = [(column, j) for j, found in enumerate(coefficients(center)) for column in found]
    values = np.array([v for found in coefficients(center) for v in found.values()])
    slopes = np.zeros((len(values), len(center)))
    for k, free in enumerate(fitted.point.free):
        if free.kind != "start":
            step = np.zeros(len(center))
            step[k] = 1e-6 * free.scale
            moved = np.array([v for found in coefficients(center + step) for v in found.values()])
            slopes[:, k] = (moved - values) / step[k]
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
