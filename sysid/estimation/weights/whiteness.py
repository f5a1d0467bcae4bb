"""Residuals of the readings, and how white the noise model makes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from sysid.arrays import SamplesByRunsByChannels
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.weights.autoregression import autocorrelation
from sysid.estimation.weights.heavy_tails import heavy_tails
from sysid.estimation.weights.residual_evidence import ResidualEvidence
from sysid.estimation.weights.reweighting import lags_of, plain_residual, residual_model

#: Samples per segment of Welch's spectrum: 64 bands, enough to see body modes and wheel hop apart.
_SEGMENT = 128


def residual_evidence(problem: Problem, residuals: Sequence[SamplesByRunsByChannels]) -> ResidualEvidence:
    """Spectra of residuals (T, R, C) of every group and their innovations per kind of sensor, correlation and tails."""
    model, weights = problem.model, problem.weights
    first = model.groups[0]
    lag = np.arange(min(lags_of(g.samples) for g in model.groups)) * first.interval_s
    kinds = tuple(dict.fromkeys(s.kind for s in model.layout.sensors))
    of_kind = np.array([kinds.index(s.kind) for s in model.layout.sensors])
    longest = max(g.interval_s for g in model.groups)
    frequency = np.linspace(0.0, 0.5 / longest, _SEGMENT // 2 + 1)
    sums, counts = np.zeros((2, len(kinds), frequency.size)), np.zeros(len(kinds))
    order: list[int] = []
    before: list[np.ndarray] = []
    after: list[np.ndarray] = []
    for group, residual in zip(model.groups, residuals, strict=True):
        noise_model = residual_model(group, residual)
        innovation = noise_model.innovations(group.measured, residual)
        depth = noise_model.coefficients.shape[0]
        kept = np.isfinite(innovation)
        innovation = np.where(kept, innovation, 0.0)
        used = group.measured.any(axis=0)
        order += list(noise_model.order[used])
        for rows, mask, series in ((before, group.measured, residual), (after, kept, innovation)):
            # On the lags of the first group, whatever the sample rate.
            correlation = autocorrelation(mask, series, lags_of(group.samples))[:, used].T
            rows += [np.interp(lag, np.arange(row.size) * group.interval_s, row) for row in correlation]
        for which, series in enumerate((residual, innovation[depth:])):
            spectrum = _flat_for_white(series, group.interval_s, frequency)
            for r, c in np.argwhere(used):
                sums[which, of_kind[c]] += spectrum[:, r, c]
        np.add.at(counts, of_kind[np.nonzero(used)[1]], 1)
    raw = [plain_residual(weights, i, residual) for i, residual in enumerate(residuals)]
    tails = [heavy_tails(g.measured, r, g.value).degrees_of_freedom for g, r in zip(model.groups, raw, strict=True)]
    return ResidualEvidence(
        kinds=kinds,
        frequency_hz=frequency,
        before=sums[0] / np.maximum(counts, 1)[:, None],
        after=sums[1] / np.maximum(counts, 1)[:, None],
        order=np.array(order, int),
        lag_s=lag,
        autocorrelation_before=np.array(before),
        autocorrelation_after=np.array(after),
        columns=tuple(s.column for s in model.layout.sensors),
        degrees_of_freedom=np.min(tails, axis=0),
    )


def _flat_for_white(series: np.ndarray, interval_s: float, frequency_hz: np.ndarray) -> np.ndarray:
    """Power (F, R, C) of series (T, R, C) at frequencies, over what white ones of their variance have."""
    length = min(_SEGMENT, series.shape[0])
    at, power = welch(series, fs=1.0 / interval_s, nperseg=length, axis=0, detrend=False)
    mean = np.maximum(power.mean(axis=0), 1e-300)
    spectra = np.empty((frequency_hz.size, *series.shape[1:]))
    for index in np.ndindex(*series.shape[1:]):
        spectra[(slice(None), *index)] = np.interp(frequency_hz, at, power[(slice(None), *index)]) / mean[index]
    return spectra
