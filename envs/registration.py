"""Makes the environment known to gymnasium as ``AdeptOne-v0``; done by ``import envs``."""

from __future__ import annotations

import gymnasium

ENVIRONMENT = "AdeptOne-v0"
"""Name under which `gymnasium.make` finds the environment; see `envs.gym_env.AdeptOneEnv` for its arguments."""


def register() -> None:
    """Registers the environment once; further calls change nothing."""
    if ENVIRONMENT not in gymnasium.registry:
        gymnasium.register(ENVIRONMENT, entry_point="envs.gym_env:AdeptOneEnv")
