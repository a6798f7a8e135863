"""The checks of a method, in the order in which they are run. A docstring's first sentence is the promise.

Most use one fit of a noise-free example, so that a quick method is checked in a second: a linear joint
(`methods.conformance.example`), or, for a method that takes several joints only, two joints of an arm
(`methods.conformance.example_arm`). `Method.check_settings` makes a slow one quick; `Method.expected_failures` names
what it fails by its nature.
"""

from __future__ import annotations

import dataclasses
import math
import pickle
import tempfile
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from envs.log import Array, Log
from methods.base import Estimates, Fit, Method, MethodError, Model, Motion, State, Status
from methods.conformance.check import Check, CheckFailed, NotApplicable
from methods.conformance.example import LinearJoint, rescaled
from methods.conformance.example_arm import TwoJoints
from methods.conformance.isolated import Prepared
from methods.conformance.representation import rebuilt
from methods.conformance.units import exponents
from methods.model_files import fit_to_json, load_model
from methods.plugins import build_method, find_method
from methods.registry import Entry, one_line

EXACT = 0.01
"""Largest relative error of a command or a simulated motion that counts as exact: what a finite filter costs."""
AGREEMENT = 0.02
"""Largest relative disagreement of inverse and simulation."""
ORDER = 0.1
"""Largest relative change of the modelled command when two logs of different damping change places: the rounding that a
trainer amplifies, the samples that a subset happens to hold. A method that follows time changes by more."""
NOTHING = 1e-3
"""Share of the command below which an offset or a friction is none."""
SHORT = 400
"""Samples of a simulation whose bits are compared."""


@dataclass(frozen=True, eq=False)
class MethodSubject:
    """A method under examination; `budget` is the time that one fit of a four-second log may take [s]."""

    entry: Entry[Method]
    budget: float = 60.0

    @cached_property
    def joint(self) -> LinearJoint | TwoJoints:
        """The example on which the method is checked."""
        return LinearJoint() if "single-joint" in self.entry.tags else TwoJoints()

    def new(self) -> Method:
        """The method as it is checked, a new object each time."""
        method = self.entry.factory()
        return dataclasses.replace(method, **method.check_settings) if method.check_settings else method  # type: ignore[type-var]

    @cached_property
    def log(self) -> Log:
        return self.joint.log(1)

    @cached_property
    def timed(self) -> tuple[Fit, float]:
        """The fit of the example on which most checks look, and the seconds that it took."""
        begin = clock.perf_counter()
        fit = self.new().fit([self.log], np.random.default_rng(0))
        return fit, clock.perf_counter() - begin

    @property
    def fit(self) -> Fit:
        """That fit. Raises NotApplicable when there is none: the first check says why."""
        try:
            return self.timed[0]
        except Exception as error:
            raise NotApplicable("there is no fit of the example to look at") from error

    def fitted(self, logs: Sequence[Log]) -> Fit:
        """Another fit with the same generator."""
        return self.new().fit(logs, np.random.default_rng(0))


def fits_the_example(subject: MethodSubject) -> None:
    """It fits four seconds of a noise-free linear joint, or of two joints of an arm, and returns a Fit."""
    fit, _ = subject.timed
    if not isinstance(fit, Fit):
        raise CheckFailed(f"fit returns a {type(fit).__name__}, not a methods.base.Fit")
    wrong = [
        f"{name} is a {type(getattr(fit, name)).__name__}, not a {wanted.__name__}"
        for name, wanted in (("model", Model), ("estimates", Estimates), ("status", Status))
        if not isinstance(getattr(fit, name), wanted)
    ]
    if wrong:
        raise CheckFailed("; ".join(wrong))


def shapes(subject: MethodSubject) -> None:
    """Answers, residuals and estimates have the shapes that methods/base.py states."""
    fit = subject.fit
    time, motion, command = subject.joint.unseen()
    rest = State.at_rest(np.zeros(len(fit.model.joints)))
    simulated = fit.model.simulate(time[:SHORT], command[:SHORT], rest, "first_order")
    found = {
        "joints": (tuple(fit.model.joints), subject.log.joints),
        "inputs": (tuple(fit.model.inputs), tuple(fact.input for fact in subject.log.facts)),
        "shape of the inverse": (np.shape(fit.model.inverse(time, motion, command)), command.shape),
        **{
            f"shape of the simulated {name}": (np.shape(getattr(simulated, name)), command[:SHORT].shape)
            for name in ("position", "velocity", "acceleration", "jerk")
        },
        "dimensions of the residuals": (np.ndim(fit.residuals), 1),
        "dimensions of the learning curve": (np.ndim(fit.learning_curve), 1),
    }
    for what, (actual, wanted) in found.items():
        if actual != wanted:
            raise CheckFailed(f"{what}: {actual}, expected {wanted}")
    if not np.all(np.isfinite(fit.residuals)):
        raise CheckFailed("residuals are not finite")
    if len(set(fit.estimates.names)) < len(fit.estimates.names):
        raise CheckFailed(f"two estimates share a name: {', '.join(fit.estimates.names)}")


def same_bits(subject: MethodSubject) -> None:
    """The same generator gives the same bits."""
    _compare(subject, subject.fit, subject.fitted([subject.log]), "a second fit from the same seed")


def refit(subject: MethodSubject) -> None:
    """A fit leaves nothing behind: the same object, used in between on another log, repeats its answer."""
    first, method = subject.fit, subject.new()
    method.fit([subject.joint.log(2)], np.random.default_rng(1))
    _compare(subject, first, method.fit([subject.log], np.random.default_rng(0)), "the refit")
    if method != subject.new():
        raise CheckFailed(f"fitting changes the specification from {subject.new()!r} to {method!r}")


def inputs_untouched(subject: MethodSubject) -> None:
    """Logs and numpy's global generator are left as they were."""
    log = replace(subject.log)
    before, state = replace(log).content_hash, _global_state()
    try:
        subject.new().fit([log], np.random.default_rng(0))
    except ValueError as error:
        if "read-only" in str(error):
            raise CheckFailed("fit writes into the arrays of the log") from error
        raise
    if replace(log).content_hash != before:
        raise CheckFailed("the log's contents have changed")
    if _global_state() != state:
        raise CheckFailed("fit draws from numpy's global generator. Use the one that is given")


def pickles(subject: MethodSubject) -> None:
    """Specification, fit and model survive pickling, and answer as before."""
    method = subject.new()
    for what, item in (("specification", method), ("fit", subject.fit)):
        try:
            copy = pickle.loads(pickle.dumps(item))
        except Exception as error:
            raise CheckFailed(f"the {what} cannot be pickled: {one_line(error)}") from error
        if what == "specification" and copy != method:
            raise CheckFailed(f"the copy {copy!r} differs from {method!r}")
    _compare(subject, subject.fit, copy, "the pickled fit")


def saves(subject: MethodSubject) -> None:
    """The model can be written as JSON and read back, and answers as before."""
    fit = subject.fit
    text = fit_to_json(subject.new(), subject.entry.name, fit, [subject.log], 0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.json"
        path.write_text(text, encoding="utf-8")
        _compare(subject, fit, replace(fit, model=load_model(path)), "the model read back")


def row_key(subject: MethodSubject) -> None:
    """The repr names every argument, rebuilds the method, and tells two specifications apart."""
    method = subject.new()
    text = repr(method)
    if not dataclasses.is_dataclass(method) or not type(method).__dataclass_params__.frozen:
        raise CheckFailed(f"{type(method).__name__} is no frozen dataclass. Write @dataclass(frozen=True)")
    if " at 0x" in text or "\n" in text:
        raise CheckFailed(f"the repr holds a memory address or a line break: {text[:120]}")
    if text != repr(subject.new()):
        raise CheckFailed("two equal specifications have different reprs")
    try:
        copy = rebuilt(text, method)
    except ValueError as error:
        raise CheckFailed(f"the repr does not rebuild the method: {error}") from error
    if copy != method:
        raise CheckFailed(f"the repr {text} rebuilds a different method")


def recovery(subject: MethodSubject) -> None:
    """It finds the example: exactly when it is tagged physics, else better than a constant."""
    exact = "physics" in subject.entry.tags
    errors = [_unseen_error(subject.joint, subject.fit.model)]
    if exact and errors[0] > EXACT and isinstance(subject.joint, LinearJoint):
        mechanical = replace(subject.joint, electrical=0.0)  # a method of second order has no winding
        errors.append(_unseen_error(mechanical, subject.fitted([mechanical.log(1)]).model))
    limit = EXACT if exact else 0.9
    if not min(errors) <= limit:
        raise CheckFailed(
            f"on a motion that it has not seen its command errs by {100 * min(errors):.3g} % of the command's rms, "
            f"allowed are {100 * limit:g} %"
        )


def inverse_and_simulation_agree(subject: MethodSubject) -> None:
    """Simulating with the command that the inverse gives returns the motion."""
    model = subject.fit.model
    time, motion, command = subject.joint.unseen()
    answer = model.inverse(time, motion, command)
    if np.all(np.isnan(answer)):
        raise NotApplicable("the model answers no inverse")
    if not np.all(np.isfinite(answer)):
        raise CheckFailed(f"{int(np.sum(~np.isfinite(answer)))} of {len(answer)} commands of the inverse are NaN")
    simulated = model.simulate(time, answer, motion.state(0), "first_order").position
    if np.all(np.isnan(simulated[1:])):
        raise NotApplicable("the model answers no simulation")
    if not np.all(np.isfinite(simulated)):
        first = int(np.argmax(~np.isfinite(simulated[:, 0])))
        raise CheckFailed(f"the simulation diverges after {time[first]:.3g} s")
    error = float(np.max(np.abs(simulated - motion.position)) / np.ptp(motion.position))
    if not error <= AGREEMENT:
        raise CheckFailed(f"the simulated position errs by up to {100 * error:.3g} % of its range")


def units(subject: MethodSubject) -> None:
    """Every estimate has a unit, and scales with the command as its unit says."""
    estimates = subject.fit.estimates
    if not estimates.names:
        return
    powers = []
    for name, unit in zip(estimates.names, estimates.units, strict=True):
        try:
            powers.append(exponents(unit))
        except ValueError as error:
            raise CheckFailed(f"the unit of {name} is not understood: {error}") from error
    if "physics" not in subject.entry.tags:
        return
    factor, own = 2.0, exponents(subject.log.facts[0].command_unit)
    resolution = NOTHING * float(np.std(subject.log.command))
    scaled = subject.fitted([rescaled(subject.log, factor)]).estimates
    if scaled.names != estimates.names:
        raise CheckFailed(f"with a doubled command the estimates are {', '.join(scaled.names)}")
    for k, (name, power) in enumerate(zip(estimates.names, powers, strict=True)):
        if set(power) & {"N", "kg", "A"}:
            continue  # SI numbers by a robot's description: they do not follow from the command alone
        wanted = factor ** power.get("V", 0) * estimates.values[k]
        slack = 3.0 * factor * (estimates.standard_errors[k] + scaled.standard_errors[k])
        slack = np.nan_to_num(slack) + (resolution if power == own else 0.0)
        if not abs(scaled.values[k] - wanted) <= 0.05 * abs(wanted) + slack:
            raise CheckFailed(
                f"{name} [{estimates.units[k]}] goes from {estimates.values[k]:.4g} to {scaled.values[k]:.4g} when the "
                f"command is doubled, expected {wanted:.4g}"
            )


def covariance(subject: MethodSubject) -> None:
    """Estimates are finite and their covariance is symmetric and positive semidefinite."""
    estimates = subject.fit.estimates
    if not np.all(np.isfinite(estimates.values)):
        raise CheckFailed("an estimate is not finite")
    matrix = estimates.covariance
    if not np.all(np.isfinite(matrix)):
        raise CheckFailed("the covariance is not finite")
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale[scale == 0.0] = 1.0
    scaled = matrix / np.outer(scale, scale)
    if not np.allclose(scaled, scaled.T, rtol=0.0, atol=1e-6):
        raise CheckFailed("the covariance is not symmetric")
    if len(scaled) and np.linalg.eigvalsh(scaled)[0] < -1e-6:
        raise CheckFailed("the covariance has a negative eigenvalue")


def honest_status(subject: MethodSubject) -> None:
    """The status is not CONVERGED where the result is useless or the excitation separates no parameters."""
    fit = subject.fit
    if fit.status is Status.CONVERGED and not _unseen_error(subject.joint, fit.model) < 1.0:
        raise CheckFailed("it says CONVERGED, but its model is no better than a constant")
    if "physics" not in subject.entry.tags:
        return
    try:
        single = subject.fitted([subject.joint.sine()])
    except MethodError:
        return
    values, spread = single.estimates.values, single.estimates.standard_errors
    wrong = _unseen_error(subject.joint, single.model) > 0.1
    if single.status is Status.CONVERGED and wrong and not np.any(spread > 0.5 * np.abs(values)):
        raise CheckFailed("under a single sine it says CONVERGED with small standard errors, but its model is wrong")


def time_budget(subject: MethodSubject) -> None:
    """A fit of four seconds ends within the budget, and states its own duration."""
    fit, taken = subject.timed
    if taken > subject.budget:
        raise CheckFailed(f"the fit took {taken:.3g} s, the budget is {subject.budget:g} s")
    if not 0.0 <= fit.seconds <= 1.01 * taken + 1e-3:
        raise CheckFailed(f"it states {fit.seconds:.3g} s, but took {taken:.3g} s")


def order_of_logs(subject: MethodSubject) -> None:
    """The order of the logs hardly matters, even when the joint has changed in between."""
    worn = replace(subject.joint, damping=1.5 * subject.joint.damping)
    logs = [subject.log, worn.log(2)]
    try:
        one, other = subject.fitted(logs), subject.fitted(logs[::-1])
    except MethodError as error:
        raise NotApplicable(f"it does not take two logs: {error}") from error
    time, motion, command = subject.joint.unseen()
    answers = [fit.model.inverse(time, motion, command) for fit in (one, other)]
    if np.all(np.isnan(answers)):
        answers = [_simulated(fit.model, time, command) for fit in (one, other)]
    change = _rms(answers[1] - answers[0]) / max(_rms(answers[0]), 1e-300)
    if not change <= ORDER:
        raise CheckFailed(f"the answers change by {100 * change:.3g} % when two logs change places")


def kinds_of_joints(subject: MethodSubject) -> None:
    """It works on current, torque and force drives, in rad and in m, or says that it does not."""
    for joint in _other_drives(subject.joint):
        log = joint.log(1)
        own, position = log.facts[0].command_unit, log.facts[0].position_unit
        what = f"a {joint.input} log in {position}"
        try:
            fit = subject.fitted([log])
        except MethodError:
            continue
        except Exception as error:
            raise CheckFailed(f"{what} ends in {one_line(error)}") from error
        if set(fit.model.inputs) != {joint.input} or tuple(fit.model.joints) != log.joints:
            raise CheckFailed(f"{what}: the model speaks of joints {fit.model.joints} with inputs {fit.model.inputs}")
        time, motion, command = joint.unseen()
        answer = fit.model.inverse(time, motion, command)
        if not (np.all(np.isfinite(answer)) or np.all(np.isnan(answer))):
            raise CheckFailed(f"{what}: the inverse is not finite")
        foreign = [unit for unit in fit.estimates.units if _foreign(unit, own, position)]
        if foreign:
            raise CheckFailed(f"{what} gives an estimate in {foreign[0]}; the command's unit is {own}")


def _other_drives(joint: LinearJoint | TwoJoints) -> tuple[LinearJoint | TwoJoints, ...]:
    if isinstance(joint, TwoJoints):
        return tuple(replace(joint, input=kind) for kind in ("current", "torque"))
    return (
        replace(joint, input="current", electrical=0.0),
        replace(joint, input="torque", electrical=0.0),
        replace(joint, input="torque", electrical=0.0, unit="m", inertia=0.5, damping=6.0, number=3),
    )


def _foreign(unit: str, command: str, position: str) -> bool:
    """True for a unit that speaks of another drive or another kind of joint than the log's."""
    power = exponents(unit)
    lever = position == "m" and ("rad" in power or "N m" in unit)
    return lever or ("V" in power and command != "V")


def no_logs(subject: MethodSubject) -> None:
    """Without a log it raises a MethodError."""
    _refuses(subject, [], "no log")


def empty_log(subject: MethodSubject) -> None:
    """A log without samples is refused with a MethodError."""
    _refuses(subject, [subject.log.slice(0, 0)], "a log without samples")


def short_log(subject: MethodSubject) -> None:
    """Logs of one and of five samples are refused with a MethodError."""
    _refuses(subject, [subject.log.slice(0, 1)], "a log of one sample")
    _refuses(subject, [subject.log.slice(100, 105)], "a log of five samples")


def still_log(subject: MethodSubject) -> None:
    """A joint that does not move is refused with a MethodError, or the status says that nothing was found."""
    for name, log in (("a still joint", subject.joint.still()), ("a stalled joint", subject.joint.still(command=1.0))):
        _refuses(subject, [log], name, unless=lambda fit: fit.status in (Status.FAILED, Status.ILL_CONDITIONED))


def wrong_joints(subject: MethodSubject) -> None:
    """Logs of different joints together are refused with a MethodError."""
    if isinstance(subject.joint, TwoJoints):
        other, what = replace(subject.joint, numbers=(1, 4)).log(2), "logs of joints 1, 2 and of joints 1, 4"
    else:
        other, what = replace(subject.joint, number=2).log(2), "logs of joints 1 and 2"
    _refuses(subject, [subject.log, other], what)


def several_joints(subject: MethodSubject) -> None:
    """A log of two joints is fitted as a whole by a method tagged multi-joint, and refused by any other."""
    arm = TwoJoints()
    log = arm.log(1)
    if "multi-joint" not in subject.entry.tags:
        _refuses(subject, [log], "a log of two joints")
        return
    fit = subject.fitted([log])
    time, motion, command = arm.unseen()
    if tuple(fit.model.joints) != log.joints:
        raise CheckFailed(f"the model of joints 1 and 2 speaks of joints {fit.model.joints}")
    answer = fit.model.inverse(time, motion, command)
    run = _simulated(fit.model, time[:SHORT], command[:SHORT])
    for what, found, size in (("inverse", answer, len(time)), ("simulation", run, SHORT)):
        if np.shape(found) != (size, 2):
            raise CheckFailed(f"shape of the {what}: {np.shape(found)}, expected {(size, 2)}")
    if not (np.all(np.isfinite(answer)) or np.all(np.isnan(answer))):
        raise CheckFailed("the inverse of two joints is not finite")


METHOD_CHECKS: tuple[Check[MethodSubject], ...] = tuple(
    Check(examine)
    for examine in (
        fits_the_example,
        shapes,
        units,
        covariance,
        recovery,
        inverse_and_simulation_agree,
        same_bits,
        refit,
        inputs_untouched,
        pickles,
        saves,
        row_key,
        order_of_logs,
        kinds_of_joints,
        honest_status,
        time_budget,
        no_logs,
        empty_log,
        short_log,
        still_log,
        wrong_joints,
        several_joints,
    )
)


def prepare_method(text: str, budget: float) -> Prepared:
    """What `adeptone check-method` checks. Raises RegistryError when there is no such method."""
    entry = find_method(text)
    method = build_method(entry)
    return Prepared(METHOD_CHECKS, MethodSubject(entry, budget), dict(method.expected_failures))


def _refuses(
    subject: MethodSubject, logs: Sequence[Log], what: str, unless: Callable[[Fit], bool] = lambda fit: False
) -> None:
    try:
        fit = subject.fitted(logs)
    except MethodError as error:
        if "\n" in str(error):
            raise CheckFailed(f"{what}: the error has more than one line: {one_line(error)}") from error
        return
    except Exception as error:
        raise CheckFailed(f"{what} ends in {one_line(error)}, not in a MethodError") from error
    if not unless(fit):
        raise CheckFailed(f"{what} is fitted without complaint ({fit.status.name})")


def _compare(subject: MethodSubject, one: Fit, other: Fit, what: str) -> None:
    """Raises CheckFailed unless both fits give the same bits."""
    for (name, first), (_, second) in zip(_answers(subject, one), _answers(subject, other), strict=True):
        if first.shape != second.shape:
            raise CheckFailed(f"{name} of {what} has shape {second.shape}, before {first.shape}")
        if not np.array_equal(first, second, equal_nan=True):
            raise CheckFailed(f"{name} of {what} differs by up to {float(np.nanmax(np.abs(first - second))):.3g}")


def _answers(subject: MethodSubject, fit: Fit) -> list[tuple[str, Array]]:
    time, motion, command = subject.joint.unseen()
    return [
        ("the estimate", fit.estimates.values),
        ("the covariance", fit.estimates.covariance),
        ("the residual", fit.residuals),
        ("the learning curve", fit.learning_curve),
        ("the inverse", fit.model.inverse(time, motion, command)),
        ("the simulation", _simulated(fit.model, time[:SHORT], command[:SHORT])),
    ]


def _simulated(model: Model, time: Array, command: Array) -> Array:
    return model.simulate(time, command, State.at_rest(np.zeros(command.shape[1])), "first_order").position


def _unseen_error(joint: LinearJoint | TwoJoints, model: Model) -> float:
    """Relative error on an unseen motion: of the inverse, or of the simulation where there is no inverse."""
    time, motion, command = joint.unseen()
    answer = model.inverse(time, motion, command)
    if np.all(np.isnan(answer)):
        found: Motion = model.simulate(time, command, motion.state(0), "first_order")
        error = _rms(found.position - motion.position) / float(np.std(motion.position))
    else:
        error = _rms(answer - command) / _rms(command)
    return error if math.isfinite(error) else math.inf


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _global_state() -> str:
    return repr(np.random.get_state())  # noqa: NPY002
