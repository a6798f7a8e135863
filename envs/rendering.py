"""Pictures of a robot without a screen.

MuJoCo draws through OpenGL in a process of its own (`envs.rendering_process`): software drivers bring a compiler that
crashes together with those of numba and torch, and a backend that failed spoils its process for the next one. Unless
``MUJOCO_GL`` chooses, EGL is tried first and OSMesa second.
"""

from __future__ import annotations

import os
import pickle
import platform
import subprocess
import sys
import weakref
from pathlib import Path
from typing import IO, cast

import numpy as np
from numpy.typing import NDArray

from envs.log import Array
from envs.robot import Robot

Image = NDArray[np.uint8]

_ROOT = str(Path(__file__).resolve().parents[1])


class RenderingError(RuntimeError):
    """No picture can be drawn on this machine; the message says why and what to install."""


class RobotRenderer:
    """Draws one robot in any pose; end its process by `close`.

    robot: what is drawn. width, height: of the picture [pixels]. camera: a name in the robot's model; None is the one
    that shows the entire AdeptOne, or MuJoCo's free camera where the model has no such camera.

    Raises RenderingError when the machine has no OpenGL.
    """

    def __init__(self, robot: Robot, *, width: int = 640, height: int = 480, camera: str | None = None):
        self._shape = (height, width, 3)
        order = pickle.dumps((robot, width, height, camera))
        reasons = []
        for backend in _backends():
            process, reason = _start(order, backend)
            if process is not None:
                self._process = process
                self.close = weakref.finalize(self, _stop, process)
                """Ends the drawing process; further calls do nothing."""
                return
            reasons.append(f"{backend}: {reason}")
        raise RenderingError(
            f"no picture ({'; '.join(reasons)}). Install libegl1 or libosmesa6, or choose by MUJOCO_GL"
        )

    def render(self, position: Array) -> Image:
        """The robot at joint coordinates `position`, shape (n,), as an RGB picture, shape (height, width, 3)."""
        request, reply = cast(IO[bytes], self._process.stdin), cast(IO[bytes], self._process.stdout)
        try:
            request.write(np.asarray(position, dtype=np.float64).tobytes())
            request.flush()
            pixels = reply.read(int(np.prod(self._shape)))
        except (BrokenPipeError, ValueError):
            pixels = b""
        if len(pixels) != np.prod(self._shape):
            raise RenderingError("the drawing process has ended. Make a new renderer")
        return np.frombuffer(pixels, dtype=np.uint8).reshape(self._shape)


def render_robot(robot: Robot, position: Array, *, width: int = 640, height: int = 480) -> Image:
    """One picture of a robot at joint coordinates `position`, shape (n,): RGB, shape (height, width, 3)."""
    renderer = RobotRenderer(robot, width=width, height=height)
    try:
        return renderer.render(position)
    finally:
        renderer.close()


def _backends() -> tuple[str, ...]:
    chosen = os.environ.get("MUJOCO_GL")
    if chosen:
        return (chosen,)
    return ("egl", "osmesa") if platform.system() == "Linux" else ("glfw",)


def _start(order: bytes, backend: str) -> tuple[subprocess.Popen[bytes] | None, str]:
    """A process that is ready to draw, or None and the reason."""
    path = os.pathsep.join([_ROOT, *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "MUJOCO_GL": backend, "PYTHONPATH": path}
    environment.pop("PYOPENGL_PLATFORM", None)
    process = subprocess.Popen(
        [sys.executable, "-m", "envs.rendering_process"],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    request, reply = cast(IO[bytes], process.stdin), cast(IO[bytes], process.stdout)
    try:
        request.write(order)
        request.flush()
        reason = pickle.load(reply)
    except (BrokenPipeError, EOFError, pickle.UnpicklingError):
        reason = "the drawing process died"
    if reason is None:
        return process, ""
    _stop(process)
    return None, str(reason)


def _stop(process: subprocess.Popen[bytes]) -> None:
    # The process ends when its standard input does.
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
    process.wait()
