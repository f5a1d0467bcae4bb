"""Difference between the clocks of two loggers, from a signal that both record.

With the signal v_a(t) of the first logger and v_b(t) of the second, gain g and level o eliminated, the lag is where

    J(lag) = sum (v_a(t) - g v_b(t - lag) - o)^2

is smallest: first by cross-correlation at all lags, then between the samples of the faster log.
"""

from __future__ import annotations

import numpy as np

from sysid.campaign.clocks.motion import Lag
from sysid.campaign.gaps import longest_pause_s, pauses

#: Longest records together [samples of the common grid].
_MOST_STEPS = 4_000_000
#: Below this correlation the signals are not the same. Another lag that comes this close to the best one is equally
#: good.
LEAST_CORRELATION, RIVAL = 0.5, 0.95
#: Lags at which a smaller share of both signals' power is common are not used.
_LEAST_COMMON = 0.2
#: Readings with which a common signal can be told from chance (an assumption).
_FEWEST = 50

Signal = tuple[np.ndarray, np.ndarray]


def sync_lag(first: Signal, second: Signal, within_s: tuple[float, float]) -> Lag | None:
    """Lag of the second logger's stamps from the common signal.

    Parameters
    ----------
    first, second : stamps (n,) [s] of the logger's own clock and readings (n,) in any unit.
    within_s : smallest and largest lag that is tried [s].

    Returns
    -------
    Lag or None
        None if the signals are not the same, or if several lags are equally good, as with a long row of even pulses.
    """
    signals = [(time[np.isfinite(value)], value[np.isfinite(value)]) for time, value in (first, second)]
    if min(time.size for time, _ in signals) < _FEWEST or min(float(np.ptp(v)) for _, v in signals) <= 0.0:
        return None
    steps = [float(np.median(np.diff(time))) for time, _ in signals]
    step = min(steps)
    if sum(float(np.ptp(time)) for time, _ in signals) / step > _MOST_STEPS:
        return None
    coarse = _coarse(signals, step, within_s)
    return None if coarse is None else _fine(signals, coarse, steps)


def _coarse(signals: list[Signal], step: float, within_s: tuple[float, float]) -> float | None:
    even = [_even(t, v, step) for t, v in signals]
    n = sum(v.size for v in even)
    spectra = [np.fft.rfft(v, n) for v in even]
    height = np.fft.irfft(spectra[0] * np.conj(spectra[1]), n)
    index = np.arange(n)
    index = np.where(index < even[0].size, index, index - n)
    lags = index * step + signals[0][0][0] - signals[1][0][0]
    # Signs of the two may differ: cables get exchanged.
    possible = (lags >= within_s[0] - step) & (lags <= within_s[1] + step)
    common = [_power_between(v, i, i + w.size) for v, w, i in ((*even, index), (*even[::-1], -index))]
    whole = float(np.sum(even[0] ** 2) * np.sum(even[1] ** 2))
    possible &= common[0] * common[1] > _LEAST_COMMON**2 * whole
    height = np.where(possible, np.abs(height), 0.0)
    k = int(np.argmax(height))
    # Even pulses overlap less at another lag, and fit as well where they do.
    order = np.argsort(lags)
    heights = (height / np.sqrt(np.maximum(common[0] * common[1], 1e-12 * whole)))[order]
    at = int(np.flatnonzero(order == k)[0])
    if heights[at] < LEAST_CORRELATION:
        return None
    # Down from the highest point on both sides: a second rise there is another lag.
    falls = heights < (1.0 - (1.0 - RIVAL) / 2.0) * heights[at]
    left = int(np.max(np.flatnonzero(falls[:at]), initial=-1))
    right = at + int(np.argmax(falls[at:])) if falls[at:].any() else heights.size
    if max(_highest_peak(heights[: left + 1]), _highest_peak(heights[right:])) > RIVAL * heights[at]:
        return None
    return float(lags[k])


def _even(time: np.ndarray, value: np.ndarray, step: float) -> np.ndarray:
    """A signal about its mean at even times; zero in its gaps, which so add nothing to any product."""
    at = np.arange(time[0], time[-1], step)
    even = np.interp(at, time, value)
    seen = _seen(time, at, 0.0)
    return np.where(seen, even - even[seen].mean(), 0.0)


def _seen(time: np.ndarray, at: np.ndarray, reach_s: float) -> np.ndarray:
    """Which times (m,) are further than a reach from every gap of a signal."""
    seen = np.ones(at.size, bool)
    for begin, end in pauses(time, longest_pause_s(time, np.inf)):
        seen &= (at <= begin - reach_s) | (at >= end + reach_s)
    return seen


def _power_between(value: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Sum of squares of the samples from begin to end, as far as there are any."""
    total = np.concatenate([[0.0], np.cumsum(value**2)])
    first, last = (np.clip(i, 0, value.size) for i in (begin, end))
    return np.asarray(total[last] - total[first])


def _highest_peak(heights: np.ndarray) -> float:
    """The largest height that is above its neighbours, 0 where there is none."""
    inside = heights[1:-1]
    return float(np.max(inside[(inside > heights[:-2]) & (inside >= heights[2:])], initial=0.0))


def _fine(signals: list[Signal], lag: float, steps: list[float]) -> Lag | None:
    (time_a, a), (time_b, b) = signals
    reach = 1.5 * max(steps)
    inside = (time_a >= time_b[0] + lag + reach) & (time_a <= time_b[-1] + lag - reach)
    # In a gap of either the edges of the other have no partner.
    inside &= _seen(time_b, time_a - lag, reach)
    if inside.sum() < _FEWEST:
        return None
    time, value = time_a[inside], a[inside]

    def left(tried: float) -> tuple[float, float]:
        shown = np.interp(time - tried, time_b, b)
        design = np.stack([shown, np.ones(shown.size)], axis=1)
        solution = np.linalg.lstsq(design, value, rcond=None)[0]
        return float(np.sum((value - design @ solution) ** 2)), float(solution[0])

    tried = lag + reach * np.linspace(-1.0, 1.0, 61)
    best = float(tried[int(np.argmin([left(t)[0] for t in tried]))])
    closer = best + reach / 30.0 * np.linspace(-1.0, 1.0, 21)
    best = float(closer[int(np.argmin([left(t)[0] for t in closer]))])
    rest, gain = left(best)
    shown = np.interp(time[:, None] - best + np.array([-0.5, 0.5]) * steps[0], time_b, b)
    slope = gain * (shown[:, 1] - shown[:, 0]) / steps[0]
    power = slope**2
    formula = np.sqrt(rest / max(time.size - 3, 1) / max(float(power.sum()), 1e-300))
    # An edge lies anywhere between two samples, in each log by itself.
    near = np.diff(time) < 1.5 * steps[0]
    edges = max(float(np.sum(np.abs(np.diff(value)[near]))) / float(np.ptp(value)), 1.0)
    between = float(np.hypot(steps[0], steps[1])) / np.sqrt(12.0 * edges)
    middle = float(power @ time) / max(float(power.sum()), 1e-300)
    return Lag(best, float(max(formula, between)), middle - best)
