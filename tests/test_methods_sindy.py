"""Sparse identification: the equation is found, in both forms, and other people's random numbers stay theirs."""

from __future__ import annotations

import numpy as np
import pytest

from envs.log import Log
from methods.base import MethodError, State, Status
from methods.sindy import TERMS, Sindy, SparseModel

TIME = np.arange(6000) * 1e-3
TRUTH = np.array([0.3, -14.0, -0.4, 0.0, -1.2, 19.0])


@pytest.fixture(scope="module")
def log() -> Log:
    model = SparseModel(1, "voltage", TRUTH, reversal_velocity=0.02)
    rng = np.random.default_rng(0)
    frequencies = np.arange(0.5, 6.0, 0.5)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    command = 0.6 * np.sum(np.cos(2.0 * np.pi * np.outer(TIME, frequencies) + phases), axis=1)
    run = model.simulate(TIME, command[:, None], State.at_rest(0.0))
    return Log(time=TIME, command=command, position=run.position)


@pytest.mark.parametrize("variant", ["smoothed", "weak"])
def test_the_equation_is_found(log: Log, variant: str) -> None:
    fit = Sindy(variant, every=1).fit([log], np.random.default_rng(0))  # type: ignore[arg-type]
    assert isinstance(fit.model, SparseModel)
    assert fit.status is Status.CONVERGED
    assert fit.model.coefficients[[1, 5]] == pytest.approx(TRUTH[[1, 5]], rel=0.1)
    assert fit.model.coefficients[4] == pytest.approx(TRUTH[4], rel=0.45)
    assert set(fit.estimates.names) <= set(TERMS)
    assert np.std(fit.residuals) < 0.02 * np.std(log.command)


def test_selected_terms_are_named_as_effects(log: Log) -> None:
    fit = Sindy(every=1).fit([log], np.random.default_rng(0))
    assert {cause.effect for cause in fit.causes or ()} == {"coulomb_friction"}
    assert fit.verdict == "named"


def test_the_weak_form_draws_from_its_own_generator(log: Log) -> None:
    np.random.seed(5)  # noqa: NPY002
    before = np.random.get_state()[1].tobytes()  # noqa: NPY002
    fits = [Sindy("weak").fit([log], np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert np.random.get_state()[1].tobytes() == before  # noqa: NPY002
    first, same, other = (fit.estimates.values.tobytes() for fit in fits)
    assert first == same != other


def test_an_equation_without_the_command_is_a_failure(log: Log) -> None:
    rng = np.random.default_rng(0)
    unrelated = Log(time=log.time, command=1e-3 * rng.normal(size=len(log)), position=np.sin(9.0 * log.time))
    fit = Sindy(threshold=0.5).fit([unrelated], rng)
    assert fit.status is Status.FAILED
    assert fit.notes == ("the sparse equation does not contain the command",)


def test_the_weak_form_takes_logs_of_one_sample_time(log: Log) -> None:
    halves = [log.slice(0, 3600), log.slice(3600, len(log))]
    fit = Sindy("weak", every=1).fit(halves, np.random.default_rng(0))
    assert isinstance(fit.model, SparseModel)
    assert fit.model.coefficients[[1, 5]] == pytest.approx(TRUTH[[1, 5]], rel=0.1)
    slower = Log(time=2.0 * log.time, command=log.command, position=log.position)
    with pytest.raises(MethodError, match="one time grid"):
        Sindy("weak").fit([log, slower], np.random.default_rng(0))


def test_the_ensemble_gives_its_spread_as_covariance(log: Log) -> None:
    fit = Sindy("ensemble", every=1).fit([log], np.random.default_rng(0))
    assert isinstance(fit.model, SparseModel)
    assert fit.model.coefficients[[1, 5]] == pytest.approx(TRUTH[[1, 5]], rel=0.1)
    assert np.all(fit.estimates.standard_errors > 0.0)
