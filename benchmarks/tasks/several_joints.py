"""The planar pair of joints 1 and 2, coupled through the arm, and the whole arm of four joints."""

from __future__ import annotations

from benchmarks.paper.experiment import PAYLOAD
from benchmarks.tasks.base import Task, register
from benchmarks.tasks.hidden_effects import Hidden
from benchmarks.tasks.recording import Experiment, Noise, Setting

PAIR, ARM = (1, 2), (1, 2, 3, 4)
PAIR_TRAIN = (Experiment("train multisine", "multisine", scale=0.8), Experiment("train series", "fourier", closed=True))
PAIR_HELD_OUT = (
    Experiment("held-out multisine", "multisine", scale=0.8),
    Experiment("held-out series", "fourier", closed=True),
)
ARM_TRAIN = (
    Experiment("train series", "fourier", closed=True),
    Experiment("train faster series", "fourier", closed=True, speed=1.5),
)
ARM_HELD_OUT = (
    Experiment("held-out series", "fourier", closed=True),
    Experiment("held-out faster series", "fourier", closed=True, speed=1.3),
)
FRICTION = "coulomb_friction"


def _add(
    name: str,
    title: str,
    joints: tuple[int, ...],
    tags: set[str],
    train: tuple[Experiment, ...],
    held_out: tuple[Experiment, ...],
    hidden: tuple[tuple[str, int], ...] = (),
    noise: Noise = "low",
) -> None:
    setting = Setting(name, joints, train, held_out, hide=Hidden(hidden) if hidden else None, noise=noise)
    register(Task(name, title, frozenset(tags), joints, setting.make, budget_seconds=240.0))


_add("pair_coupled", "Joints 1 and 2 together, nothing hidden", PAIR, {"pair", "clean"}, PAIR_TRAIN, PAIR_HELD_OUT)
_add(
    "pair_coulomb_friction",
    "Joints 1 and 2 together, friction hidden in both",
    PAIR,
    {"pair", "hidden", "friction"},
    PAIR_TRAIN,
    PAIR_HELD_OUT,
    tuple((FRICTION, joint) for joint in PAIR),
)
_add(
    "pair_joint_flexibility",
    "Joints 1 and 2 together, joint 2 flexible",
    PAIR,
    {"pair", "hidden", "transmission"},
    PAIR_TRAIN,
    PAIR_HELD_OUT,
    (("joint_flexibility", 2),),
)
_add(
    "pair_noise_high",
    "Joints 1 and 2 together, friction hidden in both, high noise",
    PAIR,
    {"pair", "hidden", "noise", "noise-high"},
    PAIR_TRAIN,
    PAIR_HELD_OUT,
    tuple((FRICTION, joint) for joint in PAIR),
    noise="high",
)
_add(
    "pair_beyond_payload",
    f"Joints 1 and 2 together, held out with {PAYLOAD:g} kg at the flange",
    PAIR,
    {"pair", "hidden", "extrapolation"},
    PAIR_TRAIN,
    tuple(Experiment(item.name, item.form, item.scale, closed=item.closed, payload=PAYLOAD) for item in PAIR_HELD_OUT),
    tuple((FRICTION, joint) for joint in PAIR),
)
_add("arm_clean", "The whole arm, nothing hidden", ARM, {"arm", "clean"}, ARM_TRAIN, ARM_HELD_OUT)
_add(
    "arm_coulomb_friction",
    "The whole arm, friction hidden in all joints",
    ARM,
    {"arm", "hidden", "friction"},
    ARM_TRAIN,
    ARM_HELD_OUT,
    tuple((FRICTION, joint) for joint in ARM),
)
