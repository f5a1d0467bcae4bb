"""Dynamic wheel loads of passes nobody drove, with bands from the posterior."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from sysid.campaign.records import Campaign, PredictionRequest
from sysid.estimation.lane_laws import lane_laws, law_inputs
from sysid.estimation.parameters import ParameterSet
from sysid.estimation.uncertain_masses import MassResponse, uncertain_masses
from sysid.prediction.mass_lanes import forces_of_draws
from sysid.prediction.results import PassPrediction, Predictions
from sysid.road.contact_laws import ContactLaw
from sysid.road.results import RoadProfile
from sysid.vehicle_model import engine
from sysid.vehicle_model.engine import Timing, WheelRoad
from sysid.vehicle_model.lanes import EffectiveRoads, Pass, make_lanes
from sysid.vehicle_model.simulation import Motion

#: Output interval of predicted histories [s], and how long before and after the passage they reach.
INTERVAL_S = 0.001
BEFORE_S = 0.5
AFTER_S = 1.5
#: Number of posterior draws behind the bands.
DRAWS = 200


@partial(jax.jit, static_argnames=("timing",))
def _forces(matrices, laws, road: WheelRoad, log_parameters, motion: Motion, *, timing: Timing) -> jax.Array:
    suspension, tire = lane_laws(laws, log_parameters)
    return engine.simulate_histories(matrices, suspension, tire, motion, road, timing).tire_force[:, 0]


def predict_pass(
    campaign: Campaign,
    parameters: ParameterSet,
    profiles: Mapping[str, RoadProfile],
    request: PredictionRequest,
    log_parameters: np.ndarray,
    draws: np.ndarray | None,
    *,
    contact: ContactLaw = "footprint",
    roads: EffectiveRoads | None = None,
    log_factors: np.ndarray | None = None,
) -> PassPrediction:
    """Tire forces of one pass, for the point estimate and for posterior draws.

    The peak dynamic load ratio of a draw is the maximum over the pass of the unfiltered vertical tire force over the
    static axle load; quantiles are taken over draws, pointwise in time for the bands.

    Parameters
    ----------
    log_parameters : (p,) point estimate, used alone where `draws` is None.
    draws : (n, p) posterior draws of the log parameters, or None.
    log_factors : (n, m) log factors on masses that belong to the draws, None for declared masses.
    """
    roads = roads or EffectiveRoads(campaign.vehicle, campaign.load_cases, profiles, contact)
    wanted = Pass(request.load_case, request.bump)
    lanes = make_lanes(campaign.vehicle, campaign.load_cases, roads, [wanted], [])
    road, speed = lanes.road, request.speed_m_s
    last = road.first_station_m + road.step_m * road.rise.shape[-1]
    # The record starts half a second before axle 1 touches the bump and its time is zero over the start of the bump.
    lead = np.ceil((BEFORE_S - road.first_station_m / speed) / INTERVAL_S) * INTERVAL_S
    samples = int(np.ceil((lead + (last + float(np.max(lanes.axle_x))) / speed + AFTER_S) / INTERVAL_S))
    timing, motion = Timing(samples, INTERVAL_S, 1), Motion(jnp.full((1, 1), speed), jnp.full((1, 1), float(lead)))
    if draws is not None and log_factors is not None:
        masses = uncertain_masses(campaign)
        force = forces_of_draws(lanes, parameters, masses, wanted, draws, log_factors, motion, timing)
    else:
        sets = log_parameters[:, None] if draws is None else draws.T
        laws = law_inputs(campaign.vehicle, parameters, lanes, [request.load_case])
        wheels = engine.wheel_road(lanes.matrices, road, lanes.axle_x, motion.speed, motion.start_s, timing)
        force = np.asarray(_forces(lanes.matrices, laws, wheels, jnp.asarray(sets), motion, timing=timing))
    static = lanes.matrices.static_load[0, :, 0]
    peaks = force.max(axis=0) / static[:, None]
    time = np.round(np.arange(samples) * INTERVAL_S - lead, 6)
    bands = _quantiles(force) if draws is not None else None
    ratios = _quantiles(peaks) if draws is not None else None
    middle = bands[1] if bands is not None else force[..., 0]
    driven = [r.nominal_speed_m_s for r in campaign.bump_runs if r.load_case == request.load_case]
    return PassPrediction(
        load_case=request.load_case,
        speed_m_s=speed,
        time_s=time,
        tire_force_q05_N=None if bands is None else bands[0].T,
        tire_force_q50_N=middle.T,
        tire_force_q95_N=None if bands is None else bands[2].T,
        static_load_N=static,
        peak_ratio_q05=None if ratios is None else ratios[0],
        peak_ratio_q50=peaks[:, 0] if ratios is None else ratios[1],
        peak_ratio_q95=None if ratios is None else ratios[2],
        lift_off=(force.min(axis=0) <= 0.0).mean(axis=1) >= 0.5,
        warnings=_warnings(campaign, request, driven, middle, static),
    )


def _quantiles(values: np.ndarray) -> np.ndarray:
    return np.quantile(values, [0.05, 0.5, 0.95], axis=-1)


def _warnings(campaign: Campaign, request: PredictionRequest, driven: list[float], force, static) -> tuple[str, ...]:
    found = []
    name = f"{request.load_case}, {3.6 * request.speed_m_s:g} km/h"
    if not driven:
        found.append(f"{name}: no run was driven in this load case; the prediction is an extrapolation.")
    elif request.speed_m_s > 1.05 * max(driven):
        found.append(
            f"{name}: faster than any run of this load case ({3.6 * max(driven):g} km/h); the prediction is an "
            "extrapolation."
        )
    travel = [a.jounce_travel_m is not None and a.rebound_travel_m is not None for a in campaign.vehicle.axles]
    peak = force.max(axis=0) / static
    if not all(travel) and np.any(peak > 3.0):
        found.append(
            f"{name}: load ratios above 3 come from a model without bump stops, and no suspension travel is declared "
            "in campaign.toml to judge whether the stops would be reached; do not use them as wheel loads."
        )
    return tuple(found)


def predict(
    campaign: Campaign,
    parameters: ParameterSet,
    profiles: Mapping[str, RoadProfile],
    log_parameters: np.ndarray,
    draws: np.ndarray | None,
    *,
    contact: ContactLaw = "footprint",
    seed: int = 0,
    masses: MassResponse | None = None,
) -> Predictions:
    """All passes that the campaign asks for; `draws` (n, p) in log space are thinned to a few hundred at random.

    Every draw gets masses of its own, drawn as `masses` says that they go with the parameters; None for declared ones.
    """
    random = np.random.default_rng(seed)
    if draws is not None and draws.shape[0] > DRAWS:
        draws = draws[random.choice(draws.shape[0], DRAWS, replace=False)]
    factors = None if draws is None or masses is None else masses.draws(draws, random)
    roads = EffectiveRoads(campaign.vehicle, campaign.load_cases, profiles, contact)
    passes = tuple(
        predict_pass(campaign, parameters, profiles, request, log_parameters, draws, roads=roads, log_factors=factors)
        for request in campaign.predictions
    )
    return Predictions(passes, "least squares" if draws is None else "posterior")
