"""All contact laws, and two simpler than radial springs: the effective road follows from the geometry alone.

The simpler ones give a :class:`sysid.road.enveloping.FootprintMap` without stretch: the tire carries what a flat road
at the effective height would make it carry, and its force stands at right angles to the effective slope.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sysid.road.enveloping import MAP_STEP_M, FootprintMap, map_stations
from sysid.road.road_profile import RoadProfile

ContactLaw = Literal["footprint", "cams", "point"]

#: Shape of the cams for ordinary tires: spacing as a share of the contact length, half axes as multiples of the radius,
#: exponent of the ellipse (A. J. C. Schmeitz, A semi-empirical three-dimensional model of the pneumatic tyre rolling
#: over arbitrarily uneven road surfaces, doctoral thesis, TU Delft, 2004).
CAM_SPACING = 0.8
CAM_AXIS = 1.0
CAM_EXPONENT = 1.8
#: Points of a cam at which it may touch the road.
_FINE_M = 0.001


def _stations(profile: RoadProfile, reach_m: float) -> np.ndarray:
    return map_stations(profile.station_m - profile.start_m, reach_m)


def _height(profile: RoadProfile, station_m: np.ndarray) -> np.ndarray:
    return np.asarray(np.interp(station_m, profile.station_m - profile.start_m, profile.height_m, left=0.0, right=0.0))


def _map(station: np.ndarray, rise: np.ndarray, slope: np.ndarray) -> FootprintMap:
    none = np.zeros((3, station.size))
    drag = np.stack([-slope, none[0], none[0]])
    return FootprintMap(station, rise, none, drag, np.zeros_like(rise), 0.0)


def point_map(profile: RoadProfile) -> FootprintMap:
    """The wheel centre follows the road point below it: height h(s), forward over vertical force -h'(s)."""
    station = _stations(profile, 0.0)
    rise = _height(profile, station)
    return _map(station, rise, np.gradient(rise, MAP_STEP_M))


def cam_map(profile: RoadProfile, radius_m: float, deflection_m: float) -> FootprintMap:
    """Two elliptical cams, one at each end of the contact length, ride over the road as rigid bodies.

    The cam (|x| / a)^n + (|z| / b)^n = 1 touches the road from above at the height z_c(s); with the spacing l the
    effective height is (z_c(s + l/2) + z_c(s - l/2)) / 2 and the effective slope (z_c(s + l/2) - z_c(s - l/2)) / l.

    Parameters
    ----------
    profile : the bump, zero road outside.
    radius_m : wheel radius R; a = b = R.
    deflection_m : static deflection u, for the contact length 2 sqrt(2 R u - u^2).
    """
    half = CAM_AXIS * radius_m
    spacing = CAM_SPACING * 2.0 * float(np.sqrt(max(2.0 * radius_m * deflection_m - deflection_m**2, 1e-8)))
    offset = np.arange(-round(half / _FINE_M) + 1, round(half / _FINE_M)) * _FINE_M
    below = half * (1.0 - (np.abs(offset) / half) ** CAM_EXPONENT) ** (1.0 / CAM_EXPONENT) - half

    def cam(station: np.ndarray) -> np.ndarray:
        height: np.ndarray = (_height(profile, station[:, None] + offset) + below).max(axis=1)
        return height

    station = _stations(profile, half + spacing)
    front, rear = cam(station + spacing / 2.0), cam(station - spacing / 2.0)
    return _map(station, 0.5 * (front + rear), (front - rear) / spacing)


@dataclass(frozen=True)
class ContactKind:
    """A contact law: its `meaning` for the user, and the `other` law that represents what it may leave out.

    `geometric_map` makes the map of a tire from the bump's profile, the wheel's radius and the static deflection [m];
    None for radial springs, whose map follows the tires' stiffness (:mod:`sysid.road.enveloping`).
    """

    meaning: str
    other: ContactLaw
    geometric_map: Callable[[RoadProfile, float, float], FootprintMap] | None = None

    @property
    def follows_tires(self) -> bool:
        """Whether its maps are made again for tires as estimated; other laws have those of the declared tires."""
        return self.geometric_map is None


CONTACT_LAWS: dict[ContactLaw, ContactKind] = {
    "footprint": ContactKind("footprint map of radial springs, power-law stiffening, forward force", "cams"),
    "cams": ContactKind("tandem elliptical cams, power-law stiffening, forward force", "footprint", cam_map),
    "point": ContactKind(
        "point follower, power-law stiffening, forward force",
        "footprint",
        lambda profile, radius_m, deflection_m: point_map(profile),
    ),
}
