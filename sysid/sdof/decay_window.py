"""The part of a record that damping laws are fitted to: the free motion while it is large."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.sdof.decay import PreparedRecord
from sysid.sdof.peaks import smoothing_half_width
from sysid.sdof.smoothing import local_polynomial

_START_PERIODS, _TAIL_PERIODS = 0.125, 0.25  # after the first and the last extremum used
_FEWEST_EXTREMA = 3  # two swings, whose ratio is a decrement
_FEWEST_READINGS = 40  # for the eight parameters of the fullest mixture
_GAP_STEPS = 1.8  # of the median step: a longer one is a gap


@dataclass(frozen=True)
class DecayWindow:
    """Readings of the free motion: times [s] from the start, readings, amplitude [m], angular frequency [rad/s].

    - `direction` of the motion at the first reading;
    - `start` (8,): parameters of `ring_down` without damping;
    - `loss`: the amplitude lost per swing at the middle amplitude `middle` [m];
    - `swings`: the half ranges of successive extrema [m], none across a gap of the readings.
    """

    begin_s: float
    time: np.ndarray
    value: np.ndarray
    amplitude: float
    direction: float
    start: np.ndarray
    swings: np.ndarray
    first_of_run: np.ndarray


def decay_window(record: PreparedRecord) -> DecayWindow | str:
    """The part of a record to fit, or why there is none."""
    if record.extrema is None or record.mode is None or record.release is None:
        return record.note
    used = np.flatnonzero(record.extrema.used)
    if used.size < _FEWEST_EXTREMA:
        return "too few swings to tell kinds of damping apart"
    times, heights, index = record.extrema.time_s[used], record.extrema.value[used], record.extrema.index[used]
    period = 2.0 * float(np.median(np.diff(times) / np.diff(index)))
    return _cut(record, period, times[0], times[-1], heights, index)


def window_from_release(record: PreparedRecord) -> DecayWindow | None:
    """The part of a record from the release to the end of the motion, None where there is too little of it."""
    if record.extrema is None or record.release is None or not np.isfinite(record.release.rest_level):
        return None
    begin, noise = record.release.time_s, record.release.noise_sd
    later = record.time_s > begin
    value = record.value[later]
    final = float(np.median(value[-max(5, value.size // 10) :]))
    moving = np.flatnonzero(np.abs(value - final) > 5.0 * max(noise, 1e-3 * float(np.ptp(value))))
    times, heights = _large_turns(record, begin, 5.0 * noise)
    if moving.size == 0 or times.size < 2:
        return None
    period = 2.0 * float(np.median(np.diff(times)))
    heights = np.concatenate([[record.release.rest_level], heights])
    end = min(max(float(record.time_s[later][moving[-1]]), times[-1]), times[-1] + 0.5 * period)
    cut = _cut(record, period, begin, end, heights, np.arange(heights.size))
    return None if isinstance(cut, str) else cut


def _large_turns(record: PreparedRecord, begin_s: float, floor: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and readings of the turning points from the release to a pause or a swing below 5 % of the largest."""
    assert record.extrema is not None
    after = record.extrema.time_s > begin_s + 0.2 * record.period_s
    times, heights = record.extrema.time_s[after], record.extrema.value[after]
    swings, gaps = np.abs(np.diff(heights)), np.diff(times)
    last = (swings < max(floor, 0.05 * float(swings.max(initial=0.0)))) | (gaps > 1.5 * gaps[:1].sum())
    count = int(np.argmax(last)) + 1 if last.any() else times.size
    return times[:count], heights[:count]


def _cut(
    record: PreparedRecord, period: float, first_s: float, last_s: float, heights: np.ndarray, index: np.ndarray
) -> DecayWindow | str:
    """Readings from shortly after the first to shortly after the last turning point, and start values.

    `heights` (m,) are those of the turning points, `index` (m,) their half-cycle numbers, which a gap leaves out.
    """
    successive = np.flatnonzero(np.diff(index) == 1)
    if successive.size == 0:
        return "no two successive turning points to tell kinds of damping apart"
    begin, end = first_s + _START_PERIODS * period, last_s + _TAIL_PERIODS * period
    inside = (record.time_s >= begin) & (record.time_s <= end)
    time, value = record.time_s[inside], record.value[inside]
    if time.size < _FEWEST_READINGS or time[0] > begin + 0.25 * period:
        return "too few readings to tell kinds of damping apart"
    place, rate, _, _ = local_polynomial(record.time_s, record.value, time[:1], 0.1 * period)
    if not np.isfinite(rate[0]):
        place, rate, _, _ = local_polynomial(record.time_s, record.value, time[:1], smoothing_half_width(period))
    swings = 0.5 * np.abs(np.diff(heights))[successive]
    omega = 2.0 * np.pi / period
    direction = float(np.sign(heights[1] - heights[0]))
    middles = 0.5 * (heights[:-1] + heights[1:])[successive]
    level = float(middles[:2].mean())
    speed = direction * max(direction * float(np.nan_to_num(rate[0])), 0.2 * omega * swings[0])
    start = np.array([omega, level, float(np.nan_to_num(place[0], nan=value[0])), speed, 0.0, 0.0, 0.0, 0.0])
    step = np.diff(time)
    first = np.concatenate([[True], step > _GAP_STEPS * float(np.median(step))])
    return DecayWindow(float(time[0]), time - time[0], value, float(swings[0]), direction, start, swings, first)
