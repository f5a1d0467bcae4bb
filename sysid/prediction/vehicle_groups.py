"""Vehicles of all draws, some at a time, for passes over roads and bridges; and what they feel of a surface."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property, partial

import jax
import numpy as np

from sysid.arrays import DrawsByParameters, Stations
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.axle_laws import law_inputs, laws_side_by_side
from sysid.prediction.assumed_stops import AssumedStops
from sysid.prediction.driven_range import spring_deflection
from sysid.prediction.felt_road import EdgeLoads, FeltRoad, Misfit, felt_road, misfit_on_springs
from sysid.prediction.vehicle_draws import (
    TOGETHER,
    DrawnVehicles,
    MakesVehicles,
    VehicleDraws,
    drawn_vehicles,
    with_contact_error,
)
from sysid.road.wheel_paths import WheelPaths
from sysid.vehicle_model.contact import EffectiveRoad, TireLaw
from sysid.vehicle_model.engine import Timing, wheel_road
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.passes import MapTires, Pass, PassBatch, declared_tires, load_case_matrices, pass_matrices
from sysid.vehicle_model.stacked_matrices import SPEED_HOLD_S, StackedMatrices, runs_side_by_side
from sysid.vehicle_model.suspension import SuspensionLaw
from sysid.vehicle_model.wheel_places import wheel_paths

#: Below this speed [m/s] it is held the more tightly the slower the pass: the truck falls behind in proportion to its
#: time on the bump, and far from the nominal place the Taylor series of the road means nothing.
SLOW_M_S = 4.0 / 3.6


def hold_s(speed_m_s: float) -> float | None:
    """Time constant [s] with which a slow pass over a bump holds its speed [m/s]; None for that of all passes."""
    return SPEED_HOLD_S * speed_m_s / SLOW_M_S if speed_m_s < SLOW_M_S else None


@dataclass(frozen=True)
class Driven:
    """Histories (T, na, t) of t vehicles: tire and suspension forces [N], suspension deflections [m].

    `body` (T, nb, t) coordinates of the bodies.
    """

    tire_N: np.ndarray
    suspension_N: np.ndarray
    extension_m: np.ndarray
    body: np.ndarray

    def after(self, samples: int) -> Driven:
        """The histories without their first samples."""
        return Driven(*(getattr(self, field.name)[samples:] for field in fields(self)))


@dataclass(frozen=True)
class VehicleGroup:
    """How some vehicles are made, their log parameters (t, p) and relative contact errors (t, na), None without."""

    make: MakesVehicles
    sets: np.ndarray
    contact_error: np.ndarray | None

    @cached_property
    def made(self) -> tuple[StackedMatrices, SuspensionLaw, TireLaw]:
        """Matrices and laws of the vehicles, made once."""
        some = self.make()
        return some.matrices, *laws_side_by_side(some.laws, list(self.sets[:, :, None]))

    @property
    def static_N(self) -> np.ndarray:
        """Static axle loads (na, t) [N]."""
        return np.asarray(self.made[0].static_load[:, :, 0].T)

    def driven(
        self, road: EffectiveRoad, axle_x: np.ndarray, speed_m_s: float, start_s: float, timing: Timing
    ) -> Driven:
        """The vehicles over a road (t, na, n), each at a speed from its start on; `axle_x` (na,) [m]."""
        matrices, suspension, tire = self.made
        count = len(self.sets)
        motion = Motion(np.full((count, 1), speed_m_s), np.full((count, 1), start_s))
        wheels = wheel_road(matrices, road, axle_x[:, None], motion, timing)
        found = wheels.engine.histories(matrices, suspension, tire, wheels, timing)
        parts = (found.tire_force, found.suspension_force, found.deflection, found.body)
        return Driven(*(np.moveaxis(np.asarray(part)[:, :, :, 0], 1, 2) for part in parts))

    def sunk_m(self, tire_N: np.ndarray) -> np.ndarray:
        """Deflections (T, na, t) [m] of the tires whose springs carry these forces (T, na, t)."""
        sunk = spring_deflection(self.made[2], np.moveaxis(tire_N, 1, 2)[..., None])
        return np.moveaxis(np.asarray(sunk)[..., 0], 1, 2)

    def wheels(self, driven: Driven, place_m: np.ndarray) -> WheelPaths:
        """Where the wheels' centres were in histories of the vehicles; `place_m` (T, na) of axles at even speed [m]."""
        matrices, suspension, _ = self.made
        return wheel_paths(matrices, suspension, driven.body, driven.extension_m, place_m[:, :, None])

    def erring(self, tire_N: np.ndarray) -> np.ndarray:
        """Tire forces (T, na, t) [N] with the contact error of every draw."""
        if self.contact_error is None:
            return tire_N
        return with_contact_error(tire_N, self.static_N, self.contact_error.T)


def felt_by_vehicle(
    state: FitState, load_case: str, station_m: Stations, height_m: Stations, paths: WheelPaths | None = None
) -> FeltRoad:
    """What the tires of a calibrated vehicle feel of a surface (:func:`sysid.prediction.felt_road.felt_road`)."""
    return felt_road(station_m, height_m, *_felt_with(state, load_case), state.point.contact, paths)


def misfit_by_vehicle(
    state: FitState, load_case: str, station_m: Stations, height_m: Stations, loads: EdgeLoads
) -> Misfit:
    """How far loads are from those of the springs (:func:`sysid.prediction.felt_road.misfit_on_springs`)."""
    return misfit_on_springs(loads, station_m, height_m, *_felt_with(state, load_case))


def _felt_with(state: FitState, load_case: str) -> tuple[Vehicle, LoadCase, LoadCase, MapTires]:
    """Vehicle, load case, the first load case, and tires."""
    campaign, cases = state.campaign, state.campaign.load_cases
    tires = state.point.tires or declared_tires(campaign.vehicle)
    return campaign.vehicle, cases[load_case], next(iter(cases.values())), tires


def vehicle_groups(
    state: FitState,
    load_case: str,
    road: EffectiveRoad,
    sets: DrawsByParameters,
    vehicles: VehicleDraws | None,
    stops: AssumedStops | None,
    held_s: float | None = SPEED_HOLD_S,
) -> tuple[PassBatch, list[VehicleGroup]]:
    """The pass of the vehicle with declared masses, and the vehicles of all draws, some at a time.

    Without `vehicles` all of them are the declared one with the assumed `stops`.  `road` is the same for all, and the
    speed is held with the time constant `held_s` [s], None for that of the vehicle.
    """
    campaign, parameters = state.campaign, state.parameters
    vehicle, cases = campaign.vehicle, campaign.load_cases
    wanted = Pass(load_case, "", hold_s=held_s)
    first = next(iter(cases.values()))
    batch = PassBatch(
        pass_matrices(load_case_matrices(vehicle, cases, [wanted]), [wanted], []),
        road,
        np.array([axle.x_m for axle in vehicle.axles])[:, None],
        np.array(first.axle_loads_kg)[None, :, None] * vehicle.gravity_m_s2,
    )
    error = None
    if vehicles is not None:
        makers = drawn_vehicles(batch, parameters, vehicles, wanted, road)
        error = vehicles.contact_error
    else:
        laws = law_inputs(vehicle, parameters, batch, [load_case])
        laws = laws if stops is None else stops.on(laws, 0)

        def same(first: int) -> DrawnVehicles:
            chosen = np.arange(first, min(first + TOGETHER, len(sets)))
            matrices = jax.tree.map(lambda *p: runs_side_by_side(p), *[batch.matrices] * chosen.size)
            return DrawnVehicles(chosen, matrices, [laws] * chosen.size, road)

        makers = tuple(partial(same, first) for first in range(0, len(sets), TOGETHER))
    parts = [slice(k * TOGETHER, (k + 1) * TOGETHER) for k in range(len(makers))]
    return batch, [
        VehicleGroup(make, sets[part], None if error is None else error[part])
        for make, part in zip(makers, parts, strict=True)
    ]
