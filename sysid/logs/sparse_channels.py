"""Slow channels among the rows of a fast one: their samples are the rows in which they have a reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.logs.channels import Clock, RawChannel

_LEAST_READINGS = 16
#: Rows without a reading stand between at least this share of the readings.
_BETWEEN = 0.5
#: Most of the steps from reading to reading lie within this factor of each other.
_EVEN = 1.5
#: Share of filled rows above which a channel is none of these.
_BUSY = 0.7


def with_own_rows(channels: Sequence[RawChannel], label: str) -> tuple[tuple[RawChannel, ...], tuple[str, ...]]:
    """The channels, slow ones with a clock of the rows that they fill, and a sentence about each of these.

    Loggers write channels of several rates into one table with one time; cells between the samples of a slow one are
    empty. A reading that is lost for a while leaves rows empty one after the other, and stays missing.
    """
    found, said = [], []
    clocks: dict[tuple[int, bytes], Clock] = {}
    for channel in channels:
        rows = _own_rows(channel)
        if rows is None:
            found.append(channel)
            continue
        clock = channel.clock
        key = id(clock), rows.tobytes()
        own = clocks.setdefault(key, Clock(clock.name, clock.time_s[rows], clock.first_row + int(rows[0])))
        found.append(replace(channel, clock=own, values=channel.values[rows]))
        said.append(
            f"{label}: '{channel.name[:60]}' has a reading in {rows.size} of {clock.time_s.size} rows, evenly spread; "
            "it is taken as sampled in these rows only."
        )
    return tuple(found), tuple(said)


def _own_rows(channel: RawChannel) -> np.ndarray | None:
    """Rows with readings of a channel that is slower than its table, None for others."""
    # Where empty rows stand between half of the readings, a third of the rows is empty.
    if np.count_nonzero(np.isfinite(channel.values)) > _BUSY * channel.values.size:
        return None
    rows = np.flatnonzero(np.isfinite(channel.values) & np.isfinite(channel.clock.time_s))
    if rows.size < _LEAST_READINGS or np.mean(np.diff(rows) > 1) < _BETWEEN:
        return None
    steps = np.diff(channel.clock.time_s[rows])
    low, high = np.quantile(steps, (0.05, 0.95))
    return rows if low > 0.0 and high <= _EVEN * low else None
