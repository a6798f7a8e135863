"""`diagnosis.json`: a diagnosis as data for other programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from diagnosis.result import Diagnosis, Evidence, Gap, JointResult, NamedEffect


def to_json(diagnosis: Diagnosis) -> str:
    """The text of `diagnosis.json`; numbers that are not finite become null."""
    return json.dumps(_finite(as_dict(diagnosis)), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def as_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """The contract's layout; signals for plots are left out."""
    return {
        "verdict": diagnosis.verdict,
        "sentence": diagnosis.sentence,
        "effects": [effect_dict(effect) for effect in diagnosis.effects],
        "gap": gap_dict(diagnosis.gaps[0]) if diagnosis.gaps else None,
        "gaps": [gap_dict(gap) for gap in diagnosis.gaps],
        "ledger": [asdict(row) for row in diagnosis.ledger],
        "joints": [joint_dict(joint) for joint in diagnosis.joints],
        "remainder": {
            "excess": sum(joint.remainder_excess for joint in diagnosis.joints),
            "dependences": [{"joint": j.joint, **asdict(d)} for j in diagnosis.joints for d in j.remainder],
            "waves": [{"joint": j.joint, **asdict(j.wave)} for j in diagnosis.joints if j.wave is not None],
            "command_steps": [{"joint": j.joint, **asdict(j.coarse)} for j in diagnosis.joints if j.coarse is not None],
            "drifts": [
                {"joint": j.joint, **asdict(d), "certain": d.is_certain} for j in diagnosis.joints for d in j.drifts
            ],
        },
        "isolability": [asdict(row) for joint in diagnosis.joints for row in joint.isolability],
        "not_separable": [asdict(row) for joint in diagnosis.joints for row in joint.confusable],
        "missing_in_mujoco": [dict(item) for item in diagnosis.missing_in_mujoco],
        "mujoco_difference": diagnosis.mujoco_difference,
        "next_experiment": None if diagnosis.next_experiment is None else asdict(diagnosis.next_experiment),
        "provenance": asdict(diagnosis.provenance),
    }


def effect_dict(effect: NamedEffect) -> dict[str, Any]:
    """One named effect with its parameters, evidence and alternatives."""
    return {
        "name": effect.name,
        "joint": effect.joint,
        "stage": effect.stage,
        "only_in": effect.only_in,
        "instants": dict(effect.instants),
        "parameters": {
            p.name: {**asdict(p.physical), "input_equivalent": asdict(p.input_equivalent)} for p in effect.parameters
        },
        "evidence": evidence_dict(effect.evidence),
        "alternatives": [
            {"name": other.name, "joint": other.joint, "evidence": evidence_dict(other.evidence)}
            for other in effect.alternatives
        ],
    }


def evidence_dict(evidence: Evidence) -> dict[str, Any]:
    """Evidence with the net value that decides."""
    return {**asdict(evidence), "net": evidence.net}


def gap_dict(gap: Gap) -> dict[str, Any]:
    """The gain with the name of what is measured."""
    return {"metric": f"rms error of free simulation in windows of {gap.window:g} s", **asdict(gap)}


def joint_dict(joint: JointResult) -> dict[str, Any]:
    """Verdict and nominal parameters of one joint, before and after the effects."""
    return {
        "joint": joint.joint,
        "verdict": joint.verdict,
        "input": joint.input,
        "pieces_of": None if joint.patched is None else joint.patched.value,
        "nominal_parameters": {
            p.name: {
                "unit": p.unit,
                "given": p.given,
                "without_effects": {"value": p.without.value, "std": p.without.std},
                "final": {"value": p.final.value, "std": p.final.std},
                "shift": p.shift,
            }
            for p in joint.nominal
        },
    }


def _finite(item: Any) -> Any:
    if isinstance(item, Mapping):
        return {str(key): _finite(value) for key, value in item.items()}
    if isinstance(item, list | tuple):
        return [_finite(value) for value in item]
    if isinstance(item, bool) or item is None or isinstance(item, str | int):
        return item
    number = float(item)
    return number if math.isfinite(number) else None
