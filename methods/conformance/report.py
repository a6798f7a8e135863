"""Results of a conformance check as text, and the exit status."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable

from methods.conformance.check import Outcome, Result


def tell(results: Iterable[Result], say: Callable[[str], None]) -> bool:
    """Say one line per check as it ends, and how many ended how; True when none failed."""
    counts: Counter[Outcome] = Counter()
    for result in results:
        counts[result.outcome] += 1
        say(result.line)
    ends = [f"{counts[outcome]} {outcome.value}" for outcome in Outcome if counts[outcome]]
    say(f"{sum(counts.values())} checks: {', '.join(ends)}")
    return not counts[Outcome.FAILED]
