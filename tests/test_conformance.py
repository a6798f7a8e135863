"""Every registered method and every effect keeps its promises, and each check fails where its promise is broken."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from diagnosis.effect_checks import EFFECT_CHECKS, EffectSubject
from envs.log import Log
from methods.base import Estimates, Fit, Method, Motion, Status
from methods.conformance.check import Check, Outcome, examine_all, undeclared
from methods.conformance.example import LinearJoint
from methods.conformance.method_checks import METHOD_CHECKS, MethodSubject
from methods.conformance.representation import rebuilt
from methods.conformance.units import exponents
from methods.effects import built_in
from methods.effects.base import Effect, EffectParameter
from methods.kernel import build
from methods.least_squares import LeastSquares
from methods.plugins import load_all
from methods.registry import METHODS, Entry
from methods.whole_arm import WholeArm

load_all()
CHECKS = {check.name: check for check in METHOD_CHECKS}
OF_EFFECTS = {check.name: check for check in EFFECT_CHECKS}


SLOW = frozenset(
    (
        "diagnosis",
        "ensemble_sindy",
        "gaussian_process",
        "full-model",
        "kalman_filter",
        "mujoco_sysid",
        "network_alone",
        "weak_sindy",
        *METHODS.names("torch"),
    )
)
"""Methods whose checks take more than ten seconds: by default they run only those that fit nothing."""
WITHOUT_A_FIT = tuple(
    CHECKS[name] for name in ("row_key", "no_logs", "empty_log", "short_log", "still_log", "wrong_joints")
)


@pytest.mark.parametrize("entry", [entry for entry in METHODS if entry.name not in SLOW], ids=lambda entry: entry.name)
def test_every_method_keeps_its_promises(entry: Entry[Method]) -> None:
    check_method(entry, METHOD_CHECKS)


@pytest.mark.parametrize("name", sorted(SLOW))
def test_slow_methods_keep_the_quick_promises(name: str) -> None:
    check_method(METHODS[name], WITHOUT_A_FIT)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SLOW))
def test_slow_methods_keep_their_promises(name: str) -> None:
    check_method(METHODS[name], METHOD_CHECKS)


def check_method(entry: Entry[Method], checks: Sequence[Check[MethodSubject]]) -> None:
    subject = MethodSubject(entry)
    expected = subject.new().expected_failures
    assert undeclared(METHOD_CHECKS, expected) == ()
    failed = [r.line for r in examine_all(checks, subject, expected) if r.outcome is Outcome.FAILED]
    assert failed == []


QUICK = tuple(check for check in EFFECT_CHECKS if check.name not in ("recovers_itself", "law"))
"""Typesetting is tested with the report; recovery takes seconds per effect."""


@pytest.mark.parametrize("effect", built_in(), ids=lambda effect: effect.name)
def test_every_effect_keeps_its_promises(effect: Effect) -> None:
    check_effect(effect, QUICK)


@pytest.mark.slow
@pytest.mark.parametrize("effect", built_in(), ids=lambda effect: effect.name)
def test_every_effect_is_recovered(effect: Effect) -> None:
    check_effect(effect, (OF_EFFECTS["recovers_itself"],))


def test_a_friction_is_recovered() -> None:
    (effect,) = (effect for effect in built_in() if effect.name == "coulomb_friction")
    check_effect(effect, (OF_EFFECTS["recovers_itself"],))


def check_effect(effect: Effect, checks: Sequence[Check[EffectSubject]]) -> None:
    expected = dict(effect.expected_failures)
    assert undeclared(EFFECT_CHECKS, expected) == ()
    subject = EffectSubject(effect, build(built_in()))
    failed = [r.line for r in examine_all(checks, subject, expected) if r.outcome is Outcome.FAILED]
    assert failed == []


# ------------------------------------------------------------------------------------ a broken promise breaks its check


def of(fit: Fit, **changes: object) -> Fit:
    return replace(fit, **changes)  # type: ignore[arg-type]


class Biased:
    """A model that answers like another one, wrongly; it is no dataclass."""

    def __init__(self, model: object, inverse: float = 1.0, reach: int = 10**9):
        self.model, self.factor, self.reach = model, inverse, reach
        self.joints, self.inputs = model.joints, model.inputs  # type: ignore[attr-defined]

    def inverse(self, time, motion, command=None):  # type: ignore[no-untyped-def]
        return self.factor * self.model.inverse(time, motion, command)[: self.reach]  # type: ignore[attr-defined]

    def simulate(self, time, command, initial, hold="zero_order") -> Motion:  # type: ignore[no-untyped-def]
        return self.model.simulate(time, command, initial, hold)  # type: ignore[attr-defined]


COUNTER = [0.0]


@dataclass(frozen=True)
class Broken(LeastSquares):
    """Least squares with one defect."""

    defect: str = ""

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        if self.defect == "careless":  # knows no MethodError
            return plain(logs)
        if self.defect == "half the log":
            logs = [log.joint(log.joints[0]) for log in logs]
        fit = LeastSquares.fit(self, logs, rng)
        estimates, model = fit.estimates, fit.model
        match self.defect:
            case "nothing":
                return None  # type: ignore[return-value]
            case "status":
                return of(fit, status="fine")
            case "short":
                return of(fit, model=Biased(model, reach=-1))
            case "stateful":
                COUNTER[0] += 1.0
                return of(fit, residuals=fit.residuals + COUNTER[0])
            case "remembers":
                return of(fit, residuals=fit.residuals + self.__dict__.setdefault("seen", logs[0].position[10, 0]))
            case "global":
                np.random.seed(3)  # noqa: NPY002
            case "writes":
                logs[0].command[0] = 1.0
            case "lambda":
                return of(fit, notes=(lambda: None,))
            case "unsaved":
                return of(fit, model=Biased(model))
            case "biased":
                return of(fit, model=Biased(model, inverse=1.03))
            case "unit":
                return of(fit, estimates=replace(estimates, units=("rad/s", "rad", "m")))
            case "volts":
                return of(fit, estimates=replace(estimates, units=("V s^3/rad", "V s^2/rad", "V s/rad")))
            case "covariance":
                return of(fit, estimates=replace(estimates, covariance=-estimates.covariance))
            case "first log":
                return LeastSquares.fit(self, logs[:1], rng) if len(logs) > 1 else fit
            case "wrong":
                scaled = replace(model, coefficients=2.2 * fit.model.coefficients)  # type: ignore[attr-defined,type-var]
                return of(fit, model=scaled, status=Status.CONVERGED)
            case "seconds":
                return of(fit, seconds=1e3)
        return fit


def plain(logs: Sequence[Log]) -> Fit:
    """Least squares without any guard, on the last log only."""
    log = logs[-1]
    rate = np.gradient(log.position[:, 0], log.time)
    gain = float(np.linalg.lstsq(rate[:, None], log.command[:, 0])[0][0])
    model = LeastSquares().fit([LinearJoint().log(1)], np.random.default_rng(0)).model
    estimates = Estimates(("velocity",), ("V s/rad",), np.array([gain]), np.array([[1.0]]))
    return Fit(model, estimates, log.command[:, 0] - gain * rate, Status.CONVERGED, 0.0)


@pytest.mark.parametrize(
    ("defect", "check", "reason"),
    [
        ("nothing", "fits_the_example", "NoneType"),
        ("status", "fits_the_example", "status is a str"),
        ("short", "shapes", "shape of the inverse"),
        ("stateful", "same_bits", "residual"),
        ("remembers", "refit", "residual"),
        ("global", "inputs_untouched", "global generator"),
        ("writes", "inputs_untouched", "writes into the arrays"),
        ("lambda", "pickles", "cannot be pickled"),
        ("unsaved", "saves", "is a Biased"),
        ("biased", "inverse_and_simulation_agree", "position errs"),
        ("biased", "recovery", "its command errs by 3 %"),
        ("half the log", "several_joints", "a log of two joints is fitted without complaint"),
        ("unit", "units", "expected"),
        ("volts", "kinds_of_joints", "the command's unit is A"),
        ("covariance", "covariance", "negative eigenvalue"),
        ("first log", "order_of_logs", "change places"),
        ("wrong", "honest_status", "CONVERGED"),
        ("seconds", "time_budget", "it states"),
        ("careless", "no_logs", "IndexError"),
        ("careless", "empty_log", "not in a MethodError"),
        ("careless", "short_log", "not in a MethodError"),
        ("careless", "still_log", "without complaint"),
        ("careless", "wrong_joints", "without complaint"),
    ],
)
def test_a_broken_method_fails_its_check(defect: str, check: str, reason: str) -> None:
    COUNTER[0] = 0.0
    entry: Entry[Method] = Entry(
        "broken", lambda: Broken(defect=defect), frozenset(("single-joint", "physics")), "test"
    )
    subject = MethodSubject(replace(entry, factory=lambda: Broken(defect=defect)))
    state = np.random.get_state()  # noqa: NPY002
    try:
        (result,) = examine_all([CHECKS[check]], subject)
    finally:
        np.random.set_state(state)  # noqa: NPY002
    assert result.outcome is Outcome.FAILED, result.line
    assert reason in result.reason
    assert "\n" not in result.line


def test_half_an_arm_is_not_several_joints() -> None:
    entry: Entry[Method] = Entry(
        "half", lambda: Broken(defect="half the log"), frozenset(("single-joint", "multi-joint")), "test"
    )
    (result,) = examine_all([CHECKS["several_joints"]], MethodSubject(entry))
    assert result.outcome is Outcome.FAILED
    assert "speaks of joints (1,)" in result.reason


@dataclass(frozen=True)
class Weak(WholeArm):
    """The whole arm with drives that are five per cent off."""

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        fit = WholeArm.fit(self, logs, rng)
        drives = fit.model.drives  # type: ignore[attr-defined]
        return of(fit, model=replace(fit.model, drives=replace(drives, scale=1.05 * drives.scale)))  # type: ignore[type-var]


def test_a_method_of_several_joints_is_checked_on_an_arm() -> None:
    entry: Entry[Method] = Entry("weak", Weak, frozenset(("multi-joint", "physics")), "test")
    found = {result.check: result for result in examine_all(METHOD_CHECKS, MethodSubject(entry))}
    assert {name for name, result in found.items() if result.outcome is Outcome.FAILED} == {"recovery"}
    assert not any(result.outcome is Outcome.NOT_APPLICABLE for result in found.values())


def test_a_declared_failure_is_shown_with_its_reason_and_must_happen() -> None:
    subject = MethodSubject(METHODS["least_squares"])
    broken = replace(CHECKS["no_logs"])
    (result,) = examine_all([broken], subject, {"no_logs": "it likes none"})
    assert result.outcome is Outcome.FAILED
    assert "it likes none" in result.reason
    raising = MethodSubject(Entry("broken", lambda: Broken(defect="covariance"), frozenset({"single-joint"}), "test"))
    (result,) = examine_all([CHECKS["covariance"]], raising, {"covariance": "it has no room"})
    assert result.outcome is Outcome.EXPECTED
    assert "it has no room" in result.line
    assert undeclared(METHOD_CHECKS, {"covarianse": "mistyped"}) == ("covarianse",)


@pytest.mark.parametrize(
    ("unit", "found"),
    [
        ("V s^2/rad", {"V": 1, "s": 2, "rad": -1}),
        ("rad/s^2/V", {"rad": 1, "s": -2, "V": -1}),
        ("1/s", {"s": -1}),
        ("1", {}),
        ("N m/m", {"N": 1}),
    ],
)
def test_units_are_exponents(unit: str, found: dict[str, int]) -> None:
    assert exponents(unit) == found


@pytest.mark.parametrize("unit", ["", "V/", "furlong", "V s^x", "V*s"])
def test_what_is_no_unit_is_refused(unit: str) -> None:
    with pytest.raises(ValueError, match="V s"):
        exponents(unit)


def test_a_repr_rebuilds_its_method_and_runs_no_code() -> None:
    method = LeastSquares(columns=("velocity",), reversal_velocity=-0.5)
    assert rebuilt(repr(method), method) == method
    for text in ("__import__('os')", "LeastSquares(columns=open('x'))", "1 +", "[x for x in ()]"):
        with pytest.raises(ValueError, match=r"dataclass|expression"):
            rebuilt(text, method)


def test_the_linear_joint_obeys_its_equation() -> None:
    """Differences of the exact recording against the equation, and the smooth motion against its own differences."""
    joint = LinearJoint(electrical=0.0)
    log = joint.log(3)
    rate = np.diff(log.position[:, 0]) / 1e-3
    middle = 0.5 * (rate[1:] + rate[:-1])
    held = joint.inertia * np.diff(rate) / 1e-3 + joint.damping * middle
    np.testing.assert_allclose(held, 0.5 * (log.command[1:-1, 0] + log.command[:-2, 0]), atol=0.02)
    time, motion, _ = joint.unseen()
    np.testing.assert_allclose(
        np.gradient(motion.velocity[:, 0], time)[1:-1], motion.acceleration[1:-1, 0], rtol=0.01, atol=0.1
    )


# ------------------------------------------------------------------------------------------------------ effects, broken

GOOD = Effect(
    name="wind",
    stage="arm",
    slot="torque",
    parameters=(EffectParameter("torque", "torque", "its level"),),
    equation=r"\tau = W",
    variable="elapsed time",
    source="test",
    starts=lambda s: [(0.02 * s.torque_rms,)],
    function=lambda t, q, dq, w, x, p: p[0],
)


def level(t, q, dq, w, p):  # type: ignore[no-untyped-def]
    return p[0]


def with_unit(t, q, dq, w, x, p):  # type: ignore[no-untyped-def]
    return p[0] + 0.1


STRAY = 3.0


def astray(t, q, dq, w, x, p):  # type: ignore[no-untyped-def]
    return STRAY * p[0]


def swapped(t, dq, q, w, x, p):  # type: ignore[no-untyped-def]
    return p[0]


def infinite(t, q, dq, w, x, p):  # type: ignore[no-untyped-def]
    return p[0] / dq if dq else float("inf")


@pytest.mark.parametrize(
    ("changes", "check", "reason"),
    [
        ({"name": "Wind"}, "declaration", "lower_case"),
        ({"variable": "humidity"}, "declaration", "humidity"),
        ({"parameters": (EffectParameter("torque", "colour", "x"),)}, "declaration", "colour"),
        ({"parameters": (EffectParameter("torque", "torque", "x", 1.0, 0.0),)}, "declaration", "bounds"),
        ({"amplitudes": (1,)}, "declaration", "no parameters"),
        ({"equation": r"\tau = \nonsense"}, "law", "no mathtext"),
        ({}, "function_of_its_slot", "lambda"),
        ({"function": astray}, "function_of_its_slot", "STRAY"),
        ({"function": swapped}, "function_of_its_slot", "gives (t, q, dq, w, x, p)"),
        ({"function": with_unit}, "dimensions", "declared wrongly"),
        ({"parameters": (EffectParameter("torque", "time", "x"),)}, "dimensions", "declared wrongly"),
        ({"function": infinite}, "bounds", "the result is"),
        ({"slot": "friction", "function": level}, "bounds", "the level is -"),
        ({"starts": None}, "starting_values", "neither"),
        ({"starts": lambda s: [(1.0, 2.0)]}, "starting_values", "2 starting values for 1"),
        ({"starts": lambda s: [(float("nan"),)]}, "starting_values", "starts at nan"),
        ({"scan": "event"}, "starting_values", "events"),
        ({"scan": "time"}, "starting_values", "three parameters"),
    ],
)
def test_a_broken_effect_fails_its_check(changes: dict[str, object], check: str, reason: str) -> None:
    effect = dataclasses.replace(GOOD, **changes)  # type: ignore[arg-type]
    (result,) = examine_all([OF_EFFECTS[check]], EffectSubject(effect, build(built_in())))
    assert result.outcome is Outcome.FAILED, result.line
    assert reason in result.reason
