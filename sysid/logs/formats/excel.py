"""Excel work books (xlsx, xlsb, xls) and OpenDocument sheets, by python-calamine: every sheet is a table."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterator, Sequence
from typing import Any, BinaryIO

import numpy as np

from sysid import limits
from sysid.logs.by_library import library_format
from sysid.logs.names import normal_name
from sysid.logs.selection import FileChannel, RefusedError
from sysid.logs.table_head import MOST_ROWS, head_below
from sysid.logs.text_instants import is_instant, seconds_of
from sysid.logs.text_numbers import MISSING, SIGNS, CellError
from sysid.logs.time_columns import is_time, time_unit


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Columns of all sheets that have a row with names of columns.

    Raises
    ------
    RefusedError
        If a sheet is larger than is read.
    """
    from python_calamine import CalamineWorkbook

    book = CalamineWorkbook.from_filelike(stream)
    for name in book.sheet_names:
        sheet = book.get_sheet_by_name(name)
        if sheet.total_height > limits.LOG_ROWS or sheet.total_width > limits.LOG_COLUMNS:
            raise RefusedError(
                f"has {sheet.total_height} rows and {sheet.total_width} columns in the sheet '{name[:60]}', at most "
                f"{limits.LOG_ROWS} and {limits.LOG_COLUMNS} are read; cut it to the test"
            )
        # Rows of the whole sheet, so that a row has the number that the program shows.
        yield from _of_sheet(name, sheet.to_python(skip_empty_area=False), request)


def _of_sheet(sheet: str, rows: list[list[Any]], request: dict[str, Any]) -> Iterator[FileChannel]:
    wanted = {*request["wanted"], *([request["time"]] if request["time"] else [])}
    wanted |= {name.rpartition("/")[2] for name in wanted}
    header = max(range(min(len(rows), limits.HEADER_LINES)), key=lambda i: _hits(rows[i], wanted), default=None)
    if header is None or not _hits(rows[header], wanted):
        return
    names = [normal_name(str(cell).strip()) for cell in rows[header]]
    below = [[str(cell) for cell in row] for row in rows[header + 1 : header + 2 + MOST_ROWS]]
    between, units = head_below(
        below, [n in wanted or is_time(n) for n in names], [is_time(n) for n in names], bool(request["units_row"])
    )
    first = header + 1 + between
    body = rows[first:]
    while body and all(cell == "" for cell in body[-1]):
        body.pop()
    for place, name in enumerate(names):
        if name:
            unit = units[place] if place < len(units) else None
            # A column of time may stand over other words, such as TS.
            unit = None if is_time(name) and time_unit(unit) is None else unit
            yield FileChannel(name, len(body), _loader(body, place, name, first, unit), sheet, first_row=first + 1)


def _loader(
    body: list[list[Any]], place: int, name: str, first: int, unit: str | None
) -> Callable[[], tuple[np.ndarray, str | None]]:
    return lambda: (_column(body, place, name, first), unit)


def _hits(row: Sequence[Any], wanted: set[str]) -> int:
    names = {normal_name(cell.strip()) for cell in row if isinstance(cell, str)}
    return 2 * len(names & wanted) + any(is_time(name) for name in names)


def _column(body: list[list[Any]], place: int, name: str, first: int) -> np.ndarray:
    """Numbers of one column; dates and times of day become nanoseconds."""
    cells = [row[place] if place < len(row) else "" for row in body]
    if any(isinstance(cell, (dt.date, dt.time, dt.timedelta)) for cell in cells):
        return np.array([_instant(cell) for cell in cells], dtype="timedelta64[ns]")
    texts = [cell for cell in cells if isinstance(cell, str) and cell.strip()]
    if texts and is_instant(texts[0]):
        return _instants(cells, name, first)
    numbers = np.full(len(cells), np.nan)
    for i, cell in enumerate(cells):
        if isinstance(cell, (int, float)):
            numbers[i] = cell
        elif str(cell).strip().casefold() not in MISSING:
            raise _strange(str(cell), first + i, name)
    return numbers


def _instants(cells: list[Any], name: str, first: int) -> np.ndarray:
    """Dates and times of day that are cells of text, in seconds."""
    import pandas as pd

    try:
        return seconds_of(pd.Series([str(cell).strip() for cell in cells]).str.translate(SIGNS))
    except CellError as error:
        raise _strange(error.text, first + error.row, name) from None


def _strange(cell: str, row: int, name: str) -> RefusedError:
    return RefusedError(
        f"has '{cell[:40]}' in row {row + 1} of the column '{name[:60]}', expected a number; correct or empty the cell"
    )


def _instant(cell: Any) -> np.timedelta64:
    if isinstance(cell, dt.datetime):
        return np.datetime64(cell, "ns") - np.datetime64(0, "ns")
    if isinstance(cell, dt.timedelta):
        return np.timedelta64(cell, "ns")
    if isinstance(cell, dt.time):
        seconds = cell.hour * 3600 + cell.minute * 60 + cell.second
        return np.timedelta64(seconds * 10**9 + cell.microsecond * 1000, "ns")
    return np.timedelta64("NaT", "ns")


FORMAT = library_format(
    "excel",
    "an Excel or OpenDocument sheet",
    __name__,
    suffixes=(".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"),
    recognises=lambda head: head.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")),
    libraries=("python_calamine",),
    extra="excel",
)
