"""Road profiles of bumps that the campaign or the command line names."""

from __future__ import annotations

import numpy as np

from sysid.campaign.records import BumpShape
from sysid.campaign.requests import shape_fault
from sysid.errors import CampaignError
from sysid.road.road_profile import RoadProfile
from sysid.road.shapes import half_sine, parabolic, profile_from_points, raised_cosine, trapezoid, watts

_SIZED = {"watts": watts, "sinusoidal": raised_cosine, "half_sine": half_sine, "parabolic": parabolic}


def named_shape(shape: BumpShape) -> RoadProfile:
    """Profile of a bump by name and size.

    ``sinusoidal`` is the raised cosine h / 2 (1 - cos(2 pi s / L)) of sinusoidal road humps, ``half_sine``
    h sin(pi s / L); points are joined by straight lines.

    Raises
    ------
    CampaignError
        If the size is missing or makes no bump.
    """
    if shape.name == "points":
        return profile_from_points(np.array(shape.station_m), np.array(shape.heights_m), name=shape.label)
    if shape.height_m is None or shape.length_m is None:
        raise CampaignError(f"A {shape.name} bump {shape_fault(shape)}.")
    if shape.name == "trapezoid":
        return trapezoid(shape.height_m, shape.length_m, top_m=shape.top_m, name=shape.label)
    return _SIZED[shape.name](shape.height_m, shape.length_m, name=shape.label)
