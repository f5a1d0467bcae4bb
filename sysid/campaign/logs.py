"""Reader of one log: from a text file to a `Log` with one channel per sensor, in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid import limits
from sysid.campaign.input_file import InputFile
from sysid.campaign.records import Channel, Log, Sensor
from sysid.campaign.text_table import near_names, read_columns
from sysid.campaign.units import si_factor
from sysid.campaign.wording import shorten
from sysid.errors import DataRejectedError

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
}
BAD_STAMP_SHARE = 0.01  # up to this share of repeated or empty stamps is a hiccup of the logger, more is a broken log
SAME_STEP = 1e-3  # rounding of the printed stamps
_SUGGESTED = 10  # missing columns for which a near name is looked for
CLIP_TOLERANCE = 1e-4  # of full scale: rounding of the written digits
SIDE_DISAGREEMENT = 0.3  # roll makes left and right differ by less than this on a bump taken straight


def read_log(source: Path | InputFile, name: str, sensors: Sequence[Sensor], sample_interval_s: float) -> Log:
    """Read one log.

    Values are value_SI = reading * unit, stamps t = stamp - first stamp.  Sensors on the left and right of the same
    place become one channel, their mean.  A reading at or beyond the declared full scale is marked as censored.

    Parameters
    ----------
    source, name
        The file (or its path) and its name for messages and results.
    sensors
        Sensors with their columns; a missing column leaves its channel out and a message in the log.
    sample_interval_s
        Declared sample interval [s].

    Returns
    -------
    Log
        Channels in the order of the sensors; its sample interval is the median step of the stamps.

    Raises
    ------
    DataRejectedError
        If the file is no table of numbers, has no time column or none of the sensors, or its time does not advance.
    """
    layout, columns, first_row = read_columns(source, name, [s.column for s in sensors], TIME_NAMES)
    time_column, to_seconds = _time_column(columns, layout.names, name)
    messages: list[str] = []
    stamps, keep = _clean_stamps(columns[time_column] * to_seconds, name, time_column, first_row, messages)
    time = stamps - stamps[0]
    step = float(np.median(np.diff(time)))
    _check_span(columns[time_column] * to_seconds, stamps, step, name, time_column, first_row)
    if abs(step / sample_interval_s - 1.0) < SAME_STEP:
        step = sample_interval_s
    _compare_step(step, sample_interval_s, name, time_column, messages)

    missing = [s.column for s in sensors if s.column not in columns]
    if len(missing) == len(sensors):
        raise DataRejectedError(
            f"{name} has none of the sensor columns, expected '{shorten(missing[0])}'"
            f"{near_names(missing[0], layout.names)}; correct the columns or the sensors in campaign.toml."
        )
    messages += [
        f"{name}: the column '{shorten(column)}' is missing"
        f"{near_names(column, layout.names) if i < _SUGGESTED else ''}; the sensor is left out there."
        for i, column in enumerate(missing)
    ]
    channels = [_channel(s, time, columns[s.column][keep]) for s in sensors if s.column in columns]
    columns.clear()
    channels = _join_sides(channels, name, messages)
    return Log(name, step, tuple(channels), float(stamps[0]), tuple(messages))


def _time_column(columns: Mapping[str, np.ndarray], names: Sequence[str], label: str) -> tuple[str, float]:
    found = {n.casefold(): n for n in columns if n.casefold() in TIME_NAMES}
    for spelling, factor in TIME_NAMES.items():
        if spelling in found:
            return found[spelling], factor
    shown = ", ".join(f"'{shorten(n, 30)}'" for n in names[:4])
    raise DataRejectedError(
        f"{label} has no time column (found {shown}, ...), expected 'time_s'; name the column of the time stamps so."
    )


def _clean_stamps(
    stamps: np.ndarray, label: str, column: str, first_row: int, messages: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Stamps that increase strictly, and the rows they stand in."""
    rows = np.flatnonzero(np.isfinite(stamps))
    allowed = max(2, int(BAD_STAMP_SHARE * stamps.size))
    empty = stamps.size - rows.size
    if rows.size < 2:
        raise DataRejectedError(
            f"{label} has {rows.size} row{'' if rows.size == 1 else 's'} with a time stamp in column '{column}', "
            "expected at least 2; export the log again."
        )
    # Blank lines at the very end come from editors and mean nothing.
    inside = rows[-1] + 1 - rows.size
    if inside > allowed:
        first = int(np.flatnonzero(~np.isfinite(stamps))[0])
        raise DataRejectedError(
            f"{label}: {empty} of {stamps.size} rows have no time stamp in column '{column}', the first in row "
            f"{first + first_row}; export the log again."
        )
    if inside:
        messages.append(f"{label}: {inside} rows without a time stamp were left out.")
    steps = np.diff(stamps[rows])
    back = np.flatnonzero(steps < 0.0)
    if back.size:
        row = rows[back[0] + 1]
        raise DataRejectedError(
            f"{label}: the time in column '{column}' runs backward in row {row + first_row} (from "
            f"{stamps[rows[back[0]]]:.10g} s to {stamps[row]:.10g} s); put the rows in order of time or split the log."
        )
    repeated = np.flatnonzero(steps == 0.0) + 1
    if repeated.size > allowed or rows.size - repeated.size < 2:
        row = rows[repeated[0]]
        raise DataRejectedError(
            f"{label}: {repeated.size} time stamps in column '{column}' repeat the one before, the first in row "
            f"{row + first_row} ({stamps[row]:.10g} s); export the log with more digits in the time column."
        )
    if repeated.size:
        messages.append(
            f"{label}: {repeated.size} row{'s' if repeated.size > 1 else ''} with a repeated time stamp (the first is "
            f"row {rows[repeated[0]] + first_row}) {'were' if repeated.size > 1 else 'was'} left out."
        )
        rows = np.delete(rows, repeated)
    return stamps[rows], rows


def _check_span(
    all_stamps: np.ndarray, stamps: np.ndarray, step: float, label: str, column: str, first_row: int
) -> None:
    """Refuse a clock that jumps: whoever lays an even grid over the record would need memory for all of it."""
    span = float(stamps[-1] - stamps[0])
    rows = limits.LOG_PAUSES * stamps.size * step + limits.LOG_PAUSE_S
    most = min(limits.LOG_SECONDS, limits.LOG_STEPS * step, rows)
    if span <= most:
        return
    jump = int(np.argmax(np.diff(stamps)))
    row = int(np.flatnonzero(all_stamps == stamps[jump + 1])[0]) + first_row
    raise DataRejectedError(
        f"{label}: the time in column '{column}' spans {span:.6g} s, at most {most:.6g} s are read of "
        f"{stamps.size} rows {step:.4g} s apart; it jumps by {stamps[jump + 1] - stamps[jump]:.6g} s in row {row}: "
        "correct the stamps or cut the log."
    )


def _compare_step(step: float, declared: float, label: str, column: str, messages: list[str]) -> None:
    ratio = step / declared
    if abs(ratio - 1.0) < 0.01:
        return
    for factor, unit in ((1e3, "ms"), (1e6, "us")):
        if abs(ratio / factor - 1.0) < 0.05:
            raise DataRejectedError(
                f"{label}: the stamps in column '{column}' are {step:g} s apart, {factor:g} times the declared "
                f"{declared:g} s, so they are probably in {unit}; "
                + ("name the column time_ms." if unit == "ms" else "write them in seconds.")
            )
    messages.append(
        f"{label}: the time stamps are {step:.4g} s apart, acquisition.sample_interval_s says {declared:g} s; the "
        "stamps are used."
    )


def _channel(sensor: Sensor, time: np.ndarray, reading: np.ndarray) -> Channel:
    value = reading * si_factor(sensor.unit, "length" if sensor.si_unit == "m" else "acceleration")
    censored = np.zeros(value.size, np.int8)
    if sensor.full_scale is not None:
        limit = sensor.full_scale * (1.0 - CLIP_TOLERANCE)
        censored[value >= limit] = 1
        censored[value <= -limit] = -1
    return Channel(sensor, time, value, censored)


def _join_sides(channels: list[Channel], label: str, messages: list[str]) -> list[Channel]:
    result: list[Channel] = []
    used: set[int] = set()
    for i, one in enumerate(channels):
        if i in used:
            continue
        other = next((j for j in range(i + 1, len(channels)) if j not in used and _is_pair(one, channels[j])), None)
        if other is None:
            result.append(one)
            continue
        used.add(other)
        result.append(_mean_of_sides(one, channels[other], label, messages))
    return result


def _is_pair(one: Channel, two: Channel) -> bool:
    a, b = one.sensor, two.sensor
    place = (a.kind, a.axle, a.body, a.x_m) == (b.kind, b.axle, b.body, b.x_m)
    return place and {a.side, b.side} == {"left", "right"}


def _mean_of_sides(one: Channel, two: Channel, label: str, messages: list[str]) -> Channel:
    names = f"'{shorten(one.sensor.column)}' and '{shorten(two.sensor.column)}'"
    for dead, alive in ((one, two), (two, one)):
        seen = dead.value[np.isfinite(dead.value)]
        if seen.size < 0.5 * dead.value.size or np.ptp(seen) == 0.0:
            messages.append(
                f"{label}: of the pair {names} only '{shorten(alive.sensor.column)}' is used; the other side shows "
                "nothing."
            )
            return alive
    mean = 0.5 * (one.value + two.value)
    difference = one.value - two.value
    both = np.isfinite(mean)
    if both.sum() > 1:
        spread = float(np.std(difference[both]))
        size = float(np.std(mean[both]))
        if spread > SIDE_DISAGREEMENT * 2.0 * size:
            messages.append(
                f"{label}: left and right ({names}) differ by {spread / max(size, 1e-300):.1f} times the size of their "
                "mean; check sign, unit and mounting of both sensors."
            )
    # A bound on one side bounds the mean only if the other side does not point the opposite way.
    upper = (one.censored == 1) | (two.censored == 1)
    lower = (one.censored == -1) | (two.censored == -1)
    mean[upper & lower] = np.nan
    censored = np.where(upper, 1, np.where(lower, -1, 0)).astype(np.int8)
    censored[upper & lower] = 0
    scales = [s.full_scale for s in (one.sensor, two.sensor) if s.full_scale is not None]
    sensor = replace(
        one.sensor,
        column=f"{one.sensor.column}+{two.sensor.column}",
        side=None,
        full_scale=min(scales) if len(scales) == 2 else None,
    )
    return Channel(sensor, one.time_s, mean, censored)
