"""Names and units of time: which column holds the stamps of a log, and the factor that turns them into seconds."""

from __future__ import annotations

import re
from collections.abc import Iterable

# Lower-case spellings of the time column with the factor to seconds; the first one found in this order counts.
TIME_NAMES: dict[str, float] = {
    "time_s": 1.0,
    "time [s]": 1.0,
    "time (s)": 1.0,
    "time[s]": 1.0,
    "t_s": 1.0,
    "t [s]": 1.0,
    "time_ms": 1e-3,
    "time [ms]": 1e-3,
    "time (ms)": 1e-3,
    "time[ms]": 1e-3,
    "t_ms": 1e-3,
    "time": 1.0,
    "t": 1.0,
    "x_value": 1.0,
    "timestamp": 1.0,
    "timestamps": 1.0,
}
_UNITS: dict[str, float] = {
    **dict.fromkeys(
        ("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden", "seconde", "secondes"), 1.0
    ),
    **dict.fromkeys(("segundo", "segundos", "secondo", "secondi"), 1.0),
    **dict.fromkeys(("ms", "msec", "msek", "millisecond", "milliseconds", "millisekunden", "millisecondes"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hour", "hours"), 3600.0),
    **dict.fromkeys(("day", "days"), 86400.0),
}
#: The unit at the end of a name: in brackets, behind an underscore, a stroke, a comma, or `in`.
_UNIT_IN_NAME = re.compile(
    r"(?:[\[(]\s*([^\[\]()]{1,12}?)\s*[\])]|(?:_|\s*/\s*|,\s*|\s+in\s+)(s|sec|ms|us|µs|μs|ns|min|h))\s*$", re.IGNORECASE
)
_LETTER = re.compile(r"[^\W\d_]")
_NUMBER = re.compile(r"(?:[\s_.#]*\d{1,3}|\s*[(\[]\d{1,3}[)\]])$")
#: Names of time in other words and languages, and with a number where a file has several.
_TIME = re.compile(
    r"(?:(?:rel|relative|abs|absolute|elapsed|local|utc|gps|sample|test|mess)[\s_.-]*)?"
    r"(?:time[\s_]?stamps?|time|zeit(?:stempel|kanal|achse)?|uhrzeit|temps|heure|tiempo|hora|tempo|tijd|x_value|"
    r"date[\s_/&-]*(?:and[\s_]*)?time|datum[\s_/&-]*(?:und[\s_]*)?(?:uhr)?zeit)"
    r"(?:[\s_.-]*channel)?(?:[\s_.#(-]*\d{1,3}\)?(?:\s+-\s.*)?)?"
)


def time_unit(unit: str | None) -> float | None:
    """Seconds in a unit of time, None where it is no such unit."""
    return None if unit is None else _UNITS.get(unit.strip().casefold())


def seconds_in(name: str, unit: str | None = None) -> float:
    """Seconds in one count of a column of time: by its unit, else by the unit in its name, else 1."""
    stated = time_unit((unit or "").strip("[]() "))
    if stated is not None:
        return stated
    if name.casefold() in TIME_NAMES:
        return TIME_NAMES[name.casefold()]
    match = _UNIT_IN_NAME.search(name)
    return (match and time_unit(match[1] or match[2])) or 1.0


def is_time(name: str) -> bool:
    """Whether a column of this name is one of time: a usual name, or another word for it, with number and unit."""
    # Quick, as every cell of the first rows is asked.
    if _LETTER.search(name) is None:
        return False
    plain = name.strip().casefold()
    numberless = _NUMBER.sub("", plain)
    if plain in TIME_NAMES or (numberless in TIME_NAMES and numberless != "t"):
        return True
    match = _UNIT_IN_NAME.search(plain)
    stated = match is not None and time_unit(match[1] or match[2]) is not None
    bare = plain[: match.start()].strip() if match is not None and stated else plain
    # t1 alone may be a temperature.
    return _TIME.fullmatch(bare) is not None or (stated and re.fullmatch(r"t\s*_?\d{0,3}", bare) is not None)


def find_time(names: Iterable[str], wanted: str | None) -> str | None:
    """The name of the column of time among `names`: the wanted one, else the usual one that stands first in the list.

    The wanted name is compared without regard to capital letters and space around it.  Behind the usual names come
    others that say time.
    """
    listed = list(names)
    if wanted is not None:
        return next((n for n in listed if n.strip().casefold() == wanted.strip().casefold()), None)
    as_written: dict[str, str] = {}
    for name in listed:
        as_written.setdefault(name.strip().casefold(), name)
    usual = (as_written[spelling] for spelling in TIME_NAMES if spelling in as_written)
    return next(usual, None) or next((n for n in listed if is_time(n)), None)
