"""The extended model as an MJCF file: what MuJoCo has an element for goes in, the rest is listed by name.

Controls are the commands of the log, one actuator per joint under the joint's name, in the order of the joints. Torques
are in SI units where the drive's constants are known, else in units of the command; the motion is the same. A single
joint moves a body of its own; a planar pair moves two links whose lengths and masses give the same equations of motion.

===================== =====================================================================
nominal joint         explicit inertia, joint damping, ``dcmotor`` with L/R, gravity on an offset mass
arm behind a spring   its own damping and its share of friction on a fixed tendon
coulomb_friction      ``frictionloss``, soft where it is found as a soft constraint
stribeck_friction     LuGre bristle of a passive ``dcmotor``, stiff enough to be dry friction
presliding_friction   the same with its own stiffness
quadratic_drag        polynomial joint damping
cable_spring, offset  joint ``stiffness`` and ``springref``; a tendon where the spring stiffens
gravity_tilt          the offset mass
cogging_torque        passive ``dcmotor``
thermal_drift         thermal resistance of the ``dcmotor``
joint_flexibility     two bodies, spring and damper on the joint between them
backlash              two bodies, a soft limit on the joint between them
input_delay           actuator ``delay``
amplifier_lag         actuator ``filterexact`` (without winding lag)
voltage_saturation    ``ctrlrange``; a known current limit: ``saturation`` or ``forcerange``
===================== =====================================================================
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import mujoco
import numpy as np

from envs.log import Array
from envs.scara import STANDARD_GRAVITY
from methods.base import State
from methods.structured import COMPENSATOR, StructuredJoint, StructuredModel

STEP = 1.25e-4
"""Longest step of MuJoCo [s]."""
STIFF = ((0.9999, 0.9999, 1e-3, 0.5, 2.0), 2.0)
"""Impedance of dry friction and its time constant in steps: next to no creep."""
COPPER = 0.00393
"""Temperature coefficient of copper's resistance [1/K]."""
AMBIENT = 25.0
"""Temperature at which the winding starts [deg C]; of no effect on the motion."""
BRISTLE_HERTZ = 80.0
"""Natural frequency of the bristles that stand for dry Stribeck friction [Hz]."""
_PASSIVE = int(mujoco.mjtCtrlInput.mjINPUT_NONE)

Values = Mapping[str, float]


@dataclass(frozen=True)
class Exported:
    """The MJCF text and the effects that MuJoCo lacks, as (joint, effect)."""

    xml: str
    missing: tuple[tuple[int, str], ...]


@dataclass
class _Joint:
    """One joint under construction; `unit`: command units per torque of the file."""

    spec: mujoco.MjSpec
    part: StructuredJoint
    name: str
    unit: float
    inertia: float
    step: float
    body: mujoco.MjsBody
    joint: mujoco.MjsJoint
    actuator: mujoco.MjsActuator
    gravity: list[float] = field(default_factory=lambda: [0.0, 0.0])
    constant: float = 0.0
    resistance: float = 0.0

    @property
    def behind(self) -> float:
        """Share of the laws of friction that acts behind a spring or a play."""
        return self.part.nominal.get("arm_friction", 0.0)

    def torque(self, value: float) -> float:
        """A torque of the model in the file's unit."""
        return value / self.unit


def export(model: StructuredModel, units: Sequence[float | None], names: Sequence[str]) -> Exported:
    """The model in MuJoCo's terms; `units` are command units per torque of each joint (None: not known).

    Effects whose parameters MuJoCo refuses, such as a limit of zero, are left out like those that it does not have.
    """
    try:
        return _built(model, units, names, frozenset())
    except (ValueError, ArithmeticError):
        places = frozenset((part.joint, effect) for part in model.parts for effect in part.effects)
        alone = [place for place in places if not _compiles(model, units, names, places - {place})]
        return _built(model, units, names, frozenset(alone))


def _compiles(
    model: StructuredModel, units: Sequence[float | None], names: Sequence[str], without: frozenset[tuple[int, str]]
) -> bool:
    try:
        _built(model, units, names, without)
    except (ValueError, ArithmeticError):
        return False
    return True


def _built(
    model: StructuredModel, units: Sequence[float | None], names: Sequence[str], without: frozenset[tuple[int, str]]
) -> Exported:
    """The model without effects of some joints, which count as missing. Raises ValueError or
    ArithmeticError where MuJoCo refuses it."""
    spec = mujoco.MjSpec()
    spec.modelname = "extended_model"
    spec.compiler.degree = False
    spec.option.timestep = step = model.sample_time / max(1, math.ceil(model.sample_time / STEP - 1e-9))
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = [0.0, 0.0, -STANDARD_GRAVITY]
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    scales = [1.0 if unit is None else unit for unit in units]
    if model.coupling is not None:
        scales[1] = scales[0] * model.coupling.unit_ratio
    bodies = _bodies(spec, model, scales, names)
    built = []
    for (body, joint, inertia), part, name, unit in zip(bodies, model.parts, names, scales, strict=True):
        actuator = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
        built.append(_Joint(spec, part, name, unit, inertia, step, body, joint, actuator))
    missing = []
    labels = {effect.name: effect.label if effect.after else effect.name for effect in model.kernel.effects}
    for item in built:
        _drive(item)
        for effect, values in item.part.effects.items():
            place = item.part.joint, effect
            if place in without or not _ELEMENTS.get(labels[effect], _lacks)(item, values):
                missing.append(place)
        if item.part.compensator is not None:
            missing.append((item.part.joint, COMPENSATOR))
        _constant(item)
        _arm_friction(item)
        if not _gravity(item, single=model.coupling is None or item.part.joint not in model.joints[:2]):
            missing.append((item.part.joint, "gravity"))
    spec.compile()
    return Exported(spec.to_xml(), tuple(missing))


def _bodies(
    spec: mujoco.MjSpec, model: StructuredModel, scales: Sequence[float], names: Sequence[str]
) -> list[tuple[mujoco.MjsBody, mujoco.MjsJoint, float]]:
    """One body per joint, side by side, the planar pair as a chain: (body, joint, inertia about the joint)."""
    found = []
    for index, (part, name) in enumerate(zip(model.parts, names, strict=True)):
        inertia = part.nominal["inertia"] / scales[index]
        if model.coupling is not None and index < 2:
            continue
        body = spec.worldbody.add_body(name=f"{name}_link", pos=[0.0, float(index), 1.0])
        found.append((body, _add_joint(body, name, part.position_unit, [0.0, 1.0, 0.0]), inertia))
        _set_inertia(body, 1.0 if part.position_unit == "rad" else inertia, inertia, [0.0, 0.0, 0.0])
    return (_pair(spec, model, scales, names) if model.coupling is not None else []) + found


def _pair(
    spec: mujoco.MjSpec, model: StructuredModel, scales: Sequence[float], names: Sequence[str]
) -> list[tuple[mujoco.MjsBody, mujoco.MjsJoint, float]]:
    """Two links with M11 = p1 + p2 + 2 p3 cos q2, M12 = p2 + p3 cos q2; the first is one metre long.

    What M22 has beyond p2 is the armature of joint 2, and p2 is no more than M22.
    """
    assert model.coupling is not None
    p1, own = (part.nominal["inertia"] / scale for part, scale in zip(model.parts[:2], scales, strict=False))
    p2, p3 = min(model.coupling.shared_inertia / scales[0], own), model.coupling.coupling_inertia / scales[0]
    share = 0.5 * (1.0 + p3**2 / (p1 * p2))
    centre = share * p2 / p3 if p3 else 0.0
    mass = p3 / centre if p3 else 1e-3 * p1
    first = spec.worldbody.add_body(name=f"{names[0]}_link", pos=[0.0, 0.0, 1.0])
    _set_inertia(first, 1.0, p1 - mass, [0.0, 0.0, 0.0])
    one = _add_joint(first, names[0], "rad", [0.0, 0.0, 1.0])
    second = first.add_body(name=f"{names[1]}_link", pos=[1.0, 0.0, 0.0])
    _set_inertia(second, mass, p2 - mass * centre**2, [centre, 0.0, 0.0])
    two = _add_joint(second, names[1], "rad", [0.0, 0.0, 1.0])
    two.armature = own - p2
    return [(first, one, p1), (second, two, own)]


def _add_joint(body: mujoco.MjsBody, name: str, unit: str, axis: list[float]) -> mujoco.MjsJoint:
    if unit == "rad":
        return body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
    return body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])


def _set_inertia(body: mujoco.MjsBody, mass: float, inertia: float, centre: list[float]) -> None:
    # one number acts; the same about all axes is a possible body
    body.explicitinertial = True
    body.mass, body.ipos, body.inertia = mass, centre, [inertia] * 3


def _drive(item: _Joint) -> None:
    """Damping and motor: with a winding lag a ``dcmotor``, else a plain motor; gain 1 / unit."""
    nominal = item.part.nominal
    lag, back_emf = nominal.get("electrical_time_constant", 0.0), nominal.get("back_emf", 0.0)
    item.constant += nominal.get("load", 0.0)
    item.joint.damping[0] = item.torque(nominal.get("viscous", 0.0))
    limit = nominal.get("torque_limit", 0.0)
    if lag > 0.0 and back_emf > 0.0:
        item.resistance = back_emf * item.unit
        _motor(item, [0.0] * 6)
        return
    item.joint.damping[0] += item.torque(back_emf)
    item.actuator.set_to_motor()
    item.actuator.gainprm[0] = item.torque(1.0)
    if limit > 0.0:
        item.actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        item.actuator.forcerange = [-item.torque(limit), item.torque(limit)]


def _motor(item: _Joint, thermal: list[float]) -> None:
    """torque = k i, L i' + R i = u - k q' with k the back-EMF and R = k unit, hence torque = (u - k q') / unit.

    MuJoCo's force uses the current at the end of the step, half a step early on average; the lag makes up for it.
    """
    nominal = item.part.nominal
    constant, limit = nominal["back_emf"], nominal.get("torque_limit", 0.0)
    item.actuator.set_to_dcmotor(
        motorconst=[constant, 0.0],
        resistance=item.resistance,
        inductance=[(nominal["electrical_time_constant"] + 0.5 * item.step) * item.resistance, 0.0],
        saturation=[0.0, limit / item.resistance, 0.0],
        thermal=thermal,
    )


def _constant(item: _Joint) -> None:
    """A constant torque that resists, as a soft spring whose rest lies far away."""
    if item.constant == 0.0:
        return
    if item.joint.stiffness[0] == 0.0:
        item.joint.stiffness[0] = 1e-6 * abs(item.torque(item.constant))
    item.joint.springref -= item.torque(item.constant) / item.joint.stiffness[0]


def _arm_friction(item: _Joint) -> None:
    """Friction on the arm: of its own velocity, not of that at which it leaves the motor."""
    damping = item.torque(item.part.nominal.get("arm_viscous", 0.0))
    share = item.behind
    if not item.body.bodies:
        item.joint.damping[0] += damping
        return
    if damping == 0.0 and share == 0.0:
        return
    tendon = item.spec.add_tendon(name=f"{item.name}_arm")
    tendon.damping[0], tendon.damping[1] = damping, share * item.joint.damping[1]
    tendon.frictionloss = share * item.joint.frictionloss
    tendon.solimp_friction, tendon.solref_friction = item.joint.solimp_friction, item.joint.solref_friction
    item.joint.damping[1] *= 1.0 - share
    item.joint.frictionloss *= 1.0 - share
    for name in (item.name, f"{item.name}_load"):
        tendon.wrap_joint(name, 1.0)


def _gravity(item: _Joint, *, single: bool) -> bool:
    """sine sin q + cosine cos q as the weight of an offset mass; half of the inertia is the mass's."""
    nominal = item.part.nominal
    sine = item.torque(nominal.get("gravity_sine", 0.0) + item.gravity[0])
    cosine = item.torque(nominal.get("gravity_cosine", 0.0) + item.gravity[1])
    size = math.hypot(sine, cosine)
    if size == 0.0:
        return True
    body = item.body if not item.body.bodies else item.body.bodies[0]
    if not single or item.part.position_unit != "rad":
        return False
    inertia = float(body.inertia[0])
    mass = 2.0 * size**2 / (inertia * STANDARD_GRAVITY**2)
    weight = mass * STANDARD_GRAVITY
    _set_inertia(body, mass, 0.5 * inertia, [-cosine / weight, 0.0, -sine / weight])
    return True


# Every element gets the joint and the effect's parameters (input-equivalent) and says whether MuJoCo has it.


def _lacks(item: _Joint, p: Values) -> bool:
    return False


def _dry(item: _Joint, p: Values) -> bool:
    item.joint.frictionloss += item.torque(p["torque"])
    item.joint.solimp_friction, item.joint.solref_friction = STIFF[0], (STIFF[1] * item.step, 1.0)
    return True


def _constrained(item: _Joint, p: Values) -> bool:
    if item.behind:  # which is one of dry friction, not of a constraint
        return False
    item.joint.frictionloss += item.torque(p["torque"])
    item.joint.solimp_friction = (p["hold"], p["hold"], 1e-3, 0.5, 2.0)
    item.joint.solref_friction = (2.0 * p["recovery_time"] / p["hold"], 1.0)
    return True


def _bristles(item: _Joint, name: str, lugre: list[float]) -> bool:
    passive = item.spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=item.name)
    passive.set_to_dcmotor(motorconst=[0.0, 0.0], resistance=1.0, lugre=lugre, ctrlspec=_PASSIVE)
    return True


def _stribeck(item: _Joint, p: Values) -> bool:
    if item.behind:
        return False
    stiffness = (2 * math.pi * BRISTLE_HERTZ) ** 2 * item.inertia
    damping = 0.2 * math.sqrt(stiffness * item.inertia)
    levels = [item.torque(p["torque"]), item.torque(p["torque"] + p["excess"]), p["velocity"]]
    return _bristles(item, f"{item.name}_stribeck", [stiffness, damping, *levels])


def _presliding(item: _Joint, p: Values) -> bool:
    torque = item.torque(p["torque"])
    stiffness = torque / p["deflection"]
    damping = stiffness * p["damping_time"]
    levels = [torque, torque * (1.0 + p.get("rise", 0.0)), p.get("velocity", 1.0)]
    return _bristles(item, f"{item.name}_bristle", [stiffness, damping, *levels])


def _drag(item: _Joint, p: Values) -> bool:
    item.joint.damping[1] += item.torque(p["coefficient"])
    return True


def _spring(item: _Joint, p: Values) -> bool:
    item.joint.stiffness[0] += item.torque(p["stiffness"])
    item.constant -= p["pull"]
    return True


def _stiffening_spring(item: _Joint, p: Values) -> bool:
    """A tendon of its own along the joint: a constant torque may move the rest of the joint's spring, not where this
    one is softest."""
    stiffness = item.torque(p["stiffness"])
    if stiffness <= 0.0:
        return False
    tendon = item.spec.add_tendon(name=f"{item.name}_cable")
    tendon.wrap_joint(item.joint.name, 1.0)
    tendon.stiffness = [stiffness, 0.0, stiffness * p["stiffening"]]
    tendon.springlength = [p["pull"] / p["stiffness"]] * 2
    return True


def _offset(item: _Joint, p: Values) -> bool:
    item.constant -= p["voltage"]
    return True


def _tilt(item: _Joint, p: Values) -> bool:
    item.gravity[0] += p["sine"]
    item.gravity[1] += p["cosine"]
    return True


def _cogging(item: _Joint, p: Values) -> bool:
    amplitude = item.torque(math.hypot(p["sine"], p["cosine"]))
    phase = math.atan2(p["cosine"], p["sine"]) + math.pi
    name = f"{item.name}_cogging_{len(item.spec.actuators)}"
    passive = item.spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=item.name)
    cogging = [amplitude, p["cycles_per_rev"], phase]
    passive.set_to_dcmotor(motorconst=[0.0, 0.0], resistance=1.0, cogging=cogging, ctrlspec=_PASSIVE)
    return True


def _heat(item: _Joint, p: Values) -> bool:
    if item.resistance == 0.0 or p["resistance_rise"] <= 0.0:
        return False
    rise, square = p["resistance_rise"], item.part.nominal["torque_square_mean"] / item.resistance**2
    thermal = rise / (1.0 + rise) / (COPPER * item.resistance * square)
    _motor(item, [thermal, 0.0, p["time_constant"], COPPER, AMBIENT, AMBIENT])
    return True


def _delay(item: _Joint, p: Values) -> bool:
    item.actuator.delay = p["delay"]
    item.actuator.nsample = max(2, math.ceil(p["delay"] / item.step) + 1)
    return True


def _lag(item: _Joint, p: Values) -> bool:
    if item.resistance != 0.0 or p["time_constant"] <= 0.0:
        return p["time_constant"] <= 0.0
    item.actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
    item.actuator.dynprm[0] = p["time_constant"]
    return True


def _clip(item: _Joint, p: Values) -> bool:
    item.actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    item.actuator.ctrlrange = [-p["voltage"], p["voltage"]]
    return True


def _split(item: _Joint, ratio: float) -> mujoco.MjsJoint:
    """Load of its own behind the motor; the joint between them measures how far the load is ahead."""
    axis = list(item.joint.axis)
    _set_inertia(item.body, float(item.body.mass) * (1.0 - ratio), item.inertia * (1.0 - ratio), [0.0, 0.0, 0.0])
    load = item.body.add_body(name=f"{item.name}_load_link")
    unit = item.part.position_unit
    mass = item.inertia * ratio
    _set_inertia(load, mass if unit == "m" else ratio, mass, [0.0, 0.0, 0.0])
    return _add_joint(load, f"{item.name}_load", unit, axis)


def _flexible(item: _Joint, p: Values) -> bool:
    if item.body.bodies or item.body.parent.name != "world":
        return False
    between = _split(item, p["inertia_ratio"])
    angular = 2.0 * math.pi * p["frequency"]
    load = item.inertia * p["inertia_ratio"]
    between.stiffness[0], between.damping[0] = load * angular**2, 2.0 * p["damping_ratio"] * load * angular
    return True


def _play(item: _Joint, p: Values) -> bool:
    if p["gap"] <= 0.0:  # what is left of a play is its spring
        return _flexible(item, p)
    if item.body.bodies or item.body.parent.name != "world":
        return False
    ratio = p["inertia_ratio"]
    between = _split(item, ratio)
    reduced = item.inertia * ratio * (1.0 - ratio)
    angular = 2.0 * math.pi * p["frequency"]
    stiffness, damping = item.inertia * ratio * angular**2, 2.0 * p["damping_ratio"] * item.inertia * ratio * angular
    between.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    between.range = [-0.5 * p["gap"], 0.5 * p["gap"]]
    # accelerations, hence per inertia; the impedance enters squared
    impedance = 0.9
    between.solimp_limit = (impedance, impedance, 1e-3, 0.5, 2.0)
    between.solref_limit = (-stiffness / reduced * impedance, -damping / reduced)
    return True


_ELEMENTS: dict[str, Callable[[_Joint, Values], bool]] = {
    "coulomb_friction": _dry,
    "constrained_coulomb_friction": _constrained,
    "stribeck_friction": _stribeck,
    "presliding_friction": _presliding,
    "presliding_friction_stribeck": _presliding,
    "quadratic_drag": _drag,
    "cable_spring": _spring,
    "cable_spring_stiffening": _stiffening_spring,
    "amplifier_offset": _offset,
    "gravity_tilt": _tilt,
    "cogging_torque": _cogging,
    "thermal_drift": _heat,
    "joint_flexibility": _flexible,
    "backlash": _play,
    "input_delay": _delay,
    "amplifier_lag": _lag,
    "voltage_saturation": _clip,
}


def simulate(xml: str, names: Sequence[str], command: Array, sample_time: float, initial: State) -> Array:
    """Positions (T, n) that MuJoCo gives for a held command (T, n), from `initial`."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    columns = [int(model.joint(name).qposadr[0]) for name in names]
    motors = [int(model.actuator_ctrladr[model.actuator(name).id]) for name in names]
    data.qpos[columns], data.qvel[[int(model.joint(n).dofadr[0]) for n in names]] = initial.position, initial.velocity
    mujoco.mj_forward(model, data)
    substeps = round(sample_time / model.opt.timestep)
    found = np.zeros((len(command), len(names)))
    with silent_mujoco():
        for k in range(len(command)):
            found[k] = data.qpos[columns]
            data.ctrl[motors] = command[k]
            mujoco.mj_step(model, data, nstep=substeps)
    return found


@contextmanager
def silent_mujoco() -> Iterator[None]:
    """Without MuJoCo's warnings and its log file in the working folder: a model that runs away shows in its motion."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def reproduction(model: StructuredModel, exported: Exported, names: Sequence[str], command: Array) -> Array:
    """Rms difference per joint (n,) between MuJoCo and the model without what MuJoCo lacks, from rest at 0."""
    ramp = np.linspace(0.0, 1.0, round(0.25 / model.sample_time))[:, None]
    command = np.concatenate([ramp * command[0], command])  # both begin at rest with nothing on its way
    plain = model.unrecorded()
    for joint, effect in exported.missing:
        plain = plain.without(joint, effect)
    start = State.at_rest(np.zeros(len(names)))
    time = model.sample_time * np.arange(len(command), dtype=float)
    ours = plain.simulate(time, command, start).position
    theirs = simulate(exported.xml, names, command, model.sample_time, start)
    return np.sqrt(np.mean((ours - theirs) ** 2, axis=0))
