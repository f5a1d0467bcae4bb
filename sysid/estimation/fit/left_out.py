"""A run predicted by a fit that has not seen it: the parameters of the other runs, its own motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid.arrays import Parameters
from sysid.campaign.records import Campaign
from sysid.estimation.fit.minimiser import minimise
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.reweighted_search import instrument_noise, noise_before, optimise_from
from sysid.estimation.fit.state import FitState, model_of
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.histories import run_histories
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_history import RunHistory
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.run_paths import about_own_paths
from sysid.estimation.residuals.side_signals import with_sides
from sysid.progress import Progress, unwatched
from sysid.vehicle_model.passes import MapTires


@dataclass(frozen=True)
class LeftOutFit:
    """`log_parameters` (p,) of the fit without the run, whether it `converged`, and the run's `history` under them."""

    log_parameters: Parameters
    converged: bool
    history: RunHistory


def fit_without(
    state: FitState,
    run: int,
    options: FitOptions,
    progress: Progress | None = None,
) -> LeftOutFit:
    """Fit all runs but one, beginning at the optimum of all, and simulate that one with the resulting parameters.

    The run's own motion, and offset and gain of its sensors, are found from its record, because no other data determine
    them. They are 3 numbers per run and 2 per channel.

    Parameters
    ----------
    state : the fit of all runs.
    run : index of the run in the campaign.
    """
    report = progress or unwatched
    others = tuple(i for i in range(len(state.campaign.bump_runs)) if i != run)
    part, model, motion, weights = _part(state, others)
    noise, phase = instrument_noise(model, motion), options.phase(weight_rounds=1)
    optimum = optimise_from(part, model, motion, noise, state.point.log_parameters, phase, report, weights=weights)
    values, _ = optimum.problem.unpack(optimum.vector)
    part, model, motion, weights = _part(state, (run,))
    motion = _own_motion(Problem(model, part, motion, weights), values)
    (history,) = run_histories(part, model, weights, motion, values, *noise_before(model, motion))
    return LeftOutFit(values, optimum.minimum.converged, history)


def driven_by(truck: FitState, recorded: FitState, run: int) -> RunHistory:
    """A run of one campaign as the truck of another fit drives it: the parameters, masses and contact of that fit.

    Motion, offset and gain of sensors are found from the record, as for a run that is left out; the noise is that of
    the campaign that recorded it.

    Parameters
    ----------
    truck : a fit of the same vehicle, with the load case of the run.
    run : index of the run in the campaign of `recorded`.
    """
    part, own, motion, weights = _part(recorded, (run,))
    campaign, point = replace(truck.campaign, bump_runs=part.bump_runs), truck.point

    def driven(tires: MapTires | None) -> BumpModel:
        # Its own bumps too: what a fit found of their heights is counted by bump.
        profiles = {**truck.profiles, **recorded.profiles}
        model = model_of(campaign, profiles, replace(point, tires=tires), truck.campaign)
        return with_sides(model, point.log_parameters, motion)

    # Over edges its wheels go other ways than those of the truck in a run of that name.
    model = driven(point.tires and replace(point.tires, paths={}))
    motion = _own_motion(Problem(model, campaign, motion, weights), point.log_parameters)
    model = about_own_paths(model, point.log_parameters, motion, driven)
    noise = noise_before(own, motion)
    (history,) = run_histories(campaign, model, weights, motion, point.log_parameters, *noise)
    return history


def _own_motion(problem: Problem, log_parameters: Parameters) -> RunMotion:
    """Motions that suit the records best while the parameters stay as they are."""

    def evaluate(local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual, jacobian = problem.evaluate(np.concatenate([log_parameters, local]))
        return residual, jacobian[:, problem.count :]

    best = minimise(evaluate, problem.vector(log_parameters)[problem.count :], relative_tolerance=1e-7)
    return problem.unpack(np.concatenate([log_parameters, best.point]))[1]


def _part(state: FitState, runs: tuple[int, ...]) -> tuple[Campaign, BumpModel, RunMotion, Weights]:
    """Some runs of a campaign as a campaign of their own, with their motions and weights in the fit of all runs."""
    part = replace(state.campaign, bump_runs=tuple(state.campaign.bump_runs[i] for i in runs))
    model = model_of(part, state.profiles, state.point, state.campaign)
    fitted, driven = state.point.weights, state.point.motion
    chosen = list(runs)
    motion = driven.of(chosen)
    model = with_sides(model, state.point.log_parameters, motion)
    columns = [s.column for s in state.model.layout.sensors]
    channels = [columns.index(s.column) for s in model.layout.sensors]

    def rows(arrays: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        of_run = {
            i: row for g, a in zip(state.model.groups, arrays, strict=True) for i, row in zip(g.runs, a, strict=True)
        }
        return tuple(np.array([of_run[chosen[r]][channels] for r in g.runs]) for g in model.groups)

    weights = Weights(rows(fitted.noise_sd), rows(fitted.tempering))
    if fitted.reading is not None:
        groups = zip(state.model.groups, fitted.reading, strict=True)
        of_run = {i: w[:, r] for g, w in groups for r, i in enumerate(g.runs)}
        reading = tuple(np.ones(g.value.shape) for g in model.groups)
        for group, weight in zip(model.groups, reading, strict=True):
            for r, i in enumerate(group.runs):
                fitted_weight = of_run[chosen[i]][: group.samples, channels]
                weight[: fitted_weight.shape[0], r] = fitted_weight
        weights = replace(weights, reading=reading)
    return part, model, motion, weights
