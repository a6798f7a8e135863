"""DFKI double pendulum: two coupled joints, where regression is biased and simulation error is not."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.real import drawing
from benchmarks.real.diagnosed import said
from benchmarks.real.inverse import missing
from benchmarks.real.ladder import gains, rivals_sentence, steps_table, tried_table
from benchmarks.real.outcome import Outcome, Picture, Section, Table, rows
from benchmarks.real.sensor import sensor_floor
from benchmarks.real.windowed import Free, Model, Step, errors, fit, free_of, halves, ladder, score, windows
from diagnosis.problem import Problem, smooth_derivatives
from envs import data_sets
from envs.log import Array, Log
from envs.rigs import rig

NAME = "dfki_double_pendulum"
JOINTS = (1, 2)
WINDOW = 0.25
"""Length of the windows that are fitted [s]: a fraction of the pendulum's period, so that no window runs away."""
SCORED = (0.25, 0.5, 1.0)
"""Lengths of windows that are judged [s]."""
PLACES = (
    "fitted, shoulder",
    "fitted, elbow",
    "held-out sines, shoulder",
    "held-out sines, elbow",
    "swing-ups, shoulder",
    "swing-ups, elbow",
)
"""Runs and joints in the order of every table."""
MRAD = 1e3
REGRESSION_SMOOTHING = 0.06
"""Window of the derivatives of the plain regression [s]."""


def model_of(p: dict[str, float]) -> Model:
    """The authors' parameters in base parameters of the pair, torques in N m."""
    g, rotor = p["g"], p["gr"] ** 2 * p["Ir"]
    return Model.of(
        (
            Free("nominal", "inertia", p["I1"] + p["m2"] * p["l1"] ** 2 + rotor, 0, lower=1e-4),
            Free("nominal", "inertia", p["I2"] + rotor, 1, lower=1e-4),
            Free("coupling", "coupling_inertia", p["m2"] * p["l1"] * p["r2"]),
            Free("coupling", "shared_inertia", p["I2"]),
            Free("nominal", "viscous", p["b1"], 0, scale=0.01, lower=0.0),
            Free("nominal", "viscous", p["b2"], 1, scale=0.01, lower=0.0),
            Free("nominal", "gravity_sine", (p["m1"] * p["r1"] + p["m2"] * p["l1"]) * g, 0),
            Free("nominal", "gravity_sine", p["m2"] * p["r2"] * g, 1),
            Free("nominal", "gravity_cosine", 0.0, 0, scale=0.1),
            Free("nominal", "gravity_cosine", 0.0, 1, scale=0.1),
        )
    )


def friction(first: float, second: float) -> tuple[Free, ...]:
    """Coulomb friction on both joints."""
    return (*free_of("coulomb_friction", [first], 0), *free_of("coulomb_friction", [second], 1))


def regression(logs: Sequence[Log], model: Model) -> Model:
    """The model's linear parameters and Coulomb friction by joint least squares on smoothed derivatives of both joints.

    The torque equations of the pair, stacked::

        u1 = I1 q1'' + p2 (q1'' + q2'') + p3 [...] + b1 q1' + c1 sign(q1') + gravity
        u2 = (I2 + p2) ... with the shared p2 and p3 in both
    """
    matrices, targets = [], []
    for log in logs:
        held = np.vstack([log.command[:1], 0.5 * (log.command[1:] + log.command[:-1])])
        q, dq, ddq = smooth_derivatives(log.time, log.position, REGRESSION_SMOOTHING)
        u = smooth_derivatives(log.time, held, REGRESSION_SMOOTHING)[0]
        c, s, both = np.cos(q[:, 1]), np.sin(q[:, 1]), q.sum(axis=1)
        zero = np.zeros(len(q))
        dry = np.tanh(dq / 0.05)
        shoulder = np.column_stack(
            [ddq[:, 0], zero, c * (2 * ddq[:, 0] + ddq[:, 1]) - s * (2 * dq[:, 0] * dq[:, 1] + dq[:, 1] ** 2),
             ddq[:, 0] + ddq[:, 1], dq[:, 0], zero, np.sin(q[:, 0]), np.sin(both), np.cos(q[:, 0]), np.cos(both),
             dry[:, 0], zero]
        )  # fmt: skip
        elbow = np.column_stack(
            [zero, ddq[:, 1], c * ddq[:, 0] + s * dq[:, 0] ** 2, ddq[:, 0], zero, dq[:, 1], zero, np.sin(both), zero,
             np.cos(both), zero, dry[:, 1]]
        )  # fmt: skip
        inner = slice(50, -50)
        matrices += [shoulder[inner], elbow[inner]]
        targets += [u[inner, 0], u[inner, 1]]
    solution = np.linalg.lstsq(np.concatenate(matrices), np.concatenate(targets), rcond=None)[0]
    free = (*model.free, *friction(0.0, 0.0))
    return Model(free, solution)


def candidates() -> list[tuple[str, list[tuple[Free, ...]]]]:
    """Effects that are tried, each on both joints at once, with starting values in N m, s and rad."""
    starts: dict[str, list[list[float | None]]] = {
        "coulomb_friction": [[0.05]],
        "load_dependent_friction": [[0.05]],
        "stribeck_friction": [[0.05, 0.05, 0.5, 1.5]],
        "presliding_friction": [[0.05, 2.5e-3, 5e-3]],
        "friction_asymmetry": [[0.01, 0.01]],
        "amplifier_offset": [[0.01]],
        "dead_zone": [[0.03]],
        "input_delay": [[4e-3]],
        "amplifier_lag": [[4e-3]],
        "torque_constant_saturation": [[1e-2]],
    }
    return [
        (name, [(*free_of(name, values, 0), *free_of(name, values, 1)) for values in each])
        for name, each in starts.items()
    ]


def with_reported_torque(log: Log, run: str) -> Log:
    """The recording with the torque that the drives report in place of the commanded one."""
    path = data_sets.locate(NAME, rig(NAME).run(run).file)
    content = path.read_bytes()
    lines = (gzip.decompress(content) if path.suffix == ".gz" else content).decode().splitlines()
    header = [name.strip() for name in lines[0].split(",")]
    table = np.loadtxt(lines[1:], delimiter=",")
    time = table[:, header.index("time")]
    torque = [np.interp(log.time, time, table[:, header.index(f"tau_meas{joint}")]) for joint in JOINTS]
    return replace(log, command=np.column_stack(torque))


def run() -> Outcome:
    """Everything about this rig."""
    machine = rig(NAME)
    published = machine.published()["model 3.0"]
    runs = {r.name: machine.log(r.name) for r in machine.runs}
    learn = list(machine.logs("fit"))
    sines = [runs[r.name] for r in machine.runs if r.role == "held_out" and r.loop == "open"]
    swings = [runs[r.name] for r in machine.runs if r.role == "held_out" and r.loop == "closed"]
    fitted, held_out = (windows(logs, JOINTS, WINDOW, pair=True) for logs in (learn, sines))
    given = model_of(published)
    authors = given.extended(friction(published["cf1"], published["cf2"]))
    biased = regression(learn, given)
    start = Model(given.free, np.maximum(biased.values[: len(given.free)], [f.lower for f in given.free]))
    begin = min((given, start), key=lambda m: float(np.sum(score(fitted, m))))
    steps, tried = ladder(halves(fitted)[0], held_out, begin, candidates(), least=0.03)
    steps = [on_all(step, fitted, held_out) for step in steps]
    last = steps[-1].model
    floor = MRAD * sensor_floor(sines, JOINTS, last, WINDOW, pair=True)
    models = [
        ("authors' model 3.0, as published", authors, None),
        ("authors' model 3.0 without friction", given, None),
        ("regression on derivatives", biased, None),
        *((step.name, step.model, None) for step in steps),
    ]
    compared = comparison([*models[:-1], ("extended model", last, None)], learn, sines, swings)
    reported = reported_section(learn, sines, swings, authors, steps[min(1, len(steps) - 1)].model)
    numbers = {}
    for key, model in (("authors", authors), ("regression", biased), ("nominal", steps[0].model), ("extended", last)):
        for place, logs in (("held-out", sines), ("swing-up", swings)):
            for j, value in enumerate(score(windows(logs, JOINTS, WINDOW, pair=True), model)):
                numbers[f"{key}: {place} joint {j + 1}"] = MRAD * float(value)
    numbers |= {f"sensor floor joint {j + 1}": float(value) for j, value in enumerate(floor)}
    engine = said(learn, [*sines, *swings], NAME)
    names = [step.name.removeprefix("+ ") for step in steps[1:]]
    summary = (
        f"Windows of {WINDOW} s of open-loop runs that were not fitted: the authors' parameters err by "
        f"{numbers['authors: held-out joint 1']:.1f} and {numbers['authors: held-out joint 2']:.1f} mrad (shoulder, "
        "elbow), "
        f"a regression on derivatives of the same fitted runs by {numbers['regression: held-out joint 1']:.1f} and "
        f"{numbers['regression: held-out joint 2']:.1f}, the model fitted by simulation error by "
        f"{numbers['extended: held-out joint 1']:.1f} and {numbers['extended: held-out joint 2']:.1f}.",
        f"Effects that earned their place on both joints: {', '.join(names) or 'none'}.",
        f"Swing-ups under feedback, far outside of the fitted motion: {numbers['authors: swing-up joint 1']:.0f} and "
        f"{numbers['authors: swing-up joint 2']:.0f} mrad with the authors' parameters, "
        f"{numbers['extended: swing-up joint 1']:.0f} and {numbers['extended: swing-up joint 2']:.0f} mrad here.",
    )
    return Outcome(
        NAME,
        machine.title,
        summary,
        (
            wrong_section(learn, steps[0].model, last, authors),
            Section(
                "Effects in the order of their gain",
                (
                    "The two joints are one problem with one inertia matrix. A regression of torque on derivatives is "
                    "biased here: near resonance inertia and gravity cancel, the net torque is small, and the errors "
                    "of the "
                    "acceleration are not. It only serves as a start; every model is fitted to the simulation error "
                    "of short windows.",
                    rivals_sentence(steps, tried),
                ),
                tuple(ladder_picture(steps, authors, fitted, held_out, floor, j) for j in range(2)),
                (
                    steps_table(steps, authors, fitted, held_out, MRAD, "mrad"),
                    parameters_beside(last, authors, biased),
                    tried_table(tried),
                ),
            ),
            compared,
            reported,
            left_section(numbers),
            engine.section,
        ),
        numbers,
    )  # fmt: skip


def ladder_picture(
    steps: Sequence[Step], given: Model, fitted: Problem, held_out: Problem, floor: Array, j: int
) -> Picture:
    """Bars of one joint; floor (2,) [mrad]."""
    caption = f"Joint {j + 1}: rms error of free simulation in windows of {WINDOW} s; dashed: sensor alone."
    before = score(fitted, given), score(held_out, given)
    return Picture(f"ladder{j + 1}", caption, gains(steps, *before, MRAD, "mrad", float(floor[j]), j))


def on_all(step: Step, fitted: Problem, held_out: Problem) -> Step:
    """A step of the ladder, which was chosen on every other window, fitted to all of them."""
    model = fit(fitted, step.model)
    return Step(step.name, model, score(fitted, model), score(held_out, model))


def comparison(
    models: Sequence[tuple[str, Model, None]], learn: Sequence[Log], sines: Sequence[Log], swings: Sequence[Log]
) -> Section:
    """All models on windows of several lengths, and run by run."""
    found = []
    for seconds in SCORED:
        groups = [windows(logs, JOINTS, seconds, pair=True) for logs in (learn, sines, swings)]
        for title, model, _ in models:
            found.append((seconds, title, *(MRAD * float(v) for problem in groups for v in score(problem, model))))
    columns = ("window [s]", "model", *PLACES)
    table = Table("models", "Rms error of free simulation [mrad]", columns, rows(found))
    by_run = []
    for log in (*learn, *sines, *swings):
        problem = windows([log], JOINTS, WINDOW, pair=True)
        for title, model, _ in models:
            by_run.append((log.name.split("/")[-1], title, *(MRAD * float(v) for v in score(problem, model))))
    runs = Table("runs", f"The same run by run, windows of {WINDOW} s [mrad]", ("run", "model", "shoulder", "elbow"),
                 rows(by_run), folded=True)  # fmt: skip
    shown = windows(sines[:1], JOINTS, 1.0, pair=True)
    drawn, axes = drawing.figure(2, 1, 3.4, sharex=True)
    time = shown.time - shown.time[0]
    for j, panel in enumerate(axes[:, 0]):
        panel.plot(time, shown.reading[:, j], color=drawing.MEASURED, label="measured")
        for (title, model, _), color in ((models[0], drawing.BEFORE), (models[-1], drawing.AFTER)):
            error = errors(shown, model)[0][:, j]
            simulated = shown.reading[:, j] - error
            simulated[shown.bounds[1:-1]] = np.nan
            panel.plot(time, simulated, color=color, label=title)
        panel.set_ylabel(f"joint {j + 1} [rad]")
        panel.set_xlim(0.0, 6.0)
    axes[1, 0].set_xlabel("time [s]")
    axes[0, 0].legend(loc="upper right", fontsize=7, ncols=3)
    caption = f"Run {sines[0].name.split('/')[-1]}, not fitted: free simulation that restarts every second."
    picture = Picture("held_out", caption, drawing.svg(drawn, "dfkirun"))
    return Section("Beside the authors' parameters", (), (picture,), (table, runs))


def parameters_beside(last: Model, authors: Model, biased: Model) -> Table:
    """Base parameters of all three."""
    known, least = ({(f.label, f.joint): v for f, v in zip(m.free, m.values, strict=True)} for m in (authors, biased))
    found = [
        (f.joint + 1, f.label, value, spread, known.get((f.label, f.joint)), least.get((f.label, f.joint)))
        for f, value, spread in zip(last.free, last.values, last.deviations, strict=True)
    ]
    columns = ("joint", "parameter", "here", "standard deviation", "authors' model 3.0", "regression on derivatives")
    return Table(
        "beside",
        "Parameters of the extended model beside those of the others (N m, kg m², s), standard deviations by windows",
        columns,
        rows(found),
    )


def left_section(numbers: dict[str, float]) -> Section:
    """What remains, and why."""
    reached = [numbers[f"extended: held-out joint {j}"] for j in (1, 2)]
    floor = [numbers[f"sensor floor joint {j}"] for j in (1, 2)]
    swing = [numbers[f"extended: swing-up joint {j}"] for j in (1, 2)]
    text = (
        f"On held-out sines {reached[0]:.1f} and {reached[1]:.1f} mrad are left; encoder and state estimate at the "
        f"beginning of a window alone give {floor[0]:.1f} and {floor[1]:.1f} mrad. There is little more to find in "
        "these runs at this length of window.",
        f"On the swing-ups {swing[0]:.0f} and {swing[1]:.0f} mrad are left. There the commanded torque reaches 8 N m "
        "and "
        "changes faster than the drives follow: the torque that they report has half the rms of the command. No fitted "
        "run excites that, so nothing here can name it; a run with steps of torque would.",
    )
    return Section("What stays unexplained", text)


def reported_section(
    learn: Sequence[Log], sines: Sequence[Log], swings: Sequence[Log], authors: Model, begin: Model
) -> Section:
    """Commanded against reported torque as the input of the same models."""
    strip = lambda log: log.name.split("/")[-1]  # noqa: E731
    groups = [[with_reported_torque(log, strip(log)) for log in logs] for logs in (learn, sines, swings)]
    own = [windows(logs, JOINTS, WINDOW, pair=True) for logs in groups]
    plain = [windows(logs, JOINTS, WINDOW, pair=True) for logs in (learn, sines, swings)]
    refitted = fit(own[0], begin)
    found = [
        (title, kind, *(MRAD * float(v) for problem in problems for v in score(problem, model)))
        for title, model, kind, problems in (
            ("authors' model 3.0", authors, "commanded", plain),
            ("authors' model 3.0", authors, "reported", own),
            ("nominal with the first effect, fitted on commanded torque", begin, "commanded", plain),
            ("the same, fitted on reported torque", refitted, "reported", own),
        )
    ]
    table = Table(
        "torque",
        f"Commanded or reported torque as input, windows of {WINDOW} s [mrad]",
        ("model", "torque", *PLACES),
        rows(found),
    )  # fmt: skip
    text = (
        "The drives report a torque of their own. On the sine runs the authors' parameters do much better with it, "
        "which suggests that they were identified with it; on the swing-ups, where the command jumps between its "
        "limits, it is "
        "no better. Fitted models hardly care. Everything else on this page uses the commanded torque, which is known "
        "exactly.",
    )
    return Section("Commanded or reported torque", text, (), (table,))


def wrong_section(learn: Sequence[Log], nominal: Model, last: Model, authors: Model) -> Section:
    """What the frictionless pair lacks, and how small the net torque is."""
    drawn, axes = drawing.figure(1, 2, 2.7)
    for j, panel in enumerate(axes[0]):
        for model, color, label in ((authors, drawing.BEFORE, "authors' model 3.0"), (nominal, drawing.OTHER,
                                    "refitted nominal"), (last, drawing.AFTER, "extended")):  # fmt: skip
            parts = [missing(log, model, j) for log in learn]
            v, lack = (np.concatenate([getattr(p, name) for p in parts]) for name in ("velocity", "command"))
            moving = np.abs(v) > 0.2
            drawing.binned(panel, v[moving], lack[moving], color, label)
        panel.set_xlabel(f"velocity of joint {j + 1} [rad/s]")
    axes[0, 0].set_ylabel("missing torque [N m]")
    axes[0, 0].legend(fontsize=7)
    text = (
        "The nominal pair knows inertia, gravity and viscous friction. Against velocity the missing torque shows "
        "what friction "
        "it has not; the middle 80 % are wide because the acceleration is noisy, which is why nothing here is "
        "estimated from this picture.",
    )
    picture = Picture(
        "missing", "Missing torque on the fitted runs: medians and the middle 80 %.", drawing.svg(drawn, "dfkimissing")
    )
    return Section("What the nominal model gets wrong", text, (picture,))
