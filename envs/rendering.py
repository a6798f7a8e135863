"""Pictures of a robot without a screen.

MuJoCo draws through OpenGL. Unless ``MUJOCO_GL`` chooses, EGL is tried first and OSMesa second, each in a process of
its own, since a failed attempt spoils the process for the other.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from envs.appearance import CAMERA
from envs.log import Array
from envs.mjcf import robot_spec
from envs.robot import Robot

Image = NDArray[np.uint8]

_PROBE = "from mujoco.{0} import GLContext; GLContext(8, 8).make_current()"


class RenderingError(RuntimeError):
    """No picture can be drawn on this machine; the message says what to install."""


class RobotRenderer:
    """Draws one robot in any pose. Free the graphics memory by `close`.

    Raises RenderingError when the machine has no OpenGL.
    """

    def __init__(self, robot: Robot, *, width: int = 640, height: int = 480, camera: str = CAMERA):
        self._model = robot_spec(robot).compile()
        self._data = mujoco.MjData(self._model)
        self._columns = [int(self._model.joint(joint.name).qposadr[0]) for joint in robot.joints]
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = self._model.camera(camera).id
        self._option = mujoco.MjvOption()
        self._scene = mujoco.MjvScene(self._model, maxgeom=1000)
        self._graphics = _graphics_context()(width, height)
        self._graphics.make_current()
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_resizeOffscreen(width, height, self._context)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)

    def render(self, position: Array) -> Image:
        """The robot at joint coordinates `position`, shape (n,), as an RGB picture, shape (height, width, 3)."""
        self._graphics.make_current()
        self._data.qpos[self._columns] = position
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        mujoco.mjr_render(self._rectangle, self._scene, self._context)
        picture = np.empty((self._rectangle.height, self._rectangle.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(picture, None, self._rectangle, self._context)
        return np.ascontiguousarray(picture[::-1])

    def close(self) -> None:
        """Frees the graphics memory."""
        self._graphics.make_current()
        self._context.free()
        self._graphics.free()


def render_robot(robot: Robot, position: Array, *, width: int = 640, height: int = 480) -> Image:
    """One picture of a robot at joint coordinates `position`, shape (n,): RGB, shape (height, width, 3)."""
    renderer = RobotRenderer(robot, width=width, height=height)
    try:
        return renderer.render(position)
    finally:
        renderer.close()


@cache
def _graphics_context() -> Callable[[int, int], Any]:
    if platform.system() != "Linux":
        return mujoco.GLContext
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    if chosen == "osmesa" or (chosen != "egl" and not _draws("egl")):
        if not _draws("osmesa"):
            raise RenderingError("no OpenGL on this machine. Install libegl1 or libosmesa6, or choose by MUJOCO_GL")
        os.environ["PYOPENGL_PLATFORM"] = "osmesa"
        from mujoco.osmesa import GLContext

        return GLContext
    from mujoco.egl import GLContext

    return GLContext


def _draws(backend: str) -> bool:
    """Whether a backend gives a context; tried in another process."""
    environment = {**os.environ, "MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend}
    attempt = subprocess.run(
        [sys.executable, "-c", _PROBE.format(backend)], env=environment, capture_output=True, timeout=60, check=False
    )
    return attempt.returncode == 0
