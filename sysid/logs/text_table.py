"""Numbers of a text log: encoding, delimiter, decimal mark and header are found from the file itself."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from sysid import limits
from sysid.errors import DataRejectedError
from sysid.logs.input_file import FileRefusedError, InputFile, read_file
from sysid.logs.text_instants import has_instants, read_instants
from sysid.logs.text_numbers import (
    COMMENT,
    DECIMAL_COMMA,
    CellError,
    LongRowError,
    NumberTable,
    cells_of,
    count_rows,
    encoding_of,
    head_lines,
    read_numbers,
)
from sysid.wording import shorten

#: Bytes in which delimiter and header are looked for.
_HEAD_BYTES = 1 << 20
_COMPARED = 60  # characters of a name that are compared with a misspelt one
_COMMENT = (*COMMENT, '"#')
#: A number with a decimal mark, one that may as well be a thousand, and how many of the former are looked at.
_MARKED = re.compile(r"[-+]?[\d.]*[.,]\d+(?:[eE][-+]?\d+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:\.\d{3})+")
_MARKED_CELLS = 100
_BINARY = {b"\x1f\x8b": "a gzip file", b"%PDF": "a PDF"}
#: What spreadsheets write where they have no number, in English and German.
_ERROR_MARKS = (
    "#N/A",
    "#NV",
    "#VALUE!",
    "#WERT!",
    "#DIV/0!",
    "#REF!",
    "#BEZUG!",
    "#NAME?",
    "#NUM!",
    "#ZAHL!",
    "#NULL!",
)


@dataclass(frozen=True)
class Layout:
    """How a log is written: text encoding, delimiter, decimal mark, line of the header (from 0) and its names.

    `units` are the cells of a row of units below the names, empty without one; `instants` are the columns that were
    read as dates or times of day.
    """

    encoding: str
    delimiter: str
    decimal: str
    header_line: int
    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    instants: tuple[str, ...] = ()

    @property
    def first_row(self) -> int:
        """Line of the first row of numbers, from 1."""
        return self.header_line + 2 + bool(self.units)


def read_columns(
    source: Path | InputFile, label: str, wanted: Sequence[str], time_names: Iterable[str], units_row: bool = False
) -> tuple[Layout, dict[str, np.ndarray], int]:
    """Read the wanted columns of a log.

    Parameters
    ----------
    source : the file, or its path.
    label : its name for messages.
    wanted : sensor columns by name; the time column is the first of `time_names` (lower case) that there is.  Dates and
        times of day in it become seconds since the midnight before the first of them.
    units_row : whether the row below the names holds units.

    Returns
    -------
    layout, columns, first_row
        `columns` maps every wanted name found, and the time column's, to a float64 array (rows,) with NaN where a cell
        is empty, infinite or says NaN; `first_row` is the line number (from 1) of its first row.

    Raises
    ------
    DataRejectedError
        If the file is no such table; the sentence names file, column and row.
    """
    data = without_error_marks(file_content(source, label).data)
    ranked = list(time_names)
    times = set(ranked)
    layout = find_layout(data, label, wanted, times)
    if units_row:
        layout = replace(layout, units=_units(data, layout))
    # Of several columns with a usual name of time only the first counts: others may hold anything.
    found = {n.casefold() for n in layout.names}
    time = next((n for n in ranked if n in found), None)
    use = [n for n in layout.names if n in set(wanted) or n.casefold() == time]
    double = next((n for n in use if layout.names.count(n) > 1), None)
    if double is not None:
        at = [i + 1 for i, n in enumerate(layout.names) if n == double]
        raise DataRejectedError(
            f"{label}: the column '{shorten(double)}' stands twice in the header (columns {at[0]} and {at[1]}); "
            "rename one of them."
        )
    columns, instants = _parse(data, label, layout, use, times)
    for values in columns.values():
        values[~np.isfinite(values)] = np.nan
    return replace(layout, instants=instants), columns, layout.first_row


def file_content(source: Path | InputFile, label: str) -> InputFile:
    """The file, read now where only its path is given.

    Raises
    ------
    DataRejectedError
        If it is no regular file, too large, or cannot be read.
    """
    try:
        return source if isinstance(source, InputFile) else read_file(source, limits.LOG_BYTES)
    except FileRefusedError as error:
        most = f"; at most {limits.LOG_BYTES / 1e6:.0f} MB are read" if error.kind == "size" else ""
        raise DataRejectedError(f"{label} is no regular file that can be read{most}; name a file.") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no valid path"
        raise DataRejectedError(f"{label} cannot be read ({reason}).") from None


def without_error_marks(data: bytes) -> bytes:
    """The text with `n/a` for the error marks of spreadsheets, whose first character would begin a comment."""
    if b"#" not in data:
        return data
    for mark in _ERROR_MARKS:
        for encoding in ("latin-1", "utf-16-le", "utf-16-be"):
            written = mark.encode(encoding)
            if written in data:
                data = data.replace(written, "n/a".encode(encoding))
    return data


def _units(data: bytes, layout: Layout) -> tuple[str, ...]:
    lines = head_lines(data, layout.encoding, _HEAD_BYTES)
    cells = cells_of(lines[layout.header_line + 1], layout.delimiter) if len(lines) > layout.header_line + 1 else []
    cells = [cell.strip("[]() ") for cell in cells]
    return tuple((cells + [""] * len(layout.names))[: len(layout.names)])


def find_layout(data: bytes, label: str, wanted: Sequence[str], time_names: Iterable[str]) -> Layout:
    """Find encoding, header line, delimiter and decimal mark of a log from its first megabyte.

    Parameters
    ----------
    data, label : content of the log, and its name in messages.
    wanted : names of columns, of which the header has at least one, or a time column.
    time_names : names that a time column may have, in small letters.

    Raises
    ------
    DataRejectedError
        If the file is empty or binary, has no such header, or has too many columns.
    """
    head = data[:_HEAD_BYTES]
    if not head.strip(b"\0 \t\r\n\xef\xbb\xbf\xff\xfe"):
        raise DataRejectedError(f"{label} is empty; export the log again.")
    for magic, what in _BINARY.items():
        if head.startswith(magic):
            raise DataRejectedError(f"{label} is {what}, not text; export the log as CSV.")
    encoding = encoding_of(data)
    lines = head_lines(data, encoding, _HEAD_BYTES)
    text = "\n".join(lines)[:65536]
    control = sum(ord(c) < 32 and c not in "\0\t\r\n\f\v" for c in text)
    if control > 0.01 * len(text):
        raise DataRejectedError(f"{label} is binary, not text; export the log as CSV.")
    known, times = set(wanted), set(time_names)
    layout = _header(lines, label, encoding, wanted, times)
    if layout.delimiter == ",":
        return layout
    places = [i for i, name in enumerate(layout.names) if name in known or name.casefold() in times]
    table = NumberTable(data, label, encoding, layout.delimiter, ".", layout.first_row - 1, layout.names)
    return replace(layout, decimal=_decimal_mark(table, places))


def _decimal_mark(table: NumberTable, places: Sequence[int]) -> str:
    """Decimal mark of most of the first numbers with one in the columns at `places`."""
    with table.rows_of_text() as stream:
        rows = iter(lambda: stream.readline(table.line_length), "")
        of_rows = (row.split(table.delimiter) for row in rows if "," in row or "." in row)
        cells = (cells[place] for cells in of_rows for place in places if place < len(cells))
        numbers = (cell.strip().strip('"') for cell in cells if "," in cell or "." in cell)
        marked = list(islice((number for number in numbers if _MARKED.fullmatch(number)), _MARKED_CELLS))
    commas = sum("," in cell for cell in marked)
    # A point may stand between thousands, as in 1.234.
    points = sum("," not in cell and not _THOUSANDS.fullmatch(cell) for cell in marked)
    return "," if commas > points else "."


def _header(lines: list[str], label: str, encoding: str, wanted: Sequence[str], times: set[str]) -> Layout:
    known = set(wanted)
    best: tuple[int, int, str, list[str]] = (0, 0, ",", [])
    for number, line in enumerate(lines[: limits.HEADER_LINES]):
        if line.lstrip().startswith(_COMMENT):
            continue
        for delimiter in (",", ";", "\t", "|"):
            if line.count(delimiter) >= 20 * limits.LOG_COLUMNS:
                continue
            names = cells_of(line, delimiter)
            hits = 2 * len(known.intersection(names)) + any(n.casefold() in times for n in names)
            if hits > best[0]:
                best = (hits, number, delimiter, names)
    hits, number, delimiter, names = best
    first = next((ln for ln in lines if ln.strip() and not ln.lstrip().startswith(_COMMENT)), "")
    if hits == 0:
        raise DataRejectedError(_no_header(first, label, wanted))
    width = max(len(names), first.count(delimiter) + 1)
    if width > limits.LOG_COLUMNS:
        raise DataRejectedError(
            f"{label} has {width} columns, at most {limits.LOG_COLUMNS} are read; export the sensor columns only."
        )
    # A trailing delimiter makes an empty last name; other empty names get one of their own.
    names = [n or f"(column {i + 1})" for i, n in enumerate(names)]
    sample = [ln for ln in lines[number + 1 : number + 101] if ln.strip() and not ln.lstrip().startswith(_COMMENT)]
    pairs = all(ln.count(",") + 1 >= 2 * len(names) - 1 for ln in sample)
    if delimiter == "," and sample and pairs and len(names) > 1:
        raise DataRejectedError(
            f"{label}: row {number + 2} has {sample[0].count(',') + 1} cells under {len(names)} column names, as when "
            "the comma separates columns and marks decimals; export with semicolons between columns."
        )
    return Layout(encoding, delimiter, ".", number, tuple(names))


def _no_header(first: str, label: str, wanted: Sequence[str]) -> str:
    names = max((cells_of(first, d) for d in (",", ";", "\t", "|")), key=len) if len(first) < 1_000_000 else []
    if len(names) > limits.LOG_COLUMNS:
        return (
            f"{label} has {len(names)} columns, at most {limits.LOG_COLUMNS} are read; export the sensor columns only."
        )
    numeric = [n for n in names if re.fullmatch(r"[-+\d.,eE]+", n)]
    expected = f"expected time_s and {', '.join(shorten(w) for w in wanted[:3])}{', ...' if len(wanted) > 3 else ''}"
    if names and len(numeric) == len(names):
        return f"{label} has no header line with column names; {expected}."
    shown = ", ".join(f"'{shorten(n, 30)}'" for n in names[:6]) + (", ..." if len(names) > 6 else "")
    return (
        f"{label} has none of the columns of campaign.toml in its first {limits.HEADER_LINES} lines (found {shown}); "
        f"{expected}."
    )


def _parse(
    data: bytes, label: str, layout: Layout, use: list[str], times: set[str]
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Columns by name, and the names of those that hold dates or times of day."""
    skip = layout.first_row - 1
    table = NumberTable(data, label, layout.encoding, layout.delimiter, layout.decimal, skip, layout.names)
    try:
        rows, width = count_rows(table)
    except LongRowError as error:
        raise DataRejectedError(
            f"{label}: row {error.number} has {error.cells} cells, the header has {len(layout.names)} names; correct "
            "that row."
        ) from None
    places = {layout.names.index(n): n for n in use if layout.names.index(n) < width}
    if not places:
        raise DataRejectedError(f"{label} has a header but no rows; export the log again.")
    clocks = {p: n for p, n in places.items() if n.casefold() in times and has_instants(table, p)}
    try:
        columns = read_numbers(table, {p: n for p, n in places.items() if p not in clocks}, rows, width)
        for place, name in clocks.items():
            columns[name] = read_instants(table, place, width)
    except CellError as error:
        name = layout.names[error.place]
        raise DataRejectedError(_cell_sentence(label, layout, error.row + skip + 1, name, error.text)) from None
    read = len(next(iter(columns.values())))
    if read == 0:
        raise DataRejectedError(f"{label} has a header but no rows; export the log again.")
    columns |= {name: np.full(read, np.nan) for name in use if name not in columns}
    return columns, tuple(clocks.values())


def _cell_sentence(label: str, layout: Layout, row: int, name: str, cell: str) -> str:
    hint = "correct or empty the cell"
    if layout.decimal == "." and DECIMAL_COMMA.match(cell):
        hint = "use the decimal point in every cell"
    elif layout.decimal == "," and _MARKED.fullmatch(cell.strip()):
        hint = "use the decimal comma in every cell, and no points between thousands"
    elif row == layout.header_line + 2 and not layout.units:
        hint = "if this row holds units, set units_row = true in campaign.toml, or start it with '#'"
    return f"{label}: row {row}, column '{shorten(name)}' has '{shorten(cell, 40)}', expected a number; {hint}."


def near_names(name: str, names: Iterable[str]) -> str:
    """Half a sentence with the nearest of the names in the file, or nothing."""
    # Long names are compared by their beginning: comparing takes the product of their lengths.
    beginnings = {n[:_COMPARED]: n for n in list(names)[: limits.LOG_COLUMNS]}
    near = difflib.get_close_matches(name[:_COMPARED], beginnings, n=1, cutoff=0.6)
    return f" (the file has '{shorten(beginnings[near[0]])}')" if near else ""
