"""Cells of the tables that commands print."""

from __future__ import annotations

import math


def value_cell(number: float, sd: float, factor: float) -> str:
    """A number and its standard deviation times a factor, a dash where it is not known."""
    if not math.isfinite(number):
        return "-"
    return f"{number * factor:.4g}" + (f" ± {sd * factor:.2g}" if math.isfinite(sd) else "")


def finite_cell(number: float, digits: str) -> str:
    """A number in a format, a dash where it is not known."""
    return f"{number:{digits}}" if math.isfinite(number) else "-"
