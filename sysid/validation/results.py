"""How well simulated histories agree with measured ones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.tabular import Tabular, records_table

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ChannelAgreement:
    """Agreement of one channel of one run; NaN is a number that the record does not give.

    - `nrmse` is RMS(simulated - measured) / (max - min of measured).
    - `residual_over_noise` is the residual scale over the instrument noise seen while the truck rolls on flat road.
    - `fit_percent` is 100 (1 - |m - s| / |m - mean(m)|).
    - `peak_error` [-] and `peak_time_error_s`: simulated less measured largest absolute value, relative, and instant.
    - `measured_frequency_hz`, `simulated_frequency_hz`: frequency with the largest amplitude.
    - `sprague_geers_magnitude`, `sprague_geers_phase` [-], zero at best.
    - `iso18571` is the overall objective rating R, one at best.
    """

    run: str
    column: str
    kind: str
    axle: int | None
    nrmse: float
    residual_over_noise: float
    samples: int
    fit_percent: float = math.nan
    peak_error: float = math.nan
    peak_time_error_s: float = math.nan
    measured_frequency_hz: float = math.nan
    simulated_frequency_hz: float = math.nan
    sprague_geers_magnitude: float = math.nan
    sprague_geers_phase: float = math.nan
    iso18571: float = math.nan


@dataclass(frozen=True)
class ValidationLimits:
    """Limits that an acceptable channel keeps.

    The rating's default is where ISO/TS 18571 begins to call an agreement good, those of Sprague and Geers are the
    ones of the RSVVP procedure (NCHRP Web-Only Document 179), the peak's is what the literature on wheel loads calls
    good, the NRMSE's is our choice.
    """

    nrmse: float = 0.10
    peak_error: float = 0.15
    sprague_geers_magnitude: float = 0.40
    sprague_geers_phase: float = 0.40
    iso18571: float = 0.80

    def exceeded(self, row: ChannelAgreement) -> tuple[str, ...]:
        """Names of the limits that a channel does not keep; a number that is not known keeps its limit."""
        above = ("nrmse", "peak_error", "sprague_geers_magnitude", "sprague_geers_phase")
        found = [name for name in above if abs(getattr(row, name)) > getattr(self, name)]
        return (*found, *(["iso18571"] if row.iso18571 < self.iso18571 else []))


@dataclass(frozen=True)
class Validation(Tabular):
    """Agreement of every channel of every run, and the limits it is held against."""

    channels: tuple[ChannelAgreement, ...]
    limits: ValidationLimits = ValidationLimits()

    @property
    def outside(self) -> tuple[ChannelAgreement, ...]:
        """Channels that do not keep every limit."""
        return tuple(row for row in self.channels if self.limits.exceeded(row))

    def to_pandas(self) -> pd.DataFrame:
        """The summary and the names of the limits that a channel does not keep."""
        return self.summary().assign(outside_limits=[" ".join(self.limits.exceeded(row)) for row in self.channels])

    def summary(self) -> pd.DataFrame:
        """One row per entry, in SI units."""
        return records_table(
            self.channels,
            (
                "run",
                "column",
                "kind",
                "axle",
                "samples",
                "nrmse",
                "residual_over_noise",
                "fit_percent",
                "peak_error",
                "peak_time_error_s",
                "measured_frequency_hz",
                "simulated_frequency_hz",
                "sprague_geers_magnitude",
                "sprague_geers_phase",
                "iso18571",
            ),
        )
