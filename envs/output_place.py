"""Can results be written where they are wanted? Asked before anything is computed."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def check_folder(out: Path) -> None:
    """Refuses a folder that cannot be made or written into, in one line (OSError); makes and leaves nothing."""
    if out.exists() and not out.is_dir():
        raise FileExistsError(f"{out} is a file. Give a folder with --out")
    _check_place(out, out)


def check_file(out: Path) -> None:
    """The same for a file, whose folder may still have to be made."""
    if out.is_dir():
        raise IsADirectoryError(f"{out} is a folder. Give a file with --out")
    _check_place(out, out.parent)


def _check_place(out: Path, folder: Path) -> None:
    place = folder.absolute()
    while not os.path.lexists(place):
        place = place.parent
    if not place.is_dir():
        raise NotADirectoryError(f"{out} cannot be written: {place} is no folder. Give another place with --out")
    try:
        with tempfile.TemporaryFile(dir=place):  # the rights alone do not tell, of /proc or of a full disk
            return
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        raise PermissionError(
            f"{out} cannot be written: nothing can be created in {place} ({reason}). Give another place with --out"
        ) from None
