"""Every effect that a plant can hide: `EFFECTS`, a registry by name, and `parse_effect`, its text form."""

from envs.plant.effects import amplifier, arm, motor, sensor, transmission
from envs.plant.effects.base import EFFECTS, Effect, EffectError, parse_effect

__all__ = ["EFFECTS", "Effect", "EffectError", "amplifier", "arm", "motor", "parse_effect", "sensor", "transmission"]
