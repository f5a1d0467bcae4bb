"""Residual scales: instrument noise from the quiet start, and what remains at the optimum."""

from __future__ import annotations

import numpy as np

from sysid.estimation.bump_model import BumpModel
from sysid.estimation.run_data import RunGroup

#: Smallest residual scale as a fraction of a channel's RMS, so that no channel can decide alone.
_FLOOR = 1e-3


def instrument_noise(group: RunGroup, quiet_s: float) -> np.ndarray:
    """Noise (R, C) of every channel before the truck meets the bump, infinite where nothing was measured.

    The differences of successive readings give sigma = sqrt(mean(diff^2) / 2): a slow drift does not count as noise.
    """
    count = max(8, int(quiet_s / group.interval_s))
    mask = group.measured[:count]
    pair = mask[1:] & mask[:-1]
    change = np.where(pair, np.diff(group.value[:count], axis=0), 0.0)
    pairs = pair.sum(axis=0)
    sigma = np.sqrt((change**2).sum(axis=0) / np.maximum(pairs, 1) / 2.0)
    return np.where(group.measured.any(axis=0), np.maximum(sigma, _floor(group)), np.inf)


def _floor(group: RunGroup) -> np.ndarray:
    count = np.maximum(group.measured.sum(axis=0), 1)
    mean = (group.measured * group.value).sum(axis=0) / count
    rms = np.sqrt((group.measured * (group.value - mean) ** 2).sum(axis=0) / count)
    return np.maximum(_FLOOR * rms, 1e-9)


def residual_scale(group: RunGroup, residual_si: np.ndarray) -> np.ndarray:
    """RMS (R, C) of the residuals (T, R, C) in SI over measured samples, infinite where there are none."""
    count = group.measured.sum(axis=0)
    rms = np.sqrt((np.where(group.measured, residual_si, 0.0) ** 2).sum(axis=0) / np.maximum(count, 1))
    return np.where(count > 0, np.maximum(rms, _floor(group)), np.inf)


def quiet_time(model: BumpModel, group: RunGroup, start_s: np.ndarray, speed_m_s: np.ndarray) -> float:
    """Shortest time [s] before any run of the group meets the bump, for noise estimates."""
    runs = list(group.runs)
    return float(max(0.2, np.min(start_s[runs] - 1.0 / speed_m_s[runs])))
