"""Effect of a road profile on a rolling tire: radial springs and the effective profile at constant load.

A wheel of radius R rolls with its centre at station s and height h.  Each spoke of the lower half, at the angle phi
from the vertical, meets the road at the distance rho(phi); its spring is shorter by R - rho and pushes along the spoke
with a force proportional to (R - rho)^p.  Summed over the spokes this gives the vertical force of the tire on any road
shape (D. C. Davis, A radial-spring terrain-enveloping tire model, Vehicle System Dynamics 4 (1975),
doi:10.1080/00423117508968461).  Its stiffness is fixed by the tire's declared vertical stiffness on a flat road.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from sysid.road.road_profile import RoadProfile
from sysid.threads import side_by_side

#: Exponent of a single spoke; on a flat road the force grows with about deflection^(SPOKE_EXPONENT + 1/2), and 1.2 is
#: the prior median of the tires' load law.
SPOKE_EXPONENT = 0.7

#: How far spokes reach from the vertical: at 60 degrees a spoke ends half a radius above the road, higher than a bump.
_HALF_ANGLE_RAD = np.deg2rad(60.0)
#: Deflections of the tables.
_LEVELS = 48
#: Largest deflection over the radius to which footprint maps are fitted, and that of the tables, which reach beyond it.
_MAP_DEPTH_PER_RADIUS = 0.12
_DEEPEST_PER_RADIUS = 0.24
#: Loads for which the footprint map is fitted: so many, up to so many times the static load.
_MAP_LEVELS, _MAP_LOAD_RATIO = 24, 6.0
#: Maps about known heights: depths from so many widths above them to as many below, and so many over the whole table,
#: which weigh this much; the least width [m], and the exponent in which the depths of the whole table are spaced.
_ABOUT_WIDTHS, _ABOUT_LEVELS, _ALL_LEVELS, _ALL_WEIGHT, _ABOUT_M, _ALL_POWER = 2.5, 21, 12, 1e-4, 0.003, 1.5
#: In forces to this power deflections are nearly straight, so that coarse levels are exact enough.
_STRAIGHT = 2.0 / 3.0
#: Distance of the stations of tables and maps; a footprint is some twenty times as long.
MAP_STEP_M = 0.01
#: Distance of the points of the road between which the compression is linear, and stations that are taken together.
_ROAD_STEP_M = 0.002
_TOGETHER = 128
#: Profiles up to so many stations have their footprint maps kept.
_KEPT_STATIONS = 1000


# Compared by identity: tables of one wheel over one profile are made once.
@dataclass(frozen=True, eq=False)
class SpokeTable:
    """Force of a unit-stiffness radial-spring wheel over one profile.

    - `station_m` (n,): of the wheel centre, from the start of the bump;
    - `contact_height_m` (n,): centre height at first contact;
    - `deflection_m` (m,): below first contact;
    - `force`, `forward_force` (n, m): vertical and forward force for unit spoke stiffness;
    - `flat_force` (m,): vertical force on a flat road.
    """

    radius_m: float
    station_m: np.ndarray
    contact_height_m: np.ndarray
    deflection_m: np.ndarray
    force: np.ndarray
    forward_force: np.ndarray
    flat_force: np.ndarray


def spoke_table(profile: RoadProfile, radius_m: float, *, exponent: float = SPOKE_EXPONENT) -> SpokeTable:
    """Tabulate the vertical force of radial springs over a profile, by station and deflection.

    Parameters
    ----------
    profile : the bump, zero road outside.
    radius_m : wheel radius R [m].
    exponent : exponent p of the spoke law [-].
    """
    station, height = (np.ascontiguousarray(a, float).tobytes() for a in (profile.station_m, profile.height_m))
    return _known_table(station, height, float(profile.start_m), float(radius_m), float(exponent))


@lru_cache(maxsize=64)
def _known_table(stations: bytes, heights: bytes, start_m: float, radius_m: float, exponent: float) -> SpokeTable:
    """The table of one profile, made once, because every stage needs it again."""
    road_s, road_z = np.frombuffer(stations) - start_m, np.frombuffer(heights)
    station = map_stations(road_s, radius_m * np.sin(_HALF_ANGLE_RAD))
    deflection = _DEEPEST_PER_RADIUS * radius_m * np.linspace(0.0, 1.0, _LEVELS) ** 1.5
    flat, _ = _spoke_forces(np.zeros(1), (radius_m - deflection)[None, :], radius_m, road_s, 0.0 * road_z, exponent)

    def part(first: int) -> tuple[np.ndarray, ...]:
        some = station[first : first + _TOGETHER]
        contact = _first_contact(some, radius_m, road_s, road_z)
        height = contact[:, None] - deflection
        return contact, *_spoke_forces(some, height, radius_m, road_s, road_z, exponent)

    parts = side_by_side(part, range(0, station.size, _TOGETHER))
    contact, force, forward = (np.concatenate(of_parts) for of_parts in zip(*parts, strict=True))
    return SpokeTable(radius_m, station, contact, deflection, force, forward, flat[0])


def _first_contact(station: np.ndarray, radius: float, road_s: np.ndarray, road_z: np.ndarray) -> np.ndarray:
    """Heights (n,) [m] of the wheel's centre at which the first spoke touches the road, R where it is flat."""
    reach = radius * np.sin(_HALF_ANGLE_RAD)
    away = np.arange(-np.floor(reach / _ROAD_STEP_M), reach / _ROAD_STEP_M) * _ROAD_STEP_M
    road = np.interp(station[:, None] + away, road_s, road_z, left=0.0, right=0.0)
    return np.asarray(np.maximum((road + np.sqrt(radius**2 - away**2)).max(axis=1), radius))


def load_on_spokes(
    station_m: np.ndarray,
    height_m: np.ndarray,
    radius_m: float,
    road_m: np.ndarray,
    road_height_m: np.ndarray,
    exponent: float,
) -> np.ndarray:
    """Vertical force (n,) of unit spokes of wheels with their centres at stations and heights (n,) [m] over a road.

    `road_m`, `road_height_m` (m,): stations and heights of the road [m], zero beyond its ends; `exponent` of a spoke.
    """
    return _spoke_forces(station_m, height_m[:, None], radius_m, road_m, road_height_m, exponent)[0][:, 0]


def map_stations(road_m: np.ndarray, reach_m: float) -> np.ndarray:
    """Uniform stations [m] of a map, which reach beyond those of a road by a wheel's reach and 0.1 m of flat road."""
    first, last = road_m[0] - reach_m - 0.1, road_m[-1] + reach_m + 0.1
    return np.arange(np.floor(first / MAP_STEP_M), np.ceil(last / MAP_STEP_M) + 1) * MAP_STEP_M


def _spoke_forces(
    station: np.ndarray, height: np.ndarray, radius: float, road_s: np.ndarray, road_z: np.ndarray, exponent: float
) -> tuple[np.ndarray, np.ndarray]:
    """Vertical and forward force of unit spokes of wheels with their centres at stations (n,) and heights (n, m) [m].

    The sums over the spokes are integrals over the road that they meet: from point to point of the road the compression
    is linear in the angle, so that the ends of the contact and edges fall on no spoke and between none.  Outwards from
    below the centre a spoke ends where its angle is first reached: road behind that is hidden.
    """
    along = _ROAD_STEP_M * np.arange(np.ceil(radius * np.sin(_HALF_ANGLE_RAD) / _ROAD_STEP_M) + 1)
    vertical, forward = np.zeros(height.shape), np.zeros(height.shape)
    for side in (1.0, -1.0):
        road = np.interp(station[:, None] + side * along, road_s, road_z, left=0.0, right=0.0)
        for level in range(height.shape[1]):
            above = height[:, level, None] - road
            shorter = radius - np.sqrt(above**2 + along**2)
            reached = np.flatnonzero((shorter > 0.0).any(axis=0))
            if reached.size == 0:
                continue
            used = slice(0, reached[-1] + 2)
            above, shorter = above[:, used], shorter[:, used]
            angle = np.arctan2(along[used], above)
            seen = np.maximum.accumulate(angle, axis=1)
            width = np.diff(seen, axis=1)
            energy = np.maximum(shorter, 0.0)
            energy **= exponent + 1.0
            first, last = shorter[:, :-1], shorter[:, 1:]
            work = np.diff(energy, axis=1)
            # Road that comes into sight behind an edge begins between two points.
            row, at = np.nonzero((seen[:, :-1] > angle[:, :-1]) & (width > 0.0))
            if row.size:
                share = (seen[row, at] - angle[row, at]) / (angle[row, at + 1] - angle[row, at])
                first = first.copy()
                first[row, at] += share * (last[row, at] - first[row, at])
                work[row, at] = energy[row, at + 1] - np.maximum(first[row, at], 0.0) ** (exponent + 1.0)
            change = last - first
            same = np.abs(change) < 1e-9
            mean = work / (exponent + 1.0) / np.where(same, 1.0, change)
            mean[same] = np.maximum(last[same], 0.0) ** exponent
            mean *= width
            middle = 0.5 * (seen[:, 1:] + seen[:, :-1])
            vertical[:, level] += (mean * np.cos(middle)).sum(axis=1)
            forward[:, level] -= side * (mean * np.sin(middle)).sum(axis=1)
    return vertical, forward


def static_deflection(table: SpokeTable, load_N: float, stiffness_N_per_m: float) -> float:
    """Deflection [m] at which a flat road carries `load_N` with the tangent stiffness `stiffness_N_per_m`.

    With the flat-road law F = K g(u) of unknown K, the deflection solves g(u) / g'(u) = F / k.
    """
    slope = _flat_exponent(table)
    target = load_N / stiffness_N_per_m

    def mismatch(u: float) -> float:
        return float(u / np.interp(u, table.deflection_m, slope) - target)

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
    """Rise of the wheel centre that keeps the vertical force constant: the effective road profile.

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
    deflection = _interpolated_rows(np.array([target**_STRAIGHT]), table.force**_STRAIGHT, table.deflection_m)[:, 0]
    flat = np.interp(target**_STRAIGHT, table.flat_force**_STRAIGHT, table.deflection_m)
    rise = table.contact_height_m - deflection - (table.radius_m - flat)
    return table.station_m, np.where(np.abs(rise) < 1e-7, 0.0, rise)


@dataclass(frozen=True)
class FootprintMap:
    """How a radial-spring tire responds over a bump, relative to its response on a flat road.

    v is how much lower the wheel centre is than the effective profile W(s) of the static load would have it.  The tire
    carries as much as on a flat road at the equivalent deflection

        e = u_0 + v + stretch_1 v + stretch_2 v^2 + stretch_3 v^3

    and its forward force is V (drag_0 + drag_1 v + drag_2 v^2), with the vertical force V.

    - `station_m` (n,): from the start of the bump;
    - `rise_m` (n,): effective profile;
    - `stretch`, `drag` (3, n): [1, 1/m, 1/m2];
    - `lift_m` (n,): how much deeper than on a flat road (v = -u_0) the wheel centre is at first contact, where
      v = lift - u_0;
    - `misfit_m`: largest error of e over the fitted range.
    """

    station_m: np.ndarray
    rise_m: np.ndarray
    stretch: np.ndarray
    drag: np.ndarray
    lift_m: np.ndarray
    misfit_m: float

    @property
    def step_m(self) -> float:
        """Distance of the stations [m]."""
        return float(self.station_m[1] - self.station_m[0])

    def widened(self, first: int, last: int) -> FootprintMap:
        """The map on stations `first` to `last`, in steps from the start of the bump: flat road where it had none."""
        before = round(self.station_m[0] / self.step_m) - first
        after = last - first + 1 - before - self.station_m.size

        def padded(values: np.ndarray) -> np.ndarray:
            rows = values.shape[:-1]
            return np.concatenate([np.zeros((*rows, before)), values, np.zeros((*rows, after))], axis=-1)

        return replace(
            self,
            station_m=np.arange(first, last + 1) * self.step_m,
            rise_m=padded(self.rise_m),
            stretch=padded(self.stretch),
            drag=padded(self.drag),
            lift_m=padded(self.lift_m),
        )


def footprint_map(table: SpokeTable, load_N: float, reference_load_N: float, stiffness_N_per_m: float) -> FootprintMap:
    """Fit the footprint map of a tire over a profile between lift-off and `_MAP_LOAD_RATIO` times its static load.

    Parameters as in :func:`effective_profile`.
    """
    # Every stage needs the maps of the same tires again. Those of long roads are large, and needed once.
    map_of = _known_map if table.station_m.size <= _KEPT_STATIONS else _known_map.__wrapped__
    return map_of(table, load_N, reference_load_N, stiffness_N_per_m)


@lru_cache(maxsize=128)
def _known_map(table: SpokeTable, load_N: float, reference_load_N: float, stiffness_N_per_m: float) -> FootprintMap:
    tire = _tire_on_table(table, load_N, reference_load_N, stiffness_N_per_m)
    deepest = np.interp((_MAP_DEPTH_PER_RADIUS * table.radius_m), table.deflection_m, table.flat_force)
    largest = min(_MAP_LOAD_RATIO * tire.unit_load, max(deepest, 2.0 * tire.unit_load))
    target = largest * np.linspace(0.0, 1.0, _MAP_LEVELS + 1)[1:] ** 1.2
    equivalent = np.interp(target**_STRAIGHT, table.flat_force**_STRAIGHT, table.deflection_m)
    deflection = _interpolated_rows(target**_STRAIGHT, table.force**_STRAIGHT, table.deflection_m)
    weight = np.ones(_MAP_LEVELS)
    return _fitted_map(table, tire, deflection, equivalent, weight, target / target.max(), weight)


def footprint_map_about(
    table: SpokeTable,
    load_N: float,
    reference_load_N: float,
    stiffness_N_per_m: float,
    rise_m: np.ndarray,
    width_m: np.ndarray,
) -> FootprintMap:
    """Fit the footprint map of a tire about the path of its centre.

    Over edges a cubic for all loads is a few per cent off; about a path that the wheel takes it follows the springs
    closely.  `misfit_m` is the root mean square error of e about the path, where it is largest.

    Parameters
    ----------
    rise_m : (n,) how far the wheel's centre is above its place on flat road, at the stations of the table [m].
    width_m : (n,) standard deviation of the heights at which the map has to hold [m]; 3 mm where less is given.
    table, load_N, reference_load_N, stiffness_N_per_m : as for :func:`effective_profile`.
    """
    tire = _tire_on_table(table, load_N, reference_load_N, stiffness_N_per_m)
    deepest = float(table.deflection_m[-1])
    # Where the wheel is off the road, the map has to hold from first contact on.
    at = np.clip(table.contact_height_m - (table.radius_m - tire.static_m + rise_m), 0.0, deepest)[:, None]
    width = np.maximum(width_m, _ABOUT_M)[:, None]
    whole = np.broadcast_to(deepest * np.linspace(0.0, 1.0, _ALL_LEVELS) ** _ALL_POWER, (at.size, _ALL_LEVELS))
    local = at + width * np.linspace(-_ABOUT_WIDTHS, _ABOUT_WIDTHS, _ABOUT_LEVELS)
    deflection = np.concatenate([local, whole], axis=1)
    inside = (deflection >= 0.0) & (deflection <= deepest)
    deflection = np.clip(deflection, 0.0, deepest)
    flat = table.flat_force**_STRAIGHT
    equivalent = _at_levels(deflection, table.deflection_m, np.interp(table.force**_STRAIGHT, flat, table.deflection_m))
    # Deeper than that a flat road is not tabulated.
    inside &= equivalent < (1.0 - 1e-9) * deepest
    near = np.exp(-0.5 * ((deflection - at) / width) ** 2) * inside
    near[:, _ABOUT_LEVELS:] = 0.0
    weight = near.copy()
    weight[:, _ABOUT_LEVELS:] = _ALL_WEIGHT * inside[:, _ABOUT_LEVELS:]
    return _fitted_map(table, tire, deflection, equivalent, weight, weight, near)


@dataclass(frozen=True)
class _TireOnTable:
    """Static load in that of unit spokes, the deflection [m] at it, and the effective profile (n,) [m]."""

    unit_load: float
    static_m: float
    rise_m: np.ndarray


def _tire_on_table(table: SpokeTable, load_N: float, reference_load_N: float, stiffness_N_per_m: float) -> _TireOnTable:
    _, rise = effective_profile(table, load_N, reference_load_N, stiffness_N_per_m)
    reference = static_deflection(table, reference_load_N, stiffness_N_per_m)
    unit = load_N / (reference_load_N / float(np.interp(reference, table.deflection_m, table.flat_force)))
    static = float(np.interp(unit**_STRAIGHT, table.flat_force**_STRAIGHT, table.deflection_m))
    return _TireOnTable(unit, static, rise)


def _fitted_map(
    table: SpokeTable,
    tire: _TireOnTable,
    deflection_m: np.ndarray,
    equivalent_m: np.ndarray,
    weight: np.ndarray,
    drag_weight: np.ndarray,
    judged: np.ndarray,
) -> FootprintMap:
    """The map through equivalent deflections (n, k) or (k,) of deflections (n, k) below first contact [m].

    The misfit is over those that `judged` (k,) or (n, k) weighs.
    """
    rise, static = tire.rise_m, tire.static_m
    height = table.contact_height_m[:, None] - deflection_m
    below = rise[:, None] + (table.radius_m - static) - height
    extra = equivalent_m - static - below
    basis = np.stack([below, below**2, below**3], axis=-1)
    # Columns are scaled so that the small powers of metres do not spoil the normal equations.
    scale = np.array([static, static**2, static**3])
    coefficients = _fit_rows(basis / scale, extra, weight) / scale
    off = (basis * coefficients[:, None, :]).sum(axis=-1) - extra
    # A peak of a rough road between two points is not touched at first.
    force, forward = table.force[:, 1:], table.forward_force[:, 1:]
    slope = np.divide(forward, force, out=np.zeros_like(force), where=force > 0.0)
    ratio = _at_levels(deflection_m, table.deflection_m[1:], slope)
    drag_scale = np.array([1.0, static, static**2])
    drag_basis = np.stack([np.ones_like(below), below, below**2], axis=-1)
    drag = _fit_rows(drag_basis / drag_scale, ratio, drag_weight) / drag_scale
    # About a path a wheel may be deep enough to feel what lies beyond the footprint of its static load.
    on_flat = np.abs(rise) < 1e-6
    if judged.ndim == 2:
        on_flat &= (np.abs(extra) * (judged > 1e-3)).max(axis=1) < 1e-6
    coefficients[on_flat], drag[on_flat] = 0.0, 0.0
    lift = rise - (table.contact_height_m - table.radius_m)
    return FootprintMap(table.station_m, rise, coefficients.T, drag.T, lift, _largest_error(off, judged))


def _largest_error(off: np.ndarray, judged: np.ndarray) -> float:
    """The largest error (n, k), or with weights of every row its largest root mean square."""
    if judged.ndim == 1:
        return float(np.abs(off).max())
    total = judged.sum(axis=1)
    return float(np.sqrt((judged * off**2).sum(axis=1) / np.where(total > 0.0, total, 1.0)).max())


def _interpolated_rows(values: np.ndarray, rows: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Levels (n, k) at which every row (n, m), which does not fall, has the `values` (k,); the ends beyond them.

    As :func:`numpy.interp` row by row, for all of them together.
    """
    after = np.clip((rows[:, None, :] <= values[:, None]).sum(axis=-1), 1, rows.shape[1] - 1)
    low, high = (np.take_along_axis(rows, i, axis=1) for i in (after - 1, after))
    rise = high - low
    share = np.clip((values - low) / np.where(rise > 0.0, rise, 1.0), 0.0, 1.0)
    return np.asarray(levels[after - 1] + share * (levels[after] - levels[after - 1]))


def _at_levels(where: np.ndarray, levels: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Values of every row (n, m) given at `levels` (m,), at its own places `where` (n, k); the ends beyond them."""
    after = np.clip(np.searchsorted(levels, where, side="right"), 1, levels.size - 1)
    low, high = (np.take_along_axis(rows, i, axis=1) for i in (after - 1, after))
    share = np.clip((where - levels[after - 1]) / (levels[after] - levels[after - 1]), 0.0, 1.0)
    return np.asarray(low + share * (high - low))


def _fit_rows(basis: np.ndarray, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weighted least squares of every row: basis (n, m, k), values (n, m), weight (m,) or (n, m) -> (n, k)."""
    weighted = basis * weight[..., None]
    normal = np.einsum("nmk,nml->nkl", weighted, basis)
    right = np.einsum("nmk,nm->nk", weighted, values)
    return np.linalg.solve(normal + 1e-12 * np.eye(basis.shape[-1]), right[..., None])[..., 0]
