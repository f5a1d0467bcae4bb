"""One number per truck, normal about a population, by quadrature over the spread: outliers, and derived loads.

    y_t = mu + b_t' e + n_t,  n_t ~ N(0, tau^2 + s_t^2),  mu ~ flat,  e ~ N(0, I),  tau on a grid of its logarithm

b_t are the sizes of the errors e that readings have in common; a difference of two readings is free of what both have
alike.  What one truck is compared with is the population of all the others: with it among them, a broken truck widens
the spread and hides itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

#: Spread of the logarithms of the spreads of a quantity's parameters about their common one (an assumption): axles of
#: one type differ less in how much their dampers vary than eight trucks can tell.
POOLING = 0.4
#: Spreads of the quadrature, each 9 % above the one before.
_POINTS = 81


@dataclass(frozen=True)
class Population:
    """What a population is from: weights (g,) over spreads (g,), mean and variance (g,) of the centre at each.

    The centre is mu, for a reading with common errors mu + b' e.
    """

    weights: np.ndarray
    spread: np.ndarray
    mean: np.ndarray
    variance: np.ndarray

    def quantiles(self, levels: tuple[float, ...]) -> np.ndarray:
        """Quantiles of the mixture of normals that a new member has: roots of its distribution function."""
        sd = np.sqrt(self.variance + self.spread**2)
        # Beyond 12 standard deviations of every normal the distribution function is 0 and 1.
        low, high = float((self.mean - 12.0 * sd).min()), float((self.mean + 12.0 * sd).max())

        def above(x: float, level: float) -> float:
            return float(self.weights @ ndtr((x - self.mean) / sd)) - level

        return np.array([brentq(above, low, high, (level,), xtol=1e-12) for level in levels])

    def tail(self, value: float, variance: float) -> float:
        """Two-sided probability that a new member's reading of this variance is as far out as `value`."""
        z = (value - self.mean) / np.sqrt(self.variance + self.spread**2 + variance)
        # Each side by itself: one less the other is rounding where it is small.
        return 2.0 * min(float(self.weights @ ndtr(z)), float(self.weights @ ndtr(-z)))


def spread_grid(scale: float) -> np.ndarray:
    """Spreads from a hundredth to ten times a scale, evenly in their logarithm."""
    return np.asarray(scale * np.exp(np.linspace(np.log(0.01), np.log(10.0), _POINTS)))


def half_cauchy(spread: np.ndarray, scale: float) -> np.ndarray:
    """Log-density of the logarithm of a half-Cauchy spread, up to a constant."""
    return np.asarray(np.log(spread) - np.log1p((spread / scale) ** 2))


@dataclass(frozen=True)
class Readings:
    """One parameter of trucks: `value` (t,), `variance` (t,) of their own errors, `common` (t, S) sizes of common ones.

    `of_new` (S,): sizes of the common errors in the reading that the population is compared with.
    """

    value: np.ndarray
    variance: np.ndarray
    common: np.ndarray
    of_new: np.ndarray

    @classmethod
    def independent(cls, value: np.ndarray, variance: np.ndarray) -> Readings:
        """Readings (t,) that have no error in common."""
        return cls(value, variance, np.zeros((len(value), 0)), np.zeros(0))


def evidence(readings: Readings, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log-evidence (g,) of readings at spreads (g,), mu and e integrated out, and mean and variance (g,) of mu + b' e.

    Linear regression on (1, b_t) with a flat prior of mu and a standard normal one of e; b is that of the new reading.
    """
    weight = 1.0 / (spread[:, None] ** 2 + readings.variance)
    rows = np.column_stack([np.ones(len(readings.value)), readings.common])
    prior = np.r_[0.0, np.ones(readings.common.shape[1])]
    information = np.einsum("gt,ti,tj->gij", weight, rows, rows) + np.diag(prior)
    found = np.linalg.solve(information, ((weight * readings.value) @ rows)[..., None])[..., 0]
    square = (weight * (readings.value - found @ rows.T) ** 2).sum(axis=1) + (prior * found**2).sum(axis=1)
    log = 0.5 * np.log(weight).sum(axis=1) - 0.5 * np.linalg.slogdet(information)[1] - 0.5 * square
    new = np.r_[1.0, readings.of_new]
    return log, found @ new, np.linalg.solve(information, np.tile(new[:, None], (len(spread), 1, 1)))[..., 0] @ new


def population(readings: Readings, scale: float) -> Population:
    """The population behind the readings of one quantity by itself."""
    spread = spread_grid(scale)
    log, mean, var = evidence(readings, spread)
    return Population(_normalised(log + half_cauchy(spread, scale)), spread, mean, var)


def pooled_populations(parameters: Sequence[Readings], scale: float) -> list[Population]:
    """Populations of several like parameters, whose spreads are lognormal about a common one."""
    if len(parameters) == 1:
        return [population(parameters[0], scale)]
    spread = spread_grid(scale)
    by_parameter = [evidence(readings, spread) for readings in parameters]
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
