"""How far the Gaussian form of a campaign may be trusted: importance weights from its own draws, and their Pareto k.

Given all other trucks, the parameters of a campaign have the Gaussian N(m, S).  Its draws x_s were made under the prior
N(m0, P); weighted by N(x_s; m, S) / N(x_s; m0, P) they are draws under the population.  k is the tail index of these
weights (A. Vehtari et al., Pareto smoothed importance sampling, JMLR 25 (2024)): above 0.7 the draws do not reach where
the population puts the truck, and sums over them say nothing.  Further campaigns of the truck itself are left out of
N(m, S): where two agree, the draws of one are too few.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from arviz_stats.base import array_stats  # type: ignore[attr-defined]  # its way of naming what is public

#: Above this a sum over weighted draws cannot be trusted.
MOST_K = 0.7
#: Fewer effective draws than this tell nothing of the tail of their weights.
_LEAST_EFFECTIVE = 10.0


@dataclass(frozen=True)
class Weights:
    """Weights of a campaign's draws: `log_weights` (n,) smoothed and normalised, `pareto_k` of the raw ones."""

    log_weights: np.ndarray
    pareto_k: float

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Weighted mean of values (n, ...)."""
        return np.asarray(np.tensordot(np.exp(self.log_weights), values, axes=1))


def smoothed(log_weights: np.ndarray) -> Weights:
    """Pareto-smoothed weights (n,) and their k, infinite if a few draws have all the weight."""
    with np.errstate(all="ignore"):
        # It takes logarithms of likelihoods and changes their sign.
        smooth, k = array_stats.psislw(-log_weights)
    share = np.exp(log_weights - log_weights.max())
    few = share.sum() ** 2 < _LEAST_EFFECTIVE * (share**2).sum()
    return Weights(np.asarray(smooth), np.inf if few or np.isnan(k) else float(k))


def _coefficients(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Of the log-density of N(mean (n, d), covariance (n, d, d)), in products, coordinates and 1, without 2 pi."""
    precision = np.linalg.inv(covariance)
    pull = np.einsum("nij,nj->ni", precision, mean)
    i, j = np.triu_indices(mean.shape[1])
    constant = np.einsum("ni,ni->n", pull, mean) + np.linalg.slogdet(covariance)[1]
    products = precision[:, i, j] * np.where(i == j, -0.5, -1.0)
    return np.concatenate([products, pull, -0.5 * constant[:, None]], axis=1)


def log_ratios(
    draws: np.ndarray,
    prior_mean: np.ndarray,
    prior_covariance: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
) -> np.ndarray:
    """Logarithm of N(x_s; m, S) / N(x_s; m0, P) (h, n) at draws (n, d), for h Gaussians m (h, d), S (h, d, d)."""
    centre = draws.mean(axis=0)
    at = draws - centre
    i, j = np.triu_indices(at.shape[1])
    features = np.concatenate([at[:, i] * at[:, j], at, np.ones((len(at), 1))], axis=1)
    prior = _coefficients(prior_mean[None] - centre, prior_covariance[None])
    return np.asarray((_coefficients(mean - centre, covariance) - prior) @ features.T)


def campaign_weights(ratios: np.ndarray) -> Weights:
    """Weights of draws, averaged over the Gaussians of draws of the hyperparameters, from log ratios (h, n)."""
    top = ratios.max(axis=0)
    return smoothed(top + np.log(np.exp(ratios - top).mean(axis=0)))


def log_correction(
    ratios: np.ndarray, mean: np.ndarray, covariance: np.ndarray, precision: np.ndarray, shift: np.ndarray
) -> np.ndarray:
    """Log ratio (h,) of a campaign's evidence under its draws to that under its Gaussian form, up to a constant.

    The first is the mean of exp(`ratios`) (h, n) over the draws; the second, with precision L and shift h of the
    likelihood, the integral of exp(-x'Lx/2 + h'x) N(x; m, S).  With several campaigns of one truck it is a correction
    of first order.
    """
    top = ratios.max(axis=1)
    sampled = top + np.log(np.exp(ratios - top[:, None]).mean(axis=1))
    mixed = np.eye(len(shift)) + precision @ covariance
    pull = shift - np.einsum("ij,hj->hi", precision, mean)
    gain = np.linalg.solve(mixed, pull[..., None])[..., 0]
    gauss = 0.5 * np.einsum("hi,hij,hj->h", pull, covariance, gain, optimize=True)
    gauss -= 0.5 * np.linalg.slogdet(mixed)[1]
    gauss += np.einsum("i,hi->h", shift, mean)
    gauss -= 0.5 * np.einsum("hi,ij,hj->h", mean, precision, mean, optimize=True)
    return np.asarray(sampled - gauss)
