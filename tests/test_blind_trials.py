"""Effects are hidden in the second world's logs, at least one per stage of the signal chain, and have to be found.

The worlds share nothing with the models but the names. The same trials are also put to a diagnosis that always gives
the most common answer: it has to fail, or the trials would prove nothing.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import pytest

from benchmarks.blind.hidden import Hidden, Parameter, at_heat
from benchmarks.blind.score import compared, diagnose, outcome
from benchmarks.blind.trials import Trial, Truth, make_trial
from benchmarks.blind.world import Heat
from methods.effects import built_in


@dataclass(frozen=True)
class Case:
    """One trial: seed, kind, family of machines, hidden effect (None where the kind draws it), length."""

    seed: int
    kind: str
    family: str
    effect: str | None = None
    is_long: bool = False


CASES = (
    Case(11, "single", "adept_j1", "dead_zone", is_long=True),
    Case(12, "single", "servo", "input_delay"),
    Case(13, "single", "adept_j2", "cogging_torque"),
    Case(100, "single", "rotor", "joint_flexibility"),
    Case(100, "single", "adept_j1", "joint_flexibility", is_long=True),
    Case(800, "single", "stage", "backlash", is_long=True),
    Case(15, "single", "servo", "coulomb_friction"),
    Case(15, "single", "stage", "coulomb_friction", is_long=True),
    Case(17, "single", "pendulum", "quadratic_drag", is_long=True),
    Case(16, "single", "rotor", "encoder_eccentricity"),
    Case(16, "single", "adept_j1", "encoder_eccentricity", is_long=True),
    Case(18, "clean", "adept_j1"),
    Case(24, "foreign", "servo"),
)


@cache
def trial_of(case: Case) -> Trial:
    """The logs and their truth; 12 s each keep the test short."""
    return make_trial(case.seed, case.kind, case.family, effect=case.effect, duration=12.0)


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=pytest.mark.slow if case.is_long else ()) for case in CASES],
    ids=lambda case: f"{case.effect or case.kind} in {case.family}",
)
def test_hidden_effect_is_found(case: Case) -> None:
    trial = trial_of(case)
    diagnosis, _ = diagnose(trial)
    named = [item["name"] for item in diagnosis["effects"]]
    assert outcome(trial.truth, diagnosis) == "right", f"{diagnosis['verdict']}: {named}"


@pytest.mark.parametrize(
    ("name", "outcomes"), [("timestamp_jitter", ["right"] * 3), ("dead_zone", ["right", "wrong", "wrong"])]
)
def test_an_error_of_the_clock_is_that_of_every_joint(name: str, outcomes: list[str]) -> None:
    hidden = SimpleNamespace(joint=1, hidden=SimpleNamespace(name=name, equivalent=()))
    truth = cast(Truth, SimpleNamespace(effects=(hidden,), structure=(), foreign=False))
    for joints, expected in zip(((1,), (2,), (1, 2)), outcomes, strict=True):
        effects = [{"joint": joint, "name": name, "alternatives": []} for joint in joints]
        assert outcome(truth, {"verdict": "named", "effects": effects}) == expected


def test_of_several_harmonics_the_one_that_was_hidden_is_compared() -> None:
    true = {
        "cycles_per_rev": Parameter(48.0, "1/rev"),
        "amplitude": Parameter(0.1, "V"),
        "phase": Parameter(0.3, "rad"),
    }
    hidden = SimpleNamespace(joint=1, hidden=SimpleNamespace(name="cogging_torque", parameters=true))
    truth = cast(Truth, SimpleNamespace(effects=(hidden,)))

    def wave(cycles: float, amplitude: float) -> dict[str, Any]:
        values = {"cycles_per_rev": cycles, "amplitude": amplitude}
        parameters = {name: {"value": v, "input_equivalent": {"value": v, "std": 0.01}} for name, v in values.items()}
        return {"joint": 1, "name": "cogging_torque", "parameters": parameters}

    assert compared(truth, {"effects": [wave(96.0, 0.01), wave(48.1, 0.11)]}) == [
        ("cogging_torque.cycles_per_rev", 48.0, 48.1, 0.01),
        ("cogging_torque.amplitude", 0.1, 0.11, 0.01),
    ]
    assert compared(truth, {"effects": [{**wave(48.0, 0.1), "joint": 2}]}) == []


@pytest.mark.parametrize("law", list(Heat))
def test_the_true_rise_of_a_resistance_is_that_at_the_recorded_current(law: Heat) -> None:
    changes = {"heating": 0.2, "heating_law": law}
    hidden = at_heat(Hidden("thermal_drift", changes, {"time_constant": Parameter(9.0, "s")}), 1.5)
    rise = hidden.parameters["resistance_rise"].value
    assert rise == pytest.approx(0.3 * (1.0 + rise if law == Heat.COPPER else 1.0))
    other = Hidden("dead_zone", {}, {})
    assert at_heat(other, 1.5) is other


def test_the_trials_cover_every_stage() -> None:
    stages = {effect.name: effect.stage for effect in built_in()}
    assert {stages[case.effect] for case in CASES if case.effect and not case.is_long} == set(stages.values())


def test_the_most_common_answer_fails() -> None:
    """A diagnosis that always answers the most common name is right in a small share of the quick trials."""
    quick = [case for case in CASES if not case.is_long]
    hidden = Counter(
        "+".join(sorted(effect.hidden.name for effect in trial_of(case).truth.effects)) or "none" for case in quick
    )
    assert hidden.most_common(1)[0][1] <= len(quick) // 4
