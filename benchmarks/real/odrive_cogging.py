"""Direct-drive motor: cogging found in the static map and in slow motion, and a current that is logged too late."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from benchmarks.real import drawing
from benchmarks.real.diagnosed import said
from benchmarks.real.outcome import Outcome, Picture, Section, Table, rows
from envs.log import Array, Log
from envs.rigs import rig
from envs.rigs.odrive_cogging import cogging_map

NAME = "odrive_cogging"
SMOOTHING = 0.045
"""Window of the local cubic fits of position and current [s]."""
THINNED = 5
"""Every so many samples are kept after smoothing."""
HOMING = 0.5
"""Time at the beginning of a recording in which the rotor may return to its zero [s]."""
ORDERS: list[float] = np.arange(1.0, 128.0, 0.05).tolist()
"""Cycles per revolution that are searched; nothing says beforehand that they are whole."""
SIGNIFICANT = 6.0
"""An order is kept while its amplitude exceeds this many of its standard deviations."""
MOST = 12
"""Orders that are looked for at most."""
SAME = 0.3
"""Distance in orders within which two findings are the same."""
APART = 0.7
"""Least distance of two orders, in units of what one passage over the recorded angle resolves."""


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Orders [cycles per revolution] with amplitudes, their standard deviations and phases, each (K,).

    The current is sum amplitude sin(order q + phase) beside the columns of `base`, whose coefficients are `rest`.
    """

    orders: Array
    amplitudes: Array
    deviations: Array
    phases: Array
    rest: Array
    residual: float

    def current(self, q: Array) -> Array:
        """Cogging current at positions (T,)."""
        found: Array = np.sum(self.amplitudes * np.sin(np.outer(q, self.orders) + self.phases), axis=1)
        return found


@dataclass(frozen=True, eq=False)
class Motion:
    """Smoothed signals of one recording on a regular clock, each (T,); the homing is left out."""

    name: str
    position: Array
    velocity: Array
    acceleration: Array
    current: Array
    current_rate: Array

    def base(self, lag: bool = True) -> Array:
        """Columns beside cogging: acceleration, velocity, one; and the current's rate where it is logged late."""
        columns = [self.acceleration, self.velocity, np.ones_like(self.position)]
        return np.column_stack([*columns, self.current_rate] if lag else columns)


def motion(log: Log) -> Motion:
    """Signals of a recording after its homing."""
    step = log.sample_time
    time = np.arange(log.time[0], log.time[-1], step)
    q, i = (np.interp(time, log.time, signal[:, 0]) for signal in (log.position, log.command))
    span = 2 * round(0.5 * SMOOTHING / step) + 1
    smooth = lambda x, order: savgol_filter(x, span, 3, deriv=order, delta=step)  # noqa: E731
    signals = (smooth(q, 0), smooth(q, 1), smooth(q, 2), smooth(i, 0), smooth(i, 1))
    keep = np.flatnonzero((time > time[0] + HOMING) & (time < time[-1] - 0.1))[::THINNED]
    return Motion(log.name.removeprefix(f"{NAME}/"), *(s[keep] for s in signals))


def pursue(q: Array, base: Array, target: Array, correlation: int, most: int = MOST) -> Harmonics:
    """Orders one after the other: the one that explains most beside everything found so far, then all refined.

    correlation: samples over which the residual is correlated; standard deviations count every one of these only once.
    """
    orders: list[float] = []
    scale = np.sqrt(np.mean(base**2, axis=0))
    base = base / scale
    resolution = 2.0 * np.pi / np.ptp(q)
    while True:
        found = _solve(q, base, target, orders, scale, correlation)
        if orders and found.amplitudes[-1] < SIGNIFICANT * found.deviations[-1]:
            orders = _refined(q, base, target, orders[:-1])
            return _solve(q, base, target, orders, scale, correlation)
        if len(orders) == most:
            return found
        columns = _columns(q, base, orders)
        residual = target - columns @ np.linalg.lstsq(columns, target, rcond=1e-9)[0]
        basis = np.linalg.qr(columns)[0]
        free = [order for order in ORDERS if all(abs(order - other) > APART * resolution for other in orders)]
        best = max(free, key=lambda order: _explained(q, basis, residual, order))
        orders = _refined(q, base, target, [*orders, best])


def _refined(q: Array, base: Array, target: Array, orders: Sequence[float]) -> list[float]:
    """Orders that fit best together with everything else (Gauss-Newton, steps of at most a tenth of an order)."""
    current = list(orders)
    for _ in range(4):
        columns = _columns(q, base, current)
        solution = np.linalg.lstsq(columns, target, rcond=1e-9)[0]
        waves = solution[base.shape[1] :].reshape(-1, 2)
        slopes = [q * (s * np.cos(o * q) - c * np.sin(o * q)) for o, (s, c) in zip(current, waves, strict=True)]
        step = np.linalg.lstsq(np.column_stack([columns, *slopes]), target, rcond=1e-9)[0][columns.shape[1] :]
        current = [o + float(np.clip(d, -0.1, 0.1)) for o, d in zip(current, step, strict=True)]
    return current


def _columns(q: Array, base: Array, orders: Sequence[float]) -> Array:
    waves = [f(order * q) for order in orders for f in (np.sin, np.cos)]
    return np.column_stack([base, *waves])


def _explained(q: Array, basis: Array, residual: Array, order: float) -> float:
    """Sum of squares that a sine and a cosine explain beside an orthonormal basis."""
    pair = np.column_stack([np.sin(order * q), np.cos(order * q)])
    pair = pair - basis @ (basis.T @ pair)
    gram, right = pair.T @ pair, pair.T @ residual
    if np.linalg.det(gram) < 1e-3 * len(q) ** 2 * 0.25:
        return 0.0
    return float(right @ np.linalg.solve(gram, right))


def _solve(q: Array, base: Array, target: Array, orders: Sequence[float], scale: Array, correlation: int) -> Harmonics:
    columns = _columns(q, base, orders)
    solution = np.linalg.lstsq(columns, target, rcond=1e-9)[0]
    residual = target - columns @ solution
    width = base.shape[1]
    spread = correlation * np.mean(residual**2) * np.linalg.pinv(columns.T @ columns)
    sine, cosine = solution[width::2], solution[width + 1 :: 2]
    variance = np.maximum(np.diag(spread)[width::2], np.diag(spread)[width + 1 :: 2])
    return Harmonics(
        np.array(orders, dtype=float),
        np.hypot(sine, cosine),
        np.sqrt(variance),
        np.arctan2(cosine, sine),
        solution[:width] / scale,
        float(np.sqrt(np.mean(residual**2))),
    )


def at(q: Array, base: Array, target: Array, orders: Array, correlation: int) -> Harmonics:
    """Amplitudes and phases at given orders."""
    scale = np.sqrt(np.mean(base**2, axis=0))
    return _solve(q, base / scale, target, list(orders), scale, correlation)


def joined(parts: Sequence[Motion], lag: bool = True) -> tuple[Array, Array, Array]:
    """Positions, base columns and currents of several recordings."""
    return (
        np.concatenate([p.position for p in parts]),
        np.concatenate([p.base(lag) for p in parts]),
        np.concatenate([p.current for p in parts]),
    )


def prediction_error(part: Motion, found: Harmonics, lag: bool = True) -> float:
    """Rms [A] of the current that a model fitted elsewhere does not predict; only the constant is the recording's own.

    The constant is friction and the offset of the current sensor, which moves by some hundredths of an ampere.
    """
    base = part.base(lag)
    predicted = base @ found.rest + found.current(part.position)
    return float(np.std(part.current - predicted))


def repeatability(parts: Sequence[Motion]) -> float:
    """Rms [A] by which the current at the same position differs from one recording to the next, over sqrt 2."""
    grid = np.linspace(0.6, 5.9, 2000)
    curves = []
    for part in parts:
        order = np.argsort(part.position)
        curves.append(np.interp(grid, part.position[order], part.current[order]))
    differences = [a - b for i, a in enumerate(curves) for b in curves[:i]]
    return float(np.sqrt(np.mean([np.var(d) for d in differences]) / 2.0))


def run() -> Outcome:
    """Everything about this rig."""
    machine = rig(NAME)
    parts = {r.name: motion(machine.log(r.name)) for r in machine.runs if r.name.startswith("slow2")}
    learn = [parts[r.name] for r in machine.runs if r.role == "fit"]
    test = [parts[r.name] for r in machine.runs if r.role == "held_out"]
    correlation = round(SMOOTHING / (THINNED * machine.log("slow2/nocomp_0").sample_time))
    static = static_harmonics("a_4")
    q, base, current = joined(learn)
    found = pursue(q, base, current, correlation)
    slower = parts["slow2_slower/nocomp_0"]
    slow = at(slower.position, slower.base(), slower.current, found.orders, correlation)
    sections: list[Section] = []
    numbers: dict[str, float] = {}
    for section, more in (
        wrong_section(learn),
        agreement_section(static, found, slow),
        ladder_section(learn, test, static, found, parts, correlation),
        static_section(static),
        compensation_section(parts),
        left_section(learn, found, static),
    ):
        sections.append(section)
        numbers |= more
    engine = said(machine.logs("fit"), [machine.log("slow2/nocomp_2")], NAME)
    summary = (
        f"Cogging was found, not given: in motion the orders {listed(found)} per revolution, in the static map "
        f"{listed(static)}; {int(numbers['orders in both'])} of the {int(numbers['orders in motion'])} orders found "
        f"in motion are also found at rest, and the amplitudes of the five largest agree within "
        f"{100 * numbers['amplitude difference, five largest']:.0f} % at 0.03 rev/s.",
        f"What everybody would take for the input is not: the logged current is low-passed with "
        f"{1e3 * numbers['lag']:.0f} ± {1e3 * numbers['lag: deviation']:.0f} ms. Left out, the error that remains "
        f"beside cogging is {numbers['without lag'] / numbers['held-out: extended']:.1f} times as large.",
        f"Current on runs that were not fitted: {numbers['held-out: nominal']:.3f} A without cogging, "
        f"{numbers['held-out: extended']:.3f} A with lag and {int(numbers['orders in motion'])} orders; two "
        f"recordings of the same motion differ by {numbers['repeatability']:.3f} A.",
        f"The order 7, the largest, is mostly not the motor's own: without the neighbouring motor it falls from "
        f"{numbers['order 7 with neighbour']:.2f} to {numbers['order 7 without neighbour']:.2f} A.",
    )
    return Outcome(NAME, machine.title, summary, (*sections, engine.section), numbers)


def listed(found: Harmonics) -> str:
    """Orders in the order of their amplitude, to a hundredth where they are not whole."""
    by_size = np.argsort(-found.amplitudes)
    return ", ".join(f"{found.orders[i]:.2f}".rstrip("0").rstrip(".") for i in by_size)


def static_harmonics(name: str) -> Harmonics:
    """Orders of a static map, found by pursuit."""
    q, current = cogging_map(name)
    return pursue(q, np.ones((len(q), 1)), current, max(1, round(len(q) / 512)))


def wrong_section(learn: Sequence[Motion]) -> tuple[Section, dict[str, float]]:
    """Current against position, and what the lag of the logged current does."""
    _, base, current = joined(learn, lag=False)
    plain = np.linalg.lstsq(base, current, rcond=None)[0]
    drawn, axes = drawing.figure(1, 2, 2.7)
    for part, color in zip(learn, (drawing.MEASURED, drawing.AFTER), strict=False):
        axes[0, 0].plot(*drawing.thin(part.position, part.current), color=color, label=part.name)
    axes[0, 0].plot(*drawing.thin(learn[0].position, learn[0].base(lag=False) @ plain), color=drawing.BEFORE,
                    label="inertia, viscous and dry friction")  # fmt: skip
    axes[0, 0].set_xlabel("position [rad]")
    axes[0, 0].set_ylabel("current [A]")
    axes[0, 0].legend(fontsize=7)
    position, holding = cogging_map("a_4")
    axes[0, 1].plot(*drawing.thin(position, holding), color=drawing.OTHER, label="static map")
    axes[0, 1].plot(
        *drawing.thin(learn[0].position, learn[0].current), color=drawing.MEASURED, label="0.10 rev/s, as logged"
    )
    axes[0, 1].set_xlim(1.0, 3.0)
    axes[0, 1].set_xlabel("position [rad]")
    axes[0, 1].legend(fontsize=7)
    numbers = {"nominal: fitted": float(np.std(current - base @ plain)), "inertia without lag": float(plain[0])}
    text = (
        "A rotor with inertia and friction needs almost no current at 0.1 rev/s. The recorded current swings by more "
        "than two amperes, in the same places in every recording. Beside the static map it lags and is smaller.",
    )
    caption = "Current over position: two recordings and the nominal model (left); static map and motion (right)."
    picture = Picture("current", caption, drawing.svg(drawn, "odwrong"))
    return Section("What the nominal model gets wrong", text, (picture,)), numbers


def turned(angle: float) -> float:
    """An angle between -pi and pi."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def agreement_section(static: Harmonics, found: Harmonics, slow: Harmonics) -> tuple[Section, dict[str, float]]:
    """Orders, amplitudes and phases of the static map beside those of the motion."""
    found_rows, differences = [], []
    both = 0
    for i in np.argsort(-found.amplitudes):
        near = np.flatnonzero(np.abs(static.orders - found.orders[i]) < SAME)
        both += bool(len(near))
        s = int(near[0]) if len(near) else None
        at_rest: tuple[float | None, ...] = (None, None, None, None)
        if s is not None:
            shifts = (turned(h.phases[i] - static.phases[s]) for h in (found, slow))
            at_rest = (static.orders[s], static.amplitudes[s], *shifts)
        moving = (found.orders[i], found.amplitudes[i], found.deviations[i], slow.amplitudes[i], slow.deviations[i])
        found_rows.append((*moving, *at_rest))
        if s is not None:
            differences.append(abs(slow.amplitudes[i] / static.amplitudes[s] - 1.0))
    table = Table(
        "harmonics",
        "Cogging found in motion (fitted runs, 0.10 rev/s; amplitudes at 0.03 rev/s beside) and in the static map",
        ("order in motion", "amplitude 0.10 rev/s [A]", "std", "amplitude 0.03 rev/s [A]", "std", "order at rest",
         "amplitude at rest [A]", "phase difference 0.10 [rad]", "phase difference 0.03 [rad]"),
        rows(found_rows),
    )  # fmt: skip
    only = [f"{o:.2f} ({a:.3f} A)" for o, a in zip(static.orders, static.amplitudes, strict=True)
            if np.min(np.abs(found.orders - o)) > SAME]  # fmt: skip
    drawn, axes = drawing.figure(1, 1, 2.5)
    panel = axes[0, 0]
    for h, color, label, shift in (
        (static, drawing.OTHER, "static map", -0.5), (slow, drawing.AFTER, "0.03 rev/s", 0.0),
        (found, drawing.BEFORE, "0.10 rev/s", 0.5),
    ):  # fmt: skip
        panel.vlines(h.orders + shift, 0.0, h.amplitudes, color=color, linewidth=2.5, label=label)
    panel.set_xlabel("cycles per revolution")
    panel.set_ylabel("amplitude [A]")
    panel.legend()
    numbers = {
        "orders in motion": float(len(found.orders)),
        "orders at rest": float(len(static.orders)),
        "orders in both": float(both),
        "amplitude difference, five largest": float(max(differences[:5], default=np.nan)),
        "lag": -float(found.rest[3]),
        "inertia": float(found.rest[0]),
    }
    text = (
        "Orders are found by pursuit over 2,540 candidates between 1 and 128 per revolution, none of them given; "
        "that they "
        "come out whole is a result. In motion the columns are inertia, viscous and dry friction, and the rate of the "
        "current, which stands for a first-order lag of the logged current. Phases are compared at the same encoder "
        "zero.",
        f"Found at rest only: {', '.join(only) or 'none'}." if only else "Nothing is found at rest only.",
    )
    picture = Picture(
        "harmonics", "Amplitudes over orders: at rest, at 0.03 rev/s and at 0.10 rev/s.", drawing.svg(drawn, "odorders")
    )
    return Section("Cogging: motion and static map agree", text, (picture,), (table,)), numbers


def group_error(group: Sequence[Motion], found: Harmonics, lag: bool) -> float:
    """Rms of `prediction_error` over recordings."""
    return float(np.sqrt(np.mean([prediction_error(part, found, lag) ** 2 for part in group])))


def ladder_section(
    learn: Sequence[Motion],
    test: Sequence[Motion],
    static: Harmonics,
    found: Harmonics,
    parts: dict[str, Motion],
    correlation: int,
) -> tuple[Section, dict[str, float]]:
    """Current error model by model on runs that were not fitted."""
    none = np.zeros(0)
    by_size = found.orders[np.argsort(-found.amplitudes)]
    models: list[tuple[str, Harmonics, bool]] = []
    for lag, title in ((False, "inertia and friction"), (True, "+ lag of the logged current")):
        q, base, current = joined(learn, lag)
        models.append((title, at(q, base, current, none, correlation), lag))
    for count in range(1, len(by_size) + 1):
        title = f"+ cogging, {by_size[count - 1]:.2f} per revolution"
        models.append((title, at(q, base, current, by_size[:count], correlation), True))
    without = at(*joined(learn, lag=False), by_size, correlation)
    rest = np.asarray(np.linalg.lstsq(base, current - static.current(q), rcond=None)[0], dtype=float)
    from_map = Harmonics(static.orders, static.amplitudes, static.deviations, static.phases, rest, 0.0)
    models.append(("the same orders without the lag", without, False))
    models.append(("cogging of the static map, only inertia, friction and lag fitted", from_map, True))
    same = [p for p in test if "nocomp" in p.name and "slower" not in p.name]
    groups = (
        ("fitted runs", learn),
        ("0.10 rev/s, not fitted", same),
        ("0.03 rev/s", [p for p in test if p.name == "slow2_slower/nocomp_0"]),
        ("0.10 rev/s, compensated", [p for p in test if p.name.startswith("slow2/comp")]),
        ("0.03 rev/s, compensated", [p for p in test if p.name == "slow2_slower/comp_0"]),
        ("neighbour turned", [parts["slow2_slower/crosstalk_nocomp_0"]]),
    )
    titles = [title for title, _, _ in models]
    scores = np.array([[group_error(group, m, lag) for _, group in groups] for _, m, lag in models])
    table = Table("current", "Rms error of the predicted current [A], fitted on the fitted runs only",
                  ("model", *(name for name, _ in groups)),
                  rows([(title, *row) for title, row in zip(titles, scores, strict=True)]))  # fmt: skip
    spread = repeatability([*learn, *same])
    last = models[1 + len(by_size)]
    shown = slice(0, 2 + len(by_size))
    drawn = drawing.bars(
        titles[shown],
        [
            ("fitted runs", drawing.AFTER, scores[shown, 0].tolist()),
            ("0.10 rev/s, not fitted", drawing.BEFORE, scores[shown, 1].tolist()),
        ],
        "rms error of the current [A]",
        ("repetition", spread),
    )
    q, base, current = joined(learn)
    full = np.column_stack([base, *[f(o * q) for o in by_size for f in (np.sin, np.cos)]])
    residual = current - full @ np.linalg.lstsq(full, current, rcond=None)[0]
    deviation = np.sqrt(correlation * np.mean(residual**2) * np.diag(np.linalg.inv(full.T @ full)))
    own = Table(
        "parameters",
        "Extended model: parameters beside cogging",
        ("parameter", "value", "standard deviation", "unit"),
        rows(
            [
                ("inertia over torque constant", last[1].rest[0], deviation[0], "A s^2/rad"),
                ("viscous friction over torque constant", last[1].rest[1], deviation[1], "A s/rad"),
                ("dry friction and offset", last[1].rest[2], deviation[2], "A"),
                ("lag of the logged current", -last[1].rest[3], deviation[3], "s"),
            ]
        ),
    )
    numbers = {
        "held-out: nominal": float(scores[0, 1]),
        "held-out: extended": float(scores[1 + len(by_size), 1]),
        "held-out: from the static map": float(scores[-1, 1]),
        "without lag": float(scores[-2, 1]),
        "repeatability": spread,
        "lag: deviation": float(deviation[3]),
    }
    text = (
        "Each row is fitted on two recordings at 0.10 rev/s and judged on others; only the constant is each "
        "recording's own. "
        "The last row takes cogging from the static map alone. Compensated runs are judged as well: the current has "
        "to do the same work against cogging whether the controller knows it beforehand or not.",
        "At 0.03 rev/s the same orders hold with amplitudes nearer to those at rest: what low-passes the logged "
        "current is "
        "steeper than a first-order lag, and its order is not in the log. With the neighbouring motor turned away "
        "from its place the order 7 is another one, and the model of the fitted runs fails there, as it should.",
    )
    picture = Picture("ladder", "Error of the predicted current, model by model.", drawing.svg(drawn, "odladder"))
    return Section("Effects in the order of their gain", text, (picture,), (table, own)), numbers


def static_section(static: Harmonics) -> tuple[Section, dict[str, float]]:
    """Repeats of the static map, forwards and backwards, with and without the neighbour."""
    found_rows = []
    amplitude = {}
    for name in ("a_4", "a_8", "a_16", "b_16", "c_16", "d_16", "rev_16", "e_16r", "iso_16"):
        q, current = cogging_map(name)
        h = at(q, np.ones((len(q), 1)), current, np.round(static.orders), 1)
        by = dict(zip(np.round(static.orders).astype(int), zip(h.amplitudes, h.phases, strict=True), strict=True))
        amplitude[name] = by
        found_rows.append((name, len(q), h.rest[0], *(by[o][0] if o in by else None for o in (7, 28, 14, 36, 12, 84)),
                           h.residual))  # fmt: skip
    a, b = (cogging_map(n)[1] for n in ("a_16", "b_16"))
    forward, backward = found_rows[4][2], found_rows[7][2]
    numbers = {
        "static repetition": float(np.std(a - b) / np.sqrt(2.0)),
        "order 7 with neighbour": float(amplitude["a_4"][7][0]) if 7 in amplitude["a_4"] else np.nan,
        "order 7 without neighbour": float(amplitude["iso_16"][7][0]) if 7 in amplitude["iso_16"] else np.nan,
        "dry friction from directions": 0.5 * (forward - backward),
    }
    table = Table(
        "static_maps",
        "Static maps: mean holding current and amplitudes of six orders [A]; c and e were taken after a restart that "
        "moved the zero by half a turn, rev and e backwards, iso without the neighbouring motor",
        ("map", "positions", "mean", "order 7", "order 28", "order 14", "order 36", "order 12", "order 84", "left"),
        rows(found_rows),
    )
    text = (
        f"Two maps taken one after the other differ by {numbers['static repetition']:.3f} A rms. Approached forwards "
        f"(c) and backwards (e), both at the same zero, the mean holding current differs by twice the dry friction: "
        f"{numbers['dry friction from directions']:.3f} A. Without the neighbouring motor the order 7 falls from "
        f"{numbers['order 7 with neighbour']:.2f} to {numbers['order 7 without neighbour']:.2f} A while 28, 14, 36 "
        "and 12 stay: "
        "a rotor with 7 pole pairs beside another motor's magnets. The map rev has large neighbouring orders as "
        "well; its positions were not approached in the same order, and it is not used.",
    )
    return Section("Static maps: repetition, direction, neighbour", text, (), (table,)), numbers


def left_section(learn: Sequence[Motion], found: Harmonics, static: Harmonics) -> tuple[Section, dict[str, float]]:
    """What remains of the current, and why."""
    spread = repeatability(learn)
    smaller = []
    for order, amplitude in zip(found.orders, found.amplitudes, strict=True):
        near = np.flatnonzero(np.abs(static.orders - order) < SAME)
        if len(near) and static.amplitudes[near[0]] > 0.2:
            smaller.append(1.0 - amplitude / static.amplitudes[near[0]])
    text = (
        f"{found.residual:.3f} A rms are left on the fitted runs, {spread:.3f} A do not even repeat between two "
        "recordings. "
        "The difference repeats itself, so it is physics or electronics and not noise.",
        f"Amplitudes in motion at 0.10 rev/s are up to {100 * max(smaller):.0f} % smaller than at rest even with the "
        "lag, "
        "and less so at 0.03 rev/s. A torque that depends on the angle alone cannot do that; a logged current that is "
        "filtered more steeply than by a first-order lag can. The filter of the drive's firmware is not in the log.",
        "The diagnosis knows no input that is logged late. What it names here stands below and should not be believed: "
        "its own verdict says so.",
    )
    return Section("What stays unexplained", text), {"left": found.residual}


def compensation_section(parts: dict[str, Motion]) -> tuple[Section, dict[str, float]]:
    """What the controller's own compensation does to the motion."""
    found_rows = [
        (name, float(np.mean(p.velocity)), float(np.std(p.velocity)), float(np.std(p.current)))
        for name, p in sorted(parts.items())
    ]
    table = Table(
        "compensation",
        "Slow motion with and without the controller's anti-cogging",
        ("run", "mean velocity [rad/s]", "ripple of the velocity [rad/s]", "current rms [A]"),
        rows(found_rows),
    )
    ripple = {name: row[2] for name, row in zip(sorted(parts), found_rows, strict=True)}
    ratio = np.mean([ripple[f"slow2/nocomp_{i}"] for i in range(3)]) / np.mean(
        [ripple[f"slow2/comp_{i}"] for i in range(3)]
    )
    text = (
        f"At 0.10 rev/s the compensation makes the motion {ratio:.1f} times smoother. The current stays as large: "
        "cogging has not gone, it is anticipated.",
    )
    return Section("With and without compensation", text, (), (table,)), {"ripple ratio": float(ratio)}
