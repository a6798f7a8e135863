"""What can be hidden in a joint: every effect of the vocabulary under its shared name, and foreign effects outside it.

Magnitudes are drawn log-uniformly relative to what the machine does in the planned experiments (`Scales`), so that
"mild" and "strong" mean the same for a wrist and for a shoulder. Where several laws have the same physical meaning one
is drawn at random; the truth records which.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, TypeVar

import numpy as np

from benchmarks.blind.machines import Machine, Rng, input_equivalent, log_uniform, total_inertia
from benchmarks.blind.world import (
    Array,
    Bristle,
    Coupling,
    DeadZone,
    Drive,
    Grasp,
    Heat,
    Joint,
    Limit,
    Pulse,
    Sag,
    Shaft,
    Side,
    Stribeck,
    TorqueLaw,
)

L = TypeVar("L", bound=IntEnum)


@dataclass(frozen=True)
class Scales:
    """What the clean joint does over the training experiments: rms and peak of command, torque, speed, current; range.

    `floor` is the sensor's rms noise [rad or m]; `other_*` belong to the second joint of a pair.
    """

    command: float
    command_peak: float
    torque: float
    speed: float
    speed_peak: float
    acceleration: float
    current: float
    current_peak: float
    spread: float
    range: float
    duration: float
    other_torque: float = 0.0
    other_speed: float = 0.0
    other_acceleration: float = 0.0


@dataclass(frozen=True)
class Parameter:
    """One true parameter; input_equivalent in command units where it is a torque."""

    value: float
    unit: str
    input_equivalent: float | None = None


@dataclass(frozen=True)
class Hidden:
    """One drawn effect: changes of the joint's fields, true parameters, and what else it may rightly be called.

    equivalent: sets of effect names that describe the same physics on such logs. streams: signals that the world needs
    beside the joint (stray_torque, arrival_delay) or that the recorder needs (timestamp_jitter), with their size.
    """

    name: str
    changes: dict[str, Any]
    parameters: dict[str, Parameter]
    law: str = "textbook"
    equivalent: tuple[frozenset[str], ...] = ()
    streams: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Draw:
    """What a drawing rule sees. `size(low, high)` is the relative magnitude; strength 1 goes from mild to strong."""

    rng: Rng
    machine: Machine
    index: int
    scales: Scales
    strength: float = 1.0

    @property
    def joint(self) -> Joint:
        return self.machine.joints[self.index]

    @property
    def rotary(self) -> bool:
        return self.machine.unit == "rad"

    def size(self, low: float, high: float) -> float:
        return self.strength * log_uniform(self.rng, low, high)

    def least(self, bound: float) -> float:
        """A lower bound that keeps a mild effect above the sensor's resolution; a weak one may go below."""
        return min(self.strength, 1.0) * bound

    def sign(self) -> float:
        return float(self.rng.choice([-1.0, 1.0]))

    def phase(self) -> float:
        return float(self.rng.uniform(-math.pi, math.pi))

    def law(self, laws: Iterable[L], plain: float = 0.6) -> L:
        """The first law with probability `plain`, else one of the others."""
        choices = list(laws)
        return choices[0] if self.rng.random() < plain else choices[int(self.rng.integers(1, len(choices)))]

    def torque(self, value: float) -> Parameter:
        return Parameter(value, "N m" if self.rotary else "N", value * input_equivalent(self.joint))

    def per(self, value: float, what: str) -> Parameter:
        unit = ("N m" if self.rotary else "N") + what.replace("x", "rad" if self.rotary else "m")
        return Parameter(value, unit, value * input_equivalent(self.joint))

    def per_current(self, value: float, power: int) -> Parameter:
        """A parameter per current to a power; per motor torque in units of the command it is what a model has."""
        torque = 1.0 if self.joint.drive == Drive.TORQUE else self.joint.torque_constant
        unit = "1/A" if power == 1 else f"1/A^{power}"
        return Parameter(value, unit, value / (torque * input_equivalent(self.joint)) ** power)

    def command(self, value: float) -> Parameter:
        unit = {Drive.VOLTAGE: "V", Drive.CURRENT: "A", Drive.TORQUE: "N m"}[Drive(self.joint.drive)]
        return Parameter(value, unit, value)

    def place(self, value: float) -> Parameter:
        return Parameter(value, self.machine.unit)


Rule = Callable[[Draw], Hidden]
Where = Callable[[Machine], bool]
VOCABULARY: dict[str, tuple[Rule, Where]] = {}
FOREIGN: dict[str, tuple[Rule, Where]] = {}


def _everywhere(machine: Machine) -> bool:
    return True


def _voltage(machine: Machine) -> bool:
    return machine.joints[0].drive == Drive.VOLTAGE


def _electric(machine: Machine) -> bool:
    return machine.joints[0].drive != Drive.TORQUE


def _rotary(machine: Machine) -> bool:
    return machine.unit == "rad"


def _limited(machine: Machine) -> bool:
    return max(machine.travel) < 10.0


def _single(machine: Machine) -> bool:
    return len(machine.joints) == 1


def _separate(machine: Machine) -> bool:
    return machine.coupling_inertia == 0.0


def _offers(table: dict[str, tuple[Rule, Where]], *where: Where) -> Callable[[Rule], Rule]:
    def register(rule: Rule) -> Rule:
        table[rule.__name__] = (rule, lambda machine: all(test(machine) for test in where))
        return rule

    return register


def applicable(table: dict[str, tuple[Rule, Where]], machine: Machine) -> list[str]:
    """Names of the table's effects that can be hidden in this machine."""
    return [name for name, (_, where) in table.items() if where(machine)]


# --- amplifier -------------------------------------------------------------------------------------------------------


@_offers(VOCABULARY)
def dead_zone(d: Draw) -> Hidden:
    width = d.size(0.03, 0.3) * d.scales.command
    law = d.law(DeadZone)
    return Hidden("dead_zone", {"dead_zone": width, "dead_zone_law": law}, {"voltage": d.command(width)}, law.name)


@_offers(VOCABULARY)
def voltage_saturation(d: Draw) -> Hidden:
    level = d.scales.command_peak * (1.0 - min(d.size(0.15, 0.55), 0.8))
    law = d.law(Limit)
    changes = {"saturation": level, "saturation_law": law}
    return Hidden("voltage_saturation", changes, {"voltage": d.command(level)}, law.name)


@_offers(VOCABULARY)
def amplifier_offset(d: Draw) -> Hidden:
    offset = d.sign() * d.size(0.01, 0.15) * d.scales.command
    return Hidden("amplifier_offset", {"offset": offset}, {"voltage": d.command(offset)})


@_offers(VOCABULARY)
def amplifier_lag(d: Draw) -> Hidden:
    slowest = max(0.02, 4.0 * d.machine.sample_time)
    lag = d.size(max(0.002, 0.7 * d.machine.sample_time), slowest)
    return Hidden("amplifier_lag", {"lag": lag}, {"time_constant": Parameter(lag, "s")})


@_offers(VOCABULARY)
def input_delay(d: Draw) -> Hidden:
    delay = d.size(0.6 * d.machine.sample_time, max(0.01, 3.0 * d.machine.sample_time))
    return Hidden("input_delay", {"delay": delay}, {"delay": Parameter(delay, "s")})


@_offers(VOCABULARY, _voltage)
def supply_sag(d: Draw) -> Hidden:
    gain = d.size(0.03, 0.25) / d.scales.current_peak
    law = d.law(Sag)
    return Hidden("supply_sag", {"sag": gain, "sag_law": law}, {"gain": d.per_current(gain, 1)}, law.name)


# --- motor -----------------------------------------------------------------------------------------------------------


@_offers(VOCABULARY, _voltage)
def thermal_drift(d: Draw) -> Hidden:
    rise, slow = d.size(0.06, 0.5), log_uniform(d.rng, 4.0, 40.0)
    law = d.law(Heat)
    changes = {"heating": rise / d.scales.current**2, "heating_time": slow, "heating_law": law}
    return Hidden(
        "thermal_drift",
        changes,
        {"resistance_rise": Parameter(rise, "1"), "time_constant": Parameter(slow, "s")},
        law.name,
    )


def at_heat(hidden: Hidden, square: float) -> Hidden:
    """A thermal drift with its rise at the mean square current of the recordings; all others as they are."""
    if hidden.name != "thermal_drift":
        return hidden
    rise = float(hidden.changes["heating"] * square)
    if hidden.changes["heating_law"] == Heat.COPPER:
        rise /= 1.0 - rise
    return replace(hidden, parameters={**hidden.parameters, "resistance_rise": Parameter(rise, "1")})


@_offers(VOCABULARY, _electric)
def torque_constant_saturation(d: Draw) -> Hidden:
    coefficient = d.size(0.06, 0.6) / d.scales.current_peak**2
    law = d.law(TorqueLaw)
    return Hidden(
        "torque_constant_saturation",
        {"kt_saturation": coefficient, "kt_law": law},
        {"coefficient": d.per_current(coefficient, 2)},
        law.name,
    )


def _wave(d: Draw) -> tuple[float, Parameter]:
    """Radians of ripple per unit of travel, with at least two periods within the range moved."""
    if not d.rotary:
        pitch = log_uniform(d.rng, 0.1, 0.5) * max(d.scales.range, 0.01)
        return 2 * math.pi / pitch, Parameter(2 * math.pi / pitch, "rad/m")
    least = 2 * math.pi / max(d.scales.range, 0.05) * 2.0
    counts = [count for count in (2, 4, 6, 8, 12, 14, 18, 24, 28, 36, 48, 72, 150) if count >= least] or [150]
    count = float(d.rng.choice(counts))
    return count, Parameter(count, "1/rev")


@_offers(VOCABULARY)
def cogging_torque(d: Draw) -> Hidden:
    amplitude, (wave, cycles), phase = d.size(0.03, 0.3) * d.scales.torque, _wave(d), d.phase()
    second = 0.0 if d.rng.random() < 0.7 else d.rng.uniform(0.05, 0.2)
    return Hidden(
        "cogging_torque",
        {"cogging": amplitude, "cogging_wave": wave, "cogging_phase": phase, "cogging_second": second},
        {"amplitude": d.torque(amplitude), "cycles_per_rev": cycles, "phase": Parameter(phase, "rad")},
        "textbook" if second == 0.0 else "second harmonic",
    )


@_offers(VOCABULARY, _electric)
def torque_ripple(d: Draw) -> Hidden:
    share, (wave, cycles), phase = d.size(0.03, 0.25), _wave(d), d.phase()
    reciprocal = int(d.rng.random() < 0.3 and d.joint.drive == Drive.VOLTAGE)
    return Hidden(
        "torque_ripple",
        {"ripple": share, "ripple_wave": wave, "ripple_phase": phase, "ripple_reciprocal": reciprocal},
        {"share": Parameter(share, "1"), "cycles_per_rev": cycles, "phase": Parameter(phase, "rad")},
        "reciprocal" if reciprocal else "textbook",
    )


# --- transmission ----------------------------------------------------------------------------------------------------


def _two_bodies(d: Draw, lowest: float, highest: float) -> dict[str, Any]:
    inertia, ratio = total_inertia(d.joint), float(d.rng.uniform(0.25, 0.75))
    link = ratio * inertia
    frequency = log_uniform(d.rng, lowest, highest)
    stiffness = link * (2 * math.pi * frequency) ** 2
    side = d.law(Side, 0.7)
    return {
        "elastic": 1,
        "link_inertia": link,
        "motor_inertia": inertia - link,
        "stiffness": stiffness,
        "damping": 2.0 * log_uniform(d.rng, 0.01, 0.1) * math.sqrt(stiffness * link),
        "friction_side": side,
    }


def _shaft_parameters(d: Draw, changes: dict[str, Any]) -> dict[str, Parameter]:
    return {
        "stiffness": d.per(changes["stiffness"], "/x"),
        "damping": d.per(changes["damping"], " s/x"),
        "inertia_ratio": Parameter(changes["link_inertia"] / total_inertia(d.joint), "1"),
    }


@_offers(VOCABULARY, _separate)
def joint_flexibility(d: Draw) -> Hidden:
    nyquist = 0.5 / d.machine.sample_time
    slowest = max(4.0, 0.6 * d.machine.bandwidth[1] / (2 * math.pi) * 3.0)
    highest = min(40.0, 0.3 * nyquist)
    stiffer = min(1.0 / math.sqrt(d.strength), 15.0)  # deflections go with the square of the period
    changes = _two_bodies(d, stiffer * min(slowest, 0.9 * highest), stiffer * highest)
    changes["encoder_side"] = d.law(Side, 0.85)
    law = f"encoder on {changes['encoder_side'].name.lower()} side"
    return Hidden("joint_flexibility", changes, _shaft_parameters(d, changes), law)


@_offers(VOCABULARY, _separate)
def backlash(d: Draw) -> Hidden:
    nyquist = 0.5 / d.machine.sample_time
    changes = _two_bodies(d, min(20.0, 0.3 * nyquist), min(80.0, 0.6 * nyquist))
    gap = max(d.size(0.0015, 0.02) * min(d.scales.range, 3.0), d.least(4.0 * d.joint.encoder_step))
    changes["gap"] = gap
    changes["shaft_law"] = law = d.law(Shaft, 0.5)
    # the torque scale is reached at this compression
    changes["shaft_reference"] = 0.5 * max(d.scales.torque, 1e-12) / changes["stiffness"]
    changes["damping"] *= 3.0
    parameters = {"gap": d.place(gap), **_shaft_parameters(d, changes)}
    return Hidden("backlash", changes, parameters, law.name, (frozenset({"backlash", "joint_flexibility"}),))


@_offers(VOCABULARY, lambda machine: len(machine.joints) == 2)
def axis_coupling(d: Draw) -> Hidden:
    law = d.law(Coupling, 0.4)
    torque = d.size(0.05, 0.4) * d.scales.torque * d.sign()
    scale, unit = {
        Coupling.ACCELERATION: (d.scales.other_acceleration, " s^2/x"),
        Coupling.VELOCITY: (d.scales.other_speed, " s/x"),
        Coupling.TORQUE: (d.scales.other_torque, ""),
    }[law]
    value = torque / scale
    if law == Coupling.ACCELERATION:  # short of a singular inertia matrix
        bound = 0.5 * min(total_inertia(joint) for joint in d.machine.joints)
        value = min(max(value, -bound), bound)
    parameter = Parameter(value, "1") if law == Coupling.TORQUE else d.per(value, unit)
    return Hidden("axis_coupling", {"coupling": value, "coupling_law": law}, {"coefficient": parameter}, law.name)


# --- arm -------------------------------------------------------------------------------------------------------------


@_offers(VOCABULARY)
def coulomb_friction(d: Draw) -> Hidden:
    torque = d.size(0.02, 0.35) * d.scales.torque
    return Hidden("coulomb_friction", {"coulomb": torque}, {"torque": d.torque(torque)}, "event-driven")


@_offers(VOCABULARY)
def stribeck_friction(d: Draw) -> Hidden:
    torque = d.size(0.03, 0.25) * d.scales.torque
    static = torque * d.rng.uniform(1.4, 2.4)
    velocity = log_uniform(d.rng, 0.04, 0.4) * d.scales.speed
    law = d.law(Stribeck, 0.5)
    return Hidden(
        "stribeck_friction",
        {"coulomb": torque, "static_excess": static - torque, "stribeck_velocity": velocity, "stribeck_law": law},
        {
            "torque": d.torque(torque),
            "static_torque": d.torque(static),
            "velocity": Parameter(velocity, f"{d.machine.unit}/s"),
        },
        law.name,
    )


@_offers(VOCABULARY)
def presliding_friction(d: Draw) -> Hidden:
    torque = d.size(0.03, 0.3) * d.scales.torque
    least = 4.0 * d.joint.encoder_step
    reach = max(log_uniform(d.rng, 0.004, 0.08) * min(d.scales.range, 3.0), least)
    stiffness = torque / reach
    law = d.law([Bristle.DAHL, Bristle.LUGRE, Bristle.DAHL_SQUARE, Bristle.MAXWELL_SLIP], 0.35)
    damping = 0.0
    if law == Bristle.LUGRE:
        damping = 2.0 * log_uniform(d.rng, 0.05, 0.5) * math.sqrt(stiffness * total_inertia(d.joint))
    return Hidden(
        "presliding_friction",
        {
            "bristle_law": law,
            "bristle_torque": torque,
            "bristle_stiffness": stiffness,
            "bristle_damping": damping,
        },
        {"torque": d.torque(torque), "stiffness": d.per(stiffness, "/x"), "damping": d.per(damping, " s/x")},
        law.name,
    )


@_offers(VOCABULARY)
def quadratic_drag(d: Draw) -> Hidden:
    exponent = 2.0 if d.rng.random() < 0.7 else d.rng.uniform(1.75, 2.0)
    coefficient = d.size(0.03, 0.35) * d.scales.torque / d.scales.speed**exponent
    return Hidden(
        "quadratic_drag",
        {"drag": coefficient, "drag_exponent": exponent},
        {"coefficient": d.per(coefficient, " s^2/x^2")},
        f"exponent {exponent:.2f}",
    )


@_offers(VOCABULARY)
def friction_asymmetry(d: Draw) -> Hidden:
    viscous = d.sign() * d.size(0.05, 0.4) * d.scales.torque / d.scales.speed
    ceiling = 1.8 * d.joint.viscous
    viscous = math.copysign(min(abs(viscous), ceiling), viscous)
    difference, mean = 0.0, 0.0
    equivalent: tuple[frozenset[str], ...] = ()
    law = "viscous"
    if abs(viscous) == ceiling or d.rng.random() < 0.5:
        difference = d.sign() * d.size(0.03, 0.2) * d.scales.torque
        mean = abs(difference) * d.rng.uniform(0.5, 1.0)
        law = "viscous and dry"
        equivalent = (frozenset({"coulomb_friction", "friction_asymmetry"}),)
    return Hidden(
        "friction_asymmetry",
        {"asymmetry_viscous": viscous, "asymmetry_torque": difference, "coulomb": mean},
        {"torque": d.torque(difference), "viscous": d.per(viscous, " s/x")},
        law,
        equivalent,
    )


@_offers(VOCABULARY)
def load_dependent_friction(d: Draw) -> Hidden:
    coefficient = d.size(0.03, 0.3)
    return Hidden(
        "load_dependent_friction", {"load_friction": coefficient}, {"coefficient": Parameter(coefficient, "1")}
    )


@_offers(VOCABULARY, _rotary, _limited, lambda machine: machine.joints[0].gravity == 0.0)
def gravity_tilt(d: Draw) -> Hidden:
    torque, phase = d.size(0.03, 0.35) * d.scales.torque, d.phase()
    return Hidden(
        "gravity_tilt",
        {"tilt": torque, "tilt_phase": phase},
        {"torque": d.torque(torque), "phase": Parameter(phase, "rad")},
    )


@_offers(VOCABULARY, _limited)
def cable_spring(d: Draw) -> Hidden:
    stiffness = d.size(0.04, 0.4) * d.scales.torque / d.scales.spread
    rest = float(d.rng.uniform(-0.5, 0.5)) * d.scales.range
    return Hidden(
        "cable_spring",
        {"spring": stiffness, "spring_rest": rest},
        {"stiffness": d.per(stiffness, "/x"), "rest_angle": d.place(rest)},
    )


@_offers(VOCABULARY)
def payload_change(d: Draw) -> Hidden:
    inertia = d.size(0.04, 0.5) * total_inertia(d.joint)
    samples = d.scales.duration / d.machine.sample_time
    time = round(float(d.rng.uniform(0.25, 0.75)) * samples) * d.machine.sample_time
    law = d.law(Grasp, 0.7)
    unit = "kg m^2" if d.rotary else "kg"
    return Hidden(
        "payload_change",
        {"payload": inertia, "payload_time": time, "payload_law": law},
        {
            "inertia": Parameter(inertia, unit, inertia * input_equivalent(d.joint)),
            "time": Parameter(time, "s"),
        },
        law.name,
    )


@_offers(VOCABULARY)
def periodic_disturbance(d: Draw) -> Hidden:
    torque, phase = d.size(0.02, 0.25) * d.scales.torque, d.phase()
    frequency = log_uniform(d.rng, 0.7, min(20.0, 0.1 / d.machine.sample_time))
    return Hidden(
        "periodic_disturbance",
        {"disturbance": torque, "disturbance_frequency": frequency, "disturbance_phase": phase},
        {
            "torque": d.torque(torque),
            "frequency": Parameter(frequency, "Hz"),
            "phase": Parameter(phase, "rad"),
        },
    )


@_offers(VOCABULARY)
def collision(d: Draw) -> Hidden:
    torque = d.sign() * d.size(0.4, 4.0) * d.scales.torque
    lasting = log_uniform(d.rng, max(0.02, 5 * d.machine.sample_time), 0.25)
    time = float(d.rng.uniform(0.15, 0.85)) * d.scales.duration
    law = d.law(Pulse)
    return Hidden(
        "collision",
        {"collision": torque, "collision_time": time, "collision_duration": lasting, "collision_law": law},
        {"torque": d.torque(torque), "time": Parameter(time, "s"), "duration": Parameter(lasting, "s")},
        law.name,
    )


# --- sensor ----------------------------------------------------------------------------------------------------------


@_offers(VOCABULARY, _rotary)
def encoder_eccentricity(d: Draw) -> Hidden:
    amplitude, phase = max(d.size(3e-4, 6e-3), d.least(3.0 * d.joint.encoder_step)), d.phase()
    return Hidden(
        "encoder_eccentricity",
        {"eccentricity": amplitude, "eccentricity_phase": phase},
        {"amplitude": Parameter(amplitude, "rad"), "phase": Parameter(phase, "rad")},
    )


@_offers(VOCABULARY)
def timestamp_jitter(d: Draw) -> Hidden:
    visible = d.joint.encoder_step / max(d.scales.speed, 1e-9)
    rms = min(max(d.size(0.04, 0.3) * d.machine.sample_time, d.least(visible)), 0.35 * d.machine.sample_time)
    stamped = float(d.rng.random() < 0.3)
    return Hidden(
        "timestamp_jitter",
        {},
        {"rms": Parameter(rms, "s")},
        "in the stamps" if stamped else "in the sampling",
        streams={"timestamp_jitter": rms, "jitter_in_stamps": stamped},
    )


# --- outside the vocabulary ------------------------------------------------------------------------------------------


@_offers(FOREIGN, _single)
def linkage_inertia(d: Draw) -> Hidden:
    """Inertia that depends on the angle, as behind an unmodelled linkage."""
    share = d.size(0.08, 0.4)
    cycles = log_uniform(d.rng, 1.0, 3.0) * (1.0 if d.rotary else 2 * math.pi / d.scales.range)
    return Hidden(
        "linkage_inertia",
        {"inertia_wave": share, "inertia_cycles": cycles, "inertia_phase": d.phase()},
        {"share": Parameter(share, "1")},
    )


@_offers(FOREIGN)
def material_hysteresis(d: Draw) -> Hidden:
    """Bouc-Wen hysteresis with a yield displacement of the size of the motion."""
    torque = d.size(0.1, 0.5) * d.scales.torque
    reach = d.rng.uniform(0.15, 0.5) * d.scales.range
    return Hidden(
        "material_hysteresis",
        {"hysteresis": torque, "hysteresis_yield": reach},
        {"torque": d.torque(torque), "yield_displacement": d.place(reach)},
        equivalent=(frozenset({"presliding_friction"}),),
    )


@_offers(FOREIGN, _electric)
def speed_dependent_torque_constant(d: Draw) -> Hidden:
    share = d.size(0.08, 0.5) / d.scales.speed_peak
    return Hidden("speed_dependent_torque_constant", {"kt_speed": share}, {"share": d.place(share)})


@_offers(FOREIGN)
def root_damper(d: Draw) -> Hidden:
    """A leaking hydraulic damper, torque by the square root of speed."""
    value = d.size(0.08, 0.4) * d.scales.torque / math.sqrt(d.scales.speed)
    return Hidden("root_damper", {"root_damper": value}, {"coefficient": d.per(value, " s^0.5/x^0.5")})


@_offers(FOREIGN)
def crosstalk(d: Draw) -> Hidden:
    """Torque from a neighbour that nobody logged."""
    torque = d.size(0.05, 0.4) * d.scales.torque
    return Hidden("crosstalk", {}, {"torque_rms": d.torque(torque)}, streams={"stray_torque": torque})


@_offers(FOREIGN)
def coarse_torque(d: Draw) -> Hidden:
    """An amplifier that rounds its own set point coarsely."""
    step = d.size(0.1, 0.6) * d.scales.command
    return Hidden("coarse_torque", {"torque_step": step}, {"step": d.command(step)})


@_offers(FOREIGN, lambda machine: machine.hold == "zero_order")
def wandering_delay(d: Draw) -> Hidden:
    """Dead time that wanders slowly between nothing and its largest value, as on a loaded bus."""
    delay = d.size(1.0, 8.0) * d.machine.sample_time
    return Hidden(
        "wandering_delay",
        {},
        {"largest": Parameter(delay, "s"), "mean": Parameter(0.5 * delay, "s")},
        streams={"arrival_delay": delay},
    )


@_offers(FOREIGN, _limited)
def cubic_spring(d: Draw) -> Hidden:
    value = d.size(0.1, 0.6) * d.scales.torque / (0.5 * d.scales.range) ** 3
    return Hidden("cubic_spring", {"cubic_spring": value}, {"coefficient": d.per(value, "/x^3")})


@_offers(FOREIGN, lambda machine: machine.joints[0].viscous > 0.0)
def warming_lubricant(d: Draw) -> Hidden:
    """Viscous friction that falls as its own work warms the lubricant."""
    torque = d.size(0.08, 0.4) * d.scales.torque
    share = torque / (d.joint.viscous * d.scales.speed)
    energy = d.rng.uniform(0.1, 0.5) * d.joint.viscous * d.scales.speed**2 * d.scales.duration
    return Hidden(
        "warming_lubricant",
        {"viscous_cold": share, "viscous_energy": energy},
        {"cold_share": Parameter(share, "1"), "energy": Parameter(energy, "J")},
    )


@_offers(FOREIGN, _single)
def swinging_base(d: Draw) -> Hidden:
    """A base that swings against the floor: linear, and seen from the joint the same as a flexible joint."""
    inertia = total_inertia(d.joint)
    base = inertia * d.rng.uniform(1.0, 6.0)
    frequency = log_uniform(d.rng, 3.0, min(15.0, 0.08 / d.machine.sample_time))
    stiffness = base * (2 * math.pi * frequency) ** 2
    return Hidden(
        "swinging_base",
        {
            "base_inertia": base,
            "base_stiffness": stiffness,
            "base_damping": 2.0 * log_uniform(d.rng, 0.01, 0.08) * math.sqrt(stiffness * base),
        },
        {"frequency": Parameter(frequency, "Hz"), "inertia_ratio": Parameter(base / inertia, "1")},
        equivalent=(frozenset({"joint_flexibility"}),),
    )


EXCLUSIVE: tuple[frozenset[str], ...] = (
    frozenset({"coulomb_friction", "stribeck_friction", "presliding_friction", "friction_asymmetry"}),
    frozenset({"joint_flexibility", "backlash"}),
    frozenset({"amplifier_offset", "friction_asymmetry"}),
    *(frozenset({"amplifier_offset", f"{law}_friction"}) for law in ("coulomb", "stribeck", "presliding")),
    frozenset({"cable_spring", "gravity_tilt"}),
    frozenset({"amplifier_lag", "input_delay"}),
    frozenset({"cogging_torque", "torque_ripple"}),
)
"""Effects that are not hidden together: they share a law, or no log separates the sum from one of them."""


def compatible(first: str, second: str) -> bool:
    """Whether both may be hidden in the same joint."""
    return first != second and not any({first, second} <= group for group in EXCLUSIVE)


def rms(signal: Array) -> float:
    return float(np.sqrt(np.mean(np.square(signal))))
