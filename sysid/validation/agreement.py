"""Agreement of simulated with measured histories, channel by channel."""

from __future__ import annotations

import numpy as np

from sysid.estimation.results import FitResult, RunHistory
from sysid.validation.results import ChannelAgreement, Validation


def nrmse(measured: np.ndarray, simulated: np.ndarray) -> float:
    """Normalised error RMS(simulated - measured) / (max - min of measured) over finite samples; NaN without any.

    Parameters
    ----------
    measured, simulated : (n,) in one unit; NaN where missing.
    """
    both = np.isfinite(measured) & np.isfinite(simulated)
    if not both.any():
        return float("nan")
    span = float(np.ptp(measured[both]))
    if span == 0.0:
        return float("nan")
    return float(np.sqrt(np.mean((simulated[both] - measured[both]) ** 2))) / span


def validate(fit: FitResult) -> Validation:
    """Agreement of every channel of every fitted run."""
    return Validation(tuple(row for history in fit.histories for row in _run(history)))


def _run(history: RunHistory) -> list[ChannelAgreement]:
    rows = []
    for c, column in enumerate(history.columns):
        plain = np.where(history.censored[c] == 0, history.measured[c], np.nan)
        samples = int(np.isfinite(plain).sum())
        if samples == 0:
            continue
        residual = plain - history.simulated[c]
        scale = float(np.sqrt(np.nanmean(residual**2)))
        rows.append(
            ChannelAgreement(
                run=history.file,
                column=column,
                kind=history.kinds[c],
                axle=history.axles[c],
                nrmse=nrmse(plain, history.simulated[c]),
                residual_over_noise=scale / float(history.instrument_noise_sd[c]),
                samples=samples,
            )
        )
    return rows
