"""A robot in MuJoCo as a `envs.simulator.Simulator`: the nominal model or any edited one."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from envs.log import Array
from envs.mjcf import robot_spec
from envs.robot import Robot

_BRAKE_INERTIA = 1e9
"""Inertia of a joint whose brake is closed [kg m^2 or kg]: it moves by less than one part in 10^9 of a free one."""


class MujocoSimulator:
    """MuJoCo with quantised commands and encoders.

    robot: what the controller knows. spec: what is simulated, an edited result of `envs.mjcf.robot_spec`; None is the
    nominal robot. Its actuators and joints carry the names of the robot's joints; its timestep divides the servo
    period. held: brakes that are closed; they hold the joints where `reset` puts them.

    Raises ValueError when the timestep does not divide the servo period.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        spec: mujoco.MjSpec | None = None,
        sample_time: float = 1e-3,
        held: Sequence[int] = (),
    ):
        self.robot, self.sample_time, self.held = robot, sample_time, tuple(held)
        self._model = (robot_spec(robot, timestep=sample_time, scenery=False) if spec is None else spec).compile()
        ratio = sample_time / self._model.opt.timestep
        if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-9 * ratio:
            raise ValueError(
                f"the timestep {self._model.opt.timestep} s does not divide the servo period {sample_time} s. "
                "Choose a timestep that does"
            )
        self._substeps = round(ratio)
        for number in self.held:
            self._model.dof_armature[self._model.joint(robot.joint(number).name).dofadr[0]] = _BRAKE_INERTIA
        self._data = mujoco.MjData(self._model)
        mujoco.mj_setConst(self._model, self._data)
        names = [joint.name for joint in robot.joints]
        self._columns = [int(self._model.joint(name).qposadr[0]) for name in names]
        self._motors = [int(self._model.actuator(name).id) for name in names]
        self._gains = robot.drive_values("amplifier_gain")

    def reset(self, position: Array, rng: np.random.Generator) -> Array:
        """At rest at `position`; MuJoCo has nothing random."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[self._columns] = position
        mujoco.mj_forward(self._model, self._data)
        return self.robot.measure(self._data.qpos[self._columns])

    def step(self, command: Array, periods: int = 1) -> Array:
        """Holds `command` for some servo periods."""
        self._data.ctrl[self._motors] = self.robot.quantise(command) * self._gains
        mujoco.mj_step(self._model, self._data, nstep=periods * self._substeps)
        return self.robot.measure(self._data.qpos[self._columns])
