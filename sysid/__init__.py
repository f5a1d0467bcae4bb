"""Suspension stiffness and damping of heavy vehicles from plank drops and speed-bump runs.

The packages follow the flow of the data (`docs/architecture.md`).  The names below are loaded when they are first used;
notebooks in `examples/` show them at work.

- A whole calibration: `Calibration` with `make_settings`; every stage is a method and returns a frozen result.
- Single steps: `read_campaign`, `check_quality`, `analyse_drops`, `read_point_cloud`, `analyse_scan`,
  `effective_profiles`, `natural_modes`, `calibrated_modes`.
- Results have `summary()`, `to_pandas()` and, where they hold arrays, `to_xarray()`; figures are in `sysid.plot`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid import plot
    from sysid.campaign import Campaign, check_quality, read_campaign
    from sysid.errors import CampaignError, DataRejectedError, NotConvergedError, SysidError
    from sysid.estimates.calibrated_truck_modes import calibrated_modes
    from sysid.road import analyse_scan, effective_profiles, read_point_cloud
    from sysid.sdof import analyse_drops
    from sysid.vehicle_model import natural_modes
    from sysid.workflow import Calibration, Settings, make_settings

_HOMES = {
    "Calibration": "sysid.workflow",
    "Campaign": "sysid.campaign",
    "CampaignError": "sysid.errors",
    "DataRejectedError": "sysid.errors",
    "NotConvergedError": "sysid.errors",
    "Settings": "sysid.workflow",
    "SysidError": "sysid.errors",
    "analyse_drops": "sysid.sdof",
    "analyse_scan": "sysid.road",
    "calibrated_modes": "sysid.estimates.calibrated_truck_modes",
    "check_quality": "sysid.campaign",
    "effective_profiles": "sysid.road",
    "make_settings": "sysid.workflow",
    "natural_modes": "sysid.vehicle_model",
    "read_campaign": "sysid.campaign",
    "read_point_cloud": "sysid.road",
}

__all__ = [
    "Calibration",
    "Campaign",
    "CampaignError",
    "DataRejectedError",
    "NotConvergedError",
    "Settings",
    "SysidError",
    "analyse_drops",
    "analyse_scan",
    "calibrated_modes",
    "check_quality",
    "effective_profiles",
    "make_settings",
    "natural_modes",
    "plot",
    "read_campaign",
    "read_point_cloud",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES, submodules=("plot",))
