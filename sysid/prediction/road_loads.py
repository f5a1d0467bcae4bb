"""Axle loads over rough roads of any length: stretches side by side, each after a run-up from rest.

A vehicle forgets within seconds, so that a long road is driven in stretches of :data:`STRETCH_S`.  Each begins
:data:`RUN_UP_S` earlier on level road, out of which the road grows; what is felt meanwhile is thrown away.  Memory then
depends on the number of draws that are simulated together, and time on the length of the road.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid import limits
from sysid.arrays import DrawsByParameters, SamplesByAxlesBySets
from sysid.campaign.records import PredictionRequest
from sysid.campaign.roads import RoadCourse
from sysid.errors import CampaignError
from sysid.estimation.fit.state import FitState
from sysid.prediction.assumed_stops import AssumedStops
from sysid.prediction.felt_road import HARSH, MOST_HARSH_M, FeltRoad
from sysid.prediction.finite import check_finite
from sysid.prediction.measures import extremes, quantiles
from sysid.prediction.pass_over_road import pass_over_road
from sysid.prediction.predicted_passes import PassPrediction, RoadLoads
from sysid.prediction.trust import DrivenRange
from sysid.prediction.vehicle_draws import (
    VehicleDraws,
)
from sysid.prediction.vehicle_groups import VehicleGroup, felt_by_vehicle, vehicle_groups
from sysid.progress import Progress, unwatched
from sysid.road.roughness import TRACK_M, class_of_density, class_of_profile, class_road, roughness_index
from sysid.threads import side_by_side
from sysid.vehicle_model.engine import Timing

#: Length of a stretch, of the run-up before it, and of its first part, where the road grows out of a level one [s].
STRETCH_S, RUN_UP_S, GROWTH_S = 20.0, 7.0, 3.5
#: Interval of the histories [s], and the steps of the integration in it on gentle and on harsh roads: one step on a
#: gentle road departs by 0.1 % of the dynamic load from eight.
INTERVAL_S = 0.004
_GENTLE_STEPS, _HARSH_STEPS = 1, 4
#: Draws behind the bands of the histories: those of all draws of a long road take much memory.
BAND_DRAWS = 40
#: Exponent of the damage that axle loads do to a road: the fourth power of the AASHO road test.
STRESS_EXPONENT = 4.0


@dataclass(frozen=True)
class _Drive:
    """Every draw over every realisation of a road: forces (T, na, n) [N], static loads (na, n), extremes (na, n)."""

    forces: SamplesByAxlesBySets
    static_N: np.ndarray
    extremes: dict[str, np.ndarray]


def course_heights(course: RoadCourse, realisation: int, track_m: float = TRACK_M) -> tuple[np.ndarray, np.ndarray]:
    """Stations (n,) from 0 and heights (tracks, n) of one realisation of a road [m]; a measured one has one track."""
    if course.roughness is not None:
        return class_road(course.roughness, course.length_m, course.seed + realisation, track_m=track_m)
    assert course.height_m is not None
    return course.step_m * np.arange(course.height_m.size), course.height_m[None]


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
    found: list[dict[str, np.ndarray]] = []
    bands: list[np.ndarray] = []
    kept = 0
    for number, group in enumerate(groups):
        drives = []
        for k, road in enumerate(roads):
            progress(f"{course.label}", (number + k / len(roads)) / len(groups))
            drives.append(_driven_over(state, request, group, road, samples))
        if kept < BAND_DRAWS:
            # The bands are of the first realisation; single precision is far beyond what the model knows.
            bands.append(drives[0].forces[..., : BAND_DRAWS - kept].astype(np.float32))
            kept += bands[-1].shape[-1]
        found.append(_measures(drives, on_road, x / speed / INTERVAL_S))
    measured = {name: np.concatenate([f[name] for f in found], axis=-1) for name in found[0]}
    static = batch.matrices.static_load[0, :, 0]
    misfit = max(0.0 if road.harsh else road.misfit for road in roads)
    return pass_over_road(
        campaign,
        request,
        time,
        np.concatenate(bands, axis=-1),
        measured,
        static,
        driven,
        stops if vehicles is None else vehicles.stops,
        _said(request, misfit),
        load_coefficient=quantiles(measured["coefficient"]),
        road=_loads(course, tracks, measured),
    )


def _driven_over(
    state: FitState, request: PredictionRequest, group: VehicleGroup, road: FeltRoad, samples: int
) -> _Drive:
    """Forces of some vehicles at the first `samples` instants from where axle 1 meets the road."""
    speed = request.speed_m_s
    x = np.array([axle.x_m for axle in state.campaign.vehicle.axles])
    count = len(group.sets)
    stretches = int(np.ceil(samples * INTERVAL_S / STRETCH_S))
    each = int(np.ceil(samples / stretches))
    run_up = int(np.ceil((RUN_UP_S + x.max() / speed) / INTERVAL_S))
    timing = Timing(each + run_up, INTERVAL_S, _HARSH_STEPS if road.harsh else _GENTLE_STEPS)
    forces = np.empty((samples, x.size, count))
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
        return extremes(found.sunk_m[run_up:], found.extension_m[run_up:], tire, INTERVAL_S)

    found = side_by_side(stretch, range(stretches))
    together = {name: np.stack([f[name] for f in found]) for name in found[0]}
    most = {name: v.sum(axis=0) if name == "lift_off_s" else v.max(axis=0) for name, v in together.items()}
    return _Drive(forces, static, most)


def _measures(drives: Sequence[_Drive], on_road: np.ndarray, shift: np.ndarray) -> dict[str, np.ndarray]:
    """Measures (axles, n) of some draws over all realisations, and of whole vehicles (1, n)."""
    static, q = drives[0].static_N, STRESS_EXPONENT
    rows: dict[str, list[np.ndarray]] = {
        n: [] for n in ("mean", "spread", "most", "least", "load_95", "load_99", "power")
    }
    for i in range(len(static)):
        force = np.concatenate([d.forces[on_road[:, i], i] for d in drives])
        rows["mean"].append(force.mean(axis=0))
        rows["spread"].append(force.std(axis=0))
        rows["most"].append(force.max(axis=0))
        rows["least"].append(force.min(axis=0))
        high = np.quantile(force, [0.95, 0.99], axis=0)
        rows["load_95"].append(high[0])
        rows["load_99"].append(high[1])
        rows["power"].append((force**q).mean(axis=0))
    found = {name: np.array(values) for name, values in rows.items()}
    at_rest = (static**q).sum(axis=0)
    found["vehicle_stress"] = found["power"].sum(axis=0, keepdims=True) / at_rest
    found["road_stress"] = found.pop("power") / static**q
    together = np.concatenate([_at_one_station(d.forces, shift, q) for d in drives])
    found["aggregate_95"] = np.quantile(together, 0.95, axis=0, keepdims=True) / at_rest
    found["coefficient"] = found.pop("spread") / found["mean"]
    found["mean_ratio"] = found["mean"] / static
    found["sum_ratio"] = found.pop("mean").sum(axis=0, keepdims=True) / static.sum(axis=0)
    for name in drives[0].extremes:
        values = np.stack([d.extremes[name] for d in drives])
        # Time off the road is that of one realisation, the mean of all.
        found[name] = values.mean(axis=0) if name == "lift_off_s" else values.max(axis=0)
    return found


def _at_one_station(forces: np.ndarray, shift: np.ndarray, exponent: float) -> np.ndarray:
    """Sum over the axles of the powers of their forces at every station of the road, (stations, n).

    `shift` (na,): how many samples later than axle 1 each axle passes a station.
    """
    whole = np.floor(shift).astype(int)
    count = len(forces) - int(np.ceil(shift.max())) - 1
    total = np.zeros((count, forces.shape[2]))
    for i, (k, share) in enumerate(zip(whole, shift - whole, strict=True)):
        force = (1.0 - share) * forces[k : k + count, i] + share * forces[k + 1 : k + 1 + count, i]
        total += force**exponent
    return total


def _loads(
    course: RoadCourse, tracks: Sequence[tuple[np.ndarray, np.ndarray]], measured: dict[str, np.ndarray]
) -> RoadLoads:
    lines = [(station, height) for station, heights in tracks for height in heights]
    classes = [c for c in (class_of_profile(*line) for line in lines) if c is not None]
    density = float(np.exp(np.mean([np.log(d) for _, d in classes]))) if classes else None
    return RoadLoads(
        load_95_N=quantiles(measured["load_95"]),
        load_99_N=quantiles(measured["load_99"]),
        road_stress=quantiles(measured["road_stress"]),
        vehicle_stress=quantiles(measured["vehicle_stress"]),
        aggregate_95=quantiles(measured["aggregate_95"]),
        exponent=STRESS_EXPONENT,
        length_m=course.length_m,
        realisations=course.realisations,
        roughness_index_mm_m=float(np.mean([roughness_index(*line) for line in lines])),
        density_m3=density,
        road_class=None if density is None else class_of_density(density),
    )


def _said(request: PredictionRequest, misfit: float) -> list[str]:
    """What has to be known about the road of a pass."""
    if misfit <= HARSH:
        return []
    return [
        f"{request.bump}: the road has edges that a tire does not smooth as the model takes it; loads there may be "
        f"off by {100.0 * misfit:.0f} % of the static load. Cut the road to {MOST_HARSH_M:g} m about them."
    ]
