"""A tilted base and a load at the end of the second link act on both joints of two links in a plane."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.engine import find
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.parameters import JointUnits
from diagnosis.partial_residual import partial_residuals
from diagnosis.problem import stack
from diagnosis.search import try_all
from envs.log import JointFacts, Log
from methods.effects import built_in
from methods.kernel import build

EFFECTS = built_in()
KERNEL = build(EFFECTS)
DT, STEP, PARTS = 4e-3, 1e-5, 20
LENGTHS, MASSES, DAMPING = (0.4, 0.3), (3.0, 2.0), (1.5, 0.6)
GRAVITY, LOAD, PICKED_UP = 9.81, 0.8, 6.0
CANDIDATES = [
    effect
    for effect in EFFECTS
    if effect.label in ("payload_change", "gravity_tilt", "coulomb_friction", "cable_spring", "collision")
]


def moved(
    seed: int, pull: tuple[float, float], load: float, braked: float = 0.0, samples: int = 3000, rested: bool = False
) -> Log:
    """Two rods under servos that are pulled along x and y of their plane; they pick up a load at the end.

    Textbook equations of the double pendulum, twenty steps a sample. braked: share of the damping that is the servos'.
    rested: whether the load did until then, so that the links lose momentum to it.
    """
    (l1, l2), (m1, m2) = LENGTHS, MASSES
    rng, time = np.random.default_rng(seed), DT * np.arange(samples)
    wave = lambda: np.sum(np.sin(np.outer(time, rng.uniform(1.0, 16.0, 5)) + rng.uniform(0, 6, 5)), axis=1)  # noqa: E731
    feed, stiff = np.column_stack([6.0 * wave(), 2.5 * wave()]), (46.0, 18.0) if pull[1] else (6.0, 3.0)
    q1, q2, d1, d2 = 0.3, 0.5, 0.0, 0.0
    command, position = np.zeros((samples, 2)), np.zeros((samples, 2))
    for k in range(samples):
        position[k] = q1, q2
        command[k] = u1, u2 = feed[k] - np.array(stiff) * (q1 - 0.3, q2 - 0.5) - braked * np.array(DAMPING) * (d1, d2)
        m = load * (time[k] >= PICKED_UP)
        one, two = 0.05 + m1 * l1**2 / 4 + (m2 + m) * l1**2, 0.02 + m2 * l2**2 / 4 + m * l2**2
        couples = l1 * l2 * (m2 / 2 + m)
        if rested and m > 0.0 and time[k] - DT < PICKED_UP:
            tip = np.array([[-l1 * np.sin(q1) - l2 * np.sin(q1 + q2), -l2 * np.sin(q1 + q2)],
                            [l1 * np.cos(q1) + l2 * np.cos(q1 + q2), l2 * np.cos(q1 + q2)]])  # fmt: skip
            cross = two + couples * np.cos(q2)
            after = np.array([[one + two + 2 * couples * np.cos(q2), cross], [cross, two]])
            d1, d2 = np.linalg.solve(after, (after - m * tip.T @ tip) @ (d1, d2))
        first, second = l1 * (m1 / 2 + m2 + m), l2 * (m2 / 2 + m)
        for _ in range(PARTS):
            c, s = np.cos(q2), np.sin(q2)
            weight2 = second * (pull[0] * np.sin(q1 + q2) - pull[1] * np.cos(q1 + q2))
            weight1 = weight2 + first * (pull[0] * np.sin(q1) - pull[1] * np.cos(q1))
            r1 = u1 - (1.0 - braked) * DAMPING[0] * d1 + couples * s * (2 * d1 * d2 + d2 * d2) + weight1
            r2 = u2 - (1.0 - braked) * DAMPING[1] * d2 - couples * s * d1 * d1 + weight2
            m11, m12 = one + two + 2 * couples * c, two + couples * c
            det = m11 * two - m12 * m12
            d1 += DT / PARTS * (two * r1 - m12 * r2) / det
            d2 += DT / PARTS * (m11 * r2 - m12 * r1) / det
            q1, q2 = q1 + DT / PARTS * d1, q2 + DT / PARTS * d2
    facts = JointFacts(input="torque", position_unit="rad", encoder_step=STEP)
    reading = STEP * np.round(position / STEP)
    return Log(time, command, reading, (1, 2), facts=(facts, facts), name=f"{seed}")


@pytest.mark.parametrize(
    ("pull", "load", "expected"),
    [
        pytest.param(
            (0.5, 0.3),
            0.0,
            {("gravity_tilt", 0): (-0.7, 0.42), ("gravity_tilt", 1): (-0.15, 0.09)},
            marks=pytest.mark.slow,
        ),
        pytest.param(
            (0.0, 0.0), LOAD, {("payload_change_carried", 1): (0.072, PICKED_UP, 4 / 3)}, marks=pytest.mark.slow
        ),
        ((0.0, GRAVITY), LOAD, {("payload_change_hung", 1): (0.072, PICKED_UP, 4 / 3, 0.0, LOAD * GRAVITY * 0.3)}),
    ],
    ids=["tilted", "loaded", "loaded where gravity pulls"],
)
def test_what_acts_on_both_links_is_found_as_one_arms(
    pull: tuple[float, float], load: float, expected: dict[tuple[str, int], tuple[float, ...]]
) -> None:
    problem, held_out = (
        stack(KERNEL, [moved(seed, pull, load, braked=0.0 if load else 0.98) for seed in own], (1, 2), pair=True)
        for own in ((1, 2), (3,))
    )
    structure = JointStructure(input="torque", gravity="pendulum" if pull[1] == GRAVITY else "none")
    finding = find(problem, (structure, structure), CANDIDATES, held_out=held_out)
    assert finding.verdict == "named"
    # on the first link both forms of a tilt are the same
    found = {(item.name if item.joint else item.label, item.joint): item for item in finding.accepted}
    assert found.keys() == expected.keys()
    for place, item in found.items():
        values = finding.final.point.parameters[0, item.joint, KERNEL.own(item.effect)]
        assert values == pytest.approx(expected[place], rel=0.01, abs=0.01)
    if load == 0.0:  # the second link's angle is the sum of both joints'
        drawn = [partial_residuals(problem, finding, j, JointUnits("torque", "rad"))[0] for j in (0, 1)]
        assert [part.signal for part in drawn] == ["position", "angle of the link"]
        both = problem.reading[problem.used].sum(axis=1)
        assert np.ptp(drawn[1].x) > 0.8 * np.ptp(both)
        assert np.all((drawn[1].x >= both.min()) & (drawn[1].x <= both.max()))
        for j, part in enumerate(drawn):
            sine, cosine = expected["gravity_tilt", j]
            law = sine * np.sin(part.x) + cosine * np.cos(part.x)
            assert np.std(part.laws[0][1] - law) < 0.1 * np.std(law)
            assert np.max(np.abs(part.laws[0][1] - law)) < 0.5 * np.std(law)


def test_a_load_that_rested_takes_its_momentum_from_both_links() -> None:
    problem = stack(KERNEL, [moved(seed, (0.0, 0.0), LOAD, rested=True) for seed in (1, 2)], (1, 2), pair=True)
    structure = JointStructure(input="torque", gravity="none")
    forms = [(effect, 1) for effect in EFFECTS if effect.label == "payload_change" and not effect.after]
    best, second, *_ = try_all(problem, fit_nominal(problem, (structure, structure)), forms)
    assert best.name == "payload_change_carried_at_rest"
    assert best.evidence > second.evidence + 1000.0
    values = best.fitted.point.parameters[0, 1, KERNEL.own(best.effect)]
    assert values == pytest.approx((0.072, PICKED_UP, 4 / 3), rel=0.01)
