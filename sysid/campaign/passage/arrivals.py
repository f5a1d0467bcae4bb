"""When each axle of a run meets the bump, and whether its sensor shows that it is lifted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from sysid import limits
from sysid.campaign.gaps import unseen
from sysid.campaign.passage.places import found_elsewhere
from sysid.campaign.records import Channel
from sysid.campaign.vehicle_records import Vehicle

#: Drift is integrated below, a bump of 2 m at walking speed above (an assumption).
HIGH_PASS_HZ = 0.4
#: Speeds that are tried: listed speed times exp(-1.6) to exp(1.6), so that m/s and mph are among them.
_REACH, _SPEEDS = 1.6, 121
#: Interval at which motions are added up: 8 cm of travel at 15 km/h, far less than a bump.
_COARSE_S = 0.02
#: Shares of the listed speed that are tried as well.
_NEAR_LISTED = (0.9, 1.0, 1.1)
#: Range in which the edge of the bump is searched for, around the time at which an axle is highest [m of travel], and
#: then around the line through all axles.
_BEFORE_M, _BEHIND_M, _NEAR_M = 1.3, 0.5, 0.45
#: Range around the expected time in which the motion of the bump itself is looked for [m of travel].
_JUST_BEFORE_M, _JUST_BEHIND_M = 0.15, 0.25
#: An axle that is lifted has reached this share of its largest speed.
_SHARE = 0.45
#: An axle that rises with less than this share of its speed at its first arrival stands still there (an assumption).
_STILL = 0.2
#: Speeds above this many times the listed one do not decide how far the axles move on the bump (an assumption).
_FAR = 1.6
#: For axles at equal distances both directions are the same: the one against the list counts less.
_BACKWARDS = 0.97
#: An arrival needs readings this long before and after it: an impulse that is missing in a gap shifts the velocity on
#: both sides of it, by half of it beside the gap, by 0.3 of it after the first time here, by 0.04 after the second [s].
_SEEN_S, _UNDISTURBED_S = 0.3, 1.5
#: Pauses are gaps if they are long for motion at this frequency, wheel hop [Hz].
_HOP_HZ = 15.0
#: Before it, the axle moves less than this share of its largest motion: those in front shake it a little.
_QUIET = 0.5


@dataclass(frozen=True)
class Arrival:
    """Time [s] at which an axle is lifted; `upward` 1 or -1 as its sensor shows it, `rise_m_s` its speed then.

    `certain` is false if the motion is no clearer that of a sensor upside down than that of an axle at another place.
    """

    time_s: float
    upward: int
    rise_m_s: float
    certain: bool = True


@dataclass(frozen=True)
class Passage:
    """The axles of one run at the bump: arrivals by axle; `speed_m_s` is negative where the last axle comes first.

    `sensors` counts the axles whose sensor has no gap where the axle is to be expected; some may show no arrival.
    `whole` says whether no gap is near any arrival: only then the arrivals tell places.
    """

    speed_m_s: float
    arrivals: Mapping[int, Arrival]
    sensors: int
    whole: bool = True

    @property
    def one_way(self) -> bool:
        """Whether the sensors of all axles show the same direction."""
        return len({arrival.upward for arrival in self.arrivals.values()}) == 1

    def misplaced_m(self, vehicle: Vehicle) -> dict[int, float]:
        """How far [m] behind its place each axle seems to be, at the speed of the run."""
        axles = sorted(self.arrivals)
        x = np.array([vehicle.axles[a].x_m for a in axles])
        time = np.array([self.arrivals[a].time_s for a in axles])
        along = self.speed_m_s * time - x
        return dict(zip(axles, (along - np.median(along)).tolist(), strict=True))

    def furthest_off_m(self, vehicle: Vehicle) -> float:
        """Distance [m] of the axle that seems to be furthest from its place."""
        return max(map(abs, self.misplaced_m(vehicle).values()))


def find_passage(channels: Sequence[Channel], vehicle: Vehicle, listed_m_s: float) -> Passage | None:
    """Find the speed and the arrivals of the axles, from their accelerations.

    Displacements d_i of the axles, integrated twice, are added up as d_i(t + x_i / v); the speed v of the run is the
    one at which they agree best. An axle has met the bump when its velocity reaches 0.45 of the velocity with which it
    is lifted. If some sensors then show an axle that falls, speeds near the listed one are tried as well, and the
    passage counts at which the axles are nearest to their places. An axle that arrives beside a gap of its readings is
    left out.

    Parameters
    ----------
    channels : of one run; axle accelerations count, of any sign.
    vehicle : for the places of the axles x_i [m].
    listed_m_s : speed around which is searched [m/s].

    Returns
    -------
    Passage or None
        None where fewer than two axles have sensors, or there is no bump to be seen, as in records below 0.04 s.
    """
    sensors = {c.sensor.axle: c for c in channels if c.sensor.kind == "axle_acceleration" and c.sensor.axle is not None}
    motions = {axle: found for axle, c in sensors.items() if (found := _integrals(c, 1, 2)) is not None}
    moved = {axle: (grid, rise) for axle, (grid, (_, rise)) in motions.items()}
    if len(moved) < 2 or max(float(grid[-1]) for grid, _ in moved.values()) < 2.0 * _COARSE_S:
        return None
    x = {axle: vehicle.axles[axle].x_m for axle in moved}
    if max(x.values()) - min(x.values()) < 0.5:
        return None
    missing = {axle: _unseen(sensors[axle], channels) for axle in moved}
    rising = {axle: (grid, velocity) for axle, (grid, (velocity, _)) in motions.items()}
    # What is integrated over a gap is wrong for a while: axles without any show the speed, if they are enough.
    whole = {axle: motion for axle, motion in moved.items() if not missing[axle]}
    shown = whole if len(whole) > 2 else moved
    passage = _passage(*_stacked(shown, x, listed_m_s), rising, missing, x, listed_m_s)
    if passage is None or passage.one_way:
        return passage
    # Some axles seem to fall: of a low bump that is long, the end of it may have been taken for its begin.
    near = (_stacked_at(share * listed_m_s, shown, x) for share in _NEAR_LISTED)
    others = [
        p for near_m_s, start in near if (p := _passage(near_m_s, start, rising, missing, x, listed_m_s)) and p.one_way
    ]
    return min([passage, *others], key=lambda p: p.furthest_off_m(vehicle))


def _unseen(channel: Channel, of_log: Sequence[Channel]) -> list[tuple[float, float]]:
    """Spans of time [s] in which a channel has no readings: gaps, and where it begins late or ends early."""
    begin, end = min(float(c.time_s[0]) for c in of_log), max(float(c.time_s[-1]) for c in of_log)
    inner = {begin, end}
    # Loggers that start one after the other within some cycles of hop miss nothing of the bump.
    return [s for s in unseen(channel, _HOP_HZ, (begin, end)) if not inner & set(s) or s[1] - s[0] > _SEEN_S]


def _is_seen(spans: Sequence[tuple[float, float]], at_s: float) -> bool:
    return not any(begin < at_s + _SEEN_S and end > at_s - _SEEN_S for begin, end in spans)


def _passage(
    speed: float,
    start: float,
    rising: Mapping[int, tuple[np.ndarray, np.ndarray]],
    missing: Mapping[int, Sequence[tuple[float, float]]],
    x: Mapping[int, float],
    listed_m_s: float,
) -> Passage | None:
    """Arrivals near those of a speed [m/s] and the time [s] at which a point at x = 0 is on the bump."""
    # A speed far above the listed one may also come from axle positions that are too large, because the bump does not
    # become longer by them.
    pace = abs(speed) if abs(speed) < _FAR * listed_m_s else listed_m_s
    first = {}
    for axle, motion in rising.items():
        at = start + x[axle] / speed
        arrival = _lifted(*motion, (at - _BEFORE_M / pace, at + _BEHIND_M / pace))
        if arrival is not None and _is_seen(missing[axle], arrival.time_s):
            first[axle] = arrival
    line = _line({a: (x[a], v.time_s) for a, v in first.items()})
    if line is None:
        return None
    speed, start = line
    arrivals, seen = {}, 0
    for axle, motion in rising.items():
        at = start + x[axle] / speed
        if not _is_seen(missing[axle], at):
            continue
        seen += 1
        arrival = _lifted(*motion, (at - _NEAR_M / pace, at + _NEAR_M / pace), at)
        # An axle that does not move there meets the bump elsewhere; its first arrival shows where.
        if arrival is None or (axle in first and arrival.rise_m_s < _STILL * first[axle].rise_m_s):
            arrival = first.get(axle)
        if arrival is not None and _is_seen(missing[axle], arrival.time_s):
            arrivals[axle] = arrival
    line = _line({a: (x[a], v.time_s) for a, v in arrivals.items()})
    if line is not None:
        # Places before signs: an axle that falls near its place may have been lifted elsewhere.
        met = {a: (v.time_s, v.upward) for a, v in arrivals.items()}
        elsewhere, doubtful = found_elsewhere(met, rising, x, line[0])
        arrivals = {a: replace(v, certain=a not in doubtful) for a, v in arrivals.items()}
        for axle, (at, upward) in elsewhere.items():
            if _is_seen(missing[axle], at):
                size = arrivals[axle].rise_m_s if axle in arrivals else float(np.max(np.abs(rising[axle][1])))
                arrivals[axle] = Arrival(at, upward, size)
        line = _line({a: (x[a], v.time_s) for a, v in arrivals.items()})
    if line is None or 2 * sum(_quiet_before(rising[a], v.time_s, pace) for a, v in arrivals.items()) < seen:
        return None
    begin, end = (f(v.time_s for v in arrivals.values()) for f in (min, max))
    log_begin_s = min(float(grid[0]) for grid, _ in rising.values())
    disturbed = any(
        first < end + _UNDISTURBED_S
        # Of a sensor that begins late, rest is missing: it disturbs its own arrival only.
        and last > (begin if first > log_begin_s or axle not in arrivals else arrivals[axle].time_s) - _UNDISTURBED_S
        for axle, spans in missing.items()
        for first, last in spans
    )
    return Passage(line[0], arrivals, seen, not disturbed)


def first_arrival(channel: Channel) -> Arrival | None:
    """The first relevant motion of an axle acceleration, if no other axle shows when to expect it."""
    found = integrated(channel, 1)
    arrival = None if found is None else _lifted(*found, (float(found[0][0]), float(found[0][-1])))
    return arrival if arrival is not None and _is_seen(_unseen(channel, [channel]), arrival.time_s) else None


def _quiet_before(motion: tuple[np.ndarray, np.ndarray], arrival_s: float, speed: float) -> bool:
    """Whether an axle moved little until a metre in front of the bump; false for a record of noise only."""
    grid, velocity = motion
    before = np.abs(velocity[grid < arrival_s - 1.0 / speed])
    return before.size >= 5 and float(before.max()) < _QUIET * float(np.max(np.abs(velocity)))


def integrated(channel: Channel, times: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Times [s] on an even grid and the acceleration integrated once or twice, without what is slower than 0.4 Hz."""
    found = _integrals(channel, times)
    return None if found is None else (found[0], found[1][0])


def _integrals(channel: Channel, *times: int) -> tuple[np.ndarray, list[np.ndarray]] | None:
    """Times [s] on an even grid, and the acceleration integrated as often as each number says."""
    good = np.isfinite(channel.value)
    if good.sum() < 20:
        return None
    time = channel.time_s[good]
    step = float(np.median(np.diff(time)))
    count = int((time[-1] - time[0]) / step) + 1
    if not 20 <= count <= limits.GRID_STEPS:
        return None
    grid = time[0] + step * np.arange(count)
    value = np.interp(grid, time, channel.value[good])
    padded = 2 * count
    frequency = np.fft.rfftfreq(padded, step)
    spectrum = np.fft.rfft(value - np.median(value), padded)
    spectrum[0] = 0.0
    spectrum[1:] *= frequency[1:] ** 4 / (frequency[1:] ** 4 + HIGH_PASS_HZ**4)
    omega = 2j * np.pi * np.maximum(frequency, frequency[1])
    return grid, [np.fft.irfft(spectrum / omega**order, padded)[:count] for order in times]


def _stacked(
    moved: Mapping[int, tuple[np.ndarray, np.ndarray]], x: Mapping[int, float], listed: float
) -> tuple[float, float]:
    """Speed [m/s], negative from the rear, and the time at which a point at x = 0 is on the bump."""
    time, size = _sizes(moved)
    best = (-1.0, listed, 0.0)
    coarse = listed * np.exp(np.linspace(-_REACH, _REACH, _SPEEDS))
    best = max(best, *_added_up(np.concatenate([coarse, -coarse]), time, size, x))
    for fine in np.linspace(-0.02, 0.02, 9):
        best = max(best, *_added_up(best[1] * np.array([1.0 + fine]), time, size, x))
    return best[1], best[2]


def _stacked_at(
    speed: float, moved: Mapping[int, tuple[np.ndarray, np.ndarray]], x: Mapping[int, float]
) -> tuple[float, float]:
    """A speed [m/s], and the time at which a point at x = 0 is on the bump if that is the speed."""
    ((_, _, start),) = _added_up(np.array([speed]), *_sizes(moved), x)
    return speed, start


def _sizes(moved: Mapping[int, tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Times [s], and the size of the motion of every axle at these, over its largest."""
    last = max(grid[-1] for grid, _ in moved.values())
    time = np.arange(0.0, last, max(_COARSE_S, last / 20_000))
    return time, {
        a: np.abs(np.interp(time, grid, d)) / max(float(np.max(np.abs(d))), 1e-12) for a, (grid, d) in moved.items()
    }


def _added_up(
    speeds: np.ndarray, time: np.ndarray, size: Mapping[int, np.ndarray], x: Mapping[int, float]
) -> list[tuple[float, float, float]]:
    """How well the motions agree at every speed, the speed, and the time of a point at x = 0."""
    first = np.min([place / speeds for place in x.values()], axis=0)
    step = float(time[1] - time[0])
    total = np.zeros((speeds.size, time.size))
    for axle, moved in size.items():
        # Whole samples are near enough for the search.
        late = np.minimum(np.rint((x[axle] / speeds - first) / step).astype(int), time.size)
        total += sliding_window_view(np.concatenate([moved, np.zeros(time.size)]), time.size)[late]
    k = np.argmax(total, axis=1)
    agreement = total[np.arange(speeds.size), k] * np.where(speeds > 0.0, 1.0, _BACKWARDS)
    return list(zip(agreement.tolist(), speeds.tolist(), (time[k] - first).tolist(), strict=True))


def _lifted(
    grid: np.ndarray, velocity: np.ndarray, window: tuple[float, float], expected: float | None = None
) -> Arrival | None:
    """The edge of the first relevant motion in a window; with an expected time, of the motion just after it."""
    inside = np.flatnonzero((grid >= window[0]) & (grid <= window[1]))
    if inside.size < 5:
        return None
    part = velocity[inside]
    largest = float(np.max(np.abs(part)))
    if largest <= 0.0:
        return None
    if expected is None:
        begin = int(np.argmax(np.abs(part) > _SHARE * largest))
    else:
        # The axles in front have set it in motion already; the bump itself is what moves it fastest about that time.
        reach = np.array([-_JUST_BEFORE_M, _JUST_BEHIND_M]) * 0.5 * (window[1] - window[0]) / _NEAR_M
        near = np.flatnonzero((grid[inside] >= expected + reach[0]) & (grid[inside] <= expected + reach[1]))
        if near.size == 0:
            return None
        begin = int(near[np.argmax(np.abs(part[near]))])
    sign = 1 if part[begin] > 0.0 else -1
    end = begin
    while end + 1 < part.size and sign * part[end + 1] > 0.0:
        end += 1
    top = float(np.max(sign * part[begin : end + 1]))
    peak = begin + int(np.argmax(sign * part[begin : end + 1]))
    below = np.flatnonzero(sign * part[: peak + 1] < _SHARE * top)
    if below.size == 0:
        return None
    k = int(below[-1])
    step = float(grid[1] - grid[0])
    rise = sign * float(part[k + 1] - part[k]) if k + 1 < part.size else 0.0
    share = (_SHARE * top - sign * float(part[k])) / rise if rise > 0.0 else 0.0
    return Arrival(float(grid[inside[k]]) + share * step, sign, top)


def _line(points: Mapping[int, tuple[float, float]]) -> tuple[float, float] | None:
    """Speed [m/s] and time of a point at x = 0: medians over all pairs, so that one axle in error does not count."""
    values = sorted(points.values())
    pairs = [(a, b) for i, a in enumerate(values) for b in values[i + 1 :] if b[0] - a[0] > 0.1]
    if not pairs:
        return None
    # Pairs far apart give more information: the weight of each is its length.
    slopes = np.array([(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairs])
    length = np.array([b[0] - a[0] for a, b in pairs])
    order = np.argsort(slopes)
    middle = int(np.searchsorted(np.cumsum(length[order]), 0.5 * length.sum()))
    slope = float(slopes[order][middle])
    if slope == 0.0 or not np.isfinite(slope):
        return None
    return 1.0 / slope, float(np.median([t - slope * x for x, t in values]))
