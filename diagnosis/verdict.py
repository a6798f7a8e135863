"""What may stay unexplained, and the verdict that follows."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.estimation import Fitted
from diagnosis.finding import Accepted, Verdict
from diagnosis.problem import Problem
from diagnosis.remainder import Remainder, beyond_chance
from diagnosis.settings import Settings


def allowance(nominal: Fitted, base: Fitted) -> float:
    """Excess of the remainder that is put down to inexact laws and integrators rather than to something missing."""
    return max(20.0, 0.005 * (nominal.criterion - base.criterion))


def unexplained(problem: Problem, explained: float, left: Sequence[Remainder], settings: Settings) -> bool:
    """Whether something is left that neither noise nor inexact laws account for.

    Where little but rounding is left a slow change of a parameter counts as other small remainders do: rounding is not
    independent of slow motion. Torques of the rest of an arm are as inexact as the measured motion of its joints:
    beside them a small remainder counts by its torque only.
    """
    exact = problem.arm is None
    excess = sum(r.excess for r in left)
    share = max(r.share for r in left)
    relevant = share > settings.relevant or (exact and share > settings.seen and excess > settings.inexact * explained)
    if excess > max(settings.unexplained * explained, 20.0) and relevant:
        return True
    for r, limit in zip(left, problem.command_limits or (0.0,) * len(left), strict=True):
        torques = ((r.disturbance_share, r.disturbance), (r.beyond_share, r.beyond))
        if any(share > settings.disturbance and size > settings.amplifier * limit for share, size in torques):
            return True
    for r in left:
        least = (settings.inexact if r.rounded else settings.minor) * explained
        for drift in r.drifts:
            if drift.is_certain and (drift.share > settings.relevant or (exact and drift.decrease > least)):
                return True
    return False


def verdict(
    problem: Problem,
    nominal: Fitted,
    final: Fitted,
    accepted: Sequence[Accepted],
    left: Sequence[Remainder],
    settings: Settings,
) -> Verdict:
    """none, named, ambiguous or unknown."""
    least = max(20.0, settings.minor * (nominal.criterion - final.criterion))
    errs = any(r.wave is not None or r.misread > least for r in left)  # the readings themselves
    rounds = any(r.coarse is not None and beyond_chance(r.coarse) > least for r in left)  # the amplifier its set point
    if errs or rounds or unexplained(problem, nominal.criterion - final.criterion, left, settings):
        return "unknown"
    if any(item.rivals for item in accepted):
        return "ambiguous"
    return "named" if accepted else "none"
