"""XL330 servo with a pendulum: friction that grows with the motor's torque, beside the authors' models m1 to m6."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.real import bam, drawing
from benchmarks.real.diagnosed import said
from benchmarks.real.inverse import missing
from benchmarks.real.ladder import gains, parameters_table, rivals_sentence, steps_table, tried_table
from benchmarks.real.outcome import Outcome, Picture, Section, Table, rows
from benchmarks.real.sensor import sensor_floor
from benchmarks.real.windowed import Free, Model, Step, fit, free_of, ladder, score, windows
from envs.log import Log
from envs.rigs import rig

NAME = "xl330"
WINDOW = 1.0
"""Length of the windows of free simulation [s]."""
MRAD = 1e3
WEIGHT = bam.MASS * bam.GRAVITY * bam.LENGTH
"""Largest torque of gravity [N m], which is known better than any other: it turns volts into N m."""


def nominal() -> Model:
    """Motor with back-EMF and a pendulum at an unknown zero, in volts, as the robot's description has it."""
    machine = rig(NAME)
    volts, published = machine.robot().input_equivalent(1), machine.published()["m1"]
    return Model.of(
        (
            Free("nominal", "inertia", volts * (bam.MASS * bam.LENGTH**2 + published["armature"]), lower=1e-6),
            Free("nominal", "back_emf", published["kt"], lower=0.0),
            Free("nominal", "gravity_sine", volts * WEIGHT, lower=0.0),
            Free("nominal", "gravity_cosine", 0.0, scale=1.0),
        )
    )


def candidates() -> list[tuple[str, list[tuple[Free, ...]]]]:
    """Effects that are tried, with starting values in volts, seconds and radians."""
    dry = 0.15
    starts: dict[str, list[list[float | None]]] = {
        "coulomb_friction": [[dry]],
        "load_dependent_friction": [[0.1]],
        "stribeck_friction": [[dry, dry, 0.3, 1.5], [dry, dry, 2.0, 1.5]],
        "presliding_friction": [[dry, 0.01, 2e-3]],
        "friction_asymmetry": [[0.01, 0.01]],
        "quadratic_drag": [[1e-3]],
        "amplifier_offset": [[0.02]],
        "dead_zone": [[0.05]],
        "voltage_saturation": [[7.0]],
        "supply_sag": [[0.01]],
        "input_delay": [[3e-3]],
        "amplifier_lag": [[4e-3]],
        "torque_constant_saturation": [[1e-3]],
        "thermal_drift": [[0.03, 10.0]],
        "joint_flexibility": [[0.5, 30.0, 0.05]],
        "backlash": [[0.01, 0.5, 30.0, 0.3]],
        "cable_spring": [[0.01, 1e-3]],
        "encoder_eccentricity": [[3e-3, 3e-3]],
    }
    return [(name, [free_of(name, values) for values in each]) for name, each in starts.items()]


def long_enough(logs: Sequence[Log]) -> list[Log]:
    """Logs that hold at least one window."""
    return [log for log in logs if log.duration > 1.05 * WINDOW]


def run() -> Outcome:
    """Everything about this rig."""
    machine = rig(NAME)
    learn, test = list(machine.logs("fit")), long_enough(machine.logs("held_out"))
    fitted, held_out = windows(learn, (1,), WINDOW), windows(test, (1,), WINDOW)
    given = nominal()
    steps, tried = ladder(fitted, held_out, given, candidates())
    last = steps[-1].model
    floor = MRAD * float(sensor_floor(test, (1,), last, WINDOW, pair=False)[0])
    comparison, numbers = compared(learn, test, steps)
    numbers |= {
        "refitted nominal: held-out": MRAD * float(steps[0].held_out[0]),
        "extended: held-out": MRAD * float(steps[-1].held_out[0]),
        "sensor floor": floor,
        "parameters": float(len(last.free)),
    }
    engine = said(learn, list(machine.logs("held_out")), NAME)
    return Outcome(
        NAME,
        machine.title,
        summary(steps, tried, numbers),
        (
            wrong_section(learn, given, steps),
            Section(
                "Effects in the order of their gain",
                (
                    f"Windows of {WINDOW:g} s run on the recorded voltage alone, from the measured state. Fitted: two "
                    "trajectories at gains 100 and 400. Held out: every other gain, and trajectories that were never "
                    "fitted. An effect enters if its gain returns on windows that were left out.",
                    rivals_sentence(steps, tried),
                ),
                (
                    Picture(
                        "ladder",
                        "Rms error of free simulation, model by model; dashed: the true model with this encoder.",
                        gains(steps, score(fitted, given), score(held_out, given), MRAD, "mrad", floor),
                    ),
                ),
                (
                    steps_table(steps, given, fitted, held_out, MRAD, "mrad"),
                    parameters_table(last),
                    physical_table(last),
                    tried_table(tried),
                ),
            ),
            comparison,
            left_section(test, last, floor, numbers["extended: held-out"]),
            engine.section,
        ),
        numbers,
    )


def summary(
    steps: Sequence[Step], tried: Sequence[tuple[str, str, float]], numbers: dict[str, float]
) -> tuple[str, ...]:
    """The finding in three sentences."""
    model = steps[-1].model
    names = [step.name.removeprefix("+ ") for step in steps[1:]]
    labels = {f.label for f in model.free}
    friction = ""
    if "load_dependent_friction.coefficient" in labels:
        value = model.value("load_dependent_friction.coefficient")
        spread = model.deviation("load_dependent_friction.coefficient")
        friction = (
            f" The gearbox turns {100 * value:.0f} ± {100 * spread:.0f} % of the motor's torque into friction; the "
            "authors' m5 and m6 have 27 to 29 % from other recordings."
        )
    return (
        f"The nominal motor with a pendulum errs by {numbers['refitted nominal: held-out']:.0f} mrad after one "
        "second on "
        f"runs that were not fitted; with {', then '.join(names)} it errs by {numbers['extended: held-out']:.1f} mrad "
        f"({int(numbers['parameters'])} parameters)." + friction,
        f"The authors' models refitted on the same logs reach {numbers['best refitted m']:.1f} mrad at best (m1: "
        f"{numbers['m1 refitted']:.0f} mrad); with their published parameters, driven by the recorded voltage, "
        f"{numbers['best published m']:.0f} mrad at best.",
        f"The encoder alone would leave {numbers['sensor floor']:.1f} mrad, so most of the rest is physics that no "
        "name here covers.",
    )


def wrong_section(learn: Sequence[Log], given: Model, steps: Sequence[Step]) -> Section:
    """What the nominal model lacks, against the signals that tell the causes."""
    before, after = ([missing(log, model) for log in learn] for model in (steps[0].model, steps[-1].model))
    drawn, axes = drawing.figure(1, 3, 2.6)
    for parts, color, label in ((before, drawing.BEFORE, "refitted nominal"), (after, drawing.AFTER, "extended")):
        signals = {
            "velocity [rad/s]": [p.velocity for p in parts],
            "motor torque, as voltage [V]": [p.torque * np.sign(p.velocity) for p in parts],
            "position [rad]": [p.position for p in parts],
        }
        lack = np.concatenate([p.command for p in parts])
        speed = np.concatenate([p.velocity for p in parts])
        for panel, (name, values) in zip(axes[0], signals.items(), strict=True):
            y = lack * np.sign(speed) if "torque" in name else lack
            moving = np.abs(speed) > 0.3
            drawing.binned(panel, np.concatenate(values)[moving], y[moving], color, label)
            panel.set_xlabel(name)
    axes[0, 1].set_xlabel("motor torque along the motion [V]")
    axes[0, 0].set_ylabel("missing voltage [V]")
    axes[0, 1].set_ylabel("missing voltage along the motion [V]")
    axes[0, 0].legend(loc="best")
    rms = lambda parts: float(np.sqrt(np.mean(np.concatenate([p.command for p in parts]) ** 2)))  # noqa: E731
    text = (
        "The missing voltage is what would have to be added to the command to explain the recorded motion, against "
        "velocity, against the motor's torque (both along the direction of motion) and against position. The refitted "
        f"nominal model lacks {rms(before):.2f} V rms and lacks it wherever the motor works; the extended model lacks "
        f"{rms(after):.2f} V.",
    )
    caption = (
        "Missing voltage of the refitted nominal and of the extended model, fitted runs, moving faster than 0.3 rad/s: "
        "medians and the middle 80 %."
    )
    picture = Picture("missing", caption, drawing.svg(drawn, "xlmissing"))
    return Section("What the nominal model gets wrong", text, (picture,))


def physical_table(model: Model) -> Table:
    """Volts turned into SI by the known weight."""
    weight, spread = model.value("gravity_sine"), model.deviation("gravity_sine")
    volts = weight / WEIGHT
    kt, kt_spread = model.value("back_emf"), model.deviation("back_emf")
    authors = rig(NAME).published()["m1"]
    ohms = volts * kt
    inertia, inertia_spread = model.value("inertia") / volts, model.deviation("inertia") / volts
    zero, zero_spread = model.value("gravity_cosine") / weight, model.deviation("gravity_cosine") / weight
    load = bam.MASS * bam.LENGTH**2
    found = [
        ("voltage per torque R/k", volts, spread / WEIGHT, "V/(N m)", authors["R"] / authors["kt"]),
        ("motor constant k", kt, kt_spread, "N m/A", authors["kt"]),
        ("resistance R", ohms, ohms * float(np.hypot(spread / weight, kt_spread / kt)), "ohm", authors["R"]),
        ("inertia with rotor", inertia, inertia_spread, "kg m^2", load + authors["armature"]),
        ("zero of the pendulum", zero, zero_spread, "rad", authors["q_offset"]),
    ]
    return Table(
        "physical",
        "The same in SI units: the weight of the pendulum is known and turns volts into N m",
        ("quantity", "value", "standard deviation", "unit", "authors' m1"),
        rows(found),
    )


def compared(learn: Sequence[Log], test: Sequence[Log], steps: Sequence[Step]) -> tuple[Section, dict[str, float]]:
    """The authors' m1 to m6 and the models of the ladder on the same windows, run by run."""
    fitted, held_out = windows(learn, (1,), WINDOW), windows(test, (1,), WINDOW)
    by_run = [(log.name.split("/")[-1], windows([log], (1,), WINDOW)) for log in (*learn, *test)]
    known = {name: bam.Bam(name, values) for name, values in rig(NAME).published().items()}
    refitted: dict[str, bam.Bam] = {}
    for name, model in known.items():
        refitted[name] = bam.refit(fitted, name, [model, *list(refitted.values())[-1:]])
    found = []
    for kind, models in (("as published", known), ("refitted", refitted)):
        for name, model in models.items():
            count = len(bam.FREE[name])
            found.append((f"{name} {kind}", count, MRAD * bam.rms(fitted, model), MRAD * bam.rms(held_out, model)))
    for step in steps:
        found.append((step.name, len(step.model.free), MRAD * float(step.fitted[0]), MRAD * float(step.held_out[0])))
    table = Table(
        "models",
        f"Rms error of free simulation in windows of {WINDOW:g} s [mrad], all models driven by the recorded voltage",
        ("model", "parameters", "fitted runs", "held-out runs"),
        rows(found),
    )
    per_run = Table(
        "runs",
        "The same run by run [mrad]",
        ("run", "role", "refitted nominal", "m1 refitted", "m6 refitted", "extended model"),
        rows(
            [
                (
                    name,
                    "fitted" if i < len(learn) else "held out",
                    MRAD * float(score(problem, steps[0].model)[0]),
                    MRAD * bam.rms(problem, refitted["m1"]),
                    MRAD * bam.rms(problem, refitted["m6"]),
                    MRAD * float(score(problem, steps[-1].model)[0]),
                )
                for i, (name, problem) in enumerate(by_run)
            ]
        ),
    )
    fits = Table(
        "refitted_parameters",
        "Parameters of the refitted m1 to m6 (SI, the authors' names)",
        ("model", "parameter", "refitted", "published"),
        rows([(n, k, v, known[n].values.get(k)) for n, m in refitted.items() for k, v in m.values.items()]),
        folded=True,
    )
    numbers = {
        "best refitted m": min(row[3] for row in found[6:12]),
        "best published m": min(row[3] for row in found[:6]),
        "m1 refitted": found[6][3],
        "m6 refitted": found[11][3],
    }
    text = (
        "m1 to m6 are the authors' friction models (Coulomb, Stribeck, load-dependent, and combinations). They "
        "identified "
        "them in closed loop, the servo's own controller simulated with it; here every model gets the recorded voltage "
        "instead, which forgives nothing. As published they serve as a check of scale; refitted on the same windows "
        "they are contestants.",
        "The step from m2 to m3, which is load-dependent friction, is the large one for them too. What m1 to m6 do "
        "not have is a torque that saturates at high voltage.",
    )
    return Section("The authors' models on the same logs", text, (), (table, per_run, fits)), numbers


def left_section(test: Sequence[Log], model: Model, floor: float, reached: float) -> Section:
    """What remains: where and how much."""
    problem = windows(test, (1,), WINDOW)
    refit = fit(problem, model)
    own = MRAD * float(score(problem, refit)[0])
    text = (
        f"On held-out runs {reached:.1f} mrad remain, the encoder alone would leave {floor:.1f} mrad. The same model "
        f"fitted to the held-out runs themselves (no forecast) leaves {own:.1f} mrad: "
        + (
            "so most of the rest is structure, not parameters that changed."
            if own > 0.7 * reached
            else "so a good part of the rest is parameters that differ from run to run."
        ),
        "The log holds one register of the drive per cycle of 5.3 ms, while the firmware changes the duty cycle in "
        "between; the supply is read at a tenth of a volt and sags with the current. Both limit what a voltage-driven "
        "simulation of these logs can reach, and neither is in the data.",
    )
    return Section("What stays unexplained", text)
