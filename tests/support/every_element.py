"""A rigid truck whose suspensions have, between them, every element of the laws."""

from __future__ import annotations

from dataclasses import replace

import rigid_truck
from rigid_truck import campaign, empty_run

from sysid.campaign.priors import NamedPrior
from sysid.campaign.records import AntiAliasFilter, Campaign
from sysid.campaign.vehicle_records import AxleGroup, Equaliser, ForceTable, FrameBending


def campaign_with_every_element(
    joined: str, *, runs: int = 1, samples: int = 220, antialias: AntiAliasFilter | None = rigid_truck.FILTER
) -> Campaign:
    """Friction, stops, asymmetric damper in bushings in front; gas spring, helper leaves that rub, lash, tables behind.

    Parameters
    ----------
    joined : what the axles behind stand on, "beam", "equaliser", or "equaliser and bending frame".
    """
    spring = ForceTable((-0.1, -0.01, 0.01, 0.1), (-3.5e4, -3e3, 3e3, 4e4))
    damper = ForceTable((-1.0, -0.2, 0.1, 1.0), (-8e3, -3e3, 2e3, 9e3))
    first, second, third = rigid_truck.AXLES
    axles = (
        replace(
            first,
            suspension_law="friction + damper_bushing + asymmetric_damper + bump_stops",
            jounce_travel_m=0.02,
            rebound_travel_m=0.025,
        ),
        replace(
            second,
            suspension_law="gas_spring + leaf_friction + helper_spring + hanger_lash + spring_table + damper_table",
            hanger_lash_m=0.01,
            spring_table=spring,
            damper_table=damper,
        ),
        third,
    )
    if joined == "beam":
        vehicle = replace(rigid_truck.VEHICLE, axles=axles, groups=(AxleGroup("bogie", (1, 2), 300.0, 90.0),))
        load = replace(rigid_truck.EMPTY, sprung_mass_kg=(rigid_truck.EMPTY.sprung_mass_kg[0] - 300.0,))
    else:
        vehicle = replace(rigid_truck.VEHICLE, axles=axles, equalisers=(Equaliser("tandem", (1, 2)),))
        load = rigid_truck.EMPTY
        if "bending" in joined:
            vehicle = replace(vehicle, bodies=(replace(vehicle.bodies[0], bending=FrameBending(8.0, 0.03)),))
    driven = [empty_run(f"{k}.csv", 7.0 + k, samples=samples) for k in range(runs)]
    made = campaign(driven, vehicle=vehicle, load_cases=(load,), antialias=antialias)
    # Within what the pass reaches.
    return replace(made, priors={"helper_travel_2": NamedPrior(0.004, 0.5, "m")})
