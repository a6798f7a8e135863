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
    "joint1_beyond_amplitude",
    "joint3_clean",
    "joint4_stribeck_friction",
    "pair_coulomb_friction",
    "rotor_cogging_torque",
    "emps",
)
"""One of each kind."""
SLOW_METHODS = ("mujoco_sysid",)

SUITES: dict[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite(
            "quick",
            "One task of each kind, two seeds, without the slowest methods; three minutes on two cores",
            QUICK_TASKS,
            tuple(name for name in METHODS.names() if name not in SLOW_METHODS),
            (0, 1),
        ),
        Suite("full", "Every task, every method, five seeds", TASKS.names(), METHODS.names(), (0, 1, 2, 3, 4)),
    )
}
