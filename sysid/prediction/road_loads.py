"""Axle loads over rough roads of any length: stretches side by side, each after a run-up from rest.

A vehicle forgets within seconds, so that a long road is driven in stretches of :data:`STRETCH_S`.  Each begins
:data:`RUN_UP_S` earlier on level road, out of which the road grows; what is felt meanwhile is thrown away.  Memory then
depends on the number of draws that are simulated together, and time on the length of the road.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from sysid import limits
from sysid.arrays import DrawsByParameters, Stations
from sysid.campaign.records import PredictionRequest
from sysid.campaign.roads import RoadCourse
from sysid.errors import CampaignError
from sysid.estimation.fit.state import FitState
from sysid.prediction.assumed_stops import AssumedStops
from sysid.prediction.bump_edges import driven_over_edges_m_s
from sysid.prediction.felt_road import HARSH, MOST_HARSH_M, EdgeLoads, FeltRoad, Misfit
from sysid.prediction.finite import check_finite
from sysid.prediction.measures import extremes, quantiles
from sysid.prediction.pass_over_road import pass_over_road
from sysid.prediction.predicted_passes import PassPrediction, RoadLoads
from sysid.prediction.road_measures import (
    RANGE_DRAWS,
    RANGE_LEVELS,
    Drive,
    aggregate_loads,
    aggregate_stations,
    counted_ranges,
    load_spectra,
    measures,
)
from sysid.prediction.trust import DrivenRange
from sysid.prediction.vehicle_draws import TOGETHER, VehicleDraws
from sysid.prediction.vehicle_groups import (
    Driven,
    VehicleGroup,
    felt_by_vehicle,
    misfit_by_vehicle,
    vehicle_groups,
)
from sysid.progress import Progress, unwatched
from sysid.road.driven_road import course_heights
from sysid.road.roughness import class_of_density, class_of_profile, roughness_index
from sysid.road.wheel_paths import WheelPaths, followed
from sysid.threads import side_by_side
from sysid.vehicle_model.engine import Timing

T = TypeVar("T")

#: Length of a stretch, of the run-up before it, and of its first part, where the road grows out of a level one [s].
STRETCH_S, RUN_UP_S, GROWTH_S = 20.0, 7.0, 3.5
#: Interval of the histories [s], which is one step of the integration on gentle roads: that departs by 0.1 % of the
#: dynamic load from eight steps.
INTERVAL_S = 0.004
#: Step of the integration on harsh roads [s], and the way between two samples there [m] as far as it allows.
_HARSH_STEP_S, _HARSH_WAY_M = 0.001, 0.008
#: Loads over edges are said to be off where the root mean square error of their change is more than this, or that of a
#: peak.
_MOST_CHANGE, _MOST_PEAK = 0.05, 0.03
#: Bytes of axle loads at a time: so many groups of draws are driven side by side.
_MOST_BYTES = 3e8
#: Draws behind the bands of the histories: those of all draws of a long road take much memory.
BAND_DRAWS = 40


def predict_road(
    state: FitState,
    request: PredictionRequest,
    sets: DrawsByParameters,
    vehicles: VehicleDraws | None,
    driven: DrivenRange,
    stops: AssumedStops | None,
    progress: Progress = unwatched,
) -> PassPrediction:
    """Axle loads of one pass over a rough road, for a point estimate or for posterior draws.

    The planar truck feels the mean of both tracks.  Every draw is driven over all realisations of the road; its
    measures are over all of them.

    Parameters
    ----------
    request : with a road.
    sets : (n, p) log parameters; `vehicles`, `driven`, `stops` as for
        :func:`sysid.prediction.predict_passes.predict_pass`.

    Raises
    ------
    CampaignError
        If the pass would take too long.
    DataRejectedError
        If forces are not finite.
    """
    campaign, course = state.campaign, request.road
    assert course is not None
    speed = request.speed_m_s
    x = np.array([axle.x_m for axle in campaign.vehicle.axles])
    duration = (course.length_m + x.max()) / speed
    if duration > limits.ROAD_SECONDS:
        raise CampaignError(
            f"The pass over {course.label} takes {duration:.3g} s at {3.6 * speed:.3g} km/h, at most "
            f"{limits.ROAD_SECONDS:g} s are predicted; choose a higher speed or a shorter road."
        )
    roads, tracks = [], []
    for k in range(course.realisations):
        station, height = course_heights(course, k)
        tracks.append((station, height))
        roads.append(felt_by_vehicle(state, request.load_case, station, height.mean(axis=0)))
    clock = _clock(speed, any(road.harsh for road in roads))
    samples = int(np.ceil(duration / clock.interval_s)) + 1
    time = clock.interval_s * np.arange(samples)
    place = speed * time[:, None] - x
    on_road = (place >= 0.0) & (place <= course.length_m)
    if vehicles is not None and any(road.harsh for road in roads):
        vehicles = vehicles.over_edges(speed, driven_over_edges_m_s(state))
    some_road = roads[0].stretch_of(-1.0, 0.5, 0.0)
    batch, groups = vehicle_groups(state, request.load_case, some_road, sets, vehicles, stops)
    _, (optimum,) = vehicle_groups(state, request.load_case, some_road, state.point.log_parameters[None], None, stops)
    said = _said(request, max((road.misfit for road in roads if not road.harsh), default=0.0))
    misfits = []
    for k, road in enumerate(roads):
        if road.harsh:
            station, height = tracks[k]
            own = station, height.mean(axis=0), samples, clock
            roads[k] = _settled(state, request, groups[0], road, *own)
            misfits.append(_off_springs(state, request, optimum, roads[k], *own))
    shift = x / speed / clock.interval_s

    def over_all(number: int) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray] | None, np.ndarray]:
        group, drawn, drives = groups[number], sum(len(g.sets) for g in groups[:number]), []
        for k, road in enumerate(roads):
            progress(f"{course.label}", (number + k / len(roads)) / len(groups))
            drives.append(_driven_over(state, request, group, road, samples, clock, max(RANGE_DRAWS - drawn, 0)))
        some = None
        if drawn < BAND_DRAWS:
            some = _of_some(drives[0], on_road, shift, course.length_m, speed * clock.interval_s, BAND_DRAWS - drawn)
        found = measures(drives, on_road, shift, course.stress_exponent)
        frequency, found["spectrum"] = load_spectra(drives, on_road, clock.interval_s)
        return found, some, frequency

    # While the engine computes for some draws, the loads of others are summed up.
    taken = 8 * samples * len(x) * TOGETHER * len(roads)
    found, kept, frequencies = zip(
        *side_by_side(over_all, range(len(groups)), max(1, int(_MOST_BYTES // taken))), strict=True
    )
    measured, some = (
        {name: np.concatenate([p[name] for p in parts if p is not None], axis=-1) for name in parts[0]}
        for parts in (found, kept)
    )
    static = batch.matrices.static_load[0, :, 0]
    return pass_over_road(
        campaign,
        request,
        time,
        some["forces"],
        measured,
        static,
        driven,
        stops if vehicles is None else vehicles.stops,
        [*said, *_said_of_edges(request, misfits)],
        load_coefficient=quantiles(measured["coefficient"]),
        road=_loads(course, tracks, measured, some, frequencies[0]),
    )


def _of_some(
    drive: Drive, on_road: np.ndarray, shift: np.ndarray, length_m: float, step_m: float, most: int
) -> dict[str, np.ndarray]:
    """What is kept of at most so many draws over the first realisation, the draws along the last axis.

    Single precision is far beyond what the model knows.
    """
    forces = drive.forces[..., :most].astype(np.float32)
    found = {"forces": forces, "aggregate": aggregate_loads(forces, shift, length_m, step_m)}
    found["tire_ranges"], found["suspension_ranges"] = counted_ranges(drive, on_road, length_m)
    return found


def _clock(speed_m_s: float, harsh: bool) -> Timing:
    """Interval of the samples and steps in it; their number is that of no samples."""
    if not harsh:
        return Timing(0, INTERVAL_S, 1)
    steps = int(np.clip(_HARSH_WAY_M / speed_m_s / _HARSH_STEP_S, 1, round(INTERVAL_S / _HARSH_STEP_S)))
    return Timing(0, steps * _HARSH_STEP_S, steps)


def _driven_over(
    state: FitState,
    request: PredictionRequest,
    group: VehicleGroup,
    road: FeltRoad,
    samples: int,
    clock: Timing,
    counted: int,
) -> Drive:
    """Forces of some vehicles at the first `samples` instants from where axle 1 meets the road.

    Suspension forces are kept of the first `counted` of them.
    """
    axles, count = group.static_N.shape
    forces = np.empty((samples, axles, count))
    suspension = np.empty((samples, axles, min(counted, count)), np.float32)

    def kept(begin: int, part: Driven, _: float) -> dict[str, np.ndarray]:
        tire = group.erring(part.tire_N)
        forces[begin : begin + len(tire)] = tire[: samples - begin]
        suspension[begin : begin + len(tire)] = part.suspension_N[: samples - begin, :, : suspension.shape[2]]
        sunk = group.sunk_m(part.tire_N.max(axis=0)[None])
        return extremes(sunk, part.extension_m, tire, clock.interval_s)

    found = _over_stretches(state, request, group, road, samples, clock, kept)
    together = {name: np.stack([f[name] for f in found]) for name in found[0]}
    most = {name: v.sum(axis=0) if name == "lift_off_s" else v.max(axis=0) for name, v in together.items()}
    return Drive(forces, suspension, group.static_N, most)


def _over_stretches(
    state: FitState,
    request: PredictionRequest,
    group: VehicleGroup,
    road: FeltRoad,
    samples: int,
    clock: Timing,
    kept: Callable[[int, Driven, float], T],
) -> tuple[T, ...]:
    """What is kept of every stretch: from its first sample, its histories and the station where its road begins [m]."""
    speed, interval = request.speed_m_s, clock.interval_s
    x = np.array([axle.x_m for axle in state.campaign.vehicle.axles])
    stretches = int(np.ceil(samples * interval / STRETCH_S))
    each = int(np.ceil(samples / stretches))
    run_up = int(np.ceil((RUN_UP_S + x.max() / speed) / interval))
    timing = clock._replace(samples=each + run_up)
    static = group.static_N

    def stretch(number: int) -> T:
        begin = number * each
        start_s = (begin - run_up) * interval
        one = road.stretch_of(speed * start_s, speed * GROWTH_S, speed * (begin + each) * interval + 1.0)
        found = group.driven(one.for_all(static.shape[1]), x, speed, -start_s, timing)
        check_finite(request, state.parameters, group.sets.T, static[:, 0], found.tire_N, found.suspension_N)
        return kept(begin, found.after(run_up), speed * start_s)

    return side_by_side(stretch, range(stretches))


def _settled(
    state: FitState,
    request: PredictionRequest,
    group: VehicleGroup,
    road: FeltRoad,
    station_m: Stations,
    height_m: Stations,
    samples: int,
    clock: Timing,
) -> FeltRoad:
    """A harsh road about the paths of the vehicles of a group, followed again until these stay where they are."""
    road, _ = followed(
        road,
        lambda felt: _along(state, request, group, felt, samples, clock)[0],
        lambda paths: felt_by_vehicle(state, request.load_case, station_m, height_m, paths),
    )
    return road


def _off_springs(
    state: FitState,
    request: PredictionRequest,
    optimum: VehicleGroup,
    road: FeltRoad,
    station_m: Stations,
    height_m: Stations,
    samples: int,
    clock: Timing,
) -> Misfit:
    """How far the loads of the optimum over a harsh road are from its tires' springs and dampers."""
    paths, tire = _along(state, request, optimum, road, samples, clock)
    law = optimum.made[2]
    damping, growth = (np.broadcast_to(np.asarray(v), law.damping.shape)[0, :, 0] for v in (law.damping, law.growth))
    loads = EdgeLoads(paths, tire[..., 0], clock.interval_s, damping, growth)
    return misfit_by_vehicle(state, request.load_case, station_m, height_m, loads)


def _along(
    state: FitState, request: PredictionRequest, group: VehicleGroup, road: FeltRoad, samples: int, clock: Timing
) -> tuple[WheelPaths, np.ndarray]:
    """Where the wheels of all vehicles of a group come on a road, and their axle loads (T, na, t) [N]."""
    x = np.array([axle.x_m for axle in state.campaign.vehicle.axles])

    def kept(begin: int, part: Driven, start_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        place = request.speed_m_s * clock.interval_s * (begin + np.arange(len(part.tire_N)))[:, None] - x
        found = group.wheels(part, place)
        return found.station_m, found.rise_m + road.level_m(start_m)[:, None], part.tire_N

    parts = _over_stretches(state, request, group, road, samples, clock, kept)
    station, rise, tire = (np.concatenate(of)[:samples] for of in zip(*parts, strict=True))
    return WheelPaths(station, rise), tire


def _loads(
    course: RoadCourse,
    tracks: Sequence[tuple[np.ndarray, np.ndarray]],
    measured: dict[str, np.ndarray],
    some: dict[str, np.ndarray],
    frequency_hz: np.ndarray,
) -> RoadLoads:
    """Measures of all draws, and of `some` what is kept of few."""
    lines = [(station, height) for station, heights in tracks for height in heights]
    classes = [c for c in (class_of_profile(*line) for line in lines) if c is not None]
    density = float(np.exp(np.mean([np.log(d) for _, d in classes]))) if classes else None
    return RoadLoads(
        load_95_N=quantiles(measured["load_95"]),
        load_99_N=quantiles(measured["load_99"]),
        road_stress=quantiles(measured["road_stress"]),
        vehicle_stress=quantiles(measured["vehicle_stress"]),
        aggregate_95=quantiles(measured["aggregate_95"]),
        exponent=course.stress_exponent,
        length_m=course.length_m,
        realisations=course.realisations,
        roughness_index_mm_m=float(np.mean([roughness_index(*line) for line in lines])),
        density_m3=density,
        road_class=None if density is None else class_of_density(density),
        frequency_hz=frequency_hz,
        spectrum_N2_Hz=quantiles(measured["spectrum"]),
        range_levels=RANGE_LEVELS,
        tire_ranges_per_km=quantiles(some["tire_ranges"]),
        suspension_ranges_per_km=quantiles(some["suspension_ranges"]),
        station_m=aggregate_stations(course.length_m),
        aggregate_N=some["aggregate"],
    )


def _said(request: PredictionRequest, misfit: float) -> list[str]:
    """What has to be known about a gentle road, or one that is too long for its edges."""
    if misfit <= HARSH:
        return []
    return [
        f"{request.bump}: the road has edges that a tire does not smooth as the model takes it; loads there may be "
        f"off by {100.0 * misfit:.0f} % of the static load. Cut the road to {MOST_HARSH_M:g} m about them."
    ]


def _said_of_edges(request: PredictionRequest, misfits: Sequence[Misfit]) -> list[str]:
    """What has to be known about a short road with edges."""
    change, peak = (max((getattr(m, name) for m in misfits), default=0.0) for name in ("change", "peak"))
    if change <= _MOST_CHANGE and peak <= _MOST_PEAK:
        return []
    return [
        f"{request.bump}: over its edges loads are off those of the tires' springs by {100.0 * change:.0f} % of the "
        f"change of load (root mean square), peaks by {100.0 * peak:.0f} %."
    ]
