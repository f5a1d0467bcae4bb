"""How far the optimum of a fit may be off for reasons that its own log-density does not know.

The log-density of the parameters x holds masses, departures from the model and clocks where the fit ends, and takes the
residuals for noise of the size that they have.  With those free, the parameters move along with them, by a linear
response that hardly depends on x: the posterior of x keeps its shape and is shifted.  Model error that no departure
describes and laws that the data do not decide shift it as well.  So a draw of the parameters is

    theta = x + d,    d ~ N(shift, Sigma - Q),

with Q the covariance of x at the optimum, and Sigma that of the parameters with everything else integrated out
(:mod:`sysid.estimation.uncertainty.data_information`).  For a linear model without model error this is the exact
marginal posterior.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters, WalkerDraws


@dataclass(frozen=True)
class Spread:
    """The normal distribution of d for p log parameters x: mean `shift` - `lever` x, covariance `covariance`.

    `shift` (p,), `covariance` (p, p); `lever` (p, p), None for a mean that does not depend on x.
    """

    shift: Parameters
    covariance: ParametersByParameters
    lever: ParametersByParameters | None = None

    def added(self, draws: WalkerDraws, seed: int, first: int = 0) -> WalkerDraws:
        """Draws (E, n, W, p) of x, each with one of d; step `first` + i of a chain always gets the same.

        Parameters
        ----------
        seed : of the random numbers; first : number of the first step.
        """
        found, factor = np.array(draws, float), covariance_root(self.covariance)
        for step in range(draws.shape[1]):
            if self.lever is not None:
                found[:, step] -= draws[:, step] @ self.lever.T
            found[:, step] += self._deviations(draws.shape, seed, first + step, factor)
        return found

    def taken_away(self, draws: WalkerDraws, seed: int, first: int = 0) -> WalkerDraws:
        """The draws x that :meth:`added` turned into these, with the same `seed` and `first`.

        Raises
        ------
        ValueError
            If the mean depends on x.
        """
        if self.lever is not None:
            raise ValueError("a spread whose mean depends on the draws cannot be taken away")
        found, factor = np.array(draws, float), covariance_root(self.covariance)
        for step in range(draws.shape[1]):
            found[:, step] -= self._deviations(draws.shape, seed, first + step, factor)
        return found

    def _deviations(self, shape: tuple[int, ...], seed: int, step: int, factor: np.ndarray) -> np.ndarray:
        ensembles, _, walkers, count = shape
        # By the number of the step: a chain that goes on keeps what it had.  By the covariance: campaigns with the same
        # seed must not get the same, or their errors would have the same sign.
        own = zlib.crc32(np.round(np.log(np.diag(self.covariance) + 1e-300), 3).tobytes())
        normal = np.random.default_rng([seed, step, own]).standard_normal((ensembles, walkers, count))
        return np.asarray(self.shift + normal @ factor.T)


def spread_between(
    own: ParametersByParameters, total: ParametersByParameters, shift: Parameters | None = None
) -> Spread:
    """What draws with covariance `own` Q (p, p) lack of `total` Sigma (p, p); `shift` (p,) is zero without one.

    Directions in which Q exceeds Sigma, as by rounding where the data say nothing, get nothing: draws are then wider
    than Sigma there.
    """
    scale = np.sqrt(np.diag(total))
    values, vectors = np.linalg.eigh(_symmetric((total - own) / np.outer(scale, scale)))
    missing = (vectors * np.maximum(values, 0.0)) @ vectors.T
    covariance = _symmetric(missing) * np.outer(scale, scale)
    return Spread(np.zeros(scale.size) if shift is None else np.asarray(shift, float), covariance)


def covariance_root(covariance: ParametersByParameters) -> ParametersByParameters:
    """F (p, p) with F F' = `covariance`, which may be singular: its symmetric root in units of standard deviations.

    Unlike other roots it does not depend on signs and order of eigenvectors, which differ between libraries.
    """
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(_symmetric(covariance / np.outer(scale, scale)))
    return np.asarray(scale[:, None] * ((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T))


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (matrix + matrix.T))
