"""What all other trucks say of a campaign, as the prior under which it is sampled once more.

Draws under the campaign's own, wide prior may not reach where the population puts its truck.  Under N(m, S) of the
other trucks they do.  The prior N(m0, P) of the shared parameters is exchanged for it: the log-density changes by

    log N(x; m, S) - log N(x; m0, P),

and a Gaussian N(x0, C) of all parameters, prior or posterior, has the precision C^-1 + S^-1 - P^-1 afterwards.

This is the quadratic form h'x - x'K x / 2 with K = S^-1 - P^-1 and h = S^-1 m - P^-1 m0 in the shared parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.fleet.draws import CampaignDraws

#: How much wider than the population its prior is taken: weights of draws under it are then bounded, and a truck that
#: differs from the others is still reached.
WIDENED = 2.0


@dataclass(frozen=True)
class PopulationPrior:
    """N(`mean` (d,), `covariance` (d, d)) of the log parameters `names`."""

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray

    def as_dict(self) -> dict[str, Any]:
        """Plain lists, for another process."""
        return {"names": list(self.names), "mean": self.mean.tolist(), "covariance": self.covariance.tolist()}

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> PopulationPrior:
        """What :meth:`as_dict` made."""
        return cls(tuple(fields["names"]), np.array(fields["mean"]), np.array(fields["covariance"]))


def prior_of_others(names: Sequence[str], mean: np.ndarray, covariance: np.ndarray) -> PopulationPrior:
    """The mixture of normals (h, d), (h, d, d) that the other trucks give, as one normal of twice its width."""
    spread = np.atleast_2d(np.cov(mean.T, bias=True))
    return PopulationPrior(tuple(names), mean.mean(axis=0), WIDENED**2 * (covariance.mean(axis=0) + spread))


@dataclass(frozen=True)
class Fitted:
    """Log-density of a calibrated campaign, (n, p) -> (n,), and mode (p,) and covariance (p, p) of its Gaussian."""

    density: Callable[[np.ndarray], np.ndarray]
    centre: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class ExchangedPrior:
    """The prior of some parameters exchanged: `at` their places, `old` and `new` mean and covariance."""

    at: np.ndarray
    old: tuple[np.ndarray, np.ndarray]
    new: tuple[np.ndarray, np.ndarray]

    def gaussian(self, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (p,) and covariance (p, p) of a Gaussian of all parameters, with the exchanged prior.

        Along directions where the Gaussian is wider than the old prior, which rounding or a rough covariance may give,
        the data count as silent.
        """
        (m0, old), (m, new) = self.old, self.new
        data = np.linalg.inv(covariance)
        before, after = np.linalg.inv(old), np.linalg.inv(new)
        linear = data @ mean
        data[np.ix_(self.at, self.at)] -= before
        linear[self.at] -= before @ m0
        size, directions = np.linalg.eigh(0.5 * (data + data.T))
        precision = (directions * np.maximum(size, 0.0)) @ directions.T
        linear = directions @ np.where(size > 0.0, directions.T @ linear, 0.0)
        precision[np.ix_(self.at, self.at)] += after
        linear[self.at] += after @ m
        changed = np.linalg.inv(precision)
        return changed @ linear, 0.5 * (changed + changed.T)

    def sampled(self, fitted: Fitted) -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray, np.ndarray]:
        """What to sample with the exchanged prior: log-density (n, p) -> (n,), mean and covariance of its Gaussian."""
        after, before = np.linalg.inv(self.new[1]), np.linalg.inv(self.old[1])
        k, h = after - before, after @ self.new[0] - before @ self.old[0]

        def density(points: np.ndarray) -> np.ndarray:
            x = np.atleast_2d(points)[:, self.at]
            return np.asarray(fitted.density(points) + x @ h - 0.5 * ((x @ k) * x).sum(axis=1))

        return density, *self.gaussian(fitted.centre, fitted.covariance)


def exchange(record: CampaignDraws, prior: PopulationPrior) -> ExchangedPrior:
    """The prior of a campaign's record exchanged for that of the population, for the parameters that both have."""
    shared = [name for name in prior.names if name in record.names]
    at = np.array([record.names.index(name) for name in shared])
    of = np.array([prior.names.index(name) for name in shared])
    old = (record.prior_mean[at], record.prior_covariance[np.ix_(at, at)])
    return ExchangedPrior(at, old, (prior.mean[of], prior.covariance[np.ix_(of, of)]))
