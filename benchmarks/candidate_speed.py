"""Speed at which a diagnosis simulates candidates: eight at a time, one at a time, and `mujoco.rollout`.

    uv run python -m benchmarks.candidate_speed [--candidates C] [--samples T] [--repeats R]

C candidates run along a log of T samples, on one thread, in steps of 1 ms of the fourth-order Runge-Kutta method.
Printed are nanoseconds per step of one candidate and how many times faster eight at a time are; of the last model, two
links that act on one another, four go at a time. MuJoCo knows neither a play nor a winding's lag; where it has the
model, it simulates the same joint without a lag and without a comparison to the log. The best of several alternating
repeats counts.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.rollout import rollout, seconds
from envs.log import Array
from methods.effects import vocabulary
from methods.kernel import BEGINNING, LANES, NOMINAL, Kernel, build

STEP = 1e-3
"""Step and sampling time [s]."""
MODELS: Mapping[str, Mapping[str, Sequence[float]]] = {
    "rigid": {},
    "Coulomb friction": {"coulomb_friction": (0.05,)},
    "Stribeck friction": {"stribeck_friction": (0.05, 0.05, 0.2, 1.0)},
    "gravity": {"gravity_tilt": (0.3, 0.1)},
    "torque ripple": {"torque_ripple": (0.03, 0.02, 12.0)},
    "flexible joint": {"joint_flexibility": (0.3, 20.0, 0.05)},
    "backlash": {"backlash": (0.01, 0.3, 30.0, 0.2)},
}
"""Effects with their parameters, input-equivalent, of each model."""
PAIR = "planar pair"
INERTIA, VISCOUS, BACK_EMF = 0.1, 0.05, 0.2
"""Of the joint."""


def main() -> None:
    """Prints a line per model."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    for name, value in (("candidates", 8), ("samples", 20_000), ("repeats", 5)):
        parser.add_argument(f"--{name}", type=int, default=value)
    chosen = parser.parse_args()
    kernel, steps = build(tuple(vocabulary())), chosen.candidates * chosen.samples
    print(
        f"{'ns per step':18}{'eight at a time':>18}{'one at a time':>18}{'ratio':>8}{'mujoco.rollout':>18}{'ratio':>8}"
    )
    for name, effects in (*MODELS.items(), (PAIR, {})):
        joints = 2 if name == PAIR else 1
        runs = [_in_lanes(kernel, effects, chosen, at_once, joints) for at_once in (LANES, 1)]
        if joints == 1 and set(effects) <= {"coulomb_friction"}:
            runs.append(_mujoco(effects, chosen))
        for run in runs:
            run()
        best = np.min([[seconds(run) for run in runs] for _ in range(chosen.repeats)], axis=0) / steps * 1e9
        line = f"{name:18}{best[0]:18.1f}{best[1]:18.1f}{best[1] / best[0]:8.1f}"
        print(line + (f"{best[2]:18.1f}{best[2] / best[0]:8.1f}" if len(best) > 2 else ""))


def _candidates(kernel: Kernel, effects: Mapping[str, Sequence[float]], count: int) -> tuple[Array, NDArray[np.bool_]]:
    """Parameters (C, 1, 1, columns) that differ a little, and switches (C, 1, effects)."""
    parameters: Array = np.zeros((count, 1, 1, kernel.columns))
    switches = np.zeros((count, 1, len(kernel.effects)), dtype=np.bool_)
    for name, value in (("inertia", INERTIA), ("viscous", VISCOUS), ("back_emf", BACK_EMF)):
        parameters[..., NOMINAL.index(name)] = value * (1.0 + 1e-3 * np.arange(count))[:, None, None]
    parameters[..., NOMINAL.index("electrical_time_constant")] = 3e-3
    for effect in kernel.effects:
        if effect.name in effects:
            switches[:, 0, kernel.switches[effect.name]] = True
            parameters[..., kernel.own(effect)] = effects[effect.name]
    return parameters, switches


def _log(samples: int) -> tuple[Array, Array]:
    """Instants (T,) and command (T, 1)."""
    instants: Array = STEP * np.arange(samples, dtype=float)
    return instants, (np.sin(7.0 * instants) + 0.3 * np.sin(31.0 * instants))[:, None]


def _in_lanes(
    kernel: Kernel, effects: Mapping[str, Sequence[float]], chosen: argparse.Namespace, at_once: int, joints: int
) -> Callable[[], None]:
    """All candidates, so many at once."""
    parameters, switches = _candidates(kernel, effects, chosen.candidates)
    instants, command = _log(chosen.samples)
    parameters, switches = np.repeat(parameters, joints, axis=2), np.repeat(switches, joints, axis=1)
    command = np.repeat(command, joints, axis=1)
    cumulative = np.vstack([np.zeros((1, joints)), np.cumsum(command[:-1], axis=0)])
    hold, bounds, near = np.zeros(joints, dtype=np.int64), np.array([0, chosen.samples]), np.zeros((0, joints, 3))
    starts = np.zeros((chosen.candidates, 1, joints, len(BEGINNING)))
    rigid = np.tile([0.3 * INERTIA, 1.0, 0.9 * INERTIA], (chosen.candidates, 1))
    out = np.empty((chosen.candidates, chosen.samples, joints))
    reading, extra = 0.2 * command, np.zeros((0, 0, joints))

    def run() -> None:
        for first in range(0, chosen.candidates, at_once):
            some = slice(first, first + at_once)
            kernel.batch(
                *(instants, command, cumulative, hold, reading, near, extra, bounds, starts[some], parameters[some]),
                *(switches[some], joints > 1, rigid[some], 30.0, 0.0, 1, out[some]),
            )

    return run


def _mujoco(effects: Mapping[str, Sequence[float]], chosen: argparse.Namespace) -> Callable[[], None]:
    """The same joint under the same commands, in MuJoCo's batched simulation on one thread."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = np.zeros(3)
    body = spec.worldbody.add_body(name="link", mass=1e-9, inertia=[1e-12] * 3)
    body.explicitinertial = True
    friction = effects.get("coulomb_friction", (0.0,))[0]
    damping = VISCOUS + BACK_EMF
    body.add_joint(name="q", type=mujoco.mjtJoint.mjJNT_HINGE, armature=INERTIA, damping=damping, frictionloss=friction)
    motor = spec.add_actuator(name="motor", target="q", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.gainprm[0] = 1.0
    return rollout(spec.compile(), np.tile(_log(chosen.samples)[1], (chosen.candidates, 1, 1)), np.zeros(1))


if __name__ == "__main__":
    main()
