"""What an AdeptOne looks like: massless shapes for MuJoCo, floor, lights and camera. Nothing here acts on a motion."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np

IVORY = [0.90, 0.87, 0.78, 1.0]
GRAPHITE = [0.16, 0.17, 0.19, 1.0]
STEEL = [0.72, 0.74, 0.77, 1.0]
SIGNAL_RED = [0.78, 0.12, 0.10, 1.0]

CAMERA = "overview"
"""Name of the camera that shows the entire arm."""
CAMERA_POSITION = (1.35, -1.95, 1.60)
CAMERA_TARGET = (0.16, 0.0, 0.58)

_BOX, _CYLINDER, _CAPSULE = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE


def dress_scara(spec: mujoco.MjSpec, length_1: float, length_2: float) -> None:
    """Gives bodies base, link_1, link_2 and quill their shapes and the world a floor, lights and a camera."""
    _add_surroundings(spec)
    base, link_1, link_2, quill = (spec.body(name) for name in ("base", "link_1", "link_2", "quill"))

    floor = -float(base.pos[2])
    _upright(base, "mounting_plate", (0.0, 0.0), (floor, floor + 0.03), 0.22, GRAPHITE)
    _upright(base, "column", (0.0, 0.0), (floor + 0.03, -0.16), 0.135, IVORY)
    _upright(base, "shoulder_motor", (0.0, 0.0), (-0.16, -0.06), 0.155, GRAPHITE)
    _box(base, "connector_panel", (-0.14, 0.0, floor + 0.20), (0.04, 0.09, 0.14), GRAPHITE)

    _arm(link_1, "inner", length_1, (-0.05, 0.055), 0.14, 0.115)
    _box(link_1, "inner_badge", (0.5 * length_1, 0.0, 0.05), (0.07, 0.03, 0.001), GRAPHITE)
    _upright(link_1, "elbow_bearing", (length_1, 0.0), (0.055, 0.07), 0.09, GRAPHITE)

    _arm(link_2, "outer", length_2, (-0.045, 0.045), 0.115, 0.075)
    _box(link_2, "wrist_cover", (0.66 * length_2, 0.0, 0.09), (0.125, 0.062, 0.055), IVORY)
    _box(link_2, "wrist_badge", (0.66 * length_2, 0.0, 0.145), (0.07, 0.012, 0.001), SIGNAL_RED)
    _conduit(link_2, (0.0, 0.0, 0.045), (0.45 * length_2, 0.0, 0.145), 0.16)
    _upright(link_2, "quill_housing", (length_2, 0.0), (-0.08, 0.30), 0.055, GRAPHITE)
    _upright(link_2, "quill_cap", (length_2, 0.0), (0.30, 0.315), 0.045, STEEL)

    _upright(quill, "quill_shaft", (0.0, 0.0), (-0.15, 0.28), 0.021, STEEL)
    _upright(quill, "tool_flange", (0.0, 0.0), (-0.165, -0.15), 0.045, GRAPHITE)
    _box(quill, "tool_finger", (0.03, 0.0, -0.20), (0.008, 0.014, 0.035), SIGNAL_RED)
    _box(quill, "tool_thumb", (-0.03, 0.0, -0.20), (0.008, 0.014, 0.035), STEEL)
    quill.sites[0].pos = [0.0, 0.0, -0.235]


def _add_surroundings(spec: mujoco.MjSpec) -> None:
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.42] * 3, [0.38] * 3
    spec.visual.quality.shadowsize = 4096
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.96, 0.97, 0.98],
        rgb2=[0.78, 0.82, 0.87],
        width=256,
        height=256,
    )
    spec.add_texture(
        name="floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.93, 0.93, 0.94],
        rgb2=[0.87, 0.88, 0.90],
        width=256,
        height=256,
    )
    material = spec.add_material(name="floor", texrepeat=[20, 20])
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    world = spec.worldbody
    world.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[10.0, 10.0, 0.1], material="floor")
    world.add_light(
        name="lamp",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[1.0, -1.5, 3.0],
        dir=[-0.3, 0.45, -0.85],
        diffuse=[0.55] * 3,
        castshadow=True,
    )
    world.add_camera(
        name=CAMERA,
        pos=CAMERA_POSITION,
        quat=_looking_at(np.array(CAMERA_POSITION), np.array(CAMERA_TARGET)),
        fovy=34.0,
    )


def _looking_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Orientation of a camera (it looks along its -z, y is up) as a quaternion, shape (4,)."""
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.column_stack([right, np.cross(back, right), back]).ravel())
    return quaternion


def _arm(body: mujoco.MjsBody, name: str, length: float, span: tuple[float, float], root: float, tip: float) -> None:
    """A flat arm with rounded ends, `root` and `tip` wide, between the heights of `span`."""
    _upright(body, f"{name}_root", (0.0, 0.0), span, root, IVORY)
    _upright(body, f"{name}_tip", (length, 0.0), span, tip, IVORY)
    middle, half = 0.5 * (span[0] + span[1]), 0.5 * (span[1] - span[0])
    # A little thinner than the ends: coinciding faces flicker.
    _box(body, f"{name}_beam", (0.5 * length, 0.0, middle), (0.5 * length, 0.97 * tip, half - 0.006), IVORY)


def _conduit(
    body: mujoco.MjsBody, start: tuple[float, float, float], end: tuple[float, float, float], rise: float
) -> None:
    """The cable hose: an arch between two points that stands `rise` above them."""
    share = np.linspace(0.0, 1.0, 13)[:, None]
    points = (1.0 - share) * np.array(start) + share * np.array(end)
    points[:, 2] += rise * 4.0 * share[:, 0] * (1.0 - share[:, 0])
    for piece, (one, other) in enumerate(itertools.pairwise(points)):
        geom = body.add_geom(name=f"conduit_{piece}", type=_CAPSULE, rgba=GRAPHITE, mass=0.0)
        geom.fromto, geom.size = np.concatenate([one, other]), [0.016, 0.0, 0.0]
        geom.contype = geom.conaffinity = 0


def _upright(
    body: mujoco.MjsBody,
    name: str,
    centre: tuple[float, float],
    span: tuple[float, float],
    radius: float,
    colour: list[float],
) -> None:
    """A vertical cylinder between two heights."""
    _shape(
        body, name, _CYLINDER, (*centre, 0.5 * (span[0] + span[1])), (radius, 0.5 * (span[1] - span[0]), 0.0), colour
    )


def _box(
    body: mujoco.MjsBody,
    name: str,
    centre: tuple[float, float, float],
    half: tuple[float, float, float],
    colour: list[float],
) -> None:
    _shape(body, name, _BOX, centre, half, colour)


def _shape(
    body: mujoco.MjsBody,
    name: str,
    kind: mujoco.mjtGeom,
    centre: tuple[float, float, float],
    size: tuple[float, float, float],
    colour: list[float],
) -> None:
    body.add_geom(name=name, type=kind, pos=centre, size=size, rgba=colour, mass=0.0, contype=0, conaffinity=0)
