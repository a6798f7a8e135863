"""Named suites: which tasks, which methods, which seeds. Importing this file imports every task and every method."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.tasks.base import TASKS, load_tasks
from methods.registry import METHODS


@dataclass(frozen=True)
class Suite:
    """A product of tasks, methods and seeds; see `benchmarks.runner.run`."""

    name: str
    title: str
    tasks: tuple[str, ...]
    methods: tuple[str, ...]
    seeds: tuple[int, ...]


load_tasks()
METHODS.load_package("methods")
METHODS.load_entry_points()

QUICK_TASKS = (
    "joint1_clean",
    "joint1_paper_effects",
    "joint1_noise_high",
    "pair_coulomb_friction",
    "rotor_cogging_torque",
)
"""One of each kind; none that needs recordings which may be absent."""
QUICK_METHODS = (
    "constant",
    "huber",
    "idim_iv",
    "idim_ls",
    "kalman_filter",
    "least_squares",
    "output_error",
    "total_least_squares",
    "whole_arm",
)
"""Those that take less than a second of processor time per fit, and the one that takes several joints."""

SUITES: dict[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite("quick", "A task of each kind and the fast methods, two seeds", QUICK_TASKS, QUICK_METHODS, (0, 1)),
        Suite("full", "Every task, every method, five seeds", TASKS.names(), METHODS.names(), (0, 1, 2, 3, 4)),
    )
}
