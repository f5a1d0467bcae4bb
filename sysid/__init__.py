"""Suspension stiffness and damping of heavy vehicles from plank drops and speed-bump runs.

The packages follow the flow of the data: campaign, sdof and road, vehicle_model, estimation, posterior, prediction and
validation, plot, export, report, workflow.  The names below are loaded when they are first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sysid.campaign import Campaign, check_quality, read_campaign
    from sysid.errors import CampaignError, DataRejectedError, NotConvergedError, SysidError
    from sysid.road import analyse_scan, read_point_cloud
    from sysid.sdof import analyse_drops
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
    "check_quality": "sysid.campaign",
    "make_settings": "sysid.workflow",
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
    "check_quality",
    "make_settings",
    "read_campaign",
    "read_point_cloud",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'sysid' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
