"""Robots by name: the AdeptOne, the real rigs, or anybody's description in a file."""

from __future__ import annotations

import difflib
from pathlib import Path

from envs.robot import Robot, RobotError, load_robot


def robot_names() -> tuple[str, ...]:
    """Names that `find_robot` knows, beside paths of descriptions."""
    from envs.data_sets import names

    return ("adeptone", *names())


def find_robot(name: str) -> Robot:
    """A robot by its name (in any case), or by the path of a TOML description (MJCF or URDF plus drives).

    The layout of descriptions is that of `load_robot`.

    Raises RobotError when the name is unknown or the description unusable.
    """
    known = name.casefold()
    if known == "adeptone":
        from envs.adeptone import adeptone

        return adeptone()
    if known in robot_names():
        from envs.rigs import rig

        return rig(known).robot()
    path = Path(name)
    if path.suffix.lower() == ".toml":
        return load_robot(path)
    if path.suffix.lower() in (".xml", ".urdf", ".mjcf"):
        raise RobotError(
            "a body alone says nothing of its drives",
            remedy=f'Write a TOML with [body] file = "{path.name}" and one [[joint]] with [joint.drive] per joint',
            source=name,
        )
    near = difflib.get_close_matches(known, robot_names(), n=1)
    raise RobotError(
        f"there is no robot {name!r}" + (f" (did you mean {near[0]}?)" if near else ""),
        remedy=f"Choose one of {', '.join(robot_names())} or give the path of a description (TOML)",
    )
