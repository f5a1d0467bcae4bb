"""The least-squares calibration: start values and rounds of re-weighting on the way to the optimum."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from sysid.campaign.records import Campaign
from sysid.errors import DataRejectedError
from sysid.estimation import noise as noise_model
from sysid.estimation.bump_model import BumpModel, bump_model
from sysid.estimation.conclusion import conclude, residual_correlations
from sysid.estimation.fit_options import FitOptions
from sysid.estimation.levenberg_marquardt import Minimum, minimise
from sysid.estimation.motion_search import search_motion
from sysid.estimation.objective import Linearisation, RunMotion, Weights
from sysid.estimation.parameters import ParameterSet
from sysid.estimation.problem import FitState, Optimum, Problem
from sysid.estimation.results import FitResult
from sysid.road.results import RoadProfile

Progress = Callable[[str, float], None]


def fit_bump_runs(
    campaign: Campaign,
    parameters: ParameterSet,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions | None = None,
    progress: Progress | None = None,
) -> tuple[FitResult, FitState]:
    """Calibrate the vehicle against all bump runs by least squares.

    minimise sum ((simulated - measured) / sigma)^2 + priors over the global log parameters and every run's speed and
    start; sigma per run and channel is re-estimated from the residuals after each round, and residuals that are
    correlated in time are down-weighted by their variance inflation.

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
    report = progress or (lambda message, fraction: None)
    optimum = optimise(campaign, parameters, profiles, options, report)
    return conclude(campaign, optimum, options, report)


def optimise(
    campaign: Campaign,
    parameters: ParameterSet,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    report: Progress,
    *,
    near: Optimum | None = None,
) -> Optimum:
    """The optimum of one set of suspension laws, all rounds of re-weighting done.

    Parameters
    ----------
    near : optimum of other laws on the same campaign to start from: its motions, weights and common parameters.
    """
    report("preparing the model", 0.0)
    model = bump_model(campaign, parameters, profiles, target_step_s=options.target_step_s, contact=options.contact)
    if near is None:
        motion, instrument = _find_motion(campaign, model, parameters.start, report)
        return optimise_from(campaign, model, motion, instrument, parameters.start, options, report)
    _, motion = near.problem.unpack(near.vector)
    start = _start_from(parameters, near)
    weights = near.problem.weights
    return optimise_from(campaign, model, motion, near.instrument, start, options, report, weights=weights)


def optimise_from(
    campaign: Campaign,
    model: BumpModel,
    motion: RunMotion,
    instrument: tuple[np.ndarray, ...],
    start: np.ndarray,
    options: FitOptions,
    report: Progress,
    *,
    weights: Weights | None = None,
) -> Optimum:
    """The optimum from given start values, all rounds of re-weighting done.

    Parameters
    ----------
    motion : speed and start of every run.
    instrument : (R, C) instrument noise per group [SI].
    start : (p,) log parameters.
    weights : those of the first round; None for weights that suit parameters which are still far off.
    """
    first_weights = Weights(_first_scale(model, instrument), tuple(np.ones_like(n) for n in instrument))
    problem = Problem(model, campaign, motion, weights or first_weights)
    vector = np.concatenate([start, np.zeros(2 * len(problem.order))])
    first, iterations, rounds = vector.copy(), 0, options.weight_rounds + 1
    minimum: Minimum | None = None
    for number in range(rounds):
        last = number == rounds - 1
        minimum = minimise(
            problem.evaluate,
            vector,
            relative_tolerance=options.tolerance if last else 1e-4,
            max_iterations=options.max_iterations,
            on_iteration=partial(_report_iteration, report, number, rounds),
        )
        vector = minimum.point
        iterations += minimum.iterations
        if not last:
            problem.weights = reweighted(problem, problem.linearise(vector))
    assert minimum is not None
    return Optimum(problem, vector, first, replace(minimum, iterations=iterations), instrument)


def optimum_under(optimum: Optimum, weights: Weights, options: FitOptions) -> Optimum:
    """The optimum of the same laws under other weights, for costs that can be compared."""
    problem = optimum.problem.with_weights(weights)
    minimum = minimise(
        problem.evaluate,
        optimum.vector,
        relative_tolerance=max(options.tolerance, 1e-6),
        max_iterations=options.max_iterations,
    )
    return replace(optimum, problem=problem, vector=minimum.point, minimum=minimum)


def _start_from(parameters: ParameterSet, near: Optimum) -> np.ndarray:
    """Start vector that takes common parameters from another optimum."""
    found = dict(zip(near.problem.model.parameters.names, near.vector, strict=False))
    return np.array([found.get(p.name, np.log(p.start)) for p in parameters.parameters])


def _find_motion(
    campaign: Campaign, model: BumpModel, start: np.ndarray, report: Progress
) -> tuple[RunMotion, tuple[np.ndarray, ...]]:
    """Speed and start of every run from the joint search, and the instrument noise (R, C) per group before them."""
    quiet = tuple(noise_model.instrument_noise(g, 0.25) for g in model.groups)
    report("searching speeds and starts", 0.02)
    motion = search_motion(model, campaign, start, quiet)
    _check_motion(campaign, model, motion)
    return motion, instrument_noise(model, motion)


def instrument_noise(model: BumpModel, motion: RunMotion) -> tuple[np.ndarray, ...]:
    """Instrument noise (R, C) per group [SI], from the records before their runs meet the bump."""
    return tuple(
        noise_model.instrument_noise(g, noise_model.quiet_time(model, g, motion.start_s, motion.speed_m_s))
        for g in model.groups
    )


def _report_iteration(report: Progress, number: int, rounds: int, iteration: int, cost: float) -> None:
    share = (number + iteration / (iteration + 8)) / rounds
    report(f"least squares, round {number + 1} of {rounds}, iteration {iteration}", 0.1 + 0.8 * share)


def _first_scale(model: BumpModel, instrument: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """First weights: instrument noise plus a tenth of each channel's RMS, for parameters that are still far off."""
    scales = []
    for group, noise in zip(model.groups, instrument, strict=True):
        count = np.maximum(group.measured.sum(axis=0), 1)
        mean = (group.measured * group.value).sum(axis=0) / count
        rms = np.sqrt((group.measured * (group.value - mean) ** 2).sum(axis=0) / count)
        scales.append(np.hypot(noise, 0.1 * rms))
    return tuple(scales)


def reweighted(problem: Problem, linearisations: tuple[Linearisation, ...]) -> Weights:
    """Residual scales, and tempering by the residuals' variance inflation, from the residuals of a round."""
    scales = []
    for group, lin, noise, temper in zip(
        problem.model.groups, linearisations, problem.weights.noise_sd, problem.weights.tempering, strict=True
    ):
        scale = np.where(np.isfinite(noise), noise, 0.0) / temper
        scales.append(noise_model.residual_scale(group, np.asarray(lin.residual) * scale))
    inflation = [noise_model.variance_inflation(c) for c in residual_correlations(problem, linearisations)]
    return Weights(tuple(scales), tuple(1.0 / np.sqrt(v) for v in inflation))


def _check_motion(campaign: Campaign, model: BumpModel, motion: RunMotion) -> None:
    for group in model.groups:
        for run in group.runs:
            length = group.samples * group.interval_s
            if not 0.0 < motion.start_s[run] < length:
                raise DataRejectedError(
                    f"{campaign.bump_runs[run].log.file}: the passage of axle 1 over the bump is not inside the record "
                    f"(found at {motion.start_s[run]:.2f} s of {length:.2f} s); check that the log starts before it."
                )
