"""Lanes of a set of passes: matrices and effective roads of each pass, ready for the integrator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sysid.campaign.records import LoadCase, Vehicle
from sysid.road.enveloping import SpokeTable, effective_profile, spoke_table
from sysid.road.results import RoadProfile
from sysid.vehicle_model.assembly import assemble
from sysid.vehicle_model.contact import EffectiveRoad, effective_road
from sysid.vehicle_model.simulation import LaneMatrices, lane_matrices


@dataclass(frozen=True)
class Pass:
    """One pass over a bump: load case and bump by name."""

    load_case: str
    bump: str


@dataclass(frozen=True)
class Lanes:
    """Everything about R passes that does not depend on the estimated parameters.

    `matrices` of each pass; `road` the effective roads (R, na, n); `axle_x` (na, 1) [m]; `reference_load` (R, na, 1)
    static load in the first load case [N].
    """

    matrices: LaneMatrices
    road: EffectiveRoad
    axle_x: np.ndarray
    reference_load: np.ndarray


class EffectiveRoads:
    """Effective profiles of a vehicle over its bumps, tabulated once per wheel radius and load."""

    def __init__(self, vehicle: Vehicle, load_cases: Mapping[str, LoadCase], profiles: Mapping[str, RoadProfile]):
        self._vehicle = vehicle
        self._load_cases = dict(load_cases)
        self._profiles = dict(profiles)
        self._table = lru_cache(maxsize=None)(self._make_table)
        self._rises = lru_cache(maxsize=None)(self._make_rises)

    def _make_table(self, bump: str, radius_m: float) -> SpokeTable:
        return spoke_table(self._profiles[bump], radius_m)

    def _make_rises(self, load_case: str, bump: str) -> tuple[np.ndarray, np.ndarray]:
        first = next(iter(self._load_cases.values()))
        case = self._load_cases[load_case]
        gravity = self._vehicle.gravity_m_s2
        curves = [
            effective_profile(
                self._table(bump, axle.tire_radius_m),
                case.axle_loads_kg[i] * gravity,
                first.axle_loads_kg[i] * gravity,
                axle.tire_stiffness_N_per_m,
            )
            for i, axle in enumerate(self._vehicle.axles)
        ]
        start = min(s[0] for s, _ in curves)
        end = max(s[-1] for s, _ in curves)
        step = curves[0][0][1] - curves[0][0][0]
        station = start + np.arange(round((end - start) / step) + 1) * step
        return station, np.array([np.interp(station, s, w, left=0.0, right=0.0) for s, w in curves])

    def rises(self, load_case: str, bump: str) -> tuple[np.ndarray, np.ndarray]:
        """Stations (n,) from the start of the bump [m] and effective rise (na, n) [m] under each axle."""
        return self._rises(load_case, bump)

    def stacked(self, passes: Sequence[Pass]) -> EffectiveRoad:
        """Effective roads of several passes on common stations."""
        curves = [self.rises(p.load_case, p.bump) for p in passes]
        step = curves[0][0][1] - curves[0][0][0]
        first = min(round(s[0] / step) for s, _ in curves)
        last = max(round(s[-1] / step) for s, _ in curves)
        rises = []
        for station, rise in curves:
            before = round(station[0] / step) - first
            rises.append(np.pad(rise, ((0, 0), (before, last - first + 1 - before - station.size))))
        return effective_road(np.arange(first, last + 1) * step, np.stack(rises))


def make_lanes(
    vehicle: Vehicle,
    load_cases: Mapping[str, LoadCase],
    roads: EffectiveRoads,
    passes: Sequence[Pass],
    body_points: list[tuple[int, float]],
) -> Lanes:
    """Lanes of several passes, with body accelerometers at (body, x_m) `body_points`."""
    first = next(iter(load_cases.values()))
    matrices = {name: assemble(vehicle, load_cases[name]) for name in {p.load_case for p in passes}}
    return Lanes(
        matrices=lane_matrices([matrices[p.load_case] for p in passes], body_points),
        road=roads.stacked(passes),
        axle_x=np.array([a.x_m for a in vehicle.axles])[:, None],
        reference_load=np.tile(np.array(first.axle_loads_kg)[:, None] * vehicle.gravity_m_s2, (len(passes), 1, 1)),
    )
