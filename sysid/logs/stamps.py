"""Stamps as people and loggers write them, as seconds that advance: clocks in digits, differences, too few digits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.logs.channels import Clock

#: Rows without which neither a rate nor a notation is told from the stamps.
_LEAST_ROWS = 16
#: Steps of a stretch in which the resolution of the stamps is looked for: that of 32-bit floats grows with time.
_STRETCH_STEPS = 4096
#: Share and number of the steps, at either end of their sizes, that may be pauses or hiccups.
_ODD_SHARE = 0.005
_ODD_STEPS = 3
#: Up to this share of steps of twice the usual size are rows that the logger lost, not rounding.
_LOST_SHARE = 0.1
#: Stamps with less jitter than this, of their step, are taken as they are.
_EXACT = 1e-3
_DAY_S = 86400.0
#: Seconds since 1970 of the years 1990 to 2100.
_EPOCH_S = 6.3e8, 4.1e9
#: Times the resolution by which stamps may leave the line of a rate that is known.
_SLIPS = 3.0
#: Part by which the rate of many stamps may differ from the one that is known.
_NEAR = 0.01
#: Part of the resolution by which bands of two lines may differ that explain the stamps as well.
_SAME_BAND = 0.05
#: Up to this share of repeated stamps is a hiccup of the logger.
HICCUPS = 0.01


def settled(clock: Clock, label: str) -> tuple[Clock, tuple[str, ...]]:
    """The clock with seconds that advance, and what is to be said about its stamps.

    - Numbers that are a time of day in digits, HHMMSS.sss, become seconds.
    - Differences to the row before are added up.
    - Where several rows share a stamp because it has too few digits, or all steps are rounded, and the rows are evenly
      spaced but for pauses, they are spread evenly: t_i = t_0 + i h with the slope h of the stamps over the rows.

    Parameters
    ----------
    clock : stamps (n,) [s] as the file has them.
    label : name of the file, for messages.
    """
    said: list[str] = []
    stamps = clock.time_s
    known = np.flatnonzero(np.isfinite(stamps))
    if known.size < _LEAST_ROWS:
        return clock, ()
    column = f"the column of time '{clock.name[:60]}'"
    seen, notations = _in_seconds(stamps[known])
    said += [f"{label}: {column} {notation}." for notation in notations]
    even = _evened(seen, known)
    if even is None and not said:
        return clock, ()
    result = np.full(stamps.size, np.nan)
    result[known] = seen if even is None else even[0]
    if even is None:
        return replace(clock, time_s=result), tuple(said)
    _, step, resolution = even
    shared = int(np.count_nonzero(np.diff(seen) == 0.0))
    if shared:
        said.append(
            f"{label}: {column} has a resolution of {resolution:.3g} s, too few digits for its rate: rows share the "
            f"stamp of the row before; by their count they are {step:.4g} s apart ({1.0 / step:.4g} Hz)."
        )
    written = np.full(stamps.size, np.nan)
    written[known] = seen
    return replace(clock, time_s=result, written=written if shared else None), tuple(said)


def in_seconds(stamps: np.ndarray) -> np.ndarray:
    """Stamps (n,), NaN where missing, as seconds that can be compared with those of another column."""
    known = np.isfinite(stamps)
    if np.count_nonzero(known) < _LEAST_ROWS:
        return stamps
    result = stamps.copy()
    result[known] = _in_seconds(stamps[known])[0]
    return result


def _in_seconds(seen: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Stamps in seconds, and what they were."""
    said = []
    for notation, words in (
        (_since_1970, "counts parts of a second since 1970, by its size, and is read so"),
        (_of_day, "is a time of day in digits, HHMMSS, and is read so"),
        (_summed, "holds the time since the row before; it is added up"),
    ):
        read = notation(seen)
        if read is not None:
            said.append(words)
            seen = read
    return seen, said


def _since_1970(stamps: np.ndarray) -> np.ndarray | None:
    """Seconds of stamps that count ms, us or ns since 1970, None for others: as seconds these lie far ahead."""
    size = float(np.min(stamps))
    part = next((p for p in (1e-3, 1e-6, 1e-9) if _EPOCH_S[0] <= size * p <= _EPOCH_S[1]), None)
    return None if part is None or size <= _EPOCH_S[1] else np.asarray(stamps * part)


def _of_day(stamps: np.ndarray) -> np.ndarray | None:
    """Seconds of stamps written as HHMMSS.sss, None where they are not.

    Within a minute they cannot be told from seconds, and need not be.  At a full minute a count would jump by 40 s.
    """
    if np.max(np.abs(np.diff(stamps))) < 40.0:
        return None
    whole = np.floor(stamps)
    hour, minute, second = whole // 10_000, whole // 100 % 100, whole % 100
    if np.min(stamps) < 0.0 or np.max(second) >= 60 or np.max(minute) >= 60 or np.max(hour) >= 24:
        return None
    read = 3600.0 * hour + 60.0 * minute + second + (stamps - whole)
    read[1:] += _DAY_S * np.cumsum(np.diff(read) < -0.5 * _DAY_S)
    steps = np.diff(read)
    turns = np.abs(np.diff(stamps) - steps) > 1.0
    # A count may pause for 40 s by chance, but hardly from the end of a minute to the beginning of the next.
    if not turns.any() or np.min(steps) < 0.0 or np.min(steps[turns]) > 2.0 * np.quantile(steps, 1.0 - _ODD_SHARE):
        return None
    return np.asarray(read)


def _summed(stamps: np.ndarray) -> np.ndarray | None:
    """Sums of stamps that are differences to the row before, None where they are not: these do not advance."""
    rest = stamps[1:]
    size = float(np.median(rest))
    steps = np.diff(rest)
    wavering = np.count_nonzero(steps < 0.0) > 0.2 * np.count_nonzero(steps)
    if not 0.0 < size < 1.0 or not (wavering or np.ptp(rest) == 0.0):
        return None
    if np.min(rest) <= 0.0 or np.mean(np.abs(rest / size - 1.0) < 0.5) < 1.0 - _ODD_SHARE:
        return None
    return np.concatenate([[0.0], np.cumsum(rest)])


def _evened(stamps: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, float, float] | None:
    """Evenly spread stamps, their step, and the resolution of the written ones; None where they are not even.

    Stamps t_i of even rows, rounded to r, stay within a band of width r around a line over the rows.  The band is wider
    where rows are lost that the stamps do not show.
    """
    steps = np.diff(stamps)
    if np.ptp(steps) <= _EXACT * steps[0]:
        return None
    repeated = np.count_nonzero(steps == 0.0)
    if np.any(steps < 0.0) or 0 < repeated <= max(2, HICCUPS * stamps.size):
        return None
    rounded, resolution, highest = _resolution(steps)
    if not (rounded or repeated):
        return None
    # A step that no rounding explains is a pause: the line goes on behind it at another height.
    part = np.concatenate([[0], np.cumsum(steps > highest + 0.5 * resolution)])
    step = _slope(stamps, rows, part)
    if not 0.0 < step <= resolution / _EXACT:
        return None
    line, width = _line(stamps, rows, part, step)
    sure = width <= resolution * (1.05 + 4.0 / np.sqrt(stamps.size))
    return (line, step, resolution) if sure else None


def spread(stamps: np.ndarray, rows: np.ndarray, step_s: float) -> np.ndarray | None:
    """Stamps of which many are repeated, at even rows that are known to be `step_s` apart; None where this is not so.

    The logger may have lost a few rows that stamps with few digits do not show: these are left out of account.
    """
    steps = np.diff(stamps)
    if np.any(steps < 0.0):
        return None
    _, resolution, highest = _resolution(steps)
    part = np.concatenate([[0], np.cumsum(steps > highest + 0.5 * resolution)])
    slope = _slope(stamps, rows, part)
    if resolution <= 0.0:
        return None
    near = abs(slope / step_s - 1.0)
    line, width = _line(stamps, rows, part, slope if near < _EXACT else step_s)
    return line if width <= (_SLIPS if near < _NEAR else 1.05) * resolution else None


def as_known(stamps: np.ndarray, rows: np.ndarray, step_s: float) -> np.ndarray | None:
    """Stamps with few digits at even rows that are known to be `step_s` apart, None where a rate near it fits better.

    A row that was lost between repeated stamps tilts the line through them, and lifts the stamps behind it off every
    line: then the rate of the line is no better than the one that is known.
    """
    _, resolution, highest = _resolution(np.diff(stamps))
    part = np.concatenate([[0], np.cumsum(np.diff(stamps) > highest + 0.5 * resolution)])
    own = _slope(stamps, rows, part)
    if abs(own / step_s - 1.0) >= _NEAR:
        return None
    line, width = _line(stamps, rows, part, step_s)
    return line if width <= _line(stamps, rows, part, own)[1] + _SAME_BAND * resolution else None


def _slope(stamps: np.ndarray, rows: np.ndarray, part: np.ndarray) -> float:
    """Slope of the lines of least squares through the stamps of all parts, 0 where there is none."""
    place = rows - _means(rows, part)
    spread_of_rows = float(place @ place)
    return max(float(place @ stamps) / spread_of_rows, 0.0) if spread_of_rows > 0.0 else 0.0


def _line(stamps: np.ndarray, rows: np.ndarray, part: np.ndarray, step: float) -> tuple[np.ndarray, float]:
    """Lines of that slope through the stamps of every part, beginning at the first, and the band around them."""
    line = _means(stamps, part) + step * (rows - _means(rows, part))
    departure = stamps - line
    begins = np.concatenate([[0], np.flatnonzero(np.diff(part)) + 1])
    width = float(np.max(np.maximum.reduceat(departure, begins) - np.minimum.reduceat(departure, begins)))
    return line + (stamps[0] - line[0]), width


def _resolution(steps: np.ndarray) -> tuple[bool, float, float]:
    """Whether stamps with these steps are rounded, their resolution, and the largest usual step.

    Steps of rounded stamps have two sizes, multiples of the resolution next to each other; those that waver have many,
    and a pause has a size of its own.
    """
    found = []
    for begin in range(0, max(steps.size - _STRETCH_STEPS // 2, 1), _STRETCH_STEPS):
        stretch = np.sort(steps[begin : begin + _STRETCH_STEPS + _STRETCH_STEPS // 2])
        odd = max(_ODD_STEPS, int(_ODD_SHARE * stretch.size))
        usual = stretch[odd : stretch.size - odd]
        size = float(usual[-1] - usual[0])
        two = np.minimum(usual - usual[0], usual[-1] - usual) <= 0.05 * size
        multiple = float(usual[0]) / size if size > 0.0 else 0.0
        whole = abs(multiple - round(multiple)) <= 0.05
        lost = round(multiple) == 1 and np.mean(usual - usual[0] > 0.5 * size) <= _LOST_SHARE
        found.append((bool(two.all()) and whole and not lost, size, float(usual[-1])))
    # Where the resolution of 32-bit floats changes there are more sizes.
    two_sizes, sizes, highest = zip(*found, strict=True)
    return 2 * sum(two_sizes) > len(found), max(sizes), max(highest)


def _means(values: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Mean of the values of the part to which each belongs."""
    return np.asarray((np.bincount(part, values) / np.bincount(part))[part])
