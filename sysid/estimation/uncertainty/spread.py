"""How far the optimum of a fit may be off for reasons that its own log-density does not know.

The log-density of the parameters x holds masses, departures from the model and clocks where the fit ends, and takes the
residuals for noise of the size that they have.  With those y free, the parameters move along with them, by a linear
response that hardly depends on x: the posterior of x keeps its shape and is shifted.  Model error that no departure
describes shifts it as well.  So a draw of the parameters is

    theta = x + d,    d ~ N(shift, Sigma - A),

with A the covariance of x at the optimum, and Sigma that of the parameters with everything else integrated out
(:mod:`sysid.estimation.uncertainty.data_information`).  For a linear model this is the exact marginal posterior.
"""

from __future__ import annotations

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
        return np.asarray(draws + self._mean(draws) + self._deviations(draws.shape, seed, first))

    def taken_away(self, draws: WalkerDraws, seed: int, first: int = 0) -> WalkerDraws:
        """The draws x that :meth:`added` turned into these, with the same `seed` and `first`.

        Raises
        ------
        ValueError
            If the mean depends on x.
        """
        if self.lever is not None:
            raise ValueError("a spread whose mean depends on the draws cannot be taken away")
        return np.asarray(draws - self.shift - self._deviations(draws.shape, seed, first))

    def _mean(self, draws: np.ndarray) -> np.ndarray:
        return self.shift if self.lever is None else self.shift - draws @ self.lever.T

    def _deviations(self, shape: tuple[int, ...], seed: int, first: int) -> np.ndarray:
        ensembles, steps, walkers, count = shape
        factor, found = covariance_root(self.covariance), np.empty(shape)
        for step in range(steps):
            # By the number of the step: a chain that goes on keeps what it had.
            normal = np.random.default_rng([seed, first + step]).standard_normal((ensembles, walkers, count))
            found[:, step] = normal @ factor.T
        return found


def spread_between(
    own: ParametersByParameters, total: ParametersByParameters, shift: Parameters | None = None
) -> Spread:
    """What draws with covariance `own` A (p, p) lack of `total` Sigma (p, p); nothing where they lack nothing.

    `shift` (p,) is zero without one.
    """
    scale = np.sqrt(np.diag(total))
    values, vectors = np.linalg.eigh(_symmetric((total - own) / np.outer(scale, scale)))
    # What is left below zero is rounding: A never exceeds Sigma by more.
    missing = (vectors * np.maximum(values, 0.0)) @ vectors.T
    covariance = _symmetric(missing) * np.outer(scale, scale)
    return Spread(np.zeros(scale.size) if shift is None else np.asarray(shift, float), covariance)


def covariance_root(covariance: ParametersByParameters) -> ParametersByParameters:
    """F (p, p) with F F' = `covariance`, which may be singular."""
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(_symmetric(covariance / np.outer(scale, scale)))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (matrix + matrix.T))
