"""The first lines of a text: where its table begins, how its columns are named, and which may be its time."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise

from sysid.first_look.column_words import dimension_of
from sysid.logs.text_numbers import MISSING, cells_of, encoding_of, head_lines
from sysid.logs.text_table import without_error_marks
from sysid.logs.time_columns import find_time, time_unit

_HEAD_BYTES = 65536
_ROWS = 40
#: Characters of a unit that nobody lists.
_LONGEST_UNIT = 6
_NUMBER = re.compile(r"^[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?$")
_INSTANT = re.compile(r"^\d{1,4}[-/.:]\d{1,2}[-/.:]\d{1,4}")
_COMMENT = ("#", "%", "//")
#: Names of time that are no usual ones, in small letters.
TIME_WORDS = re.compile(
    r"^(?:zeit|temps|time|t|datum|date|uhrzeit|zeitstempel|timestamp|timestamps|heure|elapsed)(?![a-z])"
)
_AXIS = re.compile(r"^([xyz])(?:[\s_\[(].*)?$")
_LENGTH = re.compile(r"_m$|\[m\]|\(m\)|_mm$|station|dist|weg")


#: Columns of a profile that was measured along the road.
_STATION, _HEIGHT = "station_m", "height_m"


@dataclass(frozen=True)
class TextHead:
    """Columns of a text table: their `names`, the `time` among them by name or by even steps, and how many there are.

    Without names it may be a cloud.
    """

    names: tuple[str, ...]
    time: str | None
    width: int

    @property
    def is_cloud(self) -> bool:
        """Whether the columns are points x, y, z."""
        axes = {m[1] for m in (_AXIS.match(n.casefold()) for n in self.names) if m}
        return (not self.names and self.width >= 3) or (axes == set("xyz") and self.time is None)

    @property
    def is_profile(self) -> bool:
        """Whether the columns are heights of a bump along the road."""
        return {_STATION, _HEIGHT} == {name.casefold() for name in self.names}


def text_head(data: bytes) -> TextHead | None:
    """How the table in a text begins; None where the first lines hold no rows of numbers."""
    data = without_error_marks(data[: 4 * _HEAD_BYTES])
    lines = head_lines(data, encoding_of(data), _HEAD_BYTES)
    best: TextHead | None = None
    for delimiter in (";", "\t", ",", "|", r"\s+"):
        head = _with_delimiter(lines, delimiter)
        if head is not None and (best is None or head.width > best.width):
            best = head
    return best


def _with_delimiter(lines: list[str], delimiter: str) -> TextHead | None:
    rows = [(line, cells_of(line, delimiter)) for line in lines[:400] if line.strip()]
    rows = [(line, cells) for line, cells in rows if not line.lstrip().startswith(_COMMENT)]
    first = next((i for i, (_, cells) in enumerate(rows) if len(cells) > 1 and _numeric(cells)), None)
    if first is None or not all(_numeric(cells) for _, cells in rows[first : first + 3]):
        return None
    body = [cells for _, cells in rows[first : first + _ROWS]]
    width = max(len(cells) for cells in body)
    above = [cells for _, cells in rows[max(0, first - 2) : first]]
    columns = tuple(_names(above, width))
    time = find_time(columns, None) or next((n for n in columns if TIME_WORDS.match(n.casefold())), None)
    return TextHead(columns, time or (_rising(columns, body) if columns else None), width)


def _names(above: list[list[str]], width: int) -> list[str]:
    """Names of the columns above the first row; a row of units may stand between."""

    def fits(cells: list[str]) -> bool:
        return width - 1 <= len(cells) <= width + 1 and sum(not _is_number(c) for c in cells) > 0.5 * len(cells)

    if len(above) == 2 and fits(above[0]) and fits(above[1]):
        cells = [c for c in above[1] if c]
        known = sum(_is_unit(c) for c in cells)
        # Short cells among units are units that nobody lists, such as "%".
        if known > 0 and all(len(c) <= _LONGEST_UNIT or _is_unit(c) for c in cells) and 2 * known >= len(cells):
            return above[0]
    return above[-1] if above and fits(above[-1]) else []


def _is_unit(cell: str) -> bool:
    bare = cell.strip("[]() ")
    return dimension_of(bare) is not None or time_unit(bare) is not None


def _numeric(cells: list[str]) -> bool:
    filled = [c for c in cells if c.casefold() not in MISSING]
    good = sum(bool(_NUMBER.match(c) or _INSTANT.match(c)) for c in filled)
    return len(filled) > 0 and good >= max(1.0, 0.6 * len(filled))


def _is_number(cell: str) -> bool:
    return cell.casefold() in MISSING or bool(_NUMBER.match(cell))


def _rising(names: tuple[str, ...], body: list[list[str]]) -> str | None:
    """The first column, if its numbers rise by even steps."""
    try:
        values = [float(cells[0].replace(",", ".")) for cells in body]
    except (ValueError, IndexError):
        return None
    steps = [b - a for a, b in pairwise(values)]
    even = len(steps) > 3 and min(steps) > 0.0 and max(steps) < 1.5 * min(steps)
    return names[0] if even and not _LENGTH.search(names[0].casefold()) else None
