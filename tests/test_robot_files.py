"""Anybody's robot: MJCF or URDF plus a TOML for the drives becomes a Robot; an impossible one is one clear line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from envs.pinocchio_model import inverse_dynamics, pinocchio_model
from envs.robot import Robot, RobotError
from envs.robots import find_robot
from envs.scara import parse_scara

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
    ("file", "body", "inertia"), [("arm.urdf", URDF, 'iyy="0.03"'), ("arm.xml", MJCF, "0.03 0.03 0.03")]
)
def test_a_description_is_known_by_what_it_says(file: str, body: str, inertia: str, tmp_path: Path) -> None:
    hashes = [
        find_robot(describe(tmp_path, file, text, amplifier)).content_hash
        for text, amplifier in (
            (body, "voltage"),
            (body.replace("><", "> <"), "voltage"),
            (body.replace(inertia, inertia.replace("0.03", "0.031", 1)), "voltage"),
            (body, "current"),
        )
    ]
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == 3


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


FIXED = URDF.replace('type="revolute"', 'type="fixed"')


@pytest.mark.parametrize(
    ("body", "description", "complaint"),
    [
        (URDF, SHARED.replace('"torque"', '"current"', 1), "joint 1.drive: motor_constant is missing. Add the entry"),
        (FIXED, SHARED, "arm.urdf: the body has no joint that moves"),
        (None, SHARED, "arm.urdf: no such file. Give the path of an MJCF or URDF file"),
        ("<robot", SHARED, "MuJoCo refuses the description: unclosed token: line 1, column 0. Correct this element"),
        (URDF, DRIVES.replace('"revolute"', '"prismatic"'), "joint shoulder is prismatic, but revolute in arm.urdf"),
    ],
)
def test_the_cause_is_said_once(body: str | None, description: str, complaint: str, tmp_path: Path) -> None:
    if body is not None:
        (tmp_path / "arm.urdf").write_text(body)
    (tmp_path / "arm.toml").write_text(description.format(file="arm.urdf", amplifier="voltage"))
    with pytest.raises(RobotError) as caught:
        find_robot(str(tmp_path / "arm.toml"))
    assert complaint in str(caught.value)
    assert str(caught.value).count("MuJoCo refuses") == complaint.count("MuJoCo refuses")
    assert "\n" not in str(caught.value)


def test_a_robot_that_is_misspelt() -> None:
    with pytest.raises(RobotError, match=r"there is no robot 'adeptonee' \(did you mean adeptone\?\)\. Choose"):
        find_robot("adeptonee")


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


def drive_of(folder: Path, entries: str, kind: str = "revolute", amplifier: str = "voltage") -> Robot:
    """A robot whose one drive has these lines; what is above `[joint.drive]` belongs to the joint."""
    joint, _, drive = entries.rpartition("|")
    text = DRIVES.format(file="arm.xml", amplifier=amplifier).replace('"revolute"', f'"{kind}"')
    for line in (*joint.splitlines(), *drive.splitlines()):
        name = line.partition("=")[0].strip()
        text = "\n".join(old for old in text.splitlines() if not old.startswith(f"{name} "))
    text = text.replace("[joint.drive]", f"{joint}\n[joint.drive]\n{drive}")
    (folder / "arm.xml").write_text(MJCF if kind == "revolute" else MJCF.replace("hinge", "slide"))
    (folder / "arm.toml").write_text(text + "\n")
    return find_robot(str(folder / "arm.toml"))


def stated(name: str, value: float, unit: str) -> str:
    return f'{name} = {{ value = {value}, unit = "{unit}" }}'


@pytest.mark.parametrize(
    ("name", "value", "unit", "standard"),
    [
        ("motor_constant", 52, "mN m/A", 0.052),
        ("motor_constant", 52, "mNm/A", 0.052),
        ("motor_constant", 0.4, "V s/rad", 0.4),
        ("motor_constant", 5, "mV/rpm", 0.15 / np.pi),
        ("resistance", 900, "mohm", 0.9),
        ("resistance", 900, "mΩ", 0.9),
        ("inductance", 0.8, "mH", 0.8e-3),
        ("rotor_inertia", 120, "g cm^2", 1.2e-5),
        ("rotor_inertia", 120, "g·cm²", 1.2e-5),
        ("gear_ratio", 5, "", 5.0),
        ("gear_ratio", 5, "turn/turn", 5.0),
        ("viscous", 2, "N m/rpm", 60 / np.pi),
        ("viscous", 2, "mN m s", 0.002),
        ("current_limit", 700, "mA", 0.7),
        ("command_limit", 24000, "mV", 24.0),
        ("amplifier_gain", 2, "V/V", 2.0),
        ("amplifier_gain", 2000, "mV/V", 2.0),
    ],
)
def test_units_of_a_drive_are_converted(name: str, value: float, unit: str, standard: float, tmp_path: Path) -> None:
    drive = drive_of(tmp_path, stated(name, value, unit)).drives[0]
    assert getattr(drive, name).value == pytest.approx(standard, rel=1e-12)


def test_units_of_a_joint_are_converted(tmp_path: Path) -> None:
    lines = [
        ("lower", -90, "deg"),
        ("upper", 0.5, "turn"),
        ("encoder_step", 1, "turn / 8192"),
        ("speed_limit", 6, "rpm"),
    ]
    joint = drive_of(tmp_path, "\n".join(stated(*line) for line in lines) + "|").joint(1)
    assert joint.encoder_step is not None
    assert joint.speed_limit is not None
    found = [item.value for item in (joint.lower, joint.upper, joint.encoder_step, joint.speed_limit)]
    assert found == pytest.approx([-np.pi / 2, np.pi, 2 * np.pi / 8192, 0.2 * np.pi], rel=1e-12)


def test_a_joint_that_slides_has_lengths_and_forces(tmp_path: Path) -> None:
    entries = "\n".join(
        [
            *(stated("lower", -5, "mm"), stated("encoder_step", 2, "um"), "|"),
            *(stated("gear_ratio", 50, "turn/m"), stated("viscous", 0.2, "N s/mm"), stated("motor_constant", 2, "N/A")),
        ]
    )
    joint = drive_of(tmp_path, entries, "prismatic").joint(1)
    assert joint.lower.value == pytest.approx(-0.005)
    assert joint.encoder_step is not None
    assert joint.encoder_step.value == pytest.approx(2e-6)
    assert joint.drive.gear_ratio.value == pytest.approx(100 * np.pi)
    assert joint.drive.viscous.value == pytest.approx(200.0)
    assert joint.drive.motor_constant.value == 2.0
    force = drive_of(tmp_path, stated("command_limit", 0.2, "kN"), "prismatic", "torque").drives[0]
    assert force.command_limit.value == pytest.approx(200.0)


@pytest.mark.parametrize("amplifier", ["voltage", "current", "torque"])
def test_the_gain_of_an_amplifier_is_output_per_command(amplifier: str, tmp_path: Path) -> None:
    unit = {"voltage": "V", "current": "mA", "torque": "mN m"}[amplifier]
    entries = f'{stated("amplifier_gain", 1500, unit + "/V")}\ncommand = "voltage"'
    assert drive_of(tmp_path, entries, amplifier=amplifier).drives[0].amplifier_gain.value == pytest.approx(
        1500 if amplifier == "voltage" else 1.5
    )


@pytest.mark.parametrize(
    ("line", "kind", "complaint"),
    [
        (
            stated("motor_constant", 0.35, "mN"),
            "revolute",
            "'mN' cannot be converted to N m/A. Give it in N m/A or V s",
        ),
        (stated("motor_constant", 300, "rpm/V"), "revolute", "drive.motor_constant: unit 'rpm/V'"),
        (stated("resistance", 1, "banana"), "revolute", "'banana' is unknown. Give it in ohm"),
        (stated("resistance", 1, "percent"), "revolute", "cannot be converted to ohm"),
        (stated("viscous", 1, "N s/m"), "revolute", "cannot be converted to N m s/rad"),
        (stated("viscous", 1, "N m s/rad"), "prismatic", "cannot be converted to N s/m"),
        (stated("upper", 90, "deg") + "|", "prismatic", "joint 1.upper: unit 'deg' cannot be converted to m"),
        (stated("upper", 90, "mm") + "|", "revolute", "cannot be converted to rad"),
        (stated("encoder_step", 1, "count") + "|", "revolute", "write turn / COUNTS_PER_TURN"),
        (stated("amplifier_gain", 1, "A/V"), "revolute", "cannot be converted to V/V"),
        (stated("rotor_inertia", 1, "kg m^9^9"), "revolute", "is not understood"),
        ("resistance = { value = 1, unit = 3 }", "revolute", "has the unit 3"),
        ('resistance = { value = 1, uncertainty = "10%" }', "revolute", "drive.resistance has the uncertainty '10%'"),
        ("resistance = { value = 1, uncertainty = true }", "revolute", "has the uncertainty True"),
        ("resistance = { value = 1, uncertainty = -0.1 }", "revolute", "has the uncertainty -0.1"),
        ("resistance = true", "revolute", "drive.resistance is True"),
    ],
)
def test_units_and_uncertainties_that_make_no_sense(line: str, kind: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(RobotError) as caught:
        drive_of(tmp_path, line, kind)
    assert complaint in str(caught.value)
    assert "arm.toml: joint 1" in str(caught.value)


def test_the_units_of_a_scara_are_converted() -> None:
    part = {"value": 300, "unit": "g"}
    inertia = {"value": 20, "unit": "kg cm^2"}
    link = {"length": {"value": 42, "unit": "cm"}, "mass": part, "centre_of_mass": 0.1, "inertia": inertia}
    table = {name: {**link, "rotor_inertia": 0.0} for name in ("link_1", "link_2")}
    body = parse_scara({**table, "quill": {"mass": part, "inertia": inertia}}, {})
    assert (body.link_1.length.value, body.quill.mass.value) == pytest.approx((0.42, 0.3))
    assert body.link_2.inertia.value == body.quill.inertia.value == pytest.approx(2e-3)
