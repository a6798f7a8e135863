"""Plugin files for tests of the benchmark: a task that takes milliseconds, and methods good and bad."""

TINY = """
from functools import partial
import numpy as np
from benchmarks.tasks.base import TASKS, Parameter, Task, TaskData, Truth
from envs.log import JointFacts, Log
from methods.base import State
from methods.joint_model import JointModel

COLUMNS = ("jerk", "acceleration", "velocity")
TRUE = (0.004, 0.4, 0.7)


def record(seed, name):
    rng = np.random.default_rng(seed)
    time = np.arange(1500) / 500.0
    command = sum(np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in (0.7, 1.9, 3.1, 5.3))
    model = JointModel(1, "voltage", COLUMNS, np.array(TRUE))
    motion = model.simulate(time, command[:, None], State.at_rest(0.0))
    facts = (JointFacts(encoder_step=1e-5),)
    return Log(time, command, 1e-5 * np.round(motion.position / 1e-5), facts=facts, name=name)


def make(seed):
    units = ("V s^3/rad", "V s^2/rad", "V s/rad")
    parameters = {n: Parameter(v, u) for n, v, u in zip(COLUMNS, TRUE, units)}
    train, held_out = record([seed, 1], "train"), record([seed, 2], "held out")
    return TaskData((train,), (held_out,), Truth(parameters, (("coulomb_friction", 1),)))


@TASKS.register("tiny", "single", "clean")
def tiny():
    return Task(
        name="tiny", title="A linear joint", tags=frozenset({"single", "clean"}), joints=(1,), make=make,
        budget_seconds=BUDGET, memory_gib=0.5, horizons_seconds=(0.1, 0.3, 1.0),
    )
"""


def task(name: str = "tiny", budget_seconds: float = 60.0) -> str:
    """The source of a task of that name and budget; in one process a name can be registered by one file only."""
    return TINY.replace("tiny", name).replace("BUDGET", repr(budget_seconds))


METHOD = """
from dataclasses import dataclass
import numpy as np
from methods.base import Method
from methods.least_squares import LeastSquares
from methods.registry import METHODS


@METHODS.register("NAME", "single-joint")
@dataclass(frozen=True)
class NAME(Method):
    def fit(self, logs, rng):
        BODY
        return LeastSquares().fit(logs, rng)
"""


def method(name: str, body: str = "pass") -> str:
    """The source of a method that does `body` before it fits like least squares."""
    return METHOD.replace("NAME", name).replace("BODY", body.strip().replace("\n", "\n        "))
