"""A plant under construction: the robot's MuJoCo model without the braked joints, and the tables of the compiled loop.

Effects write themselves in (`Effect.install`); `finish` compiles the model and resolves names to places in it.

A joint with a flexible or loose transmission becomes two: the rotor keeps the joint's name and drive, the arm goes on
a joint ``NAME_load`` beside it, and a fixed tendon, MuJoCo's own spring with a dead band, connects them. Friction,
nominal viscous friction included, acts on the load.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from envs.log import Array
from envs.mjcf import robot_spec
from envs.plant.effects.base import Effect, EffectError, unit_of
from envs.plant.sensors import Sensors
from envs.plant.servo import PositionServo
from envs.plant.tables import (
    ACCELERATION,
    BRISTLE,
    COUPLING,
    CURRENT,
    DRIVE,
    EVENT,
    JOINT,
    SERVO,
    TERM,
    TORQUE,
    VOLTAGE,
    Tables,
    World,
)
from envs.robot import Joint, Robot

AMBIENT = 25.0
"""Ambient temperature [deg C], at which resistances are nominal."""

COPPER = 0.00393
"""Temperature coefficient of copper's resistance [1/K] at 20 deg C (IEC 60028)."""

_MODES = {"voltage": VOLTAGE, "current": CURRENT, "torque": TORQUE}

_PASSIVE = int(mujoco.mjtCtrlInput.mjINPUT_NONE)
"""Signature of an actuator without input."""

_STIFF_FRICTION = ((0.9999, 0.9999, 1e-3, 0.5, 2.0), 2.0)
"""Impedance, and time constant in steps, of MuJoCo's dry friction: creep at rest of some 1e-9 rad/s."""

_STEPS_PER_RADIAN = 2.0
"""Steps per radian of the fastest oscillation, and per time constant of the fastest decay."""


@dataclass
class Shaft:
    """A flexible or loose transmission as its effects have described it.

    Stiffness and damping of the spring, half of the play, damping of the contact, share of the inertia that is load,
    and the side that the encoder sits on; SI units.
    """

    stiffness: float
    damping: float
    half_gap: float
    contact_damping: float
    inertia_ratio: float
    encoder: str


@dataclass(frozen=True)
class Construction:
    """The finished plant: MuJoCo's model, initial data, tables, and the loop's step [s]."""

    model: mujoco.MjModel
    data: mujoco.MjData
    world: World
    tables: Tables
    substeps: int
    step: float


class Build:
    """A plant under construction; see the module. Effects use the methods without underscore.

    robot: the true one. free: joints that move; the others are braked at `pose` (n,) [rad or m]. sample_time [s].
    rms_currents: what the motors carry in this experiment [A rms], by joint; a fifth of the limit where unknown.
    jitter: rms of the recorder's clock [s].
    """

    def __init__(
        self,
        robot: Robot,
        free: tuple[int, ...],
        pose: Array,
        sensors: Sensors,
        sample_time: float,
        rms_currents: Mapping[int, float],
    ):
        self.robot, self.free, self.sensors = robot, free, sensors
        self.pose, self.sample_time = np.asarray(pose, dtype=np.float64), sample_time
        self.jitter = 0.0
        self._rms_currents = rms_currents
        held = {number: float(pose[number - 1]) for number in range(1, len(robot) + 1) if number not in free}
        self.spec = robot_spec(robot, held=held, scenery=False)
        self.drives = np.zeros(len(free), DRIVE)
        self.joints = np.zeros(len(free), JOINT)
        self.servos = np.zeros(len(free), SERVO)
        self.shafts: dict[int, Shaft] = {}
        self.extra_inertia: dict[int, float] = {}
        self.derived: dict[int, dict[str, dict[str, Any]]] = {}
        self._terms: list[tuple[int, int, float, float, float]] = []
        self._couplings: list[tuple[int, int, int, float]] = []
        self._bristles: dict[int, tuple[float, float, float]] = {}
        self._events: list[tuple[str, float, float, float]] = []
        self._tilted = False
        for number in free:
            self._describe(number)

    def joint_of(self, effect: Effect) -> Joint:
        """The effect's joint. Raises EffectError when it is braked or does not exist."""
        if effect.joint > len(self.robot):
            raise EffectError(f"{effect.name}: {self.robot.name} has joints 1..{len(self.robot)}, not {effect.joint}")
        if effect.joint not in self.free:
            raise EffectError(
                f"{effect.name}: joint {effect.joint} is braked and shows no effect. Excite it or choose one of "
                f"{', '.join(map(str, self.free))}"
            )
        return self.robot.joint(effect.joint)

    def drive(self, effect: Effect, *, only: tuple[str, ...] = ("voltage", "current", "torque")) -> np.void:
        """The effect's row of the drive table. Raises EffectError when the amplifier's kind is not among `only`."""
        kind = self.joint_of(effect).drive.amplifier
        if kind not in only:
            raise EffectError(
                f"{effect.name}: joint {effect.joint} has a {kind} amplifier. It needs {' or '.join(only)}"
            )
        return self.drives[self.free.index(effect.joint)]

    def row(self, effect: Effect) -> np.void:
        """The effect's row of the joint table."""
        self.joint_of(effect)
        return self.joints[self.free.index(effect.joint)]

    def servo(self, effect: Effect) -> np.void:
        """The effect's row of the servo table, which also holds the encoder."""
        self.joint_of(effect)
        return self.servos[self.free.index(effect.joint)]

    def add_term(self, effect: Effect, kind: int, a: float, b: float, c: float) -> None:
        """A torque on the load: see `tables.TERM`."""
        self.joint_of(effect)
        self._terms.append((kind, effect.joint, a, b, c))

    def add_coupling(self, effect: Effect, signal: int, source: int, coefficient: float) -> None:
        """A torque on the load in proportion to a signal of the free joint `source`."""
        self.joint_of(effect)
        if source not in self.free or source == effect.joint:
            raise EffectError(f"{effect.name}: joint {source} does not move beside joint {effect.joint}. Excite both")
        self._couplings.append((effect.joint, signal, source, coefficient))

    def add_bristle(self, effect: Effect, torque: float, stiffness: float, damping: float) -> None:
        """Presliding friction at the load: MuJoCo's LuGre states, in a passive actuator."""
        self.joint_of(effect)
        self._bristles[effect.joint] = (stiffness, damping, torque)

    def add_cogging(self, effect: Effect, amplitude: float, cycles: float, phase: float) -> None:
        """MuJoCo's cogging torque, in a passive actuator on the motor's axis; here it resists like all torques."""
        name = self.joint_of(effect).name
        motor = self.spec.actuator(name)
        passive = self.spec.add_actuator(name=f"{name}_cogging", trntype=motor.trntype, target=motor.target)
        passive.set_to_dcmotor(
            motorconst=[0.0, 0.0], resistance=1.0, cogging=[amplitude, cycles, phase + math.pi], ctrlspec=_PASSIVE
        )

    def add_winding_heat(self, effect: Effect, resistance_rise: float, time_constant: float, rms: float) -> None:
        """MuJoCo's thermal resistance: in the end `resistance_rise` under a current of `rms` [A]."""
        drive = self.joint_of(effect).drive
        # in equilibrium rise = COPPER Rth rms^2 R0 (1 + rise)
        thermal_resistance = resistance_rise / (1.0 + resistance_rise) / (COPPER * drive.resistance.value * rms**2)
        actuator = self.spec.actuator(self.robot.joint(effect.joint).name)
        current = drive.current_limit.value
        actuator.set_to_dcmotor(
            motorconst=[drive.motor_constant.value, 0.0],
            resistance=drive.resistance.value,
            saturation=[0.0, current if math.isfinite(current) else 0.0, 0.0],
            inductance=[drive.inductance.value, 0.0],
            thermal=[thermal_resistance, 0.0, time_constant, COPPER, AMBIENT, AMBIENT],
        )

    def rms_current(self, effect: Effect) -> float:
        """Current that the joint's motor carries in this experiment [A rms]."""
        limit = self.robot.joint(effect.joint).drive.current_limit.value
        return self._rms_currents.get(effect.joint, 0.2 * limit if math.isfinite(limit) else 1.0)

    def add_shaft(self, effect: Effect, inertia_ratio: float, encoder: str) -> Shaft:
        """The joint's shaft, to be described further. Raises EffectError when another effect sees it differently."""
        self.joint_of(effect)
        shaft = self.shafts.setdefault(effect.joint, Shaft(math.inf, 0.0, 0.0, 0.0, inertia_ratio, encoder))
        if (shaft.inertia_ratio, shaft.encoder) != (inertia_ratio, encoder):
            raise EffectError(
                f"{effect.name}: joint {effect.joint} already has inertia_ratio {shaft.inertia_ratio:g} and its "
                f"encoder on the {shaft.encoder} side. Give both effects the same"
            )
        return shaft

    def add_event(self, effect: Effect, inertia: float, time: float) -> None:
        """From `time` on the last joint's body, the tool, is heavier by so much that the joint feels `inertia` more.

        Raises EffectError when the body would be left without mass.
        """
        joint, spec = self.joint_of(effect), self.robot.body.spec()
        tool = spec.joint(self.robot.joints[-1].name).parent.name
        if not tool:
            raise EffectError(f"{effect.name}: the last joint moves a body without a name. Name it in the description")
        model, data = self._posed(spec)
        body, dof = model.body(tool).id, int(model.joint(joint.name).dofadr[0])
        before = _inertia(model, data)[dof, dof]
        model.body_mass[body] += 1.0
        per_mass = _inertia(model, data)[dof, dof] - before
        model.body_mass[body] -= 1.0
        turning = per_mass < 1e-6
        mass, moment = (0.0, inertia) if turning else (inertia / per_mass, 0.0)
        left = float(model.body_inertia[body].min()) + moment if turning else float(model.body_mass[body]) + mass
        if left <= 0.0:
            raise EffectError(f"{effect.name}: inertia {inertia:g} takes more than the tool has. Give a larger number")
        self._events.append((tool, time, mass, moment))

    def tilt(self, effect: Effect, torque: float, phase: float) -> bool:
        """Tilts gravity so that the joint feels torque sin(q + phase) at the pose; False when gravity cannot do it.

        Raises EffectError when that takes more than all of gravity, or when the base is tilted already.
        """
        joint = self.joint_of(effect)
        pull = np.array([[self._gravity_torque(joint, axis, angle) for axis in (0, 1)] for angle in (0.0, 0.5 * np.pi)])
        if joint.kind != "revolute" or abs(np.linalg.det(pull)) < 1e-12:
            return False
        horizontal = np.linalg.solve(pull, torque * np.array([math.sin(phase), math.cos(phase)]))
        gravity = np.array(self.spec.option.gravity)
        strength = float(np.linalg.norm(gravity))
        if np.linalg.norm(horizontal) >= strength:
            largest = abs(torque) * strength / float(np.linalg.norm(horizontal))
            raise EffectError(f"{effect.name}: a lying base gives {largest:.3g} N m at most. Give a smaller torque")
        if self._tilted:
            raise EffectError(f"{effect.name}: the base is tilted already. Give one tilt, which acts on all joints")
        self._tilted = True
        upright = math.sqrt(strength**2 - float(horizontal @ horizontal))
        self.spec.option.gravity = [*horizontal, math.copysign(upright, gravity[2])]
        return True

    def inertia(self, effect: Effect) -> float:
        """Inertia that the joint's motor feels at the pose [kg m^2 or kg]."""
        number = effect.joint - 1
        return float(self.robot.inertia_matrix(self.pose)[number, number])

    def add_inertia(self, effect: Effect, inertia: float) -> None:
        """Inertia about the joint's axis beyond the robot's."""
        self.joint_of(effect)
        self.extra_inertia[effect.joint] = self.extra_inertia.get(effect.joint, 0.0) + inertia

    def load_joint(self, effect: Effect) -> mujoco.MjsJoint:
        """The joint that carries the arm, to be given springs and drag. To be called before `finish`."""
        return self.spec.joint(self.joint_of(effect).name)

    def note(self, effect: Effect, name: str, dimension: str, value: float) -> None:
        """A number of the effect that was derived from the robot, for the truth."""
        joint = self.robot.joint(effect.joint)
        unit = unit_of(dimension, joint.kind, joint.drive.command)
        self.derived.setdefault(id(effect), {})[name] = {"value": value, "unit": unit}

    def add_servo(self, servo: PositionServo, feed: Array) -> None:
        """A position servo on top of the commands `feed` (n,), which hold the pose."""
        self.servos["feed"] = feed
        for index, number in enumerate(servo.joints):
            line = self.servos[self.free.index(number)]
            line["active"] = 1
            line["proportional"], line["derivative"] = servo.proportional[index], servo.derivative[index]
            line["integral"] = servo.integral[index] if servo.integral else 0.0
            line["filter"] = -math.expm1(-self.sample_time / servo.filter_time)

    def finish(self, longest_step: float) -> Construction:
        """The plant, ready to run in steps of at most `longest_step` [s]."""
        for number in self.free:
            if number in self.shafts:
                self._split(number)
            elif number in self.extra_inertia:
                self.spec.joint(self._name(number)).armature += self.extra_inertia[number]
        self._rewire()
        for number, (stiffness, damping, torque) in self._bristles.items():
            passive = self.spec.add_actuator(name=f"{self._name(number)}_bristle", target=self._load_name(number))
            passive.trntype = mujoco.mjtTrn.mjTRN_JOINT
            lugre = [stiffness, damping, torque, torque, 1.0]
            passive.set_to_dcmotor(motorconst=[0.0, 0.0], resistance=1.0, lugre=lugre, ctrlspec=_PASSIVE)
        for joint in self.spec.joints:
            joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        for row, number in enumerate(self.free):
            if self.joints[row]["dry"]:
                self.spec.joint(self._load_name(number)).frictionloss = 1.0
        model = self.spec.compile()
        # MuJoCo would let the force use the current at the step's end; the loop integrates the current itself
        model.actuator_actearly[:] = 0
        data = mujoco.MjData(model)
        self._place(model, data)
        self._check_inertia(model, data)
        tables = self._tables(model)
        substeps = self._substeps(model, data, longest_step)
        model.opt.timestep = self.sample_time / substeps
        impedance, steps = _STIFF_FRICTION
        model.dof_solimp[:], model.dof_solref[:] = impedance, (steps * model.opt.timestep, 1.0)
        mujoco.mj_forward(model, data)
        world = World(
            model._address,
            data._address,
            data.qpos,
            data.qvel,
            data.act,
            data.qacc,
            data.act_dot,
            data.ctrl,
            data.qfrc_applied,
            model.dof_frictionloss,
            model.actuator_dynprm,
            model.body_mass,
            model.body_inertia,
        )
        return Construction(model, data, world, tables, substeps, self.sample_time / substeps)

    def _describe(self, number: int) -> None:
        joint, row = self.robot.joint(number), self.free.index(number)
        item = joint.drive
        drive, line, servo = self.drives[row], self.joints[row], self.servos[row]
        drive["mode"] = _MODES[item.amplifier]
        drive["gain"], drive["voltage_limit"] = item.amplifier_gain.value, item.voltage_limit.value
        drive["current_limit"], drive["constant"] = item.current_limit.value, item.torque_constant
        drive["resistance"], drive["inductance"] = item.resistance.value, item.inductance.value
        drive["temperature_coefficient"], drive["saturation"] = COPPER, math.inf
        line["stribeck_velocity"] = 1.0
        servo["encoder_step"] = self.sensors.encoder_step(joint)
        servo["command_step"], servo["command_limit"] = item.command_step or 0.0, item.command_limit.value
        servo["eccentricity_cycles"] = 1.0

    def _name(self, number: int) -> str:
        return self.robot.joint(number).name

    def _load_name(self, number: int) -> str:
        return f"{self._name(number)}_load" if number in self.shafts else self._name(number)

    def _posed(self, spec: mujoco.MjSpec) -> tuple[mujoco.MjModel, mujoco.MjData]:
        model = spec.compile()
        data = mujoco.MjData(model)
        for joint, angle in zip(self.robot.joints, self.pose, strict=True):
            data.qpos[model.joint(joint.name).qposadr] = angle
        return model, data

    def _gravity_torque(self, joint: Joint, axis: int, angle: float) -> float:
        """Torque of a unit gravity along a horizontal axis, on the left of the equation of motion, at q = angle."""
        spec = self.robot.body.spec()
        spec.option.gravity = np.eye(3)[axis]
        model, data = self._posed(spec)
        data.qpos[model.joint(joint.name).qposadr] = angle
        mujoco.mj_forward(model, data)
        return float(data.qfrc_bias[model.joint(joint.name).dofadr[0]])

    def _split(self, number: int) -> None:
        """Rotor and load of a joint on axes of their own; the joint's inertia at the pose is shared between them."""
        shaft, name = self.shafts[number], self._name(number)
        body_inertia = float(self.robot.body.inertia_matrix(self.pose)[number - 1, number - 1])
        load = self.spec.joint(name)
        total = body_inertia + load.armature + self.extra_inertia.get(number, 0.0)
        body = load.parent
        rotor_body = body.parent.add_body(
            name=f"{name}_rotor", pos=body.pos, quat=body.quat, mass=1e-9, inertia=[1e-9] * 3, explicitinertial=True
        )
        load.name = f"{name}_load"
        rotor = rotor_body.add_joint(name=name, type=load.type, axis=load.axis, pos=load.pos)
        rotor.armature = (1.0 - shaft.inertia_ratio) * total
        load.armature = shaft.inertia_ratio * total - body_inertia
        spring = self.spec.add_tendon(name=f"{name}_shaft", springlength=[-shaft.half_gap, shaft.half_gap])
        spring.stiffness[0], spring.damping[0] = shaft.stiffness, shaft.damping
        spring.wrap_joint(rotor.name, 1.0)
        spring.wrap_joint(load.name, -1.0)
        line = self.joints[self.free.index(number)]
        line["shaft_stiffness"], line["half_gap"] = shaft.stiffness, shaft.half_gap
        line["contact_damping"] = shaft.contact_damping

    def _rewire(self) -> None:
        """Tendons of motors that several joints turn: the names that joints have now, braked joints left out."""
        for number in self.free:
            actuator = self.spec.actuator(self._name(number))
            if actuator.trntype != mujoco.mjtTrn.mjTRN_TENDON:
                continue
            old = self.spec.tendon(actuator.target)
            name, armature = old.name, old.armature
            self.spec.delete(old)
            tendon = self.spec.add_tendon(name=name, armature=armature)
            for other in self.free:
                share = self.robot.coupling_matrix[number - 1, other - 1]
                if share:
                    tendon.wrap_joint(self._name(other) if other == number else self._load_name(other), share)

    def _place(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        for number in self.free:
            for name in {self._name(number), self._load_name(number)}:
                data.qpos[model.joint(name).qposadr] = self.pose[number - 1]

    def _check_inertia(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        matrix = _inertia(model, data)
        if np.linalg.eigvalsh(matrix).min() <= 0.0:
            raise EffectError(
                "joint_flexibility, backlash or parameter_mismatch leave the load no inertia while other joints move. "
                "Raise inertia_ratio or factor"
            )
        inverse = np.linalg.inv(matrix)
        for number, signal, source, coefficient in self._couplings:
            dofs = [int(model.joint(self._load_name(joint)).dofadr[0]) for joint in (source, number)]
            if signal == ACCELERATION and abs(coefficient * inverse[dofs[0], dofs[1]]) > 0.5:
                raise EffectError(
                    f"axis_coupling: {coefficient:g} times joint {source}'s acceleration outweighs the inertia of "
                    f"joint {number}. Give less than {0.5 / abs(inverse[dofs[0], dofs[1]]):.3g}"
                )

    def _tables(self, model: mujoco.MjModel) -> Tables:
        dof = {number: int(model.joint(self._load_name(number)).dofadr[0]) for number in self.free}
        for row, number in enumerate(self.free):
            line, drive, name = self.joints[row], self.drives[row], self._name(number)
            line["rotor"], line["load"] = int(model.joint(name).dofadr[0]), dof[number]
            behind = number in self.shafts and self.shafts[number].encoder == "load"
            line["encoder"] = line["load"] if behind else line["rotor"]
            actuator = model.actuator(name).id
            drive["actuator"], drive["control"] = actuator, model.actuator_ctrladr[actuator]
            first, count = int(model.actuator_actadr[actuator]), int(model.actuator_actnum[actuator])
            winding = drive["mode"] == VOLTAGE and drive["inductance"] > 0.0
            heated = drive["mode"] == VOLTAGE and model.actuator_dynprm[actuator, 2] > 0.0
            drive["heat"] = first if heated else -1
            drive["current"] = first + count - 1 if winding else -1
        return Tables(
            drives=self.drives,
            joints=self.joints,
            turns=self._turns(model),
            terms=np.array([(kind, dof[number], a, b, c) for kind, number, a, b, c in self._terms], TERM),
            couplings=np.array(
                [
                    (dof[number], signal, self.free.index(other), value)
                    for number, signal, other, value in self._couplings
                ],
                COUPLING,
            ),
            bristles=np.array(
                [
                    (_activation(model, f"{self._name(number)}_bristle"), dof[number], stiffness, torque)
                    for number, (stiffness, _, torque) in self._bristles.items()
                ],
                BRISTLE,
            ),
            events=np.array([(model.body(tool).id, *numbers) for tool, *numbers in self._events], EVENT),
            servos=self.servos,
        )

    def _turns(self, model: mujoco.MjModel) -> NDArray[np.float64]:
        turns = np.zeros((len(self.free), model.nv))
        for row, number in enumerate(self.free):
            for other in self.free:
                share = self.robot.coupling_matrix[number - 1, other - 1]
                name = self._name(other) if other == number else self._load_name(other)
                turns[row, int(model.joint(name).dofadr[0])] = share
        return turns

    def _substeps(self, model: mujoco.MjModel, data: mujoco.MjData, longest_step: float) -> int:
        """Steps per sample such that the fastest mode of springs, windings and dampers is followed."""
        mujoco.mj_forward(model, data)
        inverse = np.linalg.inv(_inertia(model, data))
        rates = [1.0 / longest_step]
        for shaft, row in ((self.shafts[number], self.free.index(number)) for number in self.shafts):
            relative = np.zeros(model.nv)
            relative[self.joints[row]["rotor"]], relative[self.joints[row]["load"]] = 1.0, -1.0
            compliance = float(relative @ inverse @ relative)
            rates.append(_STEPS_PER_RADIAN * math.sqrt(shaft.stiffness * compliance))
            rates.append(_STEPS_PER_RADIAN * (shaft.damping + shaft.contact_damping) * compliance)
        for row in range(len(self.free)):
            drive = self.drives[row]
            back = drive["constant"] ** 2 * inverse[self.joints[row]["rotor"], self.joints[row]["rotor"]]
            if drive["current"] >= 0:
                rates.append(_STEPS_PER_RADIAN * drive["resistance"] / drive["inductance"])
                rates.append(_STEPS_PER_RADIAN * math.sqrt(back / drive["inductance"]))
            elif drive["mode"] == VOLTAGE:
                rates.append(_STEPS_PER_RADIAN * back / drive["resistance"])
        for number, (stiffness, _, _) in self._bristles.items():
            dof = self.joints[self.free.index(number)]["load"]
            rates.append(_STEPS_PER_RADIAN * math.sqrt(stiffness * inverse[dof, dof]))
        return math.ceil(self.sample_time * max(rates) - 1e-9)


def _activation(model: mujoco.MjModel, actuator: str) -> int:
    return int(model.actuator_actadr[model.actuator(actuator).id])


def _inertia(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.float64]:
    """Joint-space inertia matrix at the data's position."""
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    return full
