"""Where least squares ended for one set of suspension laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import RunsByChannels, UnknownsOfFit
from sysid.campaign.loggers import ClockFinding
from sysid.estimation.fit.minimiser import Minimum
from sysid.estimation.fit.thresholds import LEAST_SHARE, MISFIT
from sysid.estimation.residuals.problem import Problem


@dataclass(frozen=True)
class Optimum:
    """Where least squares ended for one set of suspension laws.

    - `vector`: the optimum, and `first`: the start of the last search, both in the unknowns of `problem`;
    - `minimum`: how the search ended;
    - `instrument` (R, C): noise of the instruments per group [SI];
    - `rolling` (R, C): what the channels show while the truck rolls towards the bump, 0 where unknown;
    - `amounts` (q,): log factors on masses, and amplitudes of departures, of the model of `problem`; None for the
      declared vehicle;
    - `clocks`: those of further loggers as in its records; none if the clocks are as read.
    """

    problem: Problem
    vector: UnknownsOfFit
    first: UnknownsOfFit
    minimum: Minimum
    instrument: tuple[RunsByChannels, ...]
    rolling: tuple[RunsByChannels, ...]
    amounts: np.ndarray | None = None
    clocks: tuple[ClockFinding, ...] = ()

    @property
    def misfit(self) -> float:
        """Median over channels and runs of residual scale over noise, where both are known.

        Noise is the larger of the instruments' and of what the channels show before the bump: roughness of the road and
        the engine are not errors of the model.
        """
        both = zip(self.instrument, self.rolling, strict=True)
        return self._median_over(tuple(np.maximum(i, r) for i, r in both))

    @property
    def over_instruments(self) -> float:
        """Median over channels and runs of residual scale over the noise of the instruments alone."""
        return self._median_over(self.instrument)

    def _median_over(self, noise: tuple[RunsByChannels, ...]) -> float:
        pairs = zip(self.problem.weights.noise_sd, noise, strict=True)
        known = [(n, i, np.isfinite(n) & np.isfinite(i)) for n, i in pairs]
        return float(np.median(np.concatenate([n[k] / i[k] for n, i, k in known])))


def worth_a_search(optimum: Optimum, gain: float) -> bool:
    """Whether the residuals are so large, or what a law or part is expected to gain over them, that it is tried."""
    return optimum.misfit >= MISFIT or gain >= LEAST_SHARE * 2.0 * optimum.minimum.cost


def effective_residuals(optimum: Optimum) -> float:
    """Number of residuals over their variance inflation, summed over channels and runs."""
    total = 0.0
    for group, tempering in zip(optimum.problem.model.groups, optimum.problem.weights.tempering, strict=True):
        total += float((group.measured.sum(axis=0) * tempering**2).sum())
    return max(total, 2.0)


def parameter_sd(optimum: Optimum) -> np.ndarray:
    """Standard deviations (p,) of the log parameters from the curvature of the cost at the optimum alone."""
    jacobian, count = optimum.problem.compressed(optimum.vector).jacobian, optimum.problem.count
    optimum.problem.forget()
    normal = jacobian.T @ jacobian
    # A run that left its record says nothing about its own unknowns.
    own = np.diag(normal)[count:]
    normal[count:, count:] += 1e-12 * np.diag(np.maximum(own, own.mean()))
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(normal))[:count]))
