"""Dynamic axle loads of passes that nobody drove, with bands from the posterior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from sysid.arrays import Axles, DrawsByParameters, Samples, SamplesByAxlesBySets
from sysid.campaign.records import Campaign, PredictionRequest
from sysid.campaign.requests import driven_speeds
from sysid.errors import CampaignError
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.axle_laws import LawInputs, axle_laws, law_inputs
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.residuals.rolling_runs import RollingRuns
from sysid.prediction.assumed_stops import AssumedStops
from sysid.prediction.bridge_loads import BridgeVehicles, predict_bridge
from sysid.prediction.bump_edges import BumpEdges
from sysid.prediction.driven_range import driven_range, spring_deflection
from sysid.prediction.finite import check_duration, check_finite
from sysid.prediction.measures import extremes, impulse_ratio, lift_off_time, load_coefficient, quantiles
from sysid.prediction.predicted_passes import PassPrediction, Predictions, SpeedSweep
from sysid.prediction.quantiles import Quantiles
from sysid.prediction.remarks import edges, remarks
from sysid.prediction.road_loads import predict_road
from sysid.prediction.trust import DrivenRange, Reached, beyond_driven, extrapolations
from sysid.prediction.vehicle_draws import (
    MakesVehicles,
    VehicleDraws,
    drawn_vehicles,
    histories_of_draws,
    vehicles_of,
)
from sysid.prediction.vehicle_groups import SLOW_M_S, hold_s
from sysid.prediction.wheel_loads import rolling_pass, wheel_loads
from sysid.progress import Progress, unwatched
from sysid.road.named_shapes import named_shape
from sysid.threads import side_by_side
from sysid.vehicle_model.device_arrays import HostOrDevice, ParametersBySets
from sysid.vehicle_model.engine import Timing, WheelRoad, wheel_road
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.passes import EffectiveRoads, Pass, make_pass_batch
from sysid.vehicle_model.stacked_matrices import StackedMatrices

#: Integration step of predicted histories [s], their output interval too unless they would take more memory than that
#: [bytes]: then every second step is kept, or every third, and so on.
STEP_S = 0.001
_MOST_BYTES = 500_000_000
#: How long before and after the passage histories reach [s].
BEFORE_S = 0.5
AFTER_S = 1.5
#: Number of posterior draws behind the bands, and behind those of the ratio against speed.
DRAWS = 200
SWEEP_DRAWS = 40
#: Output interval of the ratio against speed [s], and the numbers of samples that its records have up to some minutes:
#: the reference engine compiles few lengths, and a record is at most 1.4 times as long as it need be.
SWEEP_INTERVAL_S = 0.002
SWEEP_LENGTHS = tuple(round(500 * 2.0 ** (n / 2)) for n in range(16))
#: Speeds [km/h] of the ratio against speed.
SWEEP_KM_H = (4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 28.0, 32.0, 36.0, 42.0, 48.0, 54.0, 60.0)


def _histories(
    matrices: StackedMatrices, laws: LawInputs, road: WheelRoad, log_parameters: ParametersBySets, timing: Timing
) -> tuple[HostOrDevice, HostOrDevice, HostOrDevice, HostOrDevice]:
    suspension, tire = axle_laws(laws, log_parameters)
    histories = road.engine.histories(matrices, suspension, tire, road, timing)
    sunk = spring_deflection(tire, histories.tire_force)
    return histories.tire_force[:, 0], histories.suspension_force[:, 0], histories.deflection[:, 0], sunk[:, 0]


@dataclass(frozen=True)
class _Pass:
    """Histories (T, axles, S) of one pass, its static loads (axles,), and when each axle rings, (T, axles).

    `drawn_static_N` (axles, S) those of every draw, as the scale may have been wrong; `deflection_m` of the
    suspensions, positive in extension; `sunk_m` of the tires as far as their springs carry;
    `rolling` the mean truck of all draws, None where it is not known to roll.
    """

    time_s: Samples
    tire_N: SamplesByAxlesBySets
    suspension_N: SamplesByAxlesBySets
    deflection_m: SamplesByAxlesBySets
    sunk_m: SamplesByAxlesBySets
    static_N: Axles
    drawn_static_N: np.ndarray
    passing: np.ndarray
    interval_s: float
    rolling: RollingRuns | None

    @property
    def rate_m_s(self) -> np.ndarray:
        """Rate of the suspensions' extension (T, axles, S) [m/s]."""
        return np.asarray(np.gradient(self.deflection_m, self.interval_s, axis=0))

    @property
    def peak_ratios(self) -> np.ndarray:
        """Largest force of the tires over the static load as weighed, (axles, S)."""
        return np.asarray(self.tire_N.max(axis=0) / self.static_N[:, None])

    def reached(self, speed_m_s: float) -> Reached:
        """Extremes over the pass, medians over the draws."""
        most = extremes(self.sunk_m, self.deflection_m, self.tire_N, self.interval_s)
        return Reached(speed_m_s, **{name: np.median(values, axis=-1) for name, values in most.items()})


def _simulate(
    campaign: Campaign,
    parameters: ParameterSet,
    roads: EffectiveRoads,
    request: PredictionRequest,
    sets: np.ndarray,
    vehicles: VehicleDraws | None = None,
    stops: AssumedStops | None = None,
    drawn: Sequence[MakesVehicles] | None = None,
    *,
    interval_s: float | None = None,
    lengths: Sequence[int] = (),
) -> _Pass:
    """`sets` (p, S) log parameters; `vehicles` of the S draws, None for the declared one with assumed `stops`.

    `drawn` are the vehicles in this pass, None to make them.  Histories every `interval_s` in one step each, their
    number the next of `lengths`; None for steps of :data:`STEP_S`, kept as far as there is memory.
    """
    wanted = _held(request.load_case, request.bump, request.speed_m_s)
    batch = make_pass_batch(campaign.vehicle, campaign.load_cases, roads, [wanted], [])
    road, speed = batch.road, request.speed_m_s
    last = road.first_station_m + road.step_m * road.rise.shape[-1]
    # The record starts half a second before axle 1 touches the bump and its time is zero over the start of the bump.
    before = BEFORE_S - road.first_station_m / speed
    after = (last + float(np.max(batch.axle_x))) / speed + AFTER_S
    check_duration(request, before + after)
    steps = 1 if interval_s is not None else _steps_per_sample(before + after, sets.shape[1], len(batch.axle_x))
    interval_s = steps * STEP_S if interval_s is None else interval_s
    lead = np.ceil(before / interval_s) * interval_s
    samples = int(np.ceil((lead + after) / interval_s))
    samples = next((length for length in lengths if length >= samples), samples)
    timing, motion = Timing(samples, interval_s, steps), Motion(np.full((1, 1), speed), np.full((1, 1), float(lead)))
    rolling = None
    if vehicles is None:
        laws = law_inputs(campaign.vehicle, parameters, batch, [request.load_case])
        laws = laws if stops is None else stops.on(laws, 0)
        wheels = wheel_road(batch.matrices, road, batch.axle_x, motion, timing)
        histories = _histories(batch.matrices, laws, wheels, sets, timing)
        tire, suspension, deflection, sunk = (np.asarray(h) for h in histories)
        suspension = suspension + batch.matrices.carried_load[0]
        drawn_static = batch.matrices.static_load[0]
    else:
        rolling = rolling_pass(parameters, roads, wanted, motion, timing, sets.T, vehicles)
        rise = None if rolling is None else rolling.planar.rise
        drawn = drawn or drawn_vehicles(batch, parameters, vehicles, wanted)
        tire, suspension, deflection, sunk, drawn_static = histories_of_draws(
            drawn, batch.axle_x, sets.T, motion, timing, vehicles.contact_error, rise
        )
    static = batch.matrices.static_load[0, :, 0]
    check_finite(request, parameters, sets, np.asarray(static), tire, suspension, deflection)
    time = np.round(np.arange(samples) * interval_s - lead, 6)
    x = batch.axle_x[:, 0]
    return _Pass(
        time,
        tire,
        suspension,
        deflection,
        sunk,
        static,
        np.asarray(drawn_static),
        (time[:, None] >= (road.first_station_m + x) / speed) & (time[:, None] <= (last + x) / speed + AFTER_S),
        interval_s,
        rolling,
    )


def _held(load_case: str, bump: str, speed_m_s: float) -> Pass:
    return Pass(load_case, bump, hold_s=hold_s(speed_m_s))


def _steps_per_sample(duration_s: float, sets: int, axles: int) -> int:
    """So many steps per sample that four histories of all axles and parameter sets stay below a limit of memory."""
    return max(1, int(np.ceil(4 * 8 * sets * axles * duration_s / STEP_S / _MOST_BYTES)))


def predict_pass(
    campaign: Campaign,
    parameters: ParameterSet,
    roads: EffectiveRoads,
    request: PredictionRequest,
    sets: DrawsByParameters,
    vehicles: VehicleDraws | None = None,
    driven: DrivenRange | None = None,
    stops: AssumedStops | None = None,
) -> PassPrediction:
    """Axle loads of one pass, for a point estimate or for posterior draws.

    The peak dynamic load ratio of a draw is the maximum over the pass of the unfiltered vertical tire force over the
    static axle load as weighed. So the product of ratio and weighed load is the peak force. Quantiles are taken over
    draws; for the bands they are pointwise in time.

    Parameters
    ----------
    roads : what the wheels feel, see :func:`effective_roads`.
    sets : (n, p) log parameters: one row, or draws, of which the bands are quantiles.
    vehicles : those that belong to the draws, None for the declared one.
    driven : what the driven runs reached; without it nothing is said about extrapolation.
    stops : those of the declared vehicle that are assumed; drawn ones have their own.
    """
    p = _simulate(campaign, parameters, roads, request, sets.T, vehicles, stops)
    force = quantiles(p.tire_N)
    suspension = quantiles(p.suspension_N)
    ratio = quantiles(p.peak_ratios)
    travel = (-p.deflection_m).max(axis=0), p.deflection_m.max(axis=0)
    jounce, rebound = (quantiles(t) for t in travel)
    assumed = stops if vehicles is None else vehicles.stops
    acting = {} if assumed is None else assumed.acting(*travel)
    trust = () if driven is None else extrapolations(p.reached(request.speed_m_s), driven, request.load_case, acting)
    # Over the loads of each draw: where the scale was wrong, the truck at rest does not weigh what was read.
    together = float(np.median(p.tire_N.sum(axis=1).mean(axis=0) / p.drawn_static_N.sum(axis=0)))
    wheels = None
    if vehicles is not None and p.rolling is not None:
        wheels = wheel_loads(p.rolling, p.interval_s, vehicles, p.tire_N, p.drawn_static_N)
    return PassPrediction(
        load_case=request.load_case,
        speed_m_s=request.speed_m_s,
        time_s=p.time_s,
        tire_force_q05_N=_transposed(force.q05),
        tire_force_q50_N=force.q50.T,
        tire_force_q95_N=_transposed(force.q95),
        static_load_N=p.static_N,
        peak_ratio_q05=ratio.q05,
        peak_ratio_q50=ratio.q50,
        peak_ratio_q95=ratio.q95,
        lift_off=(p.tire_N.min(axis=0) <= 0.0).mean(axis=1) >= 0.5,
        warnings=(*remarks(campaign, request, trust, together, acting), *edges(campaign, request, roads)),
        suspension_force_N=Quantiles(_transposed(suspension.q05), suspension.q50.T, _transposed(suspension.q95)),
        load_coefficient=quantiles(load_coefficient(p.tire_N, p.drawn_static_N, p.passing)),
        lift_off_s=quantiles(lift_off_time(p.tire_N, p.interval_s)),
        jounce_m=jounce,
        rebound_m=rebound,
        impulse_ratio=quantiles(impulse_ratio(p.tire_N, p.drawn_static_N)),
        shape=_over(campaign, request),
        trust=trust,
        beyond=None if driven is None else beyond_driven(driven, p.sunk_m, p.deflection_m, p.rate_m_s, p.tire_N),
        profile=roads.profiles[request.bump].identity,
        wheels=wheels,
    )


def _over(campaign: Campaign, request: PredictionRequest) -> str:
    """What a pass goes over: a shape by its label, a scanned bump by its name where there are several."""
    if request.shape is not None:
        return request.shape.label
    return request.bump if len(campaign.scans) > 1 else ""


def peak_ratios(
    campaign: Campaign,
    parameters: ParameterSet,
    roads: EffectiveRoads,
    request: PredictionRequest,
    sets: DrawsByParameters,
    vehicles: VehicleDraws | None = None,
    stops: AssumedStops | None = None,
) -> np.ndarray:
    """Peak dynamic load ratio (n, axles) of one pass for every set (n, p) of log parameters.

    `vehicles` and `stops` as for :func:`predict_pass`.
    """
    return _simulate(campaign, parameters, roads, request, sets.T, vehicles, stops).peak_ratios.T


def _transposed(values: np.ndarray | None) -> np.ndarray | None:
    return None if values is None else values.T


def speed_sweep(
    campaign: Campaign,
    parameters: ParameterSet,
    load_case: str,
    bump: str,
    roads: EffectiveRoads,
    sets: np.ndarray,
    speeds_m_s: Sequence[float],
    progress: Progress = unwatched,
    vehicles: VehicleDraws | None = None,
    driven: DrivenRange | None = None,
    stops: AssumedStops | None = None,
    bumps: BumpEdges | None = None,
) -> SpeedSweep:
    """Peak load ratio and dynamic load coefficient of one load case over a bump against speed.

    Parameters
    ----------
    sets : (p, S) log parameters, one column the point estimate or several draws.
    speeds_m_s : (m,) [m/s].
    vehicles : those that belong to the sets, None for the declared one.
    driven : what the driven runs reached; without it nothing but the speed is compared with them.
    stops : those of the declared vehicle that are assumed; drawn ones have their own.
    bumps : what wheels feel of edges at each speed; without it `roads` hold at all of them.
    """
    drawn = None
    if vehicles is not None and min(speeds_m_s) >= SLOW_M_S:
        # A vehicle is the same at every such speed.
        wanted = _held(load_case, bump, SLOW_M_S)
        batch = make_pass_batch(campaign.vehicle, campaign.load_cases, roads, [wanted], [])
        drawn = [cache(make) for make in drawn_vehicles(batch, parameters, vehicles, wanted)]
        # Before several threads ask for it at once.
        for make in drawn:
            make()

    def at(number: int) -> tuple[np.ndarray, np.ndarray, list[bool]]:
        progress(f"ratio against speed, {load_case}", number / len(speeds_m_s))
        speed = speeds_m_s[number]
        request = PredictionRequest(load_case, speed, bump)
        felt = roads if bumps is None else bumps.at(request)
        p = _simulate(
            campaign,
            parameters,
            felt,
            request,
            sets,
            vehicles if bumps is None else bumps.vehicles(vehicles, felt, request),
            stops,
            drawn if felt is roads else None,
            interval_s=SWEEP_INTERVAL_S,
            lengths=SWEEP_LENGTHS,
        )
        trust = () if driven is None else extrapolations(p.reached(speed), driven, load_case)
        beyond = [any(e.axle == i and e.what != "speed" for e in trust) for i in range(len(p.static_N))]
        return p.peak_ratios, load_coefficient(p.tire_N, p.drawn_static_N, p.passing), beyond

    # While the engine computes for one thread, another one sums up the loads at its speed.
    peaks, coefficients, beyond = map(np.array, zip(*side_by_side(at, range(len(speeds_m_s))), strict=True))
    nominal = driven_speeds(campaign, load_case)
    return SpeedSweep(
        load_case,
        bump,
        np.asarray(speeds_m_s, dtype=np.float64),
        quantiles(peaks),
        quantiles(coefficients),
        (min(nominal), max(nominal)) if nominal else None,
        None if driven is None else beyond,
    )


def effective_roads(state: FitState, requests: Sequence[PredictionRequest]) -> EffectiveRoads:
    """Effective roads of the wheels, as in the fit, for the scanned bumps and for those that the requests name."""
    shapes = {r.bump: named_shape(r.shape) for r in requests if r.shape is not None}
    campaign, point = state.campaign, state.point
    profiles = {**state.profiles, **shapes}
    return EffectiveRoads(campaign.vehicle, campaign.load_cases, profiles, point.contact, point.tires)


def predict(
    state: FitState,
    draws: DrawsByParameters | None,
    requests: Sequence[PredictionRequest],
    *,
    seed: int = 0,
    sweep_km_h: Sequence[float] = SWEEP_KM_H,
    progress: Progress = unwatched,
    driven: DrivenRange | None = None,
) -> Predictions:
    """Axle loads of passes, and the load ratio against speed in their load cases.

    Every draw gets its own masses and departures, drawn given its parameters as the fit relates them, and its own error
    of the forces between tires and road (:data:`sysid.prediction.vehicle_draws.CONTACT_ERROR`, and
    :data:`sysid.prediction.vehicle_draws.EDGE_ERROR` over edges).

    Parameters
    ----------
    state : the fit; its optimum alone is used where there are no draws.
    draws : (n, p) posterior draws of the log parameters, or None; they are thinned at random to :data:`DRAWS`, for the
        ratio against speed to :data:`SWEEP_DRAWS`.
    requests : the passes.
    sweep_km_h : speeds of the ratio against speed [km/h], none for no such table.
    driven : what the driven runs reached (:func:`sysid.prediction.driven_range.driven_range`), None to compute it.

    Raises
    ------
    CampaignError
        If a pass is in a load case of which the fit knows nothing that the prediction needs.
    """
    campaign, parameters, response = state.campaign, state.parameters, state.point.mass_response
    _check_load_cases(campaign, parameters, requests, drawn=draws is not None and response is not None)
    driven = driven or driven_range(state)
    random = np.random.default_rng(seed)
    if draws is not None and draws.shape[0] > DRAWS:
        draws = draws[random.choice(draws.shape[0], DRAWS, replace=False)]
    roads = effective_roads(state, requests)
    sets = state.point.log_parameters[None] if draws is None else draws
    vehicles, stops = vehicles_of(state, roads, sets, driven, None if draws is None else random)
    of_bridges, bumps = BridgeVehicles(state, sets, vehicles, stops), BumpEdges(state, roads, stops)

    def one(request: PredictionRequest) -> PassPrediction:
        if request.bridge is not None:
            return predict_bridge(of_bridges, request, driven, progress)
        if request.road is not None:
            return predict_road(state, request, sets, vehicles, driven, stops, progress)
        felt = bumps.at(request)
        over = bumps.vehicles(vehicles, felt, request)
        return predict_pass(campaign, parameters, felt, request, sets, over, driven, stops)

    # A pass over a bridge keeps one thread busy for long at its end.
    over_bridges = [r for r in requests if r.bridge is not None]
    for case in dict.fromkeys(r.load_case for r in over_bridges):
        of_bridges.of(case)
    crossed = iter(side_by_side(one, over_bridges))
    passes = tuple(one(r) if r.bridge is None else next(crossed) for r in requests)
    sets = sets[:SWEEP_DRAWS].T
    few = None if vehicles is None else vehicles.first(SWEEP_DRAWS)
    pairs = dict.fromkeys((r.load_case, r.bump) for r in requests if r.shape is None and r.over_bump)
    speeds = [v / 3.6 for v in sweep_km_h]
    sweeps = tuple(
        speed_sweep(campaign, parameters, case, bump, roads, sets, speeds, progress, few, driven, stops, bumps)
        for case, bump in pairs
        if speeds
    )
    return Predictions(passes, "least squares" if draws is None else "posterior", sweeps)


def _check_load_cases(
    campaign: Campaign, parameters: ParameterSet, requests: Sequence[PredictionRequest], *, drawn: bool
) -> None:
    """Refuse load cases without a stiffness of their own, and where vehicles are drawn those without such draws."""
    for case in dict.fromkeys(r.load_case for r in requests):
        springs = {p.axle for p in parameters.parameters if p.quantity == "stiffness"}
        having = {p.axle for p in parameters.parameters if p.quantity == "stiffness" and p.load_case in (None, case)}
        if springs != having or (drawn and case not in campaign.load_cases_in_use):
            raise CampaignError(
                f"Load case '{case}' is in no run and no prediction of {campaign.file.name}, so the fit has no "
                "values for it; add a prediction in this load case to the file and fit again."
            )
