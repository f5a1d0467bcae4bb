"""Records with gaps: readings where there are any, and windows under which equations of motion hold beside a gap.

A gap is a pause between two readings (rows or cells that are missing, spans that were left out) that is too long for a
line through it. A smooth window w that vanishes in it and has no reading of it under its slopes keeps linear equations
exact: by parts, the transform of w q'' is that of (w'' - 2 i omega w' - omega^2 w) q, so nothing has to be known of q
in the gap (modulating functions: M. Shinbrot, Trans. ASME 79 (1957) 579).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.records import Channel

#: A line through a pause of this share of a period is off by up to (2 pi / 8)^2 / 8 = 8 % of the amplitude.
_BRIDGED_PERIODS = 1.0 / 8.0
#: Steps between readings up to this many times the usual one are jitter.
_JITTER = 1.6
#: Slopes of a window beside a gap, and the shortest stretch between gaps that is used [s].
_SLOPE_S, _SHORTEST_S = 0.4, 0.6


def longest_pause_s(time_s: np.ndarray, highest_hz: float) -> float:
    """Longest pause [s] between readings at `time_s` (n,) that a line bridges for motion up to `highest_hz`."""
    step = float(np.median(np.diff(time_s))) if time_s.size > 1 else 0.0
    return max(_JITTER * step, _BRIDGED_PERIODS / highest_hz)


def readings_at(channel: Channel, at_s: np.ndarray, highest_hz: float = np.inf, clipped: bool = True) -> np.ndarray:
    """Readings interpolated at other times, NaN outside the record and in gaps.

    Parameters
    ----------
    channel
        One channel; missing readings are NaN, or their rows are missing.
    at_s
        (m,) increasing times [s].
    highest_hz
        Motion up to this frequency is of interest [Hz]: pauses that are short for it are bridged. By default none is.
    clipped
        Whether clipped readings count as readings.
    """
    good = np.isfinite(channel.value)
    if not clipped:
        good &= channel.censored == 0
    time, value = channel.time_s[good], channel.value[good]
    if time.size < 2:
        return np.full(at_s.size, np.nan)
    result = np.interp(at_s, time, value, left=np.nan, right=np.nan)
    for first, last in _gaps(time, highest_hz):
        result[(at_s > first) & (at_s < last)] = np.nan
    return np.asarray(result)


def gaps_of(channel: Channel, highest_hz: float) -> list[tuple[float, float]]:
    """Begin and end [s] of every gap inside the record of a channel, for motion up to `highest_hz`."""
    return _gaps(channel.time_s[np.isfinite(channel.value)], highest_hz)


def _gaps(time_s: np.ndarray, highest_hz: float, readings_s: np.ndarray | None = None) -> list[tuple[float, float]]:
    """Steps between times that a line does not bridge; the usual step is that of the readings."""
    # Where every step is short, the usual one need not be known.
    if time_s.size < 2 or np.max(np.diff(time_s)) <= _BRIDGED_PERIODS / highest_hz:
        return []
    return pauses(time_s, longest_pause_s(time_s if readings_s is None else readings_s, highest_hz))


def unseen(channel: Channel, highest_hz: float, log_s: tuple[float, float] | None = None) -> list[tuple[float, float]]:
    """Begin and end [s] of all spans without readings: gaps, and what is missing at either end of the log.

    Parameters
    ----------
    channel, highest_hz
        As of :func:`gaps_of`.
    log_s
        First and last time of the log; by default those of the channel's own rows.
    """
    time = channel.time_s[np.isfinite(channel.value)]
    begin, end = log_s or (float(channel.time_s[0]), float(channel.time_s[-1]))
    if not time.size:
        return [(begin, end)]
    whole = np.concatenate([[min(begin, time[0])], time, [max(end, time[-1])]])
    return _gaps(whole, highest_hz, time)


def is_whole(channel: Channel, begin_s: float, end_s: float, highest_hz: float) -> bool:
    """Whether a channel has readings from `begin_s` to `end_s`, as far as its log goes, without a gap."""
    time = channel.time_s[np.isfinite(channel.value)]
    if time.size < 2:
        return False
    begin, end = max(begin_s, float(channel.time_s[0])), min(end_s, float(channel.time_s[-1]))
    late_s = max(float(time[0]) - begin, end - float(time[-1]))
    if late_s > _BRIDGED_PERIODS / highest_hz and late_s > longest_pause_s(time, highest_hz):
        return False
    return not any(first < end and last > begin for first, last in _gaps(time, highest_hz))


def parted(channel: Channel) -> tuple[Channel, np.ndarray]:
    """A channel with one missing reading put in wherever rows are missing, so that no neighbour stands across a gap.

    Returns
    -------
    tuple
        The channel, and for each row of the given one its place there.
    """
    steps = np.diff(channel.time_s)
    after = np.flatnonzero(steps > _JITTER * np.median(steps)) + 1 if steps.size else np.empty(0, int)
    place = np.arange(channel.time_s.size)
    place = place + np.searchsorted(after, place, "right")
    if not after.size:
        return channel, place
    between = 0.5 * (channel.time_s[after - 1] + channel.time_s[after])
    whole = replace(
        channel,
        time_s=np.insert(channel.time_s, after, between),
        value=np.insert(channel.value, after, np.nan),
        censored=np.insert(channel.censored, after, 0),
    )
    return whole, place


def pauses(time_s: np.ndarray, longest_s: float) -> list[tuple[float, float]]:
    """Begin and end [s] of every step between times (n,) [s] that is longer than `longest_s`."""
    after = np.flatnonzero(np.diff(time_s) > longest_s)
    return list(zip(time_s[after].tolist(), time_s[after + 1].tolist(), strict=True))


@dataclass(frozen=True)
class Window:
    """A weight (n,) on even times [s], its first two slopes per second, and the time that it leaves [s].

    `whole` says whether it vanishes only at both ends of the record.
    """

    time_s: np.ndarray
    weight: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray
    known_s: float
    whole: bool

    def transform(
        self, value: np.ndarray, omega: np.ndarray, derivative: int = 0, padded: int | None = None
    ) -> np.ndarray:
        """Transform (F,) of the weighted readings, or of their weighted first or second derivative.

        Parameters
        ----------
        value
            (n,) readings at the window's times; NaN where the weight is zero.
        omega
            (F,) angular frequencies of `rfft` at which it is wanted [rad/s].
        derivative
            0, 1 or 2.
        padded
            Number of samples of the transform, with zeros behind the readings; by default n.
        """
        level = float(np.median(value[self.weight > 0.0]))
        there = np.where(self.weight > 0.0, value - level, 0.0)
        step = float(self.time_s[1] - self.time_s[0])
        count = padded or self.time_s.size
        at = np.rint(omega * step * count / (2.0 * np.pi)).astype(int)

        def moved(weight: np.ndarray) -> np.ndarray:
            return np.asarray(np.fft.rfft(there * weight, count)[at])

        plain = moved(self.weight)
        if derivative == 0:
            return plain
        if derivative == 1:
            return np.asarray(1j * omega * plain - moved(self.slope))
        return np.asarray(moved(self.curvature) - 2j * omega * moved(self.slope) - omega**2 * plain)


def window_over(time_s: np.ndarray, readings: Sequence[np.ndarray]) -> Window | None:
    """The window that vanishes wherever one of several records has no reading; None where nothing is left.

    Parameters
    ----------
    time_s
        (n,) even times [s].
    readings
        Records (n,) at these times, NaN where missing.
    """
    known = np.logical_and.reduce([np.isfinite(r) for r in readings])
    step = float(time_s[1] - time_s[0])
    weight, slope, curvature = (np.zeros(time_s.size) for _ in range(3))
    edges = np.diff(np.concatenate([[0], known.astype(np.int8), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    kept = [(b, e) for b, e in zip(begins.tolist(), ends.tolist(), strict=True) if (e - b) * step >= _SHORTEST_S]
    for begin, end in kept:
        span = (end - 1 - begin) * step
        rise_s = min(_SLOPE_S, 0.5 * span)
        since, until = (time_s[begin:end] - time_s[begin]) / rise_s, (time_s[end - 1] - time_s[begin:end]) / rise_s
        for u, sign in ((since, 1.0), (until, -1.0)):
            rising = u < 1.0
            v = u[rising]
            at = begin + np.flatnonzero(rising)
            weight[at] = v**3 * (10.0 - 15.0 * v + 6.0 * v**2)
            slope[at] = sign * 30.0 * v**2 * (1.0 - v) ** 2 / rise_s
            curvature[at] = 60.0 * v * (1.0 - v) * (1.0 - 2.0 * v) / rise_s**2
        inside = begin + np.flatnonzero((since >= 1.0) & (until >= 1.0))
        weight[inside] = 1.0
    left = sum(e - b for b, e in kept) * step
    return Window(time_s, weight, slope, curvature, left, len(kept) == 1) if kept else None
