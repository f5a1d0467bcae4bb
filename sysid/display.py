"""How numbers are shown: ends of intervals, units of the trade, and the word where there is no number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import pi

#: Normal deviate of the ends of a 90 % interval, from 5 % to 95 %.
Z90 = 1.6448536269514722

#: What stands in place of a number that only repeats its prior.
NOT_DETERMINED = "not determined"

#: Factor and name of the unit that people read, by SI unit.
_UNITS = {
    "m": (1e3, "mm"),
    "m/s^2": (1.0, "m/s\u00b2"),
    "N": (1e-3, "kN"),
    "N m": (1e-3, "kN m"),
    "N/m": (1e-3, "kN/m"),
    "N s/m": (1e-3, "kN s/m"),
    "N*s/m": (1e-3, "kN s/m"),
    "rad/s": (180.0 / pi, "deg/s"),
    "Pa": (1e-5, "bar"),
}


#: The same of channels: a speed of the truck, not of a damper.
_CHANNEL_UNITS = {"m/s": (3.6, "km/h")}


def channel_unit(si_unit: str) -> tuple[float, str]:
    """Factor from the SI unit of a channel to the one that people read, and its name."""
    return _CHANNEL_UNITS.get(si_unit, shown_unit(si_unit))


def shown_unit(si_unit: str) -> tuple[float, str]:
    """Factor from an SI unit to the one that people read, and its name: metres as mm, N as kN, others unchanged."""
    return _UNITS.get(si_unit, (1.0, si_unit))


@dataclass
class TextTable:
    """A table for a terminal, row by row; the first column stands to the left, the others to the right."""

    title: str
    columns: Sequence[str]
    rows: list[tuple[str, ...]] = field(default_factory=list)

    def add_row(self, *cells: str) -> None:
        """Add a row below the others."""
        self.rows.append(cells)


@dataclass(frozen=True)
class CommandHint:
    """A sentence, and the words of a command to type on the same campaign."""

    text: str
    command: tuple[str, ...]
