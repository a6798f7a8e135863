"""From fitted model parameters to the canonical ones of the vocabulary, with honest standard deviations and units.

The models are written in what can be fitted well: sine and cosine, compliance, torque in units of the command. People
read amplitude and phase, stiffness, newton metres. The change of variables carries the covariance along to first
order (delta method). The covariance is the larger, per parameter, of the inverse information and of the sandwich
(W. Newey, K. West, Econometrica 55 (1987) 703), which also holds where the innovations are not entirely white. To its
root what no covariance knows is added: that integrators, rounded laws and clocks differ.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.signal import lfilter

from diagnosis.estimation import Fitted, Point, predicted_motion
from diagnosis.finding import Accepted
from diagnosis.problem import Problem
from diagnosis.result import Estimate, NominalParameter, ParameterEstimate
from envs.log import COMMAND_UNIT, Array, InputKind
from envs.robot import Joint as RobotJoint
from methods.effects.base import Dimension, Effect
from methods.kernel import DAMPING, NOMINAL

INEXACT = 2e-4
"""Least standard deviation of a parameter as a share of it: what integrators, rounded laws and clocks may differ by."""
INSTANTS = ("time", "phase")
"""Parameters whose zero is arbitrary."""
STEADY = "thermal_drift_steady"
"""The form of a thermal drift that no current drives."""
Values = Mapping[str, float]
REFERENCE, LAG, BACK_EMF = (
    NOMINAL.index(name) for name in ("torque_square_mean", "electrical_time_constant", "back_emf")
)
LONGEST = 2.0
"""Steps over a winding's time constant beyond which the simulation takes the winding for a delay."""
INERTIA, HEAT = "joint inertia", "mean square motor torque"
"""Names under which a change of variables finds, besides the effect's parameters, the joint's own inertia and the mean
square of its motor torque in the final model, over the one that the effect's parameters refer to."""


@dataclass(frozen=True)
class JointUnits:
    """Units of one joint's command and motion, and the constants of its drive where they are known.

    per_torque: command units per N m (or N); per_current: motor torque in command units per ampere. None: unknown.
    """

    input: InputKind
    position: str
    per_torque: float | None = None
    per_current: float | None = None

    @property
    def command(self) -> str:
        """Unit of the command; a torque command of a linear joint is a force."""
        return self.torque if self.input == "torque" else COMMAND_UNIT[self.input]

    @property
    def torque(self) -> str:
        return "N" if self.position == "m" else "N m"


def joint_units(kind: InputKind, position: str, joint: RobotJoint | None) -> JointUnits:
    """Units of a joint, with the drive's constants when the robot is known."""
    if joint is None:
        return JointUnits(kind, position, 1.0 if kind == "torque" else None)
    drive, current = joint.drive, None
    if drive.amplifier == "voltage":
        current = drive.resistance.value / drive.amplifier_gain.value
    elif drive.amplifier == "current":
        current = 1.0 / drive.amplifier_gain.value
    return JointUnits(kind, position, drive.input_equivalent, current)


@dataclass(frozen=True)
class Canonical:
    """One effect's change of variables: canonical name -> dimension, and the function of the model's parameters."""

    dimensions: Mapping[str, Dimension | str]
    change: Callable[[Values], Values]


def _wave(amplitude: str, dimension: Dimension, *others: tuple[str, Dimension]) -> Canonical:
    """sine sin(x) + cosine cos(x) = amplitude sin(x + phase)."""

    def change(p: Values) -> Values:
        kept = {name: p[name] for name, _ in others}
        return {amplitude: math.hypot(p["sine"], p["cosine"]), **kept, "phase": math.atan2(p["cosine"], p["sine"])}

    return Canonical({amplitude: dimension, **dict(others), "phase": "angle"}, change)


def _stiffness(p: Values) -> float:
    """J r w^2 of a load that is a share r of the inertia J, w its angular frequency while the motor stands still."""
    return p[INERTIA] * p["inertia_ratio"] * (2.0 * math.pi * p["frequency"]) ** 2


def _damping(p: Values) -> float:
    """Of a spring with the stiffness of `_stiffness`."""
    return 2.0 * p["damping_ratio"] * _stiffness(p) / (2.0 * math.pi * p["frequency"])


def _rise(p: Values) -> float:
    """Rise of the resistance that is reached in the end at the mean square current of these logs.

    The model's rise r is that at another one; a share s of the losses grows with the resistance:
    ``rise = h r / (1 + s r - h s r)`` at h times the losses.
    """
    r, share = p["resistance_rise"], p.get("feedback", 0.0)
    return p[HEAT] * r / (1.0 + share * r * (1.0 - p[HEAT]))


_SPRING = Canonical(
    {"stiffness": "torque per position", "damping": "torque per velocity", "inertia_ratio": "ratio"},
    lambda p: {"stiffness": _stiffness(p), "damping": _damping(p), "inertia_ratio": p["inertia_ratio"]},
)
_STIFFENING = Canonical(
    {**_SPRING.dimensions, "stiffening": "1/position squared"},
    lambda p: {**_SPRING.change(p), "stiffening": p["stiffening"] * _stiffness(p) ** 2},
)
_CABLE = Canonical(
    {"stiffness": "torque per position", "rest_angle": "position"},
    lambda p: {"stiffness": p["stiffness"], "rest_angle": p["pull"] / max(p["stiffness"], 1e-30)},
)
_BRISTLES = Canonical(
    {"torque": "torque", "stiffness": "torque per position", "damping": "torque per velocity"},
    lambda p: {
        "torque": p["torque"],
        "stiffness": p["torque"] / p["deflection"],
        "damping": p["torque"] / p["deflection"] * p["damping_time"],
    },
)
CANONICAL: dict[str, Canonical] = {
    "thermal_drift": Canonical(
        {"resistance_rise": "ratio", "time_constant": "time"},
        lambda p: {"resistance_rise": _rise(p), "time_constant": p["time_constant"]},
    ),
    "cogging_torque": _wave("amplitude", "torque", ("cycles_per_rev", "cycles per revolution")),
    "torque_ripple": _wave("share", "ratio", ("cycles_per_rev", "cycles per revolution")),
    "gravity_tilt": _wave("torque", "torque"),
    "periodic_disturbance": _wave("torque", "torque", ("frequency", "frequency")),
    "encoder_eccentricity": _wave("amplitude", "position"),
    "joint_flexibility": _SPRING,
    "joint_flexibility_stiffening": _STIFFENING,
    "joint_flexibility_stiffening_load_side": _STIFFENING,
    "backlash": Canonical(
        {
            "gap": "position",
            "inertia_ratio": "ratio",
            "contact_stiffness": "torque per position",
            "contact_damping": "torque per velocity",
        },
        lambda p: {
            "gap": p["gap"],
            "inertia_ratio": p["inertia_ratio"],
            "contact_stiffness": _stiffness(p),
            "contact_damping": _damping(p),
        },
    ),
    "presliding_friction": _BRISTLES,
    "presliding_friction_stribeck": Canonical(
        {**_BRISTLES.dimensions, "static_torque": "torque", "velocity": "velocity"},
        lambda p: {
            **_BRISTLES.change(p),
            "static_torque": p["torque"] * (1.0 + p["rise"]),
            "velocity": p["velocity"],
        },
    ),
    "stribeck_friction": Canonical(
        {"torque": "torque", "static_torque": "torque", "velocity": "velocity"},
        lambda p: {"torque": p["torque"], "static_torque": p["torque"] + p["excess"], "velocity": p["velocity"]},
    ),
    "cable_spring": _CABLE,
    "cable_spring_stiffening": Canonical(
        {**_CABLE.dimensions, "stiffening": "1/position squared"},
        lambda p: {**_CABLE.change(p), "stiffening": p["stiffening"]},
    ),
}
"""Effects (or single forms of them) whose canonical parameters are not those of the model; all others keep theirs."""


SHAPES = ("rounding", "exponent", "fall_exponent", "feedback", "tail", "weight_sine", "weight_cosine")
"""Parameters that shape a law, beside its canonical ones."""


def canonical(effect: Effect) -> Canonical:
    """The change of variables of an effect; the identity unless `CANONICAL` holds another."""
    own = Canonical({p.name: p.dimension for p in effect.parameters}, lambda p: p)
    found = CANONICAL.get(effect.name, CANONICAL.get(effect.label, own))
    further = {p.name: p.dimension for p in effect.parameters if p.name in SHAPES and p.name not in found.dimensions}
    if not further:
        return found
    return Canonical(
        {**found.dimensions, **further}, lambda p: {**found.change(p), **{name: p[name] for name in further}}
    )


def units(dimension: str, joint: JointUnits) -> tuple[str, str, float | None]:
    """(physical unit, input-equivalent unit, physical per input-equivalent); None when the drive is not known."""
    u, x = joint.command, joint.position
    torque = None if joint.per_torque is None else 1.0 / joint.per_torque
    current = joint.per_current
    mass = "kg" if x == "m" else "kg m^2"
    table: dict[str, tuple[str, str, float | None]] = {
        "command": (u, u, 1.0),
        "torque": (joint.torque, u, torque),
        "torque per position": (f"{joint.torque}/{x}", f"{u}/{x}", torque),
        "torque per velocity": (f"{joint.torque} s/{x}", f"{u} s/{x}", torque),
        "torque per velocity squared": (f"{joint.torque} s^2/{x}^2", f"{u} s^2/{x}^2", torque),
        "inertia": (mass, f"{u} s^2/{x}", torque),
        "1/command": ("1/A", f"1/{u}", current),
        "1/command squared": ("1/A^2", f"1/{u}^2", None if current is None else current**2),
        "1/voltage": (f"1/{u}", f"1/{u}", 1.0),
        "1/power": (f"1/({u} A)", f"1/{u}^2", current),
        "1/position squared": (f"1/{x}^2",) * 2 + (1.0,),
        "time": ("s", "s", 1.0),
        "frequency": ("Hz", "Hz", 1.0),
        "position": (x, x, 1.0),
        "velocity": (f"{x}/s", f"{x}/s", 1.0),
        "cycles per revolution": ("1/rev" if x == "rad" else "rad/m",) * 2 + (1.0,),
        "angle": ("rad", "rad", 1.0),
        "ratio": ("1", "1", 1.0),
    }
    physical, own, factor = table[dimension]
    return (own, own, None) if factor is None else (physical, own, factor)


def effect_parameters(
    problem: Problem, fitted: Fitted, spread: Array, item: Accepted, joint: JointUnits
) -> tuple[ParameterEstimate, ...]:
    """Canonical parameters of one accepted effect at the final fit; `spread` is the `covariance` of that fit."""
    effect, j = item.scored.start.hypothesis.effect, item.joint
    names = [f.name for f in fitted.point.free]
    vector = fitted.point.vector
    log = item.scored.start.hypothesis.log
    columns: dict[str, list[int]] = {}
    for parameter in effect.parameters:
        plain = f"{effect.name}.{parameter.name}@{j}"
        columns[parameter.name] = [i for i, n in enumerate(names) if n == plain or n.startswith(f"{plain}#")]
    own = canonical(effect)
    inertia = names.index(f"inertia@{j}")
    driven = effect.label == "thermal_drift" and effect.name != STEADY
    beside = {HEAT: heat(problem, fitted.point, j) if driven else 1.0}

    def values(x: Array) -> Array:
        """Canonical values; of what is free in every log the rms of all with the sign of their sum, of instants and
        phases that of the first."""
        each = [
            own.change(
                {**beside, INERTIA: float(x[inertia])}
                | {name: float(x[c[min(k, len(c) - 1)]]) for name, c in columns.items()}
            )
            for k in range(max(len(c) for c in columns.values()))
        ]
        first = np.array([each[0][name] for name in own.dimensions])
        for i, name in enumerate(own.dimensions):
            if len(each) > 1 and name not in INSTANTS:
                size = math.sqrt(sum(e[name] ** 2 for e in each) / len(each))
                first[i] = math.copysign(size, sum(e[name] for e in each))
        return first

    centre = values(vector)
    slopes = np.zeros((len(centre), len(vector)))
    for i in sorted({inertia, *(i for c in columns.values() for i in c)}):
        step = np.zeros(len(vector))
        step[i] = 1e-4 * max(abs(vector[i]), 1e-3 * fitted.point.free[i].scale, 1e-12)
        change = values(vector + step) - values(vector - step)
        change = np.where(np.array(list(own.dimensions)) == "phase", (change + np.pi) % (2 * np.pi) - np.pi, change)
        slopes[:, i] = change / (2 * step[i])
    least = np.array(
        [0.0 if name in INSTANTS else INEXACT * value for name, value in zip(own.dimensions, centre, strict=True)]
    )
    deviations = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, spread, slopes), 0.0) + least**2)
    begin = float(problem.time[problem.bounds[max(log, *item.scored.start.hypothesis.apart[:1], 0)]])
    found = []
    for (name, dimension), value, std in zip(own.dimensions.items(), centre, deviations, strict=True):
        value = _on_the_logs_clock(effect, name, float(value), begin, dict(zip(own.dimensions, centre, strict=True)))
        physical, equivalent, factor = units(str(dimension), joint)
        factor = 1.0 if factor is None else factor
        found.append(
            ParameterEstimate(
                name, Estimate(value * factor, float(std) * factor, physical), Estimate(value, float(std), equivalent)
            )
        )
    return tuple(found)


def heat(problem: Problem, point: Point, j: int) -> float:
    """Mean square motor torque of joint index j in a model, over the one that its thermal parameters refer to.

    Between samples the torque behind a winding of time constant T goes on as ``b + g t + d e^(-t/T)``, whose square is
    averaged over the interval: at the samples alone a switching command has just settled. It goes towards what the
    command leaves above the back-EMF, whose slope is g as the joint gains speed, and by how much it comes closer there
    is told by the factor of the simulation's own Runge-Kutta steps, which is not quite that of the exponential.
    """
    row, motion = point.parameters[0, j], predicted_motion(problem, point)[:, j]
    logs = [motion[a:b] for a, b in pairwise(problem.bounds)]
    if row[LAG] <= 0.0:
        return float(np.mean(np.concatenate([log[:-1, 2] for log in logs]) ** 2) / row[REFERENCE])
    total = 0.0
    for begin, log in zip(problem.bounds, logs, strict=False):
        interval = float(problem.time[begin + 1] - problem.time[begin])
        n = interval / row[LAG]
        left, told = math.exp(-n), _simulated(problem, point, j, interval)
        speed, torque = log[:, 1], log[:, 2]
        gain = -row[BACK_EMF] * np.diff(speed)  # of what it goes towards, over the interval
        b, share = (torque[1:] - gain - told * torque[:-1]) / (1.0 - told), (1.0 - left) / n
        ends, _ = lfilter([1.0], [1.0, -left], (1.0 - left) * b + gain, zi=[left * torque[0]])
        d = np.concatenate([torque[:1], ends[:-1]]) - b
        slow = b**2 + b * gain + gain**2 / 3.0
        total += np.sum(slow + d**2 * share * 0.5 * (1.0 + left) + 2.0 * d * (b * share + gain * (share - left) / n))
    return float(total / sum(len(log) - 1 for log in logs) / row[REFERENCE])


def _simulated(problem: Problem, point: Point, j: int, interval: float) -> float:
    """What the simulation leaves after an interval of what the torque behind a winding was away from where it goes."""
    row = point.parameters[0, j]
    steps = problem.kernel.steps(row[None], point.switches[None, j], interval, problem.substeps)
    x = interval / steps / row[LAG]
    return math.exp(-interval / row[LAG]) if x > LONGEST else (1 - x + x**2 / 2 - x**3 / 6 + x**4 / 24) ** steps


def _on_the_logs_clock(effect: Effect, name: str, value: float, begin: float, others: Values) -> float:
    """Instants and phases count from the log's own zero of time; the models count from its first sample."""
    if effect.scan == "event" and name == "time":
        return value + begin
    if effect.scan == "time" and name == "phase":
        shifted = value - 2 * math.pi * others["frequency"] * begin
        return (shifted + math.pi) % (2 * math.pi) - math.pi
    return value


NOMINAL_DIMENSIONS: dict[str, Dimension] = {
    "inertia": "inertia",
    **dict.fromkeys(DAMPING, "torque per velocity"),
    "electrical_time_constant": "time",
    "gravity_sine": "torque",
    "gravity_cosine": "torque",
    "load": "torque",
    "arm_friction": "ratio",
}


PARTS: dict[str, tuple[str, ...]] = {
    "inertia": ("inertia",),
    "damping": DAMPING,
    **{name: (name,) for name in NOMINAL[3:7]},
    "arm_damping": ("arm_viscous",),
    "arm_friction_share": ("arm_friction",),
}
"""Nominal parameters as they are reported; command and angle determine the damping as a whole."""
COUPLING = {"shared_inertia": 2, "coupling_inertia": 0}
"""What couples a planar pair, with its place in `Point.rigid`, in units of the first joint."""
RATIO = 1
"""Place there of the units per torque of the second joint over those of the first."""


def nominal_parameters(
    nominal: Fitted, final: Fitted, spreads: tuple[Array, Array], j: int, joint: JointUnits, given: Mapping[str, float]
) -> tuple[NominalParameter, ...]:
    """Nominal parameters of joint index j before and after the effects, input-equivalent; damping is one number, and
    beside it, where there is a spring or a play, what of it acts behind that, and what share of friction laws."""
    found = []
    for title, parts in PARTS.items():
        before, after = (_estimate(f, s, parts, j, joint) for f, s in zip((nominal, final), spreads, strict=True))
        if before is None and after is None:
            continue
        none = Estimate(0.0, 0.0, units(NOMINAL_DIMENSIONS[parts[0]], joint)[1])
        found.append(NominalParameter(title, none.unit, given.get(title), before or none, after or none))
    unit = units(NOMINAL_DIMENSIONS["inertia"], joint)[1]
    if any(f.kind == "rigid" for f in final.point.free):
        for title, column in COUPLING.items():
            before, after = (_coupling(f, s, column, j, unit) for f, s in zip((nominal, final), spreads, strict=True))
            found.append(NominalParameter(title, unit, None, before, after))
    return tuple(found)


def _coupling(fitted: Fitted, spread: Array, column: int, j: int, unit: str) -> Estimate:
    """An inertia of the arm in units of joint index j of a pair, whose ratio to those of the first one is known no
    better than it is."""
    ratio = float(fitted.point.rigid[RATIO]) if j else 1.0
    value = float(fitted.point.rigid[column]) * ratio
    slope = np.zeros(len(fitted.point.free))
    for i, f in enumerate(fitted.point.free):
        if f.kind == "rigid" and f.column == column:
            slope[i] = ratio
        elif f.kind == "rigid" and f.column == RATIO and j:
            slope[i] = value / ratio
    variance = max(float(slope @ spread @ slope), 0.0) + (INEXACT * value) ** 2
    return Estimate(value, float(np.sqrt(variance)), unit)


def _estimate(fitted: Fitted, spread: Array, parts: tuple[str, ...], j: int, joint: JointUnits) -> Estimate | None:
    """Sum of nominal parameters, some of which are free."""
    names = [f.name for f in fitted.point.free]
    own = [names.index(f"{name}@{j}") for name in parts if f"{name}@{j}" in names]
    if not own:
        return None
    value = float(sum(fitted.point.parameters[0, j, NOMINAL.index(name)] for name in parts))
    variance = max(float(np.sum(spread[np.ix_(own, own)])), 0.0) + (INEXACT * value) ** 2
    return Estimate(value, float(np.sqrt(variance)), units(NOMINAL_DIMENSIONS[parts[0]], joint)[1])
