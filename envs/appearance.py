"""What an AdeptOne looks like: massless shapes for MuJoCo, floor, lights and camera. Nothing here acts on a motion."""

from __future__ import annotations

import mujoco

IVORY = [0.90, 0.87, 0.78, 1.0]
GRAPHITE = [0.16, 0.17, 0.19, 1.0]
STEEL = [0.72, 0.74, 0.77, 1.0]
SIGNAL_RED = [0.78, 0.12, 0.10, 1.0]

CAMERA = "overview"
"""Name of the camera that shows the entire arm."""

_BOX, _CYLINDER, _CAPSULE = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE


def dress_scara(spec: mujoco.MjSpec, length_1: float, length_2: float) -> None:
    """Gives bodies base, link_1, link_2 and quill their shapes and the world a floor, lights and a camera."""
    _add_surroundings(spec)
    base, link_1, link_2, quill = (spec.body(name) for name in ("base", "link_1", "link_2", "quill"))

    floor = -float(base.pos[2])
    _upright(base, "mounting_plate", (0.0, 0.0), (floor, floor + 0.03), 0.22, GRAPHITE)
    _upright(base, "column", (0.0, 0.0), (floor + 0.03, -0.16), 0.135, IVORY)
    _upright(base, "shoulder_motor", (0.0, 0.0), (-0.16, -0.05), 0.155, GRAPHITE)
    _box(base, "connector_panel", (-0.16, 0.0, floor + 0.16), (0.04, 0.09, 0.11), GRAPHITE)

    _arm(link_1, "inner", length_1, (-0.05, 0.055), 0.14, 0.115)
    _box(link_1, "inner_badge", (0.5 * length_1, 0.0, 0.056), (0.11, 0.03, 0.001), GRAPHITE)
    _upright(link_1, "elbow_bearing", (length_1, 0.0), (0.055, 0.07), 0.09, GRAPHITE)

    _arm(link_2, "outer", length_2, (-0.045, 0.045), 0.115, 0.075)
    _box(link_2, "wrist_cover", (0.62 * length_2, 0.0, 0.10), (0.15, 0.062, 0.06), IVORY)
    _box(link_2, "wrist_badge", (0.62 * length_2, 0.0, 0.161), (0.09, 0.03, 0.001), SIGNAL_RED)
    _upright(link_2, "quill_housing", (length_2, 0.0), (-0.08, 0.30), 0.055, GRAPHITE)
    _upright(link_2, "quill_cap", (length_2, 0.0), (0.30, 0.315), 0.045, STEEL)

    _upright(quill, "quill_shaft", (0.0, 0.0), (-0.15, 0.28), 0.021, STEEL)
    _upright(quill, "tool_flange", (0.0, 0.0), (-0.165, -0.15), 0.045, GRAPHITE)
    _box(quill, "tool_finger", (0.03, 0.0, -0.20), (0.008, 0.014, 0.035), SIGNAL_RED)
    _box(quill, "tool_thumb", (-0.03, 0.0, -0.20), (0.008, 0.014, 0.035), STEEL)
    quill.sites[0].pos = [0.0, 0.0, -0.235]


def _add_surroundings(spec: mujoco.MjSpec) -> None:
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.35] * 3, [0.35] * 3
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
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
        rgb1=[0.80, 0.81, 0.82],
        rgb2=[0.74, 0.75, 0.77],
        width=256,
        height=256,
    )
    material = spec.add_material(name="floor", texrepeat=[8, 8], reflectance=0.05)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    world = spec.worldbody
    world.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[3.0, 3.0, 0.1], material="floor")
    world.add_light(name="lamp", pos=[1.5, -1.5, 3.0], dir=[-0.4, 0.4, -0.9], diffuse=[0.5] * 3, castshadow=True)
    world.add_camera(
        name=CAMERA,
        pos=[1.35, -1.75, 1.55],
        fovy=38.0,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY,
        targetbody="base",
    )


def _arm(body: mujoco.MjsBody, name: str, length: float, span: tuple[float, float], root: float, tip: float) -> None:
    """A flat arm with rounded ends, `root` and `tip` wide, between the heights of `span`."""
    _upright(body, f"{name}_root", (0.0, 0.0), span, root, IVORY)
    _upright(body, f"{name}_tip", (length, 0.0), span, tip, IVORY)
    middle, half = 0.5 * (span[0] + span[1]), 0.5 * (span[1] - span[0])
    _box(body, f"{name}_beam", (0.5 * length, 0.0, middle), (0.5 * length, 0.85 * tip, half), IVORY)


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
