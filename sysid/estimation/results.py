"""Results of the least-squares fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.display import Z90
from sysid.tabular import Tabular, records_table

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from sysid.estimation.identifiability import Identifiability


_PARAMETER_COLUMNS = (
    "name",
    "axle",
    "quantity",
    "load_case",
    "unit",
    "value",
    "sd",
    "start",
    "prior_median",
    "prior_sd",
    "identified",
)


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter: what it is, and what least squares found.

    `name` like ``k_1`` or ``k_2[loaded]``; `quantity` ``stiffness``, ``damping``, ``tire_stiffness``, ...; `axle` is
    the axle index or None; `load_case` None means shared; `run` is the file of a run-local parameter or None.
    `value` in `unit`; `sd` its standard deviation; `prior_median`, `prior_log_sd` describe the prior.
    `identified` is False where the data add next to nothing to the prior.
    """

    name: str
    quantity: str
    unit: str
    axle: int | None
    load_case: str | None
    run: str | None
    law: str
    transform: str
    value: float
    sd: float
    start: float
    prior_median: float
    prior_sd: float
    identified: bool


@dataclass(frozen=True)
class HistoryBand:
    """Pointwise 5 % and 95 % quantiles (channels, n) of what the sensors of a run show over posterior draws, SI."""

    low: np.ndarray
    high: np.ndarray

    def with_scatter(self, noise_sd: np.ndarray) -> HistoryBand:
        """The band that holds 90 % of new readings: with half width h and middle m, m +- sqrt(h^2 + (z s)^2).

        Variances add; z = 1.645 and s the residual scale.  Exact where the draws are normal.

        Parameters
        ----------
        noise_sd : (channels,) residual scale s [SI].
        """
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        reach = np.hypot(half, Z90 * np.asarray(noise_sd)[:, None])
        return HistoryBand(middle - reach, middle + reach)


@dataclass(frozen=True)
class RunHistory(Tabular):
    """Measured against simulated histories of one run at the least-squares optimum.

    `time_s` (n,); per channel rows: `measured` and `simulated` (channels, n) in SI with the estimated sensor offset and
    gain applied to the simulation; NaN where missing; `censored` as in the records; `noise_sd` (channels,) residual
    scale; `offset`, `gain` (channels,); `band` what the posterior says of the same signals, None before sampling.
    """

    file: str
    case: str
    load_case: str
    speed_m_s: float
    speed_sd: float
    start_s: float
    columns: tuple[str, ...]
    kinds: tuple[str, ...]
    si_units: tuple[str, ...]
    axles: tuple[int | None, ...]
    time_s: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray
    censored: np.ndarray
    noise_sd: np.ndarray
    instrument_noise_sd: np.ndarray
    offset: np.ndarray
    gain: np.ndarray
    band: HistoryBand | None = None

    @property
    def reading_band(self) -> HistoryBand | None:
        """Where 90 % of new readings of the same pass are expected: posterior and residual scatter together."""
        return None if self.band is None else self.band.with_scatter(self.noise_sd)

    def summary(self) -> pd.DataFrame:
        """One row per channel: residual and instrument noise, sensor offset and gain."""
        import pandas as pd

        names = ("noise_sd", "instrument_noise_sd", "offset", "gain")
        axles = pd.array([None if a is None else a + 1 for a in self.axles], dtype="Int64")
        head = {"column": self.columns, "kind": self.kinds, "axle": axles, "unit": self.si_units}
        return pd.DataFrame({**head, **{name: getattr(self, name) for name in names}})

    def to_pandas(self) -> pd.DataFrame:
        """Time [s], and per channel ``..._measured`` and ``..._simulated`` in SI units, one row per sample.

        After sampling also the ends of the posterior's 90 % band, ``..._q05`` and ``..._q95``.
        """
        import pandas as pd

        columns = {"time_s": self.time_s}
        for row, name in enumerate(self.columns):
            columns |= {f"{name}_measured": self.measured[row], f"{name}_simulated": self.simulated[row]}
            if self.band is not None:
                columns |= {f"{name}_q05": self.band.low[row], f"{name}_q95": self.band.high[row]}
        return pd.DataFrame(columns)

    def to_xarray(self) -> xr.Dataset:
        """Variables ``measured``, ``simulated`` and ``censored`` over ``channel`` and ``time_s``.

        After sampling also the ends of the posterior's 90 % band, ``q05`` and ``q95``.
        """
        import xarray as xr

        values = {name: getattr(self, name) for name in ("measured", "simulated", "censored")}
        if self.band is not None:
            values |= {"q05": self.band.low, "q95": self.band.high}
        return xr.Dataset(
            {name: (("channel", "time_s"), array) for name, array in values.items()},
            {"channel": list(self.columns), "time_s": self.time_s, "unit": ("channel", list(self.si_units))},
            {"file": self.file, "case": self.case, "load_case": self.load_case, "speed_m_s": self.speed_m_s},
        )


@dataclass(frozen=True)
class LawTrial:
    """One set of suspension laws that was fitted: `laws` by axle, number of `parameters`, `cost` (half the weighted sum
    of squares with priors, same weights for all trials), `misfit` (residual over instrument noise) and `gain` in the
    information criterion over the first trial.
    """

    laws: tuple[str, ...]
    parameters: int
    cost: float
    misfit: float
    gain: float


@dataclass(frozen=True)
class LawComparison(Tabular):
    """Trials of suspension laws and the one that was `chosen`, by axle."""

    trials: tuple[LawTrial, ...]
    chosen: tuple[str, ...]

    def summary(self) -> pd.DataFrame:
        """One row per trial."""
        return records_table(self.trials, ("laws", "parameters", "cost", "misfit", "gain"))


@dataclass(frozen=True)
class ContactTrial:
    """The fit repeated with another contact law: `misfit` residual over instrument noise, `values` in the order of the
    result's parameters.
    """

    contact: str
    misfit: float
    values: tuple[float, ...]


@dataclass(frozen=True)
class MassCheck:
    """One declared mass property: `words` say which, `tolerance` is the standard deviation of the logarithm of a factor
    on it, and `asked` the factor that the data would take for it if it were estimated with all other unknowns.
    """

    name: str
    quantity: str
    words: str
    tolerance: float
    asked: float


@dataclass(frozen=True)
class ResidualEvidence:
    """What remains of the readings, and what the noise model makes of it (:mod:`sysid.estimation.autoregression`).

    Power spectra `before` and `after` (K, F) of the residuals and of their innovations, means over the channels and
    runs of each of K `kinds` of sensors over the `frequency_hz` (F,), 1 everywhere for white ones; `order` (n,) of the
    autoregressive model of every channel in every run, `autocorrelation_before` and `autocorrelation_after` (n, L) at
    lags `lag_s` (L,); `degrees_of_freedom` (C,) of the tails of every channel in `columns`, infinite for normal ones.
    """

    kinds: tuple[str, ...]
    frequency_hz: np.ndarray
    before: np.ndarray
    after: np.ndarray
    order: np.ndarray
    lag_s: np.ndarray
    autocorrelation_before: np.ndarray
    autocorrelation_after: np.ndarray
    columns: tuple[str, ...]
    degrees_of_freedom: np.ndarray


@dataclass(frozen=True)
class FitResult(Tabular):
    """The least-squares optimum: global parameters, covariance, residual statistics and diagnostics.

    `covariance` (p, p) of the global parameters in the estimation space (logarithms where `transform` says so),
    run-local parameters marginalised, inflated for residual autocorrelation, for the tolerances of declared masses
    and for model error (a sandwich over blocks of residuals, :mod:`sysid.estimation.sandwich`;
    `model_error_inflation` is its root mean square factor on standard deviations); `residual_evidence` what the
    residuals are like; `step_halving_error` the largest relative RMS change of any channel when the integration step
    is halved at the optimum; `scipy_max_difference_sd` the largest difference between the optimum found by SciPy's
    trust-region solver and this one, in standard deviations; `law_comparison` what was tried where linear laws did not
    do, or None; `contact_trials` the fit with every contact law where that was asked for, the result's own first;
    `masses` what the data say about declared masses, whose tolerances `covariance` holds; `identifiability` what the
    data determine (:mod:`sysid.estimation.identifiability`).
    """

    parameters: tuple[ParameterEstimate, ...]
    run_parameters: tuple[ParameterEstimate, ...]
    covariance: np.ndarray
    histories: tuple[RunHistory, ...]
    converged: bool
    message: str
    iterations: int
    cost: float
    residuals: int
    weight_rounds: int
    condition_number: float
    step_halving_error: float
    scipy_max_difference_sd: float
    variance_inflation: float
    model_error_inflation: float
    contact: str
    residual_evidence: ResidualEvidence
    warnings: tuple[str, ...] = ()
    law_comparison: LawComparison | None = None
    contact_trials: tuple[ContactTrial, ...] = ()
    masses: tuple[MassCheck, ...] = ()
    identifiability: Identifiability | None = None

    @property
    def laws(self) -> tuple[str, ...]:
        """Suspension law of every axle (of a group one, in the place of its first axle), front to rear."""
        found = {p.axle: p.law for p in self.parameters if p.quantity == "damping"}
        return tuple(found[axle] for axle in sorted(found, key=lambda a: -1 if a is None else a))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the global parameters in the order of the covariance."""
        return tuple(p.name for p in self.parameters)

    def summary(self) -> pd.DataFrame:
        """One row per entry, in SI units."""
        return records_table(self.parameters, _PARAMETER_COLUMNS)

    def to_pandas(self) -> pd.DataFrame:
        """Global parameters and those of every run."""
        return records_table((*self.parameters, *self.run_parameters), ("run", "law", *_PARAMETER_COLUMNS))
