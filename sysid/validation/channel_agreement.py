"""How well simulated histories agree with measured ones."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.tabular import Tabular, records_table

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ChannelAgreement:
    """Agreement of one channel of one run; NaN is a number that the record does not give.

    - `nrmse` is RMS(simulated - measured) / (max - min of measured).
    - `residual_over_noise` is the residual scale over what the sensor shows while the truck rolls towards the bump:
      noise of the instrument, or roughness of the road and vibration of the engine where these are more.
    - `fit_percent` is 100 (1 - |m - s| / |m - mean(m)|).
    - `peak_error` [-] and `peak_time_error_s`: simulated less measured largest absolute value, relative, and instant.
    - `measured_frequency_hz`, `simulated_frequency_hz`: frequency with the largest amplitude.
    - `sprague_geers_magnitude`, `sprague_geers_phase` [-], zero at best.
    - `iso18571` is the overall objective rating R, one at best.
    - `out_of_sample` is True where the simulation comes from a fit without this run.
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
    out_of_sample: bool = False


@dataclass(frozen=True)
class ValidationLimits:
    """Limits that an acceptable channel keeps.

    The default for the rating is where ISO/TS 18571 begins to call an agreement good. Those of Sprague and Geers are
    from the RSVVP procedure (NCHRP Web-Only Document 179). That of the peak is what the literature on axle loads calls
    good. That of the NRMSE is our choice.
    """

    nrmse: float = 0.10
    peak_error: float = 0.15
    sprague_geers_magnitude: float = 0.40
    sprague_geers_phase: float = 0.40
    iso18571: float = 0.80

    def exceeded(self, row: ChannelAgreement) -> tuple[str, ...]:
        """Names of the limits that a channel does not keep; a number that is not known keeps its limit."""
        above = ("nrmse", "peak_error", "sprague_geers_magnitude", "sprague_geers_phase")
        exceeded = [name for name in above if abs(getattr(row, name)) > getattr(self, name)]
        return (*exceeded, *(["iso18571"] if row.iso18571 < self.iso18571 else []))


@dataclass(frozen=True)
class LeftOutRun:
    """A run predicted by a fit of all other runs.

    - `values` (p,): global parameters of the fit without the run;
    - `shift_sd` (p,): their change, in standard deviations of the fit of all runs;
    - `converged`: whether that fit ended at a minimum;
    - `speed_m_s`, `start_s`: of the run itself, found from its record;
    - `channels`: their agreement, out of sample.
    """

    run: str
    values: np.ndarray
    shift_sd: np.ndarray
    converged: bool
    speed_m_s: float
    start_s: float
    channels: tuple[ChannelAgreement, ...]


@dataclass(frozen=True)
class LeftOut(Tabular):
    """Runs predicted without having been fitted; `names` of the global parameters, `in_sample` the fit of all runs."""

    names: tuple[str, ...]
    runs: tuple[LeftOutRun, ...]
    in_sample: tuple[ChannelAgreement, ...]

    def summary(self) -> pd.DataFrame:
        """One row per run: medians over its channels with and without the run in the fit, and the largest shift."""
        import pandas as pd

        rows = []
        for left in self.runs:
            fitted = [c for c in self.in_sample if c.run == left.run]
            most = int(np.argmax(np.abs(left.shift_sd)))
            rows.append(
                {
                    "run": left.run,
                    "residual_over_noise": channel_median(fitted, "residual_over_noise"),
                    "residual_over_noise_out_of_sample": channel_median(left.channels, "residual_over_noise"),
                    "nrmse": channel_median(fitted, "nrmse"),
                    "nrmse_out_of_sample": channel_median(left.channels, "nrmse"),
                    "iso18571": channel_median(fitted, "iso18571"),
                    "iso18571_out_of_sample": channel_median(left.channels, "iso18571"),
                    "moved_most": self.names[most],
                    "shift_sd": float(left.shift_sd[most]),
                    "converged": left.converged,
                }
            )
        return pd.DataFrame(rows)


def channel_median(rows: Sequence[ChannelAgreement], name: str) -> float:
    """Median of one measure over the channels that have it, NaN where none has."""
    finite = [v for v in (getattr(row, name) for row in rows) if math.isfinite(v)]
    return statistics.median(finite) if finite else math.nan


@dataclass(frozen=True)
class Validation(Tabular):
    """Agreement of every channel of every fitted run, and the limits for it.

    `left_out` holds runs that were predicted by a fit without them, None if that was not requested.
    """

    channels: tuple[ChannelAgreement, ...]
    limits: ValidationLimits = ValidationLimits()
    left_out: LeftOut | None = None

    @property
    def out_of_sample(self) -> tuple[ChannelAgreement, ...]:
        """Channels of runs that were predicted by a fit without them."""
        return () if self.left_out is None else tuple(c for run in self.left_out.runs for c in run.channels)

    @property
    def outside(self) -> tuple[ChannelAgreement, ...]:
        """Channels that do not keep every limit."""
        return tuple(row for row in self.channels if self.limits.exceeded(row))

    def to_pandas(self) -> pd.DataFrame:
        """The summary and the names of the limits that a channel does not keep."""
        rows = (*self.channels, *self.out_of_sample)
        return self.summary().assign(outside_limits=[" ".join(self.limits.exceeded(row)) for row in rows])

    def summary(self) -> pd.DataFrame:
        """One row per channel and run, in SI units; runs predicted by a fit without them follow, marked so."""
        return records_table(
            (*self.channels, *self.out_of_sample),
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
                "out_of_sample",
            ),
        )
