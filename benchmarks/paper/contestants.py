"""Who takes part, under which name, and from which side."""

from __future__ import annotations

from dataclasses import dataclass

from methods.back_propagation import BackPropagation
from methods.base import Method
from methods.compensated_least_squares import CompensatedLeastSquares
from methods.differentiation import BandLimited, FiniteDifferences
from methods.full_batch import FullBatch
from methods.least_squares import LeastSquares
from methods.network_alone import NetworkAlone
from methods.regressor import ColumnName
from methods.sindy import Sindy
from methods.two_layer_network import FOUR_SIGNALS, TWO_SIGNALS

RAW, FILTERED = FiniteDifferences(), BandLimited()

LS_RAW = "LS, raw differences"
LS = "LS, band-limited"
PRINTED = "LS + NN(q, q′), as printed"
PRINTED_4 = "LS + NN(q, q′, q″, q‴), as printed"
HYBRID = "LS + NN(q, q′), back-propagation"
HYBRID_4 = "LS + NN(q, q′, q″, q‴), back-propagation"
MODERN = "LS + NN(q, q′), L-BFGS"
MODERN_4 = "LS + NN(q, q′, q″, q‴), L-BFGS"
ALONE = "NN alone (q, q′, q″, q‴), L-BFGS"
SINDY = "SINDy, smoothed"
SINDY_WEAK = "SINDy, weak"
COULOMB = "LS, Coulomb instead of jerk column"
NOMINAL = "true coefficients, not fitted"
"""Not a contestant: the joint's own linear coefficients, which no method knows."""


@dataclass(frozen=True)
class Contestant:
    """A method with its name in tables and figures."""

    name: str
    method: Method


def contestants(columns: tuple[ColumnName, ...], smooth: BandLimited = FILTERED) -> tuple[Contestant, ...]:
    """All of them, for a joint with these regressor columns and a log for which `smooth` is fit."""
    raw, filtered = LeastSquares(RAW, columns), LeastSquares(smooth, columns)
    rule, modern = BackPropagation(), FullBatch()
    return (
        Contestant(LS_RAW, raw),
        Contestant(PRINTED, CompensatedLeastSquares(raw, TWO_SIGNALS, trainer=rule)),
        Contestant(PRINTED_4, CompensatedLeastSquares(raw, FOUR_SIGNALS, trainer=rule)),
        Contestant(LS, filtered),
        Contestant(HYBRID, CompensatedLeastSquares(filtered, TWO_SIGNALS, trainer=rule)),
        Contestant(HYBRID_4, CompensatedLeastSquares(filtered, FOUR_SIGNALS, trainer=rule)),
        Contestant(MODERN, CompensatedLeastSquares(filtered, TWO_SIGNALS, trainer=modern)),
        Contestant(MODERN_4, CompensatedLeastSquares(filtered, FOUR_SIGNALS, trainer=modern)),
        Contestant(ALONE, NetworkAlone(smooth)),
        Contestant(SINDY, Sindy("smoothed", smooth)),
        Contestant(SINDY_WEAK, Sindy("weak", smooth)),
        Contestant(COULOMB, LeastSquares(smooth, (*columns[1:], "coulomb"))),
    )
