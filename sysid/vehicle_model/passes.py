"""Passes over bumps: what is driven, what the wheels feel of it, and batches of passes ready for the integrator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Self

import numpy as np

from sysid.campaign.records import HOLD_S, SpeedHeld
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.road.contact_laws import CONTACT_LAWS, ContactLaw
from sysid.road.enveloping import (
    SPOKE_EXPONENT,
    FootprintMap,
    SpokeTable,
    footprint_map,
    footprint_map_about,
    spoke_table,
)
from sysid.road.road_profile import RoadProfile
from sysid.road.wheel_paths import WheelPaths
from sysid.threads import side_by_side
from sysid.vehicle_model.assembly import PlanarMatrices, assemble
from sysid.vehicle_model.contact import EffectiveRoad, effective_road
from sysid.vehicle_model.stacked_matrices import StackedMatrices, stack_matrices

#: Load by which a footprint map departs from the radial springs over a bump, in shares of the load at rest, from which
#: on it is followed about paths: smooth bumps have 0.01 to 0.07, planks up to 0.25, where one map for all that a wheel
#: may do is 12 to 32 % of the change of load off.
EDGES = 0.1


@dataclass(frozen=True)
class Pass:
    """One pass over a bump: load case and bump by name, and how the speed is held.

    `hold_s` is a time constant [s] in place of those of the vehicle and of `speed_held`; `run` names the run.
    """

    load_case: str
    bump: str
    speed_held: SpeedHeld = "servo"
    hold_s: float | None = None
    run: str = ""

    @property
    def key(self) -> tuple[str, str, str]:
        """Load case, bump and run: what the wheels feel depends on no more."""
        return self.load_case, self.bump, self.run


@dataclass(frozen=True)
class PassBatch:
    """Everything about R passes that does not depend on the estimated parameters.

    `matrices` of each pass; `road` the effective roads (R, na, n); `axle_x` (na, 1) [m]; `reference_load` (R, na, 1)
    static load in the first load case [N].
    """

    matrices: StackedMatrices
    road: EffectiveRoad
    axle_x: np.ndarray
    reference_load: np.ndarray


@dataclass(frozen=True)
class MapTires:
    """The tires that footprint maps are tabulated for.

    `stiffness_N_per_m` (na,) tangent stiffness of every axle's tires at its static load in the first load case;
    `spoke_exponent` of a single radial spring, see :mod:`sysid.road.enveloping`; `paths` by load case, bump and run are
    those of the wheels about which the springs are followed, over bumps with edges. Elsewhere one map holds for all
    that a wheel may do.
    """

    stiffness_N_per_m: tuple[float, ...]
    spoke_exponent: float = SPOKE_EXPONENT
    paths: Mapping[tuple[str, str, str], WheelPaths] = field(default_factory=dict, compare=False, repr=False)

    def like(self, other: MapTires) -> bool:
        """Whether the maps of both cannot be told apart: exponents within 0.002, stiffnesses within 0.5 %."""
        ratio = np.array(self.stiffness_N_per_m) / np.array(other.stiffness_N_per_m)
        return abs(self.spoke_exponent - other.spoke_exponent) < 0.002 and bool(np.all(np.abs(np.log(ratio)) < 0.005))


def declared_tires(vehicle: Vehicle) -> MapTires:
    """Map tires with the stiffnesses of the campaign file."""
    return MapTires(tuple(a.tire_stiffness_N_per_m for a in vehicle.axles))


class EffectiveRoads:
    """What the wheels of a vehicle feel of its bumps, by one contact law, tabulated once per wheel radius and load.

    `tires` are those of the maps, None for the declared ones.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        load_cases: Mapping[str, LoadCase],
        profiles: Mapping[str, RoadProfile],
        contact: ContactLaw = "footprint",
        tires: MapTires | None = None,
    ):
        self.contact = contact
        self.tires = tires or declared_tires(vehicle)
        self.vehicle = vehicle
        self.load_cases = dict(load_cases)
        self.profiles = dict(profiles)
        self._forget()

    def _forget(self) -> None:
        self._table = lru_cache(maxsize=None)(self._make_table)
        self._maps = lru_cache(maxsize=None)(self._make_maps)
        self._sides = lru_cache(maxsize=None)(self._make_side)

    def _make_table(self, bump: str, radius_m: float) -> SpokeTable:
        return spoke_table(self.profiles[bump], radius_m, exponent=self.tires.spoke_exponent)

    def _make_maps(self, load_case: str, bump: str, run: str) -> tuple[FootprintMap, ...]:
        first = next(iter(self.load_cases.values()))
        case = self.load_cases[load_case]
        gravity = self.vehicle.gravity_m_s2
        geometric_map, paths = CONTACT_LAWS[self.contact].geometric_map, self.tires.paths.get((load_case, bump, run))
        if geometric_map is None:
            # Before the maps, which are made side by side: tires of one radius share a table.
            for radius_m in {axle.tire_radius_m for axle in self.vehicle.axles}:
                self._table(bump, radius_m)

        def one(i: int) -> FootprintMap:
            axle = self.vehicle.axles[i]
            load, reference = case.axle_loads_kg[i] * gravity, first.axle_loads_kg[i] * gravity
            stiffness = self.tires.stiffness_N_per_m[i]
            if geometric_map is not None:
                return geometric_map(self.profiles[bump], axle.tire_radius_m, load / stiffness)
            table = self._table(bump, axle.tire_radius_m)
            if paths is not None:
                return footprint_map_about(table, load, reference, stiffness, *paths.on(i, table.station_m))
            return footprint_map(table, load, reference, stiffness)

        return side_by_side(one, range(len(self.vehicle.axles)))

    def about(self, driven: Pass, paths: WheelPaths) -> EffectiveRoads:
        """The same with the springs of tires followed about the paths of the wheels in one pass."""
        return self.with_paths({**self.tires.paths, driven.key: paths})

    def with_paths(self, paths: Mapping[tuple[str, str, str], WheelPaths]) -> Self:
        """The same with the springs of tires followed about paths by load case, bump and run."""
        other = copy(self)
        other.tires = replace(self.tires, paths=paths)
        other._forget()
        return other

    def of_side(self, side: float) -> EffectiveRoads:
        """What the wheels feel of the left track alone (1), of the right one (-1), or of their mean (0).

        Footprint maps are those about rest; a bump without sides is the same for all.
        """
        return self._sides(side)

    def _make_side(self, side: float) -> EffectiveRoads:
        def of(profile: RoadProfile) -> RoadProfile:
            if not side or profile.sides is None:
                return profile
            return replace(profile, height_m=profile.sides.left_m if side > 0.0 else profile.sides.right_m, sides=None)

        profiles = {name: of(profile) for name, profile in self.profiles.items()}
        tires = replace(self.tires, paths={})
        return EffectiveRoads(self.vehicle, self.load_cases, profiles, self.contact, tires)

    def off_springs(self, driven: Pass) -> float:
        """Largest error of a tire's load in a pass against its radial springs, in shares of the load at rest [-]."""
        if not CONTACT_LAWS[self.contact].follows_tires:
            return 0.0
        loads = (m * self.vehicle.gravity_m_s2 for m in self.load_cases[driven.load_case].axle_loads_kg)
        each = zip(self.maps(*driven.key), self.tires.stiffness_N_per_m, loads, strict=True)
        return max(one.misfit_m * stiffness / load for one, stiffness, load in each)

    def maps(self, load_case: str, bump: str, run: str = "") -> tuple[FootprintMap, ...]:
        """Footprint map of every axle in a load case over a bump; about the paths of a run where these are known."""
        return self._maps(load_case, bump, run if (load_case, bump, run) in self.tires.paths else "")

    def stacked(self, passes: Sequence[Pass]) -> EffectiveRoad:
        """Effective roads and footprint maps of several passes on common stations."""
        # Runs of one load case over one bump have the same maps: each is made once.
        met = list(dict.fromkeys(p.key for p in passes))
        maps = [self.maps(*one) for one in met]
        tabulated = [m for row in maps for m in row]
        step = tabulated[0].step_m
        first = min(round(m.station_m[0] / step) for m in tabulated)
        last = max(round(m.station_m[-1] / step) for m in tabulated)
        maps = [tuple(m.widened(first, last) for m in row) for row in maps]

        def stack(name: str) -> np.ndarray:
            return np.array([[getattr(m, name) for m in row] for row in maps])

        stretch, drag = (np.moveaxis(stack(name), 2, 0) for name in ("stretch", "drag"))
        stretch = np.concatenate([stretch, stack("lift_m")[None]])
        # A truck that nothing, or only its wheels, keep at its speed falls behind: too far for a series about there.
        loose = self.vehicle.driven_at == "road" or any(p.speed_held in ("cruise", "free") for p in passes)
        edged = loose or any(key in self.tires.paths for key in met)
        road = effective_road(np.arange(first, last + 1) * step, stack("rise_m"), stretch, drag, edged=edged)
        of_pass = [met.index(p.key) for p in passes]
        return road.of_runs(of_pass)


def load_case_matrices(
    vehicle: Vehicle, load_cases: Mapping[str, LoadCase], passes: Iterable[Pass]
) -> dict[str, PlanarMatrices]:
    """Matrices of the vehicle in every load case of the passes."""
    first = next(iter(load_cases.values()))
    return {name: assemble(vehicle, load_cases[name], first) for name in {p.load_case for p in passes}}


def _hold_s(one: Pass, matrices: PlanarMatrices) -> float:
    """Time constant [s] that holds the speed; what tows a truck, or nothing, is not its own drive."""
    if one.hold_s is not None:
        return one.hold_s
    if matrices.hold_s is None or one.speed_held in ("towed", "free"):
        return HOLD_S[one.speed_held]
    return matrices.hold_factor * matrices.hold_s


def pass_matrices(
    matrices: Mapping[str, PlanarMatrices],
    passes: Sequence[Pass],
    body_points: list[tuple[int, float]],
    rate_points: Sequence[tuple[int, float | None]] = (),
) -> StackedMatrices:
    """Matrices of several passes from those of their load cases.

    Accelerometers are at `body_points` (body, x_m), sensors of pitch rate at `rate_points`.
    """
    of_passes = [matrices[p.load_case] for p in passes]
    hold_s = [_hold_s(p, m) for p, m in zip(passes, of_passes, strict=True)]
    return stack_matrices(of_passes, body_points, hold_s, rate_points)


def make_pass_batch(
    vehicle: Vehicle,
    load_cases: Mapping[str, LoadCase],
    roads: EffectiveRoads,
    passes: Sequence[Pass],
    body_points: list[tuple[int, float]],
    rate_points: Sequence[tuple[int, float | None]] = (),
) -> PassBatch:
    """The batch of several passes; body accelerometers at (body, x_m) `body_points`, pitch rates at `rate_points`."""
    first = next(iter(load_cases.values()))
    return PassBatch(
        matrices=pass_matrices(load_case_matrices(vehicle, load_cases, passes), passes, body_points, rate_points),
        road=roads.stacked(passes),
        axle_x=np.array([a.x_m for a in vehicle.axles])[:, None],
        reference_load=np.tile(np.array(first.axle_loads_kg)[:, None] * vehicle.gravity_m_s2, (len(passes), 1, 1)),
    )
