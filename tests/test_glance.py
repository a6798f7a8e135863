"""The first look at a part of the samples: it ranks strong effects as all samples do, and says when it cannot."""

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation import Fitted, fit, plain, predicted_motion, sensitivities
from diagnosis.first_fits import first_fits, part_of
from diagnosis.glance import TELLING, Glance, can_be_glanced_at, glance
from diagnosis.hypotheses import Hypothesis, extend, proposals, sizes_of
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem, in_band, stack
from diagnosis.regression import View
from diagnosis.search import on_all, try_all
from envs.log import Array, JointFacts, Log
from methods.base import State
from methods.effects import built_in
from methods.kernel import build
from methods.structured import StructuredJoint, StructuredModel

EFFECTS = built_in()
KERNEL = build(EFFECTS)
NAMED = {effect.name: effect for effect in EFFECTS}
JOINT = {"inertia": 0.07, "viscous": 0.02, "back_emf": 0.7, "electrical_time_constant": 0.004}
STEP = 1e-5
CANDIDATES = [
    (NAMED[name], 0)
    for name in (
        "coulomb_friction",
        "quadratic_drag",
        "cable_spring",
        "dead_zone",
        "supply_sag",
        "periodic_disturbance",
    )
]


def record(effects: dict[str, dict[str, float]], dt: float, seconds: float, seed: int = 0) -> Log:
    rng = np.random.default_rng(seed)
    time = dt * np.arange(round(seconds / dt))
    hertz = np.array([0.3, 0.7, 1.3, 2.9, 5.3])
    phases = rng.uniform(0.0, 2 * np.pi, 5)
    command = np.sum(1.2 * np.sin(2 * np.pi * np.outer(time, hertz) + phases), axis=1)[:, None]
    model = StructuredModel((StructuredJoint(1, "voltage", JOINT, effects),), dt, None, EFFECTS)
    applied = command + np.cumsum(rng.normal(0.0, 1e-4, command.shape), axis=0)
    motion = model.simulate(time, applied, State.at_rest(0.0))
    facts = JointFacts(input="voltage", position_unit="rad", encoder_step=STEP)
    return Log(time, command, STEP * np.round(motion.position / STEP), (1,), facts=(facts,), name=f"log{seed}")


def fitted(effects: dict[str, dict[str, float]], dt: float, seconds: float) -> tuple[Problem, Fitted]:
    problem = stack(KERNEL, [record(effects, dt, seconds, seed) for seed in range(2)], (1,))
    return problem, fit_nominal(problem, (JointStructure(),))


@pytest.fixture(scope="module")
def rubbing() -> tuple[Problem, Fitted]:
    return fitted({"coulomb_friction": {"torque": 0.1}}, 1e-3, 30.0)


def promised(problem: Problem, base: Fitted, look: Glance | None) -> dict[str, float]:
    views = [View.of(problem, view) for view in (base, plain(problem, base))]
    starts = proposals(problem, views, CANDIDATES, sizes_of(problem, base), look)[0]
    return {start.hypothesis.effect.name: start.promise for start in starts}


def test_a_part_promises_what_all_samples_do(rubbing: tuple[Problem, Fitted]) -> None:
    problem, base = rubbing
    look = glance(problem, base)
    assert look is not None
    assert len(look.problem.time) < 0.3 * len(problem.time)
    part, whole = promised(problem, base, look), promised(problem, base, None)
    assert next(iter(part)) == next(iter(whole)) == "coulomb_friction"
    assert part["coulomb_friction"] == pytest.approx(whole["coulomb_friction"], rel=0.25)
    assert part["periodic_disturbance"] == whole["periodic_disturbance"]  # it counts time: all samples
    assert look.is_enough(part["coulomb_friction"])
    assert not look.is_enough(20.0 / look.share)


def test_a_part_promises_what_all_samples_do_in_the_band_of_the_motion(rubbing: tuple[Problem, Fitted]) -> None:
    narrow = in_band(rubbing[0])
    assert narrow.decimation > 1
    base = fit_nominal(narrow, (JointStructure(),))
    look = glance(narrow, base)
    assert look is not None
    part, whole = promised(narrow, base, look), promised(narrow, base, None)
    assert part["coulomb_friction"] == pytest.approx(whole["coulomb_friction"], rel=0.3)


def test_segments_begin_in_the_state_of_the_model(rubbing: tuple[Problem, Fitted]) -> None:
    problem, base = rubbing
    look = glance(problem, base)
    assert look is not None
    own = look.views[0].fitted
    part = look.problem
    for segment, log in enumerate(look.logs):
        a, b = part.bounds[segment : segment + 2]
        place = problem.bounds[log] + int(np.flatnonzero(problem.time[problem.bounds[log] :] == part.time[a])[0])
        assert part.starts[segment, :, :3] == pytest.approx(predicted_motion(problem, base.point)[place])
        settled = slice(a + 1000, b)
        expected = base.error[place + 1000 : place + b - a]
        assert own.error[settled] == pytest.approx(expected, abs=0.05 * np.std(base.error))


def test_starting_values_and_changes_of_the_parameters_are_those_of_all_logs(rubbing: tuple[Problem, Fitted]) -> None:
    problem, base = rubbing
    views = [View.of(problem, view) for view in (base, plain(problem, base))]
    look = glance(problem, base)
    sizes = sizes_of(problem, base)
    for part, whole in zip(
        proposals(problem, views, CANDIDATES[:1], sizes, look),
        proposals(problem, views, CANDIDATES[:1], sizes),
        strict=True,
    ):
        assert part[0].values.shape == whole[0].values.shape == (2, 1)
        assert part[0].values == pytest.approx(whole[0].values, rel=0.25)
        assert part[0].shift is not None
        assert whole[0].shift is not None
        names = [f.name for f in base.point.free]
        damping = names.index("back_emf@0")
        assert part[0].shift.shape == whole[0].shift.shape == (len(names),)
        assert part[0].shift[damping] == pytest.approx(whole[0].shift[damping], rel=0.25)
        assert not part[0].shift[names.index("velocity@0#1")]  # segments have initial velocities of their own


def test_slow_logs_are_looked_at_in_one_step_per_sample() -> None:
    problem, base = fitted({"coulomb_friction": {"torque": 0.1}}, 5e-3, 20.0)
    assert problem.substeps > 1
    look = glance(problem, base)
    assert look is not None
    assert (look.problem.substeps, look.share) == (1, 1.0)
    part, whole = promised(problem, base, look), promised(problem, base, None)
    assert part["coulomb_friction"] == pytest.approx(whole["coulomb_friction"], rel=0.05)


def test_nothing_is_saved_on_short_logs() -> None:
    assert glance(*fitted({}, 1e-3, 8.0)) is None


@pytest.mark.parametrize(
    ("name", "values"), [("thermal_drift", (0.1, 5.0)), ("periodic_disturbance", (0.01, 0.0, 3.0))]
)
def test_a_model_that_counts_time_needs_whole_logs(
    rubbing: tuple[Problem, Fitted], name: str, values: tuple[float, ...]
) -> None:
    problem, base = rubbing
    assert not can_be_glanced_at(NAMED[name])
    point = extend(problem, base.point, Hypothesis(NAMED[name], 0), np.tile(values, (2, 1)))
    assert glance(problem, replace(base, point=point)) is None


def test_time_enters_the_laws_of_disturbances_and_events_only() -> None:
    found = {effect.name for effect in EFFECTS if effect.has_time}
    assert found == {
        "collision",
        "payload_change",
        "payload_change_at_rest",
        "payload_change_carried",
        "payload_change_carried_at_rest",
        "payload_change_hung",
        "payload_change_hung_at_rest",
        "payload_change_weighed",
        "payload_change_weighed_at_rest",
        "periodic_disturbance",
    }


def test_weak_effects_are_sought_in_all_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, base = fitted({}, 1e-3, 30.0)
    looks: list[Array | None] = []

    def watched(*arguments, **options):
        looks.append(arguments[4] if len(arguments) > 4 else None)
        return proposals(*arguments, **options)

    monkeypatch.setattr("diagnosis.search.proposals", watched)
    try_all(problem, base, CANDIDATES)
    assert [look is None for look in looks] == [False, True]
    looks.clear()
    try_all(problem, base, CANDIDATES, needed=1e4)  # what would be needed shows on a part of them
    assert [look is None for look in looks] == [False]


def test_a_first_fit_to_a_part_is_one_to_all_samples(rubbing: tuple[Problem, Fitted]) -> None:
    problem, base = rubbing
    look = glance(problem, base)
    assert look is not None
    views = [View.of(problem, view) for view in (base, plain(problem, base))]
    starts = proposals(problem, views, CANDIDATES, sizes_of(problem, base), look)[0]
    own = [start for start in starts if start.hypothesis.effect.name in ("coulomb_friction", "quadratic_drag")]
    known = sensitivities(problem, base.point, base.error)
    brief, full = (first_fits(problem, base, own, known, part) for part in (look, None))
    assert [start.hypothesis.key for start, _ in brief] == [start.hypothesis.key for start, _ in full]
    for (start, part), (_, whole) in zip(brief, full, strict=True):
        assert part.samples == whole.samples == base.samples
        assert [f.name for f in part.point.free] == [f.name for f in whole.point.free]
        gain = base.criterion - whole.criterion
        assert base.criterion - part.criterion == pytest.approx(gain, rel=0.05, abs=100.0)
        name = f"{start.hypothesis.effect.name}.{start.hypothesis.effect.parameters[0].name}@0"
        if gain > 100.0:
            assert part.point.value(name) == pytest.approx(whole.point.value(name), rel=0.05)
    longer = replace(own[0], values=np.arange(2.0)[:, None])
    assert part_of(base.point, longer, look).values[:, 0].tolist() == [float(log) for log in look.logs]


def test_only_what_a_part_promises_is_asked_of_all_samples_where_much_is_needed(
    rubbing: tuple[Problem, Fitted], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, base = rubbing
    look = glance(problem, base)
    assert look is not None
    assert look.least_promise(-np.inf) == look.least_promise(0.9 * TELLING / look.share) == -np.inf
    much = 1.1 * TELLING / look.share
    assert 0.0 < look.least_promise(much) < much
    views = [View.of(problem, view) for view in (base, plain(problem, base))]
    sizes = sizes_of(problem, base)
    lists = proposals(problem, views, CANDIDATES, sizes, look)
    promises = {start.hypothesis.effect.name: start.promise for start in lists[0]}
    asked: list[str] = []

    def recorded(problem: Problem, views: list[View], effects: list, sizes: dict) -> list:
        asked.extend(effect.name for effect, _ in effects)
        return proposals(problem, views, effects, sizes)

    monkeypatch.setattr("diagnosis.search.proposals", recorded)
    least = 0.9 * promises["coulomb_friction"]
    found = on_all(problem, views, CANDIDATES, sizes, lists, least)
    assert "coulomb_friction" in asked
    assert "periodic_disturbance" not in asked  # it was regressed on all samples
    assert len(asked) < len(promises) - 1
    assert [len(own) for own in found] == [len(own) for own in lists]
    untouched = {s.hypothesis.effect.name: s.promise for s in found[0] if s.hypothesis.effect.name not in asked}
    assert all(promises[name] == promise for name, promise in untouched.items())
    asked.clear()
    on_all(problem, views, CANDIDATES, sizes, lists, -np.inf)
    assert set(asked) == set(promises) - {"periodic_disturbance"}


def test_a_part_decides_which_hypotheses_are_fitted_to_all_samples(
    rubbing: tuple[Problem, Fitted], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The best one is fitted to all samples and ends where it does without a look at a part; what is far from it is
    not."""
    problem, base = rubbing
    own = [(NAMED[name], 0) for name in ("coulomb_friction", "load_dependent_friction")]
    lengths: list[int] = []

    def counted(problem: Problem, *arguments: object, **options: object) -> Fitted:
        lengths.append(len(problem.time))
        return fit(problem, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("diagnosis.search.fit", counted)
    on_part = try_all(problem, base, own)
    assert min(lengths) < 0.5 * len(problem.time) < max(lengths) == len(problem.time)
    lengths.clear()
    monkeypatch.setattr("diagnosis.search.glance", lambda problem, base: None)
    whole = try_all(problem, base, own)
    assert set(lengths) == {len(problem.time)}
    assert [s.name for s in on_part] == [s.name for s in whole] == [effect.name for effect, _ in own]
    assert on_part[0].decrease == pytest.approx(whole[0].decrease, rel=1e-3)
    assert on_part[1].decrease == pytest.approx(whole[1].decrease, rel=0.05)
