"""The process that draws for `envs.rendering`: reads a robot, answers poses with pixels, ends with its input.

Protocol on standard input and output: in, one pickle (robot, width, height, camera); out, one pickle, None or the
reason why nothing can be drawn; then, for each pose of n doubles, height * width * 3 bytes.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from typing import IO

import mujoco
import numpy as np

from envs.appearance import CAMERA
from envs.log import Array
from envs.mjcf import robot_spec
from envs.robot import Robot


def serve(requests: IO[bytes], replies: IO[bytes]) -> None:
    """Draws until `requests` ends."""
    robot, width, height, camera = pickle.load(requests)
    try:
        draw = _artist(robot, width, height, camera)
        draw(np.zeros(len(robot)))
    except Exception as error:  # whatever the graphics driver raises becomes the reason
        pickle.dump(" ".join(str(error).split()) or type(error).__name__, replies)
        return
    pickle.dump(None, replies)
    replies.flush()
    while pose := requests.read(8 * len(robot)):
        replies.write(draw(np.frombuffer(pose)))
        replies.flush()


def _artist(robot: Robot, width: int, height: int, camera: str | None) -> Callable[[Array], bytes]:
    spec = robot_spec(robot)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    model = spec.compile()
    data = mujoco.MjData(model)
    columns = [int(model.joint(joint.name).qposadr[0]) for joint in robot.joints]
    renderer = mujoco.Renderer(model, height, width)
    names = [model.camera(number).name for number in range(model.ncam)]
    view = camera or (CAMERA if CAMERA in names else -1)

    def draw(position: Array) -> bytes:
        data.qpos[columns] = position
        mujoco.mj_forward(model, data)
        renderer.update_scene(data, view)
        return bytes(np.ascontiguousarray(renderer.render()))

    return draw


if __name__ == "__main__":
    serve(sys.stdin.buffer, sys.stdout.buffer)
