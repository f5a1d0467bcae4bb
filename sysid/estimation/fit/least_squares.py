"""The least-squares calibration: start values and rounds of re-weighting on the way to the optimum."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from sysid.arrays import Parameters
from sysid.campaign.records import Campaign
from sysid.errors import DataRejectedError
from sysid.estimation.fit.evaluation import evaluate_optimum
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.joint_optimum import joint_optimum
from sysid.estimation.fit.load_case_check import check_load_cases
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.reweighted_search import continued, instrument_noise, optimise_from
from sysid.estimation.fit.start_search import search_motion
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.larger_steps import with_larger_steps
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.weights import noise as noise_model
from sysid.progress import Progress, unwatched
from sysid.road.contact_laws import CONTACT_LAWS
from sysid.road.road_profile import RoadProfile
from sysid.vehicle_model.passes import MapTires

#: Footprint maps are made again at most so often; each time their tires come about five times closer to those of the
#: optimum under them.
_MAPS = 5
_ROUGH_TOLERANCE = 1e-5
#: Laws that do not suit a truck are not fitted to the end: the expected gain of richer ones is known long before.
_FIRST_SIGHT, _FIRST_ITERATIONS = 1e-3, 15
#: Iterations after which a search from another optimum ends that only finds the tires of the next maps: parameters that
#: the data hardly see creep on for long.
_MAP_ITERATIONS = 8


def fit_bump_runs(
    campaign: Campaign,
    parameters: ParameterSet,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions | None = None,
    progress: Progress | None = None,
) -> tuple[FitResult, FitState]:
    """Calibrate the vehicle against all bump runs by least squares.

    minimise sum ((simulated - measured) / sigma)^2 + priors over the global log parameters and every run's speed and
    start. After each round, sigma of every run and channel is estimated again from the residuals. Residuals that are
    correlated in time get less weight, by their variance inflation.

    Parameters
    ----------
    campaign : screened campaign (quality check applied).
    parameters : global parameters with start values and priors.
    profiles : road profile of each bump.
    options, progress : settings, and a callback (message, fraction done).

    Raises
    ------
    DataRejectedError
        If no run has a usable channel, or no run's start is found inside its record.
    """
    options = options or FitOptions()
    report = progress or unwatched
    optimum = optimise(campaign, parameters, profiles, options, report)
    optimum = joint_optimum(campaign, optimum, profiles, options, report)
    return evaluate_optimum(campaign, optimum, options, report)


def optimise(
    campaign: Campaign,
    parameters: ParameterSet,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    report: Progress,
    *,
    near: Optimum | None = None,
    keep_maps: bool = False,
    rough: bool = False,
    larger_steps: bool = False,
) -> Optimum:
    """The optimum of one set of suspension laws, all rounds of re-weighting done.

    Footprint maps are made for the declared tires first, and again until they are those of the estimated ones.

    Parameters
    ----------
    near : optimum of other laws on the same campaign to start from: its motions, weights and common parameters.
    keep_maps : keep the footprint maps of `near`.
    rough : end before the last search, under the weights of one round and maps of `near`, or made again once: enough to
        judge residuals by.
    larger_steps : integrate with the larger steps that searches before the last one have anyway
        (:mod:`sysid.estimation.residuals.larger_steps`): enough to compare optima by.
    """
    report("preparing the model", 0.0)

    def prepared(tires: MapTires | None, of: Campaign = campaign) -> BumpModel:
        step, contact = options.target_step_s, options.contact
        return bump_model(of, parameters, profiles, target_step_s=step, contact=contact, tires=tires)

    again = CONTACT_LAWS[options.contact].follows_tires and not keep_maps
    # For the tires of the maps, weights and minimum need not be exact.
    hasty = replace(
        options, weight_rounds=min(options.weight_rounds, 1), tolerance=max(options.tolerance, _ROUGH_TOLERANCE)
    )
    if rough:
        hasty = replace(hasty, tolerance=_FIRST_SIGHT, max_iterations=min(options.max_iterations, _FIRST_ITERATIONS))
    elif near is not None:
        hasty = replace(hasty, max_iterations=min(options.max_iterations, _MAP_ITERATIONS))
    how = hasty if again or rough else options
    larger = larger_steps or again or rough
    if near is None:
        model, start, weights, damping = prepared(None), parameters.start, None, None
        motion, instrument = _find_motion(campaign, model, start, report)
        check_load_cases(campaign, model, motion, start, instrument, lambda other: prepared(None, other))
    else:
        model, start, weights = prepared(near.problem.model.tires), _start_from(parameters, near), near.problem.weights
        instrument, (_, motion) = near.instrument, near.problem.unpack(near.vector)
        # Elements that are new stand at their start values, perhaps far from their optimum.
        damping = near.minimum.damping if parameters.names == near.problem.model.parameters.names else None
    model = with_larger_steps(model, start, motion) if larger else model
    search = partial(optimise_from, campaign, model, motion, instrument, start, how, report)
    optimum = search(weights=weights, damping=damping)
    if not again or (rough and near is not None):
        return optimum
    for _ in range(1 if rough else _MAPS - 1):
        optimum = _with_own_maps(campaign, optimum, prepared, hasty, report, larger_steps=True)
        tires = optimum.problem.model.tires
        assert tires is not None
        if tires.like(map_tires(parameters, optimum.vector[: optimum.problem.count])):
            break
    if rough:
        return optimum
    return _with_own_maps(campaign, optimum, prepared, options, report, larger_steps=larger_steps)


def _with_own_maps(
    campaign: Campaign,
    before: Optimum,
    prepared: Callable[[MapTires], BumpModel],
    options: FitOptions,
    report: Progress,
    *,
    larger_steps: bool,
) -> Optimum:
    """The optimum under footprint maps of the tires that another optimum has."""
    report("footprint of the estimated tires", 0.5)
    values, motion = before.problem.unpack(before.vector)
    model, weights = prepared(map_tires(before.problem.model.parameters, values)), before.problem.weights
    model = with_larger_steps(model, values, motion) if larger_steps else model
    search = partial(optimise_from, campaign, model, motion, before.instrument, values, options, report)
    return continued(search(weights=weights, damping=before.minimum.damping), before)


def _start_from(parameters: ParameterSet, near: Optimum) -> np.ndarray:
    """Start vector that takes common parameters from another optimum."""
    nearby = dict(zip(near.problem.model.parameters.names, near.vector, strict=False))
    return np.array([nearby.get(p.name, np.log(p.start)) for p in parameters.parameters])


def _find_motion(
    campaign: Campaign, model: BumpModel, start: Parameters, report: Progress
) -> tuple[RunMotion, tuple[np.ndarray, ...]]:
    """Speed and start of every run from the joint search, and the instrument noise (R, C) per group before them."""
    quiet = tuple(noise_model.instrument_noise(g, 0.25) for g in model.groups)
    report("searching speeds and starts", 0.02)
    motion = search_motion(model, campaign, start, quiet)
    _check_motion(campaign, model, motion)
    return motion, instrument_noise(model, motion)


def _check_motion(campaign: Campaign, model: BumpModel, motion: RunMotion) -> None:
    for group in model.groups:
        for run in group.runs:
            length = group.samples * group.interval_s
            if not 0.0 < motion.start_s[run] < length:
                raise DataRejectedError(
                    f"{campaign.bump_runs[run].log.file}: the passage of axle 1 over the bump is not inside the record "
                    f"(found at {motion.start_s[run]:.2f} s of {length:.2f} s); check that the log starts before it."
                )
