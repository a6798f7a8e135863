"""One compiled simulator for every combination of effects.

The kernel integrates n joints (independent, or the first two as a planar pair) along a log: it predicts the reading,
corrects the predicted angle weakly towards the measurement (a *leak*; with a leak of zero it is a free simulation),
and returns the prediction error. An encoder behind a spring corrects the angles on both of its sides, so that a stiff
spring is none. The equations of the effects are written into its source, one call each behind a
switch, so that any subset runs in the same machine code; the source lives in a cache folder keyed by its contents.

Per joint, in units of the command::

    T_e w' = v_a - c k q' - (1 + rise) w          electrical (T_e = 0: w = (v_a - c k q') / (1 + rise))
    M(q) q'' + h(q, q') + b q' + gravity + torques + friction = gain c w      (c: ripple of the motor constant)
    reading = q + sensor(q)

The planar pair (rigid = p3, unit ratio s of joint 2 to joint 1, shared inertia p2; in units of joint 1)::

    M11 = inertia_1 + p2 + 2 p3 cos q2,  M12 = p2 + p3 cos q2,  M22 = inertia_2 / s

where M22 exceeds p2 by a rotor that turns with joint 2 alone. Behind a spring or a play of a joint lies its share of
inertia_1 or inertia_2; there the arm's equation holds, driven by the torque between the sides. Of p2, what exceeds the
second link's share is that of a rotor r which turns with the first joint, too: its own equation is
``M_r q_r'' + r q1'' = torque``, and joint 1 carries ``r (q1'' + q_r'')``.

`torque_limit` (0: none) is the drive's known current limit; it clamps w where it acts on the arm.

A winding lag that is too short for the steps (a fifth of one) acts as a delay of the command, which is the same to
second order.

Integration: fourth-order Runge-Kutta with the command over each step (hold and delay included) taken as the straight
line that has its mean and its first moment; dry friction is handled by events (a joint stops inside a step, rests while
the other forces stay below the friction level, and breaks away), bristles and the low-pass of the amplifier by their
exact exponential solution.

Candidates, whatever their effects, go eight at a time in the lanes of the processor's vectors, on several logs at once
where these have the same instants (`run_lanes`), to the same bits as one at a time (`run`, for any number of joints).
"""

from __future__ import annotations

import hashlib
import inspect
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from envs.log import Array
from methods.compiling import compile_lanes, compile_plainly, generated, once_per_machine
from methods.effects.base import Effect
from methods.joint_equation import network_value
from methods.parallel import each

SHAPES = 6
"""Torques of unknown size beside the one that a description of the whole arm gives."""
NOMINAL = (
    "inertia",
    "viscous",
    "back_emf",
    "electrical_time_constant",
    "gravity_sine",
    "gravity_cosine",
    "load",
    "torque_square_mean",
    "torque_limit",
    "timing",
    "stepping",
    "following",
    "arm_viscous",
    "arm_friction",
    "arm",
    *(f"arm_shape_{i + 1}" for i in range(SHAPES)),
)
"""Nominal parameters of a joint, the first columns of the parameter array.

timing: by how much the command acts after it is logged [s], negative in the logs of simulators that step before they
read. stepping: 1 for a simulator that takes one semi-implicit Euler step per sample, friction by the sign of the
velocity before it, else 0. following: share of the prediction's error before a step that is added to the position in
the laws of the motor's position; 1 where they see the readings, 0 where the prediction. In free simulation there is
nothing to follow. arm_viscous: viscous friction behind a spring or a play; without one it adds to the other.
arm_friction: share of dry friction and of what resists by the velocity that acts behind a spring or a play.
"""
DAMPING = ("viscous", "back_emf", "arm_viscous")
"""Nominal parameters that add up to a joint's damping."""
STATES = 8
"""States of a joint: angle, velocity, motor torque, command behind the amplifier's lag, relative rise of resistance,
angle and velocity of the arm, what the laws of the motor's position add to it."""
BEGINNING = ("angle", "velocity", "motor torque", "twist", "twist rate", "heat")
"""What a joint begins a log with: angle and velocity of the encoder's side, motor torque, by how much the motor's angle
and velocity exceed the arm's where there is a spring or a play, beyond the twist in which the arm hangs, and by what
share the resistance exceeds that of a cold winding where it drifts."""
LANES = 8
"""Candidates of a single joint that are simulated at once."""
WIDE = 16
"""Joints of planar pairs that are simulated at once, those of half as many candidates: their equations are longer, and
more of them at once hide how long each takes."""
LANE_ROWS = (
    *("Q", "DQ", "W", "HEAT", "QL", "DQL", "Z", "LAG"),
    *("QS", "WS", "HEATS", "QLS"),
    *("DQS", "DDQ", "DW", "DHEAT", "DQLS", "DDQL"),
    *(f"FIRST_{name}" for name in ("Q", "DQ", "W", "HEAT", "QL", "DQL")),
    *(f"SUM_{name}" for name in ("Q", "DQ", "W", "HEAT", "QL", "DQL")),
    *("MOBILITY", "VISCOUS", "EMF", "ELECTRICAL", "LIMIT", "SHARE", "OMEGA", "DAMPING", "HALF", "CONSTANT", "LATE"),
    *(
        "TURNED",
        "ERROR",
        "OUTER",
        "KNOWN",
        "RESIST",
        "BRISTLE",
        "PLACE",
        "PACE",
        "ARM",
        "HELD",
        "GRIP",
        "FIXED",
        "WEIGHT",
    ),
    *("MEAN", "RISE", "U", "SUM", "R", "LEVEL", "TORQUE"),
    *("SPAN", "LEFT", "BEGIN", "AHEAD", "T", "STEP", "SIGN", "FREE", "DRY", "STOPPED", "TOTAL", "REVERSED"),
    *("COMMAND", "READING", "BESIDE", "ADDED", "COUPLING", "RATIO", "SHARED", "TURN"),
    *("FIRST_INERTIA", "CROSS", "SECOND_INERTIA", "COUPLED", "HUNG_SINE", "HUNG_COSINE"),
    *("PARTED", "SPRING", "GIVEN", "BEHIND", "DRIVE", "ANGLE", "RATE", "ROTOR", "TURNING", "STEEP", "STIFFENED"),
    *("LOADED", "INSTANT", "SUDDEN", "EVERY", "SEEN", "TIED", "LAGGED", "LAG_TIME"),
    *("COMMANDED", "GIVEN_FIRST", "GIVEN_HIGH", "GIVEN_LOW", "JUMPED"),
    *("MINE", "OWN_STEP", "PER_STEP", "QUICK", "PUSHED", "DQ_BEFORE", "DQL_BEFORE"),
    *("DRAWN", "BEFORE", "CURRENT_FIRST", "CURRENT_HIGH", "CURRENT_LOW"),
    *("WARM", "WARMER", "WARMING_TIME", "COPPERED", "STEADIED", "MEAN_SQUARE"),
)
"""Rows of the lanes' scratch: states, states within a step, their rates, the same at its beginning and summed over its
stages, in the same order, then what the lanes need once; those of the parameters follow."""
STANDING = ("INERTIA", "LOAD", "GRAVITY_SINE", "GRAVITY_COSINE", "FOLLOWING", "ARM_VISCOUS", "ARM_FRICTION")
"""Nominal parameters that lanes read where they stand among the others."""
IN_LANES = {
    "math.sin(": "_sine(",
    "math.cos(": "_cosine(",
    "math.exp(": "_exponential(",
    "math.tanh(": "_hyperbolic_tangent(",
    "math.pow(abs(": "_power(abs(",
}
"""Functions in effects that the template replaces by arithmetic of its own, of which all lanes have their share at
once."""
BESIDE_THE_ARM = {
    "position": "arm",
    "elapsed time": "arm",
    "another joint": "arm",
    "velocity": "drag",
    "direction": "drag",
}
"""Places in the template of torques on the arm, by what they follow."""
STRUCTURAL = {
    "amplifier_lag": "LAG",
    "input_delay": "DELAY",
    "thermal_drift": "THERMAL",
    "thermal_drift_copper": "COPPER",
    "thermal_drift_steady": "STEADY",
    "torque_ripple_reciprocal": "RIPPLE",
    "joint_flexibility": "FLEX",
    "joint_flexibility_load_side": "FLEX_LOAD",
    "joint_flexibility_stiffening": "STIFFENING",
    "joint_flexibility_stiffening_load_side": "STIFFENING_LOAD",
    "backlash": "PLAY",
    "backlash_load_side": "PLAY_LOAD",
    "backlash_power": "PLAY_POWER",
    "presliding_friction": "BRISTLE",
    "presliding_friction_power": "DAHL",
    "presliding_friction_stribeck": "LUGRE",
    "payload_change": "PAYLOAD",
    "payload_change_weighed": "WEIGHED",
    "payload_change_carried": "CARRIED",
    "payload_change_hung": "HUNG",
    "payload_change_at_rest": "RESTED",
    "payload_change_weighed_at_rest": "RESTED_WEIGHED",
    "payload_change_carried_at_rest": "RESTED_CARRIED",
    "payload_change_hung_at_rest": "RESTED_HUNG",
    "rounded_coulomb_friction": "ROUND",
    "tapered_coulomb_friction": "TAPER",
    "rounded_stribeck_friction": "BLEND",
    "constrained_coulomb_friction": "YIELD",
    "gravity_tilt": "TILT",
    "link_load_dependent_friction": "CARRY",
}
"""Effects that need states, time shifts or finer steps and are therefore known by name in the template below."""


def cache_folder() -> Path:
    """Folder for generated sources and machine code: ADEPTONE_CACHE, the user's cache, or a temporary one."""
    candidates = [os.environ.get("ADEPTONE_CACHE"), os.environ.get("XDG_CACHE_HOME"), str(Path.home() / ".cache")]
    for base in filter(None, candidates):
        folder = Path(base) / "adeptone"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix="adeptone"))


@dataclass(frozen=True)
class Kernel:
    """Compiled simulator for a fixed, ordered set of effects.

    `offsets[name]` is the first column of an effect's parameters, `switches[name]` its column in the switch array.
    lanes: joints that are simulated at once.
    """

    effects: tuple[Effect, ...]
    lanes: int = LANES

    @cached_property
    def of_pairs(self) -> Kernel:
        """The same for planar pairs, with lanes for more joints."""
        return replace(self, lanes=WIDE)

    @cached_property
    def offsets(self) -> dict[str, int]:
        starts = np.cumsum([len(NOMINAL), *(effect.size for effect in self.effects)])
        return {effect.name: int(start) for effect, start in zip(self.effects, starts, strict=False)}

    @property
    def columns(self) -> int:
        """Number of parameters per joint."""
        return len(NOMINAL) + sum(effect.size for effect in self.effects)

    def own(self, effect: Effect) -> slice:
        """Columns of an effect's parameters."""
        first = self.offsets[effect.name]
        return slice(first, first + effect.size)

    def column(self, effect: Effect, parameter: str) -> int:
        """Column of one of an effect's parameters."""
        return self.offsets[effect.name] + [p.name for p in effect.parameters].index(parameter)

    @cached_property
    def switches(self) -> dict[str, int]:
        return {effect.name: column for column, effect in enumerate(self.effects)}

    @cached_property
    def source(self) -> str:
        """Text of the generated module."""
        return _source(self)

    @cached_property
    def path(self) -> Path:
        """File of the generated module; its name is a hash of its text."""
        return cache_folder() / f"kernel_{hashlib.sha256(self.source.encode()).hexdigest()[:16]}.py"

    @property
    def is_new(self) -> bool:
        """Whether it has never been used here: its first use compiles for one or two minutes."""
        return not self.path.exists()

    @cached_property
    def module(self) -> ModuleType:
        """The generated module, compiled on first use and kept on disk."""
        path = self.path
        if self.is_new:
            handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
            with os.fdopen(handle, "w") as file:
                file.write(self.source)
            os.replace(temporary, path)
        return generated(path)

    def steps(self, parameters: Array, switches: np.ndarray, interval: float, substeps: int) -> int:
        """Steps per interval between samples, of which there are `substeps` or, where something acts within less than
        one, a multiple: parameters (n, columns), switches (n, effects)."""
        return int(self.module._steps(parameters, switches, interval, substeps))

    def motion(self, *arguments: Any) -> None:
        """The generated `run`, which also writes the motion, by its quicker twin where that is about a single joint."""
        if arguments[1].shape[1] > 1:
            self.module.run(*arguments)
            return
        *signals, extra, start, parameters, on, pair, rigid, leak, rate_leak, substeps, out, motion = arguments
        self.prepare(1)
        extra = np.zeros((0, 0, 1)) if not len(extra) else extra[None]
        bounds = np.array([0, len(signals[0])])
        model = (start[None, None], parameters[None, None], on[None], pair, rigid[None])
        self._in_lanes(
            *signals, extra, bounds, *model, leak, rate_leak, substeps, out[None], motion[None, :, 0], 0, 1, 0, 1
        )

    def _in_lanes(self, *arguments: Any) -> None:
        """The generated `batch_one` or `batch_pair`."""
        function = self.module.batch_one if arguments[1].shape[1] == 1 else self.module.batch_pair
        function(*arguments)

    def prepare(self, joints: int) -> None:
        """Have what simulates several candidates of a single joint or of a planar pair at once compiled and, once per
        machine, compared with what simulates one at a time (`methods.lane_check`)."""
        if joints in self._prepared:
            return
        own, name = (self, "batch_one") if joints == 1 else (self.of_pairs, "batch_pair")

        def compile_and_check() -> None:
            from methods.lane_check import Check

            check = Check.of(self, joints)
            own.begin_a_lane()
            compile_lanes(own.module, name, wide=own.lanes > LANES)
            if not check.holds(self):
                compile_plainly(own.module, name)

        once_per_machine(own.path, name, compile_and_check)
        compile_lanes(own.module, name, wide=own.lanes > LANES)
        self._prepared.add(joints)

    def begin_a_lane(self) -> None:
        """Has what lanes begin with compiled by itself, before the rest is compiled into instructions for several:
        else LLVM leaves out the velocities."""
        module, switches = self.module, np.zeros((1, len(self.effects)), dtype=bool)
        signals = np.zeros((1, len(BEGINNING))), np.zeros((1, 2))[:, 0], np.zeros(1, dtype=np.int64)
        scratch = np.zeros(module.ROWS * self.lanes), np.zeros((1, module.STEP + 1))
        found = np.zeros((1, 5), dtype=bool), np.zeros(1, dtype=bool)
        module._begin_lanes(*signals, np.ones((1, self.columns)), switches, 1.0, *scratch, *found)

    @cached_property
    def _prepared(self) -> set[int]:
        """Numbers of joints that `prepare` has seen to."""
        return set()

    def batch(self, *arguments: Any) -> None:
        """The generated function of the same name, its C L runs spread over all cores, compiled and checked before."""
        joints = arguments[1].shape[1]
        if joints == 1 or (joints == 2 and arguments[11] and not len(arguments[5])):
            self.prepare(joints)
        self.spread(*arguments)

    def spread(self, *arguments: Any) -> None:
        """`batch` by what is compiled.

        Those of a single joint or of a planar pair share lanes over all logs that have the same instants; how many
        cores there are makes no difference to that.
        """
        command, neighbour, bounds, starts, parameters, pair = (arguments[i] for i in (1, 5, 7, 8, 9, 11))
        count, logs, joints = len(parameters), len(bounds) - 1, command.shape[1]
        if starts.shape != (count, logs, joints, len(BEGINNING)):
            raise ValueError(f"starts of shape {starts.shape} are none of {count} candidates as in BEGINNING")
        nothing = np.zeros((0, 0, 3))
        if joints == 1:
            alike = [(log, 1) for log in range(logs)] if len(neighbour) else same_instants(arguments[0], bounds)
            runs = [(*own, *span) for own in alike for span in shares(own[1] * count, self.lanes)]
            each(lambda run: self._in_lanes(*arguments, nothing, *run), runs)
        elif pair and joints == 2 and not len(neighbour):
            parted = np.any(arguments[10][:, :, [effect.parts_the_arm for effect in self.effects]], axis=(1, 2))
            ends = [0, *(np.flatnonzero(np.diff(parted)) + 1).tolist(), count]  # stiff ones are quicker by themselves
            wide, runs = self.of_pairs, []
            for first, several in same_instants(arguments[0], bounds):
                parts = [(log * count + a, log * count + b) for log in range(several) for a, b in pairwise(ends)]
                for a, b in parts if len(ends) > 2 else [(0, several * count)]:
                    runs += [(first, several, a + c, a + d) for c, d in shares(b - a, wide.lanes // 2)]
            each(lambda run: wide._in_lanes(*arguments, nothing, *run), runs)
        else:
            each(lambda run: self.module.batch(*arguments, run, run + 1), range(count * logs))


def shares(count: int, most: int) -> list[tuple[int, int]]:
    """First and last of as few spans of so many things as hold `most` each at most."""
    return list(pairwise(np.linspace(0, count, -(-count // most) + 1).astype(int).tolist()))


def same_instants(time: Array, bounds: np.ndarray) -> list[tuple[int, int]]:
    """First log, and how many from there on have the same instants as far as they go, of all logs."""
    found: list[tuple[int, int]] = []
    longest = time[:0]
    for log, (a, b) in enumerate(pairwise(bounds.tolist())):
        own = time[a:b]
        both = min(len(own), len(longest))
        if both and np.array_equal(own[:both], longest[:both]):
            found[-1] = found[-1][0], found[-1][1] + 1
            longest = max(own, longest, key=len)
        else:
            found.append((log, 1))
            longest = own
    return found


def build(effects: Sequence[Effect]) -> Kernel:
    """Kernel for these effects."""
    return Kernel(tuple(effects))


def slot_of(effect: Effect) -> str:
    """The place of an effect's function in the template: torques of the arm's position, of time and of another joint
    act behind the transmission, those of its velocity on either side of it."""
    if effect.slot != "torque" or effect.stage not in ("arm", "transmission"):
        return effect.slot
    return BESIDE_THE_ARM.get(effect.variable, effect.slot)


def acts_on_either_side(effect: Effect) -> bool:
    """Whether an effect is a law of friction of which a share can act behind a spring or a play: not one of bristles,
    which have a state of their own."""
    return slot_of(effect) in ("drag", "friction") or STRUCTURAL.get(effect.name) == "YIELD"


def any_of(columns: Sequence[int]) -> str:
    """Source text that asks whether any of these switches is on."""
    return " or ".join(f"on[{column}]" for column in columns) or "False"


def lane_row(column: int, lanes: int) -> int:
    """Where a parameter of the lanes' candidates begins in their scratch."""
    return (len(LANE_ROWS) + column) * lanes


def _source(kernel: Kernel) -> str:
    """Source text of the kernel: the effects' functions, then the template with one guarded call per effect."""
    functions: list[str] = []
    slots = ("command", "gain", "torque", "arm", "drag", "friction", "sensor")
    calls: dict[str, list[str]] = {slot: [] for slot in slots}
    loops: dict[str, list[str]] = {slot: [] for slot in slots if slot != "sensor"}
    lines = {
        "command": "S[given + l] = {f}(S[given + l], now, S[Q_ + l], S[DQ_ + l], S[current + l], {p})",
        "gain": "S[SUM_ + l] *= {f}(S[T_ + l], S[QS_ + l] + S[BESIDE_ + l], S[DQS_ + l], S[WS_ + l], {p})",
        "torque": "S[SUM_ + l] += {f}(S[T_ + l], S[QS_ + l] + S[BESIDE_ + l], S[DQS_ + l], S[TORQUE_ + l], {x}, {p})",
        "arm": "S[SUM_ + l] += {f}(S[T_ + l], S[PLACE_ + l], S[DQS_ + l], S[WS_ + l], {x}, {p})",
        "drag": "S[SUM_ + l] += {f}(S[T_ + l], S[PLACE_ + l], S[PACE_ + l], S[TORQUE_ + l], {x}, {p})",
        "friction": "S[LEVEL_ + l] += {f}(S[T_ + l], S[PLACE_ + l], S[PACE_ + l], S[TORQUE_ + l], {p})",
    }
    call = {
        "command": "u = {f}(u, t, q, dq, w, p[{o}:{e}])",
        "gain": "g *= {f}(t, q, dq, w, p[{o}:{e}])",
        "torque": "r += {f}(t, q, dq, w, x, p[{o}:{e}])",
        "arm": "r += {f}(t, q, dq, w, x, p[{o}:{e}])",
        "drag": "r += {f}(t, q, dq, w, x, p[{o}:{e}])",
        "friction": "level += {f}(t, q, dq, w, p[{o}:{e}])",
        "sensor": "y += {f}(q, p[{o}:{e}])",
    }
    for column, effect in enumerate(kernel.effects):
        if effect.slot == "structure" or STRUCTURAL.get(effect.name) == "CARRY":
            continue
        assert effect.function is not None, f"effect {effect.name} has no function"
        name = f"_{effect.name}"
        text = inspect.getsource(effect.function)
        text = text.replace(f"def {effect.function.__name__}(", f"def {name}(", 1)
        for function, own in IN_LANES.items():
            text = text.replace(function, own)
        functions.append("@njit(cache=True, forceinline=True, error_model='numpy')\n" + text)
        start = kernel.offsets[effect.name]
        line = call[slot_of(effect)].format(f=name, o=start, e=start + effect.size)
        calls[slot_of(effect)].append(f"    if on[{column}]:\n        {line}")
        if slot_of(effect) in lines:
            own, places = f"p[l, {start}:{start + effect.size}]", range(start, start + effect.size)
            seen = "_seen(S, l, xs, rigid)" if effect.has_neighbour else "xs"
            line = lines[slot_of(effect)].format(f=name, p=own, x=seen)
            loop = f"elif to[{column}]:\n            for l in range(since[{column}], to[{column}]):\n"
            loop += f"                if on[l, {column}]:\n"
            loop += " " * 20 + line
            if effect.slot == "command" or any(own in text for own in IN_LANES.values()):
                # worth the machine code of a loop without branches
                line = lines[slot_of(effect)].format(
                    f=name, p=f"({''.join(f'S[{lane_row(c, kernel.lanes)} + l], ' for c in places)})", x=seen
                )
                if kernel.lanes == LANES:
                    every = f"if all_on[{column}]:\n            for l in range(LANES):\n                {line}\n"
                else:  # all lanes of one joint or of both
                    every = f"if whole[{column}]:\n"
                    for half, begins in (("HALF", f"since[{column}] == 0"), ("HALF, LANES", f"to[{column}] == LANES")):
                        every += f"            if {begins}:\n                for l in range({half}):\n"
                        every += f"                    {line}\n"
                loop = f"{every}        {loop}"
            loops[slot_of(effect)].append(loop.removeprefix("el"))
    template = _TEMPLATE
    for slot, guarded in calls.items():
        columns = [c for c, effect in enumerate(kernel.effects) if slot_of(effect) == slot]
        template = template.replace(f"    #{slot}#", "\n".join(guarded) or "    pass")
        template = template.replace(f"#any_{slot}#", any_of(columns))
    drawing = [c for c, e in enumerate(kernel.effects) if slot_of(e) == "command" and e.has_motor_torque]
    template = template.replace("#any_drawing#", any_of(drawing))
    minding = [c for c, e in enumerate(kernel.effects) if e.has_neighbour]
    template = template.replace("#any_minding#", any_of(minding))
    for slot, looped in loops.items():
        template = template.replace(f"#{slot}_lanes#", "\n        ".join(looped) or "pass")
    for symbol, array, count in (
        ("union", "union", len(kernel.effects)),
        ("common", "common", len(kernel.effects)),
    ):
        values = ", ".join(f"{array}[{i}]" for i in range(count))
        template = template.replace(f"#{symbol}#", f"({values},)")
    lanes, standing = kernel.lanes, partial(lane_row, lanes=kernel.lanes)
    constants = [f"{row}_ = {place} * {lanes}" for place, row in enumerate(LANE_ROWS)]
    constants += [f"LANES, ROWS, STATES = {lanes}, {len(LANE_ROWS) + kernel.columns}, {LANE_ROWS.index('MOBILITY')}"]
    constants += [f"HALF = {lanes // 2}"]
    constants += [f"RATES = {LANE_ROWS.index('FIRST_Q') - LANE_ROWS.index('DQS')}"]
    constants += [f"{row}_ = {standing(NOMINAL.index(row.lower()))}" for row in STANDING]
    constants += [f"FIRST_PARAMETER = {len(LANE_ROWS)}"]
    rippling = kernel.offsets.get("torque_ripple_reciprocal", 0)
    constants += [f"RIPPLE_{part}_ = {standing(rippling + i)}" for i, part in enumerate(("SINE", "COSINE", "CYCLES"))]
    constants += [f"ELECTRICAL_RATE, MOBILITY, STEP = {kernel.columns}, {kernel.columns + 1}, {kernel.columns + 2}"]
    yielding = kernel.offsets.get("constrained_coulomb_friction", 0)
    constants += [f"YIELD_{part}_ = {standing(yielding + i)}" for i, part in enumerate(("LEVEL", "TIME", "SHARE"))]
    for effect_name, symbol in STRUCTURAL.items():
        constants.append(f"{symbol} = {kernel.switches.get(effect_name, -1)}")
        constants.append(f"{symbol}_P = {kernel.offsets.get(effect_name, 0)}")
    functions.append(inspect.getsource(network_value.py_func))
    head = (
        '"""Generated from methods/kernel.py; do not edit."""\n'
        "import math\nimport numpy as np\nfrom numba import njit\n"
    )
    return head + "\n".join(constants) + "\n\n" + "\n\n".join(functions) + "\n" + template


_TEMPLATE = '''
@njit(cache=True, error_model='numpy')
def _put(target, source):
    """One array into another: to compile an assignment of slices takes seconds, for what it says of other shapes."""
    for i in range(len(target)):
        target[i] = source[i]


INERTIA, VISCOUS, BACK_EMF, ELECTRICAL, GRAVITY_SINE, GRAVITY_COSINE, LOAD, SQUARE, LIMIT = range(9)
TIMING, STEPPING, FOLLOWING, ARM_VISCOUS, ARM_FRICTION, ARM = range(9, 15)
Q, DQ, W, A, HEAT, QL, DQL, BESIDE = range(8)
TWIST, TWIST_RATE, WARMTH = range(3, 6)  # columns of what a joint begins with
OTHER, LAGGING, PROMPT = range(3)  # how the motors of all lanes follow their command
ONE_BODY, SPRING, PLAY_BETWEEN = 1, 2, 3  # what these motors move
LIGHT, HEAVY = 1, 2  # whether the arm's position resists, and whether by its weight
BITS = 4503599627370496.0  # 2^52: the last bits of the sum with a whole number are those of this number
SQUARE_ROOT_OF_HALF = 0x3FE6A09E667F3BCD  # its bits
ROUNDED = 6755399441055744.0  # 1.5 * 2^52: what is left of a number after adding and subtracting it is whole
CATCHING_UP = 6.0  # rate at which positions follow the prediction's errors, over that of the leak
LEAST = 0.05  # share of a joint's inertia, or of what is behind its spring or play, that no pose of its arm goes below
SMALL = 1e-3  # share of the inertia behind a spring or a play from which the weight of the arm hangs on it


@njit(cache=True, forceinline=True, error_model='numpy')
def _turned(x):
    """Sine and cosine of what an angle has beyond whole quarter turns; 1 if these are odd; 1 if two or three of them
    lie beyond whole turns.

    Arithmetic alone, so that all lanes go at once: reduction after Cody and Waite, series of the Cephes library.
    """
    n = (x * 0.63661977236758134308 + ROUNDED) - ROUNDED
    r = ((x - n * 1.57079625129699707031) - n * 7.54978941586159635335e-8) - n * 5.39030285815811905290e-15
    z = r * r
    s = 1.58962301576546568060e-10
    s = ((s * z - 2.50507477628578072866e-8) * z + 2.75573136213857245213e-6) * z - 1.98412698295895385996e-4
    s = ((s * z + 8.33333333332211858878e-3) * z - 1.66666666666666307295e-1) * z * r + r
    c = -1.13585365213876817300e-11
    c = ((c * z + 2.08757008419747316778e-9) * z - 2.75573141792967388112e-7) * z + 2.48015872888517045348e-5
    c = ((c * z - 1.38888888888730564116e-3) * z + 4.16666666666665929218e-2) * z * z - 0.5 * z + 1.0
    place = n - 4.0 * ((0.25 * n - 0.375 + ROUNDED) - ROUNDED)
    half = (0.5 * place - 0.25 + ROUNDED) - ROUNDED
    return s, c, place - 2.0 * half, half


@njit(cache=True, forceinline=True, error_model='numpy')
def _sine(x):
    """Sine of an angle of up to 1e8 rad."""
    s, c, odd, half = _turned(x)
    return (1.0 - 2.0 * half) * (odd * c + (1.0 - odd) * s)


@njit(cache=True, forceinline=True, error_model='numpy')
def _cosine(x):
    """Cosine of an angle of up to 1e8 rad."""
    s, c, odd, half = _turned(x)
    return (1.0 - 2.0 * (half + odd - 2.0 * half * odd)) * (odd * s + (1.0 - odd) * c)


@njit(cache=True, forceinline=True, error_model='numpy')
def _exponential(x):
    """e^x of a number between -708 and 709, beyond which it stays as it is there; arithmetic alone, as `_turned`: a
    power of two, and the Cephes library's quotient for what is left over it."""
    x = min(max(x, -708.0), 709.0)
    n = (x * 1.44269504088896338700 + ROUNDED) - ROUNDED
    r = (x - n * 6.93145751953125e-1) - n * 1.42860682030941723212e-6
    z = r * r
    a = r * ((1.26177193074810590878e-4 * z + 3.02994407707441961300e-2) * z + 9.99999999999999999910e-1)
    b = ((3.00198505138664455042e-6 * z + 2.52448340349684104192e-3) * z + 2.27265548208155028766e-1) * z + 2.0
    power = np.int64(np.float64(n + 1023.0 + BITS).view(np.int64) << 52).view(np.float64)
    return (1.0 + 2.0 * a / (b - a)) * power


@njit(cache=True, forceinline=True, error_model='numpy')
def _logarithm(x):
    """ln x of a positive number, about -709 of zero; arithmetic alone: an exponent, and a series in
    (m - 1) / (m + 1) of what is left over it."""
    bits = np.float64(max(x, 2.2250738585072014e-308)).view(np.int64)
    shift = (bits - SQUARE_ROOT_OF_HALF) >> 52  # m lies between the square roots of 1/2 and 2
    m = np.int64(bits - (shift << 52)).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    c = 1.0 / 19.0
    c = ((((c * z + 1.0 / 17.0) * z + 1.0 / 15.0) * z + 1.0 / 13.0) * z + 1.0 / 11.0) * z + 1.0 / 9.0
    c = (((c * z + 1.0 / 7.0) * z + 1.0 / 5.0) * z + 1.0 / 3.0) * z
    return shift * 6.93147180559945309417e-1 + (2.0 * s + 2.0 * s * c)


@njit(cache=True, forceinline=True, error_model='numpy')
def _power(x, y):
    """x^y of a number that is not negative."""
    return _exponential(y * _logarithm(x))


@njit(cache=True, forceinline=True, error_model='numpy')
def _hyperbolic_tangent(x):
    """tanh x, to 1e-16 of one."""
    size = 1.0 - 2.0 / (_exponential(2.0 * abs(x)) + 1.0)
    return (1.0 * (x > 0.0) - 1.0 * (x < 0.0)) * size


@njit(cache=True, forceinline=True, error_model='numpy')
def _command(u, t, q, dq, w, p, on):
    #command#
    return u


@njit(cache=True, forceinline=True, error_model='numpy')
def _gain(t, q, dq, w, p, on):
    g = 1.0
    #gain#
    return g


@njit(cache=True, forceinline=True, error_model='numpy')
def _torque(t, q, dq, w, x, p, on):
    r = 0.0
    #torque#
    return r


@njit(cache=True, forceinline=True, error_model='numpy')
def _arm_effects(t, q, dq, w, x, p, on):
    r = 0.0
    #arm#
    return r


@njit(cache=True, forceinline=True, error_model='numpy')
def _drag(t, q, dq, w, x, p, on):
    r = 0.0
    #drag#
    return r


@njit(cache=True, forceinline=True, error_model='numpy')
def _friction(t, q, dq, w, p, on):
    level = 0.0
    #friction#
    return level


@njit(cache=True, forceinline=True, error_model='numpy')
def _reading(q, p, on):
    y = q
    #sensor#
    return y


@njit(cache=True, forceinline=True, error_model='numpy')
def _held(cumulative, u, s):
    """Integral of the command over samples, from 0 to s (in samples), between which it follows straight lines."""
    last = u.shape[0] - 1
    if s <= 0.0:
        return u[0] * s
    k = int(s)
    if k >= last:
        return cumulative[last] + u[last] * (s - last)
    f = s - k
    return cumulative[k] + u[k] * f + 0.5 * (u[k + 1] - u[k]) * f * f


@njit(cache=True, forceinline=True, error_model='numpy')
def _value(u, s):
    """The command s samples after the first one, along straight lines."""
    k = min(max(int(math.floor(s)), 0), u.shape[0] - 1)
    if s <= 0.0 or k + 1 >= u.shape[0]:
        return u[k]
    return u[k] + (u[k + 1] - u[k]) * (s - k)


@njit(cache=True, error_model='numpy')
def _rise(u, a, b):
    """Rise over [a, b] (in samples, at most one long) of the straight line with the mean and the first moment of a
    command that follows straight lines itself: ``12 / (b - a)^2 int u (x - (a + b) / 2) dx``."""
    length, inner = b - a, math.floor(a) + 1.0
    if inner >= b:
        return _value(u, b) - _value(u, a)
    centre, moment = 0.5 * (a + b), 0.0
    for piece in range(2):
        lo, hi = (a, inner) if piece == 0 else (inner, b)
        part, middle = hi - lo, 0.5 * (lo + hi)
        near = 1e-9 * part  # a corner belongs to both of its sides
        moment += _value(u, middle) * part * (middle - centre)
        moment += (_value(u, hi - near) - _value(u, lo + near)) * part * part / 12.0
    return 12.0 * moment / (length * length)


@njit(cache=True, error_model='numpy')
def _present(on, has):
    """Which slots have any effect: command, gain, torque, friction, drag."""
    has[0] = _commanding(on)
    has[1] = #any_gain#
    has[2] = #any_torque# or _weighing(on)
    has[3] = _dry(on)
    has[4] = #any_drag#


@njit(cache=True, forceinline=True, error_model='numpy')
def _weighing(on):
    """Whether any effect is a torque on the arm behind the transmission."""
    return #any_arm#


@njit(cache=True, forceinline=True, error_model='numpy')
def _dry(on):
    """Whether there is dry friction."""
    return #any_friction#


@njit(cache=True, forceinline=True, error_model='numpy')
def _drawing(on):
    """Whether any effect on the command depends on the current."""
    return #any_drawing#


@njit(cache=True, forceinline=True, error_model='numpy')
def _minding(on):
    """Whether any effect depends on another joint."""
    return #any_minding#


@njit(cache=True, forceinline=True, error_model='numpy')
def _commanding(on):
    """Whether any effect is a law of the command."""
    return #any_command#


@njit(cache=True, forceinline=True, error_model='numpy')
def _sensing(on):
    """Whether any effect is one of the sensor."""
    return #any_sensor#


@njit(cache=True, forceinline=True, error_model='numpy')
def _on_arm(t, q, dq, w, x, p, on, any_effect, coupled):
    """Torque on the arm against its motion that no velocity of it changes: its weight, springs to the world, blows."""
    arm = p[LOAD]
    if any_effect:
        arm += _arm_effects(t, q, dq, w, x, p, on)
    if (p[GRAVITY_SINE] != 0.0 or p[GRAVITY_COSINE] != 0.0) and not coupled:
        arm += p[GRAVITY_SINE] * _sine(q) + p[GRAVITY_COSINE] * _cosine(q)
    return arm


@njit(cache=True, forceinline=True, error_model='numpy')
def _warming_of(p, on):
    """First parameter of what warms the winding, by how much its losses grow with its resistance (0: not at all), and
    whether they are the same all along."""
    if COPPER >= 0 and on[COPPER]:
        return COPPER_P, p[COPPER_P + 2], False
    if STEADY >= 0 and on[STEADY]:
        return STEADY_P, 0.0, True
    return THERMAL_P, 0.0, False


@njit(cache=True, forceinline=True, error_model='numpy')
def _motor(q, dq, w, heat, u, p, on):
    """Electrical side of one joint: (w, w', heat', torque before the effects on its gain)."""
    resistance, heating, constant = 1.0, 0.0, 1.0
    if RIPPLE >= 0 and on[RIPPLE]:
        constant += p[RIPPLE_P] * _sine(p[RIPPLE_P + 2] * q) + p[RIPPLE_P + 1] * _cosine(p[RIPPLE_P + 2] * q)
    emf = constant * p[BACK_EMF] * dq
    if _warming(on):
        resistance += heat
    if p[ELECTRICAL] > 0.0:
        change = (u - emf - resistance * w) * p[ELECTRICAL_RATE]
    else:
        w = u - emf
        if resistance != 1.0:
            w /= resistance
        change = 0.0
    if _warming(on):
        first, curve, steady = _warming_of(p, on)
        losses = 1.0 if steady else w * w / p[SQUARE]
        heating = (p[first] * losses * ((1.0 + curve * heat) / (1.0 + curve * p[first])) - heat) / p[first + 1]
    r = w
    if p[LIMIT] > 0.0:
        r = min(max(w, -p[LIMIT]), p[LIMIT])
    return w, change, heating, r * constant


@njit(cache=True, forceinline=True, error_model='numpy')
def _yielded(r, dq, inertia, own, p, on):
    """Net torque behind a friction that gives way like a constraint, of which a share acts on an inertia."""
    if YIELD >= 0 and on[YIELD]:
        wanted = p[YIELD_P + 2] * (r + inertia * dq / p[YIELD_P + 1])
        level = own * p[YIELD_P]
        r -= min(max(wanted, -level), level)
    return r


@njit(cache=True, forceinline=True, error_model='numpy')
def _carried(r, dq, arm, level, p):
    """Level of dry friction in proportion to the load that an arm is for its transmission: share inertia q'' + arm,
    where inertia q'' is the net torque r less friction of a level, and this one (it lessens what it depends on)."""
    sign = math.copysign(1.0, dq if dq != 0.0 else r)
    load = p[CARRY_P + 1] * (r - sign * level) + arm
    return p[CARRY_P] * abs(load) / (1.0 + p[CARRY_P + 1] * p[CARRY_P] * math.copysign(1.0, load * sign))


@njit(cache=True, forceinline=True, error_model='numpy')
def _chain(t, q, dq, w, heat, viscous, arm, u, x, p, on, has, load, own):
    """Motor and torques of one joint: (w, w', heat', torque on the inertia without dry friction, level of dry
    friction). viscous, arm: friction and torque on the arm as well, where no spring or play is in between; own: share
    of the laws of friction that acts here."""
    w, change, heating, r = _motor(q, dq, w, heat, u, p, on)
    if has[1]:
        r *= _gain(t, q, dq, w, p, on)
    given = r
    r -= viscous * dq + arm + load
    if has[2]:
        r -= _torque(t, q, dq, given, x, p, on)
    if has[4]:
        r -= own * _drag(t, q, dq, given, x, p, on)
    r = _yielded(r, dq, p[INERTIA], own, p, on)
    level = own * _friction(t, q, dq, given, p, on) if has[3] else 0.0
    if CARRY >= 0 and on[CARRY]:
        level += _carried(r, dq, arm, level, p)
    return w, change, heating, r, level


@njit(cache=True, forceinline=True, error_model='numpy')
def _load_side(on):
    """Whether the encoder sits behind the spring or the play."""
    return _tied(on) or (PLAY_LOAD >= 0 and on[PLAY_LOAD])


@njit(cache=True, forceinline=True, error_model='numpy')
def _tied(on):
    """Whether the encoder sits behind the spring."""
    return (FLEX_LOAD >= 0 and on[FLEX_LOAD]) or (STIFFENING_LOAD >= 0 and on[STIFFENING_LOAD])


@njit(cache=True, forceinline=True, error_model='numpy')
def _stiffening(p, on):
    """By how much a spring stiffens per squared twist."""
    first = -1
    if STIFFENING >= 0 and on[STIFFENING]:
        first = STIFFENING_P
    elif STIFFENING_LOAD >= 0 and on[STIFFENING_LOAD]:
        first = STIFFENING_LOAD_P
    if first < 0:
        return 0.0
    stiffness = p[INERTIA] * p[first] * (2.0 * math.pi * p[first + 1]) ** 2
    return p[first + 3] * stiffness * stiffness


@njit(cache=True, forceinline=True, error_model='numpy')
def _flexible(on):
    """Whether the transmission is a spring."""
    return (FLEX >= 0 and on[FLEX]) or (STIFFENING >= 0 and on[STIFFENING]) or _tied(on)


@njit(cache=True, forceinline=True, error_model='numpy')
def _playing(on):
    """Whether the transmission has a play."""
    return (
        (PLAY >= 0 and on[PLAY]) or (PLAY_LOAD >= 0 and on[PLAY_LOAD]) or (PLAY_POWER >= 0 and on[PLAY_POWER])
    )


@njit(cache=True, forceinline=True, error_model='numpy')
def _warming(on):
    """Whether the winding's resistance rises with its heat."""
    return (THERMAL >= 0 and on[THERMAL]) or (COPPER >= 0 and on[COPPER]) or (STEADY >= 0 and on[STEADY])


@njit(cache=True, forceinline=True, error_model='numpy')
def _play_column(on):
    """First parameter of the play, whichever side the encoder is on."""
    if PLAY_POWER >= 0 and on[PLAY_POWER]:
        return PLAY_POWER_P
    return PLAY_LOAD_P if PLAY_LOAD >= 0 and on[PLAY_LOAD] else PLAY_P


@njit(cache=True, forceinline=True, error_model='numpy')
def _share_column(on):
    """Parameter of a spring or a play that says which share of the inertia is behind; undamped frequency and damping
    ratio follow."""
    if FLEX >= 0 and on[FLEX]:
        return FLEX_P
    if FLEX_LOAD >= 0 and on[FLEX_LOAD]:
        return FLEX_LOAD_P
    if STIFFENING >= 0 and on[STIFFENING]:
        return STIFFENING_P
    if STIFFENING_LOAD >= 0 and on[STIFFENING_LOAD]:
        return STIFFENING_LOAD_P
    return _play_column(on) + 1


@njit(cache=True, forceinline=True, error_model='numpy')
def _posed(p, described, on, row, shapes):
    """Torque that the rest of the arm puts on a joint, by a row of its neighbour's motion, known torques and changes of
    the joint's inertia. That changes parameters p from those described: behind a spring or a play it is the arm that
    gets heavier, and stiffness and damping stay."""
    torque, change = 0.0, 0.0
    for i in range(shapes):
        torque += p[ARM + i] * row[3 + i]
        change += p[ARM + i] * row[3 + shapes + i]
    whole = max(described[INERTIA] + change, LEAST * described[INERTIA])
    if _flexible(on) or _playing(on):
        first = _share_column(on)
        behind = described[INERTIA] * described[first]
        arm = max(behind + change, LEAST * behind)
        whole = described[INERTIA] - behind + arm
        slower = math.sqrt(behind / max(arm, 1e-300))
        p[first] = arm / whole
        p[first + 1], p[first + 2] = described[first + 1] * slower, described[first + 2] * slower
    p[INERTIA], p[MOBILITY] = whole, 1.0 / whole
    return torque


@njit(cache=True, forceinline=True, error_model='numpy')
def _present_share(t, p, column):
    """Share of an event that has happened by time t, its instant in a column: within one step, so that it has a
    derivative."""
    return min(max((t - p[column]) / p[STEP] + 0.5, 0.0), 1.0)


MOVING = ((PAYLOAD, PAYLOAD_P), (WEIGHED, WEIGHED_P), (CARRIED, CARRIED_P), (HUNG, HUNG_P))
AT_REST = ((RESTED, RESTED_P), (RESTED_WEIGHED, RESTED_WEIGHED_P), (RESTED_CARRIED, RESTED_CARRIED_P),
           (RESTED_HUNG, RESTED_HUNG_P))
ON_THE_ARM = ((CARRIED, CARRIED_P), (HUNG, HUNG_P), (RESTED_CARRIED, RESTED_CARRIED_P), (RESTED_HUNG, RESTED_HUNG_P))
HANGING = ((HUNG, HUNG_P), (RESTED_HUNG, RESTED_HUNG_P))
LOADS = MOVING + AT_REST
LONG_AGO = -1e300


@njit(cache=True, forceinline=True, error_model='numpy')
def _payload(t, p, on):
    """Inertia that has been picked up by time t."""
    added = 0.0
    for form, first in MOVING:
        if form >= 0 and on[form]:
            added += p[first] * _present_share(t, p, first + 1)
    for form, first in AT_REST:
        if form >= 0 and on[form] and t > p[first + 1]:
            added += p[first]
    return added


@njit(cache=True, forceinline=True, error_model='numpy')
def _load_of(p, on):
    """What `_payload` of a single form depends on: inertia, instant, 1 if it is picked up at once, and how many forms
    there are."""
    inertia, instant, sudden, forms = 0.0, 0.0, 0.0, 0
    for form, first in MOVING:
        if form >= 0 and on[form]:
            inertia, instant, sudden, forms = p[first], p[first + 1], 0.0, forms + 1
    for form, first in AT_REST:
        if form >= 0 and on[form]:
            inertia, instant, sudden, forms = p[first], p[first + 1], 1.0, forms + 1
    return inertia, instant, sudden, forms


@njit(cache=True, forceinline=True, error_model='numpy')
def _laden(S, p, on, n, several):
    """What has been picked up by the lanes (ADDED), by `_payload` if any of them has several forms of it."""
    if several:
        for l in range(n):
            S[ADDED_ + l] = _payload(S[T_ + l], p[l], on[l])
    else:
        for l in range(LANES):
            share = min(max((S[T_ + l] - S[INSTANT_ + l]) / S[EVERY_ + l] + 0.5, 0.0), 1.0)
            there = 1.0 * (S[T_ + l] > S[INSTANT_ + l])
            S[ADDED_ + l] = S[LOADED_ + l] * (S[SUDDEN_ + l] * there + (1.0 - S[SUDDEN_ + l]) * share)


@njit(cache=True, forceinline=True, error_model='numpy')
def _reach(p, on):
    """Of a load at the end of the second link of a planar pair: the first link's length over its own lever."""
    reach = 0.0
    for form, first in ON_THE_ARM:
        if form >= 0 and on[form]:
            reach += p[first + 2]
    return reach


@njit(cache=True, forceinline=True, error_model='numpy')
def _hung(t, p, on):
    """Sine and cosine part of the weight of such a load at time t."""
    for form, first in HANGING:
        if form >= 0 and on[form]:
            share = _present_share(t, p, first + 1)
            return share * p[first + 3], share * p[first + 4]
    return 0.0, 0.0


@njit(cache=True, forceinline=True, error_model='numpy')
def _any_of(forms, on):
    """Whether a load of one of these forms is picked up."""
    for form, _ in forms:
        if form >= 0 and on[form]:
            return True
    return False


@njit(cache=True, forceinline=True, error_model='numpy')
def _grip(t, h, p, on):
    """Inertia of a load that rested and is picked up within a step of h from t on, and how long until then. From here
    on it is there, since the momentum at the end of the step is the same whenever in it that happens."""
    for form, first in AT_REST:
        if form >= 0 and on[form] and t <= p[first + 1] < t + h:
            wait = p[first + 1] - t
            p[first + 1] = LONG_AGO
            return p[first], wait
    return 0.0, 0.0


@njit(cache=True, forceinline=True, error_model='numpy')
def _slowed(t, h, q, dq, ql, dql, p, on):
    """Angles and velocities of motor and arm at the beginning of a step of h, (q, q', q_l, q_l'): where within the step
    the arm picks up a load that rested, the momentum of both stays as it is, and so does the way until then."""
    load, wait = _grip(t, h, p, on)
    if load == 0.0:
        return q, dq, ql, dql
    if _flexible(on) or _playing(on):
        behind = p[INERTIA] * max(p[_share_column(on)], SMALL)
        slower = dql * behind / (behind + load)
        return q, dq, ql + wait * (dql - slower), slower
    slower = dq * p[INERTIA] / (p[INERTIA] + load)
    return q + wait * (dq - slower), slower, ql, dql


@njit(cache=True, forceinline=True, error_model='numpy')
def _slowed_pair(t, h, q1, d1, ql1, dl1, q2, d2, ql2, dl2, first, second, on1, on2, p3, s, p2):
    """`_slowed` of a planar pair: of the first joint, then of the second one.

    The blow takes the momentum that the load will have from the links: in no time it changes their velocities by what a
    torque of that size accelerates them."""
    load1, wait1 = _grip(t, h, first, on1)
    load2, wait2 = _grip(t, h, second, on2)
    if load1 == 0.0 and load2 == 0.0:
        return q1, d1, ql1, dl1, q2, d2, ql2, dl2
    load2 /= s
    loose1, loose2 = _flexible(on1) or _playing(on1), _flexible(on2) or _playing(on2)
    v1, v2 = dl1 if loose1 else d1, dl2 if loose2 else d2
    reach, c = _reach(second, on2), _cosine(ql2 if loose2 else q2)
    blow1 = (load1 + load2 * (reach * reach + 2.0 * reach * c + 1.0)) * v1 + load2 * (1.0 + reach * c) * v2
    blow2 = s * load2 * ((1.0 + reach * c) * v1 + v2)
    a1, a2, al1, al2, _, _ = _coupled(
        t, q1, 0.0, ql1, 0.0, q2, 0.0, ql2, 0.0, 0.0 if loose1 else -blow1, 0.0 if loose2 else -blow2,
        blow1 if loose1 else 0.0, blow2 if loose2 else 0.0, False, False, first, second, on1, on2, p3, s, p2)
    b1, b2, bl1, bl2, _, _ = _coupled(
        t, q1, 0.0, ql1, 0.0, q2, 0.0, ql2, 0.0, 0.0, 0.0, 0.0, 0.0, False, False, first, second, on1, on2, p3, s, p2)
    wait = max(wait1, wait2)
    a1, a2, al1, al2 = a1 - b1, a2 - b2, al1 - bl1, al2 - bl2
    return (q1 - wait * a1, d1 + a1, ql1 - wait * al1, dl1 + al1, q2 - wait * a2, d2 + a2, ql2 - wait * al2,
            dl2 + al2)


@njit(cache=True, forceinline=True, error_model='numpy')
def _planar(q1, d1, q2, d2, rhs1, rhs2, stuck1, stuck2, p1, own, p2, first, second, p3, s, sine, cosine, reach):
    """Accelerations of a planar pair under the net torques of its joints: (q_1'', q_2'', torque 1, torque 2), the
    torques on what does not rest; p1, own: inertias of the joints (that of the second in units of the first), p2: what
    of the second the first one carries; sine, cosine: weight of a load at the end of the second link, which acts on
    the first one at `reach` times its own lever."""
    c, z = _cosine(q2), _sine(q2)
    g1, g2 = 0.0, 0.0
    sine2, cosine2 = second[GRAVITY_SINE] + sine, second[GRAVITY_COSINE] + cosine
    sine1, cosine1 = first[GRAVITY_SINE] + reach * sine / s, first[GRAVITY_COSINE] + reach * cosine / s
    if sine2 != 0.0 or cosine2 != 0.0:
        g2 = sine2 * _sine(q1 + q2) + cosine2 * _cosine(q1 + q2)
        g1 = g2 / s
    if sine1 != 0.0 or cosine1 != 0.0:
        g1 += sine1 * _sine(q1) + cosine1 * _cosine(q1)
    r1 = rhs1 + p3 * z * (2.0 * d1 * d2 + d2 * d2) - g1
    r2 = (rhs2 - g2) / s - p3 * z * d1 * d1
    m11, m12 = p1 + p2 + 2.0 * p3 * c, p2 + p3 * c
    if stuck1 and stuck2:
        return 0.0, 0.0, r1, r2 * s
    if stuck1:
        a2 = r2 / own
        return 0.0, a2, r1 - m12 * a2, r2 * s
    if stuck2:
        a1 = r1 / m11
        return a1, 0.0, r1, s * (r2 - m12 * a1)
    det = m11 * own - m12 * m12
    return (own * r1 - m12 * r2) / det, (m11 * r2 - m12 * r1) / det, r1, r2 * s


@njit(cache=True, forceinline=True, error_model='numpy')
def _twisted(q, dq, ql, dql, p, on):
    """Share of the inertia behind a spring or a play, and the torque between the sides over that inertia."""
    column = _share_column(on)
    omega = 2.0 * math.pi * p[column + 1]
    if _flexible(on):
        d = q - ql
        return p[column], omega * (omega * d * (1.0 + _stiffening(p, on) * (d * d)) + 2.0 * p[column + 2] * (dq - dql))
    first = _play_column(on)
    d = q - ql
    half = 0.5 * p[first]
    al = 0.0
    if abs(d) > half:
        deep = d - math.copysign(half, d)
        al = omega * (omega * deep + 2.0 * p[column + 2] * (dq - dql))
        if PLAY_POWER >= 0 and on[PLAY_POWER]:
            al *= _power(abs(deep) / max(half, 1e-300), p[first + 4] - 1.0)
        if al * d < 0.0:
            al = 0.0
    return p[column], al


@njit(cache=True, forceinline=True, error_model='numpy')
def _steepened(twist, deep, half, power):
    """Factor on the torque of a play's contact that goes by a power of the depth, 1 where there is none."""
    beyond = 1.0 * (twist > half)
    return _power(beyond * deep / max(half, 1e-300) + (1.0 - beyond), power)


@njit(cache=True, forceinline=True, error_model='numpy')
def _pulled(t, q, dq, ql, dql, arm, p, on):
    """Net torque on an arm behind a spring or a play, `arm` against it beside viscous friction, and its inertia."""
    share, al = _twisted(q, dq, ql, dql, p, on)
    pull = p[INERTIA] * share * al
    return pull - arm - p[ARM_VISCOUS] * dql, p[INERTIA] * max(share, SMALL) + _payload(t, p, on)


@njit(cache=True, forceinline=True, error_model='numpy')
def _gripped(t, q, dq, ql, dql, arm, level, span, p, on):
    """Dry friction of a level on an arm behind a spring or a play, over a step of length span, under torques as they
    are at its beginning, `arm` beside viscous friction: (sign, torque), of the level as long as it slides, and in all.

    Where it would reverse within the step, it stops and rests or slides back; the torque is the mean that takes it to
    the velocity that it has then."""
    pull, inertia = _pulled(t, q, dq, ql, dql, arm, p, on)
    rests = abs(pull) <= level
    if dql == 0.0:
        return (0.0, pull) if rests else (math.copysign(1.0, pull), 0.0)
    sign = math.copysign(1.0, dql)
    change = (pull - sign * level) / inertia
    if (dql + span * change) * sign >= 0.0:
        return sign, 0.0
    after = 0.0 if rests else (span + dql / change) * (pull - math.copysign(level, pull)) / inertia
    return 0.0, pull - inertia * (after - dql) / span


@njit(cache=True, forceinline=True, error_model='numpy')
def _parted(q, dq, ql, dql, rhs, arm, load, p, on, stuck):
    """A joint with a spring or a play in a planar pair: its motor's acceleration and net torque, the torque on the arm
    behind, and the inertia there, of which a load is."""
    share, al = _twisted(q, dq, ql, dql, p, on)
    between = p[INERTIA] * share * al
    rhs -= between
    a = 0.0 if stuck else rhs / (p[INERTIA] * (1.0 - share))
    return a, rhs, between - (arm + p[ARM_VISCOUS] * dql), p[INERTIA] * share + load


@njit(cache=True, forceinline=True, error_model='numpy')
def _coupled(t, q1, d1, ql1, dl1, q2, d2, ql2, dl2, rhs1, rhs2, arm1, arm2, stuck1, stuck2, first, second, on1, on2,
             p3, s, p2):
    """Accelerations of the motors and of the arm's links of a planar pair, and the torques on what does not rest:
    (q_1'', q_2'', q_l1'', q_l2'', torque 1, torque 2).

    rhs: net torques on the motors; arm: torques against the arm behind a spring or a play. The rigid body is what lies
    there: the torque between the sides drives it."""
    loose1, loose2 = _flexible(on1) or _playing(on1), _flexible(on2) or _playing(on2)
    added, reach, sine, cosine = _payload(t, second, on2) / s, _reach(second, on2), *_hung(t, second, on2)
    load1, load2 = _payload(t, first, on1) + added * reach * reach, _payload(t, second, on2)
    inertia1, inertia2 = first[INERTIA] + load1, second[INERTIA] + load2
    p3 = p3 + added * reach
    own, carried = second[INERTIA] / s + added, p2 + added
    drive1, drive2, a1, a2, rotor, turning = rhs1, rhs2, 0.0, 0.0, 0.0, 0.0
    if loose1:
        a1, rhs1, drive1, inertia1 = _parted(q1, d1, ql1, dl1, rhs1, arm1, load1, first, on1, stuck1)
        q1, d1 = ql1, dl1
    if loose2:
        a2, rhs2, drive2, inertia2 = _parted(q2, d2, ql2, dl2, rhs2, arm2, load2, second, on2, stuck2)
        q2, d2 = ql2, dl2
        own, rotor = inertia2 / s, own - inertia2 / s
        turning = min(max(carried - own, 0.0), rotor)  # of the rotor what turns with the first joint, too
        carried = min(carried, own)
        inertia1 += turning
        if not stuck2:  # it follows by itself
            inertia1 -= turning * turning / rotor
            drive1 -= turning / rotor * rhs2 / s
    al1, al2, torque1, torque2 = _planar(
        q1, d1, q2, d2, drive1, drive2, stuck1 and not loose1, stuck2 and not loose2, inertia1, own, carried, first,
        second, p3, s, sine, cosine, reach)
    if not loose1:
        a1, rhs1 = al1, torque1
    if not loose2:
        a2, rhs2 = al2, torque2
    elif stuck2:
        rhs2 -= s * turning * al1
    else:
        a2 -= turning * al1 / rotor
    return a1, a2, al1, al2, rhs1, rhs2


@njit(cache=True, forceinline=True, error_model='numpy')
def _joined(t, q, dq, ql, dql, rhs, arm, p, on):
    """Accelerations of motor side and load side, the net torque rhs on the former and `arm` against the latter, beside
    its viscous friction: (q'', q_l'', torque between the sides)."""
    load = _payload(t, p, on)
    if _flexible(on) or _playing(on):
        arm += p[ARM_VISCOUS] * dql
        share, al = _twisted(q, dq, ql, dql, p, on)
        F, behind = p[INERTIA] * share * al, p[INERTIA] * max(share, SMALL)
        if load != 0.0:
            al *= behind / (behind + load)
        return (rhs - F) / (p[INERTIA] * (1.0 - share)), al - arm / (behind + load), F
    inertia = p[INERTIA] + load
    a = rhs * p[MOBILITY] if inertia == p[INERTIA] else rhs / inertia
    return a, a, 0.0


@njit(cache=True, forceinline=True, error_model='numpy')
def _sides(start, p, on):
    """Angles and velocities of motor and arm at the beginning, those of the encoder's side given: the arm hangs in its
    spring or leans to one side of its play, but for what start (6,) has of `BEGINNING` besides."""
    q, dq = start[0], start[1]
    if not (_flexible(on) or _playing(on)):
        return q, dq, q, dq
    arm = _on_arm(0.0, q, 0.0, 0.0, (0.0, 0.0, 0.0), p, on, True, False)
    first = _share_column(on) - 1
    stiffness = p[INERTIA] * max(p[first + 1], SMALL) * (2.0 * math.pi * p[first + 2]) ** 2
    twist = arm / max(stiffness, 1e-300)
    if _playing(on):
        half = 0.5 * p[first]
        if PLAY_POWER >= 0 and on[PLAY_POWER]:
            half = max(half, 1e-300)
            twist = math.copysign(half * (abs(twist) / half) ** (1.0 / p[first + 4]), twist)
        if arm != 0.0:
            twist += math.copysign(half, arm)
    stiffening = _stiffening(p, on)
    for _ in range(20 if stiffening > 0.0 else 0):  # Newton's rule from beyond the root, whose curve bends one way
        twist -= (twist * (1.0 + stiffening * twist * twist) - arm / max(stiffness, 1e-300)) / (
            1.0 + 3.0 * stiffening * twist * twist)
    twist = min(max(twist, -1.0), 1.0) + start[TWIST]
    if _load_side(on):
        return q + twist, dq + start[TWIST_RATE], q, dq
    return q, dq, q - twist, dq - start[TWIST_RATE]


@njit(cache=True, forceinline=True, error_model='numpy')
def _rates(t, S, D, beside, u, x, sign, stuck, n, P, on, has, pair, rigid, bristle, extra, known, level, rhs, grip,
           span):
    """Time derivatives D of the states S (n, 8) at time t under the averaged amplifier command u (n,).

    bristle (n, 2): torque of bristles, and how much more it is per velocity. beside (n,): what the laws of the motor's
    position add to it. extra, known (n,): torques from outside, on the motor and on its arm. grip (n, 2): dry friction
    on the arm (`_gripped`), found anew for a step of length span above zero."""
    arm1, arm2 = 0.0, 0.0
    if pair and (_minding(on[0]) or _minding(on[1])):
        for j in range(2):  # each joint of a pair sees the other one as it is simulated
            x[1 - j, 0], x[1 - j, 1] = 0.0, S[j, DQ]
            x[1 - j, 2] = _motor(S[j, Q] + beside[j], S[j, DQ], S[j, W], S[j, HEAT], u[j], P[j], on[j])[0]
    for j in range(n):
        p = P[j]
        q, dq = S[j, Q], S[j, DQ]
        split = _flexible(on[j]) or _playing(on[j])
        behind = p[ARM_FRICTION] if split else 0.0
        w = given = S[j, W]
        if behind > 0.0 or (p[ELECTRICAL] <= 0.0 and has[j, 2]):
            w, _, _, given = _motor(q + beside[j], dq, w, S[j, HEAT], u[j], p, on[j])
        arm = _on_arm(t, S[j, QL] if split else q, dq, w, x[j], p, on[j], has[j, 2], pair and j < 2)
        arm += known[j]
        if behind > 0.0:
            if has[j, 1]:
                given *= _gain(t, q + beside[j], dq, w, p, on[j])
            if has[j, 4]:
                arm += behind * _drag(t, S[j, QL], S[j, DQL], given, x[j], p, on[j])
            held = behind * _friction(t, S[j, QL], S[j, DQL], given, p, on[j]) if has[j, 3] else 0.0
            if span > 0.0:
                grip[j, 0] = grip[j, 1] = 0.0
                if held > 0.0:
                    grip[j, 0], grip[j, 1] = _gripped(t, q, dq, S[j, QL], S[j, DQL], arm, held, span, p, on[j])
            arm += grip[j, 0] * held + grip[j, 1]
            if YIELD >= 0 and on[j, YIELD]:
                pull, inertia = _pulled(t, q, dq, S[j, QL], S[j, DQL], arm, p, on[j])
                arm += pull - _yielded(pull, S[j, DQL], inertia, behind, p, on[j])
        viscous = bristle[j, 1] + (p[VISCOUS] if split else p[VISCOUS] + p[ARM_VISCOUS])
        w, D[j, W], D[j, HEAT], r, level[j] = _chain(
            t, q + beside[j], dq, S[j, W], S[j, HEAT], viscous, 0.0 if split else arm, u[j], x[j], p, on[j], has[j],
            bristle[j, 0] + extra[j], 1.0 - behind)
        S[j, W] = w
        rhs[j] = r - sign[j] * level[j]
        D[j, Q] = dq
        D[j, QL] = S[j, DQL]
        if pair and j < 2:
            arm1, arm2 = (arm, arm2) if j == 0 else (arm1, arm)
        else:
            D[j, DQ], D[j, DQL], F = _joined(t, q, dq, S[j, QL], S[j, DQL], rhs[j], arm, p, on[j])
            rhs[j] -= F
        if stuck[j]:
            D[j, DQ] = 0.0
            D[j, Q] = 0.0
    if pair:
        D[0, DQ], D[1, DQ], D[0, DQL], D[1, DQL], rhs[0], rhs[1] = _coupled(
            t, S[0, Q], S[0, DQ], S[0, QL], S[0, DQL], S[1, Q], S[1, DQ], S[1, QL], S[1, DQL], rhs[0], rhs[1], arm1,
            arm2, stuck[0], stuck[1], P[0], P[1], on[0], on[1], rigid[0], rigid[1], rigid[2])


@njit(cache=True, forceinline=True, error_model='numpy')
def _smooths(p, on):
    """Whether a winding's lag that is too short for a step (below zero) is that of a low-pass behind the laws of the
    command, which take what is held as it is, and not a delay of the command itself."""
    return p[ELECTRICAL] < 0.0 and _commanding(on) and not (LAG >= 0 and on[LAG])


@njit(cache=True, forceinline=True, error_model='numpy')
def _lateness(p, on):
    """By how much the command is late [s]; a lag below zero stands for a delay."""
    late = p[TIMING]
    if not _smooths(p, on):
        late -= min(p[ELECTRICAL], 0.0)
    if DELAY >= 0 and on[DELAY]:
        late += p[DELAY_P]
    return late


@njit(cache=True, forceinline=True, error_model='numpy')
def _rising(share, jump):
    """How much the straight line rises that has the mean and the first moment of a jump with that share of a step to
    come."""
    return 6.0 * share * (1.0 - share) * jump


@njit(cache=True, forceinline=True, error_model='numpy')
def _amplifier(k, i, substeps, shift, hold, u, cumulative):
    """Held command over substep i of sample k, late by `shift` samples: its mean, how much the straight line with the
    same first moment rises, so that angle and velocity are both right behind a jump, and the share of the substep after
    a jump from one held value to the next."""
    if shift == 0.0 and hold == 0:
        return u[k], 0.0, 0.0
    a = k + i / substeps - shift
    b = a + 1.0 / substeps
    if hold == 0:  # two steps of the command at most, the second one over a share of the interval
        place, last = math.floor(a), u.shape[0] - 1
        first = u[min(max(int(place), 0), last)]
        share = (b - (place + 1.0)) * substeps
        if share <= 0.0:
            return first, 0.0, 0.0
        jump = u[min(max(int(place) + 1, 0), last)] - first
        return first + share * jump, _rising(share, jump), min(share, 1.0)
    return (_held(cumulative, u, b) - _held(cumulative, u, a)) * substeps, _rise(u, a, b), 0.0


@njit(cache=True, error_model='numpy')
def _resolved(P, h):
    """Parameters (n, columns + 3) in which a winding lag too short for steps of h acts as a delay: its sign is turned.

    The last ones are the reciprocals of winding lag and inertia, and the step.
    """
    Q = np.zeros((P.shape[0], STEP + 1))
    for j in range(Q.shape[0]):
        for column in range(ELECTRICAL_RATE):  # an array's assignment would compile a message on shapes, too
            Q[j, column] = P[j, column]
        Q[j, ELECTRICAL_RATE] = 1.0 / Q[j, ELECTRICAL] if Q[j, ELECTRICAL] > 0.0 else 0.0
        Q[j, MOBILITY] = 1.0 / Q[j, INERTIA]
        Q[j, STEP] = h
        if Q[j, ELECTRICAL] < 0.5 * h:
            Q[j, ELECTRICAL] = -Q[j, ELECTRICAL]
    return Q


@njit(cache=True, forceinline=True, error_model='numpy')
def _as_weight(p, on):
    """Puts what a tilted base does to a link of a planar pair, p (columns,) and on (effects,), in the place of its own
    weight: it turns with the joint before it, too, and pulls at that as well."""
    if TILT >= 0 and on[TILT]:
        p[GRAVITY_SINE] += p[TILT_P]
        p[GRAVITY_COSINE] += p[TILT_P + 1]
        on[TILT] = False


@njit(cache=True, error_model='numpy')
def _steepness(p, on):
    """Steepest slope of friction that is rounded, over the velocity, and the inertia that it acts on."""
    slope, moved = 0.0, p[INERTIA]
    if ROUND >= 0 and on[ROUND]:
        slope = p[ROUND_P] / p[ROUND_P + 1]
    if TAPER >= 0 and on[TAPER]:
        slope = max(slope, p[TAPER_P] / p[TAPER_P + 1])
    if BLEND >= 0 and on[BLEND]:
        slope = max(slope, (p[BLEND_P] + p[BLEND_P + 1]) / p[BLEND_P + 4])
    if YIELD >= 0 and on[YIELD]:
        slope = max(slope, p[YIELD_P + 2] * p[INERTIA] / p[YIELD_P + 1])
    if (_flexible(on) or _playing(on)) and p[ARM_FRICTION] > 0.0:
        moved *= max(p[_share_column(on)], SMALL)
    return slope, moved


@njit(cache=True, error_model='numpy')
def _mobility(p, on):
    """One over the inertia that the motor moves by itself."""
    share = p[_share_column(on)] if _flexible(on) or _playing(on) else 0.0
    return 1.0 / (p[INERTIA] * (1.0 - share))


@njit(cache=True, error_model='numpy')
def _finer(P, on, h, turning):
    """Factor on the number of steps of length h: friction that is rounded has to turn within several of them
    (`turning`), a winding lag that is no delay has to last for one, and so do the blows of a play and what swings on
    bristles. What dry friction holds on one side of a spring or a play, and lets go, is right to second order only."""
    count = 1
    for j in range(P.shape[0]):
        while count < 4 and P[j, ELECTRICAL] > 0.2 * h and count * P[j, ELECTRICAL] < h:
            count *= 2
        if _flexible(on[j]) or _playing(on[j]):
            count = max(count, 2 if _dry(on[j]) else 1)
        slope, moved = _steepness(P[j], on[j])
        while turning and count < 4 and slope * h > 0.4 * count * moved:
            count *= 2
        if _bristled(on[j]):
            first = _bristle_column(on[j])
            while count < 4 and P[j, first] * h * h > 0.01 * count * count * P[j, INERTIA] * P[j, first + 1]:
                count *= 2
        if _playing(on[j]):
            first = _play_column(on[j])
            rate = 2.0 * math.pi * P[j, first + 2] / math.sqrt(1.0 - P[j, first + 1])
            while count < 4 and P[j, first + 1] > 0.0 and rate * h > 0.15 * count:
                count *= 2
    return count


@njit(cache=True, error_model='numpy')
def _steps(P, on, dt, substeps):
    """Steps per sample of dt, given parameters (n, columns) and switches (n, effects)."""
    return 1 if P[0, STEPPING] > 0.0 else substeps * _finer(P, on, dt / substeps, True)


@njit(cache=True, error_model='numpy')
def _calm_steps(P, on, dt, substeps):
    """The same for samples in which a single joint is too fast for its rounded friction to turn, if they are fewer."""
    steps, p = _steps(P, on, dt, substeps), P[0]
    fewer = steps if P.shape[0] > 1 or p[STEPPING] > 0.0 else substeps * _finer(P, on, dt / substeps, False)
    lags = (LAG >= 0 and on[0, LAG]) or 0.0 < p[ELECTRICAL] < 0.5 * dt / fewer
    held = (YIELD >= 0 and on[0, YIELD]) or _bristled(on[0]) or _any_of(AT_REST, on[0])
    return steps if lags or held or _commanding(on[0]) else fewer


@njit(cache=True, error_model='numpy')
def _quick(p, on, h):
    """Velocity beyond which rounded friction no longer turns: its slope takes less than a twentieth of a velocity in a
    step of length h."""
    quick, moved = 0.0, _steepness(p, on)[1]
    share = 20.0 * h / moved
    if ROUND >= 0 and on[ROUND]:
        quick = p[ROUND_P + 1] * math.acosh(math.sqrt(max(share * p[ROUND_P] / p[ROUND_P + 1], 1.0)))
    if TAPER >= 0 and on[TAPER]:
        steep, n = max(share * p[TAPER_P] / p[TAPER_P + 1], 1.0), p[TAPER_P + 2]
        quick = max(quick, p[TAPER_P + 1] * math.pow(math.pow(steep, n / (n + 1.0)) - 1.0, 1.0 / n))
    if BLEND >= 0 and on[BLEND]:
        steep = max(share * (p[BLEND_P] + p[BLEND_P + 1]) / p[BLEND_P + 4], 1.0)
        quick = max(quick, p[BLEND_P + 4] * math.acosh(math.sqrt(steep)))
    return quick


@njit(cache=True, error_model='numpy')
def _jump(u, k, late):
    """Largest change of the command that acts in sample k, so many samples late, to either side."""
    last = u.shape[0] - 1
    a = min(max(int(math.floor(k - late)), 0), last)
    before, after = u[max(a - 1, 0)], u[min(a + 1, last)]
    return max(abs(u[a] - before), abs(after - u[a]))


@njit(cache=True, forceinline=True, error_model='numpy')
def _passes(dq, before, pushed, quick):
    """Whether a velocity stays beyond where friction turns for one more sample, as it changed in the last one and as a
    change of the command pushes it."""
    return abs(dq) - 2.0 * abs(dq - before) - pushed > quick


@njit(cache=True, forceinline=True, error_model='numpy')
def _low_pass(v, rise, state, h, time_constant):
    """Exact first-order low-pass over a step in which the input rises along a line of mean v: (mean, rise of the line
    with the output's first moment, state at the end)."""
    a = h / max(time_constant, 1e-12)
    decay = _exponential(-a)
    begin = v - 0.5 * rise
    away = state - begin + rise / a
    short = 1.0 * (a < 0.01)
    moment = short * a * (-1.0 / 12.0 + a * (1.0 / 24.0 - a / 80.0)) + (1.0 - short) * (
        (1.0 - decay * (1.0 + a)) / (a * a) - 0.5 * (1.0 - decay) / a)
    mean = v - rise / a + away * (1.0 - decay) / a
    return mean, rise + 12.0 * away * moment, begin + rise - rise / a + away * decay


@njit(cache=True, forceinline=True, error_model='numpy')
def _drawn(driving, w, h, rate):
    """Current of a winding in the middle and at the end of a step of h that begins with w: on its way to what the
    driving voltage gives."""
    decay, away = _exponential(-0.5 * h * rate), w - driving
    return driving + away * decay, driving + away * decay * decay


@njit(cache=True, forceinline=True, error_model='numpy')
def _driven(k, i, substeps, dt, now, h, hold, u, cumulative, q, dq, w, lag, p, on, commands, euler):
    """Command behind the amplifier over substep i of sample k: mean, rise, and state of the low-pass at the end."""
    v, rise, share = _amplifier(k, i, substeps, _lateness(p, on) / dt, hold, u, cumulative)
    return _through(v, rise, share, now, h, q, dq, w, lag, p, on, commands, euler)


@njit(cache=True, forceinline=True, error_model='numpy')
def _through(v, rise, share, now, h, q, dq, w, lag, p, on, commands, euler):
    """A command of mean v that rises over a step of h, or jumps with that share of it to come, behind the amplifier's
    effects: as `_driven`.

    The current that a supply gives way to is the one that the command draws at once where no lag lies between them;
    that of a winding goes on as the step does.
    """
    if commands:
        base, half, high = v, 0.5 * rise, v
        jump = rise / _rising(share, 1.0) if 0.0 < share < 1.0 else 0.0
        middle = late = w
        drawn = not euler and _drawing(on) and p[ELECTRICAL] > 0.0
        if drawn:
            drives = lag if LAG >= 0 and on[LAG] else _command(v, now, q, dq, w, p, on)
            middle, late = _drawn(drives - p[BACK_EMF] * dq, w, h, p[ELECTRICAL_RATE])
        count = 3 if rise != 0.0 or drawn else 1  # in the middle of the step, then at its ends
        if jump != 0.0:  # before the jump, then after it
            base, half, count = v - share * jump, jump, 2
        at_once = _drawing(on) and p[ELECTRICAL] <= 0.0 and not (LAG >= 0 and on[LAG])
        for end in range(count):
            given = base + (half if end == 1 else (-half if end == 2 else 0.0))
            if at_once:
                emf = p[BACK_EMF] * dq
                first = given - emf
                second = _command(given, now, q, dq, first, p, on) - emf
                third = _command(given, now, q, dq, second, p, on) - emf
                gone = second - first  # where the two steps lead to, by Aitken's method
                shrunk = (third - second) / gone if gone != 0.0 else 0.0
                middle = late = w = first + gone / (1.0 - min(shrunk, 0.9))
            current = middle if end == 0 or jump != 0.0 else (late if end == 1 else w)
            through = _command(given, now, q, dq, current, p, on)
            if end == 0:
                v = through
            elif end == 1:
                high = through
            else:
                rise = high - through
        if jump != 0.0:
            jump = high - v
            v, rise = v + share * jump, _rising(share, jump)
    if LAG >= 0 and on[LAG]:
        v, rise, lag = _low_pass(v, rise, lag, h, p[LAG_P])
    elif _smooths(p, on):
        v, rise, lag = _low_pass(v, rise, lag, h, -p[ELECTRICAL])
    return v, 0.0 if euler else rise, lag


@njit(cache=True, forceinline=True, error_model='numpy')
def _commanded_lanes(S, p, on, all_on, whole, since, to, now, h, draws):
    """`_through` of all lanes at once, up to the low-pass, where none draws a current that the command sets at once:
    the laws of the command for its mean, or before a jump, and at the ends of the step, or behind the jump.

    draws: whether any of them draws the current of a winding.
    """
    still = True
    for l in range(LANES):
        share = S[TURNED_ + l]
        between = 1.0 * (share > 0.0) * (1.0 * (share < 1.0))
        jump = between * (S[RISE_ + l] / (_rising(share, 1.0) + (1.0 - between)))
        jumps = 1.0 * (jump != 0.0)
        half = jumps * jump + (1.0 - jumps) * (0.5 * S[RISE_ + l])
        first = jumps * (S[MEAN_ + l] - share * jump) + (1.0 - jumps) * S[MEAN_ + l]
        S[GIVEN_FIRST_ + l], S[GIVEN_HIGH_ + l], S[GIVEN_LOW_ + l] = first, first + half, first - half
        S[JUMPED_ + l] = jumps
        S[CURRENT_FIRST_ + l] = S[CURRENT_HIGH_ + l] = S[CURRENT_LOW_ + l] = S[W_ + l]
    for l in range(LANES):
        still = still and S[RISE_ + l] == 0.0 and not draws
    if draws:
        for l in range(LANES):
            S[BEFORE_ + l], S[GIVEN_FIRST_ + l] = S[GIVEN_FIRST_ + l], S[MEAN_ + l]
    for row in range(-1 if draws else 0, 1 if still else 3):
        if row == 0 and draws:
            for l in range(LANES):
                lagged = S[LAGGED_ + l]
                drives = lagged * S[LAG_ + l] + (1.0 - lagged) * S[GIVEN_FIRST_ + l]
                middle, late = _drawn(drives - S[EMF_ + l] * S[DQ_ + l], S[W_ + l], h, S[ELECTRICAL_ + l])
                drawn, jumps = S[DRAWN_ + l], S[JUMPED_ + l]
                S[CURRENT_FIRST_ + l] = middle if drawn > 0.0 else S[W_ + l]
                S[CURRENT_HIGH_ + l] = (middle if jumps > 0.0 else late) if drawn > 0.0 else S[W_ + l]
                S[GIVEN_FIRST_ + l] = S[BEFORE_ + l]
        given, current = GIVEN_FIRST_ + max(row, 0) * LANES, CURRENT_FIRST_ + max(row, 0) * LANES
        #command_lanes#
    if still:
        for l in range(LANES):
            S[MEAN_ + l] = S[COMMANDED_ + l] * S[GIVEN_FIRST_ + l] + (1.0 - S[COMMANDED_ + l]) * S[MEAN_ + l]
    else:
        for l in range(LANES):
            there, jumps, share = S[COMMANDED_ + l], S[JUMPED_ + l], S[TURNED_ + l]
            first, high = S[GIVEN_FIRST_ + l], S[GIVEN_HIGH_ + l]
            jump = high - first
            mean = jumps * (first + share * jump) + (1.0 - jumps) * first
            rise = jumps * _rising(share, jump) + (1.0 - jumps) * (high - S[GIVEN_LOW_ + l])
            S[MEAN_ + l] = there * mean + (1.0 - there) * S[MEAN_ + l]
            S[RISE_ + l] = there * rise + (1.0 - there) * S[RISE_ + l]


@njit(cache=True, forceinline=True, error_model='numpy')
def _bristled(on):
    """Whether there are bristles."""
    return (BRISTLE >= 0 and on[BRISTLE]) or (DAHL >= 0 and on[DAHL]) or (LUGRE >= 0 and on[LUGRE])


@njit(cache=True, forceinline=True, error_model='numpy')
def _bristle_column(on):
    """Where the parameters of bristles begin: level and deflection."""
    return DAHL_P if DAHL >= 0 and on[DAHL] else (LUGRE_P if LUGRE >= 0 and on[LUGRE] else BRISTLE_P)


@njit(cache=True, forceinline=True, error_model='numpy')
def _bristle(z, dq, h, p, on):
    """Torque of a bristle over a step, its deflection in the middle, by the exact flow at the velocity dq before the
    step, and how much more torque it takes per velocity.

    Deflections are half a step ahead of velocities, so that each is in the middle of the step of the other (leapfrog,
    which neither damps nor drives what swings on the bristles); their damping goes by the velocity as it changes.
    """
    general = DAHL >= 0 and on[DAHL]
    falling = LUGRE >= 0 and on[LUGRE]
    first = _bristle_column(on)
    top = max(p[first + 1], 1e-12)
    stiffness = p[first] / top
    if falling:
        top *= 1.0 + p[LUGRE_P + 3] * math.exp(-((abs(dq) / p[LUGRE_P + 4]) ** p[LUGRE_P + 5]))
    power = 1.0 - p[DAHL_P + 3] if general else 0.0  # y = 1 - z / final falls by y' = -y^exponent
    yields = 1.0
    if dq != 0.0:
        final = math.copysign(top, dq)
        rate = abs(dq) * h / top
        if abs(power) > 1e-6:
            y = max(1.0 - z / final, 1e-12)
            z = final - final * max(y**power - power * rate, 0.0) ** (1.0 / power)
        else:
            z += (final - z) * (1.0 - math.exp(-rate))
        yields = 1.0 - z / final
    if general:
        yields = max(yields, 0.0) ** (1.0 - power)
    return stiffness * z, z, stiffness * p[first + 2] * yields


@njit(cache=True, error_model='numpy')
def _crossing(start, first, total):
    """Share of the step at which start + first s + (total - first) s^2 becomes zero (velocity within one step)."""
    a, b = total - first, first
    if abs(a) > 1e-12 * abs(b):
        root = b * b - 4.0 * a * start
        if root >= 0.0:
            root = math.sqrt(root)
            s = 2.0 * start / (-b + root) if b < 0.0 else 2.0 * start / (-b - root)
            if 0.0 < s <= 1.0:
                return s
            s = 2.0 * start / (-b - root) if b < 0.0 else 2.0 * start / (-b + root)
            if 0.0 < s <= 1.0:
                return s
    return start / (start - (start + total))


@njit(cache=True, error_model='numpy', nogil=True)
def run(t, u, cumulative, hold, y, x, extra_in, start, P, on, pair, rigid, leak, rate_leak, substeps, out, motion):
    """Simulate one log. y (T, n) readings; out (T, n) prediction errors; motion (T, n, 3): q, dq, w (or empty)."""
    T, n = u.shape
    S = np.zeros((n, 8)); z = np.zeros(n)
    begin(start, u[0], S, P, on)
    first = min(0, T)  # a number that is written out would have `advance` compiled for it alone
    advance(first, T, t, u, cumulative, hold, y, x, extra_in, S, z, P, on, pair, rigid, leak, rate_leak, substeps, out,
            motion)


@njit(cache=True, error_model='numpy', nogil=True)
def begin(start, u, S, P, on):
    """States S (n, 8) at the beginning of a log: start (n, 6) as in `BEGINNING`; command u (n,)."""
    for j in range(len(u)):
        S[j, BESIDE] = 0.0
        S[j, Q], S[j, DQ], S[j, QL], S[j, DQL] = _sides(start[j], P[j], on[j])
        S[j, A] = u[j]
        S[j, W] = start[j, 2]
        S[j, HEAT] = start[j, WARMTH]


@njit(cache=True, error_model='numpy', nogil=True)
def advance(first, last, t, u, cumulative, hold, y, x, extra_in, S, z, P, on, pair, rigid, leak, rate_leak,
        substeps, out, motion):
    """Samples first..last-1 of a log from the states S (n, 8) and deflections z (n,), which end up at sample last."""
    T, n = u.shape
    euler = P[0, STEPPING] > 0.0
    fine, calm = _steps(P, on, t[1] - t[0], substeps), _calm_steps(P, on, t[1] - t[0], substeps)
    quick = _quick(P[0], on[0], (t[1] - t[0]) / calm) if calm < fine else 0.0
    late, mobility = _lateness(P[0], on[0]) / (t[1] - t[0]), _mobility(P[0], on[0])
    dq_before, dql_before = S[0, DQ], S[0, DQL]
    P = _resolved(P, (t[1] - t[0]) / fine)
    shapes = (x.shape[2] - 3) // 2
    described = P.copy() if shapes > 0 else P
    if pair:
        on = on.copy()
        for j in range(n):
            _as_weight(P[j], on[j])
    D = np.zeros((n, 7)); first_rates = np.zeros((n, 7)); total = np.zeros((n, 7)); B = np.zeros((n, 8))
    sign = np.zeros(n); stuck = np.zeros(n, dtype=np.bool_); c = np.zeros(n)
    rises = np.zeros(n); volts = np.zeros(n); beside = np.zeros(n)
    bristle = np.zeros((n, 2)); extra = np.zeros(n); known = np.zeros(n); level = np.zeros(n); rhs = np.zeros(n)
    grip = np.zeros((n, 2))
    xs = np.zeros((n, 3))
    keep = motion.shape[0] == T
    with_x = x.shape[0] == T
    with_extra = extra_in.shape[0] == T
    dry = np.zeros(n, dtype=np.bool_)
    has = np.zeros((n, 5), dtype=np.bool_)
    for j in range(n):
        _present(on[j], has[j])
    t0 = t[0]
    for k in range(first, last):
        for j in range(n):
            e = y[k, j] - _reading(S[j, QL] if _load_side(on[j]) else S[j, Q], P[j], on[j])
            out[k, j] = e
            if keep:
                motion[k, j, 0] = S[j, Q]; motion[k, j, 1] = S[j, DQ]; motion[k, j, 2] = S[j, W]
        if k == T - 1:
            break
        dt = t[k + 1] - t[k]
        if leak > 0.0:
            pull = 1.0 - math.exp(-leak * dt)
            caught = 1.0 - math.exp(-CATCHING_UP * leak * dt)
            for j in range(n):
                angle, rate = (QL, DQL) if _load_side(on[j]) else (Q, DQ)
                S[j, angle] += pull * out[k, j]
                if _tied(on[j]):
                    S[j, Q] += pull * out[k, j]
                S[j, BESIDE] += caught * (P[j, FOLLOWING] * (1.0 - pull) * out[k, j] - S[j, BESIDE])
                beside[j] = S[j, BESIDE]
                if rate_leak > 0.0 and S[j, rate] != 0.0:
                    S[j, rate] += rate_leak * dt * out[k, j]
        for j in range(n):
            if with_x:
                xs[j, 0] = x[k, j, 0]; xs[j, 1] = x[k, j, 1]; xs[j, 2] = x[k, j, 2]
            extra[j] = extra_in[k, j] if with_extra else 0.0
            known[j] = _posed(P[j], described[j], on[j], x[k, j], shapes) if with_x and shapes > 0 else 0.0
        substeps = fine
        if calm < fine:
            pushed = _jump(u[:, 0], k, late) * dt * mobility
            passes = _passes(S[0, DQ], dq_before, pushed, quick)
            if passes and (_flexible(on[0]) or _playing(on[0])):
                passes = _passes(S[0, DQL], dql_before, 0.0, quick)
            substeps = calm if passes else fine
            dq_before, dql_before = S[0, DQ], S[0, DQL]
        h = dt / substeps
        per_step = 1.0 / h
        for i in range(substeps):
            now = t[k] - t0 + i * h
            if pair:
                S[0, Q], S[0, DQ], S[0, QL], S[0, DQL], S[1, Q], S[1, DQ], S[1, QL], S[1, DQL] = _slowed_pair(
                    now, h, S[0, Q], S[0, DQ], S[0, QL], S[0, DQL], S[1, Q], S[1, DQ], S[1, QL], S[1, DQL], P[0], P[1],
                    on[0], on[1], rigid[0], rigid[1], rigid[2])
            for j in range(n):
                p = P[j]
                if j >= 2 or not pair:
                    S[j, Q], S[j, DQ], S[j, QL], S[j, DQL] = _slowed(
                        now, h, S[j, Q], S[j, DQ], S[j, QL], S[j, DQL], p, on[j])
                c[j], rises[j], S[j, A] = _driven(k, i, substeps, dt, now, h, hold[j], u[:, j], cumulative[:, j],
                                                  S[j, Q], S[j, DQ], S[j, W], S[j, A], p, on[j], has[j, 0], euler)
                if _bristled(on[j]):
                    bristle[j, 0], z[j], bristle[j, 1] = _bristle(z[j], S[j, DQ], h, p, on[j])
            # friction by events: a joint that would reverse stops inside the step; the rest is integrated anew
            left, at, events = h, now, 0
            while left > 0.0:
                span, stopped, stage, asked = left, -1, 0, False
                for j in range(n):
                    stuck[j] = False
                    dq = S[j, DQ]
                    sign[j] = 1.0 if dq > 0.0 else (-1.0 if dq < 0.0 else 0.0)
                while stage < 4:  # the stages of the Runge-Kutta step, one after the other in the same machine code
                    ahead = 0.0 if stage == 0 else (0.5 * span if stage < 3 else span)
                    for j in range(n):
                        volts[j] = c[j] + rises[j] * ((h - left + ahead) * per_step - 0.5)
                        for m in range(7):
                            B[j, m] = S[j, m] + ahead * D[j, m] if stage else S[j, m]
                    _rates(at + ahead, B, D, beside, volts, xs, sign, stuck, n, P, on, has, pair, rigid, bristle, extra,
                           known, level, rhs, grip, 0.0 if stage else span)
                    if stage == 0:
                        again, loose, most = False, -1, 1.0
                        for j in range(n):
                            S[j, W] = B[j, W]
                            if not asked:
                                dry[j] = level[j] > 0.0
                                if dry[j] and sign[j] == 0.0:  # at rest: what would it take to hold it there?
                                    stuck[j] = again = True
                            elif stuck[j] and abs(rhs[j]) > most * level[j]:
                                loose, most = j, abs(rhs[j]) / level[j]
                        asked = True
                        if loose >= 0:  # one breaks away, and what the other takes is asked anew
                            stuck[loose], again = False, True
                            sign[loose] = 1.0 if rhs[loose] > 0.0 else -1.0
                        if again:
                            continue
                        for j in range(n):
                            _put(first_rates[j], D[j])
                            _put(total[j], D[j])
                        if euler:
                            stage = 3
                            for j in range(n):
                                for m in range(7):
                                    total[j, m] = 6.0 * D[j, m]
                                if not stuck[j]:
                                    total[j, Q] = 6.0 * S[j, DQ] + span * total[j, DQ]
                                total[j, QL] = 6.0 * S[j, DQL] + span * total[j, DQL]
                    else:
                        weight = 2.0 if stage < 3 else 1.0
                        for j in range(n):
                            for m in range(7):
                                total[j, m] += weight * D[j, m]
                    stage += 1
                    if stage == 4 and stopped < 0 and events < 6 and not euler:
                        share = 1.0
                        for j in range(n):
                            if dry[j] and not stuck[j] and S[j, DQ] != 0.0:
                                change = span / 6.0 * total[j, DQ]
                                if (S[j, DQ] + change) * S[j, DQ] < 0.0:  # it would reverse: the step ends there
                                    part = _crossing(S[j, DQ], span * first_rates[j, DQ], change)
                                    if part < share:
                                        share = part
                                        stopped = j
                        if stopped >= 0:
                            span *= share
                            stage = 1
                            for j in range(n):
                                _put(D[j], first_rates[j])
                                _put(total[j], first_rates[j])
                for j in range(n):
                    for m in range(7):
                        if m == A or (m == W and P[j, ELECTRICAL] <= 0.0):
                            continue
                        S[j, m] += span / 6.0 * total[j, m]
                    if P[j, ELECTRICAL] <= 0.0:
                        S[j, W] = B[j, W]
                if stopped >= 0:
                    S[stopped, DQ] = 0.0
                    events += 1
                    if events >= 6:
                        break
                    at += span
                    left -= span
                else:
                    break
            for i in range(n):
                if not abs(S[i, DQ]) < 1e9:
                    for kk in range(k + 1, last):
                        for j in range(n):
                            out[kk, j] = 1e6
                    return


@njit(cache=True, error_model='numpy', nogil=True)
def compensated(networks, first, last, t, u, cumulative, hold, y, x, extra, S, z, P, on, pair, rigid, leak, rate_leak,
                substeps, out, motion):
    """`advance` with packed networks of angle and velocity: their outputs are torques that resist, held per sample."""
    for k in range(first, last):
        for j in range(len(networks)):
            if networks[j, 0] > 0.0:
                extra[k, j] = network_value(networks[j], 0, S[j, 0], S[j, 1], 0.0, 0.0)
        advance(k, k + 1, t, u, cumulative, hold, y, x, extra, S, z, P, on, pair, rigid, leak, rate_leak,
                substeps, out, motion)


@njit(cache=True, forceinline=True, error_model='numpy')
def _parted_lane(S, l, p, on):
    """Puts what is behind the spring or the play of one lane into its rows."""
    first = _share_column(on)
    S[SHARE_ + l], S[DAMPING_ + l], S[OMEGA_ + l] = p[first], p[first + 2], 2.0 * math.pi * p[first + 1]
    S[STIFFENED_ + l] = _stiffening(p, on)


@njit(cache=True, forceinline=True, error_model='numpy')
def _begin_lanes(starts, u, begins, P, on, h, S, p, has, parted):
    """Parameters p (n, columns + 3), first states S, which slots have any effect and whether there is a spring or a
    play; returns how many of these, and whether any has several forms of a load that is picked up.

    Spare lanes do nothing. The log of a lane begins at row begins[l] of u (T,).
    """
    n, springs, plays, several = len(P), 0, 0, False
    resolved = _resolved(P, h)
    for l in range(LANES):
        S[EVERY_ + l], S[LAG_TIME_ + l], S[WARMING_TIME_ + l], S[MEAN_SQUARE_ + l] = h, 1.0, 1.0, 1.0
    for l in range(n):
        _put(p[l], resolved[l])
        S[Q_ + l], S[DQ_ + l], S[QL_ + l], S[DQL_ + l] = _sides(starts[l], p[l], on[l])
        S[W_ + l], S[LAG_ + l], S[HEAT_ + l] = starts[l, 2], u[begins[l]], starts[l, WARMTH]
        S[MOBILITY_ + l] = p[l, MOBILITY]
        S[VISCOUS_ + l], S[EMF_ + l], S[BRISTLE_ + l] = p[l, VISCOUS], p[l, BACK_EMF], 0.0
        S[ELECTRICAL_ + l] = p[l, ELECTRICAL_RATE]
        S[LATE_ + l] = _lateness(p[l], on[l])
        S[LIMIT_ + l] = p[l, LIMIT] if p[l, LIMIT] > 0.0 else np.inf
        if _flexible(on[l]) or _playing(on[l]):
            _parted_lane(S, l, p[l], on[l])
            springs, plays = springs + _flexible(on[l]), plays + _playing(on[l])
            if _playing(on[l]):
                S[HALF_ + l] = 0.5 * p[l, _play_column(on[l])]
                S[STEEP_ + l] = p[l, PLAY_POWER_P + 4] - 1.0 if PLAY_POWER >= 0 and on[l, PLAY_POWER] else 0.0
        else:
            S[VISCOUS_ + l] += p[l, ARM_VISCOUS]
        for column in range(P.shape[1]):
            S[(FIRST_PARAMETER + column) * LANES + l] = p[l, column]
        _present(on[l], has[l])
        parted[l] = _flexible(on[l]) or _playing(on[l])
        if not parted[l]:
            S[ARM_FRICTION_ + l] = 0.0
        S[PARTED_ + l], S[SPRING_ + l] = 1.0 * parted[l], 1.0 * (not _playing(on[l]))
        S[LOADED_ + l], S[INSTANT_ + l], S[SUDDEN_ + l], forms = _load_of(p[l], on[l])
        several = several or forms > 1
        S[SEEN_ + l], S[TIED_ + l] = 1.0 * _load_side(on[l]), 1.0 * _tied(on[l])
        S[COMMANDED_ + l] = 1.0 * has[l, 0]
        S[DRAWN_ + l] = 1.0 * (_drawing(on[l]) and p[l, ELECTRICAL] > 0.0)
        if LAG >= 0 and on[l, LAG]:
            S[LAGGED_ + l], S[LAG_TIME_ + l] = 1.0, p[l, LAG_P]
        elif _smooths(p[l], on[l]):
            S[LAGGED_ + l], S[LAG_TIME_ + l] = 1.0, -p[l, ELECTRICAL]
        if _warming(on[l]):
            first, curve, steady = _warming_of(p[l], on[l])
            S[WARM_ + l], S[WARMER_ + l], S[WARMING_TIME_ + l] = 1.0, p[l, first], p[l, first + 1]
            S[COPPERED_ + l], S[STEADIED_ + l], S[MEAN_SQUARE_ + l] = curve, 1.0 * steady, p[l, SQUARE]
    return springs, plays, several


@njit(cache=True, forceinline=True, error_model='numpy')
def _seen(S, l, xs, rigid):
    """What the joint of a lane sees of another one: of a pair the other joint's velocity and motor torque as they are
    simulated, else what was measured."""
    if rigid is None:
        return xs
    other = (l + HALF) % LANES
    return 0.0, S[DQS_ + other], S[WS_ + other]


@njit(cache=True, forceinline=True, error_model='numpy')
def _rates_lanes(S, p, on, any_on, all_on, whole, since, to, has, parted, xs, n, split, shared, weighs, motor,
                 rippled, limited, warm, ends, rigid, hanging, several, begins):
    """Time derivatives of LANES candidates at once: the same equations as `_rates`, row by row.

    has: slots that any of them fills. shared: whether friction acts on an arm behind a spring or a play, too. begins:
    whether a step does. ends: what the motor moves, if it is the same in all of them. rigid, hanging: see
    `run_lanes` and `_planar_lanes`.
    """
    if rippled:
        for l in range(LANES):
            angle = S[RIPPLE_CYCLES_ + l] * (S[QS_ + l] + S[BESIDE_ + l])
            S[CONSTANT_ + l] = 1.0 + (
                S[RIPPLE_SINE_ + l] * _sine(angle) + S[RIPPLE_COSINE_ + l] * _cosine(angle))
    if warm and motor != OTHER:
        for l in range(LANES):
            emf, heat = S[CONSTANT_ + l] * S[EMF_ + l] * S[DQS_ + l], S[HEATS_ + l]
            resistance = 1.0 + S[WARM_ + l] * heat
            if motor == LAGGING:
                S[DW_ + l] = (S[U_ + l] - emf - resistance * S[WS_ + l]) * S[ELECTRICAL_ + l]
            else:
                S[WS_ + l] = (S[U_ + l] - emf) / resistance
            w = S[R_ + l] = S[WS_ + l]
            losses = S[STEADIED_ + l] + (1.0 - S[STEADIED_ + l]) * (w * w / S[MEAN_SQUARE_ + l])
            curve = (1.0 + S[COPPERED_ + l] * heat) / (1.0 + S[COPPERED_ + l] * S[WARMER_ + l])
            S[DHEAT_ + l] = S[WARM_ + l] * (S[WARMER_ + l] * losses * curve - heat) / S[WARMING_TIME_ + l]
    elif motor == LAGGING:
        for l in range(LANES):
            emf = S[CONSTANT_ + l] * S[EMF_ + l] * S[DQS_ + l]
            S[DW_ + l] = (S[U_ + l] - emf - S[WS_ + l]) * S[ELECTRICAL_ + l]
            S[R_ + l] = S[WS_ + l]
    elif motor == PROMPT:
        for l in range(LANES):
            S[WS_ + l] = S[R_ + l] = S[U_ + l] - S[CONSTANT_ + l] * S[EMF_ + l] * S[DQS_ + l]
    else:
        for l in range(n):
            S[WS_ + l], S[DW_ + l], S[DHEAT_ + l], S[R_ + l] = _motor(
                S[QS_ + l] + S[BESIDE_ + l], S[DQS_ + l], S[WS_ + l], S[HEATS_ + l], S[U_ + l], p[l], on[l])
    if limited:
        for l in range(LANES):
            S[R_ + l] = min(max(S[R_ + l], -S[LIMIT_ + l]), S[LIMIT_ + l])
    if rippled:
        for l in range(LANES):
            S[R_ + l] *= S[CONSTANT_ + l]
    if has[1]:
        for l in range(LANES):
            S[SUM_ + l] = 1.0
        #gain_lanes#
        for l in range(LANES):
            S[R_ + l] *= S[SUM_ + l]
    if has[2] or has[3] or has[4]:
        for l in range(LANES):
            S[TORQUE_ + l] = S[R_ + l]
    if weighs:
        for l in range(LANES):
            S[PLACE_ + l], S[SUM_ + l] = S[QS_ + l], 0.0
        for l in range(n if split else 0):
            if parted[l]:
                S[PLACE_ + l] = S[QLS_ + l]
        #arm_lanes#
        for l in range(LANES):
            S[ARM_ + l] = S[LOAD_ + l] + S[SUM_ + l]
        if weighs == HEAVY:
            for l in range(LANES):
                q = S[PLACE_ + l]
                S[ARM_ + l] += S[GRAVITY_SINE_ + l] * _sine(q) + S[GRAVITY_COSINE_ + l] * _cosine(q)
        for l in range(LANES):
            S[ARM_ + l] += S[KNOWN_ + l]
            S[WEIGHT_ + l] = S[ARM_ + l]
        for l in range(n if split else 0):
            if parted[l]:
                S[WEIGHT_ + l] = 0.0
    for l in range(LANES):
        S[R_ + l] -= (S[BRISTLE_ + l] + S[VISCOUS_ + l]) * S[DQS_ + l] + S[WEIGHT_ + l] + S[RESIST_ + l]
    if has[2]:
        for l in range(LANES):
            S[SUM_ + l] = 0.0
        #torque_lanes#
        for l in range(LANES):
            S[R_ + l] -= S[SUM_ + l]
    for behind in range(1 if shared else 0, -1 if has[4] else 1, -1):
        _sided(S, behind)
        for l in range(LANES):
            S[SUM_ + l] = 0.0
        #drag_lanes#
        if behind:
            for l in range(LANES):
                S[ARM_ + l] += S[ARM_FRICTION_ + l] * S[SUM_ + l]
        else:
            for l in range(LANES):
                S[R_ + l] -= (1.0 - S[ARM_FRICTION_ + l]) * S[SUM_ + l]
    if YIELD >= 0 and all_on[YIELD]:
        for l in range(LANES):
            wanted = S[YIELD_SHARE_ + l] * (S[R_ + l] + S[INERTIA_ + l] * S[DQS_ + l] / S[YIELD_TIME_ + l])
            level = (1.0 - S[ARM_FRICTION_ + l]) * S[YIELD_LEVEL_ + l]
            S[R_ + l] -= min(max(wanted, -level), level)
    elif YIELD >= 0 and any_on[YIELD]:
        for l in range(n):
            S[R_ + l] = _yielded(S[R_ + l], S[DQS_ + l], p[l, INERTIA], 1.0 - S[ARM_FRICTION_ + l], p[l], on[l])
    for behind in range(1 if shared else 0, -1 if has[3] else 1, -1):
        _sided(S, behind)
        for l in range(LANES):
            S[LEVEL_ + l] = 0.0
        #friction_lanes#
        if behind:
            for l in range(LANES):
                S[HELD_ + l] = S[ARM_FRICTION_ + l] * S[LEVEL_ + l]
        else:
            for l in range(LANES):
                S[LEVEL_ + l] *= 1.0 - S[ARM_FRICTION_ + l]
            for l in range(n if CARRY >= 0 and any_on[CARRY] else 0):
                if on[l, CARRY]:
                    S[LEVEL_ + l] += _carried(S[R_ + l], S[DQS_ + l], S[WEIGHT_ + l], S[LEVEL_ + l], p[l])
            for l in range(LANES):
                S[R_ + l] -= S[SIGN_ + l] * S[LEVEL_ + l]
    if shared and has[3]:
        for l in range(n):
            if begins:
                S[GRIP_ + l] = S[FIXED_ + l] = 0.0
                if S[HELD_ + l] > 0.0 and S[SPAN_ + l] > 0.0:
                    S[GRIP_ + l], S[FIXED_ + l] = _gripped(
                        S[T_ + l], S[QS_ + l], S[DQS_ + l], S[QLS_ + l], S[DQLS_ + l], S[ARM_ + l], S[HELD_ + l],
                        S[SPAN_ + l], p[l], on[l])
            S[ARM_ + l] += S[GRIP_ + l] * S[HELD_ + l] + S[FIXED_ + l]
    for l in range(n if shared and YIELD >= 0 and any_on[YIELD] else 0):
        if S[ARM_FRICTION_ + l] > 0.0:
            pull, inertia = _pulled(
                S[T_ + l], S[QS_ + l], S[DQS_ + l], S[QLS_ + l], S[DQLS_ + l], S[ARM_ + l], p[l], on[l])
            S[ARM_ + l] += pull - _yielded(pull, S[DQLS_ + l], inertia, S[ARM_FRICTION_ + l], p[l], on[l])
    if rigid is not None:
        if split:
            _parted_pairs(S, p, on, any_on, has[3], hanging, several)
        else:
            _planar_lanes(S, p, on, any_on, has[3], hanging, several)
        return
    if _any_of(LOADS, any_on):
        _laden(S, p, on, n, several)
    if ends == ONE_BODY and _any_of(LOADS, any_on):
        for l in range(LANES):
            whole = S[INERTIA_ + l] + S[ADDED_ + l]
            bare = 1.0 * (whole == S[INERTIA_ + l])
            S[DDQ_ + l] = bare * (S[R_ + l] * S[MOBILITY_ + l]) + (1.0 - bare) * (S[R_ + l] / whole)
    elif ends == ONE_BODY:
        for l in range(LANES):
            S[DDQ_ + l] = S[R_ + l] * S[MOBILITY_ + l]
    elif ends == PLAY_BETWEEN:
        steep = PLAY_POWER >= 0 and any_on[PLAY_POWER]
        for l in range(LANES):
            d = S[QS_ + l] - S[QLS_ + l]
            deep = d - S[HALF_ + l] * (1.0 * (d > 0.0) - 1.0 * (d < 0.0))
            al = S[OMEGA_ + l] * (S[OMEGA_ + l] * deep + 2.0 * S[DAMPING_ + l] * (S[DQS_ + l] - S[DQLS_ + l]))
            if steep:
                al *= _steepened(abs(d), abs(deep), S[HALF_ + l], S[STEEP_ + l])
            al *= 1.0 * (abs(d) > S[HALF_ + l]) * (1.0 * (al * d >= 0.0))
            S[R_ + l] -= S[INERTIA_ + l] * S[SHARE_ + l] * al
            S[DDQ_ + l] = S[R_ + l] / (S[INERTIA_ + l] * (1.0 - S[SHARE_ + l]))
            arm = S[ARM_ + l] + S[ARM_VISCOUS_ + l] * S[DQLS_ + l]
            behind = S[INERTIA_ + l] * max(S[SHARE_ + l], SMALL)
            S[DDQL_ + l] = al * (behind / (behind + S[ADDED_ + l])) - arm / (behind + S[ADDED_ + l])
    elif ends == SPRING:
        for l in range(LANES):
            d = S[QS_ + l] - S[QLS_ + l]
            pull = S[OMEGA_ + l] * d * (1.0 + S[STIFFENED_ + l] * (d * d))
            al = S[OMEGA_ + l] * (pull + 2.0 * S[DAMPING_ + l] * (S[DQS_ + l] - S[DQLS_ + l]))
            S[R_ + l] -= S[INERTIA_ + l] * S[SHARE_ + l] * al
            S[DDQ_ + l] = S[R_ + l] / (S[INERTIA_ + l] * (1.0 - S[SHARE_ + l]))
            arm = S[ARM_ + l] + S[ARM_VISCOUS_ + l] * S[DQLS_ + l]
            behind = S[INERTIA_ + l] * max(S[SHARE_ + l], SMALL)
            S[DDQL_ + l] = al * (behind / (behind + S[ADDED_ + l])) - arm / (behind + S[ADDED_ + l])
    else:
        for l in range(n):
            S[DDQ_ + l], S[DDQL_ + l], between = _joined(
                S[T_ + l], S[QS_ + l], S[DQS_ + l], S[QLS_ + l], S[DQLS_ + l], S[R_ + l], S[ARM_ + l], p[l], on[l])
            S[R_ + l] -= between
    if has[3]:
        for l in range(LANES):
            S[DDQ_ + l] *= S[FREE_ + l]


@njit(cache=True, forceinline=True, error_model='numpy')
def _loaded_pairs(S, p, on, any_on, several):
    """Adds to planar pairs the loads that have been picked up: inertias, and of a load at the end of the second link
    also what it couples and its weight."""
    _laden(S, p, on, LANES, several)
    if _any_of(ON_THE_ARM, any_on):
        for l in range(HALF):
            m = l + HALF
            added, reach = S[ADDED_ + m] / S[RATIO_ + l], _reach(p[m], on[m])
            S[ADDED_ + l] += added * reach * reach
            S[COUPLED_ + l] = S[COUPLING_ + l] + added * reach
            sine, cosine = _hung(S[T_ + m], p[m], on[m])
            S[HUNG_SINE_ + m], S[HUNG_COSINE_ + m] = sine, cosine
            S[HUNG_SINE_ + l], S[HUNG_COSINE_ + l] = reach * sine / S[RATIO_ + l], reach * cosine / S[RATIO_ + l]


@njit(cache=True, forceinline=True, error_model='numpy')
def _posed_pairs(S, angle, weight, hanging):
    """What a pose of planar pairs says, its angles in one row: the torques of their weight into another, and sine and
    cosine of the elbow."""
    if hanging:
        for l in range(HALF):
            q1, q2 = S[angle + l], S[angle + l] + S[angle + l + HALF]
            m = l + HALF
            sine, cosine = S[GRAVITY_SINE_ + m] + S[HUNG_SINE_ + m], S[GRAVITY_COSINE_ + m] + S[HUNG_COSINE_ + m]
            pull = sine * _sine(q2) + cosine * _cosine(q2)
            sine, cosine = S[GRAVITY_SINE_ + l] + S[HUNG_SINE_ + l], S[GRAVITY_COSINE_ + l] + S[HUNG_COSINE_ + l]
            S[weight + m] = pull
            S[weight + l] = pull / S[RATIO_ + l] + (sine * _sine(q1) + cosine * _cosine(q1))
    else:
        for l in range(LANES):
            S[weight + l] = 0.0
    for l in range(HALF):
        S[TURN_ + l] = _sine(S[angle + HALF + l])
        S[CROSS_ + l] = _cosine(S[angle + HALF + l])


@njit(cache=True, forceinline=True, error_model='numpy')
def _planar_lanes(S, p, on, any_on, dry, hanging, several):
    """`_planar` of candidates whose joints lie in the first and in the second half of the lanes.

    hanging: whether gravity acts on any of them. R ends as the torques on what does not rest.
    """
    if _any_of(LOADS, any_on):
        _loaded_pairs(S, p, on, any_on, several)
    _posed_pairs(S, QS_, WEIGHT_, hanging)
    for l in range(HALF):
        S[SECOND_INERTIA_ + l] = S[INERTIA_ + HALF + l] / S[RATIO_ + l] + S[ADDED_ + HALF + l] / S[RATIO_ + l]
        S[FIRST_INERTIA_ + l] = (
            S[INERTIA_ + l] + S[ADDED_ + l] + (S[SHARED_ + l] + S[ADDED_ + HALF + l] / S[RATIO_ + l])
            + 2.0 * S[COUPLED_ + l] * S[CROSS_ + l])
        S[CROSS_ + l] = (
            S[SHARED_ + l] + S[ADDED_ + HALF + l] / S[RATIO_ + l] + S[COUPLED_ + l] * S[CROSS_ + l])
    for l in range(HALF):
        d1, d2, pull = S[DQS_ + l], S[DQS_ + HALF + l], S[COUPLED_ + l] * S[TURN_ + l]
        S[R_ + l] = S[R_ + l] + pull * (2.0 * d1 * d2 + d2 * d2) - S[WEIGHT_ + l]
        S[TURN_ + l] = (S[R_ + HALF + l] - S[WEIGHT_ + HALF + l]) / S[RATIO_ + l] - pull * d1 * d1
        S[R_ + HALF + l] = S[TURN_ + l] * S[RATIO_ + l]
    for l in range(HALF):
        one, two, cross = S[FIRST_INERTIA_ + l], S[SECOND_INERTIA_ + l], S[CROSS_ + l]
        det = one * two - cross * cross
        S[DDQ_ + l] = (two * S[R_ + l] - cross * S[TURN_ + l]) / det
        S[DDQ_ + HALF + l] = (one * S[TURN_ + l] - cross * S[R_ + l]) / det
    for l in range(HALF if dry else 0):
        m = l + HALF
        if S[FREE_ + l] * S[FREE_ + m] > 0.0:
            continue
        r1, r2, cross = S[R_ + l], S[TURN_ + l], S[CROSS_ + l]
        a1 = a2 = 0.0
        if S[FREE_ + m] > 0.0:
            a2 = r2 / S[SECOND_INERTIA_ + l]
            S[R_ + l] = r1 - cross * a2
        elif S[FREE_ + l] > 0.0:
            a1 = r1 / S[FIRST_INERTIA_ + l]
            S[R_ + m] = S[RATIO_ + l] * (r2 - cross * a1)
        S[DDQ_ + l], S[DDQ_ + m] = a1, a2


@njit(cache=True, forceinline=True, error_model='numpy')
def _parted_pairs(S, p, on, any_on, dry, hanging, several):
    """`_coupled` of candidates whose joints lie in the first and in the second half of the lanes: rows as they are for
    those that have a spring or a play (PARTED) and those that have none. What rests, and what no row says, goes one
    pair after the other."""
    steep = PLAY_POWER >= 0 and any_on[PLAY_POWER]
    if _any_of(LOADS, any_on):
        _loaded_pairs(S, p, on, any_on, several)
    for l in range(LANES):
        S[GIVEN_ + l] = S[R_ + l]
        d = S[QS_ + l] - S[QLS_ + l]
        deep = d - S[HALF_ + l] * (1.0 * (d > 0.0) - 1.0 * (d < 0.0))
        pull = S[OMEGA_ + l] * deep * (1.0 + S[STIFFENED_ + l] * (d * d))
        al = S[OMEGA_ + l] * (pull + 2.0 * S[DAMPING_ + l] * (S[DQS_ + l] - S[DQLS_ + l]))
        if steep:
            al *= _steepened(abs(d), abs(deep), S[HALF_ + l], S[STEEP_ + l])
        al *= max(1.0 * (abs(d) > S[HALF_ + l]) * (1.0 * (al * d >= 0.0)), S[SPRING_ + l])
        S[BEHIND_ + l] = S[INERTIA_ + l] * S[SHARE_ + l]
        S[DRIVE_ + l] = S[BEHIND_ + l] * al
        S[R_ + l] -= S[DRIVE_ + l]
        S[DDQ_ + l] = S[R_ + l] / (S[INERTIA_ + l] * (1.0 - S[SHARE_ + l]))
    for l in range(LANES):
        parted, whole = S[PARTED_ + l], 1.0 - S[PARTED_ + l]
        against = S[ARM_ + l] + S[ARM_VISCOUS_ + l] * S[DQLS_ + l]
        S[DRIVE_ + l] = parted * (S[DRIVE_ + l] - against) + whole * S[R_ + l]
        S[BEHIND_ + l] = parted * S[BEHIND_ + l] + whole * S[INERTIA_ + l] + S[ADDED_ + l]
        S[ANGLE_ + l] = parted * S[QLS_ + l] + whole * S[QS_ + l]
        S[RATE_ + l] = parted * S[DQLS_ + l] + whole * S[DQS_ + l]
    _posed_pairs(S, ANGLE_, PLACE_, hanging)
    for l in range(HALF):
        m = l + HALF
        added = S[ADDED_ + m] / S[RATIO_ + l]
        own, carried = S[INERTIA_ + m] / S[RATIO_ + l] + added, S[SHARED_ + l] + added
        behind = S[PARTED_ + m] * (S[BEHIND_ + m] / S[RATIO_ + l]) + (1.0 - S[PARTED_ + m]) * own
        S[ROTOR_ + l] = S[PARTED_ + m] * (own - behind)
        S[TURNING_ + l] = min(max(carried - behind, 0.0), S[ROTOR_ + l])
        carried = S[PARTED_ + m] * min(carried, behind) + (1.0 - S[PARTED_ + m]) * carried
        S[SECOND_INERTIA_ + l] = behind
        turning, rotor = S[TURNING_ + l], max(S[ROTOR_ + l], 1e-300)
        S[DRIVE_ + l] -= turning / rotor * S[R_ + m] / S[RATIO_ + l]
        S[FIRST_INERTIA_ + l] = (
            S[BEHIND_ + l] + turning - turning * turning / rotor + carried + 2.0 * S[COUPLED_ + l] * S[CROSS_ + l])
        S[CROSS_ + l] = carried + S[COUPLED_ + l] * S[CROSS_ + l]
    for l in range(HALF):
        m = l + HALF
        d1, d2, pull = S[RATE_ + l], S[RATE_ + m], S[COUPLED_ + l] * S[TURN_ + l]
        one, two, cross = S[FIRST_INERTIA_ + l], S[SECOND_INERTIA_ + l], S[CROSS_ + l]
        r1 = S[DRIVE_ + l] + pull * (2.0 * d1 * d2 + d2 * d2) - S[PLACE_ + l]
        r2 = (S[DRIVE_ + m] - S[PLACE_ + m]) / S[RATIO_ + l] - pull * d1 * d1
        det = one * two - cross * cross
        S[DDQL_ + l] = (two * r1 - cross * r2) / det
        S[DDQL_ + m] = (one * r2 - cross * r1) / det
        S[DDQ_ + m] -= S[TURNING_ + l] * S[DDQL_ + l] / max(S[ROTOR_ + l], 1e-300)
        S[DRIVE_ + l], S[DRIVE_ + m] = r1, r2 * S[RATIO_ + l]
    for l in range(LANES):
        parted, whole = S[PARTED_ + l], 1.0 - S[PARTED_ + l]
        S[DDQ_ + l] = parted * S[DDQ_ + l] + whole * S[DDQL_ + l]
        S[R_ + l] = parted * S[R_ + l] + whole * S[DRIVE_ + l]
    for l in range(HALF if dry else 0):
        m = l + HALF
        if S[FREE_ + l] * S[FREE_ + m] == 0.0:
            S[DDQ_ + l], S[DDQ_ + m], S[DDQL_ + l], S[DDQL_ + m], S[R_ + l], S[R_ + m] = _coupled(
                S[T_ + l], S[QS_ + l], S[DQS_ + l], S[QLS_ + l], S[DQLS_ + l], S[QS_ + m], S[DQS_ + m], S[QLS_ + m],
                S[DQLS_ + m], S[GIVEN_ + l], S[GIVEN_ + m], S[ARM_ + l], S[ARM_ + m], S[FREE_ + l] == 0.0,
                S[FREE_ + m] == 0.0, p[l], p[m], on[l], on[m], S[COUPLING_ + l], S[RATIO_ + l], S[SHARED_ + l])


@njit(cache=True, forceinline=True, error_model='numpy')
def _sided(S, behind):
    """Where the joints are and how fast they go, in front of a spring or a play or behind it, for laws of friction."""
    if behind:
        _copied(S, PLACE_, QLS_, 1)
        _copied(S, PACE_, DQLS_, 1)
    else:
        for l in range(LANES):
            S[PLACE_ + l] = S[QS_ + l] + S[BESIDE_ + l]
        _copied(S, PACE_, DQS_, 1)


@njit(cache=True, forceinline=True, error_model='numpy')
def _copied(S, target, source, rows):
    """So many rows of lanes into others."""
    for i in range(rows * LANES):
        S[target + i] = S[source + i]


@njit(cache=True, forceinline=True, error_model='numpy')
def _added(S, total, weight, rate):
    """One row of lanes, times a weight, on top of another."""
    for l in range(LANES):
        S[total + l] += weight * S[rate + l]


@njit(cache=True, forceinline=True, error_model='numpy')
def _pushed(S, state, step, rate):
    """One row of lanes, times another, on top of a third."""
    for l in range(LANES):
        S[state + l] += S[step + l] * S[rate + l]


@njit(cache=True, forceinline=True, error_model='numpy')
def _held_pairs(S, asked):
    """Lets what rests in planar pairs rest as long as dry friction holds it, once the levels are known (`asked`); one
    joint breaks away at a time. Returns whether the torques have to be asked anew."""
    again = False
    for l in range(HALF):
        m = l + HALF
        if not S[SPAN_ + l] > 0.0:
            continue
        if not asked:
            for joint in (l, m):
                if S[LEVEL_ + joint] > 0.0 and S[SIGN_ + joint] == 0.0:
                    S[FREE_ + joint], again = 0.0, True
            continue
        pull1 = abs(S[R_ + l]) / S[LEVEL_ + l] if S[FREE_ + l] == 0.0 else 0.0
        pull2 = abs(S[R_ + m]) / S[LEVEL_ + m] if S[FREE_ + m] == 0.0 else 0.0
        if max(pull1, pull2) > 1.0:
            first = l if pull1 >= pull2 else m
            S[FREE_ + first], S[SIGN_ + first], again = 1.0, 1.0 if S[R_ + first] > 0.0 else -1.0, True
    return again


@njit(cache=True, forceinline=True, error_model='numpy')
def _stopping_pairs(S):
    """Ends the step of planar pairs where the first of the two joints would reverse against dry friction. Returns
    whether there are any."""
    again = False
    for l in range(HALF):
        m = l + HALF
        if S[STOPPED_ + l] > 0.0 or S[STOPPED_ + m] > 0.0:
            continue
        share, first = 1.0, -1
        for joint in (l, m):
            if S[REVERSED_ + joint] < 0.0 and S[DRY_ + joint] > 0.0 and S[FREE_ + joint] > 0.0:
                crossing = _crossing(S[DQ_ + joint], S[SPAN_ + joint] * S[FIRST_DQ_ + joint], S[TOTAL_ + joint])
                if first < 0 or crossing < share:
                    share, first = crossing, joint
        if first >= 0:
            S[SPAN_ + l] *= share
            S[SPAN_ + m] *= share
            S[STOPPED_ + first], again = 1.0, True
    return again


@njit(cache=True, error_model='numpy', nogil=True)
def run_lanes(t, u, cumulative, hold, y, x, extra_in, rows, begins, lengths, starts, P, switches, leak, rate_leak,
              fine, calm, out, motion, rigid):
    """`run` for a single joint and up to LANES candidates at once that take the same steps, `fine` per sample, `calm`
    while one is too fast for rounded friction to turn; or, with the constants `rigid` (HALF, 3), for HALF candidates of
    a planar pair, joint 1 of them in the first lanes.

    Each runs along one of several logs with the same instants, as far as they go: t (T,), the longest; the log of lane
    l is rows begins[l] to begins[l] + lengths[l] of u, y (R, joints) and x (R, 3 + 2 A), or (0, 3), which holds for a
    single log only, and of out[rows[l]], extra_in[rows[l]] (C, R), or (0, 0), and motion[rows[l]] (C, R, 3): angle,
    velocity, motor torque (or empty). hold (joints,); starts (n, 6); P (n, columns); switches (n, effects).
    A candidate's states lie in the same lanes of every row of S, so that one instruction moves them all; what becomes
    of one candidate does not depend on the others.
    """
    n, T = len(rows), len(t)
    together, origin, ends_at = True, np.full(LANES, begins[0]), np.full(LANES, lengths[0])
    for l in range(n):  # spare lanes go along with the first one
        origin[l], ends_at[l] = begins[l], lengths[l]
        together = together and begins[l] == begins[0]
    euler, shapes = P[0, STEPPING] > 0.0, (x.shape[1] - 3) // 2
    on, own = switches, np.zeros((n, 5), dtype=np.bool_)
    since, to = np.zeros(switches.shape[1], dtype=np.int64), np.zeros(switches.shape[1], dtype=np.int64)
    for l in range(n - 1, -1, -1):  # the lanes from the first to the last that have an effect
        for column in range(switches.shape[1]):
            if switches[l, column]:
                since[column] = l
                to[column] = max(to[column], l + 1)
    union, common = to > 0, switches[0].copy()
    for l in range(n):
        common &= switches[l]
    whole = (since % HALF == 0) & (to % HALF == 0) & (to > 0)  # of every half of the lanes all or none
    for column in range(switches.shape[1]):
        for l in range(since[column], to[column]):
            whole[column] = whole[column] and switches[l, column]
    all_on = #common#
    any_on = #union#  # numbers instead of an array: the compiler keeps them at hand
    S, p, parted = np.zeros(ROWS * LANES), np.zeros((n, STEP + 1)), np.zeros(n, dtype=np.bool_)
    springs, plays, several = _begin_lanes(starts, u[:, 0], begins, P, on, (t[1] - t[0]) / fine, S, p, own, parted)
    slots = np.zeros(5, dtype=np.bool_)
    _present(union, slots)
    has = (slots[0], slots[1], slots[2], slots[3], slots[4])
    split, warm = _flexible(any_on) or _playing(any_on), _warming(any_on)
    no = n < 0  # a flag that is false, not the type of what is always false: what takes it is compiled once
    shared = no
    for l in range(n):
        shared = shared or (parted[l] and p[l, ARM_FRICTION] > 0.0)
    hanging = _any_of(HANGING, any_on)
    senses, sees = _sensing(any_on), _load_side(any_on)
    weighs = LIGHT if _weighing(any_on) or x.shape[1] > 3 or hanging else 0
    altered = has[0] or (LAG >= 0 and any_on[LAG])  # on its way through the amplifier, but for a delay
    at_once = lags = draws = no
    for l in range(n):
        draws = draws or (S[DRAWN_ + l] > 0.0 and not euler)
        at_once = at_once or (_drawing(on[l]) and p[l, ELECTRICAL] <= 0.0 and not (LAG >= 0 and on[l, LAG]))
        lags = lags or S[LAGGED_ + l] > 0.0
    prompt = hold[0] == 0  # held until the next sample, and not late
    lagging, limited = 0, no
    for l in range(n):
        if p[l, GRAVITY_SINE] != 0.0 or p[l, GRAVITY_COSINE] != 0.0:
            weighs, hanging = HEAVY, True
        elif p[l, LOAD] != 0.0:
            weighs = max(weighs, LIGHT)
        prompt = prompt and S[LATE_ + l] == 0.0
        lagging += p[l, ELECTRICAL] > 0.0
        limited = limited or p[l, LIMIT] > 0.0
    if shared:
        weighs = max(weighs, LIGHT)
    motor, rippled = OTHER, RIPPLE >= 0 and all_on[RIPPLE]
    if rippled or not (RIPPLE >= 0 and any_on[RIPPLE]):
        motor = LAGGING if lagging == n else (PROMPT if lagging == 0 else OTHER)
    limited, rippled = limited and motor != OTHER, rippled and motor != OTHER  # the others see to it themselves
    S[CONSTANT_ : CONSTANT_ + LANES] = 1.0
    S[FREE_ : FREE_ + LANES] = 1.0
    ends = OTHER
    if not split:
        ends = ONE_BODY
    elif springs == n:
        ends = SPRING
    elif plays == n:
        ends = PLAY_BETWEEN
    lo, joints = begins[0], 1 if rigid is None else 2
    if rigid is not None:  # gravity of a pair is not that of its joints
        weighs = LIGHT if weighs else 0
        prompt = prompt and hold[1] == 0
        for l in range(HALF):
            S[LAG_ + HALF + l] = u[begins[l], 1]
            S[COUPLING_ + l], S[RATIO_ + l], S[SHARED_ + l] = rigid[l, 0], rigid[l, 1], rigid[l, 2]
            S[COUPLED_ + l] = rigid[l, 0]
    direct = prompt and not altered
    for l in range(LANES):
        S[MINE_ + l] = fine
        if l < n and calm < fine:
            S[QUICK_ + l], S[PUSHED_ + l] = _quick(p[l], on[l], (t[1] - t[0]) / calm), _mobility(p[l], on[l])
    _copied(S, DQ_BEFORE_, DQ_, 1)
    _copied(S, DQL_BEFORE_, DQL_, 1)
    with_x, with_extra = x.shape[0] > 0, extra_in.shape[0] > 0
    lasted = np.full(LANES, T)
    resting = stopped = False
    t0, before, pull, caught, alive, late, mean, rise = t[0], 0.0, 0.0, 0.0, n, 0.0, 0.0, 0.0
    xs = (0.0, 0.0, 0.0)
    for k in range(T):
        if together and rigid is None:
            for l in range(LANES):
                S[READING_ + l], S[COMMAND_ + l] = y[lo + k, 0], u[lo + k, 0]
        else:
            for l in range(LANES):
                own_row, joint = origin[l] + min(k, ends_at[l] - 1), joints * l // LANES
                S[READING_ + l], S[COMMAND_ + l] = y[own_row, joint], u[own_row, joint]
        if senses:
            for l in range(n):
                S[ERROR_ + l] = S[READING_ + l] - _reading(S[QL_ + l] if _load_side(on[l]) else S[Q_ + l], p[l], on[l])
        elif sees:
            for l in range(LANES):
                S[ERROR_ + l] = S[READING_ + l] - (S[SEEN_ + l] * S[QL_ + l] + (1.0 - S[SEEN_ + l]) * S[Q_ + l])
        else:
            for l in range(LANES):
                S[ERROR_ + l] = S[READING_ + l] - S[Q_ + l]
        for l in range(n):
            if k < ends_at[l]:
                out[rows[l], origin[l] + k] = S[ERROR_ + l]
        for l in range(n if motion.shape[0] > 0 else 0):
            if k < ends_at[l]:
                place = origin[l] + k
                motion[rows[l], place, 0], motion[rows[l], place, 1] = S[Q_ + l], S[DQ_ + l]
                motion[rows[l], place, 2] = S[W_ + l]
        if k == T - 1:
            break
        dt = t[k + 1] - t[k]
        if leak > 0.0:
            if dt != before:
                before = dt
                pull = 1.0 - math.exp(-leak * dt)
                caught = 1.0 - math.exp(-CATCHING_UP * leak * dt)
            if sees:
                for l in range(LANES):
                    S[QL_ + l] += S[SEEN_ + l] * (pull * S[ERROR_ + l])
                    S[Q_ + l] += max(1.0 - S[SEEN_ + l], S[TIED_ + l]) * (pull * S[ERROR_ + l])
            else:
                _added(S, Q_, pull, ERROR_)
            for l in range(LANES):
                S[BESIDE_ + l] += caught * (S[FOLLOWING_ + l] * (1.0 - pull) * S[ERROR_ + l] - S[BESIDE_ + l])
            if rate_leak > 0.0:
                for l in range(n):
                    rate = DQL_ if _load_side(on[l]) else DQ_
                    if S[rate + l] != 0.0:
                        S[rate + l] += rate_leak * dt * S[ERROR_ + l]
        if with_extra:
            for l in range(n):
                S[OUTER_ + l] = extra_in[rows[l], origin[l] + min(k, ends_at[l] - 1)]
        if with_x:
            xs = (x[lo + k, 0], x[lo + k, 1], x[lo + k, 2])
            for l in range(n if shapes > 0 else 0):
                S[KNOWN_ + l] = _posed(p[l], P[l], on[l], x[lo + k], shapes)
                S[INERTIA_ + l], S[MOBILITY_ + l] = p[l, INERTIA], p[l, MOBILITY]
                if parted[l]:
                    _parted_lane(S, l, p[l], on[l])
        substeps = fine
        if calm < fine:
            substeps = calm
            for l in range(n):
                a, b = origin[l], origin[l] + ends_at[l]
                pushed = _jump(u[a:b, 0], min(k, ends_at[l] - 1), S[LATE_ + l] / (t[1] - t[0])) * dt * S[PUSHED_ + l]
                passes = _passes(S[DQ_ + l], S[DQ_BEFORE_ + l], pushed, S[QUICK_ + l])
                if passes and split:
                    passes = _passes(S[DQL_ + l], S[DQL_BEFORE_ + l], 0.0, S[QUICK_ + l])
                S[MINE_ + l] = calm if passes else fine
                substeps = substeps if passes else fine
            for l in range(LANES):
                S[OWN_STEP_ + l] = dt / S[MINE_ + l]
                S[PER_STEP_ + l] = 1.0 / S[OWN_STEP_ + l]
            _copied(S, DQ_BEFORE_, DQ_, 1)
            _copied(S, DQL_BEFORE_, DQL_, 1)
        h = dt / substeps
        per_step = 1.0 / h
        for i in range(substeps):
            now = t[k] - t0 + i * h
            if _any_of(AT_REST, any_on):
                for l in range(n if rigid is None else 0):
                    S[Q_ + l], S[DQ_ + l], S[QL_ + l], S[DQL_ + l] = _slowed(
                        now, h, S[Q_ + l], S[DQ_ + l], S[QL_ + l], S[DQL_ + l], p[l], on[l])
                for l in range(0 if rigid is None else HALF):
                    m = l + HALF
                    (S[Q_ + l], S[DQ_ + l], S[QL_ + l], S[DQL_ + l],
                     S[Q_ + m], S[DQ_ + m], S[QL_ + m], S[DQL_ + m]) = _slowed_pair(
                        now, h, S[Q_ + l], S[DQ_ + l], S[QL_ + l], S[DQL_ + l], S[Q_ + m], S[DQ_ + m], S[QL_ + m],
                        S[DQL_ + m], p[l], p[m], on[l], on[m], S[COUPLING_ + l], S[RATIO_ + l], S[SHARED_ + l])
                for l in range(LANES if rigid is not None else n):
                    _, S[INSTANT_ + l], _, _ = _load_of(p[l], on[l])
                    for _, first in AT_REST:
                        S[(FIRST_PARAMETER + first + 1) * LANES + l] = p[l, first + 1]
            if direct:
                for l in range(LANES):
                    S[U_ + l] = S[COMMAND_ + l]
            else:
                if prompt:
                    for l in range(LANES):
                        S[MEAN_ + l], S[RISE_ + l], S[TURNED_ + l] = S[COMMAND_ + l], 0.0, 0.0
                command = (-1, -1, 0.0, 0.0)  # of which the last lane has its own
                for l in range(0 if prompt else n):
                    own_command = (origin[l], joints * l // LANES, S[LATE_ + l], S[MINE_ + l])
                    if i < S[MINE_ + l] and own_command != command:
                        command = own_command
                        a, joint, late, steps = command
                        b = a + ends_at[l]
                        mean, rise, turned = _amplifier(min(k, ends_at[l] - 1), i, int(steps), late / dt, hold[joint],
                                                        u[a:b, joint], cumulative[a:b, joint])
                    S[MEAN_ + l], S[RISE_ + l], S[TURNED_ + l] = mean, rise, turned
                if has[0] and not at_once:
                    _commanded_lanes(S, p, on, all_on, whole, since, to, now, h, draws)
                for l in range(n if has[0] and at_once else 0):
                    if not (own[l, 0] or S[LAGGED_ + l] > 0.0):
                        S[RISE_ + l] = 0.0 if euler else S[RISE_ + l]
                        continue
                    S[MEAN_ + l], S[RISE_ + l], S[LAG_ + l] = _through(
                        S[MEAN_ + l], S[RISE_ + l], S[TURNED_ + l], now, h, S[Q_ + l], S[DQ_ + l], S[W_ + l],
                        S[LAG_ + l], p[l], on[l], own[l, 0], euler)
                if lags and not at_once:
                    for l in range(LANES):
                        there = S[LAGGED_ + l]
                        through, slope, lag = _low_pass(S[MEAN_ + l], S[RISE_ + l], S[LAG_ + l], h, S[LAG_TIME_ + l])
                        S[MEAN_ + l] = there * through + (1.0 - there) * S[MEAN_ + l]
                        S[RISE_ + l] = there * slope + (1.0 - there) * S[RISE_ + l]
                        S[LAG_ + l] = there * lag + (1.0 - there) * S[LAG_ + l]
                if euler and not at_once:
                    for l in range(LANES):
                        S[RISE_ + l] = 0.0
            _copied(S, RESIST_, OUTER_, 1)
            if _bristled(any_on):
                for l in range(n):
                    if _bristled(on[l]):
                        torque, S[Z_ + l], S[BRISTLE_ + l] = _bristle(S[Z_ + l], S[DQ_ + l], h, p[l], on[l])
                        S[RESIST_ + l] += torque
            for l in range(LANES):
                S[SPAN_ + l] = S[LEFT_ + l] = h
                S[BEGIN_ + l] = now
            if calm < fine:
                for l in range(LANES):
                    S[SPAN_ + l] = S[LEFT_ + l] = S[OWN_STEP_ + l] * (1.0 * (i < S[MINE_ + l]))
                    S[BEGIN_ + l] = t[k] - t0 + i * S[OWN_STEP_ + l]
            for event in range(7):  # lanes that are done have a span of zero
                stage = 0
                if has[3]:
                    resting = stopped = asked = False
                    for l in range(LANES):
                        S[SIGN_ + l] = 1.0 * (S[DQ_ + l] > 0.0) - 1.0 * (S[DQ_ + l] < 0.0)
                        S[FREE_ + l] = 1.0
                        S[STOPPED_ + l] = 0.0
                    for l in range(n):
                        resting = resting or S[DQ_ + l] == 0.0
                while stage < 4:  # the stages of the Runge-Kutta step, one after the other in the same machine code
                    share = 0.0 if stage == 0 else (0.5 if stage < 3 else 1.0)
                    for l in range(LANES):
                        ahead = share * S[SPAN_ + l]
                        S[AHEAD_ + l] = ahead
                        S[T_ + l] = S[BEGIN_ + l] + ahead
                        S[QS_ + l] = S[Q_ + l] + ahead * S[DQS_ + l]
                        S[DQS_ + l] = S[DQ_ + l] + ahead * S[DDQ_ + l]
                        S[WS_ + l] = S[W_ + l] + ahead * S[DW_ + l]
                    if split:
                        for l in range(LANES):
                            S[QLS_ + l] = S[QL_ + l] + S[AHEAD_ + l] * S[DQLS_ + l]
                            S[DQLS_ + l] = S[DQL_ + l] + S[AHEAD_ + l] * S[DDQL_ + l]
                    if warm:
                        for l in range(LANES):
                            S[HEATS_ + l] = S[HEAT_ + l] + S[AHEAD_ + l] * S[DHEAT_ + l]
                    if not direct and calm < fine:
                        for l in range(LANES):
                            place = (S[OWN_STEP_ + l] - S[LEFT_ + l] + S[AHEAD_ + l]) * S[PER_STEP_ + l] - 0.5
                            S[U_ + l] = S[MEAN_ + l] + S[RISE_ + l] * place
                    elif not direct:
                        for l in range(LANES):
                            place = (h - S[LEFT_ + l] + S[AHEAD_ + l]) * per_step - 0.5
                            S[U_ + l] = S[MEAN_ + l] + S[RISE_ + l] * place
                    _rates_lanes(S, p, on, any_on, all_on, whole, since, to, has, parted, xs, n, split, shared, weighs,
                                 motor, rippled, limited, warm, ends, rigid, hanging, several, stage == 0)
                    if stage == 0:
                        for l in range(n):
                            if S[SPAN_ + l] > 0.0:
                                S[W_ + l] = S[WS_ + l]
                        if has[3]:
                            again = False
                            if rigid is not None and resting:
                                again = _held_pairs(S, asked)
                                asked = True
                            for l in range(n if rigid is None and resting else 0):
                                if S[SIGN_ + l] == 0.0 and S[FREE_ + l] > 0.0 and S[LEVEL_ + l] > 0.0 < S[SPAN_ + l]:
                                    again = True
                                    if abs(S[R_ + l]) <= S[LEVEL_ + l]:  # it stays at rest
                                        S[FREE_ + l] = 0.0
                                    else:  # it breaks away
                                        S[SIGN_ + l] = 1.0 if S[R_ + l] > 0.0 else -1.0
                            if again:
                                continue
                            _copied(S, DRY_, LEVEL_, 1)
                            _copied(S, FIRST_Q_, DQS_, RATES)
                        _copied(S, SUM_Q_, DQS_, RATES)
                        if euler:
                            stage = 3
                            for l in range(LANES):
                                S[SUM_W_ + l] *= 6.0
                                S[SUM_HEAT_ + l] *= 6.0
                                S[SUM_DQ_ + l] *= 6.0
                                S[SUM_DQL_ + l] *= 6.0
                                S[SUM_Q_ + l] = 6.0 * S[DQ_ + l] + S[SPAN_ + l] * S[SUM_DQ_ + l]
                                S[SUM_QL_ + l] = 6.0 * S[DQL_ + l] + S[SPAN_ + l] * S[SUM_DQL_ + l]
                    else:
                        weight = 2.0 if stage < 3 else 1.0
                        _added(S, SUM_Q_, weight, DQS_)
                        _added(S, SUM_DQ_, weight, DDQ_)
                        _added(S, SUM_W_, weight, DW_)
                        if warm:
                            _added(S, SUM_HEAT_, weight, DHEAT_)
                        if split:
                            _added(S, SUM_QL_, weight, DQLS_)
                            _added(S, SUM_DQL_, weight, DDQL_)
                    stage += 1
                    if stage == 4 and has[3] and event < 6 and not euler:
                        again = False
                        for l in range(LANES):
                            S[TOTAL_ + l] = S[SPAN_ + l] / 6.0 * S[SUM_DQ_ + l]
                            S[REVERSED_ + l] = (S[DQ_ + l] + S[TOTAL_ + l]) * S[DQ_ + l]
                        if rigid is not None:
                            again = _stopping_pairs(S)
                            stopped = stopped or again
                        for l in range(n if rigid is None else 0):
                            if S[REVERSED_ + l] < 0.0 and S[STOPPED_ + l] == 0.0 and S[DRY_ + l] > 0.0:
                                # it would reverse: its step ends where it stops
                                first = S[SPAN_ + l] * S[FIRST_DQ_ + l]
                                S[SPAN_ + l] *= _crossing(S[DQ_ + l], first, S[TOTAL_ + l])
                                S[STOPPED_ + l], again, stopped = 1.0, True, True
                        if again:
                            stage = 1
                            _copied(S, DQS_, FIRST_Q_, RATES)
                            _copied(S, SUM_Q_, FIRST_Q_, RATES)
                for l in range(LANES):
                    S[STEP_ + l] = S[SPAN_ + l] / 6.0
                    S[Q_ + l] += S[STEP_ + l] * S[SUM_Q_ + l]
                    S[DQ_ + l] += S[STEP_ + l] * S[SUM_DQ_ + l]
                if motor == LAGGING:
                    _pushed(S, W_, STEP_, SUM_W_)
                else:
                    for l in range(n):
                        if p[l, ELECTRICAL] > 0.0:
                            S[W_ + l] += S[STEP_ + l] * S[SUM_W_ + l]
                        elif S[SPAN_ + l] > 0.0:
                            S[W_ + l] = S[WS_ + l]
                if warm:
                    _pushed(S, HEAT_, STEP_, SUM_HEAT_)
                if split:
                    _pushed(S, QL_, STEP_, SUM_QL_)
                    _pushed(S, DQL_, STEP_, SUM_DQL_)
                if not stopped:
                    break
                again = False
                for l in range(LANES):
                    left, ended = 0.0, S[STOPPED_ + l] > 0.0
                    if ended:
                        S[DQ_ + l] = 0.0
                    if rigid is not None:  # if one of the two stops, both go on from there
                        ended = ended or S[STOPPED_ + (l + HALF) % LANES] > 0.0
                    if ended:
                        S[BEGIN_ + l] += S[SPAN_ + l]
                        S[LEFT_ + l] -= S[SPAN_ + l]
                        left = max(S[LEFT_ + l], 0.0)
                        again = again or left > 0.0
                    S[SPAN_ + l] = left
                if not again:
                    break
        for l in range(n):
            runs = abs(S[DQ_ + l]) < 1e9
            if rigid is not None:
                runs = runs and abs(S[DQ_ + (l + HALF) % LANES]) < 1e9 and lasted[(l + HALF) % LANES] == T
            if not runs:
                if lasted[l] == T:
                    lasted[l] = k + 1
                    alive -= 1
                for row in range(STATES):
                    S[row * LANES + l] = 0.0
        if alive == 0:
            break
    for l in range(n):
        for k in range(lasted[l], ends_at[l]):
            out[rows[l], origin[l] + k] = 1e6


@njit(cache=True, error_model='numpy', nogil=True)
def batch_one(t, u, cumulative, hold, y, x, extra, bounds, starts, P, on, pair, rigid, leak, rate_leak, substeps, out,
              motion, log, logs, first, last):
    """Runs first to last of all those of a single joint's candidates on so many logs from `log` on, which have the same
    instants as far as they go: all candidates on one log, then on the next. In lanes as far as they take the same steps
    and have the same transmission: a mixture of these would be simulated one by one.

    Shapes as those of `batch`; motion (C, T, 3) or empty.
    """
    count = len(P)
    rows, begins = np.zeros(LANES, dtype=np.int64), np.zeros(LANES, dtype=np.int64)
    lengths = np.zeros(LANES, dtype=np.int64)
    begin, own = np.zeros((LANES, starts.shape[3])), np.zeros((LANES, P.shape[3]))
    switches = np.zeros((LANES, on.shape[2]), dtype=np.bool_)
    dt = t[bounds[log] + 1] - t[bounds[log]]
    xo = x[:, 0] if x.shape[0] > 0 else np.zeros((0, 3))
    eo = extra[:, :, 0] if extra.shape[0] > 0 else np.zeros((0, 0))
    a = first
    while a < last:
        n, longest, steps, calm = 0, log + a // count, 0, 0
        while a + n < last and n < LANES:
            c, its_log = (a + n) % count, log + (a + n) // count
            _put(begin[n], starts[c, its_log, 0])
            _put(own[n], P[c, its_log, 0])
            _put(switches[n], on[c, 0])
            its_steps = _steps(own[n : n + 1], switches[n : n + 1], dt, substeps)
            its_calm = _calm_steps(own[n : n + 1], switches[n : n + 1], dt, substeps)
            if n == 0:
                steps, calm = its_steps, its_calm
            elif not (
                (own[n, STEPPING] > 0.0) == (own[0, STEPPING] > 0.0) and its_steps == steps and its_calm == calm
                and _flexible(switches[n]) == _flexible(switches[0]) and _playing(switches[n]) == _playing(switches[0])
            ):
                break
            rows[n], begins[n], lengths[n] = c, bounds[its_log], bounds[its_log + 1] - bounds[its_log]
            if lengths[n] > bounds[longest + 1] - bounds[longest]:
                longest = its_log
            n += 1
        run_lanes(t[bounds[longest] : bounds[longest + 1]], u, cumulative, hold, y, xo, eo, rows[:n], begins[:n],
                  lengths[:n], begin[:n], own[:n], switches[:n], leak, rate_leak, steps, calm, out[:, :, 0], motion,
                  None)
        a += n


@njit(cache=True, error_model='numpy', nogil=True)
def batch_pair(t, u, cumulative, hold, y, x, extra, bounds, starts, P, on, pair, rigid, leak, rate_leak, substeps, out,
               motion, log, logs, first, last):
    """Runs first to last of all those of a planar pair's candidates, without neighbours, on so many logs from `log` on,
    which have the same instants as far as they go, as `batch_one`.

    Lanes that are left over repeat the last run.
    """
    count, dt = len(P), t[bounds[log] + 1] - t[bounds[log]]
    row, own = np.zeros((LANES, P.shape[3])), np.zeros((LANES, on.shape[2]), dtype=np.bool_)
    begin, constants, errors = np.zeros((LANES, starts.shape[3])), np.zeros((HALF, 3)), np.zeros((LANES, len(t)))
    rows, begins, lengths = np.arange(LANES), np.zeros(LANES, dtype=np.int64), np.zeros(LANES, dtype=np.int64)
    outer = np.zeros((LANES if extra.shape[0] > 0 else 0, len(t) if extra.shape[0] > 0 else 0))
    a = first
    while a < last:
        c, its_log = a % count, log + a // count
        steps, stepping = _steps(P[c, its_log], on[c], dt, substeps), P[c, its_log, 0, STEPPING] > 0.0
        b = a + 1
        while b < last and b < a + HALF:
            c, its_log = b % count, log + b // count
            if (P[c, its_log, 0, STEPPING] > 0.0) != stepping or _steps(P[c, its_log], on[c], dt, substeps) != steps:
                break
            b += 1
        longest = log + a // count
        for l in range(LANES):
            item, joint = min(a + l % HALF, b - 1), l // HALF
            c, its_log = item % count, log + item // count
            _put(row[l], P[c, its_log, joint])
            _put(own[l], on[c, joint])
            _put(begin[l], starts[c, its_log, joint])
            _as_weight(row[l], own[l])
            constants[l % HALF] = rigid[c]
            lo, hi = bounds[its_log], bounds[its_log + 1]
            begins[l], lengths[l] = lo, hi - lo
            if hi - lo > bounds[longest + 1] - bounds[longest]:
                longest = its_log
            if extra.shape[0] > 0:
                _put(outer[l, lo:hi], extra[c, lo:hi, joint])
        run_lanes(t[bounds[longest] : bounds[longest + 1]], u, cumulative, hold, y, np.zeros((0, 3)), outer, rows,
                  begins, lengths, begin, row, own, leak, rate_leak, steps, steps, errors, motion, constants)
        for item in range(a, b):
            c, its_log = item % count, log + item // count
            lo, hi = bounds[its_log], bounds[its_log + 1]
            for joint in range(2):
                _put(out[c, lo:hi, joint], errors[item - a + joint * HALF, lo:hi])
        a = b


@njit(cache=True, error_model='numpy', nogil=True)
def batch(t, u, cumulative, hold, y, x, extra, bounds, starts, P, on, pair, rigid, leak, rate_leak, substeps, out,
          first, last):
    """Runs first to last of all C L: candidates (first axis of P and starts) on logs (bounds (L + 1,)), of more than
    one joint.

    out (C, T, n).
    """
    logs = bounds.shape[0] - 1
    empty = np.zeros((0, u.shape[1], 3))
    for task in range(first, last):
        b, l = task // logs, task % logs
        lo, hi = bounds[l], bounds[l + 1]
        xl = x[lo:hi] if x.shape[0] > 0 else x
        el = extra[b, lo:hi] if extra.shape[0] > 0 else np.zeros((0, u.shape[1]))
        run(t[lo:hi], u[lo:hi], cumulative[lo:hi], hold, y[lo:hi], xl, el, starts[b, l], P[b, l], on[b],
            pair, rigid[b], leak, rate_leak, substeps, out[b, lo:hi], empty)
'''
