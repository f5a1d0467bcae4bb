"""How far the Gaussian form of a campaign may be trusted: importance weights from its own draws, and their Pareto k.

Given all other trucks, the parameters of a campaign have the Gaussian N(m, S).  Its draws x_s were made under the prior
N(m0, P); weighted by N(x_s; m, S) / N(x_s; m0, P) they are draws under the population.  k is the tail index of these
weights (A. Vehtari et al., Pareto smoothed importance sampling, JMLR 25 (2024)): above 0.7 the draws do not reach where
the population puts the truck, and sums over them say nothing.  Further campaigns of the truck itself are left out of
N(m, S): where two agree, the draws of one are too few.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from arviz_stats.base import array_stats  # type: ignore[attr-defined]  # its way of naming what is public

from sysid.fleet.quadratic_forms import eliminated

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


def log_ratios(
    draws: np.ndarray,
    prior: tuple[np.ndarray, np.ndarray],
    mean: np.ndarray,
    precision: np.ndarray,
    log_det: np.ndarray,
) -> np.ndarray:
    """Logarithm of N(x_s; m, S) / N(x_s; m0, P) (h, n) at draws (n, d), for h Gaussians.

    Parameters
    ----------
    prior : m0 (d,) and P (d, d).
    mean, precision, log_det : m (h, d), the inverse of S (h, d, d), and log det S (h,).
    """
    centre = draws.mean(axis=0)
    at = draws - centre
    i, j = np.triu_indices(at.shape[1])
    features = np.concatenate([at[:, i] * at[:, j], at, np.ones((len(at), 1))], axis=1)
    of_prior = _coefficients(prior[0][None] - centre, np.linalg.inv(prior[1])[None], np.linalg.slogdet(prior[1])[1])
    return np.asarray((_coefficients(mean - centre, precision, log_det) - of_prior) @ features.T)


def _coefficients(mean: np.ndarray, precision: np.ndarray, log_det: np.ndarray) -> np.ndarray:
    """Of the log-density of Gaussians in products, coordinates and 1, without 2 pi."""
    pull = (precision @ mean[..., None])[..., 0]
    i, j = np.triu_indices(mean.shape[1])
    constant = (pull * mean).sum(axis=1) + log_det
    products = precision[:, i, j] * np.where(i == j, -0.5, -1.0)
    return np.concatenate([products, pull, -0.5 * constant[:, None]], axis=1)


def campaign_weights(ratios: np.ndarray) -> Weights:
    """Weights of draws, averaged over the Gaussians of draws of the hyperparameters, from log ratios (h, n)."""
    return smoothed(_log_mean(ratios.T))


def log_corrections(
    ratios: Iterable[np.ndarray],
    mean: np.ndarray,
    precision: np.ndarray,
    log_det: np.ndarray,
    likelihood: np.ndarray,
    shift: np.ndarray,
) -> np.ndarray:
    """Log ratio (h, m) of the evidence of m campaigns under their draws to that under their Gaussian forms.

    The first is the mean of exp(`ratios`) (h, n) over the draws; the second, with precision L and shift b of the
    likelihood, the integral of exp(-x'Lx/2 + b'x) N(x; m, S).  Both are up to a constant.  With several campaigns of
    one truck it is a correction of first order.

    Parameters
    ----------
    mean, precision, log_det : m (h, d, m), the inverse of S (h, d, d, m), and log det S (h, m).
    likelihood, shift : L (d, d, m), b (d, m).
    """
    # Of x about the middle of its means: about zero, differences of large numbers would be rounding.
    centre = mean.mean(axis=0)
    mean = mean - centre
    own = np.einsum("hijm,hjm->him", precision, mean)
    pull = own + shift - np.einsum("ijm,jm->im", likelihood, centre)
    square = (own * mean).sum(axis=1)
    rows = pull[:, None]
    of_both = eliminated(precision + likelihood, rows)
    gauss = 0.5 * ((rows[:, 0] ** 2).sum(axis=1) - square - of_both - log_det)
    return np.asarray(np.stack([_log_mean(r) for r in ratios], axis=1) - gauss)


def _log_mean(logs: np.ndarray) -> np.ndarray:
    """Logarithm of the mean over the last axis of what these are logarithms of."""
    top = logs.max(axis=-1)
    return np.asarray(top + np.log(np.exp(logs - top[..., None]).mean(axis=-1)))
