"""Where least squares ended for one set of suspension laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import RunsByChannels, UnknownsOfFit
from sysid.campaign.clocks.settings import ClockFinding
from sysid.estimation.fit.minimiser import Minimum
from sysid.estimation.residuals.problem import Problem


@dataclass(frozen=True)
class Optimum:
    """Where least squares ended for one set of suspension laws.

    - `vector` the optimum and `first` where the last search began from, in the unknowns of `problem`;
    - `minimum` how it ended;
    - `instrument` (R, C): noise of the instruments per group [SI], `rolling` (R, C) what the channels show while the
      truck rolls towards the bump, 0 where nothing tells it;
    - `amounts` (q,): log factors on masses and amplitudes of departures by which the model of `problem` is moved, None
      for the declared vehicle;
    - `clocks` of further loggers as its records have them, none for clocks as read.
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
        the engine are no faults of the model.
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


def effective_residuals(optimum: Optimum) -> float:
    """Number of residuals over their variance inflation, summed over channels and runs."""
    total = 0.0
    for group, tempering in zip(optimum.problem.model.groups, optimum.problem.weights.tempering, strict=True):
        total += float((group.measured.sum(axis=0) * tempering**2).sum())
    return max(total, 2.0)
