"""Text tables (CSV): the columns of a table share one clock, the column of time."""

from __future__ import annotations

from sysid.errors import DataRejectedError
from sysid.logs.channels import Clock, LogContent, LogFormat, LogRequest, RawChannel
from sysid.logs.input_file import InputFile
from sysid.logs.text_table import find_layout, read_columns, without_error_marks
from sysid.logs.time_columns import TIME_NAMES, find_time, seconds_in
from sysid.wording import shorten


def _read(file: InputFile, label: str, request: LogRequest) -> LogContent:
    times = list(TIME_NAMES) if request.time is None else [request.time.strip().casefold()]
    wanted = _all_names(file, label, times) if request.everything else request.wanted
    layout, columns, first_row = read_columns(file, label, wanted, times, request.units_row)
    units = dict(zip(layout.names, layout.units, strict=False))
    time = find_time(columns, request.time)
    if time is None:
        shown = ", ".join(f"'{shorten(n, 30)}'" for n in layout.names[:4])
        expected = "'time_s'" if request.time is None else f"'{shorten(request.time)}'"
        raise DataRejectedError(
            f"{label} has no time column (found {shown}, ...), expected {expected}; rename the column of the time "
            "stamps, or give its name by 'time' in campaign.toml."
        )
    factor = 1.0 if time in layout.instants else seconds_in(time, units.get(time))
    clock = Clock(time, columns[time] * factor, first_row)
    channels = (RawChannel(n, clock, columns[n], units.get(n) or None) for n in wanted if n in columns)
    return LogContent(tuple(channels), layout.names)


def _all_names(file: InputFile, label: str, times: list[str]) -> tuple[str, ...]:
    names = find_layout(without_error_marks(file.data), label, (), times).names
    return tuple(n for n in names if n.casefold() not in times)


FORMAT = LogFormat("csv", "a text table", (".csv", ".txt", ".tsv", ".asc"), lambda head: False, _read)
