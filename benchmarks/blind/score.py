"""Scores the diagnosis on blind trials: was the hidden effect named, and nothing else?

    python -m benchmarks.blind.score run --kinds single,clean,foreign --first 1000000 --count 50 --out
    results/blind/kept_apart.csv
    python -m benchmarks.blind.score table results/blind/kept_apart.csv

`run` appends one row per trial and skips those that are there, so that an interrupted run goes on where it stopped. The
diagnosis sees the logs and their sidecars, never the truth.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer

from benchmarks.blind.trials import KEPT_APART, Trial, make_trial
from diagnosis.engine import Finding, find
from diagnosis.preparation import arrange, structure
from diagnosis.problem import stack
from methods.effects import built_in
from methods.kernel import build

SINGLE_JOINT = ("adept_j1", "adept_j2", "adept_j3", "adept_j4", "servo", "pendulum", "rotor", "stage")
application = typer.Typer(add_completion=False, help="Blind trials of the diagnosis.")


def diagnose(trial: Trial) -> Finding:
    """The diagnosis of the joint in question from the logs alone."""
    effects = built_in()
    kernel = build(effects)
    recordings = arrange(trial.train, trial.holdout, None)
    first = recordings.fitted[0]
    joint = trial.truth.effects[0].joint if trial.truth.effects else first.joints[0]
    problem = stack(kernel, recordings.fitted, (joint,))
    return find(problem, (structure(first, joint, recordings.robot),), effects)


def outcome(trial: Trial, finding: Finding) -> str:
    """``right``, ``missed`` (nothing named), ``unsure`` (unknown, or ambiguous with the truth among the names),
    ``wrong``.

    Known physics of the machine (a pendulum's gravity) may be named or not. Sets of names that the truth lists as
    equivalent are as right as the hidden ones.
    """
    truth = trial.truth
    structural = {name for _, name in truth.structure}
    named = {item.name for item in finding.accepted} - structural
    hidden = {effect.hidden.name for effect in truth.effects}
    accepted_sets = [hidden - structural, hidden]
    for effect in truth.effects:
        accepted_sets += [(hidden - {effect.hidden.name}) | set(other) for other in effect.hidden.equivalent]
    accepted_sets += [names - structural for names in accepted_sets]
    if truth.foreign:
        exact = any(named == set(other) for effect in truth.effects for other in effect.hidden.equivalent)
        return (
            "right"
            if finding.verdict == "unknown" or (exact and finding.verdict == "named")
            else ("missed" if finding.verdict == "none" else "wrong")
        )
    if not hidden:
        return (
            "right"
            if finding.verdict in ("none", "named") and not named
            else ("unsure" if finding.verdict == "unknown" else "wrong")
        )
    if finding.verdict == "unknown":
        return "unsure"
    if any(named == names for names in accepted_sets):
        return "right"
    if finding.verdict == "ambiguous":
        every = named | {rival.name for item in finding.accepted for rival in item.rivals}
        return "unsure" if hidden <= every else "wrong"
    return "wrong" if named else "missed"


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
            family = SINGLE_JOINT[(3 * seed + position) % len(SINGLE_JOINT)]
            try:
                trial = make_trial(seed, kind, family)
            except ValueError as error:
                typer.echo(f"{seed} {kind}: {error}")
                continue
            begin = time.perf_counter()
            finding = diagnose(trial)
            seconds = time.perf_counter() - begin
            row = {
                "seed": seed,
                "kind": kind,
                "family": family,
                "hidden": "+".join(sorted(e.hidden.name for e in trial.truth.effects)) or "nothing",
                "law": "+".join(e.hidden.law for e in trial.truth.effects),
                "verdict": finding.verdict,
                "named": "+".join(item.name for item in finding.accepted),
                "rivals": "+".join(rival.name for item in finding.accepted for rival in item.rivals),
                "outcome": outcome(trial, finding),
                "explained": finding.nominal.criterion - finding.final.criterion,
                "left": finding.remainders[0].decrease,
                "left_share": finding.remainders[0].share,
                "samples": sum(len(log) for log in trial.train),
                "sample_time": trial.train[0].sample_time,
                "loop": trial.train[0].loop,
                "seconds": seconds,
            }
            pd.DataFrame([row]).to_csv(out, mode="a", header=not out.exists(), index=False)
            typer.echo(
                f"{seed} {kind:8s} {family:9s} {row['hidden']} -> {finding.verdict} {row['named']}: {row['outcome']}"
            )


@application.command()
def table(rows: Annotated[Path, typer.Argument(help="CSV written by run.")]) -> None:
    """Prints the outcomes per kind and every trial that was not right."""
    data = pd.read_csv(rows).fillna("")
    typer.echo(pd.crosstab(data.kind, data.outcome).to_string())
    typer.echo(f"median seconds {data.seconds.median():.1f}")
    columns = ["seed", "kind", "family", "hidden", "law", "verdict", "named", "rivals", "outcome"]
    typer.echo(data[data.outcome != "right"][columns].to_string(index=False))


if __name__ == "__main__":
    application()
