"""How the experiment decides: noise levels, excitations, and held-out motion beyond the training range. Joints 1 to 4.

Coulomb friction is hidden in all of them: without any misfit every excitation that moves the joint is good enough.
"""

from __future__ import annotations

import numpy as np

from benchmarks.paper.experiment import PAYLOAD
from benchmarks.tasks.base import Task, register
from benchmarks.tasks.hidden_effects import Hidden
from benchmarks.tasks.recording import POSE, Experiment, Noise, Setting
from benchmarks.tasks.single_joint import HELD_OUT, TRAIN

LEVELS: tuple[tuple[Noise, str], ...] = (
    ("low", "the encoder's own resolution, 2 mV of amplifier noise"),
    ("medium", "4 steps of encoder noise, 10 mV of amplifier noise"),
    ("high", "20 steps of encoder noise, 50 mV of amplifier noise"),
)
SERVO = Experiment("train series", "fourier", closed=True)
EXCITATIONS: dict[str, tuple[str, tuple[Experiment, ...]]] = {
    "sine": ("the paper's single sine", (Experiment("train sine", "sine"),)),
    "chirp": ("a chirp", (Experiment("train chirp", "chirp"),)),
    "prbs": ("a random binary sequence", (Experiment("train sequence", "prbs"),)),
    "servo": ("a Fourier series under a position servo", (SERVO,)),
    "short": ("two seconds of a multisine", (Experiment("train multisine", "multisine", duration=2.0),)),
}
SLOW = (Experiment("train multisine", "multisine", speed=0.5), Experiment("train series", "fourier", speed=0.7))
WEAK = (Experiment("train multisine", "multisine", scale=0.4), Experiment("train series", "fourier", scale=0.4))
STRETCHED = (POSE[0], 0.2, *POSE[2:])
FOLDED = (POSE[0], 0.85 * np.pi, *POSE[2:])
BEYOND: dict[str, tuple[str, tuple[int, ...], tuple[Experiment, ...], tuple[Experiment, ...]]] = {
    "amplitude": (
        "held out at two and a half times the training amplitude",
        (1, 2, 3, 4),
        WEAK,
        (Experiment("held-out multisine", "multisine"), Experiment("held-out series", "fourier")),
    ),
    "frequency": (
        "held out at twice the training frequencies",
        (1, 2, 3, 4),
        SLOW,
        (Experiment("held-out multisine", "multisine"), Experiment("held-out series", "fourier", speed=1.4)),
    ),
    "pose": (
        "trained with joint 2 at 90°, held out stretched and folded",
        (1,),
        TRAIN,
        (
            Experiment("held-out stretched", "multisine", pose=STRETCHED),
            Experiment("held-out folded", "multisine", pose=FOLDED),
        ),
    ),
    "payload": (
        f"held out with {PAYLOAD:g} kg at the flange",
        (1, 2),
        TRAIN,
        (
            Experiment("held-out multisine", "multisine", payload=PAYLOAD),
            Experiment("held-out series", "fourier", payload=PAYLOAD),
        ),
    ),
}


def _hidden(joint: int) -> Hidden:
    return Hidden((("coulomb_friction", joint),))


for joint in (1, 2, 3, 4):
    for level, meaning in LEVELS:
        name = f"joint{joint}_noise_{level}"
        setting = Setting(name, (joint,), (SERVO, *TRAIN), HELD_OUT, hide=_hidden(joint), noise=level)
        register(
            Task(
                name=name,
                title=f"Joint {joint}, friction hidden, {level} noise: {meaning}",
                tags=frozenset({"single", "hidden", "noise", f"noise-{level}"}),
                joints=(joint,),
                make=setting.make,
            )
        )
    for word, (title, joints, train, held_out) in BEYOND.items():
        if joint not in joints:
            continue
        name = f"joint{joint}_beyond_{word}"
        register(
            Task(
                name=name,
                title=f"Joint {joint}, friction hidden, {title}",
                tags=frozenset({"single", "hidden", "extrapolation"}),
                joints=(joint,),
                make=Setting(name, (joint,), train, held_out, hide=_hidden(joint)).make,
            )
        )
for word, (title, train) in EXCITATIONS.items():
    name = f"joint1_excited_by_{word}"
    register(
        Task(
            name=name,
            title=f"Joint 1, friction hidden, trained on {title}",
            tags=frozenset({"single", "hidden", "excitation"}),
            joints=(1,),
            make=Setting(name, (1,), train, HELD_OUT, hide=_hidden(1)).make,
        )
    )
