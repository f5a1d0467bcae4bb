"""One number per truck, normal about a population, by quadrature over the spread: outliers, and derived loads.

    y_t ~ N(mu, tau^2 + s_t^2),  mu ~ flat,  tau on a grid of its logarithm

What one truck is compared with is the population of all the others: with it among them, a broken truck widens the
spread and hides itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

#: Spread of the logarithms of the spreads of a quantity's parameters about their common one (an assumption): axles of
#: one type differ less in how much their dampers vary than eight trucks can tell.
POOLING = 0.4
#: Spreads of the quadrature, each 9 % above the one before.
_POINTS = 81


@dataclass(frozen=True)
class Population:
    """What a population is from: weights (g,) over spreads (g,), mean and variance (g,) of mu at each."""

    weights: np.ndarray
    spread: np.ndarray
    mean: np.ndarray
    variance: np.ndarray

    def quantiles(self, levels: tuple[float, ...], *, extra_variance: float = 0.0) -> np.ndarray:
        """Quantiles of the mixture of normals that a new member has, with `extra_variance` of its reading."""
        sd = np.sqrt(self.variance + self.spread**2 + extra_variance)
        low, high = (self.mean - 12.0 * sd).min(), (self.mean + 12.0 * sd).max()
        grid = np.linspace(low, high, 4001)
        cumulative = (self.weights * ndtr((grid[:, None] - self.mean) / sd)).sum(axis=1)
        return np.interp(levels, cumulative, grid)

    def tail(self, value: float, variance: float) -> float:
        """Two-sided probability that a new member's reading of this variance is as far out as `value`."""
        below = float(
            (self.weights * ndtr((value - self.mean) / np.sqrt(self.variance + self.spread**2 + variance))).sum()
        )
        return 2.0 * min(below, 1.0 - below)


def spread_grid(scale: float) -> np.ndarray:
    """Spreads from a hundredth to ten times a scale, evenly in their logarithm."""
    return np.asarray(scale * np.exp(np.linspace(np.log(0.01), np.log(10.0), _POINTS)))


def half_cauchy(spread: np.ndarray, scale: float) -> np.ndarray:
    """Log-density of the logarithm of a half-Cauchy spread, up to a constant."""
    return np.asarray(np.log(spread) - np.log1p((spread / scale) ** 2))


def evidence(value: np.ndarray, variance: np.ndarray, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log-evidence (g,) of readings (t,) at spreads (g,), mu integrated out, and mean and variance (g,) of mu."""
    weight = 1.0 / (spread[:, None] ** 2 + variance)
    total = weight.sum(axis=1)
    mean = (weight * value).sum(axis=1) / total
    log = 0.5 * np.log(weight).sum(axis=1) - 0.5 * np.log(total)
    return log - 0.5 * (weight * (value - mean[:, None]) ** 2).sum(axis=1), mean, 1.0 / total


def population(value: np.ndarray, variance: np.ndarray, scale: float) -> Population:
    """The population behind readings (t,) with known variances, for one quantity by itself."""
    spread = spread_grid(scale)
    log, mean, var = evidence(value, variance, spread)
    return Population(_normalised(log + half_cauchy(spread, scale)), spread, mean, var)


def pooled_populations(value: np.ndarray, variance: np.ndarray, scale: float) -> list[Population]:
    """Populations of several like parameters (t, m), whose spreads are lognormal about a common one."""
    spread = spread_grid(scale)
    by_parameter = [
        evidence(v[np.isfinite(v)], s[np.isfinite(v)], spread) for v, s in zip(value.T, variance.T, strict=True)
    ]
    if len(by_parameter) == 1:
        return [population(value[np.isfinite(value[:, 0]), 0], variance[np.isfinite(value[:, 0]), 0], scale)]
    # About each common spread (rows) the spreads of single parameters (columns).
    about = -0.5 * (np.log(spread[None, :] / spread[:, None]) / POOLING) ** 2
    about -= np.log(np.exp(about).sum(axis=1, keepdims=True))
    common = [_log_sum(about + log) for log, _, _ in by_parameter]
    prior = half_cauchy(spread, scale)
    result = []
    for k, (log, mean, var) in enumerate(by_parameter):
        others = prior + sum(c for i, c in enumerate(common) if i != k)
        weights = _normalised(log + _log_sum((about + others[:, None]).T))
        result.append(Population(weights, spread, mean, var))
    return result


def _log_sum(rows: np.ndarray) -> np.ndarray:
    top = rows.max(axis=1)
    return np.asarray(top + np.log(np.exp(rows - top[:, None]).sum(axis=1)))


def _normalised(log: np.ndarray) -> np.ndarray:
    weights = np.exp(log - log.max())
    return np.asarray(weights / weights.sum())
