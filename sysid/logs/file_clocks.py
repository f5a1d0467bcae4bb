"""Clocks of the channels of a file: a clock is its stamps, compared by their content."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from sysid.logs.channels import within_range
from sysid.logs.clock_columns import SeveralTimesError, TimeColumn, nameless_time, same_time, time_of_channel
from sysid.logs.file_channels import (
    LISTED,
    FileChannel,
    RefusedError,
    is_time,
    not_time,
    numbers_of,
    unit_text,
)
from sysid.logs.time_columns import find_time, seconds_in, time_unit
from sysid.wording import joined_words, shorten


@dataclass
class FileClocks:
    """Clocks of `channels`, found as they are asked for; `time` is the wanted name of a column of time.

    `stamps` [s] are those of the clocks, `described` their names and first rows.
    """

    channels: Sequence[FileChannel]
    time: str | None
    stamps: list[np.ndarray] = field(default_factory=list)
    described: list[dict[str, Any]] = field(default_factory=list)
    _by_source: dict[int, int] = field(default_factory=dict)
    _alike: dict[tuple[int, bytes], list[int]] = field(default_factory=lambda: defaultdict(list))
    _columns: dict[int, np.ndarray] = field(default_factory=dict)
    _parts: dict[tuple[str, Hashable], list[FileChannel]] = field(default_factory=lambda: defaultdict(list))
    _origin: dict[str, np.datetime64 | np.timedelta64] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for channel in self.channels:
            self._parts[channel.group, channel.place].append(channel)

    def clock_of(self, channel: FileChannel, values: np.ndarray) -> int:
        """Number of the clock of a channel with these values.

        Raises
        ------
        RefusedError
            If it has no time of that length, several, or an axis that is not time.
        """
        size = values.size
        source, name, stamps = self._time_of(channel, values)
        clock = self._by_source.get(source)
        if clock is None:
            clock = self._by_source[source] = self._clock(stamps(), name, channel.first_row)
        if self.stamps[clock].size != size:
            raise RefusedError(
                f"has {size} values in '{shorten(channel.path)}' and {self.stamps[clock].size} times in "
                f"'{shorten(name)}'; export it again"
            )
        return clock

    def _clock(self, stamps_s: np.ndarray, name: str, first_row: int) -> int:
        stamps_s = within_range(stamps_s)
        # Of many clocks only those that agree at three places are compared.
        looked_at = stamps_s[[0, stamps_s.size // 2, -1]].tobytes() if stamps_s.size else b""
        alike = self._alike[stamps_s.size, looked_at]
        for clock in alike:
            known = self.stamps[clock]
            if np.array_equal(known, stamps_s) or np.array_equal(known, stamps_s, equal_nan=True):
                return clock
        alike.append(len(self.stamps))
        self.stamps.append(stamps_s)
        self.described.append({"name": name, "first_row": first_row})
        return alike[-1]

    def _time_of(self, channel: FileChannel, values: np.ndarray) -> tuple[int, str, Callable[[], np.ndarray]]:
        """What the stamps of a channel come from, as a number, with their name and the stamps."""
        if channel.time is None or self.time is not None:
            found = self._column_of_time(channel, values)
            if found is not None:
                self._refuse_nameless_time(channel, values, found)
                return id(found), found.name, partial(self._seconds, found)
        if isinstance(channel.time, FileChannel):
            return id(channel.time), channel.time.name, partial(self._seconds, channel.time)
        if channel.time is not None:
            return id(channel.time), channel.clock or "time", channel.time
        expected = "time" if self.time is None else self.time
        raise RefusedError(
            f"has no time column for '{shorten(channel.path)}', expected '{shorten(expected)}' of the same length; say "
            "its name by 'time' in campaign.toml or write it with the file"
        )

    def _refuse_nameless_time(self, channel: FileChannel, values: np.ndarray, time: FileChannel) -> None:
        """Refuse a channel that ends early together with a column to its left that counts up: this may be its time."""
        if not channel.in_order or not np.isnan(values[-1:]).any():
            return
        part = [c for c in self._parts[channel.group, channel.place] if c.length == channel.length]
        at = {id(c): i for i, c in enumerate(part)}
        stamps = self._seconds(time)

        def others() -> Iterator[tuple[str, np.ndarray]]:
            for other in reversed(part[at.get(id(time), at[id(channel)]) + 1 : at[id(channel)]]):
                if not self._is_time(other):
                    with suppress(RefusedError):
                        yield other.path, numbers_of(other.load()[0], other.path)

        found = nameless_time(values, stamps, others()) if stamps.size == values.size else None
        if found is not None:
            raise RefusedError(
                f"has no more readings of '{shorten(channel.path)}' behind row {found[0] + channel.first_row}, before "
                f"the time '{shorten(time.name)}' ends, and none of '{shorten(found[1])}', which counts up evenly: "
                "name that column a time, such as time2_s, if it is the time of this channel, or leave it out"
            )

    def _column_of_time(self, channel: FileChannel, values: np.ndarray) -> FileChannel | None:
        """The column of time in the part of the file in which a channel stands, or in one around it.

        A column elsewhere counts where the file has no other, and the channel no stamps of its own.
        """
        part = self._parts[channel.group, channel.place]
        times = self._times(part, channel)
        if times:
            return self._nearest(channel, part, times, values)
        around = channel.group
        while around:
            around = around.rpartition("/")[0]
            times = [c for c in self._times(self.channels, channel) if c.group == around]
            if times:
                return self._only(channel, times)
        if channel.time is not None:
            return None
        times = self._times(self.channels, channel)
        others = [c for c in self.channels if c.length > 1 and self._is_time(c)]
        return self._only(channel, times) if times and len(others) == len(times) else None

    def _times(self, candidates: Sequence[FileChannel], channel: FileChannel) -> list[FileChannel]:
        """Columns of time of the length of a channel: the usual one first, the others in the order of the file.

        A wanted one counts alone where the order of the channels says nothing.
        """
        alike = [c for c in candidates if c.length == channel.length and c is not channel]
        wanted = [c for c in alike if self._is_time(c)]
        if self.time is None or not wanted or not channel.in_order or channel.time is not None:
            times = wanted
        else:
            times = [*wanted, *(c for c in alike if is_time(c, None) and c not in wanted)]
        name = find_time([c.name for c in times], self.time)
        return sorted(times, key=lambda c: c.name != name)

    def _is_time(self, column: FileChannel) -> bool:
        return is_time(column, self.time)

    def _nearest(
        self, channel: FileChannel, part: Sequence[FileChannel], times: list[FileChannel], values: np.ndarray
    ) -> FileChannel:
        """Of several columns of time that of a channel, by the order of the file."""
        readable = self._readable(times)
        if len(readable) < 2:
            return readable[0][0] if readable else times[0]
        if not channel.in_order:
            if not all(same_time(readable[0][1], stamps) for _, stamps in readable[1:]):
                raise _several_times(channel, times)
            return readable[0][0]
        at = {id(c): i for i, c in enumerate(part)}
        declared = [] if self.time is None else [at[id(c)] for c in times if self._is_time(c)]
        columns = [TimeColumn(at[id(c)], c.name, stamps) for c, stamps in readable]
        try:
            found = time_of_channel(at[id(channel)], values, columns, declared)
        except SeveralTimesError as error:
            raise RefusedError(
                f"has several columns of time for '{shorten(channel.path)}', {error}; export the file with the column "
                "of time of every channel to its left, and leave 'time' out of campaign.toml"
            ) from None
        return part[found.place]

    def _only(self, channel: FileChannel, times: list[FileChannel]) -> FileChannel:
        """The column of another part: of several all stamps must agree."""
        stamps = [found for _, found in self._readable(times)]
        if not all(np.array_equal(other, stamps[0], equal_nan=True) for other in stamps):
            raise _several_times(channel, times)
        return times[0]

    def _readable(self, times: Sequence[FileChannel]) -> list[tuple[FileChannel, np.ndarray]]:
        """Columns of time that can be read, with their stamps; of a single one nothing is read."""
        found = []
        for column in times if len(times) > 1 else ():
            with suppress(RefusedError):
                found.append((column, self._seconds(column)))
        return found

    def _seconds(self, column: FileChannel) -> np.ndarray:
        if id(column) not in self._columns:
            self._columns[id(column)] = self._read_seconds(column)
        return self._columns[id(column)]

    def _read_seconds(self, column: FileChannel) -> np.ndarray:
        array, unit = column.load()
        if array.dtype.kind in "mM":
            first = array[~np.isnat(array)][:1]
            if not first.size:
                raise RefusedError(f"has no time in '{shorten(column.path)}'; export it again")
            # One zero for all columns of dates: the midnight before the first stamp of the first one.
            day = first[0].astype(f"{array.dtype.kind}8[D]")
            ticks = (array - self._origin.setdefault(array.dtype.kind, day)).astype("timedelta64[ns]")
            return np.where(np.isnat(ticks), np.nan, ticks.astype(np.float64) * 1e-9)
        said = unit_text(unit)
        if said is not None and time_unit(said) is None:
            raise not_time(f"'{column.name}'", said, column.path)
        return numbers_of(array, column.path) * seconds_in(column.name, said)


def _several_times(channel: FileChannel, times: Sequence[FileChannel]) -> RefusedError:
    shown = joined_words([f"'{shorten(c.path)}'" for c in times[:LISTED]])
    return RefusedError(
        f"has several columns of time for '{shorten(channel.path)}', {shown}, which do not agree; name one by 'time' "
        "in campaign.toml if it is that of all channels, else write each with its channels into a group of its own"
    )
