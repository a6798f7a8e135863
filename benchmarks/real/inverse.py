"""What a model's command lacks on a recording, sample by sample: the picture of what a nominal model gets wrong.

From smoothed position, velocity and acceleration the model says which command it would have needed; the recorded one
less that is the missing command. Only for pictures: estimates come from free simulation (`windowed`), since the noise
of the acceleration biases a regression.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.real.windowed import COUPLING, Model, effect
from diagnosis.problem import smooth_derivatives
from envs.log import Array, Log

SMOOTHING = 0.05
"""Window of the local cubic fits [s]."""


@dataclass(frozen=True, eq=False)
class Missing:
    """Signals of one joint, each (T,): time, position, velocity, acceleration, motor torque, missing command."""

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    torque: Array
    command: Array


def missing(log: Log, model: Model, index: int = 0, seconds: float = SMOOTHING) -> Missing:
    """The command that a model lacks on joint `index` of a log (0 or 1 of a planar pair), smoothed over `seconds`."""
    held = np.vstack([log.command[:1], 0.5 * (log.command[1:] + log.command[:-1])])
    zero_order = [fact.hold == "zero_order" for fact in log.facts]
    u = smooth_derivatives(log.time, np.where(zero_order, held, log.command), seconds)[0]
    q, dq, ddq = smooth_derivatives(log.time, log.position, seconds)
    value = {(f.label, f.joint): v for f, v in zip(model.free, model.values, strict=True)}
    get = lambda name, j=index: value.get((name, j), 0.0)  # noqa: E731
    x, v, a = q[:, index], dq[:, index], ddq[:, index]
    lag = get("amplifier_lag.time_constant")
    command = u[:, index]
    for name in ("amplifier_offset", "dead_zone", "voltage_saturation", "supply_sag"):
        command = _slot(model, name, index, log.time, x, v, command, command)
    if lag:
        command = command - lag * np.gradient(command, log.time)
    w = command - get("back_emf") * v
    gain = np.ones_like(w)
    resisting = get("viscous") * v + get("load")
    level = np.zeros_like(w)
    for name in _effects(model, index):
        slot = effect(name).slot
        if slot == "gain":
            gain = gain * _slot(model, name, index, log.time, x, v, w, gain)
        elif slot == "torque":
            resisting = resisting + _slot(model, name, index, log.time, x, v, w, resisting)
        elif slot == "friction":
            level = level + _slot(model, name, index, log.time, x, v, w, level)
    level = level + get("presliding_friction.torque")
    direction = np.tanh(v / (0.01 * np.std(v) + 1e-12))
    needed = _inertial(value, q, dq, ddq, index) + resisting + level * direction
    inner = slice(len(x) // 100, len(x) - len(x) // 100)
    return Missing(*(s[inner] for s in (log.time, x, v, a, w, needed - gain * w)))


def _inertial(value: dict[tuple[str, int], float], q: Array, dq: Array, ddq: Array, index: int) -> Array:
    """Inertia, coupling and gravity of one joint, alone or in a planar pair."""
    get = lambda name, j=index: value.get((name, j), 0.0)  # noqa: E731
    p3, p2 = (value.get((name, 0), 0.0) for name in (COUPLING[0], COUPLING[2]))
    if not p2:
        angle = q[:, index]
        found: Array = get("inertia") * ddq[:, index]
    else:
        c, s = np.cos(q[:, 1]), np.sin(q[:, 1])
        m12, angle = p2 + p3 * c, q.sum(axis=1)
        if index == 1:
            found = m12 * ddq[:, 0] + get("inertia") * ddq[:, 1] + p3 * s * dq[:, 0] ** 2
        else:
            found = (get("inertia") + p2 + 2 * p3 * c) * ddq[:, 0] + m12 * ddq[:, 1]
            found = found - p3 * s * (2 * dq[:, 0] * dq[:, 1] + dq[:, 1] ** 2)
            found = found + get("gravity_sine", 1) * np.sin(angle) + get("gravity_cosine", 1) * np.cos(angle)
            angle = q[:, 0]
    gravity: Array = get("gravity_sine") * np.sin(angle) + get("gravity_cosine") * np.cos(angle)
    return found + gravity


def _effects(model: Model, index: int) -> list[str]:
    """Names of the model's effects on a joint whose equation acts on torques."""
    names = {f.owner for f in model.free if f.joint == index and f.owner not in ("nominal", "coupling")}
    return sorted(name for name in names if effect(name).slot in ("gain", "torque", "friction"))


def _slot(model: Model, name: str, index: int, time: Array, x: Array, v: Array, w: Array, otherwise: Array) -> Array:
    """An effect's equation along signals; `otherwise` when the model does not contain it."""
    own = {f.name: v for f, v in zip(model.free, model.values, strict=True) if (f.owner, f.joint) == (name, index)}
    if not own:
        return otherwise
    found = effect(name)
    parameters = np.array([own.get(parameter.name, 0.0) for parameter in found.parameters])
    assert found.function is not None
    neighbour = np.zeros(3)
    elapsed = time - time[0]
    match found.slot:
        case "command":
            calls = (found.function(*s, parameters) for s in zip(w, elapsed, x, v, w, strict=True))
        case "torque":
            calls = (found.function(*s, neighbour, parameters) for s in zip(elapsed, x, v, w, strict=True))
        case _:
            calls = (found.function(*s, parameters) for s in zip(elapsed, x, v, w, strict=True))
    return np.fromiter(calls, dtype=float, count=len(x))
