"""A working method or effect of one's own to begin with, and the test that checks it; existing files are kept."""

from __future__ import annotations

import keyword
import re
from pathlib import Path
from typing import Literal

from envs.log_files import write_atomically
from envs.output_place import check_folder
from methods.effects import vocabulary
from methods.plugins import load_all
from methods.registry import METHODS, RegistryError

TEMPLATES = Path(__file__).parent / "templates"
Kind = Literal["method", "effect"]


def scaffold(kind: Kind, name: str, folder: Path) -> tuple[Path, Path]:
    """Write NAME.py and test_NAME.py into the folder and return their paths.

    Raises RegistryError for a name that is no name or is taken, FileExistsError when one of the files is there.
    """
    one = "an effect" if kind == "effect" else "a method"
    if re.fullmatch("[a-z][a-z0-9_]*", name) is None or keyword.iskeyword(name):
        raise RegistryError(f"{name!r} is no name for {one}. Write words in lower case, joined by underscores")
    if name in taken(kind):
        raise RegistryError(f"there is {one} {name!r} already. Choose another name")
    files = {folder / f"{name}.py": f"{kind}.py.txt", folder / f"test_{name}.py": f"test_{kind}.py.txt"}
    check_folder(folder)
    for path in files:
        if path.exists():
            raise FileExistsError(f"{path} exists and is kept. Choose another name or another folder")
    words = {
        "{name}": name,
        "{title}": name.replace("_", " ").capitalize(),
        "{class_name}": "".join(word.capitalize() for word in name.split("_")),
    }
    contents = {
        path: filled((TEMPLATES / template).read_text(encoding="utf-8"), words) for path, template in files.items()
    }
    write_atomically({path: text.encode() for path, text in contents.items()})
    first, second = files
    return first, second


def taken(kind: Kind) -> frozenset[str]:
    """Names of all methods or effects that are known here."""
    if kind == "effect":
        return frozenset(effect.name for effect in vocabulary())
    load_all()
    return frozenset(METHODS.names())


def filled(text: str, words: dict[str, str]) -> str:
    """The template with its words filled in; other braces stay."""
    for key, word in words.items():
        text = text.replace(key, word)
    return text
