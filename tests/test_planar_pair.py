"""Two coupled joints in the compiled models: one at rest that the other pushes, and the fast form of the simulation."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from diagnosis.estimation import errors, predicted_motion
from diagnosis.hypotheses import Hypothesis, extend, sizes_of
from diagnosis.nominal import JointStructure, fit_nominal, point_at
from diagnosis.preparation import groups
from diagnosis.problem import Problem, stack
from diagnosis.search import polish, try_all
from envs.log import Array, JointFacts, Log
from envs.robots import find_robot
from methods.base import State
from methods.effects import built_in
from methods.kernel import NOMINAL, build
from methods.structured import PlanarCoupling, StructuredJoint, StructuredModel

EFFECTS = built_in()
NAMED = {effect.name: effect for effect in EFFECTS}
KERNEL = build(EFFECTS)
DT, STEP, BURN_IN = 1e-3, 1e-6, 0.3
FIRST = {"inertia": 0.03, "viscous": 0.02, "back_emf": 0.3}
SECOND = {"inertia": 0.02, "viscous": 0.02, "back_emf": 0.1}
COUPLING = PlanarCoupling(0.01, 1.25, 0.012)
COUPLED = {"velocity": 0.01, "motor_torque": 0.15}


def pair_with(effects: Mapping[str, Mapping[str, float]] | None = None, **frictions: float) -> StructuredModel:
    own = {name: {"torque": value} for name, value in frictions.items()}
    own |= {name: dict(values) for name, values in (effects or {}).items()}
    first = StructuredJoint(1, "voltage", FIRST, own)
    return StructuredModel((first, StructuredJoint(2, "voltage", SECOND, {})), DT, COUPLING, EFFECTS)


def commands(samples: int, first: float, second: float) -> Array:
    """Held commands: a slow sine for joint 1, a square wave for joint 2."""
    time = DT * np.arange(samples)
    return np.column_stack([first * np.sin(2 * np.pi * 0.7 * time), second * np.sign(np.sin(2 * np.pi * 1.3 * time))])


def reference(command: Array, friction: float, coupled: Mapping[str, float] | None = None) -> Array:
    """Angles (T, 2) by a stiff solver from the textbook equations, dry friction as a steep slope of the velocity;
    coupled: what joint 1 feels of the velocity and the motor torque of joint 2."""
    felt = coupled or {"velocity": 0.0, "motor_torque": 0.0}

    def rates(t: float, x: Array, u: Array) -> Array:
        q2, d1, d2 = x[1], x[2], x[3]
        p3, s, p2 = COUPLING.coupling_inertia, COUPLING.unit_ratio, COUPLING.shared_inertia
        torque1 = u[0] - 0.32 * d1 - friction * np.tanh(d1 / 1e-5)
        torque1 -= felt["velocity"] * d2 + felt["motor_torque"] * (u[1] - SECOND["back_emf"] * d2)
        torque2 = (u[1] - 0.12 * d2) / s
        mass = np.array(
            [[FIRST["inertia"] + p2 + 2 * p3 * np.cos(q2), p2 + p3 * np.cos(q2)], [0.0, SECOND["inertia"] / s]]
        )
        mass[1, 0] = mass[0, 1]
        coriolis = p3 * np.sin(q2) * np.array([-(2 * d1 * d2 + d2**2), d1**2])
        return np.concatenate([x[2:], np.linalg.solve(mass, [torque1, torque2] - coriolis)])

    states = np.zeros((len(command), 4))
    for k in range(len(command) - 1):
        held = command[k]
        done = solve_ivp(rates, (0.0, DT), states[k], "Radau", args=(held,), rtol=1e-8, atol=1e-11)
        states[k + 1] = done.y[:, -1]
    return states[:, :2]


def test_a_joint_at_rest_is_pushed_by_the_other_one() -> None:
    """Joint 1 has no command; only the reaction of joint 2 moves it against its dry friction."""
    command = commands(800, 0.0, 0.4)
    time = DT * np.arange(len(command))
    moved = pair_with(coulomb_friction=0.05).simulate(time, command, State.at_rest(np.zeros(2))).position
    expected = reference(command, 0.05)
    assert np.ptp(expected[:, 0]) > 0.02
    assert moved == pytest.approx(expected, abs=2e-3 * np.ptp(expected[:, 0]))
    held = pair_with(coulomb_friction=2.0).simulate(time, command, State.at_rest(np.zeros(2))).position
    assert np.ptp(held[:, 0]) == 0.0


def test_what_a_joint_of_an_arm_feels_of_the_motor_of_the_other_one() -> None:
    command = commands(1500, 0.3, 0.4)
    time = DT * np.arange(len(command))
    expected = reference(command, 0.0, COUPLED)
    free = pair_with().simulate(time, command, State.at_rest(np.zeros(2))).position
    moved = pair_with({"axis_coupling_in_a_pair": COUPLED}).simulate(time, command, State.at_rest(np.zeros(2))).position
    assert np.max(np.abs(free - expected)) > 0.05 * np.ptp(expected[:, 0])
    assert moved == pytest.approx(expected, abs=1e-6)
    facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=STEP),) * 2
    log = Log(time, command, STEP * np.round(expected / STEP), (1, 2), facts=facts)
    problem = stack(KERNEL, [log], (1, 2), pair=True, burn_in=BURN_IN)
    nominal = fit_nominal(problem, (JointStructure(),) * 2)
    names = ("axis_coupling", "axis_coupling_in_a_pair", "joint_flexibility", "coulomb_friction", "cable_spring")
    ranked = try_all(problem, nominal, [(NAMED[name], j) for name in names for j in (0, 1)])
    assert (ranked[0].name, ranked[0].start.hypothesis.joint) == ("axis_coupling_in_a_pair", 0)
    assert "axis_coupling" not in {scored.name for scored in ranked}  # as it is measured, of a joint by itself
    best = polish(problem, nominal, ranked[0]).fitted.point
    felt = {name: best.value(f"axis_coupling_in_a_pair.{name}@0") for name in COUPLED}
    assert felt == pytest.approx(COUPLED, rel=0.02, abs=0.005)  # a second and a half tells little of the velocity


def elastic(command: Array, joint: int, share: float, omega: float, damping: float, gap: float) -> Array:
    """Angles (T, 4) of motors and links by a stiff solver, with a spring or a play in one joint.

    Four bodies: two rotors and two links. The second rotor sits on the first link; of p2, what the second link does not
    have belongs to it, and turns with the first link, too. Stiff joints are very stiff springs.
    """
    p3, s, p2 = COUPLING.coupling_inertia, COUPLING.unit_ratio, COUPLING.shared_inertia
    shares = [share if joint == j else 0.9 for j in (0, 1)]
    inertias = np.array([FIRST["inertia"], SECOND["inertia"] / s])
    links, rotors = shares * inertias, inertias - shares * inertias
    carried = min(p2, links[1])
    turning = min(p2 - carried, rotors[1])
    stiffness = np.array([links[j] * omega**2 if joint == j else 1e6 for j in (0, 1)])
    friction = np.array([2.0 * damping * links[j] * omega if joint == j else 1e2 for j in (0, 1)])
    gaps = np.array([gap if joint == j else 0.0 for j in (0, 1)])

    def rates(t: float, x: Array, u: Array) -> Array:
        motor, link, motor_rate, link_rate = np.split(x, 4)
        twist, twisting = motor - link, motor_rate - link_rate
        deep = np.sign(twist) * np.maximum(np.abs(twist) - 0.5 * gaps, 0.0)
        between = stiffness * deep + friction * twisting * (deep != 0.0 if gap else 1.0)
        between = np.where(between * twist < 0.0, 0.0, between) if gap else between
        drive = (u - np.array([0.32, 0.12]) * motor_rate) / [1.0, s] - between
        c, z, d1, d2 = np.cos(link[1]), np.sin(link[1]), *link_rate
        mass = np.zeros((4, 4))  # motor 1, motor 2, link 1, link 2
        mass[0, 0], mass[1, 1], mass[1, 2], mass[2, 1] = rotors[0], rotors[1], turning, turning
        mass[2, 2] = links[0] + carried + turning + 2 * p3 * c
        mass[2, 3] = mass[3, 2] = carried + p3 * c
        mass[3, 3] = links[1]
        coriolis = p3 * z * np.array([-(2 * d1 * d2 + d2**2), d1**2])
        acceleration = np.linalg.solve(mass, np.concatenate([drive, between - coriolis]))
        return np.concatenate([motor_rate, link_rate, acceleration])

    states = np.zeros((len(command), 8))
    for k in range(len(command) - 1):
        done = solve_ivp(rates, (0.0, DT), states[k], "Radau", args=(command[k],), rtol=1e-8, atol=1e-11)
        states[k + 1] = done.y[:, -1]
    return states[:, :4]


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize(
    ("name", "gap", "load_side"),
    [("joint_flexibility", 0.0, False), ("joint_flexibility_load_side", 0.0, True), ("backlash", 0.01, False)],
)
def test_a_spring_or_a_play_in_one_joint_of_an_arm(name: str, gap: float, load_side: bool, joint: int) -> None:
    share, hertz, damping = 0.4, 9.0, 0.05
    values = {"inertia_ratio": share, "frequency": hertz, "damping_ratio": damping} | ({"gap": gap} if gap else {})
    parts = [
        StructuredJoint(j + 1, "voltage", nominal, {name: values} if j == joint else {})
        for j, nominal in enumerate((FIRST, SECOND))
    ]
    command = commands(700, 0.3, 0.4)
    model = StructuredModel((parts[0], parts[1]), DT, COUPLING, EFFECTS)
    moved = model.simulate(DT * np.arange(len(command)), command, State.at_rest(np.zeros(2))).position
    motors_and_links = elastic(command, joint, share, 2 * np.pi * hertz, damping, gap)
    expected = motors_and_links[:, 2:] if load_side else motors_and_links[:, :2]
    rigid = pair_with().simulate(DT * np.arange(len(command)), command, State.at_rest(np.zeros(2))).position
    size = np.max(np.abs(rigid - expected))
    assert size > 2e-3 * np.ptp(expected)
    assert moved == pytest.approx(expected, abs=0.03 * size)


@pytest.fixture(scope="module")
def problem() -> Problem:
    command = commands(3000, 0.3, 0.4)
    time = DT * np.arange(len(command))
    position = pair_with(coulomb_friction=0.05).simulate(time, command, State.at_rest(np.zeros(2))).position
    facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=STEP),) * 2
    log = Log(time, command, STEP * np.round(position / STEP), (1, 2), facts=facts)
    return stack(KERNEL, [log], (1, 2), pair=True, burn_in=BURN_IN)


@pytest.mark.parametrize(
    "names",
    [
        [],
        ["coulomb_friction", "dead_zone"],
        ["presliding_friction", "amplifier_lag"],
        ["thermal_drift", "cable_spring"],
        ["payload_change"],
        ["axis_coupling_in_a_pair"],
        ["axis_coupling_in_a_pair", "amplifier_lag", "dead_zone"],
    ],
)
def test_simulation_in_registers_is_the_general_one(problem: Problem, names: list[str]) -> None:
    nominal = fit_nominal(problem, (JointStructure(),) * 2)
    point, sizes = nominal.point, sizes_of(problem, nominal)
    for name in names:
        for j in range(2):
            effect = NAMED[name]
            values = [0.002, 1.5] if name == "payload_change" else next(iter(effect.starts(sizes[j])))
            point = extend(problem, point, Hypothesis(effect, j), np.array([values], float))
    predicted = problem.reading - predicted_motion(problem, point)[:, :, 0]
    assert np.array_equal(errors(problem, [point])[0], predicted)
    if names:
        assert not np.array_equal(errors(problem, [nominal.point])[0], predicted)


@pytest.mark.parametrize(
    ("inertias", "rigid", "joint", "share"),
    [
        ((0.053, 0.00934), (-0.0124, 3.94, 0.0110), 1, 0.5),  # the motor alone was felt behind a soft spring
        ((0.053, 0.00934), (-0.0124, 3.94, 0.0110), 1, 0.15),
        ((0.053, 0.00934), (-0.0124, 3.94, 0.0110), 0, 0.15),
        ((0.02, 0.03), (0.012, 1.5, 0.0125), 1, 0.3),
        ((0.02, 0.03), (0.012, 1.5, 0.0125), 0, 0.3),
        ((0.02, 0.03), (0.002, 1.5, 0.0125), 0, 0.5),  # there is enough behind it
        ((0.02, 0.03), (0.002, 1.5, 0.0125), 1, 0.5),
    ],
)
def test_the_arm_behind_a_spring_is_a_body(
    problem: Problem, inertias: tuple[float, float], rigid: tuple[float, float, float], joint: int, share: float
) -> None:
    """Its mass matrix is positive definite wherever the elbow was; the motor stays what it is."""
    spring = NAMED["joint_flexibility"]
    column, own = NOMINAL.index("inertia"), KERNEL.column(spring, "inertia_ratio")
    point = replace(point_at(problem, (JointStructure(), JointStructure()))[0], rigid=np.array(rigid))
    point.parameters[:, :, column] = inertias
    found = extend(problem, point, Hypothesis(spring, joint), np.tile([share, 20.0, 0.04], (problem.logs, 1)))
    coupling, ratio, carried = rigid

    def matrices(parameters: Array) -> Array:
        behind = parameters[0, :, column] / (1.0, ratio)
        behind[joint] *= parameters[0, joint, own]
        side = min(carried, behind[1]) if joint == 1 else carried
        c = np.cos(problem.reading[::50, 1])
        rows = [behind[0] + side + 2.0 * coupling * c, side + coupling * c, np.full(len(c), behind[1])]
        return np.moveaxis(np.array([[rows[0], rows[1]], [rows[1], rows[2]]]), 2, 0)

    as_it_was = extend(
        problem,
        replace(point, rigid=np.array((1e-9, ratio, 1e-9))),
        Hypothesis(spring, joint),
        np.tile([share, 20.0, 0.04], (problem.logs, 1)),
    ).parameters
    before, after = (np.linalg.eigvalsh(matrices(p)).min() for p in (as_it_was, found.parameters))
    assert after > 0.0
    unit = (1.0, ratio)[joint]
    whole, part = found.parameters[0, joint, column], found.parameters[0, joint, own]
    if before > 1e-3 * inertias[joint] / unit:
        assert (whole, part) == (inertias[joint], share)
        return
    assert before < 0.0
    motor = whole * (1.0 - part)
    felt_alone = joint == 1 and inertias[1] / ratio < carried
    assert motor == pytest.approx(inertias[joint] * (1.0 if felt_alone else 1.0 - share))
    other = 1 - joint
    assert found.parameters[0, other, column] == inertias[other]
    assert problem.credible(errors(problem, [found])[0])


def test_noise_does_not_hide_what_the_joints_do_to_each_other_where_a_fit_begins() -> None:
    time = DT * np.arange(8000)
    wave = lambda low, high: sum(np.sin(2 * np.pi * f * time + f**2) for f in np.linspace(low, high, 7))  # noqa: E731
    command = np.column_stack([0.4 * wave(0.3, 2.0), 0.3 * wave(0.4, 2.3)])
    position = pair_with().simulate(time, command, State.at_rest(np.zeros(2))).position
    noisy = position + 1e-3 * np.random.default_rng(0).standard_normal(position.shape)
    facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=STEP),) * 2
    log = Log(time, command, STEP * np.round(noisy / STEP), (1, 2), facts=facts)
    structures = (JointStructure(electrical=False),) * 2
    begun = point_at(stack(KERNEL, [log], (1, 2), pair=True), structures).point.values
    assert begun["inertia@0"] == pytest.approx(FIRST["inertia"], rel=0.2)
    assert begun["inertia@1"] == pytest.approx(SECOND["inertia"], rel=0.2)
    assert begun["coupling_inertia"] == pytest.approx(COUPLING.coupling_inertia, rel=0.3)


def test_a_winding_tells_viscous_friction_from_back_emf_where_a_pose_changes_the_inertia() -> None:
    """Under an inertia that stays the same either can stand in for the other, with another winding and inertia."""
    time = DT * np.arange(8000)
    wave = lambda low, high: sum(np.sin(2 * np.pi * f * time + f**2) for f in np.linspace(low, high, 7))  # noqa: E731
    command = np.column_stack([0.4 * wave(0.3, 2.0), 0.3 * wave(0.4, 2.3)])
    winding, share = {"electrical_time_constant": 0.012}, 0.3
    joints = tuple(
        StructuredJoint(j + 1, "voltage", own | winding | {"viscous": share * own["back_emf"]}, {})
        for j, own in enumerate((FIRST, SECOND))
    )
    model = StructuredModel(joints, DT, COUPLING, EFFECTS)
    position = model.simulate(time, command, State.at_rest(np.zeros(2))).position
    facts = (JointFacts(input="voltage", position_unit="rad", encoder_step=STEP),) * 2
    log = Log(time, command, STEP * np.round(position / STEP), (1, 2), facts=facts)
    fitted = fit_nominal(stack(KERNEL, [log], (1, 2), pair=True), (JointStructure(viscous_share=0.1),) * 2)
    for j, own in enumerate((FIRST, SECOND)):
        found = {
            name: fitted.point.value(f"{name}@{j}") for name in ("viscous", "back_emf", "electrical_time_constant")
        }
        assert found == pytest.approx(
            {"viscous": share * own["back_emf"], "back_emf": own["back_emf"], **winding}, rel=0.01
        )


THREE_LINKS = """<mujoco><worldbody>
  <body><joint name="a" axis="0 0 1"/><inertial pos="0.2 0 0" mass="4" diaginertia="0.05 0.05 0.05"/>
  <body pos="0.4 0 0"><joint name="b" axis="0 0 1"/><inertial pos="0.15 0 0" mass="3" diaginertia="0.03 0.03 0.03"/>
  <body pos="0.3 0 0"><joint name="c" {axis}/><inertial pos="{offset} 0 0" mass="1" diaginertia="0.001 0.001 0.001"/>
  </body></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("axis", "offset", "moves", "is_pair"),
    [
        ('axis="0 0 1"', 0.12, False, True),
        ('axis="0 0 1"', 0.12, True, False),  # its motion changes what the first two do to each other
        ('type="slide" axis="0 0 1"', 0.0, True, True),  # straight up and down it does not
    ],
)
def test_two_joints_of_an_arm_whose_third_moves(
    axis: str, offset: float, moves: bool, is_pair: bool, tmp_path: Path
) -> None:
    (tmp_path / "arm.xml").write_text(THREE_LINKS.format(axis=axis, offset=offset))
    (tmp_path / "arm.toml").write_text(
        'name = "arm"\nbody.file = "arm.xml"\n[drive]\namplifier = "torque"\ncommand = "torque"\n'
    )
    robot = find_robot(str(tmp_path / "arm.toml"))
    time = 0.01 * np.arange(400)
    wave = np.column_stack([np.sin(time), np.sin(1.3 * time), moves * 0.7 * np.sin(np.pi * time)])
    log = Log(time, wave, wave, (1, 2, 3), facts=tuple(robot.facts(j) for j in (1, 2, 3)), name="three")
    found = [joints for joints, _ in groups([log], (1, 2), robot, ())]
    assert found == ([(1, 2)] if is_pair else [(1,), (2,)])
