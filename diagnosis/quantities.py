"""Numbers as people read them: prefixes, rounding by uncertainty, units and names written out.

Rounding follows the Particle Data Group: two digits of the standard deviation where they are at most 35, else one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

PREFIXES = {6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
PREFIXED = ("rad", "m", "s", "V", "A", "N", "N m", "Hz")
"""Units that take a prefix; others, such as 1/rev or V s^2/rad, do not."""
SUPERSCRIPT = str.maketrans("0123456789-+.", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺·")
UNDETERMINED = 1e4
"""Ratio of deviation and value beyond which a number says nothing."""
PROPER_NAMES = {"coulomb": "Coulomb", "stribeck": "Stribeck"}


def scale_for(values: Iterable[float], unit: str) -> tuple[float, str]:
    """Factor and unit in which the largest of the values has one to three digits before the point."""
    largest = max((abs(v) for v in values if math.isfinite(v)), default=0.0)
    if unit not in PREFIXED or largest == 0.0:
        return 1.0, unit
    power = min(max(3 * math.floor(math.log10(float(f"{largest:.2e}")) / 3 + 1e-9), -9), 6)
    return 10.0**-power, PREFIXES[power] + unit


def pretty_unit(unit: str) -> str:
    """``kg m^2`` as kg m² with spaces that do not break; the unit of a ratio is nothing."""
    if unit in ("1", ""):
        return ""
    parts = unit.split("^")
    text = parts[0] + "".join(part[:1].translate(SUPERSCRIPT) + part[1:] for part in parts[1:])
    return text.replace(" ", "\u00a0")


def number(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits; powers of ten where it is very large or small, a dash for none."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < max(digits + 2, 5):
        return f"{value:.{max(digits - 1 - exponent, 0)}f}".replace("-", "−")
    mantissa = value / 10.0**exponent
    return f"{mantissa:.{digits - 1}f}".replace("-", "−") + " × 10" + str(exponent).translate(SUPERSCRIPT)


def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    """A number with a prefixed unit: ``0.0412 rad`` is 41.2 mrad."""
    if value is None or not math.isfinite(value):
        return number(value)
    factor, scaled = scale_for([value], unit)
    return _with_unit(number(value * factor, digits), scaled)


def measured(value: float, std: float, unit: str) -> str:
    """A number with its standard deviation, both rounded by the deviation: ``6.9 ± 0.1 N m``."""
    if std > UNDETERMINED * abs(value) > 0.0:
        return f"{quantity(value, unit)} (not determined)"
    if not math.isfinite(std) or std <= 0.0 or not math.isfinite(value):
        return quantity(value, unit, 4)
    factor, scaled = scale_for([max(abs(value), std)], unit)
    value, std = value * factor, std * factor
    leading = std / 10.0 ** (math.floor(math.log10(std)) - 1)
    decimals = (1 if leading < 35.5 else 0) - math.floor(math.log10(std))
    exponent = math.floor(math.log10(max(abs(value), std)))
    if -4 <= exponent < 5:
        value, std = round(value, decimals), round(std, decimals)
        text = f"{value:.{max(decimals, 0)}f} ± {std:.{max(decimals, 0)}f}".replace("-", "−")
        return _with_unit(text, scaled)
    power = 10.0**exponent
    digits = max(decimals + exponent, 0)
    text = f"({value / power:.{digits}f} ± {std / power:.{digits}f})".replace("-", "−")
    return _with_unit(f"{text} × 10" + str(exponent).translate(SUPERSCRIPT), scaled)


def plain(text: str) -> str:
    """The same text with ordinary spaces, for terminals and data."""
    return text.replace("\u00a0", " ")


def unbroken(text: str) -> str:
    """Plain text whose numbers stay on one line with their units and deviations."""
    text = re.sub(r"(?<=\d) (?=[Mkmµn]?(rad|m|s|V|A|N|Hz)\b)", "\u00a0", text)
    return text.replace(" ± ", "\u00a0±\u00a0").replace("N m", "N\u00a0m")


def percent(share: float | None, digits: int = 3) -> str:
    """A share in per cent; shares short of all never round up to 100 %, and far below zero it says how many times."""
    if share is None or not math.isfinite(share):
        return "–"
    if share < -10.0:
        return f"\u2212{number(-share, 2)}\u00a0×"
    value = 100.0 * share
    text = number(value, digits)
    if value < 100.0 and text.startswith("100"):
        text = "> 99.9"
    return f"{text}\u00a0%"


def title(name: str) -> str:
    """The canonical name of an effect or a parameter in words: ``coulomb_friction`` is Coulomb friction."""
    return " ".join(PROPER_NAMES.get(word, word) for word in name.replace("_", " ").split(" "))


def sentence_case(text: str) -> str:
    """The same with a capital at the beginning."""
    return text[:1].upper() + text[1:]


def _with_unit(text: str, unit: str) -> str:
    pretty = pretty_unit(unit)
    return f"{text}\u00a0{pretty}" if pretty else text
