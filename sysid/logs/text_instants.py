"""Dates and times of day in a column of text, as seconds: in the orders, zones and notations that loggers print."""

from __future__ import annotations

import datetime as dt
import re
from itertools import islice
from typing import Any

import numpy as np

from sysid.logs.text_numbers import MISSING, SIGNS, CellError, NumberTable, cells_of, read_text

# Two parts alone, 10:05, may be hours and minutes or minutes and seconds: they need a fraction.
_INSTANT = (
    r"^(?P<date>[^:]*[T\s,_])?(?P<sign>[-+])?(?:(?P<hour>\d{1,3}):(?=\d+:\d)|(?=\d+:\d+[.,]\d))"
    r"(?P<minute>\d{1,2}):(?P<second>\d{1,2})(?:(?P<mark>[.,:])(?P<fraction>\d{1,12}))?"
    r"\s*(?P<half>[aApP]\.?\s?[mM]\.?)?\s*(?P<zone>[A-Za-z(+-][\w/+:() \[\]-]*)?$"
)
#: Date and time of day in one number, 20240506T100558.125.
_COMPACT = (
    r"^(?P<date>(?:19|20)\d{2}[01]\d[0-3]\d)[T_ ]?(?P<hour>[0-2]\d)(?P<minute>[0-5]\d)(?P<second>[0-6]\d)"
    r"(?P<mark>[.,]?)(?P<fraction>\d{1,9})?\s*(?P<zone>Z|[+-]\d\d:?(?:\d\d)?)?$"
)
_PATTERNS = (_INSTANT, _COMPACT)
_DATE_ALONE = re.compile(r"^\d{1,4}([-./])\d{1,2}\1\d{1,4}(?:[T ]+\d{1,2}:\d\d)?$|^\d{1,2}:\d\d$")
_OFFSET = re.compile(r"([+-])(\d{1,2}):?(\d\d)?")
#: First letters of the months in English, German, French, Spanish, Italian and Dutch.
_MONTHS = (
    "jan ene gen", "feb fév fev", "mar mär mrz maa", "apr avr abr", "may mai mei mag", "jun jui giu", "jul juil lug",
    "aug aoû aou ago", "sep set", "oct okt ott", "nov", "dec dez déc dic",
)  # fmt: skip
_DAY_S, _HOUR_S = 86400.0, 3600.0  # a clock without a date, or without hours, starts again
_LOOKED_AT = 200  # lines that are searched


def is_instant(cell: str) -> bool:
    """Whether a cell is a date with a time, or a time of day."""
    return any(re.match(pattern, cell.strip().translate(SIGNS)) for pattern in _PATTERNS)


def is_coarse_instant(cell: str) -> bool:
    """Whether a cell is a date, or a time without seconds, from which no stamps can be read."""
    return _DATE_ALONE.match(cell.strip()) is not None


def has_instants(table: NumberTable, place: int) -> bool:
    """Whether the first filled cell of a column is a date with a time, or a time of day."""
    with table.rows_of_text() as stream:
        for line in islice(iter(lambda: stream.readline(table.line_length), ""), _LOOKED_AT):
            cells = cells_of(line.rstrip("\r\n"), table.delimiter)
            cell = cells[place].strip() if place < len(cells) else ""
            if cell.lower() not in MISSING:
                return is_instant(cell)
    return False


def read_instants(table: NumberTable, place: int, width: int) -> np.ndarray:
    """Seconds (n,) since the midnight before the first stamp of a column; NaN where a cell is empty.

    Times of day without a date may pass midnight, those without hours the hour.  Zones are taken into account.  Of a
    date with the month first or second the order is taken by which the days follow each other.

    Raises
    ------
    CellError
        If a cell is neither.
    DataRejectedError, UnicodeDecodeError
        As :func:`sysid.logs.text_numbers.read_numbers`.
    """
    text = read_text(table, place, width).str.strip().str.translate(SIGNS)
    return seconds_of(text, place)


def seconds_of(text: Any, place: int = 0) -> np.ndarray:
    """As :func:`read_instants`, of a pandas series of text; `place` is that of its column, for the error.

    Raises
    ------
    CellError
        If a cell is neither a date nor a time.
    """
    import pandas as pd

    filled = ~text.str.lower().isin(MISSING).to_numpy()
    first = text[filled].iloc[0] if filled.any() else ""
    parts = text.str.extract(next((p for p in _PATTERNS if re.match(p, first)), _INSTANT))

    def refuse(strange: np.ndarray) -> None:
        at = np.flatnonzero(strange & filled)
        if at.size:
            raise CellError(int(at[0]), place, str(text.iloc[int(at[0])]))

    def number(name: str) -> np.ndarray:
        return np.asarray(pd.to_numeric(parts[name], errors="coerce"), np.float64)

    def each(name: str, value: Any) -> np.ndarray:
        """The value of every row by the text in one of its parts, which has few different ones."""
        if name not in parts:
            return np.zeros(len(text))
        codes, texts = pd.factorize(parts[name].fillna(""))
        return np.array([value(str(t)) for t in texts] or [0.0], np.float64)[codes]

    minute, second, hour = number("minute"), number("second"), np.nan_to_num(number("hour"))
    with np.errstate(invalid="ignore"):
        refuse(np.isnan(minute) | (minute >= 60.0) | (second > 60.0))
    half = each("half", lambda t: " ap".find(t[:1].lower()) if t else 0)
    refuse((half > 0.0) & ((hour > 12.0) | (hour < 1.0)))
    hour = np.where(half > 0.0, hour % 12.0 + np.where(half == 2.0, 12.0, 0.0), hour)
    seconds = _HOUR_S * hour + 60.0 * minute + second + _fractions(parts, number("fraction"), refuse)
    if "sign" in parts:
        seconds = np.where((parts["sign"] == "-").to_numpy(dtype=bool, na_value=False), -seconds, seconds)
    seconds = seconds - each("zone", _offset_s)
    dates = parts["date"].fillna("").str.strip(" T,_")
    if (dates != "").any():
        codes, texts = pd.factorize(dates)
        days = _days([str(t) for t in texts])
        refuse(np.isnan(days)[codes])
        return np.asarray(seconds + _DAY_S * (days - days[codes[filled.argmax()]])[codes])
    # A clock without a date starts again.
    known = np.flatnonzero(np.isfinite(seconds))
    period = _DAY_S if parts["hour"].notna().any() else _HOUR_S
    falls = np.diff(seconds[known]) < -0.5 * period
    seconds[known] += period * np.concatenate([[0.0], np.cumsum(falls)])[: known.size]
    return np.asarray(seconds)


def _fractions(parts: Any, digits: np.ndarray, refuse: Any) -> np.ndarray:
    """Fractions of a second; behind a colon stands a whole number of milliseconds or microseconds."""
    import pandas as pd

    length = parts["fraction"].str.len().to_numpy(dtype=np.float64, na_value=0.0)
    if (parts["mark"] != ":").all():
        return np.asarray(pd.to_numeric("0." + parts["fraction"].fillna("0")), np.float64)
    longest = float(length.max())
    # Two digits may be hundredths, or pictures of a film.
    refuse((length > 0.0) & (longest not in (3.0, 6.0)))
    return np.asarray(np.nan_to_num(digits) * 10.0**-longest)


def _offset_s(zone: str) -> float:
    """Seconds by which a zone is ahead of UTC; one that has only a name counts as local time, 0."""
    match = _OFFSET.search(zone)
    if match is None:
        return 0.0
    size = 3600.0 * float(match[2]) + 60.0 * float(match[3] or 0)
    return -size if match[1] == "-" else size


def _days(texts: list[str]) -> np.ndarray:
    """Days of dates since any first one, NaN where a text is none; in an order of their fields that suits all of them.

    Of several orders it is the one in which the days lie nearest to each other: a log takes days, not months.
    """
    orders = [np.array([_day(text, order) for text in texts]) for order in ("dmy", "mdy", "ymd")]
    suiting = [days for days in orders if np.isfinite(days).all()]
    return min(suiting, key=lambda days: float(np.ptp(days))) if suiting else orders[0]


def _day(text: str, order: str) -> float:
    if not text:
        return np.nan
    if (days := re.fullmatch(r"(-?\d+) days?", text)) is not None:
        return float(days[1])
    if re.fullmatch(r"\d{8}", text):
        text = f"{text[:4]}-{text[4:6]}-{text[6:]}"
    numbers = re.findall(r"\d+", text)
    month = next((m for w in re.findall(r"[^\W\d_]{3,}", text) if (m := _month(w.lower())) is not None), None)
    if month is not None and len(numbers) == 2:
        day, year = numbers if order != "ymd" else numbers[::-1]
        fields = {"y": year, "m": str(month), "d": day}
    elif len(numbers) == 3:
        # Where a year has four digits, or points stand between, the order is known.
        known = "ymd" if len(numbers[0]) == 4 else "dmy" if "." in text else order
        fields = dict(zip(known, numbers, strict=True))
    else:
        return np.nan
    year = int(fields["y"])
    if len(fields["y"]) not in (2, 4) or (order == "ymd" and len(fields["y"]) == 2 and "." in text):
        return np.nan
    try:
        return float(dt.date(year + (2000 if year < 100 else 0), int(fields["m"]), int(fields["d"])).toordinal())
    except ValueError:
        return np.nan


def _month(word: str) -> int | None:
    return next((i for i, names in enumerate(_MONTHS, start=1) if any(word.startswith(n) for n in names.split())), None)
