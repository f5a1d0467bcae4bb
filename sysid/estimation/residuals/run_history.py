"""Measured against simulated histories of one run, as a record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.arrays import Channels, ChannelsBySamples, Samples
from sysid.display import Z90
from sysid.tabular import Tabular

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True)
class HistoryBand:
    """Pointwise 5 % and 95 % quantiles (channels, n) of what the sensors of a run show over posterior draws, SI."""

    low: ChannelsBySamples
    high: ChannelsBySamples

    def with_scatter(self, noise_sd: Channels) -> HistoryBand:
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

    - `speed_m_s`: speed at axle 1, and `speed_change`: its relative change until the last axle passes;
    - `time_s` (n,);
    - `measured`, `simulated` (channels, n): in SI, with the estimated sensor offset and gain applied to the simulation;
      NaN where missing;
    - `censored` as in the records;
    - `noise_sd` (channels,): residual scale;
    - `instrument_noise_sd`, `rolling_noise_sd` (channels,): what the channels show before the bump, from reading to
      reading and in total (0 where unknown);
    - `offset`, `gain` (channels,);
    - `band`: of the same signals over posterior draws, None before sampling.
    """

    file: str
    case: str
    load_case: str
    speed_m_s: float
    speed_sd: float
    speed_change: float
    start_s: float
    columns: tuple[str, ...]
    kinds: tuple[str, ...]
    si_units: tuple[str, ...]
    axles: tuple[int | None, ...]
    time_s: Samples
    measured: ChannelsBySamples
    simulated: ChannelsBySamples
    censored: ChannelsBySamples
    noise_sd: Channels
    instrument_noise_sd: Channels
    rolling_noise_sd: Channels
    offset: Channels
    gain: Channels
    band: HistoryBand | None = None

    @property
    def noise_before_sd(self) -> Channels:
        """What the channels (channels,) show before the bump: the larger of both noises."""
        return np.asarray(np.maximum(self.instrument_noise_sd, self.rolling_noise_sd))

    @property
    def reading_band(self) -> HistoryBand | None:
        """Where 90 % of new readings of the same pass are expected: posterior and residual scatter together."""
        return None if self.band is None else self.band.with_scatter(self.noise_sd)

    _in_row_unit = ("noise_sd", "instrument_noise_sd", "rolling_noise_sd", "offset")

    def summary(self) -> pd.DataFrame:
        """One row per channel: residual and instrument noise, sensor offset and gain."""
        import pandas as pd

        names = ("noise_sd", "instrument_noise_sd", "rolling_noise_sd", "offset", "gain")
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
