"""The model that all single-joint contestants of the paper share: linear columns plus a network, equation (6).

F = a1 q''' + a2 q'' + a3 q' + a4 + a5 tanh(q'/w) + a6 q + a7 sin q + a8 cos q + N(q, q', q'', q''') - u
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from envs.log import Array
from methods.base import Motion
from methods.equation import EquationModel
from methods.joint_equation import joint_balance
from methods.regressor import COLUMN_ORDER, ColumnName, regressor
from methods.two_layer_network import TwoLayerNetwork


@dataclass(frozen=True, eq=False)
class JointModel(EquationModel):
    """Linear part v1 = Y a, shape (p,) coefficients in the order of `columns`, and compensator v2 (None: v2 = 0).

    reversal_velocity: w of the Coulomb column [rad/s or m/s].
    """

    columns: tuple[ColumnName, ...]
    coefficients: Array
    network: TwoLayerNetwork | None = None
    reversal_velocity: float = 1e-3

    @property
    def balance(self) -> Callable[[Array, float, float, float, float, float], float]:
        return joint_balance

    @cached_property
    def parameters(self) -> Array:
        by_column = dict(zip(self.columns, self.coefficients.tolist(), strict=True))
        linear = [by_column.get(name, 0.0) for name in COLUMN_ORDER]
        network = np.zeros(3) if self.network is None else self.network.flat
        return np.concatenate((linear, [self.reversal_velocity], network))

    def linear_part(self, motion: Motion) -> Array:
        """v1 = Y a, shape (T,)."""
        return regressor(motion, self.columns, self.reversal_velocity) @ self.coefficients

    def compensation(self, motion: Motion) -> Array:
        """v2, shape (T,); zero without a network."""
        return np.zeros(len(motion)) if self.network is None else self.network(motion)
