"""Picks the wanted channels among those of a file: names, sizes and clocks are judged before values are read.

It runs in the child process of a reader and is the same for all formats that a library reads.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from sysid import limits
from sysid.logs.time_columns import find_time, seconds_in
from sysid.wording import shorten

#: Names of a file that are told to the user, of the channels that were not found.
_NAMES = 300


class RefusedError(ValueError):
    """The rest of a sentence about the file, behind its name."""


@dataclass(frozen=True)
class FileChannel:
    """One channel of a file before its values are read.

    `length` is its number of values.  `load` gives values (n,) and unit.  `time` gives its stamps in seconds where the
    format ties them to the channel; without it a channel of the same group is looked for that has the name of a time.
    Channels with the same `clock` have the same stamps; `first_row` is what people call the first value.
    """

    name: str
    length: int
    load: Callable[[], tuple[np.ndarray, str | None]]
    group: str = ""
    time: Callable[[], np.ndarray] | None = None
    clock: str = ""
    first_row: int = 1

    @property
    def path(self) -> str:
        """Name with the group before it."""
        return f"{self.group}/{self.name}" if self.group else self.name


def even_time(start_s: float, step_s: float, count: int) -> Callable[[], np.ndarray]:
    """Stamps start + k step [s] of an evenly sampled channel.

    Raises
    ------
    RefusedError
        If the step is no positive number.
    """
    if not (np.isfinite(step_s) and np.isfinite(start_s) and step_s > 0.0):
        raise RefusedError(f"has a channel with a sample interval of {step_s:g} s; export it again with its time")
    return lambda: start_s + step_s * np.arange(count)


def selected(offered: Iterable[FileChannel], request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Answer and arrays of the wanted channels: first the stamps of all clocks [s], then the values.

    Raises
    ------
    RefusedError
        If a wanted name stands for several channels, sizes are beyond the limits, or a channel has no time.
    """
    channels = list(islice(offered, limits.LOG_CHANNELS + 1))
    if len(channels) > limits.LOG_CHANNELS:
        raise RefusedError(f"has more than {limits.LOG_CHANNELS} channels; export those of the sensors only")
    everything = bool(request.get("everything"))
    if everything:
        chosen = [c for c in channels if c.length > 1 and find_time((c.name,), request["time"]) is None][:_NAMES]
    else:
        chosen = [c for c in (_by_name(channels, name) for name in request["wanted"]) if c is not None]
    _check_sizes(chosen)
    answer = _Answer(channels, request["time"])
    refused: RefusedError | None = None
    for channel in chosen:
        try:
            answer.add(channel)
        except RefusedError as error:
            if not everything:
                raise
            refused = error
    if refused is not None and not answer.added:
        raise refused
    told = [
        {"name": c.name, "path": c.path, "unit": unit, "clock": clock}
        for c, unit, clock in zip(answer.added, answer.units, answer.clock_of, strict=True)
    ]
    names = [shorten(c.name, 200) for c in channels[:_NAMES]]
    wanted = _own_names(answer.added, channels) if everything else _matched(answer.added, request)
    return {"channels": told, "clocks": answer.described, "names": names, "wanted": wanted}, [
        *answer.stamps,
        *answer.values,
    ]


@dataclass
class _Answer:
    """Channels whose values have been read, of those that the file has; clocks with the same stamps are one."""

    channels: Sequence[FileChannel]
    time: str | None
    added: list[FileChannel] = field(default_factory=list)
    units: list[str | None] = field(default_factory=list)
    values: list[np.ndarray] = field(default_factory=list)
    clock_of: list[int] = field(default_factory=list)
    clocks: dict[str, int] = field(default_factory=dict)
    stamps: list[np.ndarray] = field(default_factory=list)
    described: list[dict[str, Any]] = field(default_factory=list)

    def add(self, channel: FileChannel) -> None:
        """Read values and stamps of one channel.

        Raises
        ------
        RefusedError
            If it holds no numbers, or has no time of its length.
        """
        array, unit = channel.load()
        numbers = _numbers(array, channel.path)
        key, name, time = _time_of(channel, numbers.size, self.channels, self.time)
        if key not in self.clocks:
            stamps_s = time()
            if stamps_s.size != numbers.size:
                raise _unequal(channel, numbers.size, stamps_s.size, name)
            # Formats that give every channel a time of its own mostly write the same one.
            same = (i for i, other in enumerate(self.stamps) if np.array_equal(stamps_s, other))
            self.clocks[key] = next(same, len(self.stamps))
            if self.clocks[key] == len(self.stamps):
                self.stamps.append(stamps_s)
                self.described.append({"name": name, "first_row": channel.first_row})
        clock = self.clocks[key]
        if self.stamps[clock].size != numbers.size:
            raise _unequal(channel, numbers.size, self.stamps[clock].size, name)
        self.added.append(channel)
        self.units.append(_text(unit))
        self.values.append(numbers)
        self.clock_of.append(clock)


def _unequal(channel: FileChannel, values: int, times: int, name: str) -> RefusedError:
    return RefusedError(
        f"has {values} values in '{shorten(channel.path)}' and {times} times in '{shorten(name)}'; export it again"
    )


def _own_names(chosen: Sequence[FileChannel], channels: Sequence[FileChannel]) -> list[str]:
    """Names by which channels can be asked for: with the group where another channel has the same name."""
    counts = Counter(c.name for c in channels if c.length)
    return [c.name if counts[c.name] == 1 else c.path for c in chosen]


def _matched(chosen: Sequence[FileChannel], request: dict[str, Any]) -> list[str]:
    """For every chosen channel the name by which it was wanted."""
    names = {id(c): name for name in reversed(request["wanted"]) for c in chosen if name in (c.name, c.path)}
    return [names[id(c)] for c in chosen]


def _by_name(channels: Sequence[FileChannel], name: str) -> FileChannel | None:
    hits = [c for c in channels if c.path == name] or [c for c in channels if c.name == name]
    hits = [c for c in hits if c.length] or hits
    if len(hits) > 1:
        paths = sorted({c.path for c in hits})
        hint = (
            f"name the column '{shorten(paths[0])}' or '{shorten(paths[1])}'"
            if len(paths) > 1
            else "rename one of them"
        )
        raise RefusedError(f"has {len(hits)} channels with the name '{shorten(name)}'; {hint}")
    return hits[0] if hits else None


def _check_sizes(chosen: Sequence[FileChannel]) -> None:
    for channel in chosen:
        if channel.length > limits.LOG_ROWS:
            raise RefusedError(
                f"has {channel.length} values in '{shorten(channel.path)}', at most {limits.LOG_ROWS} are read; cut it "
                "to the time of the test"
            )
    total = sum(channel.length for channel in chosen)
    if total > limits.LOG_NUMBERS:
        raise RefusedError(
            f"holds {total} numbers, at most {limits.LOG_NUMBERS} are read; cut it to the time of the test"
        )


def _time_of(
    channel: FileChannel, size: int, channels: Sequence[FileChannel], wanted: str | None
) -> tuple[str, str, Callable[[], np.ndarray]]:
    """Key, name and stamps of the clock of a channel."""
    if channel.time is not None and wanted is None:
        return f"own {channel.clock} {size}", channel.clock or "time", channel.time
    near = [c for c in channels if c.group == channel.group]
    for candidates in (near, [c for c in channels if not c.group], channels):
        named = {c.name: c for c in candidates if c.length == channel.length and c is not channel}
        name = find_time(named, wanted)
        if name is not None:
            return f"column {named[name].path}", name, partial(_seconds, named[name])
    if channel.time is not None:
        return f"own {channel.clock} {size}", channel.clock or "time", channel.time
    expected = "time" if wanted is None else wanted
    raise RefusedError(
        f"has no time column for '{shorten(channel.path)}', expected '{shorten(expected)}' of the same length; say its "
        "name by 'time' in campaign.toml or write it with the file"
    )


def _seconds(column: FileChannel) -> np.ndarray:
    array, unit = column.load()
    if np.issubdtype(array.dtype, np.datetime64) or np.issubdtype(array.dtype, np.timedelta64):
        first = array[~np.isnat(array)][:1]
        if not first.size:
            raise RefusedError(f"has no time in '{shorten(column.path)}'; export it again")
        ticks = (array - first[0]).astype("timedelta64[ns]")
        return np.where(np.isnat(ticks), np.nan, ticks.astype(np.float64) * 1e-9)
    return _numbers(array, column.path) * seconds_in(column.name, _text(unit))


def _numbers(array: np.ndarray, path: str) -> np.ndarray:
    """Values as float64, infinite ones as NaN."""
    flat = np.asarray(array)
    if flat.ndim != 1:
        flat = flat.reshape(-1)
    if flat.dtype.kind not in "biuf":
        what = "complex numbers" if flat.dtype.kind == "c" else "text or dates"
        raise RefusedError(f"has {what} in '{shorten(path)}', expected numbers; export it as numbers")
    with np.errstate(over="ignore", invalid="ignore"):
        numbers = np.array(flat, dtype=np.float64)
    numbers[~np.isfinite(numbers)] = np.nan
    return numbers


def _text(unit: Any) -> str | None:
    if isinstance(unit, bytes):
        unit = unit.decode("utf-8", "replace")
    return shorten(unit.strip(), 40) if isinstance(unit, str) and unit.strip() else None
