"""Cells and rows of CSV files that spreadsheets take as they are meant."""

from __future__ import annotations

import csv
import io
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from sysid.wording import plain_line

if TYPE_CHECKING:
    import numpy as np

#: What begins a formula, at the start of a cell or after what some countries' spreadsheets take for the end of one.
#: Blanks before it are skipped.  Wide and small forms count as what NFKC makes of them, as some programs read them.
_FORMULA = re.compile(r"(?P<before>^|;)(?P<blanks>\s*)(?=(?P<sign>\S))")
_SIGNS = "=+-@\u2212"


def escape_cell(text: str) -> str:
    """`text` on one line, with an apostrophe wherever a spreadsheet would find the beginning of a formula."""
    return _FORMULA.sub(_escaped, plain_line(text))


def _escaped(found: re.Match[str]) -> str:
    formula = unicodedata.normalize("NFKC", found["sign"])[0] in _SIGNS
    return f"{found['before']}'{found['blanks']}" if formula else found[0]


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


def columns_text(columns: Mapping[str, np.ndarray]) -> str:
    """The text of a CSV file with these columns of numbers of one length, seven digits, empty where not known."""
    row = ",".join(["%.7g"] * len(columns))
    table = zip(*(values.tolist() for values in columns.values()), strict=True)
    body = "".join(f"{row % numbers}\n" for numbers in table)
    return csv_text(tuple(columns), ()) + body.replace("nan", "")
