"""Multiple shooting: pieces that begin in free states lead to the parameters where whole logs lead astray."""

import numpy as np
import pytest
from test_remainder import NAMED, PLAY, fitted_with, problem_of

from diagnosis.estimation import Point, errors
from diagnosis.hypotheses import Hypothesis, extend
from diagnosis.nominal import JointStructure, fit_nominal
from diagnosis.problem import Problem
from diagnosis.shooting import Pieces, _step, agreed, best_of, cut, shot

TRUE = {f"backlash.{name}@0": value for name, value in PLAY["backlash"].items()}


@pytest.fixture(scope="module")
def problem() -> Problem:
    return problem_of(PLAY)


@pytest.fixture(scope="module")
def nominal(problem: Problem) -> Point:
    return fit_nominal(problem, (JointStructure(),)).point


def with_play(problem: Problem, nominal: Point, times: float) -> Point:
    """The nominal model with a play, not fitted, whose parameters are so many times those of the plant."""
    effect = NAMED["backlash"]
    values = np.array([[times * PLAY["backlash"][p.name] for p in effect.parameters]])
    return extend(problem, nominal, Hypothesis(effect, 0), values)


def pieces_of(problem: Problem, point: Point) -> Pieces:
    pieces = cut(problem, point)
    assert pieces is not None
    return pieces


def test_pieces_err_as_the_whole_log_until_their_states_are_free(problem: Problem, nominal: Point) -> None:
    point = with_play(problem, nominal, 1.0)
    pieces = pieces_of(problem, point)
    whole, parts = errors(problem, [point])[0], errors(pieces.problem, [pieces.point])[0]
    rows = np.searchsorted(problem.time, pieces.problem.time)
    np.testing.assert_allclose(parts, whole[rows], atol=1e-9)
    assert rows[0] == np.argmax(problem.used)


def test_pieces_lead_from_far_away_to_the_play(problem: Problem, nominal: Point) -> None:
    """Begun with parameters that are a third too small, and within their deviations, which the pieces tell."""
    point = with_play(problem, nominal, 0.7)
    for _ in range(4):
        agreement = agreed(pieces_of(problem, point))
        point = point.taking(agreement.values)
    for name, value in TRUE.items():
        deviation = agreement.deviations[name]
        assert 0.0 < deviation < 0.1 * value
        assert abs(agreement.values[name] - value) < 4.0 * deviation + 0.01 * value


def test_states_are_eliminated_as_if_all_were_solved_for_at_once() -> None:
    rng = np.random.default_rng(0)
    pieces, count, size, damping = 3, 2, 4, 0.1
    slopes, errs = rng.standard_normal((pieces, count + size, 30)), rng.standard_normal((pieces, 30))
    certainty, prior, held = rng.random(count), rng.standard_normal(count), rng.random((pieces, size))
    gram, gradient = slopes @ slopes.transpose(0, 2, 1), np.einsum("kpt,kt->kp", slopes, errs)
    every = np.zeros((count + pieces * size, pieces * 30))
    for k in range(pieces):
        rows, columns = count + k * size, 30 * k
        every[:count, columns : columns + 30], every[rows : rows + size, columns : columns + 30] = np.split(
            slopes[k], [count]
        )
    matrix = every @ every.T + np.diag([*certainty, *held.ravel()])
    matrix[np.diag_indices_from(matrix)] *= 1.0 + damping
    solved = -np.linalg.solve(matrix, every @ errs.ravel() + np.concatenate([prior, np.zeros(pieces * size)]))
    anywhere = np.full(count, -np.inf), np.full(count, np.inf)
    own, states = _step(gram, gradient, certainty, prior, held, damping, anywhere)
    np.testing.assert_allclose(np.concatenate([own, states.ravel()]), solved, rtol=1e-9)
    nearer = 0.5 * own[0]  # where the first parameter meets a bound, all others and the states go with it
    right = every @ errs.ravel() + np.concatenate([prior, np.zeros(pieces * size)])
    beside = -np.linalg.solve(matrix[1:, 1:], right[1:] + matrix[1:, 0] * nearer)
    ends = np.sort([nearer, -nearer])
    room = np.array([ends[0], *anywhere[0][1:]]), np.array([ends[1], *anywhere[1][1:]])
    own, states = _step(gram, gradient, certainty, prior, held, damping, room)
    np.testing.assert_allclose(np.concatenate([own, states.ravel()]), [nearer, *beside], rtol=1e-9)


@pytest.mark.slow
def test_whole_logs_do_better_from_where_pieces_lead(problem: Problem) -> None:
    fitted = fitted_with(problem, {"backlash": {name: 1.5 * value for name, value in PLAY["backlash"].items()}})
    shots = shot(problem, fitted)
    best = best_of(shots)
    assert shots[0].fitted is fitted
    assert fitted.criterion - best.criterion > 1000.0
    assert best.point.value("backlash.gap@0") == pytest.approx(PLAY["backlash"]["gap"], rel=0.02)
