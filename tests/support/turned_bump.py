"""The rigid truck over a bump that lies off square, with sensors on one side."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from rigid_truck import SENSORS, bump, campaign, empty_run, true_log_parameters

from sysid.campaign.records import Campaign, Scan, Sensor
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.road.road_profile import RoadProfile, SideProfiles

SKEW_RAD, AT_M = np.radians(2.0), 0.95
MOTION = RunMotion.steady(np.array([4.0, 4.2]), np.array([0.4, 0.45]))
RIGHT = tuple(replace(s, side="right") if s.axle == 0 or s.body is not None else s for s in SENSORS)


def turned() -> RoadProfile:
    """The bump, met by the left wheels first."""
    profile = bump(height_m=0.03)
    moved = AT_M * np.tan(SKEW_RAD)
    left, right = (np.interp(profile.station_m + s * moved, profile.station_m, profile.height_m) for s in (1.0, -1.0))
    return replace(profile, sides=SideProfiles(left, right, AT_M, float(SKEW_RAD)))


@lru_cache(maxsize=2)
def made(sensors: tuple[Sensor, ...]) -> tuple[Campaign, BumpModel, np.ndarray]:
    runs = [empty_run(name, v, sensors=sensors) for name, v in (("one.csv", 4.0), ("two.csv", 4.2))]
    data = replace(campaign(runs), scans={"bump": Scan("bump", "scan.csv", 0.0, np.empty((0, 3)))})
    parameters = campaign_parameters(data, None)
    return data, bump_model(data, parameters, {"bump": turned()}), true_log_parameters(parameters.names)
