"""How visible a hidden effect is in its logs: the limit that no diagnosis can beat.

A predictor that knows the truth and one that knows everything but one effect both follow the measured angle with a
weak leak. Their residuals differ by d. What a refit of the machine's parameters, and of the other effects' sizes, can
explain of d is projected out, the rest is whitened with the noise that the true predictor leaves, and

    visibility = || whitened, projected d ||

is the deflection of the likelihood-ratio test that knows the effect, in standard deviations of one Gaussian number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from benchmarks.blind.machines import Machine
from benchmarks.blind.world import Array, Joint, Motion, simulate
from envs.log import Log

LEAK = 30.0
"""Pull of the predictor towards the measured angle [1/s]."""

SETTLING = 0.5
"""Start of every log that is left out, until the predictor has forgotten its initial angle [s]."""

ORDER = 30
"""Order of the autoregressive whitening filter."""

REFITTED = ("resistance", "inductance", "torque_constant", "viscous", "gravity", "weight")
"""Fields of a joint that a refit of the machine would adjust; the inertias and the pair's coupling come on top."""


@dataclass(frozen=True)
class Streams:
    """Hidden signals of one recording that a predictor in the know may use. Arrays (samples, joints) or None."""

    stray_torque: Array | None = None
    arrival_delay: Array | None = None


def predict(machine: Machine, joints: tuple[Joint, ...], log: Log, streams: Streams, coupling: float) -> Motion:
    """The log's commands on these joints, following the measured angles with the leak; without rounding or noise."""
    smooth = tuple(replace(joint, encoder_step=0.0) for joint in joints)
    return simulate(
        smooth,
        log.command,
        machine.sample_time,
        coupling_inertia=coupling,
        start=log.position[0],
        stray_torque=streams.stray_torque,
        arrival_delay=streams.arrival_delay,
        seen=log.position,
        leak=LEAK,
        ramp=machine.hold == "first_order",
        step_limit=2.0 * machine.step,
    )


def variations(machine: Machine, joints: tuple[Joint, ...], share: float) -> list[tuple[tuple[Joint, ...], float]]:
    """Joints and coupling inertia with one refitted parameter raised by `share` each.

    Refitted are the machine's parameters and every number by which an effect makes a joint differ from the machine's.
    """
    found: list[tuple[tuple[Joint, ...], float]] = []
    for j, (joint, bare) in enumerate(zip(joints, machine.joints, strict=True)):
        grown = replace(
            joint, motor_inertia=joint.motor_inertia * (1 + share), link_inertia=joint.link_inertia * (1 + share)
        )
        changed = [grown]
        numbers = [name for name in REFITTED if getattr(joint, name)]
        numbers += [name for name in _sizes(joint, bare) if name not in numbers]
        changed += [replace(joint, **{name: getattr(joint, name) * (1 + share)}) for name in numbers]
        if joint.gravity and not joint.tilt:  # where a pendulum hangs is not known either
            changed.append(replace(joint, tilt=joint.gravity * share, tilt_phase=math.pi / 2))
        found += [((*joints[:j], other, *joints[j + 1 :]), machine.coupling_inertia) for other in changed]
    if machine.coupling_inertia:
        found.append((joints, machine.coupling_inertia * (1 + share)))
    return found


def _sizes(joint: Joint, bare: Joint) -> list[str]:
    """Names of the finite numbers by which a joint with effects differs from the bare one."""
    values = {field.name: getattr(joint, field.name) for field in fields(joint)}
    return [
        name
        for name, value in values.items()
        if isinstance(value, float) and np.isfinite(value) and value and value != getattr(bare, name)
    ]


def visibility(
    machine: Machine,
    true: tuple[Joint, ...],
    without: tuple[Joint, ...],
    logs: tuple[Log, ...],
    true_streams: tuple[Streams, ...],
    without_streams: tuple[Streams, ...],
) -> float:
    """Deflection of the likelihood-ratio test between the true machine and the one without an effect, on all logs."""
    columns: list[Array] = []
    noise: list[Array] = []
    share = 1e-3
    settled = slice(round(SETTLING / machine.sample_time), None)
    for log, streams, fewer in zip(logs, true_streams, without_streams, strict=True):
        known = predict(machine, true, log, streams, machine.coupling_inertia).measured
        lacking = predict(machine, without, log, fewer, machine.coupling_inertia).measured
        varied = [
            predict(machine, joints, log, fewer, p3).measured for joints, p3 in variations(machine, without, share)
        ]
        noise.append((log.position - known)[settled])
        shown = np.stack([known - lacking, *((other - lacking) / share for other in varied)], axis=-1)
        columns.append(shown[settled])
    if not all(np.isfinite(column).all() for column in columns):
        return float("inf")
    blocks = []
    for j in range(len(true)):
        residuals = [block[:, j] for block in noise]
        floor = true[j].encoder_step / np.sqrt(12.0)
        whitener, level = whitening(residuals, floor)
        blocks += [lfilter(whitener, [1.0], column[:, j], axis=0) / level for column in columns]
    table = np.concatenate(blocks)
    difference, sensitivities = table[:, 0], table[:, 1:]
    scale = np.linalg.norm(sensitivities, axis=0)
    sensitivities = sensitivities[:, scale > 0] / scale[scale > 0]
    rest = difference - sensitivities @ np.linalg.lstsq(sensitivities, difference, rcond=1e-10)[0]
    return float(np.linalg.norm(rest))


def whitening(residuals: list[Array], floor: float) -> tuple[Array, float]:
    """Autoregressive whitening filter (ORDER + 1,) and the rms of what it leaves of the residuals, at least `floor`."""
    covariance = np.zeros(ORDER + 1)
    for residual in residuals:
        centred = residual - residual.mean()
        size = 1 << (2 * len(centred) - 1).bit_length()
        power = np.abs(np.fft.rfft(centred, size)) ** 2
        covariance += np.fft.irfft(power, size)[: ORDER + 1] / len(centred) / len(residuals)
    covariance[0] = covariance[0] * (1 + 1e-9) + 1e-30
    past = solve_toeplitz(covariance[:-1], covariance[1:])
    left = covariance[0] - past @ covariance[1:]
    return np.concatenate([[1.0], -past]), max(float(np.sqrt(max(left, 0.0))), floor)


def jitter_visibility(rms: float, speed: Array, floor: float) -> float:
    """Deflection of the variance test for sampling jitter [s] at known speeds against white noise of rms `floor`."""
    added = (rms * speed) ** 2
    share = added / (added + floor**2)
    return float(np.sqrt(0.5 * np.sum(share**2)))
