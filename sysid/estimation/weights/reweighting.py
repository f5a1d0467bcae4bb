"""Weights of the residuals from the residuals: scale, correlation in time and tails of every run and channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.weights.autoregression import (
    Autoregression,
    fitted_autoregression,
    variance_inflation,
)
from sysid.estimation.weights.heavy_tails import heavy_tails
from sysid.estimation.weights.noise import residual_scale
from sysid.vehicle_model.engines.protocol import Linearisation

#: Lags of the autocorrelation, five times the highest order of the autoregressive models.
_LAGS = 120


def reweighted(problem: Problem, linearisations: Sequence[Linearisation]) -> Weights:
    """Weights of the next round: residual scales, tempering by variance inflation, and outliers."""
    scales, tails, plain = [], [], []
    for position, (group, lin) in enumerate(zip(problem.model.groups, linearisations, strict=True)):
        raw = plain_residual(problem.weights, position, lin)
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
        fitted_autoregression(group.measured, residual, lags_of(group.samples))
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


def plain_residual(weights: Weights, position: int, lin: Linearisation) -> np.ndarray:
    """Residuals (T, R, C) in SI without any weights; 0 where nothing was measured."""
    noise = weights.noise_sd[position]
    scale = np.where(np.isfinite(noise), noise, 0.0) / weights.tempering[position]
    raw = np.asarray(lin.residual) * scale
    return np.asarray(raw if weights.reading is None else raw / np.sqrt(weights.reading[position]))


def lags_of(samples: int) -> int:
    """Number of lags used for a record of this many samples."""
    return min(_LAGS, samples // 4)
