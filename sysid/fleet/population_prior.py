"""What all other trucks say of a campaign, as the prior under which it is sampled once more.

Draws under the campaign's own, wide prior may not reach where the population puts its truck.  Under N(m, S) of the
other trucks they do.  The prior N(m0, P) of the shared parameters is exchanged for it: the log-density changes by

    log N(x; m, S) - log N(x; m0, P),

and a Gaussian N(x0, C) of all parameters, prior or posterior, has the precision C^-1 + S^-1 - P^-1 afterwards.

Draws of a campaign are x + d, with x from the log-density of its fit and d ~ N(mu, D)
(:mod:`sysid.estimation.uncertainty.spread`).  The change above is the quadratic form h'y - y'K y / 2 of y = x + d, with
K = S^-1 - P^-1 and h = S^-1 m - P^-1 m0 in the shared parameters.  With d integrated out, the log-density of x changes
by

    h'y - y'K y / 2 + g'V g / 2,    y = x + mu,    g = h - K y,    V = (I + D K)^-1 D,

and then d ~ N(mu + V g, V).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.estimation.uncertainty.spread import Spread
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
    """Log-density of a calibrated campaign, (n, p) -> (n,), its optimum (p,), its covariance (p, p), and the spread.

    Draws of the campaign are those of the density, each with one of the spread.
    """

    density: Callable[[np.ndarray], np.ndarray]
    centre: np.ndarray
    covariance: np.ndarray
    spread: Spread


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

    def sampled(self, fitted: Fitted) -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray, np.ndarray, Spread]:
        """What to sample with the exchanged prior: log-density (n, p) -> (n,) of x, its Gaussian, and the spread d."""
        count = fitted.centre.size
        k, h = np.zeros((count, count)), np.zeros(count)
        after, before = np.linalg.inv(self.new[1]), np.linalg.inv(self.old[1])
        k[np.ix_(self.at, self.at)] = after - before
        h[self.at] = after @ self.new[0] - before @ self.old[0]
        shift, wide = fitted.spread.shift, fitted.spread.covariance
        v = np.linalg.solve(np.eye(count) + wide @ k, wide)
        v = 0.5 * (v + v.T)

        def density(points: np.ndarray) -> np.ndarray:
            y = np.atleast_2d(points) + shift
            g = h - y @ k
            change = y @ h - 0.5 * ((y @ k) * y).sum(axis=1) + 0.5 * ((g @ v) * g).sum(axis=1)
            return np.asarray(fitted.density(points) + change)

        left = np.eye(count) - k @ v
        size, directions = np.linalg.eigh(np.linalg.inv(fitted.covariance) + 0.5 * (left @ k + (left @ k).T))
        # What is not above zero is rounding: the data are silent there, and so is the population.
        covariance = (directions / np.maximum(size, 1e-12 * size.max())) @ directions.T
        centre = fitted.centre + covariance @ left @ (h - k @ (fitted.centre + shift))
        return density, centre, covariance, Spread(shift + v @ (h - k @ shift), v, v @ k)


def exchange(record: CampaignDraws, prior: PopulationPrior) -> ExchangedPrior:
    """The prior of a campaign's record exchanged for that of the population, for the parameters that both have."""
    shared = [name for name in prior.names if name in record.names]
    at = np.array([record.names.index(name) for name in shared])
    of = np.array([prior.names.index(name) for name in shared])
    old = (record.prior_mean[at], record.prior_covariance[np.ix_(at, at)])
    return ExchangedPrior(at, old, (prior.mean[of], prior.covariance[np.ix_(of, of)]))
