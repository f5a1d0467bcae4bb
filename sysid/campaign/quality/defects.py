"""Defects that one channel shows by itself: dead and lost spans, spikes, noise, rest level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.campaign.clipping import runs_of
from sysid.campaign.records import Channel

DEAD_S = 0.25  # a live sensor does not repeat one value for longer than this
LOST_S = 0.1  # a cycle of wheel hop at 10 Hz: shorter gaps are left to the missing samples
HELD_SAMPLES = 8  # equal readings in a row that count as a channel that hangs
SHIFT_M, SHIFT_M_S2 = 0.006, 0.8  # beyond what friction and a slope leave (an assumption)
SPIKE_SIGMA = 15.0  # typical departures: no motion of a truck does so in one sample (an assumption)
# Typical departures around a spike: an axle that chatters above the filter's cut-off departs by three of them again and
# again, a lost contact on a moving truck by more than ten.
SPIKE_AROUND = 6.0
MOVING_SHARE = 0.08  # of the largest departure: smooth motion of that size at the start is no rest
# Scatter over range, median over the channels of a log: 0.003 to 0.008 while a truck stands or rolls on a smooth road,
# 0.02 to 0.3 after it has met a bump or fallen off a plank.
OTHERS_MOVE = 0.02
BESIDE_S = 0.3  # beside a span at an end of the record, where a channel is seen to be alive
QUIET_S = 0.2  # shortest quiet start from which a rest level is read
_FEWEST = 10  # readings of a quiet start
AVERAGED_S = 0.1  # half a period of the motion of bodies, and of what a wheel meets on a bump at walking pace


@dataclass(frozen=True)
class Timing:
    """Time base of one log: rate [Hz], largest departure of a step from whole samples [s], gaps (start [s], rows)."""

    rate_hz: float
    jitter_s: float
    gaps: tuple[tuple[float, int], ...]


def timing(time_s: np.ndarray, sample_interval_s: float) -> Timing:
    """Rate, jitter and gaps of the stamps `time_s` (n,) [s], whose nominal step is `sample_interval_s` [s]."""
    steps = np.diff(time_s)
    whole = np.maximum(np.rint(steps / sample_interval_s), 1.0)
    jitter = float(np.max(np.abs(steps - whole * sample_interval_s), initial=0.0))
    gaps = tuple((float(time_s[i]) + sample_interval_s, int(whole[i]) - 1) for i in np.flatnonzero(whole > 1.5))
    return Timing(1.0 / sample_interval_s, jitter, gaps)


def dead_spans(
    time_s: np.ndarray, value: np.ndarray, censored: np.ndarray, others: Sequence[Channel] = ()
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Index ranges where the reading stands still although elsewhere it changes from sample to sample: dead, at rest.

    A sensor whose resolution is coarser than its noise repeats one reading while the truck stands.  It is dead where
    the `others` of its log move meanwhile.  Without others it is dead unless the record begins there, or the motion has
    faded away before.  A module that starts late or ends early is dead too: its reading stands still at that end of the
    record, and beside it changes with nearly every sample while the truck is still at rest.  Channels that stand still
    for most of the record are not judged.
    """
    dead: list[tuple[int, int]] = []
    at_rest: list[tuple[int, int]] = []
    for start, stop in _still_spans(time_s, value, censored):
        shares = [s for o in others if (s := _moving_share(o, time_s[start], time_s[stop - 1])) is not None]
        before = value[(time_s >= time_s[start] - DEAD_S) & (time_s < time_s[start])]
        begins = before.size < 4 or float(np.nanstd(before)) <= MOVING_SHARE * float(
            np.nanmax(value) - np.nanmin(value)
        )
        is_dead = float(np.median(shares)) > OTHERS_MOVE if shares else not begins
        is_dead |= _not_there(time_s, value, (start, stop), others)
        (dead if is_dead else at_rest).append((start, stop))
    return dead, at_rest


def _not_there(time_s: np.ndarray, value: np.ndarray, span: tuple[int, int], others: Sequence[Channel]) -> bool:
    """Whether a reading that stands still up to an end of its record is alive beside it, with the truck at rest."""
    start, stop = span
    if start > 0 and stop < value.size:
        return False
    at = time_s[stop - 1] if start == 0 else time_s[start]
    first, last = (at, at + BESIDE_S) if start == 0 else (at - BESIDE_S, at)
    change = np.diff(value[(time_s > first) & (time_s < last)])
    known = np.isfinite(change)
    shares = [s for o in others if (s := _moving_share(o, first, last)) is not None]
    at_rest = bool(shares) and float(np.median(shares)) <= OTHERS_MOVE
    return at_rest and known.sum() >= 10 and bool(np.mean(change[known] != 0.0) > 0.5)


def _moving_share(channel: Channel, first_s: float, last_s: float) -> float | None:
    """Scatter of a channel in a span of time over its range, None where it has no readings."""
    good = np.isfinite(channel.value)
    value, time = channel.value[good], channel.time_s[good]
    inside = value[(time >= first_s) & (time <= last_s)]
    return None if inside.size < 4 or np.ptp(value) == 0.0 else float(np.std(inside) / np.ptp(value))


def _still_spans(time_s: np.ndarray, value: np.ndarray, censored: np.ndarray) -> list[tuple[int, int]]:
    change = np.diff(value)
    moving = np.abs(change[np.isfinite(change)]) > 0.0
    if moving.size == 0 or moving.mean() < 0.5:
        return []
    step = float(np.median(np.diff(time_s)))
    shortest = max(20, round(DEAD_S / step))
    same = np.concatenate([change == 0.0, [False]])
    result = []
    for start, stop in runs_of(same):
        if stop + 1 - start >= shortest and not censored[start:stop].any():
            result.append((start, stop + 1))
    return result


def held_spans(
    value: np.ndarray, full_scale: float | None, at_rest: Sequence[tuple[int, int]] = ()
) -> list[tuple[int, int]]:
    """Index ranges in which a radio link or a logger repeats its last reading: shorter than dead ones, but several.

    Only channels that otherwise change with nearly every sample are judged, and readings at the full scale or in spans
    `at_rest` are not.
    """
    value = value.copy()
    for start, stop in at_rest:
        value[start:stop] = np.nan
    change = np.diff(value)
    finite = np.isfinite(change)
    if finite.sum() < 50 or np.mean(change[finite] == 0.0) > 0.35:
        return []
    same = np.concatenate([change == 0.0, [False]])
    found = [
        (start + 1, stop + 1)
        for start, stop in runs_of(same)
        if stop - start >= HELD_SAMPLES and not (full_scale and abs(value[start]) >= 0.99 * full_scale)
    ]
    moving = change[finite & (change != 0.0)]
    by_chance = np.mean(change[finite] == 0.0) ** HELD_SAMPLES * value.size
    # A clipped channel stands still at its extremes alone.
    levels = {float(value[start]) for start, _ in found}
    return found if len(levels) >= 3 and moving.size and by_chance < 0.01 else []


def level_shift(channel: Channel, rest_level: float | None, noise: float | None) -> float | None:
    """How far [SI] a channel stands from its rest level at the end of its record, None where that is nothing unusual.

    The truck must have come to rest: the last second scatters little.  A leaf spring that rubs leaves some millimetres.
    """
    good = np.isfinite(channel.value)
    if rest_level is None or noise is None or good.sum() < 100:
        return None
    time, value = channel.time_s[good], channel.value[good]
    last = value[time > time[-1] - 1.0]
    shift = float(np.median(last)) - rest_level
    limit = max(SHIFT_M if channel.sensor.si_unit == "m" else SHIFT_M_S2, 6.0 * noise)
    return shift if abs(shift) > limit and np.std(last) < 0.4 * abs(shift) else None


def lost_spans(time_s: np.ndarray, value: np.ndarray) -> list[tuple[int, int]]:
    """Index ranges without readings that last longer than a hiccup."""
    return [(a, b) for a, b in runs_of(~np.isfinite(value)) if time_s[b - 1] - time_s[a] >= LOST_S]


def spikes(value: np.ndarray) -> np.ndarray:
    """Indices of isolated readings that no band-limited motion can have.

    e_i = x_i - (-x_{i-2} + 4 x_{i-1} + 4 x_{i+1} - x_{i+2})/6 is the departure from the cubic through the neighbours; a
    spike departs by far more than the record and its surroundings do and stands out of the range of four neighbours.

    Parameters
    ----------
    value : (n,) readings, NaN where missing.
    """
    n = value.size
    if n < 30:
        return np.empty(0, int)
    far, near = (value[:-4], value[4:]), (value[1:-3], value[3:-1])
    middle = value[2:-2]
    departure = np.abs(middle - (4.0 * (near[0] + near[1]) - far[0] - far[1]) / 6.0)
    usable = np.isfinite(departure)
    if usable.sum() < 20:
        return np.empty(0, int)
    high = np.maximum.reduce([*far, *near])
    low = np.minimum.reduce([*far, *near])
    beyond = np.maximum(middle - high, low - middle)
    typical = float(np.median(departure[usable]))
    size = float(np.nanpercentile(value, 99.0) - np.nanpercentile(value, 1.0))
    with np.errstate(invalid="ignore"):
        candidate = usable & (departure > SPIKE_SIGMA * typical) & (beyond > 3.0 * (high - low) + 0.1 * size)
    found = [
        i
        for i in np.flatnonzero(candidate) + 2
        if _stands_alone(value, int(i), 0.1 * size) and _departs_alone(departure, int(i) - 2)
    ]
    return np.array(found, int)


def _departs_alone(departure: np.ndarray, i: int) -> bool:
    """Whether a departure is far above those around it that lack the same reading; one other spike is no harm."""
    around = np.concatenate([departure[max(0, i - 8) : max(0, i - 2)], departure[i + 3 : i + 9]])
    around = around[np.isfinite(around)]
    return around.size < 4 or bool(departure[i] > SPIKE_AROUND * np.median(around))


def _stands_alone(value: np.ndarray, i: int, margin: float) -> bool:
    """Whether a reading is beyond all around it, but perhaps for one other: axles that chatter reach far again soon."""
    around = np.delete(value[max(0, i - 8) : i + 9], min(i, 8))
    around = np.sort(around[np.isfinite(around)])
    return around.size < 4 or bool(value[i] > around[-2] + margin or value[i] < around[1] - margin)


def motion_starts(channels: Sequence[Channel]) -> list[float | None]:
    """Time [s] at which each channel leaves its first level: infinity if never, 0 if it moves at once.

    It is None for an empty channel, and for one that begins late and moves then.

    Each channel is compared with its own first 0.2 s; it has left that level by six times its scatter and a twentieth
    of its range.
    """
    return [_channel_start(channel) for channel in channels]


def _channel_start(channel: Channel) -> float | None:
    good = np.isfinite(channel.value)
    time, value = channel.time_s[good], channel.value[good]
    if value.size < 20:
        return None
    # A module may begin to record after the others.
    quiet = time <= time[0] + QUIET_S
    if quiet.sum() < 4:
        return None
    level, scatter = float(np.median(value[quiet])), float(np.std(value[quiet]))
    size = float(np.max(np.abs(value - level)))
    if size <= 0.0:
        return None
    # Motion is smooth from sample to sample, noise is not: its second differences are sqrt(6) times its rms.
    noise = float(np.std(np.diff(value[quiet], 2))) / np.sqrt(6.0)
    if scatter > MOVING_SHARE * size and scatter > 4.0 * noise:
        return 0.0 if time[0] < QUIET_S else None
    away = np.abs(value - level) > max(6.0 * scatter, 0.05 * size)
    both = away[:-1] & away[1:]
    return float(time[np.argmax(both)]) if both.any() else np.inf


def motion_start(starts: Sequence[float | None]) -> float | None:
    """Time [s] at which the truck meets the obstacle, or None where the record does not begin quietly.

    The second channel to leave its first level decides, so that one bad sensor does not.

    Parameters
    ----------
    starts : of all channels, from `motion_starts`.
    """
    finite = sorted(s for s in starts if s is not None and np.isfinite(s))
    if not finite:
        return None
    start = finite[1] if len(finite) > 2 else finite[0]
    return start if start >= QUIET_S else None


def quiet_readings(channel: Channel, start_s: float | None, channel_s: float | None = None) -> np.ndarray:
    """Readings (n,) of the quiet start, which ends 0.05 s before the motion begins; none where there are hardly any.

    The motion begins at `start_s` for the truck. It begins at `channel_s` for this channel, if that is earlier and
    leaves enough of the quiet start: where only axles have sensors, the first axle moves before the second one shows
    that the truck moves.
    """
    if start_s is None:
        return channel.value[:0]
    end = start_s if channel_s is None or channel_s < QUIET_S else min(start_s, channel_s)
    quiet = channel.value[(channel.time_s < end - 0.05) & np.isfinite(channel.value)]
    return np.asarray(quiet if quiet.size >= _FEWEST else quiet[:0])


def rest_of(quiet: np.ndarray) -> tuple[float | None, float | None]:
    """Mean and standard deviation of the readings of the quiet start, None where there are none."""
    return (float(np.mean(quiet)), float(np.std(quiet, ddof=1))) if quiet.size else (None, None)


def responds(channel: Channel, quiet: np.ndarray, peak: float) -> bool:
    """Whether averages over :data:`AVERAGED_S` depart from the level at rest by more than noise makes them.

    Over a long, low bump an axle accelerates by less than the noise of its sensor, but for longer.

    Parameters
    ----------
    channel
        All readings.
    quiet
        Those at rest.
    peak
        Largest departure that counts as noise, in standard deviations.
    """
    good = np.isfinite(channel.value)
    step = float(np.median(np.diff(channel.time_s[good])))
    count = max(1, round(AVERAGED_S / step))
    if quiet.size < 2 * count:
        return False

    def averages(readings: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(readings - quiet.mean())])
        return np.asarray((total[count:] - total[:-count]) / count)

    # Averages of white noise scatter least; slow noise shows in those at rest.
    scatter = max(float(np.std(quiet, ddof=1)) / np.sqrt(count), float(np.std(averages(quiet), ddof=1)))
    return bool(np.abs(averages(channel.value[good])).max() > peak * scatter)
