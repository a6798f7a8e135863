"""Robot descriptions: the AdeptOne's table, other rigs from files, ensembles, and what makes a description unusable."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.adeptone import adeptone
from envs.mjcf import DescribedBody
from envs.robot import Drive, Quantity, Robot, RobotError, load_robot
from envs.scara import ScaraBody

PENDULUM = """
<mujoco>
  <compiler autolimits="true"/>
  <worldbody>
    <body pos="0 0 1">
      <joint name="swing" axis="0 1 0" damping="9" armature="9" frictionloss="9"/>
      <inertial pos="0 0 -0.3" mass="2.0" diaginertia="0.04 0.05 0.03"/>
    </body>
  </worldbody>
  <actuator><motor joint="swing"/></actuator>
</mujoco>
"""

URDF = """
<robot name="pendulum">
  <link name="world"/>
  <link name="rod">
    <inertial>
      <origin xyz="0 0 -0.3"/><mass value="2.0"/>
      <inertia ixx="0.04" iyy="0.05" izz="{izz}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="swing" type="revolute">
    <parent link="world"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
</robot>
"""

DESCRIPTION = """
name = "pendulum"
[body]
file = "{file}"
[[joint]]
name = "{joint}"
kind = "{kind}"
lower = -3.0
upper = 3.0
encoder_step = 0.001
[joint.drive]
amplifier = "{amplifier}"
command = "torque"
amplifier_gain = 1.0
viscous = {viscous}
"""

USUAL = {"file": "arm.xml", "joint": "swing", "kind": "revolute", "amplifier": "torque", "viscous": "0.1"}


def write_robot(folder, body, **changes):
    """A description with one joint and its body's file; the path of the description."""
    entries = USUAL | changes
    (folder / entries["file"]).write_text(body)
    path = folder / "robot.toml"
    path.write_text(DESCRIPTION.format(**entries))
    return path


def quantities(record):
    """Every quantity of a tree of dataclasses, with its path."""
    for item in fields(record):
        value = getattr(record, item.name)
        for index, part in enumerate(value if isinstance(value, tuple) else (value,)):
            path = f"{item.name}[{index}]" if isinstance(value, tuple) else item.name
            if isinstance(part, Quantity):
                yield path, part
            elif hasattr(part, "__dataclass_fields__"):
                yield from ((f"{path}.{inner}", quantity) for inner, quantity in quantities(part))


@given(value=st.floats(1e-6, 1e6), uncertainty=st.floats(0.0, 5.0), seed=st.integers(0, 2**32 - 1))
def test_a_draw_stays_within_the_stated_uncertainty(value, uncertainty, seed):
    drawn = Quantity(value, "m", "test", uncertainty).sample(np.random.default_rng(seed)).value
    assert value / (1 + uncertainty) * (1 - 1e-12) <= drawn <= value * (1 + uncertainty) * (1 + 1e-12)


def test_draws_are_log_uniform():
    rng = np.random.default_rng(0)
    draws = np.array([Quantity(3.0, "m", "test", 1.0).sample(rng).value for _ in range(4000)])
    share = (np.log2(draws / 3.0) + 1.0) / 2.0
    assert np.histogram(share, bins=4, range=(0, 1))[0] == pytest.approx(1000, abs=100)


def test_ensemble_members_differ_repeat_and_keep_what_is_exact():
    robot = adeptone()
    one, same, other = (robot.sample(np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert one == same
    assert one != other
    for (path, drawn), (_, nominal) in zip(quantities(one), quantities(robot), strict=True):
        assert (drawn.value == nominal.value) == (nominal.uncertainty == 0.0), path


def test_every_number_of_the_adeptone_has_unit_and_source():
    table = dict(quantities(adeptone()))
    assert len(table) > 50
    for path, quantity in table.items():
        assert quantity.unit or path.endswith("gear_ratio"), path
        assert len(quantity.source) > 10, path


def test_nominal_adeptone_has_the_inertias_of_its_source():
    parameters = adeptone().body.parameters
    assert [parameters.p1, parameters.p2, parameters.p3] == pytest.approx([5.17, 1.18, 1.515], rel=3e-3)
    drives = adeptone().drives
    assert [drive.torque_constant for drive in drives] == pytest.approx([21, 14, 31.4, 0.50])
    assert [drive.reflected_inertia for drive in drives] == pytest.approx([0, 0, 4.9, 0.002], rel=1e-3)


def test_input_equivalent_by_kind_of_amplifier():
    assert adeptone().input_equivalent(1) == pytest.approx(5.0 / (21.0 * 30.0))
    assert adeptone(amplifier="current").input_equivalent(1) == pytest.approx(1.0 / (21.0 * 11.7 / 10.0))
    gain = Quantity(35.15, "N/V", "test")
    assert Drive(amplifier="torque", amplifier_gain=gain).input_equivalent == pytest.approx(1.0 / 35.15)


def test_facts_for_the_log():
    facts = adeptone().facts(3)
    assert (facts.input, facts.position_unit, facts.encoder_step) == ("voltage", "m", 5e-6)
    assert facts.command_step == pytest.approx(20.0 / 4096)
    assert facts.command_limit == 10.0


def test_converters_and_encoders_round_to_their_steps():
    robot = adeptone()
    step = 20.0 / 4096
    commands = np.array([[0.4 * step, 0.6 * step, 99.0, -99.0]])
    assert robot.quantise(commands) == pytest.approx(np.array([[0.0, step, 10.0 - step, -10.0]]))
    position = np.array([1e-3, 1e-3, 1.2345678e-2, 1e-3])
    assert np.abs(robot.measure(position) - position).max() <= 1.6e-4
    assert robot.measure(position)[2] == pytest.approx(1.2345e-2, abs=1e-15)


def test_motor_on_the_base_turns_with_both_links():
    """Power of motor 2 is the same seen from the motor and from the joints: tau (A q')_2 = (A^T tau)' q'."""
    turns = adeptone(second_stator="base").coupling_matrix
    velocity, torque = np.array([0.3, -0.7, 0.1, 2.0]), np.array([0.0, 5.0, 0.0, 0.0])
    assert torque @ (turns @ velocity) == pytest.approx(5.0 * (0.3 - 0.7))
    assert turns.T @ torque == pytest.approx([5.0, 5.0, 0.0, 0.0])


@pytest.mark.parametrize("file", ["arm.xml", "arm.urdf"])
def test_rig_from_a_file_is_the_textbook_pendulum(tmp_path, file):
    body = PENDULUM if file == "arm.xml" else URDF.format(izz=0.03)
    robot = load_robot(write_robot(tmp_path, body, file=file))
    angle = np.linspace(-3.0, 3.0, 7)[:, None]
    inertia, gravity = 0.05 + 2.0 * 0.3**2, 9.81 * 2.0 * 0.3
    assert robot.inertia_matrix(angle)[:, 0] == pytest.approx(np.full((7, 1), inertia))
    torque = robot.inverse_dynamics(angle, 2.0 + 0.0 * angle, 3.0 + 0.0 * angle)
    assert torque == pytest.approx(3.0 * inertia + 0.1 * 2.0 + gravity * np.sin(angle))
    assert robot.forward_dynamics(angle, 2.0 + 0.0 * angle, torque) == pytest.approx(np.full((7, 1), 3.0))


def test_joints_of_a_file_may_come_in_another_order(tmp_path):
    body = PENDULUM.replace(
        "<inertial pos",
        '<body><joint name="slide" type="slide"/><inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/></body>'
        "<inertial pos",
    )
    (tmp_path / "arm.xml").write_text(body)
    straight = DescribedBody(str(tmp_path / "arm.xml"), ("swing", "slide"))
    swapped = DescribedBody(str(tmp_path / "arm.xml"), ("slide", "swing"))
    state = np.array([0.4, 0.2])
    assert swapped.inertia_matrix(state[::-1]) == pytest.approx(straight.inertia_matrix(state)[::-1, ::-1])
    assert swapped.bias(state[::-1], state[::-1]) == pytest.approx(straight.bias(state, state)[::-1])


IMPOSSIBLE = {
    "negative mass": (PENDULUM.replace('mass="2.0"', 'mass="-2.0"'), {}, "mass"),
    "inertia without triangle inequality": (PENDULUM.replace("0.04 0.05 0.03", "0.04 0.05 0.30"), {}, "A \\+ B"),
    "the same in URDF": (URDF.format(izz=0.3), {"file": "arm.urdf"}, "A \\+ B"),
    "no mass at all": (PENDULUM.replace('mass="2.0"', 'mass="0"'), {}, "mass"),
    "not XML": ("nonsense", {}, "MuJoCo refuses"),
    "joint of another name": (PENDULUM, {"joint": "elbow"}, "swing"),
    "unknown kind": (PENDULUM, {"kind": "ball"}, "revolute, prismatic"),
    "unknown amplifier": (PENDULUM, {"amplifier": "steam"}, "voltage, current, torque"),
    "voltage drive without resistance": (PENDULUM, {"amplifier": "voltage"}, "resistance"),
    "negative friction": (PENDULUM, {"viscous": "-1.0"}, "viscous"),
    "not TOML": (PENDULUM, {"viscous": "]"}, "TOML"),
    "number that is a text": (PENDULUM, {"viscous": '"much"'}, "viscous"),
}


@pytest.mark.parametrize("case", IMPOSSIBLE)
def test_unusable_description_gives_one_clear_line(tmp_path, case):
    body, changes, word = IMPOSSIBLE[case]
    with pytest.raises(RobotError, match=word) as caught:
        load_robot(write_robot(tmp_path, body, **changes))
    message = str(caught.value)
    assert "\n" not in message
    assert str(tmp_path) in message


def test_missing_files_are_named(tmp_path):
    with pytest.raises(RobotError, match="no such file"):
        load_robot(tmp_path / "absent.toml")
    path = write_robot(tmp_path, PENDULUM)
    (tmp_path / "arm.xml").unlink()
    with pytest.raises(RobotError, match=r"arm\.xml: no such file"):
        load_robot(path)


@pytest.mark.parametrize("part", ["mass", "inertia"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.inf])
def test_impossible_link_is_refused(part, value):
    link = adeptone().body.link_1
    with pytest.raises(RobotError, match=f"{part} of the link"):
        replace(link, **{part: Quantity(value, "kg", "test")})


def test_wrong_joint_number_is_named():
    with pytest.raises(RobotError, match=r"joints 1\.\.4, not 5"):
        adeptone().joint(5)


def test_robot_and_body_are_what_they_say():
    assert isinstance(adeptone(), Robot)
    assert isinstance(adeptone().body, ScaraBody)
