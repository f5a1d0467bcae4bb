"""Objective rating of ISO/TS 18571: corridor, phase, magnitude and slope of two time histories on common samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import correlate

from sysid.arrays import PairsBySamples

# Parameters of the standard (ISO/TS 18571:2014).
_INNER, _OUTER, _CORRIDOR_POWER = 0.05, 0.5, 2
_LARGEST_SHIFT = 0.2
_WARPING_WINDOW, _LARGEST_MAGNITUDE_ERROR = 0.1, 0.5
_SLOPE_AVERAGE, _LARGEST_SLOPE_ERROR = 9, 2.0
_WEIGHTS = (0.4, 0.2, 0.2, 0.2)
#: Fewer samples than two averages of the slope are not rated.
_FEWEST = 2 * _SLOPE_AVERAGE


@dataclass(frozen=True)
class ObjectiveRating:
    """Scores between 0 and 1; `overall` is 0.4 corridor + 0.2 phase + 0.2 magnitude + 0.2 slope."""

    corridor: float
    phase: float
    magnitude: float
    slope: float

    @property
    def overall(self) -> float:
        """The rating R: above 0.94 excellent, above 0.80 good, above 0.58 fair, else poor."""
        return float(np.dot(_WEIGHTS, (self.corridor, self.phase, self.magnitude, self.slope)))


def objective_ratings(measured: PairsBySamples, simulated: PairsBySamples) -> tuple[ObjectiveRating | None, ...]:
    """Ratings of many pairs of histories of one record.

    The standard asks for 10 kHz, meant for crash signals of 0.2 s; here the samples are taken as they are.  Phase is
    the shift of up to 20 % of the record with the largest correlation, at equal ones the smallest shift, the simulated
    history earlier before later.  Magnitude and slope compare the shifted histories, magnitude after dynamic time
    warping within 10 % of the record.  A pair is None where a value is not finite, the measured history is constant or
    there are fewer than 18 samples.

    Parameters
    ----------
    measured, simulated : (pairs, n) on common, uniform samples; each pair in one unit.

    References
    ----------
    ISO/TS 18571, Road vehicles - Objective rating metric for non-ambiguous signals.
    """
    rated = [
        i
        for i, (m, s) in enumerate(zip(measured, simulated, strict=True))
        if m.size >= _FEWEST and np.all(np.isfinite(m)) and np.all(np.isfinite(s)) and np.ptp(m) > 0.0
    ]
    shifted = {i: _aligned(measured[i], simulated[i]) for i in rated}
    errors = dict(zip(rated, _warped_errors([shifted[i][:2] for i in rated]), strict=True))
    ratings: list[ObjectiveRating | None] = [None] * len(measured)
    for i in rated:
        reference, comparison, shift = shifted[i]
        ratings[i] = ObjectiveRating(
            _corridor(measured[i], simulated[i]),
            max(0.0, 1.0 - shift / (measured[i].size * _LARGEST_SHIFT)),
            max(0.0, 1.0 - errors[i] / _LARGEST_MAGNITUDE_ERROR),
            _slope(reference, comparison),
        )
    return tuple(ratings)


def _corridor(measured: np.ndarray, simulated: np.ndarray) -> float:
    relative = np.abs(simulated - measured) / np.max(np.abs(measured))
    return float(np.mean(np.clip((_OUTER - relative) / (_OUTER - _INNER), 0.0, 1.0) ** _CORRIDOR_POWER))


def _aligned(measured: np.ndarray, simulated: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """The overlap of both histories after the best shift, and the size of the shift in samples."""
    most = int(np.floor(measured.size * _LARGEST_SHIFT))
    earlier = _correlations(measured, simulated, most)
    later = _correlations(simulated, measured, most)
    # In the order of the standard, so that the first maximum wins: no shift, 1 earlier, 1 later, 2 earlier, ...
    best = int(np.argmax(np.concatenate([earlier[:1], np.column_stack([earlier[1:], later[1:]]).ravel()])))
    shift = (best + 1) // 2
    if shift == 0:
        return measured, simulated, 0
    if best % 2:
        return measured[:-shift], simulated[shift:], shift
    return measured[shift:], simulated[:-shift], shift


def _correlations(front: np.ndarray, back: np.ndarray, most: int) -> np.ndarray:
    """Correlation coefficient of front[: n - m] and back[m:] for m from 0 to `most`."""
    n = front.size
    x, y = front - front.mean(), back - back.mean()
    count = n - np.arange(most + 1)
    sum_x, sum_xx = (np.cumsum(v)[count - 1] for v in (x, x * x))
    sum_y, sum_yy = (np.cumsum(v[::-1])[count - 1] for v in (y, y * y))
    product = correlate(y, x, mode="full", method="fft")[n - 1 : n + most]
    variance = (sum_xx - sum_x**2 / count) * (sum_yy - sum_y**2 / count)
    usable = variance > 0.0
    return np.where(usable, (product - sum_x * sum_y / count) / np.sqrt(np.where(usable, variance, 1.0)), -1.0)


def _slope(measured: np.ndarray, simulated: np.ndarray) -> float:
    reference, comparison = _averaged_slope(measured), _averaged_slope(simulated)
    size = float(np.sum(np.abs(reference)))
    if size == 0.0:
        return float(not np.any(comparison))
    return max(0.0, 1.0 - float(np.sum(np.abs(comparison - reference))) / size / _LARGEST_SLOPE_ERROR)


def _averaged_slope(values: np.ndarray) -> np.ndarray:
    """Central differences averaged over nine samples, over 1, 3, 5 and 7 at the ends; per sample interval."""
    slope = np.gradient(values)
    averaged = uniform_filter1d(slope, _SLOPE_AVERAGE, mode="nearest")
    for i in range(_SLOPE_AVERAGE // 2):
        averaged[i], averaged[-1 - i] = np.mean(slope[: 2 * i + 1]), np.mean(slope[-1 - 2 * i :])
    return np.asarray(averaged)


def _warped_errors(pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Sum |s - m| over sum |m| along the cheapest warping path of every pair (measured, simulated).

    The path minimises the sum of (s - m)^2 from first to last samples within the window. Cells (i simulated, j
    measured) are visited by diagonals i + j = d, all pairs at once; column k of a diagonal is the cell with
    i - j = 2 k - width + (d odd). At equal costs the order of preference is: only the simulated history advances, only
    the measured one, both.
    """
    if not pairs:
        return np.zeros(0)
    length = np.array([m.size for m, _ in pairs])
    radius = np.ceil(_WARPING_WINDOW * length)[:, None]
    most = int(length.max())
    width = 2 * int(np.ceil(radius.max() / 2.0))
    s, m = _laid_out(pairs, most, width)
    offset = 2 * np.arange(width + 1) - width
    outside = [np.where(np.abs(offset + odd) < radius, 0.0, np.inf) for odd in (0, 1)]
    # Three diagonals in turn; one more column on either side for neighbours outside the window.
    cost = np.full((3, len(pairs), width + 3), np.inf)
    # How the best path comes to each cell: whether only the measured history advances, and whether both do.
    came = np.zeros((2, 2 * most - 1, len(pairs), width + 1), bool)
    cost[0][:, 1 + width // 2] = (s[:, width] - m[:, width + most - 1]) ** 2
    for d in range(1, 2 * most - 1):
        odd = d % 2
        first_i, first_j = (d + odd - width) // 2, (d - odd + width) // 2
        step = (
            s[:, first_i + width : first_i + 2 * width + 1]
            - m[:, most - 1 - first_j + width : most - first_j + 2 * width]
        )
        last, before = cost[(d - 1) % 3], cost[(d - 2) % 3]
        alone, waiting, both = last[:, odd : odd + width + 1], last[:, odd + 1 : odd + width + 2], before[:, 1:-1]
        least = np.minimum(alone, waiting)
        np.less(waiting, alone, out=came[0, d])
        np.less(both, least, out=came[1, d])
        step *= step
        step += outside[odd]
        step += np.minimum(least, both, out=least)
        cost[d % 3][:, 1:-1] = step
    return _path_errors(pairs, came, width)


def _path_errors(pairs: list[tuple[np.ndarray, np.ndarray]], came: np.ndarray, width: int) -> np.ndarray:
    """Sum |s - m| over sum |m| along paths that are followed back from the last samples to the first."""
    row = np.arange(len(pairs))
    measured, simulated = (np.zeros((len(pairs), max(m.size for m, _ in pairs))) for _ in range(2))
    for k, (m, s) in enumerate(pairs):
        measured[k, : m.size], simulated[k, : s.size] = m, s
    i = np.array([m.size - 1 for m, _ in pairs])
    j = i.copy()
    path = []
    while True:
        begun = i + j == 0
        path.append((i, j, begun))
        if begun.all():
            break
        waited, both = came[:, i + j, row, (i - j + width) // 2]
        i, j = i - ((both | ~waited) & ~begun), j - ((both | waited) & ~begun)
    i, j, begun = (np.array(of) for of in zip(*path, strict=True))
    # Shorter paths wait at the first samples, which count once.
    weight = np.ones(begun.shape)
    weight[1:] = ~(begun[1:] & begun[:-1])
    # Exact sums: a pair is rated the same alone and among others.
    error, scale = (
        np.array([math.fsum(of_pair) for of_pair in (weight * np.abs(values)).T])
        for values in (simulated[row, i] - measured[row, j], measured[row, j])
    )
    silent = np.where(error > 0.0, np.inf, 0.0)
    return np.where(scale > 0.0, error / np.where(scale > 0.0, scale, 1.0), silent)


def _laid_out(pairs: list[tuple[np.ndarray, np.ndarray]], most: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Simulated histories forward, measured ones backward, between infinities that no path crosses."""
    s = np.full((len(pairs), most + 2 * width), np.inf)
    m = np.full_like(s, -np.inf)
    for row, (measured, simulated) in enumerate(pairs):
        s[row, width : width + simulated.size] = simulated
        m[row, width + most - measured.size : width + most] = measured[::-1]
    return s, m
