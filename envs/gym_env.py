"""The robot as a gymnasium environment: reach a target pose by the voltages of the servo commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from envs.adeptone import adeptone
from envs.simulator import KernelSimulator, Simulator

if TYPE_CHECKING:
    from envs.rendering import Image, RobotRenderer

Observation = NDArray[np.float32]

SUCCESS_BONUS = 1.0
"""Reward per step within tolerance of the target."""


class AdeptOneEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """Reach a target pose of the joints that move.

    Action, shape (k,): command of each of the k moving joints [command units, DAC volts on the AdeptOne].
    Observation, shape (3 k,): what the sensors give of these joints and what is asked of them; encoder position
    [rad or m], its difference over the last action divided by the time [rad/s or m/s], target position [rad or m].
    Reward: ``-mean |q - q_target| / (upper - lower)``, and SUCCESS_BONUS while every joint is within tolerance.
    An episode ends by time (truncated), never by success: the pose is to be held.

    simulator: what moves, any `envs.simulator.Simulator`; None is the nominal AdeptOne at 1 kHz.
    joints: those that move where no simulator is given; brakes hold the others.
    periods: servo periods per action. duration: of an episode [s].
    reach: share of each joint's range, about its middle, in which episodes start and targets lie.
    tolerance: of success, as a share of the joint's range.
    render_mode: None or "rgb_array". width, height: of the picture [pixels].

    `reset(options=...)` takes "position" and "target" of the moving joints, shape (k,). `info` holds "success".
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012  gymnasium's form

    def __init__(
        self,
        simulator: Simulator | None = None,
        *,
        joints: Sequence[int] = (1, 2, 3, 4),
        periods: int = 1,
        duration: float = 2.0,
        reach: float = 0.8,
        tolerance: float = 0.01,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
    ):
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode is {render_mode!r}. Choose None or 'rgb_array'")
        if simulator is None:
            robot = adeptone()
            for number in joints:
                robot.joint(number)
            held = [number for number in range(1, len(robot) + 1) if number not in joints]
            simulator = KernelSimulator(robot, held=held)
        self.simulator = simulator
        self.render_mode = render_mode
        self._size = (width, height)
        self._renderer: RobotRenderer | None = None
        self._periods = periods
        self._steps = max(1, round(duration / (periods * simulator.sample_time)))
        self._reach, self._tolerance = reach, tolerance

        robot = simulator.robot
        self._moving = [row for row in range(len(robot)) if row + 1 not in simulator.held]
        if not self._moving:
            raise ValueError("every joint is held. Leave at least one free")
        self._lower = np.array([joint.lower.value for joint in robot.joints])
        self._upper = np.array([joint.upper.value for joint in robot.joints])
        limit = robot.drive_values("command_limit")[self._moving].astype(np.float32)
        self.action_space = gymnasium.spaces.Box(-limit, limit, dtype=np.float32)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3 * len(self._moving),), dtype=np.float32)
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / (periods * simulator.sample_time)))}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts an episode at rest; start and target are drawn unless `options` gives them."""
        super().reset(seed=seed)
        options = options or {}
        start = 0.5 * (self._lower + self._upper)
        start[self._moving] = self._draw(options.get("position"))
        self._target = self._draw(options.get("target"))
        self._elapsed = 0
        self._position = self.simulator.reset(start, self.np_random)
        return self._observe(self._position), {"success": self._success()}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Holds the action for the chosen number of servo periods."""
        command = np.zeros(len(self.simulator.robot))
        command[self._moving] = action
        before, self._position = self._position, self.simulator.step(command, self._periods)
        self._elapsed += 1
        success = self._success()
        reward = -float(np.mean(self._error())) + SUCCESS_BONUS * success
        return self._observe(before), reward, False, self._elapsed >= self._steps, {"success": success}

    def render(self) -> Image | None:
        """The robot in the pose last measured, shape (height, width, 3). Raises RenderingError without OpenGL."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            from envs.rendering import RobotRenderer

            self._renderer = RobotRenderer(self.simulator.robot, width=self._size[0], height=self._size[1])
        return self._renderer.render(self._position)

    def close(self) -> None:
        """Frees the graphics memory."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _draw(self, given: Any) -> NDArray[np.float64]:
        if given is not None:
            return np.asarray(given, dtype=np.float64).reshape(len(self._moving))
        share = 0.5 + 0.5 * self._reach * self.np_random.uniform(-1.0, 1.0, len(self._moving))
        lower, upper = self._lower[self._moving], self._upper[self._moving]
        return lower + share * (upper - lower)

    def _error(self) -> NDArray[np.float64]:
        """Distance from the target as a share of each joint's range, shape (k,)."""
        span = (self._upper - self._lower)[self._moving]
        return np.abs(self._position[self._moving] - self._target) / span

    def _success(self) -> bool:
        return bool(np.all(self._error() <= self._tolerance))

    def _observe(self, before: NDArray[np.float64]) -> Observation:
        now = self._position[self._moving]
        velocity = (now - before[self._moving]) / (self._periods * self.simulator.sample_time)
        return np.concatenate([now, velocity, self._target]).astype(np.float32)
