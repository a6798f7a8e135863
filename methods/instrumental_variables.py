"""Instrumental variables with simulated instruments: IDIM-IV.

a = (Z'Y)^-1 Z'v, where Z is the regressor of a *simulated* motion: the model with the current estimate is driven by the
recorded command, its motion passes the same filters as the measured one, and the estimate is renewed until it settles
(A. Janot, P.-O. Vandanjon, M. Gautier, A generic instrumental variable approach for industrial robot identification,
IEEE Trans. Control Syst. Technol. 22 (2014) 132). The encoder's noise is in Y but not in Z, so that it biases nothing,
whatever the bandwidth.

The original simulates the closed loop with the robot's own controller and reference, which a log does not hold. Here
a slow virtual spring and damper pull the simulated joint towards the recorded one,

    u_s = u + J w_0^2 (q - q_s) + 2 J w_0 (q' - q'_s),   w_0 = 2 pi `pull`,

so that an error of the estimate cannot make the simulation drift away; noise enters Z only through this pull, far
below the band of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import savgol_filter

from envs.log import Array, Log
from methods.base import State
from methods.joint_model import JointModel
from methods.joint_regression import Equations, JointRegression, Preparation
from methods.least_squares import long_run_scatter, solve
from methods.registry import METHODS
from methods.regressor import ColumnName


@METHODS.register("idim_iv", "single-joint", "physics")
@dataclass(frozen=True)
class InstrumentalVariables(JointRegression):
    """pull: of the virtual spring [Hz]; rounds: largest number of renewals; tolerance: of the relative change."""

    preparation: Preparation = field(default_factory=lambda: Preparation(attenuation=2e-3))
    pull: float = 0.1
    rounds: int = 10
    tolerance: float = 1e-4

    def solve(self, equations: Equations) -> tuple[Array, Array, tuple[str, ...]]:
        values, covariance = solve(equations.regressor, equations.command)
        scale = np.linalg.norm(equations.regressor, axis=0)
        for count in range(1, self.rounds + 1):
            instruments = self._instruments(equations, values)
            if instruments is None:
                said = "the simulation of the instruments left all bounds: the estimate is the last one before"
                return values, covariance, (said,)
            size = np.linalg.norm(instruments, axis=0)
            cross = (instruments / np.where(size > 0.0, size, 1.0)).T @ (equations.regressor / scale)
            if np.linalg.cond(cross) > 1e8:
                return values, covariance, ("the instruments do not excite every column: plain least squares",)
            inverse = np.linalg.inv(cross)
            renewed = inverse @ (instruments / size).T @ equations.command / scale
            residuals = equations.command - equations.regressor @ renewed
            scatter = long_run_scatter(instruments / size * residuals[:, None], residuals)
            covariance = inverse @ scatter @ inverse.T / np.outer(scale, scale)
            change = float(np.max(np.abs((renewed - values) * scale)) / np.max(np.abs(renewed * scale)))
            values = renewed
            if change < self.tolerance:
                return values, covariance, (f"the instruments settled after {count} rounds",)
        return values, covariance, (f"the instruments still changed by {change:.1g} after {self.rounds} rounds",)

    def _instruments(self, equations: Equations, values: Array) -> Array | None:
        """The regressor (N, p) of the simulated motion; None when the simulation diverges."""
        pulled = pulled_model(equations, values, self.pull)
        if pulled is None:
            return None
        simulated = [_simulated(log, pulled, self.pull) for log in equations.sources]
        if any(log is None for log in simulated):
            return None
        same = replace(self.preparation, bandwidth=equations.bandwidth, columns=equations.columns)
        return same.equations([log for log in simulated if log is not None]).regressor


def pulled_model(equations: Equations, values: Array, pull: float) -> JointModel | None:
    """The joint with the virtual spring and damper as further columns; None when its inertia is not positive."""
    given = dict(zip(equations.columns, values.tolist(), strict=True))
    inertia, rate = given.get("acceleration", 0.0), 2.0 * np.pi * pull
    if inertia <= 0.0:
        return None
    given["position"] = given.get("position", 0.0) + inertia * rate**2
    given["velocity"] = given.get("velocity", 0.0) + 2.0 * inertia * rate
    columns: tuple[ColumnName, ...] = tuple(given)
    return JointModel(1, "voltage", columns, np.array(list(given.values())), None, equations.reversal_velocity)


def _simulated(log: Log, pulled: JointModel, pull: float) -> Log | None:
    """The log with the positions that the pulled joint takes; None when the simulation diverges."""
    window = min(2 * round(0.025 / log.sample_time) + 5, (len(log) - 1) // 2 * 2 - 1)
    position, velocity, acceleration = (
        savgol_filter(log.position[:, 0], window, 3, deriv=order, delta=log.sample_time) for order in range(3)
    )
    inertia = dict(zip(pulled.columns, pulled.coefficients.tolist(), strict=True))["acceleration"]
    rate = 2.0 * np.pi * pull
    pulling = inertia * rate * (rate * position + 2.0 * velocity)
    start = State(position[0], velocity[0], acceleration[0])
    run = pulled.simulate(log.time, log.command + pulling[:, None], start, log.facts[0].hold)
    if not np.all(np.isfinite(run.position)):
        return None
    return replace(log, position=run.position, velocity=None)
