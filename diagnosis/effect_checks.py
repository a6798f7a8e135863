"""Conformance of effects: what an equation has to keep to take part in a diagnosis, checked one promise at a time.

Most checks call the effect's function or simulate one joint with it. The last one is an inverse crime: the log is made
with the equation that is then looked for, so it shows that the effect is consistent with itself and nothing more.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import get_args

import numpy as np

from diagnosis.engine import find
from diagnosis.estimation import Point, errors, undetermined
from diagnosis.finding import Finding
from diagnosis.hypotheses import Hypothesis, extend, sizes_of
from diagnosis.isolability import shapes
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem, stack
from diagnosis.settings import Settings
from envs.log import Array, JointFacts, Log
from methods.base import State
from methods.conformance.check import Check, CheckFailed, NotApplicable
from methods.conformance.isolated import Prepared
from methods.effects import STAGES, built_in, checked, from_file, vocabulary
from methods.effects.base import Dimension, Effect, Scales, Slot
from methods.kernel import NOMINAL, Kernel, build
from methods.registry import RegistryError, one_line
from methods.structured import StructuredJoint, StructuredModel

ARGUMENTS: dict[str, tuple[str, ...]] = {
    "command": ("u", "t", "q", "dq", "w", "p"),
    "gain": ("t", "q", "dq", "w", "p"),
    "torque": ("t", "q", "dq", "w", "x", "p"),
    "friction": ("t", "q", "dq", "w", "p"),
    "sensor": ("q", "p"),
}
"""Arguments of an effect's function by its slot."""
VARIABLES = (
    "position",
    "velocity",
    "acceleration",
    "direction",
    "command",
    "motor torque",
    "elapsed time",
    "position since reversal",
    "another joint",
)
"""Signals against which an effect can be plotted."""
GIVEN = frozenset(("math", "np"))
"""Names besides its arguments that an effect's function may use: the generated kernel has no others."""
COMMAND_POWER: dict[str, int] = {
    "command": 1,
    "torque": 1,
    "torque per position": 1,
    "torque per velocity": 1,
    "torque per velocity squared": 1,
    "inertia": 1,
    "1/command": -1,
    "1/command squared": -2,
    "1/voltage": -1,
    "1/power": -2,
}
"""Power of the command's unit in a dimension; 0 for all others."""
TIME_POWER: dict[str, int] = {
    "torque per velocity": 1,
    "torque per velocity squared": 2,
    "inertia": 2,
    "time": 1,
    "frequency": -1,
    "velocity": -1,
}
"""Power of the unit of time in a dimension; 0 for all others."""
RESULT_POWER: dict[str, int] = {"command": 1, "torque": 1, "friction": 1, "gain": 0, "sensor": 0}
"""Power of the command's unit in what a slot's function returns."""
SAMPLE_TIME, ENCODER_STEP = 2e-3, 1e-5
JOINT = {"inertia": 0.07, "viscous": 0.02, "back_emf": 0.7, "electrical_time_constant": 0.01}
STRUCTURE = JointStructure()
STRENGTH = 4.0
"""How much larger than its trial size an effect is in the log from which it has to be recovered."""
SLACK = 0.2
"""Largest relative error of a recovered parameter that is more than five standard errors off."""


@dataclass(frozen=True, eq=False)
class EffectSubject:
    """An effect under examination; `kernel` is compiled for it, alone or with all built-in ones."""

    effect: Effect
    kernel: Kernel

    @cached_property
    def known(self) -> dict[str, Effect]:
        """The built-in effects by name."""
        return {effect.name: effect for effect in built_in()}

    @cached_property
    def problem(self) -> Problem:
        """A log of the joint without the effect."""
        return stack(self.kernel, [recorded(self, None, 1)], (1,))

    @cached_property
    def sizes(self) -> Scales:
        """Typical magnitudes of that log."""
        return sizes_of(self.problem, fit_nominal(self.problem, (STRUCTURE,)))[0]

    @cached_property
    def values(self) -> tuple[float, ...]:
        """A typical parameter vector: a starting value in the middle. Raises NotApplicable when there is none."""
        if self.effect.on_the_arm:
            raise NotApplicable("it acts between the joints of a planar pair")
        every = list(self.effect.starts(self.sizes)) if self.effect.scan is None and self.effect.starts else []
        if not every and self.effect.scan is not None:
            every = shapes(self.effect, self.sizes)
        if not every:
            raise NotApplicable("it proposes no starting values for a single turning joint")
        middle = list(every[len(every) // 2])
        for a in self.effect.amplitudes:
            middle[a] = min(STRENGTH * middle[a], 0.6 * self.effect.parameters[a].upper)
        return tuple(float(value) for value in middle)

    def model(self, values: Sequence[float] | None) -> StructuredModel:
        """The joint with the effect at these parameters, or without it."""
        names = [parameter.name for parameter in self.effect.parameters]
        effects = {} if values is None else {self.effect.name: dict(zip(names, map(float, values), strict=True))}
        nominal = JOINT if values is None else JOINT | {"torque_square_mean": self.sizes.torque_rms**2}
        joint = StructuredJoint(1, "voltage", nominal, effects)
        return StructuredModel((joint,), SAMPLE_TIME, None, self.kernel.effects)

    def call(self, t: float, q: float, dq: float, w: float, u: float, x: Array, p: Array) -> float:
        """The effect's function as Python, whatever its slot."""
        assert self.effect.function is not None
        given = {"t": t, "q": q, "dq": dq, "w": w, "u": u, "x": x, "p": p}
        with np.errstate(all="ignore"):
            return float(self.effect.function(*(given[name] for name in ARGUMENTS[self.effect.slot])))


def recorded(subject: EffectSubject, values: Sequence[float] | None, seed: int, seconds: float = 8.0) -> Log:
    """A log of the joint under a held multisine from 0.3 to 12 Hz, rounded to the encoder's step."""
    time = SAMPLE_TIME * np.arange(round(seconds / SAMPLE_TIME), dtype=np.float64)
    hertz = np.arange(0.25, 12.0, 0.25)
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(hertz))
    waves = np.cos(2.0 * np.pi * np.outer(time, hertz) + phases).sum(axis=1)
    command = (1.5 * waves / np.sqrt(len(hertz)))[:, None]
    position = subject.model(values).simulate(time, command, State.at_rest(0.0)).position
    facts = JointFacts(encoder_step=ENCODER_STEP)
    return Log(time, command, ENCODER_STEP * np.round(position / ENCODER_STEP), facts=(facts,), name=f"log_{seed}")


def declaration(subject: EffectSubject) -> None:
    """Name, stage, slot, parameters and signal are words that the project knows."""
    effect = subject.effect
    names = [parameter.name for parameter in effect.parameters]
    wrong = [
        (re.fullmatch("[a-z][a-z0-9_]*", effect.name) is None, f"the name {effect.name!r} is not lower_case_words"),
        (effect.stage not in STAGES, f"there is no stage {effect.stage!r}; choose from {', '.join(STAGES)}"),
        (effect.slot not in get_args(Slot), f"there is no slot {effect.slot!r}; choose from {', '.join(ARGUMENTS)}"),
        (not names, "it has no parameter"),
        (len(set(names)) < len(names), f"two parameters share a name: {', '.join(names)}"),
        (effect.variable not in VARIABLES, f"no signal {effect.variable!r}; choose from {', '.join(VARIABLES)}"),
        (not effect.source.strip(), "it names no source"),
        (not all(0 <= a < len(names) for a in effect.amplitudes), f"amplitudes {effect.amplitudes} are no parameters"),
    ]
    for parameter in effect.parameters:
        known = parameter.dimension in get_args(Dimension)
        wrong.append((not known, f"{parameter.name} has the dimension {parameter.dimension!r}, which is unknown"))
        wrong.append(
            (not parameter.lower < parameter.upper, f"{parameter.name}: bounds {parameter.lower} .. {parameter.upper}")
        )
    for name in effect.includes:
        wrong.append((name not in subject.known, f"it includes {name!r}, which is no effect"))
    for bad, reason in wrong:
        if bad:
            raise CheckFailed(reason)


def law(subject: EffectSubject) -> None:
    """Its equation can be typeset in the report."""
    from diagnosis.figures import equation, report_style

    try:
        with report_style():
            equation(subject.effect.equation, "law")
    except ValueError as error:
        raise CheckFailed(f"{subject.effect.equation!r} is no mathtext: {one_line(error)[:160]}") from error


def function_of_its_slot(subject: EffectSubject) -> None:
    """Its function takes the slot's arguments and uses nothing but them, math and np."""
    effect = _with_function(subject)
    assert effect.function is not None
    found = tuple(inspect.signature(effect.function).parameters)
    if found != ARGUMENTS[effect.slot]:
        raise CheckFailed(
            f"it takes ({', '.join(found)}), slot {effect.slot} gives ({', '.join(ARGUMENTS[effect.slot])})"
        )
    try:
        text = inspect.getsource(effect.function)
    except OSError as error:
        raise CheckFailed("its source cannot be read: the kernel is generated from it") from error
    if not text.startswith("def "):
        raise CheckFailed("it is a lambda or nested in something. Write it as a function at the file's top level")
    variables = inspect.getclosurevars(effect.function)
    foreign = sorted((set(variables.globals) | set(variables.nonlocals) | set(variables.unbound)) - GIVEN)
    foreign = [name for name in foreign if name in effect.function.__code__.co_names]
    modules = {"math", "np"} & set(variables.globals)
    foreign = [name for name in foreign if not any(hasattr(variables.globals[module], name) for module in modules)]
    if foreign:
        raise CheckFailed(f"it uses {foreign[0]}, which the generated kernel does not have. Write the number out")


def compiles(subject: EffectSubject) -> None:
    """It compiles, and a joint with it can be simulated."""
    position = recorded(subject, subject.values, 1, 1.0).position
    if not np.all(np.isfinite(position)):
        raise CheckFailed(f"the simulation with the typical parameters {_shown(subject.values)} is not finite")


def neutral(subject: EffectSubject) -> None:
    """With its amplitudes at zero it changes nothing."""
    effect = subject.effect
    if not effect.amplitudes:
        raise NotApplicable("it declares no amplitude")
    values = list(subject.values)
    for a in effect.amplitudes:
        values[a] = 0.0
    without, zero = (recorded_exactly(subject, v) for v in (None, values))
    difference = float(np.max(np.abs(zero - without)) / np.ptp(without))
    if not difference <= 1e-9:
        raise CheckFailed(f"with zero amplitude the position changes by {difference:.2g} of its range")
    with_it = recorded_exactly(subject, subject.values)
    if np.array_equal(with_it, without):
        raise CheckFailed(f"with the typical parameters {_shown(subject.values)} it changes nothing either")


def linear_in_amplitudes(subject: EffectSubject) -> None:
    """Near zero its response is proportional to its amplitudes, as declared."""
    effect = subject.effect
    if not effect.amplitudes:
        raise NotApplicable("it declares no amplitude")
    if effect.slot == "friction":
        small, large = 0.25, 0.5  # at rest friction is not linear in anything; while sliding it is
    else:
        small, large = 1e-3, 2e-3
    nothing = recorded_exactly(subject, None)

    def response(share: float) -> Array:
        values = list(subject.values)
        for a in effect.amplitudes:
            values[a] *= share
        return recorded_exactly(subject, values) - nothing

    once, twice = response(small), response(large)
    size = float(np.linalg.norm(twice))
    left = float(np.linalg.norm(twice - 2.0 * once)) / max(size, 1e-300)
    if not (size > 0.0 and left <= 0.15):
        raise CheckFailed(f"twice the amplitude does not give twice the response: {100 * left:.3g} % are left")


def sensitivities_are_finite_differences(subject: EffectSubject) -> None:
    """The derivative by its parameters that a fit uses agrees with a finer finite difference."""
    effect, problem = subject.effect, subject.problem
    base = fit_nominal(problem, (STRUCTURE,)).point
    tile = np.tile(np.array(subject.values), (problem.logs, 1))
    point = extend(problem, _referenced(base, subject.sizes), Hypothesis(effect, 0), tile)
    centre = errors(problem, [point])[0]
    for i, free in enumerate(point.free):
        if not free.name.startswith(f"{effect.name}."):
            continue
        used, fine = 1e-3 * free.scale, 2e-4 * free.scale

        def moved(step: float, index: int = i) -> Array:
            vector = point.vector
            vector[index] += step
            return errors(problem, [point.at(vector)])[0]

        up = point.vector[i] + used <= free.upper
        coarse = (moved(used if up else -used) - centre) / (used if up else -used)
        central = (moved(fine) - moved(-fine)) / (2.0 * fine)
        size = float(np.linalg.norm(central))
        off = float(np.linalg.norm(coarse - central)) / max(size, 1e-300)
        if not np.isfinite(size) or (size > 0.0 and off > 0.3):
            raise CheckFailed(f"by {free.name.partition('.')[2]} the two differ by {100 * off:.3g} %")


def dimensions(subject: EffectSubject) -> None:
    """Its result scales with the units of command and time as the parameters' dimensions say."""
    effect = _with_function(subject)
    rng = np.random.default_rng(0)
    names = [parameter.dimension for parameter in effect.parameters]
    for what, powers, signal, own in (
        ("command", COMMAND_POWER, {"w": 1, "u": 1}, RESULT_POWER[effect.slot]),
        ("time", TIME_POWER, {"t": 1, "dq": -1}, 0),
    ):
        for _ in range(20):
            factor = float(rng.choice([0.5, 2.0, 3.0]))
            p = _random(subject, rng)
            drawn = {name: float(rng.normal()) for name in ("q", "dq", "w", "u")} | {"t": float(rng.uniform(0.0, 5.0))}
            x = rng.normal(size=3)
            lever = factor ** (np.array([0, 0, 1]) if what == "command" else np.array([-2, -1, 0]))
            scaled = {name: value * factor ** signal.get(name, 0) for name, value in drawn.items()}
            before = subject.call(**drawn, x=x, p=p)
            after = subject.call(
                **scaled, x=x * lever, p=p * np.array([factor ** powers.get(name, 0) for name in names])
            )
            if not np.isclose(after, before * factor**own, rtol=1e-9, atol=1e-12):
                raise CheckFailed(
                    f"in another unit of {what} the result goes from {before:.4g} to {after:.4g}, expected "
                    f"{before * factor**own:.4g}: a dimension is declared wrongly, or a number in it has a unit"
                )


def bounds(subject: EffectSubject) -> None:
    """Within its bounds its result is finite; a level of friction is not negative, a gain not either."""
    effect = _with_function(subject)
    rng = np.random.default_rng(1)
    for _ in range(400):
        p = _random(subject, rng)
        drawn = {name: float(rng.normal() * rng.choice([0.0, 1e-6, 1.0, 10.0])) for name in ("q", "dq", "w", "u")}
        result = subject.call(t=float(rng.uniform(0.0, 5.0)), **drawn, x=rng.normal(size=3), p=p)
        if not np.isfinite(result):
            raise CheckFailed(f"with the parameters {_shown(p)} at {_named(drawn)} the result is {result}")
        if effect.slot == "friction" and result < 0.0:
            raise CheckFailed(f"with the parameters {_shown(p)} at {_named(drawn)} the level is {result:.3g}")


def starting_values(subject: EffectSubject) -> None:
    """Its starting values are complete, finite and within its bounds, for turning and sliding joints and a pair."""
    effect = subject.effect
    if effect.scan is not None:
        names = tuple(parameter.name for parameter in effect.parameters)
        wanted = {"time": 3, "position": 3}.get(effect.scan)
        if effect.scan == "event" and effect.name not in subject.known:
            raise CheckFailed("a scan for events knows the built-in ones only. Choose another scan, or give starts")
        if wanted is not None and (effect.size != wanted or effect.amplitudes != (0, 1)):
            raise CheckFailed(
                f"a scan over {effect.scan} needs three parameters (sine, cosine, rate) and amplitudes (0, 1), it has "
                f"{', '.join(names)} and {effect.amplitudes}"
            )
        return
    if effect.starts is None:
        raise CheckFailed("it has neither starting values nor a scan: a diagnosis would never try it")
    sliding = Scales(300.0, 500.0, 200.0, 400.0, 0.3, 0.1, 0.4, 1.2, 95.0, 200.0, 25.0, 1e-3, 1e-6, False, 2)
    tried = 0
    for size in (subject.sizes, sliding, replace(subject.sizes, joints=2, coupled=True)):
        for values in effect.starts(size):
            tried += 1
            if len(values) != effect.size:
                raise CheckFailed(f"{len(values)} starting values for {effect.size} parameters")
            for parameter, value in zip(effect.parameters, values, strict=True):
                if not (np.isfinite(value) and parameter.lower <= value <= parameter.upper):
                    raise CheckFailed(
                        f"{parameter.name} starts at {value:.4g}, outside {parameter.lower:g} .. {parameter.upper:g}"
                    )
    if not tried:
        raise CheckFailed("it proposes no starting values: not for a turning joint, two sliding ones or a planar pair")


def dissipates(subject: EffectSubject) -> None:
    """A friction takes energy out: a coasting joint only slows down, and sooner than without it."""
    if subject.effect.slot != "friction":
        raise NotApplicable("its slot is not friction")
    time = SAMPLE_TIME * np.arange(300, dtype=np.float64)
    start = State(np.zeros(1), np.full(1, 2.0), np.zeros(1))
    speeds = []
    for values in (None, subject.values):
        motion = subject.model(values).simulate(time, np.zeros((len(time), 1)), start)
        speeds.append(np.abs(motion.velocity[:, 0]))
    if np.max(np.diff(speeds[1])) > 1e-9:
        raise CheckFailed("a coasting joint speeds up")
    if not speeds[1][-1] < speeds[0][-1]:
        raise CheckFailed("a coasting joint does not slow down sooner than without it")


def saves(subject: EffectSubject) -> None:
    """A model that holds it can be written and read back, and simulates as before."""
    model = subject.model(subject.values)
    copy = StructuredModel.from_json(model.to_json(), subject.kernel.effects)
    time, command = _command()
    first, second = (m.simulate(time, command, State.at_rest(0.0)).position for m in (model, copy))
    if not np.array_equal(first, second):
        raise CheckFailed(f"the simulation changes by up to {float(np.max(np.abs(first - second))):.3g} rad")


def recovers_itself(subject: EffectSubject) -> None:
    """The diagnosis finds it, with its parameters, in a log simulated with it (an inverse crime: consistency only)."""
    effect, values = subject.effect, subject.values
    problem = stack(subject.kernel, [recorded(subject, values, 1), recorded(subject, values, 2)], (1,))
    finding: Finding = find(problem, (STRUCTURE,), (effect,), Settings(limit=1))
    accepted = [item for item in finding.accepted if item.name == effect.name]
    if not accepted:
        raise CheckFailed(f"with the parameters {_shown(values)} it is not named (verdict {finding.verdict})")
    spread = np.sqrt(np.maximum(np.diag(finding.final.covariance + undetermined(finding.final)), 0.0))
    names = [free.name for free in finding.final.point.free]
    for parameter, true in zip(effect.parameters, values, strict=True):
        name = next(n for n in names if n.startswith(f"{effect.name}.{parameter.name}@"))
        i = names.index(name)
        off = abs(float(finding.final.point.vector[i]) - true)
        if off > max(SLACK * abs(true), 5.0 * float(spread[i])):
            raise CheckFailed(
                f"{parameter.name} comes out as {float(finding.final.point.vector[i]):.4g} ± {float(spread[i]):.2g}, "
                f"it was {true:.4g}"
            )


EFFECT_CHECKS: tuple[Check[EffectSubject], ...] = tuple(
    Check(examine)
    for examine in (
        declaration,
        law,
        function_of_its_slot,
        starting_values,
        bounds,
        dimensions,
        compiles,
        neutral,
        linear_in_amplitudes,
        sensitivities_are_finite_differences,
        dissipates,
        saves,
        recovers_itself,
    )
)


def find_effect(text: str) -> Effect:
    """The effect of a name (built in or of an installed package) or of a file. Raises RegistryError."""
    if Path(text).suffix == ".py" or Path(text).is_file():
        effect = from_file(Path(text))
        vocabulary([Path(text)])  # refuses a name that is taken
        return effect
    known = {effect.name: effect for effect in vocabulary()}
    if text not in known:
        raise RegistryError(
            f"there is no effect {text!r}; known are {', '.join(sorted(known))}. "
            "Give one of these or the path of a file that defines EFFECT"
        )
    return checked(known[text], text)


def prepare_effect(text: str, budget: float) -> Prepared:
    """What `adeptone check-effect` checks."""
    effect = find_effect(text)
    own = effect in built_in()
    return Prepared(
        EFFECT_CHECKS, EffectSubject(effect, build(built_in() if own else (effect,))), dict(effect.expected_failures)
    )


def recorded_exactly(subject: EffectSubject, values: Sequence[float] | None) -> Array:
    """Position (T,) of four seconds of simulation, not rounded."""
    time, command = _command()
    return subject.model(values).simulate(time, command, State.at_rest(0.0)).position[:, 0]


def _command() -> tuple[Array, Array]:
    time = SAMPLE_TIME * np.arange(2000, dtype=np.float64)
    return time, (1.5 * np.sin(2.0 * np.pi * 1.3 * time) + np.sin(2.0 * np.pi * 4.1 * time))[:, None]


def _referenced(point: Point, size: Scales) -> Point:
    """The point with the mean square motor torque filled in, by which thermal effects are normalised."""
    parameters = point.parameters.copy()
    parameters[:, :, NOMINAL.index("torque_square_mean")] = size.torque_rms**2
    return replace(point, parameters=parameters)


def _with_function(subject: EffectSubject) -> Effect:
    if subject.effect.slot == "structure":
        raise NotApplicable("it is built into the kernel")
    return subject.effect


def _random(subject: EffectSubject, rng: np.random.Generator) -> Array:
    """Parameters within the bounds, some on a bound, over several powers of ten."""
    drawn = []
    for parameter in subject.effect.parameters:
        value = float(rng.normal() * 10.0 ** rng.uniform(-3.0, 1.0))
        if np.isfinite(parameter.lower) and np.isfinite(parameter.upper):
            value = float(rng.uniform(parameter.lower, parameter.upper))
        elif np.isfinite(parameter.lower):
            value = parameter.lower + abs(value) * (0.0 if rng.uniform() < 0.1 and parameter.lower > 0.0 else 1.0)
        elif np.isfinite(parameter.upper):
            value = parameter.upper - abs(value)
        drawn.append(value)
    return np.array(drawn)


def _shown(values: Sequence[float] | Array) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def _named(values: dict[str, float]) -> str:
    return ", ".join(f"{name} = {value:.3g}" for name, value in values.items())
