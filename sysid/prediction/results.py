"""Predicted passes nobody drove."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.tabular import Tabular

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class PassPrediction:
    """Wheel loads of one pass with posterior bands.

    `time_s` (n,) zero when the centre of axle 1 passes the start of the bump; `tire_force_*_N` (axles, n) total
    vertical force, pointwise quantiles (q05/q95 None before sampling); `static_load_N` (axles,); `peak_ratio_*`
    (axles,) quantiles of the peak dynamic load ratio per draw (q05/q95 None before sampling); `lift_off` (axles,) bool,
    True where the wheels leave the road in at least half of the draws.
    """

    load_case: str
    speed_m_s: float
    time_s: np.ndarray
    tire_force_q05_N: np.ndarray | None
    tire_force_q50_N: np.ndarray
    tire_force_q95_N: np.ndarray | None
    static_load_N: np.ndarray
    peak_ratio_q05: np.ndarray | None
    peak_ratio_q50: np.ndarray
    peak_ratio_q95: np.ndarray | None
    lift_off: np.ndarray
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Predictions(Tabular):
    """All predicted passes of a campaign; `source` is ``posterior`` or ``least squares``."""

    passes: tuple[PassPrediction, ...]
    source: str

    def summary(self) -> pd.DataFrame:
        """Peak dynamic load ratio of every axle and pass."""
        import pandas as pd

        rows = []
        for p in self.passes:
            for i in range(len(p.static_load_N)):
                rows.append(
                    {
                        "load_case": p.load_case,
                        "speed_m_s": p.speed_m_s,
                        "axle": i + 1,
                        "static_load_N": p.static_load_N[i],
                        "peak_ratio_q05": None if p.peak_ratio_q05 is None else p.peak_ratio_q05[i],
                        "peak_ratio_q50": p.peak_ratio_q50[i],
                        "peak_ratio_q95": None if p.peak_ratio_q95 is None else p.peak_ratio_q95[i],
                        "lift_off": bool(p.lift_off[i]),
                    }
                )
        return pd.DataFrame(rows)
