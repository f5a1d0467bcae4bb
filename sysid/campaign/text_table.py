"""Numbers of a text log: encoding, delimiter, decimal mark and header are found from the file itself."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid import limits
from sysid.campaign.input_file import FileRefusedError, InputFile, read_file
from sysid.campaign.text_numbers import (
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
from sysid.campaign.wording import shorten
from sysid.errors import DataRejectedError

_HEAD_BYTES = 1 << 20
_COMPARED = 60
_COMMENT = ("#", "%", '"#')
_BINARY = {
    b"MDF ": "an MDF file",
    b"UnFinMF": "an unfinished MDF file",
    b"TDSm": "a TDMS file",
    b"MATLAB": "a MAT file",
    b"\x89HDF": "an HDF5 or MAT file",
    b"PK\x03\x04": "a zip or Excel file",
    b"\x1f\x8b": "a gzip file",
    b"\xd0\xcf\x11\xe0": "an old Excel file",
    b"%PDF": "a PDF",
}


@dataclass(frozen=True)
class Layout:
    """How a log is written: text encoding, delimiter, decimal mark, line of the header (from 0) and its names."""

    encoding: str
    delimiter: str
    decimal: str
    header_line: int
    names: tuple[str, ...]


def read_columns(
    source: Path | InputFile, label: str, wanted: Sequence[str], time_names: Iterable[str]
) -> tuple[Layout, dict[str, np.ndarray], int]:
    """Read the wanted columns of a log.

    Parameters
    ----------
    source
        The file, or its path.
    label
        Its name for messages.
    wanted
        Sensor columns by name; the time column is found as any of `time_names` (lower case).

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
    data = _content(source, label)
    layout = find_layout(data, label, wanted, time_names)
    times = set(time_names)
    use = [n for n in layout.names if n in set(wanted) or n.casefold() in times]
    double = next((n for n in use if layout.names.count(n) > 1), None)
    if double is not None:
        at = [i + 1 for i, n in enumerate(layout.names) if n == double]
        raise DataRejectedError(
            f"{label}: the column '{shorten(double)}' stands twice in the header (columns {at[0]} and {at[1]}); "
            "rename one of them."
        )
    columns = _parse(data, label, layout, use)
    for values in columns.values():
        values[~np.isfinite(values)] = np.nan
    return layout, columns, layout.header_line + 2


def _content(source: Path | InputFile, label: str) -> bytes:
    try:
        return (source if isinstance(source, InputFile) else read_file(source, limits.LOG_BYTES)).data
    except FileRefusedError as error:
        most = f"; at most {limits.LOG_BYTES / 1e6:.0f} MB are read" if error.kind == "size" else ""
        raise DataRejectedError(f"{label} is no regular file that can be read{most}; name a text file.") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no valid path"
        raise DataRejectedError(f"{label} cannot be read ({reason}).") from None


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
    return _header(lines, label, encoding, wanted, set(time_names))


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
    decimal = "."
    sample = [ln for ln in lines[number + 1 : number + 101] if ln.strip() and not ln.lstrip().startswith(_COMMENT)]
    if delimiter != ",":
        cells = [c for ln in sample for c in cells_of(ln, delimiter)]
        commas = sum(bool(DECIMAL_COMMA.match(c)) for c in cells)
        if commas > sum("." in c for c in cells):
            decimal = ","
    elif sample and all(ln.count(",") + 1 >= 2 * len(names) - 1 for ln in sample) and len(names) > 1:
        raise DataRejectedError(
            f"{label}: row {number + 2} has {sample[0].count(',') + 1} cells under {len(names)} column names, as when "
            "the comma separates columns and marks decimals; export with semicolons between columns."
        )
    return Layout(encoding, delimiter, decimal, number, tuple(names))


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


def _parse(data: bytes, label: str, layout: Layout, use: list[str]) -> dict[str, np.ndarray]:
    skip = layout.header_line + 1
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
    try:
        columns = read_numbers(table, places, rows, width)
    except CellError as error:
        name = layout.names[error.place]
        raise DataRejectedError(_cell_sentence(label, layout, error.row + skip + 1, name, error.text)) from None
    read = len(next(iter(columns.values())))
    if read == 0:
        raise DataRejectedError(f"{label} has a header but no rows; export the log again.")
    return columns | {name: np.full(read, np.nan) for name in use if name not in columns}


def _cell_sentence(label: str, layout: Layout, row: int, name: str, cell: str) -> str:
    hint = "correct or empty the cell"
    if row == layout.header_line + 2:
        hint = "if this row holds units or text, start it with '#'"
    elif layout.decimal == "." and DECIMAL_COMMA.match(cell):
        hint = "use the decimal point in every cell"
    return f"{label}: row {row}, column '{shorten(name)}' has '{shorten(cell, 40)}', expected a number; {hint}."


def near_names(name: str, names: Iterable[str]) -> str:
    """Half a sentence with the nearest of the names in the file, or nothing."""
    # Long names are compared by their beginning: comparing takes the product of their lengths.
    beginnings = {n[:_COMPARED]: n for n in list(names)[: limits.LOG_COLUMNS]}
    near = difflib.get_close_matches(name[:_COMPARED], beginnings, n=1, cutoff=0.6)
    return f" (the file has '{shorten(beginnings[near[0]])}')" if near else ""
