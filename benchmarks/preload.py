"""Imported once by the server that children are forked from: every method, and the libraries that start slowly.

Nothing that knows a truth is imported here: what stands in this process, a contestant inherits.
"""

import contextlib
import importlib

from methods.registry import METHODS

METHODS.load_package("methods")
for name in ("torch", "pysindy", "mujoco"):
    with contextlib.suppress(ImportError):
        importlib.import_module(name)
