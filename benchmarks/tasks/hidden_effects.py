"""One joint of the arm with one effect hidden, by family: friction, drive, transmission, load, sensor, time-varying.

Sizes are shares of what the joint's own multisine commands (`Member.level`, `Member.torque`), so that an effect matters
alike on a strong and on a weak joint; the seed draws them within a factor of 1.5 either way.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from benchmarks.paper.experiment import SETUPS
from benchmarks.tasks.base import Task, register
from benchmarks.tasks.recording import Member, Setting
from benchmarks.tasks.single_joint import HELD_OUT, TRAIN

if TYPE_CHECKING:
    from envs.plant.effects import Effect

Family = Literal["friction", "drive", "transmission", "load", "sensor", "time-varying"]
SPREAD = math.log(1.5)
Sizes = Callable[[Member, int, float], dict[str, float]]
"""Parameters of an effect from the robot, the joint and a random factor around 1."""


@dataclass(frozen=True)
class Recipe:
    """An effect of a family and its size. everywhere: tried on all four joints, not on joint 1 alone."""

    effect: str
    family: Family
    sizes: Sizes
    everywhere: bool = False


def _flexibility(member: Member, joint: int, factor: float) -> dict[str, float]:
    """A shaft with a free resonance of about 12 Hz; the encoder sits on the motor."""
    reduced = 0.7 * 0.3 * member.inertia(joint)
    return {"stiffness": factor * reduced * (2.0 * math.pi * 12.0) ** 2}


def _stribeck(member: Member, joint: int, factor: float) -> dict[str, float]:
    torque = factor * member.torque(joint)
    return {"torque": 0.06 * torque, "static_torque": 0.12 * torque, "velocity": 0.08 * member.top_speed(joint)}


def _spring(member: Member, joint: int, factor: float) -> dict[str, float]:
    stiffness = 0.08 * factor * member.torque(joint) / SETUPS[joint].sweep
    return {"stiffness": stiffness, "rest_angle": SETUPS[joint].centre}


def _saturation(member: Member, joint: int, factor: float) -> dict[str, float]:
    limit = member.robot.joint(joint).drive.current_limit.value
    return {"coefficient": 0.3 * factor / (0.6 * limit) ** 2}


RECIPES = (
    Recipe("coulomb_friction", "friction", lambda m, j, x: {"torque": 0.08 * x * m.torque(j)}, True),
    Recipe("stribeck_friction", "friction", _stribeck, True),
    Recipe("presliding_friction", "friction", lambda m, j, x: {"torque": 0.08 * x * m.torque(j)}),
    Recipe("friction_asymmetry", "friction", lambda m, j, x: {"torque": 0.08 * x * m.torque(j)}),
    Recipe("load_dependent_friction", "friction", lambda m, j, x: {"coefficient": 0.12 * x}),
    Recipe(
        "quadratic_drag",
        "friction",
        lambda m, j, x: {"coefficient": 0.1 * x * m.torque(j) / m.top_speed(j) ** 2},
    ),
    Recipe("dead_zone", "drive", lambda m, j, x: {"voltage": 0.04 * x * m.level(j)}, True),
    Recipe("voltage_saturation", "drive", lambda m, j, x: {"voltage": 0.65 * m.level(j) * x**0.5}),
    Recipe("amplifier_lag", "drive", lambda m, j, x: {"time_constant": 5e-3 * x}),
    Recipe("input_delay", "drive", lambda m, j, x: {"delay": 4e-3 * x}),
    Recipe("amplifier_offset", "drive", lambda m, j, x: {"voltage": 0.02 * x * m.level(j)}),
    Recipe("torque_constant_saturation", "drive", _saturation),
    Recipe("torque_ripple", "drive", lambda m, j, x: {"share": 0.06 * x}),
    Recipe(
        "cogging_torque",
        "drive",
        lambda m, j, x: {"amplitude": 0.05 * x * m.torque(j), "cycles_per_rev": SETUPS[j].cycles},
        True,
    ),
    Recipe("joint_flexibility", "transmission", _flexibility, True),
    Recipe("backlash", "transmission", lambda m, j, x: {"gap": 0.004 * x * SETUPS[j].sweep}),
    Recipe("cable_spring", "load", _spring, True),
    Recipe("gravity_tilt", "load", lambda m, j, x: {"torque": 0.06 * x * m.torque(j), "phase": 0.3}),
    Recipe("encoder_eccentricity", "sensor", lambda m, j, x: {"amplitude": 2e-3 * x * SETUPS[j].sweep}, True),
    Recipe("timestamp_jitter", "sensor", lambda m, j, x: {"rms": 1e-4 * x}),
    Recipe("thermal_drift", "time-varying", lambda m, j, x: {"resistance_rise": 0.3 * x, "time_constant": 5.0}, True),
    Recipe("payload_change", "time-varying", lambda m, j, x: {"inertia": 0.3 * x * m.inertia(j), "time": 5.0}, True),
    Recipe("periodic_disturbance", "time-varying", lambda m, j, x: {"torque": 0.05 * x * m.torque(j)}),
)


@dataclass(frozen=True)
class Hidden:
    """Draws effects by name for the joints that move."""

    effects: tuple[tuple[str, int], ...]

    def __call__(self, rng: np.random.Generator, member: Member) -> tuple[Effect, ...]:
        """The effects for one member of the ensemble."""
        from envs.plant.effects import EFFECTS

        recipes = {recipe.effect: recipe for recipe in RECIPES}
        return tuple(
            EFFECTS[name](joint=joint, **recipes[name].sizes(member, joint, math.exp(rng.uniform(-SPREAD, SPREAD))))
            for name, joint in self.effects
        )


for joint in (1, 2, 3, 4):
    for recipe in RECIPES:
        if joint > 1 and not recipe.everywhere:
            continue
        name = f"joint{joint}_{recipe.effect}"
        register(
            Task(
                name=name,
                title=f"Joint {joint}, hidden: {recipe.effect.replace('_', ' ')}",
                tags=frozenset({"single", "hidden", recipe.family}),
                joints=(joint,),
                make=Setting(name, (joint,), TRAIN, HELD_OUT, hide=Hidden(((recipe.effect, joint),))).make,
            )
        )
    name = f"joint{joint}_paper_effects"
    register(
        Task(
            name=name,
            title=f"Joint {joint}, hidden: friction, cogging and dead zone together",
            tags=frozenset({"single", "hidden", "friction", "drive"}),
            joints=(joint,),
            make=Setting(
                name,
                (joint,),
                TRAIN,
                HELD_OUT,
                hide=Hidden(tuple((effect, joint) for effect in ("coulomb_friction", "cogging_torque", "dead_zone"))),
            ).make,
        )
    )
