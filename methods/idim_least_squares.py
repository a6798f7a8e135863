"""The textbook method with proper filtering: IDIM-LS.

Least squares on band-passed, decimated signals with the friction terms in the regressor: M. Gautier, ICRA 1997;
M. Gautier, A. Janot, P.-O. Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013) 428.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from envs.log import Array
from methods.joint_regression import Equations, JointRegression, Preparation
from methods.least_squares import solve
from methods.registry import METHODS


@METHODS.register("idim_ls", "single-joint", "physics")
@dataclass(frozen=True)
class IdimLeastSquares(JointRegression):
    """a = (Y'Y)^-1 Y'v on the equations of `preparation`, with the covariance of `methods.least_squares.solve`."""

    preparation: Preparation = field(default_factory=Preparation)

    def solve(self, equations: Equations) -> tuple[Array, Array, tuple[str, ...]]:
        return *solve(equations.regressor, equations.command), ()
