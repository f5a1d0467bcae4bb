"""Reader of one log: from a file of any format to a `Log` with one channel per sensor, in SI units."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.campaign.inputs.log_clocks import BAD_STAMP_SHARE, CleanClock, clean_clocks
from sysid.campaign.inputs.log_sides import join_sides
from sysid.campaign.records import AUXILIARY_KINDS, Channel, Log, Sensor
from sysid.campaign.units import contradiction, unit_in_brackets
from sysid.errors import DataRejectedError
from sysid.logs.channels import LogContent, LogRequest, RawChannel
from sysid.logs.input_file import InputFile
from sysid.logs.names import normal_name
from sysid.logs.registry import read_channels
from sysid.logs.text_table import file_content, near_names
from sysid.wording import shorten

#: How the sentence about a log without the column of a sensor ends.
NO_COLUMN = "the sensor is left out there."
_SUGGESTED = 10  # missing columns for which a near name is looked for
_AS_FAST = 1.05  # steps of a pitch rate that count as no longer than those of the others
CLIP_TOLERANCE = 1e-4  # of full scale: rounding of the written digits


@dataclass(frozen=True)
class LogWriting:
    """How logs are written, as the campaign says: see :class:`sysid.logs.channels.LogRequest`.

    `sync` is the column of a signal that several loggers record, `database` the text of the DBC file
    `database_file` for logs of a CAN bus.
    """

    time: str | None = None
    units_row: bool = False
    format: str | None = None
    sync: str | None = None
    database_file: str | None = None
    database: str | None = None


def read_log(
    source: Path | InputFile,
    name: str,
    sensors: Sequence[Sensor],
    sample_interval_s: float,
    writing: LogWriting = LogWriting(),
) -> Log:
    """Read one log.

    Values are value_SI = sign * scale * reading * unit, stamps t = stamp - first stamp of the log.  Sensors on the left
    and right of the same place become one channel, their mean.  A reading at or beyond the declared full scale is
    marked as censored.

    Parameters
    ----------
    source, name : the file (or its path) and its name for messages and results.
    sensors : sensors with their columns; a missing column leaves its channel out and a message in the log.
    sample_interval_s : declared sample interval [s].
    writing : what the campaign says about the way the log is written.

    Returns
    -------
    Log
        Channels in the order of the sensors, each with the stamps of its own clock; the sample interval of the log is
        the median step of the stamps, of the slowest clock where there are several. Auxiliary channels do not count
        there: their clocks may have any rate.

    Raises
    ------
    CampaignError
        If the package that reads the file's format is not installed.
    DataRejectedError
        If the file is no table of numbers, has no time column or none of the sensors, its time does not advance, or its
        units contradict those of the sensors.
    """
    columns = [normal_name(s.source or s.column) for s in sensors]
    sync_name = None if writing.sync is None else normal_name(writing.sync)
    wanted = tuple(dict.fromkeys([*columns, sync_name] if sync_name else columns))
    request = LogRequest(wanted, writing.time, writing.units_row, writing.format, database=writing.database)
    content = read_channels(file_content(source, name), name, request)
    known = {c.name: c for c in content.channels}
    messages = [*content.messages, *_missing(columns, known, content, name)]
    found = [(s, known[column]) for s, column in zip(sensors, columns, strict=True) if column in known]
    # Of the readings that show vibration, and not that of the common signal, which is no reading of the vehicle.
    judged = [raw for s, raw in found if s.kind not in AUXILIARY_KINDS] or [raw for _, raw in found]
    clocks = clean_clocks(
        {id(c.clock): c.clock for c in content.channels},
        sample_interval_s,
        name,
        messages,
        judged={id(raw.clock) for raw in judged},
    )
    for _, raw in found:
        _refuse_unstamped(raw, clocks[id(raw.clock)], name)
    steps = {clocks[id(raw.clock)].step_s for raw in judged}
    step = max(steps)
    if len(steps) > 1:
        messages.append(
            f"{name}: its channels are sampled at different rates; those faster than the slowest, every {step:.4g} s, "
            "are compared at its steps."
        )
    of_sync = {id(known[sync_name].clock)} if sync_name in known else set()
    start = float(min(clocks[key].stamps[0] for key in {id(raw.clock) for raw in judged} | of_sync))
    times = {key: clock.stamps - start for key, clock in clocks.items()}
    channels = [_channel(s, times[id(raw.clock)], raw, clocks[id(raw.clock)].rows, name) for s, raw in found]
    channels = join_sides(channels, name, messages)
    sync = None
    if sync_name in known:
        raw = known[sync_name]
        sync = times[id(raw.clock)], raw.values[clocks[id(raw.clock)].rows]
    elif sync_name is not None:
        messages.append(
            f"{name}: the column '{shorten(sync_name)}' of the common signal is missing"
            f"{near_names(sync_name, content.names)}; the clock is looked for without it."
        )
    return make_log(name, step, channels, start_time_s=start, messages=tuple(messages), sync=sync)


def make_log(file: str, sample_interval_s: float, channels: Iterable[Channel], **more: Any) -> Log:
    """A log with channels of any kind, `more` as in :class:`Log`."""
    parts: tuple[list[Channel], list[Channel]] = ([], [])
    for channel in channels:
        parts[_is_auxiliary(channel, sample_interval_s)].append(channel)
    return Log(file, sample_interval_s, tuple(parts[False]), auxiliary=tuple(parts[True]), **more)


def _is_auxiliary(channel: Channel, sample_interval_s: float) -> bool:
    if channel.sensor.kind == "pitch_rate" and channel.time_s.size > 1:
        return float(np.median(np.diff(channel.time_s))) > _AS_FAST * sample_interval_s
    return channel.sensor.kind in AUXILIARY_KINDS - {"pitch_rate"}


def _missing(columns: Sequence[str], known: dict[str, RawChannel], content: LogContent, name: str) -> list[str]:
    missing = [column for column in columns if column not in known]
    if len(missing) == len(columns):
        raise DataRejectedError(
            f"{name} has none of the sensor columns, expected '{shorten(missing[0])}'"
            f"{near_names(missing[0], content.names)}; correct the columns or the sensors in campaign.toml."
        )
    return [
        f"{name}: the column '{shorten(column)}' is missing"
        f"{near_names(column, content.names) if i < _SUGGESTED else ''}; {NO_COLUMN}"
        for i, column in enumerate(missing)
    ]


def _refuse_unstamped(raw: RawChannel, clock: CleanClock, label: str) -> None:
    """Refuse a channel whose readings go on in rows behind the last stamp: these are no blank lines of an editor."""
    end = int(clock.rows[-1]) + 1
    readings = np.flatnonzero(np.isfinite(raw.values[end:]))
    if readings.size > max(2, BAD_STAMP_SHARE * raw.values.size):
        raise DataRejectedError(
            f"{label}: '{shorten(raw.name)}' has {readings.size} readings from row {end + raw.clock.first_row} on, "
            f"where the time in column '{shorten(raw.clock.name)}' has ended; it is not the time of this channel, or "
            "stamps are missing: export the log with the time of every channel to its left."
        )


def _channel(sensor: Sensor, time: np.ndarray, raw: RawChannel, rows: np.ndarray, label: str) -> Channel:
    # With a scale the campaign says what the numbers mean: the file's unit may be that of the bare signal.
    written = raw.unit or unit_in_brackets(sensor.source or sensor.column)
    against = contradiction(written, sensor.unit) if sensor.scale == 1.0 else None
    if against is not None:
        raise DataRejectedError(
            f"{label}: the file says that '{shorten(sensor.source or sensor.column)}' is in "
            f"'{shorten(against, 30)}', campaign.toml says '{sensor.unit}'; correct the unit there, or give "
            "the sensor a scale if its readings are scaled."
        )
    value = raw.values[rows] * (sensor.sign * sensor.scale * sensor.unit_in_si)
    censored = np.zeros(value.size, np.int8)
    if sensor.full_scale is not None:
        limit = sensor.full_scale * (1.0 - CLIP_TOLERANCE)
        censored[value >= limit] = 1
        censored[value <= -limit] = -1
    return Channel(sensor, time, value, censored)
