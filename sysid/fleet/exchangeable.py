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
#: Other trucks that give a spread.
_LEAST_OTHERS = 2
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
    about = _about(spread)
    common = [_log_product(log[None], about.T)[0] for log, _, _ in by_parameter]
    prior = half_cauchy(spread, scale)
    result = []
    for k, (log, mean, var) in enumerate(by_parameter):
        others = prior + sum(c for i, c in enumerate(common) if i != k)
        weights = _normalised(log + _log_product(others[None], about)[0])
        result.append(Population(weights, spread, mean, var))
    return result


def chances(value: np.ndarray, variance: np.ndarray, common: np.ndarray, scale: float) -> np.ndarray:
    """Two-sided probabilities (t, p) that trucks are as far from all others as they are; infinite where not known.

    What :func:`pooled_populations` and :meth:`Population.tail` say of each truck by itself, for all of them: the sums
    over the others are those over all trucks less that of the truck.

    Parameters
    ----------
    value, variance : of p like parameters, with the errors of the trucks' own (t, p); NaN where not known.
    common : sizes (t, p, S) of common errors.
    """
    spread, known = spread_grid(scale), np.isfinite(value)
    comparable = known.sum(axis=0) - known >= _LEAST_OTHERS
    prior, about = half_cauchy(spread, scale), _about(spread)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_others = [
            _evidence_of_others(value[:, i], variance[:, i], common[:, i], spread) for i in range(len(value.T))
        ]
        of_common = [
            np.where(c[:, None], _log_product(e[0], about.T), 0.0) for e, c in zip(of_others, comparable.T, strict=True)
        ]
        chance = np.full(value.shape, np.inf)
        for i, (log, mean, var) in enumerate(of_others):
            others = prior + sum((c for k, c in enumerate(of_common) if k != i), np.zeros_like(log))
            pooled = np.where(comparable.sum(axis=1)[:, None] > 1, _log_product(others, about), prior)
            weights = np.exp(log + pooled - (log + pooled).max(axis=1, keepdims=True))
            z = (value[:, i, None] - mean) / np.sqrt(var + spread**2 + variance[:, i, None])
            sides = [(weights * ndtr(side)).sum(axis=1) / weights.sum(axis=1) for side in (z, -z)]
            at = known[:, i] & comparable[:, i]
            chance[at, i] = 2.0 * np.minimum(*sides)[at]
    return chance


def _evidence_of_others(
    value: np.ndarray, variance: np.ndarray, common: np.ndarray, spread: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What :func:`evidence` says (t, g) of the readings (t,) of all others, for the errors of each truck."""
    known = np.isfinite(value)
    middle = value[known].mean() if known.any() else 0.0
    y = np.where(known, value - middle, 0.0)
    rows = np.column_stack([np.ones(len(y)), common])
    weight = np.where(known[:, None], 1.0 / (spread**2 + np.where(known, variance, 1.0)[:, None]), 0.0)

    def less_own(of_truck: np.ndarray) -> np.ndarray:
        """Sums (t, g, ...) over all others of weights times what a truck has."""
        own = weight.reshape(*weight.shape, *[1] * (of_truck.ndim - 1)) * of_truck[:, None]
        return np.asarray(own.sum(axis=0) - own)

    logs = np.log(np.where(weight > 0.0, weight, 1.0))
    information = less_own(rows[:, :, None] * rows[:, None, :]) + np.diag(np.r_[0.0, np.ones(common.shape[1])])
    pull = less_own(rows * y[:, None])
    right = np.stack([pull, np.broadcast_to(rows[:, None], pull.shape)], axis=3)
    # Where there are no others nothing is known: the caller does not look there.
    alone = information[:, :, 0, 0] <= 0.0
    information[alone] = np.eye(rows.shape[1])
    found, towards = np.moveaxis(np.linalg.solve(information, right), 3, 0)
    square = less_own(y**2) - (pull * found).sum(axis=2)
    log = 0.5 * (logs.sum(axis=0) - logs - np.linalg.slogdet(information)[1] - square)
    return log, middle + (found * rows[:, None]).sum(axis=2), (towards * rows[:, None]).sum(axis=2)


def _about(spread: np.ndarray) -> np.ndarray:
    """Probabilities of the spreads of single parameters (columns) about each common one (rows)."""
    about = np.exp(-0.5 * (np.log(spread[None, :] / spread[:, None]) / POOLING) ** 2)
    return np.asarray(about / about.sum(axis=1, keepdims=True))


def _log_product(logs: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Logarithm of exp(logs) (t, g) @ factors (g, g).

    Nothing is lost where exp is 0: the largest term is 1 times a factor that is far from 0.
    """
    top = logs.max(axis=1, keepdims=True)
    return np.asarray(top + np.log(np.exp(logs - top) @ factors))


def _normalised(log: np.ndarray) -> np.ndarray:
    weights = np.exp(log - log.max())
    return np.asarray(weights / weights.sum())
