"""What the attributes of a data set say of its values and its time: CF conventions, and waveforms of LabVIEW."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from sysid.logs.file_channels import RefusedError, even_axis, no_time
from sysid.logs.names import decoded
from sysid.logs.time_columns import time_unit
from sysid.wording import shorten

_UNITS = ("unit", "units", "Unit", "Units", "UNIT", "unit_string")
_STEPS = ("sample_interval_s", "dt", "wf_increment")
_RATES = ("sample_rate_hz", "sample_rate", "sampling_rate", "fs")
#: Starts of an axis: numbers in its unit, and moments.
_STARTS = ("wf_start_offset", "start_offset_s", "start_offset", "start_s", "start_time_s", "t0_s", "t0", "x0", "start")
_MOMENTS = ("wf_start_time", "start_time")
#: What may be a start or a scale in the words of others; it is said and not applied.
_LIKE_A_START = re.compile(r"start|delay|pre_?trig|(^|_)[tx]_?0|time_?(zero|offset|shift)", re.IGNORECASE)
_LIKE_A_SCALE = re.compile(r"^(?!full).*(gain|scale|scaling|factor|slope|offset|intercept)$", re.IGNORECASE)
_CF = ("scale_factor", "add_offset", "_FillValue", "missing_value", "valid_min", "valid_max", "valid_range")
#: What netCDF has where nothing was written (netcdf.h, NC_FILL_DOUBLE and NC_FILL_FLOAT).
_UNWRITTEN = float.fromhex("0x1.ep+122")
_SINCE = re.compile(r"\s*(\w+)\s+since\s+(.+)", re.IGNORECASE)


def text_of(data: Any, key: str) -> str:
    """The text of an attribute, empty where there is none."""
    value = data.attrs.get(key)
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        value = decoded(value)
    return value if isinstance(value, str) else ""


def unit_of(data: Any) -> str | None:
    """Unit of a data set."""
    return next((text for key in _UNITS if (text := text_of(data, key))), None)


def values_of(data: Any, messages: list[str] | None) -> np.ndarray:
    """Values (n,) by the CF conventions (sections 8.1 packed data, 2.5.1 missing data), masked where there are none.

    value = scale_factor * number + add_offset; fill values and the valid range are compared with the numbers.
    `messages` receives attributes that look like a scale and are not applied.
    """
    numbers = np.asarray(data[()]).reshape(-1)
    if text_of(data, "_Unsigned").casefold() == "true" and numbers.dtype.kind == "i":
        numbers = numbers.view(numbers.dtype.str.replace("i", "u"))
    invalid = numbers == _UNWRITTEN if numbers.dtype.kind == "f" else np.zeros(numbers.size, bool)
    for fill in (*_numbers(data, "_FillValue"), *_numbers(data, "missing_value")):
        invalid |= numbers == fill
    range_ = _numbers(data, "valid_range")
    for least in (*range_[:1], *_numbers(data, "valid_min")):
        invalid |= numbers < least
    for most in (*range_[1:2], *_numbers(data, "valid_max")):
        invalid |= numbers > most
    if messages is not None:
        messages += _not_applied(data)
    scale, offset = _number(data, "scale_factor"), _number(data, "add_offset")
    if scale is not None or offset is not None:
        numbers = numbers * (1.0 if scale is None else scale) + (0.0 if offset is None else offset)
    return np.ma.MaskedArray(numbers, invalid) if invalid.any() else numbers


def _not_applied(data: Any) -> list[str]:
    """Sentences on numbers in attributes that may change values, as the names say, but belong to no convention."""
    said = []
    for key in map(str, data.attrs):
        if key not in (*_CF, *_STARTS, *_MOMENTS) and _LIKE_A_SCALE.search(key) and not _LIKE_A_START.search(key):
            number = _numbers(data, key)
            if number.size == 1 and number[0] not in (0.0, 1.0):
                name = shorten(str(data.name).strip("/"))
                said.append(
                    f"the attribute '{shorten(key, 40)}' = {number[0]:g} of '{name}' is not applied; give the sensor a "
                    "scale if its values are raw"
                )
    return said


def instants(values: np.ndarray, unit: str | None) -> np.ndarray | None:
    """Dates (n,) of values in a unit such as ``seconds since 2024-05-01 10:00``, None for other units.

    Raises
    ------
    RefusedError
        If the date cannot be read.
    """
    match = _SINCE.match(unit or "")
    seconds = time_unit(match[1]) if match else None
    if match is None or seconds is None:
        return None
    moment = _moment(match[2])
    if moment is None:
        raise RefusedError(f"has the unit '{shorten(unit, 60)}', whose date cannot be read; export it in seconds")
    whole = np.ma.filled(np.ma.asarray(values).astype(np.float64), np.nan) * (1e9 * seconds)
    ticks = np.where(np.isfinite(whole), np.round(whole), np.iinfo(np.int64).min)
    return moment + ticks.astype(np.int64).view("m8[ns]")


def _around(data: Any, keys: Iterable[str]) -> Any:
    """The data set if it has one of the attributes, else the nearest group around it that has one, else None."""
    known, node = tuple(keys), data
    while not any(key in node.attrs for key in known):
        if node.name == "/":
            return None
        node = node.parent
    return node


def start_of(data: Any) -> np.datetime64 | float | None:
    """The moment at which an evenly sampled data set begins, or a number of seconds; None where it is not said.

    What a group says holds for its data sets that do not say it.
    """
    node = _around(data, _MOMENTS)
    for key in _MOMENTS if node is not None else ():
        if text_of(node, key):
            return _moment(text_of(node, key))
        if key in node.attrs:
            return _number(node, key)
    return None


def even_stamps(data: Any, path: str, starts: set[np.datetime64], with_time: bool) -> Callable[[], np.ndarray] | None:
    """Stamps [s] by a step or rate and the start beside it, None where there is neither.

    Moments are counted from the earliest of `starts`, those of the file.  `with_time`: a column of time stands beside
    the data set, and counts for more than the step of a group.
    """
    node = data if with_time else _around(data, (*_STEPS, *_RATES))
    if node is None:
        return None
    try:
        step = next((_number(node, key) for key in _STEPS if key in node.attrs), None)
        rate = next((_number(node, key) for key in _RATES if key in node.attrs), None)
        step = 1.0 / rate if step is None and rate else step
        if step is None:
            return None
        zero_s = _zero_s(data, path, starts)
        origin = _around(data, _STARTS)
        start = sum(_number(origin, key) or 0.0 for key in _STARTS if origin is not None and key in origin.attrs)
    except RefusedError as error:
        return no_time(error)
    unit, what = text_of(node, "wf_xunit_string"), text_of(node, "wf_xname")
    stamps: Callable[[], np.ndarray] = even_axis(what, unit, start, step, data.size, path, zero_s)
    return stamps


def _zero_s(data: Any, path: str, starts: set[np.datetime64]) -> float:
    """Time [s] of the zero of an axis."""
    unknown = next((k for k in data.attrs if k not in (*_STARTS, *_MOMENTS, *_CF) and _start_like(data, k)), None)
    if unknown is not None:
        raise RefusedError(
            f"has the attribute '{shorten(unknown, 40)}' beside the step of '{shorten(path)}', which may be its start; "
            "call it start_offset_s [s], or remove it"
        )
    moment = start_of(data)
    if isinstance(moment, np.datetime64):
        return float((moment - min(starts)) / np.timedelta64(1, "ns")) * 1e-9
    if moment is not None:
        return moment
    if any(key in data.attrs for key in _MOMENTS):
        raise RefusedError(f"has a start of '{shorten(path)}' that cannot be read; export it with its time")
    if len(starts) > 1:
        raise RefusedError(
            f"has no start of '{shorten(path)}', and other data sets begin at different times; export it again"
        )
    return 0.0


def _start_like(data: Any, key: str) -> bool:
    return _LIKE_A_START.search(key) is not None and bool(np.any(_numbers(data, key) != 0.0))


def _numbers(data: Any, key: str) -> np.ndarray:
    """Numbers of an attribute, none where it has no numbers."""
    value = np.asarray(data.attrs.get(key, ())).reshape(-1)
    return value if value.dtype.kind in "iuf" else np.zeros(0)


def _number(data: Any, key: str) -> float | None:
    """The number of an attribute, None where there is no such attribute.

    Raises
    ------
    RefusedError
        If it is no number.
    """
    if key not in data.attrs:
        return None
    value = _numbers(data, key)
    if value.size != 1:
        raise RefusedError(f"has no number in the attribute '{key}'; correct or remove it")
    return float(value[0])


def _moment(text: str) -> np.datetime64 | None:
    """A date with time (ISO 8601, or with a blank), in UTC where a zone stands with it."""
    plain = re.sub(r"\s*(UTC|GMT|Z)\s*$", "", text.strip(), flags=re.IGNORECASE)
    fraction = re.search(r"(?<=:\d\d)\.(\d+)", plain)
    try:
        moment = dt.datetime.fromisoformat(plain.replace(fraction[0], "") if fraction else plain)
    except ValueError:
        return None
    if moment.tzinfo is not None:
        moment = moment.astimezone(dt.UTC).replace(tzinfo=None)
    nanoseconds = int(fraction[1][:9].ljust(9, "0")) if fraction else 0
    return np.datetime64(moment, "ns") + np.timedelta64(nanoseconds, "ns")
