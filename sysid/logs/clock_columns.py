"""Which column of time belongs to a channel of a table that has several: the nearest to its left with its stamps."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.logs.stamps import in_seconds
from sysid.wording import joined_words, shorten

#: Columns that a sentence lists.
_LISTED = 4
#: Share of the readings of a channel that may stand in rows without a stamp.
_STRAY = 0.01
#: Part of a step by which stamps of the same time may differ.
_SAME = 1e-3
#: Part of the rows of its time that a channel fills to its end, and rows below which nothing is said about it.
_WHOLE, _LEAST_ROWS = 0.98, 16


@dataclass(frozen=True)
class TimeColumn:
    """A column of time: its `place` in the table, from the left, its `name`, and `stamps` (rows,) [s], or NaN."""

    place: int
    name: str
    stamps: np.ndarray


class SeveralTimesError(ValueError):
    """Columns of time of which none can be chosen for a channel: what they are, and the reason."""

    def __init__(self, columns: Sequence[TimeColumn], why: str):
        names = joined_words([f"'{shorten(c.name, 40)}' (column {c.place + 1})" for c in columns[:_LISTED]])
        super().__init__(f"{names}, and {why}")


def time_of_channel(
    place: int, values: np.ndarray, times: Sequence[TimeColumn], declared: Collection[int] = ()
) -> TimeColumn:
    """The column of time of a channel.

    A column can be its time if it has a stamp wherever the channel has a reading.  Of columns that can, and that do not
    show the same time, the nearest to the left counts.

    Parameters
    ----------
    place, values : place of the channel, and its readings (rows,), NaN where missing.
    times : columns of time in the order in which they are preferred where they show the same time.
    declared : places of the columns of time with the name that a campaign file says.

    Raises
    ------
    SeveralTimesError
        If several can be its time and none of them stands nearest to the left, or the declared one is another one.
    """
    if len(times) > 1:
        times = [replace(t, stamps=in_seconds(t.stamps)) for t in times]
    able = [t for t in _advancing(times) if _stamps_readings(t, values)] or list(times)
    said = next((t for t in able if t.place in declared), None)
    if len(able) == 1:
        return able[0]
    if all(same_time(able[0].stamps, t.stamps) for t in able[1:]):
        return said or max(able, key=_digits)
    left = sorted((t for t in able if t.place < place), key=lambda t: t.place)
    if not left:
        raise SeveralTimesError(able, "none of them stands to its left")
    nearest = left[-1]
    # Columns of time side by side, without channels between them, say nothing about which channel is whose.
    block = [t for t in left if all(p in {u.place for u in times} for p in range(t.place, nearest.place))]
    if not all(same_time(nearest.stamps, t.stamps) for t in block):
        whole = [t for t in block if np.array_equal(np.isfinite(t.stamps), np.isfinite(values))]
        if len(whole) != 1:
            raise SeveralTimesError(block, "they stand side by side")
        nearest = whole[0]
    else:
        nearest = max(block, key=_digits)
    if said is not None and not same_time(nearest.stamps, said.stamps):
        raise SeveralTimesError([said, nearest], "'time' names the first, the second stands between it and the channel")
    return nearest


def nameless_time(
    values: np.ndarray, stamps: np.ndarray, others: Iterable[tuple[str, np.ndarray]]
) -> tuple[int, str] | None:
    """The last row of a channel that ends before its time, and the name of what may be its time; else None.

    It is a column that counts up evenly and ends in the same row.

    Parameters
    ----------
    values, stamps : readings of the channel and its time (rows,), NaN where missing.
    others : names and values (rows,) of the columns between the time and the channel, from the right; read only where
        the channel ends early.
    """
    end = _last(values)
    if end > _WHOLE * _last(stamps) or end < _LEAST_ROWS:
        return None
    for name, counts in others:
        steps = np.diff(counts[np.isfinite(counts)])
        if _last(counts) == end and steps.size and np.min(steps) > 0.0 and np.max(steps) < 2.0 * np.min(steps):
            return end, name
    return None


def _last(values: np.ndarray) -> int:
    """Row of the last number, -1 where there is none."""
    if values.size and np.isfinite(values[-1]):
        return values.size - 1
    return int(np.flatnonzero(np.isfinite(values)).max(initial=-1))


def _advancing(times: Sequence[TimeColumn]) -> list[TimeColumn]:
    return [t for t in times if np.isfinite(t.stamps).sum() > 1 and np.nanmax(t.stamps) > np.nanmin(t.stamps)]


def _stamps_readings(time: TimeColumn, values: np.ndarray) -> bool:
    readings = np.isfinite(values)
    stray = np.count_nonzero(readings & ~np.isfinite(time.stamps))
    return bool(stray <= _STRAY * np.count_nonzero(readings))


def same_time(one: np.ndarray, two: np.ndarray) -> bool:
    """Whether stamps (n,) [s] show the same time but for their digits, or but for a zero by which they never meet.

    A time of day and a time since the start differ by hours, two loggers by less than a record takes.
    """
    both = np.isfinite(one) & np.isfinite(two)
    if np.count_nonzero(both) < 2 or np.any(np.isfinite(one) != np.isfinite(two)):
        return False
    a, b = one[both], two[both]
    difference = b - a
    near = 1.05 * max(_resolution(a), _resolution(b)) + _SAME * float(np.median(np.abs(np.diff(a))))
    if np.ptp(difference) > near:
        return False
    return bool(np.max(np.abs(difference)) <= near or a[-1] < b[0] or b[-1] < a[0])


def _resolution(stamps: np.ndarray) -> float:
    """How far stamps may be from those with more digits: the step where rows share one, else how steps vary."""
    steps = np.abs(np.diff(stamps))
    if np.count_nonzero(steps) < 0.99 * steps.size:
        return float(np.max(steps))
    low, high = np.quantile(steps, (0.01, 0.99))
    return float(high - low)


def _digits(time: TimeColumn) -> int:
    """Number of different stamps, of which a column with more digits has more."""
    return int(np.count_nonzero(np.diff(time.stamps[np.isfinite(time.stamps)])))
