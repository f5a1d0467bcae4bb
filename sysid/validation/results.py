"""How well simulated histories agree with measured ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.tabular import Tabular, records_table

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ChannelAgreement:
    """Agreement of one channel of one run; `nrmse` is RMS(simulated - measured) / (max - min of measured).

    `residual_over_noise` is the residual scale over the instrument noise seen while the truck rolls on flat road.
    """

    run: str
    column: str
    kind: str
    axle: int | None
    nrmse: float
    residual_over_noise: float
    samples: int


@dataclass(frozen=True)
class Validation(Tabular):
    """Agreement of every channel of every run."""

    channels: tuple[ChannelAgreement, ...]

    def summary(self) -> pd.DataFrame:
        """One row per entry, in SI units."""
        return records_table(
            self.channels, ("run", "column", "kind", "axle", "nrmse", "residual_over_noise", "samples")
        )
