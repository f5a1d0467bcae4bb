"""Weights of the residuals from the residuals: scale, correlation in time and tails of every run and channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from sysid.estimation.autoregression import Autoregression, autocorrelation, fitted_autoregression, variance_inflation
from sysid.estimation.heavy_tails import heavy_tails
from sysid.estimation.noise import residual_scale
from sysid.estimation.objective import Linearisation, Weights
from sysid.estimation.problem import Problem
from sysid.estimation.results import ResidualEvidence

_LAGS = 120
_SEGMENT = 128


def reweighted(problem: Problem, linearisations: Sequence[Linearisation]) -> Weights:
    """Weights of the next round: residual scales, tempering by variance inflation, and readings that stand out."""
    scales, tails, plain = [], [], []
    for position, (group, lin) in enumerate(zip(problem.model.groups, linearisations, strict=True)):
        raw = _plain_residual(problem.weights, position, lin)
        tails.append(heavy_tails(group.measured, raw, group.value))
        plain.append(raw * np.sqrt(tails[-1].weight))
        scales.append(residual_scale(group, plain[-1]))
    inflation = _inflation(problem, linearisations, residual_models(problem, plain))
    tempering = [np.sqrt(t.information / v) for t, v in zip(tails, inflation, strict=True)]
    alike = all(np.all(t.weight == 1.0) for t in tails)
    return Weights(tuple(scales), tuple(tempering), None if alike else tuple(t.weight for t in tails))


def residual_models(problem: Problem, residuals: Sequence[np.ndarray]) -> list[Autoregression]:
    """Autoregressive models of the residuals (T, R, C) of every group, whatever their scale."""
    return [
        fitted_autoregression(group.measured, residual, _lags(group.samples))
        for group, residual in zip(problem.model.groups, residuals, strict=True)
    ]


def residual_inflation(problem: Problem, linearisations: Sequence[Linearisation]) -> list[np.ndarray]:
    """Variance inflation (R, C) of every group at a linearisation."""
    return _inflation(
        problem, linearisations, residual_models(problem, [np.asarray(x.residual) for x in linearisations])
    )


def _inflation(
    problem: Problem, linearisations: Sequence[Linearisation], models: Sequence[Autoregression]
) -> list[np.ndarray]:
    columns = (np.asarray(lin.residual_jacobian)[..., : problem.count] for lin in linearisations)
    return [variance_inflation(m, c) for m, c in zip(models, columns, strict=True)]


def _plain_residual(weights: Weights, position: int, lin: Linearisation) -> np.ndarray:
    """Residuals (T, R, C) in SI without any weights; 0 where nothing was measured."""
    noise = weights.noise_sd[position]
    scale = np.where(np.isfinite(noise), noise, 0.0) / weights.tempering[position]
    raw = np.asarray(lin.residual) * scale
    return raw if weights.reading is None else raw / np.sqrt(weights.reading[position])


def residual_evidence(problem: Problem, linearisations: Sequence[Linearisation]) -> ResidualEvidence:
    """Spectra of residuals and innovations per kind of sensor, their correlation, orders and tails."""
    model, weights = problem.model, problem.weights
    first = model.groups[0]
    lag = np.arange(min(_lags(g.samples) for g in model.groups)) * first.interval_s
    kinds = tuple(dict.fromkeys(s.kind for s in model.layout.sensors))
    of_kind = np.array([kinds.index(s.kind) for s in model.layout.sensors])
    longest = max(g.interval_s for g in model.groups)
    frequency = np.linspace(0.0, 0.5 / longest, _SEGMENT // 2 + 1)
    sums, counts = np.zeros((2, len(kinds), frequency.size)), np.zeros(len(kinds))
    order: list[int] = []
    before: list[np.ndarray] = []
    after: list[np.ndarray] = []
    residuals = [np.asarray(lin.residual) for lin in linearisations]
    for group, residual, found in zip(model.groups, residuals, residual_models(problem, residuals), strict=True):
        innovation = found.innovations(group.measured, residual)
        depth = found.coefficients.shape[0]
        kept = np.isfinite(innovation)
        innovation = np.where(kept, innovation, 0.0)
        used = group.measured.any(axis=0)
        order += list(found.order[used])
        for rows, mask, series in ((before, group.measured, residual), (after, kept, innovation)):
            # On the lags of the first group, whatever the sample rate.
            own = autocorrelation(mask, series, _lags(group.samples))[:, used].T
            rows += [np.interp(lag, np.arange(row.size) * group.interval_s, row) for row in own]
        for which, series in enumerate((residual, innovation[depth:])):
            spectrum = _flat_for_white(series, group.interval_s, frequency)
            for r, c in np.argwhere(used):
                sums[which, of_kind[c]] += spectrum[:, r, c]
        np.add.at(counts, of_kind[np.nonzero(used)[1]], 1)
    raw = [_plain_residual(weights, i, lin) for i, lin in enumerate(linearisations)]
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
    found = np.empty((frequency_hz.size, *series.shape[1:]))
    for index in np.ndindex(*series.shape[1:]):
        found[(slice(None), *index)] = np.interp(frequency_hz, at, power[(slice(None), *index)]) / mean[index]
    return found


def _lags(samples: int) -> int:
    return min(_LAGS, samples // 4)
