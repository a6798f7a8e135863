"""The diagnosis as a whole: from log files to verdict, named effects, extended model, gain, and files.

`diagnose` works in memory; `diagnose_files` reads and writes. Every joint that moves is diagnosed; the first two joints
of a planar arm that move together are one problem.
"""

from __future__ import annotations

import platform
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

import numpy as np
from scipy.signal import welch
from threadpoolctl import threadpool_limits

from diagnosis.arm_torques import arm_torques
from diagnosis.choice import LAG
from diagnosis.compensator import compensators, not_refused
from diagnosis.engine import find
from diagnosis.estimation import Fitted, Point, covariance, undetermined
from diagnosis.extension import Extension, Twin, extended_model, mujoco_twin
from diagnosis.finding import WORST, Accepted, Finding, Verdict
from diagnosis.hopping import likely
from diagnosis.instants import own_instants
from diagnosis.isolability import isolability
from diagnosis.lags import instead_of_winding
from diagnosis.ledger import Step, failures, floor_of, gap, given_point, rows, steps
from diagnosis.louder_logs import is_louder
from diagnosis.next_experiment import Range, next_experiment
from diagnosis.nominal import JointStructure, settle_stamps
from diagnosis.open_laws import left_open
from diagnosis.output import to_json
from diagnosis.parameters import JointUnits, effect_parameters, joint_units, nominal_parameters
from diagnosis.partial_residual import is_of_the_link, partial_residuals
from diagnosis.preparation import (
    DiagnosisError,
    Recordings,
    given_numbers,
    groups,
    moving_joints,
    pose,
    recordings,
)
from diagnosis.problem import LIMIT, Problem, coarser, in_band, segments, smooth_derivatives, stack
from diagnosis.quantities import percent, title
from diagnosis.replay import WINDOW, input_equivalent
from diagnosis.report import render
from diagnosis.result import (
    Alternative,
    Diagnosis,
    Evidence,
    Failure,
    Gap,
    JointResult,
    LedgerRow,
    NamedEffect,
    NextExperiment,
    Provenance,
    Series,
    SignalDependence,
    Spectrum,
)
from diagnosis.rivals import rival_rows
from diagnosis.search import Ranked, Scored
from diagnosis.settings import Settings
from diagnosis.text import enumerated, joint_sentence, table
from diagnosis.unreached_limits import limits_decided
from envs.log import Array, Log
from envs.log_files import write_atomically
from envs.output_place import check_folder
from methods.base import MethodError
from methods.effects import compiled_with, vocabulary
from methods.effects.base import Effect
from methods.kernel import DAMPING, NOMINAL, build
from methods.structured import StructuredModel
from methods.two_layer_network import TwoLayerNetwork

PLOTTED = 4000
"""Samples of a signal that are kept for plots."""
SHOWN_LOGS = 5
"""Fitted logs whose signals are kept for plots."""
DATED = 0.1
"""Share of a log's length below which the deviation of an event's instant has to be."""
OTHER_SCALE, ALIKE = 4.0, 2.0
"""Factor between all found and stated parameters that speaks of another scale, and how far they may differ in it."""
WHOLE = 0.02
"""Distance from a whole number of cycles in a turn that is none."""
LINES = 15.0
"""Seconds between lines on what is going on, where no terminal shows it."""
Tell = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Solved:
    """One problem (a joint, or a coupled pair) from logs to ledger; `no_compensator` says why there is none.

    failing: by index the joints whose model does not hold on the held-out logs though nothing was left to explain.
    louder: those that err there by more than the noise of the fitted logs makes, which is stronger there.
    left_open: by index the laws that go on there in a way that the fitted logs do not tell, and by how much they err.
    rest: where the torques of the rest of the arm are from, or why they are missing. limits: by index the joints whose
    stated torque limit is reached in the held-out logs only, and whether it acts there.
    """

    joints: tuple[int, ...]
    structures: tuple[JointStructure, ...]
    units: tuple[JointUnits, ...]
    problem: Problem
    held_out: Problem
    finding: Finding
    ledger: tuple[Step, ...]
    compensators: tuple[TwoLayerNetwork | None, ...]
    no_compensator: str
    failing: Mapping[int, Failure] = field(default_factory=dict)
    rest: str = ""
    limits: Mapping[int, bool] = field(default_factory=dict)
    left_open: Mapping[int, tuple[str, Failure]] = field(default_factory=dict)
    louder: Mapping[int, Failure] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """What the search says, and `unknown` where its model does not hold on data that nobody fitted."""
        return "unknown" if self.failing else self.finding.verdict

    @property
    def last(self) -> Step:
        """The model with all accepted effects."""
        return next(step for step in reversed(self.ledger) if step.role in ("nominal", "effect"))


def diagnose_files(
    logs: Sequence[Path],
    holdout: Sequence[Path],
    robot: str | None,
    joint: int | None,
    out: Path,
    *,
    columns: Path | None = None,
    repair: bool = False,
    rivals: bool = False,
    plugins: Sequence[Path] = (),
) -> str:
    """Diagnose log files, write the results into the folder `out`, and return what the terminal shows.

    rivals: also train the networks that the ledger compares with (some seconds more). plugins: files with an effect
    of the user's own, which takes part like any other.

    Nothing is written unless everything is ready. Raises LogError, RobotError, RegistryError or DiagnosisError for
    unusable input.
    """
    from rich.console import Console

    out = Path(out)
    check_folder(out)
    effects = vocabulary(plugins)
    console = Console(stderr=True, highlight=False)
    with console.status("reading logs") as status:
        tell = status.update if console.is_terminal else in_lines(console.print)
        started = clock.perf_counter()
        read = recordings(logs, holdout, robot, columns, repair)
        files = {str(path): sha256(path.read_bytes()).hexdigest() for path in (columns, *plugins) if path is not None}
        seconds = {"reading": clock.perf_counter() - started}
        diagnosis, model, twin = diagnose(read, joint, effects=effects, rivals=rivals, tell=tell, seconds=seconds)
        diagnosis = replace(diagnosis, provenance=replace(diagnosis.provenance, files=files))
        tell("writing the report")
        write_atomically(
            {
                out / "diagnosis.json": to_json(diagnosis).encode(),
                out / "report.html": render(diagnosis).encode(),
                out / "extended_model.json": model.to_json().encode(),
                out / "extended_model.xml": twin.xml.encode(),
            }
        )
    return table(diagnosis)


def in_lines(write: Tell, seconds: float = LINES) -> Tell:
    """Tells where no terminal shows what is going on: a line with the time so far, when so long has passed since the
    last one."""
    began = last = clock.perf_counter()

    def tell(text: str) -> None:
        nonlocal last
        now = clock.perf_counter()
        if now - last >= seconds:
            write(f"{now - began:.0f} s: {text}")
            last = now

    return tell


@threadpool_limits.wrap(limits=1, user_api="blas")  # as in `diagnosis.engine`
def diagnose(
    read: Recordings,
    joint: int | None = None,
    *,
    settings: Settings | None = None,
    effects: Sequence[Effect] | None = None,
    rivals: bool = False,
    tell: Tell = lambda text: None,
    seconds: dict[str, float] | None = None,
) -> tuple[Diagnosis, StructuredModel, Twin]:
    """Diagnose recordings in memory; `effects` is the vocabulary (`methods.effects.vocabulary` unless given)."""
    settings, seconds = settings or Settings(), {} if seconds is None else seconds
    known = tuple(vocabulary() if effects is None else effects)
    findings = list(read.findings)
    joints = moving_joints(read.fitted, joint, findings)
    rng = np.random.default_rng(0)
    results, gaps, ledger, extensions, proposals = [], [], [], [], []
    rests: dict[str, list[int]] = {}
    if read.robot is None and len(joints) > 1:
        tell("whether the joints are those of an arm")
    parts = groups(read.fitted, joints, read.robot, known)
    for group, structures in parts:
        findings += filter(None, [arm_said(read, group, structures)])
        solved = solve(read, group, structures, known, settings.shared(len(parts)), tell, seconds)
        check_turns(read, solved)
        started = clock.perf_counter()
        tell(f"joint {', '.join(map(str, group))}: measuring the gain")
        for j in range(len(group)):
            result, own_gap, own_rows = joint_result(solved, j, known, settings, read.on, rng)
            results.append(replace(result, title=joint_title(read, group[j])))
            gaps.append(own_gap)
            ledger += own_rows
            ledger += compared(read, solved, j, own_gap, rng, networks=rivals)
            proposal = next_experiment(solved.problem, solved.finding, j, group[j], allowed(read, group[j]))
            proposals += [] if proposal is None else [proposal]
            solved_notes = (
                timing_said,
                growth_said,
                lags_said,
                winding_said,
                limit_said,
                open_law_said,
                louder_said,
                budget_said,
            )
            constants = 0.0 if read.robot is None else read.robot.joint(group[j]).drive.input_equivalent_uncertainty
            notes = (
                scale_said(result),
                instants_said(result),
                constants_said(result, constants),
                *(said(solved, j) for said in solved_notes),
            )
            findings += [*filter(None, notes), *doubts(solved, j, result.effects)]
        if solved.rest:
            rests.setdefault(solved.rest, []).append(group[0])
        findings += [failure_said(group[j], failure) for j, failure in solved.failing.items()]
        inputs = tuple(structure_.input for structure_ in solved.structures)
        extensions.append(
            Extension(group, inputs, solved.units, solved.held_out, solved.last.point, solved.compensators)
        )
        seconds["results"] = seconds.get("results", 0.0) + clock.perf_counter() - started
    findings += [f"joint {', '.join(map(str, joints))}: {said}" for said, joints in rests.items()]
    findings += together_said(read, len(extensions), results)
    started = clock.perf_counter()
    tell("exporting the extended model")
    model = extended_model(extensions)
    twin = mujoco_twin(model, extensions, [joint_name(read, number) for number in model.joints], WINDOW)
    seconds["export"] = clock.perf_counter() - started
    by_joint = {item.joint: item for item in gaps}
    gaps.sort(key=lambda item: -item.before / max(item.noise_floor, 1e-300))
    verdict = next(v for v in WORST if any(result.verdict == v for result in results))
    diagnosis = Diagnosis(
        verdict=verdict,
        sentence=" ".join(joint_sentence(result, by_joint[result.joint]) for result in results),
        joints=tuple(results),
        gaps=tuple(gaps),
        ledger=tuple(ledger),
        next_experiment=first_choice(proposals, results),
        provenance=provenance(read, settings, seconds, findings),
        missing_in_mujoco=twin.left_out,
        mujoco_difference=twin.difference,
    )
    return diagnosis, model, twin


def check_turns(read: Recordings, solved: Solved) -> None:
    """Refuses an answer that depends on how long a turn is where that is in doubt. Raises DiagnosisError.

    What is `unknown` claims nothing, whatever stands in for it. What repeats itself once in a turn of 2 pi, or a whole
    number of times, over swings of several such turns, tells that these are turns.
    """
    for item in solved.finding.accepted if solved.verdict != "unknown" else ():
        joint = solved.joints[item.joint]
        if item.effect.turns and joint in read.doubtful and not is_whole(solved.finding.final, item):
            what = f"{item.label.replace('_', ' ')} of joint {joint}"
            raise DiagnosisError(f"{what}, which these logs show, depends on what a turn is: {read.doubtful[joint]}")


def is_whole(final: Fitted, item: Accepted) -> bool:
    """Whether an effect repeats itself a whole number of times in 2 pi, or by its law once."""
    if item.effect.scan != "position":
        return True
    count = final.point.value(f"{item.name}.cycles_per_rev@{item.joint}")
    return round(count) >= 1 and abs(count - round(count)) < WHOLE


def arm_said(read: Recordings, group: tuple[int, ...], structures: tuple[JointStructure, ...]) -> str:
    """That the logs show an arm where no description does; nothing otherwise."""
    if read.robot is not None or len(group) < 2:
        return ""
    weight = ", with its weight" if structures[0].gravity == "pendulum" else ""
    return (
        f"joint {group[0]}, {group[1]}: the logs show a planar arm, the second link on the first{weight}; its nominal "
        "model is fitted to both joints together"
    )


def together_said(read: Recordings, parts: int, results: Sequence[JointResult]) -> list[str]:
    """What an arm's links do to one another is not known without a description, and effects may stand for it."""
    left = [str(result.joint) for result in results if result.verdict == "unknown"]
    if read.robot is not None or parts < 2 or not left:
        return []
    return [
        f"joint {', '.join(left)}: other joints move, too, and what the links of an arm do to one another is not known "
        "without its description; what is named here may stand for that. Give one with --robot"
    ]


def timing_said(solved: Solved, j: int) -> str:
    """When the command of joint index j acts, where that is not when it is logged; nothing otherwise."""
    row, dt = solved.finding.final.point.parameters[0, j], solved.problem.sample_time
    shift = float(row[NOMINAL.index("timing")])
    euler = row[NOMINAL.index("stepping")] > 0.0
    said = []
    if abs(shift) > NOTICED * dt:
        when = "before" if shift < 0.0 else "after"
        said.append(f"the command acts {abs(shift) * 1e3:.3g} ms {when} it is logged ({abs(shift) / dt:.2g} samples)")
    if euler:
        said.append("the motion is that of a simulator with one semi-implicit Euler step per sample")
    return f"joint {solved.joints[j]}: {'; '.join(said)}; the model takes that into account" if said else ""


def scale_said(result: JointResult) -> str:
    """That all parameters of a joint differ from the robot's own by one large factor, as in other units.

    Angles that are logged f times too small make inertia, damping and (at small angles) gravity f times too large.
    """
    known = {p.name: np.array([p.given, p.final.value]) for p in result.nominal if p.given is not None}
    if "gravity_sine" in known:
        known["gravity"] = np.hypot(known["gravity_sine"], known["gravity_cosine"])
    sizes = {name: known[name] for name in ("inertia", "damping", "gravity") if name in known}
    ratios = {name: np.log(found / stated) for name, (stated, found) in sizes.items() if stated > 0.0 and found > 0.0}
    factor = float(np.exp(np.mean(list(ratios.values())))) if len(ratios) > 1 else 1.0
    spread = np.ptp(list(ratios.values())) if ratios else 0.0
    if spread > np.log(ALIKE) or 1.0 / OTHER_SCALE < factor < OTHER_SCALE:
        return ""
    names = " and ".join(ratios) if len(ratios) == 2 else "inertia, damping and gravity"
    return (
        f"joint {result.joint}: {names} are all about {factor:.2g} times those of the robot's description: a gear "
        "ratio, a unit, or the scale of its position or command is wrong"
    )


def constants_said(result: JointResult, uncertainty: float) -> str:
    """That what is named in N m or N is as uncertain as the drive's constants, where the description says so;
    uncertainty: relative and multiplicative, of command units per torque."""
    every = [parameter for effect in result.effects for parameter in effect.parameters]
    is_converted = result.torque_unit != result.command_unit
    if not (uncertainty and is_converted and any(p.physical.unit.startswith(result.torque_unit) for p in every)):
        return ""
    off = percent(uncertainty, 2) if uncertainty < 1.0 else f"a factor of {1.0 + uncertainty:.2g}"
    return (
        f"joint {result.joint}: values in {result.torque_unit} follow from the description's drive constants, which "
        f"may together be {off} off; as commands (input_equivalent) they are as certain as is stated"
    )


def instants_said(result: JointResult) -> str:
    """When events happen in the logs, where that is another instant in each; nothing otherwise."""
    apart = [effect for effect in result.effects if effect.instants]
    said = [
        f"{title(effect.name)} at {enumerated([f'{t:.4g} s in {log}' for log, t in effect.instants.items()])}"
        for effect in apart
    ]
    return f"joint {result.joint}: {'; '.join(said)}; what it does is the same" if said else ""


def growth_said(solved: Solved, j: int) -> str:
    """That no model can follow the motion of joint index j, where small causes grow in it; nothing otherwise."""
    left = solved.finding.remainders[j]
    if left.growth < GROWN:
        return ""
    if not left.impacts:
        return (
            f"joint {solved.joints[j]}: noise that nobody logged decides when friction holds the joint and lets it go: "
            "errors of free simulation stay"
        )
    return (
        f"joint {solved.joints[j]}: from one blow of its play to the next small causes grow, so that noise which "
        "nobody logged decides where it goes: no model follows these logs exactly, and errors of free simulation stay"
    )


def budget_said(solved: Solved, j: int) -> str:
    """That a search that found no complete model was ended; nothing otherwise."""
    if not solved.finding.is_cut:
        return ""
    return (
        f"joint {solved.joints[j]}: the search was ended when it had taken long enough; effects that only other "
        "combinations would have shown may be missing among the names"
    )


def lags_said(solved: Solved, j: int) -> str:
    """That the logs do not tell which of several lags in series is the amplifier's; nothing otherwise."""
    name = f"{LAG}.time_constant@{j}"
    found = sorted(optimum.values[name] * 1e3 for optimum in likely(solved.finding.traded) if name in optimum.values)
    if len(found) < 2:
        return ""
    return (
        f"joint {solved.joints[j]}: the amplifier's lag stands in series with those of winding and rotor, and the logs "
        f"do not tell which is which: it may be {' or '.join(f'{lag:.3g}' for lag in found)} ms. A robot description, "
        "which states the inertia, decides"
    )


def winding_said(solved: Solved, j: int) -> str:
    """That a winding of which nothing is known may be an amplifier's lag instead; nothing otherwise."""
    found = instead_of_winding(solved.finding.final.point, j)
    named = any(item.label == LAG and item.joint == j for item in solved.finding.accepted)
    if named or found < solved.problem.sample_time:
        return ""
    return (
        f"joint {solved.joints[j]}: no inductance is stated, and the command's lag of {found * 1e3:.3g} ms counts as "
        "the winding's. An amplifier that lags, or a command that is delayed, by as much would look nearly the same; a "
        "robot description, which states the winding, decides"
    )


def limit_said(solved: Solved, j: int) -> str:
    """That the held-out logs have decided whether a stated torque limit acts; nothing otherwise."""
    if j not in solved.limits:
        return ""
    limit = f"{solved.structures[j].torque_limit:.3g} {solved.units[j].command}, input-equivalent"
    outcome = "where it acts" if solved.limits[j] else "where the joint goes beyond it as if there were none"
    return (
        f"joint {solved.joints[j]}: the torque of the drive's stated current limit ({limit}) is reached in no fitted "
        f"log but in a held-out one, {outcome}. Whether it acts is all that held-out logs have decided about the model"
    )


def open_law_said(solved: Solved, j: int) -> str:
    """That the fitted logs do not tell how a law goes on where the held-out ones are; nothing otherwise."""
    if j not in solved.left_open:
        return ""
    law, failure = solved.left_open[j]
    return (
        f"joint {solved.joints[j]}: the fitted logs leave open how the {title(law)} goes on in the range of the "
        f"held-out ones: there the model errs {failure}, and a more general form of that law no more than it is "
        "uncertain. Fit logs of that range, too"
    )


def louder_said(solved: Solved, j: int) -> str:
    """That more noise is in the held-out logs than in the fitted ones; nothing otherwise."""
    if j not in solved.louder:
        return ""
    return (
        f"joint {solved.joints[j]}: on the held-out logs the model errs {solved.louder[j]}, but by what depends on no "
        "signal and calls for no other parameters: noise that nobody logged is stronger there than in the fitted logs"
    )


def is_determined(effect: NamedEffect) -> bool:
    """Whether the logs determine any parameter of an effect with several: one of which they tell nothing but that it
    explains something stands for another one."""
    known = (abs(p.input_equivalent.value) > p.input_equivalent.std for p in effect.parameters)
    return len(effect.parameters) < 2 or any(known)


def is_dated(event: NamedEffect, longest: float) -> bool:
    """Whether the logs, the longest of which takes so many seconds, tell when an event was: one at no certain instant
    stands for something that goes on all the time."""
    (instant,) = (p.physical for p in event.parameters if p.name == "time")
    return instant.std < DATED * longest


def doubts(solved: Solved, j: int, named: Sequence[NamedEffect]) -> list[str]:
    """What speaks against the effects of joint index j being what they are named: the logs determine nothing of one, or
    not when an event was."""
    found = []
    items = (item for item in solved.finding.accepted if item.joint == j)
    for item, effect in zip(items, named, strict=True):
        if not is_determined(effect):
            found.append(
                f"these logs determine no parameter of the {title(effect.name)}: it may stand for another effect"
            )
        elif item.effect.scan == "event" and not is_dated(effect, solved.problem.longest):
            (instant,) = (p.physical for p in effect.parameters if p.name == "time")
            found.append(
                f"the instant of the {title(effect.name)} is uncertain by {instant.std:.2g} s: an event at no "
                "certain instant stands for something that goes on all the time"
            )
    return [f"joint {solved.joints[j]}: {said}" for said in found]


REST_OF_THE_ARM = (
    "what the motion of the other joints does is taken from the description and the measured motion; the extended "
    "model and its MJCF leave it out"
)


def failure_said(joint: int, failure: Failure) -> str:
    """That a model which leaves nothing of the fitted logs unexplained does not hold on the others."""
    return (
        f"joint {joint}: of the fitted logs nothing is left unexplained, but on data that nobody fitted the model errs "
        f"{failure}: its law is not the right one"
    )


NOTICED = 0.02
"""Share of a sample by which a command has to act earlier or later than logged to be told."""
GROWN = 3.0
"""Growth of what noise does (`diagnosis.remainder.Remainder.growth`) from which it is told."""


def compared(
    read: Recordings, solved: Solved, j: int, own_gap: Gap, rng: np.random.Generator, *, networks: bool
) -> list[LedgerRow]:
    """Rows beside the own models: why there is no compensator, and the rivals."""
    joint = solved.joints[j]
    rows_ = []
    if solved.compensators[j] is None:
        reason = solved.no_compensator or "what is left of this joint follows no signal of the logs"
        rows_.append(LedgerRow(joint, "+ compensator", "compensator", None, None, None, note=f"left out: {reason}"))
    gravity = solved.structures[j].gravity
    scale = (own_gap.before, own_gap.noise_floor)
    fitted, held_out = (
        [part for log in own for part in segments(log, LIMIT // len(own))] for own in (read.fitted, read.held_out)
    )
    return rows_ + rival_rows(fitted, held_out, solved.held_out, joint, scale, rng, gravity=gravity, networks=networks)


def first_choice(proposals: Sequence[NextExperiment], results: Sequence[JointResult]) -> NextExperiment | None:
    """One proposal for all joints: of an ambiguous joint if there is one, else the one with the largest benefit."""
    ambiguous = {result.joint for result in results if result.verdict == "ambiguous"}
    return max(proposals, key=lambda proposal: (proposal.joint in ambiguous, proposal.factor), default=None)


def allowed(read: Recordings, number: int) -> Range | None:
    """Range of a joint and its command by the robot's description, where both ends are stated."""
    if read.robot is None:
        return None
    item = read.robot.joint(number)
    ends = (item.lower.value, item.upper.value)
    return Range(*ends, item.drive.command_limit.value) if np.all(np.isfinite(ends)) else None


def joint_name(read: Recordings, number: int) -> str:
    """Name of a joint on its robot, or joint_N."""
    return f"joint_{number}" if read.robot is None else read.robot.joint(number).name


def joint_title(read: Recordings, number: int) -> str:
    """Name of a joint on its robot, where that says more than the number."""
    name = joint_name(read, number)
    bare = name.lower().replace("_", "").replace(" ", "")
    return "" if bare in (f"joint{number}", f"q{number}", str(number)) else name


def applying(effects: Sequence[Effect], structures: Sequence[JointStructure]) -> tuple[Effect, ...]:
    """The effects for which the commands of these joints leave room."""
    there = {structure.input for structure in structures}
    return tuple(effect for effect in effects if there & set(effect.inputs))


def solve(
    read: Recordings,
    group: tuple[int, ...],
    structures: tuple[JointStructure, ...],
    effects: Sequence[Effect],
    settings: Settings,
    tell: Tell,
    seconds: dict[str, float],
) -> Solved:
    """Find the effects of one problem and replay the models on the held-out logs."""
    started = clock.perf_counter()
    name = f"joint {', '.join(map(str, group))}"
    kernel, effects = build(compiled_with(effects)), applying(effects, structures)
    if kernel.is_new:
        tell("compiling the simulator, once for these effects: a minute or two")
    first = read.fitted[0]
    arm, rest = None, ""
    if read.robot is not None and len(group) == 1:
        try:
            arm = arm_torques(read.robot, read.fitted, group[0], pose(first, read.robot))
            rest = "" if arm is None else REST_OF_THE_ARM
        except MethodError as error:
            rest = f"what the motion of the other joints does is not known: {error.problem}"
    problem = stack(kernel, read.fitted, group, pair=len(group) > 1, arm=arm)
    held_out = stack(kernel, read.held_out, group, pair=len(group) > 1, arm=arm, dither=problem.dither)
    problem, held_out = settle_stamps(problem, held_out, structures)
    units = tuple(
        joint_units(
            structures[j].input,
            first.facts[first.index(number)].position_unit,
            None if read.robot is None else read.robot.joint(number),
        )
        for j, number in enumerate(group)
    )
    finding = find(problem, structures, effects, settings, lambda text: tell(f"{name}: {text}"), held_out)
    finding, limits = limits_decided(problem, held_out, finding, structures, settings.threshold)
    found = clock.perf_counter()
    if finding.band is not None:
        if arm is not None:
            rest += f"; what it says holds up to {finding.band:.2g} Hz, the band of the motion"
        problem = in_band(problem)
        held_out = coarser(held_out, problem.decimation * problem.thinning)
    given = None
    if read.robot is not None and len(group) == 1:
        given = given_point(finding.nominal, 0, given_numbers(read.robot, group[0], first))
    ledger = steps(problem, held_out, finding, given)
    failing = failures(problem, held_out, finding, ledger)
    louder = {j: own for j, own in failing.items() if own.noise and is_louder(held_out, finding, j)}
    failing = {j: own for j, own in failing.items() if j not in louder}
    laws = left_open(problem, held_out, finding, ledger, failing, effects)
    tell(f"{name}: a network for the remainder")
    networks, reason = compensators(read.fitted, problem, finding, group, np.random.default_rng(0))
    if any(networks):
        networks, step, refused = not_refused(held_out, ledger[-1], networks)
        ledger += [] if step is None else [step]
        reason = refused or reason
    seconds["search"] = seconds.get("search", 0.0) + found - started
    seconds["ledger"] = seconds.get("ledger", 0.0) + clock.perf_counter() - found
    return Solved(
        group,
        structures,
        units,
        problem,
        held_out,
        finding,
        tuple(ledger),
        networks,
        reason,
        {j: failure for j, failure in failing.items() if j not in laws},
        rest,
        limits,
        laws,
        louder,
    )


def joint_result(
    solved: Solved, j: int, effects: Sequence[Effect], settings: Settings, on: str, rng: np.random.Generator
) -> tuple[JointResult, Gap, list[LedgerRow]]:
    """Everything about joint index j of a solved problem."""
    finding, joint, units = solved.finding, solved.joints[j], solved.units[j]
    spread = finding.covariance + undetermined(finding.final)
    floor = floor_of(solved.problem, solved.held_out, finding, j)
    ledger = rows(solved.held_out, list(solved.ledger), j, solved.joints, floor, rng)
    own_gap = gap(solved.held_out, list(solved.ledger), j, joint, units.position, floor, on, rng)
    given = next((step.point for step in solved.ledger if step.role == "as given"), None)
    numbers = {} if given is None else dict(zip(NOMINAL[:7], given.parameters[0, j, :7].tolist(), strict=True))
    numbers["damping"] = sum(numbers.get(name, 0.0) for name in DAMPING)
    items = [item for item in finding.accepted if item.joint == j]
    named = tuple(named_effect(solved, item, spread, joint, units) for item in items)
    left = finding.remainders[j]
    said = solved.verdict if len(solved.joints) == 1 or solved.verdict == "unknown" or named else "none"
    visible, confusable = isolability(solved.problem, finding, j, joint, applying(effects, solved.structures), settings)
    result = JointResult(
        joint=joint,
        input=solved.structures[j].input,
        command_unit=units.command,
        position_unit=units.position,
        torque_unit=units.torque,
        input_equivalent=units.per_torque,
        verdict="unknown" if doubts(solved, j, named) else said,
        effects=named,
        nominal=nominal_parameters(
            finding.nominal,
            finding.final,
            (covariance(finding.nominal) + undetermined(finding.nominal), spread),
            j,
            units,
            numbers if given else {},
        ),
        remainder=tuple(SignalDependence(**asdict(dependence)) for dependence in left.dependences),
        remainder_excess=float(left.excess),
        series=tuple(all_series(solved, j)),
        spectrum=spectrum(solved, j),
        isolability=visible,
        confusable=confusable,
        partial_residuals=partial_residuals(solved.problem, finding, j, units),
        refused=alternatives(solved, finding.refused),
        fails_by=solved.failing.get(j),
        patched=finding.patched.get(j),
        drifts=left.drifts,
        wave=left.wave,
        coarse=left.coarse,
        beside=next((solved.joints[item.joint] for item in finding.accepted if item.joint != j), None),
        scattered=finding.scattered,
    )
    return result, own_gap, ledger


def named_effect(solved: Solved, item: Accepted, spread: Array, joint: int, units: JointUnits) -> NamedEffect:
    """An accepted effect with canonical parameters at the final fit."""
    hypothesis = item.scored.start.hypothesis
    effect = hypothesis.effect
    of_the_link = is_of_the_link(solved.problem, effect, item.joint)
    return NamedEffect(
        name=effect.label,
        joint=joint,
        stage=effect.stage,
        equation=effect.of_the_link.replace("q_1", f"q_{solved.joints[0]}") if of_the_link else effect.equation,
        variable=effect.variable,
        parameters=effect_parameters(solved.problem, solved.finding.final, spread, item, units),
        evidence=evidence(item.scored, item.material),
        alternatives=tuple(
            Alternative(other.label, solved.joints[other.start.hypothesis.joint], evidence(other))
            for other in item.rivals
        ),
        only_in=solved.problem.names[hypothesis.log] if hypothesis.log >= 0 and solved.problem.logs > 1 else None,
        considered=alternatives(solved, item.considered),
        instants=own_instants(solved.problem, solved.finding.final.point, effect, item.joint),
    )


def alternatives(solved: Solved, ranked: Sequence[Ranked]) -> tuple[Alternative, ...]:
    """Scores of the search with joint numbers."""
    return tuple(
        Alternative(r.name, solved.joints[r.joint], Evidence(float(r.decrease), float(r.price))) for r in ranked
    )


def evidence(scored: Scored, material: float | None = None) -> Evidence:
    """What the search found for and against a hypothesis."""
    return Evidence(float(scored.decrease), float(scored.price), None if material is None else float(material))


def all_series(solved: Solved, j: int) -> list[Series]:
    """Signals for plots: of the fitted logs, and of the first held-out log with its free simulations."""
    problem, held_out, finding = solved.problem, solved.held_out, solved.finding
    before, after = next(step for step in solved.ledger if step.role == "nominal"), solved.last
    fits = [(fitted.point, fitted.error) for fitted in (finding.nominal, finding.final)]
    replays = [(step.point, step.replay.prediction) for step in (before, after)]
    back_emf = finding.final.point.parameters[0, j, NOMINAL.index("back_emf")]
    velocity = np.concatenate([_motion(problem, log, j)[1] for log in range(problem.logs)])
    nothing = np.full_like(velocity, np.nan)
    torque = problem.command[:, j] - back_emf * velocity
    shown = range(min(problem.logs, SHOWN_LOGS))
    return [
        *(one_series(problem, log, j, fits, torque, (nothing, nothing)) for log in shown),
        one_series(
            held_out,
            0,
            j,
            replays,
            after.replay.motion[:, j, 2],
            (before.replay.windows[:, j], after.replay.windows[:, j]),
            held_out=True,
        ),
    ]


def one_series(
    problem: Problem,
    log: int,
    j: int,
    predictions: Sequence[tuple[Point, Array]],
    motor_torque: Array,
    free: tuple[Array, Array],
    *,
    held_out: bool = False,
) -> Series:
    """Signals of one log of a problem; predictions are (point, errors (T, n)), torque and free errors are (T,)."""
    before, after = (input_equivalent(problem, point, error)[:, j] for point, error in predictions)
    a, b = int(problem.bounds[log]), int(problem.bounds[log + 1])
    step = max(1, (b - a) // PLOTTED)
    pick = slice(a, b, step)
    _, velocity, acceleration = _motion(problem, log, j)
    return Series(
        log=problem.names[log],
        held_out=held_out,
        time=problem.time[pick],
        command=problem.command[pick, j],
        reading=problem.reading[pick, j],
        velocity=velocity[::step],
        acceleration=acceleration[::step],
        motor_torque=motor_torque[pick],
        before=before[pick],
        after=after[pick],
        free_before=free[0][pick],
        free_after=free[1][pick],
    )


def _motion(problem: Problem, log: int, j: int) -> tuple[Array, Array, Array]:
    """Smoothed position, velocity and acceleration of one log, each (samples,)."""
    rows_ = slice(int(problem.bounds[log]), int(problem.bounds[log + 1]))
    seconds = max(0.03, 8 * problem.sample_time)
    q, dq, ddq = smooth_derivatives(problem.time[rows_], problem.reading[rows_, j : j + 1], seconds)
    return q[:, 0], dq[:, 0], ddq[:, 0]


def spectrum(solved: Solved, j: int) -> Spectrum:
    """Amplitude densities of the residuals, as a command, on the first held-out log."""
    problem = solved.held_out
    before = next(step for step in solved.ledger if step.role == "nominal")
    rows_ = slice(int(problem.bounds[0]), int(problem.bounds[1]))
    densities = []
    for step in (before, solved.last):
        residual = input_equivalent(problem, step.point, step.replay.prediction)[rows_, j]
        frequency, power = welch(residual, 1.0 / problem.sample_time, nperseg=min(len(residual), 4096))
        densities.append(np.sqrt(power))
    return Spectrum(frequency, *densities)


def provenance(read: Recordings, settings: Settings, seconds: dict[str, float], findings: Sequence[str]) -> Provenance:
    """Hashes of the logs, versions, settings, seconds."""
    packages = ("adeptone", "numpy", "scipy", "numba")
    return Provenance(
        logs=tuple(described(log) for log in read.fitted),
        holdout=tuple(described(log) for log in read.held_out),
        robot=None if read.robot is None else read.robot.name,
        robot_sha256=None if read.robot is None else read.robot.content_hash,
        files={},
        versions={"python": platform.python_version(), **{name: version(name) for name in packages}},
        settings=asdict(settings),
        seconds={name: round(value, 3) for name, value in seconds.items()},
        findings=tuple(findings),
    )


def described(log: Log) -> dict[str, object]:
    """A log as provenance: name, file, content hash, size."""
    return {
        "name": log.name,
        "source": log.source,
        "sha256": log.content_hash,
        "samples": len(log),
        "duration": log.duration,
        "sample_time": log.sample_time,
    }
