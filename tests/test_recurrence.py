"""Events that happen in one log, in all of them, or at an instant of its own in each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation import Fitted, fit
from diagnosis.finding import Accepted
from diagnosis.hypotheses import Hypothesis, Start, extend
from diagnosis.instants import apart_in
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem, stack
from diagnosis.pruning import elsewhere
from diagnosis.recurrence import recurrences_settled
from diagnosis.search import Scored, polish, price, try_all
from envs.log import JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
NAMED = {effect.name: effect for effect in EFFECTS}
JOINT = {"inertia": 0.07, "viscous": 0.3, "back_emf": 0.0, "electrical_time_constant": 0.0}
FRICTION = {"coulomb_friction": {"torque": 0.1}}
PAYLOAD = {"payload_change": {"inertia": 0.02, "time": 4.0}}
STEP = 1e-5
STRUCTURE = (JointStructure(input="torque", electrical=False),)


def record(effects: dict[str, dict[str, float]], seed: int) -> Log:
    time = 2e-3 * np.arange(4000)
    hertz, phases = np.array([0.3, 0.7, 1.3, 2.9]), np.random.default_rng(seed).uniform(0.0, 2 * np.pi, 4)
    command = 0.5 * np.sum(np.sin(2 * np.pi * np.outer(time, hertz) + phases), axis=1)[:, None]
    model = StructuredModel((StructuredJoint(1, "torque", JOINT, effects),), 2e-3, None, EFFECTS)
    position = model.simulate(time, command, State.at_rest(0.0)).position
    facts = JointFacts(input="torque", position_unit="rad", encoder_step=STEP)
    return Log(time, command, STEP * np.round(position / STEP), (1,), facts=(facts,), name=f"log {seed}")


def payload(instant: float) -> dict[str, dict[str, float]]:
    return {"payload_change": {"inertia": 0.02, "time": instant}}


@pytest.mark.parametrize(("instants", "own"), [((4.0, 6.0), True), ((4.0, 4.0), False)])
def test_a_load_is_picked_up_at_an_instant_of_its_own_in_every_log(instants: tuple[float, ...], own: bool) -> None:
    logs = [record(payload(instant), log) for log, instant in enumerate(instants)]
    problem = stack(build(EFFECTS), logs, (1,))
    base = fit_nominal(problem, STRUCTURE)
    best = polish(problem, base, try_all(problem, base, [(NAMED["payload_change"], 0)])[0])
    (item,), fitted = recurrences_settled(problem, [Accepted(best, 0.1, ())], best.fitted)
    hypothesis, found, columns = item.scored.start.hypothesis, fitted.point, problem.kernel.own(item.effect)
    assert hypothesis.apart == ((0, 1) if own else ())
    assert hypothesis.log == -1
    assert found.parameters[:, 0, columns] == pytest.approx(np.array([[0.02, t] for t in instants]), rel=0.001)
    assert item.scored.evidence == pytest.approx(
        base.criterion - fitted.criterion - price(problem, item.scored.start, base.samples)
    )
    prices = [price(problem, replace(best.start, hypothesis=replace(hypothesis, apart=a)), 1000) for a in ((0, 1), ())]
    assert prices[0] - prices[1] == pytest.approx(np.log(1000))
    assert apart_in(found, NAMED["payload_change"], 0) == hypothesis.apart


@pytest.mark.parametrize("instant", [2.5, 5.0, None])
def test_the_instant_of_an_event_in_another_log_is_found_there(instant: float | None) -> None:
    fitted_logs, other = [record(payload(4.0), log) for log in (0, 1)], record(payload(instant) if instant else {}, 2)
    problem, held_out = (stack(build(EFFECTS), logs, (1,)) for logs in (fitted_logs, [other]))
    nominal = fit_nominal(problem, STRUCTURE).point
    event = Hypothesis(NAMED["payload_change"], 0)
    base = fit(problem, extend(problem, nominal, event, np.tile([0.02, 4.0], (2, 1))), rounds=2, iterations=8)
    found = elsewhere(held_out, base)
    there = found.point.parameters[0, 0, problem.kernel.column(NAMED["payload_change"], "time")]
    assert there == pytest.approx(instant, abs=0.005) if instant else there > 8.0
    assert np.std(found.error[held_out.used]) < STEP


def found_at(problem: Problem, log: int) -> tuple[list[Accepted], Fitted]:
    """Friction and a payload that is taken for one of this log, or of all (-1)."""
    point, items = fit_nominal(problem, STRUCTURE).point, []
    for name, values, place in (("coulomb_friction", [0.1], -1), ("payload_change", [0.02, 4.0], log)):
        start = Start(Hypothesis(NAMED[name], 0, place), np.tile(values, (problem.logs, 1)), 0.0)
        point = extend(problem, point, start.hypothesis, start.values)
        items.append(start)
    fitted = fit(problem, point, rounds=2, iterations=10)
    return [Accepted(Scored(start, fitted, 100.0, 20.0), 0.1, ()) for start in items], fitted


@pytest.mark.parametrize(("where", "assumed", "settled"), [(-1, 0, -1), (-1, 1, -1), (-1, -1, -1), (0, 0, 0)])
def test_an_event_of_one_log_is_put_into_all_where_it_happens_in_all(where: int, assumed: int, settled: int) -> None:
    logs = [record(FRICTION | (PAYLOAD if where in (-1, log) else {}), log) for log in (0, 1)]
    problem = stack(build(EFFECTS), logs, (1,))
    accepted, base = found_at(problem, assumed)
    items, fitted = recurrences_settled(problem, accepted, base)
    assert items[1].scored.start.hypothesis.log == settled
    if settled == assumed:
        assert fitted is base
        assert items == accepted
    else:
        assert fitted.criterion < base.criterion - 100.0
        assert items[1].scored.decrease > 200.0
    names = {free.name for free in fitted.point.free if free.name.startswith("payload_change")}
    suffix = "" if settled < 0 else f"#{settled}"
    assert names == {f"payload_change.inertia@0{suffix}", f"payload_change.time@0{suffix}"}
    own = problem.kernel.own(NAMED["payload_change"])
    assert fitted.point.parameters[0, 0, own] == pytest.approx([0.02, 4.0], rel=0.01)


def test_a_lone_event_has_been_sought_everywhere() -> None:
    problem = stack(build(EFFECTS), [record(PAYLOAD, log) for log in (0, 1)], (1,))
    accepted, base = found_at(problem, 0)
    assert recurrences_settled(problem, accepted[1:], base) == (accepted[1:], base)
