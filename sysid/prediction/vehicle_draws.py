"""Histories of one pass for many draws of parameters and masses: every draw is a pass with matrices of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from scipy.special import ndtri

from sysid.arrays import DrawsByParameters
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.axle_laws import LawInputs, law_inputs, laws_side_by_side
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.uncertainty.allowances import Allowances, campaign_allowances
from sysid.prediction.assumed_stops import AssumedStops, assumed_stops
from sysid.prediction.driven_range import spring_deflection
from sysid.prediction.trust import DrivenRange
from sysid.threads import side_by_side
from sysid.vehicle_model.contact import EffectiveRoad, RoadRise, raised_along, roads_side_by_side
from sysid.vehicle_model.device_arrays import HostOrDevice, ParametersBySets
from sysid.vehicle_model.engine import Timing, WheelRoad, wheel_road
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.passes import EffectiveRoads, Pass, PassBatch, load_case_matrices, pass_matrices
from sysid.vehicle_model.stacked_matrices import StackedMatrices, runs_side_by_side

#: Passes that are simulated side by side.
TOGETHER = 20
#: Standard deviation of a wheel's dynamic force over what the model makes of it, with parameters, masses and departures
#: known, an assumption: with it intervals of the peaks of 52 trucks of other equations, with radial springs for tires,
#: hold about nine in ten (`python -m studies.independent`, seeds 20261126 and 20926085, development).
CONTACT_ERROR = 0.006
#: The same over edges at speeds far beyond those that were driven over edges, an assumption: tandem cams and
#: overlapping areas, both in use, give one steer axle peaks of 2.33 and 1.85 static loads at 24 km/h over a bump of
#: 0.3 m. These dynamic forces are a factor 1.56 apart; the standard deviation of two such logarithms is 0.31.
#: Runs over edges tell what tires do at their own speeds; what dampers and belts do at others is not in them.
EDGE_ERROR = 0.31


#: Standard deviation of a side's share of its axle's load over what the model makes of it: frames are twisted,
#: springs stand unlike each other, and roll is linear. An assumption: of one simulated truck of other equations, shares
#: were off by up to 0.02 at rest and 0.04 at the peaks.
SHARE_ERROR = 0.02


@dataclass(frozen=True)
class VehicleDraws:
    """One vehicle for each of n draws of the parameters.

    - `amounts` (n, m + d): log factors on the m uncertain masses, then amplitudes of the d departures;
    - `stops`: the assumed ones, None without any;
    - `contact_error` (n, na): relative error of the dynamic force of every axle, None for none;
    - `share_error` (n, na): error of the left side's share of the axle's load, None for none.
    """

    allowances: Allowances
    amounts: np.ndarray
    stops: AssumedStops | None = None
    contact_error: np.ndarray | None = None
    share_error: np.ndarray | None = None

    def __post_init__(self) -> None:
        given, width = self.amounts.shape[1], self.allowances.count
        if given != width:
            raise ValueError(f"Draws of {given} masses and departures do not fit a vehicle with {width} of them.")

    def over(self, roads: EffectiveRoads) -> VehicleDraws:
        """The same vehicles over other roads."""
        departures = self.allowances.departures.over(roads)
        return replace(self, allowances=replace(self.allowances, departures=departures))

    def over_edges(self, speed_m_s: float, driven_m_s: float) -> VehicleDraws:
        """The same with the contact errors of a pass over edges, which were driven over at `driven_m_s` at most [m/s].

        Their standard deviation is that of smooth bumps and :data:`EDGE_ERROR` (1 - driven speed / speed) together.
        They are spaced as quantiles, in the order of those that were drawn: medians and bands of few draws do not jump.
        """
        further, error = EDGE_ERROR * max(0.0, 1.0 - driven_m_s / speed_m_s), self.contact_error
        if error is None or not further:
            return self
        rank = np.argsort(np.argsort(error, axis=0), axis=0)
        return replace(self, contact_error=np.hypot(CONTACT_ERROR, further) * ndtri((rank + 0.5) / len(error)))

    def first(self, count: int) -> VehicleDraws:
        """The vehicles of the first draws."""
        error, share = (None if e is None else e[:count] for e in (self.contact_error, self.share_error))
        stops = self.stops and self.stops.first(count)
        return replace(self, amounts=self.amounts[:count], stops=stops, contact_error=error, share_error=share)


def vehicles_of(
    state: FitState,
    roads: EffectiveRoads,
    sets: DrawsByParameters,
    driven: DrivenRange,
    random: np.random.Generator | None = None,
) -> tuple[VehicleDraws | None, AssumedStops | None]:
    """The vehicles of predicted passes for sets (n, p) of log parameters, and assumed stops of the declared vehicle.

    With `random` masses, departures, stops and contact errors are drawn.  Without it masses and departures are the most
    likely ones given the parameters, travels the medians, and there is no contact error.  The vehicles are None where
    the fit relates no masses to the parameters.
    """
    campaign, parameters, response = state.campaign, state.parameters, state.point.mass_response
    vehicle, count = campaign.vehicle, len(sets)
    stops = assumed_stops(vehicle, parameters, driven, None)
    if response is None:
        return None, stops
    amounts = response.mean(sets) if random is None else response.draws(sets, random)
    drawn = assumed_stops(vehicle, parameters, driven, random, count)
    error, share = (
        None if random is None else sd * random.standard_normal((count, len(vehicle.axles)))
        for sd in (CONTACT_ERROR, SHARE_ERROR)
    )
    # Other bumps are known without their sides; the unknowns are those of the fit.
    allowances = replace(campaign_allowances(campaign, parameters, roads), masses=state.allowances.masses)
    return VehicleDraws(allowances, amounts, drawn, error, share), stops


class DrawnVehicles(NamedTuple):
    """Some draws in one pass, at most :data:`TOGETHER`: `chosen` (t,) by number, and the laws of each."""

    chosen: np.ndarray
    matrices: StackedMatrices
    laws: Sequence[LawInputs]
    road: EffectiveRoad


#: Makes some of the draws' vehicles when it is called: those of all draws take much memory.
MakesVehicles = Callable[[], DrawnVehicles]


def vehicle_of(
    batch: PassBatch, parameters: ParameterSet, allowances: Allowances, driven: Pass, amounts: np.ndarray
) -> tuple[StackedMatrices, LawInputs]:
    """Matrices and laws of the vehicle with the masses and departures of `amounts` (m + d,) in one pass.

    `batch` is that of the pass with declared masses.
    """
    log_factors, amplitudes = allowances.split(amounts)
    vehicle, cases = allowances.masses.applied(log_factors)
    matrices = pass_matrices(load_case_matrices(vehicle, cases, [driven]), [driven], [])
    inputs = law_inputs(vehicle, parameters, replace(batch, matrices=matrices), [driven.load_case])
    return matrices, allowances.departures.laws(inputs, amplitudes, [driven.load_case], all_elements=True)


def drawn_vehicles(
    batch: PassBatch,
    parameters: ParameterSet,
    vehicles: VehicleDraws,
    driven: Pass,
    road: EffectiveRoad | None = None,
) -> tuple[MakesVehicles, ...]:
    """The vehicles of all draws in the pass `driven`, of which `batch` is the one with declared masses.

    `road` is the same for all of them; None for that of the bump, with the departures of every draw.
    """
    count = len(vehicles.amounts)

    def some(first: int) -> DrawnVehicles:
        chosen = np.arange(first, min(first + TOGETHER, count))
        matrices, laws, roads = [], [], []
        for draw in chosen:
            amounts = vehicles.amounts[draw]
            of_draw, inputs = vehicle_of(batch, parameters, vehicles.allowances, driven, amounts)
            matrices.append(of_draw)
            laws.append(inputs if vehicles.stops is None else vehicles.stops.on(inputs, int(draw)))
            roads.append(road or vehicles.allowances.road([driven], amounts))
        stacked = jax.tree.map(lambda *parts: runs_side_by_side(parts), *matrices)
        return DrawnVehicles(chosen, stacked, laws, roads_side_by_side(roads))

    return tuple(partial(some, first) for first in range(0, count, TOGETHER))


def histories_of_draws(
    drawn: Sequence[MakesVehicles],
    axle_x: np.ndarray,
    log_parameters: DrawsByParameters,
    motion: Motion,
    timing: Timing,
    contact_error: np.ndarray | None,
    rise: RoadRise | None = None,
) -> tuple[np.ndarray, ...]:
    """Tire forces and suspension forces, static load included, [N], suspension and tire deflections [m] of n draws.

    Each is an array (T, na, n); static loads (na, n) [N] come last.

    Parameters
    ----------
    drawn : the vehicles of all draws; axle_x : (na, 1) [m]; log_parameters : (n, p).
    motion : speed [m/s] and start [s] (1, 1).
    contact_error : (n, na), see :class:`VehicleDraws`.
    rise : of one run, what its road has beside that of the vehicles, None for nothing.
    """
    count = log_parameters.shape[0]
    # Filled chunk by chunk: chunks that are joined in the end take twice the memory.
    histories = np.empty((4, timing.samples, count, len(axle_x)))
    at_rest = np.empty((count, len(axle_x)))

    def fill(make: MakesVehicles) -> None:
        some = make()
        speed, start_s = (np.tile(x, (some.chosen.size, 1)) for x in (motion.speed, motion.start_s))
        met = some.road
        if rise is not None:
            height_m = np.repeat(rise.height_m, len(met.rise), axis=0)
            met = raised_along(met, replace(rise, height_m=height_m))
        road = wheel_road(some.matrices, met, axle_x, Motion(speed, start_s), timing)
        sets = log_parameters[some.chosen, :, None]
        found = histories_of_vehicles(some.matrices, some.laws, road, list(sets), timing)
        first, end = some.chosen[0], some.chosen[-1] + 1
        tire, suspension, *deflections = (np.asarray(part)[:, : end - first, :, 0] for part in found)
        static = some.matrices.static_load[: end - first, :, 0]
        if contact_error is not None:
            tire = with_contact_error(tire, static, contact_error[some.chosen])
        at_rest[first:end] = static
        carried = some.matrices.carried_load[: end - first, :, 0]
        for whole, part in zip(histories, (tire, suspension + carried, *deflections), strict=True):
            whole[:, first:end] = part

    # While the engine computes for one thread, another one makes vehicles.
    side_by_side(fill, drawn)
    return (*(np.moveaxis(history, 1, 2) for history in histories), at_rest.T)


def with_contact_error(tire_N: np.ndarray, static_N: np.ndarray, error: np.ndarray) -> np.ndarray:
    """F_s + (1 + e) (F - F_s), not below zero, and zero where the wheel is off the road.

    Parameters
    ----------
    tire_N : (T, n, na) F; static_N : (n, na) F_s [N]; error : (n, na) e.  Or axles before draws in all of them.
    """
    return np.asarray(np.where(tire_N > 0.0, np.maximum(static_N + (1.0 + error) * (tire_N - static_N), 0.0), 0.0))


def histories_of_vehicles(
    matrices: StackedMatrices,
    laws: Sequence[LawInputs],
    road: WheelRoad,
    sets: Sequence[ParametersBySets],
    timing: Timing,
) -> tuple[HostOrDevice, HostOrDevice, HostOrDevice, HostOrDevice]:
    """Tire and suspension forces [N], suspension and tire deflections [m] (T, R, na, S) of vehicles side by side."""
    suspension, tire = laws_side_by_side(laws, sets)
    histories = road.engine.histories(matrices, suspension, tire, road, timing)
    sunk = spring_deflection(tire, histories.tire_force)
    return histories.tire_force, histories.suspension_force, histories.deflection, sunk
