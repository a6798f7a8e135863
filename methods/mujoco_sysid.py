"""MuJoCo's own identification toolbox, `mujoco.sysid`, on the MJCF of one joint.

The joint is a MuJoCo model of its own, in units of the command: armature (inertia), damping, frictionloss, a `dcmotor`
whose constant and resistance both are the back-EMF (so that its torque is what is left of the command) with its
inductance, gravity as a point mass in a turned field, and a constant load as a second motor. `mujoco.sysid` simulates
segments of the logs from the measured states and minimises the normalised error of the position by its own
Gauss-Newton method (Google DeepMind, MuJoCo 3.5 and later, module `mujoco.sysid`). The start is IDIM-LS.

What is found is handed over as the same joint of `methods.structured`, whose dry friction sticks exactly where
MuJoCo's constraint creeps.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np

from envs.log import Array, Log
from methods.base import Fit, Method, MethodError, State, Status
from methods.idim_least_squares import IdimLeastSquares
from methods.joint_model import JointModel
from methods.physical_joint import FRICTION, SIGNED, coefficient_estimates, physical_model, physical_parameters
from methods.registry import METHODS
from methods.usable_logs import check_joint

ARM = 1e-6
"""Lever of the point mass that gravity pulls at [m]; its own inertia, the square, is nothing."""


def toolbox() -> ModuleType:
    """`mujoco.sysid`. Raises MethodError without its extra: the module then imports, but empty."""
    found = importlib.import_module("mujoco.sysid")
    if not hasattr(found, "optimize"):
        raise MethodError(
            "mujoco.sysid is there but empty: its extra is not installed", remedy='pip install "mujoco[sysid]"'
        )
    return found


@METHODS.register("mujoco_sysid", "single-joint", "physics")
@dataclass(frozen=True)
class MujocoSysid(Method):
    """segment: length simulated from one measured state [s]. seconds: of the logs that are used, evenly spread.

    substeps: per sample; MuJoCo's motor lets the force use the current at the step's end, an error of first order in
    the step. iterations: at most. spread: factor by which a parameter may leave its start.
    """

    start: IdimLeastSquares = field(default_factory=IdimLeastSquares)
    segment: float = 2.0
    seconds: float = 8.0
    substeps: int = 2
    iterations: int = 8
    spread: float = 10.0

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Consumes no random numbers. Residuals are those of the position, over its deviation in each segment."""
        begin = time.perf_counter()
        sysid = toolbox()
        joint, facts = check_joint(logs)
        first = self.start.fit(logs, rng)
        assert isinstance(first.model, JointModel)
        guess = physical_parameters(first.model)
        scale = np.array([max(abs(v), self._floor(logs, n, v)) for n, v in guess.items()])
        parameters = sysid.ParameterDict()
        for (name, value), size in zip(guess.items(), scale, strict=True):
            signed = name in SIGNED
            low, high = (-self.spread, self.spread) if signed else (1.0 / self.spread, self.spread)
            low = 1e-6 if name == FRICTION else low
            nominal = float(np.clip(value / size, max(low, 1e-3) if not signed else low, high))
            parameters.add(sysid.Parameter(name, nominal, low, high))

        step = logs[0].sample_time / self.substeps

        def built(candidate: Any, spec: Any) -> Any:
            values = (candidate.as_vector() * scale).tolist()
            return joint_spec(dict(zip(guess, values, strict=True)), step).compile()

        sequences = self._sequences(sysid, logs, joint_spec(guess, step), guess)
        residual = sysid.build_residual_fn(
            models_sequences=[sequences],
            build_model=built,
            modify_residual=self._at_samples,
            n_threads=1,
            resample_true=False,
        )
        with contextlib.redirect_stdout(io.StringIO()):  # its progress cannot be switched off
            found, result = sysid.optimize(parameters, residual, verbose=False, max_iters=self.iterations, eps=1e-5)
        named = dict(zip(guess, (found.as_vector() * scale).tolist(), strict=True))
        errors = np.concatenate([np.ravel(part) for part in residual(result.x, found)[0]])
        return Fit(
            model=physical_model(joint, facts, named, logs),
            estimates=coefficient_estimates(named, self._covariance(result, errors, scale), facts),
            residuals=errors,
            status=Status.CONVERGED,
            seconds=time.perf_counter() - begin,
            notes=(f"{len(sequences.sequence_name)} segments of {self.segment:g} s from measured states",),
        )

    def _floor(self, logs: Sequence[Log], name: str, value: float) -> float:
        """A size for parameters that start at nothing."""
        deviation = float(np.std(np.concatenate([log.command for log in logs])))
        return 0.0 if name in ("inertia", "electrical_time_constant") else 0.01 * deviation

    def _at_samples(self, candidate: Any, predicted: Any, measured: Any, *_: Any, **__: Any) -> tuple[Array, Any, Any]:
        """Errors at the log's samples [1], over the deviation of the position, with both signals there."""
        at = measured.data[1:]
        reached = predicted.data[self.substeps - 1 :: self.substeps]
        same = type(measured)(measured.times[1:], at, measured.signal_mapping)
        return (at - reached) / np.std(at), type(measured)(same.times, reached, measured.signal_mapping), same

    def _sequences(self, sysid: ModuleType, logs: Sequence[Log], spec: Any, guess: dict[str, float]) -> Any:
        """The used segments, with measured states and commands as held over each step."""
        model = spec.compile()
        names, states, controls, sensors = [], [], [], []
        for log, part in zip(logs, self.start.preparation.signals(logs), strict=True):
            length = min(round(self.segment / log.sample_time), len(part) - 1)
            count = max(1, min((len(part) - 1) // length, round(self.seconds / len(logs) / self.segment)))
            command = log.command[:, 0]
            if log.facts[0].hold == "first_order":
                command = np.append(0.5 * (command[1:] + command[:-1]), command[-1])
            for first in np.linspace(0, len(part) - 1 - length, count).astype(int):
                state = part.motion.state(int(first))
                rows = slice(part.start + first, part.start + first + length + 1)
                clock = log.sample_time * np.arange(length + 1)
                held = np.repeat(command[rows][:-1], self.substeps)
                steps = log.sample_time / self.substeps * np.arange(len(held) + 1)
                control = np.column_stack((np.append(held, held[-1]), np.ones(len(held) + 1)))
                act = np.array([initial_current(guess, state)])[: model.na]
                names.append(f"{log.name} {part.start + first}")
                states.append(sysid.create_initial_state(model, state.position, state.velocity, act))
                controls.append(sysid.TimeSeries.from_control_names(steps, control, model))
                sensors.append(sysid.TimeSeries.from_names(clock, log.position[rows], model, ["position"]))
        return sysid.ModelSequences("joint", spec, names, states, controls, sensors)

    def _covariance(self, result: Any, errors: Array, scale: Array) -> Array:
        """s^2 (J'J)^-1 where the optimiser hands over its Jacobian, else NaN."""
        jacobian = np.asarray(getattr(result, "jac", np.zeros((0, 0))))
        if jacobian.shape != (len(errors), len(scale)):
            return np.full((len(scale), len(scale)), np.nan)
        inverse = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
        return float(np.mean(errors**2)) * inverse * np.outer(scale, scale)


def initial_current(parameters: dict[str, float], state: State) -> float:
    """Current of the motor [1] under which the joint moves as measured."""
    torque = parameters["inertia"] * state.acceleration[0] + parameters.get("load", 0.0)
    torque += parameters[FRICTION] * np.sign(state.velocity[0]) + parameters.get("viscous", 0.0) * state.velocity[0]
    torque += parameters.get("gravity_sine", 0.0) * np.sin(state.position[0])
    torque += parameters.get("gravity_cosine", 0.0) * np.cos(state.position[0])
    return float(torque / parameters.get("back_emf", 1.0))


def joint_spec(parameters: dict[str, float], timestep: float) -> Any:
    """The joint as an `MjSpec`: actuators `drive` (control: the command) and `load` (control: 1), sensor `position`.

    A linear axis is a hinge too, whose radians stand for metres: without gravity's turning the equations are the same.
    """
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.option.gravity = [
        parameters.get("gravity_sine", 0.0) / ARM,
        -parameters.get("gravity_cosine", 0.0) / ARM,
        0.0,
    ]
    body = spec.worldbody.add_body(name="body")
    body.explicitinertial = True
    body.mass, body.ipos, body.inertia = 1.0, [ARM, 0.0, 0.0], [1e-12] * 3
    joint = body.add_joint(name="joint", axis=[0.0, 0.0, 1.0])
    joint.armature = parameters["inertia"]
    joint.damping = np.full_like(joint.damping, 0.0)
    joint.damping[0] = parameters.get("viscous", 0.0)
    joint.frictionloss = parameters[FRICTION]
    joint.solref_friction, joint.solimp_friction = (
        [2.0 * timestep, 1.0],
        [0.99, 0.999, 0.001, 0.5, 2.0],
    )  # hardly creeps
    drive = spec.add_actuator(name="drive", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="joint")
    constant = parameters.get("back_emf", 0.0)
    if constant > 0.0:
        drive.set_to_dcmotor(
            motorconst=[constant, 0.0],
            resistance=constant,
            saturation=[0.0, 0.0, 0.0],
            inductance=[constant * parameters.get("electrical_time_constant", 0.0), 0.0],
        )
    else:
        drive.set_to_motor()
    load = spec.add_actuator(name="load", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="joint")
    load.set_to_motor()
    load.gear[0] = -parameters.get("load", 0.0)
    spec.add_sensor(
        name="position", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname="joint"
    )
    return spec
