"""The record of everything that is derived from drops, fit and posterior without new data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sysid.tabular import Tabular

if TYPE_CHECKING:
    import pandas as pd

    from sysid.estimates.calibrated_elements import CalibratedVehicle
    from sysid.estimates.loops import SuspensionLoops
    from sysid.estimates.suspension_values import AxleEstimates, Quantity
    from sysid.road.effective import AxleRoad
    from sysid.vehicle_model.vibration_modes import NaturalModes


@dataclass(frozen=True)
class Estimates(Tabular):
    """Estimates of a campaign from the stages that have run: posterior medians, else least squares, else drops.

    - `stiffness`, `damping` of every axle from all methods;
    - `vehicles`, `modes`: suspensions and tires, and natural modes, for each load case for which there are data;
    - `loops`: force over one cycle of each suspension in every driven load case, at the least-squares values; empty if
      all laws are linear;
    - `roads`: effective profile of every axle in the first load case, by name of the bump, without bumps that have no
      height.
    """

    stiffness: tuple[AxleEstimates, ...] = ()
    damping: tuple[AxleEstimates, ...] = ()
    vehicles: tuple[CalibratedVehicle, ...] = ()
    modes: tuple[NaturalModes, ...] = ()
    loops: tuple[SuspensionLoops, ...] = ()
    roads: Mapping[str, tuple[AxleRoad, ...]] = field(default_factory=dict)

    def suspension(self, quantity: Quantity) -> tuple[AxleEstimates, ...]:
        """Estimates of one quantity, front to rear."""
        return self.stiffness if quantity == "stiffness" else self.damping

    def summary(self) -> pd.DataFrame:
        """One row per axle and, where they differ, load case: best stiffness and damping with 90 % intervals, SI."""
        import pandas as pd

        rows: dict[tuple[int, str], dict[str, object]] = {}
        for name, of_axles in (("stiffness_N_per_m", self.stiffness), ("damping_N_s_per_m", self.damping)):
            for one in of_axles:
                if one.best is not None:
                    row = rows.setdefault((one.axle + 1, one.load_case or ""), {})
                    row |= {name: one.best.value, f"{name}_q05": one.best.low, f"{name}_q95": one.best.high}
                    row[f"{name}_source"] = one.best.source
        head = ("axle", "load_case")
        return pd.DataFrame([dict(zip(head, key, strict=True)) | row for key, row in sorted(rows.items())])
