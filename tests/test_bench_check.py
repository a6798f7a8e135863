"""The accuracy check: silent when nothing got worse, loud when something did, and clear about unusable input."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import adeptone
from benchmarks import check, reference, tolerance
from benchmarks.check import CheckError, reference_seeds, workflow
from benchmarks.comparison import ALL_TASKS, Finding, compare
from benchmarks.reference import Run, Trial
from benchmarks.runner import plan
from benchmarks.suites import SUITES, Suite

ROOT = Path(__file__).resolve().parents[1]
TASKS = tuple(f"task{k}" for k in range(8))
METHODS = ("physics", "network", "runaway")


def run(task: str, method: str, seed: int, trial: Trial = "run", *, draw: int = 0) -> Run:
    """A made-up run: robots differ by seed, networks by chance too, and a runaway method has heavy tails.

    draw: another one is another world with the same distributions.
    """
    robot = np.random.default_rng([1, draw, seed]).normal(0.0, 0.15)
    own = np.random.default_rng([2, draw, seed, TASKS.index(task), METHODS.index(method)])
    spread = {"physics": own.normal(0.0, 0.05), "network": own.normal(0.0, 0.3), "runaway": 0.3 * own.standard_t(4)}
    error = 0.01 * (1 + TASKS.index(task)) * np.exp(robot + spread[method])
    if trial == "rounding":
        error *= 1.0 + {"physics": 1e-11, "network": 0.05, "runaway": 1e-9}[method] * own.normal()
    figures = {"inverse_error": error, "simulation_error": 0.1 * error, "fit_seconds": 1.0}
    if method == "physics":
        figures["interval_coverage"] = float(own.binomial(3, 0.9)) / 3.0
    if method == "runaway" and own.random() < 0.1:
        figures["simulation_error"] = np.inf
    return Run(task, method, f"{method}()", seed, trial, "ok", "", figures)


def runs(seeds: Sequence[int], *, draw: int = 0, trials: Sequence[Trial] = ("run",)) -> list[Run]:
    return [run(t, m, s, trial, draw=draw) for t in TASKS for m in METHODS for s in seeds for trial in trials]


def worse(found: Sequence[Run], method: str, factor: float) -> list[Run]:
    """The same runs with larger errors of one method."""
    return [
        replace(r, figures={k: v * factor if k.endswith("error") else v for k, v in r.figures.items()})
        if r.method == method
        else r
        for r in found
    ]


def regressions(findings: Sequence[Finding]) -> list[Finding]:
    return [item for item in findings if item.verdict == "regression"]


REFERENCE = runs(range(10), trials=("run", "rounding"))


def test_the_same_runs_move_nothing() -> None:
    findings = compare(runs((0, 1)), REFERENCE, {})
    assert {item.verdict for item in findings} == {"same"}
    assert {item.basis for item in findings} == {"same seeds"}


def test_other_seeds_raise_hardly_ever_a_false_alarm() -> None:
    """Forty worlds with a reference and a rerun each, and a method that loses runs and has heavy tails among them."""
    alarms = 0
    for draw in range(40):
        findings = compare(runs((100, 101), draw=draw), runs(range(10), draw=draw, trials=("run", "rounding")), {})
        assert {item.basis for item in findings} == {"other seeds"}
        alarms += bool(regressions(findings))
    assert alarms <= 1


def test_a_fraction_of_a_percent_is_caught_on_the_same_seeds() -> None:
    found = regressions(compare(worse(runs((0, 1)), "physics", 1.005), REFERENCE, {}))
    assert {item.method for item in found} == {"physics"}
    assert {item.task for item in found} == {*TASKS, ALL_TASKS}
    assert found[0].change == pytest.approx(1.005, rel=1e-3)


def test_what_rounding_can_do_is_no_regression() -> None:
    """The network's errors differ by five percent between two roundings; a fresh one by four."""
    assert regressions(compare(worse(runs((0, 1)), "network", 1.04), REFERENCE, {})) == []
    assert regressions(compare(worse(runs((0, 1)), "physics", 1.04), REFERENCE, {})) != []


@pytest.mark.parametrize("method", ["physics", "network"])
def test_a_method_that_got_much_worse_is_caught_on_other_seeds(method: str) -> None:
    found = regressions(compare(worse(runs((100, 101)), method, 3.0), REFERENCE, {}))
    assert {item.method for item in found} == {method}
    assert ALL_TASKS in {item.task for item in found}


def test_a_better_method_is_told_and_passes() -> None:
    findings = compare(worse(runs((0, 1)), "physics", 0.5), REFERENCE, {})
    assert regressions(findings) == []
    assert {item.method for item in findings if item.verdict == "better"} == {"physics"}


def broken(found: Sequence[Run], status: str, reason: str, *, method: str = "", task: str = "") -> list[Run]:
    """The same runs, those of a method or task without figures."""
    return [
        replace(r, status=status, reason=reason, figures={}) if method in ("", r.method) and task in ("", r.task) else r
        for r in found
    ]


def test_a_run_that_fails_now_is_a_regression_with_its_reason() -> None:
    fresh = broken(runs((0, 1)), "timed_out", "no result within 60 s", method="physics", task="task3")
    [found] = regressions(compare(fresh, REFERENCE, {}))
    assert (found.task, found.method, found.note) == ("task3", "physics", "seed 0: timed out: no result within 60 s")


def test_many_failures_on_other_seeds_are_a_regression_and_one_is_not() -> None:
    fresh = runs((100, 101))
    [found] = regressions(compare(broken(fresh, "failed", "it broke", method="physics"), REFERENCE, {}))
    assert (found.task, found.method) == (ALL_TASKS, "physics")
    one = next(k for k, r in enumerate(fresh) if r.method == "physics")
    fresh[one : one + 1] = broken(fresh[one : one + 1], "failed", "it broke")
    assert regressions(compare(fresh, REFERENCE, {})) == []


def test_a_share_that_falls_is_a_regression() -> None:
    fresh = [
        replace(r, figures=r.figures | {"interval_coverage": 0.0}) if r.method == "physics" else r
        for r in runs((100, 101))
    ]
    [found] = regressions(compare(fresh, REFERENCE, {}))
    assert (found.task, found.metric) == (ALL_TASKS, "interval_coverage")


def test_a_task_without_its_data_is_named_and_not_judged() -> None:
    fresh = broken(runs((0, 1)), "skipped", "no data", task="task0")
    findings = compare(fresh, REFERENCE, {"task0": "no data"})
    assert regressions(findings) == []
    assert [item.note for item in findings if item.verdict == "not compared"] == ["no data"]
    assert regressions(compare(fresh, REFERENCE, {})) != []


def test_time_counts_only_beside_the_other_methods_of_the_same_run() -> None:
    def timed(found: Sequence[Run], seconds: dict[str, float]) -> list[Run]:
        return [replace(r, figures=r.figures | {"fit_seconds": seconds[r.method]}) for r in found]

    before = timed(REFERENCE, {"physics": 1.0, "network": 1.0, "runaway": 1.0})
    slow_machine = timed(runs((0, 1)), {"physics": 9.0, "network": 9.0, "runaway": 9.0})
    slow_method = timed(runs((0, 1)), {"physics": 9.0, "network": 1.0, "runaway": 1.0})
    assert regressions(compare(slow_machine, before, {})) == []
    [found] = regressions(compare(slow_method, before, {}))
    assert (found.method, found.metric) == ("physics", "fit_seconds")


def test_prediction_limit_against_the_normal_distribution() -> None:
    """Fresh means of two exceed the limit of ten values with the stated chance."""
    rng, alpha, above = np.random.default_rng(0), 0.05, 0
    for _ in range(4000):
        values = rng.normal(size=10)
        above += np.mean(rng.normal(size=2)) > np.mean(values) + tolerance.for_other_seeds(values, 2, alpha)
    assert above / 4000 == pytest.approx(alpha, abs=0.012)


def test_a_reference_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = reference.path_of(tmp_path, "quick")
    reference.write(REFERENCE, path)
    again = reference.read(path)
    assert len(again) == len(REFERENCE)
    assert {item.verdict for item in compare(runs((0, 1)), again, {})} == {"same"}
    reference.write(again, tmp_path / "twice.csv")
    assert (tmp_path / "twice.csv").read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("content", "said"),
    [("a,b\n1,2\n", "lacks columns"), (",".join(reference.HEAD) + "\nt,m,m(),x,run,ok,\n", "line 2")],
)
def test_a_broken_reference_is_said_in_one_line(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "quick.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(CheckError, match=said):
        reference.read(path)


def test_a_reference_has_the_suites_seeds_first() -> None:
    assert reference_seeds(Suite("s", "s", (), (), (3, 12))) == (3, 12, 0, 1, 2, 4, 5, 6, 7, 8)


def test_the_workflow_is_a_workflow() -> None:
    text = workflow()
    assert "adeptone bench check --suite quick" in text
    assert "\t" not in text


@pytest.mark.parametrize("page", ["README.md", "docs/checks.md"])
def test_the_pages_lead_to_the_workflow(page: str, tmp_path: Path) -> None:
    """Their lines fit the workflow's names, say where adeptone comes from, and write into a folder that is there."""
    blocks = re.findall(r"```\w*\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    settings = dict(re.findall(r"(METHOD|REFERENCE): (\S+)", workflow()))
    made = f"adeptone bench check --method {settings['METHOD']} --reference {settings['REFERENCE']} --update"
    assert f"uv run {made}" in lines
    [address] = [line for line in lines if line.startswith("uv add ")]
    assert address in workflow()
    assert lines.index(address) < lines.index(f"uv run {made}")
    [printed] = [block for block in blocks if "bench workflow" in block]
    last_two = printed.splitlines()[-2:]
    commands = "\n".join(last_two).replace("uv run adeptone bench workflow", "echo the workflow")
    subprocess.run(["bash", "-e", "-c", commands], cwd=tmp_path, check=True)
    assert (tmp_path / ".github" / "workflows" / "accuracy.yml").read_text() == "the workflow\n"


TASK = '''
"""A joint with friction that nobody hides: signals in closed form, so that a run takes no time."""
import numpy as np
from benchmarks.tasks.base import TASKS, Task, TaskData
from envs.log import Log

def log(seed, salt):
    rng, noise = np.random.default_rng(seed), np.random.default_rng([seed, salt])
    inertia, viscous = 0.02 * np.exp(rng.normal(0.0, 0.1)), 0.3 * np.exp(rng.normal(0.0, 0.1))
    t = np.arange(3000) / 1000.0
    w = 2.0 * np.pi * (np.array([0.5, 1.3, 2.9]) + 0.1 * salt)
    phase = noise.uniform(0.0, 6.28, 3)
    part = lambda k: np.sum(0.3 * w**k * np.sin(w * t[:, None] + phase + k * np.pi / 2.0), axis=1)
    v = inertia * part(2) + viscous * part(1) + 0.05 * np.tanh(part(1) / 0.05) + noise.normal(0.0, 0.01, t.size)
    return Log(t, v[:, None], (part(0) + noise.normal(0.0, 1e-4, t.size))[:, None], name=f"log {salt}")

def make(seed):
    return TaskData((log(seed, 0),), (log(seed, 1),))

@TASKS.register("made_up", "single")
def made_up():
    limits = dict(bandwidth=20.0, horizons_seconds=(0.05, 0.2, 0.5))
    return Task("made_up", "A made-up joint", frozenset({"single"}), (1,), make, **limits)
'''
METHOD = """
from dataclasses import dataclass, field
from methods.base import Method
from methods.differentiation import BandLimited
from methods.least_squares import LeastSquares
from methods.registry import METHODS

@METHODS.register("mine", "single-joint")
@dataclass(frozen=True)
class Mine(Method):
    def fit(self, logs, rng):
        columns = ("acceleration", "velocity", "coulomb")
        return LeastSquares(differentiator=BandLimited(20.0), columns=columns).fit(logs, rng)
"""


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A task's file; a name is registered once per process."""
    path = tmp_path_factory.mktemp("task") / "made_up.py"
    path.write_text(TASK, encoding="utf-8")
    return path


@pytest.fixture
def plugin(task: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A method's file beside a suite of one task."""
    (tmp_path / "mine.py").write_text(METHOD, encoding="utf-8")
    monkeypatch.setitem(SUITES, "tiny", Suite("tiny", "one task", (str(task),), (), (0, 1), reference_seeds=6))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def told(*arguments: str) -> tuple[int, str]:
    command = ["bench", "check", "--suite", "tiny", "--method", "mine.py", "--reference", "ref", *arguments]
    result = CliRunner().invoke(adeptone.app, command)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


@pytest.mark.parametrize("reruns", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_ones_own_method_against_ones_own_reference(reruns: int, plugin: Path) -> None:
    """Made, passed, passed again and again with other seeds, and failed after a change for the worse."""
    assert told("--update")[0] == 0
    made = (plugin / "ref" / "tiny.csv").read_bytes()
    status, text = told()
    assert (status, "nothing moved" in text) == (0, True)

    cells = plan(SUITES["tiny"].tasks, ["mine.py"], range(1000, 1000 + reruns))
    fresh = check.measure(cells, "run", workers=2, progress=False)
    before = reference.read(plugin / "ref" / "tiny.csv")
    assert [regressions(compare([rerun], before, {})) for rerun in fresh] == [[]] * reruns

    worsened = METHOD.replace("BandLimited(20.0)", "BandLimited(3.0)")
    (plugin / "mine.py").write_text(worsened, encoding="utf-8")
    status, text = told()
    assert (status, "regression" in text, "made_up" in text) == (1, True, True)

    shutil.rmtree(check.UNFINISHED)  # a process reads a plugin once, and would take the first runs for the same
    status, text = told("--update")
    assert (status, "regression" in text) == (0, True)
    assert (plugin / "ref" / "tiny.csv").read_bytes() != made


def test_unusable_input_is_refused(plugin: Path) -> None:
    with pytest.raises(CheckError, match="no reference of mine"):
        check.check("tiny", ["mine.py"], Path("ref"), progress=False)
    with pytest.raises(CheckError, match="no suite 'nothing'"):
        check.check("nothing", [], Path("ref"), progress=False)


NO_METHOD = "from methods.registry import METHODS\n\n@METHODS.register('wrong')\nclass Wrong:\n    {}\n"


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("nothere", None, "is not a file"),
        ("syntax", "def x(:", "SyntaxError"),
        ("absent", "import no_such_package", "No module named 'no_such_package'"),
        ("nothing", "x = 1", "registers no method"),
        ("no_method", NO_METHOD.format("pass"), "not a methods.base.Method"),
        ("no_default", NO_METHOD.format("def __init__(self, price): ..."), "Give every field a default"),
    ],
)
@pytest.mark.parametrize("command", [["check", "--reference", "ref"], ["run", "--task", "joint1_clean"]])
def test_an_unusable_method_file_is_one_line_and_status_2(
    command: list[str],
    name: str,
    content: str | None,
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    if content is not None:
        Path(f"{name}.py").write_text(content, encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["adeptone", "bench", *command, "--method", f"{name}.py"])
    with pytest.raises(SystemExit) as caught:
        adeptone.main()
    error = capsys.readouterr().err
    assert caught.value.code == 2
    assert complaint in error
    assert error.startswith("adeptone: ")
    assert error.count("\n") == 1
