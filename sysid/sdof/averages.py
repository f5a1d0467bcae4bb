"""Averages over swings and repeats that carry both the noise and the scatter beyond it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq


@dataclass(frozen=True)
class RandomEffects:
    """Generalised least squares with an extra variance common to all values.

    `value` (p,), `covariance` (p, p), `extra_sd` the standard deviation beyond the noise, `freedom` the degrees of
    freedom.
    """

    value: np.ndarray
    covariance: np.ndarray
    extra_sd: float
    freedom: int


def random_effects(design: np.ndarray, value: np.ndarray, covariance: np.ndarray) -> RandomEffects:
    """Fit value = design @ beta with covariance C + tau^2 I, tau from the scatter itself.

    tau^2 >= 0 makes the weighted sum of squared residuals equal to the degrees of freedom (Paule and Mandel 1982,
    doi:10.6028/jres.087.022).  With tau = 0 this is the least-noise estimate; with scatter far above the noise it tends
    to the plain mean.

    Parameters
    ----------
    design, value, covariance
        (n, p), (n,), (n, n) of the noise, positive semi-definite.
    """
    design = np.asarray(design, float)
    value = np.asarray(value, float)
    size, count = design.shape
    freedom = size - count
    floor = 1e-18 * max(float(np.mean(value**2)), 1e-300)

    def solve(tau2: float) -> tuple[np.ndarray, np.ndarray, float]:
        whitener = np.linalg.cholesky(covariance + (tau2 + floor) * np.eye(size))
        a = np.linalg.solve(whitener, design)
        b = np.linalg.solve(whitener, value)
        spread = np.linalg.pinv(a.T @ a)
        beta = spread @ (a.T @ b)
        return beta, spread, float(np.sum((b - a @ beta) ** 2))

    tau2 = 0.0
    if freedom > 0 and solve(0.0)[2] > freedom:
        high = max(float(np.var(value)), float(np.trace(covariance)) / size, 10.0 * floor)
        while solve(high)[2] > freedom:
            high *= 4.0
        tau2 = float(brentq(lambda x: solve(x)[2] - freedom, 0.0, high, xtol=1e-6 * high, rtol=1e-9))
    beta, spread, _ = solve(tau2)
    return RandomEffects(beta, spread, float(np.sqrt(tau2)), freedom)


def mean_with_scatter(value: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """Random-effects mean of values with noise covariance (n, n), and its standard error."""
    fit = random_effects(np.ones((value.size, 1)), value, covariance)
    return float(fit.value[0]), float(np.sqrt(fit.covariance[0, 0]))
