"""The least-squares calibration: start values, and the phases of a search on the way to the optimum."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from sysid.arrays import Parameters
from sysid.campaign.records import Campaign
from sysid.errors import DataRejectedError
from sysid.estimation.fit.evaluation import evaluate_optimum
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.helper_travel import HELPER_TRAVEL, compressions_by_load, tried_helper_travel
from sysid.estimation.fit.joint_optimum import joint_optimum
from sysid.estimation.fit.load_case_check import check_load_cases, misfits
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.options import FitOptions, Phase
from sysid.estimation.fit.reweighted_search import continued, instrument_noise, optimise_from
from sysid.estimation.fit.search_plan import Plan, exact, glance
from sysid.estimation.fit.start_search import search_motion
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.parameters.parameter_set import Parameter, ParameterSet
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.run_paths import with_run_paths
from sysid.estimation.weights import noise as noise_model
from sysid.progress import Progress, Series, unwatched
from sysid.road.contact_laws import CONTACT_LAWS
from sysid.road.road_profile import RoadProfile
from sysid.vehicle_model.passes import MapTires


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
    report = Series(progress or unwatched)
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
    plan: Plan = exact,
    near: Optimum | None = None,
    begin: Optimum | None = None,
) -> Optimum:
    """The optimum of one set of suspension laws, by the phases of a plan.

    Parameters
    ----------
    plan : one of :mod:`sysid.estimation.fit.search_plan`.
    near : optimum of other laws on the same campaign to start from: its motions, weights, maps and common parameters.
        None to begin at the start values, under maps of the declared tires.
    begin : without one near, the optimum of the same laws on some of the runs, whose parameters take the place of the
        start values.
    """
    report("preparing the model", 0.0)

    def prepared(tires: MapTires | None, of: Campaign = campaign) -> BumpModel:
        step, contact = options.target_step_s, options.contact
        return bump_model(of, parameters, profiles, target_step_s=step, contact=contact, tires=tires)

    def under_own_maps(before: Optimum, phase: Phase) -> Optimum:
        """The optimum under footprint maps of the tires that another optimum has."""
        report("footprint of the estimated tires", 0.5)
        values, motion = before.problem.unpack(before.vector)
        old = before.problem.model
        model = prepared(with_run_paths(map_tires(old.parameters, values), old, values, motion))
        search = partial(optimise_from, campaign, model, motion, before.instrument, values, phase, report)
        return continued(search(weights=before.problem.weights, damping=before.minimum.damping), before)

    phases = plan(options, near is not None)
    if near is None:
        start = parameters.start if begin is None else _start_from(parameters, begin)
        follows = begin is not None and CONTACT_LAWS[options.contact].follows_tires
        tires = map_tires(parameters, start) if follows else None
        model, weights, damping = prepared(tires), None, None
        motion, instrument = _find_motion(campaign, model, start, report)

        def fitted(of: Campaign) -> np.ndarray:
            found = optimise_from(of, prepared(tires, of), motion, instrument, start, glance(options), report)
            values, moved = found.problem.unpack(found.vector)
            return misfits(found.problem.model, moved, values, instrument)

        check_load_cases(campaign, model, motion, start, instrument, partial(prepared, tires), fitted)
    else:
        model, start, weights = prepared(near.problem.model.tires), _start_from(parameters, near), near.problem.weights
        instrument, (_, motion) = near.instrument, near.problem.unpack(near.vector)
        # Elements that are new stand at their start values, perhaps far from their optimum.
        damping = near.minimum.damping if parameters.names == near.problem.model.parameters.names else None
    search = partial(optimise_from, campaign, model, motion, instrument, start, phases.first, report)
    optimum = search(weights=weights, damping=damping)
    for _ in range(phases.map_rounds):
        optimum = under_own_maps(optimum, phases.first)
        felt = optimum.problem.model.tires
        assert felt is not None
        if felt.like(map_tires(parameters, optimum.vector[: optimum.problem.count])):
            break
    return optimum if phases.last is None else under_own_maps(optimum, phases.last)


def _start_from(parameters: ParameterSet, near: Optimum) -> np.ndarray:
    """Start vector that takes common parameters from another optimum; new helper leaves begin where they show."""
    nearby = dict(zip(near.problem.model.parameters.names, near.vector, strict=False))
    compressed = compressions_by_load(near)

    def start(p: Parameter) -> float:
        if p.quantity == HELPER_TRAVEL and p.axle is not None:
            return tried_helper_travel(p.start, compressed.get(p.axle))
        return p.start

    return np.array([nearby.get(p.name, np.log(start(p))) for p in parameters.parameters])


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
