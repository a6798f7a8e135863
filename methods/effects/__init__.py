"""The vocabulary: every effect that the models know, one file each."""

from __future__ import annotations

import importlib
import pkgutil

from methods.effects.base import Effect

STAGES = ("amplifier", "motor", "transmission", "arm", "sensor")


def built_in() -> tuple[Effect, ...]:
    """The effects of this folder in the order of the signal chain, then by name."""
    names = [module.name for module in pkgutil.iter_modules(__path__) if module.name != "base"]
    effects = [importlib.import_module(f"{__name__}.{name}").EFFECT for name in names]
    return tuple(sorted(effects, key=lambda effect: (STAGES.index(effect.stage), effect.name)))
