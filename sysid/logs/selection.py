"""Picks the wanted channels among those of a file: names, sizes and clocks are judged before values are read.

It runs in the child process of a reader and is the same for all formats that a library reads.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np

from sysid import limits
from sysid.logs.file_channels import (
    FileChannel,
    RefusedError,
    by_name,
    even_time,
    is_time,
    numbers_of,
    told_apart,
    unit_text,
)
from sysid.logs.file_clocks import FileClocks
from sysid.logs.sparse_channels import own_rows
from sysid.wording import shorten

__all__ = ["FileChannel", "RefusedError", "even_time", "selected"]

#: Names of a file that are told to the user, of the channels that were not found.
_NAMES = 300


def selected(offered: Iterable[FileChannel], request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Answer and arrays of the wanted channels: first the stamps of all clocks [s], then the values.

    What a format has to say besides its channels it appends to ``request["messages"]``.

    Raises
    ------
    RefusedError
        If a wanted name stands for several channels, sizes are beyond the limits, or a channel has no time.
    """
    messages: list[str] = request.setdefault("messages", [])
    channels = list(islice(offered, limits.LOG_CHANNELS + 1))
    if len(channels) > limits.LOG_CHANNELS:
        raise RefusedError(f"has more than {limits.LOG_CHANNELS} channels; export those of the sensors only")
    channels = told_apart(channels)
    everything = bool(request.get("everything"))
    if everything:
        chosen = [c for c in channels if c.length > 1 and not (c.axis or is_time(c, request["time"]))][:_NAMES]
    else:
        chosen = [c for c in (by_name(channels, name) for name in request["wanted"]) if c is not None]
        messages += [f"the channel '{shorten(c.path)}' has no values" for c in chosen if not c.length]
        chosen = [c for c in chosen if c.length]
    _check_sizes(chosen)
    answer = _Answer(FileClocks(channels, request["time"]), messages)
    left_out = []
    for channel in chosen:
        try:
            answer.add(channel)
        except RefusedError as error:
            if not everything:
                raise
            left_out.append(error)
    if left_out and not answer.added:
        raise left_out[-1]
    told = [
        {"name": c.name, "path": c.path, "unit": unit, "clock": clock}
        for c, unit, clock in zip(answer.added, answer.units, answer.clock_of, strict=True)
    ]
    names = [shorten(c.name, 200) for c in channels[:_NAMES]]
    wanted = _own_names(answer.added, channels) if everything else _matched(answer.added, channels, request)
    return {
        "channels": told,
        "clocks": answer.clocks.described,
        "names": names,
        "wanted": wanted,
        "messages": messages[:_NAMES],
        "left_out": [str(error) for error in left_out],
    }, [*answer.clocks.stamps, *answer.values]


@dataclass
class _Answer:
    """Channels whose values have been read."""

    clocks: FileClocks
    messages: list[str]
    added: list[FileChannel] = field(default_factory=list)
    units: list[str | None] = field(default_factory=list)
    values: list[np.ndarray] = field(default_factory=list)
    clock_of: list[int] = field(default_factory=list)

    def add(self, channel: FileChannel) -> None:
        """Read values and stamps of one channel.

        Raises
        ------
        RefusedError
            If it holds no numbers, or has no time of its length.
        """
        array, unit = channel.load()
        numbers = numbers_of(array, channel.path)
        clock = self.clocks.clock_of(channel, numbers)
        holes = np.isnan(numbers)
        # Rows without a stamp are no samples, nor are those between the samples of a slow channel.
        stamps = self.clocks.stamps[clock]
        slow = holes.any() and own_rows(numbers, stamps) is not None
        missing = 0 if slow else int(np.count_nonzero(holes & np.isfinite(stamps)))
        if missing:
            self.messages.append(
                f"{missing} of {numbers.size} samples of '{shorten(channel.path)}' are {channel.invalid} or hold no "
                "number; they are missing"
            )
        self.added.append(channel)
        self.clock_of.append(clock)
        self.units.append(unit_text(unit))
        self.values.append(numbers)


def _own_names(chosen: Sequence[FileChannel], channels: Sequence[FileChannel]) -> list[str]:
    """Names by which channels can be asked for: with the group where another channel has the same name."""
    counts = Counter(c.name for c in channels if c.length)
    return [c.name if counts[c.name] == 1 else c.path for c in chosen]


def _matched(chosen: Sequence[FileChannel], channels: Sequence[FileChannel], request: dict[str, Any]) -> list[str]:
    """For every chosen channel the name by which it was wanted."""
    names = {id(by_name(channels, name)): name for name in reversed(request["wanted"])}
    return [names[id(c)] for c in chosen]


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
