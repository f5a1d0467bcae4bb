"""Load effects of vehicles on a bridge: what a predicted pass over one adds to the axle loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from sysid.prediction.quantiles import Quantiles
from sysid.tabular import Tabular, band_columns

if TYPE_CHECKING:
    import pandas as pd

Sense = Literal["largest", "least"]


@dataclass(frozen=True)
class CodeEffect:
    """Characteristic effect of a code's load model on one lane, with its dynamic allowance, in the effect's unit."""

    model: str
    value: float


@dataclass(frozen=True)
class LoadEffect:
    """Extremes of one load effect in one sense over the pass, quantiles (1,) over draws and surfaces, in SI units.

    - `line`: its influence line among those of the bridge;
    - `static`: of the axle loads at rest, moved slowly over the bridge;
    - `rolling`: of the dynamic axle loads of a deck that does not move, along the influence line;
    - `dynamic`: of vehicle and bridge as one system; the same as `rolling` without modes of the bridge;
    - `amplification`: dynamic over static, draw by draw;
    - `front_m`: where axle 1 of the first vehicle is at the extreme, median;
    - `concurrent` (lines,): all load effects at that instant, median;
    - `codes`: what load models of codes do in the same sense.
    """

    line: int
    name: str
    kind: str
    unit: str
    sense: Sense
    static: Quantiles
    rolling: Quantiles
    dynamic: Quantiles
    amplification: Quantiles
    front_m: float
    concurrent: np.ndarray
    codes: tuple[CodeEffect, ...] = ()

    @property
    def title(self) -> str:
        """The name, and the sense where it is not the largest value."""
        return self.name if self.sense == "largest" else f"{self.name}, {self.sense}"

    @property
    def size(self) -> float:
        """Size of the dynamic load effect, median, in its unit."""
        return abs(float(self.dynamic.q50[0]))


@dataclass(frozen=True)
class BridgeLoads(Tabular):
    """Load effects of a pass over a bridge.

    - `names`, `units` (lines,) of the influence lines; `station_m` (p,) and `influence` (lines, p) per newton;
    - `effects`: extremes of every load effect that is not next to nothing, both senses;
    - `time_s` (m,) from axle 1 at the first support; `static` (lines, m) median, `history` (lines, m) quantiles of the
      dynamic load effects over the first surface;
    - `frequency_hz` (n,) of the bridge, empty without modes; `rounds` of vehicle and deck in turn, the most of any.
    """

    bridge: str
    length_m: float
    surface: str
    vehicles: int
    gap_m: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    station_m: np.ndarray
    influence: np.ndarray
    effects: tuple[LoadEffect, ...]
    time_s: np.ndarray
    static: np.ndarray
    history: Quantiles
    frequency_hz: np.ndarray
    rounds: int

    _in_row_unit = tuple(f"{name}_{q}" for name in ("static", "rolling", "dynamic") for q in ("q05", "q50", "q95"))

    def summary(self) -> pd.DataFrame:
        """One row per load effect and sense, in SI units."""
        import pandas as pd

        count = len(self.effects)
        columns: dict[str, object] = {
            "effect": [e.name for e in self.effects],
            "sense": [e.sense for e in self.effects],
            "unit": [e.unit for e in self.effects],
        }
        for name in ("static", "rolling", "dynamic", "amplification"):
            bands = [getattr(e, name) for e in self.effects]
            of_all = (
                None if any(getattr(b, q) is None for b in bands) else np.array([getattr(b, q)[0] for b in bands])
                for q in ("q05", "q50", "q95")
            )
            columns |= band_columns(name, of_all, count)
        columns["front_m"] = [e.front_m for e in self.effects]
        for model in dict.fromkeys(c.model for e in self.effects for c in e.codes):
            of_model = [next((c.value for c in e.codes if c.model == model), np.nan) for e in self.effects]
            columns[f"over_{model}"] = np.array([e.dynamic.q50[0] for e in self.effects]) / np.array(of_model)
        return pd.DataFrame(columns)
