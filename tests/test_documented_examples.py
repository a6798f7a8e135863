"""The Python examples of the documentation, run as they are written."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.log import Log
from envs.log_files import save
from methods.base import State
from methods.structured import StructuredJoint, StructuredModel

ROOT = Path(__file__).resolve().parents[1]
NOMINAL = {"inertia": 0.02, "viscous": 0.1, "back_emf": 0.4, "electrical_time_constant": 0.005}


def examples(page: str) -> list[str]:
    """The Python blocks of a page."""
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


def test_a_saved_model_is_simulated_inverted_and_put_into_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a log that the model itself made, so that nothing but the way there can err."""
    part = StructuredJoint(1, "voltage", NOMINAL, {"coulomb_friction": {"torque": 0.3}})
    model = StructuredModel((part,), 1e-3)
    time = 1e-3 * np.arange(4000)
    command = 2.0 * np.sin(2.0 * np.pi * np.outer(time, [0.7, 1.9])).sum(axis=1, keepdims=True)
    position = model.simulate(time, command, State.at_rest(0.2)).position
    monkeypatch.chdir(tmp_path)
    save(Log(time, command, position), "test.csv")
    Path("out").mkdir()
    Path("out/extended_model.json").write_text(model.to_json(), encoding="utf-8")

    names: dict[str, Any] = {}
    use, play = examples("docs/model.md")
    exec(use, names)
    simulated, inverted = map(float, re.findall(r"\[(.*)\]", capsys.readouterr().out))
    assert simulated < 1e-3 * float(np.std(position))
    assert inverted < 0.05 * float(np.std(command))
    exec(play, names)
    assert names["environment"].unwrapped.simulator.held == (2, 3, 4)
    assert np.all(np.isfinite(names["observation"]))
