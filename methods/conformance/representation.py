"""From a repr back to the specification, without `eval`: nested calls with keywords, and literals."""

from __future__ import annotations

import ast
import dataclasses
from typing import Any


def rebuilt(text: str, example: object) -> Any:
    """The object that `text` describes, built from the dataclasses that `example` consists of.

    Raises ValueError when the text is anything but calls of these classes with literal keyword arguments.
    """
    classes: dict[str, type] = {}
    _collect(example, classes)
    try:
        tree = ast.parse(text, mode="eval")
    except SyntaxError:
        raise ValueError(f"{text[:100]!r} is no Python expression") from None
    return _value(tree.body, classes)


def _collect(item: object, classes: dict[str, type]) -> None:
    if dataclasses.is_dataclass(item) and not isinstance(item, type):
        classes[type(item).__qualname__] = type(item)
        for part in dataclasses.fields(item):
            _collect(getattr(item, part.name), classes)
    elif isinstance(item, tuple | list | frozenset):
        for value in item:
            _collect(value, classes)
    elif isinstance(item, dict):
        for value in item.values():
            _collect(value, classes)


def _value(node: ast.expr, classes: dict[str, type]) -> Any:
    if isinstance(node, ast.Call) and not node.args:
        name = ast.unparse(node.func)
        if name not in classes:
            raise ValueError(f"{name} is no dataclass of the method")
        return classes[name](**{str(keyword.arg): _value(keyword.value, classes) for keyword in node.keywords})
    if isinstance(node, ast.Tuple):
        return tuple(_value(item, classes) for item in node.elts)
    if isinstance(node, ast.List):
        return [_value(item, classes) for item in node.elts]
    if isinstance(node, ast.Dict) and None not in node.keys:
        keys = [_value(key, classes) for key in node.keys if key is not None]
        return dict(zip(keys, (_value(value, classes) for value in node.values), strict=True))
    if isinstance(node, ast.Name) and node.id in ("inf", "nan"):
        return float(node.id)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_value(node.operand, classes)
    if isinstance(node, ast.Constant):
        return node.value
    raise ValueError(f"{ast.unparse(node)[:60]!r} is neither a dataclass nor a literal")
