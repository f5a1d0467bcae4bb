"""The road of a plank drop: a wheel stands on a plank and rolls off its end."""

from __future__ import annotations

import numpy as np

from sysid.road.enveloping import FootprintMap, SpokeTable, spoke_table
from sysid.road.road_profile import RoadProfile

#: Length over which the plank's end falls off: the tread spans a gap of this size, so its exact shape is not felt.
EDGE_M = 0.01
#: Road on either side of the edge, longer than any footprint, and its stations.
_FIELD_M, _SPACING_M = 1.0, 0.002


def plank_end(height_m: float) -> RoadProfile:
    """Profile of the end of a plank, at station zero; the plank begins far enough in front of it not to be felt.

    Raises
    ------
    ValueError
        If the height is not positive.
    """
    if not height_m > 0.0:
        raise ValueError("A plank needs a positive height.")
    station = np.arange(-2.0 * _FIELD_M, 2.0 * _FIELD_M + _SPACING_M / 2, _SPACING_M)
    height = height_m * np.clip(0.5 - station / EDGE_M, 0.0, 1.0)
    return RoadProfile("plank", station, height, np.zeros_like(height), 0.0, 2.0 * _FIELD_M)


def plank_table(height_m: float, radius_m: float) -> SpokeTable:
    """Forces of a radial-spring wheel of radius R [m] around the end of a plank.

    See :func:`sysid.road.enveloping.spoke_table`.
    """
    table = spoke_table(plank_end(height_m), radius_m)
    near = np.abs(table.station_m) <= _FIELD_M + 1e-9
    return SpokeTable(
        table.radius_m,
        table.station_m[near],
        table.contact_height_m[near],
        table.deflection_m,
        table.force[near],
        table.forward_force[near],
        table.flat_force,
    )


def lifted_onto_plank(end: FootprintMap, raised_m: tuple[float, float]) -> FootprintMap:
    """Footprint map of a wheel that is lifted onto a plank slowly, rests on it and rolls off its end.

    A simulation starts from rest on the flat road; the wheel is therefore first raised to the plank over a stretch of
    road in front of its end, along a curve with continuous third derivative.  Where a wheel rolls so slowly that this
    stretch lies within the map around the end, the map begins with the road on which the wheel is raised.

    Parameters
    ----------
    end : map around the end of the plank, :func:`sysid.road.enveloping.footprint_map` of :func:`plank_table`.
    raised_m : where the wheel begins to rise and where it has risen [m], both negative.
    """
    step = float(end.station_m[1] - end.station_m[0])
    first = min(round((raised_m[0] - 0.1) / step), round(end.station_m[0] / step))
    station = np.arange(first, round(end.station_m[-1] / step) + 1) * step
    offset = station.size - end.station_m.size
    share = np.clip((station - raised_m[0]) / (raised_m[1] - raised_m[0]), 0.0, 1.0)
    rise = end.rise_m[0] * share**4 * (35.0 - share * (84.0 - share * (70.0 - 20.0 * share)))
    rise[offset:] += end.rise_m - end.rise_m[0]
    padding = [(0, 0), (offset, 0)]
    # On the plank as on the road the tire is flat: only its end has a map.
    level = (np.abs(end.rise_m) < 1e-6) | (np.abs(end.rise_m - end.rise_m[0]) < 1e-6)
    stretch, drag = (np.pad(np.where(level, 0.0, values), padding) for values in (end.stretch, end.drag))
    lift = np.pad(np.where(level, 0.0, end.lift_m), (offset, 0))
    return FootprintMap(station, rise, stretch, drag, lift, end.misfit_m)
