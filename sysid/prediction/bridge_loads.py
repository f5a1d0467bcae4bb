"""Load effects on bridges: the calibrated vehicles of all draws and the modes of the bridge as one system.

The deck's deflection under every axle is a road that moves (:func:`sysid.bridge.moving.coupled`): the vehicle is
integrated over surface and deck with all its laws, the modes answer its axle loads exactly, and both are repeated until
they agree.  The slope of the deck turns no vertical force into a horizontal one: it is a thousandth or less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid import limits
from sysid.arrays import DrawsByParameters
from sysid.bridge.moving import (
    Alike,
    Crossing,
    DeckMotion,
    EffectTimes,
    alike,
    coupled,
    deck_motion,
    dynamic_effects,
    effect_times,
    static_effects,
)
from sysid.campaign.bridges import BridgeCourse, Surface
from sysid.campaign.records import PredictionRequest
from sysid.errors import CampaignError
from sysid.estimation.fit.state import FitState
from sysid.prediction.assumed_stops import AssumedStops
from sysid.prediction.bridge_effects import BridgeLoads
from sysid.prediction.effect_extremes import EffectExtremes, bridge_loads, bridge_of, effect_extremes, stored_instants
from sysid.prediction.felt_road import GENTLE_STEP_M, HARSH
from sysid.prediction.finite import check_finite
from sysid.prediction.measures import extremes
from sysid.prediction.pass_over_road import pass_over_road
from sysid.prediction.predicted_passes import PassPrediction
from sysid.prediction.trust import DrivenRange
from sysid.prediction.vehicle_draws import VehicleDraws
from sysid.prediction.vehicle_groups import Driven, VehicleGroup, felt_by_vehicle, vehicle_groups
from sysid.progress import Progress, unwatched
from sysid.road.roughness import class_road
from sysid.threads import side_by_side
from sysid.vehicle_model.contact import EffectiveRoad, effective_road, raised
from sysid.vehicle_model.engine import Timing

#: Interval of the histories of vehicle and bridge [s], and steps of the vehicle in it on gentle and on harsh roads.
INTERVAL_S = 0.002
_GENTLE_STEPS, _HARSH_STEPS = 1, 4
#: Road of a class before the bridge and behind it [m]; how long of the approach is driven, and in which its heights
#: grow out of a level road [s].
APPROACH_M, BEHIND_M = 150.0, 30.0
APPROACH_S, GROWTH_S = 5.0, 1.5
#: Shortest approach in a measured road that goes without a sentence [s].
_SHORT_S = 2.0
#: Level road before a bridge without a surface [m].
_LEVEL_M = 2.0
#: So many draws cross first, to show the others where to begin.
_FEW = 4
#: How long the bridge is followed when the last axle has left it: periods of its first mode, at most so long [s].
_PERIODS, _TAIL_S = 2.0, 2.0


@dataclass(frozen=True)
class _Ground:
    """What wheels meet before the deck moves: a road whose station 0 is the first support.

    `lead` samples are driven before it; `substeps` of the integration per sample; `misfit` of harsh roads.
    """

    road: EffectiveRoad
    lead: int
    substeps: int
    misfit: float


@dataclass(frozen=True)
class _Found:
    """Some draws over one surface: load effects, axle loads of the first vehicle (T, na, t), their extremes (na, t)."""

    effects: EffectExtremes
    tire_N: np.ndarray
    static_N: np.ndarray
    most: dict[str, np.ndarray]
    rounds: int


class BridgeVehicles:
    """The vehicles of all draws in every load case, kept from one pass to the next."""

    def __init__(
        self,
        state: FitState,
        sets: DrawsByParameters,
        vehicles: VehicleDraws | None,
        stops: AssumedStops | None,
    ):
        self.state, self.sets, self.vehicles, self.stops = state, sets, vehicles, stops
        self._groups: dict[str, tuple[np.ndarray, list[VehicleGroup], VehicleGroup | None]] = {}

    def of(self, load_case: str) -> tuple[np.ndarray, list[VehicleGroup], VehicleGroup | None]:
        """Static axle loads as weighed (na,) [N], the vehicles of a load case, and a few of them if there are more."""
        if load_case not in self._groups:
            axles = len(self.state.campaign.vehicle.axles)
            level = effective_road(GENTLE_STEP_M * np.arange(40), np.zeros((1, axles, 40)))
            batch, groups = vehicle_groups(self.state, load_case, level, self.sets, self.vehicles, self.stops)
            for group in groups:
                # Before several threads ask for it at once.
                _ = group.static_N
            few = None
            if len(self.sets) > _FEW:
                drawn = self.vehicles and self.vehicles.first(_FEW)
                few = vehicle_groups(self.state, load_case, level, self.sets[:_FEW], drawn, self.stops)[1][0]
            self._groups[load_case] = batch.matrices.static_load[0, :, 0], groups, few
        return self._groups[load_case]


def predict_bridge(
    vehicles: BridgeVehicles, request: PredictionRequest, driven: DrivenRange, progress: Progress = unwatched
) -> PassPrediction:
    """Axle loads and load effects of one pass over a bridge, for a point estimate or for posterior draws.

    Every draw crosses over every realisation of the surface.  Quantiles of load effects are over draws and
    realisations together.

    Parameters
    ----------
    request : with a bridge.
    driven : what the driven runs reached.

    Raises
    ------
    CampaignError
        If the pass would take too long.
    DataRejectedError
        If forces are not finite, or vehicle and bridge come to no common motion.
    """
    state, course, speed = vehicles.state, request.bridge, request.speed_m_s
    assert course is not None
    bridge = bridge_of(course.bridge)
    x = np.array([axle.x_m for axle in state.campaign.vehicle.axles])
    behind = float(x.max()) + course.gap_m
    all_x = np.concatenate([x + behind * k for k in range(course.vehicles)])
    modes = bridge.modes
    tail = 0.0 if modes is None else min(_PERIODS / modes.frequency_hz[0], _TAIL_S)
    duration = (bridge.length_m + all_x.max()) / speed + tail
    _check_duration(course, speed, duration)
    samples = int(np.ceil(duration / INTERVAL_S)) + 2
    time = INTERVAL_S * np.arange(samples)
    crossing = Crossing(speed * time[:, None] - all_x, INTERVAL_S)
    times = effect_times(bridge, crossing)
    motion = None if modes is None else deck_motion(modes, crossing)
    static, groups, few = vehicles.of(request.load_case)
    grounds = _grounds(state, request, course, bridge.length_m + float(all_x.max()))

    def shown(ground: _Ground) -> Alike | None:
        if motion is None or few is None:
            return None
        of_few = _Draws(ground, few, crossing, x, behind, speed)
        return alike(motion, of_few.forces, coupled(motion, of_few.forces, float(few.static_N.mean())))

    # All draws move the deck much alike.
    begun = side_by_side(shown, grounds)

    def cross(pair: tuple[int, VehicleGroup]) -> _Found:
        number, group = pair
        progress(course.label, 0.0)
        draws = _Draws(grounds[number], group, crossing, x, behind, speed)
        return _crossed(state, request, draws, times, motion, begun[number])

    found = side_by_side(cross, [(number, group) for number in range(len(grounds)) for group in groups])
    first = found[: len(groups)]
    measured = _largest(found, len(groups))
    misfit = max(g.misfit for g in grounds)
    of_all = [f.effects for f in found]
    loads = bridge_loads(course, times, crossing, of_all, of_all[: len(groups)], max(f.rounds for f in found))
    tire, at_rest = (np.concatenate(of, axis=-1) for of in ([f.tire_N for f in first], [f.static_N for f in first]))
    # What the pass over the deck leaves out of a truck's balance is on the bridge: the sum is not judged.
    measured |= {"mean_ratio": tire.mean(axis=0) / at_rest, "sum_ratio": np.ones((1, tire.shape[-1]))}
    return pass_over_road(
        state.campaign,
        request,
        time[::2],
        tire,
        measured,
        static,
        driven,
        vehicles.stops if vehicles.vehicles is None else vehicles.vehicles.stops,
        _said(request, loads, misfit),
        bridge=loads,
    )


def _check_duration(course: BridgeCourse, speed_m_s: float, duration_s: float) -> None:
    if duration_s > limits.BRIDGE_SECONDS:
        raise CampaignError(
            f"The pass over {course.label} takes {duration_s:.3g} s at {3.6 * speed_m_s:.3g} km/h, at most "
            f"{limits.BRIDGE_SECONDS:g} s are predicted; choose a higher speed."
        )


# ---------------------------------------------------------------------- surface


def _grounds(state: FitState, request: PredictionRequest, course: BridgeCourse, end_m: float) -> list[_Ground]:
    surface, speed = course.surface, request.speed_m_s
    end_m += BEHIND_M
    if surface is None:
        lead = int(np.ceil(_LEVEL_M / speed / INTERVAL_S))
        station = GENTLE_STEP_M * np.arange(-int(np.ceil(2 * _LEVEL_M / GENTLE_STEP_M)), int(end_m / GENTLE_STEP_M))
        rise, stretch, drag = (
            np.zeros((*rows, 1, len(state.campaign.vehicle.axles), station.size)) for rows in ((), (4,), (3,))
        )
        return [_Ground(effective_road(station, rise, stretch, drag), lead, _GENTLE_STEPS, 0.0)]
    grounds = []
    for k in range(surface.course.realisations):
        station, height, at = _heights(surface, k, end_m)
        felt = felt_by_vehicle(state, request.load_case, station, height)
        lead = int(np.ceil(min(at, APPROACH_S * speed) / speed / INTERVAL_S))
        start = at - speed * lead * INTERVAL_S
        one = felt.stretch_of(start, min(GROWTH_S * speed, 0.5 * max(at, 1.0)), at + end_m)
        road = replace(one, first_station_m=one.first_station_m - at)
        steps = _HARSH_STEPS if felt.harsh else _GENTLE_STEPS
        grounds.append(_Ground(road, lead, steps, 0.0 if felt.harsh else felt.misfit))
    return grounds


def _heights(surface: Surface, realisation: int, end_m: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Stations and mean heights of both tracks [m], and the station of the first support."""
    course = surface.course
    if course.roughness is not None:
        station, tracks = class_road(course.roughness, APPROACH_M + end_m, course.seed + realisation)
        return station, tracks.mean(axis=0), APPROACH_M
    assert course.height_m is not None
    height = np.atleast_2d(course.height_m).mean(axis=0)
    return course.step_m * np.arange(height.size), height, surface.bridge_at_m


# ---------------------------------------------------------------------- motion


@dataclass
class _Draws:
    """Some draws over one surface: axle loads for any motion of the deck, and the last histories of each vehicle."""

    ground: _Ground
    group: VehicleGroup
    axles: Crossing
    axle_x: np.ndarray
    behind_m: float
    speed_m_s: float

    def __post_init__(self) -> None:
        self.last: dict[int, Driven] = {}

    @property
    def vehicles(self) -> int:
        """How many follow each other."""
        return int(self.axles.place_m.shape[1]) // self.axle_x.size

    def forces(self, deck_m: np.ndarray) -> np.ndarray:
        """Axle loads (T, na', t) [N] over deflections of the deck under all axles (T, na', t or 1) [m]."""
        count, speed, draws = self.axle_x.size, self.speed_m_s, len(self.group.sets)
        force = np.empty((len(deck_m), self.vehicles * count, draws))
        timing = Timing(self.ground.lead + len(deck_m), INTERVAL_S, self.ground.substeps)
        for number in range(self.vehicles):
            own = slice(number * count, (number + 1) * count)
            road = _on_deck(self.ground.road, deck_m[:, own], self.axles.place_m[0, own], speed, self.axles.interval_s)
            if len(road.rise) < draws:
                road = road.for_all(draws)
            start_s = self.ground.lead * INTERVAL_S + number * self.behind_m / speed
            found = self.last[number] = self.group.driven(road, self.axle_x, speed, start_s, timing)
            force[:, own] = found.tire_N[self.ground.lead :]
        return force


def _crossed(
    state: FitState,
    request: PredictionRequest,
    draws: _Draws,
    times: EffectTimes,
    motion: DeckMotion | None,
    begun: Alike | None,
) -> _Found:
    """Some draws over one surface, vehicle and bridge as one system where the bridge has modes.

    `begun` is how other draws and the deck moved together.
    """
    group, crossing, vehicles = draws.group, draws.axles, draws.vehicles
    samples, axles = len(crossing.place_m), draws.axle_x.size
    static = np.tile(group.static_N, (vehicles, 1))[None]
    if motion is None:
        rolling = draws.forces(np.zeros((samples, axles * vehicles, 1)))
        force, rounds = rolling, 1
    else:
        force, rolling, rounds = coupled(motion, draws.forces, float(static.mean()), begun)
    one = draws.last[0]
    check_finite(request, state.parameters, group.sets.T, group.static_N[:, 0], one.tire_N, one.suspension_N)

    def erring(tire_N: np.ndarray) -> np.ndarray:
        each = (group.erring(tire_N[:, k : k + axles]) for k in range(0, axles * vehicles, axles))
        return np.concatenate(list(each), axis=1)

    force = erring(force)
    dynamic = static_effects(times, force) if motion is None else dynamic_effects(times, motion, force)
    lead = draws.ground.lead
    sunk = group.sunk_m(one.tire_N[lead:].max(axis=0)[None])
    most = extremes(sunk, one.extension_m[lead:], force[:, :axles], INTERVAL_S)
    effects = {"static": static_effects(times, static), "rolling": static_effects(times, erring(rolling))}
    effects["dynamic"] = dynamic
    front = times.between(crossing.place_m[:, 0])
    # Every second sample of the axle loads is enough for whoever reads them.
    return _Found(
        effect_extremes(effects, front, stored_instants(times)),
        force[::2, :axles],
        group.static_N,
        most | {"most": force[:, :axles].max(axis=0), "least": force[:, :axles].min(axis=0)},
        rounds,
    )


def _on_deck(
    base: EffectiveRoad, deck_m: np.ndarray, start_m: np.ndarray, speed_m_s: float, interval_s: float
) -> EffectiveRoad:
    """The road of every axle with the deck's deflection (T, na, t or 1) [m] where it meets it, cubic between samples.

    `start_m` (na,) is where each axle is at the first sample.
    """
    if not deck_m.any():
        return base
    station = base.station_m
    on = np.flatnonzero((station >= 0.0) & (station <= station[-1] - BEHIND_M))
    rise = np.empty((deck_m.shape[2], start_m.size, on.size))
    for axle, start in enumerate(start_m):
        instant = (station[on] - start) / (speed_m_s * interval_s)
        before = np.clip(np.floor(instant).astype(int) - 1, 0, len(deck_m) - 4)
        t = instant - before
        weights = (
            -(t - 1.0) * (t - 2.0) * (t - 3.0) / 6.0,
            t * (t - 2.0) * (t - 3.0) / 2.0,
            -t * (t - 1.0) * (t - 3.0) / 2.0,
            t * (t - 1.0) * (t - 2.0) / 6.0,
        )
        known = (instant >= 0.0) & (instant <= len(deck_m) - 1)
        rise[:, axle] = -sum(w * known * deck_m[before + k, axle].T for k, w in enumerate(weights))
    return raised(base, int(on[0]), rise)


# ---------------------------------------------------------------------- results


def _largest(found: Sequence[_Found], groups: int) -> dict[str, np.ndarray]:
    """Extremes (na, n) of the first vehicle over all surfaces; time off the road is the mean of all."""
    by_surface = [found[k : k + groups] for k in range(0, len(found), groups)]
    whole: dict[str, np.ndarray] = {}
    for name in found[0].most:
        values = np.stack([np.concatenate([f.most[name] for f in part], axis=-1) for part in by_surface])
        if name == "lift_off_s":
            whole[name] = values.mean(axis=0)
        else:
            whole[name] = values.min(axis=0) if name == "least" else values.max(axis=0)
    return whole


def _said(request: PredictionRequest, loads: BridgeLoads, misfit: float) -> list[str]:
    """What has to be known about load effects of a pass."""
    course, said = request.bridge, []
    assert course is not None
    if loads.frequency_hz.size == 0:
        said.append(
            f"{request.bump}: the bridge has influence lines and no modes; its own motion is not in the load effects."
        )
    if misfit > HARSH:
        said.append(
            f"{request.bump}: the surface has edges that a tire does not smooth as the model has it; axle loads there "
            f"may be off by {100.0 * misfit:.0f} % of the static load."
        )
    surface = course.surface
    if surface is not None and surface.course.roughness is not None and surface.course.realisations == 1:
        said.append(
            f"{request.bump}: the intervals are those of the vehicle on this one surface. Another surface of class "
            f"{surface.course.roughness} changes the amplification, often by more: add --realisations 5 or more."
        )
    if surface is not None and surface.course.roughness is None and surface.bridge_at_m < _SHORT_S * request.speed_m_s:
        said.append(
            f"{request.bump}: the surface begins {surface.bridge_at_m:g} m before the bridge, less than "
            f"{_SHORT_S:g} s at this speed; the vehicle arrives calmer than it would be."
        )
    if surface is not None and surface.course.roughness is None:
        rest = surface.course.length_m - surface.bridge_at_m
        if rest < loads.length_m:
            said.append(f"{request.bump}: the surface ends {rest:g} m behind the first support; the rest is level.")
    return said
