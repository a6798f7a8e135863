"""Measured data of real rigs: which files there are, where they lie, where they come from.

The data are not part of the project. A folder of one's own (environment variable ADEPTONE_DATA, by default
``../shared/data`` beside the checkout when it is there) takes precedence; otherwise files are fetched from their public
address into the user's cache and checked against their SHA-256.
"""

from __future__ import annotations

import gzip
import hashlib
import os
import tomllib
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from envs.log import LogError

DESCRIPTIONS = Path(__file__).with_name("rigs")
ENVIRONMENT_VARIABLE = "ADEPTONE_DATA"

FileState = Literal["sound", "missing", "changed"]


class DataSetError(LogError):
    """A data set that is unknown, incomplete or cannot be fetched: one line with the remedy."""


@dataclass(frozen=True)
class DataFile:
    """One file of a set. path: inside the set's folder; address: where it is fetched; sha256: of its plain content.

    Where `path` ends in ``.gz`` and `address` does not, the cached copy is the plain file without that suffix.
    """

    path: str
    address: str
    sha256: str


@dataclass(frozen=True)
class DataSet:
    """The files of one rig. The name is the folder's name."""

    name: str
    title: str
    origin: str
    licence: str
    files: tuple[DataFile, ...]

    def file(self, path: str) -> DataFile:
        """A file by its path. Raises DataSetError for any other."""
        for item in self.files:
            if item.path == path:
                return item
        raise DataSetError(f"the data set {self.name} has no file {path}", remedy="See adeptone data list")


def description(name: str) -> dict[str, Any]:
    """The content of ``rig.toml``. Raises DataSetError for a rig that does not exist."""
    path = DESCRIPTIONS / name / "rig.toml"
    if not path.is_file():
        raise DataSetError(f"there is no data set {name!r}", remedy=f"Choose one of {', '.join(names())}")
    return tomllib.loads(path.read_text(encoding="utf-8"))


@cache
def names() -> tuple[str, ...]:
    """The data sets that are known, in alphabetical order."""
    return tuple(sorted(path.parent.name for path in DESCRIPTIONS.glob("*/rig.toml")))


@cache
def data_set(name: str) -> DataSet:
    """A data set by its name. Raises DataSetError when there is none."""
    content = description(name)
    return DataSet(
        name=name,
        title=content["title"],
        origin=content["origin"],
        licence=content["licence"],
        files=tuple(
            DataFile(entry["path"], content["base_address"] + entry["address"], entry["sha256"])
            for entry in content["file"]
        ),
    )


def own_folder() -> Path | None:
    """The folder of one's own that holds data sets, None when there is none.

    Raises DataSetError when ADEPTONE_DATA names a folder that does not exist.
    """
    stated = os.environ.get(ENVIRONMENT_VARIABLE)
    if stated:
        if not Path(stated).is_dir():
            raise DataSetError(f"{ENVIRONMENT_VARIABLE} is {stated}, which is no folder", remedy="Correct or unset it")
        return Path(stated)
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    return beside if beside.is_dir() else None


def cache_folder() -> Path:
    """Where fetched files are kept."""
    import pooch

    return Path(pooch.os_cache("adeptone"))


def candidates(name: str, item: DataFile) -> Iterator[Path]:
    """Where a file may lie, in order of precedence."""
    own = own_folder()
    if own is not None:
        yield own / name / item.path
    yield cache_folder() / name / cached_name(item)


def cached_name(item: DataFile) -> str:
    """Name of the fetched copy: the plain file where the address gives it uncompressed."""
    return item.path if item.address.endswith(".gz") else item.path.removesuffix(".gz")


def locate(name: str, path: str) -> Path:
    """A file of a data set on this machine. Raises DataSetError, saying how to get it, when it is nowhere."""
    item = data_set(name).file(path)
    for place in candidates(name, item):
        if place.is_file():
            return place
    raise DataSetError(
        f"{path} of the data set {name} is not on this machine",
        remedy=f"Run adeptone data fetch {name}, or set {ENVIRONMENT_VARIABLE} to the folder that holds {name}/",
    )


def available(name: str) -> bool:
    """Whether every file of a data set is on this machine."""
    return all(any(place.is_file() for place in candidates(name, item)) for item in data_set(name).files)


def verify(name: str) -> Iterator[tuple[DataFile, FileState]]:
    """Every file of a data set with its state."""
    for item in data_set(name).files:
        place = next((place for place in candidates(name, item) if place.is_file()), None)
        if place is None:
            yield item, "missing"
        else:
            yield item, "sound" if digest(place) == item.sha256 else "changed"


def digest(path: Path) -> str:
    """SHA-256 of a file's content, decompressed when it is gzip; a damaged archive gives an empty string."""
    content = path.read_bytes()
    if path.suffix == ".gz":
        try:
            content = gzip.decompress(content)
        except (OSError, EOFError, zlib.error):
            return ""
    return hashlib.sha256(content).hexdigest()


def fetch(name: str) -> Iterator[Path]:
    """Brings every file that is not on this machine into the cache, checked, one after the other.

    Raises DataSetError when an address cannot be reached or gives another content.
    """
    import pooch
    from requests.exceptions import RequestException

    for item in data_set(name).files:
        present = next((place for place in candidates(name, item) if place.is_file()), None)
        if present is not None:
            yield present
            continue
        target = cache_folder() / name / cached_name(item)
        try:
            pooch.retrieve(
                item.address, known_hash=item.sha256, fname=target.name, path=target.parent, progressbar=False
            )
        except (RequestException, OSError) as error:
            raise DataSetError(
                f"{item.address} cannot be reached ({type(error).__name__})",
                remedy=f"Connect to the network, or put the files into a folder and set {ENVIRONMENT_VARIABLE} to it",
            ) from None
        except ValueError:
            raise DataSetError(
                f"{item.address} has another content than expected",
                remedy="The public copy was changed; use a copy of your own",
            ) from None
        yield target
