"""Cells and rows of CSV files that spreadsheets take as they are meant."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence

_FORMULA_STARTS = ("=", "+", "-", "@")


def escape_cell(text: str) -> str:
    """`text` on one line, with an apostrophe in front where a spreadsheet would take it for a formula."""
    # Spreadsheets skip blanks before they look for a formula, and a bare line end would start a row of its own.
    line = "".join(c if c.isprintable() else " " for c in text)
    return "'" + line if line.lstrip().startswith(_FORMULA_STARTS) else line


def number_cell(value: float | None) -> str:
    """A number with all its digits, empty where it is not known."""
    return "" if value is None or not math.isfinite(value) else repr(float(value))


def csv_text(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """The text of a CSV file."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return stream.getvalue()
