"""Residual scales: noise of instruments and of the road from the quiet start, and what remains at the optimum."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Runs, SamplesByRunsByChannels
from sysid.estimation.residuals.run_data import RunGroup

#: Smallest residual scale as a fraction of a channel's RMS, so that no channel can decide alone.
_FLOOR = 1e-3
#: Fewest differences of successive readings that tell the noise.
_PAIRS = 8


def instrument_noise(group: RunGroup, quiet_s: float) -> np.ndarray:
    """Noise (R, C) of every channel before the truck meets the bump, infinite where nothing tells it.

    The differences of successive readings give sigma = sqrt(mean(diff^2) / 2): a slow drift does not count as noise.
    Channels with fewer than 8 differences in the first `quiet_s` seconds (a late start, a gap) take those of the
    record's quietest stretch of this length that has 8; channels without any such stretch have infinite noise.
    """
    length = max(_PAIRS + 1, int(quiet_s / group.interval_s)) - 1
    pair = group.measured[1:] & group.measured[:-1]
    pairs, squares = (
        _sums(x, min(length, len(pair))) for x in (pair, np.where(pair, np.diff(group.value, axis=0), 0.0) ** 2)
    )
    mean = squares / np.maximum(pairs, 1)
    # The smallest of a few differences would be far too small, so the fullest stretches are used.
    full = pairs >= np.maximum(_PAIRS, 0.9 * pairs.max(axis=0))
    quietest = np.where(full, mean, np.inf).min(axis=0)
    sigma = np.sqrt(np.where(pairs[0] >= _PAIRS, mean[0], quietest) / 2.0)
    return np.asarray(np.maximum(sigma, _floor(group)))


def rolling_noise(group: RunGroup, quiet_s: float) -> np.ndarray:
    """Standard deviation (R, C) of every channel while the truck rolls towards the bump, 0 where nothing tells it.

    It includes what no model of the bump explains: noise of the instruments, roughness of the road, vibration of the
    engine. Channels with fewer than 8 readings in the first `quiet_s` seconds are not used.
    """
    first = slice(0, max(_PAIRS, int(quiet_s / group.interval_s)))
    measured, value = group.measured[first], group.value[first]
    count = measured.sum(axis=0)
    mean = np.where(measured, value, 0.0).sum(axis=0) / np.maximum(count, 1)
    square = np.where(measured, (value - mean) ** 2, 0.0).sum(axis=0) / np.maximum(count - 1, 1)
    return np.where(count >= _PAIRS, np.sqrt(square), 0.0)


def _sums(values: np.ndarray, length: int) -> np.ndarray:
    """Sums (T - length + 1, R, C) of `values` (T, R, C) over all stretches of a length."""
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    return np.asarray(np.maximum(total[length:] - total[: len(total) - length], 0.0))


def _floor(group: RunGroup) -> np.ndarray:
    count = np.maximum(group.measured.sum(axis=0), 1)
    mean = (group.measured * group.value).sum(axis=0) / count
    rms = np.sqrt((group.measured * (group.value - mean) ** 2).sum(axis=0) / count)
    return np.asarray(np.maximum(_FLOOR * rms, 1e-9))


def residual_scale(group: RunGroup, residual_si: SamplesByRunsByChannels) -> np.ndarray:
    """RMS (R, C) of the residuals (T, R, C) in SI over measured samples, infinite where there are none."""
    count = group.measured.sum(axis=0)
    rms = np.sqrt((np.where(group.measured, residual_si, 0.0) ** 2).sum(axis=0) / np.maximum(count, 1))
    return np.where(count > 0, np.maximum(rms, _floor(group)), np.inf)


def quiet_time(group: RunGroup, start_s: Runs, speed_m_s: Runs) -> float:
    """Shortest time [s] before any run of the group meets the bump, for noise estimates."""
    runs = list(group.runs)
    return float(max(0.2, np.min(start_s[runs] - 1.0 / speed_m_s[runs])))
