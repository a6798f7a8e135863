"""EMPS: a linear drive. Published Coulomb model, its repetition, and what it misses; force, windows and free run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.signal import butter, decimate, filtfilt, welch

from benchmarks.real import drawing
from benchmarks.real.diagnosed import said
from benchmarks.real.inverse import missing
from benchmarks.real.ladder import gains, parameters_table, rivals_sentence, steps_table, tried_table
from benchmarks.real.outcome import Outcome, Picture, Section, Table, rows
from benchmarks.real.windowed import Free, Model, Step, errors, fit, free_of, ladder, rms, score, windows
from diagnosis.problem import Problem
from envs.log import Array, Log
from envs.rigs import rig

NAME = "emps"
WINDOW = 0.25
"""Length of the windows of free simulation [s]."""
CUTOFF = 100.0
"""Butterworth filter of the benchmark's own script [Hz]."""
BORDER, DECIMATION = 49, 10
"""Samples that the benchmark's script leaves out at the beginning, and its decimation."""
BEGIN = 0.5
"""Time of the start from rest, which does not repeat [s]."""
SHORTEST, LONGEST = 5.5, 7.5
"""Where the period of the reference is looked for [s]."""
MM = 1e3


@dataclass(frozen=True, eq=False)
class Regression:
    """Least squares of the force on functions of the motion: coefficients with standard deviations, relative error."""

    names: tuple[str, ...]
    values: Array
    deviations: Array
    error: float


def motion(log: Log) -> tuple[Array, Array, Array]:
    """Filtered position, velocity and acceleration (T,), as the benchmark's script makes them."""
    q = filtfilt(*butter(4, CUTOFF * 2.0 * log.sample_time), log.position[:, 0])
    dq = np.gradient(q, log.sample_time)
    return q, dq, np.gradient(dq, log.sample_time)


def observed(log: Log, names: tuple[str, ...]) -> tuple[Array, Array]:
    """Decimated columns (N, len(names)) and force (N,) [N]."""
    q, dq, ddq = motion(log)
    forward, backward = (dq > 0).astype(float), (dq < 0).astype(float)
    column = {
        "mass": ddq,
        "viscous": dq,
        "coulomb": np.sign(dq),
        "offset": np.ones_like(q),
        "viscous_forward": forward * dq,
        "coulomb_forward": forward,
        "viscous_backward": backward * dq,
        "coulomb_backward": -backward,
        "position sine (screw)": np.sin(2.0 * np.pi * q / 0.005),
        "position cosine (screw)": np.cos(2.0 * np.pi * q / 0.005),
        "position": q,
        "position squared": q**2,
        "quadratic drag": dq * np.abs(dq),
        "Stribeck (0.01 m/s)": np.sign(dq) * np.exp(-np.abs(dq) / 0.01),
        "asymmetry of viscous friction": np.abs(dq),
    }
    matrix = np.column_stack([decimate(column[name][BORDER:], DECIMATION) for name in names])
    return matrix, decimate(gain(log) * log.command[BORDER:, 0], DECIMATION)


def gain(log: Log) -> float:
    """Force per volt of the controller's output [N/V]."""
    return float(rig(NAME).robot().drives[0].amplifier_gain.value)


def regression(log: Log, names: tuple[str, ...]) -> Regression:
    """Least squares on one log; standard deviations of ordinary least squares, as published."""
    matrix, force = observed(log, names)
    values = np.linalg.lstsq(matrix, force, rcond=None)[0]
    residual = force - matrix @ values
    spread = np.std(residual) * np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    return Regression(names, np.asarray(values, dtype=float), spread, relative(residual, force))


def on(log: Log, found: Regression) -> float:
    """Relative force error of a regression on another log."""
    matrix, force = observed(log, found.names)
    return relative(force - matrix @ found.values, force)


def relative(residual: Array, force: Array) -> float:
    """Norm of the residual over that of the force."""
    return float(np.linalg.norm(residual) / np.linalg.norm(force))


def repeatability(log: Log) -> float:
    """Relative force error of the best conceivable model of a motion that repeats: the spread between the periods.

    With n periods the mean over them explains its own share, hence the factor sqrt(n / (n - 1)).
    """
    low_pass = butter(4, CUTOFF * 2.0 * log.sample_time)
    force = gain(log) * filtfilt(*low_pass, log.command[:, 0])
    first, length = round(BEGIN / log.sample_time), period(log)
    count = (len(force) - first) // length
    parts = np.stack([decimate(force[first + i * length :][:length], DECIMATION) for i in range(count)])
    spread = parts - parts.mean(axis=0)
    return float(np.linalg.norm(spread) / np.linalg.norm(parts) * np.sqrt(count / (count - 1)))


def period(log: Log) -> int:
    """Samples after which the motion repeats itself best."""
    q = log.position[round(BEGIN / log.sample_time) :, 0]
    lags = np.arange(round(SHORTEST / log.sample_time), round(LONGEST / log.sample_time))
    size = len(q) - lags[-1]
    return int(lags[np.argmin([np.sum((q[lag : lag + size] - q[:size]) ** 2) for lag in lags])])


COULOMB = ("mass", "viscous", "coulomb", "offset")
DIRECTIONAL = ("mass", "viscous_forward", "coulomb_forward", "viscous_backward", "coulomb_backward")


def base(log: Log) -> Model:
    """Published Coulomb model in units of the command."""
    published, volts = rig(NAME).published()["Coulomb friction"], 1.0 / gain(log)
    return Model.of(
        (
            Free("nominal", "inertia", volts * published["mass"], lower=1e-3),
            Free("nominal", "viscous", volts * published["viscous"], lower=0.0),
            Free("nominal", "load", volts * published["offset"], scale=0.1),
            *free_of("coulomb_friction", [volts * published["coulomb"]]),
        )
    )


def candidates(log: Log) -> list[tuple[str, list[tuple[Free, ...]]]]:
    """Effects that are tried beside Coulomb friction, with starting values in volts."""
    n = 1.0 / gain(log)
    starts: dict[str, list[list[float | None]]] = {
        "friction_asymmetry": [[None, -50.0 * n]],
        "load_dependent_friction": [[0.02]],
        "presliding_friction": [[5.0 * n, 5e-5, 0.01]],
        "quadratic_drag": [[100.0 * n]],
        "amplifier_lag": [[1e-3]],
        "input_delay": [[1e-3]],
        "dead_zone": [[0.01]],
        "joint_flexibility": [[0.5, 23.0, 0.05]],
        "cable_spring": [[10.0 * n, None]],
        "torque_constant_saturation": [[1e-3]],
        "thermal_drift": [[0.02, 10.0]],
        "cogging_torque": [[0.5 * n, 0.5 * n, 2.0 * np.pi / 0.005]],
        "encoder_eccentricity": [[1e-5, 1e-5]],
    }
    found = [(name, [free_of(name, values) for values in each]) for name, each in starts.items()]
    stribeck = [free_of("stribeck_friction", [0.0, 5.0 * n, velocity, 1.0]) for velocity in (0.002, 0.02)]
    return [*found, ("stribeck_friction", stribeck)]


def free_run(log: Log, model: Model) -> Array:
    """Error (T,) [m] of the simulation over the whole log from rest at the first reading, as published."""
    return errors(at_rest(log), model)[0][:, 0]


def at_rest(log: Log) -> Problem:
    """The whole log as one window that starts at rest at the first reading."""
    problem = windows([log], (1,), None)
    problem.starts[:, :, 1] = 0.0
    return problem


def run() -> Outcome:
    """Everything about this rig."""
    machine = rig(NAME)
    published = machine.published()
    learn, test = machine.log("estimation"), machine.log("pulses")
    forces, numbers = force_section(learn, test)
    window_part, ladder_numbers, steps = window_section(learn, test)
    free_part, free_numbers = free_section(
        learn, test, steps[-1].model, published["free-run position RMSE on the pulses"]
    )
    numbers |= ladder_numbers | free_numbers
    engine = said([learn], [test], NAME)
    numbers["published parameters: largest deviation"] = max(
        numbers[f"{name}: deviation from published"] for name in COULOMB
    )
    summary = (
        f"The published Coulomb model is repeated: parameters within "
        f"{100 * numbers['published parameters: largest deviation']:.2f} %, force error "
        f"{100 * numbers['Coulomb: estimation']:.2f} % (published 4.08 %) on the estimation file and "
        f"{100 * numbers['Coulomb: pulses']:.2f} % (published 5.98 %) on the pulses.",
        f"Its largest error has a name: viscous friction differs between the two directions "
        f"({numbers['viscous forward']:.0f} forward, {numbers['viscous backward']:.0f} N s/m backward). With it the "
        f"force error is {100 * numbers['directional: estimation']:.2f} % and "
        f"{100 * numbers['directional: pulses']:.2f} %"
        f"; what the same motion repeats itself to is {100 * numbers['repeatability: estimation']:.2f} %.",
        f"Open-loop windows of {WINDOW} s on the pulses file: {numbers['window: published']:.3f} mm with the published "
        f"model, {numbers['window: last']:.3f} mm with {', '.join(s.name.removeprefix('+ ') for s in steps[1:])}.",
        f"Free run over 25 s, fitted on the estimation file: {numbers['free: Coulomb estimation']:.2f} mm there and "
        f"{numbers['free: Coulomb pulses']:.2f} mm on the pulses with four physical parameters, "
        f"{numbers['free: directional estimation']:.2f} and {numbers['free: directional pulses']:.2f} mm with "
        "direction-dependent friction; linear models and recurrent networks are published with 61 to 220 mm, dynoNet "
        "with 2.64 mm.",
        f"Why not less on the pulses: friction was another one. Least squares on that file alone gives "
        f"{100 * numbers['viscous: change']:.1f} % more viscous friction. The same five parameters fitted to the "
        "free run "
        f"of the pulses file itself leave {numbers['free: refitted on pulses']:.2f} mm, so what is missing is not "
        "structure but the friction of the day.",
    )
    return Outcome(
        NAME, machine.title, summary, (forces, window_part, free_part, left_section(numbers), engine.section), numbers
    )


def force_section(learn: Log, test: Log) -> tuple[Section, dict[str, float]]:
    """The published regressions, and which further functions of the motion the force asks for."""
    published = rig(NAME).published()
    coulomb, directional = regression(learn, COULOMB), regression(learn, DIRECTIONAL)
    numbers = {
        "Coulomb: estimation": coulomb.error,
        "Coulomb: pulses": on(test, coulomb),
        "directional: estimation": directional.error,
        "directional: pulses": on(test, directional),
        "repeatability: estimation": repeatability(learn),
        "viscous forward": float(directional.values[1]),
        "viscous backward": float(directional.values[3]),
    }
    shares = concentration(learn, directional)
    numbers["left: samples accelerating"], numbers["left: energy while accelerating"], numbers["left: above 10 Hz"] = (
        shares
    )
    parameter_rows = []
    for found, key in ((coulomb, "Coulomb friction"), (directional, "direction-dependent friction")):
        for name, value, spread in zip(found.names, found.values, found.deviations, strict=True):
            given = published[key].get(name)
            share = None if given is None else abs(value / given - 1.0)
            parameter_rows.append((key, name, value, spread, given, share))
            if key == "Coulomb friction":
                numbers[f"{name}: deviation from published"] = float(share or 0.0)
    again = regression(test, COULOMB)
    change = [("the pulses file alone", name, v, s, None, None) for name, v, s in
              zip(again.names, again.values, again.deviations, strict=True)]  # fmt: skip
    numbers["viscous: change"] = float(again.values[1] / coulomb.values[1] - 1.0)
    more = [
        ("published Coulomb model", coulomb, 0.0408, 0.0598),
        ("direction-dependent friction", directional, 0.0311, None),
        *(
            (f"+ {title}", regression(learn, (*DIRECTIONAL, *names)), None, None)
            for title, names in (
                ("Stribeck friction", ("Stribeck (0.01 m/s)",)),
                ("quadratic drag", ("quadratic drag",)),
                ("ripple of the screw", ("position sine (screw)", "position cosine (screw)")),
                ("force over position", ("position", "position squared")),
            )
        ),
    ]
    table = Table(
        "force",
        "Relative force error; published figures beside ours (fitted on the estimation file)",
        ("model", "parameters", "estimation", "pulses", "estimation, published", "pulses, published"),
        rows(
            [(t, len(f.names), f.error, on(test, f), a, b) for t, f, a, b in more]
            + [("repetition of the same motion", 0, repeatability(learn), None, None, None)]
        ),
    )
    own = Table(
        "parameters",
        "Least squares as the benchmark's own script does it (N, kg, N s/m)",
        ("model", "parameter", "value", "standard deviation", "published", "deviation"),
        rows([*parameter_rows, *change]),
        digits=5,
    )
    figure = Picture(
        "missing_force",
        "What the published model lacks, on the pulses file, against velocity and against position: medians and the "
        "middle 80 % (orange: published Coulomb model; blue: with direction-dependent friction).",
        missing_force(learn, test, coulomb, directional),
    )
    text = (
        "Butterworth filter at 100 Hz forwards and backwards, central differences, decimation by ten, least squares: "
        "the "
        "benchmark's own recipe. Fitted on the estimation file, judged on the file with force pulses. The last row "
        "is no "
        "model: the carriage repeats one motion again and again, and the spread of the force between the repetitions "
        "is "
        "what no model of the motion can go below (the pulses have another period, so it is given for the estimation "
        "file only).",
    )
    return Section("Force: the published model repeated, and what it misses", text, (figure,), (table, own)), numbers


def missing_force(learn: Log, test: Log, coulomb: Regression, directional: Regression) -> str:
    """Missing force of two models against velocity and position, on the held-out file."""
    drawn, axes = drawing.figure(1, 2, 2.7)
    q, dq, _ = motion(test)
    q, dq = (decimate(s[BORDER:], DECIMATION) for s in (q, dq))
    moving = np.abs(dq) > 2e-3
    for found, color, label in (
        (coulomb, drawing.BEFORE, "published Coulomb model"),
        (directional, drawing.AFTER, "direction-dependent friction"),
    ):
        matrix, force = observed(test, found.names)
        residual = force - matrix @ found.values
        for panel, x in zip(axes[0], (dq, MM * q), strict=True):
            drawing.binned(panel, x[moving], residual[moving], color, label)
    axes[0, 0].set_xlabel("velocity [m/s]")
    axes[0, 1].set_xlabel("position [mm]")
    axes[0, 0].set_ylabel("missing force [N]")
    axes[0, 0].legend(loc="best")
    return drawing.svg(drawn, "empsforce")


def window_section(learn: Log, test: Log) -> tuple[Section, dict[str, float], list[Step]]:
    """Effects in the order of their gain in windows of free simulation."""
    fitted, held_out = windows([learn], (1,), WINDOW), windows([test], (1,), WINDOW)
    given = base(learn)
    steps, tried = ladder(fitted, held_out, given, candidates(learn))
    before = score(held_out, given)[0]
    numbers = {"window: published": MM * float(before), "window: last": MM * float(steps[-1].held_out[0])}
    shown = missing(test, given), missing(test, steps[-1].model)
    drawn, axes = drawing.figure(1, 2, 2.7)
    for part, color, label in zip(shown, (drawing.BEFORE, drawing.AFTER), ("published", steps[-1].name), strict=True):
        for panel, x in zip(axes[0], (part.velocity, part.torque), strict=True):
            drawing.binned(panel, x, gain(learn) * part.command, color, label)
    axes[0, 0].set_xlabel("velocity [m/s]")
    axes[0, 1].set_xlabel("command [V]")
    axes[0, 0].set_ylabel("missing force [N]")
    axes[0, 0].legend(loc="best")
    pictures = (
        Picture(
            "ladder",
            f"Rms error of free simulation in windows of {WINDOW} s, model by model; only the blue bars were fitted.",
            gains(steps, score(fitted, given), score(held_out, given), MM, "mm"),
        ),
        Picture("missing_after", "Missing force on the pulses file before and after, against velocity and command.",
                drawing.svg(drawn, "empsafter")),
    )  # fmt: skip
    text = (
        f"Every {WINDOW} s the simulation restarts from the measured state and then runs on the recorded voltage "
        "alone. "
        "Effects enter one by one, the one with the largest gain first, and only if the gain returns on windows that "
        "were left out of the fit.",
        rivals_sentence(steps, tried),
        carried(steps),
    )
    tables = (
        steps_table(steps, given, fitted, held_out, MM, "mm"),
        parameters_table(steps[-1].model),
        tried_table(tried),
    )
    return Section("Open-loop windows: effects in the order of their gain", text, pictures, tables), numbers, steps


def carried(steps: Sequence[Step]) -> str:
    """What each effect brings on the held-out file, in a sentence."""
    parts = [
        f"{after.name.removeprefix('+ ')} {100 * float(1.0 - after.held_out[0] / before.held_out[0]):.1f} %"
        for before, after in pairwise(steps)
    ]
    return (
        f"Decrease of the error on the pulses file: {', '.join(parts)}. An effect that brings much on the fitted "
        "file and "
        "hardly anything on the other repairs what is particular to one recording."
    )


def concentration(log: Log, found: Regression) -> tuple[float, float, float]:
    """Share of samples above 0.3 m/s^2, their share of the energy of the residual, its share above 10 Hz."""
    matrix, force = observed(log, found.names)
    residual, fast = force - matrix @ found.values, np.abs(matrix[:, 0]) > 0.3
    frequency, power = welch(residual, 1.0 / (DECIMATION * log.sample_time), nperseg=512)
    above = float(np.sum(power[frequency > 10.0]) / np.sum(power))
    return float(np.mean(fast)), float(np.sum(residual[fast] ** 2) / np.sum(residual**2)), above


def left_section(numbers: dict[str, float]) -> Section:
    """What remains, and why."""
    text = (
        f"With direction-dependent friction {100 * numbers['directional: estimation']:.2f} % of the force are left "
        "on the "
        f"estimation file; the motion itself repeats to {100 * numbers['repeatability: estimation']:.2f} %. So most of "
        "the rest is reproducible and has a cause. Stribeck friction, quadratic drag, a ripple of the screw and a "
        "force "
        "over position each take away little more than a tenth of a point (table of force errors): none of them is it. "
        f"{100 * numbers['left: energy while accelerating']:.0f} % of its energy lies in the "
        f"{100 * numbers['left: samples accelerating']:.0f} % of the time in which the carriage accelerates by more "
        "than "
        f"0.3 m/s², and {100 * numbers['left: above 10 Hz']:.0f} % of it above 10 Hz. That is where a screw, a "
        "coupling and "
        "a current loop have dynamics of their own; one encoder at the motor cannot tell them apart.",
        "Across the two files friction changed by a few per cent and the offset of the force as well. That is the "
        "limit of "
        "any forecast of the second file from the first.",
    )
    return Section("What stays unexplained", text)


def free_section(
    learn: Log, test: Log, windowed: Model, blackboxes: dict[str, float]
) -> tuple[Section, dict[str, float]]:
    """Free run over the whole record, beside published black boxes, and why it drifts."""
    given = base(learn)
    whole, other = at_rest(learn), at_rest(test)
    asymmetric = given.extended(free_of("friction_asymmetry", [None, -50.0 / gain(learn)]))
    four = fit(whole, given)
    five = fit(whole, asymmetric)
    models = [
        ("published Coulomb model, as published", given, 4),
        ("Coulomb model, fitted to the free run", four, 4),
        ("with direction-dependent friction, fitted to the free run", five, 5),
        ("model of the windows above", windowed, len(windowed.free)),
    ]
    exchanged = fit(other, five)
    own = [(title, count, MM * rms(free_run(learn, m)[:, None])[0], MM * rms(free_run(test, m)[:, None])[0], "here")
           for title, m, count in models]  # fmt: skip
    last = MM * rms(free_run(test, exchanged)[:, None])[0]
    numbers = {
        "free: published estimation": own[0][2],
        "free: published pulses": own[0][3],
        "free: Coulomb estimation": own[1][2],
        "free: Coulomb pulses": own[1][3],
        "free: directional estimation": own[2][2],
        "free: directional pulses": own[2][3],
        "free: refitted on pulses": last,
    }
    table = Table(
        "free_run",
        "Rms position error of the free run over the whole record [mm], from rest at the first reading",
        ("model", "parameters", "estimation", "pulses", "source"),
        rows(
            [
                *own,
                ("direction-dependent friction, refitted on the pulses (no forecast)", 5, None, last, "here"),
                *((name, None, None, MM * value, "published") for name, value in blackboxes.items()),
            ]
        ),
    )
    drawn, axes = drawing.figure(2, 1, 3.4, sharex=True)
    for (title, m, _), color in zip(models[:3], (drawing.BEFORE, drawing.OTHER, drawing.AFTER), strict=True):
        for panel, log in zip(axes[:, 0], (learn, test), strict=True):
            panel.plot(*drawing.thin(log.time, MM * free_run(log, m)), color=color, label=title)
    axes[1, 0].plot(*drawing.thin(test.time, MM * free_run(test, exchanged)), color=drawing.FLOOR, linestyle="--",
                    label="refitted on the pulses")  # fmt: skip
    axes[0, 0].set_ylabel("estimation [mm]")
    axes[1, 0].set_ylabel("pulses [mm]")
    axes[1, 0].set_xlabel("time [s]")
    axes[1, 0].legend(loc="upper left", fontsize=7)
    difference = [
        (f.label, a * gain(learn), b * gain(learn))
        for f, a, b in zip(five.free, five.values, exchanged.values, strict=True)
    ]
    changed = Table(
        "between_the_files",
        "The same five parameters fitted to the free run of either file: the machine was not the same (N, kg, N s/m)",
        ("parameter", "estimation", "pulses"),
        rows(difference),
        digits=5,
    )
    text = (
        "A slider integrates: 1 N too much is 5 mm/s, and nothing pulls the simulation back. So the free run "
        "measures one "
        "thing above all, whether friction was the same from record to record. Fitted to the free run of the "
        "estimation "
        "file, four or five physical parameters stay within a few millimetres over 25 s. On the pulses file the "
        "error is several times larger, and it repeats itself with the motion: friction had changed by a few per cent "
        "between the recordings, as the least squares of either file and the table below say.",
        "Published black boxes are shown as published. The test script in dynoNet's public repository reads the "
        "estimation file whichever set is chosen (examples/EMPS/EMPS_test.py), so its 2.64 mm may belong to the left "
        "column; both columns are given here.",
    )
    picture = Picture("free_run", "Error of the free run on both files.", drawing.svg(drawn, "empsfree"))
    return Section("Free run beside published black boxes", text, (picture,), (table, changed)), numbers
