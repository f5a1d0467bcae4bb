"""A rough road as the tires of every axle feel it, and its stretches for the integrator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Stations
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.road.contact_laws import ContactLaw
from sysid.road.enveloping import (
    SpokeTable,
    footprint_map,
    footprint_map_about,
    load_on_spokes,
    spoke_table,
    static_deflection,
)
from sysid.road.footprint_filter import footprint_filter
from sysid.road.road_profile import RoadProfile
from sysid.road.wheel_paths import WheelPaths
from sysid.vehicle_model.contact import EffectiveRoad, contact_damping, effective_road
from sysid.vehicle_model.passes import MapTires

#: Distance of the stations [m] of gentle roads and of harsh ones.
GENTLE_STEP_M, HARSH_STEP_M = 0.025, 0.01
#: Where the load of a wheel that follows the filtered road at its static height departs by more than this share of it,
#: the road is harsh: then the springs are followed one by one, up to a length [m].
HARSH, MOST_HARSH_M = 0.05, 100.0
#: Places at which that is looked at, those where the filter takes most away, and most places of a path over springs.
_LOOKED_AT, _JUDGED = 200, 3000


@dataclass(frozen=True)
class EdgeLoads:
    """Loads (T, na) [N] every `interval_s` [s] of one vehicle along the `paths` of its wheels.

    `damping_N_s_per_m` (na,) of its tires at the reference load, and how it grows with their contact (1 or 0), `growth`
    (na,).
    """

    paths: WheelPaths
    tire_N: np.ndarray
    interval_s: float
    damping_N_s_per_m: np.ndarray
    growth: np.ndarray


@dataclass(frozen=True)
class FeltRoad:
    """Rows of every axle's effective road on stations from `first_m`, `step_m` apart.

    `rise` (na, n) [m]; `stretch` (4, na, n) and `drag` (3, na, n) as in
    :class:`sysid.vehicle_model.contact.EffectiveRoad`.  `harsh` says whether springs were followed one by one;
    `misfit` is the largest error of a gentle road's load at its static height, as a share of it.
    """

    first_m: float
    step_m: float
    rise: np.ndarray
    stretch: np.ndarray
    drag: np.ndarray
    harsh: bool
    misfit: float

    def level_m(self, start_m: float) -> np.ndarray:
        """Rise (na,) [m] that counts as level in the stretch from `start_m` on."""
        first = int(np.floor((start_m - self.first_m) / self.step_m))
        return self.rise[:, min(max(first, 0), self.rise.shape[1] - 1)]

    def stretch_of(self, start_m: float, blend_m: float, end_m: float) -> EffectiveRoad:
        """The road from `start_m`, where it grows out of level road over `blend_m`, to `end_m`."""
        first = int(np.floor((start_m - self.first_m) / self.step_m))
        count = int(np.ceil((end_m - start_m) / self.step_m)) + 1
        index = np.clip(first + np.arange(count), 0, self.rise.shape[1] - 1)
        station = self.first_m + self.step_m * (first + np.arange(count))
        share = np.clip((station - station[0]) / blend_m, 0.0, 1.0)
        grown = share**4 * (35.0 - share * (84.0 - share * (70.0 - 20.0 * share)))
        rise = (self.rise[:, index] - self.rise[:, index[:1]]) * grown
        rows = (rows[..., index] * grown for rows in (self.stretch, self.drag))
        stretch, drag = (r[:, None] for r in rows)
        return effective_road(station, rise[None], stretch, drag, edged=self.harsh)


def felt_road(
    station_m: Stations,
    height_m: Stations,
    vehicle: Vehicle,
    load_case: LoadCase,
    reference: LoadCase,
    tires: MapTires,
    contact: ContactLaw,
    paths: WheelPaths | None = None,
) -> FeltRoad:
    """What the tires of every axle feel of a road at the loads of a load case; level road lies before and behind it.

    A gentle road is filtered by the footprint (:mod:`sysid.road.footprint_filter`).  Where that is off by more than
    :data:`HARSH` and the road is short enough, the footprint maps of the radial springs take its place.

    Parameters
    ----------
    station_m, height_m : (n,) uniform stations from 0, and heights [m].
    reference : the load case at whose axle loads the stiffness of the `tires` holds.
    contact : `point` follows the road itself.
    paths : where the wheels come along a harsh road: the springs are then followed about these paths.
    """
    height = height_m - height_m[0]
    length, margin = float(station_m[-1]), 1.0
    grid = np.arange(-margin, length + margin, GENTLE_STEP_M)
    sampled = np.interp(grid, station_m, height)
    if paths is not None:
        return _mapped(station_m, height, vehicle, load_case, reference, tires, 0.0, paths)
    if contact == "point":
        drag = -np.gradient(sampled, GENTLE_STEP_M)
        return _gentle(margin, [(sampled, drag)] * len(vehicle.axles), 0.0)
    power, rows, misfits = tires.spoke_exponent, [], []
    for i, axle in enumerate(vehicle.axles):
        load, declared = (c.axle_loads_kg[i] * vehicle.gravity_m_s2 for c in (load_case, reference))
        radius = axle.tire_radius_m
        spoke, sunk, tangent = _at_rest(radius, load, declared, tires.stiffness_N_per_m[i], power)
        rise, drag = footprint_filter(radius, sunk, load, tangent, power, GENTLE_STEP_M).applied(sampled)
        # Behind the end of the heights there is nothing to look at.
        worst = np.argsort(-np.abs(sampled - rise) * (grid < length - radius))[:_LOOKED_AT]
        centre = radius - sunk + rise[worst]
        found = spoke * load_on_spokes(grid[worst], centre, radius, station_m, height, power)
        misfits.append(float(np.abs(found / load - 1.0).max()))
        rows.append((rise, drag))
    if max(misfits) > HARSH and length <= MOST_HARSH_M:
        return _mapped(station_m, height, vehicle, load_case, reference, tires, max(misfits))
    return _gentle(margin, rows, max(misfits))


def _gentle(margin_m: float, rows: Sequence[tuple[Stations, Stations]], misfit: float) -> FeltRoad:
    """A road without stretch, from rise and G / F of every axle."""
    rise = np.stack([row[0] for row in rows])
    drag = np.zeros((3, *rise.shape))
    drag[0] = [row[1] for row in rows]
    return FeltRoad(-margin_m, GENTLE_STEP_M, rise, np.zeros((4, *rise.shape)), drag, False, misfit)


def _at_rest(
    radius_m: float, load_N: float, reference_N: float, stiffness_N_per_m: float, exponent: float
) -> tuple[float, float, float]:
    """Stiffness of spokes, their deflection [m] under a load and the tangent stiffness [N/m] there, on flat road."""
    flat = RoadProfile("flat", np.array([0.0, 0.01, 0.02]), np.zeros(3), np.zeros(3), 0.0, 0.02)
    table = spoke_table(flat, radius_m, exponent=exponent)
    spoke, sunk = _sunk(table, load_N, reference_N, stiffness_N_per_m)
    u, force = table.deflection_m, table.flat_force
    return spoke, sunk, spoke * float(np.interp(sunk, u, np.gradient(force, u)))


def _mapped(
    station_m: Stations,
    height_m: Stations,
    vehicle: Vehicle,
    load_case: LoadCase,
    reference: LoadCase,
    tires: MapTires,
    misfit: float,
    paths: WheelPaths | None = None,
) -> FeltRoad:
    """Footprint maps of all axles over a short road."""
    profile = _as_profile(station_m, height_m)
    maps = []
    for i, axle in enumerate(vehicle.axles):
        load, declared = (c.axle_loads_kg[i] * vehicle.gravity_m_s2 for c in (load_case, reference))
        table = spoke_table(profile, axle.tire_radius_m, exponent=tires.spoke_exponent)
        stiffness = tires.stiffness_N_per_m[i]
        if paths is None:
            maps.append(footprint_map(table, load, declared, stiffness))
            continue
        maps.append(footprint_map_about(table, load, declared, stiffness, *paths.on(i, table.station_m)))
    first = min(round(m.station_m[0] / m.step_m) for m in maps)
    last = max(round(m.station_m[-1] / m.step_m) for m in maps)
    maps = [m.widened(first, last) for m in maps]
    rise = np.stack([m.rise_m for m in maps])
    stretch = np.concatenate([np.stack([m.stretch for m in maps], axis=1), np.stack([m.lift_m for m in maps])[None]])
    drag = np.stack([m.drag for m in maps], axis=1)
    return FeltRoad(first * HARSH_STEP_M, HARSH_STEP_M, rise, stretch, drag, True, misfit)


def _as_profile(station_m: Stations, height_m: Stations) -> RoadProfile:
    """A short road, which comes down to level road behind its end over 5 m."""
    step, down, margin = 0.002, 5.0, 1.0
    end = float(station_m[-1])
    grid = np.arange(0.0, end + down + margin, step)
    height = np.interp(grid, station_m, height_m) * (0.5 + 0.5 * np.cos(np.pi * np.clip((grid - end) / down, 0.0, 1.0)))
    return RoadProfile("road", grid, height, np.zeros_like(height), 0.0, end)


def _sunk(table: SpokeTable, load_N: float, reference_N: float, stiffness_N_per_m: float) -> tuple[float, float]:
    """Stiffness of spokes and their deflection [m] under a load on flat road."""
    u, force = table.deflection_m, table.flat_force
    spoke = reference_N / float(np.interp(static_deflection(table, reference_N, stiffness_N_per_m), u, force))
    return spoke, float(np.interp(load_N / spoke, force, u))


@dataclass(frozen=True)
class Misfit:
    """How far loads are from those of the springs at the same places: root mean square error over the root mean square
    change of load, and relative error of the peak, both of the worst axle.
    """

    change: float
    peak: float


def misfit_on_springs(
    loads: EdgeLoads,
    station_m: Stations,
    height_m: Stations,
    vehicle: Vehicle,
    load_case: LoadCase,
    reference: LoadCase,
    tires: MapTires,
) -> Misfit:
    """Loads of a pass over a harsh road against those of springs and dampers of the tires along the same paths.

    Of two samples that follow each other the means are compared: the damper feels what is between them.

    Parameters
    ----------
    loads : of a vehicle with the given `tires`. Other parameters as for :func:`felt_road`.
    """
    profile = _as_profile(station_m, height_m - height_m[0])
    change, peak = 0.0, 0.0
    for i, axle in enumerate(vehicle.axles):
        load, declared = (c.axle_loads_kg[i] * vehicle.gravity_m_s2 for c in (load_case, reference))
        radius = axle.tire_radius_m
        table = spoke_table(profile, radius, exponent=tires.spoke_exponent)
        spoke, sunk = _sunk(table, load, declared, tires.stiffness_N_per_m[i])
        _, at_reference = _sunk(table, declared, declared, tires.stiffness_N_per_m[i])
        at, rise = loads.paths.station_m[:, i, 0], loads.paths.rise_m[:, i, 0]
        near = np.flatnonzero((at[:-1] > -1.0) & (at[:-1] < profile.length_m))
        near = near[:: 1 + near.size // _JUDGED]
        both = np.stack([near, near + 1])
        centre = radius - sunk + rise[both]
        parts = zip(*(np.array_split(v.ravel(), 1 + both.size // 500) for v in (at[both], centre)), strict=True)
        exact = np.concatenate(
            [load_on_spokes(s, h, radius, profile.station_m, profile.height_m, tires.spoke_exponent) for s, h in parts]
        ).reshape(both.shape)
        deflection = np.interp(exact, table.flat_force, table.deflection_m)
        sinking = np.diff(deflection, axis=0)[0] / loads.interval_s
        damping = contact_damping(loads.damping_N_s_per_m[i], deflection.mean(axis=0) / at_reference, loads.growth[i])
        exact = np.maximum(spoke * exact.mean(axis=0) + damping * sinking, 0.0)
        found = loads.tire_N[both, i].mean(axis=0)
        # Of a road that hardly moves the load no share is judged.
        moved = max(float(np.sqrt(np.mean((exact - load) ** 2))), HARSH * load)
        change = max(change, float(np.sqrt(np.mean((found - exact) ** 2))) / moved)
        peak = max(peak, abs(float(found.max() / max(exact.max(), load)) - 1.0))
    return Misfit(change, peak)
