"""The paper's hybrid in its four variants under names of their own: two or four signals, the paper's rule or L-BFGS.

Least squares, then a two-layer network on what is left; see `methods.compensated_least_squares`. The linear part is the
paper's (7)-(8) with a constant column, without which a joint that gravity loads has no linear model at all; the network
has biases with L-BFGS, as it would have today.
"""

from __future__ import annotations

from methods.back_propagation import BackPropagation
from methods.compensated_least_squares import CompensatedLeastSquares
from methods.full_batch import FullBatch
from methods.least_squares import LeastSquares
from methods.registry import METHODS
from methods.regressor import VERTICAL
from methods.two_layer_network import FOUR_SIGNALS, TWO_SIGNALS

LINEAR = LeastSquares(columns=VERTICAL)
TAGS = ("single-joint", "hybrid", "network")


@METHODS.register("ls_nn_two_signals", *TAGS)
def two_signals() -> CompensatedLeastSquares:
    """Inputs (q, q') by back-propagation."""
    return CompensatedLeastSquares(LINEAR, TWO_SIGNALS, trainer=BackPropagation())


@METHODS.register("ls_nn_four_signals", *TAGS)
def four_signals() -> CompensatedLeastSquares:
    """Inputs (q, q', q'', q''') by back-propagation."""
    return CompensatedLeastSquares(LINEAR, FOUR_SIGNALS, trainer=BackPropagation())


@METHODS.register("ls_nn_two_signals_lbfgs", *TAGS, "torch")
def two_signals_modern() -> CompensatedLeastSquares:
    """Inputs (q, q') by L-BFGS."""
    return CompensatedLeastSquares(LINEAR, TWO_SIGNALS, trainer=FullBatch(), with_bias=True)


@METHODS.register("ls_nn_four_signals_lbfgs", *TAGS, "torch")
def four_signals_modern() -> CompensatedLeastSquares:
    """Inputs (q, q', q'', q''') by L-BFGS."""
    return CompensatedLeastSquares(LINEAR, FOUR_SIGNALS, trainer=FullBatch(), with_bias=True)
