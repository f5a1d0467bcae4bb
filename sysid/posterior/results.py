"""Results of the Bayesian calibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.tabular import Tabular, records_table

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class PosteriorSummary:
    """Marginal posterior of one parameter in its natural unit: mean, sd, quantiles, effective draws and R-hat."""

    name: str
    mean: float
    sd: float
    q05: float
    q50: float
    q95: float
    ess: float
    rhat: float


@dataclass(frozen=True)
class Posterior(Tabular):
    """Draws of all ensembles after burn-in, in natural units.

    `draws` (ensembles, steps, walkers, parameters); `log_probability` (ensembles, steps, walkers);
    `autocorrelation_time` (parameters,) in steps; `acceptance` (ensembles,).  `converged` is the verdict over
    independent ensembles (R-hat and effective draws of every parameter), `message` says it in words.  `rejected` counts
    proposals without a finite simulation.
    """

    names: tuple[str, ...]
    draws: np.ndarray
    log_probability: np.ndarray
    burn_in: int
    thin: int
    autocorrelation_time: np.ndarray
    acceptance: np.ndarray
    summaries: tuple[PosteriorSummary, ...]
    converged: bool
    preview: bool
    likelihood: str
    message: str
    seed: int
    warnings: tuple[str, ...] = ()
    rejected: int = 0

    def summary(self) -> pd.DataFrame:
        """One row per entry, in SI units."""
        return records_table(self.summaries, ("name", "mean", "sd", "q05", "q50", "q95", "ess", "rhat"))
