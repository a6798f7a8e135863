"""Named suites: which tasks, which methods, which seeds. Importing this file imports every task and every method."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.tasks.base import TASKS, load_tasks
from methods.registry import METHODS


@dataclass(frozen=True)
class Suite:
    """A product of tasks, methods and seeds; see `benchmarks.runner.run`.

    reference_seeds: how many seeds a reference of it has; its own, and further ones up to this number.
    """

    name: str
    title: str
    tasks: tuple[str, ...]
    methods: tuple[str, ...]
    seeds: tuple[int, ...]
    reference_seeds: int = 10


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

FULL_TASKS = (
    "joint1_clean",
    "joint1_noise_high",
    "joint1_coulomb_friction",
    "joint1_paper_effects",
    "joint1_joint_flexibility",
    "joint1_thermal_drift",
    "joint1_excited_by_servo",
    "joint1_beyond_amplitude",
    "joint1_beyond_payload",
    "joint2_cable_spring",
    "joint2_payload_change",
    "joint3_stribeck_friction",
    "joint4_encoder_eccentricity",
    "pair_coupled",
    "arm_coulomb_friction",
    "servo_stribeck_friction",
    "pendulum_coulomb_friction",
    "rotor_cogging_torque",
    "stage_backlash",
    "emps",
    "xl330",
    "odrive_cogging",
    "dfki_double_pendulum",
)
"""One of every kind: machines, hidden effects by stage of the chain, noise, excitation, extrapolation, real ones."""
NAMING_TASKS = tuple(name for name in TASKS.names() if name.startswith("naming_"))
NAMING_METHODS = (
    "constant",
    "diagnosis",
    "ensemble_sindy",
    "huber",
    "idim_iv",
    "idim_ls",
    "sindy",
    "total_least_squares",
    "weak_sindy",
    "weighted_ls",
)
"""Those that name causes, and the floor, which names nothing."""

EVERY_SEED = (0, 1, 2, 3, 4)
SUITES: dict[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite("quick", "A task of each kind and the fast methods, two seeds", QUICK_TASKS, QUICK_METHODS, (0, 1)),
        Suite(
            "full",
            "One task of every kind, every method but the diagnosis, three seeds",
            FULL_TASKS,
            tuple(name for name in METHODS.names() if name != "diagnosis"),
            (0, 1, 2),
            reference_seeds=5,
        ),
        Suite(
            "naming", "What is hidden? Ten blind trials of every kind", NAMING_TASKS, NAMING_METHODS, tuple(range(10))
        ),
        Suite("everything", "Every task, every method, five seeds", TASKS.names(), METHODS.names(), EVERY_SEED),
    )
}
