"""Cable spring: cables and hoses pull the joint towards an angle of rest.

Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, section 9 (springs).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter, Scales


def torque(t, q, dq, w, x, p):
    """stiffness q - pull."""
    return p[0] * q - p[1]


EFFECT = Effect(
    name="cable_spring",
    stage="arm",
    slot="torque",
    parameters=(
        EffectParameter("stiffness", "torque per position", "torque per angle", lower=0.0),
        EffectParameter("pull", "torque", "stiffness times angle of rest"),
    ),
    equation=r"\tau = k\,(q - q_r)",
    variable="position",
    source="Khalil and Dombre",
    amplitudes=(0, 1),
    starts=lambda s: [(0.02 * s.torque_rms / s.position_span, 0.01 * s.torque_rms)],
    function=torque,
    includes=("amplifier_offset",),
)


def stiffening(t, q, dq, w, x, p):
    """(stiffness q - pull) (1 + stiffening (q - rest)^2), at rest where stiffness times angle is the pull."""
    pull = p[0] * q - p[1]
    way = pull / max(p[0], 1e-300)
    return pull * (1.0 + p[2] * way * way)


def of_a_spring(p: Sequence[float], scales: Scales) -> bool:
    """Whether the stiffness at most doubles on the way: what has hardly any at rest is a stop, or no cable."""
    far = 0.5 * scales.position_span + abs(scales.position_mean - p[1] / max(p[0], 1e-300))
    return p[2] * far * far < 1.0


def starts(scales: Scales) -> Iterator[tuple[float, float, float]]:
    for growth in (0.1, 0.5):
        yield (
            0.02 * scales.torque_rms / scales.position_span,
            0.01 * scales.torque_rms,
            growth * (2.0 / scales.position_span) ** 2,
        )


STIFFENING = replace(
    EFFECT,
    name="cable_spring_stiffening",
    kind="cable_spring",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("stiffening", "1/position squared", "relative growth of the pull by squared deflection", 0.0),
    ),
    equation=r"\tau = k\,(q - q_r)\,[1 + c\,(q - q_r)^2]",
    source="Khalil and Dombre; hardening term: G. Duffing, Erzwungene Schwingungen (1918)",
    starts=starts,
    function=stiffening,
    includes=("cable_spring",),
    neutral=(0.0,),
    resolved=of_a_spring,
)
EFFECTS = (EFFECT, STIFFENING)
