"""Road profiles from analytic bump shapes or from surveyed points, on uniform stations."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.interpolate import PchipInterpolator

from sysid.arrays import Stations
from sysid.campaign.records import BumpShape
from sysid.campaign.requests import START_HEIGHT_M, STATION_STEP_M, points_fault, shape_fault, size_fault
from sysid.errors import CampaignError
from sysid.road.road_profile import RoadProfile

#: Flat road before and behind a shape.
FLAT_M = 0.3


def make_profile(
    station_m: Stations, height_m: Stations, *, height_sd_m: Stations | None = None, name: str = "bump"
) -> RoadProfile:
    """Return the profile with its start and length read off the heights.

    `station_m` (n,) [m] uniformly spaced and starting at 0; `height_m` (n,) [m]; `height_sd_m` (n,) [m], zeros if None.
    Raises CampaignError where the stations are not uniform or nothing rises above 1 mm.
    """
    station = np.asarray(station_m, dtype=np.float64)
    height = np.asarray(height_m, dtype=np.float64)
    sd = np.zeros_like(height) if height_sd_m is None else np.asarray(height_sd_m, dtype=np.float64)
    if station.ndim != 1 or station.size < 3 or height.shape != station.shape or sd.shape != station.shape:
        raise CampaignError(
            f"Profile '{name}' has {station.size} stations, {height.size} heights and {sd.size} standard errors; "
            "three or more of each and equally many are expected."
        )
    if not (np.all(np.isfinite(station)) and np.all(np.isfinite(height)) and np.all(np.isfinite(sd))):
        raise CampaignError(f"Profile '{name}' holds values that are not numbers; remove or replace those points.")
    step = np.diff(station)
    if abs(station[0]) > 1e-12 or step[0] <= 0 or np.ptp(step) > 1e-6 * step[0]:
        raise CampaignError(
            f"The stations of profile '{name}' are not uniform from 0 upward; resample them with profile_from_points."
        )
    above = np.flatnonzero(height > START_HEIGHT_M)
    if above.size == 0:
        raise CampaignError(
            f"Profile '{name}' nowhere rises above 1 mm (maximum {1e3 * height.max():.2f} mm); give heights in metres."
        )
    start = float(station[above[0]])
    return RoadProfile(
        name=name,
        station_m=station,
        height_m=height,
        height_sd_m=sd,
        start_m=start,
        length_m=float(station[above[-1]]) - start,
    )


def raised_cosine(height_m: float, length_m: float, *, name: str = "bump") -> RoadProfile:
    """Return z(s) = h/2 (1 - cos(2 pi s/L)): height h [m], length L [m], no kink at its ends.

    Stations every `STATION_STEP_M`, `FLAT_M` of flat road on either side.  Raises CampaignError for sizes that are not
    positive.
    """
    station, u = _stations(height_m, length_m, name)
    return make_profile(station, np.where(_inside(u), 0.5 * height_m * (1 - np.cos(2 * np.pi * u)), 0.0), name=name)


def half_sine(height_m: float, length_m: float, *, name: str = "bump") -> RoadProfile:
    """Return z(s) = h sin(pi s/L): height h [m], length L [m]; arguments and errors as :func:`raised_cosine`."""
    station, u = _stations(height_m, length_m, name)
    return make_profile(station, np.where(_inside(u), height_m * np.sin(np.pi * u), 0.0), name=name)


def parabolic(height_m: float, length_m: float, *, name: str = "bump") -> RoadProfile:
    """Return z(s) = 4 h s/L (1 - s/L): height h [m], length L [m]; arguments and errors as :func:`raised_cosine`."""
    station, u = _stations(height_m, length_m, name)
    return make_profile(station, np.where(_inside(u), 4 * height_m * u * (1 - u), 0.0), name=name)


def trapezoid(height_m: float, length_m: float, *, top_m: float | None = None, name: str = "bump") -> RoadProfile:
    """Return a flat-topped hump with straight ramps: height [m], length over all [m], flat top `top_m` (a third of it).

    Other arguments as :func:`raised_cosine`, CampaignError also where the top is longer than the bump.
    """
    _refuse(shape_fault(BumpShape("trapezoid", height_m, length_m, top_m)), name)
    top = length_m / 3 if top_m is None else top_m
    station, u = _stations(height_m, length_m, name)
    ramp = (length_m - top) / 2
    distance_to_end = np.minimum(u, 1 - u) * length_m
    return make_profile(station, height_m * np.clip(distance_to_end / ramp, 0.0, 1.0), name=name)


def watts(height_m: float = 0.076, length_m: float = 3.66, *, name: str = "bump") -> RoadProfile:
    """Return the circular-arc (Watts) hump: z(s) = sqrt(R^2 - (s - L/2)^2) - (R - h) with R = (L^2/4 + h^2)/(2 h).

    Height h [m] and chord length L [m], by default 76 mm on 3.66 m; other arguments and errors as
    :func:`raised_cosine`.  Raises CampaignError where the hump would be more than a half circle.
    """
    _refuse(shape_fault(BumpShape("watts", height_m, length_m)), name)
    station, u = _stations(height_m, length_m, name)
    radius = (length_m**2 / 4 + height_m**2) / (2 * height_m)
    half_chord = np.minimum(np.abs(u - 0.5) * length_m, length_m / 2)
    arc = np.sqrt(radius**2 - half_chord**2) - (radius - height_m)
    return make_profile(station, np.where(_inside(u), np.maximum(arc, 0.0), 0.0), name=name)


def profile_from_points(
    station_m: Stations,
    height_m: Stations,
    *,
    kind: Literal["linear", "pchip"] = "linear",
    name: str = "bump",
) -> RoadProfile:
    """Return the profile through surveyed points, with `FLAT_M` of flat road put before and behind them.

    `station_m`, `height_m` (n,) [m], stations increasing, heights within 1 mm of the road at both ends.  `kind`:
    ``linear`` joins the points by straight lines, ``pchip`` by a shape-preserving cubic (no overshoot).
    Raises CampaignError for points that are not increasing, not numbers, not down on the road at the ends, or no bump
    in metres.
    """
    station = np.asarray(station_m, dtype=np.float64)
    height = np.asarray(height_m, dtype=np.float64)
    _refuse(points_fault(station, height), name)
    length = float(station[-1] - station[0])
    grid, u = _stations(float(np.max(np.abs(height))), length, name)
    along = station - station[0]
    query = np.clip(u * length, 0.0, length)
    inside = _inside(u)
    values = PchipInterpolator(along, height)(query) if kind == "pchip" else np.interp(query, along, height)
    return make_profile(grid, np.where(inside, values, 0.0), name=name)


def _refuse(fault: str, name: str) -> None:
    if fault:
        raise CampaignError(f"Profile '{name}' {fault}.")


def _stations(height_m: float, length_m: float, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return uniform stations and the same as a fraction of the bump's length."""
    _refuse(size_fault(height_m, length_m), name)
    before = int(np.ceil(FLAT_M / STATION_STEP_M - 1e-9))
    count = before + int(np.ceil((length_m + FLAT_M) / STATION_STEP_M - 1e-9)) + 1
    station = STATION_STEP_M * np.arange(count)
    return station, (station - before * STATION_STEP_M) / length_m


def _inside(fraction: np.ndarray) -> np.ndarray:
    # A station that rounding puts a hair outside still belongs to the bump.
    return (fraction >= -1e-9) & (fraction <= 1 + 1e-9)
