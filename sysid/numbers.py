"""Numbers as people read them, one rounding for a value and its interval; text without invisible characters."""

from __future__ import annotations

import math

from sysid.wording import joined_words

MISSING = "\u2014"
#: No quantity of a report is so small in the unit in which it is shown: it is zero but for rounding.
_NOTHING = 1e-5


def decimals(value: float, half_width: float = math.nan, digits: int = 3) -> int:
    """Decimal places for `value`: `digits` significant ones, a fourth where the interval is narrower than about 1 %.

    A value that is zero but for rounding gets those of its interval.
    """
    if not math.isfinite(value) or value == 0.0:
        return 0 if value == 0.0 else digits
    if abs(value) < _NOTHING:
        return decimals(half_width, digits=digits) if _NOTHING <= half_width < math.inf else 0
    # The exponent after rounding: 9.999 counts as 10.0.
    leading = int(f"{value:.{digits - 1}e}".split("e")[1])
    if math.isfinite(half_width) and 0.0 < half_width < 0.012 * abs(value):
        digits += 1
    return max(digits - 1 - leading, 0)


def number(value: float | None, digits: int = 3) -> str:
    """`value` with `digits` significant digits, a dash where it is None or not finite."""
    if value is None or not math.isfinite(value):
        return MISSING
    if value != 0.0 and not 1e-3 <= abs(value) < 1e6:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        return f"{_minus(mantissa)}\u00d710{_superscript(int(exponent))}"
    return fixed(value, decimals(value, digits=digits))


def fixed(value: float | None, places: int) -> str:
    """`value` with a fixed number of decimal places and a true minus sign."""
    if value is None or not math.isfinite(value):
        return MISSING
    return _minus(f"{value:.{places}f}")


def interval(low: float | None, high: float | None, places: int) -> str:
    """``[low, high]`` with a fixed number of decimal places, empty where either end is unknown."""
    if low is None or high is None or not (math.isfinite(low) and math.isfinite(high)):
        return ""
    return f"[{fixed(low, places)}, {fixed(high, places)}]"


def percent(fraction: float | None, digits: int = 2) -> str:
    """A fraction as percent with its sign, like ``3.2 %``."""
    if fraction is None or not math.isfinite(fraction):
        return MISSING
    return f"{number(100.0 * fraction, digits)}\u00a0%"


def speed(speed_m_s: float) -> str:
    """A speed in km/h (the unit not included), without trailing zeros."""
    return f"{speed_m_s * 3.6:.3g}"


def count(quantity: int, noun: str, plural: str | None = None) -> str:
    """``1 channel``, ``2 channels``."""
    return f"{quantity:,} {noun if quantity == 1 else plural or noun + 's'}"


def listing(items: list[str], most: int = 6) -> str:
    """``a, b and c``; what exceeds `most` becomes ``and 4 more``."""
    if len(items) > most:
        return ", ".join(items[:most]) + f" and {len(items) - most} more"
    return joined_words(items)


def _minus(text: str) -> str:
    # "-0.0" is zero after rounding.
    stripped = text.lstrip("-")
    negative = text.startswith("-") and float(stripped) != 0.0
    return ("\u2212" if negative else "") + stripped


def _superscript(exponent: int) -> str:
    return str(exponent).translate(
        str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
    )
