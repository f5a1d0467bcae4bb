"""Effective profile of a bump for the tires of every axle: its height smoothed by the tire's own footprint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.road.enveloping import effective_profile, spoke_table
from sysid.road.road_profile import RoadProfile


@dataclass(frozen=True)
class AxleRoad:
    """Effective profile of one axle (index): `rise_m` (n,) of the wheel centre over `station_m` (n,) from the start of
    the bump that keeps the tire force at the static axle load.
    """

    axle: int
    station_m: np.ndarray
    rise_m: np.ndarray


def effective_profiles(
    vehicle: Vehicle, load_case: LoadCase, reference: LoadCase, profile: RoadProfile
) -> tuple[AxleRoad, ...]:
    """Effective profile of every axle over one bump at its static load, tires as radial springs.

    Parameters
    ----------
    load_case : static axle loads that are held constant.
    reference : load case at whose axle loads the tire stiffnesses are declared, the first of the campaign.

    Source: radial springs of D. C. Davis (1975), doi:10.1080/00423117508968461.
    """
    made = {radius: spoke_table(profile, radius) for radius in {a.tire_radius_m for a in vehicle.axles}}
    roads = []
    for i, axle in enumerate(vehicle.axles):
        load, declared = (case.axle_loads_kg[i] * vehicle.gravity_m_s2 for case in (load_case, reference))
        station, rise = effective_profile(made[axle.tire_radius_m], load, declared, axle.tire_stiffness_N_per_m)
        roads.append(AxleRoad(i, station, rise))
    return tuple(roads)
