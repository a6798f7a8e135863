"""Units of measured columns, checked and converted by pint.

The vocabulary is small and closed on purpose. Angles have a dimension of their own, so that a percentage or a bare
count is never taken for an angle, nor 1/s for rad/s.
"""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from envs.log import Array

if TYPE_CHECKING:
    from pint import UnitRegistry

DEFINITIONS = """
nano- = 1e-9 = n-
micro- = 1e-6 = u- = µ-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
meter = [length] = m = metre
second = [time] = s = sec
kilogram = [mass] = kg
gram = 1e-3 * kilogram = g
ampere = [current] = A
radian = [angle] = rad
kelvin = [temperature] = K
degree_Celsius = kelvin; offset: 273.15 = degC = celsius
degree_Fahrenheit = 5 / 9 * kelvin; offset: 233.15 + 200 / 9 = degF
turn = 6.283185307179586 * radian = _ = rev = revolution
degree = 0.017453292519943295 * radian = deg
gradian = 0.015707963267948967 * radian = gon
arcminute = degree / 60 = arcmin
arcsecond = degree / 3600 = arcsec
minute = 60 * second = min
hour = 3600 * second = h
rpm = turn / minute
inch = 0.0254 * meter
newton = kilogram * meter / second ** 2 = N
kilogram_force = 9.80665 * newton = kgf
pound_force = 4.4482216152605 * newton = lbf
volt = newton * meter / ampere / second = V
newton_meter = newton * meter = Nm
ohm = volt / ampere = _ = Ohm
henry = volt * second / ampere = H
watt = volt * ampere = W
percent = 0.01 = %
share = 1
count = [count]
"""

EXPRESSION = re.compile(r"(?!.*\*\*)(?!.*\^(?!-?[1-4](?![\w.^])))[A-Za-zµ%_0-9.+\-*/()^ ]+")
"""What a unit may be written with; powers are those of units."""
SIGNS = str.maketrans({"°": "deg", "·": " ", "²": "^2", "Ω": "ohm", "\u2126": "ohm", "μ": "µ"})
"""Signs of data sheets, and how the vocabulary writes them."""
NO_UNIT = ("", "-", "1")
"""Ways to write that a number has no unit."""


class UnitError(ValueError):
    """A unit that is unknown or of the wrong kind; the text says which."""


@cache
def registry() -> UnitRegistry[Any]:
    """The closed vocabulary of `DEFINITIONS`."""
    from pint import UnitRegistry

    units: UnitRegistry[Any] = UnitRegistry(None, on_redefinition="raise")
    units.load_definitions(DEFINITIONS.strip().splitlines())
    return units


def plain(unit: str) -> str:
    """A unit without the signs of data sheets: ``deg`` for ``°``, ``kg m^2`` for ``kg·m²``."""
    return unit.strip().translate(SIGNS)


def convert(values: ArrayLike, unit: str, target: str) -> Array:
    """Values in `unit` (an expression such as ``deg``, ``turn / 8192`` or ``percent * V``) as float64 in `target`.

    Raises UnitError when the expression is not understood or has another dimension than the target.
    """
    import pint

    written = plain(unit)
    if not EXPRESSION.fullmatch(written):
        raise UnitError(f"unit {unit!r} is not understood")
    try:
        parsed = registry().parse_expression(written)
        quantity = parsed if isinstance(parsed, pint.Quantity) else registry().Quantity(parsed)
        factor = float(quantity.magnitude)
        scaled = registry().Quantity(np.asarray(values, dtype=np.float64) * factor, quantity.units)
        return np.asarray(scaled.to(target).magnitude, dtype=np.float64)
    except pint.DimensionalityError:
        raise UnitError(f"unit {unit!r} cannot be converted to {target}{hint(unit, target)}") from None
    except pint.UndefinedUnitError as error:
        names = error.unit_names
        raise UnitError(f"unit {names if isinstance(names, str) else ', '.join(names)!r} is unknown") from None
    except (pint.PintError, AssertionError, SyntaxError, TypeError, ValueError, ArithmeticError):
        raise UnitError(f"unit {unit!r} is not understood") from None


def is_unit(text: str) -> bool:
    """Whether a text is a unit of the vocabulary, such as ``deg/s``; a bare number is none."""
    import pint

    written = plain(text)
    if not EXPRESSION.fullmatch(written):
        return False
    try:
        return isinstance(registry().parse_expression(written), pint.Quantity)
    except (pint.PintError, AssertionError, SyntaxError, TypeError, ValueError, ArithmeticError):
        return False


def hint(unit: str, target: str) -> str:
    """What to write instead, for the mistakes that are made most."""
    if "count" in unit:
        return ": write turn / COUNTS_PER_TURN" if "rad" in target else f": write {target} / COUNTS_PER_UNIT"
    if unit in ("percent", "share", "%") and target == "V":
        return ": a share of the supply needs times = COLUMN_OF_THE_SUPPLY or unit = 'V / 100'"
    return ""
