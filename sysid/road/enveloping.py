"""What a rolling tire feels of a road profile: radial springs and the effective profile at constant load.

A wheel of radius R rolls with its centre at station s and height h.  Each spoke of the lower half, at the angle phi
from the vertical, meets the road at the distance rho(phi); its spring is shorter by R - rho and pushes along the spoke
with a force proportional to (R - rho)^p.  Summed over the spokes this gives the vertical force of the tire on any road
shape (D. C. Davis, A radial-spring terrain-enveloping tire model, Vehicle System Dynamics 4 (1975),
doi:10.1080/00423117508968461).  Its stiffness is fixed by the tire's declared vertical stiffness on a flat road.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from sysid.road.results import RoadProfile

#: Exponent of a single spoke; on a flat road the force grows with about deflection^(SPOKE_EXPONENT + 1/2).
SPOKE_EXPONENT = 0.7

_SPOKES = 161
_HALF_ANGLE_RAD = np.deg2rad(60.0)
_LEVELS = 24
_DEEPEST_PER_RADIUS = 0.24
_STATION_STEP_M = 0.01


@dataclass(frozen=True)
class SpokeTable:
    """Vertical force of a unit-stiffness radial-spring wheel over one profile.

    `station_m` (n,) of the wheel centre from the start of the bump; `contact_height_m` (n,) centre height at first
    contact; `deflection_m` (m,) below first contact; `force` (n, m) for unit spoke stiffness; `flat_force` (m,) the
    same on a flat road.
    """

    radius_m: float
    station_m: np.ndarray
    contact_height_m: np.ndarray
    deflection_m: np.ndarray
    force: np.ndarray
    flat_force: np.ndarray


def spoke_table(profile: RoadProfile, radius_m: float, *, exponent: float = SPOKE_EXPONENT) -> SpokeTable:
    """Tabulate the vertical force of radial springs over a profile, by station and deflection.

    Parameters
    ----------
    profile : the bump, zero road outside.
    radius_m : wheel radius R [m].
    exponent : exponent p of the spoke law [-].
    """
    reach = radius_m * np.sin(_HALF_ANGLE_RAD)
    first = profile.station_m[0] - profile.start_m - reach - 0.1
    last = profile.station_m[-1] - profile.start_m + reach + 0.1
    station = np.arange(np.floor(first / _STATION_STEP_M), np.ceil(last / _STATION_STEP_M) + 1) * _STATION_STEP_M
    angle = np.linspace(-_HALF_ANGLE_RAD, _HALF_ANGLE_RAD, _SPOKES)
    deflection = _DEEPEST_PER_RADIUS * radius_m * np.linspace(0.0, 1.0, _LEVELS) ** 1.5
    road_s, road_z = profile.station_m - profile.start_m, profile.height_m

    tread = np.interp(station[:, None] + radius_m * np.sin(angle), road_s, road_z, left=0.0, right=0.0)
    contact = np.maximum((tread + radius_m * np.cos(angle)).max(axis=1), radius_m)
    height = contact[:, None] - deflection[None, :]
    force = _spoke_sum(station, height, angle, radius_m, exponent, road_s, road_z)
    flat = _spoke_sum(np.zeros(1), (radius_m - deflection)[None, :], angle, radius_m, exponent, road_s, 0.0 * road_z)
    return SpokeTable(radius_m, station, contact, deflection, force, flat[0])


def _spoke_sum(station, height, angle, radius, exponent, road_s, road_z) -> np.ndarray:
    """Vertical force (stations, levels) of all spokes for given centre heights (stations, levels)."""
    total = np.zeros_like(height)
    for phi in angle:
        sin, cos = np.sin(phi), np.cos(phi)
        # Bisection along the spoke: above the road at the hub, possibly below it at the undeformed tread.
        low = np.zeros_like(height)
        high = np.full_like(height, radius)
        for _ in range(22):
            middle = 0.5 * (low + high)
            road = np.interp(station[:, None] + middle * sin, road_s, road_z, left=0.0, right=0.0)
            below = height - middle * cos < road
            high = np.where(below, middle, high)
            low = np.where(below, low, middle)
        compression = np.maximum(radius - 0.5 * (low + high), 0.0)
        compression[compression < 1e-6 * radius] = 0.0
        total += cos * compression**exponent
    return total * (angle[1] - angle[0])


def static_deflection(table: SpokeTable, load_N: float, stiffness_N_per_m: float) -> float:
    """Deflection [m] at which a flat road carries `load_N` with the tangent stiffness `stiffness_N_per_m`.

    With the flat-road law F = K g(u) of unknown K, the deflection solves g(u) / g'(u) = F / k.
    """
    slope = _flat_exponent(table)
    target = load_N / stiffness_N_per_m

    def mismatch(u: float) -> float:
        return u / np.interp(u, table.deflection_m, slope) - target

    deepest = float(table.deflection_m[-1])
    if mismatch(deepest) < 0.0:
        return deepest
    return float(brentq(mismatch, 1e-6, deepest))


def _flat_exponent(table: SpokeTable) -> np.ndarray:
    """Local exponent d log F / d log u of the flat-road law at the tabulated deflections."""
    u, f = table.deflection_m[1:], table.flat_force[1:]
    local = np.gradient(np.log(f), np.log(u))
    return np.concatenate(([local[1]], local))


def effective_profile(
    table: SpokeTable, load_N: float, reference_load_N: float, stiffness_N_per_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rise of the wheel centre that keeps the vertical force constant: the road as the wheel centre feels it.

    Parameters
    ----------
    table : spoke table of the profile for the wheel's radius.
    load_N : constant vertical load of the wheels [N].
    reference_load_N, stiffness_N_per_m : the load at which the flat-road tangent stiffness is declared, and that
        stiffness [N/m]; both for the same set of tires as `load_N`.

    Returns
    -------
    station_m (n,) from the start of the bump, and rise_m (n,), zero where the road is flat.
    """
    reference = static_deflection(table, reference_load_N, stiffness_N_per_m)
    spoke_stiffness = reference_load_N / np.interp(reference, table.deflection_m, table.flat_force)
    target = load_N / spoke_stiffness
    flat = np.interp(target, table.flat_force, table.deflection_m)
    # Interpolating the deflection in force^(2/3), in which it is nearly straight, keeps the coarse levels exact enough.
    power = 2.0 / 3.0
    deflection = np.array([np.interp(target**power, row**power, table.deflection_m) for row in table.force])
    flat = np.interp(target**power, table.flat_force**power, table.deflection_m)
    rise = table.contact_height_m - deflection - (table.radius_m - flat)
    return table.station_m, np.where(np.abs(rise) < 1e-7, 0.0, rise)
