"""Regenerate the reference of effects, ``docs/effects.md``, from their definitions.

uv run python docs/make_effects.py
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from diagnosis.parameters import JointUnits, canonical, units
from methods.effects import built_in
from methods.effects.base import Effect

PAGE = Path(__file__).parent / "effects.md"
STAGES = ("amplifier", "motor", "transmission", "arm", "sensor")
"""The order of the signal chain."""
VOLTAGE = JointUnits("voltage", "rad", 1.0, 1.0)
"""A revolute joint behind a voltage amplifier whose constants are known."""
OF_THE_WHOLE = {
    "phase": "of the sine, at angle or time zero",
    "amplitude": "of the sine",
    "share": "of the motor torque, amplitude of the sine",
    "stiffness": "torque per deflection",
    "damping": "torque per rate of the deflection",
    "inertia_ratio": "share of the joint's inertia that is behind it",
    "contact_stiffness": "of the flanks when they touch",
    "contact_damping": "of the flanks when they touch",
    "rest_angle": "angle at which it does not pull",
    "static_torque": "level from rest",
    "resistance_rise": "relative, reached in the end",
    "stiffening": "relative growth of the stiffness by the squared deflection",
    "torque": "level or amplitude",
}
"""Meanings of parameters that the report states in other terms than the model's."""
HEAD = r"""# The effects, one by one

What the tool can name, with the equation of every form of it, what the report states, and in which unit. Regenerated
by `uv run python docs/make_effects.py`. How one of them is chosen: [method.md](method.md); how to write your own:
[plugins.md](plugins.md).

**Signs.** A joint obeys $`J\,\ddot q + b\,\dot q + g(q) + \sum\tau = \tau_m`$ with the motor torque $`\tau_m = \alpha
i`$: every $`\tau`$ below **resists**, so that a positive spring, weight, friction or cogging torque brakes a positive
motion. What comes from outside ($`\tau_d`$: disturbances, collisions) **pushes**. $`v`$ is the command as logged,
$`v_a`$ what the amplifier makes of it, $`i`$ the motor's current, $`y`$ the reading, $`q_l`$ the arm's side of a
spring or a play.

**Units.** As for a revolute joint behind a voltage amplifier whose constants a robot description states; with a
linear one N and m, with other drives A or N m for V. Each value is also given as *input-equivalent*, the command that
does the same: all that a log without a description determines. `1/A` is then per unit of the motor torque in the
command's unit.

**Forms** bear one name: which of them the logs prefer does not change what is missing, only its law. The textbook's
comes first. A friction law that stands beside `coulomb_friction` is said without it: `stribeck_friction` and
`presliding_friction` contain it; `friction_asymmetry` is the difference between the directions alone and stands
beside it, and a difference that is viscous only is one, too. A weight that depends on the angle is nominal where a
robot description has gravity, and `gravity_tilt` where nothing states it. An event (`collision`, `payload_change`)
happens once in every log, at an instant of its own, or in one of them; several of one kind in the same log leave
something unexplained.

**What is no effect here.** Nominal parameters that differ from what a description states (`parameter_mismatch`) are not
named: they are refitted always, and the report and `nominal_parameters` in `diagnosis.json` state each of them as
given, refitted, and beside the effects.
"""


def summary(effect: Effect) -> str:
    """First paragraph of the effect's own module."""
    text = inspect.getdoc(importlib.import_module(f"methods.effects.{effect.label}")) or ""
    return " ".join(text.split("\n\n")[0].split())


def stated(effect: Effect) -> str:
    """What the report states of one form, with units and meanings."""
    own = {(parameter.name, parameter.dimension): parameter.meaning for parameter in effect.parameters}
    found = []
    for name, dimension in canonical(effect).dimensions.items():
        unit = units(dimension, VOLTAGE)[0]
        meaning = own.get((name, dimension)) or OF_THE_WHOLE.get(name, "")
        found.append(f"`{name}`" + (f" [{unit}]" if unit != "1" else "") + (f": {meaning}" if meaning else ""))
    return "; ".join(found).replace("|", "\\|")


def rows(forms: Sequence[Effect]) -> list[str]:
    """One row of a table per equation; further instances and the other side of the encoder have the same."""
    found: dict[tuple[str, str], list[Effect]] = {}
    for form in forms:
        found.setdefault((form.equation, stated(form)), []).append(form)
    lines = []
    for (equation, said), alike in found.items():
        notes = []
        if any(form.name.endswith("load_side") for form in alike):
            notes.append("encoder on either side")
        several = sum(form.name.rpartition("_")[2].isdigit() for form in alike)
        if several:
            notes.append(f"up to {several + 1} of them")
        if any(form.on_the_arm for form in alike):
            notes.append("second joint of a planar arm")
        if len(alike[0].inputs) < 3:
            notes.append("voltage drives only")
        equation = equation.replace("|", r"\vert ")
        lines.append(f"| $`{equation}`$ | {said} | {', '.join(notes)} |")
    return lines


def page() -> str:
    """The whole page."""
    text = [HEAD]
    effects = sorted(built_in(), key=lambda e: (STAGES.index(e.stage), e.label, e.name != e.label, e.name))
    for stage, of_stage in groupby(effects, key=lambda e: e.stage):
        text.append(f"## {stage.capitalize()}\n")
        for label, forms in groupby(of_stage, key=lambda e: e.label):
            every = list(forms)
            text += [f"### `{label}`", f"{summary(every[0])} ({every[0].source})\n"]
            text += ["| law | what the report states | |", "|---|---|---|", *rows(every), ""]
    return "\n".join(text).rstrip() + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
