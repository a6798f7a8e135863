"""Sparse identification of the joint's equation by pysindy (Brunton, Proctor, Kutz, PNAS 113 (2016) 3932).

q'' = xi_1 + xi_2 q' + xi_3 q'|q'| + xi_4 q'^3 + xi_5 tanh(q'/w) + xi_6 u, with few nonzero xi

The command enters as a control input, taken as effective at the sampling instants (a held command lags by half a
sample), and linearly, so that the equation can be inverted. Position and current are no part of the state: under a
single sine, q, q', q'' and q''' span two dimensions only, and a sparse regression then prefers relations such as
q''' = -w^2 q', in which the command does not occur at all.

``smoothed`` regresses the band-limited acceleration. ``weak`` needs no derivative of the velocity: both sides are
integrated against test functions (Reinbold, Gurevich, Grigoriev, Phys. Rev. E 101 (2020) 010203). ``ensemble`` is
``smoothed`` on bootstrap samples of the data, of which the median is taken; their spread is the covariance (Fasel,
Kutz, Brunton, Brunton, Proc. R. Soc. A 478 (2022) 20210904).
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from envs.log import Array, Log
from methods.base import Estimates, Fit, Method, MethodError, Status
from methods.differentiation import BandLimited, Differentiator
from methods.equation import EquationModel, compile_balance
from methods.named_terms import causes_of, verdict_of
from methods.registry import METHODS
from methods.usable_logs import check_joint

TERMS = ("constant", "velocity", "velocity |velocity|", "velocity^3", "coulomb", "command")


@compile_balance
def _balance(p, q, dq, ddq, jerk, u):
    # p = (xi_1 ... xi_6, w); F = q'' - Theta xi
    smooth = p[0] + dq * (p[1] + abs(dq) * p[2] + dq * dq * p[3])
    return ddq - smooth - p[4] * np.tanh(dq / p[6]) - p[5] * u


@dataclass(frozen=True, eq=False)
class SparseModel(EquationModel):
    """coefficients: xi (6,) in the order of `TERMS` [rad/s^2 or m/s^2 per term]; reversal_velocity: w."""

    coefficients: Array
    reversal_velocity: float

    @property
    def balance(self) -> Callable[[Array, float, float, float, float, float], float]:
        return _balance

    @cached_property
    def parameters(self) -> Array:
        return np.concatenate((self.coefficients, [self.reversal_velocity]))


@METHODS.register("sindy", "single-joint", "sparse")
@dataclass(frozen=True)
class Sindy(Method):
    """Sequentially thresholded least squares over `TERMS`.

    threshold: smallest share of the acceleration's deviation that a term must carry to stay.
    reversal_velocity: w as a share of the largest speed.
    windows, window: number and half-width [s] of the weak form's test functions. They have to be short beside the
    period of the motion: windows of half a period make velocity, its powers and friction indistinguishable.
    every: use every n-th sample, enough for signals limited to tens of hertz. members: of the ensemble.
    """

    variant: Literal["smoothed", "weak", "ensemble"] = "smoothed"
    differentiator: Differentiator = field(default_factory=BandLimited)
    threshold: float = 0.02
    reversal_velocity: float = 1e-2
    windows: int = 400
    window: float = 0.1
    every: int = 5
    members: int = 30

    @property
    def expected_failures(self) -> Mapping[str, str]:
        if self.variant == "ensemble":
            return {}
        return {
            "covariance": "a thresholded regression chooses its terms by the data; no covariance holds for what is left"
        }

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """The weak variant draws the places of its test functions, the ensemble its samples, the other nothing."""
        begin = time.perf_counter()
        joint, _ = check_joint(logs)
        steps = {round(log.sample_time, 9) for log in logs}
        if self.variant == "weak" and len(steps) > 1:
            raise MethodError("the weak form works on one time grid", remedy="Give logs of one sample time")
        signals = [self.differentiator.signals(log) for log in logs]
        fastest = max(float(np.max(np.abs(part.motion.velocity))) for part in signals)
        if fastest == 0.0:
            raise MethodError("the joint never moves in these logs", remedy="Give a log in which it does")
        reversal = self.reversal_velocity * fastest
        rows = slice(None, None, self.every)
        features = [_features(part.motion.velocity[rows, 0], part.command[rows, 0], reversal) for part in signals]
        scale = np.std(np.concatenate(features), axis=0)
        speed = scale[0]
        rate = float(np.std(np.concatenate([part.motion.acceleration[rows] for part in signals])))
        scaled = [part / scale for part in features]
        sparse, spread = self._regress(
            times=[part.time[rows] - part.time[0] for part in signals],
            states=[part[:, :1] for part in scaled],
            rates=[part.motion.acceleration[rows] / speed for part in signals],
            controls=[part[:, 1:] for part in scaled],
            threshold=self.threshold * rate / speed,
            rng=rng,
        )
        facts = logs[0].facts[0]
        units_of = speed / np.concatenate(([1.0], scale))
        model = SparseModel(joint, facts.input, sparse * units_of, reversal)
        kept = np.flatnonzero(model.coefficients)
        has_input = model.coefficients[-1] != 0.0
        units = _units(facts.position_unit, facts.command_unit)
        causes = causes_of(joint, [TERMS[k] for k in kept])
        return Fit(
            model=model,
            estimates=Estimates(
                names=tuple(TERMS[k] for k in kept),
                units=tuple(units[k] for k in kept),
                values=model.coefficients[kept],
                covariance=(spread * np.outer(units_of, units_of))[np.ix_(kept, kept)],
            ),
            residuals=np.concatenate([part.command - model.inverse(part.time, part.motion) for part in signals])[:, 0],
            status=Status.CONVERGED if has_input else Status.FAILED,
            seconds=time.perf_counter() - begin,
            notes=() if has_input else ("the sparse equation does not contain the command",),
            causes=causes,
            verdict=verdict_of(causes),
        )

    def _regress(
        self,
        times: list[Array],
        states: list[Array],
        rates: list[Array],
        controls: list[Array],
        threshold: float,
        rng: np.random.Generator,
    ) -> tuple[Array, Array]:
        """Coefficients (6,) of the scaled terms and their covariance (6, 6), NaN where the variant gives none."""
        import pysindy

        linear = pysindy.PolynomialLibrary(degree=1, include_bias=True)
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=0.0)
        untouched = np.random.get_state()  # noqa: NPY002
        np.random.seed(int(rng.integers(2**31)) if self.variant != "smoothed" else 0)  # noqa: NPY002
        try:  # pysindy draws from the global generator
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # STLSQ warns when it drops every term; the status says so instead
                if self.variant == "weak":
                    grid, pieces = equal_pieces(times, (states, controls))
                    weak = pysindy.WeakPDELibrary(
                        function_library=linear,
                        spatiotemporal_grid=grid,
                        K=self.windows // len(pieces[0]),
                        H_xt=self.window,
                        is_uniform=True,
                    )
                    model = pysindy.SINDy(optimizer=optimizer, feature_library=weak)
                    model.fit(pieces[0], t=[grid] * len(pieces[0]), u=pieces[1])
                else:
                    if self.variant == "ensemble":
                        optimizer = pysindy.EnsembleOptimizer(optimizer, bagging=True, n_models=self.members)
                    model = pysindy.SINDy(optimizer=optimizer, feature_library=linear)
                    model.fit(states, t=times, x_dot=rates, u=controls)
        finally:
            np.random.set_state(untouched)  # noqa: NPY002
        found = np.asarray(model.coefficients()[0])
        if self.variant != "ensemble":
            return found, np.full((len(found), len(found)), np.nan)
        return found, np.cov(np.array([member[0] for member in optimizer.coef_list]).T)


@METHODS.register("weak_sindy", "single-joint", "sparse")
def weak_sindy() -> Sindy:
    """SINDy in weak form."""
    return Sindy("weak")


@METHODS.register("ensemble_sindy", "single-joint", "sparse")
def ensemble_sindy() -> Sindy:
    """SINDy as the median of bootstrap samples."""
    return Sindy("ensemble")


def equal_pieces(times: list[Array], signals: tuple[list[Array], ...]) -> tuple[Array, tuple[list[Array], ...]]:
    """One time grid and the signals of all logs cut into pieces as long as the shortest log."""
    length = min(len(time) for time in times)
    starts = [(log, first) for log, time in enumerate(times) for first in range(0, len(time) - length + 1, length)]
    return times[0][:length], tuple([part[log][first : first + length] for log, first in starts] for part in signals)


def _features(velocity: Array, command: Array, reversal_velocity: float) -> Array:
    """The terms but the constant, shape (T, 5); the first one is the state."""
    friction = np.tanh(velocity / reversal_velocity)
    return np.column_stack((velocity, velocity * np.abs(velocity), velocity**3, friction, command))


def _units(position: str, command: str) -> tuple[str, ...]:
    acceleration = f"{position}/s^2"
    return (acceleration, "1/s", f"1/{position}", f"s/{position}^2", acceleration, f"{acceleration}/{command}")
