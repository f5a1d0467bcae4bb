"""What the runs of a campaign say by themselves: its posterior with the prior divided out, as a Gaussian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.fleet.draws import CampaignDraws

#: Directions about which the data add less than this share of the prior's information count as unknown: the draws could
#: not tell it from nothing.
LEAST_INFORMATION = 0.05
#: Share of the variance of a campaign that a shared error may explain at most.
MOST_SHARED = 0.9


@dataclass(frozen=True)
class Likelihood:
    """exp(-x' precision x / 2 + shift' x) of log parameters x (p,); `precision` (p, p) may be singular."""

    precision: np.ndarray
    shift: np.ndarray

    def placed(self, at: np.ndarray, count: int) -> Likelihood:
        """The same of a longer vector of `count` parameters, whose entries `at` these are; it is silent on others."""
        precision, shift = np.zeros((count, count)), np.zeros(count)
        precision[np.ix_(at, at)] = self.precision
        shift[at] = self.shift
        return Likelihood(precision, shift)


def likelihood_of(record: CampaignDraws) -> Likelihood:
    """The Gaussian likelihood behind Gaussian posterior and prior of a campaign.

    With posterior N(m, C) from the draws and prior N(m0, P) it is precision C^-1 - P^-1 and shift C^-1 m - P^-1 m0,
    computed where the prior is standard normal.  Directions in which the posterior is as wide as the prior (or wider,
    by the chance of the draws) carry no information.

    Raises
    ------
    ValueError
        If there are fewer draws than a covariance needs.
    """
    n, p = record.draws.shape
    if n < 2 * p + 2:
        raise ValueError(f"{n} draws of {p} parameters say nothing of their covariance")
    factor = np.linalg.cholesky(record.prior_covariance)
    white = np.linalg.solve(factor, (record.draws - record.prior_mean).T)
    inverse = np.linalg.inv(np.atleast_2d(np.cov(white)))
    shift = inverse @ white.mean(axis=1)
    size, directions = np.linalg.eigh(inverse - np.eye(p))
    kept = size > LEAST_INFORMATION
    size = np.where(kept, size, 0.0)
    back = np.linalg.solve(factor.T, directions)
    precision = (back * size) @ back.T
    along = np.where(kept, directions.T @ shift, 0.0)
    return Likelihood(precision, back @ along + precision @ record.prior_mean)


def without_shared(likelihood: Likelihood, moved: np.ndarray, sd: float) -> tuple[Likelihood, float]:
    """The likelihood for a known shared error, of a campaign whose interval allows for that error already.

    The covariance V becomes V - s^2 a a', which is L + s^2 L a a' L / (1 - s^2 a' L a) for the precision L.

    Parameters
    ----------
    moved : a (p,), by how much each log parameter follows the error.
    sd : s, standard deviation of the error.

    Returns
    -------
    The likelihood, and the share of the variance s^2 a' L a that the error was found to be (at most 0.9 is taken off).
    """
    pulled = likelihood.precision @ moved
    share = float(sd**2 * moved @ pulled)
    if share <= 0.0:
        return likelihood, 0.0
    s2 = sd**2 * min(1.0, MOST_SHARED / share)
    gain = s2 / (1.0 - s2 * float(moved @ pulled))
    precision = likelihood.precision + gain * np.outer(pulled, pulled)
    return Likelihood(precision, likelihood.shift + gain * pulled * float(moved @ likelihood.shift)), share
