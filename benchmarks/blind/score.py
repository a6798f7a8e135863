"""Scores the diagnosis on blind trials: was the hidden effect named, and nothing else?

    python -m benchmarks.blind.score run --kinds single,clean,foreign --first 1000000 --count 50 --out
    results/blind/kept_apart.csv
    python -m benchmarks.blind.score table results/blind/kept_apart.csv

Each trial's logs are written to a folder of their own, and ``adeptone diagnose`` runs on it as a separate process that
is given nothing else. `run` appends one row per trial and skips those that are there, so that an interrupted run goes
on where it stopped.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from benchmarks.blind.summary import text
from benchmarks.blind.trials import KEPT_APART, Trial, Truth, make_trial, write_trial

SINGLE_JOINT = ("adept_j1", "adept_j2", "adept_j3", "adept_j4", "servo", "pendulum", "rotor", "stage")
PAIRED = (*SINGLE_JOINT, "pair")
"""Families of machines that kinds rotate through; two effects may also be hidden in two joints that move together."""
OF_THE_CLOCK = ("timestamp_jitter",)
"""Effects of the instants at which all joints are read."""
INCIDENTAL = ("phase", "time", "rest_angle")
"""Parameters whose zero is arbitrary: their relative error means nothing."""
TIME_LIMIT = 900.0
application = typer.Typer(add_completion=False, help="Blind trials of the diagnosis.")


def diagnose(trial: Trial) -> tuple[dict[str, Any], float]:
    """`diagnosis.json` made by the command line from the logs alone, and the seconds of the whole command.

    Raises ValueError with the command's own words when it refuses the logs.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs, out = folder / "logs", folder / "out"
        write_trial(trial, logs, folder / "truth")
        train = [str(logs / f"{log.name}.csv") for log in trial.train]
        holdout = [item for log in trial.holdout for item in ("--holdout", str(logs / f"{log.name}.csv"))]
        for path in (folder / "truth").iterdir():
            path.unlink()
        command = [sys.executable, "-m", "adeptone", "diagnose", *train, *holdout, "--out", str(out)]
        begin = time.perf_counter()
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=TIME_LIMIT)
        except subprocess.TimeoutExpired:
            raise ValueError(f"no answer within {TIME_LIMIT:g} s") from None
        seconds = time.perf_counter() - begin
        if done.returncode:
            raise ValueError(done.stderr.strip()[-300:])
        return json.loads((out / "diagnosis.json").read_text(encoding="utf-8")), seconds


def outcome(truth: Truth, diagnosis: Mapping[str, Any]) -> str:
    """``right``, ``missed`` (nothing named), ``unsure`` (unknown, or ambiguous with the truth among the names),
    ``wrong``.

    Known physics of the machine (a pendulum's gravity) may be named or not. Sets of names that the truth lists as
    equivalent are as right as the hidden ones. The joint counts as well as the name, but for errors of the log's
    clock: all joints are read by it, at the same wrong instants.
    """
    verdict = diagnosis["verdict"]
    place = lambda joint, name: (0 if name in OF_THE_CLOCK else joint, name)  # noqa: E731
    structural = {place(joint, name) for joint, name in truth.structure}
    named = {place(item["joint"], item["name"]) for item in diagnosis["effects"]} - structural
    hidden = {place(effect.joint, effect.hidden.name) for effect in truth.effects}
    accepted_sets = [hidden]
    for effect in truth.effects:
        others = hidden - {place(effect.joint, effect.hidden.name)}
        accepted_sets += [others | {place(effect.joint, name) for name in names} for names in effect.hidden.equivalent]
    accepted_sets = [names - structural for names in accepted_sets]
    if truth.foreign:
        exact = any(named == names for names in accepted_sets[1:])
        if verdict == "unknown" or (exact and verdict == "named"):
            return "right"
        return "missed" if verdict == "none" else "wrong"
    if verdict == "unknown":
        return "unsure"
    if not hidden:
        return "right" if not named else "wrong"
    if any(named == names for names in accepted_sets) and verdict == "named":
        return "right"
    if verdict == "ambiguous":
        rivals = {
            place(item["joint"], other["name"]) for item in diagnosis["effects"] for other in item["alternatives"]
        }
        return "unsure" if any(names <= named | rivals for names in accepted_sets) else "wrong"
    return "wrong" if named else "missed"


def compared(truth: Truth, diagnosis: Mapping[str, Any]) -> list[tuple[str, float, float, float]]:
    """(effect.parameter, true value, estimate, standard deviation), input-equivalent, of what was rightly named.

    Of several waves of one effect the one whose cycles are nearest is compared: a harmonic of it is no error.
    """
    found = []
    for effect in truth.effects:
        own = [
            item for item in diagnosis["effects"] if (item["joint"], item["name"]) == (effect.joint, effect.hidden.name)
        ]
        wave = effect.hidden.parameters.get("cycles_per_rev")
        if wave is not None:
            own.sort(key=lambda item: abs(item["parameters"]["cycles_per_rev"]["value"] - wave.value))
        for name, parameter in effect.hidden.parameters.items() if own else ():
            if name in INCIDENTAL or name not in own[0]["parameters"]:
                continue
            estimate = own[0]["parameters"][name]["input_equivalent"]
            true = parameter.value if parameter.input_equivalent is None else parameter.input_equivalent
            found.append((f"{effect.hidden.name}.{name}", true, estimate["value"], estimate["std"]))
    return found


def row(seed: int, kind: str, family: str) -> dict[str, Any]:
    """One trial, made, diagnosed and scored. Raises ValueError when no such trial exists or the logs are refused."""
    trial = make_trial(seed, kind, family)
    truth = trial.truth
    diagnosis, seconds = diagnose(trial)
    return {
        "seed": seed,
        "kind": kind,
        "family": family,
        "hidden": "+".join(sorted(effect.hidden.name for effect in truth.effects)) or "nothing",
        "law": "+".join(effect.hidden.law for effect in truth.effects),
        "visibility": min((effect.visibility for effect in truth.effects), default=np.nan),
        "verdict": diagnosis["verdict"],
        "named": "+".join(item["name"] for item in diagnosis["effects"]),
        "rivals": "+".join(other["name"] for item in diagnosis["effects"] for other in item["alternatives"]),
        "outcome": outcome(truth, diagnosis),
        "parameters": json.dumps(compared(truth, diagnosis)),
        "closed": (diagnosis["gap"] or {}).get("closed"),
        "amplifier_noise": truth.amplifier_noise[0],
        "samples": sum(len(log) for log in trial.train),
        "sample_time": trial.train[0].sample_time,
        "loop": trial.train[0].loop,
        "seconds": round(seconds, 2),
    }


def family_of(seed: int, kind: str, position: int) -> str:
    """The family of machines whose turn it is."""
    families = PAIRED if kind == "pair" else SINGLE_JOINT
    return families[(5 * seed + position) % len(families)]  # 5 shares no factor with either number of families


@application.command()
def run(
    out: Annotated[Path, typer.Option(help="CSV that rows are appended to.")],
    kinds: Annotated[str, typer.Option(help="Comma-separated kinds.")] = "single,clean,foreign",
    first: Annotated[int, typer.Option(help="First seed.")] = KEPT_APART,
    count: Annotated[int, typer.Option(help="Number of seeds.")] = 20,
) -> None:
    """Diagnoses trials and appends one row each."""
    done = set()
    if out.exists():
        table = pd.read_csv(out)
        done = set(zip(table.seed, table.kind, strict=True))
    out.parent.mkdir(parents=True, exist_ok=True)
    for seed in range(first, first + count):
        for position, kind in enumerate(kinds.split(",")):
            if (seed, kind) in done:
                continue
            family = family_of(seed, kind, position)
            try:
                found = row(seed, kind, family)
            except ValueError as error:
                typer.echo(f"{seed} {kind}: {error}")
                continue
            pd.DataFrame([found]).to_csv(out, mode="a", header=not out.exists(), index=False)
            typer.echo(
                f"{seed} {kind:8s} {family:9s} {found['hidden']} -> {found['verdict']} {found['named']}: "
                f"{found['outcome']} ({found['seconds']:.0f} s)"
            )


@application.command()
def table(rows: Annotated[Path, typer.Argument(help="CSV written by run.")]) -> None:
    """Prints outcomes, confusion of effects, detection threshold, parameter errors, and all that was not right."""
    typer.echo(text(pd.read_csv(rows, keep_default_na=False)))


if __name__ == "__main__":
    application()
