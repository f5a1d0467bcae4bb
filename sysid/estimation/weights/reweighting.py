"""Weights of the residuals from the residuals: scale, correlation in time and tails of every run and channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.arrays import RunsByChannels, SamplesByRunsByChannels
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_data import RunGroup
from sysid.estimation.weights.autoregression import Autoregression, fitted_autoregression, variance_inflation
from sysid.estimation.weights.heavy_tails import heavy_tails
from sysid.estimation.weights.noise import residual_scale
from sysid.vehicle_model.engines.protocol import Linearisation

#: Lags of the autocorrelation, five times the highest order of the autoregressive models.
_LAGS = 120


def reweighted(problem: Problem, linearisations: Sequence[Linearisation]) -> Weights:
    """Weights of the next round: residual scales, tempering by variance inflation, and outliers."""
    scales, weights, tempering = [], [], []
    for position, (group, lin) in enumerate(zip(problem.model.groups, linearisations, strict=True)):
        raw = plain_residual(problem.weights, position, np.asarray(lin.residual))
        tails = heavy_tails(group.measured, raw, group.value)
        plain = raw * np.sqrt(tails.weight)
        scales.append(residual_scale(group, plain))
        inflation = _inflation(problem, lin, residual_model(group, plain))
        tempering.append(np.sqrt(tails.information / inflation))
        weights.append(tails.weight)
    alike = all(np.all(of_group == 1.0) for of_group in weights)
    return Weights(tuple(scales), tuple(tempering), None if alike else tuple(weights))


def residual_model(group: RunGroup, residual: SamplesByRunsByChannels) -> Autoregression:
    """Autoregressive models of the residuals (T, R, C) of a group, whatever their scale."""
    return fitted_autoregression(group.measured, residual, lags_of(group.samples))


def residual_inflation(problem: Problem, position: int, lin: Linearisation) -> RunsByChannels:
    """Variance inflation (R, C) of the group at a position, from its linearisation."""
    return _inflation(problem, lin, residual_model(problem.model.groups[position], np.asarray(lin.residual)))


def _inflation(problem: Problem, lin: Linearisation, model: Autoregression) -> RunsByChannels:
    return variance_inflation(model, np.asarray(lin.residual_jacobian)[..., : problem.count])


def plain_residual(weights: Weights, position: int, residual: SamplesByRunsByChannels) -> SamplesByRunsByChannels:
    """Residuals (T, R, C) of a group in SI without any weights; 0 where nothing was measured."""
    noise = weights.noise_sd[position]
    scale = np.where(np.isfinite(noise), noise, 0.0) / weights.tempering[position]
    raw = residual * scale
    return np.asarray(raw if weights.reading is None else raw / np.sqrt(weights.reading[position]))


def lags_of(samples: int) -> int:
    """Number of lags used for a record of this many samples."""
    return min(_LAGS, samples // 4)
