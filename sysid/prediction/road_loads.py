"""Axle loads over rough roads of any length: stretches side by side, each after a run-up from rest.

A vehicle forgets within seconds, so that a long road is driven in stretches of :data:`STRETCH_S`.  Each begins
:data:`RUN_UP_S` earlier on level road, out of which the road grows; what is felt meanwhile is thrown away.  Memory then
depends on the number of draws that are simulated together, and time on the length of the road.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid import limits
from sysid.arrays import DrawsByParameters
from sysid.campaign.records import PredictionRequest
from sysid.campaign.roads import RoadCourse
from sysid.errors import CampaignError
from sysid.estimation.fit.state import FitState
from sysid.prediction.assumed_stops import AssumedStops
from sysid.prediction.felt_road import HARSH, MOST_HARSH_M, DrivenLoads, FeltRoad
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
from sysid.prediction.vehicle_draws import (
    VehicleDraws,
)
from sysid.prediction.vehicle_groups import VehicleGroup, felt_by_vehicle, vehicle_groups
from sysid.progress import Progress, unwatched
from sysid.road.driven_road import course_heights
from sysid.road.roughness import class_of_density, class_of_profile, roughness_index
from sysid.threads import side_by_side
from sysid.vehicle_model.engine import Timing

#: Length of a stretch, of the run-up before it, and of its first part, where the road grows out of a level one [s].
STRETCH_S, RUN_UP_S, GROWTH_S = 20.0, 7.0, 3.5
#: Interval of the histories [s], and the steps of the integration in it on gentle and on harsh roads: one step on a
#: gentle road departs by 0.1 % of the dynamic load from eight.
INTERVAL_S = 0.004
_GENTLE_STEPS, _HARSH_STEPS = 1, 4
#: How often the springs over edges are followed about the loads of the time before.
_ROUNDS = 2
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
    samples = int(np.ceil(duration / INTERVAL_S)) + 1
    time = INTERVAL_S * np.arange(samples)
    place = speed * time[:, None] - x
    on_road = (place >= 0.0) & (place <= course.length_m)
    batch, groups = vehicle_groups(state, request.load_case, roads[0].stretch_of(-1.0, 0.5, 0.0), sets, vehicles, stops)
    for k, road in enumerate(roads):
        for _ in range(_ROUNDS if road.harsh else 0):
            # The first vehicles tell what axles carry over the edges; about these loads the springs are followed.
            first = _driven_over(state, request, groups[0], roads[k], samples, 0)
            loads = DrivenLoads(place, np.median(first.forces, axis=-1))
            roads[k] = felt_by_vehicle(state, request.load_case, tracks[k][0], tracks[k][1].mean(axis=0), loads)
    shift = x / speed / INTERVAL_S
    found: list[dict[str, np.ndarray]] = []
    kept: list[dict[str, np.ndarray]] = []
    drawn = 0
    for number, group in enumerate(groups):
        drives = []
        for k, road in enumerate(roads):
            progress(f"{course.label}", (number + k / len(roads)) / len(groups))
            drives.append(_driven_over(state, request, group, road, samples, max(RANGE_DRAWS - drawn, 0)))
        if drawn < BAND_DRAWS:
            kept.append(_of_some(drives[0], on_road, shift, course.length_m, speed, BAND_DRAWS - drawn))
        drawn += len(group.sets)
        found.append(measures(drives, on_road, shift, course.stress_exponent))
        frequency, found[-1]["spectrum"] = load_spectra(drives, on_road, INTERVAL_S)
    measured, some = (
        {name: np.concatenate([p[name] for p in parts], axis=-1) for name in parts[0]} for parts in (found, kept)
    )
    static = batch.matrices.static_load[0, :, 0]
    harsh, misfit = max((road.misfit, road.harsh) for road in roads)[::-1]
    return pass_over_road(
        campaign,
        request,
        time,
        some["forces"],
        measured,
        static,
        driven,
        stops if vehicles is None else vehicles.stops,
        _said(request, misfit, harsh),
        load_coefficient=quantiles(measured["coefficient"]),
        road=_loads(course, tracks, measured, some, frequency),
    )


def _of_some(
    drive: Drive, on_road: np.ndarray, shift: np.ndarray, length_m: float, speed_m_s: float, most: int
) -> dict[str, np.ndarray]:
    """What is kept of at most so many draws over the first realisation, the draws along the last axis.

    Single precision is far beyond what the model knows.
    """
    forces = drive.forces[..., :most].astype(np.float32)
    found = {"forces": forces, "aggregate": aggregate_loads(forces, shift, length_m, speed_m_s * INTERVAL_S)}
    found["tire_ranges"], found["suspension_ranges"] = counted_ranges(drive, on_road, length_m)
    return found


def _driven_over(
    state: FitState, request: PredictionRequest, group: VehicleGroup, road: FeltRoad, samples: int, counted: int
) -> Drive:
    """Forces of some vehicles at the first `samples` instants from where axle 1 meets the road.

    Suspension forces are kept of the first `counted` of them.
    """
    speed = request.speed_m_s
    x = np.array([axle.x_m for axle in state.campaign.vehicle.axles])
    count = len(group.sets)
    stretches = int(np.ceil(samples * INTERVAL_S / STRETCH_S))
    each = int(np.ceil(samples / stretches))
    run_up = int(np.ceil((RUN_UP_S + x.max() / speed) / INTERVAL_S))
    timing = Timing(each + run_up, INTERVAL_S, _HARSH_STEPS if road.harsh else _GENTLE_STEPS)
    forces = np.empty((samples, x.size, count))
    suspension = np.empty((samples, x.size, min(counted, count)), np.float32)
    static = group.static_N

    def stretch(number: int) -> dict[str, np.ndarray]:
        begin = number * each
        start_s = (begin - run_up) * INTERVAL_S
        end_m = speed * (begin + each) * INTERVAL_S + 1.0
        one = road.stretch_of(speed * start_s, speed * GROWTH_S, end_m)
        found = group.driven(one.of_runs([0] * count), x, speed, -start_s, timing)
        check_finite(request, state.parameters, group.sets.T, static[:, 0], found.tire_N, found.suspension_N)
        tire = group.erring(found.tire_N[run_up:])
        part = forces[begin : begin + each]
        part[:] = tire[: len(part)]
        kept = suspension[begin : begin + each]
        kept[:] = found.suspension_N[run_up : run_up + len(kept), :, : kept.shape[2]]
        return extremes(found.sunk_m[run_up:], found.extension_m[run_up:], tire, INTERVAL_S)

    found = side_by_side(stretch, range(stretches))
    together = {name: np.stack([f[name] for f in found]) for name in found[0]}
    most = {name: v.sum(axis=0) if name == "lift_off_s" else v.max(axis=0) for name, v in together.items()}
    return Drive(forces, suspension, static, most)


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


def _said(request: PredictionRequest, misfit: float, harsh: bool) -> list[str]:
    """What has to be known about the road of a pass."""
    if misfit <= HARSH:
        return []
    if harsh:
        return [
            f"{request.bump}: at its edges loads are off by up to {100.0 * misfit:.0f} % of the static load from those "
            "of the tires' springs."
        ]
    return [
        f"{request.bump}: the road has edges that a tire does not smooth as the model takes it; loads there may be "
        f"off by {100.0 * misfit:.0f} % of the static load. Cut the road to {MOST_HARSH_M:g} m about them."
    ]
