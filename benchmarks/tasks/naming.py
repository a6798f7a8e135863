"""What is hidden? Blind trials of the second world, for methods that name causes (`Fit.causes`).

The joint's family goes round with the seed. A method that names nothing gets its errors measured all the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from benchmarks.tasks.base import Task, TaskData, Truth, register
from methods.base import Cause

if TYPE_CHECKING:
    from benchmarks.blind.trials import Truth as BlindTruth

FIRST_SEED = 4_000_000
"""Seeds of the benchmark's trials are kept apart from those that methods are tuned on."""
KINDS = {
    "clean": "nothing",
    "single": "one effect",
    "pair": "two effects",
    "foreign": "an effect outside the vocabulary, to be called unknown",
    "weak": "one effect near the limit of visibility",
}
SCORES = {"right": 1.0, "unsure": 0.5, "missed": 0.0, "wrong": 0.0}


@dataclass(frozen=True)
class BlindJudge:
    """Judges by the rules of `benchmarks.blind.score.outcome`; the joint counts as well as the name."""

    hidden: BlindTruth

    def __call__(self, verdict: str | None, causes: tuple[Cause, ...]) -> tuple[str, float]:
        """``right``, ``unsure``, ``missed`` or ``wrong``, and its score."""
        from benchmarks.blind.score import outcome

        effects = [
            {"name": cause.effect, "joint": cause.joint, "alternatives": [{"name": rival} for rival in cause.rivals]}
            for cause in causes
        ]
        said = verdict or ("named" if causes else "none")
        word = outcome(self.hidden, {"verdict": said, "effects": effects})
        return word, SCORES[word]


def make(kind: str, seed: int) -> TaskData:
    """A blind trial of one joint."""
    from benchmarks.blind.score import SINGLE_JOINT
    from benchmarks.blind.trials import make_trial

    number = FIRST_SEED + seed
    for offset in range(len(SINGLE_JOINT)):
        try:
            trial = make_trial(number, kind, SINGLE_JOINT[(3 * seed + offset) % len(SINGLE_JOINT)])
            break
        except ValueError:  # this family of machines cannot hide that effect
            continue
    else:
        return make(kind, seed + 1000)
    hidden = tuple((item.hidden.name, item.joint) for item in trial.truth.effects)
    judge = BlindJudge(replace(trial.truth, streams=()))
    return TaskData(trial.train, trial.holdout, Truth({}, hidden), judge=judge)


for kind, title in KINDS.items():
    register(
        Task(
            name=f"naming_{kind}",
            title=f"Name the cause: hidden is {title}",
            tags=frozenset({"naming", "single", "second-world"}),
            joints=(1,),
            make=partial(make, kind),
            budget_seconds=180.0,
            bandwidth=20.0,
        )
    )
