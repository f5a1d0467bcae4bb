"""Predicted passes that nobody drove."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.arrays import Axles, AxlesBySamples, Samples
from sysid.campaign.requests import MARGIN
from sysid.prediction.bridge_effects import BridgeLoads
from sysid.prediction.quantiles import Quantiles
from sysid.prediction.trust import Extrapolation
from sysid.road.road_profile import ProfileIdentity
from sysid.tabular import Tabular, band_columns

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True)
class RoadLoads:
    """What axle loads over a rough road do to it.

    - `load_95_N`, `load_99_N` (axles,): load that the axle exceeds on 5 % and on 1 % of the road [N];
    - `road_stress` (axles,): mean of (F / F_0)^q over the road, F_0 the load at rest, with the exponent q;
    - `vehicle_stress`: the same of the whole vehicle, sum_i mean F_i^q / sum_i F_0i^q;
    - `aggregate_95`: sum_i F_i(s)^q / sum_i F_0i^q that 5 % of the stations s exceed, all axles at one station;
    - `roughness_index_mm_m` (IRI), `density_m3` (G_d(n_0) of ISO 8608) and `road_class` of the road, means over tracks
      and realisations; None where it is too short;
    - `spectrum_N2_Hz` (axles, m): one-sided power spectral density of the axle load at `frequency_hz` (m,);
    - `tire_ranges_per_km`, `suspension_ranges_per_km` (axles, k): how often per kilometre the force goes to and fro by
      more than `range_levels` (k,) times the load at rest (rainflow), on the first realisation, of few draws;
    - `aggregate_N` (p, d): sum of all axle loads that pass `station_m` (p,) on the first realisation, of d draws.
    """

    load_95_N: Quantiles
    load_99_N: Quantiles
    road_stress: Quantiles
    vehicle_stress: Quantiles
    aggregate_95: Quantiles
    exponent: float
    length_m: float
    realisations: int
    roughness_index_mm_m: float
    density_m3: float | None
    road_class: str | None
    frequency_hz: np.ndarray
    spectrum_N2_Hz: Quantiles
    range_levels: np.ndarray
    tire_ranges_per_km: Quantiles
    suspension_ranges_per_km: Quantiles
    station_m: np.ndarray
    aggregate_N: np.ndarray


#: Sides of the truck, in the order of :class:`WheelLoads`.
SIDES = ("left", "right")


@dataclass(frozen=True)
class WheelLoads:
    """Loads of the wheels of either side, left first, twin tires together.

    `static_N`, `peak_N` (2, axles) at rest and largest of the pass; `force_N` (2, axles, n) their course, all [N].
    """

    static_N: Quantiles
    peak_N: Quantiles
    force_N: Quantiles

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the sides, in the order of the loads."""
        return SIDES

    def heaviest(self, axle_load_N: Axles) -> tuple[int, int]:
        """Side and axle of the wheel whose peak is largest over half the static load of its axle (axles,) [N]."""
        side, axle = np.unravel_index(int(np.argmax(self.peak_N.q50 / axle_load_N)), self.peak_N.q50.shape)
        return int(side), int(axle)

    def of_side(self, side: int) -> WheelLoads:
        """The loads of one side, (axles,) and (axles, n), by its place in :data:`SIDES`."""
        return WheelLoads(*(q.at(side) for q in (self.static_N, self.peak_N, self.force_N)))


@dataclass(frozen=True)
class PassPrediction(Tabular):
    """Axle loads of one pass with posterior bands.

    - `time_s` (n,): zero when the centre of axle 1 passes the start of the bump;
    - `tire_force_*_N` (axles, n): total vertical force, pointwise quantiles (q05/q95 None before sampling);
    - `static_load_N` (axles,);
    - `peak_ratio_*` (axles,): quantiles of the peak dynamic load ratio per draw (q05/q95 None before sampling);
    - `lift_off` (axles,) bool: True where the wheels leave the road in at least half of the draws.

    - `suspension_force_N` (axles, n): force of spring, damper and friction together on the body, positive in
      compression, static load included (of an axle group at its first axle);
    - `load_coefficient` (axles,): RMS of force less static load, over static load, from the axle's first contact to the
      end of its ringing;
    - `lift_off_s` (axles,): time off the ground;
    - `jounce_m`, `rebound_m` (axles,): largest compression and extension from rest;
    - `impulse_ratio` (axles,): mean force during the pass over static load.

    `shape` names a bump that no run crossed, or the scanned one where there are several; else it is empty.  `profile`
    tells its profile from others (None if it is not known).

    - `bridge`: load effects of a pass over a bridge, None for others.  `time_s` counts from axle 1 at the first
      support; axle loads are those of the first vehicle;
    - `road`: measures of a pass over a rough road, None for others.  `time_s` counts from where axle 1 meets the road.
      With several realisations forces are those of the first, and peaks the largest of all;
    - `wheels`: loads of left and right wheels, None where the fit knows nothing of roll;
    - `trust` lists what goes beyond the driven runs, empty if nothing does;
    - `beyond` (axles, n) bool: instants at which tire deflection, travel or damper speed go beyond them in at least
      half of the draws, or at which a wheel is off the ground that never was in the runs. None if the driven runs are
      not known.
    """

    load_case: str
    speed_m_s: float
    time_s: Samples
    tire_force_q05_N: AxlesBySamples | None
    tire_force_q50_N: AxlesBySamples
    tire_force_q95_N: AxlesBySamples | None
    static_load_N: Axles
    peak_ratio_q05: Axles | None
    peak_ratio_q50: Axles
    peak_ratio_q95: Axles | None
    lift_off: Axles
    warnings: tuple[str, ...] = ()
    suspension_force_N: Quantiles | None = None
    load_coefficient: Quantiles | None = None
    lift_off_s: Quantiles | None = None
    jounce_m: Quantiles | None = None
    rebound_m: Quantiles | None = None
    impulse_ratio: Quantiles | None = None
    shape: str = ""
    trust: tuple[Extrapolation, ...] = ()
    beyond: np.ndarray | None = None
    profile: ProfileIdentity | None = None
    road: RoadLoads | None = None
    bridge: BridgeLoads | None = None
    wheels: WheelLoads | None = None

    @property
    def axle_load_kN(self) -> Quantiles:
        """Quantiles of the peak load of every axle, both sides together, (axles,) [kN]."""
        return self.peak_ratio.times(1e-3 * self.static_load_N)

    @property
    def peak_ratio(self) -> Quantiles:
        """Quantiles of the peak dynamic load ratio, (axles,)."""
        return Quantiles(self.peak_ratio_q05, self.peak_ratio_q50, self.peak_ratio_q95)

    @property
    def tire_force_N(self) -> Quantiles:
        """Pointwise quantiles of the total vertical tire force, (axles, n) [N]."""
        return Quantiles(self.tire_force_q05_N, self.tire_force_q50_N, self.tire_force_q95_N)

    def summary(self) -> pd.DataFrame:
        """Peak load [N] and dynamic load ratio of every axle."""
        return Predictions((self,), "").summary()

    def to_pandas(self) -> pd.DataFrame:
        """Time [s] and per axle the vertical tire force and the suspension force [N] with their quantiles."""
        import pandas as pd

        forces = {"tire_force": self.tire_force_N, "suspension_force": self.suspension_force_N}
        columns = {"time_s": self.time_s}
        for name, bands in forces.items():
            if bands is None:
                continue
            for axle in range(len(self.static_load_N)):
                of_axle = (None if b is None else b[axle] for b in (bands.q05, bands.q50, bands.q95))
                columns |= band_columns(f"{name}{axle + 1}_N", of_axle, len(self.time_s))
        return pd.DataFrame(columns)

    def to_xarray(self) -> xr.Dataset:
        """Vertical tire force and static load [N] over ``quantile``, ``axle`` (from 1) and ``time_s``."""
        import xarray as xr

        force = self.tire_force_N
        bands = {q: v for q, v in ((0.05, force.q05), (0.5, force.q50), (0.95, force.q95)) if v is not None}
        return xr.Dataset(
            {
                "tire_force_N": (("quantile", "axle", "time_s"), np.array(list(bands.values()))),
                "static_load_N": ("axle", self.static_load_N),
            },
            {"quantile": list(bands), "axle": np.arange(len(self.static_load_N)) + 1, "time_s": self.time_s},
            {"load_case": self.load_case, "speed_m_s": self.speed_m_s, "shape": self.shape},
        )


@dataclass(frozen=True)
class SpeedSweep(Tabular):
    """Peak dynamic load ratio and dynamic load coefficient of one load case against speed, (speeds, axles).

    - `driven_m_s` are the lowest and the highest nominal speed of the runs in this load case, None without any;
    - `beyond` (speeds, axles) bool: whether tire deflection, travel or damper speed goes beyond the driven runs, or a
      wheel lifts off that never did. None if the driven runs are not known.
    """

    load_case: str
    bump: str
    speed_m_s: np.ndarray
    peak_ratio: Quantiles
    load_coefficient: Quantiles
    driven_m_s: tuple[float, float] | None
    beyond: np.ndarray | None = None

    @property
    def extrapolated(self) -> np.ndarray:
        """Speeds (m,) at which no run of the load case was as fast, bool."""
        fastest = 0.0 if self.driven_m_s is None else MARGIN * self.driven_m_s[1]
        return np.asarray(self.speed_m_s > fastest)

    def summary(self) -> pd.DataFrame:
        """One row per speed and axle."""
        import pandas as pd

        speeds, axles = self.peak_ratio.q50.shape
        columns = {
            "load_case": self.load_case,
            "bump": self.bump,
            "speed_m_s": np.repeat(self.speed_m_s, axles),
            "axle": np.tile(np.arange(axles) + 1, speeds),
        }
        for name in ("peak_ratio", "load_coefficient"):
            bands = getattr(self, name)
            flat = (None if b is None else b.ravel() for b in (bands.q05, bands.q50, bands.q95))
            columns |= band_columns(name, flat, speeds * axles)
        return pd.DataFrame(columns | {"extrapolated": np.repeat(self.extrapolated, axles)})


@dataclass(frozen=True)
class Predictions(Tabular):
    """All predicted passes of a campaign; `source` is ``posterior`` or ``least squares``.

    `sweeps` hold the load ratio against speed, one per load case that is predicted.
    """

    passes: tuple[PassPrediction, ...]
    source: str
    sweeps: tuple[SpeedSweep, ...] = ()

    def summary(self) -> pd.DataFrame:
        """Peak load [N] and dynamic load ratio of every axle and pass."""
        import pandas as pd

        rows = []
        for p in self.passes:
            ratios = {"q05": p.peak_ratio_q05, "q50": p.peak_ratio_q50, "q95": p.peak_ratio_q95}
            for i, static_N in enumerate(p.static_load_N):
                of_axle = {q: None if ratio is None else ratio[i] for q, ratio in ratios.items()}
                rows.append(
                    {
                        "load_case": p.load_case,
                        "speed_m_s": p.speed_m_s,
                        "axle": i + 1,
                        "static_load_N": static_N,
                        **{f"peak_load_N_{q}": None if r is None else r * static_N for q, r in of_axle.items()},
                        **{f"peak_ratio_{q}": r for q, r in of_axle.items()},
                        "lift_off": bool(p.lift_off[i]),
                        "load_coefficient_q50": None if p.load_coefficient is None else p.load_coefficient.q50[i],
                        "lift_off_s_q50": None if p.lift_off_s is None else p.lift_off_s.q50[i],
                    }
                )
        return pd.DataFrame(rows)
