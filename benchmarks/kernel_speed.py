"""Speed of the compiled kernel against `mujoco.rollout`: same robot, batch, commands, RK4, step and threads.

    uv run python -m benchmarks.kernel_speed [--threads N] [--batch B] [--steps T] [--repeats R]

Prints steps per second of both and their ratio. Both keep every state in memory that was allocated before; the model
for MuJoCo carries no shapes and no contacts, which is its fastest form. The best of several alternating repeats
counts, since other programs on the machine only ever slow a run down.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from benchmarks.rollout import rollout, seconds
from envs.adeptone import adeptone
from envs.kernel import simulate
from envs.mjcf import robot_spec
from envs.robot import Robot

STEP = 1e-3
"""Integrator step and sampling time [s]: the servo period."""


@dataclass(frozen=True)
class Speed:
    """Steps per second [1/s] of both engines on the same number of threads."""

    threads: int
    kernel: float
    mujoco: float

    @property
    def ratio(self) -> float:
        """How many times faster the kernel is."""
        return self.kernel / self.mujoco


def measure_speed(robot: Robot, *, threads: int = 1, batch: int = 64, steps: int = 500, repeats: int = 5) -> Speed:
    """Simulates `batch` members for `steps` steps by either engine; the best of `repeats` counts."""
    command = np.random.default_rng(0).uniform(-0.5, 0.5, (batch, steps, len(robot)))
    position = np.array([0.5 * (joint.lower.value + joint.upper.value) for joint in robot.joints])

    def by_kernel() -> None:
        simulate(robot, command, STEP, position=position, threads=threads)

    model = robot_spec(robot, timestep=STEP, scenery=False).compile()
    by_mujoco = rollout(model, command * robot.drive_values("amplifier_gain"), position, threads)
    by_kernel()
    taken = [(seconds(by_kernel), seconds(by_mujoco)) for _ in range(repeats)]
    best_kernel, best_mujoco = np.min(taken, axis=0)
    return Speed(threads, kernel=batch * steps / best_kernel, mujoco=batch * steps / best_mujoco)


def main() -> None:
    """Prints the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    for name, value in (("threads", 1), ("batch", 64), ("steps", 500), ("repeats", 5)):
        parser.add_argument(f"--{name}", type=int, default=value)
    chosen = parser.parse_args()
    speed = measure_speed(
        adeptone(), threads=chosen.threads, batch=chosen.batch, steps=chosen.steps, repeats=chosen.repeats
    )
    print(f"threads {speed.threads}, RK4, step {STEP} s, batch {chosen.batch} x {chosen.steps} steps")
    print(f"kernel          {speed.kernel:14,.0f} steps/s")
    print(f"mujoco.rollout  {speed.mujoco:14,.0f} steps/s")
    print(f"ratio           {speed.ratio:14.1f}")


if __name__ == "__main__":
    main()
