"""Named suites: which tasks, which methods, which seeds."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Suite:
    """A product of tasks, methods and seeds; see `benchmarks.runner.run`."""

    name: str
    title: str
    tasks: tuple[str, ...]
    methods: tuple[str, ...]
    seeds: tuple[int, ...]


SUITES: dict[str, Suite] = {}
