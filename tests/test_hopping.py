"""Where small causes grow, a fit is begun again from places nearby, and parameters are as uncertain as good optima are
apart."""

import numpy as np
import pytest
from test_remainder import PLAY, fitted_with, problem_of

from diagnosis.hopping import Optimum, distances, hopped, likely, with_laws


@pytest.mark.slow
def test_a_fit_behind_impacts_finds_a_better_optimum_nearby() -> None:
    begun = {"backlash": {name: 1.5 * value for name, value in PLAY["backlash"].items()}}
    problem = problem_of(PLAY)
    fitted = fitted_with(problem, begun)
    best, optima = hopped(problem, fitted)
    assert fitted.criterion - best.criterion > 1000.0
    assert best.criterion == min(optimum.criterion for optimum in optima)
    assert optima[0] == Optimum.of(fitted)
    gap = optima[0].values["backlash.gap@0"], Optimum.of(best).values["backlash.gap@0"]
    assert abs(gap[1] - 0.004) < 0.5 * abs(gap[0] - 0.004)


def test_only_optima_that_are_as_likely_count() -> None:
    here = Optimum(-1000.0, {"inertia@0": 0.1, "backlash.gap@0": 0.004})

    def moved(worse: float, away: float) -> Optimum:
        return Optimum(here.criterion + worse, {name: value + away for name, value in here.values.items()})

    optima = (moved(7.0, 3e-3), here, moved(9.0, 0.1))
    assert distances(optima, 1.0) == pytest.approx(dict.fromkeys(here.values, 3e-3 / np.sqrt(2.0)))
    assert distances(optima, 2.0) == pytest.approx(dict.fromkeys(here.values, np.sqrt((9e-6 + 0.01) / 3.0)))
    assert distances((), 2.0) == {}
    assert likely(optima) == [here, optima[0]]


def test_optima_beside_another_law_are_none_of_a_law() -> None:
    both, alone, neither = (
        Optimum(0.0, dict.fromkeys(names, 1.0))
        for names in (
            ("inertia@0", "cable_spring.stiffness@0", "backlash.gap@0", "backlash_power.gap@0"),
            ("inertia@0", "backlash.gap@0"),
            ("inertia@0",),
        )
    )
    plays = ("backlash", "backlash_power")
    assert with_laws((both, alone, neither), plays, {"backlash"}) == (alone,)
    assert with_laws((both, alone, neither), plays, plays) == (both,)
    assert with_laws((both, alone, neither), plays, ()) == (neither,)
