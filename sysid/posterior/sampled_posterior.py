"""Results of the Bayesian calibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.arrays import EnsemblesByStepsByWalkers, Parameters, WalkerDraws
from sysid.estimation.parameters.units import parameter_unit
from sysid.tabular import Tabular, records_table
from sysid.wording import finish, nearest, shorten

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

#: Log-density of the posterior's maximum above that of the least-squares optimum from which on this is a local one. A
#: curved posterior differs from its Gaussian approximation by less.
LOCAL_OPTIMUM = 5.0


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

    `draws` (ensembles, steps, walkers, parameters); `log_probability` (ensembles, steps, walkers) up to a constant;
    `autocorrelation_time` (parameters,) in steps; `acceptance` (ensembles,).  `converged` is the verdict over
    independent ensembles (R-hat and effective draws of every parameter), `message` says it in
    words.  `rejected` counts proposals without a finite simulation.  `against_intervals` are those `warnings` that
    speak against relying on the intervals.
    """

    names: tuple[str, ...]
    draws: WalkerDraws
    log_probability: EnsemblesByStepsByWalkers
    burn_in: int
    thin: int
    autocorrelation_time: Parameters
    acceptance: np.ndarray
    summaries: tuple[PosteriorSummary, ...]
    converged: bool
    preview: bool
    likelihood: str
    message: str
    seed: int
    warnings: tuple[str, ...] = ()
    rejected: int = 0
    against_intervals: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> PosteriorSummary:
        """The summary of a parameter by its name, in SI units: ``posterior["k_1"].q50``.

        Raises
        ------
        KeyError
            If there is no such parameter; the nearest name is suggested.
        """
        for s in self.summaries:
            if s.name == name:
                return s
        raise KeyError(finish(f"the posterior has no parameter '{shorten(name)}'; {nearest(name, self.names)}"))

    _in_row_unit = ("mean", "sd", "q05", "q50", "q95")

    def _row_units(self, table: pd.DataFrame) -> list[str]:
        return [parameter_unit(name) for name in table["name"]]

    def summary(self) -> pd.DataFrame:
        """One row per entry, in SI units."""
        return records_table(self.summaries, ("name", "mean", "sd", "q05", "q50", "q95", "ess", "rhat"))

    def to_pandas(self) -> pd.DataFrame:
        """All draws: `ensemble`, `step` and `walker` counted from 0, and one column per parameter in its unit."""
        import pandas as pd

        ensembles, steps, walkers, count = self.draws.shape
        places = pd.MultiIndex.from_product(
            [range(ensembles), range(steps), range(walkers)], names=["ensemble", "step", "walker"]
        )
        return pd.DataFrame(self.draws.reshape(-1, count), places, list(self.names)).reset_index()

    def to_xarray(self) -> xr.Dataset:
        """All draws, one variable per parameter in its unit, with dimensions ``chain`` (ensemble) and ``draw``."""
        from sysid.posterior.inference_data import posterior_dataset

        return posterior_dataset(self)

    def to_arviz(self) -> Any:
        """All draws for ArviZ: ``InferenceData`` before its version 1, an xarray ``DataTree`` for later ones."""
        from sysid.posterior.inference_data import arviz_data

        return arviz_data(self)


def optimum_warnings(posterior: Posterior, optimum: Parameters, log_density: float) -> tuple[str, ...]:
    """What draws say about the least-squares optimum: a sentence if they fit clearly better, so that it is a local one.

    The mean log-density of draws of a Gaussian with p parameters is p / 2 below its maximum.

    Parameters
    ----------
    optimum : (p,) in natural units; log_density : there.
    """
    higher = float(posterior.log_probability.mean()) + optimum.size / 2.0 - log_density
    if higher < LOCAL_OPTIMUM:
        return ()
    low, middle, high = np.quantile(np.log(posterior.draws).reshape(-1, optimum.size), [0.05, 0.5, 0.95], axis=0)
    name = posterior.names[int(np.argmax(np.abs(middle - np.log(optimum)) / (high - low)))]
    return (
        f"The posterior fits better than the least-squares optimum (log-density {higher:.0f} higher), which is a local "
        f"one; they differ most in {name}. Use the values of the posterior, and fit again with a prior for {name} in "
        "campaign.toml.",
    )
