"""Anybody's robot: MJCF or URDF plus a TOML for the drives becomes a Robot; an impossible one is one clear line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from envs.pinocchio_model import inverse_dynamics, pinocchio_model
from envs.robot import RobotError
from envs.robots import find_robot

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.2"/><mass value="2.0"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="10" velocity="5"/></joint>
</robot>"""
MJCF = """<mujoco><worldbody><body name="upper"><joint name="shoulder" type="hinge" axis="0 1 0"/>
  <inertial pos="0 0 -0.2" mass="2.0" diaginertia="0.03 0.03 0.03"/></body></worldbody></mujoco>"""
DRIVES = """
name = "arm"
[body]
file = "{file}"
[[joint]]
name = "shoulder"
kind = "revolute"
lower = -2.0
upper = 2.0
[joint.drive]
amplifier = "{amplifier}"
amplifier_gain = 1.0
command = "{amplifier}"
resistance = 1.2
motor_constant = 0.05
gear_ratio = 50.0
"""


def describe(folder: Path, file: str = "arm.urdf", body: str = URDF, amplifier: str = "voltage") -> str:
    (folder / file).write_text(body)
    (folder / "arm.toml").write_text(DRIVES.format(file=file, amplifier=amplifier))
    return str(folder / "arm.toml")


@pytest.mark.parametrize(("file", "body"), [("arm.urdf", URDF), ("arm.xml", MJCF)])
@pytest.mark.parametrize(("amplifier", "per_torque"), [("voltage", 1.2 / 2.5), ("current", 1 / 2.5), ("torque", 1.0)])
def test_body_and_drives(file: str, body: str, amplifier: str, per_torque: float, tmp_path: Path) -> None:
    robot = find_robot(describe(tmp_path, file, body, amplifier))
    q = np.array([0.5])
    assert robot.inertia_matrix(q) == pytest.approx(0.03 + 2.0 * 0.2**2)
    assert robot.body.bias(q, np.zeros(1)) == pytest.approx(2.0 * 9.81 * 0.2 * np.sin(0.5))
    assert robot.input_equivalent(1) == pytest.approx(per_torque)
    assert robot.facts(1).input == amplifier


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<mass value="2.0"/>', '<mass value="-2.0"/>'),
        ('iyy="0.03"', 'iyy="-0.03"'),
        ('izz="0.03"', 'izz="3.0"'),
        ('name="shoulder"', 'name="elbow"'),
        ("</robot>", ""),
    ],
)
def test_impossible_bodies(old: str, new: str, tmp_path: Path) -> None:
    path = describe(tmp_path, body=URDF.replace(old, new))
    with pytest.raises(RobotError) as caught:
        find_robot(path).inertia_matrix(np.zeros(1))
    assert "\n" not in str(caught.value)
    assert "arm." in str(caught.value)


def test_meshes_of_other_packages_are_left_out(tmp_path: Path) -> None:
    mesh = '<geometry><mesh filename="package://arm_description/upper.stl"/></geometry>'
    ball = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    shapes = f"<visual>{mesh}</visual><collision>{mesh}</collision>{ball}</link>"
    robot = find_robot(describe(tmp_path, body=URDF.replace("</inertial></link>", f"</inertial>{shapes}")))
    assert robot.inertia_matrix(np.array([0.5])) == pytest.approx(0.03 + 2.0 * 0.2**2)


SHARED = """
name = "arm"
[body]
file = "{file}"
[drive]
amplifier = "torque"
command = "torque"
"""


@pytest.mark.parametrize(("file", "body"), [("arm.urdf", URDF), ("arm.xml", MJCF)])
def test_joints_are_those_of_the_file_where_none_is_described(file: str, body: str, tmp_path: Path) -> None:
    (tmp_path / file).write_text(body)
    (tmp_path / "arm.toml").write_text(SHARED.format(file=file))
    robot = find_robot(str(tmp_path / "arm.toml"))
    assert [(joint.name, joint.kind) for joint in robot.joints] == [("shoulder", "revolute")]
    assert robot.joint(1).upper.value == (2.0 if file == "arm.urdf" else np.inf)
    assert robot.input_equivalent(1) == 1.0


def test_a_free_base_is_refused(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(MJCF.replace('type="hinge" axis="0 1 0"', 'type="free"'))
    (tmp_path / "arm.toml").write_text(SHARED.format(file="arm.xml"))
    with pytest.raises(RobotError, match="neither a hinge nor a slide"):
        find_robot(str(tmp_path / "arm.toml"))


def test_continuous_joints_have_one_coordinate_in_pinocchio(tmp_path: Path) -> None:
    limit = '<limit lower="-2" upper="2" effort="10" velocity="5"/>'
    turning = URDF.replace('type="revolute"', 'type="continuous"').replace(limit, "")
    (tmp_path / "arm.urdf").write_text(turning)
    (tmp_path / "arm.toml").write_text(SHARED.format(file="arm.urdf"))
    robot = find_robot(str(tmp_path / "arm.toml"))
    model = pinocchio_model(robot)
    state = (np.array([0.5]), np.array([0.3]), np.array([2.0]))
    ours = robot.inertia_matrix(state[0]) @ state[2] + robot.body.bias(*state[:2])
    assert inverse_dynamics(robot, model, *state) == pytest.approx(ours)


BODIES = {
    "without names": """<body><joint name="shoulder" axis="0 1 0"/>
        <inertial pos="0 0 -0.2" mass="2.0" diaginertia="0.03 0.03 0.03"/>
        <body name="fore" pos="0 0 -0.4"><joint name="elbow" axis="0 1 0"/>
        <inertial pos="0 0 -0.1" mass="0.5" diaginertia="0.01 0.01 0.01"/></body></body>""",
    "from another file": '<include file="other.xml"/>',
    "weighed by its mesh": """<body euler="10 20 30"><joint name="shoulder" axis="0 1 0"/>
        <geom type="mesh" mesh="wedge"/>
        <body pos="0 0 -0.4"><joint name="elbow" axis="0 1 0"/><geom type="mesh" mesh="wedge"/></body></body>""",
    "with two joints, an anchor and a reference": """<body pos="0.1 0 0" euler="0 0 40">
        <joint name="shoulder" axis="0 1 1" pos="0 0.2 0.1" ref="0.3"/>
        <joint name="elbow" type="slide" axis="1 0 1" ref="0.1"/>
        <inertial pos="0 0 -0.2" mass="2.0" fullinertia="0.03 0.02 0.03 0.001 0.002 0.003"/>
        <body pos="0.3 0 0"><geom size="0.1" pos="0 0.1 0"/></body></body>""",
}


@pytest.mark.parametrize("kind", BODIES)
def test_pinocchio_has_the_body_that_mujoco_has(kind: str, tmp_path: Path) -> None:
    (tmp_path / "other.xml").write_text(f"<mujoco>{BODIES['without names']}</mujoco>")
    (tmp_path / "arm.xml").write_text(
        f"""<mujoco><asset><mesh name="wedge" vertex="0 0 0  0 0.1 0  0.1 0 0  0 0 -0.3"/></asset>
        <worldbody>{BODIES[kind]}</worldbody></mujoco>"""
    )
    (tmp_path / "arm.toml").write_text(SHARED.format(file="arm.xml"))
    robot = find_robot(str(tmp_path / "arm.toml"))
    model = pinocchio_model(robot)
    state = (np.array([0.5, -0.2]), np.array([0.3, 0.7]), np.array([2.0, -1.0]))
    ours = robot.inertia_matrix(state[0]) @ state[2] + robot.body.bias(*state[:2])
    assert inverse_dynamics(robot, model, *state) == pytest.approx(ours)


def test_the_documented_description_works_as_written(tmp_path: Path) -> None:
    page = (Path(__file__).parents[1] / "docs" / "robots.md").read_text(encoding="utf-8")
    (tmp_path / "arm.toml").write_text(page.split("```toml\n")[1].split("```")[0])
    (tmp_path / "arm.xml").write_text(
        """<mujoco><worldbody><body name="upper"><joint name="shoulder" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 -0.2" mass="2.0" diaginertia="0.03 0.03 0.03"/>
        <body name="fore" pos="0 0 -0.4"><joint name="elbow" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 -0.15" mass="1.0" diaginertia="0.01 0.01 0.01"/></body></body></worldbody></mujoco>"""
    )
    robot = find_robot(str(tmp_path / "arm.toml"))
    assert [robot.facts(joint).input for joint in (1, 2)] == ["voltage", "torque"]
    assert robot.input_equivalent(1) == pytest.approx(1.2 / 2.5)
    assert robot.joint(1).drive.resistance.uncertainty == 0.1
    assert robot.joint(2).upper.value == np.inf
