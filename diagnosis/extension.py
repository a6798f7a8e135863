"""The extended model of a diagnosis: final fits of all joints as one `StructuredModel`, and its MJCF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diagnosis.estimation import Point
from diagnosis.parameters import JointUnits
from diagnosis.problem import Problem
from diagnosis.replay import replay, rms
from envs.log import InputKind
from methods.kernel import NOMINAL
from methods.structured import COMPENSATOR, PlanarCoupling, StructuredJoint, StructuredModel
from methods.two_layer_network import TwoLayerNetwork

OWN = NOMINAL[: NOMINAL.index("arm")]
"""A joint's own parameters: a model of joints knows nothing of the rest of the arm."""
CHECKED = 3.0
"""Length of the stretch on which MuJoCo is compared with the model [s]."""


@dataclass(frozen=True, eq=False)
class Extension:
    """One problem's share of the extended model: a point that has been made ready for the held-out logs."""

    joints: tuple[int, ...]
    inputs: tuple[InputKind, ...]
    units: tuple[JointUnits, ...]
    held_out: Problem
    point: Point
    compensators: tuple[TwoLayerNetwork | None, ...]


@dataclass(frozen=True)
class Twin:
    """The extended model in MuJoCo: MJCF text, effects left out, rms difference per joint number [rad or m]."""

    xml: str
    left_out: tuple[dict[str, Any], ...]
    difference: dict[int, float]


def extended_model(extensions: Sequence[Extension]) -> StructuredModel:
    """All joints as one model; a planar pair comes first."""
    ordered = sorted(extensions, key=lambda item: -len(item.joints))
    parts: list[StructuredJoint] = []
    for item in ordered:
        kernel = item.held_out.kernel
        for j, joint in enumerate(item.joints):
            row = item.point.parameters[0, j]
            effects = {}
            for effect in kernel.effects:
                if item.point.switches[j, kernel.switches[effect.name]]:
                    start = kernel.offsets[effect.name]
                    names = [p.name for p in effect.parameters]
                    effects[effect.name] = dict(zip(names, row[start : start + effect.size].tolist(), strict=True))
            nominal = dict(zip(OWN, row[: len(OWN)].tolist(), strict=True))
            unit = item.units[j].position
            parts.append(StructuredJoint(joint, item.inputs[j], nominal, effects, unit, item.compensators[j]))
    first = ordered[0]
    coupling = PlanarCoupling(*first.point.rigid.tolist()) if first.held_out.pair else None
    return StructuredModel(tuple(parts), first.held_out.sample_time, coupling, first.held_out.kernel.effects)


def mujoco_twin(model: StructuredModel, extensions: Sequence[Extension], names: Sequence[str], window: float) -> Twin:
    """The model in MuJoCo, what it lacks, and what that costs on the held-out logs.

    names: of the model's joints. The cost is the rms error of free simulation in windows of the given length [s]
    without the effect, nothing refitted, beside that with it.
    """
    from diagnosis.mjcf_export import export, reproduction

    units = {joint: item.units[j].per_torque for item in extensions for j, joint in enumerate(item.joints)}
    exported = export(model, [units[joint] for joint in model.joints], names)
    left_out: list[dict[str, Any]] = []
    for joint, effect in exported.missing:
        item = next(item for item in extensions if joint in item.joints)
        j = item.joints.index(joint)
        entry: dict[str, Any] = {"effect": effect, "joint": joint}
        switches, networks = item.point.switches.copy(), list(item.compensators)
        if effect == COMPENSATOR:
            networks[j] = None
        elif effect in item.held_out.kernel.switches:
            switches[j, item.held_out.kernel.switches[effect]] = False
        lacking = replace(item.point, switches=switches)
        entry["error_with"], entry["error_without"] = (
            rms(replay(item.held_out, point, window, own).windows[:, j])
            for point, own in ((item.point, item.compensators), (lacking, networks))
        )
        entry["unit"] = item.units[j].position
        left_out.append(entry)
    ordered = sorted(extensions, key=lambda item: -len(item.joints))
    count = min(int(CHECKED / model.sample_time), *(int(item.held_out.bounds[1]) for item in ordered))
    command = np.concatenate([item.held_out.command[:count] for item in ordered], axis=1)
    differences = reproduction(model, exported, names, command)
    return Twin(exported.xml, tuple(left_out), dict(zip(model.joints, differences.tolist(), strict=True)))
