"""Removal of isolated spikes, and local polynomial smoothing that keeps wheel hop out of the body mode."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Samples

_CHUNK_ELEMENTS = 2_000_000  # bounds the memory of one batch of windows to some 100 MB
_DEGREE = 3
_MEDIAN_REACH_S = 0.02  # a running median this short leaves wheel hop nearly alone
_MEDIAN_SHARE, _CUBIC_SHARE = 0.15, 0.03


def robust_sd(value: Samples) -> float:
    """Standard deviation estimated from the median absolute deviation (0 for an empty array)."""
    if value.size == 0:
        return 0.0
    return float(1.4826 * np.median(np.abs(value - np.median(value))))


def high_frequency_noise(value: Samples) -> float:
    """Noise standard deviation from fourth differences, which a smooth motion hardly enters (0 below 6 samples)."""
    if value.size < 6:
        return 0.0
    return float(robust_sd(np.convolve(value, [1.0, -4.0, 6.0, -4.0, 1.0], "valid")) / np.sqrt(70.0))


def spike_mask(time_s: Samples, value: Samples) -> Samples:
    """Mark isolated readings, up to three in a row, that do not fit their neighbours.

    A reading is a spike if it differs from the running median (over 40 ms, three to seven readings) by more than 15 %
    of the range and the usual noise. It is also a spike if it differs from the cubic through its four neighbours by
    more than 3 % of the range and ten times the usual misfit. Readings beside a gap are not judged.

    Parameters
    ----------
    time_s, value
        (n,) increasing times [s] and finite readings.

    Returns
    -------
    numpy.ndarray
        (n,) bool, True = spike.
    """
    mask = np.zeros(value.size, bool)
    if value.size < 9:
        return mask
    step = float(np.median(np.diff(time_s)))
    reach = int(np.clip(round(_MEDIAN_REACH_S / step), 1, 3))
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(value, reach, mode="edge"), 2 * reach + 1)
    median = np.median(windows, axis=1)
    span = float(np.ptp(median))
    noise = robust_sd(value - median)
    away = np.abs(value - median) > max(_MEDIAN_SHARE * span, 8.0 * noise)
    gaps = np.flatnonzero(np.diff(time_s) > 1.8 * step)
    beside_gap = np.zeros(value.size, bool)
    for shift in range(-2, 4):
        beside_gap[np.clip(gaps + shift, 0, value.size - 1)] = True
    mask |= away & ~beside_gap
    cleaned = np.where(mask, median, value)
    cubic = (-cleaned[:-4] + 4 * cleaned[1:-3] + 4 * cleaned[3:-1] - cleaned[4:]) / 6.0
    misfit = np.abs(cleaned[2:-2] - cubic)
    limit = max(10.0 * robust_sd(cleaned[2:-2] - cubic), _CUBIC_SHARE * span)
    # A spike also spoils the cubic of its neighbours, so only local maxima of the misfit count.
    neighbourhood = np.lib.stride_tricks.sliding_window_view(np.pad(misfit, 2), 5).max(axis=1)
    mask[2:-2] |= (misfit > limit) & (misfit >= neighbourhood) & ~beside_gap[2:-2]
    return mask


def _tricube(u: np.ndarray) -> np.ndarray:
    rest = np.clip(1.0 - np.abs(u * u * u), 0.0, None)
    return np.asarray(rest * rest * rest)


def local_polynomial(
    time_s: Samples, value: Samples, at_s: Samples, half_width_s: float
) -> tuple[Samples, Samples, Samples, Samples]:
    """Smooth with a cubic fitted locally under tricube weights.

    Away from the ends this is a symmetric linear filter, so an exponentially decaying oscillation keeps its period and
    its decrement and loses only a constant factor; irregular stamps and gaps need no resampling.

    Parameters
    ----------
    time_s, value
        (n,) increasing times [s] and finite readings.
    at_s
        (m,) times at which to evaluate, increasing or not.
    half_width_s
        Half width of the window [s].

    Returns
    -------
    tuple
        Smoothed value (m,), its slope per second (m,), and the noise gains of both (m,) (their variance over the
        variance of white noise in the readings, the slope's per s^2); NaN where the window holds too few readings.
    """
    at_s = np.atleast_1d(np.asarray(at_s, float))
    smooth, slope, gain, slope_gain = (np.full(at_s.size, np.nan) for _ in range(4))
    first = np.searchsorted(time_s, at_s - half_width_s, "left")
    last = np.searchsorted(time_s, at_s + half_width_s, "right")
    good = np.flatnonzero(last - first >= _DEGREE + 3)
    if good.size == 0:
        return smooth, slope, gain, slope_gain
    width = int((last - first)[good].max())
    for rows in np.array_split(good, max(1, -(-good.size * width // _CHUNK_ELEMENTS))):
        index = first[rows, None] + np.arange(width)
        inside = index < last[rows, None]
        index = np.minimum(index, time_s.size - 1)
        u = np.where(inside, (time_s[index] - at_s[rows, None]) / half_width_s, 0.0)
        weight = np.where(inside, _tricube(u), 0.0)
        powers = np.empty((2 * _DEGREE + 1, *u.shape))
        powers[0] = 1.0
        for power in range(1, 2 * _DEGREE + 1):
            np.multiply(powers[power - 1], u, out=powers[power])
        moments = np.einsum("prw,rw->pr", powers, weight)
        normal = np.stack([moments[p : p + _DEGREE + 1] for p in range(_DEGREE + 1)]).transpose(2, 0, 1)
        diagonal = np.prod(np.diagonal(normal, axis1=1, axis2=2), axis=1)
        # Readings bunched in one place (a long gap) make the normal matrix singular: no value there.
        solvable = np.linalg.det(normal) > 1e-7 * diagonal
        normal[~solvable] = np.eye(_DEGREE + 1)
        unit = np.zeros((rows.size, _DEGREE + 1, 2))
        unit[:, 0, 0] = unit[:, 1, 1] = 1.0
        coefficients = np.linalg.solve(normal, unit)
        kernel = np.einsum("prw,rpk->krw", powers[: _DEGREE + 1], coefficients) * weight
        readings = value[index]
        # The constant is taken out first because rounding errors grow with the offset otherwise.
        centre = readings[np.arange(rows.size), (last - first)[rows] // 2]
        readings = np.where(inside, readings - centre[:, None], 0.0)
        smooth[rows] = np.where(solvable, centre + np.sum(kernel[0] * readings, axis=1), np.nan)
        slope[rows] = np.where(solvable, np.sum(kernel[1] * readings, axis=1) / half_width_s, np.nan)
        gain[rows] = np.where(solvable, np.sum(kernel[0] ** 2, axis=1), np.nan)
        slope_gain[rows] = np.where(solvable, np.sum(kernel[1] ** 2, axis=1) / half_width_s**2, np.nan)
    return smooth, slope, gain, slope_gain
