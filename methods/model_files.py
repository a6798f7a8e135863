"""Fitted models in files: one JSON layout for every model that is a frozen dataclass of numbers, arrays and the like.

    {"format": 1, "model": "fitted", "method": ..., "label": ..., "status": ..., "notes": [...],
     "joints": [1], "inputs": ["voltage"],
     "estimates": [{"name": ..., "unit": ..., "value": ..., "standard_error": ...}, ...], "covariance": [[...], ...],
     "logs": [{"name": ..., "sha256": ...}, ...], "versions": {...}, "seed": 0,
     "parts": {"class": "methods.joint_model.JointModel", "fields": {...}}}

`parts` rebuilds the model: a dataclass is its class and its fields, an array {"array": nested lists, "dtype": ...,
"shape": ...}, a tuple {"tuple": [...]}, a mapping {"mapping": {...}}; the rest is plain JSON. Numbers that are not
finite are {"number": "nan"}, "inf" or "-inf" (in an array the word alone) inside `parts`, and null elsewhere. Numbers
survive to the last bit.
`load_model` also reads the `extended_model.json` of a diagnosis.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import json
import math
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from envs.log import Log
from methods.base import Fit, Method, MethodError, Model
from methods.effects.base import Effect
from methods.registry import METHODS

FORMAT = 1
"""Version of the JSON layout."""
NOT_FINITE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
ROOMS = frozenset(("envs", "methods"))
"""Packages of the project that hold parts of models."""
PACKAGES = ("adeptone", "numpy", "scipy", "numba")
"""Packages whose versions are noted."""


def fit_to_json(method: Method, label: str, fit: Fit, logs: Sequence[Log], seed: int) -> str:
    """The text of a model file. Raises MethodError when the model holds something that cannot be written."""
    estimates = fit.estimates
    rows = zip(estimates.names, estimates.units, estimates.values, estimates.standard_errors, strict=True)
    content = {
        "format": FORMAT,
        "model": "fitted",
        "method": repr(method),
        "label": label,
        "status": fit.status.value,
        "notes": list(fit.notes),
        "joints": list(fit.model.joints),
        "inputs": list(fit.model.inputs),
        "estimates": [
            {"name": name, "unit": unit, "value": _number(value), "standard_error": _number(error)}
            for name, unit, value, error in rows
        ],
        "covariance": [[_number(value) for value in row] for row in estimates.covariance],
        "logs": [{"name": log.name, "sha256": log.content_hash} for log in logs],
        "seed": seed,
        "versions": {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
        "parts": encoded(fit.model, type(fit.model).__name__),
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def load_model(path: Path, vocabulary: Sequence[Effect] = ()) -> Model:
    """The model of a file that `adeptone fit` or a diagnosis wrote, to simulate or invert.

    vocabulary: effects for an extended model that holds one of a plugin file. A model of a plugin's own class needs the
    plugin installed, or loaded with `METHODS.load_path` before. Raises MethodError when the file is no such model.
    """
    text = Path(path).read_text(encoding="utf-8")
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise MethodError(f"{path} is no JSON ({error})", remedy="Give a file that adeptone wrote") from None
    kind = content.get("model") if isinstance(content, dict) else None
    if kind == "structured":
        from methods.structured import StructuredModel

        return StructuredModel.from_json(text, vocabulary)
    if kind != "fitted" or content.get("format") != FORMAT:
        raise MethodError(
            f"{path} is no model file of format {FORMAT}", remedy="Give a model.json of adeptone fit, or fit again"
        )
    model = decoded(content.get("parts"))
    if not isinstance(model, Model):
        raise MethodError(f"the parts of {path} are no model", remedy="Fit again")
    return model


def encoded(item: Any, place: str) -> Any:
    """JSON of a model's part; `place` says in an error where it stands."""
    if item is None or isinstance(item, bool | str):
        return item
    if isinstance(item, np.ndarray):
        if item.dtype.kind not in "fiub":
            raise _unwritable(f"an array of {item.dtype}", place)
        return {"array": _nested(item.tolist()), "dtype": str(item.dtype), "shape": list(item.shape)}
    if isinstance(item, np.generic):
        return encoded(item.item(), place)
    if isinstance(item, int | float):
        value = _plain(item)
        return {"number": value} if isinstance(value, str) else value
    if isinstance(item, tuple | list):
        values = [encoded(value, f"{place}[{k}]") for k, value in enumerate(item)]
        return {"tuple": values} if isinstance(item, tuple) else values
    if isinstance(item, Mapping) and all(isinstance(key, str) for key in item):
        return {"mapping": {key: encoded(value, f"{place}[{key!r}]") for key, value in item.items()}}
    if dataclasses.is_dataclass(item) and not isinstance(item, type):
        kind = type(item)
        names = [part.name for part in dataclasses.fields(item) if part.init]
        return {
            "class": f"{kind.__module__}.{kind.__qualname__}",
            "fields": {name: encoded(getattr(item, name), f"{place}.{name}") for name in names},
        }
    raise _unwritable(f"a {type(item).__name__}", place)


def decoded(item: Any) -> Any:
    """The part that `encoded` wrote. Raises MethodError for a class that is not known here."""
    if isinstance(item, list):
        return [decoded(value) for value in item]
    if not isinstance(item, dict):
        return item
    if "number" in item:
        return NOT_FINITE[item["number"]]
    if "array" in item:
        return np.array(_numbers(item["array"]), dtype=item["dtype"]).reshape(item["shape"])
    if "tuple" in item:
        return tuple(decoded(value) for value in item["tuple"])
    if "mapping" in item:
        return {key: decoded(value) for key, value in item["mapping"].items()}
    if "class" in item:
        fields = {name: decoded(value) for name, value in item["fields"].items()}
        try:
            return _class(item["class"])(**fields)
        except TypeError as error:
            raise MethodError(f"{item['class']} does not fit the file ({error})", remedy="Fit again") from None
    raise MethodError("the parts of the model file cannot be read", remedy="Fit again")


def _class(name: str) -> type:
    """A dataclass of the project's methods or of a registered plugin; nothing else is ever built from a file."""
    module_name, _, class_name = name.rpartition(".")
    if module_name.partition(".")[0] not in ROOMS:
        METHODS.load_entry_points()
    foreign = {entry.factory.__module__.partition(".")[0] for entry in METHODS}
    module = None
    if module_name.partition(".")[0] in foreign | ROOMS:
        with contextlib.suppress(ModuleNotFoundError):
            module = importlib.import_module(module_name)
    found = getattr(module, class_name, None)
    if not (isinstance(found, type) and dataclasses.is_dataclass(found)):
        raise MethodError(
            f"the model file needs {name}, which is not here", remedy="Install or load the plugin that it comes from"
        )
    return found


def _unwritable(what: str, place: str) -> MethodError:
    return MethodError(
        f"this model cannot be written to a file: {place} is {what}",
        remedy="Let the model be a dataclass of numbers, text, arrays, tuples, mappings and other dataclasses",
    )


def _plain(value: float) -> float | str:
    """A number, or the word for one that is not finite."""
    if isinstance(value, float) and not math.isfinite(value):
        return next(word for word, number in NOT_FINITE.items() if str(value) == str(number))
    return value


def _nested(values: Any) -> Any:
    return [_nested(value) for value in values] if isinstance(values, list) else _plain(values)


def _numbers(values: Any) -> Any:
    if isinstance(values, list):
        return [_numbers(value) for value in values]
    return NOT_FINITE[values] if isinstance(values, str) else values


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
