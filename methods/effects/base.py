"""What an effect is: a standard name, its place in the signal chain, parameters, and one equation.

All torques in the models are *input-equivalent*, i.e. expressed in the unit of the command
(``torque * R / (alpha * gain)`` for a voltage drive), because command and angle alone determine no more.

An effect's equation is one scalar function compiled by numba. Its slot says where it acts:

========== ==================================================== =======================================
slot       signature                                            meaning of the result
========== ==================================================== =======================================
command    f(u, t, q, dq, w, p)                                 the command after this effect [command unit]
gain       f(t, q, dq, w, p)                                    factor on the motor torque [1]
torque     f(t, q, dq, w, x, p)                                 torque that resists the motion [command unit]
friction   f(t, q, dq, w, p)                                    level of dry friction, >= 0 [command unit]
sensor     f(q, p)                                              reading minus angle [rad or m]
structure  (none)                                               built into the kernel: extra states, time shifts
========== ==================================================== =======================================

``t`` [s], ``q`` [rad or m], ``dq`` [rad/s or m/s], ``w`` motor torque [command unit], for torques and friction that
after the effects on its gain, ``p`` the parameters of the effect in the order of the declaration, ``x`` =
(acceleration, velocity, command) of the neighbouring joint as measured; of a planar pair, whose joints are simulated
together, (0, velocity, motor torque) of the other one.
"""

from __future__ import annotations

import dis
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Literal

from envs.log import InputKind

Stage = Literal["amplifier", "motor", "transmission", "arm", "sensor"]
Slot = Literal["command", "gain", "torque", "friction", "sensor", "structure"]
Dimension = Literal[
    "command",  # [unit of the command]
    "torque",  # [N m or N], input-equivalent inside the models
    "torque per position",
    "torque per velocity",
    "torque per velocity squared",
    "inertia",
    "1/command",
    "1/command squared",
    "1/voltage",  # of the command itself, not of the torque that it makes
    "1/power",  # of command times motor torque
    "1/position squared",
    "time",
    "frequency",
    "position",
    "velocity",
    "cycles per revolution",
    "angle",
    "ratio",
]


@dataclass(frozen=True)
class EffectParameter:
    """One parameter: canonical name, dimension, bounds in model units, and what the number means.

    stands_in_at: the ends of a shape's range that no such law has, so that it stands in for another one there.
    """

    name: str
    dimension: Dimension
    meaning: str
    lower: float = -float("inf")
    upper: float = float("inf")
    stands_in_at: Literal["", "lower", "upper", "both"] = ""


@dataclass(frozen=True)
class Scales:
    """Typical magnitudes of the logs at hand, from which an effect proposes starting values.

    Everything is measured on the logs (nothing is tuned to a machine): command rms and peak, motor torque rms and peak
    [command unit]; position span, velocity rms and peak; nominal inertia and rate constants; duration and sample time.
    joints: 2 where the logs tell of another one; coupled: whether both are simulated together as a planar pair.
    acceleration_rms: less than what the motor torque gives the inertia where others (a weight, an arm) take part of it.
    """

    command_rms: float
    command_peak: float
    torque_rms: float
    torque_peak: float
    position_span: float
    position_mean: float
    velocity_rms: float
    velocity_peak: float
    inertia: float
    damping: float
    duration: float
    sample_time: float
    encoder_step: float
    revolute: bool = True
    joints: int = 1
    coupled: bool = False
    acceleration_rms: float = math.inf


MOTOR_TORQUE = {"command": 4, "torque": 3, "friction": 3}
"""Place of the motor torque among the arguments of a slot's function."""
TIME = {"command": 1, "gain": 0, "torque": 0, "friction": 0}
"""Place of the time."""
NEIGHBOUR = 4
"""Place of the neighbouring joint among the arguments of a torque."""
Starts = Callable[[Scales], Iterable[tuple[float, ...]]]


@dataclass(frozen=True)
class Effect:
    """One physical effect as an equation of the models.

    amplitudes: indices of the parameters in which the effect is linear near zero; with all of them zero it vanishes.
    starts: proposes full parameter vectors; amplitudes in them are trial sizes, rescaled by regression before use.
    scan: how candidate shapes that no short grid can cover are found: ``time`` (frequency of a disturbance),
        ``position`` (cycles per revolution), ``event`` (instants), or None.
    ringing: proposes full parameter vectors with which the joint rings at a frequency [Hz] that stands out of the
        errors: a mode with little damping is found from close by only.
    across: once it is fitted, further full parameter vectors from which it is begun again: where a law has a ridge, a
        fit on one side of it does not find what lies on the other.
    variable: the signal against which the effect shows itself in a plot.
    includes: names of effects that this one contains as a special case. exchanges: nominal parameter that can stand in
        for the first parameter, or nothing. replaces: nominal parameter that has no meaning beside this effect.
    resolved: whether parameters (size,) describe something that logs of these scales can show at all, where that has to
        be asked: a deflection far below the encoder's step is an integrator's, not a spring's.
    tries: starting values, each of another shape, from which it is fitted before it is compared with others.
    excludes: names of effects that cannot be in the same joint.
    beside: standard names of effects of which this one is a property: beside one of them whose first parameter is at
        least as large, no log tells it from what it includes.
    neutral: for a more general form of an included law, the values of its further parameters with which both are the
        same.
    undecided: of a more general form that is as plausible as the included law, mean and standard deviation of each of
        its further parameters before any log is seen: where logs do not tell the two apart, both are in the deviations.
    drives: whether the motor torque enters its law, which a function of its own shows by itself.
    scatters: whether small causes grow in it, as in impacts, so that what noise leaves depends on the motion.
    turns: whether its law is the same again a turn of 2 pi further.
    on_the_arm: of a law of the second joint of a planar pair alone, which acts on the first one, too: whether by
        their ``coupling`` or, in an arm that gravity pulls, also by its ``weight``.
    of_the_link: its equation for the second link of a planar pair, where it turns with both joints and acts on both.
    inputs: kinds of command (`envs.log.InputKind`) that leave room for it: a drive that controls current or torque
        makes up for a sagging supply.
    remembers: whether it has a state that outlasts the motion of a few seconds, which a log does not show.
    kind, after: an effect that may occur several times has further instances with names of their own (`instances`);
        `kind` is the name they share, `after` the instances one of which has to be there first; so may a form of a law.
    expected_failures: conformance checks (`diagnosis.effect_checks`) that it fails by its nature, each with the reason.
    """

    name: str
    stage: Stage
    slot: Slot
    parameters: tuple[EffectParameter, ...]
    equation: str
    variable: str
    source: str
    amplitudes: tuple[int, ...] = (0,)
    starts: Starts | None = None
    function: Callable | None = None
    scan: Literal["time", "position", "event"] | None = None
    ringing: Callable[[float], Sequence[tuple[float, ...]]] | None = None
    across: Callable[[Sequence[float]], Sequence[tuple[float, ...]]] | None = None
    includes: tuple[str, ...] = ()
    neutral: tuple[float, ...] = ()
    undecided: tuple[tuple[float, float], ...] = ()
    exchanges: str = ""
    replaces: str = ""
    resolved: Callable[[Sequence[float], Scales], bool] | None = None
    tries: int = 1
    drives: bool = False
    scatters: bool = False
    turns: bool = False
    on_the_arm: Literal["", "coupling", "weight"] = ""
    of_the_link: str = ""
    inputs: tuple[InputKind, ...] = ("voltage", "current", "torque")
    remembers: bool = False
    excludes: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    kind: str = ""
    expected_failures: tuple[tuple[str, str], ...] = ()

    @property
    def label(self) -> str:
        """The standard name, whichever instance it is."""
        return self.kind or self.name

    @property
    def size(self) -> int:
        return len(self.parameters)

    @property
    def shapes(self) -> tuple[int, ...]:
        """Indices of the parameters that are no amplitudes."""
        return tuple(i for i in range(self.size) if i not in self.amplitudes)

    @property
    def parts_the_arm(self) -> bool:
        """Whether it puts a spring or a play between motor and arm, with a share of the inertia behind it."""
        return any(parameter.name == "inertia_ratio" for parameter in self.parameters)

    @property
    def has_motor_torque(self) -> bool:
        """Whether the motor torque enters its law: mechanical damping and back-EMF then act differently."""
        return self.drives or self.slot == "gain" or self._reads(MOTOR_TORQUE.get(self.slot))

    @property
    def is_dry(self) -> bool:
        """Whether it is dry friction, or contains it."""
        return "coulomb_friction" in (self.label, *self.includes)

    @property
    def has_time(self) -> bool:
        """Whether time enters its law."""
        return self.scan in ("time", "event") or self._reads(TIME.get(self.slot))

    @property
    def is_linear_in_place(self) -> bool:
        """Whether its torque is linear in all of its parameters and depends on where its own joint is."""
        whole = self.slot == "torque" and self.variable == "position" and len(self.amplitudes) == self.size
        others = (TIME["torque"], MOTOR_TORQUE["torque"], NEIGHBOUR)
        return whole and self.scan is None and not any(map(self._reads, others))

    @property
    def has_neighbour(self) -> bool:
        """Whether the motion or the command of the neighbouring joint enters its law."""
        return self.slot == "torque" and self._reads(NEIGHBOUR)

    def _reads(self, place: int | None) -> bool:
        """Whether its function reads the argument at a place."""
        if self.function is None or place is None:
            return False
        name = self.function.__code__.co_varnames[place]
        used = (i.argval for i in dis.get_instructions(self.function) if i.opname.startswith("LOAD_FAST"))
        return any(name == u or (isinstance(u, tuple) and name in u) for u in used)


def exclusive(forms: Sequence[Effect]) -> tuple[Effect, ...]:
    """Forms of one law, each excluding the others, save those that contain it or are contained in it."""

    def excluded(form: Effect) -> tuple[str, ...]:
        apart = (f for f in forms if f is not form and f.name not in form.includes and form.name not in f.includes)
        return tuple(f.name for f in apart)

    return tuple(replace(form, excludes=excluded(form)) for form in forms)


def instances(effect: Effect, count: int) -> tuple[Effect, ...]:
    """An effect that may occur up to `count` times, as effects of their own."""
    names = [effect.name, *(f"{effect.name}_{number}" for number in range(2, count + 1))]
    further = (replace(effect, name=name, after=(before,), kind=effect.name) for before, name in pairwise(names))
    return (effect, *further)


def is_periodic(cycles: float, scales: Scales) -> bool:
    """Whether the logs span half a period of something with so many cycles per revolution: a shorter piece of it is a
    spring's."""
    return cycles * scales.position_span > math.pi


def is_readable(way: float, scales: Scales) -> bool:
    """Whether readings can show so short a way [rad or m], by the encoder's step and the way between two of them."""
    return way > max(0.3 * scales.encoder_step, 1e-3 * scales.velocity_rms * scales.sample_time)


def geometric(first: float, last: float, ratio: float) -> list[float]:
    """Values from first to last, neighbours at most a factor `ratio` apart; the first alone where last is below it."""
    if not last > first:
        return [first]
    count = 2 + int(math.log(last / first) / math.log(ratio))
    return [first * (last / first) ** (i / (count - 1)) for i in range(count)]


def grid(*axes: Iterable[float]) -> list[tuple[float, ...]]:
    """Cartesian product of starting values, one axis per parameter."""
    return list(product(*axes))
