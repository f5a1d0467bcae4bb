"""Results of the advice: how well parameters would be known after runs that nobody has driven yet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.tabular import Tabular

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Prospect:
    """What would be known after one further run: `load_case`, `bump`, `speed_m_s`, and the `sensor` added for it.

    `sd` (p,) standard deviations of the log parameters; `peak_sd` standard deviation of the predicted peak dynamic load
    ratio, NaN without a prediction.  Of what is known now `load_case` and `bump` are empty and the speed is NaN.
    `exact` names a declared mass property that is taken as exact then.
    """

    load_case: str
    bump: str
    speed_m_s: float
    sensor: str
    sd: np.ndarray
    peak_sd: float
    exact: str = ""

    @property
    def label(self) -> str:
        """The run and the added sensor, or what is exact, in words."""
        if not self.load_case:
            return f"none, but exact {self.exact}" if self.exact else "none"
        run = f"{3.6 * self.speed_m_s:.4g} km/h, {self.load_case}"
        return f"{run}, with {self.sensor}" if self.sensor else run


@dataclass(frozen=True)
class PeakTarget:
    """The predicted peak that advice looks at: `axle` index, pass, and `ratio` as predicted, else at the optimum."""

    axle: int
    load_case: str
    speed_m_s: float
    ratio: float

    @property
    def label(self) -> str:
        """The pass and the axle in words."""
        return f"axle {self.axle + 1}, {self.load_case}, {3.6 * self.speed_m_s:.4g} km/h"


@dataclass(frozen=True)
class Advice(Tabular):
    """The benefit of the next run and the next sensor.

    - `names` (p,) of the parameters;
    - `targets`: names of the parameters of interest, every k and c;
    - `now`: present knowledge;
    - `runs`: after one further run each, with the present sensors;
    - `sensors`: after one further run with one more sensor, each with the run that suits it best;
    - `peak`: the predicted peak, None without a prediction;
    - `statements` in words;
    - `masses`: without a further run, but with one declared mass property measured exactly; the most useful ones first.
    """

    names: tuple[str, ...]
    targets: tuple[str, ...]
    now: Prospect
    runs: tuple[Prospect, ...]
    sensors: tuple[Prospect, ...]
    peak: PeakTarget | None
    statements: tuple[str, ...]
    masses: tuple[Prospect, ...] = ()

    @property
    def rows(self) -> tuple[Prospect, ...]:
        """Everything that is compared, what is known now first."""
        return (self.now, *self.runs, *self.sensors, *self.masses)

    def worst(self, prospect: Prospect) -> tuple[str, float]:
        """Name and relative standard deviation of the k or c that would be known worst."""
        sd = {name: float(prospect.sd[self.names.index(name)]) for name in self.targets}
        name = max(sd, key=lambda n: sd[n])
        return name, sd[name]

    def median(self, prospect: Prospect) -> float:
        """Median relative standard deviation of all k and c."""
        return float(np.median([prospect.sd[self.names.index(name)] for name in self.targets]))

    def summary(self) -> pd.DataFrame:
        """One row per prospect: what is known now, after every run, with every sensor."""
        import pandas as pd

        rows = []
        for p in self.rows:
            name, worst = self.worst(p)
            rows.append(
                {
                    "load_case": p.load_case,
                    "bump": p.bump,
                    "speed_m_s": p.speed_m_s,
                    "sensor": p.sensor,
                    "exact": p.exact,
                    "worst": name,
                    "worst_sd": worst,
                    "median_sd": self.median(p),
                    "peak_ratio_sd": p.peak_sd,
                }
            )
        return pd.DataFrame(rows)
