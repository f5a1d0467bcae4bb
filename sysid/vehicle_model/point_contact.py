"""A measured road of any length as the road of point followers."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Stations
from sysid.errors import SysidError
from sysid.vehicle_model.contact import EffectiveRoad, effective_road

#: Stations of the road table [m].
STEP_M = 0.01


def measured_road(
    station_m: Stations, height_m: Stations, axles: int, *, footprint_m: float = 0.0, lead_m: float = 0.0
) -> EffectiveRoad:
    """Road of point followers on a measured profile: straight between its points, averaged over the footprint.

    W(s) = (1 / b) integral of z over [s - b/2, s + b/2], z piecewise linear; b = 0 is z itself.  A moving average of
    b = 250 mm stands for the tire's contact patch in the International Roughness Index (M. W. Sayers, "On the
    calculation of International Roughness Index from longitudinal road profile", Transportation Research Record 1501,
    1995).

    Parameters
    ----------
    station_m, height_m : (n,) measured points [m], any spacing; heights count from the lead's.
    axles : number of axles that follow it, na.
    footprint_m : length b [m].
    lead_m : length of straight road added in front, with the mean slope of the profile's first 11 m, on which a
        vehicle that starts from rest settles [m].

    Returns
    -------
    EffectiveRoad with `rise` (1, na, stations), zero at its first station; behind the last one the road drops to zero.

    Raises
    ------
    SysidError
        If there are fewer than two points, stations do not increase, or a value is not finite.
    """
    s, z = np.asarray(station_m, float), np.asarray(height_m, float)
    if s.ndim != 1 or s.shape != z.shape or s.size < 2:
        raise SysidError(f"A measured road needs two points or more as (n,) arrays, got {s.shape} and {z.shape}.")
    if not (np.isfinite(s).all() and np.isfinite(z).all() and (np.diff(s) > 0).all()):
        worst = int(np.argmin(np.where(np.isfinite(s[1:]) & np.isfinite(z[1:]), np.diff(s), -np.inf))) + 1
        raise SysidError(
            f"Point {worst + 1} of the measured road ({s[worst]:g} m, {z[worst]:g} m) does not follow the one before; "
            "stations must increase and all values be finite."
        )
    if lead_m > 0.0:
        reach = min(s[0] + 11.0, s[-1])
        slope = (np.interp(reach, s, z) - z[0]) / (reach - s[0])
        s, z = np.concatenate([[s[0] - lead_m], s]), np.concatenate([[z[0] - slope * lead_m], z])
    grid = s[0] + np.arange(int(np.floor((s[-1] - s[0]) / STEP_M)) + 1) * STEP_M
    rise = np.interp(grid, s, z) if footprint_m <= 0.0 else _average(s, z, grid, footprint_m)
    return effective_road(grid, np.tile(rise - rise[0], (1, axles, 1)))


def _average(s: np.ndarray, z: np.ndarray, at: np.ndarray, length: float) -> np.ndarray:
    """Mean of the piecewise linear z over [at - length/2, at + length/2], z constant beyond its ends."""
    area = np.concatenate([[0.0], np.cumsum(0.5 * (z[1:] + z[:-1]) * np.diff(s))])

    def integral(x: np.ndarray) -> np.ndarray:
        inside = np.clip(x, s[0], s[-1])
        k = np.clip(np.searchsorted(s, inside, side="right") - 1, 0, s.size - 2)
        part = inside - s[k]
        slope = (z[k + 1] - z[k]) / (s[k + 1] - s[k])
        return np.asarray(area[k] + part * (z[k] + 0.5 * slope * part) + np.where(x < s[0], z[0], z[-1]) * (x - inside))

    return np.asarray((integral(at + 0.5 * length) - integral(at - 0.5 * length)) / length)
