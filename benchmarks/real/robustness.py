"""``python -m benchmarks.real.robustness``: recordings spoilt in ways that happen, and what comes out of them.

Every spoilt recording goes through files, as a user's would. Asked is not that the answer stays, but that it is never
wrong with confidence: the same verdict and names, fewer names, or a message that says what is wrong.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from benchmarks.real.outcome import Table, rows
from diagnosis.preparation import DiagnosisError, recordings
from diagnosis.run import diagnose
from envs import data_sets
from envs.log import Array, JointFacts, Log, LogError
from envs.log_files import load, save, write_atomically
from envs.rigs import rig

CONFIDENT = ("named",)
"""Verdicts that claim to know."""
KNOWN = {
    "emps": ("coulomb_friction", "friction_asymmetry"),
    "xl330": ("load_dependent_friction", "timestamp_jitter"),
    "synthetic joint": ("coulomb_friction",),
}
"""Causes that are established otherwise: published, by the authors' own models, by the stamps of a serial bus that can
be seen to jitter (xl330), hidden by the simulator."""
PERIOD = 6250
"""Samples of the EMPS recording that are used: one period of its reference, a second time held out."""
SYNTHETIC, STRANGER = (11, "adept_j1"), (12, "servo")
"""Seed and family of the synthetic recordings; Coulomb friction is hidden in both, the machines differ."""
SHORTENED = 10_000
"""Samples of the synthetic recordings that are used."""


@dataclass(frozen=True, eq=False)
class Machine:
    """Recordings to spoil: fitted, held out, the robot that the user would name, and another machine's recording."""

    name: str
    fitted: tuple[Log, ...]
    held_out: tuple[Log, ...]
    robot: str | None
    stranger: Log


@dataclass(frozen=True)
class Answer:
    """What came out: verdict ("refused" or "crashed" with a message when there is none), names, findings."""

    machine: str
    case: str
    verdict: str
    names: tuple[str, ...] = ()
    message: str = ""
    findings: tuple[str, ...] = ()
    seconds: float = 0.0


Spoil = Callable[[Log, np.random.Generator], Log]


def half_rate(log: Log, rng: np.random.Generator) -> Log:
    """Every second sample."""
    return _rows(log, np.arange(0, len(log), 2))


def third(log: Log, rng: np.random.Generator) -> Log:
    """The first third."""
    return log.slice(0, len(log) // 3)


def jitter(log: Log, rng: np.random.Generator) -> Log:
    """Time stamps with 1 ms of white noise, in the order of the samples."""
    return replace(log, time=log.time + rng.normal(0.0, 1e-3, len(log)))


def dropped(log: Log, rng: np.random.Generator) -> Log:
    """One sample in a hundred is missing."""
    return _rows(log, np.flatnonzero(rng.random(len(log)) > 0.01))


def sign(log: Log, rng: np.random.Generator) -> Log:
    """The encoder counts the wrong way."""
    return replace(log, position=-log.position, velocity=None if log.velocity is None else -log.velocity)


def unit(log: Log, rng: np.random.Generator) -> Log:
    """Degrees that are called radians, or millimetres that are called metres."""
    factor = 180.0 / np.pi if log.facts[0].position_unit == "rad" else 1e3
    return _scaled(log, factor)


def gear(log: Log, rng: np.random.Generator) -> Log:
    """A gear ratio that is ten times too large: positions a tenth of what they are."""
    return _scaled(log, 0.1)


def _scaled(log: Log, factor: float) -> Log:
    facts = tuple(
        replace(f, encoder_step=None if f.encoder_step is None else f.encoder_step * factor) for f in log.facts
    )
    velocity = None if log.velocity is None else factor * log.velocity
    return replace(log, position=factor * log.position, velocity=velocity, facts=facts)


def _rows(log: Log, which: np.ndarray) -> Log:
    pick = lambda array: None if array is None else array[which]  # noqa: E731
    return replace(
        log,
        time=log.time[which],
        command=log.command[which],
        position=log.position[which],
        velocity=pick(log.velocity),
        temperature=pick(log.temperature),
    )


CASES: dict[str, tuple[Spoil | None, bool]] = {
    "as recorded": (None, False),
    "half the sampling rate": (half_rate, False),
    "cut to a third": (third, False),
    "time stamps with 1 ms jitter": (jitter, False),
    "time stamps with 1 ms jitter, --repair": (jitter, True),
    "1 % of samples dropped": (dropped, False),
    "1 % of samples dropped, --repair": (dropped, True),
    "wrong sign of the position": (sign, False),
    "degrees for radians (mm for m)": (unit, False),
    "gear ratio wrong by 10": (gear, False),
}
"""How recordings are spoilt, and whether a repair is asked for."""
MIXED, COMMANDED = "two machines mixed", "commanded instead of measured input"


def emps() -> Machine:
    """One period of either file."""
    item = rig("emps")
    learn, test = (item.log(name).slice(0, PERIOD) for name in ("estimation", "pulses"))
    bare = lambda log: replace(log, robot=None, loop=None, facts=(JointFacts(),))  # noqa: E731
    return Machine("emps", (learn,), (test,), "emps", bare(learn))


def xl330() -> Machine:
    """Two fitted runs and one that is not."""
    item = rig("xl330")
    logs = [item.log(name) for name in ("sin_sin_100", "sin_time_square_400", "sin_time_square_200")]
    return Machine("xl330", tuple(logs[:2]), (logs[2],), "xl330", item_of("emps"))


def item_of(name: str) -> Log:
    """A recording of another rig."""
    return rig(name).log("estimation").slice(0, PERIOD)


def blind() -> Machine:
    """A synthetic arm joint with dry friction, recorded by the independent simulator."""
    first, test = synthetic(*SYNTHETIC)
    return Machine("synthetic joint", (first,), (test,), None, synthetic(*STRANGER)[0])


@cache
def synthetic(seed: int, family: str) -> tuple[Log, Log]:
    """Training and held-out log of a blind trial, made by its own command so that nothing else of it can be seen."""
    with tempfile.TemporaryDirectory() as place:
        command = ["--seed", str(seed), "--kind", "single", "--family", family, "--effect", "coulomb_friction"]
        subprocess.run(
            [sys.executable, "-m", "benchmarks.blind.trials", *command, "--out", place], check=True, capture_output=True
        )
        folder = next((Path(place) / "logs").iterdir())
        logs = [load(folder / name) for name in ("train_0.csv", "holdout_0.csv")]
        return logs[0].slice(0, SHORTENED), logs[1].slice(0, SHORTENED)


def commanded() -> Machine:
    """XL330 with the duty cycle times the nominal supply in place of the measured one."""
    machine = xl330()

    def nominal(log: Log) -> Log:
        path = data_sets.locate("xl330", rig("xl330").run(log.name.split("/")[-1]).file)
        content = json.loads(path.read_text(encoding="utf-8"))
        entries = [entry for entry in content["entries"] if entry["torque_enable"]]
        stamps = np.array([entry["timestamp"] for entry in entries])
        supply: Array = np.interp(log.time, stamps, [entry["input_volts"] for entry in entries])
        return replace(log, command=log.command * (content["vin"] / supply)[:, None])

    return replace(machine, fitted=tuple(map(nominal, machine.fitted)), held_out=tuple(map(nominal, machine.held_out)))


def ask(machine: Machine, case: str, fitted: Sequence[Log], held_out: Sequence[Log], *, repair: bool) -> Answer:
    """Write the logs, read them as a user's, diagnose."""
    started = clock.perf_counter()
    with tempfile.TemporaryDirectory() as place:
        try:
            paths = [
                [save(log, Path(place) / f"{group}_{i}.csv") for i, log in enumerate(logs)]
                for group, logs in (("fitted", fitted), ("held_out", held_out))
            ]
            robot = machine.robot if case != MIXED else None
            read = recordings(paths[0], paths[1], robot, None, repair)
            diagnosis, _, _ = diagnose(read)
        except (LogError, DiagnosisError) as error:
            text = str(error).replace(f"{place}/", "")
            return Answer(machine.name, case, "refused", message=text, seconds=clock.perf_counter() - started)
        except Exception as error:
            text = f"{type(error).__name__}: {error}"
            return Answer(machine.name, case, "crashed", message=text, seconds=clock.perf_counter() - started)
    names = tuple(sorted({effect.name for effect in diagnosis.effects}))
    said = tuple(text.split(": ", 1)[-1] for text in diagnosis.provenance.findings)
    return Answer(machine.name, case, diagnosis.verdict, names, "", said, clock.perf_counter() - started)


def judge(answer: Answer, before: Answer | None) -> str:
    """same, fewer names, weaker, caught, or WRONG: a confident name that nothing else gives."""
    if answer.verdict == "refused":
        return "caught: refused"
    if answer.verdict == "crashed":
        return "CRASHED"
    if before is None or answer.case == before.case:
        return "reference"
    new = set(answer.names) - set(before.names) - set(KNOWN.get(answer.machine, ()))
    more_said = [text for text in answer.findings if text not in before.findings]
    suspicious = any(
        word in text for text in more_said for word in ("wrong", "one machine", "beyond the range", "sign")
    )
    if suspicious:
        return "caught: said"
    if not new and answer.verdict == before.verdict:
        return "same" if set(answer.names) == set(before.names) else "same verdict, other names"
    if answer.verdict in CONFIDENT and new:
        return "WRONG"
    return "not confident" if answer.verdict not in CONFIDENT else "same names, other verdict"


def table(answers: Sequence[Answer]) -> Table:
    """One row per machine and case."""
    before = {answer.machine: answer for answer in answers if answer.case == "as recorded"}
    found = []
    for answer in answers:
        reference = before.get(answer.machine)
        extra = [text for text in answer.findings if reference is None or text not in reference.findings]
        message = answer.message or "; ".join(extra)
        found.append((answer.machine, answer.case, judge(answer, reference), answer.verdict,
                      ", ".join(answer.names), message))  # fmt: skip
    columns = ("machine", "recording", "judgement", "verdict", "names", "message")
    return Table("robustness", "Spoilt recordings and what the diagnosis makes of them", columns, rows(found))


def main(
    out: Annotated[Path, typer.Option(help="Folder of the table.")] = Path("results/real"),
    machines: Annotated[list[str] | None, typer.Option("--machine", help="Only this one; may be repeated.")] = None,
    again: Annotated[bool, typer.Option("--again", help="Do everything anew.")] = False,
) -> None:
    """Spoil recordings in the ways that happen; a table of what comes out. Answers that are there are kept."""
    console = Console(stderr=True, highlight=False)
    path = out / "robustness.json"
    kept = {}
    if path.exists() and not again:
        for entry in json.loads(path.read_text(encoding="utf-8")):
            answer = Answer(**{**entry, "names": tuple(entry["names"]), "findings": tuple(entry["findings"])})
            kept[answer.machine, answer.case] = answer
    makers: dict[str, Callable[[], Machine]] = {"emps": emps, "xl330": xl330, "synthetic joint": blind}
    for name, make in makers.items():
        if machines and name not in machines:
            continue
        if name in data_sets.names() and not rig(name).available:
            console.print(f"{name}: its data are not here. Run: uv run adeptone data fetch {name}")
            continue
        machine = make()
        jobs: list[tuple[str, Machine, Sequence[Log], Sequence[Log], bool]] = []
        for case, (spoil, repair) in CASES.items():
            rng = np.random.default_rng(0)
            change = lambda log, s=spoil, r=rng: log if s is None else s(log, r)  # noqa: E731
            jobs.append((case, machine, [change(log) for log in machine.fitted],
                         [change(log) for log in machine.held_out], repair))  # fmt: skip
        mixed = machine.stranger if name != "emps" else synthetic(*SYNTHETIC)[0]
        own = machine.fitted[:1] if name != "emps" else (machine.stranger,)
        jobs.append((MIXED, machine, [*own, mixed], [], False))
        if name == "xl330":
            other = commanded()
            jobs.append((COMMANDED, machine, other.fitted, other.held_out, False))
        for case, owner, fitted, held_out, repair in jobs:
            if (name, case) in kept:
                continue
            with console.status(f"{name}: {case}"):
                answer = ask(owner, case, fitted, held_out, repair=repair)
            kept[name, case] = answer
            console.print(
                f"{name} | {case} | {answer.verdict} {', '.join(answer.names)} {answer.message}", soft_wrap=True
            )
            write_atomically(
                {path: json.dumps([asdict(a) for a in kept.values()], ensure_ascii=False, indent=1).encode()}
            )
    result = table(list(kept.values()))
    write_atomically({out / "tables" / "robustness.csv": result.csv().encode()})
    for row in result.rows:
        console.print(" | ".join(str(value) for value in row[:5]), soft_wrap=True)
    if any(row[2] in ("WRONG", "CRASHED") for row in result.rows):
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
