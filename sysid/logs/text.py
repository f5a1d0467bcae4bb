"""Text tables (CSV): the columns of a table share one clock, the column of time, or have one each, to their left."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress

import numpy as np

from sysid.errors import DataRejectedError
from sysid.logs.channels import Clock, LogContent, LogFormat, LogRequest, RawChannel
from sysid.logs.clock_columns import SeveralTimesError, TimeColumn, nameless_time, time_of_channel
from sysid.logs.input_file import InputFile
from sysid.logs.table_head import is_reading
from sysid.logs.text_table import TextTable, open_table
from sysid.logs.time_columns import find_time, is_time, seconds_in
from sysid.wording import shorten


def _read(file: InputFile, label: str, request: LogRequest) -> LogContent:
    declared = request.time

    def is_key(name: str) -> bool:
        return is_time(name) if declared is None else find_time((name,), declared) is not None

    table = open_table(file, label, request.wanted, is_key, request.units_row)
    usual = find_time(table.names, declared)
    if usual is None:
        shown = ", ".join(f"'{shorten(n, 30)}'" for n in table.names[:4])
        expected = "'time_s'" if declared is None else f"'{shorten(declared)}'"
        raise DataRejectedError(
            f"{label} has no time column (found {shown}, ...), expected {expected}; rename the column of the time "
            "stamps, or give its name by 'time' in campaign.toml."
        )
    first = table.names.index(usual)
    times = [first, *(i for i, name in enumerate(table.names) if i != first and is_time(name))]
    if request.everything:
        wanted = {n: i for i, n in enumerate(table.names) if i not in times and is_reading(table.first_cell(i))}
    else:
        wanted = {n: place for n in request.wanted if (place := table.place(n)) is not None}
    times = _readable(table, times, list(wanted.values()))
    instants = [place for place in times if table.has_instants(place)]
    columns = table.read([*wanted.values(), *times], instants)
    of_time = []
    for place in times:
        factor = 1.0 if place in instants else seconds_in(table.names[place], table.unit(place))
        of_time.append(TimeColumn(place, table.names[place], columns[place] * factor))
    said = [] if declared is None else [t.place for t in of_time if is_key(t.name)]
    clocks = {t.place: Clock(t.name, t.stamps, table.layout.first_row) for t in of_time}
    channels = []
    for name, place in wanted.items():
        try:
            time = time_of_channel(place, columns[place], of_time, said)
        except SeveralTimesError as error:
            raise DataRejectedError(
                f"{label} has several columns of time for '{shorten(name)}', {error}; export the file "
                "with the column of time of every channel to its left, and leave 'time' out of campaign.toml."
            ) from None
        _refuse_nameless_time(table, name, place, columns, time)
        channels.append(RawChannel(name, clocks[time.place], columns[place], table.unit(place)))
    return LogContent(tuple(channels), table.names)


def _readable(table: TextTable, times: Sequence[int], wanted: Sequence[int]) -> list[int]:
    """Places of the columns of time that may be that of a wanted channel; the first of `times` is the usual one."""
    first, last = min(wanted, default=0), max(wanted, default=0)
    # Where a channel has none to its left, each may be its time.
    may_be = [p for p in times[1:] if p < last or first < min(times)]
    return [times[0], *(p for p in may_be if is_reading(table.first_cell(p)))]


def _refuse_nameless_time(
    table: TextTable, name: str, place: int, columns: dict[int, np.ndarray], time: TimeColumn
) -> None:
    """Refuse a channel that ends early together with a column to its left that counts up: this may be its time."""

    def others() -> Iterator[tuple[str, np.ndarray]]:
        for other in range(place - 1, time.place, -1):
            if other not in columns and is_reading(table.first_cell(other)):
                with suppress(DataRejectedError):
                    yield table.names[other], table.read([other])[other]

    found = nameless_time(columns[place], time.stamps, others())
    if found is not None:
        raise DataRejectedError(
            f"{table.label}: '{shorten(name)}' ends in row {found[0] + table.layout.first_row}, before the time "
            f"'{shorten(time.name)}' does, and so does the column '{shorten(found[1])}', which counts up evenly: name "
            "that column a time, such as time2_s, if it is the time of this channel, or leave it out."
        )


FORMAT = LogFormat("csv", "a text table", (".csv", ".txt", ".tsv", ".asc"), lambda head: False, _read)
