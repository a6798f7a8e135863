"""Tables of blind trials, from made-up rows."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from benchmarks.blind.summary import LIMIT, confident_wrong, confusion, detection, parameters, text


def row(hidden: str, verdict: str, named: str, outcome: str, **other: object) -> dict[str, object]:
    return {
        "seed": 1, "kind": "single", "family": "servo", "hidden": hidden, "law": "textbook", "visibility": 50.0,
        "verdict": verdict, "named": named, "rivals": "", "outcome": outcome, "parameters": "[]", "closed": 1.0,
        "amplifier_noise": 0.0, "seconds": 10.0, **other,
    }  # fmt: skip


def test_confusion_tells_what_was_said_for_what_was_hidden() -> None:
    data = pd.DataFrame(
        [
            row("backlash", "named", "backlash", "right"),
            row("backlash", "named", "dead_zone", "wrong"),
            row("backlash", "unknown", "backlash", "unsure"),
            row("backlash", "ambiguous", "backlash", "unsure", rivals="dead_zone"),
            row("nothing", "named", "gravity_tilt", "right", family="pendulum", kind="clean"),
            row("dead_zone", "named", "dead_zone+gravity_tilt", "right", family="pendulum"),
        ]
    )
    table = confusion(data)
    assert table.loc["backlash"].to_dict() == {
        "(none)": 0, "(unknown)": 1, "backlash": 1, "backlash or dead_zone": 1, "dead_zone": 1,
    }  # fmt: skip
    assert table.loc["nothing", "(none)"] == 1
    assert table.loc["dead_zone", "dead_zone"] == 1
    assert confident_wrong(data) == pytest.approx(1 / 6)


def test_the_threshold_of_detection_is_found() -> None:
    rng = np.random.default_rng(0)
    sizes = np.exp(rng.uniform(np.log(1.5), np.log(15.0), 400))
    found = rng.uniform(size=400) < 1.0 / (1.0 + (6.0 / sizes) ** 5)
    weak = [
        row("backlash", "named" if yes else "none", "backlash" if yes else "", "", kind="weak", visibility=size)
        for size, yes in zip(sizes, found, strict=True)
    ]
    threshold, count = detection(pd.DataFrame(weak))
    assert count == 400
    assert threshold == pytest.approx(6.0, rel=0.1)
    assert pytest.approx(3.09, abs=0.01) == LIMIT
    assert np.isnan(detection(pd.DataFrame(weak[:0], columns=list(weak[0])))[0])


def test_intervals_and_errors_of_parameters() -> None:
    values = [("backlash.gap", 1.0, 1.01, 0.02), ("backlash.inertia_ratio", 1.0, 1.3, 0.1)]
    data = pd.DataFrame([row("backlash", "named", "backlash", "right", parameters=json.dumps(values))])
    table = parameters(data)
    assert table.loc[(False, True), "coverage"] == 0.5
    assert table.loc[(False, True), "median_error"] == pytest.approx(0.155)
    assert "weak effects" in text(data)
