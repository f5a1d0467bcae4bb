"""Numbers of a text log: encoding, delimiter, decimal mark and header are found from the file itself."""

from __future__ import annotations

import csv
import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from sysid.campaign.wording import shorten
from sysid.errors import DataRejectedError

MAX_COLUMNS = 2_000
_HEAD_BYTES = 1 << 20
_HEADER_LINES = 200
_PIECE_ROWS = 100_000
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
_DECIMAL_COMMA = re.compile(r'^\s*"?[-+]?\d*,\d+([eE][-+]?\d+)?"?\s*$')


@dataclass(frozen=True)
class Layout:
    """How a log is written: text encoding, delimiter, decimal mark, line of the header (from 0) and its names."""

    encoding: str
    delimiter: str
    decimal: str
    header_line: int
    names: tuple[str, ...]


def read_columns(path: Path, label: str, wanted: Sequence[str], time_names: Iterable[str]) -> tuple[Layout, dict, int]:
    """Read the wanted columns of a log.

    Parameters
    ----------
    path
        The file; its size has been checked.
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
    layout = find_layout(path, label, wanted, time_names)
    times = set(time_names)
    use = [n for n in layout.names if n in set(wanted) or n.casefold() in times]
    double = next((n for n in use if layout.names.count(n) > 1), None)
    if double is not None:
        at = [i + 1 for i, n in enumerate(layout.names) if n == double]
        raise DataRejectedError(
            f"{label}: the column '{shorten(double)}' stands twice in the header (columns {at[0]} and {at[1]}); "
            "rename one of them."
        )
    columns = _parse(path, label, layout, use)
    for values in columns.values():
        values[~np.isfinite(values)] = np.nan
    return layout, columns, layout.header_line + 2


def find_layout(path: Path, label: str, wanted: Sequence[str], time_names: Iterable[str]) -> Layout:
    """Find encoding, header line, delimiter and decimal mark of a log from its first megabyte.

    Parameters
    ----------
    path, label : the log, and its name in messages.
    wanted : names of columns, of which the header has at least one, or a time column.
    time_names : names that a time column may have, in small letters.

    Raises
    ------
    DataRejectedError
        If the file cannot be read, is empty or binary, has no such header, or has too many columns.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
    except OSError as error:
        raise DataRejectedError(f"{label} cannot be read ({error.strerror}).") from None
    if not head.strip(b"\0 \t\r\n\xef\xbb\xbf\xff\xfe"):
        raise DataRejectedError(f"{label} is empty; export the log again.")
    for magic, what in _BINARY.items():
        if head.startswith(magic):
            raise DataRejectedError(f"{label} is {what}, not text; export the log as CSV.")
    encoding = _encoding(head, label)
    text = head.decode(encoding, errors="replace").lstrip("\ufeff")
    control = sum(ord(c) < 32 and c not in "\0\t\r\n\f\v" for c in text[:65536])
    if control > 0.01 * len(text[:65536]):
        raise DataRejectedError(f"{label} is binary, not text; export the log as CSV.")
    lines = re.split(r"\r\n|\r|\n", text)
    if len(head) == _HEAD_BYTES and len(lines) > 1:
        lines.pop()
    return _header(lines, label, encoding, wanted, set(time_names))


def _encoding(head: bytes, label: str) -> str:
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    even, odd = head[0:4096:2].count(0), head[1:4096:2].count(0)
    if max(even, odd) > 0.4 * min(len(head), 4096) / 2 and min(even, odd) == 0:
        return "utf-16-be" if even > odd else "utf-16-le"
    try:
        head[: max(1, len(head) - 4)].decode("utf-8")
    except UnicodeDecodeError as error:
        # A multi-byte character cut by the end of the head is no fault.
        if error.start < len(head) - 8:
            return "latin-1"
    return "utf-8-sig"


def _shape(path: Path, label: str, layout: Layout) -> tuple[int, int]:
    """Number of lines below the header and the largest number of cells in one.

    Refuses NUL bytes, endless lines, and rows with more cells than the header has names: pandas would cut those short
    and so shift numbers into the wrong column.
    """
    width = number = 0
    names = len(layout.names)
    with path.open(encoding=layout.encoding, errors="replace") as stream:
        for number, line in enumerate(iter(lambda: stream.readline(_HEAD_BYTES), ""), start=1):
            if "\0" in line:
                raise DataRejectedError(
                    f"{label}: line {number} contains NUL bytes, as a log cut off while it was written does; export it "
                    "again or delete what follows."
                )
            if len(line) >= _HEAD_BYTES:
                raise DataRejectedError(f"{label}: line {number} is longer than a megabyte; export the log as a table.")
            if number <= layout.header_line + 1:
                continue
            cell_count = line.count(layout.delimiter) + 1
            if cell_count > names:
                cells = _cells(line.split("#")[0].rstrip("\n"), layout.delimiter)
                cell_count = len(cells)
                while len(cells) > names and not cells[-1]:
                    cells.pop()
                if len(cells) > names:
                    raise DataRejectedError(
                        f"{label}: row {number} has {len(cells)} cells, the header has {names} names; correct that row."
                    )
            width = max(width, cell_count)
    return number - layout.header_line - 1, width


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return [c.strip() for c in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return [c.strip().strip('"') for c in line.split(delimiter)]


def _header(lines: list[str], label: str, encoding: str, wanted: Sequence[str], times: set[str]) -> Layout:
    known = set(wanted)
    best: tuple[int, int, str, list[str]] = (0, 0, ",", [])
    for number, line in enumerate(lines[:_HEADER_LINES]):
        if line.lstrip().startswith(_COMMENT):
            continue
        for delimiter in (",", ";", "\t", "|"):
            if line.count(delimiter) >= 20 * MAX_COLUMNS:
                continue
            names = _cells(line, delimiter)
            hits = 2 * len(known.intersection(names)) + any(n.casefold() in times for n in names)
            if hits > best[0]:
                best = (hits, number, delimiter, names)
    hits, number, delimiter, names = best
    first = next((ln for ln in lines if ln.strip() and not ln.lstrip().startswith(_COMMENT)), "")
    if hits == 0:
        raise DataRejectedError(_no_header(first, label, wanted))
    width = max(len(names), first.count(delimiter) + 1)
    if width > MAX_COLUMNS:
        raise DataRejectedError(
            f"{label} has {width} columns, at most {MAX_COLUMNS} are read; export the sensor columns only."
        )
    # A trailing delimiter makes an empty last name; other empty names get one of their own.
    names = [n or f"(column {i + 1})" for i, n in enumerate(names)]
    decimal = "."
    sample = [ln for ln in lines[number + 1 : number + 101] if ln.strip() and not ln.lstrip().startswith(_COMMENT)]
    if delimiter != ",":
        cells = [c for ln in sample for c in _cells(ln, delimiter)]
        commas = sum(bool(_DECIMAL_COMMA.match(c)) for c in cells)
        if commas > sum("." in c for c in cells):
            decimal = ","
    elif sample and all(ln.count(",") + 1 >= 2 * len(names) - 1 for ln in sample) and len(names) > 1:
        raise DataRejectedError(
            f"{label}: row {number + 2} has {sample[0].count(',') + 1} cells under {len(names)} column names, as when "
            "the comma separates columns and marks decimals; export with semicolons between columns."
        )
    return Layout(encoding, delimiter, decimal, number, tuple(names))


def _no_header(first: str, label: str, wanted: Sequence[str]) -> str:
    names = max((_cells(first, d) for d in (",", ";", "\t", "|")), key=len) if len(first) < 1_000_000 else []
    if len(names) > MAX_COLUMNS:
        return f"{label} has {len(names)} columns, at most {MAX_COLUMNS} are read; export the sensor columns only."
    numeric = [n for n in names if re.fullmatch(r"[-+\d.,eE]+", n)]
    expected = f"expected time_s and {', '.join(shorten(w) for w in wanted[:3])}{', ...' if len(wanted) > 3 else ''}"
    if names and len(numeric) == len(names):
        return f"{label} has no header line with column names; {expected}."
    shown = ", ".join(f"'{shorten(n, 30)}'" for n in names[:6]) + (", ..." if len(names) > 6 else "")
    return (
        f"{label} has none of the columns of campaign.toml in its first {_HEADER_LINES} lines (found {shown}); "
        f"{expected}."
    )


def _parse(path: Path, label: str, layout: Layout, use: list[str]) -> dict[str, np.ndarray]:
    import pandas as pd

    rows, width = _shape(path, label, layout)
    places = {layout.names.index(n): n for n in use if layout.names.index(n) < width}
    if not places:
        raise DataRejectedError(f"{label} has a header but no rows; export the log again.")
    options = {
        "sep": layout.delimiter,
        "decimal": layout.decimal,
        "header": None,
        "names": list(range(width)),
        "usecols": list(places),
        "index_col": False,
        "skipinitialspace": True,
        "skip_blank_lines": False,
        "comment": "#",
        "engine": "c",
        "low_memory": False,
        "chunksize": _PIECE_ROWS,
        "na_values": ["-", "--", "NAN", "nan", "Inf", "none", "OVER", "over"],
    }
    # Filled piece by piece: a large log then needs the memory of its numbers only.
    result = {name: np.full(rows, np.nan) for name in use}
    filled = 0
    try:
        with _rows(path, layout) as stream, pd.read_csv(stream, dtype=np.float64, **options) as pieces:  # type: ignore[call-overload]
            for piece in pieces:
                for place, name in places.items():
                    result[name][filled : filled + len(piece)] = piece[place].to_numpy()
                filled += len(piece)
    except pd.errors.EmptyDataError:
        raise DataRejectedError(f"{label} has a header but no rows; export the log again.") from None
    except pd.errors.ParserError as error:
        raise DataRejectedError(f"{label} is not a regular table: {_parser_reason(error)}.") from None
    except MemoryError:
        raise DataRejectedError(f"{label} does not fit into memory; cut it to the time of the test.") from None
    except (ValueError, OverflowError):
        raise DataRejectedError(_bad_cell(path, label, layout, options)) from None
    return {name: values[:filled] for name, values in result.items()}


def _rows(path: Path, layout: Layout) -> TextIO:
    """The file as text, behind its header."""
    stream = path.open(encoding=layout.encoding, errors="replace")
    for _ in range(layout.header_line + 1):
        stream.readline()
    return stream


def _parser_reason(error: Exception) -> str:
    if "EOF inside string" in str(error):
        return "a quotation mark is never closed; remove it"
    return shorten(str(error).replace("Error tokenizing data. C error: ", ""), 120)


def _bad_cell(path: Path, label: str, layout: Layout, options: dict) -> str:
    """Name the first cell that is not a number; only run after the fast reading has failed."""
    import pandas as pd

    general = f"{label} has text among its numbers; remove it and mark lines of text with '#'."
    row = layout.header_line + 2
    try:
        with _rows(path, layout) as stream, pd.read_csv(stream, dtype=str, **options) as pieces:
            for piece in pieces:
                for place in piece.columns:
                    text = piece[place]
                    marked = text.str.replace(",", ".") if layout.decimal == "," else text
                    number = pd.to_numeric(marked, errors="coerce")
                    bad = np.flatnonzero(text.notna().to_numpy() & number.isna().to_numpy())
                    if bad.size:
                        return _cell_sentence(
                            label, layout, int(bad[0]) + row, layout.names[place], str(text.iloc[bad[0]])
                        )
                row += len(piece)
    except (ValueError, OverflowError, MemoryError):  # pandas' ParserError is a ValueError
        return general
    return general


def _cell_sentence(label: str, layout: Layout, row: int, name: str, cell: str) -> str:
    hint = "correct or empty the cell"
    if row == layout.header_line + 2:
        hint = "if this row holds units or text, start it with '#'"
    elif layout.decimal == "." and _DECIMAL_COMMA.match(cell):
        hint = "use the decimal point in every cell"
    return f"{label}: row {row}, column '{shorten(name)}' has '{shorten(cell, 40)}', expected a number; {hint}."


def near_names(name: str, names: Iterable[str]) -> str:
    """Half a sentence with the nearest of the names in the file, or nothing."""
    near = difflib.get_close_matches(name, list(names)[:MAX_COLUMNS], n=1, cutoff=0.6)
    return f" (the file has '{shorten(near[0])}')" if near else ""
