"""Output error: the parameters whose free simulation comes nearest to the recorded position.

    min over p, x_0 of  sum over segments and samples of (q(t) - q_s(t; p, x_0))^2

by Levenberg-Marquardt with bounds on the compiled kernel, which simulates true sticking (L. Ljung, System
Identification, 1999, chapter 7; M. Gautier, A. Janot, P.-O. Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013) 428
for robots). Command noise apart, nothing is differentiated: the encoder's noise stays white and biases nothing.

Each log is cut into segments of `horizon` seconds, whose initial states are estimated along: over a whole log small
errors of the load accumulate without bound in a joint that nothing holds in place. The start is IDIM-LS.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import savgol_filter

from envs.log import Array, JointFacts, Log
from methods.base import Fit, Method, Status
from methods.idim_least_squares import IdimLeastSquares
from methods.joint_model import JointModel
from methods.kernel import BEGINNING, NOMINAL
from methods.least_squares import long_run_scatter
from methods.physical_joint import FRICTION, SIGNED, coefficient_estimates, physical_model, physical_parameters
from methods.registry import METHODS
from methods.structured import StructuredModel
from methods.usable_logs import check_joint

GONE = 1e3
"""Error [rad or m] that stands for a simulation that left all bounds."""


@METHODS.register("output_error", "single-joint", "physics")
@dataclass(frozen=True)
class OutputError(Method):
    """horizon: length of the segments [s]. rate: of the samples that are compared [Hz]. evaluations: at most."""

    start: IdimLeastSquares = field(default_factory=IdimLeastSquares)
    horizon: float = 5.0
    rate: float = 200.0
    evaluations: int = 40

    def fit(self, logs: Sequence[Log], rng: np.random.Generator) -> Fit:
        """Consumes no random numbers. Residuals are those of the position [rad or m]."""
        begin = time.perf_counter()
        joint, facts = check_joint(logs)
        first = self.start.fit(logs, rng)
        assert isinstance(first.model, JointModel)
        guess = physical_parameters(first.model)
        segments = Segments(joint, facts, tuple(logs), self.horizon, self.rate, tuple(guess))
        found = segments.minimised(np.array(list(guess.values())), self.evaluations)
        size = len(guess)
        return Fit(
            model=segments.model(found.x[:size]),
            estimates=coefficient_estimates(
                dict(zip(guess, found.x[:size].tolist(), strict=True)), covariance(found)[:size, :size], facts
            ),
            residuals=found.fun,
            status=Status.ITERATION_LIMIT if found.status == 0 else Status.CONVERGED,
            seconds=time.perf_counter() - begin,
            notes=(f"{found.nfev} simulations of {len(segments.bounds) - 1} segments of up to {self.horizon:g} s",),
        )


def covariance(found: OptimizeResult) -> Array:
    """(J'J)^-1 S (J'J)^-1 with the scatter S of Newey and West: errors of a simulation last for long."""
    scale = np.linalg.norm(found.jac, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = found.jac / scale
    bread = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    scatter = long_run_scatter(scaled * found.fun[:, None], found.fun)
    return bread @ scatter @ bread / np.outer(scale, scale)


@dataclass(frozen=True, eq=False)
class Segments:
    """Segments of logs laid out for the kernel; `names` are the free parameters, followed by (q0, q0') per segment."""

    joint: int
    facts: JointFacts
    logs: tuple[Log, ...]
    horizon: float
    rate: float
    names: tuple[str, ...]

    @cached_property
    def cuts(self) -> tuple[tuple[Log, int, int], ...]:
        """(log, first, last) of every segment."""
        found = []
        for log in self.logs:
            count = max(1, round(log.duration / self.horizon))
            edges = np.linspace(0, len(log), count + 1).astype(int)
            found += [(log, int(a), int(b)) for a, b in pairwise(edges)]
        return tuple(found)

    @cached_property
    def bounds(self) -> np.ndarray:
        """Row (S + 1,) at which each segment begins."""
        return np.cumsum([0, *(last - first for _, first, last in self.cuts)])

    def stacked(self, name: str) -> Array:
        """A signal of all segments, (T,)."""
        return np.concatenate([getattr(log, name).reshape(len(log), -1)[a:b, 0] for log, a, b in self.cuts])

    @cached_property
    def signals(self) -> tuple[Array, Array, Array, Array]:
        """Time (T,), command (T, 1), its integral over samples per segment (T, 1), position (T, 1)."""
        command = self.stacked("command")[:, None]
        held = self.facts.hold == "zero_order"
        total = np.zeros_like(command)
        for a, b in pairwise(self.bounds):
            u = command[a:b]
            total[a + 1 : b] = np.cumsum(u[:-1] if held else 0.5 * (u[:-1] + u[1:]), axis=0)
        return self.stacked("time"), command, total, self.stacked("position")[:, None]

    @cached_property
    def kept(self) -> np.ndarray:
        """Rows that are compared."""
        every = [max(1, round(1.0 / (self.rate * log.sample_time))) for log, _, _ in self.cuts]
        ends = zip(self.bounds[:-1], self.bounds[1:], every, strict=True)
        return np.concatenate([np.arange(a, b, step) for a, b, step in ends])

    def model(self, values: Array) -> StructuredModel:
        """The joint with these values of `names`."""
        return physical_model(self.joint, self.facts, dict(zip(self.names, values.tolist(), strict=True)), self.logs)

    def errors(self, vectors: Array) -> Array:
        """Recorded less simulated position (C, N) of candidates (C, P + 2 S)."""
        base = self.model(np.ones(len(self.names)))
        table, switches, _, rigid = base.arrays
        count, segments = len(vectors), len(self.cuts)
        columns = [base.kernel.offsets[n] if n == FRICTION else NOMINAL.index(n) for n in self.names]
        parameters = np.tile(table, (count, segments, 1, 1))
        parameters[..., columns] = vectors[:, None, None, : len(columns)]
        starts = np.zeros((count, segments, 1, len(BEGINNING)))
        starts[:, :, 0, :2] = vectors[:, len(columns) :].reshape(count, segments, 2)
        t, u, total, y = self.signals
        emf = parameters[:, :, 0, NOMINAL.index("back_emf")]
        starts[:, :, 0, 2] = u[self.bounds[:-1], 0] - emf * starts[:, :, 0, 1]  # the torque has settled
        out = np.empty((count, len(t), 1))
        base.kernel.batch(
            t, u, total, np.array([0 if self.facts.hold == "zero_order" else 1]), y,
            np.zeros((0, 1, 3)), np.zeros((0, 0, 1)), self.bounds, starts, parameters,
            np.tile(switches, (count, 1, 1)), False, np.tile(rigid, (count, 1)), 0.0, 0.0, base.substeps, out,
        )  # fmt: skip
        return np.nan_to_num(np.clip(out[:, self.kept, 0], -GONE, GONE), nan=GONE)

    def minimised(self, guess: Array, evaluations: int) -> OptimizeResult:
        """The optimum from a guess of the parameters; initial states start at the smoothed measurement."""
        states = []
        for log, first, _ in self.cuts:
            window = min(2 * round(0.025 / log.sample_time) + 5, (len(log) - 1) // 2 * 2 - 1)
            for order in range(2):
                smooth = savgol_filter(log.position[:, 0], window, 3, deriv=order, delta=log.sample_time)
                states.append(smooth[first])
        start = np.concatenate((guess, states))
        typical = self.typical(guess)
        least = np.full(len(start), -np.inf)
        for k, name in enumerate(self.names):
            if name not in SIGNED:
                least[k] = 0.0
            if name in ("inertia", "electrical_time_constant"):
                least[k] = 1e-3 * start[k]
        return least_squares(
            lambda x: self.errors(x[None])[0],
            np.maximum(start, least + 1e-9 * typical),
            jac=lambda x: self.jacobian(x, 1e-4 * typical),
            bounds=(least, np.inf),
            x_scale=typical,
            method="trf",
            xtol=1e-7,
            ftol=1e-7,
            max_nfev=evaluations,
        )

    def typical(self, guess: Array) -> Array:
        """Sizes of all unknowns: a parameter's own, or one that moves the command by a tenth of its deviation."""
        t, u, _, y = self.signals
        speed = float(np.std(np.gradient(y[:, 0], t))) if len(t) > 1 else 1.0
        torque = 0.1 * float(np.std(u))
        floors = {"back_emf": torque / max(speed, 1e-12), "viscous": torque / max(speed, 1e-12)}
        size = [max(abs(v), floors.get(n, torque)) if n not in ("inertia", "electrical_time_constant") else v
                for n, v in zip(self.names, guess, strict=True)]  # fmt: skip
        return np.array([*size, *([float(np.std(y)), speed] * len(self.cuts))])

    def jacobian(self, vector: Array, steps: Array) -> Array:
        """Forward differences (N, P + 2 S); the states of all segments are moved at once, each touches its own rows."""
        size = len(self.names)
        moved = np.tile(vector, (size + 3, 1))
        for k in range(size):
            moved[k + 1, k] += steps[k]
        moved[size + 1, size::2] += steps[size::2]
        moved[size + 2, size + 1 :: 2] += steps[size + 1 :: 2]
        outcomes = self.errors(moved)
        changes = outcomes[1:] - outcomes[0]
        segment = np.searchsorted(self.bounds, self.kept, side="right") - 1
        jacobian = np.zeros((len(self.kept), len(vector)))
        jacobian[:, :size] = (changes[:size] / steps[:size, None]).T
        for part in range(2):
            columns = size + 2 * segment + part
            jacobian[np.arange(len(segment)), columns] = changes[size + part] / steps[columns]
        return jacobian
