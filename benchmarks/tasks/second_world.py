"""Other machines, in a world that shares no code with the plant: servos, pendulums, rotors and linear stages.

Whoever does well here as on the plant does not owe it to the plant's own way of computing an effect.
"""

from __future__ import annotations

from functools import partial

from benchmarks.tasks.base import Task, TaskData, Truth, register

FIRST_SEED = 3_000_000
"""Seeds of the benchmark's trials are kept apart from those that methods are tuned on."""
MACHINES = {
    "servo": ("a geared hobby servo", "stribeck_friction"),
    "pendulum": ("a torque-driven pendulum", "coulomb_friction"),
    "rotor": ("a current-driven rotor", "cogging_torque"),
    "stage": ("a linear stage", "backlash"),
}


def make(family: str, effect: str | None, seed: int) -> TaskData:
    """A trial of the second world on one family of machines."""
    from benchmarks.blind.trials import make_trial

    kind = "clean" if effect is None else "single"
    trial = make_trial(FIRST_SEED + seed, kind, family, effect=effect)
    hidden = tuple((item.hidden.name, item.joint) for item in trial.truth.effects)
    return TaskData(trial.train, trial.holdout, Truth({}, hidden))


for family, (title, effect) in MACHINES.items():
    for hidden in (None, effect):
        register(
            Task(
                name=f"{family}_{hidden or 'clean'}",
                title=f"{title[:1].upper()}{title[1:]}, {'nothing hidden' if hidden is None else 'hidden: ' + hidden}",
                tags=frozenset({"single", "second-world", "clean" if hidden is None else "hidden"}),
                joints=(1,),
                make=partial(make, family, hidden),
                bandwidth=20.0,
            )
        )
