"""What a diagnosis says, as plain data: verdict, named effects, gain, what is left, what to do next.

Everything that a report or another program needs is in a `Diagnosis`; nothing in it refers back to the fits. Numbers
are SI; a torque also comes as what it amounts to in the command's unit (`input_equivalent`), because command and angle
alone determine no more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from diagnosis.command_steps import CommandSteps
from diagnosis.encoder_waves import READINGS, Wave
from diagnosis.finding import Verdict
from diagnosis.patchwork import Patchwork
from diagnosis.remainder import Drift
from envs.log import Array, InputKind

RAN_AWAY = 1e3
"""Error of free simulation over short windows [rad or m] that only a simulation which ran away has."""


@dataclass(frozen=True)
class Estimate:
    """One number with its standard deviation and unit."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter of an effect by its canonical name.

    physical: in SI units where the drive's constants are known, else the same as `input_equivalent`.
    input_equivalent: as the command that has the same effect (torques), or the number itself (times, angles, ratios).
    """

    name: str
    physical: Estimate
    input_equivalent: Estimate


@dataclass(frozen=True)
class Evidence:
    """Why an effect is believed.

    decrease: of -2 log likelihood by the effect with everything refitted. price: charged for its parameters and for the
    shapes that were searched. material: its torque as a share of the command's rms. net: decrease less price.
    """

    decrease: float
    price: float
    material: float | None = None

    @property
    def net(self) -> float:
        return self.decrease - self.price


@dataclass(frozen=True)
class Alternative:
    """Another explanation at the moment when an effect was accepted."""

    name: str
    joint: int
    evidence: Evidence


@dataclass(frozen=True)
class NamedEffect:
    """One named effect.

    alternatives: what explains the logs as well. considered: all hypotheses that were fitted when it was accepted,
    itself among them, best first. only_in: the log it occurs in, for an event that happens in one recording only.
    instants: by log the instant [s] of an event that happens in each at its own; the parameter `time` is the first.
    """

    name: str
    joint: int
    stage: str
    equation: str
    variable: str
    parameters: tuple[ParameterEstimate, ...]
    evidence: Evidence
    alternatives: tuple[Alternative, ...]
    only_in: str | None = None
    considered: tuple[Alternative, ...] = ()
    instants: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class NominalParameter:
    """A nominal parameter in input-equivalent units, and what became of it.

    given: by the named robot (None when unknown). without: refitted while the effects were missing. final: beside the
    effects. `shift` is what the missing effects had done to it, relative to the final value.
    """

    name: str
    unit: str
    given: float | None
    without: Estimate
    final: Estimate

    @property
    def is_new(self) -> bool:
        """Whether only the effects have made it a parameter, as a spring does of the arm's damping."""
        return self.without.value == self.without.std == 0.0

    @property
    def shift(self) -> float:
        if self.is_new or not self.final.value:
            return 0.0
        return (self.without.value - self.final.value) / abs(self.final.value)


@dataclass(frozen=True)
class SignalDependence:
    """How strongly the remainder depends on a signal: decrease of -2 log likelihood by smooth functions of it."""

    signal: str
    decrease: float
    functions: int
    p_value: float


@dataclass(frozen=True, eq=False)
class Series:
    """Signals for plots, thinned alike, each (S,): time [s], command, reading [rad or m], velocity, motor torque.

    before, after: residual of the refitted nominal and of the extended model, as the command that would explain it.
    free_before, free_after: error of the free simulation in windows [rad or m]; NaN where there is none.
    Motor torque and residuals are in the command's unit.
    """

    log: str
    held_out: bool
    time: Array
    command: Array
    reading: Array
    velocity: Array
    acceleration: Array
    motor_torque: Array
    before: Array
    after: Array
    free_before: Array
    free_after: Array


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Amplitude densities of the residuals over frequency [Hz], each (F,), in the command's unit per sqrt(Hz)."""

    frequency: Array
    before: Array
    after: Array


@dataclass(frozen=True, eq=False)
class Quantiles:
    """Median of a quantity in bins of a signal and the range of its middle 80 %, each (K,)."""

    middle: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class PartialResidual:
    """The residual against the signal that tells an effect: what the effect has to explain, its law, what is left.

    effect: None for the remainder of the final model. kind: what the residual is expressed as, a command that is
    missing, a resisting torque that is missing (in units of the command), or an error of the reading. x (K,) with bins
    in `before` and `after`; `laws` are (name, values (K,)), the effect's own first, then those of its rivals. samples
    (2, M): some unbinned pairs of signal and residual. continuous: x is a stretch of time instead of bins.
    """

    effect: str | None
    kind: Literal["command", "resistance", "reading"]
    signal: str
    signal_unit: str
    unit: str
    x: Array
    before: Quantiles
    after: Quantiles
    laws: tuple[tuple[str, Array], ...]
    samples: Array
    continuous: bool


@dataclass(frozen=True)
class LedgerRow:
    """One model on the logs that the gain is measured on.

    inverse_error: rms residual as a command. window_error, whole_error: rms error of free simulation in short windows
    and over whole logs [rad or m]; None when the model could not be simulated. interval: 90 % of the window error.
    closed: share of the explainable gap. microseconds: of one simulated sample. note: why a number is missing.
    """

    joint: int
    step: str
    role: Literal["as given", "nominal", "effect", "compensator", "rival"]
    inverse_error: float | None
    window_error: float | None
    whole_error: float | None
    interval: tuple[float, float] | None = None
    closed: float | None = None
    microseconds: float | None = None
    note: str = ""


@dataclass(frozen=True)
class Gap:
    """The gain in one number: rms error of free simulation in windows of `window` seconds, on data nobody fitted."""

    joint: int
    unit: str
    before: float
    after: float
    noise_floor: float
    closed: float | None
    interval: tuple[float, float] | None
    on: str
    window: float = 1.0


@dataclass(frozen=True)
class Isolability:
    """What these logs could have shown of one effect on one joint.

    threshold: smallest input-equivalent magnitude of its torque (rms over the log, command unit) with evidence enough.
    share: the same relative to the command's rms. nearest: the effect that looks most alike, `separation` the angle
    [degrees] between the two in the innovations once nominal parameters are refitted; None when nothing is visible.
    """

    effect: str
    joint: int
    threshold: float | None
    share: float | None
    nearest: str | None
    separation: float | None


@dataclass(frozen=True)
class Confusable:
    """Two effects that these logs cannot tell apart at a torque of 5 % of the command; angle between them [degrees]."""

    first: str
    second: str
    joint: int
    separation: float


@dataclass(frozen=True)
class NextExperiment:
    """The proposed experiment: excitation in text form, purpose, predicted benefit in words and as a factor."""

    joint: int
    excitation: str
    purpose: str
    benefit: str
    factor: float


@dataclass(frozen=True)
class Failure:
    """How many times as much a model errs on data that nobody fitted as noise, or the refitted nominal model, does."""

    times: float
    noise: bool

    def __str__(self) -> str:
        return f"{self.times:.2g} times as much as {'noise accounts for' if self.noise else 'without the effects'}"


@dataclass(frozen=True, eq=False)
class JointResult:
    """Everything about one joint.

    refused: the hypotheses that were tried last and not accepted, best first. fails_by: how the model fails on data
    that nobody fitted, where only that says that it is wrong. patched: what the effects stand for together, where they
    are pieces of another law. drifts: how constant each parameter is within the logs and from one to the next. wave:
    an error of the readings that is periodic in the position. coarse: steps to which the amplifier rounds its command.
    title: its name in the robot's description, if that says more than the number. beside: the number of the other joint
    of a planar pair, where the model has effects there. scattered: what noise alone would let a hypothesis explain
    beside the model, where small causes grow in it.
    """

    joint: int
    input: InputKind
    command_unit: str
    position_unit: str
    torque_unit: str
    input_equivalent: float | None
    verdict: Verdict
    effects: tuple[NamedEffect, ...]
    nominal: tuple[NominalParameter, ...]
    remainder: tuple[SignalDependence, ...]
    remainder_excess: float
    series: tuple[Series, ...]
    spectrum: Spectrum | None
    isolability: tuple[Isolability, ...] = ()
    confusable: tuple[Confusable, ...] = ()
    partial_residuals: tuple[PartialResidual, ...] = ()
    refused: tuple[Alternative, ...] = ()
    fails_by: Failure | None = None
    patched: Patchwork | None = None
    drifts: tuple[Drift, ...] = ()
    wave: Wave | None = None
    coarse: CommandSteps | None = None
    title: str = ""
    beside: int | None = None
    scattered: float = 0.0

    @property
    def misread(self) -> bool:
        """Whether the readings themselves err over the position."""
        return any(d.signal == READINGS for d in self.remainder)


@dataclass(frozen=True)
class Provenance:
    """Where a diagnosis comes from: files with hashes, versions, settings, seconds per stage, what was noticed.

    robot, robot_sha256: name of the description, and the hash of what it says. files: SHA-256 of the files given beside
    logs and robot, by their paths.
    """

    logs: tuple[Mapping[str, Any], ...]
    holdout: tuple[Mapping[str, Any], ...]
    robot: str | None
    robot_sha256: str | None
    files: Mapping[str, str]
    versions: Mapping[str, str]
    settings: Mapping[str, Any]
    seconds: Mapping[str, float]
    findings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The outcome for all joints. `gaps` has one entry per joint, the widest first.

    missing_in_mujoco: effects that `extended_model.xml` lacks and the error that costs. mujoco_difference: rms distance
    of MuJoCo's motion from the model without them, per joint [rad or m].
    """

    verdict: Verdict
    sentence: str
    joints: tuple[JointResult, ...]
    gaps: tuple[Gap, ...]
    ledger: tuple[LedgerRow, ...]
    next_experiment: NextExperiment | None
    provenance: Provenance
    missing_in_mujoco: tuple[Mapping[str, Any], ...] = ()
    mujoco_difference: Mapping[int, float] | None = None

    @property
    def effects(self) -> tuple[NamedEffect, ...]:
        """All named effects, joint by joint in the order of acceptance."""
        return tuple(effect for joint in self.joints for effect in joint.effects)
