"""One joint of the arm, nothing hidden: what is left is noise and resolution."""

from benchmarks.tasks.base import Task, register
from benchmarks.tasks.recording import Experiment, Setting

TRAIN = (Experiment("train multisine", "multisine"), Experiment("train steps", "steps"))
HELD_OUT = (Experiment("held-out multisine", "multisine"), Experiment("held-out series", "fourier"))
"""Other phases of the same excitation, and another excitation."""

for joint in (1, 2, 3, 4):
    name = f"joint{joint}_clean"
    register(
        Task(
            name=name,
            title=f"Joint {joint}, nothing hidden",
            tags=frozenset({"single", "clean"}),
            joints=(joint,),
            make=Setting(name, (joint,), TRAIN, HELD_OUT).make,
        )
    )
