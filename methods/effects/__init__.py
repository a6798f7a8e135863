"""The vocabulary: every effect that the models know, one file each, and those of installed packages."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from methods.effects.base import Effect
from methods.registry import RegistryError, entry_points, run_file

STAGES = ("amplifier", "motor", "transmission", "arm", "sensor")
GROUP = "adeptone.effects"
"""Entry-point group in which an installed package names its effects: ``name = "package.module:EFFECT"``."""


def built_in() -> tuple[Effect, ...]:
    """The effects of this folder in the order of the signal chain, then by name."""
    names = [module.name for module in pkgutil.iter_modules(__path__) if module.name != "base"]
    modules = [importlib.import_module(f"{__name__}.{name}") for name in names]
    return _ordered(effect for module in modules for effect in getattr(module, "EFFECTS", (module.EFFECT,)))


def vocabulary(plugins: Sequence[Path] = ()) -> tuple[Effect, ...]:
    """The effects of this folder, of installed packages, and of plugin files, in the order of the signal chain.

    Raises RegistryError when a plugin does not run, is no effect, or takes a name that is taken.
    """
    found = {effect.name: (effect, "the project itself") for effect in built_in()}
    foreign = [(effect, f"entry point {name}") for name, effect in entry_points(GROUP)]
    for item, origin in [*foreign, *((from_file(path), str(path)) for path in dict.fromkeys(map(Path, plugins)))]:
        effect = checked(item, origin)
        if effect.name in found:
            raise RegistryError(
                f"effect {effect.name!r} of {origin} is already defined by {found[effect.name][1]}. Choose another name"
            )
        found[effect.name] = (effect, origin)
    return _ordered(effect for effect, _ in found.values())


def compiled_with(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects that a kernel for these is built of: all built-in ones where those suffice, so that one serves."""
    own = built_in()
    return own if set(effects) <= set(own) else tuple(effects)


def from_file(path: Path) -> Effect:
    """The effect that a plugin file defines as ``EFFECT``. Raises RegistryError when there is none."""
    return checked(getattr(run_file(path, "EFFECT"), "EFFECT", None), str(path))


def checked(item: object, origin: str) -> Effect:
    """The item itself when it is an effect that the kernel can hold. Raises RegistryError otherwise."""
    if not isinstance(item, Effect):
        raise RegistryError(f"{origin} defines no effect. Write EFFECT = Effect(...) into the file")
    if item.stage not in STAGES:
        raise RegistryError(
            f"effect {item.name!r} of {origin} has the stage {item.stage!r}. Choose from {', '.join(STAGES)}"
        )
    if item.slot == "structure" and item.name not in {effect.name for effect in built_in()}:
        raise RegistryError(
            f"effect {item.name!r} of {origin} has the slot 'structure', which needs states in methods/kernel.py. "
            "Choose command, gain, torque, friction or sensor"
        )
    if item.slot != "structure" and item.function is None:
        raise RegistryError(f"effect {item.name!r} of {origin} has no function. Give one for the slot {item.slot!r}")
    return item


def _ordered(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    return tuple(sorted(effects, key=lambda effect: (STAGES.index(effect.stage), effect.name)))
