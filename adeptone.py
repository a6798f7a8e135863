"""The command line: ``adeptone COMMAND``. Nothing heavy is imported before a command needs it.

Exit status: 0 done (with any verdict), 1 a check failed, 2 unusable input, said in one line.
"""

from __future__ import annotations

import sys
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperOption

PACKAGES = ("envs", "methods", "diagnosis", "benchmarks")
"""Where the project's own errors come from: their text is meant for the user."""

app = typer.Typer(
    name="adeptone",
    help="Tells robot engineers what their simulation gets wrong: named causes, an extended model, and the gain.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
data_app = typer.Typer(no_args_is_help=True, help="Log files and the recordings of real rigs.", rich_markup_mode=None)
app.add_typer(data_app, name="data")
bench_app = typer.Typer(no_args_is_help=True, help="Methods measured by one yardstick.", rich_markup_mode=None)
app.add_typer(bench_app, name="bench")

HELD_OUT = "--holdout"


class HoldoutCommand(TyperCommand):
    """A command that fits some recordings and keeps others apart: ``LOG… --holdout LOG…``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        valued = {name for p in self.params if isinstance(p, TyperOption) and not p.is_flag for name in p.opts}
        return super().parse_args(ctx, held_out_together(args, valued))


def held_out_together(arguments: list[str], valued: set[str]) -> list[str]:
    """The arguments with --holdout before every file that follows one directly; as they are if that leaves no other
    file. valued: the options that take a value."""
    found: list[str] = []
    others, is_held = 0, False
    rest = iter(arguments)
    for argument in rest:
        if argument == "--":
            left = list(rest)
            found, others = [*found, argument, *left], others + len(left)
        elif argument.startswith("-"):
            name, has_value, _ = argument.partition("=")
            found += [argument, *([*islice(rest, 1)] if name in valued and not has_value else [])]
            is_held = name == HELD_OUT
        elif is_held:
            found += [HELD_OUT, argument]
        else:
            found.append(argument)
            others += 1
    return found if others else arguments


LogFiles = Annotated[list[Path], typer.Argument(metavar="LOG…", help="Recordings: CSV, Parquet, NPZ, MATLAB, ROS bag")]
ColumnMapFile = Annotated[
    Path | None, typer.Option("--columns", metavar="TOML", help="Names and units of the files' columns")
]
Repair = Annotated[bool, typer.Option("--repair", help="Mend broken rows, spikes and irregular time, and say so")]
RigName = Annotated[str, typer.Argument(metavar="NAME", help="A data set; see: adeptone data list")]


@app.command()
def record(
    excitation: Annotated[
        str, typer.Option("--excitation", metavar="E", help="Such as multisine:amplitude=2,band=0.1-8,joints=1+2")
    ],
    out: Annotated[Path, typer.Option("--out", metavar="LOG", help="CSV, Parquet or NPZ; the truth goes beside it")],
    robot: Annotated[
        str, typer.Option("--robot", metavar="ROBOT", help="adeptone, a rig's name or a TOML description")
    ] = "adeptone",
    effect: Annotated[
        list[str] | None,
        typer.Option(
            "--effect", metavar="NAME=VALUE", help="Hidden in the plant; NAME@2=VALUE for joint 2; repeatable"
        ),
    ] = None,
    duration: Annotated[float, typer.Option("--duration", metavar="SECONDS", min=0.0)] = 30.0,
    rate: Annotated[float, typer.Option("--rate", metavar="HZ", min=1.0)] = 1000.0,
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0)] = 0,
) -> None:
    """Make a synthetic experiment: a plant with hidden effects, and the log that its sensors give."""
    from envs.log_files import check_writable
    from envs.output_place import check_file
    from envs.plant.plant import record as record_plant
    from envs.robots import find_robot

    check_writable(out)
    check_file(out)
    recording = record_plant(
        find_robot(robot), effect or [], excitation, duration=duration, rate=rate, seed=seed, name=out.stem
    )
    typer.echo(recording.save(out))


@app.command(cls=HoldoutCommand)
def diagnose(
    logs: LogFiles,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where report and model are written")],
    holdout: Annotated[
        list[Path] | None, typer.Option(HELD_OUT, metavar="LOG…", help="Recordings for the gain only")
    ] = None,
    robot: Annotated[
        str | None, typer.Option("--robot", metavar="ROBOT", help="adeptone, a rig's name or a TOML description")
    ] = None,
    joint: Annotated[int | None, typer.Option("--joint", metavar="J", help="Diagnose this joint only")] = None,
    columns: ColumnMapFile = None,
    repair: Repair = False,
    rivals: Annotated[
        bool, typer.Option("--rivals", help="Also train networks on the same logs and show them in the ledger")
    ] = False,
    plugin: Annotated[
        list[Path] | None,
        typer.Option("--plugin", metavar="FILE", help="A Python file with an effect of your own; repeatable"),
    ] = None,
) -> None:
    """Name what the nominal model of a robot gets wrong on measured logs."""
    from diagnosis.run import diagnose_files

    said = diagnose_files(
        logs, holdout or [], robot, joint, out, columns=columns, repair=repair, rivals=rivals, plugins=plugin or []
    )
    typer.echo(said)


@app.command(cls=HoldoutCommand)
def fit(
    logs: LogFiles,
    method: Annotated[
        str, typer.Option("--method", metavar="METHOD", help="A registered name or a Python file that registers one")
    ],
    out: Annotated[Path, typer.Option("--out", metavar="MODEL", help="The fitted model, JSON")],
    holdout: Annotated[
        list[Path] | None, typer.Option(HELD_OUT, metavar="LOG…", help="Recordings for the error only")
    ] = None,
    robot: Annotated[
        str | None, typer.Option("--robot", metavar="ROBOT", help="adeptone, a rig's name or a TOML description")
    ] = None,
    joint: Annotated[int | None, typer.Option("--joint", metavar="J", help="Fit this joint only")] = None,
    columns: ColumnMapFile = None,
    repair: Repair = False,
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0)] = 0,
) -> None:
    """Fit one method to measured logs and save its model."""
    from methods.fitting import fit_files

    said = fit_files(
        method,
        logs,
        out,
        holdout=holdout or [],
        robot=robot,
        joint=joint,
        columns=columns,
        repair=repair,
        seed=seed,
    )
    typer.echo(said)


@data_app.command("list")
def data_list() -> None:
    """The recordings of real rigs, and whether they are on this machine."""
    from envs.rigs import rigs

    for rig in rigs():
        state = "here" if rig.available else f"not here; adeptone data fetch {rig.name}"
        typer.echo(f"{rig.name}: {rig.title} ({state})")
        for run in rig.runs:
            typer.echo(f"  {run.name:24} {run.role.replace('_', '-'):9} {run.note}")


@data_app.command("fetch")
def data_fetch(name: RigName) -> None:
    """Bring a data set to this machine, checked against its SHA-256."""
    from envs.data_sets import fetch

    for path in fetch(name):
        typer.echo(path)


@data_app.command("verify")
def data_verify(name: Annotated[str | None, typer.Argument(metavar="NAME", help="All when left out")] = None) -> None:
    """Compare the files on this machine with their SHA-256; exit 1 when one is missing or changed."""
    from envs.data_sets import names, verify

    unsound = 0
    for data_set in [name] if name is not None else names():
        states = list(verify(data_set))
        wrong = [(item.path, state) for item, state in states if state != "sound"]
        unsound += len(wrong)
        typer.echo(f"{data_set}: {len(states) - len(wrong)} of {len(states)} files sound")
        for path, state in wrong:
            typer.echo(f"  {path}: {state}")
    if unsound:
        raise typer.Exit(1)


@data_app.command("inspect")
def data_inspect(logs: LogFiles, columns: ColumnMapFile = None, repair: Repair = False) -> None:
    """Say what a log is made of; for a file with its own column names, propose a column map."""
    from envs.inspection import inspect_file

    for path in logs:
        for line in inspect_file(path, columns, repair=repair):
            typer.echo(line)


Budget = Annotated[
    float, typer.Option("--budget", metavar="SECONDS", min=1.0, help="Time for one fit of a log of four seconds")
]


@app.command("check-method")
def check_method(
    method: Annotated[
        str, typer.Argument(metavar="METHOD", help="A file, a registered name, or an installed package's entry point")
    ],
    budget: Budget = 60.0,
) -> None:
    """Check what a method promises, one line per check; exit 1 when a promise is not kept."""
    from methods.conformance.isolated import examine_isolated
    from methods.conformance.method_checks import prepare_method
    from methods.conformance.report import tell

    if not tell(examine_isolated(prepare_method, method, budget), typer.echo):
        raise typer.Exit(1)


@app.command("check-effect")
def check_effect(
    effect: Annotated[
        str, typer.Argument(metavar="EFFECT", help="A file, a known name, or an installed package's entry point")
    ],
    budget: Budget = 60.0,
) -> None:
    """Check what an effect promises, one line per check; exit 1 when a promise is not kept."""
    from diagnosis.effect_checks import prepare_effect
    from methods.conformance.isolated import examine_isolated
    from methods.conformance.report import tell

    if not tell(examine_isolated(prepare_effect, effect, budget), typer.echo):
        raise typer.Exit(1)


Folder = Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the two files are written")]


@app.command("new-method")
def new_method(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Such as my_method")], out: Folder = Path()
) -> None:
    """Write a working method to begin with, and its test."""
    from methods.scaffold import scaffold

    for path in scaffold("method", name, out):
        typer.echo(path)


@app.command("new-effect")
def new_effect(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Such as my_effect")], out: Folder = Path()
) -> None:
    """Write a working effect to begin with, and its test."""
    from methods.scaffold import scaffold

    for path in scaffold("effect", name, out):
        typer.echo(path)


@bench_app.command("run")
def bench_run(
    suite: Annotated[
        str | None, typer.Option("--suite", metavar="NAME", help="quick, full, naming or everything")
    ] = None,
    task: Annotated[
        list[str] | None,
        typer.Option("--task", metavar="NAME_OR_PATH", help="Instead of the suite's tasks; repeatable"),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option("--method", metavar="NAME_OR_PATH", help="Instead of the suite's methods; repeatable"),
    ] = None,
    seeds: Annotated[
        str | None, typer.Option("--seeds", metavar="N", help="How many, or which: 5, 0-4, 1,3; instead of the suite's")
    ] = None,
    workers: Annotated[int, typer.Option("--workers", metavar="N", min=1, help="Runs at once")] = 2,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where rows are kept")] = Path("results/bench"),
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="A Dask scheduler that takes the work")
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Try again what did not end well")] = False,
) -> None:
    """Run methods on tasks; what is there already is not computed again."""
    from benchmarks.runner import command

    typer.echo(command(suite, task or [], method or [], seeds, out, workers=workers, scheduler=scheduler, retry=retry))


@bench_app.command("report")
def bench_report(
    results: Annotated[Path, typer.Option("--results", metavar="DIR", help="What `adeptone bench run` wrote")] = Path(
        "results/bench"
    ),
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Where page and tables are written; DIR/report by default"),
    ] = None,
) -> None:
    """Write the leaderboard: one interactive page, and tables as CSV, Markdown and LaTeX."""
    from benchmarks.leaderboard.report import report_files

    typer.echo(report_files(results, out if out is not None else results / "report"))


@bench_app.command("check")
def bench_check(
    suite: Annotated[str, typer.Option("--suite", metavar="NAME", help="quick, full, naming or everything")] = "quick",
    method: Annotated[
        list[str] | None,
        typer.Option("--method", metavar="NAME_OR_PATH", help="Instead of the suite's own methods; repeatable"),
    ] = None,
    reference: Annotated[Path, typer.Option("--reference", metavar="DIR", help="Folder of the references")] = Path(
        "results/reference"
    ),
    seeds: Annotated[
        str | None, typer.Option("--seeds", metavar="N", help="How many, or which: 5, 0-4, 1,3; instead of the suite's")
    ] = None,
    workers: Annotated[int, typer.Option("--workers", metavar="N", min=1, help="Runs at once")] = 2,
    update: Annotated[bool, typer.Option("--update", help="Make the reference anew, and say what moved")] = False,
) -> None:
    """Run a suite afresh and compare it with its reference; exit 1 when something got worse."""
    from benchmarks import check
    from benchmarks.store import Store

    methods = method or []
    if update:
        if seeds:
            raise typer.BadParameter("a reference has the suite's seeds; leave --seeds out with --update")
        finished = Store(check.UNFINISHED)
        report, path = check.update(
            suite, methods, reference, workers=workers, progress=sys.stderr.isatty(), finished=finished
        )
        typer.echo(report.text())
        typer.echo(path)
        return
    report = check.check(suite, methods, reference, seeds=seeds, workers=workers, progress=sys.stderr.isatty())
    typer.echo(report.text())
    if not report.sound:
        raise typer.Exit(1)


@bench_app.command("workflow")
def bench_workflow() -> None:
    """Print a GitHub Actions workflow that checks the accuracy of a method of your own."""
    from benchmarks.check import workflow

    typer.echo(workflow(), nl=False)


def main() -> None:
    """Runs the command line; input errors become one line on stderr and exit status 2."""
    try:
        app()
    except (ValueError, OSError) as error:
        own = type(error).__module__.partition(".")[0] in PACKAGES
        if not (own or isinstance(error, OSError)):
            raise
        typer.echo(f"adeptone: {' '.join(str(error).split())}", err=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
