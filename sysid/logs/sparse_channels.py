"""Slow channels among the rows of a fast one: their samples are the rows in which they have a reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.logs.channels import Clock, RawChannel
from sysid.wording import joined_words, shorten

_LEAST_READINGS = 16
#: Rows without a reading stand between at least this share of the readings.
_BETWEEN = 0.5
#: Most of the steps from reading to reading lie within this factor of each other.
_EVEN = 1.5
#: Share of filled rows above which a channel is none of these.
_BUSY = 0.7
#: Columns that a sentence lists.
_LISTED = 4


def with_own_rows(channels: Sequence[RawChannel], label: str) -> tuple[tuple[RawChannel, ...], tuple[str, ...]]:
    """The channels, slow ones with a clock of the rows that they fill, and a sentence about those of every such clock.

    Loggers write channels of several rates into one table with one time; cells between the samples of a slow one are
    empty. A reading that is lost for a while leaves rows empty one after the other, and stays missing.
    """
    found = []
    clocks: dict[tuple[int, bytes], Clock] = {}
    slow: dict[tuple[int, int], list[str]] = {}
    for channel in channels:
        rows = own_rows(channel.values, channel.clock.time_s)
        if rows is None:
            found.append(channel)
            continue
        clock = channel.clock
        key = id(clock), rows.tobytes()
        own = clocks.setdefault(key, Clock(clock.name, clock.time_s[rows], clock.first_row + int(rows[0])))
        found.append(replace(channel, clock=own, values=channel.values[rows]))
        slow.setdefault((rows.size, clock.time_s.size), []).append(channel.name)
    return tuple(found), tuple(_sentence(label, names, *counts) for counts, names in slow.items())


def _sentence(label: str, names: Sequence[str], readings: int, rows: int) -> str:
    shown = joined_words([f"'{shorten(n)}'" for n in names[:_LISTED]])
    more = f" and {len(names) - _LISTED} more columns" if len(names) > _LISTED else ""
    have, taken = ("have", "they are") if len(names) > 1 else ("has", "it is")
    return (
        f"{label}: {shown}{more} {have} a reading in one of {rows / readings:.3g} rows, evenly spread; {taken} taken "
        "as sampled in these rows only."
    )


def own_rows(values: np.ndarray, stamps: np.ndarray) -> np.ndarray | None:
    """Rows with readings of a channel that is slower than its table, None for others.

    Parameters
    ----------
    values, stamps : readings and stamps [s] of all rows of the table (n,), NaN where missing.
    """
    # Where empty rows stand between half of the readings, a third of the rows is empty.
    if np.count_nonzero(np.isfinite(values)) > _BUSY * values.size:
        return None
    rows = np.flatnonzero(np.isfinite(values) & np.isfinite(stamps))
    if rows.size < _LEAST_READINGS or np.mean(np.diff(rows) > 1) < _BETWEEN:
        return None
    steps = np.diff(stamps[rows])
    low, high = np.quantile(steps, (0.05, 0.95))
    return rows if low > 0.0 and high <= _EVEN * low else None
