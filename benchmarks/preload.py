"""Imported once by the server that children are forked from: every method of the project.

Nothing that knows a truth is imported here: what stands in this process, a contestant inherits.
"""

import benchmarks.worker  # noqa: F401
from methods.registry import METHODS

METHODS.load_package("methods")
