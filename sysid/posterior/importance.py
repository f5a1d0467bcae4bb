"""Importance sampling about the mode: whether a posterior is so near its normal approximation that no chain is needed.

Draws x of a multivariate t about the mode get weights w = p(x) / t(x).  The k of a generalised Pareto distribution
fitted to the largest weights says whether means under them can be trusted (A. Vehtari, D. Simpson, A. Gelman, Y. Yao
and J. Gabry, Pareto smoothed importance sampling, Journal of Machine Learning Research 25 (2024), 72).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from arviz_stats.base import array_stats  # type: ignore[attr-defined]  # its way of naming what is public

from sysid.arrays import DrawsByParameters, Parameters, ParametersByParameters
from sysid.posterior.ensembles import Density
from sysid.posterior.moves import LaplaceMove

#: Degrees of freedom of the proposals with sides.
_SIDED_NU = 10.0
#: Distances, in standard deviations, at which a density shows how wide it is on each side.
_DISTANCES = np.array([0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0])


@dataclass(frozen=True)
class ImportanceSample:
    """Draws (n, p) with their log-density (n,) and smoothed weights (n,) of sum 1, and `pareto_k`."""

    draws: DrawsByParameters
    log_probability: np.ndarray
    weights: np.ndarray
    pareto_k: float

    @property
    def effective(self) -> float:
        """Number of independent draws of the posterior that say as much."""
        return float(1.0 / np.sum(self.weights**2))

    @property
    def is_reliable(self) -> bool:
        """Whether so many draws suffice at this k: k < min(1 - 1 / log10 n, 0.7)."""
        return bool(self.pareto_k < min(1.0 - 1.0 / np.log10(len(self.draws)), 0.7))

    def sentence(self, *, chain: bool) -> str:
        """How good its draws are, where a chain came after it or, without `chain`, where they are the posterior."""
        found = (
            f"Importance sampling about the optimum: Pareto k {self.pareto_k:.2f}, {self.effective:.0f} of "
            f"{len(self.draws)} draws effective"
        )
        if not self.is_reliable:
            return f"{found}; a chain is needed."
        return f"{found}; {'they would do for a preview' if chain else 'a chain was not needed'}."

    def resampled(self, groups: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draws (groups, n / groups, 1, p) and log-densities, each group from its own share of the draws by weight."""
        shares = np.array_split(np.arange(len(self.draws)), groups)
        size = min(map(len, shares))
        picked = np.array([random.choice(s, size, p=self.weights[s] / self.weights[s].sum()) for s in shares])
        return self.draws[picked][:, :, None], self.log_probability[picked][:, :, None]


@dataclass(frozen=True)
class SidedProposals:
    """A multivariate t about a mode whose axes have widths of their own on either side.

    x = mode + F (s z), z of a t with nu degrees of freedom; s_i is `above` (p,) where z_i > 0, `below` (p,) elsewhere.
    So it reaches where a spread may be zero, as far as the density of its logarithm does (J. Geweke, Bayesian inference
    in econometric models using Monte Carlo integration, Econometrica 57 (1989), 1317, section 5).
    """

    mode: Parameters
    factor: ParametersByParameters
    above: Parameters
    below: Parameters

    @classmethod
    def about(cls, density: Density, mode: Parameters, covariance: ParametersByParameters) -> SidedProposals:
        """The widths that a log-density shows along the columns of F: the largest d / sqrt(2 fall over d)."""
        factor = np.linalg.cholesky(covariance)
        moves = _DISTANCES[:, None] * np.array([1.0, -1.0])[:, None, None, None] * factor.T[None, :, None]
        values = density(np.concatenate([mode[None], mode + moves.reshape(-1, mode.size)]))
        falls = (values[0] - values[1:]).reshape(2, mode.size, _DISTANCES.size)
        widths = _DISTANCES / np.sqrt(2.0 * np.maximum(falls, 1e-2))
        above, below = np.clip(np.nan_to_num(widths, nan=0.0).max(axis=2), 0.3, 10.0)
        return cls(mode, factor, above, below)

    def draws(self, count: int, random: np.random.RandomState) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, p), and the logarithm of their density (n,), up to a constant."""
        chi2 = random.chisquare(_SIDED_NU, size=(count, 1))
        z = random.standard_normal((count, self.mode.size)) / np.sqrt(chi2 / _SIDED_NU)
        width = np.where(z > 0.0, self.above, self.below)
        log_t = -0.5 * (_SIDED_NU + self.mode.size) * np.log1p((z**2).sum(axis=1) / _SIDED_NU)
        return self.mode + (width * z) @ self.factor.T, log_t - np.log(width).sum(axis=1)


def importance_sample(
    density: Density,
    mode: Parameters,
    covariance: ParametersByParameters,
    seed: int,
    count: int,
    *,
    sided: bool = False,
) -> ImportanceSample:
    """Draws about a posterior's mode (p,) with the covariance (p, p); what has no finite density weighs nothing.

    Parameters
    ----------
    sided : whether proposals follow the density on either side of its mode, at 14 p densities more.
    """
    of = SidedProposals.about(density, mode, covariance) if sided else LaplaceMove(mode, covariance)
    draws, log_proposal = of.draws(count, np.random.RandomState(np.random.MT19937([seed, count])))
    values = np.asarray(density(draws), float)
    finite = np.isfinite(values)
    if not finite.any():
        return ImportanceSample(draws, values, np.full(count, 1.0 / count), np.inf)
    weights = np.zeros(count)
    # It takes the logarithms with opposite sign.
    smoothed, k = array_stats.psislw(log_proposal[finite] - values[finite])
    weights[finite] = np.exp(smoothed - smoothed.max())
    return ImportanceSample(draws, values, weights / weights.sum(), float(k))
