"""Dates and times of day in a column of text: ISO 8601, dates with dots, and plain clock times, as seconds."""

from __future__ import annotations

import re
from itertools import islice

import numpy as np

from sysid.logs.text_numbers import MISSING, CellError, NumberTable, cells_of, read_text

# Two parts alone, 10:05, may be hours and minutes or minutes and seconds: they need a fraction.
_INSTANT = (
    r"^(?:(?:(?P<year>\d{4})-(?P<month>\d\d)-(?P<day>\d\d)|"
    r"(?P<day2>\d{1,2})\.(?P<month2>\d{1,2})\.(?P<year2>\d{4}))[T ]+(?=\d+:\d+:))?"
    r"(?:(?P<hour>\d{1,2}):(?=\d+:)|(?=\d+:\d+[.,]))(?P<minute>\d{1,2}):(?P<second>\d{1,2})"
    r"(?:[.,](?P<fraction>\d{1,12}))?\s*(?P<zone>Z|[+-]\d\d:?\d\d)?$"
)
_PATTERN = re.compile(_INSTANT)
_DAY_S = 86400.0  # a clock without a date starts again
_LOOKED_AT = 200  # lines that are searched


def has_instants(table: NumberTable, place: int) -> bool:
    """Whether the first filled cell of a column is a date with a time, or a time of day."""
    with table.rows_of_text() as stream:
        for line in islice(iter(lambda: stream.readline(table.line_length), ""), _LOOKED_AT):
            cells = cells_of(line.rstrip("\r\n"), table.delimiter)
            cell = cells[place].strip() if place < len(cells) else ""
            if cell.lower() not in MISSING:
                return _PATTERN.match(cell) is not None
    return False


def read_instants(table: NumberTable, place: int, width: int) -> np.ndarray:
    """Seconds (n,) since the midnight before the first stamp of a column; NaN where a cell is empty.

    Times of day without a date may pass midnight.  Zones are taken into account.

    Raises
    ------
    CellError
        If a cell is neither.
    DataRejectedError, UnicodeDecodeError
        As :func:`sysid.logs.text_numbers.read_numbers`.
    """
    import pandas as pd

    text = read_text(table, place, width).str.strip()
    parts = text.str.extract(_INSTANT)
    strange = np.flatnonzero(parts["second"].isna().to_numpy() & ~text.str.lower().isin(MISSING).to_numpy())
    if strange.size:
        raise CellError(int(strange[0]), place, str(text.iloc[int(strange[0])]))

    def number(name: str) -> np.ndarray:
        return np.asarray(pd.to_numeric(parts[name], errors="coerce"), np.float64)

    fraction = pd.to_numeric("0." + parts["fraction"].fillna("0"), errors="coerce").to_numpy(dtype=np.float64)
    seconds = 3600.0 * np.nan_to_num(number("hour")) + 60.0 * number("minute") + number("second") + fraction
    zone = parts["zone"].fillna("Z").replace("Z", "+0000").str.replace(":", "")
    offset = (
        pd.to_numeric(zone.str[1:3]).to_numpy(np.float64) * 3600.0
        + pd.to_numeric(zone.str[3:5]).to_numpy(np.float64) * 60.0
    )
    seconds = seconds - np.where(zone.str[0].to_numpy() == "-", -offset, offset)
    dates = [parts[name].fillna(parts[f"{name}2"]) for name in ("year", "month", "day")]
    if dates[0].notna().any():
        days = pd.to_datetime(dates[0] + "-" + dates[1].str.zfill(2) + "-" + dates[2].str.zfill(2), errors="coerce")
        since = (days - days.dropna().min()).dt.total_seconds().to_numpy(np.float64)
        return np.asarray(seconds + since)
    # A clock without a date starts again at midnight.
    known = np.flatnonzero(np.isfinite(seconds))
    falls = np.diff(seconds[known]) < -0.5 * _DAY_S
    seconds[known] += _DAY_S * np.concatenate([[0.0], np.cumsum(falls)])[: known.size]
    return np.asarray(seconds)
