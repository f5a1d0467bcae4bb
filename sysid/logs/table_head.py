"""What stands between the names of the columns of a table and its first numbers: units, processing, blank rows."""

from __future__ import annotations

import re
from collections.abc import Sequence

from sysid.logs.text_instants import is_coarse_instant, is_instant
from sysid.logs.text_numbers import MISSING, SIGNS
from sysid.logs.time_columns import time_unit

#: Rows in which the first numbers are looked for.
MOST_ROWS = 20
_NUMBER = re.compile(r"[-+]?(?:\d[\d.,'\u2019 ]*|[.,]\d+)(?:[eE][-+]?\d+)?")
_BRACKETS = re.compile(r"\[.*\]|\(.*\)")


def is_reading(cell: str) -> bool:
    """Whether a cell holds a number or a time."""
    text = cell.translate(SIGNS).strip()
    return _NUMBER.fullmatch(text) is not None or is_instant(text) or is_coarse_instant(text)


def head_below(
    rows: Sequence[Sequence[str]], used: Sequence[bool], keys: Sequence[bool], units_row: bool = False
) -> tuple[int, tuple[str, ...]]:
    """How many rows stand between the names and the first numbers, and the units in one of them, empty without one.

    Parameters
    ----------
    rows : cells of the first rows below the names.
    used, keys : which columns are read, and which are those of time, or of what else stands for the row.
    units_row : whether the first row holds units, whatever stands there.
    """
    places = [place for place, read in enumerate(used) if read]
    key = next((place for place, one in enumerate(keys) if one), None)
    declared = int(units_row and len(rows) > 0)
    between = declared + rows_above_numbers(rows[declared:], places, key)
    at = 0 if declared else units_among(rows[:between], key)
    return between, () if at is None else tuple(bare_unit(cell) for cell in rows[at])


def rows_above_numbers(rows: Sequence[Sequence[str]], used: Sequence[int], time: int | None) -> int:
    """How many of the rows below the names hold no numbers; 0 where the first numbers are not among them.

    Parameters
    ----------
    rows : cells of the first rows below the names.
    used : places of the columns that are read.
    time : place of the column of time.
    """
    for count, row in enumerate(rows[:MOST_ROWS]):
        cells = [row[place] for place in used if place < len(row)]
        readings = sum(is_reading(cell) for cell in cells)
        words = sum(cell.strip().casefold() not in MISSING for cell in cells) - readings
        stamped = time is not None and time < len(row) and is_reading(row[time])
        # A row of numbers between words and a blank row numbers the columns.
        numbering = count > 0 and count + 1 < len(rows) and not "".join(rows[count + 1]).strip()
        # One word among numbers is a fault in a row of numbers.
        if (stamped or readings > words or (readings and not words)) and not numbering:
            return count
    return 0


def units_among(rows: Sequence[Sequence[str]], time: int | None) -> int | None:
    """Which of the rows between names and numbers holds units, None where there is none.

    It is the first with a unit of time in the column of time, or with all its words in brackets, else the first with
    words at all.
    """
    filled = [[c.strip() for c in row if c.strip().casefold() not in MISSING] for row in rows]
    for number, row in enumerate(rows):
        unit = bare_unit(row[time]) if time is not None and time < len(row) else ""
        if time_unit(unit) is not None or (filled[number] and all(_BRACKETS.fullmatch(c) for c in filled[number])):
            return number
    # One word alone is a title, such as [data].
    return next(
        (number for number, words in enumerate(filled) if len(words) > 1 or len(rows[number]) == 1 == len(words)), None
    )


def bare_unit(cell: str) -> str:
    """A unit without brackets around it."""
    return cell.strip().strip("[]()").strip()
