"""Recordings of real machines, where they are on this machine; nothing of the truth is known, others' figures are."""

from __future__ import annotations

from functools import partial

from benchmarks import fingerprint
from benchmarks.tasks.base import Published, Task, TaskData, register
from envs.rigs import rig

JANOT = "Janot, Gautier, Brunot 2019"


def make(name: str, seed: int) -> TaskData:
    """The runs that are fitted and those that are held out; the seed does not matter."""
    machine = rig(name)
    return TaskData(machine.logs("fit"), machine.logs("held_out"))


def missing(name: str) -> str | None:
    """Why the task is skipped on this machine."""
    return None if rig(name).available else f"the recordings are not here; adeptone data fetch {name}"


def files(name: str) -> str:
    """Hash of the recordings."""
    from envs.data_sets import locate

    machine = rig(name)
    if not machine.available:
        return ""
    return fingerprint.file_hash(locate(name, run.file) for run in machine.runs if run.role != "other")


def _emps() -> tuple[Published, ...]:
    table = rig("emps").published()
    runs = [
        Published(model, "simulation_error", value, "free run on the pulses, as published by its authors")
        for model, value in table["free-run position RMSE on the pulses"].items()
    ]
    share = table["Coulomb friction"]["relative_force_error_pulses"]
    return (Published("Coulomb friction, estimation record", "inverse_error_relative", share, JANOT), *runs)


def _add(
    name: str,
    title: str,
    joints: tuple[int, ...],
    bandwidth: float,
    horizons: tuple[float, float, float],
    published: tuple[Published, ...] = (),
) -> None:
    register(
        Task(
            name=name,
            title=title,
            tags=frozenset({"real", "single" if len(joints) == 1 else "pair"}),
            joints=joints,
            make=partial(make, name),
            budget_seconds=240.0,
            horizons_seconds=horizons,
            bandwidth=bandwidth,
            deterministic=True,
            published=published,
            skip=partial(missing, name),
            identity=partial(files, name),
        )
    )


_add("emps", "EMPS: ball screw and carriage", (1,), 30.0, (0.1, 0.5, 2.0), _emps())
_add("xl330", "Dynamixel XL330 with a pendulum", (1,), 20.0, (0.1, 0.3, 1.0))
_add("odrive_cogging", "Direct-drive motor turning slowly", (1,), 20.0, (0.1, 0.5, 2.0))
_add("dfki_double_pendulum", "Double pendulum with quasi-direct drives", (1, 2), 30.0, (0.05, 0.2, 1.0))
