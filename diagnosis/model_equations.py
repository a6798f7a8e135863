"""The extended model of a joint as formulas: the nominal equation of motion, and one law per effect."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from diagnosis.result import JointResult, NamedEffect
from methods.effects import built_in

GRAVITY = (("gravity_sine", r"G_s \sin q"), ("gravity_cosine", r"G_c \cos q"), ("load", "L"))
SYMBOLS = {
    "inertia": "J",
    "damping": "B",
    "electrical_time_constant": "T_e",
    "gravity_sine": "G_s",
    "gravity_cosine": "G_c",
    "load": "L",
    "arm_damping": "b_l",
    "arm_friction_share": r"\lambda",
    "shared_inertia": "P",
    "coupling_inertia": "K",
}
"""Nominal parameters by the letters of the equation of motion."""
ARM = r"J r\,\ddot q_l = F"
"""How an arm behind a spring moves."""
RUBBING = (
    r"(1-\lambda)\,\tau_f(\dot q)\ \mathrm{acts\ on\ the\ motor},\quad "
    r"\lambda\,\tau_f(\dot q_l)\ \mathrm{on\ the\ arm}"
)
"""Where laws of friction act that have a share behind a spring."""
RESISTING = (r"\tau_f", r"\tau_c", r"\tau_d", r"\tau_g", r"\tau")
"""Left-hand sides of laws that resist the motion, and so join the equation of motion on its left."""
FIRST, LAST = "input_delay", "amplifier_lag"
"""Effects on the command that act before and after all others."""


@dataclass(frozen=True)
class Formula:
    """A line of the model in TeX; `effect` is None for the nominal equations."""

    tex: str
    effect: str | None


def model_equations(joint: JointResult) -> tuple[Formula, ...]:
    """Equations of the extended model, torques in units of the command; other joints enter by their effects, and the
    other one of a planar pair by the arm's own equation (q with its number)."""
    names = {parameter.name for parameter in joint.nominal}
    laws = _laws(joint.effects)
    driven = "v_a" if any(effect.stage == "amplifier" for effect in joint.effects) else "u"
    motor = r"\tau_m" if any(_side(effect.equation) == r"\tau_m" for effect in joint.effects) else "w"
    terms = [r"J\,\ddot q", r"B\,\dot q", *(term for name, term in GRAVITY if name in names)]
    if joint.beside is not None:
        terms[:] = _planar(joint, joint.beside, names)
    terms += [side for side, formula in laws if side is not None and formula.effect is not None]
    lines = []
    electrical, behind = "electrical_time_constant" in names, "arm_damping" in names
    if electrical or behind:
        terms[1] = r"b\,\dot q"
    whole = "B = b" + " + k" * electrical + " + b_l" * behind
    if electrical:
        lines.append(Formula(rf"T_e\,\dot w + w = {driven} - k\,\dot q,\quad {whole}", None))
    elif motor == "w":
        motor = driven
    lines.append(Formula(f"{' + '.join(terms)} = {motor}", None))
    if "arm_friction_share" in names:
        lines.append(Formula(RUBBING, None))
    if joint.beside is not None and f"W_{joint.beside}" in terms:
        lines.append(Formula(rf"W_{joint.beside} = \mathrm{{gravity\ of\ joint\ {joint.beside}}}", None))
    formulas = [formula for _, formula in laws]
    if behind:
        damped = ARM.replace("= F", r"+ b_l\,\dot q_l = F")
        formulas = [replace(formula, tex=formula.tex.replace(ARM, damped)) for formula in formulas]
        if not any(damped in formula.tex for formula in formulas):
            lines.append(Formula(damped, None))
        if not electrical:
            lines.append(Formula(whole, None))
    return (*lines, *formulas)


def _planar(joint: JointResult, other: int, names: set[str]) -> list[str]:
    """Terms of a joint of a planar pair (`methods.kernel`), its damping second; the other one is q with its number."""
    beside = f"q_{other}"
    rate, acceleration = rf"\dot {beside}", rf"\ddot {beside}"
    weights = [term for name, term in GRAVITY[:2] if name in names]
    load = [term for name, term in GRAVITY[2:] if name in names]
    if joint.joint < other:
        own = rf"(J + P + 2 K \cos {beside})\,\ddot q"
        driven = rf"(P + K \cos {beside})\,{acceleration} - K \sin {beside}\,(2 \dot q + {rate})\,{rate}"
        hanging = [f"W_{other}"] if weights else []
    else:
        own = r"J\,\ddot q"
        driven = rf"(P + K \cos q)\,{acceleration} + K \sin q\,{rate}^2"
        weights, hanging = [term.replace(" q", f" ({beside} + q)") for term in weights], []
    return [own, r"B\,\dot q", driven, *weights, *hanging, *load]


def _laws(effects: tuple[NamedEffect, ...]) -> list[tuple[str | None, Formula]]:
    """Laws with their symbol in the equation of motion; effects that would share a symbol are numbered."""
    sides = [_side(effect.equation) for effect in effects]
    found: list[tuple[str | None, Formula]] = []
    for index, (effect, side) in enumerate(zip(effects, sides, strict=True)):
        tex, symbol = effect.equation, side if side in RESISTING else None
        if symbol is not None and sides.count(side) > 1:
            letter = symbol.partition("_")[2]
            symbol = rf"\tau_{{{letter}{sides[: index + 1].count(side)}}}"
            tex = tex.replace(f"{side} =", f"{symbol} =", 1)
        found.append((symbol, Formula(tex, effect.name)))
    return _chained(effects, found)


def _chained(
    effects: tuple[NamedEffect, ...], laws: list[tuple[str | None, Formula]]
) -> list[tuple[str | None, Formula]]:
    """The laws with those of the amplifier in the order in which the command u passes them, which between the first and
    the last is that of their forms' names (`methods.effects.vocabulary`); what adds to the torque comes behind all of
    them. Each takes what the one before gives, and the last one gives v_a."""
    forms = {form.equation: form for form in built_in()}

    def turn(effect: NamedEffect) -> tuple[int, str]:
        form = forms.get(effect.equation)
        place = 2 if form and form.slot == "torque" else (effect.name == LAST) - (effect.name == FIRST)
        return place, form.name if form else effect.name

    chain = [i for i, effect in enumerate(effects) if effect.stage == "amplifier" and "v_a" in effect.equation]
    chain.sort(key=lambda i: turn(effects[i]))
    for place, i in enumerate(chain):
        given = f"v_{place}" if place else "u"
        made = "v_a" if place == len(chain) - 1 else f"v_{place + 1}"
        side, formula = laws[i]
        tex = re.sub(r"(?<![A-Za-z\\])v(?![A-Za-z_])", given, formula.tex).replace("v_a", made)
        laws[i] = side, replace(formula, tex=tex)
    return laws


def _side(equation: str) -> str:
    """The last left-hand side that is a torque, else the first one: laws with a state define the torque at the end."""
    sides = [part.partition("=")[0].strip() for part in equation.split(r",\ ")]
    torques = [side for side in sides if side.startswith(r"\tau")]
    return torques[-1] if torques else sides[0]
