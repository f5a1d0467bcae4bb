"""Alternating extrema of a smoothed record, refined below the sample step, and the run of them that is a free decay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import Samples
from sysid.sdof.smoothing import local_polynomial, robust_sd
from sysid.sdof.time_grid import even_times

_WIDEST, _NARROWEST = 0.4, 0.2  # half window of the smoothing in body periods: passes 0.96 to 1.00 of the body mode
_HOP_HALF_WIDTH_S = 0.18  # passes at most a tenth of a wheel hop of 7 Hz and more
_HALF_PERIOD_TOLERANCE = 0.2  # of half a period, by which extrema may be off
_GROWTH_TOLERANCE = 1.05  # a free decay does not grow; a swing may be this much larger than the last, beside the noise
_SMALLEST_RELATIVE_AMPLITUDE = 0.01  # of the largest swing
_GAP_PERIODS = 1.0 / 6.0
_NOISE_FLOOR = 3.0  # standard deviations of an extremum that its amplitude must exceed
_NOISE_SAMPLES = 400  # enough for a scatter known to 4 %


@dataclass(frozen=True)
class Extrema:
    """Extrema of one decay, alternating in sign.

    - `time_s`, `value` (m,);
    - `index` (m,): half-cycle number counted from the first (gaps leave numbers out);
    - `value_sd`, `time_sd` (m,) from the noise of the readings;
    - `used` (m,) bool marks the run that is a free decay.
    """

    time_s: np.ndarray
    value: np.ndarray
    index: np.ndarray
    value_sd: np.ndarray
    time_sd: np.ndarray
    used: np.ndarray


def smoothing_half_width(period_s: float) -> float:
    """Half window [s] that keeps wheel hop out of a body mode of the given period, as narrow as that allows."""
    return float(np.clip(_HOP_HALF_WIDTH_S, _NARROWEST * period_s, _WIDEST * period_s))


def find_extrema(time_s: Samples, value: Samples, period_s: float, start_s: float, noise_sd: float) -> Extrema:
    """Find the extrema of the smoothed readings after the release and choose those of the free decay.

    An extremum is where the slope of the local cubic (`smoothing_half_width`) vanishes. The first extremum used is the
    first one that is followed by two half-periods within 20 % of the expected one and by falling swings. All following
    extrema are used down to the noise floor: an amplitude above 3 standard deviations of the smoothed noise and above 1
    % of that of the first one used. Extrema in a gap of the readings longer than a sixth of a period are left out.

    Parameters
    ----------
    time_s, value
        (n,) times [s] and finite readings after the release.
    period_s
        Expected period of the body mode [s].
    start_s
        No extremum before this time is used [s].
    noise_sd
        Smallest noise of the readings to assume, in their unit.
    """
    half_width = smoothing_half_width(period_s)
    step = period_s / 60.0
    grid = even_times(time_s, step, half_width)
    _, slope, _, _ = local_polynomial(time_s, value, grid, half_width)
    crossing = np.flatnonzero(np.isfinite(slope[:-1] * slope[1:]) & (slope[:-1] * slope[1:] < 0.0))
    times = _refine(time_s, value, half_width, grid[crossing], grid[crossing + 1], slope[crossing], slope[crossing + 1])
    height, _, gain, slope_gain = local_polynomial(time_s, value, times, half_width)
    readings_noise = max(noise_sd, _late_noise(time_s, value, half_width))
    sd = readings_noise * np.sqrt(gain)
    keep = _merge_ripple(height, sd)
    times, height, sd, slope_gain = times[keep], height[keep], sd[keep], slope_gain[keep]
    index, used = _choose(time_s, times, height, sd, period_s, start_s)
    amplitude = _amplitudes(height)
    with np.errstate(divide="ignore", invalid="ignore"):
        time_sd = readings_noise * np.sqrt(slope_gain) / ((2.0 * np.pi / period_s) ** 2 * amplitude)
    return Extrema(times, height, index, sd, time_sd, used)


def _refine(
    time_s: np.ndarray,
    value: np.ndarray,
    half_width: float,
    left: np.ndarray,
    right: np.ndarray,
    slope_left: np.ndarray,
    slope_right: np.ndarray,
) -> np.ndarray:
    """Zeros of the smoothed slope inside the brackets, by false position (Illinois variant), all at once."""
    left, right, f_left, f_right = left.copy(), right.copy(), slope_left.copy(), slope_right.copy()
    middle = 0.5 * (left + right)
    for _ in range(6):
        if left.size == 0:
            break
        span = f_right - f_left
        middle = np.where(span != 0.0, left - f_left * (right - left) / np.where(span == 0.0, 1.0, span), left)
        f_middle = local_polynomial(time_s, value, middle, half_width)[1]
        same = f_middle * f_right > 0.0
        f_left, f_right = (
            np.where(same, 0.5 * f_left, f_middle),
            np.where(same, f_middle, 0.5 * f_right),
        )
        left, right = np.where(same, left, middle), np.where(same, middle, right)
    return np.asarray(middle)


def _late_noise(time_s: np.ndarray, value: np.ndarray, half_width: float) -> float:
    """Scatter of the readings about the smoothed curve in the later half, where wheel hop has died out."""
    late = np.flatnonzero(time_s > 0.5 * (time_s[0] + time_s[-1]))
    late = late[:: max(1, late.size // _NOISE_SAMPLES)]
    if late.size < 8:
        return 0.0
    difference = value[late] - local_polynomial(time_s, value, time_s[late], half_width)[0]
    return robust_sd(difference[np.isfinite(difference)])


def _merge_ripple(height: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Indices of the extrema left after removing, smallest first, neighbouring pairs that the noise explains."""
    keep = list(range(height.size))
    while len(keep) > 2:
        swings = np.abs(np.diff(height[keep]))
        smallest = int(np.argmin(swings))
        if swings[smallest] > _NOISE_FLOOR * sd[keep[smallest]]:
            break
        # At the end only the outer one goes; inside, dropping both keeps the signs alternating.
        if smallest == 0:
            del keep[0]
        elif smallest == len(keep) - 2:
            del keep[-1]
        else:
            del keep[smallest : smallest + 2]
    return np.array(keep, int)


def _amplitudes(height: np.ndarray) -> np.ndarray:
    """Amplitude at each extremum: a quarter of the two swings around it, half the one swing at the ends."""
    if height.size < 2:
        return np.zeros(height.size)
    swings = np.abs(np.diff(height))
    around = np.concatenate([[swings[0]], 0.5 * (swings[:-1] + swings[1:]), [swings[-1]]])
    return 0.5 * around


def _choose(
    time_s: np.ndarray, times: np.ndarray, height: np.ndarray, sd: np.ndarray, period_s: float, start_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Half-cycle numbers of all extrema and the mask of those in the free decay."""
    used = np.zeros(times.size, bool)
    if times.size == 0:
        return np.zeros(0, int), used
    after = np.clip(np.searchsorted(time_s, times), 1, time_s.size - 1)
    in_gap = time_s[after] - time_s[after - 1] > _GAP_PERIODS * period_s
    gap_starts = time_s[:-1][np.diff(time_s) > _GAP_PERIODS * period_s]
    half = 0.5 * period_s
    for first in range(times.size - 2):
        if times[first] < start_s or in_gap[first]:
            continue
        run = _run_from(first, times, height, sd, in_gap, gap_starts, half)
        if run.size >= 3:
            used[run] = True
            half = float(np.median(np.diff(times[run])))
            break
    origin = times[np.argmax(used)] if used.any() else times[0]
    return np.rint((times - origin) / half).astype(int), used


def _run_from(
    first: int,
    times: np.ndarray,
    height: np.ndarray,
    sd: np.ndarray,
    in_gap: np.ndarray,
    gap_starts: np.ndarray,
    half: float,
) -> np.ndarray:
    """Extrema of the free decay that starts at `first`, as indices (possibly fewer than three)."""
    run = [first]
    largest, last_swing = 0.0, np.inf
    for i in range(first + 1, times.size):
        if in_gap[i]:
            continue
        halves = (times[i] - times[run[-1]]) / half
        count = int(np.rint(halves))
        across_gap = bool(np.any((gap_starts > times[run[-1]]) & (gap_starts < times[i])))
        if count < 1 or abs(halves - count) > _HALF_PERIOD_TOLERANCE or (count > 1 and not across_gap):
            break
        if count == 1:
            swing = abs(height[i] - height[run[-1]])
            largest = max(largest, swing)
            if swing > _GROWTH_TOLERANCE * last_swing + 2.0 * _NOISE_FLOOR * sd[i]:
                break
            # Half the last swing, not the mean of two, so that the floor holds for this extremum itself.
            if 0.5 * swing < max(_NOISE_FLOOR * sd[i], 0.5 * _SMALLEST_RELATIVE_AMPLITUDE * largest):
                break
            last_swing = swing
        run.append(i)
    return np.array(run)
