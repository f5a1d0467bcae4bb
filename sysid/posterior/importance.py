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

#: Draws: enough for k.
DRAWS = 400


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

    @property
    def sentence(self) -> str:
        """What it says about the chain."""
        found = (
            f"Importance sampling about the optimum: Pareto k {self.pareto_k:.2f}, {self.effective:.0f} of "
            f"{len(self.draws)} draws effective"
        )
        return f"{found}; {'a chain was not needed' if self.is_reliable else 'a chain is needed'}."

    def resampled(self, groups: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draws (groups, n / groups, 1, p) and log-densities, each group from its own share of the draws by weight."""
        shares = np.array_split(np.arange(len(self.draws)), groups)
        size = min(map(len, shares))
        picked = np.array([random.choice(s, size, p=self.weights[s] / self.weights[s].sum()) for s in shares])
        return self.draws[picked][:, :, None], self.log_probability[picked][:, :, None]


def importance_sample(
    density: Density, mode: Parameters, covariance: ParametersByParameters, seed: int, count: int = DRAWS
) -> ImportanceSample:
    """Draws about a posterior's mode (p,) with the covariance (p, p); what has no finite density weighs nothing."""
    proposals = LaplaceMove(mode, covariance)
    draws, log_proposal = proposals.draws(count, np.random.RandomState(np.random.MT19937([seed, count])))
    values = np.asarray(density(draws), float)
    finite = np.isfinite(values)
    if not finite.any():
        return ImportanceSample(draws, values, np.full(count, 1.0 / count), np.inf)
    weights = np.zeros(count)
    # It takes the logarithms with opposite sign.
    smoothed, k = array_stats.psislw(log_proposal[finite] - values[finite])
    weights[finite] = np.exp(smoothed - smoothed.max())
    return ImportanceSample(draws, values, weights / weights.sum(), float(k))
