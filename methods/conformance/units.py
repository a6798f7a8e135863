"""Units of estimates as exponents: ``V s^2/rad`` -> {V: 1, s: 2, rad: -1}."""

from __future__ import annotations

import re
from collections import Counter

ATOMS = frozenset(("V", "A", "N", "m", "s", "rad", "kg", "W", "K", "H", "ohm", "Hz", "degC"))
_ATOM = re.compile(r"([A-Za-z]+|1)(?:\^(-?\d+))?")


def exponents(unit: str) -> dict[str, int]:
    """Exponents by symbol; ``1`` is a pure number. What follows a slash divides, up to the next slash.

    Raises ValueError for anything else.
    """
    found: Counter[str] = Counter()
    for index, part in enumerate(unit.split("/")):
        factors = part.split()
        if not factors:
            raise ValueError(f"{unit!r} is incomplete. Write it like V s^2/rad, or 1 for a pure number")
        for factor in factors:
            match = _ATOM.fullmatch(factor)
            if match is None or (match[1] != "1" and match[1] not in ATOMS):
                raise ValueError(f"{factor!r} in {unit!r} is unknown. Use {', '.join(sorted(ATOMS))} as in V s^2/rad")
            if match[1] != "1":
                found[match[1]] += (1 if index == 0 else -1) * int(match[2] or 1)
    return {symbol: power for symbol, power in found.items() if power}
