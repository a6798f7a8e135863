"""The experiment itself: record, fit and score every draw. One draw is one unit of work for one process."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.paper import contestants as names
from benchmarks.paper.contestants import FILTERED, RAW, Contestant, contestants
from benchmarks.paper.evaluation import Errors, Reference, score
from benchmarks.paper.experiment import HELD_OUT, TRAINING, Draw, LogName, Trial, record, trials
from benchmarks.paper.truth import true_coefficients
from envs.log import Array, Log
from methods.base import Fit, State
from methods.compensated_least_squares import CompensatedLeastSquares
from methods.cramer_rao import cramer_rao_bound
from methods.differentiation import BandLimited, Differentiator
from methods.full_batch import FullBatch
from methods.joint_model import JointModel
from methods.least_squares import LeastSquares, condition_number, estimate_history, white_covariance
from methods.network_alone import NetworkAlone
from methods.regressor import HORIZONTAL, ColumnName, column_unit
from methods.two_layer_network import FOUR_SIGNALS

AS_PRINTED = "as printed"


@dataclass(frozen=True)
class Estimator:
    """One way through step 1: which signals, under which excitation, with or without a column for dry friction."""

    name: str
    log: LogName
    differentiator: Differentiator
    friction: bool = False

    def method(self, columns: tuple[ColumnName, ...]) -> LeastSquares:
        """The regression for a joint with these columns."""
        return LeastSquares(self.differentiator, (*columns, "coulomb") if self.friction else columns)


ESTIMATORS: tuple[Estimator, ...] = (
    Estimator(AS_PRINTED, "training sine", RAW),
    Estimator("band-limited", "training sine", FILTERED),
    Estimator("band-limited, multisine", "multisine", FILTERED),
    Estimator("band-limited, multisine, Coulomb column", "multisine", FILTERED, friction=True),
)
"""From the paper's recipe to what it takes to get the parameters right, one change at a time."""

NODES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
"""Hidden nodes tried in the comparison of structures (claim C6)."""


@dataclass(frozen=True)
class ErrorRow:
    """Errors of one contestant on one log of one draw; `joint` is the joint's number."""

    draw: int
    joint: int
    method: str
    log: str
    errors: Errors


@dataclass(frozen=True)
class ParameterRow:
    """One coefficient of one joint by one estimator on one draw.

    `error_if_white`: standard error under independent residuals; `standard_error`: under correlated ones; `bound`:
    Cramer-Rao bound on the standard deviation from the encoder's resolution alone, at the true coefficients. Linear
    quantities in `unit`.
    """

    draw: int
    joint: int
    estimator: str
    column: ColumnName
    unit: str
    truth: float
    estimate: float
    standard_error: float
    error_if_white: float
    bound: float
    condition: float


@dataclass(frozen=True)
class HistoryRow:
    """How the estimates of one draw settle: per estimator, spread of the last half of the record and final error.

    settled: largest distance from the final value within the last half, as a share of the final value, per column;
    off: final value over truth minus 1, per column.
    """

    draw: int
    estimator: str
    settled: tuple[float, ...]
    off: tuple[float, ...]


@dataclass(frozen=True)
class StructureRow:
    """Training error (root mean square over that of the command) with a number of hidden nodes, claim C6."""

    draw: int
    nodes: int
    beside_model: float
    alone: float


@dataclass(frozen=True)
class OptimalityRow:
    """Claim C7 on one draw: how far from least the sum of squares is, and whether "best" means right.

    lowered: largest relative fall of the sum of squares over random changes of the estimate (0: none found);
    raw_error, filtered_error: error on the reference signals of the estimate from raw and from filtered signals [V].
    """

    draw: int
    lowered: float
    raw_error: float
    filtered_error: float


@dataclass(frozen=True, eq=False)
class Showcase:
    """What the figures need of one log. `fits` by contestant; `histories` (N,), (N, p) by estimator.

    truth: empty where nobody knows it. window: free runs start anew so often [s]; None: never.
    """

    log: Log
    fits: Mapping[str, Fit]
    histories: Mapping[str, tuple[Array, Array]]
    truth: Mapping[ColumnName, float]
    filtered: BandLimited = FILTERED
    window: float | None = None


@dataclass(frozen=True, eq=False)
class DrawResult:
    """All rows of one draw; `learning_curves` by contestant; `showcase` of draw 0 only."""

    draw: int
    errors: tuple[ErrorRow, ...]
    parameters: tuple[ParameterRow, ...]
    histories: tuple[HistoryRow, ...]
    structures: tuple[StructureRow, ...]
    optimality: OptimalityRow
    learning_curves: Mapping[str, Array]
    showcase: Showcase | None


def run_draws(members: Sequence[Draw], jobs: int, structure_draws: int) -> Iterator[DrawResult]:
    """Results in the order of the draws; the first `structure_draws` also compare network structures."""
    from joblib import Parallel, delayed

    work = (delayed(run_draw)(draw, draw.number < structure_draws) for draw in members)
    yield from Parallel(n_jobs=jobs, return_as="generator")(work)


def run_draw(draw: Draw, compare_structures: bool) -> DrawResult:
    """Everything about one draw."""
    errors: list[ErrorRow] = []
    parameters: list[ParameterRow] = []
    for joint, setup in draw.setups.items():
        if joint != 1:
            sine, multisine = (record(trial, draw.seed) for trial in trials(draw, joint, (TRAINING, "multisine")))
            logs: dict[str, Log] = {TRAINING: sine, "multisine": multisine}
            parameters += parameter_rows(draw, joint, logs)
            chosen = [
                item
                for item in contestants(setup.columns)
                if item.name in (names.LS_RAW, names.LS, names.PRINTED, names.HYBRID)
            ]
            errors += error_rows(draw, joint, fit_all(chosen, sine, draw.seed), logs)
    first = {trial.name: trial for trial in trials(draw, 1, (TRAINING, *HELD_OUT))}
    logs = {name: record(trial, draw.seed) for name, trial in first.items()}
    parameters = parameter_rows(draw, 1, logs) + parameters
    fits = fit_all(contestants(draw.setups[1].columns), logs[TRAINING], draw.seed)
    errors = error_rows(draw, 1, fits, logs) + errors
    columns = draw.setups[1].columns
    histories = {item.name: history(item.method(columns), logs[item.log]) for item in ESTIMATORS}
    truth = true_coefficients(draw.robot, 1, first[TRAINING].pose)
    return DrawResult(
        draw=draw.number,
        errors=tuple(errors),
        parameters=tuple(parameters),
        histories=tuple(history_row(draw.number, name, item[1], truth) for name, item in histories.items()),
        structures=tuple(structure_rows(draw, logs[TRAINING])) if compare_structures else (),
        optimality=optimality(draw, fits, logs[TRAINING]),
        learning_curves={name: fit.learning_curve for name, fit in fits.items() if len(fit.learning_curve)},
        showcase=Showcase(logs[TRAINING], fits, histories, truth) if draw.number == 0 else None,
    )


def fit_all(chosen: Sequence[Contestant], log: Log, seed: int) -> dict[str, Fit]:
    """Every contestant on one log, each with a generator of its own that depends on seed and name only."""
    return {item.name: item.method.fit([log], np.random.default_rng([seed, *item.name.encode()])) for item in chosen}


def error_rows(draw: Draw, joint: int, fits: Mapping[str, Fit], logs: Mapping[str, Log]) -> list[ErrorRow]:
    """Scores of all fits, and of the true coefficients, on all logs of a joint."""
    (trial,) = trials(draw, joint, (TRAINING,))
    models = {name: fit.model for name, fit in fits.items()}
    models[names.NOMINAL] = true_model(trial)
    rows = []
    for log_name, log in logs.items():
        reference = Reference.of(log)
        rows += [ErrorRow(draw.number, joint, name, log_name, score(item, reference)) for name, item in models.items()]
    return rows


def true_model(trial: Trial) -> JointModel:
    """The joint's linear part with its true coefficients."""
    truth = true_coefficients(trial.robot, trial.setup.joint, trial.pose)
    columns = trial.setup.columns
    return JointModel(trial.setup.joint, "voltage", columns, np.array([truth[name] for name in columns]))


def parameter_rows(draw: Draw, joint: int, logs: Mapping[str, Log]) -> list[ParameterRow]:
    """Step 1 by all estimators against the truth."""
    (trial,) = trials(draw, joint, (TRAINING,))
    columns = draw.setups[joint].columns
    model = true_model(trial)
    bounds = {name: _encoder_bound(model, logs[name]) for name in {item.log: None for item in ESTIMATORS}}
    rows = []
    for item in ESTIMATORS:
        log = logs[item.log]
        method = item.method(columns)
        problem = method.problem([log])
        fit = method.fit([log], np.random.default_rng(draw.seed))
        white = np.sqrt(np.diag(white_covariance(problem.regressor, fit.residuals)))
        rows += [
            ParameterRow(
                draw=draw.number,
                joint=joint,
                estimator=item.name,
                column=column,
                unit=column_unit(column, log.facts[0]),
                truth=float(model.coefficients[k]),
                estimate=float(fit.estimates.values[k]),
                standard_error=float(fit.estimates.standard_errors[k]),
                error_if_white=float(white[k]),
                bound=float(bounds[item.log][k]),
                condition=condition_number(problem.regressor),
            )
            for k, column in enumerate(columns)
        ]
    return rows


def _encoder_bound(model: JointModel, log: Log) -> Array:
    """Cramer-Rao bound on the standard deviations of the coefficients, (p,), from the encoder's step alone."""
    deviation = (log.facts[0].encoder_step or 0.0) / np.sqrt(12.0)
    return np.sqrt(np.diag(cramer_rao_bound(model, log, State.at_rest(log.position[0]), deviation)))


def history(method: LeastSquares, log: Log) -> tuple[Array, Array]:
    """Numbers of samples (N,) and estimates (N, p) after each of them."""
    problem = method.problem([log])
    samples = np.arange(1, len(problem.command) + 1, dtype=np.float64)
    return samples, estimate_history(problem.regressor, problem.command)


def history_row(draw: int, name: str, estimates: Array, truth: Mapping[ColumnName, float]) -> HistoryRow:
    """How a history of joint 1 settles."""
    final = estimates[-1]
    late = estimates[len(estimates) // 2 :]
    settled = np.max(np.abs(late / final - 1.0), axis=0)
    true = np.array([truth[column] for column in HORIZONTAL])
    return HistoryRow(
        draw, name, tuple(settled[: len(true)].tolist()), tuple((final[: len(true)] / true - 1.0).tolist())
    )


def structure_rows(draw: Draw, log: Log) -> Iterator[StructureRow]:
    """The same network, inputs and optimiser, once beside the identified model and once alone."""
    step_1 = LeastSquares(FILTERED, draw.setups[1].columns)
    scale = float(np.std(FILTERED.signals(log).command))
    for nodes in NODES:
        beside = CompensatedLeastSquares(step_1, FOUR_SIGNALS, nodes, FullBatch(), with_bias=True)
        alone = NetworkAlone(FILTERED, FOUR_SIGNALS, nodes, FullBatch())
        residuals = [
            method.fit([log], np.random.default_rng([draw.seed, nodes])).residuals for method in (beside, alone)
        ]
        yield StructureRow(draw.number, nodes, *(float(np.std(part)) / scale for part in residuals))


def optimality(draw: Draw, fits: Mapping[str, Fit], log: Log) -> OptimalityRow:
    """Tries 2000 random changes of the estimate on the very signals it was fitted to."""
    problem = LeastSquares(RAW, draw.setups[1].columns).problem([log])
    estimate = fits[names.LS_RAW].estimates.values
    rng = np.random.default_rng(draw.seed)
    changes = 10.0 ** rng.uniform(-6.0, 0.0, (2000, 1)) * rng.normal(size=(2000, 3)) * np.abs(estimate)
    gram = problem.regressor.T @ problem.regressor
    moment = problem.regressor.T @ problem.command
    slope = gram @ estimate - moment
    least = float(np.sum((problem.command - problem.regressor @ estimate) ** 2))
    rises = 2.0 * changes @ slope + np.einsum("ki,ij,kj->k", changes, gram, changes)
    reference = Reference.of(log)
    inverse = {name: score(fits[name].model, reference).inverse for name in (names.LS_RAW, names.LS)}
    return OptimalityRow(draw.number, max(0.0, float(-np.min(rises))) / least, inverse[names.LS_RAW], inverse[names.LS])
