"""Plugins from files and installed packages, for methods and effects, and the README's own example as written."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import adeptone
from diagnosis.effect_checks import EffectSubject, recorded
from diagnosis.preparation import arrange
from diagnosis.run import diagnose
from envs.log import Log
from envs.log_files import save
from methods.base import MethodError, State
from methods.compensated_least_squares import CompensatedLeastSquares
from methods.conformance.example import LinearJoint
from methods.effects import from_file, vocabulary
from methods.kernel import build
from methods.model_files import decoded, encoded, fit_to_json, load_model
from methods.plugins import find_method, load_all
from methods.registry import METHODS, RegistryError
from methods.scaffold import TEMPLATES, scaffold
from methods.structured import StructuredModel

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(autouse=True)
def registry() -> Iterator[None]:
    """Methods that a test registers are forgotten after it; those of the project are all there from the start."""
    load_all()
    before = dict(METHODS._entries)
    yield
    METHODS._entries.clear()
    METHODS._entries.update(before)


def run(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["adeptone", *arguments])
    with pytest.raises(SystemExit) as caught:
        adeptone.main()
    return int(caught.value.code or 0)


def plugin(folder: Path, text: str, name: str = "mine") -> Path:
    path = folder / f"{name}.py"
    path.write_text(text, encoding="utf-8")
    return path


def method_text(name: str, body: str = "raise ValueError('so it goes\\nwrong')") -> str:
    return f"""
from dataclasses import dataclass
from methods.base import Method
from methods.registry import METHODS

@METHODS.register("{name}", "single-joint")
@dataclass(frozen=True)
class Mine(Method):
    def fit(self, logs, rng):
        {body}
"""


@pytest.fixture
def logs(tmp_path: Path) -> list[Path]:
    return [save(LinearJoint().log(seed), tmp_path / f"log_{seed}.csv") for seed in (1, 2)]


# ---------------------------------------------------------------------------------------------------------- the README


def readme_section(title: str) -> str:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    return text.split(f"\n## {title}\n")[1].split("\n## ")[0]


def blocks(text: str) -> list[str]:
    return [block.split("\n", 1)[1] for block in re.findall(r"```(.*?)```", text, re.DOTALL)]


def test_the_readmes_method_is_installed_checked_fitted_and_measured(tmp_path: Path) -> None:
    """Files and commands as written; only the place of the installation is another one."""
    *files, commands = blocks(readme_section("Add a method"))
    for block in files:
        path = tmp_path / block.split("\n", 1)[0].removeprefix("# ")
        path.parent.mkdir(exist_ok=True)
        path.write_text(block, encoding="utf-8")
    code = [line for line in files[1].splitlines()[1:] if line.strip()]
    assert len(code) <= 32
    site = tmp_path / "site"
    environment = os.environ | {"PYTHONPATH": f"{site}{os.pathsep}{ROOT}"}
    for name, seed in (("train", 1), ("test", 2)):
        save(LinearJoint().log(seed), tmp_path / f"{name}.csv")
    said = {}
    for command in commands.strip().splitlines():
        words = command.split()
        if words[:3] == ["uv", "pip", "install"]:
            words[3:3] = ["--quiet", "--no-deps", "--python", sys.executable, "--target", str(site)]
        else:
            assert words[:3] == ["uv", "run", "adeptone"]
            words[:3] = [sys.executable, "-m", "adeptone"]
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        said[words[3] if "-m" in words else "install"] = done.stdout
    assert "FAILED" not in said["check-method"]
    assert re.search(r"velocity +0\.6 ", said["fit"])
    assert load_json(tmp_path / "model.json")["label"] == "ridge"
    assert "2 ok" in said["bench"]


def load_json(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


# ------------------------------------------------------------------------------------------------------------- methods


def test_a_method_is_found_by_name_and_by_file(tmp_path: Path) -> None:
    assert find_method("least_squares").name == "least_squares"
    path = plugin(tmp_path, method_text("mine"))
    assert find_method(str(path)).name == "mine"
    assert find_method(str(path)).factory is find_method(str(path)).factory  # run once
    with pytest.raises(RegistryError, match="did you mean least_squares"):
        find_method("least_square")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (method_text("least_squares"), "already registered by methods.least_squares"),
        ("import nowhere\n", "ModuleNotFoundError"),
        ("import sys\nsys.exit(0)\n", "does not run: SystemExit"),
        ("x = 1\n", "registers no method"),
        (
            method_text("lacking").replace("def fit", "def fiddle"),
            "write fit(self, logs, rng)",
        ),
        (method_text("needy").replace("def fit", "size: int\n    def fit"), "missing 1 required positional argument"),
        (method_text("raising"), "fails in fit: ValueError: so it goes wrong"),
        (method_text("nothing", "return 3"), "returns a int"),
    ],
)
def test_a_broken_method_is_one_line_and_writes_nothing(
    text: str,
    reason: str,
    tmp_path: Path,
    logs: list[Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, out = plugin(tmp_path, text), tmp_path / "model.json"
    assert run("fit", "--method", str(path), str(logs[0]), "--out", str(out), monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
    assert not out.exists()
    assert "mine" not in METHODS.names()


def test_a_file_that_fails_registers_nothing(tmp_path: Path) -> None:
    before = METHODS.names()
    with pytest.raises(RegistryError, match="ZeroDivisionError"):
        METHODS.load_path(plugin(tmp_path, method_text("half") + "\n1 / 0\n"))
    assert METHODS.names() == before


def test_a_broken_installed_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = importlib.metadata.EntryPoint("gone", "no_such_module:Thing", METHODS.group)
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: [broken] if group == METHODS.group else [])
    with pytest.raises(RegistryError, match="plugin gone does not run: ModuleNotFoundError") as caught:
        find_method("certainly_absent")
    assert "\n" not in str(caught.value)


def test_check_method_says_what_is_broken_and_exits_with_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = plugin(tmp_path, method_text("raising"))
    assert run("check-method", str(path), monkeypatch=monkeypatch) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("FAILED            fits_the_example")
    assert "it raises ValueError: so it goes wrong (mine.py, line" in lines[0].replace("It raises", "it raises")
    assert run("check-method", str(tmp_path / "absent.py"), monkeypatch=monkeypatch) == 2
    assert "is not a file" in capsys.readouterr().err


# ----------------------------------------------------------------------------------------------------------------- fit


def test_fit_saves_a_model_that_answers_as_before(
    tmp_path: Path, logs: list[Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "models" / "model.json"
    arguments = ["fit", "--method", "least_squares", str(logs[0]), "--holdout", str(logs[1]), "--out", str(out)]
    assert run(*arguments, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    assert re.search(r"velocity +0\.6 +\S+ +V s/rad", said)
    assert "rms error on log_2, joint 1: command" in said
    content = load_json(out)
    assert [entry["name"] for entry in content["estimates"]] == ["jerk", "acceleration", "velocity"]
    assert content["estimates"][2]["value"] == pytest.approx(0.6, rel=1e-3)
    assert len(content["covariance"]) == 3
    time, motion, command = LinearJoint().unseen()
    np.testing.assert_allclose(load_model(out).inverse(time, motion, command), command, atol=0.01)


def test_a_network_travels_to_the_last_bit(tmp_path: Path) -> None:
    method, log = CompensatedLeastSquares(), LinearJoint().log(1)
    fit = method.fit([log], np.random.default_rng(3))
    out = tmp_path / "model.json"
    out.write_text(fit_to_json(method, "compensated_least_squares", fit, [log], 3), encoding="utf-8")
    time, motion, _ = LinearJoint().unseen()
    assert np.array_equal(load_model(out).inverse(time, motion), fit.model.inverse(time, motion))


@dataclass(frozen=True)
class Holder:
    inner: object


def test_what_is_not_finite_and_what_is_foreign() -> None:
    for item in (float("inf"), "inf", (1, 2.5), [None, True], np.array([[np.nan, 1.0]]), np.zeros((0, 3)), {"a": (1,)}):
        assert repr(decoded(encoded(item, "x"))) == repr(item)
    with pytest.raises(MethodError, match=r"x\.inner is a function"):
        encoded(Holder(test_what_is_not_finite_and_what_is_foreign), "x")
    for name in ("os.system", "subprocess.Popen", "methods.base.MethodError", "methods.nowhere.Thing"):
        with pytest.raises(MethodError, match="which is not here"):
            decoded({"class": name, "fields": {}})


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--method", "lest_squares"], "did you mean least_squares"),
        (["--method", "least_squares", "--joint", "3"], "not joint 3"),
        (["--method", "least_squares", "--holdout", "log_1.csv"], "is also fitted"),
        (["--method", "least_squares", "log_1.csv"], "is given twice"),
        (["--method", "least_squares", "--robot", "nobody"], "nobody"),
        (["--method", "least_squares", "--out", "."], "is a folder"),
        (["--method", "least_squares", "pair.csv"], "Choose it with --joint"),
    ],
)
def test_fit_refuses_in_one_line(
    arguments: list[str],
    reason: str,
    tmp_path: Path,
    logs: list[Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    one, two = LinearJoint().log(1), LinearJoint().log(2)
    pair = Log(one.time, np.hstack([one.command, two.command]), np.hstack([one.position, two.position]), joints=(1, 2))
    save(pair, tmp_path / "pair.csv")
    files = [] if "pair.csv" in arguments else ["log_1.csv"]
    out = [] if "--out" in arguments else ["--out", "model.json"]
    assert run("fit", *files, *arguments, *out, monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
    assert not (tmp_path / "model.json").exists()


# ------------------------------------------------------------------------------------------------------------- effects


@pytest.fixture(scope="module")
def spring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The template's effect, a spring that hardens."""
    return scaffold("effect", "hard_spring", tmp_path_factory.mktemp("effect"))[0]


def test_an_effect_of_ones_own_is_named_in_a_diagnosis_and_its_model_is_read_back(spring: Path) -> None:
    effect = from_file(spring)
    subject = EffectSubject(effect, build((effect,)))
    values = (0.3, 1.0)
    read = arrange([recorded(subject, values, seed) for seed in (1, 2)], [recorded(subject, values, 3)], None)
    diagnosis, model, _ = diagnose(read, effects=(effect,))
    (named,) = diagnosis.effects
    assert named.name == "hard_spring"
    assert {"effect": "hard_spring", "joint": 1}.items() <= dict(diagnosis.missing_in_mujoco[0]).items()
    copy = StructuredModel.from_json(model.to_json(), (effect,))
    time = 2e-3 * np.arange(200)
    command = np.sin(9.0 * time)[:, None]
    one, other = (m.simulate(time, command, State.at_rest(0.2)).position for m in (model, copy))
    assert np.array_equal(one, other)


@pytest.mark.slow
def test_an_effect_file_takes_part_in_a_diagnosis_of_files(
    spring: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Among all other effects; the simulator is compiled anew for them together."""
    effect = from_file(spring)
    subject = EffectSubject(effect, build((effect,)))
    files = [str(save(recorded(subject, (0.3, 1.0), seed), tmp_path / f"{seed}.csv")) for seed in (1, 2)]
    arguments = ["diagnose", files[0], "--holdout", files[1], "--plugin", str(spring), "--out", str(tmp_path / "out")]
    assert run(*arguments, monkeypatch=monkeypatch) == 0
    assert "hard spring" in capsys.readouterr().out.replace("_", " ")
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert said["provenance"]["files"] == {str(spring): hashlib.sha256(spring.read_bytes()).hexdigest()}
    model = load_model(tmp_path / "out" / "extended_model.json", (effect,))
    assert isinstance(model, StructuredModel)
    assert list(model.parts[0].effects) == ["hard_spring"]


def test_effects_come_from_files_and_installed_packages(spring: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "hard_spring" in {effect.name for effect in vocabulary([spring, spring])}
    monkeypatch.syspath_prepend(spring.parent)
    point = importlib.metadata.EntryPoint("spring", "hard_spring:EFFECT", "adeptone.effects")
    monkeypatch.setattr(
        importlib.metadata, "entry_points", lambda group: [point] if group == "adeptone.effects" else []
    )
    assert "hard_spring" in {effect.name for effect in vocabulary()}
    with pytest.raises(RegistryError, match="already defined by entry point spring"):
        vocabulary([spring])


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("EFFECT = Effect(", "OTHER = Effect(", "defines no effect"),
        ('name="hard_spring"', 'name="backlash"', "already defined by the project itself"),
        ('stage="arm"', 'stage="leg"', "has the stage 'leg'"),
        ('slot="torque"', 'slot="structure"', "needs states in methods/kernel.py"),
        ("function=torque", "function=None", "has no function"),
        ("import Effect,", "import Defect,", "does not run: ImportError"),
    ],
)
def test_a_broken_effect_is_one_line(
    old: str,
    new: str,
    reason: str,
    spring: Path,
    tmp_path: Path,
    logs: list[Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = spring.read_text(encoding="utf-8")
    assert old in text
    path = plugin(tmp_path, text.replace(old, new))
    out = tmp_path / "out"
    assert run("diagnose", str(logs[0]), "--plugin", str(path), "--out", str(out), monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
    assert not out.exists()


# ----------------------------------------------------------------------------------------------------------- templates


@pytest.mark.parametrize("kind", ["method", "effect"])
def test_a_template_passes_its_own_test_as_written(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(f"new-{kind}", "hard_spring", "--out", str(tmp_path), monkeypatch=monkeypatch) == 0
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path / "test_hard_spring.py")]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "passed" in done.stdout


def test_new_method_overwrites_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "test_mine.py").write_text("kept")
    for name, reason in (
        ("mine", "test_mine.py exists and is kept"),
        ("least_squares", "already"),
        ("Mine", "is no name for a method"),
        ("class", "is no name for a method"),
    ):
        assert run("new-method", name, "--out", str(tmp_path), monkeypatch=monkeypatch) == 2
        error = capsys.readouterr().err
        assert reason in error
        assert error.count("\n") == 1
    assert run("new-effect", "Mine", "--out", str(tmp_path), monkeypatch=monkeypatch) == 2
    assert "is no name for an effect" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["test_mine.py"]
    assert (tmp_path / "test_mine.py").read_text() == "kept"
    assert sorted(path.name for path in TEMPLATES.iterdir()) == [
        "effect.py.txt",
        "method.py.txt",
        "test_effect.py.txt",
        "test_method.py.txt",
    ]
